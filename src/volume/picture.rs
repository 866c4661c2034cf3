//! Rendering an image: tiles over threads, rays over pixels, only where the mask says.
//!
//! Every pixel is computed by itself, so that it has the same bits in a sparse picture, in any tile and for any number of
//! threads. With one sample a pixel the ray goes through its centre; with several they follow an additive recurrence
//! with the powers of the plastic number, turned by a hash of pixel and seed, and are averaged.
//!
//! Source of the pattern: M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use lacuna_core::Size;
use lacuna_core::parallel::prelude::*;

use super::blocks::Blocks;
use super::camera::{Camera, clip};
use super::dense::Dense;
use super::grid::Grid;
use super::integral::Integral;
use super::kernel::{Cubic, Kernel, Linear, Nearest};
use super::march::{March, Seen};
use super::shade::{Shader, ToWorld};
use super::surface::{Surface, maximum};
use super::tiles::{self, Done};
use super::transfer::Table;
use super::walk::Walk;
use super::weights::{BSpline, CatmullRom};

/// Half the distance of finite differences, in pixels.
const DIFFERENCE: f64 = 0.25;
/// No difference, then one before and one after along x and y.
const AROUND: [(f64, f64); 5] =
    [(0.0, 0.0), (-DIFFERENCE, 0.0), (DIFFERENCE, 0.0), (0.0, -DIFFERENCE), (0.0, DIFFERENCE)];

/// How values between voxels are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The nearest voxel.
    Nearest,
    /// Linear along each axis.
    Linear,
    /// Cubic B-spline weights on what the grid holds: voxels (which smooths) or spline coefficients.
    BSpline,
    /// The cubic of Catmull and Rom.
    CatmullRom,
}

/// What a ray looks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Look {
    /// Direct volume rendering.
    Dvr,
    /// The first surface of a value, in a colour.
    Iso(f32, [f32; 3]),
    /// The largest value.
    Mip,
    /// Colour without light, alpha, normal and mean depth: see `dense`.
    Dense,
}

/// Everything that rendering needs and that does not change from frame to frame.
#[derive(Clone, Debug)]
pub struct Renderer {
    /// The volume.
    pub grid: Arc<Grid>,
    /// The interpolation.
    pub interpolation: Interpolation,
    /// What rays look for.
    pub look: Look,
    /// The transfer function for the steps of the march.
    pub table: Table,
    /// Its integrals, if segments are pre-integrated.
    pub integral: Option<Integral>,
    /// Where normals come from.
    pub to_world: ToWorld,
    /// Where there is something to see; nothing walks through everything.
    pub blocks: Option<Arc<Blocks>>,
    /// World length of a step.
    pub step: f64,
    /// The march ends at this opacity.
    pub opaque: f32,
    /// Alpha of the surface that depth tells of `Look::Dvr`.
    pub threshold: f32,
    /// Behind everything: premultiplied red, green, blue and alpha.
    pub background: [f32; 4],
}

/// One image of a renderer's volume.
#[derive(Clone, Copy, Debug)]
pub struct Shot<'a> {
    /// The camera.
    pub camera: &'a Camera,
    /// The shading, which depends on where the camera's lights are.
    pub shader: Option<&'a Shader>,
    /// Height and width.
    pub size: Size,
    /// The pixels to render, `size` row-major; nothing renders all.
    pub mask: Option<&'a [bool]>,
    /// Samples a pixel, 1 or more.
    pub samples: u32,
    /// Of their pattern.
    pub seed: u64,
    /// Whether normals are wanted.
    pub normals: bool,
    /// Whether depths are wanted.
    pub depth: bool,
    /// Whether derivatives are wanted.
    pub gradients: bool,
}

/// What was rendered: planes, row by row, with zeros where no pixel was. What was not wanted is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Red, green, blue, premultiplied, and alpha.
    pub colour: [Vec<f32>; 4],
    /// The surface normal, of length 1; zeros without one.
    pub normal: [Vec<f32>; 3],
    /// Distance from the camera to the surface; infinite without one.
    pub depth: Vec<f32>,
    /// The colour's derivative by columns, then by rows (downwards), per pixel.
    pub slopes: [[Vec<f32>; 4]; 2],
}

/// What was rendered of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Red, green, blue, premultiplied, and alpha.
    pub colour: [f32; 4],
    /// The surface normal, of length 1; zeros without one.
    pub normal: [f32; 3],
    /// Distance from the camera to the surface; infinite without one.
    pub depth: f32,
    /// The colour's derivative by columns, then by rows (downwards), per pixel.
    pub slopes: [[f32; 4]; 2],
}

impl Pixel {
    const NOTHING: Self =
        Self { colour: [0.0; 4], normal: [0.0; 3], depth: f32::INFINITY, slopes: [[0.0; 4]; 2] };
}

/// Which instructions of the machine tiles are rendered with. All of them give the same bits, as no multiplication is
/// fused with a sum.
#[derive(Clone, Copy, Debug)]
pub enum Instructions {
    /// The widest that the machine has.
    Best,
    /// Those that every machine has.
    #[cfg(test)]
    Plain,
    /// Vectors of 256 bits.
    #[cfg(all(test, target_arch = "x86_64"))]
    Wide(pulp::x86::V3),
}

impl Instructions {
    /// All kinds that this machine has.
    #[cfg(test)]
    pub fn kinds() -> Vec<Self> {
        let kinds = vec![Self::Best, Self::Plain];
        #[cfg(target_arch = "x86_64")]
        let kinds = kinds.into_iter().chain(pulp::x86::V3::try_new().map(Self::Wide)).collect();
        kinds
    }

    fn run<W: pulp::WithSimd>(self, work: W) -> W::Output {
        match self {
            Self::Best => pulp::Arch::new().dispatch(work),
            #[cfg(test)]
            Self::Plain => pulp::Simd::vectorize(pulp::Scalar::new(), work),
            #[cfg(all(test, target_arch = "x86_64"))]
            Self::Wide(simd) => pulp::Simd::vectorize(simd, work),
        }
    }
}

impl Shot<'_> {
    /// The numbers that are kept of a pixel, in the order of [`Self::planes`].
    #[inline(always)]
    fn keep(&self, pixel: &Pixel, kept: &mut Vec<f32>) {
        kept.extend_from_slice(&pixel.colour);
        if self.normals {
            kept.extend_from_slice(&pixel.normal);
        }
        if self.depth {
            kept.push(pixel.depth);
        }
        if self.gradients {
            kept.extend_from_slice(pixel.slopes.as_flattened());
        }
    }

    /// The planes of a picture that are wanted, in that order; zeros where there are none yet.
    fn planes<'a>(&self, picture: &'a mut Picture) -> Vec<&'a mut Vec<f32>> {
        let Picture { colour, normal, depth, slopes } = picture;
        let normal = normal.iter_mut().filter(|_| self.normals);
        let slopes = slopes.as_flattened_mut().iter_mut().filter(|_| self.gradients);
        let planes = colour.iter_mut().chain(normal).chain(Some(depth).filter(|_| self.depth)).chain(slopes);
        let mut all: Vec<_> = planes.collect();
        for plane in &mut all {
            plane.resize(self.size.pixels(), 0.0);
        }
        all
    }
}

/// Renders a shot. `advance` is told of tiles as they are done, out of [`tiles::tiles`]; if it answers
/// `false` the rest is left out.
pub fn render(renderer: &Renderer, shot: &Shot<'_>, advance: &(dyn Fn() -> bool + Sync)) -> Picture {
    let mut picture = Picture::default();
    render_onto(&mut picture, renderer, shot, advance);
    picture
}

/// The same onto a picture of such a shot with other pixels, or an empty one; the pixels that are not asked for stay as they are.
pub fn render_onto(
    picture: &mut Picture,
    renderer: &Renderer,
    shot: &Shot<'_>,
    advance: &(dyn Fn() -> bool + Sync),
) {
    render_by(picture, renderer, shot, Instructions::Best, advance);
}

/// The same with these instructions.
pub fn render_by(
    picture: &mut Picture,
    renderer: &Renderer,
    shot: &Shot<'_>,
    instructions: Instructions,
    advance: &(dyn Fn() -> bool + Sync),
) {
    let going = AtomicBool::new(true);
    let one = |number: usize| {
        if !going.load(Ordering::Relaxed) {
            return Done::default();
        }
        let kept = renderer.tile(shot, number, instructions);
        if !advance() {
            going.store(false, Ordering::Relaxed);
        }
        kept
    };
    let done = (0..tiles::tiles(shot.size)).into_par_iter().with_max_len(1).map(one);
    tiles::put(shot.size, &done, shot.planes(picture));
}

/// A tile to be rendered.
struct Tile<'a, K> {
    renderer: &'a Renderer,
    kernel: K,
    shot: &'a Shot<'a>,
    number: usize,
}

impl<K: Kernel> pulp::WithSimd for Tile<'_, K> {
    type Output = Done;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Done {
        self.renderer.tile_by(self.kernel, self.shot, self.number)
    }
}

impl Renderer {
    fn tile(&self, shot: &Shot<'_>, number: usize, instructions: Instructions) -> Done {
        match self.interpolation {
            Interpolation::Nearest => {
                instructions.run(Tile { renderer: self, kernel: Nearest, shot, number })
            }
            Interpolation::Linear => instructions.run(Tile { renderer: self, kernel: Linear, shot, number }),
            Interpolation::BSpline => {
                instructions.run(Tile { renderer: self, kernel: Cubic(BSpline), shot, number })
            }
            Interpolation::CatmullRom => {
                instructions.run(Tile { renderer: self, kernel: Cubic(CatmullRom), shot, number })
            }
        }
    }

    #[inline(always)]
    fn tile_by<K: Kernel>(&self, kernel: K, shot: &Shot<'_>, number: usize) -> Done {
        let mut done = Done::default();
        for (place, (y, x)) in tiles::pixels(shot.size, shot.mask, number) {
            done.places.push(place);
            shot.keep(&self.pixel(kernel, shot, (x, y)), &mut done.numbers);
        }
        done
    }

    #[inline(always)]
    fn pixel<K: Kernel>(&self, kernel: K, shot: &Shot<'_>, (x, y): (usize, usize)) -> Pixel {
        let mut pixel = Pixel::NOTHING;
        let share = 1.0 / shot.samples as f32;
        // The sample itself, then those before and after it along x and y.
        let rays = if shot.gradients { 5 } else { 1 };
        for index in 0..shot.samples {
            let (dx, dy) = offset(shot, (x, y), index);
            for (k, (right, down)) in AROUND.into_iter().enumerate().take(rays) {
                let (seen, depth) = self.ray(kernel, shot, x as f64 + dx + right, y as f64 + dy + down);
                if k > 0 {
                    let (axis, sign) = ((k - 1) / 2, if k % 2 == 0 { 1.0 } else { -1.0 });
                    for part in 0..4 {
                        let slope = sign * seen.colour[part] / (2.0 * DIFFERENCE) as f32;
                        pixel.slopes[axis][part] += share * slope;
                    }
                    continue;
                }
                for part in 0..4 {
                    pixel.colour[part] += share * seen.colour[part];
                }
                for part in 0..3 {
                    pixel.normal[part] += share * seen.normal[part];
                }
                pixel.depth = pixel.depth.min(depth);
            }
        }
        let [a, b, c] = pixel.normal;
        let length = (a * a + b * b + c * c).sqrt();
        if length > 0.0 {
            for part in &mut pixel.normal {
                *part /= length;
            }
        }
        pixel
    }

    /// Whether what is seen lies between two samples.
    pub fn spans(&self) -> bool {
        self.integral.is_some() || matches!(self.look, Look::Iso(..))
    }

    /// What the ray through a point of the image sees, on the background, and the distance to its surface.
    #[inline(always)]
    fn ray<K: Kernel>(&self, kernel: K, shot: &Shot<'_>, x: f64, y: f64) -> (Seen, f32) {
        let ray = shot.camera.ray(shot.size, x, y);
        let mut seen = Seen::NOTHING;
        let mut depth = f32::INFINITY;
        if let Some(segment) = clip(&ray, self.grid.placement(), self.grid.last()) {
            let blocks = (self.blocks.as_deref(), self.spans());
            let walk = Walk::new(&self.grid, kernel, blocks, &segment, self.step);
            let [x, y, z] = ray.direction;
            let view = [x as f32, y as f32, z as f32];
            seen = self.look(walk, view, shot);
            if seen.depth >= 0.0 {
                depth = (segment.start + f64::from(seen.depth) * self.step) as f32;
            }
        }
        let behind = 1.0 - seen.colour[3];
        for k in 0..4 {
            seen.colour[k] += behind * self.background[k];
        }
        (seen, depth)
    }

    #[inline(always)]
    fn look<K: Kernel>(&self, walk: Walk<'_, K>, view: [f32; 3], shot: &Shot<'_>) -> Seen {
        let (shader, to_world) = (shot.shader, &self.to_world);
        let wanted = shot.normals.then_some(to_world);
        match self.look {
            Look::Dvr => March {
                table: &self.table,
                integral: self.integral.as_ref(),
                shader,
                to_world,
                opaque: self.opaque,
                threshold: self.threshold,
                normals: shot.normals,
            }
            .ray(walk, view),
            Look::Iso(value, colour) => {
                Surface { value, colour, shader, to_world, normals: shot.normals }.ray(walk, view)
            }
            Look::Mip => maximum(walk, &self.table, wanted),
            Look::Dense => Dense { table: &self.table, to_world: wanted, opaque: self.opaque }.ray(walk),
        }
    }
}

/// Where a sample lies within its pixel.
fn offset(shot: &Shot<'_>, (x, y): (usize, usize), index: u32) -> (f64, f64) {
    /// 1 / g and 1 / g^2 of the plastic number g.
    const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
    if shot.samples == 1 {
        return (0.5, 0.5);
    }
    let key = shot.seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ ((y as u64) << 32 | x as u64);
    let place = |axis: u64| {
        let start = (lacuna_core::mix(key.wrapping_add(axis)) >> 11) as f64 / (1_u64 << 53) as f64;
        (start + STEPS[axis as usize] * f64::from(index)).fract()
    };
    (place(0), place(1))
}
