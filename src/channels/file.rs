//! Rules of a show as a file, in TOML: `[[rule]]` with `glob`, `rule` and perhaps `reason`; the first match wins.

use std::fmt::Write;
use std::path::Path;

use lacuna_exr::Frame;
use serde::Deserialize;

use super::names::visible;
use super::{Choice, DecidedBy, Override};

/// The most bytes that such a file may have.
const MOST: u64 = 4 << 20;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    rule: Vec<Entry>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    glob: String,
    rule: String,
    reason: Option<String>,
}

/// The rules in a file.
///
/// # Errors
/// What is wrong, in one line with the file's name.
pub fn read_rules(path: &Path) -> Result<Vec<Override>, String> {
    let fail = |why: &dyn std::fmt::Display| format!("{}: {why}", path.display());
    let bytes = lacuna_exr::read_small(path, MOST).map_err(|error| fail(&error))?;
    parse(&String::from_utf8(bytes).map_err(|error| fail(&error))?).map_err(|why| fail(&why))
}

/// What is wrong with a text of TOML, and in which line.
pub fn problem(text: &str, error: &toml::de::Error) -> String {
    let line = error.span().map(|span| 1 + text[..span.start.min(text.len())].matches('\n').count());
    let line = line.map(|line| format!("line {line}: ")).unwrap_or_default();
    format!("{line}{}", error.message())
}

fn parse(text: &str) -> Result<Vec<Override>, String> {
    let file: File = toml::from_str(text).map_err(|error| problem(text, &error))?;
    let one = |entry: Entry| {
        let asked: Override = format!("{}={}", entry.glob, entry.rule)
            .parse()
            .map_err(|error: super::OverrideError| error.to_string())?;
        Ok(Override { reason: Some(entry.reason.unwrap_or_else(|| format!("rule {}", entry.glob))), ..asked })
    };
    file.rule.into_iter().map(one).collect()
}

/// The rules that a frame's channels have, as a file to start from; sampling masks in use are left out. A comment stands for names
/// whose channels a rule would change: those that some part lists as complete, or of which parts make different things.
pub fn print_rules(frame: &Frame, choices: &[Vec<Choice>]) -> String {
    let quoted = |text: &str| toml::Value::String(text.into()).to_string();
    let mut text =
        "# Rules for channels: the first glob that matches a full name wins; lacuna fill --rules FILE.\n"
            .to_owned();
    let mut found: Vec<(String, Vec<&Choice>)> = Vec::new();
    for (part, choices) in frame.parts.iter().zip(choices) {
        let ruled =
            part.channels.iter().zip(choices).filter(|(_, choice)| choice.by != DecidedBy::SamplingMask);
        for (channel, choice) in ruled {
            let name = channel.display_name();
            match found.iter_mut().find(|(known, _)| *known == *name) {
                Some((_, all)) => all.push(choice),
                None => found.push((name.into_owned(), vec![choice])),
            }
        }
    }
    for (name, choices) in found {
        let first = choices[0];
        let _ = if choices.iter().any(|choice| choice.by == DecidedBy::Dense || choice.rule != first.rule) {
            let each = choices.iter().map(|choice| format!("{} ({})", choice.rule, visible(&choice.why)));
            write!(text, "\n# {}: {}\n", visible(&name), each.collect::<Vec<_>>().join("; "))
        } else {
            let glob = glob::Pattern::escape(&name).replace('=', "[=]");
            let (glob, rule, why) = (quoted(&glob), quoted(first.rule.name()), quoted(&first.why));
            write!(text, "\n[[rule]]\nglob = {glob}\nrule = {rule}\nreason = {why}\n")
        };
    }
    text
}

#[cfg(test)]
mod tests {
    use super::super::{Rule, choose};
    use super::*;
    use crate::testing::{float, frame, part, uint, window};

    #[test]
    fn what_is_printed_is_read_again_and_gives_the_same_rules() {
        let channels =
            vec![float("a[1]=b.R", &[0.5]), float("Z", &[0.5]), uint("id", &[1]), float("u\"\\", &[0.5])];
        let frame = frame(vec![part(window(0, 0, 1, 1), channels)]);
        let choices = choose(&frame, &[], &[]);
        let rules = parse(&print_rules(&frame, &choices)).unwrap();
        let again = choose(&frame, &[], &rules);
        let both = choices[0].iter().zip(&again[0]);
        assert!(
            rules.len() == 4 && { both }
                .all(|(one, other)| one.rule == other.rule && other.by == DecidedBy::Override)
        );
        assert_eq!(again[0][0].why, format!("{} (--rules)", choices[0][0].why));
    }

    #[test]
    fn names_of_which_parts_make_different_things_have_no_rule() {
        let of = |names: [&str; 2]| part(window(0, 0, 1, 1), names.map(|name| float(name, &[0.5])).into());
        let mut frame = frame(vec![of(["R", "Z"]), of(["G", "Z"])]);
        super::super::list_dense(&mut frame.parts[1], ["G", "Z"]);
        let choices = choose(&frame, &[], &[]);
        let text = print_rules(&frame, &choices);
        assert_eq!(parse(&text).unwrap().len(), 1, "{text}");
        assert!(text.contains("# Z: depth (a depth, by its name); keep (listed"), "{text}");
        let again = choose(&frame, &[], &parse(&text).unwrap());
        let rules = |all: &[Vec<Choice>]| all.iter().flatten().map(|choice| choice.rule).collect::<Vec<_>>();
        assert_eq!(rules(&again), rules(&choices));
    }

    #[test]
    fn rules_say_what_is_wrong_with_them() {
        let rules = parse("[[rule]]\nglob = \"spec.*\"\nrule = \"keep\"\n").unwrap();
        assert_eq!((rules[0].rule, rules[0].matches("spec.R")), (Rule::Keep, true));
        for (text, reason) in [
            ("[[rule]]\nglob = \"a\"\nrule = \"paint\"\n", "not a rule"),
            ("[[rule]]\nglob = \"a\"\n", "line 1"),
            ("[[rules]]\n", "unknown field"),
            ("rule", "line 1"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(reason) && !error.contains('\n'), "{text}: {error}");
        }
    }
}
