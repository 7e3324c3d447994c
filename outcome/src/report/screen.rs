//! Summary of a finished run on one screen: first the verdict, then its reasons.

use std::fmt::Write as _;

use crate::metrics::expect::Verdict;
use crate::metrics::summary::Summary;
use crate::report::rows::{
    BROKEN, FAULTS, LATENCY, ROWS_SHOWN, broken_robot_texts, deadline_advice, expectations, facts,
    fault, latency, verdict,
};

/// Formats the summary of a run for the screen.
pub fn screen(summary: &Summary) -> String {
    let (words, _) = verdict(summary);
    let mut text = format!("{}, {}: {words}\n", summary.scenario, summary.pace.keyword());
    for expectation in expectations(summary) {
        let sign = match expectation.verdict {
            Verdict::Held => "held  ",
            Verdict::Missed => "MISSED",
            Verdict::Unseen => "UNSEEN",
        };
        let reason = expectation.reason.map_or(String::new(), |reason| format!(": {reason}"));
        let (name, measured) = (expectation.name, expectation.measured);
        let required = format!("required {}{reason}", expectation.required);
        line(&mut text, format_args!("  {sign} {name:<23} {measured:>12}  {required}"));
    }
    if let Some(advice) = deadline_advice(summary) {
        line(&mut text, format_args!("  {advice}"));
    }
    for (name, value) in facts(summary) {
        line(&mut text, format_args!("{name:<19} {value}"));
    }
    let worst = summary.worst_latencies();
    if !worst.is_empty() {
        let row = |cells: [&str; 7]| columns(cells, LATENCY, &[0, 1], " ");
        line(&mut text, format_args!("\n  {}", row(LATENCY.map(|(head, _)| head))));
        // The latency of all robots is shown only if that of the control timer is known for comparison.
        let all = summary.wake_latency_pair().map(|[all, _]| all);
        for stage in all.into_iter().chain(worst) {
            line(
                &mut text,
                format_args!("  {}", row(latency(stage).each_ref().map(String::as_str))),
            );
        }
    }
    if let Some(first) = summary.faults.first() {
        let row = |[t_s, what, rest @ ..]: [&str; 7]| {
            let [(_, wide), (_, whats), widths @ ..] = FAULTS;
            format!("{t_s:>wide$}  {what:<whats$} {}", columns(rest, widths, &[], " "))
        };
        line(&mut text, format_args!("\n  {}", row(FAULTS.map(|(head, _)| head))));
        for each in summary.faults.iter().take(ROWS_SHOWN) {
            line(&mut text, format_args!("  {}", row(fault(each).each_ref().map(String::as_str))));
            let [predicted, observed, affected, orphaned] = broken_robot_texts(each);
            let indent = "             ";
            line(
                &mut text,
                format_args!(
                    "{indent}{}: {predicted}; {}: {observed}; {}: {affected}",
                    BROKEN[0], BROKEN[1], BROKEN[2]
                ),
            );
            for why in &each.predicted_why {
                line(&mut text, format_args!("{indent}  {why}"));
            }
            if !each.orphaned.is_empty() {
                line(&mut text, format_args!("{indent}{}: {orphaned}", BROKEN[3]));
            }
        }
        let count = summary.faults.len();
        if count > ROWS_SHOWN {
            line(
                &mut text,
                format_args!(
                    "  ... the first {ROWS_SHOWN} of {count} faults; summary.json has all"
                ),
            );
        }
        line(&mut text, format_args!("  {}", first.broken_means()));
    }
    text
}

fn line(text: &mut String, line: std::fmt::Arguments<'_>) {
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{line}");
}

/// Formats cells with these widths. Text is aligned to the left, numbers to the right.
fn columns<const N: usize>(
    cells: [&str; N],
    widths: [(&str, usize); N],
    words: &[usize],
    between: &str,
) -> String {
    let cell =
        |(place, (cell, (_, wide))): (usize, (&str, (&str, usize)))| match words.contains(&place) {
            true => format!("{cell:<wide$}"),
            false => format!("{cell:>wide$}"),
        };
    let cells: Vec<String> = cells.into_iter().zip(widths).enumerate().map(cell).collect();
    cells.join(between)
}
