//! Enlarges an image with a missing pixel: what is missing is filled on the way, and light stays light.

use lacuna_filters::enlarge::{Options, upscale};
use lacuna_filters::upscale::{Geometry, Sampling};
use lacuna_filters::{Mask, Planes, Size};
use ndarray::Array2;

fn main() -> Result<(), lacuna_filters::Error> {
    let mut small =
        Array2::from_shape_fn((48, 64), |(y, x)| if (y / 8 + x / 8) % 2 == 0 { 1.0_f32 } else { 0.0 });
    small[(20, 20)] = f32::NAN;

    let samples = Planes::from(small);
    let mut options = Options::new(Geometry::scaled(Size::new(48, 64), 2.0, Sampling::Box));
    options.mask = Some(Mask::finite(&samples).into());
    let large = upscale(&samples, &options)?;

    let image = Array2::try_from(large.planes)?;
    let least = image.iter().copied().fold(f32::INFINITY, f32::min);
    show(&format!("{:?}, {} values limited, none below {least}", image.dim(), large.limited[0].values));
    Ok(())
}

#[allow(clippy::print_stdout, reason = "a program that shows what it does")]
fn show(line: &str) {
    println!("{line}");
}
