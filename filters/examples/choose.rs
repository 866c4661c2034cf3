//! A picture in rounds: a tenth of the pixels by a pattern, then the next ones where the estimated error is largest.

use std::sync::Arc;

use lacuna_filters::metric::error;
use lacuna_filters::sampling::refine::{self, Preference};
use lacuna_filters::sampling::{Field, Pattern, Temporal, mask};
use lacuna_filters::{Error, Mask, Method, Options, Plane, Planes, Run, Size, fill};

fn main() -> Result<(), Error> {
    let size = Size::new(96, 128);
    // Stands for a renderer.
    let truth =
        Plane::from_fn(size, |y, x| if (x as f32 - 60.0).hypot(y as f32 - 50.0) < 30.0 { 1.0 } else { 0.2 });
    let samples = Planes::from(truth.clone());

    let field = Field { x: 0, y: 0, size };
    let mut measured = Arc::new(mask(Pattern::Shuffle, field, 0.1, 1, Temporal::Fixed, 0)?);
    for round in 0..3 {
        let filled = fill(&samples, Arc::clone(&measured), &Options::default())?;
        let found = error::compare(&truth, &filled.planes.as_slice()[0], None, error::Options::default())?;
        let psnr = found.psnr(1.0).unwrap_or(f64::INFINITY);
        show(&format!("round {round}: {:.1} % measured, {psnr:.1} dB", 100.0 * measured.density()));

        let estimate = refine::estimate(&samples, &measured, Method::default().filter(), &Run::default())?;
        let mut flags = measured.as_slice().to_vec();
        for pixel in estimate.next(size.pixels() / 50, field, Preference::new(1, None), |_| true) {
            flags[pixel] = true;
        }
        measured = Arc::new(Mask::new(size, flags)?);
    }
    Ok(())
}

#[allow(clippy::print_stdout, reason = "a program that shows what it does")]
fn show(line: &str) {
    println!("{line}");
}
