//! Hints in messages: every suggested command works, and every listed item exists.

use std::path::Path;

use crate::harness::{ExitsWith as _, ROOT, phalanx, run};
use crate::programs::{run as run_own, scenario, script};

/// Scenario that is no template of `phalanx new`: its graph file alone would make the program larger by 180 KB.
const NO_TEMPLATE: &str = "thousand";

/// Returns the names of all shipped scenarios that are templates.
fn shipped() -> Vec<String> {
    let files = std::fs::read_dir(Path::new(ROOT).join("scenarios")).unwrap();
    let paths = files.map(|file| file.unwrap().path());
    let scenarios = paths.filter(|path| path.extension().is_some_and(|end| end == "toml"));
    let names = scenarios.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned());
    names.filter(|name| name != NO_TEMPLATE).collect()
}

#[test]
fn new_folder_can_start_from_any_shipped_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let names = shipped();
    assert!(names.len() > 20);
    for name in names {
        let new = format!("my-{name}");
        phalanx(["new", &new, "--from", &name]).current_dir(folder.path()).exits_with(0);
        let path = folder.path().join(&new).join("scenario.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let shipped = std::fs::read_to_string(format!("{ROOT}/scenarios/{name}.toml")).unwrap();
        let renamed =
            shipped.replace(&format!("\nname = \"{name}\"\n"), &format!("\nname = \"{new}\"\n"));
        assert!(text.ends_with(&renamed[renamed.find("\nname").unwrap()..]), "{text}");
        phalanx(["check", path.to_str().unwrap()]).exits_with(0);
    }
    let output = phalanx(["new", "x", "--from", "ring"]).exits_with(2).stderr;
    assert!(output.contains("ring-6"), "{output}");
}

#[test]
fn velocity_feedback_in_a_ring_is_reported_with_the_fix() {
    let tanh = ["robot_defaults.law=formation-tanh", "robot_defaults.k_f_m_s=0.1"];
    let mut check = phalanx(["check", "scenarios/ring-6.toml"]);
    check.args(tanh.iter().flat_map(|set| ["--set", set]));
    let output = check.exits_with(3).stderr;
    for expected in [
        "`law = \"formation-unit\"` and `speed_m_s = 0.1` in place",
        "phalanx new NAME --from ring-6",
    ] {
        assert!(output.contains(expected), "{output}");
    }
    // The settings that the hint suggests.
    let fix = ["robot_defaults.law=formation-unit", "robot_defaults.speed_m_s=0.1"];
    check.args(fix.iter().flat_map(|set| ["--set", set])).exits_with(0);
}

#[test]
fn late_fault_and_key_given_as_option_name_the_remedy() {
    let arguments = ["check", "scenarios/triangle-kill.toml", "--set", "duration_s=5"];
    let output = phalanx(arguments).exits_with(3).stderr;
    assert!(output.contains("`--set fault=[]`"), "{output}");
    phalanx(arguments).args(["--set", "fault=[]", "--set", "expect={}"]).exits_with(0);
    for (option, key) in [
        (&["--duration", "5"][..], "duration_s=5"),
        (&["--period-s=0.01"], "period_s=0.01"),
        (&["--v_max", "0.2"], "avoidance.speed_max_m_s=0.2"),
        (&["--dt"], "period_s=VALUE"),
    ] {
        let output = phalanx(["run", "scenarios/triangle.toml"]).args(option).exits_with(2).stderr;
        let expected = format!("tip: to set a scenario key, use '--set {key}'");
        assert!(output.contains(&expected), "{output}");
        let check = ["check", "scenarios/triangle.toml", "--set", key, "--set", "expect={}"];
        phalanx(check).exits_with(if key.contains("VALUE") { 3 } else { 0 });
    }
    let arguments = ["check", "scenarios/triangle.toml", "--set", "duration_s=5"];
    let output = phalanx(arguments).exits_with(3).stderr;
    assert!(output.contains("`--set expect={}`"), "{output}");
    // An unknown option that is no key gets no such hint.
    let output = phalanx(["run", "scenarios/triangle.toml", "--flurb"]).exits_with(2).stderr;
    assert!(!output.contains("--set"), "{output}");
}

#[test]
fn completions_match_default_binary_and_help_its_verbs() {
    for shell in ["bash", "zsh", "fish"] {
        let text = phalanx(["completions", shell]).exits_with(0).stdout;
        assert!(["sweep", "pace", "completions"].iter().all(|word| text.contains(word)));
    }
    let help = phalanx(["--help"]).exits_with(0).stdout;
    let lists_verb = |verb: &str| help.contains(&format!("\n  {verb} "));
    assert!(lists_verb("run") && lists_verb("completions") && !lists_verb("bench"), "{help}");
    assert_eq!(lists_verb("fleet"), cfg!(feature = "bridge"), "{help}");
}

#[test]
fn python_without_the_package_is_reported() {
    let failing_script = "echo \"ModuleNotFoundError: No module named 'phalanx'\" >&2; exit 1";
    // A law, and a plant.
    for (law, plant) in [("own.sh", "follow.sh"), ("follow.sh", "own.sh")] {
        let plant = format!("[plant]\nprogram = [\"./{plant}\"]\n");
        let folder = scenario(&format!("[\"./{law}\"]"), &plant);
        script(folder.path(), "own.sh", failing_script);
        script(folder.path(), "follow.sh", "sleep 100");
        let ended = run_own(folder.path()).lockstep().finish();
        ended.exits_with(4).assert_leaves_nothing();
        ended.assert_holds(
            ended.stderr.contains("activate the virtual environment"),
            "the remedy is reported",
        );
    }
}

#[test]
fn samples_have_front_points_and_their_distances() {
    let ended = run("triangle").lockstep().set("record_hz=1000").finish();
    let text = ended.file("samples.csv");
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let column = |name| rows[0].iter().position(|head| *head == name).expect(name);
    let at = |row: &Vec<&str>, name| row[column(name)].parse::<f64>().unwrap();
    let mut nearest_m = f64::INFINITY;
    for instant in rows[1..].chunks(3) {
        let fronts: Vec<[f64; 2]> = instant
            .iter()
            .map(|row| {
                let (sin, cos) = at(row, "heading_rad").sin_cos();
                let front = [at(row, "front_x_m"), at(row, "front_y_m")];
                let deviation = [
                    front[0] - at(row, "x_m") - 0.045 * cos,
                    front[1] - at(row, "y_m") - 0.045 * sin,
                ];
                assert!(deviation[0].hypot(deviation[1]) < 1e-12, "{row:?}");
                front
            })
            .collect();
        for [a, b] in [[0, 1], [0, 2], [1, 2]] {
            let distance_m = (fronts[a][0] - fronts[b][0]).hypot(fronts[a][1] - fronts[b][1]);
            nearest_m = nearest_m.min(distance_m);
        }
    }
    // The summary uses every tick and the table at most every fifth: the table's minimum is not lower, and at most
    // slightly higher.
    let min_distance_m = ended.number("/min_distance_m");
    ended.assert_holds(
        (0.0..1e-3).contains(&(nearest_m - min_distance_m + 1e-12)),
        format!("{nearest_m}"),
    );
}

#[test]
fn reference_marks_required_keys_and_has_the_checker_bounds() {
    let page = phalanx(["schema", "--markdown"]).exits_with(0).stdout;
    let section = |name: &str| {
        let (_, rest) = page.split_once(&format!("\n## `{name}`\n")).expect(name);
        rest.split("\n## ").next().unwrap().to_owned()
    };
    let row = |section_name: &str, key: &str| {
        let section = section(section_name);
        let row = section.lines().find(|line| line.starts_with(&format!("| `{key}` |")));
        row.unwrap_or_else(|| panic!("{section_name} {key}")).to_owned()
    };
    for (section_name, key, expected) in [
        ("fault", "at_s", "| **needed** | 0 to less than `duration_s` |"),
        ("fault", "probability", "| needed by some kinds, see below | above 0, to 1 |"),
        ("fault", "hosts", "| needed by some kinds, see below |"),
        ("pose", "heading_rad", "| **needed** | -2π to 2π |"),
        ("robot", "law", "| needed in `robot` or in `robot_defaults` |"),
        ("silence", "lost_after_s", "| `stale_after_s` to 1e7 |"),
    ] {
        let found = row(section_name, key);
        assert!(found.contains(expected), "{found}");
    }
    for (heading_rad, code) in [("-6.28", 0), ("6.28", 0), ("6.29", 3)] {
        let set = format!("robot.r1.pose.heading_rad={heading_rad}");
        phalanx(["check", "scenarios/triangle.toml", "--set", &set]).exits_with(code);
    }
}

#[test]
fn broken_and_ideal_formation_are_explained_where_shown() {
    let ended = run("triangle-kill").lockstep().drawing().finish();
    ended.exits_with(0);
    let broken = "a robot is broken if, when the fault ends (a permanent one: at the end of the run), it is more than \
                  0.01 m from its slot in the planned formation";
    let ideal = "Distances from the slots that the whole planned graph gives the robots";
    let page = ended.file("report.html");
    let on_screen = ended.stdout.contains(broken) && ended.stdout.contains("ideal errors, m");
    ended.assert_holds(on_screen, "the screen explains it");
    ended.assert_holds(page.contains(broken) && page.contains(ideal), "the page explains it");
}

#[test]
fn properties_that_survive_any_single_death_are_spelled_out() {
    let text = phalanx(["check", "scenarios/antipodal-8.toml"]).exits_with(0).stdout;
    let expected =
        "after the permanent failure of any robot, all others keep their leader and their slots";
    assert!(text.contains(expected), "{text}");
}
