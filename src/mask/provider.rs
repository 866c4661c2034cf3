//! A mask over a window of absolute pixels, and which channels it may serve.

use lacuna_exr::Window;
use lacuna_filters::Mask;

use crate::channels::Name;

/// The views that a mask serves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Views {
    /// Every part: a file without views.
    All,
    /// The parts of one view, or those without one.
    Of(Option<String>),
}

/// A mask that was found, and what it is for.
#[derive(Clone, Debug)]
pub struct Provider {
    /// The part that it stands in, if it is the frame's own.
    pub part: Option<usize>,
    /// The views that it serves.
    pub views: Views,
    /// The layer that it is for, with the layers inside; nothing if it is for all.
    pub layer: Option<String>,
    /// The pixels that it covers.
    pub window: Window,
    /// The flags over that window.
    pub mask: Mask,
}

impl Provider {
    /// How well the mask suits a channel: smaller is better, nothing is not at all. A layer's own mask goes first
    /// (the closest layer), then the part's own, then the others of the view.
    pub fn suits(&self, part: usize, view: Option<&str>, name: &str) -> Option<(usize, bool)> {
        let view_fits = match &self.views {
            Views::All => true,
            Views::Of(own) => own.as_deref() == view,
        };
        let elsewhere = self.part != Some(part);
        let distance = match &self.layer {
            None => usize::MAX,
            Some(layer) => {
                let rest = Name::new(name).layer.strip_prefix(layer.as_str())?;
                if !rest.is_empty() && !rest.starts_with('.') {
                    return None;
                }
                rest.len()
            }
        };
        view_fits.then_some((distance, elsewhere))
    }
}
