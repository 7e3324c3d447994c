//! Time from the timeout of an in-neighbor to the first sample for which the robot uses a backup neighbor instead. The
//! run in real time has kills; the times are the run times of the samples in its events. They include the waiting time
//! before the repair, the opening of the backup neighbor's beacon service and the wait for its next beacon.

use std::fmt::Write as _;

use anyhow::Context as _;
use outcome::results::page::parse_events;
use outcome::results::tables::EventLine;
use protocol::brief::Pace;

use crate::quantiles::{QUANTILES, quantiles_us};
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::RunProcess;

/// Number of robots in a line: each receives from its predecessor, and the first one is the leader.
const ROBOT_COUNT: usize = 8;
/// Rates of the robots, Hz.
const RATES_HZ: [u64; 2] = [200, 1000];
/// Time from the timeout of an in-neighbor until the robot opens a backup neighbor (`repair_after_s`), s.
const REPAIR_AFTER_S: f64 = 0.2;
/// Interval between kills, s; long enough that each kill finds the original graph restored.
const KILL_INTERVAL_S: f64 = 1.5;
/// Time from a kill to the restart of the robot, s.
const RESTART_DELAY_S: f64 = 0.6;
/// Number of quantiles shown: p50 and p99. A p99.9 would need more kills than fit into a measurement.
const SHOWN_QUANTILE_COUNT: usize = 2;

/// Returns a case for each rate, with `kills` kills.
pub(crate) fn cases<'a>(settings: &'a BenchSettings<'_>, kills: usize) -> Vec<BenchCase<'a>> {
    let case = |rate_hz: u64| {
        BenchCase::new(format!("{rate_hz} Hz"), move |table| {
            let faults = (0..kills).map(|kill| {
                // Spreads the kills over the phases of the robots' timers.
                let at_s = 1.0
                    + KILL_INTERVAL_S * kill as f64
                    + agent::golden_phase(kill) / rate_hz as f64;
                format!("--fault=kill r2 @{at_s:.6} restart {RESTART_DELAY_S}")
            });
            let faults: Vec<String> = faults.collect();
            let faults: Vec<&str> = faults.iter().map(String::as_str).collect();
            let mut run = RunProcess::start(
                settings,
                &line_scenario_text(kills, rate_hz),
                Pace::Realtime,
                &faults,
            )?;
            run.wait_for_exit()?;
            let durations_us = quantiles_us(repair_times_ns(&run.read_events()))
                .context("events.csv has no repair of r3 after a timeout of r2")?;
            for ((_, name, _), us) in QUANTILES.iter().zip(durations_us).take(SHOWN_QUANTILE_COUNT)
            {
                let quantity = format!(
                    "timeout to backup neighbor minus repair_after_s, {name} of {kills}, ms"
                );
                table.record_run(&quantity, us / 1e3 - 1e3 * REPAIR_AFTER_S);
            }
            Ok(())
        })
    };
    RATES_HZ.map(case).into()
}

/// Returns the scenario text of a line of robots behind a leader at rest.
fn line_scenario_text(kills: usize, rate_hz: u64) -> String {
    let mut text = format!(
        "name = \"line-{ROBOT_COUNT}\"\nduration_s = {}\nperiod_s = {}\nrepair = \"spares\"\n\
         repair_after_s = {REPAIR_AFTER_S}\ntrajectory = {{ kind = \"still\", center_m = [0.0, 0.0] }}\n",
        2.0 + KILL_INTERVAL_S * kills as f64,
        1.0 / rate_hz as f64,
    );
    for i in 0..ROBOT_COUNT {
        let x_m = -0.6 * i as f64;
        let law = match i {
            0 => "law = \"leader-tanh\"\nk_m_m_s = 1.0\n".to_owned(),
            _ => format!("law = \"formation-tanh\"\nk_f_m_s = 1.0\nhears = [\"r{i}\"]\n"),
        };
        let _ = write!(
            text,
            "[[robot]]\nname = \"r{}\"\n{law}place_m = [{x_m}, 0.0]\n\
             pose = {{ x_m = {}, y_m = 0.0, heading_rad = 0.0 }}\n",
            i + 1,
            x_m - 0.045
        );
    }
    text + "[avoidance]\nkind = \"guard\"\ndistance_min_m = 0.2\nspeed_max_m_s = 0.3\n\
            [robot_defaults]\nfront_point_m = 0.045\n"
}

/// Returns the time from each timeout of r2 at r3 until r3 uses r1 instead, ns, from the text of `events.csv`.
fn repair_times_ns(events: &str) -> Vec<u64> {
    let mut lost_s = None;
    let mut durations_ns = Vec::new();
    for EventLine { t_s, kind, robot, other, state, .. } in parse_events(events).unwrap_or_default()
    {
        match [&kind, &robot, &state, &other].map(String::as_str) {
            ["contact", "r3", "lost", "r2"] => lost_s = Some(t_s),
            ["repair", "r3", "used", "r1"] => {
                let duration_s = lost_s.take().map(|lost_s| t_s - lost_s);
                durations_ns.extend(duration_s.map(|duration_s| (1e9 * duration_s) as u64));
            }
            _ => {}
        }
    }
    durations_ns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ring;

    #[test]
    fn line_scenario_gives_r3_the_leader_as_backup_neighbor() {
        let scenario = ring::parse_scenario(&line_scenario_text(3, 200)).unwrap();
        let spares = scenario.repair_plan.spares.iter().filter(|edge| edge.to == 2);
        assert_eq!(spares.map(|edge| edge.from).collect::<Vec<_>>(), [0]);
    }

    #[test]
    fn repair_time_counts_from_the_preceding_timeout() {
        let events = "t_s,kind,robot,detail,state,other,goal_x_m,goal_y_m\n\
                      1.1,contact,r3,,lost,r2,,\n1.1,contact,r4,,lost,r3,,\n\
                      1.304,repair,r3,,used,r1,,\n1.304,repair,r3,,unused,r2,,\n\
                      1.9,repair,r3,,used,r2,,\n2.6,contact,r3,,lost,r2,,\n2.81,repair,r3,,used,r1,,\n";
        let ms: Vec<u64> =
            repair_times_ns(events).iter().map(|ns| (ns + 500_000) / 1_000_000).collect();
        assert_eq!(ms, [204, 210]);
    }
}
