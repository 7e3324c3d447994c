//! What was measured: each round's figures, their medians with least and most, and the ratio of
//! a run to its baseline, taken within each round.

use std::fmt::Write as _;

use serde::Serialize;

use outcome::campaign::statistics::finite_median;
use outcome::report::digits::digits;

use crate::machine::Machine;

/// Figures under way, in the order in which they first came.
#[derive(Debug, Default)]
pub(crate) struct Table {
    /// Of which part and case the next figures are.
    part: &'static str,
    case: String,
    figures: Vec<Figure>,
    trajectories: Vec<Trajectory>,
}

#[derive(Debug)]
struct Figure {
    part: &'static str,
    /// Case and figure, with its unit.
    what: String,
    /// Round by round.
    run: Vec<f64>,
    /// By name.
    baselines: Vec<(String, Vec<f64>)>,
}

/// The hashes of one trajectory, computed by several means.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Trajectory {
    robots: usize,
    ticks: u64,
    /// By means.
    hashes: Vec<(String, String)>,
}

impl Table {
    /// The next figures are of this part and case.
    pub(crate) fn begin(&mut self, part: &'static str, case: &str) {
        (self.part, self.case) = (part, case.into());
    }

    fn figure(&mut self, what: &str) -> Option<&mut Figure> {
        let (part, what) = (self.part, format!("{}, {what}", self.case));
        self.figures.iter_mut().find(|figure| figure.part == part && figure.what == what)
    }

    /// A figure of a run in this round. `what` ends with its unit.
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

    /// The same figure of a baseline.
    pub(crate) fn baseline(&mut self, what: &str, name: &str, value: f64) {
        let figure = self.figure(what).expect("a run is measured before its baselines");
        match figure.baselines.iter_mut().find(|(known, _)| known == name) {
            Some((_, rounds)) => rounds.push(value),
            None => figure.baselines.push((name.into(), vec![value])),
        }
    }

    /// A run's figure of the last round, by its case and what it is.
    pub(crate) fn last(&self, what: &str) -> Option<f64> {
        let same = |figure: &&Figure| figure.part == self.part && figure.what == what;
        self.figures.iter().find(same)?.run.last().copied()
    }

    /// The hash of the trajectory of so many robots by some means; all must be the same.
    pub(crate) fn trajectory(&mut self, robots: usize, ticks: u64, means: &str, hash: &str) {
        let hashed = (means.to_owned(), hash.to_owned());
        match self.trajectories.iter_mut().find(|trajectory| trajectory.robots == robots) {
            Some(trajectory) if trajectory.hashes.contains(&hashed) => {}
            Some(trajectory) => trajectory.hashes.push(hashed),
            None => self.trajectories.push(Trajectory { robots, ticks, hashes: vec![hashed] }),
        }
    }

    /// All of it.
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
    /// One line for each baseline, and one without any if there is none.
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
                // Nothing is a multiple of nothing.
                ratio: ratios.iter().all(|ratio| ratio.is_finite()).then(|| Spread::over(&ratios)),
                ..alone.clone()
            }
        });
        let against: Vec<Row> = against.collect();
        if against.is_empty() { vec![alone] } else { against }
    }
}

/// Median, least and most of the rounds.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Spread {
    median: f64,
    min: f64,
    max: f64,
    /// Round by round.
    rounds: Vec<f64>,
}

impl Spread {
    /// Of at least one round.
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

/// One line of the table. `floor`: the baseline.
#[derive(Debug, Clone, PartialEq, Serialize)]
struct Row {
    part: &'static str,
    /// What is measured, with its unit.
    what: String,
    ours: Spread,
    floor_name: Option<String>,
    floor: Option<Spread>,
    /// Ours / floor.
    ratio: Option<Spread>,
}

/// All that a bench has to say.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Report {
    machine: Machine,
    /// What makes the figures doubtful.
    warnings: Vec<String>,
    /// By number of robots: one trajectory, bit by bit, of a run and of every baseline.
    trajectories: Vec<Trajectory>,
    rows: Vec<Row>,
    /// What the rows do not say.
    notes: Vec<String>,
}

impl Report {
    /// For programs.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("string keys and finite numbers only") + "\n"
    }

    /// A number of robots for which not all means computed the same trajectory.
    pub(crate) fn differing(&self) -> Option<String> {
        let differs = |t: &&Trajectory| t.hashes.iter().any(|(_, hash)| *hash != t.hashes[0].1);
        let Trajectory { robots, hashes, .. } = self.trajectories.iter().find(differs)?;
        Some(format!(
            "trajectories of {robots} robots differ, so their speeds do not compare: {hashes:?}"
        ))
    }

    /// For people.
    pub(crate) fn screen(&self) -> String {
        let mut text = self.machine.screen() + &self.lines();
        let verdict = match self.differing() {
            None => "the same trajectory bit by bit",
            Some(_) => "DIFFERENT",
        };
        for Trajectory { robots, ticks, hashes } in &self.trajectories {
            let _ = writeln!(text, "{robots} robots, {ticks} ticks: {verdict}: {}", hashes[0].1);
        }
        text +=
            "median (least-most) of the rounds; ours and baselines took turns within each round\n";
        for note in &self.notes {
            let _ = writeln!(text, "{note}");
        }
        for warning in &self.warnings {
            let _ = writeln!(text, "warning: {warning}");
        }
        text
    }

    /// The rows in columns, under the names of their parts.
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
        let report = table.report(Machine::look(), Vec::new(), Vec::new());
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
        let differing = table.report(Machine::look(), Vec::new(), Vec::new()).differing();
        assert!(differing.unwrap().contains(r#"("run", "a"), ("mapping", "a"), ("run", "b")"#));
    }
}
