//! Three-component vectors and affine maps in f64, as plain arrays.

/// A point or direction: x, y, z.
pub type Vector = [f64; 3];

/// `a + b`.
#[inline]
pub fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline]
pub fn subtract(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `a s`.
#[inline]
pub fn scale(a: Vector, s: f64) -> Vector {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// The scalar product.
#[inline]
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product.
#[inline]
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The length.
#[inline]
pub fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// `a` at length 1; a vector of length 0 stays.
#[inline]
pub fn normalise(a: Vector) -> Vector {
    let length = length(a);
    if length > 0.0 { scale(a, length.recip()) } else { a }
}

/// An affine map: `p` goes to `origin + sum of axes[k] p[k]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Affine {
    /// Where 0 goes.
    pub origin: Vector,
    /// Where the steps along x, y and z go.
    pub axes: [Vector; 3],
}

impl Affine {
    /// Steps of these lengths along the axes, from 0.
    pub fn spacing(spacing: Vector) -> Self {
        let [x, y, z] = spacing;
        Self { origin: [0.0; 3], axes: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]] }
    }

    /// Where the point goes.
    pub fn point(&self, p: Vector) -> Vector {
        add(self.origin, self.direction(p))
    }

    /// Where the direction goes.
    pub fn direction(&self, p: Vector) -> Vector {
        add(add(scale(self.axes[0], p[0]), scale(self.axes[1], p[1])), scale(self.axes[2], p[2]))
    }

    /// The volume that the unit cube has afterwards; negative if the map mirrors.
    pub fn determinant(&self) -> f64 {
        dot(self.axes[0], cross(self.axes[1], self.axes[2]))
    }

    /// The rows of the inverse of the linear part: `dot(rows[k], d)` is component k before the map. A gradient goes the
    /// same way with the rows as columns. The determinant must not be 0.
    pub fn inverse_rows(&self) -> [Vector; 3] {
        let [a, b, c] = self.axes;
        let over = self.determinant().recip();
        [scale(cross(b, c), over), scale(cross(c, a), over), scale(cross(a, b), over)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_undoes_the_map() {
        let map =
            Affine { origin: [1.0, 2.0, 3.0], axes: [[2.0, 0.1, 0.0], [0.0, -3.0, 0.5], [0.3, 0.0, 1.5]] };
        let point = [0.7, -1.3, 2.9];
        let offset = subtract(map.point(point), map.origin);
        for (row, expected) in map.inverse_rows().into_iter().zip(point) {
            assert!((dot(row, offset) - expected).abs() < 16.0 * f64::EPSILON);
        }
        assert!(Affine::spacing([1.0, 2.0, 3.0]).determinant() > 5.9);
        assert_eq!(normalise([0.0; 3]), [0.0; 3]);
    }
}
