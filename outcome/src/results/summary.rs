//! What came out: summed up for programs, and on one screen for people.

use std::fmt::Write as _;

use protocol::brief::Pace;
use protocol::number::{self, told_apart};
use protocol::stage::{Cause, Stage};
use serde::Serialize;

use crate::metrics::Measures;
use crate::metrics::expect::{self, Expectation, Verdict};
use crate::metrics::summary::{Commands, GoalSummary, InformationAge, StageLatency, Summary, Wall};
use crate::results::outcome::Outcome;
use experiment::scenario::Scenario;
use formation::seconds;

/// Of more robots than this, the screen shows only those with the largest errors.
const ROBOTS_SHOWN: usize = 12;
/// The verdict on a run of which nothing is expected: it has neither passed nor failed.
const UNDECLARED: &str = "no expectations declared; exit code 0 says that the run ended as planned";

/// JSON with a final newline.
pub fn to_json<T: Serialize>(value: &T) -> String {
    let text = serde_json::to_string_pretty(value).expect("string keys and plain values only");
    text + "\n"
}

/// Puts together what came out.
pub fn sum_up(
    scenario: &Scenario,
    pace: Pace,
    measures: &Measures,
    outcome: &Outcome,
    expectations: Vec<Expectation>,
    exit: u8,
) -> Summary {
    let truth = outcome.truth.unwrap_or_default();
    let wall_s = outcome.wall.as_secs_f64();
    let per_wall = |amount: f64| if wall_s > 0.0 { amount / wall_s } else { 0.0 };
    let t_s = seconds(truth.t_ns);
    let by_robot = |counts: &[u64]| {
        let names = scenario.robots.iter().map(|robot| robot.name.clone());
        names.zip(counts.iter().copied()).collect()
    };
    let is_age = |line: &StageLatency| line.stage == Stage::BeaconAge.word();
    let (ages, latency) = outcome.latency.stages().into_iter().partition(is_age);
    let measures = measures.clone();
    Summary {
        scenario: scenario.name.clone(),
        pace,
        exit,
        interrupted: outcome.interrupted,
        acts_by_hand: outcome.acts_by_hand,
        t_s,
        ended_early: measures.ended_early_at_s.is_some(),
        ticks: truth.tick,
        trajectory_hash: measures.trajectory_hash,
        hash_by_second: measures.hash_by_second,
        min_distance_m: measures.min_distance_m,
        min_distance_pair: measures.min_distance_pair,
        min_distance_t_s: measures.min_distance_t_s,
        violations: measures.violations,
        min_clearance: measures.min_clearance,
        clearance_violations: measures.clearance_violations,
        final_error_m: measures.final_error_m,
        final_error_m_max: measures.final_error_m_max,
        final_ideal_error_m: measures.final_ideal_error_m,
        final_ideal_error_m_max: measures.final_ideal_error_m_max,
        tracking_error_m_max: measures.tracking_error_m_max,
        integrated_error_m_s: measures.integrated_error_m_s,
        hull_distance_m_max_final: measures.hull_distance_m_max_final,
        converged_at_s: measures.converged_at_s,
        arrived_at_s: measures.arrived_at_s,
        path_m: measures.path_m,
        path_over_straight: measures.path_over_straight,
        deadline_misses: outcome.deadline_misses,
        commands: Commands {
            late: truth.commands_late,
            old: truth.commands_old,
            not_finite: truth.commands_not_finite,
            scaled: truth.commands_scaled,
            expired: truth.commands_expired,
            age_ns_max: truth.command_age_ns_max,
            unanswered: outcome.odometry_old,
            lost: outcome.latency.commands_lost(),
        },
        beacons_refused: by_robot(&outcome.beacons_refused),
        alive_at_end: scenario
            .robots
            .iter()
            .zip(&measures.alive_at_end)
            .filter(|(_, alive)| **alive)
            .map(|(robot, _)| robot.name.clone())
            .collect(),
        truths_lost: measures.truths_lost,
        unseen_s: measures.unseen_s,
        ages,
        information_ages: outcome.latency.information_ages(),
        restarts: by_robot(&outcome.restarts),
        faults: measures.faults,
        expectations,
        wall: Wall {
            startup_s: outcome.startup.map(|startup| startup.as_secs_f64()),
            wall_s,
            ticks_per_s: per_wall(truth.tick as f64),
            real_time_factor: per_wall(t_s),
            latency,
            wake_of_all: outcome.latency.wake_of_all(),
            latencies_lost: outcome.latency.rows_lost(),
            processes: outcome.usages.clone(),
            hosts: outcome.hosts.clone(),
            goals: outcome.goals.clone(),
        },
    }
}

/// One screen for people: first whether it went as expected, then why.
pub fn screen(summary: &Summary) -> String {
    let mut text = String::new();
    let verdict = match (summary.interrupted, summary.exit) {
        (true, _) => "interrupted",
        (_, 4) => "ended early",
        _ => expect::worst(&summary.expectations).map_or(UNDECLARED, Verdict::of_all),
    };
    let _ = writeln!(text, "{}, {}: {verdict}", summary.scenario, summary.pace.word());
    for expectation in &summary.expectations {
        let Expectation { name, value, bound, reason, .. } = expectation;
        let sign = match expectation.verdict() {
            Verdict::Held => "held  ",
            Verdict::Missed => "MISSED",
            Verdict::Unseen => "UNSEEN",
        };
        let (value, bound) = match value {
            Some(value) => told_apart(*value, *bound).into(),
            None => ("-".to_owned(), number::short(*bound)),
        };
        let relation = expectation.relation();
        let reason = reason.as_ref().map_or(String::new(), |reason| format!(": {reason}"));
        let _ =
            writeln!(text, "  {sign} {name:<23} {value:>12}  required {relation} {bound}{reason}");
    }
    if let Some(advice) = overloaded(summary) {
        let _ = writeln!(text, "  {advice}");
    }
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<19} {value}");
    };
    if let (Some(distance), Some([a, b]), Some(t_s)) =
        (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s)
    {
        let violations = match summary.violations {
            0 => String::new(),
            ticks => format!(", below d at {ticks} ticks"),
        };
        let distance = digits(distance);
        row("smallest distance", format!("{distance} m, {a} - {b} at {t_s:.3} s{violations}"));
    }
    if let Some(clearance) = &summary.min_clearance {
        let whereabouts = clearance.whereabouts(summary.clearance_violations);
        row("smallest clearance", format!("{} m, {whereabouts}", digits(clearance.distance_m)));
    }
    let converged = summary.converged_at_s.map_or("never".into(), |t_s| format!("at {t_s:.3} s"));
    row("converged", converged);
    for (errors, all, largest) in [
        (&summary.final_error_m, "final errors, m", "largest errors, m"),
        (&summary.final_ideal_error_m, "to ideal places, m", "farthest off, m"),
    ] {
        let mut errors: Vec<_> = errors.iter().collect();
        let few = errors.len() <= ROBOTS_SHOWN;
        if !few {
            errors.sort_by(|(_, a), (_, b)| b.partial_cmp(a).expect("errors are no NaN"));
            errors.truncate(ROBOTS_SHOWN / 2);
        }
        let shown = errors.iter().map(|(robot, e)| format!("{robot} {}", short(*e)));
        row(if few { all } else { largest }, shown.collect::<Vec<_>>().join("  "));
    }
    let wall = &summary.wall;
    row(
        "time",
        format!(
            "{:.3} s run{} in {:.3} s of wall time, {:.0} ticks/s, {:.2} x real time",
            summary.t_s,
            if summary.ended_early { ", ended early," } else { "" },
            wall.wall_s,
            wall.ticks_per_s,
            wall.real_time_factor
        ),
    );
    if let Some(hash) = &summary.trajectory_hash {
        row("trajectory hash", hash.clone());
    }
    let Commands { late, old, not_finite, scaled, expired, lost, .. } = summary.commands;
    if summary.pace == Pace::Realtime {
        row("deadline misses", summary.deadline_misses.to_string());
    }
    let refused = late + old + not_finite;
    row("commands", format!("{refused} refused, {scaled} scaled, {expired} expired, {lost} lost"));
    let beacons: u64 = summary.beacons_refused.iter().map(|(_, refused)| refused).sum();
    if beacons > 0 {
        row("beacons", format!("{beacons} refused"));
    }
    if summary.truths_lost > 0 {
        let gaps = summary.unseen_s.iter();
        let gaps: String =
            gaps.map(|[from, until]| format!(", none from {from:.3} s to {until:.3} s")).collect();
        row("truths lost", format!("{}{gaps}", summary.truths_lost));
    }
    if wall.latencies_lost > 0 {
        row("latencies lost", wall.latencies_lost.to_string());
    }
    if let Some(InformationAge { robot, from, mean_ns, peak_ns, .. }) = summary.oldest() {
        let ms = |ns: f64| digits(ns / 1e6);
        let (mean, peak) = (ms(*mean_ns), ms(*peak_ns as f64));
        row("information age", format!("oldest {from} -> {robot}: mean {mean} ms, peak {peak} ms"));
    }
    let late = summary.late_by_cause();
    if !late.is_empty() {
        let total: u64 = late.iter().map(|&(_, count)| count).sum();
        let causes: Vec<String> =
            late.iter().map(|(cause, count)| format!("{} {count}", cause.words())).collect();
        row("late wake-ups", format!("{total}: {}", causes.join(", ")));
    }
    if let Some(GoalSummary { taken, refused }) = &wall.goals {
        let refused: Vec<String> =
            refused.iter().map(|(why, count)| format!("{why} {count}")).collect();
        let refused = match refused.as_slice() {
            [] => String::new(),
            reasons => format!("; refused: {}", reasons.join(", ")),
        };
        row("goals from ROS 2", format!("{taken} taken{refused}"));
    }
    for host in &wall.hosts {
        row(&format!("host {}", host.name), host.words());
    }
    let worst = summary.worst_latencies();
    if !worst.is_empty() {
        let _ = writeln!(
            text,
            "\n  {:<16} {:<16} {:>9} {:>9} {:>9} {:>9} {:>9}",
            "latency, us", "worst", "count", "p50", "p99", "p99.9", "max"
        );
        // Without the control timer there is nothing to hold it against.
        let all = summary.beside_the_machine().map(|[all, _]| all);
        for line in all.into_iter().chain(worst) {
            let edge = line.edge();
            let us = |ns: u64| digits(ns as f64 / 1e3);
            let _ = writeln!(
                text,
                "  {:<16} {edge:<16} {:>9} {:>9} {:>9} {:>9} {:>9}",
                line.stage,
                line.count,
                us(line.p50_ns),
                us(line.p99_ns),
                us(line.p99_9_ns),
                us(line.max_ns),
            );
        }
    }
    if !summary.faults.is_empty() {
        let _ = writeln!(
            text,
            "\n  {:>9}  {:<28} {:>9} {:>9} {:>11} {:>11} {:>12}",
            "fault, s", "what", "stale, s", "lost, s", "peak err, m", "min dist, m", "recovered, s"
        );
        for fault in &summary.faults {
            let _ = writeln!(
                text,
                "  {:>9.3}  {:<28} {:>9} {:>9} {:>11} {:>11} {:>12}",
                fault.t_s,
                fault.what,
                short(fault.stale_after_s),
                short(fault.lost_after_s),
                digits(fault.peak_error_m),
                short(fault.min_distance_m),
                short(fault.recovered_after_s),
            );
            let who = |robots: &[String]| match robots {
                [] => "nobody".to_owned(),
                [few @ .., _] if few.len() >= ROBOTS_SHOWN => {
                    format!("{} and {} more", robots[..8].join(", "), robots.len() - 8)
                }
                few => few.join(", "),
            };
            let (predicted, broken) = (who(&fault.predicted), who(&fault.broken));
            let affected = who(&fault.affected);
            let _ = writeln!(
                text,
                "{:13}predicted to break: {predicted}; observed: {broken}; affected: {affected}",
                ""
            );
            for line in &fault.predicted_why {
                let _ = writeln!(text, "{:15}{line}", "");
            }
            if !fault.orphaned.is_empty() {
                let _ = writeln!(text, "{:13}orphaned: {}", "", who(&fault.orphaned));
            }
        }
        let _ = writeln!(text, "  {}", summary.faults[0].broken_means());
    }
    text
}

/// What to do about a miss that may be the machine's: more than half of many late wake-ups waited for a
/// core.
fn overloaded(summary: &Summary) -> Option<String> {
    if expect::worst(&summary.expectations)? != Verdict::Missed {
        return None;
    }
    let late = summary.late_by_cause();
    let total: u64 = late.iter().map(|&(_, count)| count).sum();
    let waited = late.iter().find(|(cause, _)| *cause == Cause::Core)?.1;
    (summary.pace == Pace::Realtime && summary.deadline_misses > 0 && 2 * waited > total).then(|| {
        format!(
            "other programs wanted the cores ({waited} of {total} late wake-ups waited for one): \
             `--pace lockstep` does not depend on that"
        )
    })
}

fn short(value: Option<f64>) -> String {
    value.map_or("-".into(), digits)
}

/// Four significant digits.
fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if !(1e-3..1e5).contains(&size) => format!("{value:.1e}"),
        size => {
            let before = size.log10().floor() as i32;
            format!("{value:.*}", (3 - before).max(0) as usize)
        }
    }
}
