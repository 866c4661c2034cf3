//! Spellings of before: each says the new one.

use std::ffi::OsString;

/// What stands in the place of an old command, if these words are one; the program's name comes first.
pub fn line(words: &[OsString]) -> Option<String> {
    let words: Vec<&str> = words.iter().skip(1).map(|word| word.to_str().unwrap_or_default()).collect();
    let (&first, rest) = words.split_first()?;
    let now = match first {
        "train" | "encode" | "decode" => format!("lacuna dictionary {first}"),
        "dictionary-info" => "lacuna dictionary info".into(),
        "mask" => return of_mask(rest),
        _ => return None,
    };
    Some(format!("'lacuna {first}' is '{now}' now (see '{now} --help')"))
}

/// Masks were measured by a flag.
fn of_mask(words: &[&str]) -> Option<String> {
    let own =
        words.iter().take_while(|word| **word != "--").map(|word| word.split('=').next().unwrap_or(word));
    let old = own
        .into_iter()
        .find(|word| ["--measure", "--coherence", "--densities", "--spectrum"].contains(word))?;
    let now = if old == "--measure" { "lacuna analyze MASK".into() } else { format!("lacuna analyze {old}") };
    Some(format!("'lacuna mask {old}' is '{now}' now (see 'lacuna analyze --help')"))
}
