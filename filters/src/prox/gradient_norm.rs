//! Norms of one gradient, their proximal map, and the projection on their dual ball.

use serde::Serialize;

/// How the length of a gradient (vertical, horizontal) is measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Norm {
    /// `sqrt(a^2 + b^2)`: no direction is preferred.
    #[default]
    Isotropic,
    /// `|a| + |b|`: prefers edges along rows and columns.
    Anisotropic,
}

impl Norm {
    /// The norm of a gradient.
    pub fn of(self, [a, b]: [f64; 2]) -> f64 {
        match self {
            Self::Isotropic => a.hypot(b),
            Self::Anisotropic => a.abs() + b.abs(),
        }
    }

    /// The nearest vector in the dual unit ball (a disc or a square): the proximal map of the conjugate.
    ///
    /// Source: A. Chambolle, T. Pock, "A First-Order Primal-Dual Algorithm for Convex Problems with Applications to
    /// Imaging", JMIV 40, 2011, section 6.2.
    pub fn clip(self, [a, b]: [f64; 2]) -> [f64; 2] {
        match self {
            Self::Isotropic => {
                let shrink = 1.0 / a.hypot(b).max(1.0);
                [a * shrink, b * shrink]
            }
            Self::Anisotropic => [a.clamp(-1.0, 1.0), b.clamp(-1.0, 1.0)],
        }
    }

    /// The proximal map of `threshold` times the norm (soft thresholding); `threshold` is positive.
    pub fn shrink(self, [a, b]: [f64; 2], threshold: f64) -> [f64; 2] {
        match self {
            Self::Isotropic => {
                let length = a.hypot(b);
                let keep = if length > threshold { 1.0 - threshold / length } else { 0.0 };
                [a * keep, b * keep]
            }
            Self::Anisotropic => [a, b].map(|v| (v.abs() - threshold).max(0.0).copysign(v)),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::Norm;

    proptest! {
        /// Moreau's identity: `v = prox_tf(v) + t prox_f*(v / t)`.
        #[test]
        fn moreau(a in -1e3..1e3, b in -1e3..1e3, t in 1e-3..1e3) {
            for norm in [Norm::Isotropic, Norm::Anisotropic] {
                let near = norm.shrink([a, b], t);
                let dual = norm.clip([a / t, b / t]);
                for (v, (p, d)) in [a, b].into_iter().zip(near.into_iter().zip(dual)) {
                    prop_assert!((v - (p + t * d)).abs() <= 8.0 * f64::EPSILON * (v.abs() + t));
                }
            }
        }

        /// Clipping is the nearest point: no point of the ball is nearer.
        #[test]
        fn clip_is_nearest(a in -4.0..4.0, b in -4.0..4.0, c in -2.0..2.0, d in -2.0..2.0) {
            for norm in [Norm::Isotropic, Norm::Anisotropic] {
                let near = norm.clip([a, b]);
                let other = norm.clip([c, d]);
                let distance = |p: [f64; 2]| (p[0] - a).hypot(p[1] - b);
                prop_assert!(distance(near) <= distance(other) + 8.0 * f64::EPSILON);
            }
        }
    }
}
