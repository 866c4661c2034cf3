//! Values that settings can have: each is read from a word and shown as one.

/// One of the words that a setting takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// The word.
    pub name: &'static str,
    /// What it means, in a line.
    pub help: &'static str,
}

/// The place of a setting's value.
pub trait Field {
    /// The value as it stands in a line of settings.
    fn show(&self) -> String;

    /// Takes the value that a text has; whether it has one. Ranges are [`super::Range`]'s to check.
    fn read(&mut self, text: &str) -> bool;
}

/// Fields that are shown and parsed as Rust does it.
macro_rules! plain {
    ($($type:ty),+) => {
        $(impl $crate::descriptor::Field for $type {
            fn show(&self) -> String {
                self.to_string()
            }

            fn read(&mut self, text: &str) -> bool {
                text.parse().is_ok_and(|value| {
                    *self = value;
                    true
                })
            }
        })+
    };
}

pub(crate) use plain;

plain!(f64, usize, bool, String);

/// Pixels from block to block: half a block if no number is given.
impl Field for Option<usize> {
    fn show(&self) -> String {
        self.map_or_else(|| "half".into(), |pixels| pixels.to_string())
    }

    fn read(&mut self, text: &str) -> bool {
        *self = text.parse().ok();
        self.is_some() || text == "half"
    }
}

/// Makes an enum a field: each variant with its word and what it means.
macro_rules! words {
    ($type:ident { $($variant:ident: $name:literal, $help:literal;)+ }) => {
        impl $type {
            /// The words that settings have for it.
            pub const CHOICES: &'static [$crate::descriptor::Choice] =
                &[$($crate::descriptor::Choice { name: $name, help: $help }),+];
        }

        impl $crate::descriptor::Field for $type {
            fn show(&self) -> String {
                match self { $(Self::$variant => $name.into(),)+ }
            }

            fn read(&mut self, text: &str) -> bool {
                *self = match text { $($name => Self::$variant,)+ _ => return false };
                true
            }
        }
    };
}
pub(crate) use words;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensing::wavelet::Wavelet;
    use crate::solver::Solver;

    #[test]
    fn what_is_shown_is_read() {
        let mut values: [(Box<dyn Field>, &str, &str); 7] = [
            (Box::new(0.5), "1e-3", "0.001"),
            (Box::new(7_usize), "12", "12"),
            (Box::new(false), "true", "true"),
            (Box::new(None::<usize>), "8", "8"),
            (Box::new(Some(8_usize)), "half", "half"),
            (Box::new(Wavelet::Daubechies(4)), "sym5", "sym5"),
            (Box::new(Solver::Nesta), "primal-dual", "primal-dual"),
        ];
        for (field, text, shown) in &mut values {
            assert!(field.read(text), "{text}");
            assert_eq!(field.show(), *shown);
            let again = field.show();
            assert!(field.read(&again) && field.show() == again);
            assert!(!field.read("no such value"), "{text}");
        }
    }
}
