//! Fills an image of which every third diagonal was measured, and says how far it is from the complete one.

use lacuna_filters::{Mask, Options, Planes, fill};
use ndarray::Array2;

fn main() -> Result<(), lacuna_filters::Error> {
    let truth = |y: usize, x: usize| 0.5 + 0.5 * (y as f32 / 9.0).sin() * (x as f32 / 7.0).cos();
    let sparse = |(y, x): (usize, usize)| if (y + 2 * x) % 5 == 0 { truth(y, x) } else { f32::NAN };

    let samples = Planes::from(Array2::from_shape_fn((120, 160), sparse));
    let filled = fill(&samples, Mask::finite(&samples), &Options::default())?;
    let image = Array2::try_from(filled.planes)?;

    let worst = image.indexed_iter().map(|((y, x), value)| (value - truth(y, x)).abs()).fold(0.0, f32::max);
    show(&format!("{:?}, at most {worst:.4} off", filled.outcome.stop));
    Ok(())
}

#[allow(clippy::print_stdout, reason = "a program that shows what it does")]
fn show(line: &str) {
    println!("{line}");
}
