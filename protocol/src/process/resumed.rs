//! Whether a process goes on after it was stopped. What it then finds late, nobody's machine made so.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::SIGCONT;

/// Becomes true when the process goes on after a SIGSTOP.
#[derive(Debug, Clone)]
pub struct Resumed(Arc<AtomicBool>);

impl Resumed {
    /// A flag that SIGCONT sets. Waits it interrupts return early.
    pub fn on_signal() -> io::Result<Resumed> {
        let resumed = Resumed(Arc::default());
        signal_hook::flag::register(SIGCONT, resumed.0.clone())?;
        Ok(resumed)
    }

    /// Whether it went on since this was asked last.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_goes_on_is_told_once() {
        let resumed = Resumed::on_signal().unwrap();
        assert!(!resumed.take());
        signal_hook::low_level::raise(SIGCONT).unwrap();
        assert!(resumed.take());
        assert!(!resumed.take());
    }
}
