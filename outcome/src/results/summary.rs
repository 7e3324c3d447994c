//! Creation of the summary of a run.

use protocol::brief::Pace;
use protocol::exit;
use protocol::law_message::{SentCounts, hash_bytes};
use protocol::stage::Stage;
use serde::Serialize;

use crate::metrics::Metrics;
use crate::metrics::expect;
use crate::metrics::summary::{CommandCounts, StageLatency, Summary, WallTimeValues};
use crate::results::outcome::RunOutcome;
use experiment::scenario::Scenario;
use formation::ns_to_seconds;

/// Formats a value as JSON with a final newline.
pub fn to_json<T: Serialize>(value: &T) -> String {
    let text = serde_json::to_string_pretty(value).expect("string keys and plain values only");
    text + "\n"
}

/// Evaluates the expectations of a scenario and returns the summary of the run. `run_exit` is the exit code
/// before the expectations are taken into account.
pub fn evaluate_run(
    scenario: &Scenario,
    pace: Pace,
    metrics: &Metrics,
    outcome: &RunOutcome,
    run_exit: u8,
) -> Summary {
    let mut summary = metrics.finish();
    for (name, value) in &outcome.program_metrics {
        let entry = summary.metrics.iter_mut().find(|(metric, _)| metric == name);
        entry.into_iter().for_each(|(_, metric_value)| *metric_value = *value);
    }
    let mut expectations =
        expect::evaluate(scenario, &summary, pace, outcome.deadline_misses, run_exit);
    expectations.extend(expect::failed_robots_expectation(scenario, &outcome.failed_robots));
    let all_held = expectations.iter().all(|expectation| expectation.held);
    let is_expected_exit = scenario.expectations.exit_code == Some(run_exit);
    let exit = match (run_exit, all_held) {
        (exit::OK, true) => exit::OK,
        (exit::OK, false) => exit::EXPECTATION_MISSED,
        (_, true) if is_expected_exit => exit::OK,
        (code, _) => code,
    };
    let newest_truth = outcome.newest_truth.unwrap_or_default();
    let wall_s = outcome.wall_time.as_secs_f64();
    let per_wall_second = |total: f64| if wall_s > 0.0 { total / wall_s } else { 0.0 };
    let t_s = ns_to_seconds(newest_truth.t_ns);
    let by_robot = |counts: &[u64]| {
        let names = scenario.robots.iter().map(|robot| robot.name.clone());
        names.zip(counts.iter().copied()).collect()
    };
    let counts_sent = scenario.counts_sent_messages();
    let sent = |number: fn(&SentCounts) -> u64| {
        let numbers: Vec<u64> = outcome.sent_counts.iter().map(number).collect();
        if counts_sent { by_robot(&numbers) } else { Vec::new() }
    };
    let is_age = |line: &StageLatency| line.stage == Stage::BeaconAge.keyword();
    let (ages, latency) = outcome.latency.stage_latencies().into_iter().partition(is_age);
    Summary {
        scenario: scenario.name.clone(),
        pace,
        exit,
        interrupted: outcome.was_interrupted,
        acts_by_hand: outcome.manual_interventions,
        t_s,
        ticks: newest_truth.tick,
        deadline_misses: outcome.deadline_misses,
        commands: CommandCounts {
            late: newest_truth.commands_late,
            old: newest_truth.commands_old,
            not_finite: newest_truth.commands_not_finite,
            scaled: newest_truth.commands_scaled,
            expired: newest_truth.commands_expired,
            age_ns_max: newest_truth.command_age_ns_max,
            unanswered: outcome.unanswered_samples,
            lost: outcome.latency.commands_lost(),
        },
        beacons_refused: by_robot(&outcome.refused_beacon_counts),
        beacons_sent: sent(|sent| sent.beacons),
        messages_sent: sent(|sent| sent.messages),
        messages_dropped: sent(|sent| sent.dropped_messages),
        message_hash: (counts_sent && pace == Pace::Lockstep)
            .then(|| message_hash(&outcome.sent_counts)),
        ages,
        information_ages: outcome.latency.information_ages(),
        restarts: by_robot(&outcome.restart_counts),
        expectations,
        wall: WallTimeValues {
            startup_s: outcome.startup_time.map(|startup| startup.as_secs_f64()),
            wall_s,
            ticks_per_s: per_wall_second(newest_truth.tick as f64),
            real_time_factor: per_wall_second(t_s),
            latency,
            wake_of_all: outcome.latency.wake_latency_of_all_robots(),
            latencies_lost: outcome.latency.rows_lost(),
            processes: outcome.usages.clone(),
            hosts: outcome.hosts.clone(),
            goals: outcome.goals.clone(),
        },
        ..summary
    }
}

/// Returns the hash of all messages of a run: equal if and only if each robot sent the same messages at the same ticks.
fn message_hash(sent: &[SentCounts]) -> String {
    let hash = sent.iter().fold(0, |hash, robot| {
        hash_bytes(
            hash_bytes(hash, &robot.messages.to_le_bytes()),
            &robot.message_hash.to_le_bytes(),
        )
    });
    format!("{hash:016x}")
}
