//! Row loops of a few conjugate-gradient steps on the masked Poisson problem, which make a dual variable nearly
//! divergence-free at missing pixels. Whatever they compute, the bound stays valid, so f32 sums are enough.
//!
//! Roofline: 5 steps on a band of rows whose four vectors stay in L2; per step and pixel 44 bytes of L2 traffic and
//! 16 flops, so L2 bandwidth bounds it.

use super::{DualBall, PrimalRow, dispatch};

/// Lanes of the f32 partial sums.
const WIDE: usize = 16;

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let (a, a_rest) = a.as_chunks::<WIDE>();
    let (b, b_rest) = b.as_chunks::<WIDE>();
    let mut sums = [0.0_f32; WIDE];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..WIDE {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(&a, &b)| f64::from(a * b)).sum();
    rest + sums.iter().map(|&sum| f64::from(sum)).sum::<f64>()
}

dispatch! {
    /// Writes the adjoint gradient of the dual variable at free pixels, 0 elsewhere, and returns its squared norm.
    source_row = source(out: &mut [f32], row: PrimalRow<'_>) -> f64
}

#[inline(always)]
fn source(out: &mut [f32], row: PrimalRow<'_>) -> f64 {
    let n = out.len();
    if n == 0 {
        return 0.0;
    }
    let (above, vertical, horizontal, free) =
        (&row.above[..n], &row.vertical[..n], &row.horizontal[..n], &row.free[..n]);
    out[0] = f32::from(free[0]) * ((above[0] - vertical[0]) - horizontal[0]);
    for j in 1..n {
        out[j] = f32::from(free[j]) * ((above[j] - vertical[j]) + (horizontal[j - 1] - horizontal[j]));
    }
    dot(out, out)
}

dispatch! {
    /// `out = M grad* grad p` for `p` that is 0 at fixed pixels; returns the product of `p` and `out`.
    /// At the image's first and last row, `above` or `below` is `p` itself.
    laplacian_row = laplacian(out: &mut [f32], p: &[f32], above: &[f32], below: &[f32], free: &[u8]) -> f64
}

#[inline(always)]
fn laplacian(out: &mut [f32], p: &[f32], above: &[f32], below: &[f32], free: &[u8]) -> f64 {
    let n = p.len();
    if n == 0 {
        return 0.0;
    }
    let (out, above, below, free) = (&mut out[..n], &above[..n], &below[..n], &free[..n]);
    let vertical = |j: usize| (p[j] - above[j]) + (p[j] - below[j]);
    let last = n - 1;
    out[0] = f32::from(free[0]) * (vertical(0) + if n > 1 { p[0] - p[1] } else { 0.0 });
    for j in 1..last {
        out[j] = f32::from(free[j]) * (vertical(j) + ((p[j] - p[j - 1]) + (p[j] - p[j + 1])));
    }
    if n > 1 {
        out[last] = f32::from(free[last]) * (vertical(last) + (p[last] - p[last - 1]));
    }
    dot(p, out)
}

dispatch! {
    /// `phi <- phi + alpha p`, `r <- r - alpha lap`; returns the squared norm of `r`.
    descend_row = descend(phi: &mut [f32], r: &mut [f32], p: &[f32], lap: &[f32], alpha: f32) -> f64
}

#[inline(always)]
fn descend(phi: &mut [f32], r: &mut [f32], p: &[f32], lap: &[f32], alpha: f32) -> f64 {
    for (((phi, r), &p), &lap) in phi.iter_mut().zip(r.iter_mut()).zip(p).zip(lap) {
        *phi += alpha * p;
        *r -= alpha * lap;
    }
    dot(r, r)
}

dispatch! {
    /// `p <- r + beta p`.
    direction_row = direction(p: &mut [f32], r: &[f32], beta: f32)
}

#[inline(always)]
fn direction(p: &mut [f32], r: &[f32], beta: f32) {
    for (p, &r) in p.iter_mut().zip(r) {
        *p = r + beta * *p;
    }
}

dispatch! {
    /// `q <- clip(q - grad phi)`; `below` is the next row of `phi`, or `phi` itself at the image's last row.
    correct_row<B> = correct(vertical: &mut [f32], horizontal: &mut [f32], phi: &[f32], below: &[f32])
}

#[inline(always)]
fn correct<B: DualBall>(vertical: &mut [f32], horizontal: &mut [f32], phi: &[f32], below: &[f32]) {
    let n = phi.len();
    if n == 0 {
        return;
    }
    let (vertical, horizontal, below) = (&mut vertical[..n], &mut horizontal[..n], &below[..n]);
    let right = &phi[1..n];
    for j in 0..n - 1 {
        let (a, b) = B::clip(vertical[j] - (below[j] - phi[j]), horizontal[j] - (right[j] - phi[j]));
        vertical[j] = a;
        horizontal[j] = b;
    }
    let last = n - 1;
    let (a, _) = B::clip(vertical[last] - (below[last] - phi[last]), 0.0);
    vertical[last] = a;
}
