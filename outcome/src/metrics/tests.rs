use super::fault::{FaultEnd, FaultReport};
use super::*;

use experiment::examples::row_of_three;
use formation::graph::FormationGraph;
use proptest::prelude::*;
use protocol::law::Role;

use crate::metrics::examples::{header, rows};

const SECOND_NS: u64 = 1_000_000_000;
const ALL_ALIVE: [bool; 3] = [true; 3];

/// Returns the formation with r3 off its slot by `offset_m`, towards r2.
fn rows_with_r3_displaced(offset_m: f64) -> [TruthRow; 3] {
    rows([0.0, -1.0, -2.0 + offset_m])
}

/// Returns the metrics of the row of three after these samples: tick, positions, and which robots are alive.
fn metrics_of_samples(
    truths: impl IntoIterator<Item = (u64, [TruthRow; 3], [bool; 3])>,
) -> Metrics {
    let mut metrics = Metrics::new(&row_of_three(), Pace::Lockstep);
    for (tick, rows, alive) in truths {
        metrics.add_truth(&header(tick), &rows, &alive);
    }
    metrics
}

/// Returns the metrics of a run in which r3 is off its slot by `offset_m` at each tick and all robots are alive.
fn metrics_with_r3_displaced<const N: usize>(truths: [(u64, f64); N]) -> RunMetrics {
    metrics_of_samples(
        truths.map(|(tick, offset_m)| (tick, rows_with_r3_displaced(offset_m), ALL_ALIVE)),
    )
    .finish()
}

fn is_close(a: Option<f64>, b: f64) -> bool {
    a.is_some_and(|a| (a - b).abs() < 1e-12)
}

#[test]
fn errors_are_distances_from_the_slot_given_by_in_neighbors() {
    let metrics = metrics_of_samples([(0, rows([0.0, -0.7, -1.5]), ALL_ALIVE)]);
    let errors = metrics.current_metrics().errors_m;
    assert_eq!(errors[0], None);
    assert!(is_close(errors[1], 0.3) && is_close(errors[2], 0.2), "{errors:?}");
}

#[test]
fn integrated_error_counts_only_the_time_alive() {
    // r3 dies after 3 s.
    let metrics = metrics_of_samples(
        (0..=4).map(|tick| (tick, rows_with_r3_displaced(0.25), [true, true, tick < 4])),
    );
    let integrated = metrics.finish().integrated_error_m_s;
    assert_eq!(integrated[0], ("r1".to_owned(), None));
    assert!(is_close(integrated[1].1, 0.0) && is_close(integrated[2].1, 0.75), "{integrated:?}");
}

#[test]
fn minimum_distance_has_its_pair_and_time() {
    let truths = [(0, 1.0), (1, 0.15), (2, 0.1), (3, 0.5)];
    let metrics =
        metrics_of_samples(truths.map(|(tick, x_m)| (tick, rows([0.0, 3.0, x_m]), ALL_ALIVE)))
            .finish();
    assert!(is_close(metrics.min_distance_m, 0.1));
    assert_eq!(metrics.min_distance_t_s, Some(2.0));
    assert_eq!(metrics.violations, 2);
}

#[test]
fn minimum_distance_includes_ticks_between_truths() {
    let mut metrics = metrics_of_samples([(0, rows_with_r3_displaced(0.0), ALL_ALIVE)]);
    metrics.record_unplanned_death(1, "signal 9", SECOND_NS / 4);
    let header_with_pair = TruthHeader {
        closest_m: 0.05,
        closest_t_ns: SECOND_NS / 2,
        closest_pair: [1, 2],
        violations: 4,
        commands_late: 3,
        ..header(1)
    };
    metrics.add_truth(&header_with_pair, &rows_with_r3_displaced(0.0), &ALL_ALIVE);
    let run_metrics = metrics.finish();
    assert_eq!((run_metrics.min_distance_m, run_metrics.min_distance_t_s), (Some(0.05), Some(0.5)));
    assert_eq!(run_metrics.violations, 4);
    assert_eq!(run_metrics.faults[0].min_distance_m, Some(0.05));
}

#[test]
fn single_robot_has_no_minimum_distance() {
    let mut scenario = row_of_three();
    scenario.robots.truncate(1);
    scenario.graph = FormationGraph::new(1, Vec::new());
    let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
    metrics.add_truth(&TruthHeader { ..header(0) }, &rows([0.0; 3])[..1], &[true]);
    let run_metrics = metrics.finish();
    assert_eq!((run_metrics.min_distance_m, run_metrics.final_error_m_max), (None, None));
}

#[test]
fn lost_samples_are_counted_by_gaps_and_repeated_ones_skipped() {
    let metrics = metrics_with_r3_displaced([1, 2, 6, 6, 7].map(|tick| (tick, 0.0)));
    assert_eq!(metrics.truths_lost, 4);
    // Tick 0 was lost before the first sample.
    assert_eq!(metrics.unseen_s, [[0.0, 1.0], [2.0, 6.0]]);
}

#[test]
fn convergence_starts_after_the_last_large_error() {
    let metrics =
        metrics_with_r3_displaced([(0, 0.5), (1, 0.005), (2, 0.02), (3, 0.009), (4, 0.001)]);
    assert_eq!(metrics.converged_at_s, Some(3.0));
}

#[test]
fn disturbed_dead_or_nan_end_has_not_converged() {
    for (offset_m, alive) in [(0.5, ALL_ALIVE), (0.0, [false; 3]), (f64::NAN, ALL_ALIVE)] {
        let metrics = metrics_of_samples([
            (0, rows_with_r3_displaced(0.0), ALL_ALIVE),
            (1, rows_with_r3_displaced(offset_m), alive),
        ]);
        assert_eq!(metrics.finish().converged_at_s, None);
    }
}

#[test]
fn dead_robots_do_not_affect_convergence_and_final_errors() {
    let truths = (0..=20).map(|tick| (tick, rows_with_r3_displaced(0.5), [true, true, false]));
    let metrics = metrics_of_samples(truths).finish();
    assert_eq!(metrics.converged_at_s, Some(0.0));
    let finals: Vec<_> = metrics.final_error_m.into_iter().map(|(_, e)| e).collect();
    assert_eq!(finals, [None, Some(0.0), None]);
    assert_eq!(metrics.alive_at_end, ["r1", "r2"]);
}

#[test]
fn final_errors_are_the_worst_of_the_last_tenth_of_the_run() {
    let metrics = metrics_with_r3_displaced([(0, 0.9), (17, 0.8), (18, 0.3), (19, 0.4), (20, 0.1)]);
    assert!(is_close(metrics.final_error_m_max, 0.4));
    assert_eq!(metrics_with_r3_displaced([(0, 0.0)]).final_error_m_max, None);
}

/// Returns the report of a run in which r2 is killed at 3 s and moves again at 5 s; `offset_m` is r3's error at each
/// tick.
fn report_of_replaced_robot(offset_m: &[f64]) -> FaultReport {
    let mut metrics = Metrics::new(&row_of_three(), Pace::Lockstep);
    for (tick, &offset_m) in (0u64..).zip(offset_m) {
        if tick == 3 {
            metrics.record_unplanned_death(1, "signal 9", tick * SECOND_NS);
        }
        if tick == 5 {
            metrics.end_fault(0, FaultEnd::Repaired, tick * SECOND_NS);
        }
        metrics.add_truth(
            &header(tick),
            &rows_with_r3_displaced(offset_m),
            &[true, !(3..5).contains(&tick), true],
        );
    }
    metrics.finish().faults.remove(0)
}

#[test]
fn fault_window_lasts_until_stable_recovery_or_the_end() {
    for (offset_m, lasted_s, recovered_after_s, peak_m, distance_m) in [
        //  0    1    2    3    4    5    6    7     8      9
        (
            &[0.6, 0.0, 0.0, 0.0, 0.2, 0.4, 0.3, 0.02, 0.009, 0.005][..],
            Some(2.0),
            Some(3.0),
            0.4,
            0.6,
        ),
        (&[0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.0, 0.0, 0.5, 0.0], Some(2.0), Some(4.0), 0.5, 0.5),
        (&[0.0, 0.0, 0.0, 0.0, 0.2, 0.2, 0.7], Some(2.0), None, 0.7, 0.3),
        // The replacement never moved.
        (&[0.0; 5], None, None, 0.0, 1.0),
        // No robot was disturbed.
        (&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.008, 0.0], Some(2.0), Some(0.0), 0.008, 0.992),
    ] {
        let fault = report_of_replaced_robot(offset_m);
        assert_eq!((fault.t_s, fault.robot.as_deref()), (3.0, Some("r2")));
        assert_eq!((fault.lasted_s, fault.recovered_after_s), (lasted_s, recovered_after_s));
        let has_peak_error = is_close(Some(fault.peak_error_m), peak_m);
        assert!(
            has_peak_error && is_close(fault.min_distance_m, distance_m),
            "{offset_m:?}: {fault:?}"
        );
    }
}

#[test]
fn later_fault_closes_only_the_window_of_a_recovered_fault() {
    let run = |offset_m: [f64; 8]| {
        let mut metrics = Metrics::new(&row_of_three(), Pace::Lockstep);
        for (tick, offset_m) in (0u64..).zip(offset_m) {
            if tick == 1 || tick == 5 {
                let fault = metrics.record_unplanned_death(0, "signal 9", tick * SECOND_NS);
                metrics.end_fault(fault, FaultEnd::Permanent, tick * SECOND_NS);
            }
            metrics.add_truth(&header(tick), &rows_with_r3_displaced(offset_m), &ALL_ALIVE);
        }
        metrics.finish().faults
    };
    let separate = run([0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.6, 0.0]);
    assert_eq!(
        (separate[0].recovered_after_s, separate[1].recovered_after_s),
        (Some(1.0), Some(2.0))
    );
    assert!(
        is_close(Some(separate[0].peak_error_m), 0.1)
            && is_close(Some(separate[1].peak_error_m), 0.6)
    );

    let overlapping = run([0.0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.6, 0.0]);
    assert_eq!(overlapping[0].recovered_after_s, Some(6.0));
    assert!(is_close(Some(overlapping[0].peak_error_m), 0.6));
}

#[test]
fn simultaneous_faults_share_their_effects() {
    let mut metrics = metrics_of_samples([(0, rows_with_r3_displaced(0.0), ALL_ALIVE)]);
    for fault in [0, 1] {
        metrics.record_unplanned_death(fault, "signal 9", SECOND_NS);
        metrics.end_fault(fault, FaultEnd::Permanent, SECOND_NS);
    }
    metrics.add_truth(&header(1), &rows_with_r3_displaced(0.0), &ALL_ALIVE);
    metrics.add_truth(&header(2), &rows_with_r3_displaced(0.5), &ALL_ALIVE);
    let faults = metrics.finish().faults;
    assert!(
        faults.iter().all(|f| f.recovered_after_s.is_none() && is_close(Some(f.peak_error_m), 0.5))
    );
}

/// Event of a run; reception states may be reported in any order.
#[derive(Debug, Clone, Copy)]
enum FaultSequenceStep {
    /// The plant reached this second.
    Truth(u64),
    Begin(usize, u64),
    End(usize, FaultEnd, u64),
    Reception(usize, usize, ReceptionState, u64),
}

/// r2 dies at 3 s, returns at 6 s, becomes silent at 7 s for another reason, and dies for good at 8 s; r1 dies
/// meanwhile.
const EVENT_SEQUENCE: [FaultSequenceStep; 25] = [
    FaultSequenceStep::Truth(0),
    FaultSequenceStep::Truth(1),
    FaultSequenceStep::Truth(2),
    FaultSequenceStep::Truth(3),
    FaultSequenceStep::Begin(0, 3),
    FaultSequenceStep::Truth(4),
    FaultSequenceStep::Begin(1, 4),
    FaultSequenceStep::End(1, FaultEnd::Permanent, 4),
    FaultSequenceStep::Truth(5),
    FaultSequenceStep::Truth(6),
    FaultSequenceStep::End(0, FaultEnd::Repaired, 6),
    FaultSequenceStep::Truth(7),
    FaultSequenceStep::Truth(8),
    FaultSequenceStep::Begin(2, 8),
    FaultSequenceStep::End(2, FaultEnd::Permanent, 8),
    FaultSequenceStep::Truth(9),
    FaultSequenceStep::Reception(2, 1, ReceptionState::Stale, 2),
    FaultSequenceStep::Reception(2, 1, ReceptionState::Stale, 5),
    FaultSequenceStep::Reception(0, 1, ReceptionState::Stale, 4),
    FaultSequenceStep::Reception(0, 1, ReceptionState::Lost, 6),
    FaultSequenceStep::Reception(2, 1, ReceptionState::Fresh, 6),
    FaultSequenceStep::Reception(2, 1, ReceptionState::Stale, 7),
    FaultSequenceStep::Reception(2, 1, ReceptionState::Lost, 9),
    FaultSequenceStep::Reception(1, 0, ReceptionState::Stale, 5),
    FaultSequenceStep::Reception(1, 0, ReceptionState::Lost, 8),
];

fn collect_fault_reports(steps: impl Iterator<Item = FaultSequenceStep>) -> Vec<FaultReport> {
    let mut metrics = Metrics::new(&row_of_three(), Pace::Lockstep);
    for robot in [1, 0, 1] {
        let affected = AffectedComponent {
            robot: Some(robot),
            silenced_source: SilencedSource::Robot(robot),
            ..AffectedComponent::default()
        };
        metrics.register_fault(format!("death of {robot}"), affected);
    }
    for step in steps {
        match step {
            FaultSequenceStep::Truth(tick) => {
                metrics.add_truth(&header(tick), &rows_with_r3_displaced(0.0), &ALL_ALIVE)
            }
            FaultSequenceStep::Begin(fault, s) => metrics.begin_fault(fault, s * SECOND_NS),
            FaultSequenceStep::End(fault, end, s) => metrics.end_fault(fault, end, s * SECOND_NS),
            FaultSequenceStep::Reception(receiver, neighbor, reception_state, s) => {
                metrics.record_reception(receiver, neighbor, reception_state, s * SECOND_NS);
            }
        }
    }
    metrics.finish().faults
}

proptest! {
    /// The order of reception reports depends on the machine: they arrive in any order, long before or after the
    /// event that they belong to.
    #[test]
    fn receptions_count_equally_in_any_report_order(
        step_indices in prop::collection::vec(0..=16usize, 9),
    ) {
        let (ordered_steps, receptions) = EVENT_SEQUENCE.split_at(16);
        // The other steps stay in order; each reception report is inserted before the step with its index.
        let receptions_before = |step_index: usize| {
            let indexed = step_indices.iter().zip(receptions);
            indexed.filter(move |(index, _)| **index == step_index).map(|(_, reception)| *reception).rev()
        };
        let steps = (0..=16).flat_map(|step_index| {
            receptions_before(step_index).chain(ordered_steps.get(step_index).copied())
        });
        let faults = collect_fault_reports(steps);
        let times: Vec<_> =
            faults.iter().map(|fault| (fault.stale_after_s, fault.lost_after_s)).collect();
        prop_assert_eq!(
            times,
            [(Some(1.0), Some(3.0)), (Some(1.0), Some(4.0)), (None, Some(1.0))]
        );
        prop_assert_eq!(faults, collect_fault_reports(EVENT_SEQUENCE.into_iter()));
    }
}

#[test]
fn old_reception_reports_are_dropped() {
    let mut metrics = Metrics::new(&row_of_three(), Pace::Lockstep);
    for tick in 0..100_000 {
        metrics.add_truth(&header(tick), &rows_with_r3_displaced(0.0), &ALL_ALIVE);
        metrics.record_reception(2, 1, ReceptionState::Stale, tick * SECOND_NS);
    }
    assert!(metrics.faults.stored_report_count() < 100, "{}", metrics.faults.stored_report_count());
}

#[test]
fn new_goal_determines_errors_and_convergence_of_its_robot() {
    let mut scenario = row_of_three();
    for (robot, x_m) in scenario.robots.iter_mut().zip([0.0, 1.0, 2.0]) {
        (robot.role, robot.goal_m) = (Role::GOAL, Some([x_m, 0.0]));
    }
    let mut metrics = Metrics::new(&scenario, Pace::Realtime);
    metrics.add_truth(&header(0), &rows([0.5, 1.0, 2.0]), &ALL_ALIVE);
    metrics.add_truth(&header(1), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    assert_eq!(metrics.finish().converged_at_s, Some(ns_to_seconds(header(1).t_ns)));
    assert!(metrics.finish().path_over_straight.is_some());
    metrics.set_goal(2, Vec2::new(3.0, 0.0));
    metrics.add_truth(&header(2), &rows([0.0, 1.0, 2.25]), &ALL_ALIVE);
    for errors_m in [metrics.current_metrics().errors_m, metrics.current_metrics().ideal_errors_m] {
        let expected = errors_m.iter().zip([0.0, 0.0, 0.75]);
        assert!(expected.into_iter().all(|(&found, m)| is_close(found, m)), "{errors_m:?}");
    }
    assert_eq!(metrics.finish().converged_at_s, None);
    metrics.add_truth(&header(3), &rows([0.0, 1.0, 3.0]), &ALL_ALIVE);
    assert_eq!(metrics.finish().converged_at_s, Some(ns_to_seconds(header(3).t_ns)));
    assert_eq!(metrics.finish().path_over_straight, None, "it was not sent to one goal only");
}

/// The slots of the row are 0, -1 and -2 m; each robot steers within 0.21 m of another.
#[test]
fn robot_off_its_slot_at_the_end_waits_for_the_blocking_robot() {
    let mut scenario = row_of_three();
    scenario.avoidance_method.steering_distance = Some(("d_f", |_| 0.21));
    let waits = |x_m: [f64; 3], alive: [bool; 3]| {
        let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
        metrics.add_truth(&header(0), &rows(x_m), &alive);
        let waits = metrics.finish().waits;
        waits.iter().map(|wait| wait.describe()).collect::<Vec<_>>().join("; ")
    };
    assert_eq!(waits([0.0, -1.0, -2.0], ALL_ALIVE), "", "all robots have arrived");
    assert_eq!(waits([0.0, -1.0, -1.5], ALL_ALIVE), "", "no robot is in the way");
    // r2's slot is 1 m behind r1.
    assert_eq!(waits([0.0, -0.8, -1.0], [true, true, false]), "r2 by r3 (dead) in its slot");
    assert_eq!(waits([0.0, -0.4, -0.6], [true, true, false]), "r2 by r3 (dead) in its path");
    let found = waits([0.0, -0.7, -0.9], ALL_ALIVE);
    assert_eq!(found, "r2 by r3 in its slot");
}

#[test]
fn free_robots_are_evaluated_by_the_targets_of_their_laws() {
    let mut scenario = row_of_three();
    scenario.robots.iter_mut().for_each(|robot| robot.role = Role::FREE);
    let target = |x_m: f64, vx_m_s: f64| {
        let (position, velocity) = (Vec2::new(x_m, 0.0), Vec2::new(vx_m_s, 0.0));
        Some(Target { position, velocity })
    };
    let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
    metrics.add_truth(&header(0), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    metrics.add_truth(&header(1), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    assert_eq!(metrics.current_metrics().errors_m, [None; 3]);
    let without_targets = metrics.finish();
    assert!(
        without_targets.is_unjudged
            && without_targets.converged_at_s.is_none()
            && without_targets.waits.is_empty()
    );
    // A target counts after the sample for which it was named, also if the report arrives earlier.
    metrics.set_own_target(0, header(2).t_ns, target(0.5, 1.0));
    metrics.add_truth(&header(2), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    assert_eq!(metrics.current_metrics().errors_m, [None; 3]);
    metrics.add_truth(&header(3), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    assert!(
        is_close(metrics.current_metrics().errors_m[0], 1.5),
        "{:?}",
        metrics.current_metrics().errors_m
    );
    metrics.set_own_target(0, header(3).t_ns, target(0.0, 0.0));
    metrics.add_truth(&header(4), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    let with_target = metrics.finish();
    assert_eq!(
        (with_target.is_unjudged, with_target.converged_at_s),
        (false, Some(ns_to_seconds(header(4).t_ns)))
    );
    metrics.set_own_target(0, header(4).t_ns, None);
    metrics.add_truth(&header(5), &rows([0.0, 1.0, 2.0]), &ALL_ALIVE);
    assert_eq!(
        (metrics.current_metrics().errors_m[0], metrics.finish().converged_at_s),
        (None, None)
    );
}
