//! The page of a finished run: one file that needs no other and makes no request.

use std::fmt::Write as _;

use crate::metrics::expect::{self, Expectation, Verdict};
use crate::metrics::fault::FaultReport;
use crate::metrics::summary::{Commands, InformationAge, StageLatency, Summary};

use crate::report::chart::Figure;
use crate::report::digits::{asked, digits};
use crate::report::markup::escaped;
use crate::report::page;
use crate::report::run::Run;

const STYLE: &str = include_str!("../../assets/report.css");
/// Of a longer list of names only the first ones are told.
const NAMES_MAX: usize = 12;

/// `report.html`.
pub fn report(run: &Run, figures: &[Figure]) -> String {
    let name = &run.scene.name;
    framed(name, &format!("{name}: report of a run"), &head(run), sections(run, figures))
}

/// A page that needs no other file: its heading and title, what stands below the heading (HTML), and
/// its sections.
pub fn framed(heading: &str, title: &str, head: &str, sections: Vec<Section>) -> String {
    let (heading, title) = (escaped(heading), escaped(title));
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

/// A part of a page.
pub struct Section {
    /// What links to it say.
    pub id: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// HTML.
    pub content: String,
}

/// All that have something in them, in order.
fn sections(run: &Run, figures: &[Figure]) -> Vec<Section> {
    let of =
        |content: fn(&Summary) -> String| run.summary.as_ref().map(content).unwrap_or_default();
    let replay = page::replay(&run.scene, &run.frames());
    let all = [
        ("replay", "Replay", replay),
        ("summary", "Summary", of(summary)),
        ("expectations", "Expectations", of(|summary| expectations(&summary.expectations))),
        ("faults", "Faults", of(|summary| faults(&summary.faults))),
        ("figures", "Figures", drawn(figures)),
        ("latency", "Latency", of(latency)),
        ("robots", "Robots and processes", of(robots)),
        ("machine", "Machine and manifest", listed(&run.manifest)),
    ];
    all.into_iter()
        .filter(|(_, _, content)| !content.is_empty())
        .map(|(id, title, content)| Section { id, title, content })
        .collect()
}

/// What the run was, and how it went.
fn head(run: &Run) -> String {
    let pace = escaped(&run.scene.pace);
    let (robots, edges) = (run.scene.robots.len(), run.scene.edges.len());
    let mut text = format!(
        "<p class=\"quiet\">{robots} robots, {edges} edges, {} s, {pace}</p>\n",
        asked(run.lasts_s())
    );
    let (class, verdict) = match &run.summary {
        None => {
            ("missed", "cut short: the run ended without a summary; what was recorded is shown")
        }
        Some(summary) if summary.interrupted => ("missed", "interrupted"),
        Some(summary) if summary.exit == 4 => ("missed", "ended early"),
        Some(summary) => match expect::worst(&summary.expectations) {
            None => (
                "undeclared",
                "no expectations declared; exit code 0 says that the run ended as planned",
            ),
            Some(verdict) => (verdict.word(), verdict.of_all()),
        },
    };
    let _ = writeln!(text, "<p class=\"verdict {class}\">{verdict}</p>");
    if let Some(why) = &run.unpromised {
        let why = escaped(why);
        let _ =
            writeln!(text, "<p class=\"verdict undeclared\">no promise about distances: {why}</p>");
    }
    if run.every > 1 {
        let _ = writeln!(
            text,
            "<p class=\"quiet\">The record is long: the figures and the replay use one of every {} \
             recorded instants.</p>",
            run.every
        );
    }
    text
}

fn summary(summary: &Summary) -> String {
    let mut rows: Vec<(&str, String)> = Vec::new();
    if let (Some(distance_m), Some([a, b]), Some(t_s)) =
        (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s)
    {
        let below = match summary.violations {
            0 => String::new(),
            ticks => format!(", below d at {ticks} ticks"),
        };
        let distance = digits(distance_m);
        rows.push((
            "Smallest distance",
            format!("{distance} m, {a} \u{2013} {b} at {t_s:.3} s{below}"),
        ));
    }
    if let Some(clearance) = &summary.min_clearance {
        let whereabouts = clearance.whereabouts(summary.clearance_violations);
        let distance = digits(clearance.distance_m);
        rows.push(("Smallest clearance", format!("{distance} m, {whereabouts}")));
    }
    let converged = summary.converged_at_s.map_or("never".into(), |t_s| format!("at {t_s:.3} s"));
    rows.push(("Converged", converged));
    let in_m = |value: Option<f64>| value.map(|value| format!("{} m", digits(value)));
    let measured = [
        ("Worst error, last 10 %", in_m(summary.final_error_m_max)),
        ("Worst error to the ideal formation, last 10 %", in_m(summary.final_ideal_error_m_max)),
        ("Main leader's error, last 10 %", in_m(summary.tracking_error_m_max)),
        ("Outside the hull, last 10 %", in_m(summary.hull_distance_m_max_final)),
        ("Trajectory hash", summary.trajectory_hash.clone()),
    ];
    rows.extend(measured.into_iter().filter_map(|(name, value)| Some((name, value?))));
    rows.push((
        "Time",
        format!(
            "{:.3} s of run time, {} ticks, in {:.3} s of wall time: {} x real time",
            summary.t_s,
            summary.ticks,
            summary.wall.wall_s,
            digits(summary.wall.real_time_factor)
        ),
    ));
    rows.push(("Deadline misses", summary.deadline_misses.to_string()));
    let Commands { late, old, not_finite, scaled, expired, lost, .. } = summary.commands;
    let commands = [
        (late, "late"),
        (old, "old"),
        (not_finite, "not finite"),
        (scaled, "scaled"),
        (expired, "expired"),
        (lost, "lost"),
    ];
    let commands = commands.iter().filter(|(count, _)| *count > 0);
    let commands: Vec<String> = commands.map(|(count, word)| format!("{count} {word}")).collect();
    let fine = "all taken in time".to_owned();
    rows.push(("Commands", if commands.is_empty() { fine } else { commands.join(", ") }));
    for (name, lost) in [
        ("Plant states not received", summary.truths_lost),
        ("Latencies lost", summary.wall.latencies_lost),
    ] {
        if lost > 0 {
            rows.push((name, lost.to_string()));
        }
    }
    described(rows.iter().map(|(name, value)| (*name, value.as_str())))
}

fn expectations(expectations: &[Expectation]) -> String {
    let reasons = expectations.iter().any(|expectation| expectation.reason.is_some());
    let rows = expectations.iter().map(|expectation| {
        let Expectation { name, value, bound, held, reason, .. } = expectation;
        // A miss by a hair's breadth must not be rounded to its bound.
        let shown = |value: f64| if *held { digits(value) } else { value.to_string() };
        let mut row = vec![
            Cell::Text(name.clone()),
            Cell::Number(value.map_or("never".into(), shown)),
            Cell::Number(if *held { asked(*bound) } else { bound.to_string() }),
            Cell::Verdict(expectation.verdict()),
        ];
        row.extend(reasons.then(|| Cell::Long(reason.clone().unwrap_or_default())));
        row
    });
    let heads = ["Expected", "#Measured", "#Required", "Verdict", "Why"];
    table(&heads[..if reasons { 5 } else { 4 }], rows)
}

fn faults(faults: &[FaultReport]) -> String {
    let seconds = |value: Option<f64>| Cell::Number(value.map_or("\u{2013}".into(), digits));
    let rows = faults.iter().enumerate().map(|(place, fault)| {
        vec![
            Cell::Number((place + 1).to_string()),
            Cell::Number(format!("{:.3}", fault.t_s)),
            Cell::Word(fault.what.clone()),
            seconds(fault.stale_after_s),
            seconds(fault.lost_after_s),
            Cell::Number(digits(fault.peak_error_m)),
            seconds(fault.min_distance_m),
            seconds(fault.recovered_after_s),
            Cell::Long(predicted(fault)),
            Cell::Text(who(&fault.broken)),
            Cell::Text(who(&fault.affected)),
            Cell::Text(who(&fault.orphaned)),
        ]
    });
    let heads = [
        "#No.",
        "#At, s",
        "What",
        "#Stale after, s",
        "#Lost after, s",
        "#Peak error, m",
        "#Least distance, m",
        "#Recovered after, s",
        "Predicted to break",
        "Observed to break",
        "Affected",
        "Orphaned",
    ];
    let Some(first) = faults.first() else { return String::new() };
    let means = escaped(&first.broken_means());
    format!("{}<p class=\"quiet\">{means}</p>\n", table(&heads, rows))
}

/// Who is to break, each with the reason.
fn predicted(fault: &FaultReport) -> String {
    match fault.predicted_why.is_empty() {
        true => who(&fault.predicted),
        false => fault.predicted_why.join("; "),
    }
}

fn who(robots: &[String]) -> String {
    match robots.len() {
        0 => "nobody".into(),
        many if many > NAMES_MAX => {
            let few = &robots[..NAMES_MAX - 4];
            format!("{} and {} more", few.join(", "), many - few.len())
        }
        _ => robots.join(", "),
    }
}

/// Figures within a page, each with its caption.
pub fn drawn(figures: &[Figure]) -> String {
    let mut text = String::new();
    for figure in figures {
        // Inline, the name space is known and the size is that of the page.
        let svg = figure.svg().replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1);
        let (title, caption) = (escaped(&figure.title), escaped(&figure.caption));
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

fn latency(summary: &Summary) -> String {
    let us = |ns: u64| Cell::Number(digits(ns as f64 / 1e3));
    let row = |line: &StageLatency| {
        let edge = line
            .from
            .as_ref()
            .map_or(line.robot.clone(), |from| format!("{from} \u{2192} {}", line.robot));
        let count = Cell::Number(line.count.to_string());
        let values = [line.p50_ns, line.p99_ns, line.p99_9_ns, line.max_ns].map(us);
        [Cell::Text(line.stage.clone()), Cell::Text(edge), count]
            .into_iter()
            .chain(values)
            .collect()
    };
    let heads =
        ["Stage", "Robot or edge", "#Count", "#p50, us", "#p99, us", "#p99.9, us", "#max, us"];
    let worst = table(&heads, summary.worst_latencies().into_iter().map(row));
    let ages = ages(&summary.information_ages);
    if worst.is_empty() {
        return ages;
    }
    format!(
        "<p>For each stage, the robot or edge with the largest p99.9.</p>\n{worst}<details>\n\
         <summary>All {} robots, edges and stages</summary>\n{}</details>\n{ages}",
        summary.latencies().count(),
        table(&heads, summary.latencies().map(row))
    )
}

fn ages(ages: &[InformationAge]) -> String {
    let ms = |ns: f64| Cell::Number(digits(ns / 1e6));
    let rows = ages.iter().map(|age| {
        vec![
            Cell::Text(format!("{} \u{2192} {}", age.from, age.robot)),
            Cell::Number(age.heard.to_string()),
            ms(age.mean_ns),
            ms(age.peak_ns as f64),
        ]
    });
    let all = table(&["Edge", "#Beacons heard", "#Mean age, ms", "#Peak age, ms"], rows);
    if all.is_empty() {
        return all;
    }
    format!(
        "<h3>Information age</h3>\n<p>At every instant, now minus the stamp of the newest beacon heard: \
         it grows while an edge is silent.</p>\n{all}"
    )
}

fn robots(summary: &Summary) -> String {
    let of = |list: &[(String, Option<f64>)], name: &str| {
        let value = list.iter().find(|(robot, _)| robot == name).and_then(|(_, value)| *value);
        Cell::Number(value.map_or("\u{2013}".into(), digits))
    };
    let rows = summary.wall.processes.iter().map(|process| {
        vec![
            Cell::Text(process.name.clone()),
            of(&summary.final_error_m, &process.name),
            of(&summary.integrated_error_m_s, &process.name),
            Cell::Number(process.starts.to_string()),
            Cell::Number(digits(process.usage.user_s + process.usage.system_s)),
            Cell::Number(process.usage.involuntary_switches.to_string()),
            Cell::Number(process.usage.major_faults.to_string()),
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
    format!("{}{}", table(&heads, rows), about_processes(summary))
}

/// What the rows of no robot are.
fn about_processes(summary: &Summary) -> String {
    let words = [
        (
            "machine",
            "has the robots' timer and nothing else, and shows what the machine alone does",
        ),
        ("awake", "keeps the cores out of sleep states, and gives way to all others"),
    ];
    let is_there = |name: &str| summary.wall.processes.iter().any(|process| process.name == name);
    words
        .iter()
        .filter(|(name, _)| is_there(name))
        .map(|(name, does)| format!("<p class=\"quiet\">{name}: a process that {does}.</p>\n"))
        .collect()
}

fn listed(entries: &[(String, String)]) -> String {
    described(entries.iter().map(|(name, value)| (name.as_str(), value.as_str())))
}

/// Names and what they stand for.
pub fn described<'a>(entries: impl Iterator<Item = (&'a str, &'a str)>) -> String {
    let entries: String = entries
        .map(|(name, value)| format!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value)))
        .collect();
    if entries.is_empty() { entries } else { format!("<dl>\n{entries}</dl>\n") }
}

/// What is in a place of a table.
pub enum Cell {
    /// Words.
    Text(String),
    /// A sentence: not squeezed into a narrow column.
    Long(String),
    /// Not broken.
    Word(String),
    /// A number.
    Number(String),
    /// How an expectation came out.
    Verdict(Verdict),
}

/// A verdict as people read it.
pub(crate) fn told(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Held | Verdict::Missed => verdict.word(),
        Verdict::Unseen => "not observed",
    }
}

/// A table that may be wider than the text, and scrolls by itself where it is wider than the page;
/// heads of numbers begin with `#`. Nothing for no rows.
pub fn table(heads: &[&str], rows: impl Iterator<Item = Vec<Cell>>) -> String {
    let mut body = String::new();
    for row in rows {
        body.push_str("<tr>");
        for cell in row {
            let _ = match cell {
                Cell::Text(text) => write!(body, "<td>{}</td>", escaped(&text)),
                Cell::Long(text) => write!(body, "<td class=\"long\">{}</td>", escaped(&text)),
                Cell::Word(text) => write!(body, "<td class=\"word\">{}</td>", escaped(&text)),
                Cell::Number(text) => write!(body, "<td class=\"number\">{}</td>", escaped(&text)),
                Cell::Verdict(verdict) => {
                    write!(body, "<td class=\"{}\">{}</td>", verdict.word(), told(verdict))
                }
            };
        }
        body.push_str("</tr>\n");
    }
    if body.is_empty() {
        return body;
    }
    let heads = heads.iter().map(|head| match head.strip_prefix('#') {
        Some(head) => format!("<th scope=\"col\" class=\"number\">{}</th>", escaped(head)),
        None => format!("<th scope=\"col\">{}</th>", escaped(head)),
    });
    let heads: String = heads.collect();
    format!(
        "<div class=\"wide tabular\" tabindex=\"0\" role=\"group\" aria-label=\"Table\">\n<table>\n\
         <thead><tr>{heads}</tr></thead>\n<tbody>\n{body}</tbody>\n</table>\n</div>\n"
    )
}
