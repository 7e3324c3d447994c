//! Directory of a run. All files except the recording are plain text and stay readable if the run ends early;
//! `phalanx recover` repairs the recording. Every write error names its file.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::ops::Deref;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::recording::recorder::{FLUSH_INTERVAL, LawTopic, Recorder, RunDescription};
use protocol::brief::Pace;
use protocol::exit;
use protocol::message::{TruthHeader, TruthRow};
use serde::Serialize;

use crate::columns::Table;
use crate::metrics::summary::{LatencyInterval, StageLatency, Summary};
use crate::metrics::{CurrentMetrics, PairDistance};
use crate::results::files::date;
use crate::results::files::host_dir::{HostDir, SCENARIO_FILE, write_error};
use crate::results::files::manifest::Manifest;
use crate::results::files::reserved::ReservedFile;
use crate::results::latency::LatencyCollector;
use crate::results::summary::to_json;
use crate::results::tables::{
    self, DueSample, EventLine, MessageLine, RecordedMessage, SampleLine, SampleSelector,
    SignalLine,
};
use experiment::scenario::Scenario;
use formation::ns_to_seconds;
use formation::obstacle::Obstacle;

pub use crate::results::files::host_dir::RunDirError;

/// Default directory of runs without `--out`.
pub const RUNS_DIR: &str = "runs";
/// Name of the file about what was run, where and how.
pub const MANIFEST_FILE: &str = "manifest.json";
/// Name of the file with the results.
pub const SUMMARY_FILE: &str = "summary.json";
/// Name of the table of robot states over time.
pub const SAMPLES_FILE: &str = SampleLine::FILE;
/// Name of the table of the smallest distance of each pair.
pub const PAIRS_FILE: &str = PairDistance::FILE;
/// Name of the table of events.
pub const EVENTS_FILE: &str = EventLine::FILE;
/// Name of the table of the laws' signals.
pub const SIGNALS_FILE: &str = SignalLine::FILE;
/// Name of the table of the laws' messages.
pub const MESSAGES_FILE: &str = MessageLine::FILE;
/// Names of the tables that are equal in runs with the same trajectory.
pub const REPRODUCIBLE_TABLES: [&str; 5] =
    [SAMPLES_FILE, PAIRS_FILE, EVENTS_FILE, SIGNALS_FILE, MESSAGES_FILE];
/// Names of those tables that only some runs have: those of the values that control laws record or send.
pub const OPTIONAL_TABLES: [&str; 2] = [SIGNALS_FILE, MESSAGES_FILE];
/// Name of the recording.
pub const RECORDING_FILE: &str = "run.mcap";

/// Directory of a run on the plant's host, which also holds the results.
pub struct RunDir {
    host_dir: HostDir,
    newest_samples: SampleSelector,
    walls: Vec<Obstacle>,
    samples: AppendedFile,
    /// Time of the last flush of the samples.
    last_samples_flush: Instant,
    events: AppendedFile,
    /// Table of the laws' signals; `None` if no law records any.
    signals: Option<AppendedFile>,
    /// Table of the laws' messages; `None` if they are not recorded.
    messages: Option<AppendedFile>,
    /// Recording; `None` before it is created, and after a write error.
    recording: Option<Recorder>,
    /// Allocated summary file; `None` after it is written.
    reserved_summary: Option<ReservedFile>,
}

/// A file that is appended to, with its path for errors.
struct AppendedFile {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Deref for RunDir {
    type Target = HostDir;

    fn deref(&self) -> &HostDir {
        &self.host_dir
    }
}

impl AppendedFile {
    /// Creates the file of a table in a directory.
    fn create<L: Table>(directory: &Path) -> Result<AppendedFile, RunDirError> {
        let path = directory.join(L::FILE);
        let file = File::create_new(&path).map_err(write_error(&path))?;
        let mut log = AppendedFile { path, file: BufWriter::new(file) };
        log.append_text(&L::header())?;
        Ok(log)
    }

    /// Creates the file of a table that the run has only if `exists`.
    fn create_if<L: Table>(
        exists: bool,
        directory: &Path,
    ) -> Result<Option<AppendedFile>, RunDirError> {
        exists.then(|| AppendedFile::create::<L>(directory)).transpose()
    }

    fn append_text(&mut self, text: &str) -> Result<(), RunDirError> {
        self.file.write_all(text.as_bytes()).map_err(write_error(&self.path))
    }

    fn flush(&mut self) -> Result<(), RunDirError> {
        self.file.flush().map_err(write_error(&self.path))
    }
}

impl RunDir {
    /// Creates the directory, which must not exist.
    pub fn create(path: &Path, scenario: &Scenario) -> Result<RunDir, RunDirError> {
        let host_dir = HostDir::create(path)?;
        let summary = path.join(SUMMARY_FILE);
        Ok(RunDir {
            host_dir,
            newest_samples: SampleSelector::new(scenario),
            walls: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
            samples: AppendedFile::create::<SampleLine>(path)?,
            last_samples_flush: Instant::now(),
            events: AppendedFile::create::<EventLine>(path)?,
            signals: AppendedFile::create_if::<SignalLine>(scenario.has_signals(), path)?,
            messages: AppendedFile::create_if::<MessageLine>(
                scenario.has_recorded_messages(),
                path,
            )?,
            recording: None,
            reserved_summary: Some(
                ReservedFile::create(&summary, summary_bytes(scenario))
                    .map_err(write_error(&summary))?,
            ),
        })
    }

    /// Writes the effective scenario and the manifest, and creates the recording. Without `is_recorded`, there is
    /// no recording, and only the first and the last sample are written.
    pub fn write_initial_files(
        &mut self,
        scenario: &str,
        manifest: &Manifest,
        is_recorded: bool,
    ) -> Result<(), RunDirError> {
        self.write_scenario(scenario)?;
        self.write_file(MANIFEST_FILE, to_json(manifest))?;
        if is_recorded {
            return self.begin_recording(scenario, manifest);
        }
        self.newest_samples.record_first_and_last_only();
        Ok(())
    }

    /// Creates the recording with the effective scenario and, in real time, the manifest.
    fn begin_recording(&mut self, scenario: &str, manifest: &Manifest) -> Result<(), RunDirError> {
        let path = self.path().join(RECORDING_FILE);
        let run = self.path().file_name().unwrap_or_default().to_string_lossy().into_owned();
        let (seed, is_reproducible) = (manifest.seed.to_string(), manifest.pace == Pace::Lockstep);
        let mut metadata = BTreeMap::from([
            ("scenario", manifest.scenario.as_str()),
            ("pace", manifest.pace.keyword()),
            ("seed", &seed),
            ("phalanx", manifest.phalanx),
            ("git_hash", manifest.build.git_hash.as_deref().unwrap_or("")),
        ]);
        let manifest_text = to_json(manifest);
        let mut attachments = vec![(SCENARIO_FILE, "application/toml", scenario)];
        if !is_reproducible {
            metadata.insert("run", &run);
            attachments.push(("manifest.json", "application/json", &manifest_text));
        }
        let metadata = metadata.into_iter().map(|(key, value)| (key.to_owned(), value.to_owned()));
        let run = RunDescription {
            started_unix_ns: manifest.epoch_unix_ns,
            is_reproducible,
            robots: self.newest_samples.robots(),
            law_topics: [
                (LawTopic::Signals, self.newest_samples.robots_with_signals()),
                (LawTopic::Messages, self.newest_samples.robots_with_messages()),
            ],
            walls: &self.walls,
            metadata: metadata.collect(),
            attachments: &attachments,
        };
        self.recording = Some(Recorder::create(&path, &run).map_err(write_error(&path))?);
        Ok(())
    }

    /// Writes a sample to `samples.csv` and the recording if one is due. The last sample of a run is always
    /// written. `metrics` are those at this sample.
    pub fn write_truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        metrics: CurrentMetrics<'_>,
    ) -> Result<(), RunDirError> {
        match self.newest_samples.store_sample(header, rows, alive, metrics) {
            true => self.write_newest_sample(),
            false => Ok(()),
        }
    }

    /// Adds the message that a robot's law sent with the answer to its sample of run time `t_ns`, ns. Does nothing if
    /// messages are not recorded.
    pub fn add_law_message(&mut self, robot: usize, t_ns: u64, message: &[u8]) {
        self.newest_samples.add_law_message(robot, t_ns, message);
    }

    fn write_newest_sample(&mut self) -> Result<(), RunDirError> {
        let Some(sample) = self.newest_samples.take_newest_sample() else { return Ok(()) };
        self.samples.append_text(sample.text)?;
        let DueSample { t_ns, lines, nearest_pair, signals, messages, .. } = sample;
        if let Some(log) = &mut self.signals {
            log.append_text(&tables::format_lines(signals))?;
        }
        if let Some(log) = &mut self.messages {
            let lines: Vec<MessageLine> =
                messages.iter().flat_map(RecordedMessage::lines).collect();
            log.append_text(&tables::format_lines(&lines))?;
        }
        write_to_recording(&mut self.recording, &self.host_dir, |recording| {
            recording.record_sample(t_ns, lines, nearest_pair)?;
            recording.record_signals(t_ns, signals)?;
            recording.record_law_messages(t_ns, messages)
        })
    }

    fn write_last_truth(&mut self) -> Result<(), RunDirError> {
        self.write_newest_sample()?;
        self.flush_tables()
    }

    fn flush_tables(&mut self) -> Result<(), RunDirError> {
        self.samples.flush()?;
        let law_tables = [&mut self.signals, &mut self.messages];
        law_tables.into_iter().flatten().try_for_each(AppendedFile::flush)
    }

    /// Flushes buffered data if the last flush was at least [`FLUSH_INTERVAL`] ago, so that a kill loses no more than
    /// that. Call it often.
    pub fn flush_if_due(&mut self, now: Instant) -> Result<(), RunDirError> {
        if now.saturating_duration_since(self.last_samples_flush) >= FLUSH_INTERVAL {
            self.last_samples_flush = now;
            self.flush_tables()?;
        }
        write_to_recording(&mut self.recording, &self.host_dir, |recording| {
            recording.flush_if_due(now)
        })
    }

    /// Writes an event at this run time, ns, and flushes `events.csv`.
    pub fn write_event(&mut self, t_ns: u64, event: EventLine) -> Result<(), RunDirError> {
        let event = EventLine { t_s: ns_to_seconds(t_ns), ..event };
        self.events.append_text(&event.to_csv_line())?;
        self.events.flush()?;
        write_to_recording(&mut self.recording, &self.host_dir, |recording| {
            recording.record_event(t_ns, &event)
        })
    }

    /// Writes the summary, after all other files, of which these could not be written. Returns all errors; each names
    /// an incomplete file. After an error the summary has the exit code of a failure.
    pub fn finish(
        &mut self,
        summary: &mut Summary,
        mut write_errors: Vec<RunDirError>,
    ) -> Vec<RunDirError> {
        if !write_errors.is_empty() {
            summary.exit = exit::INFRASTRUCTURE_FAILURE;
        }
        if let Some(Err(error)) =
            self.reserved_summary.take().map(|reserved| reserved.fill(to_json(summary).as_bytes()))
        {
            write_errors.push(write_error(&self.path().join(SUMMARY_FILE))(error));
            summary.exit = exit::INFRASTRUCTURE_FAILURE;
        }
        write_errors
    }

    /// Writes all remaining files except for the summary, as far as there is disk space, of a run that lasted for this
    /// wall time. Returns all errors; each names an incomplete file.
    pub fn write_final_files(
        &mut self,
        pairs: &[PairDistance],
        latency: &mut LatencyCollector,
        duration: Duration,
    ) -> Vec<RunDirError> {
        let hlog = latency.encode_hlog(SystemTime::now() - duration, duration);
        // Each file is written, even if one before it failed.
        [
            self.events.flush(),
            self.write_last_truth(),
            self.write_file(PAIRS_FILE, tables::format_pairs(pairs)),
            self.write_file(StageLatency::FILE, to_csv(&latency.stage_latencies())),
            self.write_file(LatencyInterval::FILE, to_csv(&latency.intervals_over_time())),
            self.write_file("latency.hlog", hlog),
            self.recording.take().map_or(Ok(()), |recording| {
                recording.finish().map_err(write_error(&self.path().join(RECORDING_FILE)))
            }),
        ]
        .into_iter()
        .filter_map(Result::err)
        .collect()
    }
}

/// Passes the recording to `write`. After the first error, which is returned, the recording is given up and all
/// other files are still written.
fn write_to_recording(
    recording: &mut Option<Recorder>,
    host: &HostDir,
    write: impl FnOnce(&mut Recorder) -> io::Result<()>,
) -> Result<(), RunDirError> {
    let Some(recorder) = recording else { return Ok(()) };
    write(recorder).map_err(|error| {
        *recording = None;
        write_error(&host.path().join(RECORDING_FILE))(error)
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
    let part_count = scenario.robots.len() + scenario.graph.edges().len() + scenario.faults.len();
    let hash_bytes = 32 * (scenario.duration_ns / 1_000_000_000);
    (1 << 16) + (1 << 12) * part_count as u64 + hash_bytes
}

/// Location of a run's directory.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RunLocation {
    /// This path, which must not exist.
    Path(PathBuf),
    /// Path `runs/<name>-<date>-<time>` in UTC, with a number appended if it exists.
    DatedName(String),
}

impl RunLocation {
    /// Calls `create` with a free path. Returns the path and the result. Runs that start at the same time get
    /// different paths.
    pub fn create_with<D>(
        &self,
        create: impl Fn(&Path) -> Result<D, RunDirError>,
    ) -> Result<(PathBuf, D), RunDirError> {
        let stem = match self {
            RunLocation::Path(path) => return Ok((path.clone(), create(path)?)),
            RunLocation::DatedName(name) => name_with_date(name),
        };
        let numbered = (2..).map(|n| format!("{stem}-{n}"));
        let paths = std::iter::once(stem.clone()).chain(numbered);
        for path in paths.map(|name| Path::new(RUNS_DIR).join(name)) {
            match create(&path) {
                Err(RunDirError::Exists(_)) => {}
                created => return Ok((path, created?)),
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
    let to_usable_character =
        |c: char| if c.is_alphanumeric() || "-_".contains(c) { c } else { '_' };
    let mut bytes = 0;
    let fits = |c: &char| {
        bytes += c.len_utf8();
        bytes <= NAME_BYTES_MAX
    };
    let name: String = name.chars().map(to_usable_character).take_while(fits).collect();
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    format!("{name}-{}", date::format_for_file_name(seconds))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn name_taken_concurrently_gets_next_number() {
        let attempts = std::cell::Cell::new(0);
        let create = |path: &Path| {
            attempts.set(attempts.get() + 1);
            if attempts.get() < 3 { Err(RunDirError::Exists(path.into())) } else { Ok(()) }
        };
        let (path, ()) = super::RunLocation::DatedName("a/b".into()).create_with(create).unwrap();
        let path = path.to_str().unwrap();
        assert!(path.starts_with("runs/a_b-2") && path.ends_with("-3"), "{path}");
        attempts.set(0);
        assert!(
            super::RunLocation::Path("here".into()).create_with(create).is_err(),
            "no other place was asked for"
        );
    }

    use crate::metrics::examples::{header, rows};
    use experiment::examples::row_of_three;
    use formation::Vec2;

    #[test]
    fn second_run_into_the_same_directory_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for round in 0..50 {
            let path = folder.path().join(format!("deep/run-{round}"));
            let results: Vec<_> = std::thread::scope(|scope| {
                let create_and_write = || {
                    let run_dir = RunDir::create(&path, &row_of_three())?;
                    run_dir.write_scenario("name")
                };
                let threads = [scope.spawn(create_and_write), scope.spawn(create_and_write)];
                threads.into_iter().map(|thread| thread.join().unwrap()).collect()
            });
            let refused: Vec<_> = results.into_iter().filter_map(Result::err).collect();
            assert!(matches!(refused[..], [RunDirError::Exists(_)]), "{refused:?}");
            assert_eq!(fs::read_to_string(path.join("scenario.toml")).unwrap(), "name");
        }
    }

    #[test]
    fn samples_of_an_early_end_have_the_first_and_the_last_row() {
        let folder = tempfile::tempdir().unwrap();
        let mut run_dir = RunDir::create(&folder.path().join("run"), &row_of_three()).unwrap();
        for tick in 1..=7 {
            let rows = rows([tick as f64, -1.0, -2.0]);
            let metrics = CurrentMetrics {
                errors_m: &[None, Some(0.5), None],
                error_vectors: &[None, Some(Vec2::new(-0.3, 0.4)), None],
                ideal_errors_m: &[None, None, Some(0.25)],
                ..CurrentMetrics::default()
            };
            run_dir.write_truth(&header(tick), &rows, &[true; 3], metrics).unwrap();
        }
        run_dir.write_last_truth().unwrap();
        let text = fs::read_to_string(folder.path().join("run/samples.csv")).unwrap();
        let lines: Vec<_> = text.lines().collect();
        assert_eq!(lines[1], "1,r1,0.9,0,0,0,0,,1,,1,0,,,0");
        assert_eq!(lines[2], "1,r2,-1.1,0,0,0,0,0.5,1,,-1,0,-0.3,0.4,0");
        assert_eq!(lines[3], "1,r3,-2.1,0,0,0,0,,1,0.25,-2,0,,,0");
        let mut times: Vec<_> = lines[1..].iter().map(|l| l.split_once(',').unwrap().0).collect();
        times.dedup();
        assert_eq!(times, ["1", "2", "4", "6", "7"]);
    }
}
