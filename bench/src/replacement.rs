//! From a kill to the replacement's first command: SIGKILL from outside in a run in real time, and
//! an onlooker that receives the robot's commands as the plant does. In between: the death is
//! noticed, reaped and cleaned up, a process is started, it opens its ports, takes an odometry
//! sample at its next wake-up, and answers. No restart delay is set.

use std::ffi::OsString;
use std::path::Path;
use std::time::{Duration, Instant};

use protocol::brief::{self, AgentBrief, Pace};
use protocol::message::Command;
use protocol::process::Stop;
use protocol::run_root::{self, RunRoot};
use protocol::service::{self, Subscriber};
use rustix::process::{Pid, Signal, kill_process};

use crate::flown::Flying;
use crate::peers::Peers;
use crate::table::Row;
use crate::{BenchError, Place, failed, ring};

/// Robots in the run.
const ROBOTS: usize = 8;
/// T, s.
const PERIOD_S: f64 = 0.005;
/// Longer than any measurement; the run is ended when it is done.
const TICKS: u64 = 200_000;
/// The robot that is killed.
const VICTIM: &str = "r1";
/// A replacement has come within this, or never will.
const BACK_MAX: Duration = Duration::from_secs(20);
/// Between two kills, so that each finds a run that has settled.
const SETTLE: Duration = Duration::from_millis(50);
/// How often commands are looked for.
const LOOK_EVERY: Duration = Duration::from_micros(100);

/// Kills so often, in each of the rounds.
pub(crate) fn measure(
    root: &RunRoot,
    stop: &Stop,
    rounds: usize,
    kills: usize,
    mut progress: impl FnMut(&str),
) -> Result<Vec<Row>, BenchError> {
    let (mut p50, mut p99) = (Vec::new(), Vec::new());
    for round in 1..=rounds {
        progress(&format!("replacement, {kills} kills, round {round}"));
        let mut taken_ms = killed(root, stop, kills)?;
        taken_ms.sort_by(f64::total_cmp);
        let at = |share: f64| taken_ms[(share * (taken_ms.len() - 1) as f64).round() as usize];
        p50.push(at(0.50));
        p99.push(at(0.99));
    }
    let what = |name: &str| format!("kill to first command, {name} of {kills}, ms");
    Ok(vec![
        Row::alone("replacement", &what("p50"), p50),
        Row::alone("replacement", &what("p99"), p99),
    ])
}

fn killed(root: &RunRoot, stop: &Stop, kills: usize) -> Result<Vec<f64>, BenchError> {
    let text = ring::text(ROBOTS, TICKS, PERIOD_S);
    let place = Place::new(root, "onlooker")?;
    let mut flying = Flying::start(root, stop, &text, Pace::Realtime)?;
    let began = Instant::now();
    let brief = flying.brief(VICTIM);
    while !flying.has_events("ready", ROBOTS) {
        flying.check()?;
        if began.elapsed() > BACK_MAX {
            return Err(BenchError::Wrong("the run was not ready in time".into()));
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    let result = place.path().join("result.json");
    let words: Vec<OsString> = vec![
        "bench-peer".into(),
        "kill".into(),
        brief.into(),
        kills.to_string().into(),
        result.clone().into(),
    ];
    let peers = Peers::start(place.path(), stop, [words])?;
    while !result.exists() {
        flying.check()?;
        peers.check()?;
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(peers);
    drop(flying);
    let text = std::fs::read_to_string(&result).map_err(failed("read", &result))?;
    serde_json::from_str(&text).map_err(|error| BenchError::Wrong(error.to_string()))
}

/// The onlooker: kills the robot of this brief and waits for its replacement, so often; writes how
/// long each took, ms.
pub(crate) fn onlooker(brief_path: &Path, kills: usize, result: &Path) -> Result<(), BenchError> {
    let brief: AgentBrief = brief::read(brief_path)?;
    run_root::join(&brief.run_root)?;
    let node = service::node("onlooker")?;
    let service = service::command(&brief.name).open(&node)?;
    let commands = service.subscriber()?;
    let mut incarnation = next(&commands, 0)?;
    let mut taken_ms = Vec::with_capacity(kills);
    for _ in 0..kills {
        std::thread::sleep(SETTLE);
        let pid = process_of(brief_path).ok_or_else(|| {
            BenchError::Wrong(format!("found no process of {}", brief_path.display()))
        })?;
        let began = Instant::now();
        kill_process(pid, Signal::KILL)
            .map_err(|error| failed("kill the agent of", brief_path)(error.into()))?;
        incarnation = next(&commands, incarnation + 1)?;
        taken_ms.push(began.elapsed().as_secs_f64() * 1e3);
    }
    // Named once it is whole.
    let unnamed = result.with_extension("new");
    let text = serde_json::to_string(&taken_ms).expect("numbers only");
    std::fs::write(&unnamed, text).map_err(failed("write", &unnamed))?;
    std::fs::rename(&unnamed, result).map_err(failed("name", result))?;
    // The bench ends this process; its own end would look like a failure.
    std::thread::sleep(BACK_MAX);
    Ok(())
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
