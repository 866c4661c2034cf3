//! Choices and values from bytes; when they have run out, zeros.

use std::sync::Arc;

use lacuna_filters::dictionary::dct;
use lacuna_filters::dictionary::fill::Learned;
use lacuna_filters::{METHODS, Mask, Method, Plane, Size};

/// Bytes to draw from.
pub struct Draw<'a>(pub &'a [u8]);

impl Draw<'_> {
    pub fn byte(&mut self) -> u8 {
        let Some((&first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        first
    }

    /// A number below `count`.
    pub fn below(&mut self, count: usize) -> usize {
        usize::from(self.byte()) % count
    }

    pub fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    pub fn one_of<T: Clone>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())].clone()
    }

    /// Most often a value as frames have it, now and then one that breaks things.
    pub fn value(&mut self) -> f32 {
        match self.byte() {
            byte @ 0..=199 => f32::from(byte) / 64.0,
            byte @ 200..=219 => -f32::from(byte - 200) / 8.0,
            220 => f32::NAN,
            221 => f32::INFINITY,
            222 => f32::NEG_INFINITY,
            223 => f32::MAX,
            224 => f32::MIN,
            225 => 1e-45,
            226 => 1e30,
            227 => -0.0,
            228..=239 => 1e3 * (1.0 + f32::from(self.byte())),
            _ => f32::from_bits(u32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()])),
        }
    }

    pub fn plane(&mut self, size: Size) -> Plane {
        Plane::from_fn(size, |_, _| self.value())
    }

    /// A mask of about that many of 256 pixels.
    pub fn mask(&mut self, size: Size) -> Mask {
        let share = self.byte();
        let pairs = self.flag();
        let mut last = false;
        Mask::from_fn(size, |_, x| {
            if !(pairs && x % 2 == 1) {
                last = self.byte() <= share;
            }
            last
        })
    }

    /// A method with its defaults, but cheap, and now and then with other settings.
    pub fn method(&mut self) -> Method {
        let found = self.one_of(METHODS);
        let mut method = Method::of(found, &[]).unwrap();
        if found.takes.dictionary {
            let dictionary = Some(Arc::new(dct::dictionary(4, 16).unwrap()));
            method = Learned { dictionary, ..Learned::default() }.into();
        }
        // Only some have them.
        for (name, value) in [("block", "4"), ("atoms", "16"), ("max_iterations", "60")] {
            let _ = method.set(name, value);
        }
        if self.flag() {
            for setting in found.settings {
                let value =
                    self.one_of(&["", "", "0", "0.5", "1", "3", "1e3", "1e-6", "true", "measured", "third"]);
                let _ = method.set(setting.name, value);
            }
            let _ = method.set("max_iterations", "60");
        }
        method
    }
}
