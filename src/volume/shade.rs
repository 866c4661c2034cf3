//! Shading: how a sample's colour follows from its gradient, the lights and the view.
//!
//! With the gradient `g` of the normalised value per voxel, `n = g / |g|`, the direction `l` to a light, `h` between `l` and
//! the view, and the weight `k = min(1, s |g|)` (or 1 if `s` is 0), the colour becomes
//! `(flat (1 - k) + k (ambient + diffuse |n.l|)) rgb + k specular |n.h|^shininess`, summed over the lights. Both sides
//! of a surface are lit alike.
//!
//! Sources: B. T. Phong, "Illumination for computer generated pictures", CACM 18(6), 1975; J. F. Blinn, "Models of light
//! reflection for computer synthesized pictures", SIGGRAPH 1977 (h); M. Levoy, "Display of surfaces from volume data", IEEE
//! CG&A 8(3), 1988 (weight by the gradient).

use super::vector::{Vector, normalise, scale};

/// Lights of a scene at most.
pub const MOST_LIGHTS: usize = 4;

/// How light is reflected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Share of the colour where there is no gradient.
    pub flat: f32,
    /// Share of the colour that every surface shows.
    pub ambient: f32,
    /// Share that follows the angle to the light.
    pub diffuse: f32,
    /// Strength of highlights, which are white.
    pub specular: f32,
    /// Exponent of highlights; larger is sharper.
    pub shininess: f32,
    /// `s`: how much gradient makes a full surface; 0 takes everything as one.
    pub gradient_scale: f32,
}

/// A light at infinity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Towards the light, length 1, in world coordinates.
    pub direction: [f32; 3],
    /// Its strength.
    pub intensity: f32,
}

/// Everything that shading needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Shader {
    /// The material.
    pub material: Material,
    /// The lights, [`MOST_LIGHTS`] at most.
    pub lights: Vec<Light>,
    /// Rows of the map from index gradients to those of the normalised value per voxel in world directions.
    pub to_world: [[f32; 3]; 3],
}

impl Light {
    /// A light in that direction (not 0), of any length.
    pub fn new(direction: Vector, intensity: f64) -> Self {
        Self { direction: normalise(direction).map(|part| part as f32), intensity: intensity as f32 }
    }
}

impl Shader {
    /// The map of gradients: `rows` are those of the inverse placement, `per_value` the normalisation of values,
    /// `voxel` the length of a voxel.
    pub fn gradient_map(rows: [Vector; 3], per_value: f64, voxel: f64) -> [[f32; 3]; 3] {
        let rows = rows.map(|row| scale(row, per_value * voxel));
        std::array::from_fn(|axis| std::array::from_fn(|k| rows[k][axis] as f32))
    }

    /// The normal of length 1 (0 where there is no gradient) and the length of the gradient, from a gradient in index
    /// coordinates.
    #[inline(always)]
    pub fn normal(&self, gradient: [f32; 3]) -> ([f32; 3], f32) {
        let m = &self.to_world;
        let mut world = [0.0; 3];
        for axis in 0..3 {
            world[axis] = m[axis][0] * gradient[0] + m[axis][1] * gradient[1] + m[axis][2] * gradient[2];
        }
        let length = dot(world, world).sqrt();
        let over = if length > 0.0 { 1.0 / length } else { 0.0 };
        ([world[0] * over, world[1] * over, world[2] * over], length)
    }

    /// The directions `h` of the lights for a ray of that direction.
    #[inline(always)]
    pub fn halfway(&self, view: [f32; 3]) -> [[f32; 3]; MOST_LIGHTS] {
        let mut found = [[0.0; 3]; MOST_LIGHTS];
        for k in 0..self.lights.len().min(MOST_LIGHTS) {
            let l = self.lights[k].direction;
            let h = [l[0] - view[0], l[1] - view[1], l[2] - view[2]];
            let square = dot(h, h);
            let over = if square > 0.0 { 1.0 / square.sqrt() } else { 0.0 };
            found[k] = [h[0] * over, h[1] * over, h[2] * over];
        }
        found
    }

    /// The shaded colour; `halfway` as [`Shader::halfway`] gives it for the ray.
    #[inline(always)]
    pub fn shade(
        &self,
        colour: [f32; 3],
        normal: [f32; 3],
        length: f32,
        halfway: &[[f32; 3]; MOST_LIGHTS],
    ) -> [f32; 3] {
        let material = &self.material;
        let weight = material.gradient_scale * length;
        let k = if material.gradient_scale > 0.0 && weight < 1.0 { weight } else { 1.0 };
        let (mut diffuse, mut specular) = (0.0, 0.0);
        for k in 0..self.lights.len().min(MOST_LIGHTS) {
            let (light, h) = (&self.lights[k], &halfway[k]);
            diffuse += light.intensity * dot(normal, light.direction).abs();
            if material.specular > 0.0 {
                specular += light.intensity * power(dot(normal, *h).abs(), material.shininess);
            }
        }
        let share = material.flat * (1.0 - k) + k * (material.ambient + material.diffuse * diffuse);
        let white = k * material.specular * specular;
        [share * colour[0] + white, share * colour[1] + white, share * colour[2] + white]
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `base^exponent` for a base of 0 or more; by squaring where the exponent is a small whole number.
#[inline(always)]
fn power(base: f32, exponent: f32) -> f32 {
    let whole = exponent as u32;
    if exponent.fract() != 0.0 || !(0.0..=1024.0).contains(&exponent) {
        return base.powf(exponent);
    }
    let (mut result, mut square, mut rest) = (1.0, base, whole);
    if whole < 32 {
        // Unrolled: the usual exponents take no loop.
        for bit in 0..5 {
            result *= if whole >> bit & 1 == 1 { square } else { 1.0 };
            square *= square;
        }
        return result;
    }
    while rest > 0 {
        if rest & 1 == 1 {
            result *= square;
        }
        square *= square;
        rest >>= 1;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::vector::Affine;

    fn shader() -> Shader {
        let material = Material {
            flat: 0.8,
            ambient: 0.25,
            diffuse: 0.65,
            specular: 0.25,
            shininess: 30.0,
            gradient_scale: 40.0,
        };
        let to_world = Shader::gradient_map(Affine::spacing([1.0, 1.0, 2.0]).inverse_rows(), 0.01, 1.0);
        Shader { material, lights: vec![Light::new([0.0, 0.0, 2.0], 1.0)], to_world }
    }

    #[test]
    fn powers_are_powers() {
        for exponent in [0.0, 1.0, 2.0, 7.0, 30.0, 2.5] {
            for base in [0.0_f32, 0.3, 0.99, 1.0] {
                let exact = f64::from(base).powf(f64::from(exponent));
                assert!(
                    (f64::from(power(base, exponent)) - exact).abs()
                        <= 64.0 * f64::from(f32::EPSILON) * exact
                );
            }
        }
    }

    #[test]
    fn gradients_are_per_voxel_of_world() {
        let (normal, length) = shader().normal([0.0, 0.0, -100.0]);
        assert_eq!(normal, [0.0, 0.0, -1.0]);
        assert!((length - 0.5).abs() < 1e-6);
        assert_eq!(shader().normal([0.0; 3]), ([0.0; 3], 0.0));
    }

    #[test]
    fn a_surface_towards_the_light_is_full_and_a_flat_place_flat() {
        let shader = shader();
        let halfway = shader.halfway([0.0, 0.0, -1.0]);
        let lit = shader.shade([1.0, 0.5, 0.0], [0.0, 0.0, -1.0], 1.0, &halfway);
        for (part, expected) in lit.into_iter().zip([1.15, 0.7, 0.25]) {
            assert!((part - expected).abs() < 1e-6);
        }
        let flat = shader.shade([1.0, 0.5, 0.0], [0.0; 3], 0.0, &halfway);
        assert_eq!(flat, [0.8, 0.4, 0.0]);
    }
}
