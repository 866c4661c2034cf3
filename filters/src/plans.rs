//! Plans that depend on the mask alone, kept for the groups and frames that have an equal one.

use std::sync::{Arc, Mutex, PoisonError};

use crate::baseline::depth::DepthPlan;
use crate::baseline::nearest::NearestMap;
use crate::{Error, Mask, Method, Plan, Plane, Problem, Run, upscale};

/// How many plans are kept.
const MOST: usize = 4;

/// Method and settings, mask, weights, plan.
type FilterEntry = (String, Arc<Mask>, Option<Arc<Plane>>, Arc<dyn Plan>);

/// Geometry, method, plan.
type EnlargeEntry = ((upscale::Geometry, upscale::Method), Arc<upscale::Plan>);

/// A bounded, thread-safe store of the last plans.
///
/// Two threads that miss at the same time both make the plan: waiting for each other inside a thread pool could
/// make a thread wait for itself.
#[derive(Default)]
pub struct Plans {
    filters: Mutex<Vec<FilterEntry>>,
    nearest: Mutex<Vec<(Arc<Mask>, Arc<NearestMap>)>>,
    depth: Mutex<Vec<(Arc<Mask>, Arc<DepthPlan>)>>,
    enlarge: Mutex<Vec<EnlargeEntry>>,
}

impl std::fmt::Debug for Plans {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Plans").finish_non_exhaustive()
    }
}

impl Plans {
    /// An empty store.
    pub fn new() -> Self {
        Self::default()
    }

    /// The plan of a method on a mask, with the weights of the samples if they have any.
    pub fn filter(
        &self,
        method: &Method,
        mask: &Arc<Mask>,
        weights: Option<&Arc<Plane>>,
        run: &Run<'_>,
    ) -> Result<Arc<dyn Plan>, Error> {
        let key = format!("{} {}", method.name(), method.settings());
        let same =
            |entry: &FilterEntry| entry.0 == key && equal(&entry.1, mask) && entry.2.as_ref() == weights;
        if let Some(found) = recall(&self.filters, same) {
            return Ok(found.3);
        }
        let mut problem = Problem::fill(Arc::clone(mask));
        problem.weights = weights.cloned();
        let plan: Arc<dyn Plan> = method.filter().plan(&problem, run)?.into();
        if run.interrupted().is_none() {
            store(&self.filters, (key, Arc::clone(mask), weights.cloned(), Arc::clone(&plan)));
        }
        Ok(plan)
    }

    /// The plan of an enlargement.
    pub fn enlarge(
        &self,
        geometry: upscale::Geometry,
        method: upscale::Method,
    ) -> Result<Arc<upscale::Plan>, Error> {
        if let Some(found) = recall(&self.enlarge, |entry| entry.0 == (geometry, method)) {
            return Ok(found.1);
        }
        let plan = Arc::new(upscale::Plan::new(geometry, method)?);
        store(&self.enlarge, ((geometry, method), Arc::clone(&plan)));
        Ok(plan)
    }

    /// Which measured pixel is nearest to each pixel of a mask.
    pub fn nearest(&self, mask: &Arc<Mask>) -> Result<Arc<NearestMap>, Error> {
        if let Some(found) = recall(&self.nearest, |entry| equal(&entry.0, mask)) {
            return Ok(found.1);
        }
        let map = Arc::new(NearestMap::new(mask)?);
        store(&self.nearest, (Arc::clone(mask), Arc::clone(&map)));
        Ok(map)
    }

    /// What the depth rule knows of a mask.
    pub fn depth(&self, mask: &Arc<Mask>) -> Result<Arc<DepthPlan>, Error> {
        if let Some(found) = recall(&self.depth, |entry| equal(&entry.0, mask)) {
            return Ok(found.1);
        }
        let plan = Arc::new(DepthPlan::new(mask)?);
        store(&self.depth, (Arc::clone(mask), Arc::clone(&plan)));
        Ok(plan)
    }
}

fn equal(a: &Arc<Mask>, b: &Arc<Mask>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

/// The entry that matches; it becomes the newest.
fn recall<T: Clone>(entries: &Mutex<Vec<T>>, same: impl Fn(&T) -> bool) -> Option<T> {
    let mut entries = entries.lock().unwrap_or_else(PoisonError::into_inner);
    let at = entries.iter().position(same)?;
    let entry = entries.remove(at);
    entries.push(entry.clone());
    Some(entry)
}

fn store<T>(entries: &Mutex<Vec<T>>, entry: T) {
    let mut entries = entries.lock().unwrap_or_else(PoisonError::into_inner);
    if entries.len() >= MOST {
        entries.remove(0);
    }
    entries.push(entry);
}

#[cfg(test)]
mod tests {
    use crate::{Size, baseline::push_pull};

    use super::*;

    #[test]
    fn equal_masks_share_a_plan_and_few_are_kept() {
        let mask = |at| Arc::new(Mask::from_fn(Size::new(3, 3), |y, x| y * 3 + x == at));
        let method = Method::from(push_pull::Settings);
        let plans = Plans::new();
        let run = Run::default();
        let first = plans.filter(&method, &mask(0), None, &run).unwrap();
        assert!(Arc::ptr_eq(&first, &plans.filter(&method, &mask(0), None, &run).unwrap()));
        for at in 1..=MOST {
            plans.filter(&method, &mask(at), None, &run).unwrap();
        }
        assert!(!Arc::ptr_eq(&first, &plans.filter(&method, &mask(0), None, &run).unwrap()));
        assert!(Arc::ptr_eq(&plans.nearest(&mask(2)).unwrap(), &plans.nearest(&mask(2)).unwrap()));
    }
}
