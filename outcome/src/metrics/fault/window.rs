//! What one fault did: when it was noticed, how far it threw the formation off, when that was over.

use protocol::message::Contact;
use serde::{Deserialize, Deserializer, Serialize};

use super::Report;
use experiment::prediction::{Broken, broken_means, lines};
use experiment::scenario::{Silenced, Struck};
use formation::seconds;

/// What theory says of a lie.
const NOT_FORETOLD: &str = "what becomes of a lie is not predicted";

/// A fault while it is watched.
#[derive(Debug, Clone)]
pub(super) struct FaultWindow {
    pub(super) number: usize,
    what: String,
    struck: Struck,
    began_ns: u64,
    ended_ns: Option<u64>,
    /// When the robot came back; it may never.
    returned_ns: Option<u64>,
    stale_ns: Option<u64>,
    lost_ns: Option<u64>,
    /// Until the recovery.
    worst: Worst,
    /// Since the recovery: counts if that did not last, or if nothing was ever disturbed.
    worst_since: Worst,
    /// Whether an error was ever above the bound.
    disturbed: bool,
    recovered_ns: Option<u64>,
    foretold: Foretold,
    /// Whose errors have gone beyond the bound.
    left: Left,
    /// Another fault began after this one had recovered: what follows is not its doing.
    closed: bool,
}

/// What theory says of a fault when it begins.
#[derive(Debug, Clone, Default)]
pub(super) struct Foretold {
    /// Whom it breaks.
    pub(super) broken: Vec<Broken>,
    /// Those that it cuts off from their leader, by their places.
    pub(super) orphaned: Vec<usize>,
}

/// For a robot: by those it hears, and to the ideal formation.
pub(super) type Both = [bool; 2];

/// Who was within bounds when the fault began, and is not any more.
#[derive(Debug, Clone)]
struct Left {
    calm: Vec<Both>,
    left: Vec<Both>,
}

impl Left {
    fn new(calm: impl Iterator<Item = Both>, silenced: Silenced) -> Left {
        let counts = |i| silenced != Silenced::Robot(i);
        let calm: Vec<Both> =
            (0..).zip(calm).map(|(i, calm)| calm.map(|c| c && counts(i))).collect();
        Left { left: vec![[false; 2]; calm.len()], calm }
    }

    fn truth(&mut self, beyond: impl Iterator<Item = Both>) {
        for ((left, calm), beyond) in self.left.iter_mut().zip(&self.calm).zip(beyond) {
            *left = [calm[0] && beyond[0], calm[1] && beyond[1]];
        }
    }

    /// `error`: 0 by those heard, 1 to the ideal formation.
    fn names(&self, error: usize, names: &[String]) -> Vec<String> {
        let left = self.left.iter().zip(names).filter(|(left, _)| left[error]);
        left.map(|(_, name)| name.clone()).collect()
    }
}

/// How a fault ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// What it broke is whole again.
    Whole,
    /// Nothing will be made whole: it is over as soon as it began.
    ForGood,
}

/// The worst of a stretch of time.
#[derive(Debug, Clone, Copy)]
struct Worst {
    error_m: f64,
    distance_m: f64,
}

impl Worst {
    const NONE: Worst = Worst { error_m: 0.0, distance_m: f64::INFINITY };

    fn merge(&mut self, other: Worst) {
        self.error_m = self.error_m.max(other.error_m);
        self.distance_m = self.distance_m.min(other.distance_m);
    }
}

/// What one fault did, for the report.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FaultReport {
    /// When it began, s.
    pub t_s: f64,
    /// What it was.
    pub what: String,
    /// Whom it struck.
    pub robot: Option<String>,
    /// Robots that it breaks while it lasts, says the theory: that end more than
    /// `converged_error_m` off their places in the formation as planned.
    pub predicted: Vec<String>,
    /// Why, each line for all of whom it is true: `r1, r2: the leader r5 is dead`.
    pub predicted_why: Vec<String>,
    /// Robots that it cut off from their leader: alive, in need of one, and no longer reached by one.
    pub orphaned: Vec<String>,
    /// Farther off its place than this, m, a robot is broken.
    pub broken_m: f64,
    /// Living robots other than the silenced that were within `broken_m` of their places in the
    /// formation as planned when it began, and were not when it ended (or, if it never does, at last).
    pub broken: Vec<String>,
    /// The same by the error to those that a robot still hears: whose error was below
    /// `converged_error_m` when it
    /// began, and above it when it ended (or, if it never does, at last): who did not find back
    /// into bounds while it lasted.
    pub affected: Vec<String>,
    /// From its beginning until what it broke was whole again (a restart's first tick), s.
    pub lasted_s: Option<f64>,
    /// From its beginning until the first neighbour called the robot stale, s.
    pub stale_after_s: Option<f64>,
    /// From its beginning until the first neighbour called the robot lost, s.
    pub lost_after_s: Option<f64>,
    /// Worst error of a living robot until the recovery, m; if nothing was disturbed, until the
    /// next fault or the run's end.
    #[serde(deserialize_with = "or_infinite")]
    pub peak_error_m: f64,
    /// Smallest distance over the same time, m.
    pub min_distance_m: Option<f64>,
    /// From its end until all living errors were, and stayed, below `converged_error_m`, s; 0 if
    /// they were all the time since.
    pub recovered_after_s: Option<f64>,
}

impl FaultReport {
    /// What broken means, in words.
    pub fn broken_means(&self) -> String {
        broken_means(self.broken_m)
    }
}

impl FaultWindow {
    /// `foretold`: what theory says of it. `calm`: whose error is below the bound, by those it hears
    /// and to the ideal formation.
    pub(super) fn new(
        number: usize,
        what: String,
        struck: Struck,
        began_ns: u64,
        foretold: Foretold,
        calm: impl Iterator<Item = Both>,
    ) -> FaultWindow {
        FaultWindow {
            foretold,
            left: Left::new(calm, struck.silenced),
            number,
            what,
            struck,
            began_ns,
            ended_ns: None,
            returned_ns: None,
            stale_ns: None,
            lost_ns: None,
            worst: Worst::NONE,
            worst_since: Worst::NONE,
            disturbed: false,
            recovered_ns: None,
            closed: false,
        }
    }

    /// Nothing changes any more; or, of what had ended for good, it is whole after all. Gives what it
    /// had silenced and no longer does.
    pub(super) fn ended(&mut self, end: End, t_ns: u64) -> Silenced {
        if self.returned_ns.is_some() {
            return Silenced::Nobody;
        }
        self.ended_ns = Some(t_ns);
        if end == End::ForGood {
            return Silenced::Nobody;
        }
        self.returned_ns = Some(t_ns);
        self.struck.silenced
    }

    pub(super) fn another_began(&mut self) {
        self.closed |= self.recovered_ns.is_some();
    }

    /// Takes in one truth; `calm_since_ns`: since when all living errors are below the bound;
    /// `beyond`: which living robots' errors are above it.
    pub(super) fn truth(
        &mut self,
        t_ns: u64,
        error_m: f64,
        calm_since_ns: Option<u64>,
        beyond: impl Iterator<Item = Both>,
        distance_m: f64,
    ) {
        if self.closed || t_ns < self.began_ns {
            return;
        }
        if self.returned_ns.is_none_or(|returned_ns| t_ns <= returned_ns) {
            self.left.truth(beyond);
        }
        self.disturbed |= calm_since_ns.is_none();
        let ended_ns = self.ended_ns.filter(|&ended_ns| t_ns >= ended_ns);
        // A truth of the very instant of its end cannot tell what the fault has led to.
        self.recovered_ns = match (ended_ns, calm_since_ns) {
            (Some(ended_ns), Some(calm_ns)) if t_ns > ended_ns => Some(calm_ns.max(ended_ns)),
            _ => None,
        };
        let now = Worst { error_m, distance_m };
        if ended_ns.is_some() && calm_since_ns.is_some() {
            self.worst_since.merge(now);
        } else {
            self.worst.merge(std::mem::replace(&mut self.worst_since, Worst::NONE));
            self.worst.merge(now);
        }
    }

    /// Takes in how somebody is heard, in any order; the first to hear the struck so counts.
    pub(super) fn contact(&mut self, report: Report) {
        let Report { hearer, neighbor, contact, since_ns } = report;
        let struck = self.struck.robot == Some(neighbor)
            && self.struck.hearer.is_none_or(|only| only == hearer);
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

    /// `broken_m`: farther off its place than this, m, a robot is broken.
    pub(super) fn report(&self, names: &[String], broken_m: f64) -> FaultReport {
        let broken = &self.foretold.broken;
        let after = |from_ns: u64| move |t_ns: u64| seconds(t_ns.saturating_sub(from_ns));
        let since_begin = after(self.began_ns);
        let name = |robot: usize| names[robot].as_str();
        // What began after the return is not this fault's; the return may be told last.
        let meanwhile =
            |&since_ns: &u64| self.returned_ns.is_none_or(|back_ns| since_ns <= back_ns);
        let mut worst = self.worst;
        if self.recovered_ns.is_none() || !self.disturbed {
            worst.merge(self.worst_since);
        }
        let mut predicted_why = lines(broken.iter().map(|one| (name(one.robot), one.why(name))));
        predicted_why.extend(self.struck.lies.then(|| NOT_FORETOLD.to_owned()));
        FaultReport {
            t_s: seconds(self.began_ns),
            what: self.what.clone(),
            robot: self.struck.robot.map(|robot| names[robot].clone()),
            predicted: broken.iter().map(|one| names[one.robot].clone()).collect(),
            predicted_why,
            orphaned: self.foretold.orphaned.iter().map(|&i| names[i].clone()).collect(),
            broken: self.left.names(1, names),
            affected: self.left.names(0, names),
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

/// A number that may have been infinite, for which JSON has no word but `null`.
fn or_infinite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::prediction::Cause;

    const S: u64 = 1_000_000_000;

    const STRUCK: Struck =
        Struck { robot: Some(1), hearer: None, silenced: Silenced::Robot(1), lies: false };

    fn none() -> impl Iterator<Item = Both> {
        [[false; 2]; 3].into_iter()
    }

    fn names() -> Vec<String> {
        ["r1", "r2", "r3"].map(String::from).into()
    }

    fn heard(hearer: usize, neighbor: usize, contact: Contact, since_ns: u64) -> Report {
        Report { hearer, neighbor, contact, since_ns }
    }

    fn foretold() -> Foretold {
        let cause = Cause::Unled { leader: 1 };
        let broken = vec![Broken { robot: 0, cause, off_m: None, outside_m: None }];
        Foretold { broken, orphaned: vec![2] }
    }

    fn window() -> FaultWindow {
        FaultWindow::new(
            0,
            "kill r2".into(),
            STRUCK,
            10 * S,
            foretold(),
            [[true; 2]; 3].into_iter(),
        )
    }

    #[test]
    fn who_was_calm_and_does_not_find_back_while_it_lasts_is_affected() {
        let calm = [[true; 2], [true, false], [false, true]].into_iter();
        let mut fault = FaultWindow::new(0, "kill r2".into(), STRUCK, 10 * S, foretold(), calm);
        let all = || [[true; 2]; 3].into_iter();
        let affected = |fault: &FaultWindow| fault.report(&names(), 0.01).affected;
        let broken = |fault: &FaultWindow| fault.report(&names(), 0.01).broken;
        fault.truth(11 * S, 0.5, None, all(), 0.3);
        assert_eq!(affected(&fault), ["r1"], "r2 is dead, and r3 was off before");
        assert_eq!(broken(&fault), ["r1", "r3"], "but r3 was in its place");
        fault.truth(12 * S, 0.0, None, none(), 0.3);
        fault.ended(End::Whole, 12 * S);
        fault.truth(13 * S, 0.5, None, all(), 0.3);
        assert!(affected(&fault).is_empty(), "what follows on the return is not the silence's");
        let FaultReport { predicted, predicted_why, orphaned, .. } = fault.report(&names(), 0.01);
        assert_eq!(predicted, ["r1"]);
        assert_eq!(predicted_why, ["r1: not reached by the leader r2"]);
        assert_eq!(orphaned, ["r3"]);
    }

    #[test]
    fn what_never_ends_stays_silenced_unless_it_is_brought_back_by_hand() {
        let mut fault = window();
        assert_eq!(fault.ended(End::ForGood, 10 * S), Silenced::Nobody);
        fault.truth(11 * S, 0.0, Some(9 * S), none(), 1.0);
        assert_eq!(fault.ended(End::Whole, 15 * S), Silenced::Robot(1));
        assert_eq!(fault.ended(End::Whole, 16 * S), Silenced::Nobody, "it had ended already");
        fault.truth(16 * S, 0.5, None, none(), 1.0);
        fault.truth(17 * S, 0.0, Some(17 * S), none(), 1.0);
        let report = fault.report(&names(), 0.01);
        assert_eq!((report.lasted_s, report.recovered_after_s), (Some(5.0), Some(2.0)));
        assert_eq!(report.peak_error_m, 0.5);
    }

    #[test]
    fn of_a_lie_it_is_said_that_nothing_is_foretold() {
        let struck = Struck { robot: Some(1), lies: true, ..Struck::default() };
        let what = "lie r2 beacons by [0.5, 0]".into();
        let fault = FaultWindow::new(0, what, struck, S, Foretold::default(), none());
        let FaultReport { predicted, predicted_why, .. } = fault.report(&names(), 0.01);
        assert!(predicted.is_empty());
        assert_eq!(predicted_why, [NOT_FORETOLD]);
    }

    #[test]
    fn a_cut_is_noticed_by_the_one_that_no_longer_hears() {
        let struck = Struck { hearer: Some(2), ..STRUCK };
        let calm = [[true; 2]; 3].into_iter();
        let mut fault =
            FaultWindow::new(0, "cut r2->r3".into(), struck, 10 * S, Foretold::default(), calm);
        fault.contact(heard(0, 1, Contact::Stale, 11 * S));
        assert_eq!(fault.report(&names(), 0.01).stale_after_s, None);
        fault.contact(heard(2, 1, Contact::Stale, 12 * S));
        assert_eq!(fault.report(&names(), 0.01).stale_after_s, Some(2.0));
    }
}
