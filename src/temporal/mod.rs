//! Frames beside the one that is filled: which they are, and where their samples lie in it.

mod between;
mod blind;
mod camera;
mod carriers;
mod doubt;
mod fit;
mod kept;
mod neighbours;
mod paths;
mod reading;
mod reference;
mod vectors;

pub use between::between;
pub use camera::SCENE;
pub use carriers::{Carrier, Guided, carriers};
pub use fit::shapes;
pub use neighbours::{
    Neighbour, NeighbourFiles, Neighbours, Reading, header, left_filled, left_unread, numbers,
};
pub use reference::Reference;

use std::str::FromStr;

/// The attribute that names the frames that a part was filled along with.
pub const ATTRIBUTE: &str = "lacuna/neighbours";
/// Neighbours on either side that `auto` takes.
const AUTO: usize = 3;
/// Neighbours on either side at most.
const MOST: usize = 16;

/// What `--temporal` and `--motion` say.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Temporal {
    /// The neighbours.
    pub window: Window,
    /// Where motion is known from.
    pub motion: Motion,
}

/// How many neighbours are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Window {
    /// None.
    #[default]
    None,
    /// As many as are worth it.
    Auto,
    /// So many on either side.
    Each(usize),
}

impl Window {
    /// Neighbours on either side.
    pub const fn each(self) -> usize {
        match self {
            Self::None => 0,
            Self::Auto => AUTO,
            Self::Each(count) => count,
        }
    }
}

/// Where motion is known from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Motion {
    /// Vectors of the file where there are any, else depth and cameras, else estimated.
    #[default]
    Auto,
    /// Motion vectors of the file, by whichever convention the samples agree with.
    Vectors,
    /// Depth, worldToCamera and worldToNDC.
    Camera,
    /// Estimated from the frames.
    Flow,
    /// Nothing moves.
    None,
}

/// Why a text is no number of neighbours.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no number of neighbours: write auto, none or 1 to {MOST}")]
pub struct WindowError(String);

impl FromStr for Window {
    type Err = WindowError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "none" | "0" => Ok(Self::None),
            "auto" => Ok(Self::Auto),
            _ => match text.parse() {
                Ok(count) if (1..=MOST).contains(&count) => Ok(Self::Each(count)),
                _ => Err(WindowError(text.into())),
            },
        }
    }
}

impl std::fmt::Display for Window {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::None => f.write_str("none"),
            Self::Auto => f.write_str("auto"),
            Self::Each(count) => count.fmt(f),
        }
    }
}

impl std::fmt::Display for Motion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        use clap::ValueEnum;
        f.write_str(self.to_possible_value().as_ref().map_or("", clap::builder::PossibleValue::get_name))
    }
}
