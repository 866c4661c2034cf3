//! Whether channels hold something at the missing pixels: nobody writes it down, so it is told from the values.
//!
//! A renderer that skips a pixel leaves the same there for all: zero, NaN, or what its buffer was cleared to. A group of channels is complete if
//! the missing pixels hold at least two different values, and are blank (all channels zero, or one of them NaN) no more often than the measured
//! ones, give or take 2 %. A background of zeros is behind both; where pixels were chosen for what they show, it is behind more of the
//! missing ones, so those between two neighbours in a row of measured pixels that hold something may show it as well.

use lacuna_core::parallel::prelude::*;

use crate::{Mask, Plane};

/// What the share of blank pixels may be higher.
const MARGIN: f64 = 0.02;
/// Pixels that one task takes.
const PIECE: usize = 1 << 14;

/// Channels of one image that belong together.
pub trait Group: Sync {
    /// Whether a pixel holds nothing: all are zero, or one is NaN.
    fn is_blank(&self, at: usize) -> bool;
    /// Whether two pixels hold the same.
    fn are_same(&self, one: usize, other: usize) -> bool;
}

impl Group for [&Plane] {
    fn is_blank(&self, at: usize) -> bool {
        let value = |plane: &&Plane| plane.pixels()[at];
        self.iter().map(value).all(|value| value == 0.0) || self.iter().map(value).any(f32::is_nan)
    }

    fn are_same(&self, one: usize, other: usize) -> bool {
        self.iter().all(|plane| plane.pixels()[one].to_bits() == plane.pixels()[other].to_bits())
    }
}

/// Whether a group holds something at the pixels that a mask of its size calls missing.
pub fn is_complete<G: Group + ?Sized>(group: &G, mask: &Mask) -> bool {
    if mask.is_full() {
        return true;
    }
    let pieces = mask.as_slice().par_chunks(PIECE).enumerate();
    let pieces = pieces.map(|(piece, flags)| Seen::new(group, flags, piece * PIECE));
    let seen = pieces.into_iter().fold(Seen::default(), |seen, next| seen.and(&next, group));
    let blank = seen.shares[0].blank;
    // One value everywhere, measured pixels included, is complete, if idle.
    let idle = |first: usize| (0..mask.as_slice().len()).all(|at| group.are_same(first, at));
    let varies = seen.differs || seen.first.is_some_and(|first| blank > 0 || idle(first));
    varies && (no_more_often(seen.shares) || no_more_often(between(group, mask)))
}

/// Whether one channel of a complete group was left out: all missing pixels hold the same, and measured ones beside them something else.
pub fn is_left_out<G: Group + ?Sized>(channel: &G, mask: &Mask) -> bool {
    let (flags, width) = (mask.as_slice(), mask.size().width.max(1));
    let Some(first) = flags.iter().position(|flag| !flag) else { return false };
    let none = channel.is_blank(first);
    let same = |at: usize| (none && channel.is_blank(at)) || channel.are_same(first, at);
    if (first..flags.len()).any(|at| !flags[at] && !same(at)) {
        return false;
    }
    let missing = |at: usize| flags.get(at).is_some_and(|flag| !flag);
    let beside = |at: usize| {
        let (left, right) =
            (!at.is_multiple_of(width) && missing(at - 1), at % width + 1 < width && missing(at + 1));
        left || right || missing(at + width) || (at >= width && missing(at - width))
    };
    let mut others = Share::default();
    let measured = (0..flags.len()).filter(|&at| flags[at] && beside(at));
    measured.for_each(|at| others.add(!same(at)));
    others.blank as f64 > MARGIN * others.all as f64
}

/// Blank pixels among some.
#[derive(Clone, Copy, Default)]
struct Share {
    blank: usize,
    all: usize,
}

impl Share {
    fn add(&mut self, is_blank: bool) {
        self.blank += usize::from(is_blank);
        self.all += 1;
    }

    fn and(self, other: Self) -> Self {
        Self { blank: self.blank + other.blank, all: self.all + other.all }
    }
}

/// Whether missing pixels, of which there are some, are blank no more often than measured ones.
fn no_more_often([missing, measured]: [Share; 2]) -> bool {
    let part = |share: Share| share.blank as f64 / share.all.max(1) as f64;
    missing.all > 0 && part(missing) <= part(measured) + MARGIN
}

/// What some pixels hold.
#[derive(Default)]
struct Seen {
    /// Of the missing and of the measured ones.
    shares: [Share; 2],
    /// The first missing pixel that is not blank, and whether another one holds something else.
    first: Option<usize>,
    differs: bool,
}

impl Seen {
    fn new<G: Group + ?Sized>(group: &G, flags: &[bool], start: usize) -> Self {
        let mut seen = Self::default();
        for (at, &measured) in (start..).zip(flags) {
            let blank = group.is_blank(at);
            seen.shares[usize::from(measured)].add(blank);
            if !blank && !measured && !seen.differs {
                seen.differs = !group.are_same(*seen.first.get_or_insert(at), at);
            }
        }
        seen
    }

    /// With what the next pixels hold.
    fn and<G: Group + ?Sized>(self, next: &Self, group: &G) -> Self {
        let apart = self.first.zip(next.first).is_some_and(|(one, other)| !group.are_same(one, other));
        Self {
            shares: [0, 1].map(|side| self.shares[side].and(next.shares[side])),
            first: self.first.or(next.first),
            differs: self.differs || next.differs || apart,
        }
    }
}

/// The missing pixels between two neighbours in a row of measured ones that hold something, and the measured ones between two such.
fn between<G: Group + ?Sized>(group: &G, mask: &Mask) -> [Share; 2] {
    let mut shares = [Share::default(); 2];
    let width = mask.size().width.max(1);
    for (row, flags) in mask.as_slice().chunks(width).enumerate() {
        let measured = (row * width..).zip(flags).filter(|(_, flag)| **flag);
        let measured: Vec<(usize, bool)> = measured.map(|(at, _)| (at, group.is_blank(at))).collect();
        for pair in measured.windows(2).filter(|pair| !pair[0].1 && !pair[1].1) {
            (pair[0].0 + 1..pair[1].0).for_each(|at| shares[0].add(group.is_blank(at)));
        }
        for three in measured.windows(3).filter(|three| !three[0].1 && !three[2].1) {
            shares[1].add(three[1].1);
        }
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Size;

    const SIZE: Size = Size { height: 64, width: 80 };

    /// A disk of slopes over a background of zeros.
    fn disk() -> Vec<Plane> {
        let slope = |y: usize, x: usize, part: f32| {
            let (v, u) = (y as f32 - 31.5, x as f32 - 39.5);
            if u * u + v * v < 500.0 { part * u + (1.0 - part) * v } else { 0.0 }
        };
        [0.2, 0.7].map(|part| Plane::from_fn(SIZE, |y, x| slope(y, x, part))).into()
    }

    fn scattered(share: usize) -> Mask {
        Mask::from_fn(SIZE, |y, x| (y * 7919 + x * 104_729 + y * x * 31) % 100 < share)
    }

    /// Most pixels of the disk and few of the background.
    fn chosen() -> Mask {
        let (dense, few, disk) = (scattered(50), scattered(3), disk());
        let flags = (0..SIZE.pixels()).map(|at| {
            let mask = if disk[0].pixels()[at] == 0.0 { &few } else { &dense };
            mask.as_slice()[at]
        });
        Mask::of(SIZE, flags.collect())
    }

    fn complete(planes: &[Plane], mask: &Mask) -> bool {
        is_complete(planes.iter().collect::<Vec<_>>().as_slice(), mask)
    }

    /// What a renderer leaves of it that writes `clear` at missing pixels.
    fn sparse(clear: f32, mask: &Mask) -> Vec<Plane> {
        let mut planes = disk();
        for plane in &mut planes {
            let pixels = plane.pixels_mut().iter_mut().zip(mask.as_slice());
            pixels.filter(|(_, flag)| !**flag).for_each(|(value, _)| *value = clear);
        }
        planes
    }

    #[test]
    fn values_tell_wherever_pixels_were_measured() {
        for mask in [scattered(5), scattered(30), scattered(70), chosen()] {
            assert!(complete(&disk(), &mask), "{}", mask.count());
            for clear in [0.0, -0.0, 1.0, f32::NAN] {
                assert!(!complete(&sparse(clear, &mask), &mask), "{clear} {}", mask.count());
            }
        }
        let full = Mask::from_fn(SIZE, |_, _| true);
        assert!(complete(&sparse(0.0, &scattered(30)), &full));
    }

    #[test]
    fn a_hole_beside_measured_pixels_is_sparse() {
        for mask in [scattered(30), chosen()] {
            let mut planes = disk();
            let hole = (0..SIZE.pixels()).filter(|at| !mask.as_slice()[*at] && at % SIZE.width < 40);
            for at in hole {
                for plane in &mut planes {
                    plane.pixels_mut()[at] = 0.0;
                }
            }
            assert!(!complete(&planes, &mask));
        }
    }

    #[test]
    fn a_channel_is_left_out_where_its_group_is_not() {
        let slice = |plane: &Plane, mask: &Mask| is_left_out([plane].as_slice(), mask);
        for mask in [scattered(5), scattered(30), scattered(70), chosen()] {
            assert!(!slice(&disk()[0], &mask));
            assert!(!slice(&Plane::filled(SIZE, 0.0), &mask) && !slice(&Plane::filled(SIZE, 0.5), &mask));
            for clear in [0.0, 1.0, f32::NAN] {
                assert!(slice(&sparse(clear, &mask)[0], &mask), "{clear} {}", mask.count());
            }
        }
        // A lost bucket in a floor.
        let bucket = Mask::from_fn(SIZE, |y, x| !(8..24).contains(&y) || x < 8);
        let floor = Plane::from_fn(SIZE, |y, _| if y < 40 { 0.0 } else { y as f32 });
        assert!(!slice(&floor, &bucket));
    }

    #[test]
    fn one_value_is_complete_only_if_measured_pixels_hold_it_too() {
        let mask = scattered(30);
        assert!(complete(&[Plane::filled(SIZE, 0.5)], &mask));
        assert!(!complete(&[Plane::filled(SIZE, 0.0)], &mask));
        let measured = Plane::from_fn(SIZE, |y, x| if mask.row(y)[x] { 0.25 } else { 0.5 });
        assert!(!complete(&[measured], &mask));
    }
}
