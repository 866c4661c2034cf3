//! The minimum of the energy on a tile, by conjugate gradients. [`super`] has the formulas.
//!
//! Planes lie flat between margins of a row and more that stay zero, and every pass is one loop over all pixels: what a difference takes
//! from beyond the tile, or from the end of the row before, meets a coefficient of zero.

use super::{LANES, Tile, slices};
use crate::kernel::Body;
use crate::kernel::aligned::Aligned;

/// Values that are summed in single precision.
const RUN: usize = 8 * LANES;

/// The energy's coefficients on a tile, and room for what is computed with them. Between its margins a plane has the tile's pixels, and
/// zeros up to a multiple of [`LANES`].
#[derive(Debug, Default)]
pub(super) struct Operator {
    height: usize,
    width: usize,
    /// `p` at pixels that have both neighbours in their row.
    p: Aligned<f32>,
    /// `r` at pixels that have both neighbours in their column.
    r: Aligned<f32>,
    /// `q / 2` at pixels.
    half: Aligned<f32>,
    /// `q^2` at pixels that have all four neighbours.
    square: Aligned<f32>,
    /// At cells: the factor of the squared mixed difference. No cell is in the last row or column.
    twist: Aligned<f32>,
    pulls: Pulls,
    steps: Steps,
}

/// What second derivatives pull with.
#[derive(Debug, Default)]
struct Pulls {
    /// At pixels, along rows.
    xx: Aligned<f32>,
    /// At pixels, along columns.
    yy: Aligned<f32>,
    /// At pixels: their share in the pull of the cells around.
    share: Aligned<f32>,
    /// At cells: mixed differences, then what they pull with.
    mixed: Aligned<f32>,
}

/// What conjugate gradients keep.
#[derive(Debug, Default)]
struct Steps {
    /// Inverse of the diagonal where pixels are free, else 0.
    inverse: Aligned<f32>,
    pixels: Aligned<f32>,
    residual: Aligned<f32>,
    direction: Aligned<f32>,
    /// What the operator makes of the direction.
    image: Aligned<f32>,
}

/// Solves for the free pixels of every channel, starting from what is there.
#[derive(Debug)]
pub struct Solve<'a> {
    /// The tile, whose matrices are known.
    pub tile: &'a mut Tile,
    /// Steps at most.
    pub steps: usize,
    /// The residual, over what it is at first, at which a channel ends.
    pub tolerance: f64,
}

impl Body for Solve<'_> {
    /// The most steps that a channel took, and the largest residual over what it was.
    type Output = (usize, f64);
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> (usize, f64) {
        let Tile { height, width, values, free, matrix, operator, .. } = self.tile;
        operator.find(matrix, (*height, *width));
        operator.precondition(free);
        let (mut most, mut largest) = (0, 0.0_f64);
        for pixels in values.chunks_exact_mut(*height * *width) {
            let (steps, left) = operator.minimise(pixels, self.steps, self.tolerance);
            (most, largest) = (most.max(steps), largest.max(left));
        }
        (most, largest)
    }
}

impl Operator {
    /// Zeros on either side of a plane.
    fn margin(&self) -> usize {
        (self.width + 1).next_multiple_of(LANES)
    }

    /// Values between the margins.
    fn length(&self) -> usize {
        (self.height * self.width).next_multiple_of(LANES)
    }

    /// Takes on a size. What lies outside of the tile's pixels is zero, and stays so.
    fn resize(&mut self, (height, width): (usize, usize)) {
        if (self.height, self.width) == (height, width) {
            return;
        }
        (self.height, self.width) = (height, width);
        let length = self.length() + 2 * self.margin();
        let Self { p, r, half, square, twist, pulls: Pulls { xx, yy, share, mixed }, steps, .. } = self;
        let Steps { inverse, pixels, residual, direction, image } = steps;
        for plane in [p, r, half, square, twist, xx, yy, share, mixed] {
            *plane = Aligned::zeros(length);
        }
        for plane in [inverse, pixels, residual, direction, image] {
            *plane = Aligned::zeros(length);
        }
    }

    /// Finds the coefficients from a tile's matrices.
    #[inline(always)]
    pub(super) fn find(&mut self, [p, q, r]: &[Vec<f32>; 3], size: (usize, usize)) {
        self.resize(size);
        let ((h, w), margin) = (size, self.margin());
        let inner = margin..margin + h * w;
        let Self { p: along, r: down, half, square, twist, steps, .. } = self;
        // Until there are steps, what the factors of cells are the mean of.
        let both = &mut steps.image;
        let targets = both[inner.clone()].iter_mut().zip(&mut half[inner.clone()]);
        let targets = targets.zip(&mut square[inner.clone()]);
        for (((both, half), square), ((p, q), r)) in targets.zip(p.iter().zip(q).zip(r)) {
            *both = p * r + q * q;
            *half = 0.5 * q;
            *square = q * q;
        }
        let [a, b, c, d] = slices(both, [0, 1, w, w + 1].map(|k| margin + k), h * w);
        for (i, twist) in twist[inner.clone()].iter_mut().enumerate() {
            *twist = 0.5 * ((a[i] + b[i]) + (c[i] + d[i]));
        }
        clear_ends(&mut twist[inner.clone()], size);
        along[inner.clone()].copy_from_slice(p);
        down[inner.clone()].copy_from_slice(r);
        for plane in [along, &mut *square] {
            plane[inner.clone()].chunks_exact_mut(w).for_each(|row| (row[0], row[w - 1]) = (0.0, 0.0));
        }
        for plane in [down, square] {
            plane[margin..][..w].fill(0.0);
            plane[inner.end - w..][..w].fill(0.0);
        }
    }

    /// The diagonal of half of the energy's Hessian; at the border without products of different derivatives, which cancel elsewhere.
    #[inline(always)]
    pub(super) fn diagonal(&self, out: &mut [f32]) {
        let (w, margin, n) = (self.width, self.margin(), out.len());
        let [p0, p1, p2] = slices(&self.p, [margin - 1, margin, margin + 1], n);
        let [r0, r1, r2] = slices(&self.r, [margin - w, margin, margin + w], n);
        let [t0, t1, t2, t3] = slices(&self.twist, [margin - w - 1, margin - w, margin - 1, margin], n);
        let square = &self.square[margin..][..n];
        for (i, out) in out.iter_mut().enumerate() {
            let along = p0[i] * p0[i] + 4.0 * p1[i] * p1[i] + p2[i] * p2[i];
            let across = r0[i] * r0[i] + 4.0 * r1[i] * r1[i] + r2[i] * r2[i];
            *out = (along + across) + (8.0 * square[i] + ((t0[i] + t1[i]) + (t2[i] + t3[i])));
        }
    }

    /// Inverts the diagonal where pixels are free.
    #[inline(always)]
    fn precondition(&mut self, free: &[f32]) {
        let mut plane = std::mem::take(&mut self.steps.inverse);
        let inner = &mut plane[self.margin()..][..free.len()];
        self.diagonal(inner);
        for (inverse, free) in inner.iter_mut().zip(free) {
            *inverse = if *inverse > 0.0 { *free / *inverse } else { 0.0 };
        }
        self.steps.inverse = plane;
    }

    /// Takes steps from the pixels that are there. Returns how many, and the residual over what it was at first.
    #[inline(always)]
    fn minimise(&mut self, values: &mut [f32], most: usize, tolerance: f64) -> (usize, f64) {
        let (margin, n) = (self.margin(), self.length());
        self.steps.pixels[margin..][..values.len()].copy_from_slice(values);
        self.steps.direction[margin..][..values.len()].copy_from_slice(values);
        self.apply();
        let first = self.steps.start(margin, n);
        let (mut rest, mut step) = (first, 0);
        while step < most && rest > tolerance * tolerance * first {
            self.apply();
            let Some(now) = self.steps.advance(rest, margin, n) else { break };
            rest = now;
            step += 1;
        }
        values.copy_from_slice(&self.steps.pixels[margin..][..values.len()]);
        (step, if first > 0.0 { (rest / first).sqrt() } else { 0.0 })
    }

    /// Half of the energy's gradient at the direction: the image.
    #[inline(always)]
    pub(super) fn apply(&mut self) {
        let (size, w, margin, n) = ((self.height, self.width), self.width, self.margin(), self.length());
        let Steps { direction: u, image, .. } = &mut self.steps;
        let Pulls { xx, yy, share, mixed } = &mut self.pulls;
        let (own, beyond) = ([margin], margin + w);
        let [mid, right, below, across] = slices(u, [margin, margin + 1, beyond, beyond + 1], n);
        for (i, mixed) in mixed[margin..][..n].iter_mut().enumerate() {
            *mixed = (across[i] - below[i]) - (right[i] - mid[i]);
        }
        clear_ends(&mut mixed[margin..][..n], size);
        let [left, up] = slices(u, [margin - 1, margin - w], n);
        let [[p], [r], [half], [square], [twist]] =
            [&self.p, &self.r, &self.half, &self.square, &self.twist].map(|plane| slices(plane, own, n));
        let [a, b, c, d] = slices(mixed, [margin - w - 1, margin - w, margin - 1, margin], n);
        let [to_xx, to_yy, to_share] =
            [&mut *xx, &mut *yy, &mut *share].map(|plane| &mut plane[margin..][..n]);
        for i in 0..n {
            let dxx = (left[i] - mid[i]) + (right[i] - mid[i]);
            let dyy = (up[i] - mid[i]) + (below[i] - mid[i]);
            let cells = half[i] * ((a[i] + b[i]) + (c[i] + d[i]));
            let (px, ry) = (p[i] * dxx, r[i] * dyy);
            to_xx[i] = p[i] * (px + cells) + square[i] * dyy;
            to_yy[i] = r[i] * (ry + cells) + square[i] * dxx;
            to_share[i] = half[i] * (px + ry);
        }
        let [a, b, c, d] = slices(share, [margin, margin + 1, beyond, beyond + 1], n);
        for (i, mixed) in mixed[margin..][..n].iter_mut().enumerate() {
            *mixed = (a[i] + b[i]) + (c[i] + d[i]) + twist[i] * *mixed;
        }
        clear_ends(&mut mixed[margin..][..n], size);
        let [left, mid, right] = slices(xx, [margin - 1, margin, margin + 1], n);
        let [up, centre, down] = slices(yy, [margin - w, margin, beyond], n);
        let [a, b, c, d] = slices(mixed, [margin - w - 1, margin - w, margin - 1, margin], n);
        for (i, out) in image[margin..][..n].iter_mut().enumerate() {
            let along = (left[i] - mid[i]) + (right[i] - mid[i]);
            let across = (up[i] - centre[i]) + (down[i] - centre[i]);
            *out = (along + across) + ((a[i] - b[i]) + (d[i] - c[i]));
        }
    }

    /// The operator of some matrices on some values, and its diagonal.
    #[cfg(test)]
    pub(super) fn applied(&mut self, values: &[f32]) -> [Vec<f32>; 2] {
        let margin = self.margin();
        self.steps.direction[margin..][..values.len()].copy_from_slice(values);
        self.apply();
        let mut diagonal = vec![0.0; values.len()];
        self.diagonal(&mut diagonal);
        [self.steps.image[margin..][..values.len()].to_vec(), diagonal]
    }
}

impl Steps {
    /// The first residual and direction, from the image of the pixels. Returns the residual's square, preconditioned.
    #[inline(always)]
    fn start(&mut self, margin: usize, n: usize) -> f64 {
        let [image, inverse] = [&self.image, &self.inverse].map(|plane| &plane[margin..][..n]);
        let [residual, direction] =
            [&mut self.residual, &mut self.direction].map(|plane| &mut plane[margin..][..n]);
        for (((r, d), o), m) in residual.iter_mut().zip(&mut *direction).zip(image).zip(inverse) {
            *r = -o;
            *d = *r * m;
        }
        dot(residual, direction)
    }

    /// A step along the direction, and the next direction. `rest` is the residual's square, preconditioned; returns what is left of it,
    /// or nothing where no step can be taken.
    #[inline(always)]
    fn advance(&mut self, rest: f64, margin: usize, n: usize) -> Option<f64> {
        let inverse = &self.inverse[margin..][..n];
        let [pixels, residual, direction, image] =
            [&mut self.pixels, &mut self.residual, &mut self.direction, &mut self.image]
                .map(|plane| &mut plane[margin..][..n]);
        let length = rest / dot(direction, image);
        if !length.is_finite() {
            return None;
        }
        let alpha = length as f32;
        for ((x, r), (d, o)) in pixels.iter_mut().zip(&mut *residual).zip(direction.iter().zip(&*image)) {
            *x += alpha * d;
            *r -= alpha * o;
        }
        // The image is not needed any more: what the preconditioner makes of the residual takes its place.
        for ((z, r), m) in image.iter_mut().zip(&*residual).zip(inverse) {
            *z = r * m;
        }
        let now = dot(residual, image);
        let beta = (now / rest) as f32;
        for (d, z) in direction.iter_mut().zip(&*image) {
            *d = z + beta * *d;
        }
        Some(now)
    }
}

/// Clears the last column and what follows the row before the last.
#[inline(always)]
fn clear_ends(cells: &mut [f32], (h, w): (usize, usize)) {
    cells[(h - 1) * w..].fill(0.0);
    cells[..(h - 1) * w].chunks_exact_mut(w).for_each(|row| row[w - 1] = 0.0);
}

/// A sum of products.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut all = 0.0;
    for (a, b) in a.chunks(RUN).zip(b.chunks(RUN)) {
        let mut sums = [0.0_f32; LANES];
        for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
            for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
                *sum += a * b;
            }
        }
        all += f64::from(sums.iter().sum::<f32>());
    }
    all
}
