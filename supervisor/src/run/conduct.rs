//! How time passes in a run, and what follows from that for the supervisor. No other file asks.
//!
//! In lockstep the plant pauses at the tick of whatever is due, and the supervisor acts only then,
//! until everybody is at rest: wall time is not simulated time. In real time nobody waits for it.

use std::path::Path;
use std::time::{Duration, Instant};

use protocol::barrier::{Barrier, BarrierError};
use protocol::brief::Pace;
use protocol::message::{StatusHeader, TruthHeader};
use protocol::run_root::RunRoot;
use rustix::event::PollFd;

use super::error::{RunError, TRUTH_SILENCE_MAX};
use super::hung::{Watch, Watched};
use super::processes::wait_for_news;
use crate::child::Child;
use crate::cores::{Cores, Placement};
use crate::spawn::Launcher;
use experiment::scenario::Scenario;
use outcome::metrics::expect::FailedRobot;
use outcome::results::usage::Usage;

/// How long one turn of the loop waits for news.
const TURN: Duration = Duration::from_millis(2);

/// How time passes.
pub(super) enum Conduct {
    /// As fast as the machine allows.
    Lockstep {
        barrier: Barrier,
        /// On which cores the processes are.
        placement: Option<Box<Placement>>,
        period_ns: u64,
        watch: Box<Watch>,
    },
    /// As on the wall.
    Realtime { period_ns: u64, watch: Box<Watch> },
}

impl Conduct {
    /// What must stand before the first process.
    pub(super) fn new(
        scenario: &Scenario,
        pace: Pace,
        run_root: &RunRoot,
        launcher: &Launcher,
    ) -> Result<Conduct, BarrierError> {
        let (robots, period_ns) = (scenario.robots.len(), scenario.period_ns);
        let hung_after = Duration::from_nanos(scenario.hung_after_ns);
        let ready_after = Duration::from_nanos(scenario.ready_after_ns);
        let watch = Box::new(Watch::new(robots, hung_after, ready_after));
        if pace == Pace::Realtime {
            return Ok(Conduct::Realtime { period_ns, watch });
        }
        let cores = Cores::deal(robots, std::process::id() as usize);
        let groups = cores.as_ref().map_or(1, Cores::groups);
        let barrier = Barrier::create(&run_root.barrier_path(), robots, groups, hung_after)?;
        // Nobody moves before everybody has reported, so that a death during the start-up is dealt
        // with as if it had not been.
        barrier.pause_at(0);
        Ok(Conduct::Lockstep {
            barrier,
            placement: cores.map(|cores| Box::new(Placement::new(cores, launcher.clone()))),
            period_ns,
            watch,
        })
    }

    /// Whether links can be cut by hand: what the agents are told meanwhile has no tick.
    pub(super) fn cuts_links_by_hand(&self) -> bool {
        matches!(self, Conduct::Realtime { .. })
    }

    /// Whether a replacement may start before what the dead left is removed. In lockstep all wait for
    /// that, so that each restart finds the same.
    pub(super) fn starts_beside_remains(&self) -> bool {
        matches!(self, Conduct::Realtime { .. })
    }

    /// Whether the others go on while somebody is stopped. In lockstep they wait.
    pub(super) fn goes_on_without_the_stopped(&self) -> bool {
        matches!(self, Conduct::Realtime { .. })
    }

    /// Waits until something may have happened, for at most one turn. `news`: what is readable then;
    /// in lockstep the plant calls.
    pub(super) fn wait_for_news<'f>(&self, news: impl FnOnce() -> Vec<PollFd<'f>>) {
        match self {
            Conduct::Lockstep { barrier, .. } => {
                barrier.wait_attention(TURN);
            }
            Conduct::Realtime { .. } => wait_for_news(&mut news(), TURN),
        }
    }

    /// A truth was taken in.
    pub(super) fn took(&self, truth: &TruthHeader) {
        if let Conduct::Lockstep { barrier, .. } = self {
            barrier.consumed(truth.tick + 1);
        }
    }

    /// How many reports of robots are there, if all of the time before the truth at hand are. In
    /// lockstep the plant waits for the robots, and they report before they arrive.
    pub(super) fn reports_before_truth(&self) -> Option<u32> {
        match self {
            Conduct::Lockstep { barrier, .. } => Some(barrier.reports()),
            Conduct::Realtime { .. } => None,
        }
    }

    /// Up to which run time, ns, everything is known once this truth was taken, and in lockstep what
    /// came before it.
    pub(super) fn known_before(&self, newest: &TruthHeader) -> u64 {
        match self {
            Conduct::Lockstep { .. } => newest.t_ns,
            // Nobody waits for what is still under way.
            Conduct::Realtime { .. } => newest.t_ns.saturating_add(1),
        }
    }

    /// Whether the plant stands and will not move before the supervisor has acted: it has not
    /// started, or it is paused and the truth of that tick, sent before the pause, was taken in.
    pub(super) fn stands(&self, newest: Option<&TruthHeader>) -> bool {
        match (self, newest) {
            (Conduct::Realtime { .. }, _) => false,
            (Conduct::Lockstep { .. }, None) => true,
            (Conduct::Lockstep { barrier, .. }, Some(truth)) => {
                barrier.paused() == Some(truth.tick)
            }
        }
    }

    /// Whether the supervisor may kill, stop and start robots now.
    pub(super) fn may_act(&self, newest: Option<&TruthHeader>) -> bool {
        matches!(self, Conduct::Realtime { .. }) || self.stands(newest)
    }

    /// Whether nobody has moved yet.
    pub(super) fn starting_up(&self, newest: Option<&TruthHeader>) -> bool {
        match self {
            Conduct::Lockstep { .. } => {
                newest.is_none_or(|truth| truth.t_ns == 0) && self.stands(newest)
            }
            Conduct::Realtime { .. } => newest.is_none(),
        }
    }

    /// Whether a robot that reports so takes part. In lockstep a replacement is ready before its
    /// first tick; in real time it takes part once it has answered a sample.
    pub(super) fn takes_part(&self, status: &StatusHeader) -> bool {
        match self {
            Conduct::Lockstep { .. } => true,
            Conduct::Realtime { .. } => status.incarnation == 0 || status.moving == 1,
        }
    }

    /// The plant waits for this robot from the next tick on.
    pub(super) fn join(&self, robot: usize) {
        if let Conduct::Lockstep { barrier, .. } = self {
            barrier.set_member(robot, barrier.paused().unwrap_or(0));
        }
    }

    /// The plant waits for this robot no more.
    pub(super) fn leave(&self, robot: usize) {
        if let Conduct::Lockstep { barrier, .. } = self {
            barrier.remove_member(robot);
        }
    }

    /// Something is due at this run time, ns, or never.
    pub(super) fn pause_at(&self, t_ns: Option<u64>) {
        if let Conduct::Lockstep { barrier, period_ns, .. } = self {
            barrier.pause_at(t_ns.map_or(u64::MAX, |t_ns| t_ns.div_ceil(*period_ns)));
        }
    }

    /// Lets the plant go on, after [`Conduct::pause_at`] said where to.
    pub(super) fn resume(&self) {
        if let Conduct::Lockstep { barrier, .. } = self {
            barrier.resume();
        }
    }

    /// Nobody is waited for without a limit. In real time that is one of the clock's; in lockstep a
    /// process may take as long as the machine makes it. `last_news`: when the last truth came; `slow`: by how much a
    /// robot may be slow on purpose.
    pub(super) fn check_deadlines<'c>(
        &mut self,
        newest: Option<&TruthHeader>,
        last_news: Instant,
        plant: &Child,
        robots: impl Iterator<Item = Watched<'c>> + Clone,
        slow: impl Fn(usize) -> Duration,
    ) -> Result<(), RunError> {
        match self {
            Conduct::Lockstep { barrier, watch, .. } => watch.look(barrier, newest, plant, robots),
            Conduct::Realtime { watch, .. } => {
                watch.look_for_silence(robots, slow)?;
                // A plant of the scenario's own takes as long to start as a robot may.
                let limit = match newest {
                    None => TRUTH_SILENCE_MAX.max(watch.ready_after()),
                    Some(_) => TRUTH_SILENCE_MAX,
                };
                match last_news.elapsed() > limit {
                    true => Err(RunError::PlantSilent { limit }),
                    false => Ok(()),
                }
            }
        }
    }

    /// The last truth is in: lets everybody come to the end of what they are at, so that none is
    /// ended over it.
    pub(super) fn let_finish(&self) {
        if let Conduct::Realtime { period_ns, .. } = self {
            std::thread::sleep(2 * Duration::from_nanos(*period_ns));
        }
    }

    /// Robots that are hung and hold nobody up: in lockstep they end the run.
    pub(super) fn failed(&self) -> Vec<FailedRobot> {
        match self {
            Conduct::Lockstep { .. } => Vec::new(),
            Conduct::Realtime { watch, .. } => watch.failed().collect(),
        }
    }

    /// Keeps the plant and the robots (by place) on their cores, while nobody else wants those.
    /// `log`: of what keeps the cores awake.
    pub(super) fn place<'c>(
        &mut self,
        plant: &Child,
        robots: impl Iterator<Item = (usize, &'c Child)> + Clone,
        log: &Path,
    ) {
        if let Conduct::Lockstep { placement: Some(placement), barrier, .. } = self {
            placement.look(plant, robots, barrier.ticks_begun(), log);
        }
    }

    /// Lets go of the cores: what it took to keep them awake.
    pub(super) fn end(&mut self) -> Option<Usage> {
        match self {
            Conduct::Lockstep { placement: Some(placement), .. } => Some(placement.end()),
            _ => None,
        }
    }
}
