//! Direct volume rendering of one ray: front to back, `C += (1 - A) a c`, `A += (1 - A) a`.
//!
//! Eight samples are interpolated, classified and shaded side by side, then composited one by one: some behind the end of an
//! opaque ray are computed in vain. Gradients and shading are left out where none of the eight has an opacity.
//!
//! With pre-integration the segment between two samples has the mean colour and the opacity of the values that a line
//! between theirs goes through, so that thin features of the transfer function are not stepped over.
//!
//! Sources: M. Levoy, "Efficient ray tracing of volume data", ACM TOG 9(3), 1990 (order, early termination); K. Engel,
//! M. Kraus, T. Ertl, "High-quality pre-integrated volume rendering using hardware-accelerated pixel shading", Graphics
//! Hardware 2001.

use super::integral::Integral;
use super::kernel::Kernel;
use super::lanes::{LANES, Lanes};
use super::shade::{MOST_LIGHTS, Shader, ToWorld};
use super::transfer::Table;
use super::walk::{Bundle, Walk};

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

/// What the march needs besides the walk.
#[derive(Clone, Copy, Debug)]
pub struct March<'a> {
    /// The transfer function.
    pub table: &'a Table,
    /// Its integrals, if segments are pre-integrated.
    pub integral: Option<&'a Integral>,
    /// The shading; none shows plain colours.
    pub shader: Option<&'a Shader>,
    /// Where normals come from.
    pub to_world: &'a ToWorld,
    /// The march ends at this opacity.
    pub opaque: f32,
    /// Alpha of the surface that depth tells.
    pub threshold: f32,
    /// Whether normals are wanted.
    pub normals: bool,
}

/// What a bundle shows: the share of their colours that samples have, what is white, and normals.
struct Shown {
    share: [f32; LANES],
    white: [f32; LANES],
    normals: [[f32; LANES]; 3],
}

impl Seen {
    /// Nothing.
    pub const NOTHING: Self = Self { colour: [0.0; 4], normal: [0.0; 3], depth: -1.0 };
}

impl March<'_> {
    /// Marches along a ray of that direction.
    #[inline(always)]
    pub fn ray<K: Kernel>(&self, mut walk: Walk<'_, K>, view: [f32; 3]) -> Seen {
        let halfway = self.shader.map_or([[0.0; 3]; MOST_LIGHTS], |shader| shader.halfway(view));
        // A single sample, in a volume one voxel thick say, ends no segment.
        let integral = self.integral.filter(|_| walk.count() > 1);
        let mut seen = Seen::NOTHING;
        // The last sample and its value.
        let mut known = (f32::NAN, 0.0);
        while let Some(bundle) = walk.next() {
            let (values, partial) = walk.values(&bundle);
            let colours = match integral {
                None => self.table.at_all(values, bundle.count),
                Some(integral) => segments(integral, &mut known, &bundle, values),
            };
            let visible = visible(&colours, bundle.count);
            if visible == 0 {
                continue;
            }
            let mut shown = Shown { share: [1.0; LANES], white: [0.0; LANES], normals: [[0.0; LANES]; 3] };
            if self.shader.is_some() || self.normals {
                let (normals, lengths) = self.to_world.normals(walk.gradients(&bundle, &partial, visible));
                if let Some(shader) = self.shader {
                    let (share, white) = shader.shade(normals, lengths, &halfway);
                    (shown.share, shown.white) = (share.to_array(), white.to_array());
                }
                shown.normals = [normals[0].to_array(), normals[1].to_array(), normals[2].to_array()];
            }
            if !self.composite(&mut seen, &bundle, &colours, &shown) {
                break;
            }
        }
        seen
    }

    /// Adds samples behind what was seen; whether it is still not opaque.
    #[inline(always)]
    fn composite(
        &self,
        seen: &mut Seen,
        bundle: &Bundle,
        colours: &[[f32; 4]; LANES],
        shown: &Shown,
    ) -> bool {
        for lane in 0..bundle.count {
            let [red, green, blue, opacity] = colours[lane];
            if opacity <= 0.0 {
                continue;
            }
            let part = (1.0 - seen.colour[3]) * opacity;
            for (k, colour) in [red, green, blue].into_iter().enumerate() {
                seen.colour[k] += part * (shown.share[lane] * colour + shown.white[lane]);
            }
            if self.normals {
                for k in 0..3 {
                    seen.normal[k] += part * shown.normals[k][lane];
                }
            }
            seen.colour[3] += part;
            if seen.depth < 0.0 && seen.colour[3] >= self.threshold {
                seen.depth = bundle.samples[lane];
            }
            if seen.colour[3] >= self.opaque {
                return false;
            }
        }
        true
    }
}

/// A bit for each of the first samples that have an opacity.
#[inline(always)]
pub fn visible(colours: &[[f32; 4]; LANES], count: usize) -> u32 {
    let mut visible = 0;
    for lane in 0..count {
        visible |= u32::from(colours[lane][3] > 0.0) << lane;
    }
    visible
}

/// Colours and opacities of the segments that end in a bundle's samples; nothing where the sample before is not known.
#[inline(always)]
fn segments(
    integral: &Integral,
    known: &mut (f32, f32),
    bundle: &Bundle,
    values: Lanes,
) -> [[f32; 4]; LANES] {
    let mut found = [[0.0; 4]; LANES];
    for (lane, value) in values.to_array().into_iter().enumerate().take(bundle.count) {
        let sample = bundle.samples[lane];
        if known.0 == sample - 1.0 {
            let ([red, green, blue], opacity) = integral.segment(known.1, value);
            found[lane] = [red, green, blue, opacity];
        }
        *known = (sample, value);
    }
    found
}
