//! The images of a group while a frame is compared: for maps, pictures, and the flicker from frame to frame.

use lacuna_exr::Part;
use lacuna_filters::metric::ssim::Similarity;
use lacuna_filters::{Mask, Plane};

use super::model::GroupReport;

/// What a comparison of one group has at hand.
pub struct Images<'a> {
    /// What was found so far: all but the flicker.
    pub report: &'a GroupReport,
    /// Whether the group stands for the frame.
    pub main: bool,
    /// The reference, as it is in the file; one plane a channel.
    pub reference: &'a [Plane],
    /// The test image, as it is in the file.
    pub test: &'a [Plane],
    /// Structural similarity, one map a channel.
    pub similarity: &'a [Similarity],
    /// The distance in CIELUV, if it was wanted.
    pub cieluv: Option<&'a Plane>,
    /// LDR-FLIP, if it was wanted.
    pub flip: Option<&'a Plane>,
    /// Which pixels were measured.
    pub mask: Option<&'a Mask>,
    /// Which pixels of the test image were not.
    pub missing: Option<&'a [bool]>,
    /// The estimated error of each pixel, where the test image has it.
    pub estimate: Option<&'a Plane>,
    /// The reference's part, its data window that of both.
    pub part: &'a Part,
}
