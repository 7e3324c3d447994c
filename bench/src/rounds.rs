//! Order of the measurements: each round measures every case once, with runs and baselines alternating.

use std::io::{self, Write as _};

use protocol::process::Stop;
use protocol::run_root::RunRoot;

use crate::Interrupted;
use crate::table::Table;

/// Settings that all measurements have in common.
pub(crate) struct Setting<'a> {
    pub(crate) root: &'a RunRoot,
    pub(crate) stop: &'a Stop,
    /// Number of rounds.
    pub(crate) rounds: usize,
    /// Approximate duration of each measurement, s.
    pub(crate) seconds: f64,
    /// Whether robots, plant and timers run with real-time priority in real time.
    pub(crate) realtime_priority: bool,
    /// Whether stderr is a terminal, on which progress is shown.
    pub(crate) shows_progress: bool,
}

/// Measures once, and adds the values to the table.
type Measure<'a> = Box<dyn FnMut(&mut Table) -> anyhow::Result<()> + 'a>;

/// One or more lines of the table, measured together in each round.
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
                self.check_signals()?;
                table.begin(part, &case.name);
                (case.measure)(table)?;
            }
        }
        Ok(())
    }

    /// Fails if a signal has arrived.
    pub(crate) fn check_signals(&self) -> anyhow::Result<()> {
        if self.stop.requested() { Err(Interrupted.into()) } else { Ok(()) }
    }

    /// Returns the name of a real-time case.
    pub(crate) fn realtime_case(&self, robots: usize, rate_hz: u64) -> String {
        let priority = if self.realtime_priority { " with real-time priority" } else { "" };
        format!("{robots} robots at {rate_hz} Hz{priority}")
    }
}
