//! `docs/reference/`: the lists there are complete and have no extra entries. `PHALANX_BLESS=1` rewrites the generated
//! pages.

use std::collections::BTreeSet;

use clap::CommandFactory as _;

use crate::harness::{ExitsWith as _, ROOT, phalanx, run};

fn run_phalanx(arguments: &[&str]) -> String {
    phalanx(arguments).exits_with(0).stdout
}

fn page(path: &str) -> String {
    std::fs::read_to_string(format!("{ROOT}/docs/reference/{path}")).unwrap()
}

/// Asserts that a committed page equals this text. Rewrites the page if PHALANX_BLESS is set.
#[track_caller]
fn assert_page(path: &str, text: &str) {
    if std::env::var_os("PHALANX_BLESS").is_some() {
        std::fs::write(format!("{ROOT}/docs/reference/{path}"), text).unwrap();
    }
    let again = "PHALANX_BLESS=1 cargo test --test it pages::reference";
    assert!(
        page(path) == text,
        "docs/reference/{path} is out of date; regenerate it with: {again}"
    );
}

/// Asserts that the table below a heading of a page equals this text. Rewrites it if PHALANX_BLESS is set.
#[track_caller]
fn assert_table(path: &str, heading: &str, table: &str) {
    let page = page(path);
    let (before, section) =
        page.split_once(&format!("\n## {heading}\n\n")).unwrap_or_else(|| panic!("{heading}"));
    let (_, after) = section.split_once("|\n\n").unwrap_or_else(|| panic!("{heading}: no table"));
    assert_page(path, &format!("{before}\n## {heading}\n\n{table}\n{after}"));
}

#[test]
fn files_page_tables_equal_the_generated_tables() {
    use outcome::columns::Table;
    use outcome::metrics::PairDistance;
    use outcome::metrics::summary::{LatencyInterval, StageLatency};
    use outcome::results::tables::{EventLine, MessageLine, SampleLine, SignalLine};
    fn check<L: Table>() {
        assert_table("files.md", &format!("`{}`", L::FILE), &L::reference_table());
    }
    check::<SampleLine>();
    check::<PairDistance>();
    check::<EventLine>();
    check::<SignalLine>();
    check::<MessageLine>();
    check::<StageLatency>();
    check::<LatencyInterval>();
    assert_table("files.md", "`export/`", &outcome::recording::export::tables_reference());
}

/// Returns the names in backquotes in the first column of the tables below a heading.
fn names_in_tables(page: &str, heading: &str) -> Vec<String> {
    let (_, section) =
        page.split_once(&format!("\n## {heading}\n")).unwrap_or_else(|| panic!("{heading}"));
    let section = section.split("\n## ").next().unwrap();
    let lines: Vec<&str> = section.lines().collect();
    let heads = |line: usize| lines.get(line + 1).is_some_and(|below| below.starts_with("|---"));
    let rows = lines.iter().enumerate().filter(|(line, _)| !heads(*line));
    let rows = rows.filter_map(|(_, row)| row.strip_prefix("| `"));
    let cells = rows.map(|row| row.split(" | ").next().unwrap());
    cells
        .flat_map(|cell| cell.split('`').step_by(2).collect::<Vec<_>>())
        .filter(|word| !word.trim_matches([',', ' ']).is_empty())
        .map(str::to_owned)
        .collect()
}

#[test]
fn key_pages_equal_the_generated_pages() {
    assert_page("scenario.md", &run_phalanx(&["schema", "--markdown"]));
    assert_page("campaign.md", &run_phalanx(&["schema", "--campaign", "--markdown"]));
    assert_page("fleet.md", &bridge::keys::reference_page());
}

#[test]
fn files_page_quantities_equal_the_generated_tables() {
    use outcome::campaign::table::{TIMING_COLUMNS, run_columns};
    use outcome::metrics::summary::Summary;
    use outcome::quantities::reference_table;
    let keys = Summary::QUANTITIES.iter().map(|key| (key.name, key.text));
    assert_table("files.md", "`summary.json`", &reference_table("key", keys));
    let columns = run_columns().map(|column| (column.name, column.description));
    assert_table("files.md", "`runs.csv`", &reference_table("column", columns));
    let columns = TIMING_COLUMNS.iter().map(|column| (column.name, column.description));
    assert_table("files.md", "`timing.csv`", &reference_table("column", columns));
}

#[test]
fn command_line_page_equals_the_help() {
    let mut text =
        "# Command line\n\nWritten from `phalanx VERB --help` by the tests; do not edit it.\n"
            .to_owned();
    text += &format!("\n```text\n{}```\n", run_phalanx(&["--help"]));
    for verb in verbs() {
        let help = match verb.as_str() {
            // The bench is a separate program, which need not be built.
            "bench" => bench::cli::CommandLine::command().render_long_help().to_string(),
            _ => run_phalanx(&[&verb, "--help"]),
        };
        text += &format!("\n## `phalanx {verb}`\n\n```text\n{help}```\n");
    }
    let text: Vec<&str> = text.lines().map(str::trim_end).collect();
    assert_page("command-line.md", &(text.join("\n") + "\n"));
}

/// Returns the subcommands that the help lists.
fn verbs() -> Vec<String> {
    let help = run_phalanx(&["--help"]);
    let (_, commands) = help.split_once("Commands:\n").unwrap();
    let (commands, _) = commands.split_once("\n\n").unwrap();
    let names = commands.lines().filter_map(|line| {
        let name = line.strip_prefix("  ")?;
        (!name.starts_with(' ')).then(|| name.split(' ').next().unwrap().to_owned())
    });
    names.filter(|name| name != "help").collect()
}

#[test]
fn files_page_lists_every_run_file_and_table_column() {
    let page = page("files.md");
    let run = run("triangle").lockstep().drawing().set("duration_s=1").set("expect={}");
    let ended = run.fault("kill r2 @0.5").finish();
    ended.exits_with(0);
    let directory = ended.run_dir();
    let named =
        |name: &str| page.contains(&format!("`{name}")) || page.contains(&format!("`{name}/*"));
    for entry in std::fs::read_dir(&directory).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(named(&name), "{name} is not on the page");
    }
    for table in ["samples.csv", "pairs.csv", "events.csv", "latency.csv", "latency_over_time.csv"]
    {
        let text = ended.file(table);
        let columns: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        assert_eq!(names_in_tables(&page, &format!("`{table}`")), columns, "{table}");
    }
    let keys: BTreeSet<String> = names_in_tables(&page, "`summary.json`").into_iter().collect();
    let found: BTreeSet<String> = ended.summary.as_object().unwrap().keys().cloned().collect();
    // Some keys are written only if they apply.
    assert!(found.is_subset(&keys), "{found:?} and {keys:?}");
    let keys: BTreeSet<String> = names_in_tables(&page, "Each of `faults`").into_iter().collect();
    let fault = ended.summary["faults"][0].as_object().unwrap();
    assert_eq!(keys, fault.keys().cloned().collect());
    let kinds = ended.file("events.csv");
    for kind in kinds.lines().skip(1).filter_map(|line| line.split(',').nth(1)) {
        assert!(page.contains(&format!("`{kind}`")), "the event kind {kind} is not on the page");
    }
}

#[test]
fn messages_page_lists_every_message_with_fields_in_order() {
    let page = page("messages.md");
    let source = include_str!("../../../protocol/src/message.rs");
    let mut messages = 0;
    for declared in source.split("\nmessage! {\n").skip(1) {
        let body = declared.split("\n}\n").next().unwrap();
        let lines = body.lines().filter(|line| !line.trim_start().starts_with("///"));
        let mut lines = lines.map(str::trim);
        let name = lines.next().unwrap().split(' ').next().unwrap();
        let fields: Vec<&str> = lines.filter_map(|line| Some(line.split_once(": ")?.0)).collect();
        assert_eq!(names_in_tables(&page, &format!("`{name}`")), fields, "{name}");
        messages += 1;
    }
    assert!(messages >= 9, "{messages} messages");
}

#[test]
fn exit_codes_page_matches_the_protocol() {
    let page = page("exit-codes.md");
    let source = include_str!("../../../protocol/src/exit.rs");
    let codes: Vec<&str> = source
        .lines()
        .filter_map(|line| line.strip_prefix("pub const ")?.split(" = ").nth(1)?.strip_suffix(';'))
        .collect();
    let rows: Vec<&str> = page
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split(' ').next())
        .filter(|cell| cell.parse::<u8>().is_ok())
        .collect();
    assert_eq!(rows, codes);
}

#[test]
fn scenarios_page_lists_every_shipped_scenario() {
    let page = page("scenarios.md");
    let mut named =
        names_in_tables(&page.replace("# Shipped", "\n## Shipped"), "Shipped scenarios");
    let folder = std::fs::read_dir(format!("{ROOT}/scenarios")).unwrap();
    let files = folder.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut files: Vec<String> = files.filter(|name| name.ends_with(".toml")).collect();
    named.sort();
    files.sort();
    assert_eq!(named, files);
}
