//! The rival of every choice of pixels: the frame at half its resolution, a quarter of the pixels, enlarged by Lanczos.
//!
//! A small pixel is the mean of the two by two that it covers (fewer at the border of an odd size): a renderer that smooths its edges, and takes four
//! rays for each of them. With one ray through its middle it would alias; so the rival is shown at its best.

use lacuna_exr::{Frame, Samples};
use lacuna_filters::upscale::plain::Kernel;
use lacuna_filters::upscale::{Axis, Geometry, Method, Sampling};
use lacuna_filters::{Plane, Planes, Size, enlarge, upscale};

/// How it is enlarged.
pub const KERNEL: Kernel = Kernel::Lanczos3;
/// Its pixels over those of the frame.
pub const DENSITY: f64 = 0.25;
/// Pixels of the frame along each edge of a small one.
const SIDE: usize = 2;

/// The frame from its small image.
///
/// # Errors
/// A frame of which nothing is finite.
pub fn enlarged(mut frame: Frame) -> Result<Frame, String> {
    for part in &mut frame.parts {
        let size = part.size();
        let axis = |pixels: usize| Axis {
            inputs: pixels.div_ceil(SIDE),
            outputs: pixels,
            scale: SIDE as f64,
            shift: 0.0,
        };
        let geometry =
            Geometry { vertical: axis(size.height), horizontal: axis(size.width), sampling: Sampling::Box };
        let small = part.channels.iter().map(|channel| halved(size, &channel.samples.as_f32()));
        let small = Planes::new(geometry.low(), small.collect()).map_err(|error| error.to_string())?;
        let mut options = enlarge::Options::new(geometry);
        options.method = Method::Plain(KERNEL);
        let large = upscale(&small, &options).map_err(|error| error.to_string())?;
        for (channel, plane) in part.channels.iter_mut().zip(large.planes.as_slice()) {
            channel.samples = Samples::Float(plane.pixels().to_vec());
        }
    }
    Ok(frame)
}

/// Means of the finite pixels under each small one; not a number where there are none.
fn halved(size: Size, values: &[f32]) -> Plane {
    let small = Size::new(size.height.div_ceil(SIDE), size.width.div_ceil(SIDE));
    Plane::from_fn(small, |y, x| {
        let rows = SIDE * y..(SIDE * y + SIDE).min(size.height);
        let columns = SIDE * x..(SIDE * x + SIDE).min(size.width);
        let under = rows.flat_map(|y| values[y * size.width..][columns.clone()].iter());
        let (sum, count) = under
            .filter(|value| value.is_finite())
            .fold((0.0, 0.0), |(sum, count), value| (sum + f64::from(*value), count + 1.0));
        (sum / count) as f32
    })
}
