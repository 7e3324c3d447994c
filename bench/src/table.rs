//! Table of the measured values: their median, minimum and maximum over the rounds, and the ratio of a run to its
//! baseline, computed within each round.

use std::fmt::Write as _;

use serde::Serialize;

use outcome::campaign::statistics::finite_median;
use outcome::report::digits::format_four_digits;

use crate::machine::Machine;

/// Measured values during the bench, in the order of their first occurrence.
#[derive(Debug, Default)]
pub(crate) struct MeasurementTable {
    /// Part of the next values.
    current_part: &'static str,
    /// Case of the next values.
    current_case: String,
    quantities: Vec<MeasuredQuantity>,
    trajectories: Vec<TrajectoryHashes>,
}

/// Values of one quantity in all rounds.
#[derive(Debug)]
struct MeasuredQuantity {
    part: &'static str,
    /// Case and name of the quantity, with its unit.
    description: String,
    /// Values of the run, one for each round.
    run_values: Vec<f64>,
    /// Name and values of each baseline, one value for each round.
    baselines: Vec<(String, Vec<f64>)>,
}

/// Hashes of one trajectory, computed by a run and its baselines.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct TrajectoryHashes {
    robots: usize,
    ticks: u64,
    /// Name of the run or baseline, and its hash.
    hashes: Vec<(String, String)>,
}

impl MeasurementTable {
    /// Sets the part and the case of the next values.
    pub(crate) fn begin_case(&mut self, part: &'static str, case: &str) {
        (self.current_part, self.current_case) = (part, case.into());
    }

    /// Returns the values of a quantity of the current case, if there are any.
    fn find_quantity(&mut self, quantity: &str) -> Option<&mut MeasuredQuantity> {
        let (part, quantity) = (self.current_part, format!("{}, {quantity}", self.current_case));
        self.quantities.iter_mut().find(|entry| entry.part == part && entry.description == quantity)
    }

    /// Records a value of the run in this round. `quantity` names the quantity and ends with its unit.
    pub(crate) fn record_run(&mut self, quantity: &str, value: f64) {
        match self.find_quantity(quantity) {
            Some(entry) => entry.run_values.push(value),
            None => {
                let (part, quantity) =
                    (self.current_part, format!("{}, {quantity}", self.current_case));
                let (run, baselines) = (vec![value], Vec::new());
                self.quantities.push(MeasuredQuantity {
                    part,
                    description: quantity,
                    run_values: run,
                    baselines,
                });
            }
        }
    }

    /// Records a value of a baseline in this round.
    ///
    /// # Panics
    /// If the run has no value of this quantity.
    pub(crate) fn record_baseline(&mut self, quantity: &str, name: &str, value: f64) {
        let entry = self.find_quantity(quantity).expect("a run is measured before its baselines");
        match entry.baselines.iter_mut().find(|(baseline, _)| baseline == name) {
            Some((_, values)) => values.push(value),
            None => entry.baselines.push((name.into(), vec![value])),
        }
    }

    /// Returns the latest value of a run in the current part. `description` is the case and the quantity, joined by a
    /// comma.
    pub(crate) fn last_value(&self, description: &str) -> Option<f64> {
        let is_match = |entry: &&MeasuredQuantity| {
            entry.part == self.current_part && entry.description == description
        };
        self.quantities.iter().find(is_match)?.run_values.last().copied()
    }

    /// Records the trajectory hash of a run or baseline (`source`). All hashes for a number of robots and of ticks must
    /// be equal; [`Report::find_trajectory_mismatch`] checks it.
    pub(crate) fn record_trajectory(
        &mut self,
        robots: usize,
        ticks: u64,
        source: &str,
        hash: &str,
    ) {
        let source_and_hash = (source.to_owned(), hash.to_owned());
        let is_same =
            |recorded: &&mut TrajectoryHashes| (recorded.robots, recorded.ticks) == (robots, ticks);
        match self.trajectories.iter_mut().find(is_same) {
            Some(trajectory) if trajectory.hashes.contains(&source_and_hash) => {}
            Some(trajectory) => trajectory.hashes.push(source_and_hash),
            None => self.trajectories.push(TrajectoryHashes {
                robots,
                ticks,
                hashes: vec![source_and_hash],
            }),
        }
    }

    /// Returns the report of all recorded values.
    pub(crate) fn into_report(
        self,
        machine: Machine,
        warnings: Vec<String>,
        notes: Vec<String>,
    ) -> Report {
        let rows = self.quantities.iter().flat_map(MeasuredQuantity::to_rows).collect();
        Report { machine, warnings, trajectories: self.trajectories, rows, notes }
    }
}

impl MeasuredQuantity {
    /// Returns a row for each baseline, or one row without a baseline if there is none.
    fn to_rows(&self) -> Vec<ReportRow> {
        let row = ReportRow {
            part: self.part,
            what: self.description.clone(),
            ours: Spread::from_rounds(&self.run_values),
            floor_name: None,
            floor: None,
            ratio: None,
        };
        let baseline_rows = self.baselines.iter().map(|(name, baseline)| {
            let ratios: Vec<f64> = self
                .run_values
                .iter()
                .zip(baseline)
                .map(|(run, baseline)| run / baseline)
                .collect();
            ReportRow {
                floor_name: Some(name.clone()),
                floor: Some(Spread::from_rounds(baseline)),
                // A baseline value of 0 has no ratio.
                ratio: ratios
                    .iter()
                    .all(|ratio| ratio.is_finite())
                    .then(|| Spread::from_rounds(&ratios)),
                ..row.clone()
            }
        });
        let baseline_rows: Vec<ReportRow> = baseline_rows.collect();
        if baseline_rows.is_empty() { vec![row] } else { baseline_rows }
    }
}

/// Median, minimum and maximum over the rounds.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Spread {
    median: f64,
    min: f64,
    max: f64,
    /// Value of each round.
    rounds: Vec<f64>,
}

impl Spread {
    /// Computes the spread of the values of all rounds.
    ///
    /// # Panics
    /// If there are no rounds or no finite values.
    fn from_rounds(rounds: &[f64]) -> Spread {
        let median = finite_median(rounds).expect("at least one round");
        let [min, max] =
            [f64::min, f64::max].map(|choose| rounds.iter().copied().fold(median, choose));
        Spread { median, min, max, rounds: rounds.to_vec() }
    }

    /// Formats the spread as median (minimum-maximum), or as one value for a single round.
    fn format(&self) -> String {
        let Spread { median, min, max, rounds } = self;
        match rounds.len() {
            1 => format_four_digits(*median),
            _ => format!(
                "{} ({}-{})",
                format_four_digits(*median),
                format_four_digits(*min),
                format_four_digits(*max)
            ),
        }
    }
}

/// A row of the table. Its field names are JSON keys.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct ReportRow {
    part: &'static str,
    /// Case and name of the measured quantity, with its unit.
    what: String,
    /// Values of Phalanx.
    ours: Spread,
    /// Name of the baseline.
    floor_name: Option<String>,
    /// Values of the baseline.
    floor: Option<Spread>,
    /// Ratio of `ours` to `floor`; `None` without a baseline or if a ratio is not finite.
    ratio: Option<Spread>,
}

/// Complete result of a bench.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Report {
    machine: Machine,
    /// Conditions that make the results doubtful.
    warnings: Vec<String>,
    /// Trajectory hashes for each number of robots.
    trajectories: Vec<TrajectoryHashes>,
    rows: Vec<ReportRow>,
    /// Explanations of the rows.
    notes: Vec<String>,
}

impl Report {
    /// Formats the report as JSON.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("string keys and finite numbers only") + "\n"
    }

    /// Returns an error message about the first number of robots and ticks for which the hashes differ; `None` if all
    /// are equal.
    pub(crate) fn find_trajectory_mismatch(&self) -> Option<String> {
        let has_difference = |trajectory: &&TrajectoryHashes| {
            trajectory.hashes.iter().any(|(_, hash)| *hash != trajectory.hashes[0].1)
        };
        let TrajectoryHashes { robots, hashes, .. } =
            self.trajectories.iter().find(has_difference)?;
        Some(format!(
            "trajectories of {robots} robots differ, so their speeds cannot be compared: {hashes:?}"
        ))
    }

    /// Formats the report as text.
    pub(crate) fn to_text(&self) -> String {
        let mut text = self.machine.to_text() + &self.format_rows();
        let verdict = match self.find_trajectory_mismatch() {
            None => "bit-identical trajectories",
            Some(_) => "DIFFERENT trajectories",
        };
        for TrajectoryHashes { robots, ticks, hashes } in &self.trajectories {
            let _ = writeln!(text, "{robots} robots, {ticks} ticks: {verdict}: {}", hashes[0].1);
        }
        text += "median (minimum-maximum) of the rounds; each round measured Phalanx and its baselines once\n";
        for note in &self.notes {
            let _ = writeln!(text, "{note}");
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "warning: {warning}");
        }
        text
    }

    /// Formats the rows in columns, with the name of each part above its rows.
    fn format_rows(&self) -> String {
        let format = |spread: &Option<Spread>| spread.as_ref().map(Spread::format);
        let cells = |row: &ReportRow| {
            [
                row.what.clone(),
                row.ours.format(),
                row.floor_name.clone().unwrap_or("-".into()),
                format(&row.floor).unwrap_or_default(),
                format(&row.ratio).unwrap_or("-".into()),
                row.ours.rounds.len().to_string(),
            ]
        };
        let header = ["measurement", "Phalanx", "baseline", "", "Phalanx / baseline", "rounds"];
        let mut lines = vec![("", header.map(str::to_owned))];
        lines.extend(self.rows.iter().map(|row| (row.part, cells(row))));
        let width = |column: usize| lines.iter().map(|(_, cells)| cells[column].len()).max();
        let widths: [usize; 6] = std::array::from_fn(|column| width(column).unwrap_or(0));
        let (mut text, mut last_part) = (String::new(), "");
        for (part, cells) in &lines {
            if *part != last_part {
                let _ = writeln!(text, "{}", if *part == "floors" { "baselines" } else { part });
                last_part = part;
            }
            let mut line = String::new();
            for (cell, width) in cells.iter().zip(widths) {
                let _ = write!(line, "  {cell:<width$}");
            }
            let _ = writeln!(text, "{}", line.trim_end());
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratio_is_the_median_of_the_ratios_within_rounds() {
        let mut table = MeasurementTable::default();
        table.begin_case("floors", "round trip");
        for (run, baseline) in [(10.0, 1.0), (40.0, 8.0), (30.0, 0.5)] {
            table.record_run("p50, us", run);
            table.record_baseline("p50, us", "pipe", baseline);
        }
        assert_eq!(table.last_value("round trip, p50, us"), Some(30.0));
        let report = table.into_report(Machine::probe(), Vec::new(), Vec::new());
        let row = &report.rows[0];
        let ratio = row.ratio.as_ref().unwrap();
        assert_eq!((ratio.median, ratio.min, ratio.max, row.ours.median), (10.0, 5.0, 60.0, 30.0));
        assert!(report.to_text().contains("30.00 (10.00-40.00)"), "{}", report.to_text());
        assert_eq!(Spread::from_rounds(&[9.0, 1.0, 2.0, 4.0]).median, 3.0);
    }

    #[test]
    fn differing_trajectory_hashes_are_reported() {
        let mut table = MeasurementTable::default();
        for (source, hash) in [("run", "a"), ("mapping", "a"), ("run", "b")] {
            table.record_trajectory(3, 5, source, hash);
        }
        let differing =
            table.into_report(Machine::probe(), Vec::new(), Vec::new()).find_trajectory_mismatch();
        assert!(differing.unwrap().contains(r#"("run", "a"), ("mapping", "a"), ("run", "b")"#));
    }
}
