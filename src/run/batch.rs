//! Runs one kind of work on every frame of a plan: schedule, progress, messages, report and exit status.

mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use self::summary::{line, sum};
use crate::files::error::PlanError;
use crate::files::plan::Item;
use crate::files::reports;
use crate::files::reports::is_standard_output;
use crate::run::console::{Console, Meter, Verbosity, frame_span, label};
use crate::run::ledger::Ledger;
use crate::run::record::{Heading, Journal, Record, State, write_failure};
use crate::run::schedule::{Limits, Need, Permits, Refusal, Share};
use crate::run::{memory, schedule, signals, threads};

/// Parts of a frame's progress: read, solve, write.
const STEPS: u64 = 3;

/// How to run; none of it changes a bit of a result but the time limit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RunOptions {
    /// Threads in all; 0 for all that there are.
    pub threads: usize,
    /// Frames that are solved at the same time.
    pub parallel_frames: usize,
    /// Bytes that frames on the way may use together.
    pub memory: Option<u64>,
    /// For solving one frame.
    pub time_limit: Option<Duration>,
    /// Print the plan only.
    pub dry_run: bool,
    /// How much is said.
    pub verbosity: Verbosity,
    /// How progress is told.
    pub meter: Meter,
    /// Where the report goes.
    pub json: Option<PathBuf>,
    /// The ledger that a line a frame is appended to.
    pub log: Option<PathBuf>,
    /// Where the page goes, of work that has one.
    pub page: Option<PathBuf>,
}

impl RunOptions {
    /// The console that these options ask for.
    ///
    /// # Errors
    /// If two things would go into one file or stream that cannot share it.
    pub fn console(&self) -> Result<Arc<Console>, PlanError> {
        self.console_beside(&[])
    }

    /// The same where the work has further reports.
    pub fn console_beside(&self, others: &[reports::Asked<'_>]) -> Result<Arc<Console>, PlanError> {
        if self.log.as_deref().is_some_and(is_standard_output) {
            let text = "--log -: a ledger is a file; --json - writes a report to standard output";
            return Err(PlanError::Usage(text.into()));
        }
        let own = [("--json", &self.json), ("--report", &self.page), ("--log", &self.log)];
        let own = own.into_iter().filter_map(|(flag, path)| Some((flag, path.as_deref()?)));
        let all: Vec<_> = own.chain(others.iter().copied()).collect();
        reports::check(&all, self.meter == Meter::OpenJd)?;
        Ok(Console::with(self.verbosity, self.meter))
    }

    /// A run that ended before it had frames: its report says so in the place of an earlier one, which would be believed. Where names
    /// contradict each other nothing else is written.
    pub fn report(
        &self,
        command: &'static str,
        result: Result<u8, PlanError>,
    ) -> Result<u8, (&'static str, PlanError)> {
        result.map_err(|error| {
            let is_place = |path: &PathBuf| match &error {
                PlanError::Failed(_) => {
                    reports::check(&[("--json", path)], self.meter == Meter::OpenJd).is_ok()
                }
                PlanError::Usage(_) => reports::is_report(path),
            };
            if let Some(path) = self.json.as_ref().filter(|path| !self.dry_run && is_place(path)) {
                let lacuna = env!("CARGO_PKG_VERSION");
                let heading = Heading { lacuna, command, filter: None, settings: None };
                // The error is told either way.
                drop(write_failure(path, &heading, &error.to_string()));
            }
            (command, error)
        })
    }

    /// The files that a run writes besides its frames.
    pub fn also_written(&self) -> Vec<PathBuf> {
        [&self.json, &self.page, &self.log].into_iter().flatten().cloned().collect()
    }
}

/// Why a frame failed, and the file that it is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The file.
    pub file: PathBuf,
    /// What is wrong and the way out.
    pub text: String,
}

impl Failure {
    /// A failure about `file`, which some errors name themselves.
    pub fn at(file: &Path, error: impl std::fmt::Display) -> Self {
        let (text, named) = (error.to_string(), format!("{}: ", file.display()));
        Self { file: file.into(), text: text.strip_prefix(&named).unwrap_or(&text).into() }
    }

    /// A file that is there already, and is not believed for this reason.
    pub fn kept_doubtful(file: &Path, why: &str) -> Self {
        Self { file: file.into(), text: format!("there already, but doubtful: {why}") }
    }

    /// A file that was written, but is not believed for this reason.
    pub fn doubtful(file: &Path, why: &str) -> Self {
        Self { file: file.into(), text: format!("written, but doubtful: {why}") }
    }
}

/// What is to be done with a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Decision {
    /// The work.
    Do,
    /// The same though there is an output, for this reason.
    Again(String),
    /// Nothing, for this reason.
    Skip(String),
}

/// What is done at the end on a signal, in the signal's thread.
pub type LastWords = Box<dyn FnOnce() -> Result<(), String> + Send>;

/// One kind of work on frames.
pub trait Work: Sync {
    /// What the work is called in plans and sums: "fill", "filled".
    fn words(&self) -> (&'static str, &'static str);

    /// Whether it only checks frames, so that nothing passes by absence.
    fn is_gate(&self) -> bool {
        false
    }

    /// Pieces of progress that solving a frame tells besides the stages, by [`Stage::piece`].
    fn pieces(&self) -> u64 {
        0
    }

    /// Whether anything is to be done. Looks at files, changes nothing.
    fn decide(&self, item: &Item) -> Result<Decision, Failure>;

    /// Bytes that the work on this frame may need, by its header; 0 if that cannot be read.
    fn need(&self, item: &Item) -> Need;

    /// The work itself; it passes over the record if nothing is to be written in the end.
    fn frame(&self, item: &Item, stage: &Stage<'_>, record: &mut Record) -> Result<(), Failure>;

    /// A frame did not come through: it was passed over, failed, or was refused.
    fn lost(&self, _item: &Item) {}

    /// What would make more of these frames, a line each.
    fn hints(&self, _records: &[Record]) -> Vec<String> {
        Vec::new()
    }

    /// What is written, besides the batch's report, when a signal ends the run.
    fn last_words(&self, _console: &Arc<Console>) -> Option<LastWords> {
        None
    }

    /// What is written when all frames are through.
    fn end(&self, _heading: &Heading, _records: &[Record]) -> Result<(), String> {
        Ok(())
    }
}

/// What the work on a frame may ask of the batch.
pub struct Stage<'a> {
    permits: &'a Permits<'a>,
    share: &'a Share<'a>,
    console: &'a Console,
    stopped: &'a AtomicBool,
    /// Pieces of solving that were not told yet.
    pieces: AtomicU64,
}

/// Where it is written down what became of each frame.
#[derive(Clone)]
struct Books {
    journal: Journal,
    ledger: Ledger,
}

impl Books {
    /// A frame is in work, and was stopped if the run ends before it is through.
    fn begin(&self, index: usize, item: &Item, record: &Record) {
        self.ledger.begin(index, item, record);
        self.journal.enter(index, Record { state: State::Stopped, ..record.clone() });
    }

    fn enter(&self, index: usize, record: Record) {
        self.ledger.end(index, &record);
        self.journal.enter(index, record);
    }
}

impl Stage<'_> {
    /// Reads, and counts the time.
    pub fn read<T>(&self, record: &mut Record, read: impl FnOnce() -> T) -> T {
        let result = timed(&mut record.seconds.read, read);
        self.console.advance(1);
        result
    }

    /// Solves when it is this frame's turn, and counts the time from then on.
    pub fn solve<T: Send>(&self, record: &mut Record, solve: impl FnOnce() -> T + Send) -> T {
        let result = self.solve_more(record, solve);
        self.console.advance(1);
        result
    }

    /// The same for what is left after that; of progress it is a [piece](Self::piece).
    pub fn solve_more<T: Send>(&self, record: &mut Record, solve: impl FnOnce() -> T + Send) -> T {
        let seconds = &mut record.seconds.solve;
        // It may run on another thread, whose lines are to name the frame as well.
        let span = tracing::Span::current();
        self.permits.solve(|| span.in_scope(|| timed(seconds, solve)))
    }

    /// Holds no more memory than the frame needs, now that it was read.
    ///
    /// # Errors
    /// It needs more than the bound.
    pub fn settle(&self, item: &Item, needed: u64) -> Result<(), Failure> {
        self.share.settle(needed).map_err(|refusal| Failure { file: item.input.clone(), text: why(refusal) })
    }

    /// The memory that is held for the frame.
    pub const fn share(&self) -> &Share<'_> {
        self.share
    }

    /// Writes, and counts the time.
    pub fn write<T>(&self, record: &mut Record, write: impl FnOnce() -> T) -> T {
        let result = timed(&mut record.seconds.write, write);
        self.console.advance(1);
        result
    }

    /// Some pieces of solving are done.
    pub fn piece(&self, pieces: u64) {
        let most = |left: u64| left.saturating_sub(pieces);
        let (Ok(left) | Err(left)) =
            self.pieces.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| Some(most(left)));
        let told = left - most(left);
        if told > 0 {
            self.console.advance(told);
        }
    }

    /// No more pieces come, though some may not have been needed.
    pub fn end_pieces(&self) {
        self.piece(u64::MAX);
    }

    /// Whether the run is to end.
    pub fn stopped(&self) -> bool {
        self.stopped.load(Ordering::SeqCst)
    }
}

fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    *seconds += start.elapsed().as_secs_f64();
    result
}

/// Runs `work` on all items; the exit status is 0, or 1 if a frame failed.
pub fn run(
    heading: Heading,
    items: &[Item],
    options: &RunOptions,
    work: &dyn Work,
    console: &Arc<Console>,
) -> Result<u8, String> {
    let threads = threads::start(options.threads)?;
    let ledger = Ledger::open(options.log.as_deref(), &heading)?;
    let books = Books { journal: Journal::new(heading, items), ledger };
    let stopped = watch(&books, options.json.clone(), work.last_words(console), console)?;
    let start = Instant::now();
    console.begin(items.len() as u64 * (STEPS + work.pieces()));
    // With a bound, memory counts for more than time.
    if options.memory.is_none() {
        lacuna_filters::keep_freed_memory();
    }
    let limits = Limits {
        parallel_frames: options.parallel_frames,
        overlap: if threads > 1 { 2 } else { 0 },
        memory: options.memory,
    };
    schedule::run(
        items,
        limits,
        |item| work.need(item),
        |index, item, (permits, share)| {
            let pieces = AtomicU64::new(work.pieces());
            one(index, item, work, &Stage { permits, share, console, stopped: &stopped, pieces }, &books);
        },
        |index, item, refusal| refused((index, item), refusal, work, console, &books),
        || stopped.load(Ordering::SeqCst),
    );
    console.end();
    while stopped.load(Ordering::SeqCst) {
        // The signal's thread ends the process.
        std::thread::park();
    }
    let Books { journal, ledger } = books;
    let mut failed = sum(&journal, work, start, console);
    if let Some(error) = ledger.close() {
        console.error(&error);
        failed = true;
    }
    // A copy: a signal's thread needs the records while reports are written.
    let records = journal.records().clone();
    if let Err(error) = work.end(journal.heading(), &records) {
        console.error(&error);
        failed = true;
    }
    if let Some(path) = &options.json
        && let Err(error) = journal.write(path)
    {
        console.error(&error);
        failed = true;
    }
    Ok(u8::from(failed))
}

/// No frame can be done, for this reason: ledger and report say so of each.
pub fn none(heading: Heading, items: &[Item], options: &RunOptions, reason: &str) -> Result<(), String> {
    let ledger = Ledger::open(options.log.as_deref(), &heading)?;
    let books = Books { journal: Journal::new(heading, items), ledger };
    for index in 0..items.len() {
        let mut record = books.journal.get(index);
        record.state = State::Failed;
        record.message = Some(reason.into());
        books.enter(index, record);
    }
    books.ledger.close().map_or(Ok(()), Err)?;
    options.json.as_ref().map_or(Ok(()), |path| books.journal.write(path))
}

/// Ends the run on a signal: no temporary file stays, the report says what was done.
fn watch(
    books: &Books,
    json: Option<PathBuf>,
    last_words: Option<LastWords>,
    console: &Arc<Console>,
) -> Result<Arc<AtomicBool>, String> {
    let (Books { journal, ledger }, console) = (books.clone(), Arc::clone(console));
    let clean = move || {
        lacuna_exr::remove_temporaries();
        console.end();
        ledger.stop();
        let (done, all) = {
            let records = journal.records();
            (records.iter().filter(|record| record.state == State::Done).count(), records.len())
        };
        console.error(&format!("stopped by a signal; {done} of {all} frames are done"));
        if let Some(error) = ledger.error() {
            console.error(&error);
        }
        let report = json.map(|path| journal.write(&path));
        for error in [report, last_words.map(|say| say())].into_iter().flatten().filter_map(Result::err) {
            console.error(&error);
        }
        lacuna_exr::remove_temporaries();
    };
    signals::watch(clean).map_err(|error| format!("cannot watch for signals: {error}"))
}

fn one(index: usize, item: &Item, work: &dyn Work, stage: &Stage<'_>, books: &Books) {
    let _span = frame_span(&item.input, item.number).entered();
    let mut record = books.journal.get(index);
    let result = work.decide(item).and_then(|decision| match decision {
        Decision::Skip(reason) => {
            stage.console.advance(STEPS);
            record.pass_over(reason);
            Ok(())
        }
        decision => {
            if let Decision::Again(why) = decision {
                tracing::info!("made again: {why}");
            }
            books.begin(index, item, &record);
            work.frame(item, stage, &mut record)
        }
    });
    // A signal ends the process: the frame is neither done nor at fault.
    if result.is_err() && stage.stopped() {
        return;
    }
    stage.end_pieces();
    if result.is_err() || record.state == State::Skipped {
        work.lost(item);
    }
    match result {
        Err(failure) => fail(&mut record, item, &failure, stage.console),
        Ok(()) if record.state == State::Skipped => {
            let reason = record.message.as_deref().unwrap_or_default();
            stage.console.detail(&format!("{}: skipped: {reason}", label(&item.input, item.number)));
        }
        Ok(()) => {
            // A stage that was not needed, as writing where frames are only checked, is done as well.
            stage.console.advance(STEPS.saturating_sub(record.steps_done()));
            record.state = State::Done;
            stage.console.detail(&line(item, &record));
        }
    }
    books.enter(index, record);
}

fn refused(
    (index, item): (usize, &Item),
    refusal: Refusal,
    work: &dyn Work,
    console: &Console,
    books: &Books,
) {
    if refusal == Refusal::NotStarted {
        return;
    }
    let text = why(refusal);
    let mut record = books.journal.get(index);
    console.advance(work.pieces());
    work.lost(item);
    fail(&mut record, item, &Failure { file: item.input.clone(), text }, console);
    books.enter(index, record);
}

/// What the log says of a refusal.
fn why(refusal: Refusal) -> String {
    match refusal {
        Refusal::NotStarted => "not started".into(),
        Refusal::TooLarge { needed, bound } => too_large(needed, bound, memory::granted()),
        Refusal::Panic(message) => format!("internal error ({message}); please report it with this frame"),
    }
}

/// Why a frame is not filled, when Slurm grants so much or says nothing.
fn too_large(needed: u64, bound: u64, granted: Option<u64>) -> String {
    let way = if granted == Some(bound) {
        ", 7/8 of what Slurm grants; ask for more with the job's --mem"
    } else {
        "; allow more with --memory"
    };
    let (needed, bound) = (lacuna_exr::Amount::at_most(needed), lacuna_exr::Amount::at_least(bound));
    format!("the frame needs about {needed} of memory, more than the bound of {bound}{way}")
}

fn fail(record: &mut Record, item: &Item, failure: &Failure, console: &Console) {
    let text = format!("{}: {}", label(&failure.file, item.number), failure.text);
    console.error(&text);
    console.advance(STEPS.saturating_sub(record.steps_done()));
    record.state = State::Failed;
    record.message = Some(text);
}

#[cfg(test)]
mod tests {
    use super::too_large;

    #[test]
    fn more_memory_is_asked_of_the_one_who_bounds_it() {
        let (needed, bound) = (5 << 20, 3 << 20);
        assert!(too_large(needed, bound, None).ends_with("bound of 3 MiB; allow more with --memory"));
        assert!(
            too_large(needed, 1 << 10, None).contains("about 5 MiB of memory, more than the bound of 1 KiB")
        );
        assert!(too_large(needed, bound, Some(9 << 20)).ends_with("--memory"));
        assert!(too_large(needed, bound, Some(bound)).ends_with("with the job's --mem"));
    }
}
