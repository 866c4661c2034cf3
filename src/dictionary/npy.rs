//! Arrays in NumPy's format (.npy), version 1: a line of text about them, then their numbers.
//!
//! Only little-endian arrays in row-major order are read, of the types that a dictionary has. What the text promises is checked
//! against the bytes that are there before anything is made of them.

use super::Error;

const MAGIC: &[u8] = b"\x93NUMPY";
/// NumPy aligns the numbers to this.
const ALIGNMENT: usize = 64;

/// A type of numbers.
pub trait Number: Sized + Copy {
    /// How NumPy calls it.
    const NAME: &'static str;
    /// Bytes of one.
    const BYTES: usize;
    /// From that many bytes.
    fn read(bytes: &[u8]) -> Self;
    /// Appends its bytes.
    fn write(self, out: &mut Vec<u8>);
}

macro_rules! number {
    ($type:ty, $name:literal) => {
        impl Number for $type {
            const NAME: &'static str = $name;
            const BYTES: usize = size_of::<$type>();
            fn read(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<$type>()];
                own.copy_from_slice(bytes);
                Self::from_le_bytes(own)
            }
            fn write(self, out: &mut Vec<u8>) {
                out.extend(self.to_le_bytes());
            }
        }
    };
}
number!(f32, "<f4");
number!(f64, "<f8");
number!(u32, "<u4");
number!(u64, "<u8");
number!(u8, "|u1");

/// An array as the content of a .npy file.
pub fn write<T: Number>(shape: &[usize], values: &[T]) -> Vec<u8> {
    let mut sizes: Vec<String> = shape.iter().map(ToString::to_string).collect();
    if sizes.len() == 1 {
        // A tuple of one.
        sizes.push(String::new());
    }
    let text = format!(
        "{{'descr': '{}', 'fortran_order': False, 'shape': ({}), }}",
        T::NAME,
        sizes.join(", ").trim_end()
    );
    let before = MAGIC.len() + 4;
    let length = (before + text.len() + 1).next_multiple_of(ALIGNMENT) - before;
    let mut out = Vec::with_capacity(before + length + values.len() * T::BYTES);
    out.extend(MAGIC);
    out.extend([1, 0]);
    out.extend((length as u16).to_le_bytes());
    out.extend(text.as_bytes());
    out.resize(before + length - 1, b' ');
    out.push(b'\n');
    for value in values {
        value.write(&mut out);
    }
    out
}

/// Reads an array; its shape has `axes` sizes.
pub fn read<T: Number>(bytes: &[u8], axes: usize) -> Result<(Vec<usize>, Vec<T>), Error> {
    let damaged = |what: &str| Error::Damaged(format!("an array {what}"));
    let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| damaged("is not in NumPy's format"))?;
    let ([major, _minor], rest) = rest.split_first_chunk().ok_or_else(|| damaged("ends in its header"))?;
    let (length, rest) = match major {
        1 => rest.split_first_chunk().map(|(length, rest)| (usize::from(u16::from_le_bytes(*length)), rest)),
        _ => rest.split_first_chunk().map(|(length, rest)| (u32::from_le_bytes(*length) as usize, rest)),
    }
    .ok_or_else(|| damaged("ends in its header"))?;
    let (text, numbers) = rest.split_at_checked(length).ok_or_else(|| damaged("ends in its header"))?;
    let text = str::from_utf8(text).map_err(|_| damaged("has a header that is no text"))?;
    if quoted(text, "'descr':") != Some(T::NAME) {
        return Err(damaged(&format!("is not of the type {}", T::NAME)));
    }
    if after(text, "'fortran_order':").is_none_or(|rest| !rest.starts_with("False")) {
        return Err(damaged("is in column-major order (write it with numpy.ascontiguousarray)"));
    }
    let shape = shape(text).filter(|shape| shape.len() == axes);
    let shape = shape.ok_or_else(|| damaged(&format!("has not {axes} axes")))?;
    let count = shape.iter().try_fold(T::BYTES, |bytes, size| bytes.checked_mul(*size));
    if count != Some(numbers.len()) {
        return Err(damaged("has not the numbers that its shape promises"));
    }
    Ok((shape, numbers.chunks_exact(T::BYTES).map(T::read).collect()))
}

fn after<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    Some(text.split_once(key)?.1.trim_start())
}

fn quoted<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    Some(after(text, key)?.strip_prefix('\'')?.split_once('\'')?.0)
}

fn shape(text: &str) -> Option<Vec<usize>> {
    let inside = after(text, "'shape':")?.strip_prefix('(')?.split_once(')')?.0;
    let sizes = inside.split(',').map(str::trim).filter(|size| !size.is_empty());
    sizes.map(|size| size.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_come_back_and_lies_do_not() {
        for (shape, count) in [(vec![], 1), (vec![5], 5), (vec![2, 3], 6), (vec![0, 7], 0)] {
            let values: Vec<f32> = (0..count).map(|i| i as f32 / 3.0).collect();
            let bytes = write(&shape, &values);
            assert_eq!((bytes.len() - 4 * values.len()) % ALIGNMENT, 0);
            assert_eq!(read::<f32>(&bytes, shape.len()).unwrap(), (shape.clone(), values));
            assert!(read::<f64>(&bytes, shape.len()).is_err());
            assert!(read::<f32>(&bytes, shape.len() + 1).is_err());
            for length in 0..bytes.len() {
                assert!(read::<f32>(&bytes[..length], shape.len()).is_err(), "{length}");
            }
        }
        let text = |shape: &str| {
            let mut bytes = b"\x93NUMPY\x01\x00\x60\x00".to_vec();
            bytes.extend(
                format!("{:96}", format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}}}"))
                    .bytes(),
            );
            bytes
        };
        for shape in ["(99999999999, 99999999999)", "(18446744073709551615,)", "(-1,)", "(1", "1", "(x,)"] {
            assert!(
                read::<f32>(&text(shape), 1).is_err() && read::<f32>(&text(shape), 2).is_err(),
                "{shape}"
            );
        }
    }
}
