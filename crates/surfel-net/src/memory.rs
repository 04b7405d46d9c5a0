//! What a network asks of the allocator: to keep memory that was freed.
//!
//! A pass frees and asks for maps of megabytes hundreds of times; glibc gives each back to the system, which then
//! clears every page of the next. Invariant: results do not depend on it, only time and resident memory.

/// Keeps freed memory for the next request, for the rest of the process; a program calls it first. Where the
/// allocator is not glibc's, nothing changes.
pub fn keep_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    glibc::keep();
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod glibc {
    /// The largest threshold that older versions accept, bytes.
    const CAUTIOUS: i32 = 32 << 20;

    #[allow(unsafe_code)]
    pub(super) fn keep() {
        // SAFETY: `mallopt` takes plain numbers, may be called at any time from any thread, and refuses by a zero.
        let set = |parameter, value| unsafe { libc::mallopt(parameter, value) } != 0;
        // Either of these also ends the thresholds' own growth, so both are needed.
        if !set(libc::M_MMAP_THRESHOLD, i32::MAX) {
            set(libc::M_MMAP_THRESHOLD, CAUTIOUS);
        }
        set(libc::M_TRIM_THRESHOLD, i32::MAX);
    }
}
