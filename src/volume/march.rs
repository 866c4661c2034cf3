//! Direct volume rendering of one ray: front to back, `C += (1 - A) a c`, `A += (1 - A) a`.
//!
//! With pre-integration the segment between two samples has the mean colour and the opacity of the values that a line
//! between theirs goes through, so that thin features of the transfer function are not stepped over.
//!
//! Sources: M. Levoy, "Efficient ray tracing of volume data", ACM TOG 9(3), 1990 (order, early termination); K. Engel,
//! M. Kraus, T. Ertl, "High-quality pre-integrated volume rendering using hardware-accelerated pixel shading", Graphics
//! Hardware 2001.

use super::integral::Integral;
use super::kernel::Kernel;
use super::shade::{MOST_LIGHTS, Shader};
use super::transfer::Table;
use super::walk::Walk;

/// What a ray saw.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Red, green, blue, premultiplied, and alpha.
    pub colour: [f32; 4],
    /// Sum of the normals by their share of alpha.
    pub normal: [f32; 3],
    /// The sample, from the entry, at which there was a surface; negative if there was none.
    pub depth: f32,
}

impl Seen {
    /// Nothing.
    pub const NOTHING: Self = Self { colour: [0.0; 4], normal: [0.0; 3], depth: -1.0 };

    /// Adds a sample behind what was seen; whether it is still not opaque.
    #[inline(always)]
    fn add(&mut self, i: u32, opacity: f32, colour: [f32; 3], normal: [f32; 3], march: &March<'_>) -> bool {
        let share = (1.0 - self.colour[3]) * opacity;
        for k in 0..3 {
            self.colour[k] += share * colour[k];
            self.normal[k] += share * normal[k];
        }
        self.colour[3] += share;
        if self.depth < 0.0 && self.colour[3] >= march.threshold {
            self.depth = i as f32;
        }
        self.colour[3] < march.opaque
    }
}

/// What the march needs besides the walk.
#[derive(Clone, Copy, Debug)]
pub struct March<'a> {
    /// The transfer function.
    pub table: &'a Table,
    /// Its integrals, if segments are pre-integrated.
    pub integral: Option<&'a Integral>,
    /// The shading; none shows plain colours.
    pub shader: Option<&'a Shader>,
    /// The march ends at this opacity.
    pub opaque: f32,
    /// Alpha of the surface that depth tells.
    pub threshold: f32,
}

impl March<'_> {
    /// Marches along a ray of that direction.
    #[inline(always)]
    pub fn ray<K: Kernel>(&self, mut walk: Walk<'_, K>, view: [f32; 3]) -> Seen {
        if let Some(integral) = self.integral {
            return self.segments(integral, walk, view);
        }
        let halfway = self.halfway(view);
        let mut seen = Seen::NOTHING;
        let mut visible = true;
        let mut i = 0;
        while i < walk.count {
            let place = walk.place(i as f32);
            if let Some(next) = walk.leap(i, &place) {
                i = next;
                continue;
            }
            if walk.enter(&place) && walk.skips() {
                let (low, high) = walk.bounds();
                visible = self.table.visible(low, high);
            }
            if visible {
                let (value, partial) = walk.value(&place);
                let [red, green, blue, opacity] = self.table.at(value);
                if opacity > 0.0 {
                    let (mut colour, mut normal) = ([red, green, blue], [0.0; 3]);
                    if let Some(shader) = self.shader {
                        let length;
                        (normal, length) = shader.normal(walk.gradient(&place, &partial));
                        colour = shader.shade(colour, normal, length, &halfway);
                    }
                    if !seen.add(i, opacity, colour, normal, self) {
                        break;
                    }
                }
            }
            i += 1;
        }
        seen
    }

    /// The same with pre-integrated segments: sample `i` stands for the segment from `i - 1`.
    #[inline(always)]
    fn segments<K: Kernel>(&self, integral: &Integral, mut walk: Walk<'_, K>, view: [f32; 3]) -> Seen {
        let halfway = self.halfway(view);
        let mut seen = Seen::NOTHING;
        // The last sample whose value is known, and that value.
        let mut known = (u32::MAX, 0.0);
        let mut i = 0;
        while i < walk.count {
            let place = walk.place(i as f32);
            // The segment from a known sample is finished even if it ends in an empty block.
            if i == 0 || known.0 != i - 1 {
                if let Some(next) = walk.leap(i, &place) {
                    i = next;
                    continue;
                }
                if i > 0 {
                    known = (i - 1, walk.sample((i - 1) as f32).0);
                }
            }
            walk.enter(&place);
            let (value, partial) = walk.value(&place);
            if i > 0 {
                let (mut colour, opacity) = integral.segment(known.1, value);
                if opacity > 0.0 {
                    let mut normal = [0.0; 3];
                    if let Some(shader) = self.shader {
                        let length;
                        (normal, length) = shader.normal(walk.gradient(&place, &partial));
                        colour = shader.shade(colour, normal, length, &halfway);
                    }
                    if !seen.add(i, opacity, colour, normal, self) {
                        break;
                    }
                }
            }
            // An empty block takes up the leaps again.
            known = if walk.leap(i, &place).is_some() { (u32::MAX, 0.0) } else { (i, value) };
            i += 1;
        }
        seen
    }

    #[inline(always)]
    fn halfway(&self, view: [f32; 3]) -> [[f32; 3]; MOST_LIGHTS] {
        match self.shader {
            Some(shader) => shader.halfway(view),
            None => [[0.0; 3]; MOST_LIGHTS],
        }
    }
}
