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

fn part(text: &str, range: &str, fits: impl Fn(&f64) -> bool) -> Result<f64, String> {
    let percent =
        text.trim_end_matches([' ', '%']).parse().ok().map(|value: f64| value / 100.0).filter(&fits);
    number(text, range, fits).map_err(|why| match percent {
        Some(part) => format!("{why}: {} % is {part}", text.trim_end_matches([' ', '%'])),
        None => why,
    })
}
