//! Shading: how a sample's colour follows from its gradient, the lights and the view.
//!
//! With the gradient `g` of the normalised value per voxel, the normal `n = -g / |g|`, the direction `l` to a light, `h` between `l` and
//! the view, and the weight `k = min(1, s |g|)` (or 1 if `s` is 0), the colour becomes
//! `(flat (1 - k) + k (ambient + diffuse |n.l|)) rgb + k specular |n.h|^shininess`, summed over the lights. Both sides
//! of a surface are lit alike.
//!
//! Sources: B. T. Phong, "Illumination for computer generated pictures", CACM 18(6), 1975; J. F. Blinn, "Models of light
//! reflection for computer synthesized pictures", SIGGRAPH 1977 (h); M. Levoy, "Display of surfaces from volume data", IEEE
//! CG&A 8(3), 1988 (weight by the gradient).

use super::lanes::{Lanes, all, dot, splat};
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
    /// The lights, `MOST_LIGHTS` at most.
    pub lights: Vec<Light>,
}

/// From gradients in index coordinates to normals: rows of the map to those of the normalised value per voxel in world directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToWorld(pub [[f32; 3]; 3]);

impl Light {
    /// A light in that direction (not 0), of any length.
    pub fn new(direction: Vector, intensity: f64) -> Self {
        Self { direction: normalise(direction).map(|part| part as f32), intensity: intensity as f32 }
    }
}

impl ToWorld {
    /// `rows` are those of the inverse placement, `per_value` the normalisation of values, `voxel` the length of a voxel.
    pub fn new(rows: [Vector; 3], per_value: f64, voxel: f64) -> Self {
        let rows = rows.map(|row| scale(row, per_value * voxel));
        Self(std::array::from_fn(|axis| std::array::from_fn(|k| rows[k][axis] as f32)))
    }

    /// The normals of length 1, from high to low values (0 where there is no gradient), and the lengths of the gradients, from
    /// gradients in index coordinates.
    #[inline(always)]
    pub fn normals(&self, gradients: [Lanes; 3]) -> ([Lanes; 3], Lanes) {
        let [a, b, c] = &self.0;
        let along = |row: &[f32; 3]| dot(splat(*row), gradients);
        let world = [along(a), along(b), along(c)];
        let length = dot(world, world).sqrt();
        // A length of 0 gives an infinite reciprocal.
        let over = length.simd_gt(Lanes::ZERO).select(all(-1.0) / length, Lanes::ZERO);
        ([world[0] * over, world[1] * over, world[2] * over], length)
    }
}

impl Shader {
    /// The directions `h` of the lights for a ray of that direction.
    #[inline(always)]
    pub fn halfway(&self, view: [f32; 3]) -> [[f32; 3]; MOST_LIGHTS] {
        let mut found = [[0.0; 3]; MOST_LIGHTS];
        for k in 0..self.lights.len().min(MOST_LIGHTS) {
            let l = self.lights[k].direction;
            let h = [l[0] - view[0], l[1] - view[1], l[2] - view[2]];
            let square = h[0] * h[0] + h[1] * h[1] + h[2] * h[2];
            let over = if square > 0.0 { 1.0 / square.sqrt() } else { 0.0 };
            found[k] = [h[0] * over, h[1] * over, h[2] * over];
        }
        found
    }

    /// The share of their colours and the white that samples show; `halfway` as [`Shader::halfway`] gives it for the ray.
    #[inline(always)]
    pub fn shade(
        &self,
        normals: [Lanes; 3],
        lengths: Lanes,
        halfway: &[[f32; 3]; MOST_LIGHTS],
    ) -> (Lanes, Lanes) {
        let material = &self.material;
        let k = if material.gradient_scale > 0.0 {
            (all(material.gradient_scale) * lengths).fast_min(all(1.0))
        } else {
            all(1.0)
        };
        let (mut diffuse, mut specular) = (Lanes::ZERO, Lanes::ZERO);
        for k in 0..self.lights.len().min(MOST_LIGHTS) {
            let (light, h) = (&self.lights[k], &halfway[k]);
            diffuse += all(light.intensity) * dot(normals, splat(light.direction)).abs();
            if material.specular > 0.0 {
                let cosines = dot(normals, splat(*h)).abs();
                specular += all(light.intensity) * power(cosines, material.shininess);
            }
        }
        let surface = all(material.ambient) + all(material.diffuse) * diffuse;
        let share = all(material.flat) * (all(1.0) - k) + k * surface;
        (share, k * all(material.specular) * specular)
    }
}

/// `base^exponent` for bases of 0 or more; by squaring where the exponent is a small whole number.
#[inline(always)]
fn power(base: Lanes, exponent: f32) -> Lanes {
    if exponent.fract() != 0.0 || !(0.0..=1024.0).contains(&exponent) {
        return Lanes::new(base.to_array().map(|base| base.powf(exponent)));
    }
    let (mut result, mut square, mut rest) = (all(1.0), base, exponent as u32);
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
    use crate::vector::Affine;

    fn shader() -> Shader {
        let material = Material {
            flat: 0.8,
            ambient: 0.25,
            diffuse: 0.65,
            specular: 0.25,
            shininess: 30.0,
            gradient_scale: 40.0,
        };
        Shader { material, lights: vec![Light::new([0.0, 0.0, 2.0], 1.0)] }
    }

    fn normal(gradient: [f32; 3]) -> ([f32; 3], f32) {
        let to_world = ToWorld::new(Affine::spacing([1.0, 1.0, 2.0]).inverse_rows(), 0.01, 1.0);
        let (normals, lengths) = to_world.normals(gradient.map(all));
        (normals.map(|part| part.to_array()[5]), lengths.to_array()[2])
    }

    #[test]
    fn powers_are_powers() {
        for exponent in [0.0, 1.0, 2.0, 7.0, 30.0, 33.0, 2.5] {
            for base in [0.0_f32, 0.3, 0.99, 1.0] {
                let exact = f64::from(base).powf(f64::from(exponent));
                let found = power(all(base), exponent).to_array()[3];
                assert!((f64::from(found) - exact).abs() <= 64.0 * f64::from(f32::EPSILON) * exact);
            }
        }
    }

    #[test]
    fn gradients_are_per_voxel_of_world_and_normals_against_them() {
        let (found, length) = normal([0.0, 0.0, -100.0]);
        assert_eq!(found, [0.0, 0.0, 1.0]);
        assert!((length - 0.5).abs() < 1e-6);
        assert_eq!(normal([0.0; 3]), ([0.0; 3], 0.0));
    }

    #[test]
    fn a_surface_towards_the_light_is_full_and_a_flat_place_flat() {
        let shader = shader();
        let halfway = shader.halfway([0.0, 0.0, -1.0]);
        let shade = |normal: [f32; 3], length: f32| {
            let (share, white) = shader.shade(normal.map(all), all(length), &halfway);
            (share.to_array()[7], white.to_array()[0])
        };
        let (share, white) = shade([0.0, 0.0, -1.0], 1.0);
        assert!((share - 0.9).abs() < 1e-6 && (white - 0.25).abs() < 1e-6);
        assert_eq!(shade([0.0; 3], 0.0), (0.8, 0.0));
    }
}
