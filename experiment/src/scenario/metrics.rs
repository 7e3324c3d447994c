//! Metrics of the experiment's own: `[metrics.NAME]`, computed from signals of the laws, and their bounds.

use super::diagnostic::{Diagnostic, most_similar_word};
use super::keys;
use super::laws::is_key_name;
use super::reduction::{OverRobots, OverTime};
use super::robots::quote_names;
use super::table::TableReader;
use super::{MetricBounds, Robot};

/// Metric of the experiment's own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Metric {
    /// Name, NAME of `[metrics.NAME]`.
    pub name: String,
    /// Name of the signal that it is computed from.
    pub signal: String,
    /// Reduction of the values of one robot.
    pub over_time: OverTime,
    /// Reduction of the values of the robots.
    pub over_robots: OverRobots,
}

/// Parses all metrics, in the order of the file.
pub(super) fn metrics(
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
        let value = table.required(keys::Metric::signal)?;
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
        Ok(Metric {
            name: name.to_owned(),
            signal: signal.to_owned(),
            over_time: table.read_word(keys::Metric::over_time)?,
            over_robots: table.read_word(keys::Metric::over_robots)?,
        })
    };
    root.named_tables(keys::Root::metrics)?.into_iter().map(metric).collect()
}

/// Parses the bounds of metrics in `[expect]`.
pub(super) fn bounds(
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
        let [min, max] =
            [keys::ExpectMetric::min, keys::ExpectMetric::max].map(|key| table.maybe_number(key));
        let (min, max) = (min?, max?);
        match (min, max) {
            (None, None) => Err(table.error_at_table(
                format!("the metric `{name}` has no bound"),
                format!("expected `metrics.{name}.min`, `metrics.{name}.max`, or both"),
            )),
            (Some(least), Some(most)) if least > most => Err(table.error_at_table(
                format!("`min` is {least}, above `max`, {most}"),
                "expected `min` to be at most `max`",
            )),
            _ => Ok(MetricBounds { metric: name.to_owned(), min, max }),
        }
    };
    // In the path of an error and of the table, so that overrides are found.
    let tables = expect.named_tables(keys::Expect::metrics)?;
    tables.into_iter().map(bounds).collect()
}
