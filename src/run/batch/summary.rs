//! What the log says of a frame that is done, and of a run in the end.

use std::path::Path;
use std::time::Instant;

use super::Work;
use crate::files::plan::Item;
use crate::run::console::{Console, label};
use crate::run::record::{Journal, Record, State, told_residual};

/// The line that `-v` prints for a frame.
pub fn line(item: &Item, record: &Record) -> String {
    let mut parts = Vec::new();
    if let Some(density) = record.density {
        parts.push(format!("density {:.2} %", density * 100.0));
    }
    if let Some(rules) = &record.rules {
        parts.push(rules.clone());
    }
    if let Some(outcome) = record.outcome {
        parts.push(format!("{} iterations", outcome.iterations));
        parts.extend(told_residual(outcome).map(|residual| format!("residual {residual:.1e}")));
        parts.extend(outcome.gap.map(|gap| format!("gap {gap:.1e}")));
        parts.extend(outcome.objective.map(|objective| format!("objective {objective:.6}")));
        parts.extend(outcome.constraint.map(|distance| format!("distance from the samples {distance:.1e}")));
    }
    let seconds = record.seconds;
    parts.push(format!(
        "{:.2} s (read {:.2}, solve {:.2}, write {:.2})",
        seconds.read + seconds.solve + seconds.write,
        seconds.read,
        seconds.solve,
        seconds.write
    ));
    format!("{}: {}", label(&item.input, item.number), parts.join("; "))
}

/// Says what came of the run; whether a frame failed.
pub fn sum(journal: &Journal, work: &dyn Work, start: Instant, console: &Console) -> bool {
    let records = journal.records();
    let count = |state: State| records.iter().filter(|record| record.state == state).count();
    let (done, skipped, failed) = (count(State::Done), count(State::Skipped), count(State::Failed));
    let mut parts = vec![format!("{done} of {} {} {}", records.len(), plural(records.len()), work.words().1)];
    for (number, what) in [(skipped, "skipped"), (failed, "failed")] {
        if number > 0 {
            parts.push(format!("{number} {what}"));
        }
    }
    let densities = records.iter().filter_map(|record| record.density).map(|density| density * 100.0);
    if let Some((least, most)) = densities.map(|d| (d, d)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))) {
        let (least, most) = (format!("{least:.2}"), format!("{most:.2}"));
        parts.push(if least == most {
            format!("density {least} %")
        } else {
            format!("density {least} to {most} %")
        });
    }
    parts.push(format!("{:.2} s", start.elapsed().as_secs_f64()));
    let written = |record: &&Record| record.state == State::Done && record.seconds.write > 0.0;
    parts.extend(went(records.iter().filter(written)).filter(|_| !work.is_gate()));
    work.hints(&records).iter().for_each(|hint| console.note(hint));
    console.note(&parts.join(", "));
    // They pass over nothing but frames that are not there.
    let unchecked = work.is_gate() && done + failed == 0;
    if unchecked {
        let what = work.words().1;
        console.error(&format!("no frame was {what}: none of them exists; check the pattern and --frames"));
    }
    failed > 0 || unchecked
}

/// Where the outputs are: the only file, or the folder of all; nothing where none was written.
fn went<'a>(written: impl Iterator<Item = &'a Record>) -> Option<String> {
    let outputs: Vec<&Path> = written.map(|record| Path::new(&record.output)).collect();
    match outputs.as_slice() {
        [] => None,
        [one] => Some(format!("written to {}", one.display())),
        [first, rest @ ..] if rest.iter().all(|path| path.parent() == first.parent()) => {
            let folder = first.parent().filter(|folder| !folder.as_os_str().is_empty());
            let folder = folder.unwrap_or(Path::new("."));
            Some(format!("written to {}{}", folder.display(), std::path::MAIN_SEPARATOR))
        }
        _ => Some("written to several folders".into()),
    }
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "frame" } else { "frames" }
}

#[cfg(test)]
mod tests {
    use super::{Record, went};

    #[test]
    fn where_outputs_went_is_told() {
        let told = |outputs: &[&str]| {
            let record = |output: &&str| Record { output: (*output).into(), ..Record::default() };
            let records: Vec<Record> = outputs.iter().map(record).collect();
            went(records.iter())
        };
        assert_eq!(told(&[]), None);
        assert_eq!(told(&["a/b.exr"]), Some("written to a/b.exr".into()));
        assert_eq!(told(&["a/b.exr", "a/c.exr"]), Some("written to a/".into()));
        assert_eq!(told(&["b.exr", "c.exr"]), Some("written to ./".into()));
        assert_eq!(told(&["a/b.exr", "c/b.exr"]), Some("written to several folders".into()));
    }
}
