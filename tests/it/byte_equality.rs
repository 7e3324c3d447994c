//! What lockstep writes is a function of the run: the same bytes again, whatever the load.

use crate::harness::{Ended, in_parallel, run};

/// Name and bytes of everything that must be the same, `summary.json` without its section `wall`,
/// which stands at its end.
fn written(ended: &Ended) -> Vec<(&'static str, Vec<u8>)> {
    let file = |name: &str| std::fs::read(ended.run_dir().join(name)).unwrap_or_default();
    let summary = ended.file("summary.json");
    let (decided, wall) = summary.split_once("\n  \"wall\": {").unwrap_or_default();
    ended.claim(wall.contains("\"wall_s\""), "the summary ends with a section of wall times");
    let mut written = vec![("summary.json", decided.into())];
    for name in ["events.csv", "samples.csv", "pairs.csv", "run.mcap"] {
        ended.claim(file(name).len() > 100, format!("there is something in {name}"));
        written.push((name, file(name)));
    }
    written
}

/// Fails with the first line, or byte, in which two runs differ.
#[track_caller]
fn same_bytes(one: &Ended, other: &Ended) {
    for ((name, one_bytes), (_, other_bytes)) in written(one).iter().zip(&written(other)) {
        if one_bytes == other_bytes {
            continue;
        }
        let text = |bytes| String::from_utf8_lossy(bytes).into_owned();
        let (a, b) = (text(one_bytes), text(other_bytes));
        let lines = a.lines().zip(b.lines()).enumerate().find(|(_, (a, b))| a != b);
        let lines = lines.filter(|_| *name != "run.mcap");
        let at = one_bytes.iter().zip(other_bytes).position(|(a, b)| a != b);
        let sizes = (one_bytes.len(), other_bytes.len());
        other.claim(false, format!("{name} is the same: byte {at:?} of {sizes:?}, {lines:?}"));
    }
}

/// Everything at once: robots that are killed, frozen and deaf at the same time, and report it all at
/// the same time; beacons that overtake each other; bad sensors.
fn chaos() -> Ended {
    let set = [
        "expect={}",
        "duration_s=10",
        "chaos.from_s=1",
        "chaos.until_s=8",
        "chaos.mean_time_between_kills_s=1.5",
        "chaos.mean_time_between_freezes_s=1.5",
        "chaos.restart_after_s=0.5",
    ];
    let faults = [
        "kill r5 @3 restart 1",
        "kill r7 @3 restart 0.002",
        "freeze r2 @3 for 0.5",
        "kill r1 @6",
        "cut r1->r4 @4.001 for 2",
        "loss r6->r7 of 0.9 @2 for 5",
        "delay r7->r6 by 0.006 jitter 0.01 @0.5 for 4",
        "noise r3 odometry by 0.001 @1 for 3",
        "slow r8 by 0.003 @7 for 0.5",
    ];
    let ended = run("containment-chaos").lockstep().sets(set).faults(faults).finish();
    ended.exits_with(0).leaves_nothing();
    ended
}

#[test]
fn the_same_run_writes_the_same_bytes_idle_or_busy() {
    let idle = chaos();
    let faults = idle.summary["faults"].as_array().map_or(0, Vec::len);
    idle.claim(faults > 12, format!("there was chaos: {faults} faults"));
    let refused = idle.summary["beacons_refused"].as_object().unwrap().values();
    let refused: u64 = refused.filter_map(|count| count.as_u64()).sum();
    idle.claim(refused > 0, "beacons that overtook each other were refused");
    let ages = idle.summary["ages"].as_array().map_or(0, Vec::len);
    idle.claim(ages == 15, format!("every edge has ages: {ages}"));
    let events = idle.file("events.csv");
    let t_s = |line: &str| line.split_once(',').and_then(|(t_s, _)| t_s.parse::<f64>().ok());
    let times: Vec<_> = events.lines().skip(1).map(t_s).collect();
    idle.claim(times.len() > 100 && times.is_sorted(), "events stand in order of time");
    // Each keeps the cores of the others busy.
    in_parallel(&[(), ()], |()| same_bytes(&idle, &chaos()));
}
