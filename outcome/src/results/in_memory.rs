//! Tables of a run in memory: the replacement of `run_dir` without the feature `files`.

use std::convert::Infallible;

use experiment::scenario::Scenario;
use protocol::message::{TruthHeader, TruthRow};

use crate::metrics::CurrentErrors;
use crate::results::tables::{EVENTS_HEADER, SAMPLES_HEADER, Samples, event_line};

/// Error of writing to memory, which never occurs.
pub type RunDirError = Infallible;

/// Tables of one run.
pub struct RunDir {
    tables: Samples,
    samples: String,
    /// Events up to now.
    pub recorded_events: Vec<RecordedEvent>,
}

/// An event of a run.
pub struct RecordedEvent {
    /// Run time, ns.
    pub t_ns: u64,
    /// Kind of the event.
    pub kind: String,
    /// Name of the robot; empty for an event of the run.
    pub robot: String,
    /// Details of the event.
    pub detail: String,
}

impl RunDir {
    /// Creates the tables before the first sample.
    pub fn new(scenario: &Scenario) -> RunDir {
        let samples = SAMPLES_HEADER.to_owned();
        RunDir { tables: Samples::new(scenario), samples, recorded_events: Vec::new() }
    }

    /// Stores a sample. The last sample of a run is always written. `measured` are the metrics at this sample.
    pub fn write_truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        measured: CurrentErrors<'_>,
    ) -> Result<(), RunDirError> {
        if self.tables.store(header, rows, alive, measured) {
            self.samples.extend(self.tables.format_newest());
        }
        Ok(())
    }

    /// Stores an event.
    pub fn write_event(
        &mut self,
        t_ns: u64,
        kind: &str,
        robot: &str,
        detail: &str,
    ) -> Result<(), RunDirError> {
        let [kind, robot, detail] = [kind, robot, detail].map(str::to_owned);
        self.recorded_events.push(RecordedEvent { t_ns, kind, robot, detail });
        Ok(())
    }

    /// Returns `samples.csv` up to the newest sample.
    pub fn samples(&mut self) -> &str {
        self.samples.extend(self.tables.format_newest());
        &self.samples
    }

    /// Returns `events.csv` up to now.
    pub fn events(&self) -> String {
        let lines = self.recorded_events.iter();
        let lines = lines.map(|it| event_line(it.t_ns, &it.kind, &it.robot, &it.detail));
        EVENTS_HEADER.to_owned() + &lines.collect::<String>()
    }
}
