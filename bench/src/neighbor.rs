//! Time from a neighbor's publication of a beacon to its use: a run in real time, compared with bare iceoryx2 polled
//! by processes with the same timers, phases and graph, but without controllers.
//!
//! A process that polls waits for its own timer, so most of the age of a beacon is the phase between two timers. The
//! row "timers alone" gives this part. A sender that computes for a long time publishes late, so its beacons appear
//! young: compare the ages with the row from polling to publishing.

use agent::golden_phase;
use anyhow::Context as _;
use experiment::briefs;
use experiment::scenario::Scenario;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::clock::{self, Timer};
use protocol::message::Beacon;
use protocol::run_root;
use protocol::service::{self, Factory, Node, Qos, send_slice};
use protocol::stage::Stage;
use protocol::wake::golden_phase_ns;
use serde::{Deserialize, Serialize};

use crate::peers::{self, PeerAddress, Peers};
use crate::quantiles::{QUANTILES, Quantiles, mean_quantiles, quantiles_us};
use crate::realtime::{DURATION_FACTOR, RATES_HZ};
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::RunProcess;
use crate::table::MeasurementTable;
use crate::{WorkDir, ring};

/// Minimum number of wake-ups. With fewer the start-up would dominate the measurement.
const TICKS_MIN: u64 = 50;

/// Quantiles of one measurement.
#[derive(Debug, Default, Serialize, Deserialize)]
struct NeighborTimes {
    /// Time from the sending of a beacon to its use, for each edge.
    send_to_use: Vec<Quantiles>,
    /// Time from polling the beacons to sending the own beacon, for each robot.
    poll_to_send: Vec<Quantiles>,
    /// Wake-up latency, for each robot.
    wake: Vec<Quantiles>,
}

impl NeighborTimes {
    /// Returns names and values, us: means over all edges or over all robots.
    ///
    /// # Errors
    /// If a measurement has no values.
    fn mean_times(&self) -> anyhow::Result<Vec<(String, f64)>> {
        let mean = |quantiles: &[Quantiles]| {
            mean_quantiles(quantiles).context("a measurement has no values: no beacon was received")
        };
        let delivery_times = QUANTILES.iter().zip(mean(&self.send_to_use)?);
        let delivery_times =
            delivery_times.map(|((_, name, _), us)| (format!("published to used {name}, us"), us));
        Ok(delivery_times
            .chain([("polling to publishing p50, us".to_owned(), mean(&self.poll_to_send)?[0])])
            .chain([("wake-up latency p50, us".to_owned(), mean(&self.wake)?[0])])
            .collect())
    }
}

/// Returns a case for each rate and number of robots.
pub(crate) fn cases<'a>(
    settings: &'a BenchSettings<'_>,
    robots: &[usize],
) -> anyhow::Result<Vec<BenchCase<'a>>> {
    run_root::join(settings.root.path())?;
    let case = |rate_hz: u64, robots: usize| {
        let seconds = DURATION_FACTOR * settings.duration_s;
        let ticks = ((seconds * rate_hz as f64) as u64).max(TICKS_MIN);
        let text = ring::ring_scenario_text(robots, ticks, 1.0 / rate_hz as f64);
        let scenario = ring::parse_scenario(&text)?;
        let node = service::create_node("bench")?;
        let name = format!("{robots} robots at {rate_hz} Hz");
        Ok(BenchCase::new(name, move |table: &mut MeasurementTable| {
            let summary =
                RunProcess::start(settings, &text, Pace::Realtime, &[])?.wait_for_summary()?;
            let [used, answer, wake] = [Stage::BeaconDelivery, Stage::Compute, Stage::Wake]
                .map(|stage| summary.stage_quantiles(stage));
            for (what, us) in
                (NeighborTimes { send_to_use: used, poll_to_send: answer, wake }).mean_times()?
            {
                table.record_run(&what, us);
            }
            for (what, us) in measure_iceoryx2(settings, &node, &scenario, ticks)?.mean_times()? {
                table.record_baseline(&what, "iceoryx2 alone, polled", us);
            }
            let timers_us = mean_timer_phase_us(&scenario);
            table.record_baseline("published to used p50, us", "timers alone", timers_us);
            Ok(())
        }))
    };
    RATES_HZ.iter().flat_map(|&rate| robots.iter().map(move |&robots| case(rate, robots))).collect()
}

/// Returns the mean time from a timer deadline of a sender to the next deadline of its receiver over all edges, us.
fn mean_timer_phase_us(scenario: &Scenario) -> f64 {
    let edges = scenario.graph.edges();
    let phase = |robot: usize| golden_phase(robot + 1);
    let phases = edges.iter().map(|edge| (phase(edge.to) - phase(edge.from)).rem_euclid(1.0));
    phases.sum::<f64>() / edges.len() as f64 * scenario.period_ns as f64 / 1e3
}

/// Measures beacons over iceoryx2 between processes without controllers, plant and supervisor.
fn measure_iceoryx2(
    settings: &BenchSettings<'_>,
    node: &Node,
    scenario: &Scenario,
    ticks: u64,
) -> anyhow::Result<NeighborTimes> {
    let work_dir = WorkDir::new(settings.root, "neighbor")?;
    let dir = work_dir.path();
    let robots = scenario.robots.len();
    let mut services: Vec<Factory<[u8], Beacon>> = Vec::new();
    for (i, robot) in scenario.robots.iter().enumerate() {
        let qos = Qos::for_robot(Pace::Realtime, scenario.graph.outgoing_edges(i).count());
        services.push(service::beacon_topic(&robot.name).create(node, qos)?);
    }
    let root = settings.root.path();
    let briefs = (0..robots).map(|i| briefs::agent_brief(scenario, i, Pace::Realtime, root));
    peers::write_briefs(dir, briefs)?;
    let peers = Peers::start(dir, settings.stop, robots, "neighbor", &[ticks.to_string().into()])?;
    let mut total = NeighborTimes::default();
    for times in peers.wait_for_results::<NeighborTimes>()? {
        total.send_to_use.extend(times.send_to_use);
        total.poll_to_send.extend(times.poll_to_send);
        total.wake.extend(times.wake);
    }
    drop((peers, services));
    Ok(total)
}

/// Exchanges beacons with the neighbors of its brief for `ticks` wake-ups and reports the measured times.
pub(crate) fn run_peer(address: &PeerAddress, ticks: u64) -> anyhow::Result<()> {
    let brief: AgentBrief = brief::read(&address.brief_path())?;
    run_root::join(&brief.run_root)?;
    clock::tighten_timer_slack();
    let node = service::create_node(&format!("neighbor-{}", brief.name))?;
    let open_beacon_service = |name: &str| service::beacon_topic(name).open(&node);
    let publisher = open_beacon_service(&brief.name)?.publisher(0)?;
    let subscribers =
        brief.neighbors.iter().map(|neighbor| open_beacon_service(&neighbor.name)?.subscriber());
    let subscribers: Vec<_> = subscribers.collect::<Result<_, _>>()?;
    address.wait_for_start()?;

    let with_capacity = || Vec::with_capacity(ticks as usize);
    let mut delivery_ns: Vec<Vec<u64>> = subscribers.iter().map(|_| with_capacity()).collect();
    let (mut wake_ns, mut poll_to_send_ns) = (with_capacity(), with_capacity());
    let period_ns = brief.period_ns;
    let mut timer = Timer::new(period_ns, golden_phase_ns(brief.index, period_ns));
    for tick in 0..ticks {
        let Some(wake) = timer.wait() else { continue };
        let polled_ns = clock::now_ns();
        for (subscriber, delivery_ns) in subscribers.iter().zip(&mut delivery_ns) {
            while let Some(beacon) = subscriber.receive()? {
                delivery_ns.push(clock::now_ns().saturating_sub(beacon.user_header().sent_ns));
            }
        }
        let sent_ns = clock::now_ns();
        send_slice(&publisher, Beacon { tick, sent_ns, ..Beacon::default() }, 0, |_| 0)?;
        wake_ns.push(wake.lateness_ns);
        poll_to_send_ns.push(sent_ns - polled_ns);
    }
    // Cleans up now, because the bench kills this process once it has the result.
    drop((publisher, subscribers, node));
    address.report_result(&NeighborTimes {
        send_to_use: delivery_ns.into_iter().filter_map(quantiles_us).collect(),
        poll_to_send: quantiles_us(poll_to_send_ns).into_iter().collect(),
        wake: quantiles_us(wake_ns).into_iter().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_timer_phase_of_two_robots_is_half_a_period() {
        let scenario = ring::parse_scenario(&ring::ring_scenario_text(2, 10, 0.001)).unwrap();
        assert!((mean_timer_phase_us(&scenario) - 500.0).abs() < 1e-6);
    }

    #[test]
    fn mean_times_weight_edges_and_robots_equally() {
        let send_to_use = vec![[1.0, 2.0, 3.0], [3.0, 6.0, 9.0]];
        let times =
            NeighborTimes { send_to_use, poll_to_send: vec![[5.0; 3]], wake: vec![[4.0; 3]] };
        let means: Vec<f64> = times.mean_times().unwrap().into_iter().map(|(_, us)| us).collect();
        assert_eq!(means, [2.0, 4.0, 6.0, 5.0, 4.0]);
        assert!(NeighborTimes::default().mean_times().is_err());
    }
}
