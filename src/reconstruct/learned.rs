//! Which groups of channels a dictionary is for: R, G and B of a layer together, in that order, or each alone for a grey one. All
//! others are filled by smoothness splines.

use std::borrow::Cow;
use std::sync::Arc;

use lacuna_exr::Part;
use lacuna_filters::Method;
use lacuna_filters::variational::ss;

use super::Job;
use super::groups::Group;
use crate::dictionary::training::component;

/// The groups with the job that fills each; those of methods without a dictionary are as they were.
pub fn assign<'a>(part: &Part, groups: Vec<Group>, job: &'a Job) -> Vec<(Group, Cow<'a, Job>)> {
    let Method::Dictionary(learned) = &job.method else {
        return groups.into_iter().map(|group| (group, Cow::Borrowed(job))).collect();
    };
    let splines = || Cow::Owned(Job { method: Method::Ss(ss::Settings::default()), ..job.clone() });
    let mut assigned = Vec::new();
    for group in groups {
        let (taken, rest) = match learned.dictionary.channels() {
            _ if !group.light => (Vec::new(), group.channels.clone()),
            1 => (group.channels.clone(), Vec::new()),
            3 => triple(part, &group.channels),
            _ => (Vec::new(), group.channels.clone()),
        };
        let (light, normal) = (group.light, group.normal);
        let of = |channels| Group { channels, mask: Arc::clone(&group.mask), light, normal };
        assigned.extend((!taken.is_empty()).then(|| (of(taken), Cow::Borrowed(job))));
        assigned.extend((!rest.is_empty()).then(|| (of(rest), splines())));
    }
    assigned
}

/// R, G and B of the channels, in that order, if there is one of each; and the others.
fn triple(part: &Part, channels: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let place = |at: &usize| {
        let name = part.channels.get(*at)?.display_name();
        component(&name)
    };
    let found = [0, 1, 2].map(|wanted| channels.iter().copied().find(|at| place(at) == Some(wanted)));
    let [Some(r), Some(g), Some(b)] = found else { return (Vec::new(), channels.to_vec()) };
    let rest = channels.iter().copied().filter(|at| ![r, g, b].contains(at)).collect();
    (vec![r, g, b], rest)
}
