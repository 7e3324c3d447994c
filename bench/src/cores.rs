//! CPU pinning: one core for each end of a round trip. The kernel's placement of two processes that wake each other
//! changes their round trip several times over, more than the differences that the bench measures.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// First and last core of this process's affinity mask; with more than two cores they are usually not hyper-threading
/// siblings. Dropping it restores the mask of the calling thread.
pub(crate) struct PinnedCores {
    all_cores: CpuSet,
    first_core: CpuSet,
    last_core: CpuSet,
}

impl PinnedCores {
    /// Pins the calling thread to the first core. `None`, without pinning, if there is only one core or if the
    /// affinity mask cannot be read or set.
    pub(crate) fn pin_to_first() -> Option<PinnedCores> {
        let all_cores = sched_getaffinity(None).ok()?;
        let mut usable_cores = (0..CpuSet::MAX_CPU).filter(|&core| all_cores.is_set(core));
        let (first, last) = (usable_cores.next()?, usable_cores.next_back()?);
        let [first, last] = [first, last].map(|core| {
            let mut set = CpuSet::new();
            set.set(core);
            set
        });
        let cores = PinnedCores { all_cores, first_core: first, last_core: last };
        pin_to(&cores.first_core).then_some(cores)
    }
}

/// Calls `start` with the calling thread on the last core, which the started processes inherit, then moves the thread
/// back to the first core. Without pinned cores it only calls `start`.
pub(crate) fn start_on_last_core<T>(cores: Option<&PinnedCores>, start: impl FnOnce() -> T) -> T {
    let Some(PinnedCores { first_core, last_core, .. }) = cores else {
        return start();
    };
    pin_to(last_core);
    let result = start();
    pin_to(first_core);
    result
}

/// Sets the affinity mask of the calling thread; returns whether it succeeded.
fn pin_to(cores: &CpuSet) -> bool {
    sched_setaffinity(None, cores).is_ok()
}

impl Drop for PinnedCores {
    fn drop(&mut self) {
        pin_to(&self.all_cores);
    }
}
