//! Evaluation of the scenario's expectations (acceptance criteria).
//!
//! An expectation is about robots, and does not hold if it is about none. The robots that the scenario expects to
//! be alive at the end are counted: all robots except the ones that the plan leaves dead; with `alive_at_end`, the
//! robots that it names, or as many as it requires.
//!
//! - A counted robot that is dead at the end fails the expectations about it: it neither converged nor kept its slot.
//! - An expectation about robots of which none is counted is missed; so is an expectation about a formation of
//!   which only one robot is counted. `alive_at_end` can declare that this is intended.
//! - An expectation that held in all samples, but could have failed while samples were lost, is *unseen*.

use protocol::brief::Pace;
use serde::{Deserialize, Serialize};

use super::RunMetrics;
use super::fault::FaultReport;
use super::finals::FINAL_FRACTION;
use experiment::scenario::{AliveAtEnd, FaultKind, Metric, MetricBounds, MetricSource, Scenario};
use formation::ns_to_seconds;
use protocol::number::format_short;

/// Verdict on an expectation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// The expectation holds.
    Held,
    /// The expectation does not hold.
    #[default]
    Missed,
    /// The expectation held in all samples, but samples were lost for too long to be certain.
    Unseen,
}

impl Verdict {
    /// Returns the keyword of the verdict.
    pub fn as_str(self) -> &'static str {
        match self {
            Verdict::Held => "held",
            Verdict::Missed => "missed",
            Verdict::Unseen => "unseen",
        }
    }

    /// Returns the verdict as text for the screen and the report.
    pub fn display_text(self) -> &'static str {
        match self {
            Verdict::Held | Verdict::Missed => self.as_str(),
            Verdict::Unseen => "not observed",
        }
    }

    /// Returns a sentence about all expectations of a run, given the worst verdict.
    pub fn describe_all(self) -> &'static str {
        match self {
            Verdict::Held => "every expectation held",
            Verdict::Missed => "an expectation was missed",
            Verdict::Unseen => "samples were lost: not known whether every expectation held",
        }
    }
}

/// One expectation and its result.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Expectation {
    /// Key of the expectation in the scenario.
    pub name: String,
    /// Measured value; `None` if the event never occurred.
    pub value: Option<f64>,
    /// Bound that the scenario sets.
    pub bound: f64,
    /// Whether the expectation held.
    pub held: bool,
    /// Verdict. Summaries of earlier versions have only `held`; use [`Expectation::verdict`].
    pub verdict: Verdict,
    /// Reason of a verdict that the value does not explain.
    pub reason: Option<String>,
}

impl Expectation {
    /// Returns the relation that the value must have to the bound: `>=`, `<=` or `=`.
    pub fn relation(&self) -> &'static str {
        match &*self.name {
            name if name.starts_with(METRIC_NAME_PREFIX) && name.ends_with(".min") => ">=",
            "min_distance_m" | "min_distance_over_d" | "min_clearance_m" | "alive_at_end" => ">=",
            "exit" => "=",
            _ => "<=",
        }
    }

    /// Returns the verdict, also for summaries that have only `held`.
    pub fn verdict(&self) -> Verdict {
        if self.held { Verdict::Held } else { self.verdict }
    }
}

/// A robot that was lost for good without being planned: dead, hung or stopped.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FailedRobot {
    /// Index of the robot in the scenario.
    pub robot: usize,
    /// Cause of the loss. The text follows the name of the robot.
    pub cause: String,
}

/// Beginning of the names of expectations about metrics of the experiment's own, such as `metrics.cost_m2.max`.
pub const METRIC_NAME_PREFIX: &str = "metrics.";

/// Reasons of a miss for a metric without a value, of a signal and of a program.
const NOT_RECORDED_REASON: &str = "no robot that was alive at the end recorded the signal";
const NOT_COMPUTED_REASON: &str = "its program gave no value";

/// Name of the expectation that every scenario has: no robot is lost for good without being planned.
pub const FAILED_ROBOTS_NAME: &str = "failed_robots";

/// Returns the missed expectation [`FAILED_ROBOTS_NAME`] if robots were lost that `alive_at_end` does not exempt;
/// `None` if none was.
pub fn failed_robots_expectation(
    scenario: &Scenario,
    failed: &[FailedRobot],
) -> Option<Expectation> {
    let is_required = |failed: &&FailedRobot| match &scenario.expectations.alive_at_end {
        None => true,
        Some(AliveAtEnd::Robots(robots)) => robots.contains(&failed.robot),
        Some(AliveAtEnd::Count(_)) => false,
    };
    let failed: Vec<&FailedRobot> = failed.iter().filter(is_required).collect();
    let describe =
        |failed: &&FailedRobot| format!("{} {}", scenario.robots[failed.robot].name, failed.cause);
    (!failed.is_empty()).then(|| Expectation {
        name: FAILED_ROBOTS_NAME.into(),
        value: Some(failed.len() as f64),
        bound: 0.0,
        held: false,
        verdict: Verdict::Missed,
        reason: Some(failed.iter().map(describe).collect::<Vec<_>>().join("; ")),
    })
}

/// Returns the worst verdict: missed is worse than unseen, unseen worse than held. Returns `None` without
/// expectations.
pub fn worst_verdict(expectations: &[Expectation]) -> Option<Verdict> {
    let worst_first = [Verdict::Missed, Verdict::Unseen, Verdict::Held];
    let occurred = |verdict: &Verdict| expectations.iter().any(|e| e.verdict() == *verdict);
    worst_first.into_iter().find(occurred)
}

/// The robots that an expectation is about.
#[derive(Clone, Copy, PartialEq)]
enum ExpectationScope {
    /// The complete run: dead robots do not change the verdict.
    Run,
    /// All robots, by their relative positions.
    Formation,
    /// The main leader.
    Leader,
    /// The followers of containment control.
    Followers,
}

/// An expectation of the scenario with its measured value.
struct Criterion {
    name: String,
    bound: f64,
    value: Option<f64>,
    holds: fn(f64, f64) -> bool,
    scope: ExpectationScope,
    /// Run time from which on every sample matters, s.
    relevant_start_s: f64,
    /// Reason of a miss that the value does not explain.
    miss_reason: Option<String>,
}

impl Criterion {
    /// Returns the criterion of an expectation about the complete run, of which no single sample matters; `None` if
    /// the scenario does not have this expectation.
    fn new(
        name: &str,
        bound: Option<f64>,
        value: Option<f64>,
        holds: fn(f64, f64) -> bool,
    ) -> Option<Criterion> {
        bound.map(|bound| Criterion {
            name: name.to_owned(),
            bound,
            value,
            holds,
            scope: ExpectationScope::Run,
            relevant_start_s: f64::INFINITY,
            miss_reason: None,
        })
    }

    /// Sets the robots that it is about, and the run time from which on every sample matters, s.
    fn with_scope(self, scope: ExpectationScope, relevant_start_s: f64) -> Criterion {
        Criterion { scope, relevant_start_s, ..self }
    }

    /// Sets the reason of a miss that the value does not explain.
    fn with_miss_reason(self, miss_reason: Option<String>) -> Criterion {
        Criterion { miss_reason, ..self }
    }
}

fn is_at_least(value: f64, bound: f64) -> bool {
    value >= bound
}

fn is_at_most(value: f64, bound: f64) -> bool {
    value <= bound
}

fn is_equal(value: f64, bound: f64) -> bool {
    value == bound
}

/// Evaluates every expectation of the scenario. `exit` is the exit code of the run itself.
pub fn evaluate(
    scenario: &Scenario,
    run_metrics: &RunMetrics,
    pace: Pace,
    deadline_misses: u64,
    exit: u8,
) -> Vec<Expectation> {
    let evaluator = Evaluator::new(scenario, run_metrics);
    criteria(scenario, run_metrics, pace, deadline_misses, exit)
        .into_iter()
        .map(|criterion| evaluator.evaluate(criterion))
        .collect()
}

fn criteria(
    scenario: &Scenario,
    run_metrics: &RunMetrics,
    pace: Pace,
    deadline_misses: u64,
    exit: u8,
) -> Vec<Criterion> {
    use ExpectationScope::{Followers, Formation, Leader, Run};
    let expect = &scenario.expectations;
    let end_s =
        if run_metrics.ended_early { run_metrics.t_s } else { ns_to_seconds(scenario.duration_ns) };
    let final_start_s = end_s * (1.0 - FINAL_FRACTION);
    let distance_over_d = run_metrics.distance_over_d(scenario.avoidance.distance_min_m);
    let clearance_m = run_metrics.min_clearance.as_ref().map(|clearance| clearance.distance_m);
    let lower_bound = |name, bound, value| {
        Criterion::new(name, bound, value, is_at_least)
            .map(|criterion| criterion.with_scope(Run, 0.0))
    };
    let upper_bound = |name, bound, value, scope, from_s| {
        let criterion = Criterion::new(name, bound, value, is_at_most);
        criterion.map(|criterion| criterion.with_scope(scope, from_s))
    };
    let converged_s = run_metrics.converged_at_s.unwrap_or(f64::INFINITY);
    let motion_criteria = [
        lower_bound("min_distance_m", expect.min_distance_m, run_metrics.min_distance_m),
        lower_bound("min_distance_over_d", expect.min_distance_over_d, distance_over_d),
        lower_bound("min_clearance_m", expect.min_clearance_m, clearance_m),
        upper_bound(
            "final_error_m_max",
            expect.final_error_m_max,
            run_metrics.final_error_m_max,
            Formation,
            final_start_s,
        ),
        upper_bound(
            "final_ideal_error_m_max",
            expect.final_ideal_error_m_max,
            run_metrics.final_ideal_error_m_max,
            Formation,
            final_start_s,
        ),
        upper_bound(
            "tracking_error_m_max",
            expect.tracking_error_m_max,
            run_metrics.tracking_error_m_max,
            Leader,
            final_start_s,
        ),
        upper_bound(
            "hull_distance_m_max",
            expect.hull_distance_m_max,
            run_metrics.hull_distance_m_max_final,
            Followers,
            final_start_s,
        ),
        upper_bound(
            "converged_by_s",
            expect.converged_by_s,
            run_metrics.converged_at_s,
            Formation,
            converged_s,
        ),
        recovery_criterion(expect.recovered_within_s, &run_metrics.faults),
    ];
    let misses_max = expect.deadline_misses_max.filter(|_| pace == Pace::Realtime);
    let (misses_max, misses) = (misses_max.map(|bound| bound as f64), Some(deadline_misses as f64));
    let (exit_code, exit) = (expect.exit_code.map(f64::from), Some(f64::from(exit)));
    let process_criteria = [
        Criterion::new("deadline_misses_max", misses_max, misses, is_at_most),
        Criterion::new("exit", exit_code, exit, is_equal),
        alive_criterion(scenario, run_metrics),
    ];
    motion_criteria
        .into_iter()
        .flatten()
        .chain(metric_criteria(scenario, run_metrics))
        .chain(process_criteria.into_iter().flatten())
        .collect()
}

/// Returns the criterion about the time to recover from each fault. A run without faults misses it, because the timeline
/// probably has a typing error.
fn recovery_criterion(bound: Option<f64>, faults: &[FaultReport]) -> Option<Criterion> {
    let recoveries: Option<Vec<f64>> = faults.iter().map(|fault| fault.recovered_after_s).collect();
    let slowest_s = recoveries.map(|all| all.into_iter().fold(0.0, f64::max));
    let slowest_s = slowest_s.filter(|_| !faults.is_empty());
    let first_s = faults.iter().map(|fault| fault.t_s).fold(f64::INFINITY, f64::min);
    let criterion = Criterion::new("recovered_within_s", bound, slowest_s, is_at_most)?;
    Some(
        criterion
            .with_scope(ExpectationScope::Formation, first_s)
            .with_miss_reason(explain_missing_recovery(faults)),
    )
}

/// Returns the criteria about metrics of the experiment's own.
fn metric_criteria(scenario: &Scenario, run_metrics: &RunMetrics) -> Vec<Criterion> {
    let criteria_of_metric = |MetricBounds { metric, min, max }: &MetricBounds| {
        let value = find_metric(run_metrics, metric);
        let reason = value.is_none().then(|| missing_value_reason(scenario, metric));
        let name = |bound: &str| format!("{METRIC_NAME_PREFIX}{metric}.{bound}");
        let criteria = [
            Criterion::new(&name("min"), *min, value, is_at_least),
            Criterion::new(&name("max"), *max, value, is_at_most),
        ];
        criteria.map(|criterion| Some(criterion?.with_miss_reason(reason.clone())))
    };
    scenario.expectations.metrics.iter().flat_map(criteria_of_metric).flatten().collect()
}

/// Returns the criterion about the robots that are alive at the end.
fn alive_criterion(scenario: &Scenario, run_metrics: &RunMetrics) -> Option<Criterion> {
    let expected = scenario.expectations.alive_at_end.as_ref()?;
    let all: Vec<usize> = (0..scenario.robots.len()).collect();
    let (robots, bound) = match expected {
        AliveAtEnd::Robots(robots) => (robots, robots.len() as f64),
        AliveAtEnd::Count(count) => (&all, *count as f64),
    };
    let names = robots.iter().map(|&robot| &scenario.robots[robot].name);
    let dead = names.filter(|name| !run_metrics.alive_at_end.contains(name));
    let dead: Vec<&str> = dead.map(|name| name.as_str()).collect();
    let alive = Some((robots.len() - dead.len()) as f64);
    let criterion = Criterion::new("alive_at_end", Some(bound), alive, is_at_least)?;
    Some(criterion.with_miss_reason(Some(format!("dead at the end: {}", dead.join(", ")))))
}

/// Returns why the time to recover from all faults is unknown; `None` if it is known.
fn explain_missing_recovery(faults: &[FaultReport]) -> Option<String> {
    if faults.is_empty() {
        return Some("the run had no fault".to_owned());
    }
    let unrecovered = faults.iter().find(|fault| fault.recovered_after_s.is_none())?;
    Some(format!("no recovery from {} at {} s", unrecovered.what, format_short(unrecovered.t_s)))
}

/// Returns the value of the metric `name` of the run; `None` if none of its signals was recorded.
fn find_metric(run_metrics: &RunMetrics, name: &str) -> Option<f64> {
    run_metrics.metrics.iter().find(|(metric, _)| metric == name).and_then(|(_, value)| *value)
}

/// Returns the reason why the metric `name` has no value.
fn missing_value_reason(scenario: &Scenario, name: &str) -> String {
    let is_program = |metric: &Metric| {
        metric.name == name && matches!(metric.source, MetricSource::Program { .. })
    };
    let reason = match scenario.metrics.iter().any(is_program) {
        true => NOT_COMPUTED_REASON,
        false => NOT_RECORDED_REASON,
    };
    reason.to_owned()
}

/// Data that a verdict needs in addition to the value.
struct Evaluator<'a> {
    scenario: &'a Scenario,
    run_metrics: &'a RunMetrics,
    /// Which robots were alive at the end, in scenario order.
    alive: Vec<bool>,
    counted_robots: Vec<bool>,
}

impl Evaluator<'_> {
    fn new<'a>(scenario: &'a Scenario, run_metrics: &'a RunMetrics) -> Evaluator<'a> {
        let robots = scenario.robots.iter();
        let alive = robots.map(|robot| run_metrics.alive_at_end.contains(&robot.name));
        let alive: Vec<bool> = alive.collect();
        let counted_robots = match &scenario.expectations.alive_at_end {
            None => robots_alive_by_plan(scenario),
            Some(AliveAtEnd::Robots(robots)) => {
                (0..alive.len()).map(|robot| robots.contains(&robot)).collect()
            }
            // Any robots may make up the number.
            Some(AliveAtEnd::Count(_)) => alive.clone(),
        };
        Evaluator { scenario, run_metrics, alive, counted_robots }
    }

    fn evaluate(&self, criterion: Criterion) -> Expectation {
        let Criterion { name, bound, value, holds, scope, relevant_start_s, miss_reason } =
            criterion;
        let holds = value.map(|value| holds(value, bound));
        let (verdict, reason) = match (self.unconditional_miss_reason(scope), holds) {
            (Some(reason), _) => (Verdict::Missed, Some(reason)),
            (None, Some(false)) => (Verdict::Missed, miss_reason),
            (None, holds) => match (self.unseen_period_text(relevant_start_s), holds) {
                (Some(reason), _) => (Verdict::Unseen, Some(reason)),
                (None, None) if !self.has_counted_robots(scope) => (Verdict::Held, None),
                (None, None) => (Verdict::Missed, miss_reason),
                (None, Some(_)) => (Verdict::Held, None),
            },
        };
        let held = verdict == Verdict::Held;
        Expectation { name, value, bound, held, verdict, reason }
    }

    /// Returns the reason if the expectation is missed for any measured value.
    fn unconditional_miss_reason(&self, scope: ExpectationScope) -> Option<String> {
        let robots = self.robots_in_scope(scope)?;
        if robots.is_empty() {
            return Some("the scenario has no such robot".to_owned());
        }
        let counted = |robot: &&usize| self.counted_robots[**robot];
        let counted: Vec<usize> = robots.iter().filter(counted).copied().collect();
        let dead = |robot: &usize| !self.alive[*robot];
        let dead: Vec<usize> = counted.iter().copied().filter(dead).collect();
        let is_intended = self.scenario.expectations.alive_at_end.is_some();
        match counted[..] {
            _ if !dead.is_empty() => Some(format!("dead at the end: {}", self.format_names(&dead))),
            _ if is_intended => None,
            [] => Some(format!("the plan leaves none of {} alive", self.format_names(&robots))),
            [robot] if scope == ExpectationScope::Formation && robots.len() > 1 => {
                Some(format!("only {} is left", self.format_names(&[robot])))
            }
            _ => None,
        }
    }

    /// Returns whether the expectation is about at least one counted robot.
    fn has_counted_robots(&self, scope: ExpectationScope) -> bool {
        self.robots_in_scope(scope)
            .is_none_or(|robots| robots.iter().any(|&robot| self.counted_robots[robot]))
    }

    fn robots_in_scope(&self, scope: ExpectationScope) -> Option<Vec<usize>> {
        match scope {
            ExpectationScope::Run => None,
            ExpectationScope::Formation => Some((0..self.counted_robots.len()).collect()),
            ExpectationScope::Leader => Some(self.scenario.leader().into_iter().collect()),
            ExpectationScope::Followers => Some(self.scenario.contained_robots()),
        }
    }

    /// Returns the first period of lost samples that the expectation depends on, as text.
    fn unseen_period_text(&self, relevant_start_s: f64) -> Option<String> {
        let is_relevant = |[_, until_s]: &&[f64; 2]| *until_s > relevant_start_s;
        let [from_s, until_s] = self.run_metrics.unseen_s.iter().find(is_relevant)?;
        Some(format!("no ground-truth samples from {from_s:.3} s to {until_s:.3} s"))
    }

    fn format_names(&self, robots: &[usize]) -> String {
        let names = robots.iter().map(|&robot| self.scenario.robots[robot].name.as_str());
        names.collect::<Vec<_>>().join(", ")
    }
}

/// Returns for each robot whether the plan leaves it alive: it is not killed, or restarted before the end.
fn robots_alive_by_plan(scenario: &Scenario) -> Vec<bool> {
    let mut alive = vec![true; scenario.robots.len()];
    for fault in &scenario.faults {
        if let FaultKind::Kill { robot, restart_after_ns } = fault.kind {
            let restart_ns =
                restart_after_ns.map(|after_ns| fault.start_ns.saturating_add(after_ns));
            alive[robot] = restart_ns.is_some_and(|restart_ns| restart_ns < scenario.duration_ns);
        }
    }
    alive
}

#[cfg(test)]
mod tests {
    use super::*;
    use experiment::examples::row_of_three;
    use experiment::scenario::{Expectations, Fault};
    use protocol::law::Role;

    const SECOND_NS: u64 = 1_000_000_000;

    fn run_metrics(alive: &[&str]) -> RunMetrics {
        RunMetrics {
            min_distance_m: Some(0.2),
            final_error_m_max: Some(0.5),
            final_ideal_error_m_max: Some(0.5),
            alive_at_end: alive.iter().map(|name| (*name).to_owned()).collect(),
            ..RunMetrics::default()
        }
    }

    const ALL_NAMES: [&str; 3] = ["r1", "r2", "r3"];

    /// Returns the row of three with these expectations.
    fn row_with_expectations(expect: impl FnOnce(&mut Expectations)) -> Scenario {
        let mut scenario = row_of_three();
        expect(&mut scenario.expectations);
        scenario
    }

    fn evaluate_single(scenario: &Scenario, run_metrics: &RunMetrics) -> (Verdict, Option<String>) {
        let found = evaluate(scenario, run_metrics, Pace::Lockstep, 0, 0);
        let [expectation] = &found[..] else { panic!("one expectation: {found:?}") };
        assert_eq!(expectation.held, expectation.verdict == Verdict::Held);
        (expectation.verdict(), expectation.reason.clone())
    }

    fn verdict_with_reason(reason: &str) -> (Verdict, Option<String>) {
        (Verdict::Missed, Some(reason.to_owned()))
    }

    const HELD: (Verdict, Option<String>) = (Verdict::Held, None);

    #[test]
    fn bounds_are_inclusive_and_absent_values_do_not_hold() {
        let scenario = row_with_expectations(|expect| {
            *expect = Expectations {
                min_distance_m: Some(0.2),
                final_error_m_max: Some(0.4),
                final_ideal_error_m_max: Some(0.5),
                tracking_error_m_max: Some(0.4),
                converged_by_s: Some(10.0),
                recovered_within_s: Some(1.0),
                deadline_misses_max: Some(0),
                exit_code: Some(0),
                ..expect.clone()
            }
        });
        let held = |pace| -> Vec<(String, bool)> {
            let found = evaluate(&scenario, &run_metrics(&ALL_NAMES), pace, 1, 0);
            found.into_iter().map(|expectation| (expectation.name, expectation.held)).collect()
        };
        let named = |held: &[(&str, bool)]| -> Vec<(String, bool)> {
            held.iter().map(|&(name, held)| (name.to_owned(), held)).collect()
        };
        let in_both_modes = [
            ("min_distance_m", true),
            ("final_error_m_max", false),
            ("final_ideal_error_m_max", true),
            ("tracking_error_m_max", false),
            ("converged_by_s", false),
            ("recovered_within_s", false),
        ];
        assert_eq!(held(Pace::Lockstep), named(&[&in_both_modes[..], &[("exit", true)]].concat()));
        let in_real_time = [("deadline_misses_max", false), ("exit", true)];
        assert_eq!(held(Pace::Realtime), named(&[&in_both_modes[..], &in_real_time[..]].concat()));
    }

    #[test]
    fn bounds_of_metrics_are_inclusive_and_need_a_value() {
        let scenario = row_with_expectations(|expect| {
            expect.metrics = vec![MetricBounds {
                metric: "cost_m2".to_owned(),
                min: Some(-1.0),
                max: Some(0.5),
            }];
        });
        let found = |value| -> Vec<(String, bool, String)> {
            let metrics = vec![("cost_m2".to_owned(), value)];
            let run_metrics = RunMetrics { metrics, ..run_metrics(&ALL_NAMES) };
            let found = evaluate(&scenario, &run_metrics, Pace::Lockstep, 0, 0);
            let fields = |e: Expectation| (e.relation().to_owned(), e.held, e.name);
            found
                .into_iter()
                .map(fields)
                .map(|(relation, held, name)| (name, held, relation))
                .collect()
        };
        let verdicts = |min, max| {
            [("metrics.cost_m2.min", min, ">="), ("metrics.cost_m2.max", max, "<=")]
                .map(|(name, held, relation)| (name.to_owned(), held, relation.to_owned()))
                .to_vec()
        };
        assert_eq!(found(Some(0.5)), verdicts(true, true));
        assert_eq!(found(Some(0.6)), verdicts(true, false));
        assert_eq!(found(Some(-1.1)), verdicts(false, true));
        assert_eq!(found(None), verdicts(false, false));
    }

    #[test]
    fn unplanned_death_at_end_is_not_converged() {
        let mut scenario = row_with_expectations(|expect| expect.converged_by_s = Some(10.0));
        let run_metrics = RunMetrics { converged_at_s: Some(3.0), ..run_metrics(&["r1", "r2"]) };
        assert_eq!(
            evaluate_single(&scenario, &run_metrics),
            verdict_with_reason("dead at the end: r3")
        );
        let kill = |at_s: u64, robot, restart_after_s: Option<u64>| Fault {
            start_ns: at_s * SECOND_NS,
            duration_ns: None,
            kind: FaultKind::Kill {
                robot,
                restart_after_ns: restart_after_s.map(|after_s| after_s * SECOND_NS),
            },
        };
        scenario.faults = vec![kill(4, 2, None)];
        assert_eq!(
            evaluate_single(&scenario, &run_metrics),
            HELD,
            "the plan leaves the robot dead"
        );
        scenario.faults = vec![kill(4, 2, None), kill(8, 2, Some(2))];
        assert_eq!(
            evaluate_single(&scenario, &run_metrics),
            verdict_with_reason("dead at the end: r3"),
            "the plan restarts it"
        );
        scenario.faults = vec![kill(4, 2, Some(30))];
        assert_eq!(evaluate_single(&scenario, &run_metrics), HELD, "the restart is after the end");
    }

    #[test]
    fn expectation_without_robots_is_missed_and_counts_use_living() {
        let mut hull = row_with_expectations(|expect| expect.hull_distance_m_max = Some(0.0));
        let run_metrics = run_metrics(&["r1", "r3"]);
        assert_eq!(
            evaluate_single(&hull, &run_metrics),
            verdict_with_reason("the scenario has no such robot")
        );
        hull.robots[1].role = Role::CONTAINED;
        assert_eq!(
            evaluate_single(&hull, &run_metrics),
            verdict_with_reason("dead at the end: r2")
        );
        for (count, held) in [(2, true), (3, false)] {
            hull.expectations.alive_at_end = Some(AliveAtEnd::Count(count));
            let found = evaluate(&hull, &run_metrics, Pace::Lockstep, 0, 0);
            let verdicts: Vec<bool> = found.iter().map(|expectation| expectation.held).collect();
            assert_eq!(verdicts, [true, held], "{found:?}");
        }
    }

    #[test]
    fn expectation_is_unseen_while_truths_were_lost() {
        let unseen_between = |from: f64, until: f64| {
            (
                Verdict::Unseen,
                Some(format!("no ground-truth samples from {from:.3} s to {until:.3} s")),
            )
        };
        let distance = row_with_expectations(|expect| expect.min_distance_m = Some(0.2));
        let lost = |from_s, until_s| RunMetrics {
            unseen_s: vec![[from_s, until_s]],
            ..run_metrics(&ALL_NAMES)
        };
        assert_eq!(evaluate_single(&distance, &lost(3.0, 5.0)), unseen_between(3.0, 5.0));
        let too_near = RunMetrics { min_distance_m: Some(0.1), ..lost(3.0, 5.0) };
        assert_eq!(
            evaluate_single(&distance, &too_near),
            (Verdict::Missed, None),
            "a violation was seen"
        );
        // The window is the last 10 % of 20 s.
        let errors = row_with_expectations(|expect| expect.final_error_m_max = Some(0.5));
        assert_eq!(evaluate_single(&errors, &lost(3.0, 5.0)), HELD);
        assert_eq!(evaluate_single(&errors, &lost(17.0, 18.5)), unseen_between(17.0, 18.5));
        let converged = row_with_expectations(|expect| expect.converged_by_s = Some(10.0));
        let since = |run_metrics| RunMetrics { converged_at_s: Some(6.0), ..run_metrics };
        assert_eq!(evaluate_single(&converged, &since(lost(3.0, 5.0))), HELD);
        assert_eq!(evaluate_single(&converged, &since(lost(7.0, 8.0))), unseen_between(7.0, 8.0));
        let recovered = row_with_expectations(|expect| expect.recovered_within_s = Some(5.0));
        let fault =
            FaultReport { t_s: 4.0, recovered_after_s: Some(1.0), ..FaultReport::default() };
        let with_fault = |run_metrics| RunMetrics { faults: vec![fault.clone()], ..run_metrics };
        assert_eq!(evaluate_single(&recovered, &with_fault(lost(1.0, 3.0))), HELD);
        assert_eq!(
            evaluate_single(&recovered, &run_metrics(&ALL_NAMES)),
            verdict_with_reason("the run had no fault")
        );
        let never = FaultReport { what: "kill r2".into(), t_s: 4.0, ..FaultReport::default() };
        let never = RunMetrics { faults: vec![fault.clone(), never], ..run_metrics(&ALL_NAMES) };
        assert_eq!(
            evaluate_single(&recovered, &never),
            verdict_with_reason("no recovery from kill r2 at 4 s")
        );
        assert_eq!(
            evaluate_single(&recovered, &with_fault(lost(3.0, 5.0))),
            unseen_between(3.0, 5.0)
        );
    }

    #[test]
    fn worst_verdict_is_missed_and_then_unseen() {
        let of = |verdict| Expectation {
            held: verdict == Verdict::Held,
            verdict,
            ..Expectation::default()
        };
        let [held, missed, unseen] = [Verdict::Held, Verdict::Missed, Verdict::Unseen].map(of);
        assert_eq!(worst_verdict(&[]), None);
        assert_eq!(worst_verdict(std::slice::from_ref(&held)), Some(Verdict::Held));
        assert_eq!(worst_verdict(&[held.clone(), unseen.clone()]), Some(Verdict::Unseen));
        assert_eq!(worst_verdict(&[unseen, held, missed]), Some(Verdict::Missed));
    }
}
