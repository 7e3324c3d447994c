//! Programs that compute metrics from the directory of a run: their numbers are in all results, and their errors are
//! named.

use std::path::Path;

use serde_json::json;
use tempfile::TempDir;

use super::{run, script};
use crate::harness::{ExitsWith as _, Phalanx, RunRoot, phalanx};

/// A program that prints the number of samples of r2, and the number of events.
const COUNTS: &str = "cd \"$1\"; echo reading; \
    echo \"{ \\\"samples\\\": $(grep -c ,r2, samples.csv), \\\"events\\\": $(($(wc -l < events.csv) - 1)) }\"";

/// Creates a scenario of two robots with built-in laws and the metrics `samples` and `events` of `metrics.sh`.
fn scenario(program: &str, more: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let text = format!(
        "name = \"own\"\nduration_s = 0.5\nperiod_s = 0.01\nrecord_hz = 20.0\n\
         avoidance = {{ kind = \"guard\", distance_min_m = 0.2, speed_max_m_s = 0.3 }}\n\
         robot = [\n\
         {{ name = \"r1\", pose = {{ x_m = -0.1, y_m = 0.0, heading_rad = 0.0 }}, goal_m = [0.0, 0.1] }},\n\
         {{ name = \"r2\", pose = {{ x_m = 1.0, y_m = 0.0, heading_rad = 0.0 }}, goal_m = [1.5, 0.0] }},\n]\n\
         [robot_defaults]\nfront_point_m = 0.1\nlaw = \"goal-unit\"\nspeed_m_s = 0.1\n\
         [metrics.samples]\nprogram = [\"./metrics.sh\"]\n\
         [metrics.events]\nprogram = [\"./metrics.sh\"]\n{more}"
    );
    std::fs::write(folder.path().join("own.toml"), text).unwrap();
    script(folder.path(), "metrics.sh", program);
    folder
}

fn lockstep(folder: &Path) -> Phalanx {
    run(folder).lockstep()
}

#[test]
fn numbers_of_a_program_are_in_summary_expectations_and_copy() {
    let folder = scenario(COUNTS, "[expect]\nmetrics.samples.min = 11\nmetrics.events.max = 1\n");
    let ended = lockstep(folder.path()).finish();
    ended.exits_with(1).assert_leaves_nothing();
    let metrics = &ended.summary["metrics"];
    ended.assert_holds(metrics == &json!({ "samples": 11.0, "events": 2.0 }), metrics.to_string());
    let verdicts: Vec<_> = ended.summary["expectations"].as_array().unwrap().iter().collect();
    let verdicts: Vec<_> = verdicts.iter().map(|one| (&one["name"], &one["held"])).collect();
    let expected = [
        (&json!("metrics.events.max"), &json!(false)),
        (&json!("metrics.samples.min"), &json!(true)),
    ];
    ended.assert_holds(verdicts == expected, format!("{verdicts:?}"));
    // The copy of the program gives the same summary.
    let run_root = RunRoot::new();
    let mut verify = phalanx(["verify"]);
    verify.arg(ended.run_dir()).arg("--allow-programs").env("PHALANX_RUN_ROOT", run_root.path());
    verify.exits_with(0);
    let mut refused = phalanx(["verify"]);
    let stderr = refused.arg(ended.run_dir()).exits_with(2).stderr;
    assert!(
        stderr.contains("starts a program from the run directory, ")
            && stderr.contains("metrics.sh"),
        "{stderr}"
    );
}

#[test]
fn error_of_a_program_is_named_and_ends_the_run_with_4() {
    for (program, more, parts) in [
        (
            "echo no file >&2; exit 3",
            "",
            &["error: the metrics program `./metrics.sh` failed (exit code 3):", "no file"][..],
        ),
        (
            "sleep 100 & sleep 100",
            "deadline_s = 0.3\n",
            &["took more than 0.3 s (deadline_s), and was killed"],
        ),
        (
            "echo '{\"samples\": NaN, \"events\": 1}'",
            "",
            &["a number that is not finite; print null"],
        ),
        ("echo '{\"samples\": 1}'", "", &["printed no value for \"events\""]),
        (
            "echo '{\"samples\": 1, \"events\": 2, \"costs\": 3}'",
            "",
            &["printed a value for \"costs\", which no table"],
        ),
        (
            ":",
            "",
            &[
                "printed nothing; expected one JSON object, such as { \"events\": 0.5, \"samples\": 0.5 }",
            ],
        ),
    ] {
        let folder = scenario(program, more);
        let ended = lockstep(folder.path()).finish();
        ended.exits_with(4).assert_leaves_nothing();
        for part in parts {
            ended.assert_holds(ended.stderr.contains(part), format!("{part}: {}", ended.stderr));
        }
        let metrics = &ended.summary["metrics"];
        ended.assert_holds(
            metrics == &json!({ "samples": null, "events": null }),
            metrics.to_string(),
        );
        ended.assert_holds(ended.hash().len() == 16, "the other results are there");
    }
}

#[test]
fn null_is_no_value_and_misses_a_bound_with_the_reason() {
    let program = "echo '{\"samples\": null, \"events\": 2}'";
    let folder = scenario(program, "[expect]\nmetrics.samples.max = 1\n");
    let ended = lockstep(folder.path()).finish();
    ended.exits_with(1);
    let reason = &ended.summary["expectations"][0]["reason"];
    ended.assert_holds(reason == "its program gave no value", reason.to_string());
}

#[test]
fn campaign_has_equal_columns_in_process_and_by_processes() {
    let folder = scenario(COUNTS, "");
    let campaign = "name = \"own\"\nscenario = \"own.toml\"\npace = \"lockstep\"\nseeds = 2\n";
    std::fs::write(folder.path().join("campaign.toml"), campaign).unwrap();
    let run_root = RunRoot::new();
    let table = |out: &str, more: &[&str]| {
        let mut sweep = phalanx(["sweep"]);
        sweep.arg(folder.path().join("campaign.toml")).arg("--out").arg(folder.path().join(out));
        sweep.args(more).env("PHALANX_RUN_ROOT", run_root.path()).exits_with(0);
        std::fs::read_to_string(folder.path().join(out).join("runs.csv")).unwrap()
    };
    let (by_processes, in_process) = (table("own", &[]), table("same", &["--in-process"]));
    assert_eq!(by_processes, in_process);
    let header = by_processes.lines().next().unwrap();
    assert!(header.ends_with(",metrics.events,metrics.samples"), "{header}");
    assert!(by_processes.lines().skip(1).all(|line| line.ends_with(",2,11")), "{by_processes}");
}

#[test]
fn hunt_misses_the_bound_of_a_program() {
    // The smallest x of r2, which the hunt varies.
    let program = "cd \"$1\"; awk -F, '$2 == \"r2\" { if (!n++ || $3 < least) least = $3 } \
        END { printf \"{ \\\"samples\\\": %s, \\\"events\\\": 0 }\", least }' samples.csv";
    let folder = scenario(program, "[expect]\nmetrics.samples.min = 0.9\n");
    let (run_root, out) = (RunRoot::new(), folder.path().join("out"));
    let mut hunt = phalanx(["hunt"]);
    hunt.arg(folder.path().join("own.toml")).arg("--out").arg(&out);
    hunt.args(["--runs", "20", "--vary", "starts"]).env("PHALANX_RUN_ROOT", run_root.path());
    let output = hunt.exits_with(1);
    assert!(output.stderr.contains("metrics that programs compute"), "{}", output.stderr);
    let report = std::fs::read_to_string(out.join("hunt.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(
        (&report["expectation"], &report["starts"]),
        (&json!("metrics.samples.min"), &json!(1))
    );
    let replay =
        crate::harness::run_file(&out.join(report["file"].as_str().unwrap())).lockstep().finish();
    replay.exits_with(1);
    assert_eq!(replay.hash(), report["trajectory_hash"].as_str().unwrap());
}
