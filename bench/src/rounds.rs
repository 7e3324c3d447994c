//! In which order it is measured: in each round every case once, a run and its baselines by turns.

use std::io::{self, Write as _};

use protocol::process::Stop;
use protocol::run_root::RunRoot;

use crate::Interrupted;
use crate::table::Table;

/// What all measurements have in common.
pub(crate) struct Setting<'a> {
    pub(crate) root: &'a RunRoot,
    pub(crate) stop: &'a Stop,
    /// How often a run and its baselines take turns.
    pub(crate) rounds: usize,
    /// How long each measurement is to take, s, about.
    pub(crate) seconds: f64,
    /// In real time robots, plant and timers run before every ordinary process.
    pub(crate) realtime_priority: bool,
    /// Somebody looks on.
    pub(crate) shows_progress: bool,
}

/// Measures once, and writes down what came out.
type Measure<'a> = Box<dyn FnMut(&mut Table) -> anyhow::Result<()> + 'a>;

/// One line or several lines of the table, measured together in each round.
pub(crate) struct Case<'a> {
    name: String,
    measure: Measure<'a>,
}

impl<'a> Case<'a> {
    pub(crate) fn new(
        name: impl Into<String>,
        measure: impl FnMut(&mut Table) -> anyhow::Result<()> + 'a,
    ) -> Case<'a> {
        Case { name: name.into(), measure: Box::new(measure) }
    }
}

impl Setting<'_> {
    /// Measures the cases of a part.
    pub(crate) fn measure(
        &self,
        table: &mut Table,
        part: &'static str,
        cases: Vec<Case<'_>>,
    ) -> anyhow::Result<()> {
        let mut cases = cases;
        for round in 1..=self.rounds {
            for case in &mut cases {
                if self.shows_progress {
                    let shown = format!("{part}, {}, round {round} of {}", case.name, self.rounds);
                    let _ = write!(io::stderr(), "\r\x1b[K{shown}");
                }
                self.go_on()?;
                table.begin(part, &case.name);
                (case.measure)(table)?;
            }
        }
        Ok(())
    }

    /// Fails if a signal came.
    pub(crate) fn go_on(&self) -> anyhow::Result<()> {
        if self.stop.requested() { Err(Interrupted.into()) } else { Ok(()) }
    }

    /// How a case of real time is named.
    pub(crate) fn realtime_case(&self, robots: usize, rate_hz: u64) -> String {
        let priority = if self.realtime_priority { " with real-time priority" } else { "" };
        format!("{robots} robots at {rate_hz} Hz{priority}")
    }
}
