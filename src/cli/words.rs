//! Values that are read by their type, and are known by name to completions.

use std::ffi::OsStr;
use std::marker::PhantomData;
use std::str::FromStr;

use clap::builder::{PossibleValue, TypedValueParser};
use clap::{Arg, Command};

/// Reads a `T`; these are the words for it, or examples of them.
#[derive(Clone, Debug)]
pub struct Words<T> {
    words: &'static [&'static str],
    read: PhantomData<fn() -> T>,
}

impl<T> Words<T> {
    /// A parser of values with these words.
    pub const fn new(words: &'static [&'static str]) -> Self {
        Self { words, read: PhantomData }
    }
}

impl<T> TypedValueParser for Words<T>
where
    T: FromStr<Err = String> + Clone + Send + Sync + 'static,
{
    type Value = T;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<T, clap::Error> {
        T::from_str.parse_ref(command, arg, value)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.words.iter().map(PossibleValue::new)))
    }
}
