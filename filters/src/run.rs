//! How to run: never changes the result, unless it stops it early.

use crate::Stop;

/// How a reconstruction is to be run. Threads are those of the rayon pool that the caller is in.
#[derive(Clone, Copy, Default)]
pub struct Run<'a> {
    /// Asked between iterations: `Some(stop)` ends the solver with the best image so far and that outcome.
    pub interrupt: Option<&'a (dyn Fn() -> Option<Stop> + Sync)>,
}

impl Run<'_> {
    /// Whether the caller wants the solver to end, and why.
    pub fn interrupted(&self) -> Option<Stop> {
        self.interrupt.and_then(|ask| ask())
    }
}

impl std::fmt::Debug for Run<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Run").field("interrupt", &self.interrupt.is_some()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn asks_the_caller_who_may_be_silent() {
        assert_eq!(Run::default().interrupted(), None);
        let stop = || Some(Stop::TimeLimit);
        let run = Run { interrupt: Some(&stop) };
        assert_eq!(run.interrupted(), Some(Stop::TimeLimit));
        assert_eq!(format!("{run:?}"), "Run { interrupt: true }");
    }
}
