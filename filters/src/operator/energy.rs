//! The quadratic energy of an image: a short sum of products of banded matrices, rows times columns.
//!
//! With `K_k` the one-dimensional energies of [`super::profile`] (`v` along columns, `h` along rows), order `m`:
//!
//! ```text
//! H = sum over t = 0 .. m of  binomial(m, t) K_t^v (x) K_{m-t}^h   +   tension (K_0^v (x) K_1^h + K_1^v (x) K_0^h)
//! ```
//!
//! which for m = 2 is equation 3.16 of the thesis, `|f_yy|^2 + 2 |f_xy|^2 + |f_xx|^2`, and for m = 3 the same with third
//! derivatives. Grouped by `K_t^v` it has `m + 1` terms. `H` is symmetric, positive semi-definite, and maps the
//! polynomials of total degree below `m` (with tension: the constants) to zero, at the borders too.
//! On a grid of spacing `s` a factor `K_k` is scaled by `s^(1-2k)`, each axis by its own spacing.

use super::profile::{Kernel, Profile};
use crate::Size;
use crate::kernel::stencil::Separable;
use crate::kernel::window::{Axis, WIDTH};

/// What an energy is made of, apart from the size of the image.
#[derive(Clone, Copy, Debug)]
pub struct Form {
    /// Which function passes through the samples.
    pub kernel: Kernel,
    /// Order of the derivatives, 2 or 3.
    pub order: usize,
    /// Share of first derivatives.
    pub tension: f64,
}

impl Form {
    /// An energy of any size.
    pub const fn new(kernel: Kernel, order: usize, tension: f64) -> Self {
        Self { kernel, order, tension }
    }

    /// By how much tension makes an energy larger than without.
    pub const fn stretch(&self) -> f64 {
        self.tension.max(1.0)
    }

    /// The energy of an image of this size whose pixels are `spacing` (vertical, horizontal) apart.
    pub fn energy(&self, size: Size, spacing: (f64, f64)) -> Separable<f64> {
        let [tall, wide] = [size.height, size.width].map(|len| Profile::new(self.kernel, self.order, len));
        let scale = |s: f64, k: usize| s.powi(1 - 2 * k as i32);
        let order = self.order;
        let vertical = Axis::new(tall.len, tall.ends, |t, class| {
            if t > order { [0.0; WIDTH] } else { tall.rows[t][class].map(|x| x * scale(spacing.0, t)) }
        });
        let horizontal = Axis::new(wide.len, wide.ends, |t, class| {
            let mut row = [0.0; WIDTH];
            let mut add = |k: usize, weight: f64| {
                for (sum, x) in row.iter_mut().zip(wide.rows[k][class]) {
                    *sum += weight * scale(spacing.1, k) * x;
                }
            };
            if t <= order {
                add(order - t, [1.0, order as f64, order as f64, 1.0][if t == order { 3 } else { t }]);
            }
            if t <= 1 {
                add(1 - t, self.tension);
            }
            row
        });
        Separable::new(vertical, horizontal, order + 1)
    }
}
