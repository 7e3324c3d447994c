//! What was measured: each round's figures, their medians with least and most, and the ratio of
//! ours to the floor, taken within each round.

use std::fmt::Write as _;

use serde::Serialize;

use crate::machine::Machine;

/// Median, least and most of the rounds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Spread {
    median: f64,
    min: f64,
    max: f64,
    /// Round by round.
    rounds: Vec<f64>,
}

impl Spread {
    /// Of at least one round.
    fn of(rounds: Vec<f64>) -> Spread {
        let mut sorted = rounds.clone();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted.len() / 2;
        let median = match sorted.len() % 2 {
            1 => sorted[middle],
            _ => 0.5 * (sorted[middle - 1] + sorted[middle]),
        };
        Spread { median, min: sorted[0], max: sorted[sorted.len() - 1], rounds }
    }

    fn shown(&self) -> String {
        let Spread { median, min, max, rounds } = self;
        match rounds.len() {
            1 => digits(*median),
            _ => format!("{} ({}-{})", digits(*median), digits(*min), digits(*max)),
        }
    }
}

/// One line of the table.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Row {
    part: &'static str,
    /// What is measured, with its unit.
    what: String,
    ours: Spread,
    /// What ours is held against.
    floor_name: Option<String>,
    floor: Option<Spread>,
    /// Ours / floor.
    ratio: Option<Spread>,
}

impl Row {
    /// A figure that nothing is held against.
    pub(crate) fn alone(part: &'static str, what: &str, ours: Vec<f64>) -> Row {
        let ours = Spread::of(ours);
        Row { part, what: what.into(), ours, floor_name: None, floor: None, ratio: None }
    }

    /// A figure against a floor of the same rounds.
    pub(crate) fn against(
        part: &'static str,
        what: &str,
        floor_name: &str,
        ours: Vec<f64>,
        floor: Vec<f64>,
    ) -> Row {
        let ratio: Vec<f64> = ours.iter().zip(&floor).map(|(ours, floor)| ours / floor).collect();
        Row {
            floor_name: Some(floor_name.into()),
            floor: Some(Spread::of(floor)),
            // Nothing is a multiple of nothing.
            ratio: ratio.iter().all(|ratio| ratio.is_finite()).then(|| Spread::of(ratio)),
            ..Row::alone(part, what, ours)
        }
    }

    /// Ours / floor, the median of the rounds.
    pub(crate) fn ratio_median(&self) -> Option<f64> {
        self.ratio.as_ref().map(|ratio| ratio.median)
    }
}

/// All that a bench has to say.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Report {
    pub(crate) machine: Machine,
    /// What makes the figures doubtful.
    pub(crate) warnings: Vec<String>,
    /// By number of robots: one trajectory, bit by bit, of ours and of every floor.
    pub(crate) trajectories: Vec<Trajectory>,
    pub(crate) rows: Vec<Row>,
    /// What the rows do not say.
    pub(crate) notes: Vec<String>,
}

/// The hashes of one trajectory, computed by several means.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Trajectory {
    pub(crate) robots: usize,
    pub(crate) ticks: u64,
    /// By means.
    pub(crate) hashes: Vec<(String, String)>,
}

impl Trajectory {
    /// Whether all means gave the same.
    pub(crate) fn is_one(&self) -> bool {
        self.hashes.iter().all(|(_, hash)| *hash == self.hashes[0].1)
    }
}

impl Report {
    /// For programs.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("string keys and finite numbers only") + "\n"
    }

    /// For people.
    pub(crate) fn screen(&self) -> String {
        let mut text = self.machine.screen();
        let header =
            ["what", "ours", "baseline", "", "ours / baseline", "rounds"].map(str::to_owned);
        let shown = |spread: &Option<Spread>| spread.as_ref().map_or("-".into(), Spread::shown);
        let lines: Vec<[String; 6]> = std::iter::once(header)
            .chain(self.rows.iter().map(|row| {
                [
                    row.what.clone(),
                    row.ours.shown(),
                    row.floor_name.clone().unwrap_or("-".into()),
                    row.floor.as_ref().map_or(String::new(), Spread::shown),
                    shown(&row.ratio),
                    row.ours.rounds.len().to_string(),
                ]
            }))
            .collect();
        let width = |column: usize| lines.iter().map(|line| line[column].len()).max().unwrap_or(0);
        let widths: [usize; 6] = std::array::from_fn(width);
        let parts = std::iter::once("").chain(self.rows.iter().map(|row| row.part));
        let mut last = "";
        for (part, line) in parts.zip(&lines) {
            if part != last {
                let _ = writeln!(text, "{}", if part == "floors" { "baselines" } else { part });
                last = part;
            }
            let mut shown = String::new();
            for (cell, width) in line.iter().zip(widths) {
                let _ = write!(shown, "  {cell:<width$}");
            }
            let _ = writeln!(text, "{}", shown.trim_end());
        }
        for trajectory in &self.trajectories {
            let Trajectory { robots, ticks, hashes } = trajectory;
            let verdict =
                if trajectory.is_one() { "the same trajectory bit by bit" } else { "DIFFERENT" };
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
        for line in self.conclusion() {
            let _ = writeln!(text, "{line}");
        }
        text
    }

    /// What the parts amount to, a line each: medians of the rounds.
    fn conclusion(&self) -> Vec<String> {
        let rows = |part| self.rows.iter().filter(move |row: &&Row| row.part == part);
        let range = |values: &[f64]| {
            let least = values.iter().copied().reduce(f64::min)?;
            let most = values.iter().copied().reduce(f64::max)?;
            let [least, most] = [least, most].map(digits);
            Some(if least == most { least } else { format!("{least} to {most}") })
        };
        let ratios = |part| {
            let ratios = rows(part).filter_map(|row| Some(row.ratio.as_ref()?.median));
            range(&ratios.collect::<Vec<f64>>())
        };
        let missed = |of: fn(&Row) -> Option<&Spread>| {
            let rows = rows("realtime").filter(|row| row.what.contains("deadlines missed"));
            rows.filter_map(|row| Some(of(row)?.median)).reduce(f64::max).map(digits)
        };
        let replaced = rows("replacement").next();
        [
            ratios("floors").map(|ratio| {
                format!("a robot's round trip takes {ratio} times that of bare transports")
            }),
            ratios("lockstep").map(|ratio| {
                format!("lockstep has {ratio} times the ticks/s of the same work without it")
            }),
            missed(|row| Some(&row.ours)).zip(missed(|row| row.floor.as_ref())).map(
                |(ours, timers)| {
                    format!("at most {ours} % of deadlines were missed, by bare timers {timers} %")
                },
            ),
            ratios("startup")
                .map(|ratio| format!("start-up takes {ratio} times that of bare processes")),
            replaced.map(|row| format!("{}: {}", row.what, row.ours.shown())),
        ]
        .into_iter()
        .flatten()
        .map(|line| format!("conclusion: {line}"))
        .collect()
    }
}

/// Three significant digits.
fn digits(value: f64) -> String {
    match value.abs() {
        0.0 => "0".into(),
        size if size >= 1e4 => format!("{:.1}k", value / 1e3),
        size if size < 1e-3 => format!("{value:.1e}"),
        size => format!("{value:.*}", (2 - size.log10().floor() as i32).max(0) as usize),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_taken_within_each_round_and_then_its_median() {
        let row = Row::against("p", "w", "f", vec![10.0, 40.0, 30.0], vec![1.0, 2.0, 10.0]);
        let ratio = row.ratio.unwrap();
        assert_eq!((ratio.median, ratio.min, ratio.max), (10.0, 3.0, 20.0));
        assert_eq!(row.ours.median, 30.0);
    }

    #[test]
    fn the_conclusion_has_a_line_for_each_part_that_was_measured() {
        let row =
            |part, what: &str, ours, floor| Row::against(part, what, "f", vec![ours], vec![floor]);
        let report = |rows| Report {
            machine: Machine::look(),
            warnings: Vec::new(),
            trajectories: Vec::new(),
            rows,
            notes: Vec::new(),
        };
        let rows = vec![
            row("floors", "one", 2.0, 1.0),
            row("floors", "two", 12.0, 4.0),
            row("realtime", "8 robots, deadlines missed, %", 0.5, 0.25),
            row("realtime", "8 robots, lateness", 100.0, 1.0),
            Row::alone("replacement", "kill to first command, ms", vec![7.0]),
        ];
        let lines = [
            "conclusion: a robot's round trip takes 2.00 to 3.00 times that of bare transports",
            "conclusion: at most 0.500 % of deadlines were missed, by bare timers 0.250 %",
            "conclusion: kill to first command, ms: 7.00",
        ];
        assert_eq!(report(rows).conclusion(), lines);
        assert!(report(Vec::new()).conclusion().is_empty());
    }

    #[test]
    fn of_an_even_number_of_rounds_the_median_is_the_middle() {
        assert_eq!(Spread::of(vec![4.0, 1.0, 2.0, 9.0]).median, 3.0);
    }

    #[test]
    fn figures_keep_three_digits() {
        for (value, shown) in
            [(0.0, "0"), (13.26, "13.3"), (0.4567, "0.457"), (123_456.0, "123.5k"), (987.6, "988")]
        {
            assert_eq!(digits(value), shown);
        }
    }
}
