//! Report page of a finished run: one self-contained file that makes no requests.

use std::fmt::Write as _;

use crate::metrics::expect::Verdict;
use crate::metrics::summary::{InformationAge, StageLatency, Summary};

use crate::report::chart::Figure;
use crate::report::digits::format_four_digits;
use crate::report::markup::escape_markup;
use crate::report::page;
use crate::report::rows::{self, SHOWN_ROWS_MAX};
use crate::report::run::LoadedRun;
use protocol::number::format_short;

const STYLE: &str = include_str!("../../assets/report.css");
/// Notice for a run without a summary.
pub const CUT_SHORT_NOTE: &str =
    "cut short: the run ended without a summary; the recorded part is shown";

/// Returns the content of `report.html`.
pub fn report_html(run: &LoadedRun, figures: &[Figure]) -> String {
    let name = &run.scene.name;
    page_html(name, &format!("{name}: report of a run"), &header_html(run), sections(run, figures))
}

/// Returns a self-contained page: heading, title, HTML below the heading, and sections.
pub fn page_html(heading: &str, title: &str, head: &str, sections: Vec<Section>) -> String {
    let (heading, title) = (escape_markup(heading), escape_markup(title));
    let policy = page::content_security_policy();
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n"
    );
    let _ = write!(page, "<header>\n<h1>{heading}</h1>\n{head}<nav aria-label=\"Sections\">");
    for Section { id, title, .. } in &sections {
        let _ = write!(page, "<a href=\"#{id}\">{title}</a> ");
    }
    page.push_str("</nav>\n</header>\n<main>\n");
    for Section { id, title, content } in sections {
        let _ = writeln!(
            page,
            "<section id=\"{id}\" aria-labelledby=\"{id}-title\">\n<h2 id=\"{id}-title\">{title}</h2>\n\
             {content}</section>"
        );
    }
    page.push_str("</main>\n</body>\n</html>\n");
    page
}

/// A section of a page.
pub struct Section {
    /// Anchor of the section.
    pub id: &'static str,
    /// Heading of the section.
    pub title: &'static str,
    /// Content, HTML.
    pub content: String,
}

/// Returns all sections with content, in order.
fn sections(run: &LoadedRun, figures: &[Figure]) -> Vec<Section> {
    let summary_section =
        |content: fn(&Summary) -> String| run.summary.as_ref().map(content).unwrap_or_default();
    let replay = page::replay_html(&run.scene, &run.frames());
    let sections = [
        ("replay", "Replay", replay),
        ("summary", "Summary", summary_section(summary_html)),
        ("expectations", "Expectations", summary_section(expectations_html)),
        ("faults", "Faults", summary_section(faults_html)),
        ("repairs", "Repairs", repairs_html(run)),
        ("figures", "Figures", figures_html(figures)),
        ("latency", "Latency", summary_section(latency_html)),
        ("robots", "Robots and processes", summary_section(robots_html)),
        ("machine", "Machine and manifest", manifest_html(&run.manifest)),
    ];
    sections
        .into_iter()
        .filter(|(_, _, content)| !content.is_empty())
        .map(|(id, title, content)| Section { id, title, content })
        .collect()
}

/// Returns the description of the run and its verdict.
fn header_html(run: &LoadedRun) -> String {
    let pace = escape_markup(&run.scene.pace);
    let robots = run.scene.robots.len();
    let edges = run.scene.edges.iter().filter(|edge| !edge.spare).count();
    let introduction = run
        .introduction
        .as_ref()
        .map(|introduction| format!("<p>{}</p>\n", escape_markup(introduction)));
    let mut text = introduction.unwrap_or_default();
    let _ = writeln!(
        text,
        "<p class=\"quiet\">{robots} robots, {edges} edges, {} s, {pace}</p>",
        format_short(run.duration_s())
    );
    let (verdict, worst) = match &run.summary {
        None => (CUT_SHORT_NOTE, Some(Verdict::Missed)),
        Some(summary) => rows::verdict(summary),
    };
    let class = worst.map_or("undeclared", Verdict::as_str);
    let _ = writeln!(text, "<p class=\"verdict {class}\">{verdict}</p>");
    if let Some(damage) = &run.damage {
        let damage = escape_markup(damage);
        let _ = writeln!(text, "<p class=\"verdict missed\">results are unreliable: {damage}</p>");
    }
    if let Some(reason) = &run.missing_guarantee {
        let reason = escape_markup(reason);
        let _ = writeln!(
            text,
            "<p class=\"verdict undeclared\">no promise about distances: {reason}</p>"
        );
    }
    if run.decimation > 1 {
        let _ = writeln!(
            text,
            "<p class=\"quiet\">The record is long: the figures and the replay use one of every {} \
             recorded instants.</p>",
            run.decimation
        );
    }
    text
}

fn summary_html(summary: &Summary) -> String {
    let facts = rows::fact_rows(summary);
    description_list_html(facts.iter().map(|(name, value)| (capitalize(name), value.as_str())))
}

/// Capitalizes a column head of the screen for the page.
fn capitalize(name: &str) -> String {
    let mut characters = name.chars();
    characters
        .next()
        .map_or(String::new(), |first| first.to_uppercase().chain(characters).collect())
}

fn expectations_html(summary: &Summary) -> String {
    let has_reasons = summary.expectations.iter().any(|expectation| expectation.reason.is_some());
    let rows = rows::expectation_rows(summary).map(|expectation| {
        let mut row = vec![
            TableCell::Text(expectation.name.to_owned()),
            TableCell::Number(expectation.measured_value),
            TableCell::Number(expectation.required_value),
            TableCell::Verdict(expectation.verdict),
        ];
        let reason = expectation.reason.unwrap_or_default().to_owned();
        row.extend(has_reasons.then_some(TableCell::LongText(reason)));
        row
    });
    let heads = ["Expected", "#Measured", "#Required", "Verdict", "Why"];
    table_html(&heads[..if has_reasons { 5 } else { 4 }], rows)
}

fn faults_html(summary: &Summary) -> String {
    let rows = summary.faults.iter().enumerate().map(|(index, fault)| {
        let [t_s, what, numbers @ ..] = rows::format_fault_row(fault);
        let [mut predicted, other_groups @ ..] = rows::format_broken_robots(fault);
        if !fault.predicted_why.is_empty() {
            predicted = fault.predicted_why.join("; ");
        }
        [
            TableCell::Number((index + 1).to_string()),
            TableCell::Number(t_s),
            TableCell::UnbrokenText(what),
        ]
        .into_iter()
        .chain(numbers.map(TableCell::Number))
        .chain([TableCell::LongText(predicted)])
        .chain(other_groups.map(TableCell::Text))
        .collect()
    });
    let is_text_column = |index: usize| index == 1;
    let heads =
        ["#No.".to_owned()].into_iter().chain(column_heads(&rows::FAULT_COLUMNS, is_text_column));
    let heads: Vec<String> = heads.chain(rows::BROKEN_ROBOT_COLUMNS.map(capitalize)).collect();
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    let Some(first) = summary.faults.first() else { return String::new() };
    let definition = escape_markup(&first.describe_broken());
    let omitted_note = omitted_rows_note(summary.faults.len(), "summary.json");
    format!(
        "{}{omitted_note}<p class=\"quiet\">{definition}</p>\n",
        table_html(&heads, rows.take(SHOWN_ROWS_MAX))
    )
}

/// Returns a note below a table that shows only the first of `count` rows, and which file has all; empty if it has all.
fn omitted_rows_note(count: usize, file: &str) -> String {
    match count > SHOWN_ROWS_MAX {
        true => format!(
            "<p class=\"quiet\">These are the first {SHOWN_ROWS_MAX} of {count}; {file} has all.</p>\n"
        ),
        false => String::new(),
    }
}

/// Returns the table of repair events.
fn repairs_html(run: &LoadedRun) -> String {
    let rows = run.repair_events.iter().map(|(t_s, robot, change)| {
        vec![
            TableCell::Number(format_four_digits(*t_s)),
            TableCell::UnbrokenText(robot.clone()),
            TableCell::Text(change.clone()),
        ]
    });
    let omitted_note = omitted_rows_note(run.repair_events.len(), "events.csv");
    table_html(&["#Time, s", "Robot", "Change"], rows.take(SHOWN_ROWS_MAX)) + &omitted_note
}

/// Converts column heads of the screen to heads of the page. Columns that are not text are numbers.
fn column_heads(heads: &[(&str, usize)], is_text_column: impl Fn(usize) -> bool) -> Vec<String> {
    let heads = heads.iter().enumerate().map(|(index, (head, _))| match is_text_column(index) {
        true => capitalize(head),
        false => format!("#{}", capitalize(head)),
    });
    heads.collect()
}

/// Returns the figures as HTML, each with its caption.
pub fn figures_html(figures: &[Figure]) -> String {
    let mut text = String::new();
    for figure in figures {
        // Inline SVG needs no name space declaration.
        let svg = figure.to_svg().replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1);
        let (title, caption) = (escape_markup(&figure.title), escape_markup(&figure.caption));
        let _ = writeln!(
            text,
            "<figure id=\"{name}\">\n<div class=\"wide\" tabindex=\"0\" role=\"group\" aria-label=\"{title}\">\n{svg}</div>\n\
             <figcaption><strong>{title}.</strong> {caption} \
             <span class=\"quiet\">figures/{name}.svg</span></figcaption>\n</figure>",
            name = figure.name
        );
    }
    text
}

fn latency_html(summary: &Summary) -> String {
    let row = |line: &StageLatency| -> Vec<TableCell> {
        let [stage, edge, numbers @ ..] = rows::format_latency_row(line);
        let text_cells = [stage, edge].map(TableCell::Text);
        text_cells.into_iter().chain(numbers.map(TableCell::Number)).collect()
    };
    let heads = column_heads(&rows::LATENCY_COLUMNS, |index| index < 2);
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    let worst = table_html(&heads, summary.worst_latencies().into_iter().map(row));
    let ages = information_ages_html(&summary.information_ages);
    if worst.is_empty() {
        return ages;
    }
    format!(
        "<p>For each stage, the robot or edge with the largest p99.9.</p>\n{worst}<details>\n\
         <summary>All {} robots, edges and stages</summary>\n{}</details>\n{ages}",
        summary.latencies().count(),
        table_html(&heads, summary.latencies().map(row))
    )
}

fn information_ages_html(ages: &[InformationAge]) -> String {
    let ms = |ns: f64| TableCell::Number(format_four_digits(ns / 1e6));
    let rows = ages.iter().map(|age| {
        vec![
            TableCell::Text(format!("{} \u{2192} {}", age.from, age.robot)),
            TableCell::Number(age.heard.to_string()),
            ms(age.mean_ns),
            ms(age.peak_ns as f64),
        ]
    });
    let table = table_html(&["Edge", "#Beacons received", "#Mean age, ms", "#Peak age, ms"], rows);
    if table.is_empty() {
        return table;
    }
    format!(
        "<h3>Age of information</h3>\n<p>At every instant, now minus the stamp of the newest beacon received: \
         the age grows while an edge is silent.</p>\n{table}"
    )
}

fn robots_html(summary: &Summary) -> String {
    let value_of = |list: &[(String, Option<f64>)], name: &str| {
        let value = list.iter().find(|(robot, _)| robot == name).and_then(|(_, value)| *value);
        TableCell::Number(value.map_or("\u{2013}".into(), format_four_digits))
    };
    let rows = summary.wall.processes.iter().map(|process| {
        vec![
            TableCell::Text(process.name.clone()),
            value_of(&summary.final_error_m, &process.name),
            value_of(&summary.integrated_error_m_s, &process.name),
            TableCell::Number(process.starts.to_string()),
            TableCell::Number(format_four_digits(process.usage.processor_time_s())),
            TableCell::Number(process.usage.involuntary_switches.to_string()),
            TableCell::Number(process.usage.major_faults.to_string()),
        ]
    });
    let heads = [
        "Process",
        "#Final error, m",
        "#Integrated error, m s",
        "#Starts",
        "#Processor time, s",
        "#Preempted",
        "#Pages read",
    ];
    format!("{}{}", table_html(&heads, rows), processes_html(summary))
}

/// Returns explanations of the processes that are no robots.
fn processes_html(summary: &Summary) -> String {
    let explanations = [
        (
            "machine",
            "only waits on the robots' timer, as a baseline for the wake-up latency of this machine",
        ),
        ("awake", "keeps the cores out of sleep states, at idle priority"),
    ];
    let exists = |name: &str| summary.wall.processes.iter().any(|process| process.name == name);
    explanations
        .iter()
        .filter(|(name, _)| exists(name))
        .map(|(name, description)| {
            format!("<p class=\"quiet\">{name}: a process that {description}.</p>\n")
        })
        .collect()
}

fn manifest_html(entries: &[(String, String)]) -> String {
    description_list_html(entries.iter().map(|(name, value)| (name.as_str(), value.as_str())))
}

/// Returns a description list of names and values.
pub fn description_list_html<'a>(
    entries: impl Iterator<Item = (impl AsRef<str>, &'a str)>,
) -> String {
    let entry = |(name, value): (_, &str)| {
        let name: &str = AsRef::as_ref(&name);
        format!("<dt>{}</dt><dd>{}</dd>\n", escape_markup(name), escape_markup(value))
    };
    let entries: String = entries.map(entry).collect();
    if entries.is_empty() { entries } else { format!("<dl>\n{entries}</dl>\n") }
}

/// A cell of a table.
pub enum TableCell {
    /// Plain text.
    Text(String),
    /// A sentence, which must not be squeezed into a narrow column.
    LongText(String),
    /// Text without line breaks.
    UnbrokenText(String),
    /// Number, aligned to the right.
    Number(String),
    /// A verdict on an expectation.
    Verdict(Verdict),
}

/// Returns a table that may be wider than the text and then scrolls. Heads of number columns begin with `#`.
/// Returns an empty string without rows.
pub fn table_html(heads: &[&str], rows: impl Iterator<Item = Vec<TableCell>>) -> String {
    let mut body = String::new();
    for row in rows {
        body.push_str("<tr>");
        for cell in row {
            let _ = match cell {
                TableCell::Text(text) => write!(body, "<td>{}</td>", escape_markup(&text)),
                TableCell::LongText(text) => {
                    write!(body, "<td class=\"long\">{}</td>", escape_markup(&text))
                }
                TableCell::UnbrokenText(text) => {
                    write!(body, "<td class=\"word\">{}</td>", escape_markup(&text))
                }
                TableCell::Number(text) => {
                    write!(body, "<td class=\"number\">{}</td>", escape_markup(&text))
                }
                TableCell::Verdict(verdict) => {
                    write!(
                        body,
                        "<td class=\"{}\">{}</td>",
                        verdict.as_str(),
                        verdict.display_text()
                    )
                }
            };
        }
        body.push_str("</tr>\n");
    }
    if body.is_empty() {
        return body;
    }
    let heads = heads.iter().map(|head| match head.strip_prefix('#') {
        Some(head) => format!("<th scope=\"col\" class=\"number\">{}</th>", escape_markup(head)),
        None => format!("<th scope=\"col\">{}</th>", escape_markup(head)),
    });
    let heads: String = heads.collect();
    format!(
        "<div class=\"wide tabular\" tabindex=\"0\" role=\"group\" aria-label=\"Table\">\n<table>\n\
         <thead><tr>{heads}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>\n</div>\n"
    )
}
