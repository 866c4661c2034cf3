//! A rectangle of the image that is solved by conjugate gradients in f64 with a multigrid cycle: holes, sparse masks, and smoothing.

use crate::kernel::Isa;
use crate::kernel::stencil::{Separable, Window, apply};
use crate::operator::energy::Form;
use crate::solver::conjugate::{self, System};
use crate::solver::multigrid::Multigrid;
use crate::{Mask, Outcome, Plane, Run, Size};

/// Multigrid cycles in the numbers that suffice.
enum Grids {
    /// For the well-posed case.
    Single(Multigrid<f32>),
    /// For third order, smoothing, and energies that may leave an image undetermined.
    Double(Multigrid<f64>),
}

/// The rectangle with its grids.
pub struct Region {
    isa: Isa,
    window: Window,
    matrix: Separable<f64>,
    grids: Grids,
    /// Per pixel of the window's buffer: 1 if it is to be computed.
    free: Vec<f64>,
    /// Per pixel the weight of its sample over lambda.
    pull: Option<Vec<f64>>,
}

impl Region {
    /// All of the image.
    pub fn whole(isa: Isa, form: &Form, mask: &Mask, lambda: f64, weights: Option<&Plane>) -> Self {
        let size = mask.size();
        let window = Window { y: 0, x: 0, height: size.height, width: size.width };
        Self::new(isa, form, mask, lambda, weights, window)
    }

    /// A window of the image, around which all pixels keep their values.
    pub fn new(
        isa: Isa,
        form: &Form,
        mask: &Mask,
        lambda: f64,
        weights: Option<&Plane>,
        window: Window,
    ) -> Self {
        let mut free: Vec<f64> = window.zeros();
        let mut pull = (lambda > 0.0).then(|| window.zeros::<f64>());
        for i in 0..window.height {
            let measured = &mask.row(window.y + i)[window.x..][..window.width];
            for (j, &measured) in measured.iter().enumerate() {
                let place = window.at(i, j);
                match &mut pull {
                    Some(pull) => {
                        free[place] = 1.0;
                        let weight = weights.map_or(1.0, |w| f64::from(w.at(window.y + i, window.x + j)));
                        pull[place] = if measured { weight / lambda } else { 0.0 };
                    }
                    None => free[place] = if measured { 0.0 } else { 1.0 },
                }
            }
        }
        let (mut size, mut spacing) = (mask.size(), (1.0, 1.0));
        let mut matrix = |level: usize| {
            if level > 0 {
                let halve = |n: usize, s: f64| if n > 1 { (n.div_ceil(2), 2.0 * s) } else { (n, s) };
                let (tall, wide) = (halve(size.height, spacing.0), halve(size.width, spacing.1));
                size = Size::new(tall.0, wide.0);
                spacing = (tall.1, wide.1);
            }
            form.energy(size, spacing)
        };
        let grids = if form.order == 2 && form.tension > 0.0 && pull.is_none() {
            let free = free.iter().map(|&free| free as f32).collect();
            Grids::Single(Multigrid::new(isa, window, &mut matrix, free, None))
        } else {
            Grids::Double(Multigrid::new(isa, window, &mut matrix, free.clone(), pull.clone()))
        };
        Self { isa, window, matrix: form.energy(mask.size(), (1.0, 1.0)), grids, free, pull }
    }

    /// The rectangle.
    pub fn window(&self) -> Window {
        self.window
    }

    /// Replaces the free pixels of `image` in the window by the solution, to within about `tolerance`.
    pub fn solve(&self, samples: &Plane, image: &mut Plane, tolerance: f64, run: &Run<'_>) -> Outcome {
        let window = self.window;
        let mut r = self.residual(samples, image);
        let mut c = window.zeros();
        let system = System { a: &self.matrix, d: self.pull.as_deref() };
        let ending = match &self.grids {
            Grids::Single(grids) => {
                conjugate::solve(system, grids, &mut grids.workspace(), &mut r, &mut c, tolerance, run)
            }
            Grids::Double(grids) => {
                conjugate::solve(system, grids, &mut grids.workspace(), &mut r, &mut c, tolerance, run)
            }
        };
        for i in 0..window.height {
            let row = &mut image.row_mut(window.y + i)[window.x..][..window.width];
            for (j, value) in row.iter_mut().enumerate() {
                let place = window.at(i, j);
                if self.free[place] != 0.0 {
                    *value = (f64::from(*value) + c[place]) as f32;
                }
            }
        }
        Outcome {
            stop: ending.stop,
            iterations: ending.iterations,
            residual: Some(ending.residual),
            ..Outcome::direct()
        }
    }

    /// `diag(pull) (samples - image) - H image` at free pixels, zero elsewhere. Pixels around the window count.
    fn residual(&self, samples: &Plane, image: &Plane) -> Vec<f64> {
        let (window, reach, size) = (self.window, self.matrix.terms, image.size());
        let (y, x) = (window.y.saturating_sub(reach), window.x.saturating_sub(reach));
        let wide = Window {
            y,
            x,
            height: size.height.min(window.y + window.height + reach) - y,
            width: size.width.min(window.x + window.width + reach) - x,
        };
        let mut values = wide.zeros::<f64>();
        for i in 0..wide.height {
            let row = &image.row(y + i)[x..][..wide.width];
            for (value, &pixel) in values[wide.at(i, 0)..].iter_mut().zip(row) {
                *value = f64::from(pixel);
            }
        }
        let mut product = wide.zeros();
        apply(self.isa, &self.matrix, wide, &values, None, &mut product);
        let mut residual = window.zeros();
        for i in 0..window.height {
            for j in 0..window.width {
                let place = window.at(i, j);
                if self.free[place] == 0.0 {
                    continue;
                }
                residual[place] = -product[wide.at(window.y - y + i, window.x - x + j)];
                if let Some(pull) = self.pull.as_ref().map(|pull| pull[place]).filter(|&pull| pull > 0.0) {
                    let (row, column) = (window.y + i, window.x + j);
                    residual[place] +=
                        pull * (f64::from(samples.at(row, column)) - f64::from(image.at(row, column)));
                }
            }
        }
        residual
    }
}
