//! Running a study: cells side by side, each on one thread; a journal that is continued; the report.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crate::files::error::PlanError;
use crate::run::console::{Console, Verbosity};
use crate::run::{schedule, signals, threads};
use crate::study::{self, Cell, Definition, Entry, Row, Sheet, SheetDefinition, Subject};

/// The most bytes that a journal or a picture of an earlier run may have.
const MOST_READ: u64 = 1 << 30;
/// The journal's file.
const JOURNAL: &str = "results.jsonl";
/// How the last line of a sheet's file begins.
const SHEET: &str = "<!-- made from ";
/// How the last line of a figure's file begins.
const FIGURE: &str = "<!-- figure of a study";

/// A study that is to be run.
#[derive(Clone, Debug, PartialEq)]
pub struct StudyJob {
    /// What is studied.
    pub definition: Definition,
    /// The folder that its frames are relative to.
    pub folder: PathBuf,
    /// The filters, in the definition's order.
    pub entries: Vec<Entry>,
    /// The folder for journal, tables, figures and page.
    pub output: PathBuf,
    /// Cells at the same time; 0 for as many as there are processors.
    pub threads: usize,
    /// Say only what is to be done.
    pub dry_run: bool,
    /// How much is said.
    pub verbosity: Verbosity,
}

/// Runs the cells that are not in the journal yet, then writes the report; the exit status.
pub fn study(job: &StudyJob) -> Result<u8, PlanError> {
    let console = Console::new(job.verbosity);
    console.listen();
    let reach = job.entries.iter().map(|entry| entry.job.temporal.window.each()).max().unwrap_or(0);
    let subjects: Result<Vec<Subject>, String> =
        job.definition.frames.iter().map(|frame| Subject::read(frame, &job.folder, reach)).collect();
    let subjects = subjects.map_err(PlanError::Failed)?;
    subjects.iter().flat_map(|subject| &subject.notes).for_each(|note| console.warning(note));
    let cells = study::cells(&job.definition, &subjects, &job.entries)
        .map_err(|error| PlanError::Usage(error.to_string()))?;
    let sheets = sheets(job, &subjects)?;
    let journal = job.output.join(JOURNAL);
    let mut file = None;
    if !job.dry_run {
        let made = std::fs::create_dir_all(&job.output);
        made.map_err(|error| fail(&job.output, "cannot make the folder", &error))?;
        file = Some(open(&journal)?);
    }
    let mut known = known(&journal).map_err(PlanError::Failed)?;
    let todo = missing(&cells, &known);
    console.note(&format!("{}, {} of them to be run", number(cells.len()), todo.len()));
    let Some(file) = &file else {
        for cell in todo {
            console.note(&cell.name());
        }
        return Ok(0);
    };
    let workers = Workers::new(job.threads, &console).map_err(PlanError::Failed)?;
    for row in workers.rows(&todo, (file, &journal), &console)? {
        known.insert(row.key.clone(), row);
    }
    let rows: Vec<Row> = cells.iter().filter_map(|cell| named(cell, &known)).collect();
    let (sheets, blank) = workers.sheets(&sheets, &job.output, &console)?;
    write(job, &rows, &sheets)?;
    let failed = rows.iter().filter(|row| row.error.is_some()).count();
    console.note(&format!(
        "{}, {failed} failed; the report is {}",
        number(rows.len()),
        job.output.join("report.html").display()
    ));
    Ok(u8::from(failed + blank > 0))
}

/// So many cells.
fn number(cells: usize) -> String {
    format!("{cells} {}", if cells == 1 { "cell" } else { "cells" })
}

fn fail(path: &Path, what: &str, error: &dyn std::fmt::Display) -> PlanError {
    PlanError::Failed(format!("{}: {what}: {error}", path.display()))
}

/// The rows of an earlier run, by their keys.
fn known(journal: &Path) -> Result<BTreeMap<String, Row>, String> {
    match lacuna_exr::read_small(journal, MOST_READ) {
        Ok(bytes) => Ok(study::read_journal(&bytes).into_iter().map(|row| (row.key.clone(), row)).collect()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(BTreeMap::new()),
        Err(error) => Err(format!("{}: cannot read: {error}", journal.display())),
    }
}

/// The cells without a row, each key once.
fn missing<'a, 'b>(cells: &'b [Cell<'a>], known: &BTreeMap<String, Row>) -> Vec<&'b Cell<'a>> {
    let mut seen = BTreeSet::new();
    cells.iter().filter(|cell| !known.contains_key(&cell.key()) && seen.insert(cell.key())).collect()
}

/// The row of a cell under its own names: another study may have called them otherwise.
fn named(cell: &Cell<'_>, known: &BTreeMap<String, Row>) -> Option<Row> {
    let row = known.get(&cell.key())?.clone();
    Some(Row {
        frame: cell.subject.name.clone(),
        class: cell.subject.class.clone(),
        filter: cell.label().into(),
        ..row
    })
}

/// A sheet with the cells that it shows: per density one a filter.
struct Planned<'a> {
    definition: &'a SheetDefinition,
    cells: Vec<Cell<'a>>,
}

fn sheets<'a>(job: &'a StudyJob, subjects: &'a [Subject]) -> Result<Vec<Planned<'a>>, PlanError> {
    let one = |definition: &'a SheetDefinition| {
        let wrong = |what: &str| PlanError::Usage(format!("sheet '{}': {what}", definition.name));
        let own = Definition {
            patterns: vec![definition.pattern.clone()],
            densities: definition.densities.clone(),
            seeds: job.definition.seeds[..1].to_vec(),
            ..job.definition.clone()
        };
        if let Some(label) =
            definition.filters.iter().find(|label| !job.entries.iter().any(|entry| entry.label == **label))
        {
            return Err(wrong(&format!("filter '{label}' is none of the study's")));
        }
        // Half the resolution has no filters to choose from.
        let wanted = |cell: &Cell<'_>| {
            let all = definition.filters.is_empty() || cell.pattern == study::Selection::Half;
            all || definition.filters.contains(&cell.entry.label)
        };
        let subject = subjects.iter().filter(|subject| subject.name == definition.frame);
        let mut cells = Vec::new();
        let is_outside =
            |shot: &study::Shot| definition.window.is_some_and(|window| !study::meets(window, shot.window()));
        for subject in subject {
            if subject.shots.iter().any(is_outside) {
                return Err(wrong("its window holds no pixel of the frame"));
            }
            let all = study::cells(&own, std::slice::from_ref(subject), &job.entries);
            cells.extend(all.map_err(|error| wrong(&error.to_string()))?);
        }
        cells.retain(wanted);
        Ok(Planned { definition, cells })
    };
    job.definition.sheets.iter().map(one).collect()
}

/// Threads that take cells one after another.
struct Workers {
    pools: Vec<rayon::ThreadPool>,
    stopped: Arc<std::sync::atomic::AtomicBool>,
}

impl Workers {
    fn new(asked: usize, console: &Arc<Console>) -> Result<Self, String> {
        let pool =
            || rayon::ThreadPoolBuilder::new().num_threads(1).build().map_err(|error| error.to_string());
        let pools: Result<Vec<_>, _> = (0..threads::count(asked)).map(|_| pool()).collect();
        let console = Arc::clone(console);
        let clean = move || {
            console.end();
            console.error("stopped by a signal; the same command goes on from here");
            lacuna_exr::remove_temporaries();
        };
        let stopped = signals::watch(clean).map_err(|error| format!("cannot watch for signals: {error}"))?;
        Ok(Self { pools: pools?, stopped })
    }

    /// Does `work` for each number below `count`; what it gives goes to `done`.
    fn each<T: Send>(&self, count: usize, work: impl Fn(usize) -> T + Sync, done: impl Fn(usize, T) + Sync) {
        let next = AtomicUsize::new(0);
        std::thread::scope(|scope| {
            for pool in &self.pools {
                let (next, work, done) = (&next, &work, &done);
                scope.spawn(move || {
                    while !self.stopped.load(Ordering::SeqCst) {
                        let at = next.fetch_add(1, Ordering::Relaxed);
                        if at >= count {
                            break;
                        }
                        done(at, pool.install(|| work(at)));
                    }
                });
            }
        });
        while self.stopped.load(Ordering::SeqCst) {
            // The signal's thread ends the process.
            std::thread::park();
        }
    }

    /// Runs cells; each row is in the journal as soon as it is there.
    fn rows(
        &self,
        cells: &[&Cell<'_>],
        (file, journal): (&File, &Path),
        console: &Console,
    ) -> Result<Vec<Row>, PlanError> {
        let state = Mutex::new((file, Vec::new(), None));
        console.begin(cells.len() as u64);
        let work = |at: usize| {
            let ran = guarded(|| study::run(cells[at], &mut |_| ()));
            ran.unwrap_or_else(|error| Row { error: Some(error), ..cells[at].blank() })
        };
        self.each(cells.len(), work, |at, row| {
            let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
            let written = state.0.write_all(study::journal(&row).as_bytes());
            state.2 = state.2.take().or(written.err());
            console.detail(&format!(
                "{}: {}",
                cells[at].name(),
                row.psnr().map_or_else(String::new, |psnr| format!("{psnr:.2} dB"))
            ));
            if let Some(error) = &row.error {
                console.error(&format!("{}: {error}", cells[at].name()));
            }
            state.1.push(row);
            console.advance(1);
        });
        console.end();
        let (_, rows, broken) = state.into_inner().unwrap_or_else(PoisonError::into_inner);
        broken.map_or(Ok(rows), |error| Err(fail(journal, "cannot write", &error)))
    }

    /// Makes the sheets that are not there yet; their names and pictures, and how many tiles are blank, as their cells failed.
    fn sheets(
        &self,
        sheets: &[Planned<'_>],
        folder: &Path,
        console: &Console,
    ) -> Result<(Vec<(String, String)>, usize), PlanError> {
        let (mut all, mut blank) = (Vec::new(), 0);
        for sheet in sheets {
            let path = folder.join(format!("{}.svg", sheet.definition.name));
            let mark = sheet.mark();
            let old =
                lacuna_exr::read_small(&path, MOST_READ).ok().and_then(|old| String::from_utf8(old).ok());
            let old = old.unwrap_or_default();
            if old.ends_with(&mark) {
                all.push((sheet.definition.name.clone(), old));
                continue;
            }
            console.note(&format!("{}: {} for the pictures", path.display(), number(sheet.cells.len())));
            let tiles = Mutex::new(BTreeMap::new());
            let work = |at: usize| guarded(|| Sheet::of(&sheet.cells[at], sheet.definition)).flatten();
            self.each(sheet.cells.len(), work, |at, tile| {
                tiles.lock().unwrap_or_else(PoisonError::into_inner).insert(at, tile);
            });
            let tiles = tiles.into_inner().unwrap_or_else(PoisonError::into_inner).into_values();
            let tiles: Vec<study::Tile<'_>> = sheet.cells.iter().zip(tiles).collect();
            let failed = tiles.iter().filter_map(|(cell, tile)| Some((cell, tile.as_ref().err()?)));
            let told = failed.map(|(cell, error)| {
                console.error(&format!("{}: {}: {error}", path.display(), cell.name()));
            });
            let failed = told.count();
            blank += failed;
            let mark = if failed == 0 { mark } else { sheet.mark_as("failed cells") };
            let svg = study::sheet(sheet.definition, &tiles) + &mark;
            put(&path, &svg)?;
            all.push((sheet.definition.name.clone(), svg));
        }
        Ok((all, blank))
    }
}

impl Planned<'_> {
    /// The last line of the sheet's file, which tells what it was made from.
    fn mark(&self) -> String {
        let mut sum = flate2::Crc::new();
        sum.update(format!("{:?}", self.definition).as_bytes());
        for cell in &self.cells {
            sum.update(cell.key().as_bytes());
            sum.update(cell.entry.label.as_bytes());
        }
        self.mark_as(&format!("{:08x}", sum.sum()))
    }

    /// The same of what is to be made again.
    fn mark_as(&self, what: &str) -> String {
        format!("{SHEET}{what}{}", name_mark(&self.definition.name))
    }
}

/// How the last line of a picture's file ends: a sum of its name, which itself may hold what a comment may not.
fn name_mark(name: &str) -> String {
    let mut sum = flate2::Crc::new();
    sum.update(name.as_bytes());
    format!(", named {:08x} -->\n", sum.sum())
}

/// Work on a cell, whose defects are its own.
fn guarded<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work))
        .map_err(|panic| format!("internal error ({}); please report it", schedule::message(panic.as_ref())))
}

/// The journal, this run's alone until it ends, ready for the next line: a last line that was cut short is ended.
fn open(journal: &Path) -> Result<File, PlanError> {
    let failed = |error: &std::io::Error| fail(journal, "cannot write", error);
    let opened = OpenOptions::new().create(true).append(true).open(journal);
    let mut file = opened.map_err(|error| failed(&error))?;
    // Where the file system has no locks, runs do each other's cells again.
    if let Err(TryLockError::WouldBlock) = file.try_lock() {
        let other = "another study is running in this folder; wait for it or give another --output";
        return Err(PlanError::Failed(format!("{}: {other}", journal.display())));
    }
    let bytes = lacuna_exr::read_small(journal, MOST_READ);
    if bytes.is_ok_and(|bytes| bytes.last().is_some_and(|&last| last != b'\n')) {
        file.write_all(b"\n").map_err(|error| failed(&error))?;
    }
    Ok(file)
}

fn put(path: &Path, text: &str) -> Result<(), PlanError> {
    lacuna_exr::write_whole(path, text.as_bytes()).map_err(|error| fail(path, "cannot write", &error))
}

/// Removes the pictures that earlier runs left of frames and sheets that are called otherwise now; copies that people gave other
/// names stay.
fn remove_others(folder: &Path, kept: &BTreeSet<String>) -> Result<(), PlanError> {
    let listed = std::fs::read_dir(folder).map_err(|error| fail(folder, "cannot be listed", &error))?;
    for path in listed.flatten().map(|entry| entry.path()) {
        let is_kept = path.file_name().is_none_or(|name| kept.contains(&*name.to_string_lossy()));
        if is_kept || path.extension().is_none_or(|ending| ending != "svg") {
            continue;
        }
        let text = lacuna_exr::read_small(&path, MOST_READ).unwrap_or_default();
        let last = String::from_utf8_lossy(text.rsplit(|&byte| byte == b'\n').nth(1).unwrap_or_default())
            .into_owned();
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let is_own = last.ends_with(name_mark(&name).trim_end());
        if is_own && (last.contains(SHEET) || last.contains(FIGURE)) {
            std::fs::remove_file(&path).map_err(|error| fail(&path, "cannot be removed", &error))?;
        }
    }
    Ok(())
}

fn write(job: &StudyJob, rows: &[Row], sheets: &[(String, String)]) -> Result<(), PlanError> {
    let at = |name: &str| job.output.join(name);
    let definition = &job.definition;
    put(&at("results.csv"), &study::csv(rows))?;
    put(&at("results.json"), &study::json(&definition.title, rows).map_err(PlanError::Failed)?)?;
    put(&at("tables.md"), &study::tables(rows, definition.verdict))?;
    let figures = study::figures(rows).map_err(PlanError::Failed)?;
    for figure in &figures {
        put(
            &at(&format!("{}.svg", figure.name)),
            &format!("{}\n{FIGURE}{}", figure.svg, name_mark(&figure.name)),
        )?;
    }
    let names = figures.iter().map(|figure| &figure.name).chain(sheets.iter().map(|(name, _)| name));
    put(&at("report.html"), &study::page(definition, rows, &figures, sheets))?;
    remove_others(&job.output, &names.map(|name| format!("{name}.svg")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pictures_under_their_own_names_go() {
        let folder = tempfile::tempdir().unwrap();
        let figure = |name: &str| format!("<svg/>\n{FIGURE}{}", name_mark(name));
        let sheet = |name: &str| format!("<svg/>\n{SHEET}0{}", name_mark(name));
        for (name, text) in [
            ("psnr-old.svg", figure("psnr-old")),
            ("sheet.svg", sheet("sheet")),
            ("psnr-new.svg", figure("psnr-new")),
            ("paper.svg", figure("psnr-old")),
            ("slide.svg", sheet("sheet")),
            ("mine.svg", "<svg/>\n".to_owned()),
        ] {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        remove_others(folder.path(), &BTreeSet::from(["psnr-new.svg".to_owned()])).unwrap();
        let left = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        let left: BTreeSet<_> = left.map(|name| name.into_string().unwrap()).collect();
        let kept = ["mine.svg", "paper.svg", "psnr-new.svg", "slide.svg"].map(str::to_owned);
        assert_eq!(left, BTreeSet::from(kept));
    }
}
