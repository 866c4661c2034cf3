//! The rows that a band of sweeps works on: its own, and copies of those beyond its edges.

/// Rows of one plane that a band works on: its own, and copies of those beyond its edges.
pub struct Rows<'a> {
    /// Copies of the rows before its own.
    pub above: &'a mut [f32],
    /// Its own.
    pub own: &'a mut [f32],
    /// Copies of the rows after its own.
    pub below: &'a mut [f32],
    /// First row of its own.
    pub first: usize,
    /// Values of a row.
    pub width: usize,
}

impl Rows<'_> {
    /// Row `y` of the image.
    pub fn row(&self, y: usize) -> &[f32] {
        let at = y * self.width;
        let own = self.first * self.width;
        if at < own {
            &self.above[at + self.above.len() - own..][..self.width]
        } else if at < own + self.own.len() {
            &self.own[at - own..][..self.width]
        } else {
            &self.below[at - own - self.own.len()..][..self.width]
        }
    }

    /// The same, to be written.
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        let at = y * self.width;
        let own = self.first * self.width;
        if at < own {
            let above = self.above.len();
            &mut self.above[at + above - own..][..self.width]
        } else if at < own + self.own.len() {
            &mut self.own[at - own..][..self.width]
        } else {
            &mut self.below[at - own - self.own.len()..][..self.width]
        }
    }
    /// Row `y - 1`, to be written, and row `y`.
    pub fn pair(&mut self, y: usize) -> (&mut [f32], &[f32]) {
        let Self { above, own, below, first, width } = self;
        let (start, width) = (*first * *width - above.len(), *width);
        let (a, b) = (above.len(), above.len() + own.len());
        // Offsets among all rows that there are.
        let (before, here) = ((y - 1) * width - start, y * width - start);
        if here < a {
            split(above, here, width)
        } else if here == a {
            (&mut above[before..], &own[..width])
        } else if here < b {
            split(own, here - a, width)
        } else if here == b {
            (&mut own[before - a..], &below[..width])
        } else {
            split(below, here - b, width)
        }
    }
}

/// The row that ends at `at` and the one that begins there.
fn split(part: &mut [f32], at: usize, width: usize) -> (&mut [f32], &[f32]) {
    let (before, rest) = part.split_at_mut(at);
    (&mut before[at - width..], &rest[..width])
}
