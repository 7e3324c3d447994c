//! Whether a live view that somebody looks at makes anybody late: the same runs in real time with a
//! view and a reader that takes all it is sent, and without, in turns.
//!
//! The reader draws nothing. A browser on the same machine takes processor time of its own.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::TcpStream;
use std::thread::JoinHandle;
use std::time::Duration;

use protocol::brief::Pace;
use protocol::process::Stop;
use protocol::run_root::RunRoot;
use serde_json::Value;

use crate::child::{self, Running, latest_wake_us, number};
use crate::quantiles::QUANTILES;
use crate::ring;
use crate::table::Row;
use crate::{BenchError, Measured, Setting};

/// Rate of the robots, Hz.
const RATE_HZ: u64 = 1000;
/// A stream that says nothing for this long is broken: the start-up of many robots is far shorter.
const SILENCE_MAX: Duration = Duration::from_secs(60);

/// What one way of running showed, round by round.
#[derive(Default)]
struct Seen {
    missed: Vec<f64>,
    late_us: [Vec<f64>; QUANTILES.len()],
}

impl Seen {
    fn take(&mut self, summary: &Value, periods: u64) -> Result<(), BenchError> {
        self.missed.push(100.0 * number(summary, "/deadline_misses")? / periods as f64);
        for ((key, ..), late_us) in QUANTILES.iter().zip(&mut self.late_us) {
            late_us.extend(latest_wake_us(summary, key));
        }
        Ok(())
    }
}

/// Measures runs of `seconds` each.
pub(crate) fn measure(setting: &Setting<'_>, robots: &[usize], seconds: f64) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    let mut rows = Vec::new();
    for &robots in robots {
        let (ticks, text) = ring::lasting(robots, RATE_HZ, seconds);
        let periods = ticks * robots as u64;
        let (mut watched, mut alone) = (Seen::default(), Seen::default());
        let mut frames = Vec::new();
        for round in 1..=rounds {
            setting.progress(&format!("live view, {robots} robots at {RATE_HZ} Hz, round {round}"));
            // Who goes first changes, for the second may find the machine warm.
            for with_view in [round % 2 == 0, round % 2 != 0] {
                if with_view {
                    let (summary, seen) = run_watched(root, stop, &text)?;
                    watched.take(&summary, periods)?;
                    frames.push(seen as f64 / number(&summary, "/wall/wall_s")?);
                } else {
                    alone.take(&child::run(root, stop, &text, Pace::Realtime)?, periods)?;
                }
            }
        }
        let what = |of: &str| format!("{robots} robots at {RATE_HZ} Hz, {of}");
        // No ratio: it may be one to nothing.
        for (how, missed) in [("watched", watched.missed), ("without a view", alone.missed)] {
            let what = what(&format!("deadlines missed, % of periods, {how}"));
            rows.push(Row::alone("view", &what, missed));
        }
        for ((_, name, _), (ours, floor)) in
            QUANTILES.iter().zip(watched.late_us.into_iter().zip(alone.late_us))
        {
            // A summary need not tell.
            if !ours.is_empty() && ours.len() == floor.len() {
                let what = what(&format!("wake lateness {name} of the latest robot, us"));
                rows.push(Row::against("view", &what, "without a view", ours, floor));
            }
        }
        rows.push(Row::alone("view", &what("frames a second at the reader"), frames));
    }
    Ok(rows)
}

/// A run that is looked at: its summary, and how many frames the reader was shown.
fn run_watched(root: &RunRoot, stop: &Stop, text: &str) -> Result<(Value, u64), BenchError> {
    let mut running = Running::start_with(root, stop, text, Pace::Realtime, &["--view"])?;
    let url = running.said("view: ")?;
    let reader = reader(&url)?;
    // Where this fails the run is ended, and with it the stream.
    let summary = running.summary()?;
    let frames = reader.join().expect("the reader does not panic");
    Ok((summary, frames))
}

/// Reads the stream of the view at `url` to its end; how many frames there were.
fn reader(url: &str) -> Result<JoinHandle<u64>, BenchError> {
    let broken = |error: &dyn std::fmt::Display| BenchError::Wrong(format!("{url}: {error}"));
    let (host, query) = url
        .strip_prefix("http://")
        .and_then(|rest| rest.split_once('/'))
        .ok_or_else(|| broken(&"not an address of a live view"))?;
    let connect = || {
        let mut stream = TcpStream::connect(host)?;
        stream.set_read_timeout(Some(SILENCE_MAX))?;
        write!(stream, "GET /events{query} HTTP/1.0\r\nHost: {host}\r\n\r\n")?;
        Ok::<TcpStream, std::io::Error>(stream)
    };
    let stream = connect().map_err(|error| broken(&error))?;
    Ok(std::thread::spawn(move || {
        let lines = BufReader::new(stream).lines().map_while(Result::ok);
        lines.filter(|line| line.starts_with("data: {\"t_s\":") && line.contains("robots")).count()
            as u64
    }))
}
