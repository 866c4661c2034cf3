//! From voxels to the coefficients of the cubic B-spline that goes through them.
//!
//! Along each axis the coefficients c solve `(c[k-1] + 4 c[k] + c[k+1]) / 6 = v[k]`, where beyond the ends the outermost
//! coefficient repeats, as it does in the grid's border. The system is tridiagonal and diagonally dominant: elimination
//! without pivots, in place in f32: every step shrinks what was rounded before to 0.27 of it.
//!
//! Source: M. Unser, A. Aldroubi, M. Eden, "B-spline signal processing: Part I", IEEE Transactions on Signal Processing
//! 41(2), 1993.

use lacuna_core::parallel::prelude::*;

/// Rows that are solved side by side along themselves.
const ABREAST: usize = 16;

/// Writes the coefficients of `size[0] x size[1] x size[2]` voxels, x fastest. `strides` are from one row and from one
/// slice to the next; what lies between is left alone. `voxels` writes those of row y in slice z.
pub fn prefilter(
    values: &mut [f32],
    size: [usize; 3],
    strides: [usize; 2],
    voxels: impl Fn(usize, usize, &mut [f32]) + Sync,
) {
    let [nx, ny, nz] = size;
    let [along_x, along_y, along_z] = size.map(Tridiagonal::new);
    let end = values.len().min(nz * strides[1]);
    values[..end].par_chunks_mut(strides[1]).enumerate().for_each(|(z, slice)| {
        let mut rows: Vec<_> = slice.chunks_mut(strides[0]).take(ny).map(|row| &mut row[..nx]).collect();
        for (y, row) in rows.iter_mut().enumerate() {
            voxels(y, z, row);
        }
        let mut columns = vec![[0.0; ABREAST]; nx];
        for rows in rows.chunks_mut(ABREAST) {
            along_x.solve_along(rows, &mut columns);
        }
        along_y.solve(&mut rows);
    });
    let mut of_y: Vec<Vec<&mut [f32]>> = (0..ny).map(|_| Vec::with_capacity(nz)).collect();
    for slice in values.chunks_mut(strides[1]).take(nz) {
        for (rows, row) in of_y.iter_mut().zip(slice.chunks_mut(strides[0])) {
            rows.push(&mut row[..nx]);
        }
    }
    of_y.par_iter_mut().for_each(|rows| along_z.solve(rows));
}

/// The eliminated matrix: the factor of each row, and the reciprocal of its diagonal.
struct Tridiagonal {
    over: Vec<f32>,
}

impl Tridiagonal {
    fn new(n: usize) -> Self {
        let (mut over, mut eliminated) = (Vec::with_capacity(n), 0.0);
        for k in 0..n {
            // A repeated neighbour adds to the diagonal.
            let ends = f64::from(u8::from(k == 0)) + f64::from(u8::from(k + 1 == n));
            eliminated = (4.0 + ends - eliminated).recip();
            over.push(eliminated as f32);
        }
        Self { over }
    }

    /// Solves across rows: every place within them is a system of its own.
    fn solve<R: AsMut<[f32]> + AsRef<[f32]>>(&self, rows: &mut [R]) {
        for (k, &over) in self.over.iter().enumerate() {
            let (before, now) = rows.split_at_mut(k);
            let now = now[0].as_mut();
            match before.last() {
                Some(before) => {
                    for (value, before) in now.iter_mut().zip(before.as_ref()) {
                        *value = (6.0 * *value - before) * over;
                    }
                }
                None => now.iter_mut().for_each(|value| *value *= 6.0 * over),
            }
        }
        for (k, &over) in self.over.iter().enumerate().rev().skip(1) {
            let (now, next) = rows.split_at_mut(k + 1);
            for (value, next) in now[k].as_mut().iter_mut().zip(next[0].as_ref()) {
                *value -= next * over;
            }
        }
    }

    /// Solves along some rows, [`ABREAST`] at most, by way of their columns.
    fn solve_along(&self, rows: &mut [&mut [f32]], columns: &mut [[f32; ABREAST]]) {
        for (k, row) in rows.iter().enumerate() {
            for (column, value) in columns.iter_mut().zip(row.iter()) {
                column[k] = *value;
            }
        }
        self.solve(columns);
        for (k, row) in rows.iter_mut().enumerate() {
            for (column, value) in columns.iter().zip(row.iter_mut()) {
                *value = column[k];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_goes_through_the_voxels() {
        for size in [[1, 1, 1], [5, 1, 2], [2, 7, 4], [9, 8, 7], [3, 37, 2]] {
            let [nx, ny, nz] = size;
            let values: Vec<f32> = (0..nx * ny * nz).map(|k| ((k * 7919 + 13) % 101) as f32).collect();
            let mut coefficients = values.clone();
            prefilter(&mut coefficients, size, [nx, nx * ny], |y, z, row| {
                row.copy_from_slice(&values[(z * ny + y) * nx..][..nx]);
            });
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
