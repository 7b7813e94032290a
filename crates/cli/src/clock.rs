//! CPU time, for figures that other programs on the machine do not change much.

#[cfg(unix)]
fn clock_secs(id: nix::time::ClockId) -> f64 {
    nix::time::clock_gettime(id).map_or(0.0, |t| t.tv_sec() as f64 + 1e-9 * t.tv_nsec() as f64)
}

/// CPU time of the calling thread in seconds.
#[cfg(unix)]
pub fn thread_cpu_secs() -> f64 {
    clock_secs(nix::time::ClockId::CLOCK_THREAD_CPUTIME_ID)
}

/// CPU time of all threads in seconds.
#[cfg(unix)]
pub fn process_cpu_secs() -> f64 {
    clock_secs(nix::time::ClockId::CLOCK_PROCESS_CPUTIME_ID)
}

/// Seconds since the first call: systems without CPU clocks get wall time.
#[cfg(not(unix))]
pub fn thread_cpu_secs() -> f64 {
    static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
    START.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
}

/// Seconds since the first call: systems without CPU clocks get wall time.
#[cfg(not(unix))]
pub fn process_cpu_secs() -> f64 {
    thread_cpu_secs()
}
