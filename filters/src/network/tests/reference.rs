//! The correction as it is defined, in f64, over the whole image at once, and read from the weights' file by itself.

use crate::{Mask, Plane};

/// Planes of some height and width.
struct Image {
    h: usize,
    w: usize,
    values: Vec<f64>,
}

impl Image {
    fn from_fn(h: usize, w: usize, f: impl Fn(usize, usize) -> f64) -> Self {
        Self { h, w, values: (0..h * w).map(|i| f(i / w, i % w)).collect() }
    }

    /// The value at a place, or the outermost one nearest to it.
    fn at(&self, y: isize, x: isize) -> f64 {
        let inside = |k: isize, n: usize| k.clamp(0, n as isize - 1) as usize;
        self.values[inside(y, self.h) * self.w + inside(x, self.w)]
    }

    fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Self { h: self.h, w: self.w, values: self.values.iter().map(|x| f(*x)).collect() }
    }

    fn minus(&self, other: &Self) -> Self {
        let values = self.values.iter().zip(&other.values).map(|(a, b)| a - b).collect();
        Self { h: self.h, w: self.w, values }
    }

    fn transposed(&self) -> Self {
        Self::from_fn(self.w, self.h, |y, x| self.values[x * self.w + y])
    }

    /// A Gaussian along rows, then along columns.
    fn blurred(&self, sigma: f64, reach: isize, reflects: bool) -> Self {
        self.blurred_along(sigma, reach, reflects)
            .transposed()
            .blurred_along(sigma, reach, reflects)
            .transposed()
    }

    fn blurred_along(&self, sigma: f64, reach: isize, reflects: bool) -> Self {
        let weight = |d: isize| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp();
        let total: f64 = (-reach..=reach).map(weight).sum();
        Self::from_fn(self.h, self.w, |y, x| {
            let value = |at: isize| {
                let edge = at.clamp(0, self.w as isize - 1);
                let e = self.at(y as isize, edge);
                if at == edge || !reflects { e } else { 2.0 * e - self.at(y as isize, 2 * edge - at) }
            };
            (-reach..=reach).map(|d| weight(d) * value(x as isize + d)).sum::<f64>() / total
        })
    }
}

/// The weights of each layer, by output, input, row and column, and its biases.
fn layers() -> Vec<(Vec<f64>, Vec<f64>)> {
    let bytes = include_bytes!("../weights.f32");
    let mut all = bytes.chunks_exact(4).map(|word| f64::from(f32::from_le_bytes(word.try_into().unwrap())));
    let layers = [(17, 24), (24, 24), (24, 24), (24, 4)]
        .map(|(i, o)| (all.by_ref().take(i * o * 9).collect(), all.by_ref().take(o).collect()));
    assert_eq!(all.count(), 0);
    layers.to_vec()
}

fn convolved(from: &[Image], (weights, bias): &(Vec<f64>, Vec<f64>)) -> Vec<Image> {
    let (h, w) = (from[0].h, from[0].w);
    let one = |o: usize| {
        Image::from_fn(h, w, |y, x| {
            let mut sum = bias[o];
            for (i, from) in from.iter().enumerate() {
                for (dy, dx) in (0..3).flat_map(|dy| (0..3).map(move |dx| (dy, dx))) {
                    let weight = weights[((o * from_count(weights, bias) + i) * 3 + dy) * 3 + dx];
                    sum += weight * from.at((y + dy) as isize - 1, (x + dx) as isize - 1);
                }
            }
            sum
        })
    };
    (0..bias.len()).map(one).collect()
}

fn from_count(weights: &[f64], bias: &[f64]) -> usize {
    weights.len() / (9 * bias.len())
}

/// The corrected image; measured pixels as they were.
pub fn corrected(image: &Plane, mask: &Mask) -> Vec<f64> {
    let size = image.size();
    let (h, w) = (size.height.next_multiple_of(2), size.width.next_multiple_of(2));
    let inside = |y: usize, x: usize| (y.min(size.height - 1), x.min(size.width - 1));
    let u = Image::from_fn(h, w, |y, x| f64::from(image.at(inside(y, x).0, inside(y, x).1)));
    let m =
        Image::from_fn(h, w, |y, x| f64::from(u8::from(mask.is_measured(inside(y, x).0, inside(y, x).1))));
    let near = |y: usize, x: usize| (0..9).map(move |k| (y as isize + k / 3 - 1, x as isize + k % 3 - 1));
    let low = Image::from_fn(h, w, |y, x| near(y, x).map(|(y, x)| u.at(y, x)).fold(f64::INFINITY, f64::min));
    let high =
        Image::from_fn(h, w, |y, x| near(y, x).map(|(y, x)| u.at(y, x)).fold(-f64::INFINITY, f64::max));
    let span = high.minus(&low);
    let detail = u.minus(&u.blurred(1.5, 4, true));
    let finest = detail.minus(&detail.blurred(1.5, 4, false));
    let strength = finest.map(|x| x * x).blurred(1.0, 3, false).map(f64::sqrt);
    let around = detail.map(|x| x * x).blurred(2.5, 6, false).map(|x| x.sqrt() + 1e-18);
    let over = |of: &Image, i: usize| of.values[i] / around.values[i];
    let kinds: [&dyn Fn(usize) -> f64; 4] = [
        &|i| over(&detail, i).clamp(-6.0, 6.0),
        &|i| over(&detail, i).clamp(-6.0, 6.0) * m.values[i],
        &|i| m.values[i] - 0.5,
        &|i| over(&span, i).min(6.0) / 6.0 - 0.5,
    ];
    let pixel = |y: usize, x: usize, k: usize| (2 * y + k / 2) * w + 2 * x + k % 2;
    let mut maps: Vec<Image> = kinds
        .iter()
        .flat_map(|kind| (0..4).map(move |k| Image::from_fn(h / 2, w / 2, |y, x| kind(pixel(y, x, k)))))
        .collect();
    maps.push(Image::from_fn(h / 2, w / 2, |y, x| {
        (0..4).map(|k| over(&strength, pixel(y, x, k))).sum::<f64>() / 4.0
    }));
    let layers = layers();
    for (k, layer) in layers.iter().enumerate() {
        let made = convolved(&maps, layer);
        maps = match k {
            0 => made.iter().map(|map| map.map(|x| x.max(0.0))).collect(),
            3 => made,
            _ => made.iter().zip(&maps).map(|(a, b)| a.minus(&b.map(|x| -x)).map(|x| x.max(0.0))).collect(),
        };
    }
    let value = |y: usize, x: usize| {
        let i = y * w + x;
        let said = maps[2 * (y % 2) + x % 2].values[y / 2 * (w / 2) + x / 2];
        let value = u.values[i] + said * strength.values[i].min(span.values[i]);
        if m.values[i] > 0.0 { u.values[i] } else { value.clamp(low.values[i], high.values[i]) }
    };
    (0..size.pixels()).map(|i| value(i / size.width, i % size.width)).collect()
}
