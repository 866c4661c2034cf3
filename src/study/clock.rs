//! The time that a thread kept a processor busy: what other processes do does not count.

/// Processor seconds of the calling thread since some moment.
#[cfg(unix)]
pub fn busy() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

/// Seconds since some moment, by the clock on the wall: there is no other here.
#[cfg(not(unix))]
pub fn busy() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}
