//! Damaged runs of a campaign are reported and computed again, and do not enter the table.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::campaigns::{CampaignDir, NINE_RUN_CAMPAIGN, run_to_exit_code};
use crate::harness::{ExitsWith as _, ROOT, map_in_parallel, phalanx, run};

/// Returns the directories of all runs that have been completed.
fn runs(campaign: &CampaignDir) -> Vec<PathBuf> {
    let runs =
        fs::read_dir(campaign.out_path("out/runs")).unwrap().map(|entry| entry.unwrap().path());
    let mut runs: Vec<PathBuf> = runs.filter(|run| run.extension().is_none()).collect();
    runs.sort();
    runs
}

const RUN_DAMAGES: [&str; 9] = [
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
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 11"));
    let output = run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    assert!(output.contains("11 of 11 runs\n"), "progress in lines: {output}");
    let table = campaign.file("out/runs.csv");
    let runs = runs(&campaign);
    for (run, damage) in runs.iter().zip(RUN_DAMAGES) {
        Command::new("sh").args(["-ec", damage]).current_dir(run).exits_with(0);
    }
    let assert_all_named = |output: &str| {
        for run in &runs[..9] {
            assert!(output.contains(&format!("{} is damaged: ", run.display())), "{output}");
        }
        assert_eq!(output.matches("(in the run with seed ").count(), 9, "{output}");
    };
    let output = run_to_exit_code(campaign.sweep("out", &["--collect"]), 1);
    assert_all_named(&output);
    assert!(output.contains("2 of 11 runs, 9 are damaged"), "{output}");
    assert_eq!(campaign.file("out/runs.csv").lines().count(), 3, "no row is of a damaged run");
    let output = run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    assert_all_named(&output);
    assert!(output.contains("2 of 11 runs already have a result"), "{output}");
    assert!(output.contains("9 runs in"), "{output}");
    assert_eq!(campaign.file("out/runs.csv"), table);
    for run in &runs[..9] {
        assert!(run.with_extension("damaged").exists(), "what was there is kept");
    }
    let output = run_to_exit_code(campaign.sweep("out", &["--collect"]), 0);
    assert!(!output.contains("damaged"), "{output}");
}

/// The exchange must be detected even if the figures of the two runs are equal.
#[test]
fn swapped_run_directories_are_named_and_repeated() {
    let campaign =
        CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 3\nkeep = \"all\""));
    run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    let table = campaign.file("out/runs.csv");
    let runs = runs(&campaign);
    let temporary = campaign.out_path("aside");
    for (from, to) in [(&runs[0], &temporary), (&runs[1], &runs[0]), (&temporary, &runs[1])] {
        fs::rename(from, to).unwrap();
    }
    let id = |run: &PathBuf| run.file_name().unwrap().to_str().unwrap().to_owned();
    let assert_both_named = |output: &str| {
        let message = |at: &PathBuf, is: &PathBuf| {
            let message = "it is not the run that its directory is named after, but";
            format!("{} is damaged: {message} {}", at.display(), id(is))
        };
        assert!(output.contains(&message(&runs[0], &runs[1])), "{output}");
        assert!(output.contains(&message(&runs[1], &runs[0])), "{output}");
    };
    let output = run_to_exit_code(campaign.sweep("out", &["--collect"]), 1);
    assert_both_named(&output);
    assert_eq!(campaign.file("out/runs.csv").lines().count(), 2, "no row is of another run");
    let report = phalanx(["report", "."]).current_dir(&runs[0]).exits_with(1).stdout_and_stderr();
    assert!(
        report.contains(&format!("but {}; the report shows this too", id(&runs[1]))),
        "{report}"
    );
    let output = run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    assert_both_named(&output);
    assert!(output.contains("1 of 3 runs already have a result"), "{output}");
    assert_eq!(campaign.file("out/runs.csv"), table);
    // A run that was moved to another name belongs to no row.
    fs::remove_dir_all(&runs[0]).unwrap();
    std::os::unix::fs::symlink(&runs[1], &runs[0]).unwrap();
    let output = run_to_exit_code(campaign.sweep("out", &["--collect"]), 1);
    assert!(output.contains(&format!("but {}", id(&runs[1]))), "{output}");
    // A copy in another folder is complete, and its checksums are standard ones.
    Command::new("cp")
        .args(["-r".as_ref(), runs[1].as_os_str(), temporary.as_os_str()])
        .exits_with(0);
    phalanx(["report".as_ref(), temporary.as_os_str()]).exits_with(0);
    Command::new("sha256sum")
        .args(["-c", "checksums.sha256"])
        .current_dir(&temporary)
        .exits_with(0);
}

#[test]
fn command_of_a_damaged_run_repeats_it() {
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 1"));
    run_to_exit_code(campaign.sweep("out", &[]), 0);
    let table = campaign.file("out/runs.csv");
    let [run] = &runs(&campaign)[..] else { panic!("{:?}", runs(&campaign)) };
    fs::write(run.join("summary.json"), "").unwrap();
    let commands = campaign.sweep("out", &["--emit-commands"]).exits_with(0);
    assert!(commands.stderr.contains("is damaged: summary.json"), "{}", commands.stderr);
    let mut shell = Command::new("sh");
    shell.args(["-c", &commands.stdout]);
    run_to_exit_code(campaign.prepared(shell), 0);
    run_to_exit_code(campaign.sweep("out", &["--collect"]), 0);
    assert_eq!(campaign.file("out/runs.csv"), table);
}

#[test]
fn reading_a_campaign_removes_no_run() {
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 2"));
    run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    let text = campaign.file("campaign.toml");
    fs::write(campaign.out_path("campaign.toml"), format!("keep = \"all\"\n{text}")).unwrap();
    let output = run_to_exit_code(campaign.sweep("out", &["--collect"]), 4);
    assert!(output.contains("2 are missing"), "less was kept than is asked for: {output}");
    assert_eq!(runs(&campaign).len(), 2);
    run_to_exit_code(campaign.sweep("out", &["--in-process"]), 0);
    assert!(runs(&campaign).iter().all(|run| run.join("run.mcap").exists()));
}

/// Simulates a power failure at each write, rename, removal and sync. After it, data that were not synced are lost, or
/// only their content or name, or nothing.
#[test]
fn power_failure_at_any_point_is_resumed_to_an_equal_table() {
    let campaign = CampaignDir::new(&NINE_RUN_CAMPAIGN.replace("seeds = 9", "seeds = 2"));
    let [library, call_log] = ["cut.so", "told"].map(|name| campaign.out_path(name));
    let source = Path::new(ROOT).join("tests/power/cut.c");
    let mut compiler = Command::new("cc");
    compiler.args(["-shared", "-fPIC", "-o"]).args([&library, &source]).arg("-ldl").exits_with(0);
    let sweep = |out: &str, cut: usize| {
        let mut sweep = campaign.sweep(out, &["--in-process", "--jobs", "1"]);
        sweep.env("LD_PRELOAD", &library).env("CUT_FOLDER", campaign.out_path(out).join("runs"));
        sweep.env("CUT_AT", cut.to_string()).env("CUT_LOSES", (cut % 4).to_string());
        sweep
    };
    sweep("whole", 0).env("CUT_TOLD", &call_log).exits_with(0);
    let call_log = campaign.file("told");
    let (calls, rest) = call_log.split_once(" calls\n").expect(&call_log);
    assert_eq!(rest, "", "what says that runs are complete is synced");
    let cut_points: Vec<usize> = (1..=calls.parse().unwrap()).collect();
    assert!(cut_points.len() > 20, "{call_log}");
    let uncut_table = campaign.file("whole/runs.csv");
    map_in_parallel(&cut_points, |cut| {
        let out = format!("cut-{cut}");
        run_to_exit_code(sweep(&out, *cut), 137);
        let collected = campaign.sweep(&out, &["--collect"]).output().unwrap();
        assert!(matches!(collected.status.code(), Some(0 | 1 | 4)), "{cut}: {collected:?}");
        let rows = campaign.file(&format!("{out}/runs.csv"));
        assert!(
            rows.lines().all(|row| uncut_table.lines().any(|line| line == row)),
            "{cut}: {rows}"
        );
        run_to_exit_code(campaign.sweep(&out, &["--in-process"]), 0);
        assert_eq!(campaign.file(&format!("{out}/runs.csv")), uncut_table, "{cut}");
    });
}

#[test]
fn report_verifies_table_checksums() {
    let ended = run("triangle").lockstep().set("duration_s=1").set("expect={}").finish();
    let run_dir = ended.exits_with(0).run_dir();
    let report = |code| {
        phalanx(["report".as_ref(), run_dir.as_os_str()]).exits_with(code).stdout_and_stderr()
    };
    Command::new("sha256sum").args(["-c", "checksums.sha256"]).current_dir(&run_dir).exits_with(0);
    assert!(!report(0).contains("checksums"));
    let samples = ended.file("samples.csv");
    fs::write(run_dir.join("samples.csv"), samples.replacen("r1,0", "r1,1", 1)).unwrap();
    let output = report(1);
    ended.assert_holds(output.contains("samples.csv is not as the run wrote it"), &output);
    let page = ended.file("report.html");
    ended.assert_holds(page.contains("results are unreliable: samples.csv"), "the page says so");
    fs::remove_file(run_dir.join("samples.csv")).unwrap();
    ended.assert_holds(report(1).contains("samples.csv is missing"), "it is named");
    fs::remove_file(run_dir.join("checksums.sha256")).unwrap();
    ended.assert_holds(report(0).contains("no checksums"), "nothing is known of an older run");
}
