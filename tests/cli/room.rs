//! A folder of test frames, and lacuna run on it as a process.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Output, Stdio};

use half::f16;
use lacuna_exr::{
    self, Attributes, Channel, Compression, Frame, Layout, Limits, Part, Samples, Window, WriteOptions,
};

/// The binary under test.
pub const LACUNA: &str = env!("CARGO_BIN_EXE_lacuna");

/// A temporary folder in which lacuna runs.
pub struct Room(tempfile::TempDir);

/// What a run did.
pub struct Done {
    /// Exit status; negative is a signal.
    pub status: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Room {
    /// An empty folder.
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    /// A folder with sparse frames of those names.
    pub fn with(names: &[&str]) -> Self {
        let room = Self::new();
        for name in names {
            room.add(name, &sparse(40, 30));
        }
        room
    }

    /// The path of a name in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a frame.
    pub fn add(&self, name: &str, frame: &Frame) {
        lacuna_exr::write(frame, &self.path(name), &WriteOptions::default()).unwrap();
    }

    /// Reads a frame.
    pub fn read(&self, name: &str) -> Frame {
        lacuna_exr::read(&self.path(name), &Limits::default()).unwrap()
    }

    /// Makes a folder.
    pub fn folder(&self, name: &str) {
        std::fs::create_dir(self.path(name)).unwrap();
    }

    /// The names in a folder, hidden ones included, sorted.
    pub fn names(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.path(folder)).unwrap();
        let mut names: Vec<_> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// A process of lacuna that is not started yet.
    pub fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(LACUNA);
        command.args(words).current_dir(self.0.path()).stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    /// Runs lacuna to its end.
    pub fn run(&self, words: &[&str]) -> Done {
        Done::from(self.command(words).output().unwrap())
    }

    /// Runs lacuna, which must succeed.
    pub fn ok(&self, words: &[&str]) -> Done {
        let done = self.run(words);
        assert_eq!(done.status, 0, "{words:?}\n{}", done.err);
        done
    }
}

impl From<Output> for Done {
    fn from(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        let done = Self { status: status(output.status), out: text(output.stdout), err: text(output.stderr) };
        assert!(!done.err.contains("panicked") && !done.err.contains("internal error"), "{}", done.err);
        done
    }
}

impl Done {
    /// The lines of standard error that begin with `lacuna: error: `.
    pub fn errors(&self) -> Vec<&str> {
        self.err.lines().filter(|line| line.starts_with("lacuna: error: ")).collect()
    }
}

/// The exit status; negative is a signal.
pub fn status(status: std::process::ExitStatus) -> i32 {
    #[cfg(unix)]
    let signal = std::os::unix::process::ExitStatusExt::signal(&status);
    #[cfg(not(unix))]
    let signal = None;
    status.code().unwrap_or_else(|| -signal.unwrap_or(0))
}

/// A part with channels R, G, B (halves of a smooth ramp), Z and mask, in which every fifth pixel was measured.
pub fn part(window: Window) -> Part {
    part_from(window, 0)
}

/// The same with the first measured pixel further on, for other masks.
pub fn part_from(window: Window, first: usize) -> Part {
    part_of(window, |at| at >= first && (at - first).is_multiple_of(5))
}

/// The same with these measured pixels.
pub fn part_of(window: Window, measured: impl Fn(usize) -> bool) -> Part {
    let size = window.size();
    let ramp = |at: usize, scale: f32| {
        let (y, x) = (at / size.width, at % size.width);
        if measured(at) { 0.1 + scale * (x as f32 + 2.0 * y as f32) / 100.0 } else { 0.0 }
    };
    let halves =
        |scale: f32| Samples::Half((0..size.pixels()).map(|at| f16::from_f32(ramp(at, scale))).collect());
    let mask = (0..size.pixels()).map(|at| if measured(at) { f16::ONE } else { f16::ZERO }).collect();
    let depth = (0..size.pixels()).map(|at| ramp(at, 3.0)).collect();
    let channel = |name: &str, samples| Channel { name: name.into(), perceptually_linear: false, samples };
    Part {
        attributes: Attributes::default(),
        data_window: window,
        display_window: window,
        compression: Compression::Zip,
        layout: Layout::ScanLines,
        channels: vec![
            channel("B", halves(0.3)),
            channel("G", halves(0.6)),
            channel("R", halves(1.0)),
            channel("Z", Samples::Float(depth)),
            channel("mask", Samples::Half(mask)),
        ],
        had_levels: false,
    }
}

/// A sparse frame of that size at the origin.
pub fn sparse(width: i32, height: i32) -> Frame {
    Frame { parts: vec![part(Window { x_min: 0, y_min: 0, x_max: width - 1, y_max: height - 1 })] }
}

/// Reads standard error of a run up to the first line of its progress: a frame has been read, what follows is work. What
/// it says from there on.
pub fn at_work(process: &mut Child) -> BufReader<ChildStderr> {
    let mut said = BufReader::new(process.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("Progress: ") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "ended before it said anything");
    }
    said
}

/// Sends a signal, such as `-TERM`, to a process.
pub fn send(signal: &str, process: u32) {
    assert!(
        std::process::Command::new("kill").args([signal, &process.to_string()]).status().unwrap().success()
    );
}

/// The values of a channel of the first part.
pub fn values(frame: &Frame, name: &str) -> Vec<f32> {
    let channel = frame.parts[0].channels.iter().find(|channel| channel.name == name.as_bytes()).unwrap();
    channel.samples.as_f32()
}

/// The bytes of a file.
pub fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

/// Sets a file's time of last change to that many seconds ago.
pub fn age(path: &Path, seconds: u64) {
    let time = std::time::SystemTime::now() - std::time::Duration::from_secs(seconds);
    std::fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
}
