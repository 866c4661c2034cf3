//! What is asked of `dictionary` and `dct`, and what is to be known of them.

use std::sync::Arc;

use super::super::Dictionary;
use crate::Error;
use crate::descriptor::{Configured, Descriptor, Field, Memory, Range, Setting, Takes};

/// How a dictionary is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Use {
    /// Atoms of a block at most.
    pub sparsity: usize,
    /// The root of the mean squared error of a block's measured values that is good enough; 0 takes all atoms.
    pub error: f64,
    /// Pixels from block to block; half a block if `None`.
    pub stride: Option<usize>,
    /// Whether measured pixels leave as approximated.
    pub restore: bool,
}

impl Default for Use {
    fn default() -> Self {
        Self { sparsity: 30, error: 0.0, stride: None, restore: false }
    }
}

const SPARSITY: Setting = Setting {
    name: "sparsity",
    flag: "dict-sparsity",
    value: "L",
    range: Range::Count(1, usize::MAX),
    help: "atoms of a block at most, 1 or more, and never more than a third of its measured values; larger follows the samples \
           closer",
    ..Setting::PLAIN
};

const ERROR: Setting = Setting {
    name: "error",
    flag: "dict-error",
    value: "ERROR",
    range: Range::NotNegative,
    help: "root mean squared error of a block's measured values at which no more atoms are taken, 0 or more; larger is smoother",
    ..Setting::PLAIN
};

const STRIDE: Setting = Setting {
    name: "stride",
    flag: "dict-stride",
    value: "N",
    range: Range::CountOr(1, "half"),
    help: "pixels from block to block, 1 to the block; smaller is better and slower, the block itself is what the thesis has; \
           half is half a block",
    ..Setting::PLAIN
};

const RESTORE: Setting = Setting {
    name: "restore",
    flag: "dict-restore",
    range: Range::Switch,
    help: "measured pixels leave as approximated, too, instead of as they came; also where none is missing",
    smooths: true,
    ..Setting::PLAIN
};

impl Use {
    /// The stride is within a block of so many pixels.
    pub(super) fn check(&self, block: usize) -> Result<(), Error> {
        match self.stride.filter(|stride| !(1..=block).contains(stride)) {
            Some(stride) => {
                let range = format!("1 to the block of {block} pixels").into();
                Err(Error::Setting { name: "stride", value: stride.to_string(), range })
            }
            None => Ok(()),
        }
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        Some(match name {
            "sparsity" => &mut self.sparsity,
            "error" => &mut self.error,
            "stride" => &mut self.stride,
            "restore" => &mut self.restore,
            _ => return None,
        })
    }
}

/// What is asked of the filter `dictionary`; see the module.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Learned {
    /// The dictionary, without which nothing can be planned.
    pub dictionary: Option<Arc<Dictionary>>,
    /// What tells it from others, for the settings line.
    pub name: String,
    /// How it is used.
    pub how: Use,
}

/// What is to be known of the filter `dictionary`.
pub static LEARNED: Descriptor = Descriptor {
    name: "dictionary",
    help: "Few atoms of a learned dictionary a block (--dictionary FILE, see lacuna dictionary train)",
    settings: &[
        Setting {
            name: "dictionary",
            flag: "dictionary",
            value: "FILE",
            range: Range::Dictionary,
            help: "the file that lacuna dictionary train made",
            ..Setting::PLAIN
        },
        SPARSITY,
        ERROR,
        STRIDE,
        RESTORE,
    ],
    even: Memory { image: 48, channel: 16 },
    uneven: Memory { image: 48, channel: 16 },
    takes: Takes { dictionary: true, ..Takes::NOTHING },
    restores: true,
    held_out: None,
    new: || Box::new(Learned::default()),
};

impl Configured for Learned {
    fn descriptor(&self) -> &'static Descriptor {
        &LEARNED
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        if name == "dictionary" { Some(&mut self.name) } else { self.how.field(name) }
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(self.clone())
    }

    fn check(&self) -> Result<(), Error> {
        self.dictionary.as_ref().map_or(Ok(()), |dictionary| self.how.check(dictionary.block()))
    }

    fn planes(&self) -> Option<usize> {
        self.dictionary.as_ref().map(|dictionary| dictionary.channels()).filter(|&channels| channels > 1)
    }
}

/// What is asked of the filter `dct`; see the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cosines {
    /// Pixels of a block's side.
    pub block: usize,
    /// Atoms, a square number.
    pub atoms: usize,
    /// How they are used.
    pub how: Use,
}

impl Default for Cosines {
    /// As in the thesis: 256 x 1024.
    fn default() -> Self {
        Self { block: 16, atoms: 1024, how: Use::default() }
    }
}

/// What is to be known of the filter `dct`.
pub static COSINES: Descriptor = Descriptor {
    name: "dct",
    help: "Few cosines a block; a baseline",
    settings: &[
        Setting {
            name: "block",
            range: Range::Count(1, 64),
            help: "pixels of a block's side",
            ..Setting::PLAIN
        },
        Setting {
            name: "atoms",
            range: Range::Count(1, 16384),
            help: "atoms, a square number",
            ..Setting::PLAIN
        },
        SPARSITY,
        ERROR,
        STRIDE,
        RESTORE,
    ],
    even: Memory { image: 48, channel: 16 },
    uneven: Memory { image: 48, channel: 16 },
    takes: Takes::NOTHING,
    restores: true,
    held_out: None,
    new: || Box::new(Cosines::default()),
};

impl Configured for Cosines {
    fn descriptor(&self) -> &'static Descriptor {
        &COSINES
    }

    fn field(&mut self, name: &str) -> Option<&mut dyn Field> {
        match name {
            "block" => Some(&mut self.block),
            "atoms" => Some(&mut self.atoms),
            name => self.how.field(name),
        }
    }

    fn check(&self) -> Result<(), Error> {
        self.how.check(self.block)
    }

    fn boxed(&self) -> Box<dyn Configured> {
        Box::new(*self)
    }
}
