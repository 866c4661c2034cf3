//! How many threads work.

/// The number of threads for `--threads asked`, where 0 means all that the process may use: its affinity and, on Linux,
/// the CPU quota of its cgroup (version 1 and 2), both of which the standard library asks for, and no more than
/// `SLURM_CPUS_PER_TASK`. What was asked for is taken up to 64, or 4 for each processor where that is more.
pub fn count(asked: usize) -> usize {
    let granted = std::env::var("SLURM_CPUS_PER_TASK").ok();
    resolve(asked, available(), granted.as_deref())
}

fn available() -> usize {
    std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

/// Thousands of threads on a few processors wait for each other without an end.
fn most(available: usize) -> usize {
    (4 * available).max(64)
}

fn resolve(asked: usize, available: usize, granted: Option<&str>) -> usize {
    if asked > 0 {
        return asked.min(most(available));
    }
    let granted = granted.and_then(|text| text.trim().parse().ok()).filter(|&cpus: &usize| cpus > 0);
    granted.map_or(available, |granted| granted.min(available))
}

/// Makes the pool that all parallel loops use.
pub fn start(asked: usize) -> Result<usize, String> {
    let threads = count(asked);
    if asked > threads {
        tracing::warn!(
            "--threads {asked}: {threads} are the most that are of use here, and as many are taken"
        );
    }
    lacuna_filters::share_heaps(threads);
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .thread_name(|index| format!("lacuna-{index}"))
        .build_global()
        .map(|()| threads)
        .map_err(|error| format!("cannot start {threads} threads: {error}"))
}

#[cfg(test)]
mod tests {
    use super::resolve;

    #[test]
    fn what_was_asked_for_goes_first_then_the_grant_then_what_there_is() {
        assert_eq!(resolve(5, 2, Some("3")), 5);
        assert_eq!(resolve(5000, 2, None), 64);
        assert_eq!(resolve(5000, 100, None), 400);
        assert_eq!(resolve(0, 8, Some("3")), 3);
        assert_eq!(resolve(0, 2, Some("3")), 2);
        assert_eq!(resolve(0, 8, None), 8);
        for nonsense in ["", "0", "x", "-1"] {
            assert_eq!(resolve(0, 8, Some(nonsense)), 8);
        }
    }
}
