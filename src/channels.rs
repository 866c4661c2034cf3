//! Which rule each channel gets: colour, scalar, normal, identifier.

/// What happens to a channel's missing pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    /// Reconstructed by the filter.
    Fill,
    /// Reconstructed by the filter, then made unit length with its two siblings.
    Normal,
    /// Only values that a measured neighbour had.
    Depth,
    /// Bits copied from the nearest measured pixel.
    Nearest,
    /// Untouched.
    Keep,
}

/// A rule and why it was chosen, for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// What is done.
    pub rule: Rule,
    /// Why: the option, attribute or name that decided.
    pub why: String,
}
