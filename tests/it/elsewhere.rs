//! Robots whose law is in a program of the scenario's own, whatever language it is written in: what all of them must show
//! in the pentagon, where r3 has that law, `mine`.

use crate::harness::{Ended, Phalanx};

/// The run with r3 by the law `mine`.
pub fn with_r3(run: Phalanx) -> Phalanx {
    run.set("robot.r3.law=mine")
}

#[track_caller]
pub fn keeps_its_distance(ended: &Ended) {
    let distance_m = ended.number("/min_distance_m");
    ended.claim(distance_m >= 0.3, format!("nobody came nearer than 0.3 m: {distance_m}"));
}

#[track_caller]
pub fn says(ended: &Ended, part: &str) {
    ended.claim(ended.stderr.contains(part), format!("it says {part:?}"));
}

/// The same law in both: the same trajectory, bit by bit.
#[track_caller]
pub fn moves_as(ended: &Ended, built_in: &Ended) {
    ended.exits_with(0).leaves_nothing();
    ended.claim(ended.hash() == built_in.hash(), format!("as {}", built_in.hash()));
    keeps_its_distance(ended);
}

/// r3 died, lives again, and harmed nobody.
#[track_caller]
pub fn r3_came_back(ended: &Ended) {
    ended.exits_with(0).leaves_nothing();
    keeps_its_distance(ended);
    let events = ended.file("events.csv");
    ended.claim(events.contains(",ready,r3,incarnation 1"), "r3 came back");
    let alive = ended.summary["alive_at_end"].to_string();
    ended.claim(alive.contains("r3"), format!("r3 lives at the end: {alive}"));
}
