//! Who held a core while a robot that was due waited for it: a pure function of the switches between
//! threads, in order of time.

use std::collections::{BTreeMap, VecDeque};

/// So long a history of each core is kept, ns: nobody who waits longer is told about.
const HISTORY_NS: u64 = 2_000_000_000;
/// A wake-up is late if it comes this part of a period after its deadline, as the robots count.
const LATE_PART: u64 = 10;

/// From this moment on, a core runs this thread.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Switch {
    /// CLOCK_MONOTONIC, ns.
    pub t_ns: u64,
    pub core: usize,
    /// By the kernel's number; 0: nobody, the core is idle.
    pub thread: u32,
    pub process: u32,
}

/// What held cores for how long while robots waited, by process; 0: nobody, the core was idle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Held {
    /// Late wake-ups of which it held the core for the longest time.
    pub late: u64,
    /// For how long it did, over all late wake-ups, ns.
    pub held_ns: u64,
}

/// A robot's thread, with deadlines at the multiples of the period plus its phase.
#[derive(Debug)]
struct Watched {
    phase_ns: u64,
    /// When it ran last, ns: it sleeps until the first deadline after that.
    ran_until_ns: u64,
}

impl Watched {
    fn due_ns(&self, period_ns: u64) -> u64 {
        let periods = (self.ran_until_ns + period_ns).saturating_sub(self.phase_ns) / period_ns;
        periods * period_ns + self.phase_ns
    }
}

/// Takes switches, tells who held the cores.
#[derive(Debug)]
pub(super) struct Attribution {
    period_ns: u64,
    watched: BTreeMap<u32, Watched>,
    cores: Vec<VecDeque<Switch>>,
    held: BTreeMap<u32, Held>,
    late: u64,
}

impl Attribution {
    pub(super) fn new(period_ns: u64, cores: usize) -> Attribution {
        let cores = vec![VecDeque::new(); cores];
        Attribution { period_ns, cores, watched: BTreeMap::new(), held: BTreeMap::new(), late: 0 }
    }

    /// A robot's thread is due at multiples of the period plus this phase, from `now_ns` on.
    pub(super) fn watch(&mut self, thread: u32, phase_ns: u64, now_ns: u64) {
        let phase_ns = phase_ns % self.period_ns;
        self.watched.insert(thread, Watched { phase_ns, ran_until_ns: now_ns });
    }

    /// It is gone.
    pub(super) fn forget(&mut self, thread: u32) {
        self.watched.remove(&thread);
    }

    /// How many wake-ups were late.
    pub(super) fn late(&self) -> u64 {
        self.late
    }

    /// By process.
    pub(super) fn held(&self) -> &BTreeMap<u32, Held> {
        &self.held
    }

    /// Takes the next switch; each is at least as late as those before it. The processes that held the core
    /// while its thread waited, if that was a late wake-up.
    pub(super) fn take(&mut self, switch: Switch) -> Vec<u32> {
        let Some(core) = self.cores.get_mut(switch.core) else { return Vec::new() };
        if let Some(before) = core.back()
            && let Some(watched) = self.watched.get_mut(&before.thread)
        {
            watched.ran_until_ns = switch.t_ns;
        }
        let mut holders = Vec::new();
        if let Some(watched) = self.watched.get(&switch.thread) {
            let due_ns = watched.due_ns(self.period_ns);
            if switch.t_ns.saturating_sub(due_ns) > self.period_ns / LATE_PART {
                self.late += 1;
                holders = attribute(core, due_ns, switch.t_ns, &mut self.held);
            }
        }
        core.push_back(switch);
        while core.get(1).is_some_and(|second| second.t_ns + HISTORY_NS < switch.t_ns) {
            core.pop_front();
        }
        holders
    }
}

/// Counts who held this core in between; the processes concerned.
fn attribute(
    core: &VecDeque<Switch>,
    from_ns: u64,
    until_ns: u64,
    held: &mut BTreeMap<u32, Held>,
) -> Vec<u32> {
    let mut by_process = BTreeMap::<u32, u64>::new();
    let mut end_ns = until_ns;
    for switch in core.iter().rev() {
        let begin_ns = switch.t_ns.max(from_ns);
        *by_process.entry(switch.process).or_default() += end_ns.saturating_sub(begin_ns);
        if switch.t_ns <= from_ns {
            break;
        }
        end_ns = begin_ns;
    }
    by_process.retain(|_, held_ns| *held_ns > 0);
    let longest = by_process.iter().max_by_key(|(_, held_ns)| **held_ns).map(|(&of, _)| of);
    for (&process, &held_ns) in &by_process {
        let held = held.entry(process).or_default();
        held.held_ns += held_ns;
        held.late += u64::from(Some(process) == longest);
    }
    by_process.into_keys().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;
    const ROBOT: u32 = 10;

    /// A robot of 10 ms, due at 3 ms, 13 ms and so on, on one core of two.
    fn watching() -> Attribution {
        let mut attribution = Attribution::new(10 * MS, 2);
        attribution.watch(ROBOT, 3 * MS, 0);
        attribution
    }

    /// The core runs this thread of a process of the same number from then on, times in ms.
    fn on(core: usize, t_ms: u64, process: u32) -> Switch {
        Switch { t_ns: t_ms * MS, core, thread: process, process }
    }

    fn taken(switches: &[Switch]) -> (u64, Vec<(u32, u64, u64)>) {
        let mut attribution = watching();
        for &switch in switches {
            attribution.take(switch);
        }
        let held = attribution.held().iter();
        let held = held.map(|(&process, held)| (process, held.late, held.held_ns / MS)).collect();
        (attribution.late(), held)
    }

    #[test]
    fn who_held_the_core_longest_while_a_robot_was_due_has_its_late_wake_up() {
        let switches =
            [on(0, 0, 0), on(0, 1, 20), on(0, 5, 30), on(0, 6, 20), on(0, 8, ROBOT), on(0, 9, 0)];
        assert_eq!(taken(&switches), (1, vec![(20, 1, 4), (30, 0, 1)]));
    }

    #[test]
    fn a_robot_that_runs_when_it_is_due_is_not_late() {
        assert_eq!(taken(&[on(0, 0, 20), on(0, 3, ROBOT), on(0, 4, 0)]), (0, vec![]));
        assert_eq!(taken(&[on(0, 0, 20), on(0, 4, ROBOT)]), (0, vec![]), "a tenth of a period");
    }

    #[test]
    fn a_core_that_was_idle_held_nobody_up_and_says_so() {
        assert_eq!(taken(&[on(0, 0, 0), on(0, 7, ROBOT)]), (1, vec![(0, 1, 4)]));
    }

    #[test]
    fn only_the_core_on_which_it_comes_to_run_counts() {
        let switches = [on(0, 0, 20), on(1, 0, 30), on(1, 6, ROBOT)];
        assert_eq!(taken(&switches), (1, vec![(30, 1, 3)]));
    }

    #[test]
    fn a_robot_that_is_interrupted_at_work_is_not_late_again() {
        let switches = [on(0, 0, 0), on(0, 3, ROBOT), on(0, 4, 20), on(0, 9, ROBOT), on(0, 10, 0)];
        assert_eq!(taken(&switches), (0, vec![]));
    }

    #[test]
    fn a_robot_that_was_at_work_when_it_was_due_was_not_kept_waiting() {
        let switches = [on(0, 0, 0), on(0, 3, ROBOT), on(0, 14, 20), on(0, 19, ROBOT)];
        assert_eq!(taken(&switches), (0, vec![]));
    }

    #[test]
    fn a_robot_waits_from_the_first_deadline_that_it_was_kept_from() {
        // Due at 3, 13 and 23 ms, and on the core at 25 ms only; then again at 33 ms.
        let switches = [on(0, 0, 20), on(0, 25, ROBOT), on(0, 26, 20), on(0, 35, ROBOT)];
        assert_eq!(taken(&switches), (2, vec![(20, 2, 24)]));
    }

    #[test]
    fn a_robot_kept_from_its_work_until_after_the_next_deadline_is_late_for_that() {
        let switches = [on(0, 0, 0), on(0, 3, ROBOT), on(0, 4, 20), on(0, 18, ROBOT)];
        assert_eq!(taken(&switches), (1, vec![(20, 1, 5)]));
    }

    #[test]
    fn the_dead_and_unknown_cores_are_nobodys_lateness() {
        let mut attribution = watching();
        attribution.take(on(7, 5, ROBOT));
        attribution.take(on(0, 0, 20));
        attribution.forget(ROBOT);
        assert!(attribution.take(on(0, 9, ROBOT)).is_empty());
        assert_eq!(attribution.late(), 0);
    }

    #[test]
    fn a_history_that_begins_later_than_the_deadline_tells_what_it_has() {
        assert_eq!(taken(&[on(0, 5, 20), on(0, 8, ROBOT)]), (1, vec![(20, 1, 3)]));
        assert_eq!(taken(&[on(0, 8, ROBOT)]), (1, vec![]));
    }
}
