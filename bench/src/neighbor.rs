//! Time from a neighbor's publication to its use in a real run, compared with bare iceoryx2 polled by
//! processes with the same timers, phases and graph, but without controllers.
//!
//! A polling process waits for its own timer, so most of an age is the phase between two timers; the row
//! "timers alone" gives that part. A sender that computes for long publishes late, so that its samples
//! appear young: compare the ages together with the row from wake-up to publication.

use agent::golden_phase;
use anyhow::Context as _;
use experiment::briefs;
use experiment::scenario::Scenario;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::clock::{self, Timer};
use protocol::message::Beacon;
use protocol::run_root;
use protocol::service::{self, Factory, Node, Qos};
use protocol::stage::Stage;
use serde::{Deserialize, Serialize};

use crate::peers::{self, Peers, Post};
use crate::quantiles::{QUANTILES, Quantiles, mean, quantiles_us};
use crate::realtime::{LONGER, RATES_HZ};
use crate::rounds::{Case, Setting};
use crate::run::Run;
use crate::table::Table;
use crate::{Place, ring};

/// Minimum number of wake-ups; fewer would mostly measure the start.
const TICKS_MIN: u64 = 50;

/// Result of one measurement, per edge or per robot.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Seen {
    /// Time from the sending of a beacon to its use, for each edge.
    used: Vec<Quantiles>,
    /// Time from a robot's first read of its samples to the sending of its own beacon.
    answer: Vec<Quantiles>,
    /// Wake-up latency: time from the deadline of a timer until the process runs.
    wake: Vec<Quantiles>,
}

impl Seen {
    /// Returns names and values, us: means over all edges, or over all robots.
    fn figures(&self) -> anyhow::Result<Vec<(String, f64)>> {
        let mean = |all: &[Quantiles]| mean(all).context("nobody heard anybody");
        let used = QUANTILES.iter().zip(mean(&self.used)?);
        let used = used.map(|((_, name, _), us)| (format!("published to used {name}, us"), us));
        Ok(used
            .chain([("looking to publishing p50, us".to_owned(), mean(&self.answer)?[0])])
            .chain([("wake lateness p50, us".to_owned(), mean(&self.wake)?[0])])
            .collect())
    }
}

/// Returns a case for each rate and number of robots.
pub(crate) fn cases<'a>(
    setting: &'a Setting<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<Case<'a>>> {
    run_root::join(setting.root.path())?;
    let case = |rate_hz: u64, robots: usize| {
        let seconds = LONGER * setting.seconds;
        let ticks = ((seconds * rate_hz as f64) as u64).max(TICKS_MIN);
        let text = ring::text(robots, ticks, 1.0 / rate_hz as f64);
        let scenario = ring::read(&text)?;
        let node = service::node("bench")?;
        let name = format!("{robots} robots at {rate_hz} Hz");
        Ok(Case::new(name, move |table: &mut Table| {
            let summary = Run::start(setting, &text, Pace::Realtime, &[])?.summary()?;
            let [used, answer, wake] = [Stage::BeaconDelivery, Stage::Compute, Stage::Wake]
                .map(|stage| summary.stage(stage));
            for (what, us) in (Seen { used, answer, wake }).figures()? {
                table.run(&what, us);
            }
            for (what, us) in without_brains(setting, &node, &scenario, ticks)?.figures()? {
                table.baseline(&what, "iceoryx2 alone, polled", us);
            }
            let timers_us = timers_alone_us(&scenario);
            table.baseline("published to used p50, us", "timers alone", timers_us);
            Ok(())
        }))
    };
    RATES_HZ.iter().flat_map(|&rate| robots.iter().map(move |&robots| case(rate, robots))).collect()
}

/// Returns the time from a timer's deadline to the next deadline of its receiver, as mean over all edges, us.
fn timers_alone_us(scenario: &Scenario) -> f64 {
    let edges = scenario.graph.edges();
    let phase = |robot: usize| golden_phase(robot + 1);
    let shares = edges.iter().map(|edge| (phase(edge.to) - phase(edge.from)).rem_euclid(1.0));
    shares.sum::<f64>() / edges.len() as f64 * scenario.period_ns as f64 / 1e3
}

/// Measures beacons over iceoryx2 between processes without controllers, plant and supervisor.
fn without_brains(
    setting: &Setting<'_>,
    node: &Node,
    scenario: &Scenario,
    ticks: u64,
) -> anyhow::Result<Seen> {
    let place = Place::new(setting.root, "neighbor")?;
    let dir = place.path();
    let robots = scenario.robots.len();
    let mut services: Vec<Factory<Beacon>> = Vec::new();
    for (i, robot) in scenario.robots.iter().enumerate() {
        let hearers = Qos::of_robot(Pace::Realtime, scenario.graph.outgoing_edges(i).count());
        services.push(service::beacon(&robot.name).create(node, hearers)?);
    }
    let root = setting.root.path();
    let briefs = (0..robots).map(|i| briefs::agent(scenario, i, Pace::Realtime, root));
    peers::write_briefs(dir, briefs)?;
    let peers = Peers::start(dir, setting.stop, robots, "neighbor", &[ticks.to_string().into()])?;
    let mut all = Seen::default();
    for seen in peers.results::<Seen>()? {
        all.used.extend(seen.used);
        all.answer.extend(seen.answer);
        all.wake.extend(seen.wake);
    }
    drop((peers, services));
    Ok(all)
}

/// Exchanges beacons with the neighbors of its brief for this many wake-ups.
pub(crate) fn peer(post: &Post, ticks: u64) -> anyhow::Result<()> {
    let brief: AgentBrief = brief::read(&post.brief())?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    let node = service::node(&format!("neighbor-{}", brief.name))?;
    let opened = |name: &str| service::beacon(name).open(&node);
    let out = opened(&brief.name)?.publisher()?;
    let heard = brief.neighbors.iter().map(|neighbor| opened(&neighbor.name)?.subscriber());
    let heard: Vec<_> = heard.collect::<Result<_, _>>()?;
    post.wait_for_all()?;

    let room = || Vec::with_capacity(ticks as usize);
    let mut used_ns: Vec<Vec<u64>> = heard.iter().map(|_| room()).collect();
    let (mut wake_ns, mut answer_ns) = (room(), room());
    let period_ns = brief.period_ns;
    let mut timer = Timer::new(period_ns, (golden_phase(brief.index) * period_ns as f64) as u64);
    for tick in 0..ticks {
        let Some(wake) = timer.wait() else { continue };
        let looked_ns = clock::now_ns();
        for (subscriber, used_ns) in heard.iter().zip(&mut used_ns) {
            while let Some(beacon) = subscriber.receive()? {
                used_ns.push(clock::now_ns().saturating_sub(beacon.sent_ns));
            }
        }
        let sent_ns = clock::now_ns();
        out.send_copy(Beacon { tick, sent_ns, ..Beacon::default() })?;
        wake_ns.push(wake.lateness_ns);
        answer_ns.push(sent_ns - looked_ns);
    }
    // The bench ends this process once it has the result, so all ports are closed first.
    drop((out, heard, node));
    post.report(&Seen {
        used: used_ns.into_iter().filter_map(quantiles_us).collect(),
        answer: quantiles_us(answer_ns).into_iter().collect(),
        wake: quantiles_us(wake_ns).into_iter().collect(),
    })
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
    fn every_edge_and_every_robot_counts_alike() {
        let used = vec![[1.0, 2.0, 3.0], [3.0, 6.0, 9.0]];
        let seen = Seen { used, answer: vec![[5.0; 3]], wake: vec![[4.0; 3]] };
        let figures: Vec<f64> = seen.figures().unwrap().into_iter().map(|(_, us)| us).collect();
        assert_eq!(figures, [2.0, 4.0, 6.0, 5.0, 4.0]);
        assert!(Seen::default().figures().is_err());
    }
}
