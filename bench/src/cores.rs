//! One core for each end of a round trip. Where the kernel puts two processes that wake each other
//! changes their round trip several times over, and would drown what is compared.

use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

/// The first and the last core that this process may use: no siblings where there are more than
/// two. Dropped, the calling thread may use all again.
pub(crate) struct Cores {
    all: CpuSet,
    here: CpuSet,
    there: CpuSet,
}

impl Cores {
    /// Keeps the calling thread on the first core. With one core, or a kernel that does not say,
    /// everybody stays where they may be.
    pub(crate) fn take() -> Option<Cores> {
        let all = sched_getaffinity(None).ok()?;
        let (first, last) = (usable(&all).next()?, usable(&all).next_back()?);
        let cores = Cores { all, here: alone(first), there: alone(last) };
        (first != last && stay_on(&cores.here)).then_some(cores)
    }
}

/// Starts processes, which inherit the core, on the other core.
pub(crate) fn on_the_other<T>(cores: Option<&Cores>, start: impl FnOnce() -> T) -> T {
    let Some(Cores { here, there, .. }) = cores else { return start() };
    stay_on(there);
    let started = start();
    stay_on(here);
    started
}

/// Keeps the calling thread on the last core that it may use.
pub(crate) fn stay_on_the_last() -> rustix::io::Result<()> {
    let all = sched_getaffinity(None)?;
    let last = usable(&all).next_back().expect("the thread is on one");
    sched_setaffinity(None, &alone(last))
}

fn usable(all: &CpuSet) -> impl DoubleEndedIterator<Item = usize> {
    (0..CpuSet::MAX_CPU).filter(|&core| all.is_set(core))
}

fn alone(core: usize) -> CpuSet {
    let mut set = CpuSet::new();
    set.set(core);
    set
}

fn stay_on(set: &CpuSet) -> bool {
    sched_setaffinity(None, set).is_ok()
}

impl Drop for Cores {
    fn drop(&mut self) {
        stay_on(&self.all);
    }
}
