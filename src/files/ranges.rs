//! Frame ranges: `1-10`, `1-10x2`, `1-10:2`, `1,5,9-12`, descending (`10-1`), negative (`-5--1`).

use std::str::FromStr;

/// More frames than this in one range are a slip of the keyboard.
const MOST: usize = 1_000_000;

/// Frame numbers in the order asked for, each once.
#[derive(Clone, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(try_from = "String")]
pub struct Frames(Vec<i64>);

/// Why a text is not a frame range.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RangeError {
    /// A part is neither a number nor a range.
    #[error("'{0}' is not a frame or a range such as 1-10, 1-10x2 or 1,5,9-12")]
    Syntax(String),
    /// The step is zero, or negative in a range that ascends.
    #[error("the step of '{0}' must be 1 or more (a range that descends takes a negative one as well)")]
    Step(String),
    /// There are too many frames.
    #[error("more than {MOST} frames")]
    TooMany,
}

impl Frames {
    /// The numbers, in the order asked for.
    pub fn numbers(&self) -> &[i64] {
        &self.0
    }
}

impl TryFrom<String> for Frames {
    type Error = RangeError;

    fn try_from(text: String) -> Result<Self, RangeError> {
        text.parse()
    }
}

impl FromStr for Frames {
    type Err = RangeError;

    fn from_str(text: &str) -> Result<Self, RangeError> {
        let mut numbers = Vec::new();
        let mut seen = std::collections::HashSet::new();
        for part in text.split(',') {
            let (first, last, step) = range(part.trim())?;
            let count = (first.abs_diff(last) / step).saturating_add(1);
            if count > MOST as u64 || numbers.len() + count as usize > MOST {
                return Err(RangeError::TooMany);
            }
            for k in 0..count as i64 {
                let offset = k * step as i64;
                let number = if last >= first { first + offset } else { first - offset };
                if seen.insert(number) {
                    numbers.push(number);
                }
            }
        }
        Ok(Self(numbers))
    }
}

/// First, last and step of one part.
fn range(part: &str) -> Result<(i64, i64, u64), RangeError> {
    let syntax = || RangeError::Syntax(part.into());
    let (ends, step) = match part.split_once(['x', ':']) {
        Some((ends, step)) => (ends, step.parse::<i32>().map_err(|_| syntax())?),
        None => (part, 1),
    };
    // A minus sign at the start belongs to the number; the next one separates.
    let dash = ends.char_indices().skip(1).find(|&(_, c)| c == '-').map(|(at, _)| at);
    let number = |text: &str| match text.parse() {
        Ok(number) if !text.starts_with('+') => Ok(number),
        _ => Err(syntax()),
    };
    let (first, last) = match dash {
        Some(at) => (number(&ends[..at])?, number(&ends[at + 1..])?),
        None if part.len() == ends.len() => number(ends).map(|only| (only, only))?,
        None => return Err(syntax()),
    };
    if step == 0 || (step < 0 && last >= first) {
        return Err(RangeError::Step(part.into()));
    }
    Ok((first, last, u64::from(step.unsigned_abs())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(text: &str) -> Vec<i64> {
        text.parse::<Frames>().unwrap().0
    }

    #[test]
    fn every_spelling_gives_its_numbers_in_the_order_asked() {
        assert_eq!(frames("7"), [7]);
        assert_eq!(frames("-7"), [-7]);
        assert_eq!(frames("1-4"), [1, 2, 3, 4]);
        assert_eq!(frames("1-10x3"), [1, 4, 7, 10]);
        assert_eq!(frames("1-10:4"), [1, 5, 9]);
        assert_eq!(frames("4-1"), [4, 3, 2, 1]);
        assert_eq!(frames("10-1x4"), [10, 6, 2]);
        assert_eq!(frames("10-1x-4"), [10, 6, 2]);
        assert_eq!(frames("1,5,9-12"), [1, 5, 9, 10, 11, 12]);
        assert_eq!(frames("-3--1"), [-3, -2, -1]);
        assert_eq!(frames("-1--3"), [-1, -2, -3]);
        assert_eq!(frames("-2-2x2"), [-2, 0, 2]);
        assert_eq!(frames("0001-0003"), [1, 2, 3]);
        assert_eq!(frames("9, 1-2"), [9, 1, 2]);
        // A name may have a date and a time.
        assert_eq!(frames("20240102030405-20240102030406"), [20_240_102_030_405, 20_240_102_030_406]);
    }

    #[test]
    fn a_frame_is_listed_once() {
        assert_eq!(frames("3,1-4,2"), [3, 1, 2, 4]);
    }

    #[test]
    fn what_is_no_range_is_refused() {
        let long = "1-99999999999999999999";
        for text in ["", ",", "1-", "-", "a", "1-2-3", "1--", "1x2", "1:2", "1-10x", "+1", "1.5", long] {
            assert!(matches!(text.parse::<Frames>(), Err(RangeError::Syntax(_))), "{text}");
        }
        assert!(matches!("1-10x0".parse::<Frames>(), Err(RangeError::Step(_))));
        assert!(matches!("1-10x-2".parse::<Frames>(), Err(RangeError::Step(_))));
        for text in ["1-2000000", "-9223372036854775808-9223372036854775807"] {
            assert_eq!(text.parse::<Frames>(), Err(RangeError::TooMany));
        }
    }
}
