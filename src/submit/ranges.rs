//! Frame numbers as the shortest text that `--frames` reads.

/// The largest step that `--frames` reads.
const MOST: u64 = i32::MAX as u64;

/// `1-10`, `1-9x2`, `5,7-12`: the numbers in their order.
pub fn text(numbers: &[i64]) -> String {
    let mut parts = Vec::new();
    let mut rest = numbers;
    while let Some(&first) = rest.first() {
        let difference = |pair: &[i64]| pair[1].checked_sub(pair[0]).filter(|step| step.abs_diff(0) <= MOST);
        let step = rest.windows(2).next().and_then(difference).unwrap_or(0);
        let steps = rest.windows(2).take_while(|pair| step != 0 && difference(pair) == Some(step)).count();
        // Two numbers far apart are no range.
        let count = if steps >= 2 || (steps == 1 && step.abs() == 1) { steps + 1 } else { 1 };
        let last = rest[count - 1];
        parts.push(match (count, step.abs()) {
            (1, _) => first.to_string(),
            (_, 1) => format!("{first}-{last}"),
            (_, step) => format!("{first}-{last}x{step}"),
        });
        rest = &rest[count..];
    }
    parts.join(",")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::text;
    use crate::files::ranges::Frames;

    #[test]
    fn runs_become_ranges() {
        assert_eq!(text(&[1, 2, 3, 4]), "1-4");
        assert_eq!(text(&[7]), "7");
        assert_eq!(text(&[1, 2]), "1-2");
        assert_eq!(text(&[1, 5]), "1,5");
        assert_eq!(text(&[1, 3, 5, 6]), "1-5x2,6");
        assert_eq!(text(&[4, 3, 2]), "4-2");
        assert_eq!(text(&[9, 5, 1]), "9-1x4");
        assert_eq!(text(&[-3, -2, -1]), "-3--1");
        assert_eq!(text(&[]), "");
        assert_eq!(text(&[i64::MIN, 0, i64::MAX]), format!("{},0,{}", i64::MIN, i64::MAX));
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_as_it_was(steps in prop::collection::vec(-3_i64..4, 1..40), first in -50_i64..50) {
            let mut numbers = vec![first];
            for step in steps {
                let next = numbers[numbers.len() - 1] + step;
                if !numbers.contains(&next) {
                    numbers.push(next);
                }
            }
            let read: Frames = text(&numbers).parse().unwrap();
            prop_assert_eq!(read.numbers(), &numbers[..]);
        }
    }
}
