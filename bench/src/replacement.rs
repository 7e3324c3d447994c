//! From a kill to the replacement's first command: SIGKILL from outside in a run in real time, and
//! an onlooker that receives the robot's commands as the plant does. In between: the death is
//! noticed, reaped and cleaned up, a process is started, it opens its ports, takes an odometry
//! sample at its next wake-up, and answers. No restart delay is set.

use std::ffi::OsString;
use std::path::Path;
use std::time::{Duration, Instant};

use agent::golden_phase;
use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::Command;
use protocol::process::Stop;
use protocol::run_root::{self, RunRoot};
use protocol::service::{self, Subscriber};
use rustix::process::{Pid, Signal, kill_process};

use crate::child::Running;
use crate::peers::{self, Peers};
use crate::quantiles::{QUANTILES, quantiles_us};
use crate::table::Row;
use crate::{BenchError, Measured, Place, Setting, failed, ring};

/// Robots in the run.
const ROBOTS: usize = 8;
/// Rates of the robots, Hz. A replacement waits for the plant's next sample, and then for its own
/// next wake-up: two periods at most, one on average.
const RATES_HZ: [u64; 2] = [200, 1000];
/// Longer than any measurement; the run is ended when it is done.
const TICKS: u64 = 1_000_000;
/// The robot that is killed.
const VICTIM: &str = "r1";
/// A replacement has come within this, or never will.
const BACK_MAX: Duration = Duration::from_secs(20);
/// Between two kills, so that each finds a run that has settled.
const SETTLE: Duration = Duration::from_millis(50);
/// So many of the quantiles are told: a kill in a thousand is more than anybody waits for.
const TOLD: usize = 2;
/// How often commands are looked for.
const LOOK_EVERY: Duration = Duration::from_micros(100);

/// Kills so often, in each of the rounds.
pub(crate) fn measure(setting: &Setting<'_>, kills: usize) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    let mut taken_ms = RATES_HZ.map(|_| [const { Vec::new() }; TOLD]);
    for round in 1..=rounds {
        for (rate_hz, taken_ms) in RATES_HZ.iter().zip(&mut taken_ms) {
            setting.progress(&format!("replacement at {rate_hz} Hz, {kills} kills, round {round}"));
            let nobody = || BenchError::Wrong("nobody was killed".into());
            let taken_us = quantiles_us(killed(root, stop, *rate_hz, kills)?).ok_or_else(nobody)?;
            for (taken_ms, us) in taken_ms.iter_mut().zip(taken_us) {
                taken_ms.push(us / 1e3);
            }
        }
    }
    let rows = RATES_HZ.iter().zip(taken_ms).flat_map(|(rate_hz, taken_ms)| {
        QUANTILES.iter().zip(taken_ms).map(move |((_, name, _), taken_ms)| {
            let what = format!("{rate_hz} Hz, kill to first command, {name} of {kills}, ms");
            Row::alone("replacement", &what, taken_ms)
        })
    });
    Ok(rows.collect())
}

/// How long each replacement took, ns.
fn killed(root: &RunRoot, stop: &Stop, rate_hz: u64, kills: usize) -> Result<Vec<u64>, BenchError> {
    let text = ring::text(ROBOTS, TICKS, 1.0 / rate_hz as f64);
    let place = Place::new(root, "onlooker")?;
    let mut running = Running::start(root, stop, &text, Pace::Realtime)?;
    let began = Instant::now();
    let brief = running.brief(VICTIM);
    while !running.has_events("ready", ROBOTS) {
        running.check()?;
        if began.elapsed() > BACK_MAX {
            return Err(BenchError::Wrong("the run was not ready in time".into()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let result = place.path().join("result.json");
    let words: Vec<OsString> = vec![
        "peer".into(),
        "kill".into(),
        brief.into(),
        kills.to_string().into(),
        result.clone().into(),
    ];
    let peers = Peers::start(place.path(), stop, [words])?;
    while !result.exists() {
        running.check()?;
        peers.check()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    peers.told(&result)
}

/// The onlooker: kills the robot of this brief and waits for its replacement, so often; writes how
/// long each took, ns.
pub(crate) fn onlooker(brief_path: &Path, kills: usize, result: &Path) -> Result<(), BenchError> {
    let brief: AgentBrief = brief::read(brief_path)?;
    run_root::join(&brief.run_root)?;
    let node = service::node("onlooker")?;
    let service = service::command(&brief.name).open(&node)?;
    let commands = service.subscriber()?;
    let mut incarnation = next(&commands, 0)?;
    let period_s = brief.period_ns as f64 / 1e9;
    let mut taken_ns = Vec::with_capacity(kills);
    for kill in 0..kills {
        // After a command the robot sleeps: a kill shall meet it, and its timer, at any phase.
        std::thread::sleep(SETTLE + Duration::from_secs_f64(golden_phase(kill) * period_s));
        let pid = process_of(brief_path).ok_or_else(|| {
            BenchError::Wrong(format!("found no process of {}", brief_path.display()))
        })?;
        let began = Instant::now();
        kill_process(pid, Signal::KILL)
            .map_err(|error| failed("kill the agent of", brief_path)(error.into()))?;
        incarnation = next(&commands, incarnation + 1)?;
        taken_ns.push(began.elapsed().as_nanos() as u64);
    }
    peers::tell(result, &taken_ns)
}

/// Waits for a command of this incarnation or a later one: which it was.
fn next(commands: &Subscriber<Command>, least: u64) -> Result<u64, BenchError> {
    let began = Instant::now();
    loop {
        let sample = commands.receive();
        let sample = sample.map_err(|cause| BenchError::Wrong(format!("not received: {cause}")))?;
        match sample {
            Some(command) if command.incarnation >= least => return Ok(command.incarnation),
            Some(_) => {}
            None if began.elapsed() > BACK_MAX => {
                let limit_s = BACK_MAX.as_secs();
                let what = format!("no command of incarnation {least} within {limit_s} s");
                return Err(BenchError::Wrong(what));
            }
            None => std::thread::sleep(LOOK_EVERY),
        }
    }
}

/// The agent that was told this brief.
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
