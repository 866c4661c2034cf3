//! What is said while a sequence runs: single lines on standard error, and a progress bar or the lines that a farm's
//! manager reads: `Progress: 45%` on standard error, or those of Open Job Description on standard output.

use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use tracing::field::{Field, Visit};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

/// Between two lines of progress that nobody asked for.
const PAUSE: Duration = Duration::from_secs(1);

/// How much is said.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// Errors, warnings, progress and the sum of the run.
    #[default]
    Normal,
    /// A line for every frame as well.
    Verbose,
}

/// How progress is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Meter {
    /// A bar on a terminal, elsewhere as `Plain`, but one line in a second at most; nothing if quiet.
    #[default]
    Auto,
    /// `Progress: 45%`, a line for each percent, on standard error.
    Plain,
    /// `openjd_progress: 45` on standard output, and `openjd_status` and `openjd_fail` with what is said.
    OpenJd,
    /// Not at all.
    None,
}

/// The place where everything is said, so that lines and bar do not run into each other.
#[derive(Debug)]
pub struct Console {
    verbosity: Verbosity,
    meter: Meter,
    progress: Mutex<Progress>,
}

#[derive(Debug, Default)]
struct Progress {
    total: u64,
    done: u64,
    percent: Option<u64>,
    told: Option<Instant>,
    bar: Option<ProgressBar>,
}

impl Console {
    /// A console that says that much.
    pub fn new(verbosity: Verbosity) -> Arc<Self> {
        Self::with(verbosity, Meter::Auto)
    }

    /// The same, with progress told in that way.
    pub fn with(verbosity: Verbosity, meter: Meter) -> Arc<Self> {
        Arc::new(Self { verbosity, meter, progress: Mutex::default() })
    }

    /// Takes the warnings of the whole process; later calls do nothing.
    pub fn listen(self: &Arc<Self>) {
        let subscriber = tracing_subscriber::registry().with(Listener(Arc::clone(self)));
        // Only a second console in one process (in tests) finds the place taken.
        drop(tracing::subscriber::set_global_default(subscriber));
    }

    /// `lacuna: error: TEXT`.
    pub fn error(&self, text: &str) {
        self.line(&format!("lacuna: error: {text}"));
        self.to_openjd("fail", text);
    }

    /// `lacuna: warning: TEXT`, unless quiet.
    pub fn warning(&self, text: &str) {
        if self.verbosity > Verbosity::Quiet {
            self.line(&format!("lacuna: warning: {text}"));
        }
    }

    /// `lacuna: TEXT`, unless quiet.
    pub fn note(&self, text: &str) {
        if self.verbosity > Verbosity::Quiet {
            self.line(&format!("lacuna: {text}"));
            self.to_openjd("status", text);
        }
    }

    /// `lacuna: TEXT`, if verbose.
    pub fn detail(&self, text: &str) {
        if self.verbosity > Verbosity::Normal {
            self.line(&format!("lacuna: {text}"));
        }
    }

    /// Begins to show progress, of which `steps` make the whole.
    pub fn begin(&self, steps: u64) {
        let mut progress = self.progress();
        *progress = Progress { total: steps, ..Progress::default() };
        let quiet = self.verbosity == Verbosity::Quiet;
        if self.meter != Meter::Auto || quiet || !std::io::stderr().is_terminal() {
            return;
        }
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{wide_bar} {percent:>3}% {elapsed} < {eta}") {
            bar.set_style(style);
        }
        bar.enable_steady_tick(Duration::from_millis(250));
        progress.bar = Some(bar);
    }

    /// `steps` more are done.
    pub fn advance(&self, steps: u64) {
        let mut progress = self.progress();
        progress.done = (progress.done + steps).min(progress.total);
        if let Some(bar) = &progress.bar {
            bar.set_position(progress.done);
        } else if let Some(percent) = (progress.done * 100).checked_div(progress.total)
            && progress.percent != Some(percent)
        {
            progress.percent = Some(percent);
            if self.meter != Meter::Auto
                || percent == 100
                || progress.told.is_none_or(|told| told.elapsed() >= PAUSE)
            {
                progress.told = Some(Instant::now());
                self.percent(percent);
            }
        }
    }

    /// What was asked for is told to a quiet run's reader too.
    fn percent(&self, percent: u64) {
        match self.meter {
            Meter::Plain => write_line(&format!("Progress: {percent}%")),
            Meter::Auto if self.verbosity > Verbosity::Quiet => write_line(&format!("Progress: {percent}%")),
            Meter::OpenJd => self.to_openjd("progress", &percent.to_string()),
            Meter::Auto | Meter::None => {}
        }
    }

    /// `openjd_WHAT: TEXT` on standard output, if that is how progress is told.
    fn to_openjd(&self, what: &str, text: &str) {
        if self.meter == Meter::OpenJd {
            openjd(what, text);
        }
    }

    /// Takes the bar away.
    pub fn end(&self) {
        if let Some(bar) = self.progress().bar.take() {
            bar.finish_and_clear();
        }
    }

    fn line(&self, text: &str) {
        let text = one_line(text);
        match &self.progress().bar {
            Some(bar) => bar.suspend(|| write_line(&text)),
            None => write_line(&text),
        }
    }

    fn progress(&self) -> std::sync::MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A file and its frame number, for people: `shot.0012.exr (frame 12)`.
pub fn label(file: &Path, number: Option<i64>) -> String {
    let mut name = file.display().to_string();
    // Spaces at its ends and the mark of an encoding would not be seen.
    if name.trim() != name || name.contains('\u{feff}') {
        name = format!("'{name}'");
    }
    number.map_or_else(|| name.clone(), |number| format!("{name} (frame {number})"))
}

/// `openjd_fail: TEXT` on standard output, for what ends a run before it has a console.
pub fn openjd_fail(text: &str) {
    openjd("fail", text);
}

fn openjd(what: &str, text: &str) {
    // Nobody is left to tell if standard output is closed.
    drop(writeln!(std::io::stdout().lock(), "openjd_{what}: {}", one_line(text)));
}

/// Nobody is left to tell if standard error is closed.
fn write_line(text: &str) {
    drop(writeln!(std::io::stderr().lock(), "{text}"));
}

/// Control characters, line ends above all, become spaces.
fn one_line(text: &str) -> String {
    text.trim_end().replace(|c: char| c.is_control(), " ")
}

/// The span that says which frame is worked on; warnings inside it name its file.
pub fn frame_span(file: &Path, number: Option<i64>) -> tracing::Span {
    tracing::error_span!("frame", label = label(file, number))
}

struct Listener(Arc<Console>);

/// The label of a frame's span.
struct Label(String);

impl<S: tracing::Subscriber + for<'a> LookupSpan<'a>> Layer<S> for Listener {
    fn enabled(&self, metadata: &tracing::Metadata<'_>, _: Context<'_, S>) -> bool {
        metadata.target().starts_with("lacuna")
    }

    fn on_new_span(
        &self,
        attributes: &tracing::span::Attributes<'_>,
        id: &tracing::Id,
        context: Context<'_, S>,
    ) {
        let mut texts = Texts::default();
        attributes.record(&mut texts);
        if let (Some(span), false) = (context.span(id), texts.label.is_empty()) {
            span.extensions_mut().insert(Label(texts.label));
        }
    }

    fn on_event(&self, event: &tracing::Event<'_>, context: Context<'_, S>) {
        let mut texts = Texts::default();
        event.record(&mut texts);
        let label = context.event_scope(event).and_then(|mut scope| {
            scope.find_map(|span| span.extensions().get::<Label>().map(|label| label.0.clone()))
        });
        let text = match label {
            Some(label) => format!("{label}: {}{}", texts.message, texts.others),
            None => format!("{}{}", texts.message, texts.others),
        };
        match *event.metadata().level() {
            tracing::Level::ERROR => self.0.error(&text),
            tracing::Level::WARN => self.0.warning(&text),
            tracing::Level::INFO => self.0.note(&text),
            _ => self.0.detail(&text),
        }
    }
}

#[derive(Default)]
struct Texts {
    message: String,
    label: String,
    others: String,
}

impl Visit for Texts {
    fn record_str(&mut self, field: &Field, value: &str) {
        if field.name() == "label" {
            value.clone_into(&mut self.label);
        } else {
            self.record_debug(field, &format_args!("{value}"));
        }
    }

    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        if field.name() == "message" {
            self.message = format!("{value:?}");
        } else {
            let other = format!(" {}={value:?}", field.name());
            self.others.push_str(&other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_one_line() {
        assert_eq!(one_line("a\nb\tc\u{1b}[0m\n"), "a b c [0m");
        assert_eq!(one_line("größe\n"), "größe");
    }

    #[test]
    fn labels_name_file_and_frame() {
        assert_eq!(label(Path::new("a b.exr"), None), "a b.exr");
        assert_eq!(label(Path::new("s.0012.exr"), Some(12)), "s.0012.exr (frame 12)");
    }
}
