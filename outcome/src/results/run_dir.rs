//! Directory of a run. All files except the recording are plain text and stay readable if the run ends early;
//! `phalanx recover` repairs the recording. Every write error names its file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::recording::recorder::{FLUSH_EVERY, Recorder, RunDescription};
use protocol::brief::Pace;
use protocol::exit;
use protocol::message::{TruthHeader, TruthRow};
use serde::Serialize;

use crate::columns::Table;
use crate::metrics::summary::{LatencyInterval, StageLatency, Summary};
use crate::metrics::{CurrentErrors, PairDistance};
use crate::results::files::date;
use crate::results::files::host_dir::{HostDir, SCENARIO, write_error};
use crate::results::files::manifest::Manifest;
use crate::results::files::reserved::Reserved;
use crate::results::latency::Latency;
use crate::results::summary::to_json;
use crate::results::tables::{self, DueSample, EventLine, SampleLine, Samples, SignalLine};
use experiment::scenario::Scenario;
use formation::obstacle::Obstacle;
use formation::seconds;

pub use crate::results::files::host_dir::RunDirError;

/// Default directory of runs without `--out`.
pub const RUNS: &str = "runs";
/// Name of the file about what was run, where and how.
pub const MANIFEST: &str = "manifest.json";
/// Name of the file with the results.
pub const SUMMARY: &str = "summary.json";
/// Name of the table of robot states over time.
pub const SAMPLES: &str = SampleLine::FILE;
/// Name of the table of the smallest distance of each pair.
pub const PAIRS: &str = PairDistance::FILE;
/// Name of the table of events.
pub const EVENTS: &str = EventLine::FILE;
/// Name of the table of the laws' signals.
pub const SIGNALS: &str = SignalLine::FILE;
/// Name of the recording.
pub const RECORDING: &str = "run.mcap";

/// Directory of a run on the plant's host, which also holds the results.
pub struct RunDir {
    host: HostDir,
    newest_samples: Samples,
    walls: Vec<Obstacle>,
    samples: Log,
    /// Time of the last flush of the samples.
    samples_flushed: Instant,
    events: Log,
    /// Table of the laws' signals; `None` if no law records any.
    signals: Option<Log>,
    /// Recording; `None` before it is created, and after a write error.
    recording: Option<Recorder>,
    /// Allocated summary file; `None` after it is written.
    summary: Option<Reserved>,
}

/// A file that is appended to, with its path for errors.
struct Log {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Deref for RunDir {
    type Target = HostDir;

    fn deref(&self) -> &HostDir {
        &self.host
    }
}

impl Log {
    /// Creates the file of a table in a directory.
    fn create<L: Table>(directory: &Path) -> Result<Log, RunDirError> {
        let path = directory.join(L::FILE);
        let file = File::create_new(&path).map_err(write_error(&path))?;
        let mut log = Log { path, file: BufWriter::new(file) };
        log.text(&L::header())?;
        Ok(log)
    }

    fn text(&mut self, text: &str) -> Result<(), RunDirError> {
        self.file.write_all(text.as_bytes()).map_err(write_error(&self.path))
    }

    fn flush(&mut self) -> Result<(), RunDirError> {
        self.file.flush().map_err(write_error(&self.path))
    }
}

impl RunDir {
    /// Creates the directory, which must not exist.
    pub fn create(path: &Path, scenario: &Scenario) -> Result<RunDir, RunDirError> {
        let host = HostDir::create(path)?;
        let summary = path.join(SUMMARY);
        Ok(RunDir {
            host,
            newest_samples: Samples::new(scenario),
            walls: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
            samples: Log::create::<SampleLine>(path)?,
            samples_flushed: Instant::now(),
            events: Log::create::<EventLine>(path)?,
            signals: match scenario.has_signals() {
                true => Some(Log::create::<SignalLine>(path)?),
                false => None,
            },
            recording: None,
            summary: Some(
                Reserved::create(&summary, summary_bytes(scenario))
                    .map_err(write_error(&summary))?,
            ),
        })
    }

    /// Writes the effective scenario and the manifest, and creates the recording. Without `is_recorded`, there is
    /// no recording, and only the first and the last sample are written.
    pub fn begin(
        &mut self,
        scenario: &str,
        manifest: &Manifest,
        is_recorded: bool,
    ) -> Result<(), RunDirError> {
        self.write_scenario(scenario)?;
        self.write(MANIFEST, to_json(manifest))?;
        if is_recorded {
            return self.begin_recording(scenario, manifest);
        }
        self.newest_samples.record_first_and_last_only();
        Ok(())
    }

    /// Creates the recording with the effective scenario and, in real time, the manifest.
    fn begin_recording(&mut self, scenario: &str, manifest: &Manifest) -> Result<(), RunDirError> {
        let path = self.path().join(RECORDING);
        let run = self.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (seed, reproducible) = (manifest.seed.to_string(), manifest.pace == Pace::Lockstep);
        let mut facts = BTreeMap::from([
            ("scenario", manifest.scenario.as_str()),
            ("pace", manifest.pace.keyword()),
            ("seed", &seed),
            ("phalanx", manifest.phalanx),
            ("git_hash", manifest.build.git_hash.as_deref().unwrap_or("")),
        ]);
        let manifest_text = to_json(manifest);
        let mut attachments = vec![(SCENARIO, "application/toml", scenario)];
        if !reproducible {
            facts.insert("run", &run);
            attachments.push(("manifest.json", "application/json", &manifest_text));
        }
        let facts = facts.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned()));
        let run = RunDescription {
            started_unix_ns: manifest.epoch_unix_ns,
            reproducible,
            robots: self.newest_samples.robots(),
            with_signals: self.newest_samples.robots_with_signals(),
            walls: &self.walls,
            facts: facts.collect(),
            attachments: &attachments,
        };
        self.recording = Some(Recorder::create(&path, &run).map_err(write_error(&path))?);
        Ok(())
    }

    /// Writes a sample to `samples.csv` and the recording if one is due. The last sample of a run is always
    /// written. `measured` are the metrics at this sample.
    pub fn write_truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        measured: CurrentErrors<'_>,
    ) -> Result<(), RunDirError> {
        match self.newest_samples.store(header, rows, alive, measured) {
            true => self.write_newest(),
            false => Ok(()),
        }
    }

    fn write_newest(&mut self) -> Result<(), RunDirError> {
        let Some(sample) = self.newest_samples.take_newest() else { return Ok(()) };
        self.samples.text(sample.text)?;
        let DueSample { t_ns, lines, nearest, signals, .. } = sample;
        if let Some(log) = &mut self.signals {
            log.text(&tables::signals(signals))?;
        }
        record(&mut self.recording, &self.host, |recording| {
            recording.record_sample(t_ns, lines, nearest)?;
            recording.record_signals(t_ns, signals)
        })
    }

    fn write_last_truth(&mut self) -> Result<(), RunDirError> {
        self.write_newest()?;
        self.flush_tables()
    }

    fn flush_tables(&mut self) -> Result<(), RunDirError> {
        self.samples.flush()?;
        self.signals.as_mut().map_or(Ok(()), Log::flush)
    }

    /// Flushes buffered data if the last flush was at least [`FLUSH_EVERY`] ago, so that a kill loses no more than
    /// that. Call it often.
    pub fn flush_if_due(&mut self, now: Instant) -> Result<(), RunDirError> {
        if now.saturating_duration_since(self.samples_flushed) >= FLUSH_EVERY {
            self.samples_flushed = now;
            self.flush_tables()?;
        }
        record(&mut self.recording, &self.host, |recording| recording.flush_if_due(now))
    }

    /// Writes an event at this run time, ns, and flushes `events.csv`.
    pub fn write_event(&mut self, t_ns: u64, event: EventLine) -> Result<(), RunDirError> {
        let event = EventLine { t_s: seconds(t_ns), ..event };
        self.events.text(&event.text())?;
        self.events.flush()?;
        record(&mut self.recording, &self.host, |recording| recording.record_event(t_ns, &event))
    }

    /// Writes all remaining files and the summary, as far as there is disk space. Returns all errors; each names an
    /// incomplete file. After an error the summary has the exit code of a failure.
    pub fn finish(
        &mut self,
        summary: &mut Summary,
        pairs: &[PairDistance],
        latency: &mut Latency,
    ) -> Vec<RunDirError> {
        let mut unwritten = self.write_rest(summary, pairs, latency);
        if !unwritten.is_empty() {
            summary.exit = exit::INFRASTRUCTURE;
        }
        if let Some(Err(error)) =
            self.summary.take().map(|reserved| reserved.fill(to_json(summary).as_bytes()))
        {
            unwritten.push(write_error(&self.path().join(SUMMARY))(error));
            summary.exit = exit::INFRASTRUCTURE;
        }
        unwritten
    }

    fn write_rest(
        &mut self,
        summary: &Summary,
        pairs: &[PairDistance],
        latency: &mut Latency,
    ) -> Vec<RunDirError> {
        let lasted = Duration::from_secs_f64(summary.wall.wall_s);
        let hlog = latency.hlog(SystemTime::now() - lasted, lasted);
        // Each file is written, even if one before it failed.
        [
            self.events.flush(),
            self.write_last_truth(),
            self.write(PAIRS, tables::pairs(pairs)),
            self.write(StageLatency::FILE, to_csv(&latency.stages())),
            self.write(LatencyInterval::FILE, to_csv(&latency.over_time())),
            self.write("latency.hlog", hlog),
            self.recording.take().map_or(Ok(()), |recording| {
                recording.finish().map_err(write_error(&self.path().join(RECORDING)))
            }),
        ]
        .into_iter()
        .filter_map(Result::err)
        .collect()
    }
}

/// Passes the recording to `write`. After the first error, which is returned, the recording is given up and all
/// other files are still written.
fn record(
    recording: &mut Option<Recorder>,
    host: &HostDir,
    write: impl FnOnce(&mut Recorder) -> io::Result<()>,
) -> Result<(), RunDirError> {
    let Some(recorder) = recording else { return Ok(()) };
    write(recorder).map_err(|error| {
        *recording = None;
        write_error(&host.path().join(RECORDING))(error)
    })
}

/// Formats a table with a header and one line per entry.
fn to_csv<T: Serialize>(lines: &[T]) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for line in lines {
        writer.serialize(line).expect("memory takes everything");
    }
    writer.into_inner().expect("memory takes everything")
}

/// Returns the disk space to allocate for the summary, bytes; far more than any summary needs.
fn summary_bytes(scenario: &Scenario) -> u64 {
    let parts = scenario.robots.len() + scenario.graph.edges().len() + scenario.faults.len();
    let hashes = 32 * (scenario.duration_ns / 1_000_000_000);
    (1 << 16) + (1 << 12) * parts as u64 + hashes
}

/// Location of a run's directory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunLocation {
    /// This path, which must not exist.
    Path(PathBuf),
    /// Path `runs/<name>-<date>-<time>` in UTC, with a number appended if it exists.
    Dated(String),
}

impl RunLocation {
    /// Calls `make` with a free path. Returns the path and the result. Runs that start at the same time get
    /// different paths.
    pub fn create_with<D>(
        &self,
        make: impl Fn(&Path) -> Result<D, RunDirError>,
    ) -> Result<(PathBuf, D), RunDirError> {
        let stem = match self {
            RunLocation::Path(path) => return Ok((path.clone(), make(path)?)),
            RunLocation::Dated(name) => name_with_date(name),
        };
        let numbered = (2..).map(|n| format!("{stem}-{n}"));
        let paths = std::iter::once(stem.clone()).chain(numbered);
        for path in paths.map(|name| Path::new(RUNS).join(name)) {
            match make(&path) {
                Err(RunDirError::Exists(_)) => {}
                made => return Ok((path, made?)),
            }
        }
        unreachable!("numbers do not end")
    }
}

/// Maximum length of the scenario name in a directory name, bytes. A longer name is cut, because file systems allow
/// 255 bytes.
const NAME_BYTES_MAX: usize = 200;

/// Returns `<name>-<date>-<time>`, in UTC.
fn name_with_date(name: &str) -> String {
    // A scenario name is free text; a slash in it must not lead out of the folder.
    let usable = |c: char| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' };
    let mut bytes = 0;
    let fits = |c: &char| {
        bytes += c.len_utf8();
        bytes <= NAME_BYTES_MAX
    };
    let name: String = name.chars().map(usable).take_while(fits).collect();
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    format!("{name}-{}", date::format_for_name(seconds))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn name_taken_concurrently_gets_next_number() {
        let taken = std::cell::Cell::new(0);
        let make = |path: &Path| {
            taken.set(taken.get() + 1);
            if taken.get() < 3 { Err(RunDirError::Exists(path.into())) } else { Ok(()) }
        };
        let (path, ()) = super::RunLocation::Dated("a/b".into()).create_with(make).unwrap();
        let path = path.to_str().unwrap();
        assert!(path.starts_with("runs/a_b-2") && path.ends_with("-3"), "{path}");
        taken.set(0);
        assert!(
            super::RunLocation::Path("here".into()).create_with(make).is_err(),
            "no other place was asked for"
        );
    }

    use crate::metrics::examples::{header, rows};
    use experiment::examples::row_of_three;
    use formation::Vec2;

    #[test]
    fn second_run_into_the_same_directory_is_refused() {
        let place = tempfile::tempdir().unwrap();
        for round in 0..50 {
            let path = place.path().join(format!("deep/run-{round}"));
            let both: Vec<_> = std::thread::scope(|scope| {
                let one = || {
                    let run_dir = RunDir::create(&path, &row_of_three())?;
                    run_dir.write_scenario("name")
                };
                let threads = [scope.spawn(one), scope.spawn(one)];
                threads.into_iter().map(|thread| thread.join().unwrap()).collect()
            });
            let refused: Vec<_> = both.into_iter().filter_map(Result::err).collect();
            assert!(matches!(refused[..], [RunDirError::Exists(_)]), "{refused:?}");
            assert_eq!(fs::read_to_string(path.join("scenario.toml")).unwrap(), "name");
        }
    }

    #[test]
    fn samples_of_an_early_end_have_the_first_and_the_last_row() {
        let place = tempfile::tempdir().unwrap();
        let mut run_dir = RunDir::create(&place.path().join("run"), &row_of_three()).unwrap();
        for tick in 1..=7 {
            let rows = rows([tick as f64, -1.0, -2.0]);
            let measured = CurrentErrors {
                errors_m: &[None, Some(0.5), None],
                errors: &[None, Some(Vec2::new(-0.3, 0.4)), None],
                ideal_errors_m: &[None, None, Some(0.25)],
                ..CurrentErrors::default()
            };
            run_dir.write_truth(&header(tick), &rows, &[true; 3], measured).unwrap();
        }
        run_dir.write_last_truth().unwrap();
        let text = fs::read_to_string(place.path().join("run/samples.csv")).unwrap();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines[1], "1,r1,0.9,0,0,0,0,,1,,1,0,,,0");
        assert_eq!(lines[2], "1,r2,-1.1,0,0,0,0,0.5,1,,-1,0,-0.3,0.4,0");
        assert_eq!(lines[3], "1,r3,-2.1,0,0,0,0,,1,0.25,-2,0,,,0");
        let mut times: Vec<_> = lines[1..].iter().map(|l| l.split_once(',').unwrap().0).collect();
        times.dedup();
        assert_eq!(times, ["1", "2", "4", "6", "7"]);
    }
}
