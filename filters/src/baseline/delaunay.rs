//! The Delaunay triangulation of the measured pixels, and the triangle that each missing pixel lies in.
//!
//! Pixel centres are the sites; a missing pixel on an edge belongs to either triangle, which is settled by the order of
//! triangles. Where four or more sites lie on an empty circle the triangulation is not unique: the crate's order of insertion
//! decides, which depends on nothing but the mask. Without three sites that are not collinear there is no triangle.
//!
//! Cost: O(n log n) for n measured pixels on one thread, about 1 microsecond a site; a u32 a pixel and 48 bytes a site kept.
//! Range: sites are inserted by exact orientation tests; the test for the empty circle is exact while circles are narrower
//! than about 4000 pixels, beyond which a triangle may be thinner than it must.

use delaunator::{EMPTY, Point};
use lacuna_core::parallel::prelude::*;

use crate::{Error, Mask, Size};

/// In a table of triangles: there is none.
pub(super) const NONE: u32 = u32::MAX;

/// Triangles over the measured pixels.
pub(super) struct Triangulation {
    /// The sites: column and row, in row-major order.
    pub sites: Vec<[i32; 2]>,
    /// The sites' row-major indices in the image.
    pub pixels: Vec<u32>,
    /// Three sites each, all turning the same way.
    pub triangles: Vec<[u32; 3]>,
    /// Beyond the edge from corner k to corner k + 1: the triangle there, [`NONE`] at the hull.
    pub neighbours: Vec<[u32; 3]>,
    /// Per pixel the triangle of a missing pixel; [`NONE`] for measured ones and outside the hull.
    pub at: Vec<u32>,
    size: Size,
}

impl Triangulation {
    /// Triangulates the measured pixels of a mask.
    ///
    /// # Errors
    /// [`Error::EmptyMask`]; [`Error::TooLarge`] if the image has 2^31 pixels or more.
    pub fn new(mask: &Mask) -> Result<Self, Error> {
        let size = mask.size();
        mask.require_samples()?;
        if i32::try_from(size.pixels()).is_err() {
            return Err(Error::TooLarge { size });
        }
        let measured = mask.as_slice().iter().enumerate().filter(|(_, flag)| **flag);
        let pixels: Vec<u32> = measured.map(|(at, _)| at as u32).collect();
        let place = |&at: &u32| [(at as usize % size.width) as i32, (at as usize / size.width) as i32];
        let sites: Vec<[i32; 2]> = pixels.iter().map(place).collect();
        let (triangles, neighbours) = triangulate(&sites);
        let mut found = Self { sites, pixels, triangles, neighbours, at: vec![NONE; size.pixels()], size };
        for index in 0..found.triangles.len() {
            found.paint(index, mask);
        }
        Ok(found)
    }

    /// The corners of a triangle: column and row.
    pub fn corners(&self, triangle: u32) -> [[f64; 2]; 3] {
        self.triangles[triangle as usize].map(|site| self.sites[site as usize].map(f64::from))
    }

    /// Enters a triangle at the missing pixels within it: row by row those where no edge has them on its outer side.
    fn paint(&mut self, index: usize, mask: &Mask) {
        let corners = self.triangles[index].map(|site| self.sites[site as usize].map(i64::from));
        let [a, b, c] = corners;
        let turn = ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).signum();
        let rows = corners.map(|corner| corner[1]);
        let (top, bottom) = (rows[0].min(rows[1]).min(rows[2]), rows[0].max(rows[1]).max(rows[2]));
        for y in top..=bottom {
            let (mut first, mut last) = (0_i64, self.size.width as i64 - 1);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                // turn * (dx (y - y0) - dy (x - x0)) >= 0
                let (dx, dy) = (turn * (to[0] - from[0]), turn * (to[1] - from[1]));
                let rest = dx * (y - from[1]) + dy * from[0];
                match dy.signum() {
                    1 => last = last.min(rest.div_euclid(dy)),
                    -1 => first = first.max(-rest.div_euclid(-dy)),
                    _ if rest < 0 => last = -1,
                    _ => {}
                }
            }
            for x in first..=last {
                let at = y as usize * self.size.width + x as usize;
                if !mask.as_slice()[at] {
                    self.at[at] = index as u32;
                }
            }
        }
    }

    /// Writes `value(triangle, barycentric coordinates)` to the missing pixels inside the hull, rows in parallel. `prepare`
    /// makes what the pixels of a triangle share; it is asked again wherever a row enters a triangle.
    pub fn fill<T>(
        &self,
        out: &mut [f32],
        prepare: impl Fn(u32) -> T + Sync,
        value: impl Fn(&T, [f64; 3]) -> f32 + Sync,
    ) {
        let width = self.size.width;
        let rows = out.par_chunks_mut(width).zip(self.at.par_chunks(width)).enumerate();
        rows.for_each(|(y, (out, triangles))| {
            let mut shared: Option<(u32, T, Barycentric)> = None;
            for (x, (out, &triangle)) in out.iter_mut().zip(triangles).enumerate() {
                if triangle == NONE {
                    continue;
                }
                if shared.as_ref().is_none_or(|(known, ..)| *known != triangle) {
                    shared = Some((triangle, prepare(triangle), Barycentric::of(self.corners(triangle))));
                }
                if let Some((_, shared, within)) = &shared {
                    *out = value(shared, within.at([x as f64, y as f64]));
                }
            }
        });
    }
}

/// Triangles and, beyond each edge, the neighbour.
fn triangulate(sites: &[[i32; 2]]) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
    let points: Vec<Point> = sites.iter().map(|&[x, y]| Point { x: f64::from(x), y: f64::from(y) }).collect();
    let found = delaunator::triangulate(&points);
    let triangles = found.triangles.chunks_exact(3).map(|corners| [0, 1, 2].map(|k| corners[k] as u32));
    let beyond = |edge: usize| if edge == EMPTY { NONE } else { (edge / 3) as u32 };
    let neighbours = found.halfedges.chunks_exact(3).map(|edges| [0, 1, 2].map(|k| beyond(edges[k])));
    (triangles.collect(), neighbours.collect())
}

/// A point's shares of the corners of a triangle, which add up to 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Barycentric {
    corner: [f64; 2],
    rows: [[f64; 2]; 2],
}

impl Barycentric {
    /// Of a triangle that is not flat.
    pub fn of([a, b, c]: [[f64; 2]; 3]) -> Self {
        let (u, v) = ([a[0] - c[0], a[1] - c[1]], [b[0] - c[0], b[1] - c[1]]);
        let area = u[0] * v[1] - u[1] * v[0];
        Self { corner: c, rows: [[v[1] / area, -v[0] / area], [-u[1] / area, u[0] / area]] }
    }

    /// At column and row.
    pub fn at(&self, point: [f64; 2]) -> [f64; 3] {
        let by = [point[0] - self.corner[0], point[1] - self.corner[1]];
        let [a, b] = self.rows.map(|row| row[0] * by[0] + row[1] * by[1]);
        [a, b, 1.0 - a - b]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::baseline::testing;

    /// Twice the signed area of three sites.
    fn area(a: [i32; 2], b: [i32; 2], c: [i32; 2]) -> i64 {
        let [a, b, c] = [a, b, c].map(|site| site.map(i64::from));
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    /// Whether `p` lies strictly inside the circle through three sites, in exact integers.
    fn in_circle(corners: [[i32; 2]; 3], p: [i32; 2]) -> bool {
        let [a, b, c] = corners.map(|site| [0, 1].map(|k| i128::from(site[k] - p[k])));
        let square = |v: [i128; 2]| v[0] * v[0] + v[1] * v[1];
        let minor = |u: [i128; 2], v: [i128; 2]| u[0] * v[1] - u[1] * v[0];
        let determinant = square(a) * minor(b, c) + square(b) * minor(c, a) + square(c) * minor(a, b);
        determinant * i128::from(area(corners[0], corners[1], corners[2]).signum()) > 0
    }

    proptest! {
        #[test]
        fn circles_are_empty_and_triangles_cover_the_hull(mask in testing::mask(14)) {
            let found = Triangulation::new(&mask).unwrap();
            let mut whole = 0;
            for triangle in &found.triangles {
                let corners = triangle.map(|site| found.sites[site as usize]);
                whole += area(corners[0], corners[1], corners[2]).abs();
                prop_assert!(found.sites.iter().all(|&site| !in_circle(corners, site)));
            }
            // The hull's area by a walk along its lower and its upper side.
            let mut hull: Vec<[i32; 2]> = Vec::new();
            let mut sites = found.sites.clone();
            sites.sort_unstable();
            for side in [sites.clone(), sites.into_iter().rev().collect()] {
                let start = hull.len();
                for site in side {
                    while hull.len() >= start + 2 && area(hull[hull.len() - 2], hull[hull.len() - 1], site) <= 0 {
                        hull.pop();
                    }
                    hull.push(site);
                }
                hull.pop();
            }
            let outline: i64 = (1..hull.len().max(2) - 1).map(|k| area(hull[0], hull[k], hull[k + 1])).sum();
            prop_assert_eq!(whole, outline);
        }

        #[test]
        fn each_missing_pixel_has_the_triangle_it_lies_in(mask in testing::mask(20)) {
            let found = Triangulation::new(&mask).unwrap();
            let width = mask.size().width;
            let inside = |triangle: [u32; 3], p: [i32; 2]| {
                let [a, b, c] = triangle.map(|site| found.sites[site as usize]);
                let sides = [area(a, b, p), area(b, c, p), area(c, a, p)];
                sides.iter().all(|&side| side >= 0) || sides.iter().all(|&side| side <= 0)
            };
            for (at, &triangle) in found.at.iter().enumerate() {
                let p = [(at % width) as i32, (at / width) as i32];
                if mask.as_slice()[at] {
                    prop_assert_eq!(triangle, NONE);
                } else if triangle == NONE {
                    prop_assert!(found.triangles.iter().all(|&triangle| !inside(triangle, p)));
                } else {
                    prop_assert!(inside(found.triangles[triangle as usize], p));
                }
            }
        }

        #[test]
        fn neighbours_share_the_edge(mask in testing::mask(20)) {
            let found = Triangulation::new(&mask).unwrap();
            for (index, neighbours) in found.neighbours.iter().enumerate() {
                for (k, &other) in neighbours.iter().enumerate().filter(|(_, other)| **other != NONE) {
                    let edge = [found.triangles[index][k], found.triangles[index][(k + 1) % 3]];
                    let shared = found.triangles[other as usize];
                    prop_assert!(edge.iter().all(|site| shared.contains(site)));
                }
            }
        }
    }

    #[test]
    fn collinear_sites_have_no_triangle() {
        for (height, width) in [(1, 1), (1, 9), (9, 1), (2, 1)] {
            let found = Triangulation::new(&Mask::from_fn(Size::new(height, width), |_, _| true)).unwrap();
            assert!(found.triangles.is_empty());
        }
        let diagonal = Mask::from_fn(Size::new(9, 9), |y, x| y == x);
        assert!(Triangulation::new(&diagonal).unwrap().triangles.is_empty());
    }
}
