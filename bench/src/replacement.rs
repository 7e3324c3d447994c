//! Time from a kill to the replacement's first command. An observer process sends SIGKILL to a robot of a run in real
//! time and receives the robot's commands like the plant. In between, the supervisor detects the exit, reaps the
//! process, removes its stale resources and starts a new one, which opens its ports, reads an odometry sample at its
//! next wake-up and answers. The restart delay is 0.

use std::path::Path;
use std::time::{Duration, Instant};

use agent::golden_phase;
use anyhow::{Context as _, bail};
use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::Command;
use protocol::run_root;
use protocol::service::{self, Subscriber};
use rustix::process::{Pid, Signal, kill_process};

use crate::peers::{PeerAddress, Peers};
use crate::quantiles::{QUANTILES, quantiles_us};
use crate::rounds::{BenchCase, BenchSettings};
use crate::run::RunProcess;
use crate::{WorkDir, ring};

/// Number of robots in the run.
const ROBOT_COUNT: usize = 8;
/// Rates of the robots, Hz. A replacement waits for the plant's next sample and then for its own next wake-up: at most
/// two periods, one on average.
const RATES_HZ: [u64; 2] = [200, 1000];
/// Number of ticks of the run, longer than any measurement; the bench ends the run after the measurement.
const TICK_COUNT: u64 = 1_000_000;
/// Name of the robot that is killed.
const KILLED_ROBOT_NAME: &str = "r1";
/// Maximum time to wait for the start of the run and for each replacement. The measurement fails after it.
const REPLACEMENT_DURATION_MAX: Duration = Duration::from_secs(20);
/// Minimum time between a replacement and the next kill, so that the run settles.
const SETTLING_TIME: Duration = Duration::from_millis(50);
/// Number of quantiles shown: p50 and p99. A p99.9 would need more kills than fit into a measurement.
const SHOWN_QUANTILE_COUNT: usize = 2;
/// Polling interval for commands.
const POLL_INTERVAL: Duration = Duration::from_micros(100);

/// Returns a case for each rate, with `kills` kills.
pub(crate) fn cases<'a>(settings: &'a BenchSettings<'_>, kills: usize) -> Vec<BenchCase<'a>> {
    let case = |rate_hz: u64| {
        BenchCase::new(format!("{rate_hz} Hz"), move |table| {
            let durations_us = quantiles_us(measure_replacements(settings, rate_hz, kills)?);
            let durations_us = durations_us.context("the observer reported no replacement")?;
            for ((_, name, _), us) in QUANTILES.iter().zip(durations_us).take(SHOWN_QUANTILE_COUNT)
            {
                let quantity = format!("kill to first command, {name} of {kills}, ms");
                table.record_run(&quantity, us / 1e3);
            }
            Ok(())
        })
    };
    RATES_HZ.map(case).into()
}

/// Starts a run and the observer, and returns the time that each replacement took, ns.
fn measure_replacements(
    settings: &BenchSettings<'_>,
    rate_hz: u64,
    kills: usize,
) -> anyhow::Result<Vec<u64>> {
    let text = ring::ring_scenario_text(ROBOT_COUNT, TICK_COUNT, 1.0 / rate_hz as f64);
    let work_dir = WorkDir::new(settings.root, "observer")?;
    let mut run = RunProcess::start(settings, &text, Pace::Realtime, &[])?;
    let start = Instant::now();
    while !run.has_events("ready", ROBOT_COUNT) {
        run.check_running()?;
        if start.elapsed() > REPLACEMENT_DURATION_MAX {
            bail!("the run was not ready within {} s", REPLACEMENT_DURATION_MAX.as_secs());
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let arguments = [run.brief_path(KILLED_ROBOT_NAME).into(), kills.to_string().into()];
    let peers = Peers::start(work_dir.path(), settings.stop, 1, "kill", &arguments)?;
    while !peers.has_result() {
        run.check_running()?;
        peers.check_running()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    Ok(peers.wait_for_results()?.remove(0))
}

/// Runs the observer process: kills the robot of this brief `kills` times, waits for each replacement and reports the
/// times.
pub(crate) fn run_peer(
    address: &PeerAddress,
    brief_path: &Path,
    kills: usize,
) -> anyhow::Result<()> {
    let brief: AgentBrief = brief::read(brief_path)?;
    run_root::join(&brief.run_root)?;
    let node = service::create_node("observer")?;
    let commands = service::command_topic(&brief.name).open(&node)?.subscriber()?;
    address.report_ready()?;
    let mut incarnation = wait_for_incarnation(&commands, 0)?;
    let period_s = brief.period_ns as f64 / 1e9;
    let mut durations_ns = Vec::with_capacity(kills);
    for kill in 0..kills {
        // The robot sleeps after a command; the varying delay spreads the kills over the phases of its timer.
        std::thread::sleep(SETTLING_TIME + Duration::from_secs_f64(golden_phase(kill) * period_s));
        let pid = find_agent_process(brief_path).with_context(|| {
            format!("no running agent process has the brief {}", brief_path.display())
        })?;
        let kill_time = Instant::now();
        kill_process(pid, Signal::KILL)?;
        incarnation = wait_for_incarnation(&commands, incarnation + 1)?;
        durations_ns.push(kill_time.elapsed().as_nanos() as u64);
    }
    address.report_result(&durations_ns)
}

/// Waits for a command of incarnation `minimum` or later, and returns its incarnation number.
///
/// # Errors
/// If none arrives within [`REPLACEMENT_DURATION_MAX`].
fn wait_for_incarnation(commands: &Subscriber<Command>, minimum: u64) -> anyhow::Result<u64> {
    let start = Instant::now();
    loop {
        match commands.receive()? {
            Some(command) if command.incarnation >= minimum => return Ok(command.incarnation),
            Some(_) => {}
            None if start.elapsed() > REPLACEMENT_DURATION_MAX => {
                bail!(
                    "no command of incarnation {minimum} or later within {} s",
                    REPLACEMENT_DURATION_MAX.as_secs()
                )
            }
            None => std::thread::sleep(POLL_INTERVAL),
        }
    }
}

/// Returns the process ID of the agent that was started with this brief; `None` if no such process is running.
fn find_agent_process(brief: &Path) -> Option<Pid> {
    let path = brief.as_os_str().as_encoded_bytes();
    let processes = std::fs::read_dir("/proc").ok()?.flatten();
    processes.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok()).find_map(|pid| {
        let command_line = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        let mut arguments = command_line.split(|&byte| byte == 0);
        let is_agent = arguments.nth(1) == Some(b"agent") && arguments.next() == Some(path);
        if is_agent { Pid::from_raw(pid) } else { None }
    })
}
