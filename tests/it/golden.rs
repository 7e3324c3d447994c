//! Stored results of every shipped scenario, as it is and with one kill and restart: a change of a
//! trajectory or of a table is a line in the diff of `tests/golden/runs.txt`.
//!
//! `PHALANX_BLESS=1 cargo test --test it golden` writes the file again. The reason for each changed
//! line belongs in the commit message.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::ops::Range;
use std::path::Path;

use serde_json::Value;
use sha2::{Digest as _, Sha256};

use crate::campaigns::{CampaignDir, run_to_exit_code};
use crate::harness::ROOT;

/// Scenarios that are also run with a process for each robot.
pub const AS_PROCESSES: [&str; 13] = [
    "bodies/drones-8",
    "bodies/parking-8",
    "bodies/team-9",
    "bodies/triangle-axle",
    "containment",
    "containment-chaos",
    "corridor",
    "liar-10",
    "pentagon",
    "pentagon-cut",
    "swap-8",
    "triangle",
    "triangle-inertia",
];

/// Folders of shipped scenarios, below `scenarios`, with the prefix of their names.
const FOLDERS: [&str; 2] = ["", "bodies/"];

/// Tables whose checksums are stored, next to the trajectory hash and the checksum of
/// `summary.json` without its section `wall`.
const HASHED_TABLES: [&str; 3] = ["samples.csv", "pairs.csv", "events.csv"];

/// Returns the name of every shipped scenario, sorted: `bodies/parking-8` is in the folder `bodies`.
fn shipped() -> Vec<String> {
    let named = |folder: &str| {
        let files = fs::read_dir(Path::new(ROOT).join("scenarios").join(folder)).unwrap().flatten();
        let toml = files
            .map(|file| file.path())
            .filter(|path| path.extension().is_some_and(|extension| extension == "toml"));
        let names = toml.map(|path| format!("{folder}{}", path.file_stem().unwrap().display()));
        names.collect::<Vec<String>>()
    };
    let mut names: Vec<String> = FOLDERS.into_iter().flat_map(named).collect();
    names.sort();
    names
}

/// Numbers of robots with which a scenario with a kill lasts 20 s only, to save a minute of processor time. `thousand`
/// has faults after that time.
const SHORTENED_ROBOTS: Range<usize> = 100..1024;

/// Returns a campaign that runs each of `scenarios` twice in lockstep: as shipped, and with its last
/// robot killed at 2 s and restarted 0.5 s later.
fn campaign(scenarios: &[&str]) -> String {
    let mut text =
        "name = \"golden\"\nkeep = \"all\"\nscenario = \"SCENARIOS/triangle.toml\"\ncase = [\n"
            .to_owned();
    for name in scenarios {
        let scenario = crate::oracle::scenario(name, &[]);
        let robot = &scenario.robots.last().unwrap().name;
        let file = format!("scenario = \"SCENARIOS/{name}.toml\"");
        let large = SHORTENED_ROBOTS.contains(&scenario.robots.len());
        let short = if large { ", set = { duration_s = 20, expect = {} }" } else { "" };
        writeln!(text, "{{ axis = \"case\", name = \"{name}\", {file} }},").unwrap();
        writeln!(
            text,
            "{{ axis = \"case\", name = \"{name} kill\", {file}, \
             faults = [\"kill {robot} @2 restart 0.5\"]{short} }},"
        )
        .unwrap();
    }
    text + "]\n"
}

fn checksum(bytes: &[u8]) -> String {
    Sha256::digest(bytes)[..8].iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the stored form of a finished run: trajectory hash, then one checksum per table.
fn fingerprint(run: &Path) -> String {
    let summary = fs::read_to_string(run.join("summary.json")).unwrap();
    let mut summary: Value = serde_json::from_str(&summary).unwrap();
    let hash = summary["trajectory_hash"].as_str().unwrap().to_owned();
    assert!(summary.as_object_mut().unwrap().remove("wall").is_some(), "{summary}");
    let mut line = format!("trajectory {hash}");
    for table in HASHED_TABLES {
        write!(line, " {table} {}", checksum(&fs::read(run.join(table)).unwrap())).unwrap();
    }
    write!(line, " summary.json {}", checksum(summary.to_string().as_bytes())).unwrap();
    line
}

/// Runs the campaign of `scenarios` and returns the fingerprint of each run, by its name.
fn fingerprints(scenarios: &[&str], options: &[&str]) -> BTreeMap<String, String> {
    let campaign = CampaignDir::new(&campaign(scenarios));
    run_to_exit_code(campaign.sweep("out", options), 0);
    let table = campaign.file("out/runs.csv");
    let rows: Vec<Vec<&str>> = table.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 1 + 2 * scenarios.len(), "{table}");
    let id = rows[0].iter().rposition(|&column| column == "run").unwrap();
    let runs = campaign.out_path("out/runs");
    rows[1..].iter().map(|row| (row[0].to_owned(), fingerprint(&runs.join(row[id])))).collect()
}

fn read_golden_file() -> String {
    fs::read_to_string(Path::new(ROOT).join("tests/golden/runs.txt")).unwrap_or_default()
}

#[test]
fn shipped_scenarios_in_process_match_stored_results() {
    let names = shipped();
    assert!(names.len() >= 34, "{names:?}");
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let found: String = fingerprints(&names, &["--in-process"])
        .iter()
        .map(|(run, line)| format!("{run}: {line}\n"))
        .collect();
    if std::env::var_os("PHALANX_BLESS").is_some() {
        fs::write(Path::new(ROOT).join("tests/golden/runs.txt"), &found).unwrap();
    }
    let stored = read_golden_file();
    let changed: Vec<&str> =
        found.lines().filter(|line| !stored.lines().any(|stored| stored == *line)).collect();
    assert!(found == stored, "changed, or new:\n{}\nstored:\n{stored}", changed.join("\n"));
}

#[test]
fn scenarios_as_processes_match_stored_results() {
    let stored = read_golden_file();
    for (run, line) in fingerprints(&AS_PROCESSES, &[]) {
        let line = format!("{run}: {line}");
        assert!(stored.lines().any(|stored| stored == line), "{line}\nstored:\n{stored}");
    }
}
