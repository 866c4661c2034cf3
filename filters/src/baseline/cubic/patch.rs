//! Three cubic patches over a triangle that is split at its centroid, in Bezier form.

/// A surface over one triangle. Coefficients are those of the Bernstein polynomials: `corner` of a corner's cube, `towards[i][j]`
/// of corner i squared times corner j, `inner[i]` of corner i squared times the centroid, `ring[k]` of the two corners other than
/// k times the centroid, `spoke[i]` of corner i times the centroid squared, `middle` of the centroid's cube.
pub(super) struct Patch {
    corner: [f64; 3],
    towards: [[f64; 3]; 3],
    inner: [f64; 3],
    ring: [f64; 3],
    spoke: [f64; 3],
    middle: f64,
}

/// The direction across the edge opposite to corner `k`, as shares of the corners k + 1, k + 2 and of the centroid: to the point
/// `other` (barycentric coordinates of the triangle), or to the edge's middle.
pub(super) fn across(k: usize, other: Option<[f64; 3]>) -> [f64; 3] {
    match other {
        // Corner k is three centroids less the other corners.
        Some(at) => [at[(k + 1) % 3] - at[k], at[(k + 2) % 3] - at[k], 3.0 * at[k] - 1.0],
        None => [0.5, 0.5, -1.0],
    }
}

impl Patch {
    /// The surface with these values and gradients at the corners, whose derivative in `directions[k]` is linear along the edge
    /// opposite to corner k.
    pub fn new(
        corners: [[f64; 2]; 3],
        corner: [f64; 3],
        gradients: [[f64; 2]; 3],
        directions: [[f64; 3]; 3],
    ) -> Self {
        let towards = [0, 1, 2].map(|i| {
            [0, 1, 2].map(|j| {
                let edge = [0, 1].map(|axis| corners[j][axis] - corners[i][axis]);
                corner[i] + (gradients[i][0] * edge[0] + gradients[i][1] * edge[1]) / 3.0
            })
        });
        // towards[i][i] is the corner itself: the mean of three.
        let inner = towards.map(|from| from.iter().sum::<f64>() / 3.0);
        let ring = [0, 1, 2].map(|k| {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            let [a, b, c] = directions[k];
            let start = a * corner[i] + b * towards[i][j] + c * inner[i];
            let end = a * towards[j][i] + b * corner[j] + c * inner[j];
            (f64::midpoint(start, end) - a * towards[i][j] - b * towards[j][i]) / c
        });
        let spoke = [0, 1, 2].map(|i| (inner[i] + ring[(i + 1) % 3] + ring[(i + 2) % 3]) / 3.0);
        let middle = spoke.iter().sum::<f64>() / 3.0;
        Self { corner, towards, inner, ring, spoke, middle }
    }

    /// The value at a point of the triangle, by its barycentric coordinates.
    pub fn at(&self, shares: [f64; 3]) -> f64 {
        // The patch of the corners i and j: the share of corner k is the least, and goes to the centroid.
        let k = (0..3).fold(0, |least, k| if shares[k] < shares[least] { k } else { least });
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let (u, v, s) = (shares[i] - shares[k], shares[j] - shares[k], 3.0 * shares[k]);
        let edge = u * u * u * self.corner[i]
            + 3.0 * u * v * (u * self.towards[i][j] + v * self.towards[j][i])
            + v * v * v * self.corner[j];
        let first = u * u * self.inner[i] + 2.0 * u * v * self.ring[k] + v * v * self.inner[j];
        let second = u * self.spoke[i] + v * self.spoke[j];
        edge + s * (3.0 * first + s * (3.0 * second + s * self.middle))
    }
}
