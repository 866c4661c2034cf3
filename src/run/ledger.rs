//! The ledger of a farm: one line of JSON for each frame that a run came to, appended to a file that many runs share.
//!
//! A line is one write to a file opened for appending, under a lock that every writer takes, so that lines of several
//! writers never mix, on a network's file system either. A line that a crash or a full disk cut short is closed by the next.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use serde::Serialize;
use sha2::{Digest, Sha256};

use crate::files::plan::Item;
use crate::run::record::{Heading, Record, State};

/// How long lines wait for other writers: once while frames are made, and once at the end.
const PATIENCE: Duration = Duration::from_secs(30);
/// Frames whose lines are missing that an error names.
const NAMED: usize = 20;
/// The same for the last lines after a signal, which leaves little time.
const HASTE: Duration = Duration::from_secs(1);

/// The ledger of a run; clones are the same one. Without a file it does nothing.
#[derive(Clone, Debug)]
pub struct Ledger(Option<Arc<Inner>>);

#[derive(Debug)]
struct Inner {
    path: PathBuf,
    heading: Heading,
    host: String,
    task: Option<String>,
    state: Mutex<Entries>,
    /// Lines that are not in the file yet; not held while anything waits.
    lines: Mutex<VecDeque<Waiting>>,
    /// Held while lines are written.
    attempt: Mutex<Attempt>,
    /// A signal came.
    hurried: AtomicBool,
    /// Open from the beginning, as the reader of a pipe goes when its last writer does.
    _pipe: Option<File>,
}

#[derive(Debug, Default)]
struct Entries {
    /// Frames begun and not ended, by their index.
    begun: BTreeMap<usize, Begun>,
    /// Frames that have a line.
    ended: BTreeSet<usize>,
}

#[derive(Debug)]
struct Waiting {
    /// The frame that it is about.
    frame: String,
    line: Vec<u8>,
}

/// How the last attempt to write ended.
#[derive(Debug, Default)]
struct Attempt {
    /// Another process did not give the lock back in time.
    late: bool,
    error: Option<String>,
}

#[derive(Debug)]
struct Begun {
    /// So far.
    record: Record,
    /// The hash of the input.
    input: Option<String>,
    /// The record has it as text, which is not every path.
    output: PathBuf,
}

#[derive(Serialize)]
struct Line<'a> {
    time: String,
    host: &'a str,
    process: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    task: Option<&'a str>,
    #[serde(flatten)]
    heading: &'a Heading,
    input_sha256: Option<&'a str>,
    output_sha256: Option<&'a str>,
    #[serde(flatten)]
    record: &'a Record,
}

impl Ledger {
    /// The ledger in that file, which is made if it is missing.
    ///
    /// # Errors
    /// If the file cannot be opened for appending, or holds something else.
    pub fn open(path: Option<&Path>, heading: &Heading) -> Result<Self, String> {
        let Some(path) = path else { return Ok(Self(None)) };
        let mut file = open(path).map_err(|error| unwritten(path, &error))?;
        if !is_ledger(&mut file).map_err(|error| unwritten(path, &error))? {
            return Err(format!(
                "{}: the file is no ledger, which begins with {{, and nothing is appended to it; name another for --log",
                path.display()
            ));
        }
        let pipe = file.metadata().is_ok_and(|found| !found.is_file()).then_some(file);
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default().trim().to_owned();
        Ok(Self(Some(Arc::new(Inner {
            path: path.into(),
            heading: heading.clone(),
            host,
            task: task(|name| std::env::var(name).ok()),
            state: Mutex::default(),
            lines: Mutex::default(),
            attempt: Mutex::default(),
            hurried: AtomicBool::new(false),
            _pipe: pipe,
        }))))
    }

    /// The work on a frame begins: its input is hashed before it is read.
    pub fn begin(&self, index: usize, item: &Item, record: &Record) {
        if let Some(inner) = &self.0 {
            let begun =
                Begun { record: record.clone(), input: hash(&item.input), output: item.output.clone() };
            inner.state().begun.insert(index, begun);
        }
    }

    /// The frame is through: its line, with the hash of the output if there is a new one.
    pub fn end(&self, index: usize, record: &Record) {
        let Some(inner) = &self.0 else { return };
        let made = inner.state().begun.get(&index).map(|begun| begun.output.clone());
        let output = made.filter(|_| record.state == State::Done).and_then(|path| hash(&path));
        let mut state = inner.state();
        // A signal's thread may have been faster.
        if state.ended.insert(index) {
            let input = state.begun.remove(&index).and_then(|begun| begun.input);
            inner.enter(record, (input.as_deref(), output.as_deref()));
            drop(state);
            inner.flush(false);
        }
    }

    /// The run ends on a signal: what was begun gets a line that says so, and nothing else is written any more.
    pub fn stop(&self) {
        let Some(inner) = &self.0 else { return };
        inner.hurried.store(true, Ordering::SeqCst);
        let mut state = inner.state();
        for (index, Begun { mut record, input, .. }) in std::mem::take(&mut state.begun) {
            record.state = State::Stopped;
            state.ended.insert(index);
            inner.enter(&record, (input.as_deref(), None));
        }
        drop(state);
        inner.flush(true);
    }

    /// The run is through: lines that could not be written until now are, or the error says so.
    pub fn close(&self) -> Option<String> {
        if let Some(inner) = &self.0 {
            inner.flush(true);
        }
        self.error()
    }

    /// Why lines could not be written, and of which frames.
    pub fn error(&self) -> Option<String> {
        let inner = self.0.as_ref()?;
        let frames: Vec<String> = inner.lines().iter().map(|waiting| waiting.frame.clone()).collect();
        let named = frames.iter().take(NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
        let more = match frames.len().saturating_sub(NAMED) {
            0 => String::new(),
            more => format!(" and {more} more"),
        };
        let error = inner.attempt().error.clone()?;
        (!frames.is_empty()).then(|| format!("{error}; it lacks the lines of frames {named}{more}"))
    }
}

impl Inner {
    fn state(&self) -> MutexGuard<'_, Entries> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn lines(&self) -> MutexGuard<'_, VecDeque<Waiting>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn attempt(&self) -> MutexGuard<'_, Attempt> {
        self.attempt.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A line for the file.
    fn enter(&self, record: &Record, (input, output): (Option<&str>, Option<&str>)) {
        let line = Line {
            time: utc(SystemTime::now()),
            host: &self.host,
            process: std::process::id(),
            task: self.task.as_deref(),
            heading: &self.heading,
            input_sha256: input,
            output_sha256: output,
            record,
        };
        // Nothing of it can fail to be text.
        let line = serde_json::to_vec(&line).unwrap_or_default();
        let frame = record.frame.map_or_else(|| record.output.clone(), |number| number.to_string());
        self.lines().push_back(Waiting { frame, line });
    }

    /// Writes all lines. When another process did not give the lock back, later ones do not wait for it, but at the last.
    fn flush(&self, last: bool) {
        let mut attempt = self.attempt();
        let mut lines = std::mem::take(&mut *self.lines());
        if lines.is_empty() {
            return;
        }
        let late = attempt.late;
        let patience = || {
            if self.hurried.load(Ordering::SeqCst) {
                HASTE
            } else if late && !last {
                Duration::ZERO
            } else {
                PATIENCE
            }
        };
        *attempt = match append(&self.path, &mut lines, patience) {
            Ok(()) => Attempt::default(),
            Err(error) => Attempt {
                late: error.kind() == ErrorKind::TimedOut,
                error: Some(unwritten(&self.path, &error)),
            },
        };
        let mut later = self.lines();
        lines.append(&mut later);
        *later = lines;
    }
}

fn unwritten(path: &Path, error: &std::io::Error) -> String {
    format!("{}: the ledger cannot be written: {error}", path.display())
}

fn open(path: &Path) -> std::io::Result<File> {
    #[cfg(unix)]
    if path.metadata().is_ok_and(|found| std::os::unix::fs::FileTypeExt::is_fifo(&found.file_type())) {
        return open_pipe(path);
    }
    OpenOptions::new().read(true).append(true).create(true).open(path)
}

/// A pipe that is opened for reading, too, would take lines that nobody reads, and one for writing alone would wait for a reader.
#[cfg(unix)]
fn open_pipe(path: &Path) -> std::io::Result<File> {
    use rustix::fs::{OFlags, fcntl_setfl};
    use std::os::unix::fs::OpenOptionsExt;
    let waits_not = OFlags::NONBLOCK.bits() as i32;
    let pipe = OpenOptions::new().write(true).custom_flags(waits_not).open(path).map_err(|error| {
        let nobody = error.raw_os_error() == Some(rustix::io::Errno::NXIO.raw_os_error());
        if nobody { std::io::Error::other("nobody reads the pipe") } else { error }
    })?;
    // A line is written when there is room for it.
    fcntl_setfl(&pipe, OFlags::empty())?;
    Ok(pipe)
}

/// Whether a file is empty or begins as a line of JSON does; a pipe or a device has no beginning.
fn is_ledger(file: &mut File) -> std::io::Result<bool> {
    if !file.metadata()?.is_file() {
        return Ok(true);
    }
    let mut first = [0];
    Ok(file.read(&mut first)? == 0 || first == *b"{")
}

/// Appends lines, each in one write, and takes out those that are written. The file is opened anew, so that a network's file system
/// tells its true end.
fn append(
    path: &Path,
    lines: &mut VecDeque<Waiting>,
    patience: impl Fn() -> Duration,
) -> std::io::Result<()> {
    let mut file = open(path)?;
    // The lock ends with the file.
    lock(&file, patience)?;
    while let Some(Waiting { line, .. }) = lines.front() {
        let mut text = Vec::with_capacity(line.len() + 2);
        if is_cut_short(&mut file) {
            text.push(b'\n');
        }
        text.extend_from_slice(line);
        text.push(b'\n');
        file.write_all(&text)?;
        lines.pop_front();
    }
    Ok(())
}

fn lock(file: &File, patience: impl Fn() -> Duration) -> std::io::Result<()> {
    let start = Instant::now();
    loop {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) if start.elapsed() < patience() => {
                std::thread::sleep(Duration::from_millis(2));
            }
            Err(TryLockError::WouldBlock) => {
                return Err(std::io::Error::new(ErrorKind::TimedOut, "another process holds its lock"));
            }
            // Where the file system has no locks, appending has to do.
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(()),
        }
    }
}

/// Whether the last line has no end.
fn is_cut_short(file: &mut File) -> bool {
    let mut last = [b'\n'];
    // A pipe or a device has no last line.
    let sought = file.seek(SeekFrom::End(-1));
    sought.is_ok() && file.read_exact(&mut last).is_ok() && last != *b"\n"
}

/// The SHA-256 of a file in hexadecimal digits; `None` if it cannot be read (a procedural volume is no file).
fn hash(path: &Path) -> Option<String> {
    let mut file = File::open(path).ok().filter(|file| file.metadata().is_ok_and(|found| found.is_file()))?;
    let (mut sum, mut buffer) = (Sha256::new(), vec![0; 1 << 18]);
    loop {
        match file.read(&mut buffer) {
            Ok(0) => break,
            Ok(count) => sum.update(&buffer[..count]),
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return None,
        }
    }
    let digits =
        |byte: &u8| [byte >> 4, byte & 15].map(|digit| char::from(b"0123456789abcdef"[usize::from(digit)]));
    Some(sum.finalize().iter().flat_map(digits).collect())
}

/// The farm's name of the task: Slurm's `ARRAY_TASK` or `JOB`, with `+N` after N restarts.
fn task(variable: impl Fn(&str) -> Option<String>) -> Option<String> {
    let job = match (variable("SLURM_ARRAY_JOB_ID"), variable("SLURM_ARRAY_TASK_ID")) {
        (Some(job), Some(task)) => format!("{job}_{task}"),
        _ => variable("SLURM_JOB_ID")?,
    };
    let restarts = variable("SLURM_RESTART_COUNT").filter(|count| count != "0");
    Some(restarts.map_or_else(|| job.clone(), |count| format!("{job}+{count}")))
}

/// A moment as `2001-02-03T04:05:06.789Z`.
fn utc(moment: SystemTime) -> String {
    let since = moment.duration_since(UNIX_EPOCH).unwrap_or_default();
    let (days, second) = (since.as_secs() / 86_400, since.as_secs() % 86_400);
    // Years that begin in March, in cycles of 400 years of 146097 days; day 0 is then the 1st of March of year 0.
    let day = days + 719_468;
    let (cycle, of_cycle) = (day / 146_097, day % 146_097);
    let year = (of_cycle - of_cycle / 1460 + of_cycle / 36_524 - of_cycle / 146_096) / 365;
    let of_year = of_cycle - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let date = of_year - (153 * month + 2) / 5 + 1;
    let (month, next) = if month < 10 { (month + 3, 0) } else { (month - 9, 1) };
    format!(
        "{:04}-{month:02}-{date:02}T{:02}:{:02}:{:02}.{:03}Z",
        400 * cycle + year + next,
        second / 3600,
        second / 60 % 60,
        second % 60,
        since.subsec_millis()
    )
}

#[cfg(test)]
mod tests;
