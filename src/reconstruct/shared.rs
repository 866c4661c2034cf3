//! Plans shared among frames.
//!
//! Without a bound on memory one store serves all frames. With one, plans of masks that do not come back must not pile
//! up: only the plans of the last frame's masks are kept beside those of the frames on the way.

use std::sync::{Arc, Mutex, PoisonError};

use lacuna_filters::Mask;

use crate::mask::Masks;
use crate::reconstruct::Plans;

/// The masks of a frame, per part and channel.
type FrameMasks = Vec<Vec<Option<Arc<Mask>>>>;

/// Where a frame finds its plans.
pub enum SharedPlans {
    /// One store for all.
    All(Arc<Plans>),
    /// The store of the last frame, for frames with the same masks.
    Last(Mutex<Option<(FrameMasks, Arc<Plans>)>>),
}

impl SharedPlans {
    /// Plans for many frames, with memory bounded or not.
    pub fn new(bounded: bool) -> Self {
        if bounded { Self::Last(Mutex::default()) } else { Self::All(Arc::default()) }
    }

    /// The plans of a frame.
    pub fn of(&self, masks: &Masks) -> Arc<Plans> {
        let last = match self {
            Self::All(plans) => return Arc::clone(plans),
            Self::Last(last) => last,
        };
        let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, plans)) = &*last
            && *known == masks.channels
        {
            return Arc::clone(plans);
        }
        let plans = Arc::new(Plans::new());
        *last = Some((masks.channels.clone(), Arc::clone(&plans)));
        plans
    }
}

#[cfg(test)]
mod tests {
    use lacuna_filters::Size;

    use super::*;

    fn masks(at: usize) -> Masks {
        let mask = Mask::from_fn(Size::new(2, 2), |y, x| 2 * y + x == at);
        Masks { channels: vec![vec![Some(Arc::new(mask)), None]], ..Masks::default() }
    }

    #[test]
    fn a_bounded_store_keeps_the_last_masks_only() {
        let plans = SharedPlans::new(true);
        let first = plans.of(&masks(0));
        assert!(Arc::ptr_eq(&first, &plans.of(&masks(0))));
        let second = plans.of(&masks(1));
        assert!(!Arc::ptr_eq(&first, &second));
        assert_eq!(Arc::strong_count(&first), 1);
        assert!(Arc::ptr_eq(&second, &plans.of(&masks(1))));
    }

    #[test]
    fn an_unbounded_store_is_one() {
        let plans = SharedPlans::new(false);
        assert!(Arc::ptr_eq(&plans.of(&masks(0)), &plans.of(&masks(1))));
    }
}
