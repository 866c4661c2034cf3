//! What the log says of how a solver ended.

use lacuna_filters::upscale::{Method, Sampling};
use lacuna_filters::{Outcome, Stop};

use crate::reconstruct::{Enlarge, Report};

/// A distance from the input that shows; true frames of Gaussian pixels are nearer at whole factors, but at the hardest edges.
const SHOWS: f64 = 0.01;

/// Lines for the log.
pub fn notes(report: &Report, enlarge: Option<&Enlarge>) -> Vec<String> {
    let Some(outcome) = report.outcome else { return Vec::new() };
    let off = enlarge.and_then(|asked| off_input(outcome, asked));
    early(outcome, enlarge).into_iter().chain(off).collect()
}

/// What is to be said of a solver that stopped before it converged.
fn early(outcome: Outcome, enlarge: Option<&Enlarge>) -> Option<String> {
    let why = match outcome.stop {
        Stop::Converged | Stop::Cancelled => return None,
        Stop::IterationLimit => "the limit of iterations",
        Stop::TimeLimit => "--time-limit",
    };
    let distance = match (outcome.gap, outcome.residual) {
        (Some(gap), _) => format!(", relative gap {gap:.1e}"),
        (None, Some(residual)) => format!(", residual {residual:.1e}"),
        (None, None) => String::new(),
    };
    let is_tv = enlarge.is_some_and(|asked| matches!(asked.method, Method::Tv(_)));
    let remedy = if is_tv && outcome.stop == Stop::IterationLimit {
        "; --tv-iterations allows more, a larger --tv-gap needs fewer"
    } else {
        ""
    };
    Some(format!(
        "stopped by {why} after {} iterations{distance}: the best image so far is written{remedy}",
        outcome.iterations
    ))
}

/// What is to be said of bounds that keep an enlarged frame from its input.
fn off_input(outcome: Outcome, asked: &Enlarge) -> Option<String> {
    let off = outcome.off_input.filter(|off| *off >= SHOWS)?;
    let remedy = match (&asked.method, asked.sampling) {
        // What straddles hard edges at broken factors is far off in frames that are right, too.
        (Method::Ss, None | Some(Sampling::Box)) => return None,
        (_, None | Some(Sampling::Box)) => "--filter ss takes whole pixels",
        _ => "if the renderer's filter is not this one, --sampling box comes nearer",
    };
    Some(format!(
        "reduced again, it is off its input by up to {off:.1e} of the largest value, as bounds go first beside hard edges; {remedy}"
    ))
}

#[cfg(test)]
mod tests {
    use lacuna_filters::variational::tv::Settings;

    use super::*;
    use crate::reconstruct::Target;

    fn asked(method: Method, sampling: Option<Sampling>) -> Enlarge {
        let target = Target::Scale { x: 1.5, y: 1.5 };
        Enlarge { target, method, sampling, take_guides: false, keep_vectors: false }
    }

    fn report(outcome: Outcome) -> Report {
        Report { outcome: Some(outcome), ..Report::default() }
    }

    const STOPPED: Outcome = Outcome { stop: Stop::IterationLimit, iterations: 9, ..Outcome::direct() };

    #[test]
    fn what_can_be_done_is_said() {
        let tv = asked(Method::Tv(Settings::default()), None);
        let said = notes(&report(Outcome { gap: Some(0.1), off_input: Some(0.02), ..STOPPED }), Some(&tv));
        assert!(said.len() == 2 && said[0].contains("--tv-iterations") && said[1].contains("--filter ss"));
        let mitchell = asked(Method::Ss, Some(Sampling::Mitchell));
        let off = |off| Outcome { off_input: Some(off), ..Outcome::direct() };
        assert!(notes(&report(off(1.6e-4)), Some(&mitchell)).is_empty());
        let said = notes(&report(off(0.02)), Some(&mitchell));
        assert!(said[0].contains("up to 2.0e-2") && said[0].contains("--sampling box"), "{said:?}");
        assert!(notes(&report(off(0.2)), Some(&asked(Method::Ss, None))).is_empty());
        let said = notes(&report(Outcome { residual: Some(0.02), ..STOPPED }), None);
        assert!(said.len() == 1 && said[0].contains("after 9 iterations, residual 2.0e-2"), "{said:?}");
    }
}
