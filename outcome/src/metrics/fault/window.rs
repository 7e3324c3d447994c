//! Effect of one fault: detection, largest error, and recovery.

use protocol::message::ReceptionState;
use serde::{Deserialize, Deserializer, Serialize};

use super::ReceptionReport;
use experiment::prediction::{BrokenPrediction, broken_definition_text, lines_by_cause};
use experiment::scenario::{AffectedComponent, SilencedSource};
use formation::ns_to_seconds;

/// Reason that is reported instead of a prediction for a fault with false data.
const NOT_PREDICTED_REASON: &str = "the effect of a lie is not predicted";

/// A fault under observation.
#[derive(Debug, Clone)]
pub(super) struct FaultWindow {
    pub(super) number: usize,
    description: String,
    affected_component: AffectedComponent,
    start_ns: u64,
    ended_ns: Option<u64>,
    /// Time at which the silenced robot or edge returned; `None` if it has not.
    returned_ns: Option<u64>,
    stale_ns: Option<u64>,
    lost_ns: Option<u64>,
    /// Extremes until the recovery.
    extremes_until_recovery: Extremes,
    /// Extremes since the recovery. They count if the recovery did not last, or if no error was ever above the
    /// bound.
    extremes_since_recovery: Extremes,
    /// Whether an error was ever above the bound.
    was_disturbed: bool,
    recovered_ns: Option<u64>,
    prediction: Prediction,
    /// Robots whose errors have left the bound.
    displaced_robots: DisplacedRobots,
    /// Whether another fault began after this one had recovered. Later samples then belong to the other fault.
    is_closed: bool,
}

/// Predicted effect of a fault, computed when it begins.
#[derive(Debug, Clone, Default)]
pub(super) struct Prediction {
    /// Robots that the fault breaks.
    pub(super) broken_robots: Vec<BrokenPrediction>,
    /// Indices of the robots that the fault disconnects from every leader.
    pub(super) orphaned_robots: Vec<usize>,
}

/// Two flags of a robot: for its error to the neighbors it receives from, and for its error to the ideal formation.
pub(super) type ErrorFlags = [bool; 2];

/// Robots that were within bounds when the fault began and are not any more.
#[derive(Debug, Clone)]
struct DisplacedRobots {
    was_within_bound: Vec<ErrorFlags>,
    has_left_bound: Vec<ErrorFlags>,
}

impl DisplacedRobots {
    fn new(
        within_bound: impl Iterator<Item = ErrorFlags>,
        silenced: SilencedSource,
    ) -> DisplacedRobots {
        let is_counted = |i| silenced != SilencedSource::Robot(i);
        let within_bound: Vec<ErrorFlags> = (0..)
            .zip(within_bound)
            .map(|(i, within_bound)| within_bound.map(|is_within| is_within && is_counted(i)))
            .collect();
        DisplacedRobots {
            has_left_bound: vec![[false; 2]; within_bound.len()],
            was_within_bound: within_bound,
        }
    }

    fn add_truth(&mut self, beyond_bound: impl Iterator<Item = ErrorFlags>) {
        for ((has_left, within_bound), beyond_bound) in
            self.has_left_bound.iter_mut().zip(&self.was_within_bound).zip(beyond_bound)
        {
            *has_left = [within_bound[0] && beyond_bound[0], within_bound[1] && beyond_bound[1]];
        }
    }

    /// Returns the names of these robots. `error` is 0 for the error to neighbors, 1 for the error to the ideal
    /// formation.
    fn names(&self, error: usize, names: &[String]) -> Vec<String> {
        let displaced =
            self.has_left_bound.iter().zip(names).filter(|(has_left, _)| has_left[error]);
        displaced.map(|(_, name)| name.clone()).collect()
    }
}

/// End of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultEnd {
    /// Repair: the effect of the fault is undone.
    Repaired,
    /// Permanent fault: no repair follows, and the fault counts as ended when it begins.
    Permanent,
}

/// Extreme values over a period.
#[derive(Debug, Clone, Copy)]
struct Extremes {
    error_m_max: f64,
    distance_m_min: f64,
}

impl Extremes {
    const NONE: Extremes = Extremes { error_m_max: 0.0, distance_m_min: f64::INFINITY };

    fn merge(&mut self, other: Extremes) {
        self.error_m_max = self.error_m_max.max(other.error_m_max);
        self.distance_m_min = self.distance_m_min.min(other.distance_m_min);
    }
}

/// Effect of one fault, as reported.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultReport {
    /// Time at which the fault began, s.
    pub t_s: f64,
    /// Description of the fault.
    pub what: String,
    /// Name of the robot that the fault affects.
    pub robot: Option<String>,
    /// Robots that the fault is predicted to break while it lasts: they end more than `converged_error_m` off their
    /// slots in the planned formation.
    pub predicted: Vec<String>,
    /// Reasons of the prediction, one line for each group of robots: `r1, r2: the leader r5 is dead`.
    pub predicted_why: Vec<String>,
    /// Robots that the fault disconnected from every leader although they are alive and their role needs one.
    pub orphaned: Vec<String>,
    /// Distance from its slot above which a robot is broken, m.
    pub broken_m: f64,
    /// Living robots, except the silenced one, that were within `broken_m` of their slots in the planned formation
    /// when the fault began and were not when it ended (or, if it never ended, at the end of the run).
    pub broken: Vec<String>,
    /// Living robots, except the silenced one, whose error to the neighbors they receive from was below
    /// `converged_error_m` when the fault began and above it when it ended (or, if it never ended, at the end of
    /// the run).
    pub affected: Vec<String>,
    /// Time from the beginning until the fault ended (for a restart, until the first tick of the new process), s.
    pub lasted_s: Option<f64>,
    /// Time from the beginning until the first neighbor classified the robot as stale, s.
    pub stale_after_s: Option<f64>,
    /// Time from the beginning until the first neighbor classified the robot as lost (timed out), s.
    pub lost_after_s: Option<f64>,
    /// Largest error of a living robot until the recovery, m. If no error left the bound, until the next fault or
    /// the end of the run.
    #[serde(deserialize_with = "deserialize_or_infinite")]
    pub peak_error_m: f64,
    /// Smallest distance over the same period, m.
    pub min_distance_m: Option<f64>,
    /// Time from the end of the fault until the errors of all living robots were, and stayed, below
    /// `converged_error_m`, s; 0 if they were below it all the time.
    pub recovered_after_s: Option<f64>,
}

impl FaultReport {
    /// Returns the definition of *broken* as text, with its bound.
    pub fn describe_broken(&self) -> String {
        broken_definition_text(self.broken_m)
    }
}

impl FaultWindow {
    /// Creates the window of a fault that begins. `within_bound` gives for each robot whether its two errors are
    /// below the bound.
    pub(super) fn new(
        number: usize,
        description: String,
        affected: AffectedComponent,
        start_ns: u64,
        prediction: Prediction,
        within_bound: impl Iterator<Item = ErrorFlags>,
    ) -> FaultWindow {
        FaultWindow {
            prediction,
            displaced_robots: DisplacedRobots::new(within_bound, affected.silenced_source),
            number,
            description,
            affected_component: affected,
            start_ns,
            ended_ns: None,
            returned_ns: None,
            stale_ns: None,
            lost_ns: None,
            extremes_until_recovery: Extremes::NONE,
            extremes_since_recovery: Extremes::NONE,
            was_disturbed: false,
            recovered_ns: None,
            is_closed: false,
        }
    }

    /// Ends the fault. A fault that ended for good may still be repaired later. Returns what the fault had silenced
    /// and no longer does.
    pub(super) fn end(&mut self, end: FaultEnd, t_ns: u64) -> SilencedSource {
        if self.returned_ns.is_some() {
            return SilencedSource::NoSource;
        }
        self.ended_ns = Some(t_ns);
        if end == FaultEnd::Permanent {
            return SilencedSource::NoSource;
        }
        self.returned_ns = Some(t_ns);
        self.affected_component.silenced_source
    }

    pub(super) fn close_if_recovered(&mut self) {
        self.is_closed |= self.recovered_ns.is_some();
    }

    /// Updates the window with one sample. `converged_since_ns` is the time since which all errors of living robots are
    /// below the bound; `beyond_bound` gives which errors are above it.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        error_m: f64,
        converged_since_ns: Option<u64>,
        beyond_bound: impl Iterator<Item = ErrorFlags>,
        distance_m: f64,
    ) {
        if self.is_closed || t_ns < self.start_ns {
            return;
        }
        if self.returned_ns.is_none_or(|returned_ns| t_ns <= returned_ns) {
            self.displaced_robots.add_truth(beyond_bound);
        }
        self.was_disturbed |= converged_since_ns.is_none();
        let ended_ns = self.ended_ns.filter(|&ended_ns| t_ns >= ended_ns);
        // A sample at the very instant of the end cannot show what the fault leads to.
        self.recovered_ns = match (ended_ns, converged_since_ns) {
            (Some(ended_ns), Some(converged_ns)) if t_ns > ended_ns => {
                Some(converged_ns.max(ended_ns))
            }
            _ => None,
        };
        let current = Extremes { error_m_max: error_m, distance_m_min: distance_m };
        if ended_ns.is_some() && converged_since_ns.is_some() {
            self.extremes_since_recovery.merge(current);
        } else {
            self.extremes_until_recovery
                .merge(std::mem::replace(&mut self.extremes_since_recovery, Extremes::NONE));
            self.extremes_until_recovery.merge(current);
        }
    }

    /// Records a reception report, in any order. The earliest report about the affected robot counts.
    pub(super) fn record_reception(&mut self, report: ReceptionReport) {
        let ReceptionReport { receiver, neighbor, reception_state, since_ns } = report;
        let is_affected = self.affected_component.robot == Some(neighbor)
            && self
                .affected_component
                .receiver
                .is_none_or(|only_receiver| only_receiver == receiver);
        if !is_affected || since_ns < self.start_ns {
            return;
        }
        let earliest_ns = match reception_state {
            ReceptionState::Stale => &mut self.stale_ns,
            ReceptionState::Lost => &mut self.lost_ns,
            ReceptionState::Fresh | ReceptionState::NothingReceived | ReceptionState::Apart => {
                return;
            }
        };
        *earliest_ns = Some(earliest_ns.map_or(since_ns, |known_ns| since_ns.min(known_ns)));
    }

    /// Returns the report. `broken_m` is the distance from its slot above which a robot is broken, m.
    pub(super) fn report(&self, names: &[String], broken_m: f64) -> FaultReport {
        let broken = &self.prediction.broken_robots;
        let after = |from_ns: u64| move |t_ns: u64| ns_to_seconds(t_ns.saturating_sub(from_ns));
        let since_begin = after(self.start_ns);
        let name = |robot: usize| names[robot].as_str();
        // Reception changes after the return do not belong to this fault; the return may be reported last.
        let before_return =
            |&since_ns: &u64| self.returned_ns.is_none_or(|returned_ns| since_ns <= returned_ns);
        let mut worst = self.extremes_until_recovery;
        if self.recovered_ns.is_none() || !self.was_disturbed {
            worst.merge(self.extremes_since_recovery);
        }
        let mut predicted_why = lines_by_cause(
            broken.iter().map(|prediction| (name(prediction.robot), prediction.describe(name))),
        );
        predicted_why
            .extend(self.affected_component.is_byzantine.then(|| NOT_PREDICTED_REASON.to_owned()));
        FaultReport {
            t_s: ns_to_seconds(self.start_ns),
            what: self.description.clone(),
            robot: self.affected_component.robot.map(|robot| names[robot].clone()),
            predicted: broken.iter().map(|prediction| names[prediction.robot].clone()).collect(),
            predicted_why,
            orphaned: self.prediction.orphaned_robots.iter().map(|&i| names[i].clone()).collect(),
            broken: self.displaced_robots.names(1, names),
            affected: self.displaced_robots.names(0, names),
            broken_m,
            lasted_s: self.ended_ns.map(since_begin),
            stale_after_s: self.stale_ns.filter(before_return).map(since_begin),
            lost_after_s: self.lost_ns.filter(before_return).map(since_begin),
            peak_error_m: worst.error_m_max,
            min_distance_m: worst.distance_m_min.is_finite().then_some(worst.distance_m_min),
            recovered_after_s: self
                .ended_ns
                .and_then(|ended_ns| self.recovered_ns.map(after(ended_ns))),
        }
    }
}

/// Deserializes a number that may have been infinite, which JSON represents as `null`.
fn deserialize_or_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::prediction::BreakCause;

    const NS_PER_S: u64 = 1_000_000_000;

    const AFFECTED_ROBOT: AffectedComponent = AffectedComponent {
        robot: Some(1),
        receiver: None,
        silenced_source: SilencedSource::Robot(1),
        is_byzantine: false,
    };

    fn no_flags() -> impl Iterator<Item = ErrorFlags> {
        [[false; 2]; 3].into_iter()
    }

    fn names() -> Vec<String> {
        ["r1", "r2", "r3"].map(String::from).into()
    }

    fn reception_report(
        receiver: usize,
        neighbor: usize,
        reception_state: ReceptionState,
        since_ns: u64,
    ) -> ReceptionReport {
        ReceptionReport { receiver, neighbor, reception_state, since_ns }
    }

    fn prediction() -> Prediction {
        let cause = BreakCause::LeaderUnreachable { leader: 1 };
        let broken_robots = vec![BrokenPrediction {
            robot: 0,
            cause,
            slot_distance_m: None,
            hull_distance_m: None,
        }];
        Prediction { broken_robots, orphaned_robots: vec![2] }
    }

    fn window() -> FaultWindow {
        FaultWindow::new(
            0,
            "kill r2".into(),
            AFFECTED_ROBOT,
            10 * NS_PER_S,
            prediction(),
            [[true; 2]; 3].into_iter(),
        )
    }

    #[test]
    fn robot_that_leaves_the_bound_without_recovery_is_affected() {
        let within_bound = [[true; 2], [true, false], [false, true]].into_iter();
        let mut fault = FaultWindow::new(
            0,
            "kill r2".into(),
            AFFECTED_ROBOT,
            10 * NS_PER_S,
            prediction(),
            within_bound,
        );
        let all = || [[true; 2]; 3].into_iter();
        let affected = |fault: &FaultWindow| fault.report(&names(), 0.01).affected;
        let broken = |fault: &FaultWindow| fault.report(&names(), 0.01).broken;
        fault.add_truth(11 * NS_PER_S, 0.5, None, all(), 0.3);
        assert_eq!(affected(&fault), ["r1"], "r2 is dead, and r3 was off its slot before");
        assert_eq!(broken(&fault), ["r1", "r3"], "but r3 was in its slot");
        fault.add_truth(12 * NS_PER_S, 0.0, None, no_flags(), 0.3);
        fault.end(FaultEnd::Repaired, 12 * NS_PER_S);
        fault.add_truth(13 * NS_PER_S, 0.5, None, all(), 0.3);
        assert!(affected(&fault).is_empty(), "effects of the return do not belong to the silence");
        let FaultReport { predicted, predicted_why, orphaned, .. } = fault.report(&names(), 0.01);
        assert_eq!(predicted, ["r1"]);
        assert_eq!(predicted_why, ["r1: not reached by the leader r2"]);
        assert_eq!(orphaned, ["r3"]);
    }

    #[test]
    fn permanent_fault_stays_silenced_until_a_manual_restart() {
        let mut fault = window();
        assert_eq!(fault.end(FaultEnd::Permanent, 10 * NS_PER_S), SilencedSource::NoSource);
        fault.add_truth(11 * NS_PER_S, 0.0, Some(9 * NS_PER_S), no_flags(), 1.0);
        assert_eq!(fault.end(FaultEnd::Repaired, 15 * NS_PER_S), SilencedSource::Robot(1));
        assert_eq!(
            fault.end(FaultEnd::Repaired, 16 * NS_PER_S),
            SilencedSource::NoSource,
            "it had ended already"
        );
        fault.add_truth(16 * NS_PER_S, 0.5, None, no_flags(), 1.0);
        fault.add_truth(17 * NS_PER_S, 0.0, Some(17 * NS_PER_S), no_flags(), 1.0);
        let report = fault.report(&names(), 0.01);
        assert_eq!((report.lasted_s, report.recovered_after_s), (Some(5.0), Some(2.0)));
        assert_eq!(report.peak_error_m, 0.5);
    }

    #[test]
    fn false_data_fault_has_no_prediction() {
        let affected = AffectedComponent {
            robot: Some(1),
            is_byzantine: true,
            ..AffectedComponent::default()
        };
        let what = "lie r2 beacons by [0.5, 0]".into();
        let fault =
            FaultWindow::new(0, what, affected, NS_PER_S, Prediction::default(), no_flags());
        let FaultReport { predicted, predicted_why, .. } = fault.report(&names(), 0.01);
        assert!(predicted.is_empty());
        assert_eq!(predicted_why, [NOT_PREDICTED_REASON]);
    }

    #[test]
    fn link_cut_is_detected_by_its_receiver() {
        let affected = AffectedComponent { receiver: Some(2), ..AFFECTED_ROBOT };
        let within_bound = [[true; 2]; 3].into_iter();
        let mut fault = FaultWindow::new(
            0,
            "cut r2->r3".into(),
            affected,
            10 * NS_PER_S,
            Prediction::default(),
            within_bound,
        );
        fault.record_reception(reception_report(0, 1, ReceptionState::Stale, 11 * NS_PER_S));
        assert_eq!(fault.report(&names(), 0.01).stale_after_s, None);
        fault.record_reception(reception_report(2, 1, ReceptionState::Stale, 12 * NS_PER_S));
        assert_eq!(fault.report(&names(), 0.01).stale_after_s, Some(2.0));
    }
}
