//! Tables of a run in memory: the replacement of `run_dir` without the feature `files`.

use std::convert::Infallible;

use experiment::scenario::Scenario;
use protocol::message::{TruthHeader, TruthRow};

use formation::ns_to_seconds;

use crate::columns::Table as _;
use crate::metrics::CurrentMetrics;
use crate::results::tables::{EventLine, SampleLine, SampleSelector};

pub use InMemoryError as RunDirError;
pub use InMemoryRun as RunDir;

/// Error of writing to memory, which never occurs.
pub type InMemoryError = Infallible;

/// Tables of one run.
pub struct InMemoryRun {
    tables: SampleSelector,
    samples: String,
    /// Events up to now.
    pub recorded_events: Vec<EventLine>,
}

impl InMemoryRun {
    /// Creates the tables before the first sample.
    pub fn new(scenario: &Scenario) -> InMemoryRun {
        let samples = SampleLine::header();
        InMemoryRun { tables: SampleSelector::new(scenario), samples, recorded_events: Vec::new() }
    }

    /// Stores a sample. The last sample of a run is always written. `metrics` are those at this sample.
    pub fn write_truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        metrics: CurrentMetrics<'_>,
    ) -> Result<(), InMemoryError> {
        if self.tables.store_sample(header, rows, alive, metrics) {
            self.write_newest();
        }
        Ok(())
    }

    fn write_newest(&mut self) {
        self.samples.extend(self.tables.take_newest_sample().map(|sample| sample.text));
    }

    /// Adds the message that a robot's law sent with the answer to its sample of run time `t_ns`, ns.
    pub fn add_law_message(&mut self, robot: usize, t_ns: u64, message: &[u8]) {
        self.tables.add_law_message(robot, t_ns, message);
    }

    /// Stores an event at this run time, ns.
    pub fn write_event(&mut self, t_ns: u64, event: EventLine) -> Result<(), InMemoryError> {
        self.recorded_events.push(EventLine { t_s: ns_to_seconds(t_ns), ..event });
        Ok(())
    }

    /// Returns `samples.csv` up to the newest sample.
    pub fn samples(&mut self) -> &str {
        self.write_newest();
        &self.samples
    }

    /// Returns `events.csv` up to now.
    pub fn events(&self) -> String {
        let lines = self.recorded_events.iter().map(EventLine::to_csv_line);
        EventLine::header() + &lines.collect::<String>()
    }
}
