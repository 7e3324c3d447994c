//! Effect of one fault: detection, largest error, and recovery.

use protocol::message::Contact;
use serde::{Deserialize, Deserializer, Serialize};

use super::Report;
use experiment::prediction::{Broken, broken_means, lines};
use experiment::scenario::{Silenced, Struck};
use formation::seconds;

/// Reason that is reported instead of a prediction for a fault with false data.
const NOT_PREDICTED: &str = "the effect of a lie is not predicted";

/// A fault under observation.
#[derive(Debug, Clone)]
pub(super) struct FaultWindow {
    pub(super) number: usize,
    description: String,
    affected: Struck,
    began_ns: u64,
    ended_ns: Option<u64>,
    /// Time at which the silenced robot or edge returned; `None` if it has not.
    returned_ns: Option<u64>,
    stale_ns: Option<u64>,
    lost_ns: Option<u64>,
    /// Extremes until the recovery.
    worst: Extremes,
    /// Extremes since the recovery. They count if the recovery did not last, or if no error was ever above the
    /// bound.
    worst_since: Extremes,
    /// Whether an error was ever above the bound.
    disturbed: bool,
    recovered_ns: Option<u64>,
    prediction: Prediction,
    /// Robots whose errors have left the bound.
    displaced_robots: DisplacedRobots,
    /// Whether another fault began after this one had recovered. Later samples then belong to the other fault.
    closed: bool,
}

/// Predicted effect of a fault, computed when it begins.
#[derive(Debug, Clone, Default)]
pub(super) struct Prediction {
    /// Robots that the fault breaks.
    pub(super) broken: Vec<Broken>,
    /// Indices of the robots that the fault disconnects from every leader.
    pub(super) orphaned: Vec<usize>,
}

/// Two flags of a robot: for its error to the neighbors it receives from, and for its error to the ideal formation.
pub(super) type ErrorFlags = [bool; 2];

/// Robots that were within bounds when the fault began and are not any more.
#[derive(Debug, Clone)]
struct DisplacedRobots {
    within_bound: Vec<ErrorFlags>,
    outside_bound: Vec<ErrorFlags>,
}

impl DisplacedRobots {
    fn new(within_bound: impl Iterator<Item = ErrorFlags>, silenced: Silenced) -> DisplacedRobots {
        let counts = |i| silenced != Silenced::Robot(i);
        let within_bound: Vec<ErrorFlags> = (0..)
            .zip(within_bound)
            .map(|(i, within_bound)| within_bound.map(|c| c && counts(i)))
            .collect();
        DisplacedRobots { outside_bound: vec![[false; 2]; within_bound.len()], within_bound }
    }

    fn add_truth(&mut self, beyond: impl Iterator<Item = ErrorFlags>) {
        for ((left, within_bound), beyond) in
            self.outside_bound.iter_mut().zip(&self.within_bound).zip(beyond)
        {
            *left = [within_bound[0] && beyond[0], within_bound[1] && beyond[1]];
        }
    }

    /// Returns the names of these robots. `error` is 0 for the error to neighbors, 1 for the error to the ideal
    /// formation.
    fn names(&self, error: usize, names: &[String]) -> Vec<String> {
        let left = self.outside_bound.iter().zip(names).filter(|(left, _)| left[error]);
        left.map(|(_, name)| name.clone()).collect()
    }
}

/// End of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Repair: the effect of the fault is undone.
    Whole,
    /// Permanent fault: no repair follows, and the fault counts as ended when it begins.
    ForGood,
}

/// Extreme values over a period.
#[derive(Debug, Clone, Copy)]
struct Extremes {
    error_m: f64,
    distance_m: f64,
}

impl Extremes {
    const NONE: Extremes = Extremes { error_m: 0.0, distance_m: f64::INFINITY };

    fn merge(&mut self, other: Extremes) {
        self.error_m = self.error_m.max(other.error_m);
        self.distance_m = self.distance_m.min(other.distance_m);
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
    /// Name of the robot that the fault strikes.
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
    #[serde(deserialize_with = "or_infinite")]
    pub peak_error_m: f64,
    /// Smallest distance over the same period, m.
    pub min_distance_m: Option<f64>,
    /// Time from the end of the fault until the errors of all living robots were, and stayed, below
    /// `converged_error_m`, s; 0 if they were below it all the time.
    pub recovered_after_s: Option<f64>,
}

impl FaultReport {
    /// Returns the definition of *broken* as text, with its bound.
    pub fn broken_means(&self) -> String {
        broken_means(self.broken_m)
    }
}

impl FaultWindow {
    /// Creates the window of a fault that begins. `within_bound` says for each robot whether its two errors are
    /// below the bound.
    pub(super) fn new(
        number: usize,
        what: String,
        struck: Struck,
        began_ns: u64,
        prediction: Prediction,
        within_bound: impl Iterator<Item = ErrorFlags>,
    ) -> FaultWindow {
        FaultWindow {
            prediction,
            displaced_robots: DisplacedRobots::new(within_bound, struck.silenced),
            number,
            description: what,
            affected: struck,
            began_ns,
            ended_ns: None,
            returned_ns: None,
            stale_ns: None,
            lost_ns: None,
            worst: Extremes::NONE,
            worst_since: Extremes::NONE,
            disturbed: false,
            recovered_ns: None,
            closed: false,
        }
    }

    /// Ends the fault. A fault that ended for good may still be repaired later. Returns what the fault had silenced
    /// and no longer does.
    pub(super) fn end(&mut self, end: End, t_ns: u64) -> Silenced {
        if self.returned_ns.is_some() {
            return Silenced::Nobody;
        }
        self.ended_ns = Some(t_ns);
        if end == End::ForGood {
            return Silenced::Nobody;
        }
        self.returned_ns = Some(t_ns);
        self.affected.silenced
    }

    pub(super) fn close_if_recovered(&mut self) {
        self.closed |= self.recovered_ns.is_some();
    }

    /// Updates the window with one sample. `converged_since_ns` is the time since which all errors of living robots are
    /// below the bound; `beyond` says which errors are above it.
    pub(super) fn add_truth(
        &mut self,
        t_ns: u64,
        error_m: f64,
        converged_since_ns: Option<u64>,
        beyond: impl Iterator<Item = ErrorFlags>,
        distance_m: f64,
    ) {
        if self.closed || t_ns < self.began_ns {
            return;
        }
        if self.returned_ns.is_none_or(|returned_ns| t_ns <= returned_ns) {
            self.displaced_robots.add_truth(beyond);
        }
        self.disturbed |= converged_since_ns.is_none();
        let ended_ns = self.ended_ns.filter(|&ended_ns| t_ns >= ended_ns);
        // A sample at the very instant of the end cannot show what the fault leads to.
        self.recovered_ns = match (ended_ns, converged_since_ns) {
            (Some(ended_ns), Some(converged_ns)) if t_ns > ended_ns => {
                Some(converged_ns.max(ended_ns))
            }
            _ => None,
        };
        let now = Extremes { error_m, distance_m };
        if ended_ns.is_some() && converged_since_ns.is_some() {
            self.worst_since.merge(now);
        } else {
            self.worst.merge(std::mem::replace(&mut self.worst_since, Extremes::NONE));
            self.worst.merge(now);
        }
    }

    /// Records a contact report, in any order. The earliest report about the struck robot counts.
    pub(super) fn record_contact(&mut self, report: Report) {
        let Report { hearer, neighbor, contact, since_ns } = report;
        let struck = self.affected.robot == Some(neighbor)
            && self.affected.hearer.is_none_or(|only| only == hearer);
        if !struck || since_ns < self.began_ns {
            return;
        }
        let first = match contact {
            Contact::Stale => &mut self.stale_ns,
            Contact::Lost => &mut self.lost_ns,
            Contact::Fresh | Contact::Unheard => return,
        };
        *first = Some(first.map_or(since_ns, |first_ns| since_ns.min(first_ns)));
    }

    /// Returns the report. `broken_m` is the distance from its slot above which a robot is broken, m.
    pub(super) fn report(&self, names: &[String], broken_m: f64) -> FaultReport {
        let broken = &self.prediction.broken;
        let after = |from_ns: u64| move |t_ns: u64| seconds(t_ns.saturating_sub(from_ns));
        let since_begin = after(self.began_ns);
        let name = |robot: usize| names[robot].as_str();
        // Contact changes after the return do not belong to this fault; the return may be reported last.
        let meanwhile =
            |&since_ns: &u64| self.returned_ns.is_none_or(|back_ns| since_ns <= back_ns);
        let mut worst = self.worst;
        if self.recovered_ns.is_none() || !self.disturbed {
            worst.merge(self.worst_since);
        }
        let mut predicted_why =
            lines(broken.iter().map(|one| (name(one.robot), one.describe(name))));
        predicted_why.extend(self.affected.lies.then(|| NOT_PREDICTED.to_owned()));
        FaultReport {
            t_s: seconds(self.began_ns),
            what: self.description.clone(),
            robot: self.affected.robot.map(|robot| names[robot].clone()),
            predicted: broken.iter().map(|one| names[one.robot].clone()).collect(),
            predicted_why,
            orphaned: self.prediction.orphaned.iter().map(|&i| names[i].clone()).collect(),
            broken: self.displaced_robots.names(1, names),
            affected: self.displaced_robots.names(0, names),
            broken_m,
            lasted_s: self.ended_ns.map(since_begin),
            stale_after_s: self.stale_ns.filter(meanwhile).map(since_begin),
            lost_after_s: self.lost_ns.filter(meanwhile).map(since_begin),
            peak_error_m: worst.error_m,
            min_distance_m: worst.distance_m.is_finite().then_some(worst.distance_m),
            recovered_after_s: self
                .ended_ns
                .and_then(|ended_ns| self.recovered_ns.map(after(ended_ns))),
        }
    }
}

/// Deserializes a number that may have been infinite, which JSON represents as `null`.
fn or_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::prediction::Cause;

    const NS_PER_S: u64 = 1_000_000_000;

    const AFFECTED_ROBOT: Struck =
        Struck { robot: Some(1), hearer: None, silenced: Silenced::Robot(1), lies: false };

    fn no_flags() -> impl Iterator<Item = ErrorFlags> {
        [[false; 2]; 3].into_iter()
    }

    fn names() -> Vec<String> {
        ["r1", "r2", "r3"].map(String::from).into()
    }

    fn contact_report(hearer: usize, neighbor: usize, contact: Contact, since_ns: u64) -> Report {
        Report { hearer, neighbor, contact, since_ns }
    }

    fn prediction() -> Prediction {
        let cause = Cause::Unled { leader: 1 };
        let broken = vec![Broken { robot: 0, cause, off_m: None, outside_m: None }];
        Prediction { broken, orphaned: vec![2] }
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
    fn calm_robot_that_does_not_recover_in_the_window_is_affected() {
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
        fault.end(End::Whole, 12 * NS_PER_S);
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
        assert_eq!(fault.end(End::ForGood, 10 * NS_PER_S), Silenced::Nobody);
        fault.add_truth(11 * NS_PER_S, 0.0, Some(9 * NS_PER_S), no_flags(), 1.0);
        assert_eq!(fault.end(End::Whole, 15 * NS_PER_S), Silenced::Robot(1));
        assert_eq!(fault.end(End::Whole, 16 * NS_PER_S), Silenced::Nobody, "it had ended already");
        fault.add_truth(16 * NS_PER_S, 0.5, None, no_flags(), 1.0);
        fault.add_truth(17 * NS_PER_S, 0.0, Some(17 * NS_PER_S), no_flags(), 1.0);
        let report = fault.report(&names(), 0.01);
        assert_eq!((report.lasted_s, report.recovered_after_s), (Some(5.0), Some(2.0)));
        assert_eq!(report.peak_error_m, 0.5);
    }

    #[test]
    fn lie_reports_that_nothing_is_predicted() {
        let struck = Struck { robot: Some(1), lies: true, ..Struck::default() };
        let what = "lie r2 beacons by [0.5, 0]".into();
        let fault = FaultWindow::new(0, what, struck, NS_PER_S, Prediction::default(), no_flags());
        let FaultReport { predicted, predicted_why, .. } = fault.report(&names(), 0.01);
        assert!(predicted.is_empty());
        assert_eq!(predicted_why, [NOT_PREDICTED]);
    }

    #[test]
    fn link_cut_is_detected_by_its_receiver() {
        let struck = Struck { hearer: Some(2), ..AFFECTED_ROBOT };
        let within_bound = [[true; 2]; 3].into_iter();
        let mut fault = FaultWindow::new(
            0,
            "cut r2->r3".into(),
            struck,
            10 * NS_PER_S,
            Prediction::default(),
            within_bound,
        );
        fault.record_contact(contact_report(0, 1, Contact::Stale, 11 * NS_PER_S));
        assert_eq!(fault.report(&names(), 0.01).stale_after_s, None);
        fault.record_contact(contact_report(2, 1, Contact::Stale, 12 * NS_PER_S));
        assert_eq!(fault.report(&names(), 0.01).stale_after_s, Some(2.0));
    }
}
