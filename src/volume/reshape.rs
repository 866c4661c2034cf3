//! Volumes turned, mirrored and resampled to cubes.

use super::vector::{Affine, length, scale};
use super::{Error, Grid, Limits, Values};

/// The volume whose axes are those that `text` names: `x -z y` has the file's x, its z mirrored, and its y. The new
/// volume stands upright at the world's origin with its voxels' lengths.
///
/// # Errors
/// [`Error::Scene`] if these are not three different axes, [`Error::Volume`] if there is no memory for both volumes.
pub fn axes(grid: &Grid, text: &str, limits: &Limits) -> Result<Grid, Error> {
    let one = |word: &str| {
        let (mirrored, name) = word.strip_prefix('-').map_or((false, word), |name| (true, name));
        ["x", "y", "z"].iter().position(|axis| *axis == name).map(|axis| (axis, mirrored))
    };
    let found: Option<Vec<(usize, bool)>> = text.split_whitespace().map(one).collect();
    let found: Option<[(usize, bool); 3]> = found.and_then(|axes| axes.try_into().ok());
    let Some(chosen) = found.filter(|a| a[0].0 != a[1].0 && a[1].0 != a[2].0 && a[0].0 != a[2].0) else {
        return Err(Error::Scene(format!("axes: '{text}' are not three axes such as \"x -z y\"")));
    };
    let old = grid.size();
    // With a border and without, before and after.
    limits.voxels(old, 4 * grid.voxel_bytes())?;
    let size = chosen.map(|(axis, _)| old[axis]);
    let spacing = chosen.map(|(axis, _)| length(grid.placement().axes[axis]));
    let order = Order { size, steps: chosen.map(|(axis, mirrored)| step(old, axis, mirrored)) };
    grid.mapped(size, Affine::spacing(spacing), |voxels| match voxels {
        Values::U8(voxels) => Values::U8(order.apply(voxels)),
        Values::U16(voxels) => Values::U16(order.apply(voxels)),
        Values::I16(voxels) => Values::I16(order.apply(voxels)),
        Values::F32(voxels) => Values::F32(order.apply(voxels)),
    })
}

/// Where an axis begins in the old array, and how far apart its voxels are.
fn step(size: [usize; 3], axis: usize, mirrored: bool) -> (usize, isize) {
    let stride: usize = size[..axis].iter().product();
    if mirrored { ((size[axis] - 1) * stride, -(stride as isize)) } else { (0, stride as isize) }
}

struct Order {
    size: [usize; 3],
    steps: [(usize, isize); 3],
}

impl Order {
    fn apply<T: Copy>(&self, voxels: &[T]) -> Vec<T> {
        let start: usize = self.steps.iter().map(|step| step.0).sum();
        let [nx, ny, nz] = self.size;
        let at = |k: usize, axis: usize| k as isize * self.steps[axis].1;
        let voxel =
            |x: usize, y: usize, z: usize| voxels[start.wrapping_add_signed(at(x, 0) + at(y, 1) + at(z, 2))];
        let rows = (0..nz).flat_map(|z| (0..ny).map(move |y| (y, z)));
        rows.flat_map(|(y, z)| (0..nx).map(move |x| (x, y, z))).map(|(x, y, z)| voxel(x, y, z)).collect()
    }
}

/// The volume with voxels of the shortest edge along every axis, values between them by lines. Along an axis whose
/// voxels are k times as long there are `k (n - 1) + 1` afterwards, rounded: it ends half a voxel beside its old end at most.
///
/// # Errors
/// [`Error::Volume`] if it would become too large.
pub fn cubes(grid: &Grid, limits: &Limits) -> Result<Grid, Error> {
    let placement = grid.placement();
    let ratios = placement.axes.map(|axis| length(axis) / grid.voxel());
    // Headers tell edges as floats.
    let ratios = ratios.map(|ratio| if ratio < 1.0 + 1e-6 { 1.0 } else { ratio });
    if ratios == [1.0; 3] {
        return Ok(grid.clone());
    }
    let old = grid.size();
    let size: [usize; 3] = std::array::from_fn(|k| (ratios[k] * (old[k] - 1) as f64).round() as usize)
        .map(|n| n.saturating_add(1));
    let count = size.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
    if count.is_none_or(|count| count > 1 << 33) {
        return Err(Error::Volume(format!("resampled to {size:?} voxels it is too large")));
    }
    // As floats before and after an axis, and with a border.
    limits.voxels(size, 3 * size_of::<f32>() as u64)?;
    let mut values = grid.values();
    let mut now = old;
    for axis in 0..3 {
        values = stretched(&values, now, axis, (ratios[axis], size[axis]));
        now[axis] = size[axis];
    }
    let axes = std::array::from_fn(|k| scale(placement.axes[k], ratios[k].recip()));
    Ok(Grid::new(size, &Values::F32(values), Affine { axes, ..*placement })?.made_from(grid))
}

/// `length` values along one axis, `ratio` of them to each old one.
fn stretched(values: &[f32], size: [usize; 3], axis: usize, (ratio, length): (f64, usize)) -> Vec<f32> {
    if ratio == 1.0 {
        return values.to_vec();
    }
    let inner: usize = size[..axis].iter().product();
    let (old, outer) = (size[axis], values.len() / inner / size[axis]);
    let mut out = Vec::with_capacity(outer * length * inner);
    for slab in 0..outer {
        for k in 0..length {
            let at = k as f64 / ratio;
            let (from, share) = (at as usize, at.fract() as f32);
            let row = |k: usize| &values[(slab * old + k.min(old - 1)) * inner..][..inner];
            let pairs = row(from).iter().zip(row(from + 1));
            out.extend(pairs.map(|(a, b)| a + share * (b - a)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        let values = (0..24).collect::<Vec<u8>>();
        Grid::new([2, 3, 4], &Values::U8(values), Affine::spacing([1.0, 2.0, 3.0])).unwrap()
    }

    #[test]
    fn axes_are_turned_and_mirrored() {
        let turned = axes(&grid(), "z -x y", &Limits::default()).unwrap();
        assert_eq!(turned.size(), [4, 2, 3]);
        assert_eq!(turned.placement().axes[0], [3.0, 0.0, 0.0]);
        for (z, x, y) in [(0, 0, 0), (3, 1, 2), (1, 0, 2)] {
            assert_eq!(turned.value([z, 1 - x, y]), grid().value([x, y, z]));
        }
        for bad in ["x y", "x y y", "x y w", "", "x y z x"] {
            assert!(axes(&grid(), bad, &Limits::default()).is_err(), "{bad}");
        }
        assert!(axes(&grid(), "z -x y", &Limits { bytes: 50, outside: false }).is_err());
    }

    #[test]
    fn cubes_have_the_values_of_lines() {
        let cubes = cubes(&grid(), &Limits::default()).unwrap();
        assert_eq!(cubes.size(), [2, 5, 10]);
        assert_eq!(cubes.voxel(), 1.0);
        // The values grow by 1, 2, 6 along the axes.
        for (x, y, z) in [(0, 0, 0), (1, 4, 9), (1, 3, 4)] {
            let expected = x as f64 + y as f64 + 2.0 * z as f64;
            assert!((cubes.value([x, y, z]) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn cubes_of_broken_ratios_have_the_shortest_edge() {
        let values = Values::U8((0..8).collect());
        for (edge, size) in [(1.4, 11), (1.6, 12), (2.5, 19), (1.000_000_1, 8)] {
            let long = Grid::new([1, 1, 8], &values, Affine::spacing([1.0, 1.0, edge])).unwrap();
            let cubes = cubes(&long, &Limits::default()).unwrap();
            assert_eq!(cubes.size(), [1, 1, size], "{edge}");
            let lengths = cubes.placement().axes.map(length);
            assert!(lengths.iter().all(|edge| (edge - 1.0).abs() < 1e-6), "{lengths:?}");
            for z in 0..size {
                let expected = (z as f64 / edge).min(7.0);
                assert!((cubes.value([0, 0, z]) - expected).abs() < 1e-5, "{edge} {z}");
            }
        }
    }
}
