//! One core for each end of a round trip. Where the kernel puts two processes that wake each other
//! changes their round trip several times over, and would drown what is compared.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// The first and the last core that this process may use: no siblings where there are more than
/// two. Dropped, the calling thread may use all again.
pub(crate) struct Cores {
    all: CpuSet,
    first: CpuSet,
    last: CpuSet,
}

impl Cores {
    /// Keeps the calling thread on the first core. With one core, or a kernel that does not say,
    /// everybody stays where they may be.
    pub(crate) fn take() -> Option<Cores> {
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

/// Starts processes, which inherit the core, on the last core.
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
