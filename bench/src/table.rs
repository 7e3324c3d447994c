//! Results: the values of each round, their medians with minimum and maximum, and the ratio of a run to its
//! baseline, computed within each round.

use std::fmt::Write as _;

use serde::Serialize;

use outcome::campaign::statistics::finite_median;
use outcome::report::digits::digits;

use crate::machine::Machine;

/// Values collected so far, in the order in which they first occurred.
#[derive(Debug, Default)]
pub(crate) struct Table {
    /// Part to which the next values belong; the case follows.
    part: &'static str,
    case: String,
    figures: Vec<Figure>,
    trajectories: Vec<Trajectory>,
}

#[derive(Debug)]
struct Figure {
    part: &'static str,
    /// Case and quantity, with its unit.
    what: String,
    /// Values of the run, by round.
    run: Vec<f64>,
    /// Values of the baselines, by name.
    baselines: Vec<(String, Vec<f64>)>,
}

/// Hashes of one trajectory, computed by several implementations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Trajectory {
    robots: usize,
    ticks: u64,
    /// Hashes, by implementation.
    hashes: Vec<(String, String)>,
}

impl Table {
    /// Sets the part and the case of the next values.
    pub(crate) fn begin(&mut self, part: &'static str, case: &str) {
        (self.part, self.case) = (part, case.into());
    }

    fn figure(&mut self, what: &str) -> Option<&mut Figure> {
        let (part, what) = (self.part, format!("{}, {what}", self.case));
        self.figures.iter_mut().find(|figure| figure.part == part && figure.what == what)
    }

    /// Adds a value of the run in this round. `what` ends with its unit.
    pub(crate) fn run(&mut self, what: &str, value: f64) {
        match self.figure(what) {
            Some(figure) => figure.run.push(value),
            None => {
                let (part, what) = (self.part, format!("{}, {what}", self.case));
                let (run, baselines) = (vec![value], Vec::new());
                self.figures.push(Figure { part, what, run, baselines });
            }
        }
    }

    /// Adds the corresponding value of a baseline.
    pub(crate) fn baseline(&mut self, what: &str, name: &str, value: f64) {
        let figure = self.figure(what).expect("a run is measured before its baselines");
        match figure.baselines.iter_mut().find(|(known, _)| known == name) {
            Some((_, rounds)) => rounds.push(value),
            None => figure.baselines.push((name.into(), vec![value])),
        }
    }

    /// Returns the run's value of the last round, by case and quantity.
    pub(crate) fn last(&self, what: &str) -> Option<f64> {
        let same = |figure: &&Figure| figure.part == self.part && figure.what == what;
        self.figures.iter().find(same)?.run.last().copied()
    }

    /// Adds the hash of the trajectory of this many robots by an implementation. All hashes must be equal.
    pub(crate) fn trajectory(&mut self, robots: usize, ticks: u64, means: &str, hash: &str) {
        let hashed = (means.to_owned(), hash.to_owned());
        match self.trajectories.iter_mut().find(|trajectory| trajectory.robots == robots) {
            Some(trajectory) if trajectory.hashes.contains(&hashed) => {}
            Some(trajectory) => trajectory.hashes.push(hashed),
            None => self.trajectories.push(Trajectory { robots, ticks, hashes: vec![hashed] }),
        }
    }

    /// Returns the report of all values.
    pub(crate) fn report(
        self,
        machine: Machine,
        warnings: Vec<String>,
        notes: Vec<String>,
    ) -> Report {
        let rows = self.figures.iter().flat_map(Figure::rows).collect();
        Report { machine, warnings, trajectories: self.trajectories, rows, notes }
    }
}

impl Figure {
    /// Returns one row for each baseline, or one without a baseline if there is none.
    fn rows(&self) -> Vec<Row> {
        let alone = Row {
            part: self.part,
            what: self.what.clone(),
            ours: Spread::over(&self.run),
            floor_name: None,
            floor: None,
            ratio: None,
        };
        let against = self.baselines.iter().map(|(name, baseline)| {
            let ratios: Vec<f64> =
                self.run.iter().zip(baseline).map(|(run, of)| run / of).collect();
            Row {
                floor_name: Some(name.clone()),
                floor: Some(Spread::over(baseline)),
                // A ratio to 0 is not finite, and is omitted.
                ratio: ratios.iter().all(|ratio| ratio.is_finite()).then(|| Spread::over(&ratios)),
                ..alone.clone()
            }
        });
        let against: Vec<Row> = against.collect();
        if against.is_empty() { vec![alone] } else { against }
    }
}

/// Median, minimum and maximum of the rounds.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Spread {
    median: f64,
    min: f64,
    max: f64,
    /// Values by round.
    rounds: Vec<f64>,
}

impl Spread {
    /// Computes the spread of at least one round. Panics without any.
    fn over(rounds: &[f64]) -> Spread {
        let median = finite_median(rounds).expect("at least one round");
        let [min, max] = [f64::min, f64::max].map(|of| rounds.iter().copied().fold(median, of));
        Spread { median, min, max, rounds: rounds.to_vec() }
    }

    fn shown(&self) -> String {
        let Spread { median, min, max, rounds } = self;
        match rounds.len() {
            1 => digits(*median),
            _ => format!("{} ({}-{})", digits(*median), digits(*min), digits(*max)),
        }
    }
}

/// Row of the table. `floor` is the baseline.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    part: &'static str,
    /// Quantity, with its unit.
    what: String,
    ours: Spread,
    floor_name: Option<String>,
    floor: Option<Spread>,
    /// Ratio of the run to the baseline.
    ratio: Option<Spread>,
}

/// Report of a bench.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Report {
    machine: Machine,
    /// Conditions that make the values doubtful.
    warnings: Vec<String>,
    /// Trajectories by number of robots: the hashes of the run and of every baseline must be equal.
    trajectories: Vec<Trajectory>,
    rows: Vec<Row>,
    /// Notes for the reader of the rows.
    notes: Vec<String>,
}

impl Report {
    /// Formats the report as JSON.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("string keys and finite numbers only") + "\n"
    }

    /// Returns a message about the first number of robots for which the trajectories differ; `None` if
    /// there is none.
    pub(crate) fn differing(&self) -> Option<String> {
        let differs = |t: &&Trajectory| t.hashes.iter().any(|(_, hash)| *hash != t.hashes[0].1);
        let Trajectory { robots, hashes, .. } = self.trajectories.iter().find(differs)?;
        Some(format!(
            "trajectories of {robots} robots differ, so their speeds do not compare: {hashes:?}"
        ))
    }

    /// Formats the report as text.
    pub(crate) fn screen(&self) -> String {
        let mut text = self.machine.screen() + &self.lines();
        let verdict = match self.differing() {
            None => "bit-identical trajectories",
            Some(_) => "DIFFERENT",
        };
        for Trajectory { robots, ticks, hashes } in &self.trajectories {
            let _ = writeln!(text, "{robots} robots, {ticks} ticks: {verdict}: {}", hashes[0].1);
        }
        text += "median (minimum-maximum) of the rounds; ours and baselines alternated within each round\n";
        for note in &self.notes {
            let _ = writeln!(text, "{note}");
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "warning: {warning}");
        }
        text
    }

    /// Formats the rows in columns, under the names of their parts.
    fn lines(&self) -> String {
        let shown = |spread: &Option<Spread>| spread.as_ref().map(Spread::shown);
        let cells = |row: &Row| {
            [
                row.what.clone(),
                row.ours.shown(),
                row.floor_name.clone().unwrap_or("-".into()),
                shown(&row.floor).unwrap_or_default(),
                shown(&row.ratio).unwrap_or("-".into()),
                row.ours.rounds.len().to_string(),
            ]
        };
        let header = ["what", "ours", "baseline", "", "ours / baseline", "rounds"];
        let mut lines = vec![("", header.map(str::to_owned))];
        lines.extend(self.rows.iter().map(|row| (row.part, cells(row))));
        let width = |column: usize| lines.iter().map(|(_, cells)| cells[column].len()).max();
        let widths: [usize; 6] = std::array::from_fn(|column| width(column).unwrap_or(0));
        let (mut text, mut last) = (String::new(), "");
        for (part, cells) in &lines {
            if *part != last {
                let _ = writeln!(text, "{}", if *part == "floors" { "baselines" } else { part });
                last = part;
            }
            let mut shown = String::new();
            for (cell, width) in cells.iter().zip(widths) {
                let _ = write!(shown, "  {cell:<width$}");
            }
            let _ = writeln!(text, "{}", shown.trim_end());
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_taken_within_each_round_and_then_its_median() {
        let mut table = Table::default();
        table.begin("floors", "round trip");
        for (run, baseline) in [(10.0, 1.0), (40.0, 8.0), (30.0, 0.5)] {
            table.run("p50, us", run);
            table.baseline("p50, us", "pipe", baseline);
        }
        assert_eq!(table.last("round trip, p50, us"), Some(30.0));
        let report = table.report(Machine::read(), Vec::new(), Vec::new());
        let row = &report.rows[0];
        let ratio = row.ratio.as_ref().unwrap();
        assert_eq!((ratio.median, ratio.min, ratio.max, row.ours.median), (10.0, 5.0, 60.0, 30.0));
        assert!(report.screen().contains("30.00 (10.00-40.00)"), "{}", report.screen());
        assert_eq!(Spread::over(&[9.0, 1.0, 2.0, 4.0]).median, 3.0);
    }

    #[test]
    fn a_trajectory_that_one_of_the_means_computed_otherwise_is_named() {
        let mut table = Table::default();
        for (means, hash) in [("run", "a"), ("mapping", "a"), ("run", "b")] {
            table.trajectory(3, 5, means, hash);
        }
        let differing = table.report(Machine::read(), Vec::new(), Vec::new()).differing();
        assert!(differing.unwrap().contains(r#"("run", "a"), ("mapping", "a"), ("run", "b")"#));
    }
}
