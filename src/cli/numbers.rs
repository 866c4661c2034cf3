//! Numbers in their ranges, as several flags take them.

use std::fmt::Display;
use std::str::FromStr;

fn number<T: FromStr>(text: &str, range: impl Display, fits: impl Fn(&T) -> bool) -> Result<T, String> {
    text.parse().ok().filter(fits).ok_or_else(|| format!("it must be a number {range}"))
}

pub fn zero_or_more(text: &str) -> Result<f64, String> {
    number(text, "of 0 or more", |value: &f64| *value >= 0.0 && value.is_finite())
}

pub fn one_or_more(text: &str) -> Result<u32, String> {
    number(text, "of 1 or more", |value: &u32| *value >= 1)
}

pub fn fraction(text: &str) -> Result<f64, String> {
    part(text, "from 0 to 1", |value| (0.0..=1.0).contains(value))
}

/// A density: no pixel at all is nothing to fill from.
pub fn density(text: &str) -> Result<f64, String> {
    part(text, "above 0 and at most 1", |value| *value > 0.0 && *value <= 1.0)
}

/// The value that counts as white.
pub fn peak(text: &str) -> Result<f32, String> {
    number(text, "above 0", |value: &f32| *value > 0.0 && value.is_finite())
}

/// Whole numbers of a scene's file have a sign.
pub fn seed_of_scene(text: &str) -> Result<u64, String> {
    let most = i64::MAX.unsigned_abs();
    number(text, format_args!("from 0 to {most}"), |value: &u64| *value <= most)
}

/// The length of a step in voxels.
pub fn step(text: &str) -> Result<f64, String> {
    number(text, "from 0.001 to 1000", |value: &f64| (1e-3..=1e3).contains(value))
}

fn part(text: &str, range: &str, fits: impl Fn(&f64) -> bool) -> Result<f64, String> {
    let bare = text.trim_end_matches([' ', '%']);
    // By its digits: a division would show what it rounds.
    let percent = format!("{bare}e-2").parse().ok().filter(&fits);
    number(text, range, fits).map_err(|why| match percent {
        Some(part) => format!("{why}: {bare} % is {part}"),
        None => why,
    })
}
