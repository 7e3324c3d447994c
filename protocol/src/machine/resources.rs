//! Resources that a new port or connection needs and that a process may exhaust: file descriptors and address
//! space. iceoryx2 reports a failure without its cause, so the cause is probed.

use std::fs::File;
use std::io;

use iceoryx2::port::DegradationAction;
use rustix::mm::{MapFlags, ProtFlags, mmap_anonymous, munmap};

/// Size of the probed mapping, bytes; larger than that of any connection.
const PROBE_BYTES: usize = 4 << 20;

/// Returns the reason if this process can open no file or map no memory now; `None` if it can do both.
pub fn find_missing_resource() -> Option<io::Error> {
    if let Err(error) = File::open("/dev/null") {
        return Some(error);
    }
    // SAFETY: a new mapping at an address that the kernel chooses; nothing else refers to it.
    match unsafe {
        mmap_anonymous(std::ptr::null_mut(), PROBE_BYTES, ProtFlags::READ, MapFlags::PRIVATE)
    } {
        Ok(address) => {
            // SAFETY: mapped above with this length, and used by no code.
            let _ = unsafe { munmap(address, PROBE_BYTES) };
            None
        }
        Err(error) => Some(error.into()),
    }
}

/// Decides what to do if a port cannot connect to another process. A process that has just exited is skipped. If
/// this process lacks resources, it would silently receive nothing from the other one: that is an error.
pub(crate) fn handle_failed_connection() -> DegradationAction {
    match find_missing_resource() {
        None => DegradationAction::Warn,
        Some(error) => {
            let remedy = match error.raw_os_error() {
                Some(libc::EMFILE) => "; raise the limit by `ulimit -n`",
                Some(libc::ENOMEM) => "; raise the limit by `ulimit -v`, or free memory",
                _ => "",
            };
            tracing::error!("cannot connect to another process: {error}{remedy}");
            DegradationAction::DegradeAndFail
        }
    }
}
