//! Tests of the Poisson disks.

use proptest::prelude::*;

use super::*;

const fn field(height: usize, width: usize) -> Field {
    Field { x: 3, y: -8, size: Size::new(height, width) }
}

/// The least squared distance of two samples.
fn least(mask: &Mask) -> usize {
    let size = mask.size();
    let points: Vec<_> = (0..size.pixels())
        .filter(|&pixel| mask.as_slice()[pixel])
        .map(|pixel| (pixel / size.width, pixel % size.width))
        .collect();
    let mut least = usize::MAX;
    for (index, a) in points.iter().enumerate() {
        for b in &points[..index] {
            least = least.min(a.0.abs_diff(b.0).pow(2) + a.1.abs_diff(b.1).pow(2));
        }
    }
    least
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn counts_are_exact(height in 1_usize..40, width in 1_usize..40, density in 0.0..=1.0_f64, seed in any::<u64>()) {
        let mask = mask(field(height, width), density, seed).unwrap();
        prop_assert_eq!(mask.count(), (density * (height * width) as f64).round() as usize);
    }
}

#[test]
fn samples_keep_the_distance_of_the_density() {
    for (density, expected) in [(0.4, 1), (0.3, 2), (0.2, 2), (0.1, 5), (0.05, 10), (0.01, 64)] {
        let mask = mask(field(90, 101), density, 1).unwrap();
        assert!(least(&mask) >= expected, "{density}: {}", least(&mask));
    }
}

#[test]
fn a_pass_is_maximal_and_keeps_the_distance() {
    let size = Size::new(90, 70);
    let mut set = Set::new(size);
    for squared in [8, 5] {
        set.pass(squared, 9);
        let samples: Vec<usize> = (0..size.pixels()).filter(|&pixel| set.taken[pixel]).collect();
        for pixel in 0..size.pixels() {
            let distance =
                |a: usize| (a / 70).abs_diff(pixel / 70).pow(2) + (a % 70).abs_diff(pixel % 70).pow(2);
            let least = samples.iter().filter(|&&a| a != pixel).map(|&a| distance(a)).min().unwrap();
            assert_eq!(least >= squared as usize, set.taken[pixel], "{pixel}");
        }
    }
}

/// The same sets without slabs, disks and lists: all pixels of a field in one order, every distance to every sample.
struct Slow {
    size: Size,
    taken: Vec<bool>,
}

impl Slow {
    /// The pixels in the order of the darts, round by round over the whole field.
    fn darts(&self, squared: u64, seed: u64) -> Vec<usize> {
        let (tiles, Size { height, width }) = (Tiles::new(self.size, squared, seed), self.size);
        let mut rounds = vec![Vec::new(); 4];
        for tile in 0..tiles.down * tiles.across {
            let (row, column) = (tile / tiles.across, tile % tiles.across);
            let order = Permutation::new((tiles.side * tiles.side) as u64, hash(seed, tile as u64));
            let places = (0..tiles.side * tiles.side).map(|turn| order.apply(turn as u64) as usize);
            let pixels =
                places.map(|at| (row * tiles.side + at / tiles.side, column * tiles.side + at % tiles.side));
            let inside = pixels.filter(|(y, x)| *y < height && *x < width);
            rounds[row % 2 * 2 + column % 2].extend(inside.map(|(y, x)| y * width + x));
        }
        rounds.concat()
    }

    fn nearest(&self, pixel: usize, besides: usize) -> usize {
        let width = self.size.width;
        let distance = |a: usize| {
            (a / width).abs_diff(pixel / width).pow(2) + (a % width).abs_diff(pixel % width).pow(2)
        };
        let others = (0..self.taken.len()).filter(|&other| self.taken[other] && other != besides);
        others.map(distance).min().unwrap_or(usize::MAX)
    }

    fn pass(&mut self, squared: u64, seed: u64) {
        for pixel in self.darts(squared, seed) {
            if self.nearest(pixel, usize::MAX) >= squared as usize {
                self.taken[pixel] = true;
            }
        }
    }

    fn relax(&mut self, squared: u64, seed: u64) {
        let Size { height, width } = self.size;
        for pixel in self.darts(squared, seed) {
            if !self.taken[pixel] {
                continue;
            }
            let (row, column) = (pixel / width, pixel % width);
            let (mut best, mut farthest) = (pixel, self.nearest(pixel, pixel));
            for y in row.saturating_sub(1)..(row + 2).min(height) {
                for x in column.saturating_sub(1)..(column + 2).min(width) {
                    let distance = self.nearest(y * width + x, pixel);
                    if distance > farthest {
                        (best, farthest) = (y * width + x, distance);
                    }
                }
            }
            self.taken[pixel] = false;
            self.taken[best] = true;
        }
    }
}

#[test]
fn slabs_and_disks_make_the_sets_of_the_definition() {
    // Three rows of three tiles of 64 pixels, the last ones cut off; thin fields; and one where few pixels are samples.
    for (height, width, radii) in
        [(150, 139, [25, 20]), (1, 700, [400, 361]), (300, 2, [50, 40]), (130, 120, [900, 800])]
    {
        let size = Size::new(height, width);
        let (mut fast, mut slow) = (Set::new(size), Slow { size, taken: vec![false; size.pixels()] });
        for squared in radii {
            fast.pass(squared, 4);
            slow.pass(squared, 4);
            assert!(fast.taken == slow.taken, "{height}x{width}, pass {squared}");
            let open = (0..size.pixels()).filter(|&pixel| !slow.taken[pixel]);
            let widest = open.map(|pixel| slow.nearest(pixel, usize::MAX)).max().unwrap();
            assert_eq!(fast.widest(), widest as u64, "{height}x{width}, pass {squared}");
        }
        fast.relax(radii[1], 5);
        slow.relax(radii[1], 5);
        assert!(fast.taken == slow.taken, "{height}x{width}, relaxation");
    }
}

#[test]
fn radii_are_sums_of_two_squares() {
    let sums = [1, 2, 4, 5, 8, 9, 10, 13, 16, 17, 18, 20, 25];
    for pair in sums.windows(2) {
        assert_eq!(sum_of_squares_above(pair[0]), pair[1]);
    }
    assert_eq!(sum_of_squares_above(0), 1);
}

/// Each took minutes or gigabytes when darts were thrown beyond the field, or for every radius.
#[test]
fn thin_and_sparse_fields_are_done() {
    for (height, width, wanted) in [
        (1, 20_000, 2),
        (1, 5000, 1),
        (20_000, 1, 40),
        (1, 70_000, 1),
        (3, 40_000, 7),
        (900, 1100, 2),
        (900, 1100, 60),
    ] {
        let density = wanted as f64 / (height * width) as f64;
        let mask = mask(field(height, width), density, 1).unwrap();
        assert_eq!(mask.count(), wanted, "{height}x{width}");
        // Of one row, spread like the plane, half of the mean distance is the least to expect.
        assert!(wanted < 2 || least(&mask).isqrt() > height.max(width) / wanted / 4, "{height}x{width}");
    }
}

#[test]
fn a_field_larger_than_the_probe_is_exact_too() {
    let field = field(700, 1100);
    assert_eq!(mask(field, 0.07, 2).unwrap().count(), 53_900);
}

#[test]
fn seeds_differ_and_repeat() {
    let of = |seed| mask(field(50, 50), 0.2, seed).unwrap();
    assert_eq!(of(1), of(1));
    assert_ne!(of(1), of(2));
}
