//! Fuzz tests: no scenario, `--fault` or imported graph makes a parser panic, and a text that is accepted parses to the
//! same scenario again. `PHALANX_TIMES=300` takes minutes.

use std::path::Path;

use formation::random::draw_unit_by_number;

use super::read::{Overrides, read_text};
use super::tests::{TRIANGLE_WITH_HEADED_TABLES, test_catalog, triangle_text};
use crate::check::{Theory, format_report};

const FAULT_ARGUMENTS: [&str; 13] = [
    "kill r2 @10 restart 2",
    "kill r1 @0.5",
    "kill plant @3",
    "freeze r2 @1 for 2",
    "cut r2->r1 @1 for 2",
    "loss r2->r1 of 0.5 burst 3 @1 for 2",
    "delay r2->r1 by 0.01 jitter 0.002 @1 for 2",
    "load of 2 @1 for 2",
    "slow r2 by 0.01 @1",
    "blackout r1 odometry @1 for 2",
    "noise r1 proximity by 0.01 @1",
    "noise r1 odometry by 0 heading 0.1 @1",
    "wheels r1 limit 0.1 @1",
];

/// Tokens of TOML, JSON, GraphML and faults, and some others. `_` is a space, `~` a newline.
const TOKENS: &str = "[ ] [[ ]] { } = \" ' ''' \"\"\" # . : , - -> @ _ ~ \r~ < > /> / &amp; &x; 1e400 -1 0 7 \
    nan inf 1e300 99999999999999999999 9223372036854775808 true null ä \u{0} 𝔘 \u{feff} \\ud800 for \
    restart_2 robot r1 [[edge]]~ [[fault]]~ [[robot]]~ [graph]~ robot_=_[]~ edge_=_3~ name_=_\"r1\"~ \
    graph_=_\"triangle.graphml\"~ {_name_=_\"r2\"_}, \"id\":_7, \"pose\":_3, <node_id=\"x\"> <data_key=\"d0\">";

fn repetition_factor() -> u64 {
    std::env::var("PHALANX_TIMES").map_or(1, |times| times.parse().unwrap())
}

fn read_repository_file(path: &str) -> String {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    std::fs::read_to_string(repository.join(path)).unwrap()
}

/// Returns `original` with a few random changes drawn from `seed`.
fn mutate_text(original: &str, seed: u64) -> String {
    let pieces: Vec<&str> = TOKENS.split(' ').collect();
    let mut drawn = 0;
    let mut below = |bound: usize| {
        drawn += 1;
        (draw_unit_by_number(seed, drawn) * bound as f64) as usize
    };
    let mut text: Vec<char> = original.chars().collect();
    for _ in 0..1 + below(4) {
        let position = below(text.len() + 1);
        let removed = below(6).min(text.len() - position);
        let piece = if below(3) == 0 { "" } else { pieces[below(pieces.len())] };
        text.splice(
            position..position + removed,
            piece.replace('_', " ").replace('~', "\n").chars(),
        );
    }
    text.into_iter().collect()
}

/// Returns whether the text is accepted. Otherwise its diagnostic must render. Neither may panic.
fn is_accepted(path: &Path, text: &str, overrides: &Overrides) -> bool {
    match read_text(path, text, overrides, &test_catalog()) {
        Ok(_) => true,
        Err(diagnostic) => {
            assert!(diagnostic.render(false).starts_with("error: "));
            assert!(diagnostic.render(true).contains("error"));
            false
        }
    }
}

/// Mutations of a valid scenario, and some random texts: each is accepted or rejected. An accepted one can be reported
/// and parses to the same scenario again.
#[test]
fn fuzzed_scenario_never_panics_and_diagnostics_are_printable() {
    let texts = 3000 * repetition_factor();
    let originals = [
        read_repository_file("scenarios/triangle-kill.toml"),
        TRIANGLE_WITH_HEADED_TABLES.to_owned(),
    ];
    let assignments = vec!["robot.r1.pose.x_m=0.1".to_owned()];
    let overrides = [
        Overrides::default(),
        Overrides { assignments, seed: Some(3), ..Overrides::default() },
        Overrides { faults: vec!["kill r3 @1".into()], ..Overrides::default() },
    ];
    let path = Path::new("test.toml");
    let accepted = (0..texts).filter(|&seed| {
        let original = if seed % 10 == 0 { "" } else { originals[(seed % 2) as usize].as_str() };
        let text = mutate_text(original, seed);
        let overrides = &overrides[(seed % 3) as usize];
        if !is_accepted(path, &text, overrides) {
            return false;
        }
        let (scenario, effective, warnings) =
            read_text(path, &text, overrides, &test_catalog()).unwrap();
        assert!(warnings.iter().all(|warning| !warning.render(false).is_empty()));
        assert!(!format_report(&scenario, &Theory::compute(&scenario)).is_empty());
        let again = read_text(path, &effective, &Overrides::default(), &test_catalog()).unwrap().0;
        assert_eq!(again, scenario, "seed {seed}");
        true
    });
    let accepted = accepted.count() as u64;
    assert!(accepted > texts / 30 && accepted < texts, "{accepted} of {texts} were read");
}

#[test]
fn no_fault_on_the_command_line_makes_the_reader_panic() {
    let specs = 4000 * repetition_factor();
    let triangle = triangle_text();
    let accepted = (0..specs).filter(|&seed| {
        let spec =
            mutate_text(FAULT_ARGUMENTS[(seed % FAULT_ARGUMENTS.len() as u64) as usize], seed);
        let overrides = Overrides { faults: vec![spec], ..Overrides::default() };
        is_accepted(Path::new("test.toml"), &triangle, &overrides)
    });
    let accepted = accepted.count() as u64;
    assert!(accepted > specs / 1000 && accepted < specs, "{accepted} of {specs} were read");
}

/// Mutations of valid graphs, in scenarios that are sometimes mutated, too, or have no robots or edges. The effective
/// text of an accepted scenario needs no graph file.
#[test]
fn fuzzed_graph_never_panics_and_round_trips() {
    let texts = 3000 * repetition_factor();
    let graphs = [
        "triangle-edges.json",
        "triangle.graphml",
        "triangle-names.csv",
        "triangle-numbers.json",
        "all-hear-all.graphml",
        "triangle-matrix.csv",
    ];
    let originals = graphs.map(|name| read_repository_file(&format!("tests/graphs/{name}")));
    let inline = triangle_text().replace("pose =", "place_m = [0, 0], pose =");
    let (head, _) = TRIANGLE_WITH_HEADED_TABLES.split_once("[[robot]]").unwrap();
    let (robots, _) = TRIANGLE_WITH_HEADED_TABLES.split_once("[[edge]]").unwrap();
    let heads = [
        head,
        &robots.replace("pose =", "place_m = [0, 0]\npose ="),
        TRIANGLE_WITH_HEADED_TABLES,
        &inline,
    ];
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    let path = folder.path().join("test.toml");
    let mut accepted = 0;
    for seed in 0..texts {
        let index = (seed % 6) as usize;
        let graph = match draw_unit_by_number(seed, 100) < 0.3 {
            true => originals[index].clone(),
            false => mutate_text(&originals[index], seed),
        };
        std::fs::write(folder.path().join(graphs[index]), graph).unwrap();
        let head = heads[(draw_unit_by_number(seed, 101) * 4.0) as usize];
        let text = format!("graph = \"{}\" # g\n{head}", graphs[index]);
        let text =
            if draw_unit_by_number(seed, 102) < 0.3 { mutate_text(&text, !seed) } else { text };
        let overrides = Overrides { seed: (seed % 5 == 0).then_some(7), ..Overrides::default() };
        if is_accepted(&path, &text, &overrides) {
            accepted += 1;
            let (scenario, effective, _) =
                read_text(&path, &text, &overrides, &test_catalog()).unwrap();
            let other_path = Path::new("/nowhere/test.toml");
            let again = read_text(other_path, &effective, &Overrides::default(), &test_catalog());
            let (again, same_text, _) = again.unwrap();
            assert_eq!((again, same_text), (scenario, effective), "seed {seed}");
        }
    }
    assert!(accepted > texts / 30 && accepted < texts, "{accepted} of {texts} were read");
}
