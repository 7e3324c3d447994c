//! Separate cores for the two ends of a round trip. The kernel's placement of two processes that wake each
//! other changes the round trip several times over, which would hide the differences of interest.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// First and last usable core; with more than two, they are not siblings. Dropping the value lets the
/// calling thread use all cores again.
pub(crate) struct Cores {
    all: CpuSet,
    first: CpuSet,
    last: CpuSet,
}

impl Cores {
    /// Pins the calling thread to the first core. Returns `None`, without pinning, with one core or if the
    /// kernel does not report them.
    pub(crate) fn pin_this_thread() -> Option<Cores> {
        let all = sched_getaffinity(None).ok()?;
        let mut usable = (0..CpuSet::MAX_CPU).filter(|&core| all.is_set(core));
        let (first, last) = (usable.next()?, usable.next_back()?);
        let [first, last] = [first, last].map(|core| {
            let mut set = CpuSet::new();
            set.set(core);
            set
        });
        let cores = Cores { all, first, last };
        stay_on(&cores.first).then_some(cores)
    }
}

/// Calls `start` so that the processes it starts inherit the last core.
pub(crate) fn on_the_last<T>(cores: Option<&Cores>, start: impl FnOnce() -> T) -> T {
    let Some(Cores { first, last, .. }) = cores else { return start() };
    stay_on(last);
    let started = start();
    stay_on(first);
    started
}

fn stay_on(set: &CpuSet) -> bool {
    sched_setaffinity(None, set).is_ok()
}

impl Drop for Cores {
    fn drop(&mut self) {
        stay_on(&self.all);
    }
}
