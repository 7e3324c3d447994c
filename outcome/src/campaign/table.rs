//! `runs.csv` and `timing.csv`: one row per run.
//!
//! In `runs.csv` stands what the experiment determines: in lockstep it is the same, byte for byte,
//! however the runs came about. What depends on the machine stands in `timing.csv`.

use crate::metrics::expect;
use crate::metrics::summary::Summary;

use crate::campaign::folder::{Folder, State, attempts};
use experiment::campaign::cells::Cell;
use experiment::campaign::file::Campaign;

/// One run and what became of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Row<'c> {
    /// The run.
    pub cell: &'c Cell,
    /// What became of it.
    pub state: State,
    /// Attempts whose machinery failed.
    pub failures: usize,
}

/// The rows of runs in these states, in their order; those that are missing or damaged have none.
pub fn rows<'c>(cells: &'c [Cell], folder: &Folder, states: Vec<State>) -> Vec<Row<'c>> {
    let mut rows = Vec::new();
    for (cell, state) in cells.iter().zip(states) {
        if !state.is_to_be_run() {
            let failures = attempts(&folder.run(&cell.id)).len();
            rows.push(Row { cell, state, failures });
        }
    }
    rows
}

impl Row<'_> {
    /// Its summary, if it has a result.
    pub fn summary(&self) -> Option<&Summary> {
        match &self.state {
            State::Done(summary) => Some(summary),
            State::GivenUp(_) | State::Missing | State::Damaged(_) => None,
        }
    }

    /// The verdict on it, in a word.
    pub fn outcome(&self) -> &'static str {
        let Some(summary) = self.summary() else { return "infrastructure" };
        expect::worst(&summary.expectations).map_or("undeclared", |verdict| verdict.word())
    }
}

/// The columns of `runs.csv` behind those of the axes, with what they are.
pub const COLUMNS: [(&str, &str); 26] = [
    ("seed", "seed of everything random"),
    (
        "outcome",
        "`held`, `missed` or `unseen`: the worst of the expectations; `undeclared`: there are none; `infrastructure`: the run's machinery failed three times",
    ),
    ("exit", "exit code of the run"),
    ("trajectory_hash", "in lockstep: equal if and only if two runs are the same bit by bit"),
    ("t_s", "run time reached"),
    ("ticks", "plant ticks"),
    ("distance_min_m", "d"),
    ("min_distance_m", "smallest distance of two front points at any tick"),
    ("min_distance_over_d", "the same in d"),
    ("violations", "ticks at which some pair was nearer than d"),
    (
        "min_clearance_m",
        "smallest distance of a front point to a wall or obstacle; empty without any",
    ),
    (
        "clearance_violations",
        "ticks at which some front point was nearer to one than the clearance",
    ),
    (
        "converged",
        "1 if all living errors stayed below `converged_error_m` from some time on, else 0",
    ),
    ("converged_at_s", "since when; empty if never"),
    ("final_error_m_max", "worst living error over the last 10 %"),
    ("final_ideal_error_m_max", "worst living error to the ideal formation over the last 10 %"),
    ("tracking_error_m_max", "the main leader's error over the last 10 %"),
    (
        "hull_distance_m_max_final",
        "largest distance of a contained robot from the leaders' hull over the last 10 %",
    ),
    (
        "integrated_error_m_s",
        "integral of the error over the time a robot lived, summed over all robots",
    ),
    ("alive_at_end", "how many robots lived at the end"),
    ("restarts", "restarts of robots"),
    (
        "recovered_after_s_max",
        "longest time that a fault's effect lasted; empty without faults, or if one was for good",
    ),
    (
        "arrived",
        "how many robots stayed within `converged_error_m` of where they are wanted, from some time on",
    ),
    ("arrived_at_s_mean", "the mean of these times; when the last arrived is `converged_at_s`"),
    (
        "path_over_straight",
        "of robots that arrived at goals: the lengths of their ways over those of straight lines; empty if none did",
    ),
    ("run", "identity of the run, and the name of its directory below `runs/`"),
];

/// `runs.csv`.
pub fn runs(campaign: &Campaign, rows: &[Row<'_>]) -> String {
    let axes = campaign.axes.iter().map(|axis| axis.key.as_str());
    let heads: Vec<&str> = axes.chain(COLUMNS.iter().map(|(name, _)| *name)).collect();
    written(&heads, rows.iter().map(|row| run(campaign, row)))
}

fn run(campaign: &Campaign, row: &Row<'_>) -> Vec<String> {
    let shown = |value: Option<f64>| value.map_or(String::new(), number);
    let settings = campaign.at(row.cell.point);
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

/// The columns of `timing.csv`, with what they are.
pub const TIMING: [(&str, &str); 10] = [
    ("run", "identity of the run"),
    ("failed_attempts", "attempts whose machinery failed"),
    (
        "startup_s",
        "wall time from the start of the first process to t = 0; empty with `--in-process`",
    ),
    ("wall_s", "wall time from t = 0 to the end"),
    ("ticks_per_s", "plant ticks per second of wall time"),
    ("real_time_factor", "run time per wall time"),
    (
        "processor_s",
        "processor time of all its processes; with `--in-process` of the thread that computed it",
    ),
    ("deadline_misses", "commands sent after their agent's next wake-up was due, in real time"),
    (
        "compute_p99_us",
        "time from an odometry sample to the command, p99 of the slowest robot; with `--in-process` without the time that it takes to read from other processes",
    ),
    ("compute_mean_us", "the same time, the mean over all robots and samples"),
];

/// `timing.csv`.
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
    written(&heads, rows.iter().map(row))
}

/// Of nothing there is none.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// In the fewest digits that tell it apart.
fn number(number: f64) -> String {
    let mut digits = zmij::Buffer::new();
    let text = digits.format(number);
    text.strip_suffix(".0").unwrap_or(text).to_owned()
}

fn written(heads: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(heads).expect("memory takes everything");
    for row in rows {
        writer.write_record(&row).expect("as many fields as heads");
    }
    String::from_utf8(writer.into_inner().expect("memory takes everything")).expect("text only")
}
