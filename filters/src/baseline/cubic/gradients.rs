//! Gradients at the sites that make the cubics along all edges bend least.

use super::super::delaunay::Triangulation;
use super::{MOST_SWEEPS, outcome};
use crate::{Outcome, Run, Stop};

/// The largest change of a gradient in a sweep, over the range of the samples, at which the sweeps end.
const TOLERANCE: f64 = 1e-5;

/// The edges of a triangulation, site by site.
pub(super) struct Network {
    /// Column and row.
    sites: Vec<[i32; 2]>,
    /// Where each site's edges begin, and one more.
    starts: Vec<u32>,
    /// The site at the other end, and one over the cube of the length.
    edges: Vec<(u32, f64)>,
    /// The inverse of the sum of `e e^T / L^3`: first, mixed and last element.
    inverses: Vec<[f64; 3]>,
}

impl Network {
    /// The edges of all triangles; none for a site that is in no triangle.
    pub fn new(triangulation: &Triangulation) -> Self {
        let sites = triangulation.sites.clone();
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(6 * sites.len());
        for &[a, b, c] in &triangulation.triangles {
            // Inner edges come from both their triangles, once each way; those of the hull from one.
            pairs.extend([(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)]);
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; sites.len() + 1];
        for &(from, _) in &pairs {
            starts[from as usize + 1] += 1;
        }
        for at in 0..sites.len() {
            starts[at + 1] += starts[at];
        }
        let weigh = |(from, to): (u32, u32)| {
            let [x, y] = between(&sites, from, to);
            (to, (x * x + y * y).powf(-1.5))
        };
        let edges = pairs.into_iter().map(weigh).collect();
        let mut network = Self { sites, starts, edges, inverses: Vec::new() };
        network.inverses = (0..network.sites.len() as u32).map(|site| network.inverse(site)).collect();
        network
    }

    fn edges(&self, site: u32) -> &[(u32, f64)] {
        &self.edges[self.starts[site as usize] as usize..self.starts[site as usize + 1] as usize]
    }

    fn inverse(&self, site: u32) -> [f64; 3] {
        let mut q = [0.0; 3];
        for &(other, weight) in self.edges(site) {
            let [x, y] = between(&self.sites, site, other);
            q = [q[0] + weight * x * x, q[1] + weight * x * y, q[2] + weight * y * y];
        }
        let determinant = q[0] * q[2] - q[1] * q[1];
        if determinant > 0.0 {
            [q[2] / determinant, -q[1] / determinant, q[0] / determinant]
        } else {
            [0.0; 3]
        }
    }

    /// The gradients (per column, per row) of sites with these values.
    pub fn gradients(&self, values: &[f64], run: &Run<'_>) -> (Vec<[f64; 2]>, Outcome) {
        let mut gradients = vec![[0.0; 2]; values.len()];
        let (low, high) =
            values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
        for sweep in 1..=MOST_SWEEPS {
            let mut largest = 0.0_f64;
            for site in 0..values.len() {
                let new = self.relaxed(site as u32, values, &gradients);
                let old = std::mem::replace(&mut gradients[site], new);
                largest = largest.max((new[0] - old[0]).abs()).max((new[1] - old[1]).abs());
            }
            if largest <= TOLERANCE * (high - low) {
                return (gradients, outcome(Stop::Converged, sweep));
            }
            if let Some(stop) = run.interrupted() {
                return (gradients, outcome(stop, sweep));
            }
        }
        (gradients, outcome(Stop::IterationLimit, MOST_SWEEPS))
    }

    /// The gradient of a site that is best beside its neighbours'.
    fn relaxed(&self, site: u32, values: &[f64], gradients: &[[f64; 2]]) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for &(other, weight) in self.edges(site) {
            let [x, y] = between(&self.sites, site, other);
            let [gx, gy] = gradients[other as usize];
            let rise = values[other as usize] - values[site as usize];
            let share = weight * (1.5 * rise - 0.5 * (gx * x + gy * y));
            sum = [sum[0] + share * x, sum[1] + share * y];
        }
        let [a, b, c] = self.inverses[site as usize];
        [a * sum[0] + b * sum[1], b * sum[0] + c * sum[1]]
    }
}

/// From one site to another, columns and rows.
fn between(sites: &[[i32; 2]], from: u32, to: u32) -> [f64; 2] {
    let (a, b) = (sites[from as usize], sites[to as usize]);
    [f64::from(b[0] - a[0]), f64::from(b[1] - a[1])]
}
