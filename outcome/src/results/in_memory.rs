//! The tables of a run where there are no files: what `run_dir` is without the feature `files`.

use std::convert::Infallible;

use experiment::scenario::Scenario;
use protocol::message::{TruthHeader, TruthRow};

use crate::metrics::Now;
use crate::results::tables::{EVENTS_HEADER, SAMPLES_HEADER, Samples, event_line};

/// Memory takes everything.
pub type RunDirError = Infallible;

/// The tables of one run.
pub struct RunDir {
    tables: Samples,
    samples: String,
    /// What happened so far.
    pub happened: Vec<Happened>,
}

/// One event.
pub struct Happened {
    /// Run time, ns.
    pub t_ns: u64,
    /// What.
    pub kind: String,
    /// To which robot; empty for the run as a whole.
    pub robot: String,
    /// More of it.
    pub detail: String,
}

impl RunDir {
    /// Before the first truth.
    pub fn new(scenario: &Scenario) -> RunDir {
        let samples = SAMPLES_HEADER.to_owned();
        RunDir { tables: Samples::new(scenario), samples, happened: Vec::new() }
    }

    /// Takes in a truth; the last one is written at the end anyhow.
    pub fn truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        measured: Now<'_>,
    ) -> Result<(), RunDirError> {
        if self.tables.truth(header, rows, alive, measured) {
            self.samples.extend(self.tables.take_lines());
        }
        Ok(())
    }

    /// Writes an event.
    pub fn event(
        &mut self,
        t_ns: u64,
        kind: &str,
        robot: &str,
        detail: &str,
    ) -> Result<(), RunDirError> {
        let [kind, robot, detail] = [kind, robot, detail].map(str::to_owned);
        self.happened.push(Happened { t_ns, kind, robot, detail });
        Ok(())
    }

    /// All of `samples.csv` up to the newest truth.
    pub fn samples(&mut self) -> &str {
        self.samples.extend(self.tables.take_lines());
        &self.samples
    }

    /// All of `events.csv` so far.
    pub fn events(&self) -> String {
        let lines = self.happened.iter();
        let lines = lines.map(|it| event_line(it.t_ns, &it.kind, &it.robot, &it.detail));
        EVENTS_HEADER.to_owned() + &lines.collect::<String>()
    }
}
