//! Time from the loss of an in-neighbor to the first sample for which a robot uses a backup neighbor
//! instead: kills in a real-time run, by the run times in its events. It includes the time that the robot
//! waits before it declares the neighbor failed, the opening of the backup's beacon, and the backup's next
//! beacon.

use std::fmt::Write as _;

use anyhow::Context as _;
use protocol::brief::Pace;

use crate::quantiles::{QUANTILES, quantiles_us};
use crate::rounds::{Case, Setting};
use crate::run::Run;

/// Number of robots in the run: each receives from the previous one, and the first one leads.
const ROBOTS: usize = 8;
/// Rates of the robots, Hz.
const RATES_HZ: [u64; 2] = [200, 1000];
/// Time without a beacon after which a backup neighbor is activated, s.
const REPAIR_AFTER_S: f64 = 0.2;
/// Time between two kills, and from a kill to the restart of the robot, s, so that each kill finds a complete graph.
const EVERY_S: f64 = 1.5;
const BACK_AFTER_S: f64 = 0.6;
/// Number of quantiles shown; more would need thousands of kills.
const SHOWN: usize = 2;

/// Returns a case for each rate, with this many kills.
pub(crate) fn cases<'a>(setting: &'a Setting<'_>, kills: usize) -> Vec<Case<'a>> {
    let case = |rate_hz: u64| {
        Case::new(format!("{rate_hz} Hz"), move |table| {
            let faults = (0..kills).map(|kill| {
                // At different phases of the robots' timers.
                let at_s = 1.0 + EVERY_S * kill as f64 + agent::golden_phase(kill) / rate_hz as f64;
                format!("--fault=kill r2 @{at_s:.6} restart {BACK_AFTER_S}")
            });
            let faults: Vec<String> = faults.collect();
            let faults: Vec<&str> = faults.iter().map(String::as_str).collect();
            let mut run = Run::start(setting, &text(kills, rate_hz), Pace::Realtime, &faults)?;
            run.end()?;
            let taken_us = quantiles_us(taken_ns(&run.events())).context("nobody was repaired")?;
            for ((_, name, _), us) in QUANTILES.iter().zip(taken_us).take(SHOWN) {
                let what = format!("lost to spare less repair_after_s, {name} of {kills}, ms");
                table.run(&what, us / 1e3 - 1e3 * REPAIR_AFTER_S);
            }
            Ok(())
        })
    };
    RATES_HZ.map(case).into()
}

/// Returns the scenario: a line behind a leader at rest.
fn text(kills: usize, rate_hz: u64) -> String {
    let mut text = format!(
        "name = \"line-{ROBOTS}\"\nduration_s = {}\nperiod_s = {}\nrepair = \"spares\"\n\
         repair_after_s = {REPAIR_AFTER_S}\ntrajectory = {{ kind = \"still\", center_m = [0.0, 0.0] }}\n",
        2.0 + EVERY_S * kills as f64,
        1.0 / rate_hz as f64,
    );
    for i in 0..ROBOTS {
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

/// Returns the times, ns, from each loss of r2 until r3 uses r1, by the events of a run.
fn taken_ns(events: &str) -> Vec<u64> {
    let mut lost_s = None;
    let mut taken_ns = Vec::new();
    for row in events.lines() {
        let mut cells = row.splitn(4, ',');
        let t_s = cells.next().and_then(|t_s| t_s.parse::<f64>().ok());
        match (cells.next(), cells.next(), cells.next()) {
            (Some("contact"), Some("r3"), Some("lost r2")) => lost_s = t_s,
            (Some("repair"), Some("r3"), Some("goes by r1")) => {
                let taken_s = t_s.zip(lost_s.take()).map(|(t_s, lost_s)| t_s - lost_s);
                taken_ns.extend(taken_s.map(|taken_s| (1e9 * taken_s) as u64));
            }
            _ => {}
        }
    }
    taken_ns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ring;

    #[test]
    fn the_line_is_sound_and_r3_has_the_leader_for_a_spare() {
        let scenario = ring::read(&text(3, 200)).unwrap();
        let spares = scenario.spares.iter().filter(|edge| edge.to == 2);
        assert_eq!(spares.map(|edge| edge.from).collect::<Vec<_>>(), [0]);
    }

    #[test]
    fn each_repair_counts_from_the_loss_before_it() {
        let events = "t_s,kind,robot,detail\n1.1,contact,r3,lost r2\n1.1,contact,r4,lost r3\n\
                      1.304,repair,r3,goes by r1\n1.304,repair,r3,goes no longer by r2\n\
                      1.9,repair,r3,goes by r2\n2.6,contact,r3,lost r2\n2.81,repair,r3,goes by r1\n";
        let ms: Vec<u64> = taken_ns(events).iter().map(|ns| (ns + 500_000) / 1_000_000).collect();
        assert_eq!(ms, [204, 210]);
    }
}
