//! The slow twin of the march, for tests: one sample after the other in f64, every sum over all voxels of the support
//! written out, nothing skipped, nothing shared. Only the table of the transfer function is the fast march's own.

use super::camera::{Segment, clip};
use super::picture::{Interpolation, Look, Renderer};
use super::shade::{Shader, ToWorld};
use super::vector::{Vector, add, dot, length, normalise, scale, subtract};
use super::{Grid, Ray};

/// Weights and their derivatives of the voxels `first`, `first + 1`, ... at an index coordinate.
struct Along {
    first: i64,
    weights: Vec<[f64; 2]>,
}

/// Along one axis of `n` voxels.
fn along(interpolation: Interpolation, at: f64, n: usize) -> Along {
    // The last voxel belongs to the cell behind it, as in the fast march.
    let cell = at.floor().min((n - 1) as f64);
    let f = at - cell;
    let cubic = |a: [[f64; 4]; 4]| {
        // Coefficients of 1, f, f^2, f^3.
        a.map(|[c, l, q, k]| [c + f * (l + f * (q + f * k)), l + f * (2.0 * q + 3.0 * k * f)]).to_vec()
    };
    let (first, weights) = match interpolation {
        Interpolation::Nearest => (i64::from(f >= 0.5), vec![[1.0, 0.0]]),
        Interpolation::Linear => (0, vec![[1.0 - f, -1.0], [f, 1.0]]),
        Interpolation::BSpline => (
            -1,
            cubic(
                [[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]
                    .map(|a| a.map(|c| c / 6.0)),
            ),
        ),
        Interpolation::CatmullRom => (
            -1,
            cubic(
                [[0.0, -1.0, 2.0, -1.0], [2.0, 0.0, -5.0, 3.0], [0.0, 1.0, 4.0, -3.0], [0.0, 0.0, -1.0, 1.0]]
                    .map(|a| a.map(|c| c / 2.0)),
            ),
        ),
    };
    Along { first: cell as i64 + first, weights }
}

/// Value and gradient per index step at an index point.
pub fn sample(grid: &Grid, interpolation: Interpolation, p: Vector) -> (f64, Vector) {
    let size = grid.size();
    let axes = [0, 1, 2].map(|k| along(interpolation, p[k], size[k]));
    let voxel = |at: [i64; 3]| grid.value([0, 1, 2].map(|k| at[k].clamp(0, size[k] as i64 - 1) as usize));
    let (mut value, mut gradient) = (0.0, [0.0; 3]);
    for (z, wz) in axes[2].weights.iter().enumerate() {
        for (y, wy) in axes[1].weights.iter().enumerate() {
            for (x, wx) in axes[0].weights.iter().enumerate() {
                let at = [x, y, z];
                let v = voxel([0, 1, 2].map(|k| axes[k].first + at[k] as i64));
                value += wx[0] * wy[0] * wz[0] * v;
                gradient[0] += wx[1] * wy[0] * wz[0] * v;
                gradient[1] += wx[0] * wy[1] * wz[0] * v;
                gradient[2] += wx[0] * wy[0] * wz[1] * v;
            }
        }
    }
    if interpolation == Interpolation::Nearest {
        let at = [0, 1, 2].map(|k| axes[k].first);
        for axis in 0..3 {
            let [after, before] = [1, -1].map(|d| {
                let mut at = at;
                at[axis] += d;
                voxel(at)
            });
            gradient[axis] = 0.5 * (after - before);
        }
    }
    (value, gradient)
}

/// The normal, and the length of the gradient.
fn normal(to_world: &ToWorld, gradient: Vector) -> (Vector, f64) {
    let world = to_world.0.map(|row| dot(row.map(f64::from), gradient));
    (normalise(scale(world, -1.0)), length(world))
}

/// The shaded colour, by the formula in [`super::shade`].
fn shaded(shader: &Shader, colour: Vector, (normal, size): (Vector, f64), view: Vector) -> Vector {
    let material = &shader.material;
    let per_gradient = f64::from(material.gradient_scale);
    let k = if per_gradient > 0.0 { (per_gradient * size).min(1.0) } else { 1.0 };
    let (mut diffuse, mut specular) = (0.0, 0.0);
    for light in &shader.lights {
        let towards = light.direction.map(f64::from);
        let h = normalise(subtract(towards, view));
        diffuse += f64::from(light.intensity) * dot(normal, towards).abs();
        specular += f64::from(light.intensity) * dot(normal, h).abs().powf(f64::from(material.shininess));
    }
    let surface = f64::from(material.ambient) + f64::from(material.diffuse) * diffuse;
    let share = f64::from(material.flat) * (1.0 - k) + k * surface;
    let white = k * f64::from(material.specular) * specular;
    colour.map(|part| share * part + white)
}

/// One ray's samples, by number.
struct Samples<'a> {
    renderer: &'a Renderer,
    shader: Option<&'a Shader>,
    segment: Segment,
    view: Vector,
}

impl Samples<'_> {
    fn count(&self) -> u32 {
        self.segment.samples(self.renderer.step)
    }

    fn at(&self, i: f64) -> (f64, Vector) {
        let grid = &self.renderer.grid;
        let p = add(self.segment.entry, scale(self.segment.direction, i * self.renderer.step));
        sample(grid, self.renderer.interpolation, [0, 1, 2].map(|k| p[k].clamp(0.0, grid.last()[k])))
    }

    fn shown(&self, colour: Vector, gradient: Vector) -> Vector {
        let normal = normal(&self.renderer.to_world, gradient);
        self.shader.map_or(colour, |shader| shaded(shader, colour, normal, self.view))
    }

    /// The table's colour and opacity of sample `i`, or those of the segment that ends there.
    fn classified(&self, i: u32, value: f64) -> [f64; 4] {
        let found = match self.renderer.integral.as_ref().filter(|_| self.count() > 1) {
            None => self.renderer.table.at(value as f32),
            Some(_) if i == 0 => [0.0; 4],
            Some(integral) => {
                let before = self.at(f64::from(i) - 1.0).0;
                let ([red, green, blue], opacity) = integral.segment(before as f32, value as f32);
                [red, green, blue, opacity]
            }
        };
        found.map(f64::from)
    }

    fn march(&self) -> [f64; 4] {
        let mut sum = [0.0; 4];
        for i in 0..self.count() {
            let (value, gradient) = self.at(f64::from(i));
            let [red, green, blue, opacity] = self.classified(i, value);
            let colour = self.shown([red, green, blue], gradient);
            let part = (1.0 - sum[3]) * opacity;
            for k in 0..3 {
                sum[k] += part * colour[k];
            }
            sum[3] += part;
            if sum[3] >= f64::from(self.renderer.opaque) {
                break;
            }
        }
        sum
    }

    /// Where the first surface is, by halving.
    fn first(&self, value: f64) -> Option<f64> {
        let inside = |i: f64| self.at(i).0 >= value;
        let i = (1..self.count()).map(f64::from).find(|&i| inside(i) != inside(i - 1.0))?;
        let (mut near, mut far) = (i - 1.0, i);
        for _ in 0..40 {
            let middle = 0.5 * (near + far);
            if inside(middle) == inside(i - 1.0) { near = middle } else { far = middle }
        }
        Some(far)
    }

    fn surface(&self, value: f64, colour: Vector) -> [f64; 4] {
        let Some(at) = self.first(value) else { return [0.0; 4] };
        let [red, green, blue] = self.shown(colour, self.at(at).1);
        [red, green, blue, 1.0]
    }

    /// The first sample of the largest value.
    fn highest(&self) -> f64 {
        let higher = |best: f64, i: f64| if self.at(i).0 > self.at(best).0 { i } else { best };
        (0..self.count()).map(f64::from).fold(0.0, higher)
    }

    fn maximum(&self) -> [f64; 4] {
        let most = self.at(self.highest()).0;
        let [red, green, blue, alpha] = self.renderer.table.at(most as f32).map(f64::from);
        [red * alpha, green * alpha, blue * alpha, alpha]
    }
}

/// Distance and normal of what a ray of an isosurface or a maximum sees, and the length of the gradient there.
pub fn place(renderer: &Renderer, ray: &Ray) -> Option<(f64, Vector, f64)> {
    let segment = clip(ray, renderer.grid.placement(), renderer.grid.last())?;
    let samples = Samples { renderer, shader: None, segment, view: ray.direction };
    let at = match renderer.look {
        Look::Iso(value, _) => samples.first(value.into())?,
        _ => samples.highest(),
    };
    let (normal, size) = normal(&renderer.to_world, samples.at(at).1);
    Some((segment.start + at * renderer.step, normal, size))
}

/// Red, green, blue, premultiplied, and alpha that a ray sees, without the background.
pub fn ray(renderer: &Renderer, shader: Option<&Shader>, ray: &Ray) -> [f64; 4] {
    let Some(segment) = clip(ray, renderer.grid.placement(), renderer.grid.last()) else { return [0.0; 4] };
    let samples = Samples { renderer, shader, segment, view: ray.direction };
    match renderer.look {
        Look::Mip => samples.maximum(),
        Look::Iso(value, colour) => samples.surface(value.into(), colour.map(f64::from)),
        Look::Dvr | Look::Dense => samples.march(),
    }
}
