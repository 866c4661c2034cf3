//! A mask over a window of absolute pixels, and which channels it may serve.

use lacuna_exr::{Part, Window};
use lacuna_filters::Mask;

use crate::channels::{Name, names_view, view_of};

/// The views that a mask serves.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Views {
    /// Every part: a file without views.
    All,
    /// The parts of one view, or those without one.
    Of(Option<String>),
    /// This view, which is the default one, and the other views of the same part that have no mask of their own.
    Default(String),
}

impl Views {
    /// The views of a sampling mask that is the channel `name` of `part`: without a view in either it is for all.
    pub fn of_mask(part: &Part, name: &str) -> Self {
        match view_of(part, name) {
            Some(view) if !names_view(part, name) => Self::Default(view),
            view => Self::Of(view),
        }
    }
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
    /// How well the mask suits a channel: smaller is better, nothing is not at all. A mask of the channel's view goes first, then
    /// that of its layer (the closest layer), then the part's own.
    pub fn suits(&self, part: usize, view: Option<&str>, name: &str) -> Option<(bool, usize, bool)> {
        let elsewhere = self.part != Some(part);
        let (view_fits, borrowed) = match &self.views {
            Views::All => (true, false),
            Views::Of(own) => (own.as_deref() == view, false),
            Views::Default(own) => {
                let same = view == Some(own.as_str());
                (same || self.part.is_none() || !elsewhere, !same)
            }
        };
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
        view_fits.then_some((borrowed, distance, elsewhere))
    }
}
