//! From providers to one mask per channel: by absolute coordinates, every pixel or none.

use std::sync::Arc;

use lacuna_exr::{Frame, Window};
use lacuna_filters::Mask;

use super::Masks;
use super::provider::Provider;
use crate::channels::view_of;

/// What the providers make for one window: the mask, or the first pixel that none covers.
type Cover = Result<Arc<Mask>, Option<(i64, i64)>>;

/// Finds every channel's mask among the providers.
pub fn serve(frame: &Frame, providers: &[Provider]) -> Masks {
    let mut masks = Masks::default();
    let mut known: Vec<Arc<Mask>> = Vec::new();
    for (index, part) in frame.parts.iter().enumerate() {
        let mut covers: Vec<(Vec<usize>, Cover)> = Vec::new();
        let mut channels = Vec::new();
        let mut reasons = Vec::new();
        for channel in &part.channels {
            let name = channel.display_name();
            let order = order(providers, index, view_of(part, &name).as_deref(), &name);
            let at = covers.iter().position(|(other, _)| *other == order).unwrap_or_else(|| {
                let cover = cover(providers, &order, part.data_window).map(|mask| share(&mut known, mask));
                covers.push((order, cover));
                covers.len() - 1
            });
            let (mask, why) = match &covers[at].1 {
                Ok(mask) => (Some(Arc::clone(mask)), None),
                Err(None) => (None, Some("no mask of its view or layer".to_owned())),
                Err(Some((x, y))) => (None, Some(format!("the mask does not cover pixel ({x}, {y})"))),
            };
            channels.push(mask);
            reasons.push(why);
        }
        masks.channels.push(channels);
        masks.why_none.push(reasons);
    }
    masks.mask_channels = vec![Vec::new(); frame.parts.len()];
    masks
}

/// The providers that suit a channel, best first.
fn order(providers: &[Provider], part: usize, view: Option<&str>, name: &str) -> Vec<usize> {
    let mut found: Vec<_> = providers
        .iter()
        .enumerate()
        .filter_map(|(index, provider)| Some((provider.suits(part, view, name)?, index)))
        .collect();
    found.sort_unstable();
    found.into_iter().map(|(_, index)| index).collect()
}

/// Equal masks become one allocation, so that they are planned once.
fn share(known: &mut Vec<Arc<Mask>>, mask: Mask) -> Arc<Mask> {
    if let Some(same) = known.iter().find(|other| ***other == mask) {
        return Arc::clone(same);
    }
    let mask = Arc::new(mask);
    known.push(Arc::clone(&mask));
    mask
}

/// The mask over `window`: each pixel from the first provider in `order` that covers it.
fn cover(providers: &[Provider], order: &[usize], window: Window) -> Result<Mask, Option<(i64, i64)>> {
    let size = window.size();
    if order.is_empty() {
        return Err(None);
    }
    if let Some(first) = order.first().map(|&index| &providers[index])
        && first.window == window
    {
        return Ok(first.mask.clone());
    }
    let mut flags = vec![false; size.pixels()];
    let mut covered = vec![false; size.pixels()];
    let mut left = size.pixels();
    for provider in order.iter().map(|&index| &providers[index]) {
        if left == 0 {
            break;
        }
        let other = provider.window;
        let columns = i64::from(window.x_min.max(other.x_min))..i64::from(window.x_max.min(other.x_max)) + 1;
        let rows = i64::from(window.y_min.max(other.y_min))..i64::from(window.y_max.min(other.y_max)) + 1;
        for y in rows {
            let to = (y - i64::from(window.y_min)) as usize * size.width;
            let from = provider.mask.row((y - i64::from(other.y_min)) as usize);
            for x in columns.clone() {
                let at = to + (x - i64::from(window.x_min)) as usize;
                if !covered[at] {
                    covered[at] = true;
                    left -= 1;
                    flags[at] = from[(x - i64::from(other.x_min)) as usize];
                }
            }
        }
    }
    let pixel = |at: usize| {
        let (y, x) = (at / size.width, at % size.width);
        (i64::from(window.x_min) + x as i64, i64::from(window.y_min) + y as i64)
    };
    match covered.iter().position(|&done| !done) {
        Some(at) => Err(Some(pixel(at))),
        None => Mask::new(size, flags).map_err(|_| None),
    }
}
