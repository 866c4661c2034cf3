//! The slow twin: total variation by a primal-dual interior-point method with dense solves, in f64.
//!
//! With `s(g) = mu + sqrt(mu^2 + |g|^2)` it follows the path `s q = g`, `grad* q + lambda S^T r = 0`,
//! `lambda (epsilon^2 - |r|^2) = 2 mu` as `mu` goes to 0, by Newton steps in which `q` and `lambda` are variables of
//! their own. Nothing but the problem is shared with the fast path.
//!
//! Source: T. Chan, G. Golub, P. Mulet, "A Nonlinear Primal-Dual Method for Total Variation-Based Image Restoration",
//! SIAM J. Sci. Comput. 20(6), 1999 (the linearisation); the barrier is that of second-order cones.

use crate::prox::Norm;

/// A problem on `height x width` pixels; `sample` is read at measured pixels.
pub struct Twin {
    pub height: usize,
    pub width: usize,
    pub measured: Vec<bool>,
    pub sample: Vec<f64>,
    pub norm: Norm,
    pub epsilon: f64,
    /// Roots of the samples' weights: the residual is `r = root (x - sample)`.
    pub root: Vec<f64>,
}

/// A minimiser with its proof.
pub struct Solution {
    pub x: Vec<f64>,
    pub objective: f64,
    /// Absolute duality gap.
    pub gap: f64,
}

/// The pixels whose differences form one gradient: up to two pairs (from, to).
type Group = Vec<(usize, usize)>;

struct Iterate {
    x: Vec<f64>,
    q: Vec<[f64; 2]>,
    lambda: f64,
}

impl Twin {
    fn groups(&self) -> Vec<Group> {
        let mut groups = Vec::new();
        for y in 0..self.height {
            for x in 0..self.width {
                let at = y * self.width + x;
                let down = (y + 1 < self.height).then_some((at, at + self.width));
                let right = (x + 1 < self.width).then_some((at, at + 1));
                match self.norm {
                    Norm::Isotropic => groups.push(down.into_iter().chain(right).collect()),
                    Norm::Anisotropic => groups.extend(down.into_iter().chain(right).map(|pair| vec![pair])),
                }
            }
        }
        groups.retain(|group: &Group| !group.is_empty());
        groups
    }

    /// The objective of an image.
    pub fn objective(&self, x: &[f64]) -> f64 {
        self.groups().iter().map(|group| length(difference(group, x))).sum()
    }

    /// Distance of an image from the samples.
    pub fn distance(&self, x: &[f64]) -> f64 {
        self.residual(x).iter().map(|r| r * r).sum::<f64>().sqrt()
    }

    fn residual(&self, x: &[f64]) -> Vec<f64> {
        (0..x.len())
            .map(|i| if self.measured[i] { self.root[i] * (x[i] - self.sample[i]) } else { 0.0 })
            .collect()
    }

    /// Lower bound of the objective by `q`, with missing pixels in the samples' range.
    fn bound(&self, groups: &[Group], q: &[[f64; 2]]) -> f64 {
        let longest = q.iter().map(|&q| length(q)).fold(1.0, f64::max);
        let mut d = vec![0.0; self.sample.len()];
        for (group, q) in groups.iter().zip(q) {
            for (&(from, to), q) in group.iter().zip(q) {
                d[to] += q / longest;
                d[from] -= q / longest;
            }
        }
        let measured = || (0..d.len()).filter(|&i| self.measured[i]);
        let low = measured().map(|i| self.sample[i]).fold(f64::INFINITY, f64::min);
        let high = measured().map(|i| self.sample[i]).fold(f64::NEG_INFINITY, f64::max);
        let held: f64 = measured().map(|i| self.sample[i] * d[i]).sum();
        let ball = self.epsilon * measured().map(|i| (d[i] / self.root[i]).powi(2)).sum::<f64>().sqrt();
        let free: f64 =
            (0..d.len()).filter(|&i| !self.measured[i]).map(|i| (low * d[i]).min(high * d[i])).sum();
        held + free - ball
    }

    /// Minimises to a relative gap of `tolerance`, or as far as f64 goes.
    pub fn solve(&self, tolerance: f64) -> Solution {
        let groups = self.groups();
        let count = self.measured.iter().filter(|&&m| m).count() as f64;
        let measured = || self.sample.iter().zip(&self.measured).filter(|(_, m)| **m).map(|(s, _)| *s);
        let mean = measured().sum::<f64>() / count;
        let start = self.sample.iter().zip(&self.measured).map(|(&s, &m)| if m { s } else { mean });
        let mut at = Iterate { x: start.collect(), q: vec![[0.0; 2]; groups.len()], lambda: 0.0 };
        let mut best = Solution { x: at.x.clone(), objective: self.objective(&at.x), gap: f64::INFINITY };
        let mut bound = 0.0_f64;
        let mut mu = best.objective / groups.len() as f64;
        at.lambda = 2.0 * mu / self.epsilon.powi(2).max(f64::MIN_POSITIVE);
        for _ in 0..300 {
            self.newton(&groups, &mut at, mu);
            bound = bound.max(self.bound(&groups, &at.q));
            let objective = self.objective(&at.x);
            if objective <= best.objective {
                best = Solution { x: at.x.clone(), objective, gap: 0.0 };
            }
            best.gap = best.objective - bound;
            if best.gap <= tolerance * best.objective {
                break;
            }
            let now = (objective - bound) / groups.len() as f64;
            mu = mu.min(0.3 * now).max(1e-3 * tolerance * best.objective / groups.len() as f64);
        }
        best
    }

    /// One Newton step towards the point of the path at `mu`.
    fn newton(&self, groups: &[Group], at: &mut Iterate, mu: f64) {
        let n = at.x.len();
        let moves = |i: usize| self.epsilon > 0.0 || !self.measured[i];
        let mut matrix = vec![0.0; n * n];
        let mut right = vec![0.0; n];
        let mut blocks = Vec::with_capacity(groups.len());
        for (group, q) in groups.iter().zip(&at.q) {
            let g = difference(group, &at.x);
            let root = mu.hypot(length(g));
            let s = mu + root;
            let cross = 0.5 * (q[0] * g[1] + q[1] * g[0]) / root;
            let block =
                [[(1.0 - q[0] * g[0] / root) / s, -cross / s], [-cross / s, (1.0 - q[1] * g[1] / root) / s]];
            for (k, &(from, to)) in group.iter().enumerate() {
                right[to] -= g[k] / s;
                right[from] += g[k] / s;
                for (l, &(from2, to2)) in group.iter().enumerate() {
                    for (i, si) in [(to, 1.0), (from, -1.0)] {
                        for (j, sj) in [(to2, 1.0), (from2, -1.0)] {
                            matrix[i * n + j] += si * sj * block[k][l];
                        }
                    }
                }
            }
            blocks.push((block, [g[0] / s, g[1] / s]));
        }
        let r = self.residual(&at.x);
        let room = self.epsilon.powi(2) - r.iter().map(|r| r * r).sum::<f64>();
        if self.epsilon > 0.0 {
            for i in (0..n).filter(|&i| self.measured[i]) {
                let slope = |i: usize| self.root[i] * r[i];
                right[i] -= 2.0 * mu / room * slope(i);
                matrix[i * n + i] += at.lambda * self.root[i].powi(2);
                for j in 0..n {
                    matrix[i * n + j] += 2.0 * at.lambda * slope(i) * slope(j) / room;
                }
            }
        }
        for i in (0..n).filter(|&i| !moves(i)) {
            right[i] = 0.0;
            for j in 0..n {
                matrix[i * n + j] = 0.0;
                matrix[j * n + i] = 0.0;
            }
            matrix[i * n + i] = 1.0;
        }
        let step = cholesky_solve(matrix, right, n);
        self.take(groups, at, &step, &blocks, &r, room, mu);
    }

    #[allow(clippy::too_many_arguments, reason = "the second half of one Newton step")]
    fn take(
        &self,
        groups: &[Group],
        at: &mut Iterate,
        step: &[f64],
        blocks: &[([[f64; 2]; 2], [f64; 2])],
        r: &[f64],
        room: f64,
        mu: f64,
    ) {
        let mut dual = 1.0_f64;
        let mut turns = Vec::with_capacity(groups.len());
        for ((group, (block, target)), q) in groups.iter().zip(blocks).zip(&at.q) {
            let dg = difference(group, step);
            let turn = [0, 1].map(|k| block[k][0] * dg[0] + block[k][1] * dg[1] + target[k] - q[k]);
            while length([q[0] + dual * turn[0], q[1] + dual * turn[1]]) >= 1.0 && dual > 1e-12 {
                dual *= 0.9;
            }
            turns.push(turn);
        }
        let mut primal = 1.0;
        if self.epsilon > 0.0 {
            let along: f64 = (0..r.len()).map(|i| self.root[i] * r[i] * step[i]).sum();
            let turn = (2.0 * mu - at.lambda * room + 2.0 * at.lambda * along) / room;
            while at.lambda + dual * turn <= 0.0 {
                dual *= 0.9;
            }
            let moved = |t: f64| {
                let x: Vec<f64> = at.x.iter().zip(step).map(|(x, s)| x + t * s).collect();
                self.distance(&x)
            };
            while moved(primal) >= self.epsilon {
                primal *= 0.9;
            }
            // Strictly inside, so that the next room is positive.
            if primal < 1.0 {
                primal *= 0.95;
            }
            at.lambda += dual * turn;
        }
        for (q, turn) in at.q.iter_mut().zip(turns) {
            *q = [q[0] + dual * turn[0], q[1] + dual * turn[1]];
        }
        for (x, s) in at.x.iter_mut().zip(step) {
            *x += primal * s;
        }
    }
}

fn length([a, b]: [f64; 2]) -> f64 {
    a.hypot(b)
}

/// The gradient of a group; a missing component is 0.
fn difference(group: &Group, x: &[f64]) -> [f64; 2] {
    let mut g = [0.0; 2];
    for (g, &(from, to)) in g.iter_mut().zip(group) {
        *g = x[to] - x[from];
    }
    g
}

/// Solves a symmetric positive definite system; a pivot lost to rounding leaves its variable where it is.
fn cholesky_solve(mut a: Vec<f64>, mut b: Vec<f64>, n: usize) -> Vec<f64> {
    for j in 0..n {
        for k in 0..j {
            let factor = a[j * n + k];
            for i in j..n {
                a[i * n + j] -= a[i * n + k] * factor;
            }
        }
        let pivot = if a[j * n + j] > 0.0 { a[j * n + j].sqrt() } else { 1e100 };
        a[j * n + j] = pivot;
        for i in j + 1..n {
            a[i * n + j] /= pivot;
        }
    }
    for i in 0..n {
        for k in 0..i {
            b[i] -= a[i * n + k] * b[k];
        }
        b[i] /= a[i * n + i];
    }
    for i in (0..n).rev() {
        for k in i + 1..n {
            b[i] -= a[k * n + i] * b[k];
        }
        b[i] /= a[i * n + i];
    }
    b
}
