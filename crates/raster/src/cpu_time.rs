//! Time that this thread spent computing.

use std::time::Duration;

/// CPU time of the calling thread. Differences are free of what other threads and programs do, unlike wall time.
///
/// Where the system does not tell (anything but Unix), the wall time since the first call.
pub fn thread_cpu_time() -> Duration {
    #[cfg(unix)]
    {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
        Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
    }
    #[cfg(not(unix))]
    {
        static START: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
        START.get_or_init(std::time::Instant::now).elapsed()
    }
}

#[cfg(test)]
mod tests {
    use super::thread_cpu_time;
    use std::time::Duration;

    #[cfg(unix)]
    #[test]
    fn sleeping_takes_no_cpu_time_and_working_does() {
        let start = thread_cpu_time();
        std::thread::sleep(Duration::from_millis(50));
        let slept = thread_cpu_time() - start;
        assert!(slept < Duration::from_millis(25), "{slept:?}");
        let mut x = 1u64;
        while thread_cpu_time() - start < Duration::from_millis(5) {
            x = std::hint::black_box(x.wrapping_mul(3));
        }
    }
}
