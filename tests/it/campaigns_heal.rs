//! Damage to the runs of a campaign is named and healed, and no table is made of it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::campaigns::{NINE, Place, ended};
use crate::harness::{ExitsWith as _, phalanx, run};

/// The directories of the runs that are done, or were.
fn runs(place: &Place) -> Vec<PathBuf> {
    let runs = fs::read_dir(place.out("out/runs")).unwrap().map(|entry| entry.unwrap().path());
    let mut runs: Vec<PathBuf> = runs.filter(|run| run.extension().is_none()).collect();
    runs.sort();
    runs
}

const DAMAGES: [&str; 9] = [
    ": > summary.json",
    "truncate -s 300 summary.json",
    "rm summary.json",
    "echo '{}' > summary.json",
    "sed -i 's/\"t_s\": 1/\"t_s\": 2/' summary.json",
    ": > checksums.sha256",
    "rm checksums.sha256",
    "rm manifest.json",
    "echo >> scenario.toml",
];

#[test]
fn damaged_runs_are_named_and_run_again_and_no_others() {
    let place = Place::new(&NINE.replace("seeds = 9", "seeds = 11"));
    let said = ended(place.sweep("out", &["--in-process"]), 0);
    assert!(said.contains("11 of 11 runs\n"), "progress in lines: {said}");
    let table = place.file("out/runs.csv");
    let runs = runs(&place);
    for (run, damage) in runs.iter().zip(DAMAGES) {
        Command::new("sh").args(["-ec", damage]).current_dir(run).exits_with(0);
    }
    let names = |said: &str| {
        for run in &runs[..9] {
            assert!(said.contains(&format!("{} is damaged: ", run.display())), "{said}");
        }
        assert_eq!(said.matches("(in the run with seed ").count(), 9, "{said}");
    };
    let said = ended(place.sweep("out", &["--collect"]), 1);
    names(&said);
    assert!(said.contains("2 of 11 runs, 9 are damaged"), "{said}");
    assert_eq!(place.file("out/runs.csv").lines().count(), 3, "no row is of a damaged run");
    let said = ended(place.sweep("out", &["--in-process"]), 0);
    names(&said);
    assert!(said.contains("2 of 11 runs are there already"), "{said}");
    assert!(said.contains("9 runs in"), "{said}");
    assert_eq!(place.file("out/runs.csv"), table);
    for run in &runs[..9] {
        assert!(run.with_extension("damaged").exists(), "what was there is kept");
    }
    let said = ended(place.sweep("out", &["--collect"]), 0);
    assert!(!said.contains("damaged"), "{said}");
}

#[test]
fn the_command_of_a_damaged_run_runs_it_again() {
    let place = Place::new(&NINE.replace("seeds = 9", "seeds = 1"));
    ended(place.sweep("out", &[]), 0);
    let table = place.file("out/runs.csv");
    let [run] = &runs(&place)[..] else { panic!("{:?}", runs(&place)) };
    fs::write(run.join("summary.json"), "").unwrap();
    let commands = place.sweep("out", &["--emit-commands"]).exits_with(0);
    assert!(commands.stderr.contains("is damaged: summary.json"), "{}", commands.stderr);
    let mut shell = Command::new("sh");
    shell.args(["-c", &commands.stdout]);
    ended(place.prepared(shell), 0);
    ended(place.sweep("out", &["--collect"]), 0);
    assert_eq!(place.file("out/runs.csv"), table);
}

#[test]
fn whoever_only_looks_at_a_campaign_removes_no_run() {
    let place = Place::new(&NINE.replace("seeds = 9", "seeds = 2"));
    ended(place.sweep("out", &["--in-process"]), 0);
    let campaign = place.file("campaign.toml");
    fs::write(place.out("campaign.toml"), format!("keep = \"all\"\n{campaign}")).unwrap();
    let said = ended(place.sweep("out", &["--collect"]), 4);
    assert!(said.contains("2 are missing"), "less was kept than is asked for: {said}");
    assert_eq!(runs(&place).len(), 2);
    ended(place.sweep("out", &["--in-process"]), 0);
    assert!(runs(&place).iter().all(|run| run.join("run.mcap").exists()));
}

#[test]
fn a_report_holds_the_tables_of_a_run_against_their_checksums() {
    let ended = run("triangle").lockstep().set("duration_s=1").set("expect={}").finish();
    let run_dir = ended.exits_with(0).run_dir();
    let report = |code| phalanx(["report".as_ref(), run_dir.as_os_str()]).exits_with(code).both();
    Command::new("sha256sum").args(["-c", "checksums.sha256"]).current_dir(&run_dir).exits_with(0);
    assert!(!report(0).contains("checksums"));
    let samples = ended.file("samples.csv");
    fs::write(run_dir.join("samples.csv"), samples.replacen("r1,0", "r1,1", 1)).unwrap();
    let said = report(1);
    ended.claim(said.contains("samples.csv is not as the run wrote it"), &said);
    let page = ended.file("report.html");
    ended.claim(page.contains("not to be relied on: samples.csv"), "the page says so");
    fs::remove_file(run_dir.join("samples.csv")).unwrap();
    ended.claim(report(1).contains("samples.csv is missing"), "it is named");
    fs::remove_file(run_dir.join("checksums.sha256")).unwrap();
    ended.claim(report(0).contains("no checksums"), "nothing is known of an older run");
}
