//! Latency statistics of a run: complete, consistent in all files, and in agreement with the events.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use hdrhistogram::Histogram;
use hdrhistogram::serialization::Deserializer;
use hdrhistogram::serialization::interval_log::{IntervalLogIterator, LogEntry};
use rustix::process::Signal;
use serde_json::Value;

use crate::harness::{FinishedRun, run, signal_pid};

/// Edges of the triangle: receiver and sender.
const EDGES: [(&str, &str); 3] = [("r1", "r2"), ("r2", "r3"), ("r3", "r1")];

const HALF_A_SECOND: Duration = Duration::from_millis(500);

const STAGES_OF_ROBOTS: [&str; 3] = ["odometry", "compute", "command"];

/// Stage, robot and neighbor.
type Key = (String, String, String);
/// Rows of `latency.csv`: the numbers by column.
type Lines = BTreeMap<Key, BTreeMap<String, f64>>;

fn lines(ended: &FinishedRun) -> Lines {
    let text = ended.file("latency.csv");
    let mut rows = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let columns = rows.next().expect("a header");
    assert_eq!(
        columns.join(","),
        "stage,robot,from,count,min_ns,p50_ns,p90_ns,p99_ns,p99.9_ns,p99.99_ns,max_ns,mean_ns"
    );
    rows.map(|row| {
        let numbers = columns[3..].iter().cloned().zip(row[3..].iter().map(|n| n.parse().unwrap()));
        ((row[0].clone(), row[1].clone(), row[2].clone()), numbers.collect())
    })
    .collect()
}

fn number(lines: &Lines, stage: &str, robot: &str, from: &str, column: &str) -> f64 {
    let key = key(stage, robot, from);
    let line = lines.get(&key).unwrap_or_else(|| panic!("no {key:?} in {:?}", lines.keys()));
    line[column]
}

fn key(stage: &str, robot: &str, from: &str) -> (String, String, String) {
    (stage.to_owned(), robot.to_owned(), from.to_owned())
}

/// Checks that quantiles increase from the minimum to the maximum, that the mean lies between these, and that summary
/// and HDR log agree with the table. Returns the table.
fn assert_consistent(ended: &FinishedRun) -> Lines {
    let lines = lines(ended);
    let rising_columns =
        ["min_ns", "p50_ns", "p90_ns", "p99_ns", "p99.9_ns", "p99.99_ns", "max_ns"];
    for (key, line) in &lines {
        let values = rising_columns.map(|column| line[column]);
        ended
            .assert_holds(values.is_sorted(), format!("the quantiles of {key:?} rise: {values:?}"));
        let spread = values[0]..=values[6];
        ended.assert_holds(
            spread.contains(&line["mean_ns"]),
            format!("so lies the mean of {key:?}"),
        );
    }

    let (ages, wall_latencies) = (&ended.summary["ages"], &ended.summary["wall"]["latency"]);
    let entries: Vec<&Value> =
        [ages, wall_latencies].into_iter().flat_map(|list| list.as_array().unwrap()).collect();
    let has_only_ages = ages.as_array().unwrap().iter().all(|entry| entry["stage"] == "beacon_age");
    ended.assert_holds(has_only_ages, "outside of what depends on wall time stand ages alone");
    ended.assert_holds(entries.len() == lines.len(), "the summary has every line of the table");
    for entry in entries {
        let name = |key: &str| entry[key].as_str().unwrap_or_default().to_owned();
        let line = &lines[&(name("stage"), name("robot"), name("from"))];
        for (column, value) in line {
            let same =
                entry[column].as_f64().is_some_and(|reported| (reported - value).abs() < 1e-6);
            ended.assert_holds(same, format!("{column} of {entry}"));
        }
    }

    let log = std::fs::read(ended.run_dir().join("latency.hlog")).unwrap();
    let mut logged = 0;
    for entry in IntervalLogIterator::new(&log) {
        let LogEntry::Interval(interval) = entry.unwrap() else { continue };
        let tag = interval.tag().unwrap().as_str();
        let (stage, edge) = tag.split_once(':').unwrap();
        let (from, robot) = edge.split_once("->").unwrap_or(("", edge));
        let line = &lines[&(stage.to_owned(), robot.to_owned(), from.to_owned())];
        let bytes = BASE64_STANDARD.decode(interval.encoded_histogram()).unwrap();
        let found: Histogram<u64> = Deserializer::new().deserialize(&mut &bytes[..]).unwrap();
        ended.assert_holds(found.len() as f64 == line["count"], format!("{tag}: as many values"));
        for (column, quantile) in
            [("p50_ns", 0.5), ("p99_ns", 0.99), ("p99.9_ns", 0.999), ("p99.99_ns", 0.9999)]
        {
            let value = found.value_at_quantile(quantile) as f64;
            let value = value.clamp(line["min_ns"], line["max_ns"]);
            ended.assert_holds(value == line[column], format!("{tag}: the same {column}"));
        }
        logged += 1;
    }
    ended.assert_holds(logged == lines.len(), "the HDR log has every line of the table");
    lines
}

#[test]
fn report_without_a_control_timer_omits_the_machine() {
    let ended = run("triangle")
        .set("duration_s=1")
        .set("expect={}")
        .set("realtime.control_timer=false")
        .finish();
    ended.exits_with(0).assert_leaves_nothing();
    let lines = assert_consistent(&ended);
    ended.assert_holds(lines.keys().all(|(stage, ..)| stage != "machine"), "no stage of it");
    ended.assert_holds(
        !ended.run_dir().join("logs/machine.jsonl").exists(),
        "no process that would report it",
    );
}

#[test]
fn realtime_run_reports_delays_of_every_robot_and_edge() {
    let ended = run("triangle").set("duration_s=4").set("expect={}").finish();
    ended.exits_with(0).assert_leaves_nothing();
    let lines = assert_consistent(&ended);
    let count = |stage: &str, robot: &str, from: &str| number(&lines, stage, robot, from, "count");
    // One value for each deadline, missed or not.
    ended.assert_holds(count("wake", "plant", "") >= 3999.0, "the plant woke every millisecond");
    let too_old = ended.summary["commands"]["unanswered"].as_f64().expect("it is counted");
    for (robot, from) in EDGES {
        let answers = count("compute", robot, "");
        ended.assert_holds((200.0..1200.0).contains(&answers), "it answered every 5 ms, or almost");
        ended.assert_holds(count("wake", robot, "") >= answers - 1.0, "and woke for each answer");
        let unanswered = count("odometry", robot, "") - answers;
        ended.assert_holds(
            (0.0..=too_old).contains(&unanswered),
            "to one odometry sample each, unless it was too old",
        );
        let commands = count("command", robot, "");
        ended.assert_holds(
            (1.0..=answers).contains(&commands),
            "each of them commands, unless lost",
        );
        let ages = count("beacon_age", robot, from);
        ended
            .assert_holds((1.0..answers).contains(&ages), "used once in each answer but the first");
        let deliveries = count("beacon_delivery", robot, from);
        ended.assert_holds(
            (1.0..=count("compute", from, "")).contains(&deliveries),
            "no more than was said",
        );
    }
    ended.assert_holds(
        count("machine", "machine", "") >= 1.0,
        "and a bare timer was late beside them",
    );
    let edges = lines.keys().filter(|(_, _, from)| !from.is_empty()).count();
    ended.assert_holds(edges == 2 * EDGES.len(), "no other robot is heard");
    let commands_received: f64 = EDGES.map(|(robot, _)| count("command", robot, "")).iter().sum();
    let answered: f64 = EDGES.map(|(robot, _)| count("compute", robot, "")).iter().sum();
    // The loss of the last commands may not be detected.
    ended.assert_holds(
        commands_received + ended.number("/commands/lost") <= answered,
        "no more commands were taken or lost than sent",
    );

    let processes = ended.summary["wall"]["processes"].as_array().unwrap();
    let names: Vec<&str> =
        processes.iter().filter_map(|process| process["name"].as_str()).collect();
    ended.assert_holds(
        names == ["supervisor", "plant", "r1", "r2", "r3", "machine"],
        "every process is there",
    );
    for process in processes {
        let of = |key: &str| process[key].as_f64().unwrap();
        ended.assert_holds(of("starts") == 1.0, "started once");
        ended.assert_holds(of("user_s") + of("system_s") > 0.0, "it took processor time");
        ended.assert_holds(of("voluntary_switches") > 100.0, "waited many times");
        ended.assert_holds(of("minor_faults") > 0.0, "and touched memory");
    }
}

#[test]
fn lockstep_beacons_are_one_period_old_at_every_tick() {
    let ended = run("triangle").lockstep().finish();
    ended.exits_with(0).assert_leaves_nothing();
    let lines = assert_consistent(&ended);
    let ticks = ended.number("/ticks");
    for (robot, from) in EDGES {
        for stage in STAGES_OF_ROBOTS {
            let count = number(&lines, stage, robot, "", "count");
            ended.assert_holds(
                count == ticks,
                format!("{stage} of {robot} at each of {ticks} ticks"),
            );
        }
        let age = |column: &str| number(&lines, "beacon_age", robot, from, column);
        ended.assert_holds(age("count") == ticks - 1.0, "at the first tick nothing was heard");
        ended.assert_holds(age("min_ns") == 5e6 && age("max_ns") == 5e6, "5 ms old, always");
        ended.assert_holds(age("p50_ns") == 5e6 && age("mean_ns") == 5e6, "and exactly");
    }
    ended.assert_holds(lines.len() == 4 * EDGES.len(), "no robot waits for a clock");
    ended.assert_holds(ended.number("/wall/latencies_lost") == 0.0, "no value is lost");
}

#[test]
fn measurements_before_a_kill_are_kept() {
    let fault = "kill r2 @15 restart 2";
    let ended = run("triangle").lockstep().set("expect={}").fault(fault).finish();
    ended.exits_with(0).assert_leaves_nothing();
    let lines = assert_consistent(&ended);
    // 3000 ticks before the death and 2600 after it. Values that were not yet sent are lost: at most 512, three of them
    // a tick.
    for stage in ["odometry", "compute"] {
        let count = number(&lines, stage, "r2", "", "count");
        ended.assert_holds(
            (5600.0 - 512.0 / 3.0..=5600.0).contains(&count),
            format!("{count} {stage}"),
        );
    }
    ended.assert_holds(
        number(&lines, "command", "r2", "", "count") == 5600.0,
        "the plant lost none",
    );
    let of_r2 = |process: &&Value| process["name"] == "r2";
    let r2 = ended.summary["wall"]["processes"].as_array().unwrap().iter().find(of_r2).unwrap();
    ended.assert_holds(r2["starts"] == 2, "both its processes are counted");
}

#[test]
fn externally_stopped_robot_is_late_for_each_missed_deadline() {
    let mut running = run("triangle").set("duration_s=6").set("expect={}").start();
    let r2 = running.pid_of("r2");
    running.wait_for("a second of samples", |run| {
        let samples = std::fs::read_to_string(run.run_dir().join("samples.csv")).ok()?;
        (samples.lines().count() > 300).then_some(())
    });
    let since = Instant::now();
    signal_pid(r2, Signal::STOP);
    running.wait_for("half a second", |_| (since.elapsed() > HALF_A_SECOND).then_some(()));
    signal_pid(r2, Signal::CONT);
    let ended = running.finish();
    ended.exits_with(0).assert_leaves_nothing();
    let lines = assert_consistent(&ended);
    let wake = |column: &str| number(&lines, "wake", "r2", "", column);
    let (late_ns, period_ns) = (wake("max_ns"), 5e6);
    ended.assert_holds(late_ns > 3.0 * period_ns, "it overslept");
    // L + (L - T) + (L - 2 T) + ... is at least L^2 / (2 T).
    let sum_ns = wake("mean_ns") * wake("count");
    ended.assert_holds(sum_ns >= late_ns * late_ns / (2.0 * period_ns), "and each deadline counts");
    ended.assert_holds(
        !lines.keys().any(|(stage, ..)| stage == "held"),
        "no planned fault caused it",
    );
    ended.assert_holds(latest_by_cause(&lines, "r2") == Some(late_ns), "and it has a cause");
}

/// Returns the maximum lateness of a robot's wake-ups with a known cause, ns. `None` without any.
fn latest_by_cause(lines: &Lines, robot: &str) -> Option<f64> {
    let is_lateness_of_robot = |(stage, of, _): &Key| stage.starts_with("late_") && of == robot;
    let lateness =
        lines.iter().filter(|(key, _)| is_lateness_of_robot(key)).map(|(_, line)| line["max_ns"]);
    lateness.reduce(f64::max)
}

#[test]
fn planned_freeze_or_slowdown_is_not_a_late_wake_up() {
    let ended = run("triangle")
        .set("duration_s=8")
        .set("expect={}")
        .fault("freeze r2 @1 for 3")
        .fault("slow r3 by 3 @1 for 0.1")
        .finish();
    ended.exits_with(0).assert_leaves_nothing();
    let lines = assert_consistent(&ended);
    for robot in ["r2", "r3"] {
        let late_ns = |stage: &str| number(&lines, stage, robot, "", "max_ns");
        let (wake_ns, held_ns) = (late_ns("wake"), late_ns("held"));
        ended
            .assert_holds(wake_ns < 2.5e9, format!("{robot}: {wake_ns} ns are no machine's doing"));
        ended.assert_holds(held_ns > 1e9, format!("{robot}: they stand apart: {held_ns}"));
        let late_ns = latest_by_cause(&lines, robot).unwrap_or(0.0);
        ended.assert_holds(late_ns <= wake_ns, format!("{robot}: and have no cause: {late_ns}"));
    }
    ended.assert_holds(number(&lines, "held", "r2", "", "count") == 1.0, "it woke from it once");
    ended.assert_holds(!lines.contains_key(&key("held", "r1", "")), "no planned fault held r1");
    ended.assert_holds(
        ended.number("/deadline_misses") >= 600.0,
        "the periods are missed all the same",
    );
}
