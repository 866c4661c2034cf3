//! Projection on a Euclidean ball.

/// The ball of the points at most `radius` from a centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L2Ball {
    /// Radius, at least 0.
    pub radius: f64,
}

impl L2Ball {
    /// What a difference from the centre whose length is `distance` is multiplied by to project it; 0 to 1.
    ///
    /// Source: N. Parikh, S. Boyd, "Proximal Algorithms", Foundations and Trends in Optimization 1(3), 2014,
    /// section 6.5.1 (the dual of the Euclidean norm).
    pub fn keep(self, distance: f64) -> f64 {
        if distance > self.radius { self.radius / distance } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::float_cmp, reason = "exact values are asked for")]

    use proptest::prelude::*;

    use super::L2Ball;

    proptest! {
        /// Moreau's identity: projection on the ball plus the proximal map of its support function is the identity.
        #[test]
        fn moreau(v in prop::collection::vec(-10.0..10.0, 1..6), radius in 0.0..20.0) {
            let length = v.iter().map(|v: &f64| v * v).sum::<f64>().sqrt();
            let ball = L2Ball { radius };
            // The proximal map of `radius` times the Euclidean norm.
            let shrink = if length > radius { 1.0 - radius / length } else { 0.0 };
            for v in v {
                let sum = v * ball.keep(length) + v * shrink;
                prop_assert!((sum - v).abs() <= 4.0 * f64::EPSILON * v.abs());
            }
        }

        #[test]
        fn projection_is_inside(length in 0.0..1e6, radius in 0.0..1e3) {
            let inside = length * L2Ball { radius }.keep(length);
            prop_assert!(inside <= radius * (1.0 + 2.0 * f64::EPSILON));
            prop_assert!(length > radius || inside == length);
        }
    }

    #[test]
    fn radius_zero_is_the_centre() {
        assert_eq!(L2Ball { radius: 0.0 }.keep(3.0), 0.0);
        assert_eq!(L2Ball { radius: 0.0 }.keep(0.0), 1.0);
    }
}
