//! `runs.csv` and `timing.csv`: one row per run.
//!
//! `runs.csv` holds what the experiment determines: in lockstep the file is the same byte for byte, however the runs
//! were executed. `timing.csv` holds what depends on the machine.

use crate::metrics::expect;
use crate::metrics::summary::Summary;

use crate::campaign::folder::{Folder, State, failed_attempts};
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Campaign;

/// One run and its status.
#[derive(Debug, Clone, PartialEq)]
pub struct Row<'c> {
    /// The run's grid point, seed and configuration.
    pub cell: &'c Cell,
    /// Status of the run.
    pub state: State,
    /// Number of failed attempts.
    pub failures: usize,
}

/// Returns the rows of the runs, in order. Missing and damaged runs have no row.
pub fn campaign_rows<'c>(cells: &'c [Cell], folder: &Folder, states: Vec<State>) -> Vec<Row<'c>> {
    let mut rows = Vec::new();
    for (cell, state) in cells.iter().zip(states) {
        if !state.is_to_be_run() {
            let failures = failed_attempts(&folder.run(&cell.id)).len();
            rows.push(Row { cell, state, failures });
        }
    }
    rows
}

impl Row<'_> {
    /// Returns the summary of the run, if it has a result.
    pub fn summary(&self) -> Option<&Summary> {
        match &self.state {
            State::Done(summary) => Some(summary),
            State::GivenUp(_) | State::Missing | State::Damaged(_) => None,
        }
    }

    /// Returns the verdict on the run as a keyword: `held`, `missed`, `unseen`, `undeclared`, or `infrastructure`
    /// for a run that was given up.
    pub fn outcome(&self) -> &'static str {
        let Some(summary) = self.summary() else { return "infrastructure" };
        expect::worst(&summary.expectations).map_or("undeclared", |verdict| verdict.as_str())
    }
}

/// Columns of `runs.csv` after the columns of the axes, with descriptions.
pub const COLUMNS: [(&str, &str); 26] = [
    ("seed", "seed of the random number generator"),
    (
        "outcome",
        "`held`, `missed` or `unseen`: the worst verdict on an expectation; `undeclared`: the scenario declares none; `infrastructure`: the run failed to execute three times",
    ),
    ("exit", "exit code of the run"),
    (
        "trajectory_hash",
        "hash of the trajectory, in lockstep: equal if and only if two runs are equal bit by bit",
    ),
    ("t_s", "run time at the end"),
    ("ticks", "number of plant ticks"),
    ("distance_min_m", "minimum distance d of the scenario"),
    ("min_distance_m", "smallest distance between two front points at any tick"),
    ("min_distance_over_d", "`min_distance_m` divided by d"),
    ("violations", "number of ticks at which a pair of robots was closer than d"),
    (
        "min_clearance_m",
        "smallest distance of a front point to a wall or obstacle; empty if the scenario has none",
    ),
    (
        "clearance_violations",
        "number of ticks at which a front point was closer to a wall or obstacle than the clearance",
    ),
    (
        "converged",
        "1 if the errors of all living robots stayed below `converged_error_m` from some time on, else 0",
    ),
    ("converged_at_s", "time from which they stayed below it; empty if never"),
    ("final_error_m_max", "worst error of a living robot over the last 10 % of the run"),
    (
        "final_ideal_error_m_max",
        "worst error of a living robot to the ideal formation over the last 10 % of the run",
    ),
    ("tracking_error_m_max", "worst error of the main leader over the last 10 % of the run"),
    (
        "hull_distance_m_max_final",
        "largest distance of a follower from the leaders' convex hull over the last 10 % of the run",
    ),
    (
        "integrated_error_m_s",
        "integral of each robot's error over the time it was alive, summed over all robots",
    ),
    ("alive_at_end", "number of robots alive at the end"),
    ("restarts", "number of restarts of robots"),
    (
        "recovered_after_s_max",
        "longest time until the formation recovered from a fault; empty without faults, or if it did not recover from one",
    ),
    (
        "arrived",
        "number of robots that stayed within `converged_error_m` of their target from some time on",
    ),
    ("arrived_at_s_mean", "mean of these arrival times; the last one is `converged_at_s`"),
    (
        "path_over_straight",
        "path length divided by straight-line length, over the robots that arrived at goals; empty if none did",
    ),
    ("run", "identifier of the run, and name of its directory below `runs/`"),
];

/// Returns the content of `runs.csv`.
pub fn runs(campaign: &Campaign, rows: &[Row<'_>]) -> String {
    let axes = campaign.axes.iter().map(|axis| axis.key.as_str());
    let heads: Vec<&str> = axes.chain(COLUMNS.iter().map(|(name, _)| *name)).collect();
    to_csv(&heads, rows.iter().map(|row| run(campaign, row)))
}

fn run(campaign: &Campaign, row: &Row<'_>) -> Vec<String> {
    let shown = |value: Option<f64>| value.map_or(String::new(), number);
    let settings = campaign.settings_at(row.cell.point);
    let mut fields: Vec<String> = settings.iter().map(|setting| setting.shown.clone()).collect();
    fields.push(row.cell.seed.to_string());
    fields.push(row.outcome().to_owned());
    let d_m = row.cell.distance_min_m;
    let Some(summary) = row.summary() else {
        fields.push("4".into());
        fields.extend(vec![String::new(); COLUMNS.len() - 4]);
        fields.push(row.cell.id.clone());
        return fields;
    };
    let sum = |list: &[(String, Option<f64>)]| {
        let values: Option<Vec<f64>> = list.iter().map(|(_, value)| *value).collect();
        values.filter(|values| !values.is_empty()).map(|values| values.iter().sum())
    };
    let arrived: Vec<f64> = summary.arrived_at_s.iter().filter_map(|(_, at_s)| *at_s).collect();
    let recovered: Option<Vec<f64>> =
        summary.faults.iter().map(|fault| fault.recovered_after_s).collect();
    let recovered = recovered.and_then(|all| all.into_iter().reduce(f64::max));
    fields.extend([
        summary.exit.to_string(),
        summary.trajectory_hash.clone().unwrap_or_default(),
        number(summary.t_s),
        summary.ticks.to_string(),
        number(d_m),
        shown(summary.min_distance_m),
        shown(summary.min_distance_m.map(|distance_m| distance_m / d_m)),
        summary.violations.to_string(),
        shown(summary.min_clearance.as_ref().map(|clearance| clearance.distance_m)),
        summary.clearance_violations.to_string(),
        u8::from(summary.converged_at_s.is_some()).to_string(),
        shown(summary.converged_at_s),
        shown(summary.final_error_m_max),
        shown(summary.final_ideal_error_m_max),
        shown(summary.tracking_error_m_max),
        shown(summary.hull_distance_m_max_final),
        shown(sum(&summary.integrated_error_m_s)),
        summary.alive_at_end.len().to_string(),
        summary.restarts.iter().map(|(_, count)| count).sum::<u64>().to_string(),
        shown(recovered),
        arrived.len().to_string(),
        shown(mean(&arrived)),
        shown(summary.path_over_straight),
        row.cell.id.clone(),
    ]);
    fields
}

/// Columns of `timing.csv`, with descriptions.
pub const TIMING: [(&str, &str); 10] = [
    ("run", "identifier of the run"),
    ("failed_attempts", "number of attempts that failed to execute"),
    (
        "startup_s",
        "wall time from the start of the first process to t = 0; empty with `--in-process`",
    ),
    ("wall_s", "wall time from t = 0 to the end"),
    ("ticks_per_s", "plant ticks per second of wall time"),
    ("real_time_factor", "run time divided by wall time"),
    (
        "processor_s",
        "processor time of all processes of the run; with `--in-process`, of the thread that computed it",
    ),
    (
        "deadline_misses",
        "number of commands sent after their agent's next wake-up was due, in real time",
    ),
    (
        "compute_p99_us",
        "time from an odometry sample to the command, p99 of the slowest robot; with `--in-process`, without the time to read from other processes",
    ),
    ("compute_mean_us", "mean of that time over all robots and samples"),
];

/// Returns the content of `timing.csv`.
pub fn timing(rows: &[Row<'_>]) -> String {
    let heads: Vec<&str> = TIMING.iter().map(|(name, _)| *name).collect();
    let row = |row: &Row<'_>| {
        let mut fields = vec![row.cell.id.clone(), row.failures.to_string()];
        match row.summary() {
            None => fields.extend(vec![String::new(); TIMING.len() - 2]),
            Some(summary) => {
                let wall = &summary.wall;
                let usage = wall.processes.iter().map(|process| process.usage);
                let processor_s: f64 = usage.map(|usage| usage.user_s + usage.system_s).sum();
                let compute = wall.latency.iter().filter(|line| line.stage == "compute");
                let slowest = compute.clone().map(|line| line.p99_ns).max();
                let count: u64 = compute.clone().map(|line| line.count).sum();
                let in_all: f64 = compute.map(|line| line.mean_ns * line.count as f64).sum();
                let mean = (count > 0).then(|| in_all / count as f64);
                fields.extend([
                    wall.startup_s.map_or(String::new(), number),
                    number(wall.wall_s),
                    number(wall.ticks_per_s),
                    number(wall.real_time_factor),
                    format!("{processor_s:.6}"),
                    summary.deadline_misses.to_string(),
                    slowest.map_or(String::new(), |ns| number(ns as f64 / 1e3)),
                    mean.map_or(String::new(), |ns| format!("{:.3}", ns / 1e3)),
                ]);
            }
        }
        fields
    };
    to_csv(&heads, rows.iter().map(row))
}

/// Returns the mean, or `None` for an empty slice.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn number(number: f64) -> String {
    let mut digits = zmij::Buffer::new();
    let text = digits.format(number);
    text.strip_suffix(".0").unwrap_or(text).to_owned()
}

fn to_csv(heads: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(heads).expect("memory takes everything");
    for row in rows {
        writer.write_record(&row).expect("as many fields as heads");
    }
    String::from_utf8(writer.into_inner().expect("memory takes everything")).expect("text only")
}
