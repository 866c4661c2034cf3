//! Atoms that are of no use give way to the blocks that are represented worst.

use std::collections::VecDeque;

use super::Work;
use crate::dictionary::pursuit::Shared;
use crate::kernel::dense::add_multiple;

/// Two atoms whose absolute product is above this are one too many.
const DUPLICATE: f32 = 0.99;

impl Work<'_> {
    /// Replaces atoms without users and near-duplicates; `shared` has the products of the atoms as they are.
    pub(super) fn replace(&mut self, shared: &Shared) {
        let mut users = self.users();
        let errors = self.squared_errors();
        let mut worst: Vec<usize> = (0..errors.len()).filter(|at| errors[*at] > 0.0).collect();
        worst.sort_by(|a, b| errors[*b].total_cmp(&errors[*a]).then(a.cmp(b)));
        let mut worst = VecDeque::from(worst);
        let mut replaced = vec![false; users.len()];
        for atom in 0..users.len() {
            let twin = if users[atom].is_empty() { None } else { twin(atom, shared, &users, &replaced) };
            if !users[atom].is_empty() && twin.is_none() {
                continue;
            }
            // A block whose code changes below is not taken, so that its gain is what it seems.
            let busy = |block: &usize| users[atom].iter().any(|user| user.0 as usize == *block);
            let Some(place) = worst.iter().position(|block| !busy(block)) else { continue };
            let block = worst[place];
            if let Some(twin) = twin {
                // What was handed over before may have changed the block's error.
                let gain = super::squared(&self.residuals[block * self.dimension..][..self.dimension]);
                if !self.hand_over(atom, twin, &users[atom], shared, gain) {
                    continue;
                }
                let moved = std::mem::take(&mut users[atom]);
                users[twin].extend(moved);
            }
            worst.remove(place);
            self.become_block(atom, block);
            for users in &mut users {
                users.retain(|user| user.0 as usize != block);
            }
            users[atom].push((block as u32, 0));
            replaced[atom] = true;
        }
    }

    /// Moves an atom's factors to its twin if that costs no more than `gain`; the places in the codes of `users` may be stale.
    fn hand_over(
        &mut self,
        atom: usize,
        twin: usize,
        users: &[(u32, u32)],
        shared: &Shared,
        gain: f64,
    ) -> bool {
        let n = self.dimension;
        let along = shared.gram()[(atom, twin)];
        let (Some(own), Some(other)) = (self.atoms.row(atom).to_slice(), self.atoms.row(twin).to_slice())
        else {
            return false;
        };
        let mut cost = 0.0;
        let mut changes = Vec::new();
        for &(block, _) in users {
            let block = block as usize;
            let Some(place) = self.codes[block].iter().position(|entry| entry.0 as usize == atom) else {
                continue;
            };
            let factor = self.codes[block][place].1;
            let mut residual = self.residuals[block * n..][..n].to_vec();
            let before = super::squared(&residual);
            add_multiple(factor, own, &mut residual);
            add_multiple(-factor * along, other, &mut residual);
            cost += super::squared(&residual) - before;
            changes.push((block, place, factor * along, residual));
        }
        if cost > gain {
            return false;
        }
        for (block, place, factor, residual) in changes {
            self.residuals[block * n..][..n].copy_from_slice(&residual);
            let code = &mut self.codes[block];
            code.remove(place);
            match code.iter_mut().find(|entry| entry.0 as usize == twin) {
                Some(entry) => entry.1 += factor,
                None => code.push((twin as u32, factor)),
            }
        }
        true
    }

    /// Makes a block an atom, and the atom its code.
    fn become_block(&mut self, atom: usize, block: usize) {
        let n = self.dimension;
        let values = &self.blocks[block * n..][..n];
        let length = super::squared(values).sqrt();
        self.atoms
            .row_mut(atom)
            .iter_mut()
            .zip(values)
            .for_each(|(to, x)| *to = (f64::from(*x) / length) as f32);
        self.codes[block] = vec![(atom as u32, length as f32)];
        super::residual(values, &self.atoms, &self.codes[block], &mut self.residuals[block * n..][..n]);
    }
}

/// An atom that is nearly the same and used at least as much.
fn twin(atom: usize, shared: &Shared, users: &[Vec<(u32, u32)>], replaced: &[bool]) -> Option<usize> {
    let row = shared.gram().row(atom);
    let alike = |(other, product): (usize, &f32)| {
        let more = (users[other].len(), atom) >= (users[atom].len(), other);
        (other != atom && product.abs() > DUPLICATE && more && !replaced[other]).then_some(other)
    };
    row.iter().enumerate().find_map(alike)
}
