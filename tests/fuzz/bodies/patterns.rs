//! What people type and write: patterns of frames, ranges, masks, rules, layouts of voxels, studies, rules of a show.

use std::path::Path;

use lacuna::channels::{Override, read_rules};
use lacuna::files::patterns::{Pattern, number_in_name};
use lacuna::files::ranges::Frames;
use lacuna::mask::Source;
use lacuna::reconstruct::{Target, parse_settings};
use lacuna::study::Definition;
use lacuna_volume::read::RawLayout;

/// The bytes are a text; its first line is a word, the rest a file.
pub fn body(data: &[u8]) {
    let text = String::from_utf8_lossy(data);
    let (word, rest) = text.split_once('\n').unwrap_or((&text, ""));
    if let Ok(Some(pattern)) = Pattern::parse(word) {
        for number in [i64::MIN, -12_345, -1, 0, 7, 100_000, i64::MAX] {
            let path = pattern.path(number);
            assert!(pattern.number_of(&path).is_none_or(|found| found == number), "{word} {number}");
        }
        let _ = pattern.folder();
    }
    if let Ok(frames) = word.parse::<Frames>() {
        let mut numbers = frames.numbers().to_vec();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), frames.numbers().len(), "{word}: each frame once");
    }
    if let Ok(source) = word.parse::<Source>() {
        assert_eq!(source.to_string().parse(), Ok(source), "{word}");
    }
    if let Ok(rule) = word.parse::<Override>() {
        assert_eq!(rule.to_string().parse(), Ok(rule), "{word}");
    }
    let _ = (number_in_name(Path::new(word)), word.parse::<RawLayout>(), parse_settings(word));
    let _ = (Target::scale(word), Target::size(word));
    let _ = Definition::parse(rest);
    let _ = read_rules(&super::file("patterns.toml", rest.as_bytes()));
}
