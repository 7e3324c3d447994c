//! Metrics of the experiment's own: `[metrics.NAME]`, computed from signals of the laws or by programs, and their
//! bounds.

use std::path::Path;

use super::diagnostic::{Diagnostic, most_similar_word};
use super::fields::kinds;
use super::keys;
use super::laws::is_key_name;
use super::program::ExternalProgram;
use super::reduction::{RobotReduction, TimeReduction};
use super::robots::quote_names;
use super::table::{TableReader, TypedValue};
use super::{MetricBounds, Robot, Scenario};

/// Metric of the experiment's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Metric {
    /// Name, NAME of `[metrics.NAME]`.
    pub name: String,
    /// Input of the computation.
    pub source: MetricSource,
}

/// Input of a metric.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MetricSource {
    /// Values that the laws recorded.
    Signal {
        /// Name of the signal.
        signal: String,
        /// Reduction of the values of one robot.
        over_time: TimeReduction,
        /// Reduction of the values of the robots.
        over_robots: RobotReduction,
    },
    /// The directory of the run, by a program.
    Program {
        /// Program that computes the metric.
        program: ExternalProgram,
        /// Maximum time that the program may take, ns.
        deadline_ns: u64,
    },
}

/// Program that computes metrics of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MetricProgram<'s> {
    /// Program that computes the metrics.
    pub program: &'s ExternalProgram,
    /// Maximum time that it may take, ns: the smallest one of its metrics.
    pub deadline_ns: u64,
    /// Names of the metrics that it computes.
    pub metrics: Vec<&'s str>,
}

impl Scenario {
    /// Returns the programs that compute metrics, each once, in the order of their first metrics.
    pub fn metric_programs(&self) -> Vec<MetricProgram<'_>> {
        let mut all: Vec<MetricProgram<'_>> = Vec::new();
        for metric in &self.metrics {
            let MetricSource::Program { program, deadline_ns } = &metric.source else { continue };
            match all.iter_mut().find(|known| known.program == program) {
                Some(known) => {
                    known.deadline_ns = known.deadline_ns.min(*deadline_ns);
                    known.metrics.push(&metric.name);
                }
                None => all.push(MetricProgram {
                    program,
                    deadline_ns: *deadline_ns,
                    metrics: vec![&metric.name],
                }),
            }
        }
        all
    }

    /// Returns whether a program computes a metric.
    pub fn has_metric_programs(&self) -> bool {
        let is_program = |metric: &Metric| matches!(metric.source, MetricSource::Program { .. });
        self.metrics.iter().any(is_program)
    }
}

/// Checks that the programs of metrics and their files exist, relative to the scenario's folder.
pub(super) fn check_files_exist(
    root: &TableReader<'_, keys::Root>,
    folder: &Path,
) -> Result<(), Diagnostic> {
    for (_, table) in root.named_tables(keys::Root::metrics)? {
        if let Some(program) = table.get(keys::Metric::program) {
            ExternalProgram::check_files_with_program(&program, &table, folder)?;
        }
    }
    Ok(())
}

/// Parses all metrics, in the order of the file.
pub(super) fn parse_metrics(
    root: &TableReader<'_, keys::Root>,
    robots: &[Robot],
) -> Result<Vec<Metric>, Diagnostic> {
    let mut known: Vec<&str> = robots.iter().flat_map(|robot| robot.signals).copied().collect();
    known.sort_unstable();
    known.dedup();
    let metric = |(name, table): (&str, TableReader<'_, keys::Metric>)| {
        if !is_key_name(name) {
            return Err(table.error_at_table(
                format!("`{name}` is the name of a metric"),
                "expected lower-case letters, digits and `_`, with the unit last, as in `cost_m2`",
            ));
        }
        let name = name.to_owned();
        if let Some(program) = table.get(keys::Metric::program) {
            return Ok(Metric { name, source: parse_program(&program, &table)? });
        }
        let Some(value) = table.get(keys::Metric::signal) else {
            let problem = format!("the metric `{name}` has neither `signal` nor `program`");
            let expected = "expected `signal`, the name of a signal of the laws, or `program`, which computes the metric from \
                            the directory of the run";
            return Err(table.error_at_table(problem, expected));
        };
        reject_keys_of_programs(&table)?;
        let signal = value.text("expected the name of a signal")?;
        if !known.contains(&signal) {
            let expected = match (most_similar_word(signal, known.iter().copied()), &known[..]) {
                (Some(close), _) => format!("did you mean \"{close}\"?"),
                (None, []) => {
                    "expected a name that `signals` in a table [laws.NAME] lists; the laws of \
                               these robots have no signals"
                        .to_owned()
                }
                (None, known) => {
                    format!(
                        "expected one of the signals of the robots' laws: {}",
                        quote_names(known)
                    )
                }
            };
            return Err(value.error_about_key(format!("is \"{signal}\""), expected));
        }
        let source = MetricSource::Signal {
            signal: signal.to_owned(),
            over_time: table.read_word(keys::Metric::over_time)?,
            over_robots: table.read_word(keys::Metric::over_robots)?,
        };
        Ok(Metric { name, source })
    };
    root.named_tables(keys::Root::metrics)?.into_iter().map(metric).collect()
}

/// Parses a metric that the program `program` computes.
fn parse_program(
    program: &TypedValue<'_, kinds::Texts>,
    table: &TableReader<'_, keys::Metric>,
) -> Result<MetricSource, Diagnostic> {
    let spans = [
        table.get(keys::Metric::signal).map(|value| value.span()),
        table.get(keys::Metric::over_time).map(|value| value.span()),
        table.get(keys::Metric::over_robots).map(|value| value.span()),
    ];
    if spans.iter().any(Option::is_some) {
        return Err(program.error_about_key(
            "is given beside `signal`, `over_time` or `over_robots`",
            "expected either a signal and its reductions, or a program",
        ));
    }
    let deadline_ns = table.time_ns(keys::Metric::deadline_s)?;
    Ok(MetricSource::Program {
        program: ExternalProgram::read_with_program(program, table)?,
        deadline_ns,
    })
}

/// Rejects keys that only a metric with a program has.
fn reject_keys_of_programs(table: &TableReader<'_, keys::Metric>) -> Result<(), Diagnostic> {
    let expected = "expected no such key, or `program` in place of `signal`";
    let problem = "is given without `program`";
    if let Some(value) = table.get(keys::Metric::deadline_s) {
        return Err(value.error_about_key(problem, expected));
    }
    if let Some(value) = table.get(keys::ProgramFiles::files) {
        return Err(value.error_about_key(problem, expected));
    }
    match table.get(keys::ProgramFiles::memory_max_mb) {
        Some(value) => Err(value.error_about_key(problem, expected)),
        None => Ok(()),
    }
}

/// Parses the bounds of metrics in `[expect]`.
pub(super) fn parse_metric_bounds(
    expect: &TableReader<'_, keys::Expect>,
    metrics: &[Metric],
) -> Result<Vec<MetricBounds>, Diagnostic> {
    let names: Vec<&str> = metrics.iter().map(|metric| metric.name.as_str()).collect();
    let bounds = |(name, table): (&str, TableReader<'_, keys::ExpectMetric>)| {
        if !names.contains(&name) {
            let expected = match (most_similar_word(name, names.iter().copied()), &names[..]) {
                (Some(close), _) => format!("did you mean `{close}`?"),
                (None, []) => format!("expected a table `[metrics.{name}]`, which defines it"),
                (None, known) => format!(
                    "expected one of the metrics {}, or a table `[metrics.{name}]`",
                    quote_names(known)
                ),
            };
            return Err(table.error_at_table(format!("`{name}` is no metric"), expected));
        }
        let [min, max] = [keys::ExpectMetric::min, keys::ExpectMetric::max]
            .map(|key| table.optional_number(key));
        let (min, max) = (min?, max?);
        match (min, max) {
            (None, None) => Err(table.error_at_table(
                format!("the metric `{name}` has no bound"),
                format!("expected `metrics.{name}.min`, `metrics.{name}.max`, or both"),
            )),
            (Some(min_value), Some(max_value)) if min_value > max_value => Err(table
                .error_at_table(
                    format!("`min` is {min_value}, above `max`, {max_value}"),
                    "expected `min` to be at most `max`",
                )),
            _ => Ok(MetricBounds { metric: name.to_owned(), min, max }),
        }
    };
    // In the path of an error and of the table, so that overrides are found.
    let tables = expect.named_tables(keys::Expect::metrics)?;
    tables.into_iter().map(bounds).collect()
}
