//! One atom after another with its factors, the rest of the dictionary held fixed.
//!
//! With `E = R + x d^T` for the residuals `R` of the blocks that use atom `d` with factors `x`, the new pair minimises
//! `|E - x' d'^T|`: `d' = E^T x / |.|`, `x' = E d'`, and so on from there. `E` is not formed: `E d' = R d' + x (d . d')`.

use super::Work;
use crate::kernel::dense::{add_multiple, dot};

/// Power iterations at most.
const MOST: usize = 100;
/// The relative gain of the squared singular value at which they stop.
const TOLERANCE: f64 = 1e-6;

impl Work<'_> {
    /// Updates every atom that is used, in their order.
    pub(super) fn update(&mut self) {
        for (atom, users) in self.users().iter().enumerate() {
            if !users.is_empty() {
                self.update_atom(atom, users);
            }
        }
    }

    fn update_atom(&mut self, atom: usize, users: &[(u32, u32)]) {
        let n = self.dimension;
        let old: Vec<f32> = self.atoms.row(atom).to_vec();
        let before: Vec<f32> =
            users.iter().map(|&(b, place)| self.codes[b as usize][place as usize].1).collect();
        let mut factors = before.clone();
        let mut direction = old.clone();
        let mut value = 0.0;
        for _ in 0..if self.settings.approximate { 1 } else { MOST } {
            let mut next = vec![0.0; n];
            for (&(block, _), factor) in users.iter().zip(&factors) {
                add_multiple(*factor, &self.residuals[block as usize * n..][..n], &mut next);
            }
            add_multiple(dot(&before, &factors), &old, &mut next);
            let length = super::squared(&next).sqrt();
            if length < f64::from(f32::MIN_POSITIVE) || !length.is_finite() {
                return;
            }
            for x in &mut next {
                *x = (f64::from(*x) / length) as f32;
            }
            let along = dot(&old, &next);
            for ((&(block, _), before), factor) in users.iter().zip(&before).zip(&mut factors) {
                *factor = before.mul_add(along, dot(&self.residuals[block as usize * n..][..n], &next));
            }
            direction = next;
            let new = super::squared(&factors);
            if new <= value * (1.0 + TOLERANCE) {
                break;
            }
            value = new;
        }
        for ((&(block, place), before), factor) in users.iter().zip(&before).zip(&factors) {
            let residual = &mut self.residuals[block as usize * n..][..n];
            add_multiple(*before, &old, residual);
            add_multiple(-factor, &direction, residual);
            self.codes[block as usize][place as usize].1 = *factor;
        }
        self.atoms.row_mut(atom).iter_mut().zip(direction).for_each(|(to, from)| *to = from);
    }
}
