//! Time from a kill to the replacement's first command: SIGKILL from outside in a real-time run, with an
//! observer that receives the robot's commands like the plant. It includes the detection of the death,
//! reaping and clean-up, the start of a process, the opening of its ports, the odometry sample at its next
//! wake-up, and its reply. No restart delay is set.

use std::path::Path;
use std::time::{Duration, Instant};

use agent::golden_phase;
use anyhow::{Context as _, bail};
use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::Command;
use protocol::run_root;
use protocol::service::{self, Subscriber};
use rustix::process::{Pid, Signal, kill_process};

use crate::peers::{Peers, Post};
use crate::quantiles::{QUANTILES, quantiles_us};
use crate::rounds::{Case, Setting};
use crate::run::Run;
use crate::{Place, ring};

/// Number of robots in the run.
const ROBOTS: usize = 8;
/// Rates of the robots, Hz. A replacement waits for the plant's next sample, and then for its own next
/// wake-up: at most two periods, one on average.
const RATES_HZ: [u64; 2] = [200, 1000];
/// Number of ticks, more than any measurement needs; the run is ended when the measurement is done.
const TICKS: u64 = 1_000_000;
/// Name of the robot that is killed.
const VICTIM: &str = "r1";
/// Maximum time to wait for a replacement.
const BACK_MAX: Duration = Duration::from_secs(20);
/// Time between two kills, so that each finds a settled run.
const SETTLE: Duration = Duration::from_millis(50);
/// Number of quantiles shown; more would need thousands of kills.
const SHOWN: usize = 2;
/// Polling interval for commands.
const LOOK_EVERY: Duration = Duration::from_micros(100);

/// Returns a case for each rate, with this many kills.
pub(crate) fn cases<'a>(setting: &'a Setting<'_>, kills: usize) -> Vec<Case<'a>> {
    let case = |rate_hz: u64| {
        Case::new(format!("{rate_hz} Hz"), move |table| {
            let taken_us = quantiles_us(killed(setting, rate_hz, kills)?);
            let taken_us = taken_us.context("nobody was killed")?;
            for ((_, name, _), us) in QUANTILES.iter().zip(taken_us).take(SHOWN) {
                let what = format!("kill to first command, {name} of {kills}, ms");
                table.run(&what, us / 1e3);
            }
            Ok(())
        })
    };
    RATES_HZ.map(case).into()
}

/// Returns the duration of each replacement, ns.
fn killed(setting: &Setting<'_>, rate_hz: u64, kills: usize) -> anyhow::Result<Vec<u64>> {
    let text = ring::text(ROBOTS, TICKS, 1.0 / rate_hz as f64);
    let place = Place::new(setting.root, "onlooker")?;
    let mut run = Run::start(setting, &text, Pace::Realtime, &[])?;
    let began = Instant::now();
    while !run.has_events("ready", ROBOTS) {
        run.check()?;
        if began.elapsed() > BACK_MAX {
            bail!("the run was not ready in time");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let words = [run.brief(VICTIM).into(), kills.to_string().into()];
    let peers = Peers::start(place.path(), setting.stop, 1, "kill", &words)?;
    while !peers.is_done() {
        run.check()?;
        peers.check()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(peers.results()?.remove(0))
}

/// Runs the observer: kills the robot of this brief and waits for its replacement, `kills` times.
pub(crate) fn peer(post: &Post, brief_path: &Path, kills: usize) -> anyhow::Result<()> {
    let brief: AgentBrief = brief::read(brief_path)?;
    run_root::join(&brief.run_root)?;
    let node = service::node("onlooker")?;
    let commands = service::command(&brief.name).open(&node)?.subscriber()?;
    post.report_ready()?;
    let mut incarnation = next(&commands, 0)?;
    let period_s = brief.period_ns as f64 / 1e9;
    let mut taken_ns = Vec::with_capacity(kills);
    for kill in 0..kills {
        // The robot sleeps after a command. The random delay lets the kill occur at any phase of the robot
        // and of its timer.
        std::thread::sleep(SETTLE + Duration::from_secs_f64(golden_phase(kill) * period_s));
        let pid = process_of(brief_path)
            .with_context(|| format!("found no process of {}", brief_path.display()))?;
        let began = Instant::now();
        kill_process(pid, Signal::KILL)?;
        incarnation = next(&commands, incarnation + 1)?;
        taken_ns.push(began.elapsed().as_nanos() as u64);
    }
    post.report(&taken_ns)
}

/// Waits for a command of incarnation `least` or a later one, and returns its incarnation.
fn next(commands: &Subscriber<Command>, least: u64) -> anyhow::Result<u64> {
    let began = Instant::now();
    loop {
        match commands.receive()? {
            Some(command) if command.incarnation >= least => return Ok(command.incarnation),
            Some(_) => {}
            None if began.elapsed() > BACK_MAX => {
                bail!("no command of incarnation {least} within {} s", BACK_MAX.as_secs())
            }
            None => std::thread::sleep(LOOK_EVERY),
        }
    }
}

/// Returns the process of the agent that was started with this brief.
fn process_of(brief: &Path) -> Option<Pid> {
    let path = brief.as_os_str().as_encoded_bytes();
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    processes.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok()).find_map(|pid| {
        let line = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        let mut words = line.split(|&byte| byte == 0);
        let agent = words.nth(1) == Some(b"agent") && words.next() == Some(path);
        if agent { Pid::from_raw(pid) } else { None }
    })
}
