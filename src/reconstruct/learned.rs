//! Which groups of channels a dictionary is for: R, G and B of a layer together, in that order, or each alone for a grey one. All
//! others are filled by the default method.

use lacuna_exr::Part;
use lacuna_filters::Method;
use lacuna_filters::fill::Values;

use super::groups::Group;
use crate::channels::rgb_place;

/// The groups with the method that fills each; those of methods that take any planes are as they were.
pub fn assign(part: &Part, groups: Vec<Group>, method: &Method) -> Vec<(Group, Method)> {
    if !method.descriptor().takes.dictionary {
        return groups.into_iter().map(|group| (group, method.clone())).collect();
    }
    let mut assigned = Vec::new();
    for group in groups {
        let (taken, rest) = match method.planes() {
            _ if group.values != Values::Light => (Vec::new(), group.channels.clone()),
            None => (group.channels.clone(), Vec::new()),
            Some(3) => triple(part, &group.channels),
            Some(_) => (Vec::new(), group.channels.clone()),
        };
        let of = |channels| Group { channels, ..group.clone() };
        assigned.extend((!taken.is_empty()).then(|| (of(taken), method.clone())));
        assigned.extend((!rest.is_empty()).then(|| (of(rest), Method::default())));
    }
    assigned
}

/// R, G and B of the channels, in that order, if there is one of each; and the others.
fn triple(part: &Part, channels: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let place = |at: &usize| {
        let name = part.channels.get(*at)?.display_name();
        rgb_place(&name)
    };
    let found = [0, 1, 2].map(|wanted| channels.iter().copied().find(|at| place(at) == Some(wanted)));
    let [Some(r), Some(g), Some(b)] = found else { return (Vec::new(), channels.to_vec()) };
    let rest = channels.iter().copied().filter(|at| ![r, g, b].contains(at)).collect();
    (vec![r, g, b], rest)
}
