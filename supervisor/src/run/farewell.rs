//! How a run ends: every child is asked to, and killed if it does not; what they took is summed up,
//! and what they shared is removed.

use std::time::{Duration, Instant};

use super::Run;
use super::error::RunError;
use crate::child::Child;
use crate::outcome::Outcome;
use crate::usage::Usage;

/// Children asked to end are killed after this.
const GRACE: Duration = Duration::from_secs(2);

impl Run<'_> {
    /// Ends every process and removes what they shared. What went wrong at the end is told.
    pub(super) fn farewell(mut self) -> (Outcome, Result<(), RunError>) {
        self.end_children();
        // The last values are sent at the very end.
        let taken = self.take_latencies();
        self.sum_up_usages();
        let complete = self.load.missing().map_err(RunError::from);
        let Run {
            outcome,
            robots,
            plant,
            load,
            truth,
            latencies,
            faults_by_hand,
            cleaner,
            conduct,
            _services,
            _node,
            run_root,
            ..
        } = self;
        drop((robots, plant, load, truth, latencies, faults_by_hand));
        drop((cleaner, conduct, _services, _node));
        if let Err(error) = run_root.remove() {
            tracing::warn!(%error, "could not remove the run root");
        }
        (outcome, taken.and(complete))
    }

    /// Asks everybody to end, and kills whoever does not.
    fn end_children(&mut self) {
        let _ = self.take_statuses();
        let misses = self.robots.iter().map(|robot| robot.misses_before + robot.misses);
        self.outcome.deadline_misses = misses.sum();
        let refused = self.robots.iter().map(|robot| robot.refused_before + robot.refused);
        self.outcome.beacons_refused = refused.collect();
        let asked = Instant::now();
        let mut killed = false;
        for child in self.children() {
            child.terminate();
        }
        while self.children().any(|child| child.ended().is_none()) {
            if !killed && asked.elapsed() > GRACE {
                killed = true;
                for child in self.children().filter_map(|child| match child.ended() {
                    None => Some(child),
                    Some(_) => None,
                }) {
                    tracing::warn!(pid = child.pid(), "did not end when asked; killed");
                    child.kill();
                }
            } else if asked.elapsed() > 2 * GRACE {
                tracing::error!("a killed process does not end; the kernel holds it");
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Puts together what everybody took, once all have ended.
    fn sum_up_usages(&mut self) {
        let plant = self.plant.usage().unwrap_or_default();
        let robots = self.robots.iter().zip(&self.outcome.restarts).map(|(robot, restarts)| {
            let mut usage = robot.usage;
            usage += robot.seat.child().and_then(Child::usage).unwrap_or_default();
            (robot.name.clone(), restarts + 1, usage)
        });
        let awake = self.conduct.end().map(|usage| ("awake".to_owned(), 1, usage));
        self.outcome.usages = [
            ("supervisor".to_owned(), 1, Usage::of_this_process()),
            ("plant".to_owned(), 1, plant),
        ]
        .into_iter()
        .chain(robots)
        .chain(awake)
        .collect();
    }

    /// All children, the plant first: it waits for the robots, and they for nobody.
    fn children(&mut self) -> impl Iterator<Item = &mut Child> {
        let robots = self.robots.iter_mut().filter_map(|robot| robot.seat.child_mut());
        [&mut self.plant].into_iter().chain(robots).chain(self.load.children_mut())
    }
}
