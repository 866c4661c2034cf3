//! What point constraints add to an operator: a symmetric matrix between neighbours on a grid.
//!
//! A point whose value is to be zero adds `w v v'`, with `v` the bilinear weights of the four cells around it. The sum over all
//! points has nine diagonals, of which five planes hold what there is: a cell with itself, with the next one in
//! its row, and with the three below. A plain diagonal is the first plane alone.
//!
//! Roofline of a row, per vector: 9 multiply-adds, 19 loads and a store; the planes are the five streams from memory.

use super::simd::{Lanes, Vector, Vectored, vectors};
use super::window::{PAD, Window};
use super::{Isa, Real};

/// How firmly a point of this weight holds a grid: two springs in a row, its own and one of weight `most`.
fn firm(weight: f64, most: f64) -> f64 {
    if weight.is_finite() { weight * most / (weight + most) } else { most }
}

/// The cells around pixels of the finest grid, axis by axis.
struct Cells {
    window: Window,
    /// Of each row and of each column of pixels: the first of two cells, and the weight of the second.
    axes: [Vec<(usize, f64)>; 2],
}

impl Cells {
    fn new(window: Window, cell: (usize, usize)) -> Self {
        let axis = |cell: usize, n: usize| {
            let place = |at: usize| {
                let centre = (at as f64 + 0.5) / cell as f64 - 0.5;
                let first = centre.max(0.0).min((n as f64 - 2.0).max(0.0)) as usize;
                // A lone cell takes all.
                (first, if n > 1 { centre - first as f64 } else { 0.0 })
            };
            (0..cell * n).map(place).collect()
        };
        Self { window, axes: [axis(cell.0, window.height), axis(cell.1, window.width)] }
    }

    /// Where the first of the four cells around a pixel stands, and the weights of that, the next in its row, and the two below.
    fn around(&self, (y, x): (usize, usize)) -> (usize, [f64; 4]) {
        let ((i, down), (j, right)) = (self.axes[0][y], self.axes[1][x]);
        let v = [(1.0 - down) * (1.0 - right), (1.0 - down) * right, down * (1.0 - right), down * right];
        (self.window.at(i, j), v)
    }
}

/// Sets `pull` to the right-hand side of points that ask for these values instead of zeros: the sum of `w v` times the value.
pub fn pull<T: Real>(
    window: Window,
    cell: (usize, usize),
    points: &[Point],
    values: &[f64],
    most: f64,
    pull: &mut [T],
) {
    pull.fill(T::ZERO);
    let cells = Cells::new(window, cell);
    for (&(y, x, weight), value) in points.iter().zip(values) {
        let (at, v) = cells.around((y, x));
        let below = at + window.stride();
        let force = firm(weight, most) * value;
        for (at, v) in [at, at + 1, below, below + 1].into_iter().zip(v) {
            pull[at] += T::from_f64(force * v);
        }
    }
}

/// The planes, each a buffer of the window: either the first or all five.
#[derive(Clone, Debug)]
pub struct Points<T> {
    planes: Vec<Vec<T>>,
}

/// A point: row and column in pixels of the finest window, and its weight there (infinite: a measured pixel).
pub type Point = (usize, usize, f64);

impl<T: Real> Points<T> {
    /// A diagonal.
    pub fn diagonal(values: Vec<T>) -> Self {
        Self { planes: vec![values] }
    }

    /// The points on a grid whose cells are `cell` (high, wide) pixels of the finest. No point weighs more than `most`: the
    /// weight is that of two springs in a row, the point's own and the grid's.
    pub fn new(window: Window, cell: (usize, usize), points: &[Point], most: f64) -> Self {
        let mut planes: Vec<Vec<T>> = (0..5).map(|_| window.zeros()).collect();
        let cells = Cells::new(window, cell);
        for &(y, x, weight) in points {
            let weight = firm(weight, most);
            let (at, v) = cells.around((y, x));
            let below = at + window.stride();
            let mut add = |plane: usize, at: usize, a: usize, b: usize| {
                planes[plane][at] += T::from_f64(weight * v[a] * v[b]);
            };
            for (k, at) in [at, at + 1, below, below + 1].into_iter().enumerate() {
                add(0, at, k, k);
            }
            add(1, at, 0, 1);
            add(1, below, 2, 3);
            add(2, at + 1, 1, 2);
            add(3, at, 0, 2);
            add(3, at + 1, 1, 3);
            add(4, at, 0, 3);
        }
        Self { planes }
    }

    /// The same with other numbers.
    #[cfg(test)]
    pub fn map<U: Real>(&self, cast: impl Fn(&[T]) -> Vec<U>) -> Points<U> {
        Points { planes: self.planes.iter().map(|plane| cast(plane)).collect() }
    }

    /// The diagonal, a buffer of the window.
    pub fn middle(&self) -> &[T] {
        &self.planes[0]
    }

    /// The entry between places `k` and `l` of a buffer with this stride.
    pub fn entry(&self, stride: usize, k: usize, l: usize) -> f64 {
        let (k, l) = (k.min(l), k.max(l));
        [0, 1, stride - 1, stride, stride + 1]
            .iter()
            .position(|&distance| l - k == distance)
            .and_then(|plane| self.planes.get(plane))
            .map_or(0.0, |plane| plane[k].to_f64())
    }

    /// Adds the matrix times `x` to `q`, both buffers of `tile`, which begins at `(i, j)` of the window. In the padding beside
    /// the tile `q` may become anything.
    pub fn add(&self, isa: Isa, window: Window, (i, j): (usize, usize), tile: Window, x: &[T], q: &mut [T])
    where
        T: Lanes,
    {
        vectors(isa, Add { points: self, window, at: (i, j), tile, x, q });
    }

    /// Adds a row of the matrix times `x` to `q`, a multiple of any vector's lanes. `x`: the row above, its own and the one below,
    /// each with one value more to either side; the first value of `q` belongs to place `at` of the window's buffers.
    #[inline(always)]
    pub fn add_row<'a, V: Vector<Number = T>>(
        &'a self,
        window: Window,
        at: usize,
        x: [&'a [T]; 3],
        q: &mut [T],
    ) {
        let length = q.len();
        let Some([centre, right, down_left, down, down_right]) =
            self.planes.first_chunk().map(|planes: &[Vec<T>; 5]| planes.each_ref().map(Vec::as_slice))
        else {
            for ((q, &x), &d) in q.iter_mut().zip(&x[1][1..]).zip(&self.planes[0][at..]) {
                *q += d * x;
            }
            return;
        };
        let above = at - window.stride();
        let [upper, here, lower] = x;
        let plane = |plane: &'a [T], at: usize| plane[at..][..length].chunks_exact(V::LANES);
        let values = |row: &'a [T], at: usize| row[at..][..length].chunks_exact(V::LANES);
        let own = plane(centre, at).zip(values(here, 1)).zip(plane(right, at).zip(values(here, 2)));
        let own = own.zip(plane(right, at - 1).zip(values(here, 0)));
        let below = plane(down_left, at).zip(values(lower, 0)).zip(plane(down, at).zip(values(lower, 1)));
        let below = below.zip(plane(down_right, at).zip(values(lower, 2)));
        let over =
            plane(down_left, above + 1).zip(values(upper, 2)).zip(plane(down, above).zip(values(upper, 1)));
        let over = over.zip(plane(down_right, above - 1).zip(values(upper, 0)));
        for (q, ((own, below), over)) in q.chunks_exact_mut(V::LANES).zip(own.zip(below).zip(over)) {
            add_three(add_three(add_three(V::load(q), own), below), over).store(q);
        }
    }
}

/// Three vectors of planes, each with what it is multiplied by.
type Three<'a, T> = (((&'a [T], &'a [T]), (&'a [T], &'a [T])), (&'a [T], &'a [T]));

#[inline(always)]
fn add_three<V: Vector>(sum: V, (((a, x), (b, y)), (c, z)): Three<'_, V::Number>) -> V {
    let sum = V::load(a).fused(V::load(x), sum);
    V::load(c).fused(V::load(z), V::load(b).fused(V::load(y), sum))
}

struct Add<'a, T> {
    points: &'a Points<T>,
    window: Window,
    at: (usize, usize),
    tile: Window,
    x: &'a [T],
    q: &'a mut [T],
}

impl<T: Real> Vectored<T> for Add<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector<Number = T>>(self) {
        let stride = self.tile.stride();
        for i in 0..self.tile.height {
            // From the padding on, which has no points.
            let own = (i + PAD) * stride;
            let row = |at: usize| &self.x[at - 1..][..stride + 2];
            let at = self.window.at(self.at.0 + i, self.at.1) - PAD;
            let x = [row(own - stride), row(own), row(own + stride)];
            self.points.add_row::<V>(self.window, at, x, &mut self.q[own..][..stride]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum of `w v v'` point by point, and every instruction set's product with it on the window and on a part.
    #[test]
    fn every_instruction_set_adds_the_sum_over_the_points() {
        for (height, width) in [(1, 1), (1, 6), (7, 1), (2, 2), (5, 23), (12, 40)] {
            let window = Window { y: 0, x: 0, height, width };
            let cell = (4, 2);
            let held: Vec<Point> = (0..2 * height * width)
                .map(|k| ((k * 7) % (cell.0 * height), (k * 11) % (cell.1 * width)))
                .enumerate()
                .map(|(k, (y, x))| (y, x, if k % 3 == 0 { f64::INFINITY } else { 0.5 + k as f64 }))
                .collect();
            let most = 2.0;
            let points = Points::<f64>::new(window, cell, &held, most);
            let cells: Vec<(usize, usize)> =
                (0..height).flat_map(|i| (0..width).map(move |j| (i, j))).collect();
            // Bilinear weights by their definition: a line through the two nearest cells of either axis.
            let weight = |at: usize, cell: usize, n: usize, i: usize| {
                let centre = (at as f64 + 0.5) / cell as f64 - 0.5;
                let first = (centre.floor().max(0.0) as usize).min(n.saturating_sub(2));
                match (n, i.checked_sub(first)) {
                    (1, _) => 1.0,
                    (_, Some(0)) => 1.0 - (centre - first as f64),
                    (_, Some(1)) => centre - first as f64,
                    _ => 0.0,
                }
            };
            let mut x = window.zeros::<f64>();
            for &(i, j) in &cells {
                x[window.at(i, j)] = ((i * 31 + j * 17) as f64 * 0.37).sin();
            }
            let entry = |k: (usize, usize), l: (usize, usize)| -> f64 {
                let of = |point: &Point, at: (usize, usize)| {
                    weight(point.0, cell.0, height, at.0) * weight(point.1, cell.1, width, at.1)
                };
                let firm = |own: f64| if own.is_finite() { 1.0 / (1.0 / own + 1.0 / most) } else { most };
                held.iter().map(|point| firm(point.2) * of(point, k) * of(point, l)).sum()
            };
            // Per cell the product with `x` and the size of what it sums; the stored entries on the way.
            let sums: Vec<(f64, f64)> = cells
                .iter()
                .map(|&k| {
                    cells.iter().fold((0.0, 0.0), |(sum, size), &l| {
                        let own = entry(k, l);
                        let stored = points.entry(window.stride(), window.at(k.0, k.1), window.at(l.0, l.1));
                        assert!((own - stored).abs() <= 1e-12 * held.len() as f64 * most, "{k:?} {l:?}");
                        (sum + own * x[window.at(l.0, l.1)], size + own.abs())
                    })
                })
                .collect();
            let single = Points::<f32>::new(window, cell, &held, most);
            let narrow: Vec<f32> = x.iter().map(|&x| x as f32).collect();
            for isa in Isa::all() {
                let mut q = window.zeros::<f64>();
                points.add(isa, window, (0, 0), window, &x, &mut q);
                let mut narrow_q = window.zeros::<f32>();
                single.add(isa, window, (0, 0), window, &narrow, &mut narrow_q);
                for (&k, &(sum, size)) in cells.iter().zip(&sums) {
                    let at = window.at(k.0, k.1);
                    assert!((q[at] - sum).abs() <= 64.0 * f64::EPSILON * size, "{isa:?} {k:?}");
                    let bound = 64.0 * f64::from(f32::EPSILON) * size;
                    assert!((f64::from(narrow_q[at]) - sum).abs() <= bound, "{isa:?} {k:?}");
                }
                if height > 3 && width > 8 {
                    let (i, j) = (2, 5);
                    let part = Window { y: i, x: j, height: height - 3, width: width - 7 };
                    let (mut own, mut product) = (part.zeros::<f64>(), part.zeros::<f64>());
                    for k in 0..part.height + 2 * PAD {
                        let length = part.width + 2 * PAD;
                        let row = &x[(i + k) * window.stride() + j..][..length];
                        own[k * part.stride()..][..length].copy_from_slice(row);
                    }
                    points.add(isa, window, (i, j), part, &own, &mut product);
                    for k in 0..part.height {
                        let (here, whole) = (part.at(k, 0), window.at(i + k, j));
                        for (a, b) in product[here..][..part.width].iter().zip(&q[whole..]) {
                            assert!((a - b).abs() <= 64.0 * f64::EPSILON * b.abs().max(1.0));
                        }
                    }
                }
            }
        }
    }

    /// Bilinear weights give planes exactly, so points that ask for the values of a plane pull as the matrix would.
    #[test]
    fn points_on_a_plane_pull_as_the_matrix_does() {
        let window = Window { y: 0, x: 0, height: 6, width: 9 };
        let (cell, most) = ((4, 2), 2.0);
        let held: Vec<Point> = (0..40).map(|k| ((k * 7) % 24, (k * 11) % 18, 0.5 + k as f64)).collect();
        let plane = |y: f64, x: f64| 1.0 + 0.25 * y - 0.5 * x;
        let mut grid = window.zeros::<f64>();
        for i in 0..window.height {
            for j in 0..window.width {
                grid[window.at(i, j)] = plane(4.0 * i as f64 + 1.5, 2.0 * j as f64 + 0.5);
            }
        }
        let mut product = window.zeros();
        let points = Points::<f64>::new(window, cell, &held, most);
        points.add(Isa::best(), window, (0, 0), window, &grid, &mut product);
        let mut found = vec![f64::NAN; window.len()];
        let values: Vec<f64> = held.iter().map(|point| plane(point.0 as f64, point.1 as f64)).collect();
        pull(window, cell, &held, &values, most, &mut found);
        for i in 0..window.height {
            for j in 0..window.width {
                let at = window.at(i, j);
                assert!((found[at] - product[at]).abs() <= 1e-12 * 40.0 * most * 10.0, "{i} {j}");
            }
        }
    }

    #[test]
    fn a_diagonal_multiplies_place_by_place() {
        let window = Window { y: 0, x: 0, height: 3, width: 5 };
        let (mut d, mut x) = (window.zeros::<f64>(), window.zeros::<f64>());
        for i in 0..3 {
            for j in 0..5 {
                (d[window.at(i, j)], x[window.at(i, j)]) = (i as f64, 1.0 + j as f64);
            }
        }
        let points = Points::diagonal(d);
        let mut q = window.zeros::<f64>();
        points.add(Isa::best(), window, (0, 0), window, &x, &mut q);
        for i in 0..3 {
            for j in 0..5 {
                assert!((q[window.at(i, j)] - i as f64 * (1.0 + j as f64)).abs() <= f64::EPSILON);
                assert!(
                    (points.entry(window.stride(), window.at(i, j), window.at(i, j)) - i as f64).abs() <= 0.0
                );
            }
        }
    }
}
