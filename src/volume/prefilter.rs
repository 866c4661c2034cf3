//! From voxels to the coefficients of the cubic B-spline that goes through them.
//!
//! Along each axis the coefficients c solve `(c[k-1] + 4 c[k] + c[k+1]) / 6 = v[k]`, where beyond the ends the outermost
//! coefficient repeats, as it does in the grid's border. The system is tridiagonal and diagonally dominant: elimination
//! without pivots, in f64.
//!
//! Source: M. Unser, A. Aldroubi, M. Eden, "B-spline signal processing: Part I", IEEE Transactions on Signal Processing
//! 41(2), 1993.

use rayon::prelude::*;

/// Turns `size[0] x size[1] x size[2]` values, x fastest, into coefficients.
pub fn prefilter(values: &mut [f32], size: [usize; 3]) {
    let [nx, ny, nz] = size;
    let rows = Tridiagonal::new(nx);
    values.par_chunks_mut(nx).for_each(|row| rows.solve(row, 1));
    let columns = Tridiagonal::new(ny);
    values.par_chunks_mut(nx * ny).for_each(|slice| columns.solve(slice, nx));
    // Along z every y is by itself: its rows are brought together, as rows far apart in memory are slow.
    let depths = Tridiagonal::new(nz);
    let solved = |y: usize| {
        let mut rows: Vec<f32> =
            values.chunks(nx * ny).flat_map(|slice| &slice[y * nx..][..nx]).copied().collect();
        depths.solve(&mut rows, nx);
        rows
    };
    let solved: Vec<Vec<f32>> = (0..ny).into_par_iter().map(solved).collect();
    values.par_chunks_mut(nx * ny).enumerate().for_each(|(z, slice)| {
        for (row, solved) in slice.chunks_mut(nx).zip(&solved) {
            row.copy_from_slice(&solved[z * nx..][..nx]);
        }
    });
}

/// The eliminated matrix: the factor of each row, and the reciprocal of its diagonal.
struct Tridiagonal {
    over: Vec<f64>,
}

impl Tridiagonal {
    fn new(n: usize) -> Self {
        let mut over: Vec<f64> = Vec::with_capacity(n);
        for k in 0..n {
            // A repeated neighbour adds to the diagonal.
            let ends = f64::from(u8::from(k == 0)) + f64::from(u8::from(k + 1 == n));
            let eliminated = over.last().copied().unwrap_or(0.0);
            over.push((4.0 + ends - eliminated).recip());
        }
        Self { over }
    }

    /// Solves along the rows of `n x width` values, for every place within a row at once.
    fn solve(&self, values: &mut [f32], width: usize) {
        let mut forward = vec![0.0_f64; values.len()];
        for (k, (row, over)) in values.chunks(width).zip(&self.over).enumerate() {
            let (before, now) = forward.split_at_mut(k * width);
            let before = before.chunks(width).last();
            for (x, (out, value)) in now.iter_mut().zip(row).enumerate() {
                let last = before.map_or(0.0, |before| before[x]);
                *out = (6.0 * f64::from(*value) - last) * over;
            }
        }
        let mut next = vec![0.0_f64; width];
        let rows = values.chunks_mut(width).zip(forward.chunks(width)).zip(&self.over);
        for ((row, forward), over) in rows.rev() {
            for ((value, forward), next) in row.iter_mut().zip(forward).zip(&mut next) {
                *next = forward - *next * over;
                *value = *next as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_goes_through_the_voxels() {
        for size in [[1, 1, 1], [5, 1, 2], [2, 7, 4], [9, 8, 7]] {
            let [nx, ny, nz] = size;
            let values: Vec<f32> = (0..nx * ny * nz).map(|k| ((k * 7919 + 13) % 101) as f32).collect();
            let mut coefficients = values.clone();
            prefilter(&mut coefficients, size);
            let at = |x: i64, y: i64, z: i64| {
                let inside = |k: i64, n: usize| k.clamp(0, n as i64 - 1) as usize;
                f64::from(coefficients[inside(x, nx) + nx * (inside(y, ny) + ny * inside(z, nz))])
            };
            for z in 0..nz as i64 {
                for y in 0..ny as i64 {
                    for x in 0..nx as i64 {
                        let mut sum = 0.0;
                        for (dz, wz) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                            for (dy, wy) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                                for (dx, wx) in [(-1, 1.0), (0, 4.0), (1, 1.0)] {
                                    sum += wx * wy * wz * at(x + dx, y + dy, z + dz) / 216.0;
                                }
                            }
                        }
                        let value = f64::from(values[x as usize + nx * (y as usize + ny * z as usize)]);
                        assert!((sum - value).abs() < 101.0 * 64.0 * f64::from(f32::EPSILON), "{size:?}");
                    }
                }
            }
        }
    }
}
