//! Order of the measurements: each round measures every case once, with the run and its baselines one after the other.

use std::io::{self, Write as _};

use protocol::process::StopFlag;
use protocol::run_root::RunRoot;

use crate::Interrupted;
use crate::table::MeasurementTable;

/// Settings that all measurements share.
pub(crate) struct BenchSettings<'a> {
    /// Run root of the bench.
    pub(crate) root: &'a RunRoot,
    /// State of the signal handlers.
    pub(crate) stop: &'a StopFlag,
    /// Number of rounds.
    pub(crate) rounds: usize,
    /// Approximate duration of each measurement, s.
    pub(crate) duration_s: f64,
    /// `true` to run robots, plant and timers of the part realtime with SCHED_FIFO priority.
    pub(crate) realtime_priority: bool,
    /// `true` to show the progress on stderr, which is then a terminal.
    pub(crate) shows_progress: bool,
}

/// Function that measures once and records the values in the table.
type MeasureFn<'a> = Box<dyn FnMut(&mut MeasurementTable) -> anyhow::Result<()> + 'a>;

/// A case: one or several rows of the table, measured together in each round.
pub(crate) struct BenchCase<'a> {
    name: String,
    measure: MeasureFn<'a>,
}

impl<'a> BenchCase<'a> {
    pub(crate) fn new(
        name: impl Into<String>,
        measure: impl FnMut(&mut MeasurementTable) -> anyhow::Result<()> + 'a,
    ) -> BenchCase<'a> {
        BenchCase { name: name.into(), measure: Box::new(measure) }
    }
}

impl BenchSettings<'_> {
    /// Measures the cases of a part in all rounds.
    ///
    /// # Errors
    /// The first error of a measurement, or [`Interrupted`].
    pub(crate) fn measure_cases(
        &self,
        table: &mut MeasurementTable,
        part: &'static str,
        cases: Vec<BenchCase<'_>>,
    ) -> anyhow::Result<()> {
        let mut cases = cases;
        for round in 1..=self.rounds {
            for case in &mut cases {
                if self.shows_progress {
                    let progress =
                        format!("{part}, {}, round {round} of {}", case.name, self.rounds);
                    let _ = write!(io::stderr(), "\r\x1b[K{progress}");
                }
                self.check_interrupted()?;
                table.begin_case(part, &case.name);
                (case.measure)(table)?;
            }
        }
        Ok(())
    }

    /// Returns the error [`Interrupted`] if a signal has been received.
    pub(crate) fn check_interrupted(&self) -> anyhow::Result<()> {
        if self.stop.is_requested() { Err(Interrupted.into()) } else { Ok(()) }
    }

    /// Returns the name of a case in real time.
    pub(crate) fn format_realtime_case(&self, robots: usize, rate_hz: u64) -> String {
        let priority = if self.realtime_priority { " with real-time priority" } else { "" };
        format!("{robots} robots at {rate_hz} Hz{priority}")
    }
}
