//! From a neighbor's publication to its use: a real run, against bare iceoryx2 polled by processes
//! with the same timers, phases and graph, which think nothing.
//!
//! Whoever polls waits for its own timer, so most of an age is the phase between two timers. The
//! row "timers alone" tells that share. A sender that thinks for long publishes late, and its
//! samples look young: read the ages with the row from waking to publishing.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use agent::golden_phase;
use experiment::briefs;
use experiment::scenario::Scenario;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::clock::{self, Timer};
use protocol::message::Beacon;
use protocol::process::Stop;
use protocol::run_root::{self, RunRoot};
use protocol::service::{self, Factory, Node, Qos};
use protocol::stage::Stage;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::peers::{self, Peers};
use crate::quantiles::{QUANTILES, Quantiles, quantiles_us};
use crate::table::Row;
use crate::{BenchError, Measured, Place, Setting, child, failed, ring};

/// Rates of the robots, Hz.
const RATES_HZ: [u64; 2] = [100, 1000];
/// Fewer wake-ups than this measure the start.
const TICKS_MIN: u64 = 50;

/// What one measurement gave: means over all edges, or over all robots.
struct Told {
    /// From a beacon's sending to its taking by each that hears it.
    used: Quantiles,
    /// From the deadline of a timer to the process running.
    wake: Quantiles,
    /// From a robot's first look at its samples to the sending of its own.
    answer: Quantiles,
}

impl Told {
    /// Of any number of edges and robots, but not of none.
    fn mean(edges: &[Quantiles], wakes: &[Quantiles], answers: &[Quantiles]) -> Option<Told> {
        Some(Told { used: mean(edges)?, wake: mean(wakes)?, answer: mean(answers)? })
    }
}

fn mean(all: &[Quantiles]) -> Option<Quantiles> {
    let sum = |place: usize| all.iter().map(|quantiles| quantiles[place]).sum::<f64>();
    let mean = std::array::from_fn(|place| sum(place) / all.len() as f64);
    (!all.is_empty()).then_some(mean)
}

/// Measures in turns, about `seconds` each.
pub(crate) fn measure(setting: &Setting<'_>, robots: &[usize], seconds: f64) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    run_root::join(root.path())?;
    let node = service::node("bench")?;
    let mut rows = Vec::new();
    for rate_hz in RATES_HZ {
        for &robots in robots {
            let ticks = ((seconds * rate_hz as f64) as u64).max(TICKS_MIN);
            let text = ring::text(robots, ticks, 1.0 / rate_hz as f64);
            let scenario = ring::read(&text)?;
            let (mut ours, mut bare) = (Vec::new(), Vec::new());
            for round in 1..=rounds {
                let case = format!("neighbors, {robots} robots at {rate_hz} Hz");
                setting.progress(&format!("{case}, ours, round {round}"));
                let summary = child::run(root, stop, &text, Pace::Realtime)?;
                let nobody = || BenchError::Wrong(format!("{case}: nobody heard anybody"));
                ours.push(told_by(&summary).ok_or_else(nobody)?);
                setting.progress(&format!("{case}, iceoryx2 alone, round {round}"));
                let told = without_brains(root, stop, &node, &scenario, ticks)?;
                bare.push(told.ok_or_else(nobody)?);
            }
            let case = format!("{robots} robots at {rate_hz} Hz");
            rows.extend(rows_of(&case, &ours, &bare, timers_alone_us(&scenario)));
        }
    }
    Ok(rows)
}

fn rows_of(case: &str, ours: &[Told], bare: &[Told], timers_us: f64) -> Vec<Row> {
    let against = |what: &str, figure: &dyn Fn(&Told) -> f64| {
        let column = |told: &[Told]| told.iter().map(figure).collect();
        let what = format!("{case}, {what}, us");
        Row::against("neighbor", &what, "iceoryx2 alone, polled", column(ours), column(bare))
    };
    let mut rows = Vec::new();
    for (place, (_, name, _)) in QUANTILES.iter().enumerate() {
        rows.push(against(&format!("published to used {name}"), &|told| told.used[place]));
    }
    let what = format!("{case}, published to used p50, us");
    let used = ours.iter().map(|told| told.used[0]).collect();
    rows.push(Row::against("neighbor", &what, "timers alone", used, vec![timers_us; ours.len()]));
    rows.push(against("looking to publishing p50", &|told| told.answer[0]));
    rows.push(against("wake lateness p50", &|told| told.wake[0]));
    rows
}

/// From one timer's deadline to the next one of whoever hears it, mean of all edges, us.
fn timers_alone_us(scenario: &Scenario) -> f64 {
    let edges = scenario.graph.edges();
    let phase = |robot: usize| golden_phase(robot + 1);
    let shares = edges.iter().map(|edge| (phase(edge.to) - phase(edge.from)).rem_euclid(1.0));
    shares.sum::<f64>() / edges.len() as f64 * scenario.period_ns as f64 / 1e3
}

/// What a run's summary tells; `None` if nobody heard anybody.
fn told_by(summary: &Value) -> Option<Told> {
    let stages = summary["wall"]["latency"].as_array()?;
    let of = |stage: Stage| -> Vec<Quantiles> {
        let robots = |row: &&Value| row["stage"] == stage.word() && row["robot"] != "plant";
        let rows = stages.iter().filter(robots);
        let us = |row: &Value, key: &str| row[key].as_f64().unwrap_or(f64::NAN) / 1e3;
        rows.map(|row| QUANTILES.map(|(key, ..)| us(row, key))).collect()
    };
    Told::mean(&of(Stage::BeaconDelivery), &of(Stage::Wake), &of(Stage::Compute))
}

/// Beacons over iceoryx2 between processes without brains, plant and supervisor.
fn without_brains(
    root: &RunRoot,
    stop: &Stop,
    node: &Node,
    scenario: &Scenario,
    ticks: u64,
) -> Result<Option<Told>, BenchError> {
    let place = Place::new(root, "neighbor")?;
    let dir = place.path();
    let robots = scenario.robots.len();
    let results: Vec<PathBuf> =
        (1..=robots).map(|index| dir.join(format!("result-{index}.json"))).collect();
    let mut services: Vec<Factory<Beacon>> = Vec::new();
    let mut words: Vec<Vec<OsString>> = Vec::new();
    for (i, result) in results.iter().enumerate() {
        let hearers = Qos::of_robot(Pace::Realtime, scenario.graph.hearers_of(i).count());
        services.push(service::beacon(&scenario.robots[i].name).create(node, hearers)?);
        let told = briefs::agent(scenario, i, Pace::Realtime, root.path());
        let path = dir.join(format!("brief-{i}.toml"));
        std::fs::write(&path, brief::to_text(&told)).map_err(failed("write", &path))?;
        let peer = ["peer".into(), "neighbor".into(), path.into(), ticks.to_string().into()];
        words.push(peer.into_iter().chain([result.into()]).collect());
    }
    let peers = Peers::start(dir, stop, words)?;
    peers.go()?;
    let (mut edges, mut wakes, mut answers) = (Vec::new(), Vec::new(), Vec::new());
    for path in &results {
        let seen: Seen = peers.told(path)?;
        edges.extend(seen.used);
        wakes.extend(seen.wake);
        answers.extend(seen.answer);
    }
    drop((peers, services));
    Ok(Told::mean(&edges, &wakes, &answers))
}

/// What one process without a brain saw.
#[derive(Debug, Serialize, Deserialize)]
struct Seen {
    /// Of each neighbor that was heard.
    used: Vec<Quantiles>,
    wake: Option<Quantiles>,
    answer: Option<Quantiles>,
}

/// Hears the neighbors of this brief and is heard, at so many wake-ups; writes what it saw.
pub(crate) fn peer(brief_path: &Path, ticks: u64, result: &Path) -> Result<(), BenchError> {
    let brief: AgentBrief = brief::read(brief_path)?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    let dir = result.parent().unwrap_or(result);
    let node = service::node(&format!("neighbor-{}", brief.name))?;
    let opened = |name: &str| service::beacon(name).open(&node);
    let out = opened(&brief.name)?.publisher()?;
    let heard = brief.neighbors.iter().map(|neighbor| opened(&neighbor.name)?.subscriber());
    let heard: Vec<_> = heard.collect::<Result<_, _>>()?;
    peers::await_go(dir, brief.index - 1)?;

    let room = || Vec::with_capacity(ticks as usize);
    let mut used_ns: Vec<Vec<u64>> = heard.iter().map(|_| room()).collect();
    let (mut wake_ns, mut answer_ns) = (room(), room());
    let period_ns = brief.period_ns;
    let mut timer = Timer::new(period_ns, (golden_phase(brief.index) * period_ns as f64) as u64);
    for tick in 0..ticks {
        let Some(wake) = timer.wait() else { continue };
        let looked_ns = clock::now_ns();
        for (subscriber, used_ns) in heard.iter().zip(&mut used_ns) {
            let receive = || {
                let failed = |cause| BenchError::Wrong(format!("not received: {cause}"));
                subscriber.receive().map_err(failed)
            };
            while let Some(beacon) = receive()? {
                used_ns.push(clock::now_ns().saturating_sub(beacon.sent_ns));
            }
        }
        let sent_ns = clock::now_ns();
        let sent = out.send_copy(Beacon { tick, sent_ns, ..Beacon::default() });
        sent.map_err(|cause| BenchError::Wrong(format!("not sent: {cause}")))?;
        wake_ns.push(wake.lateness_ns);
        answer_ns.push(sent_ns - looked_ns);
    }
    // The bench ends this process once it has the result; nothing is then left to clean up.
    drop((out, heard, node));
    let seen = Seen {
        used: used_ns.into_iter().filter_map(quantiles_us).collect(),
        wake: quantiles_us(wake_ns),
        answer: quantiles_us(answer_ns),
    };
    peers::tell(result, &seen)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_robots_that_hear_each_other_wait_half_a_period_on_average_for_the_timers_alone() {
        let scenario = ring::read(&ring::text(2, 10, 0.001)).unwrap();
        assert!((timers_alone_us(&scenario) - 500.0).abs() < 1e-6);
    }

    #[test]
    fn every_edge_and_every_robot_counts_alike_and_the_plant_does_not() {
        let row = |stage: &str, robot: &str, p50_ns: u64| {
            serde_json::json!({
                "stage": stage, "robot": robot,
                "p50_ns": p50_ns, "p99_ns": 2 * p50_ns, "p99.9_ns": 3 * p50_ns,
            })
        };
        let rows = [
            row("beacon_delivery", "r1", 1000),
            row("beacon_delivery", "r2", 3000),
            row("wake", "plant", 9000),
            row("wake", "r1", 4000),
            row("compute", "r1", 5000),
        ];
        let told = told_by(&serde_json::json!({ "wall": { "latency": rows } })).unwrap();
        assert_eq!(told.used, [2.0, 4.0, 6.0]);
        assert_eq!((told.wake[0], told.answer[0]), (4.0, 5.0));
        assert!(told_by(&serde_json::json!({ "wall": { "latency": rows[2..] } })).is_none());
    }
}
