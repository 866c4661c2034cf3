//! Values that are NaN or infinite: how many a channel has, and how the log says so.

use lacuna_exr::Samples;

/// How many values are NaN or infinite; whole numbers never are.
pub fn non_finite(samples: &Samples) -> usize {
    non_finite_among(samples, None)
}

/// The same among the values with a flag; all if there are no flags.
pub fn non_finite_among(samples: &Samples, flags: Option<&[bool]>) -> usize {
    let counts = |at: usize| flags.is_none_or(|flags| flags.get(at) == Some(&true));
    match samples {
        Samples::Half(values) => {
            values.iter().enumerate().filter(|(at, value)| !value.is_finite() && counts(*at)).count()
        }
        Samples::Float(values) => {
            values.iter().enumerate().filter(|(at, value)| !value.is_finite() && counts(*at)).count()
        }
        Samples::Uint(_) => 0,
    }
}

/// `3 values are not finite: R 2, G 1`, from what is said of one and of several, and the counts of channels; nothing where all are finite.
pub fn non_finite_note(
    [one, several]: [&str; 2],
    counts: impl IntoIterator<Item = (impl AsRef<str>, usize)>,
) -> Option<String> {
    let (mut all, mut named) = (0, Vec::new());
    for (name, count) in counts.into_iter().filter(|(_, count)| *count > 0) {
        all += count;
        named.push(format!("{} {count}", super::visible(name.as_ref())));
    }
    let said = if all == 1 { one } else { several };
    (all > 0).then(|| format!("{all} {said}: {}", named.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_channels_with_such_values_are_named() {
        let note = |counts: [(&str, usize); 3]| non_finite_note(["is not finite", "are not finite"], counts);
        assert_eq!(note([("R", 2), ("G", 0), ("Z", 1)]), Some("3 are not finite: R 2, Z 1".into()));
        assert_eq!(note([("R", 0), ("G", 1), ("Z", 0)]), Some("1 is not finite: G 1".into()));
        assert_eq!(note([("R", 0), ("G", 0), ("Z", 0)]), None);
        let values = vec![1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX];
        assert_eq!(non_finite(&Samples::Float(values.clone())), 3);
        let flags = [true, true, false, false, true];
        assert_eq!(non_finite_among(&Samples::Float(values), Some(&flags)), 1);
        assert_eq!(non_finite(&Samples::Uint(vec![u32::MAX])), 0);
    }
}
