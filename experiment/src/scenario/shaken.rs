//! Texts by the thousand, or by the million: that no scenario, no `--fault` and no imported graph
//! makes a reader panic. The short form for graphs is with the other tests of imports.

use std::path::{Path, PathBuf};

use formation::random::draw;

use super::read::{Overrides, read_text};
use super::tests::catalog;
use crate::check::{Theory, report};

const SPECS: [&str; 13] = [
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

const PIECES: [&str; 40] = [
    "[",
    "]",
    "[[",
    "]]",
    "{",
    "}",
    "=",
    "\"",
    "'",
    "\n",
    "\r\n",
    "#",
    ".",
    ",",
    "-",
    "->",
    "@",
    " ",
    "1e400",
    "-1",
    "0",
    "nan",
    "inf",
    "1e300",
    "99999999999999999999",
    "true",
    "ä",
    "\u{0}",
    "𝔘",
    "\u{feff}",
    "<",
    ">",
    "/",
    "&amp;",
    "for",
    "restart 2",
    "[[edge]]\n",
    "[[fault]]\n",
    "null",
    "robot",
];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn file(path: &str) -> String {
    std::fs::read_to_string(repository().join(path)).unwrap()
}

/// `original` with a few changes that `seed` draws.
fn mutated(original: &str, seed: u64) -> String {
    let mut drawn = 0;
    let mut below = |bound: usize| {
        drawn += 1;
        (draw(seed, drawn) * bound as f64) as usize
    };
    let mut text: Vec<char> = original.chars().collect();
    for _ in 0..1 + below(4) {
        let at = below(text.len() + 1);
        let cut = below(6).min(text.len() - at);
        let piece = if below(3) == 0 { "" } else { PIECES[below(PIECES.len())] };
        text.splice(at..at + cut, piece.chars());
    }
    text.into_iter().collect()
}

/// Whether this is read; if not, its diagnostic can be shown. Neither panics.
fn is_read(path: &Path, text: &str, overrides: &Overrides) -> bool {
    match read_text(path, text, overrides, &catalog()) {
        Ok(_) => true,
        Err(diagnostic) => {
            assert!(diagnostic.render(false).starts_with("error: "));
            assert!(diagnostic.render(true).contains("error"));
            false
        }
    }
}

/// Scenarios near a sound one, and some from nothing: read or refused, and what is read can be
/// reported and is the same when it is read again.
fn no_scenario_makes_the_reader_panic(texts: u64) {
    let originals = [file("scenarios/triangle.toml"), file("scenarios/triangle-kill.toml")];
    let set = vec!["robot.r1.pose.x_m=0.1".to_owned()];
    let overrides = [
        Overrides::default(),
        Overrides { set, seed: Some(3), ..Overrides::default() },
        Overrides { faults: vec!["kill r3 @1".into()], ..Overrides::default() },
    ];
    let path = Path::new("test.toml");
    let read = (0..texts).filter(|&seed| {
        let original = if seed % 10 == 0 { "" } else { originals[(seed % 2) as usize].as_str() };
        let text = mutated(original, seed);
        let overrides = &overrides[(seed % 3) as usize];
        if !is_read(path, &text, overrides) {
            return false;
        }
        let (scenario, effective, warnings) =
            read_text(path, &text, overrides, &catalog()).unwrap();
        assert!(warnings.iter().all(|warning| !warning.render(false).is_empty()));
        assert!(!report(&scenario, &Theory::of(&scenario)).is_empty());
        let again = read_text(path, &effective, &Overrides::default(), &catalog()).unwrap().0;
        assert_eq!(again, scenario, "seed {seed}");
        true
    });
    let read = read.count() as u64;
    assert!(read > texts / 30 && read < texts, "{read} of {texts} were read");
}

#[test]
fn no_scenario_makes_the_reader_panic_and_every_diagnostic_can_be_shown() {
    no_scenario_makes_the_reader_panic(3000);
}

#[test]
#[ignore = "minutes; a million scenarios"]
fn no_scenario_of_a_million_makes_the_reader_panic() {
    no_scenario_makes_the_reader_panic(1_000_000);
}

fn no_fault_makes_the_reader_panic(specs: u64) {
    let triangle = file("scenarios/triangle.toml");
    let read = (0..specs).filter(|&seed| {
        let spec = mutated(SPECS[(seed % SPECS.len() as u64) as usize], seed);
        let overrides = Overrides { faults: vec![spec], ..Overrides::default() };
        is_read(Path::new("test.toml"), &triangle, &overrides)
    });
    let read = read.count() as u64;
    assert!(read > specs / 1000 && read < specs, "{read} of {specs} were read");
}

#[test]
fn no_fault_on_the_command_line_makes_the_reader_panic() {
    no_fault_makes_the_reader_panic(4000);
}

#[test]
#[ignore = "minutes; a million faults"]
fn no_fault_of_a_million_makes_the_reader_panic() {
    no_fault_makes_the_reader_panic(1_000_000);
}

#[test]
#[ignore = "minutes; half a million graphs"]
fn no_graph_of_half_a_million_makes_the_reader_panic() {
    let graphs = ["triangle-edges.json", "triangle-names.csv", "triangle.graphml"];
    let texts = graphs.map(|graph| file(&format!("tests/graphs/{graph}")));
    let triangle = file("scenarios/triangle.toml");
    let (head, robots) = triangle.split_once("robot = [").unwrap();
    let (_, tail) = robots.split_once("\n]\n").unwrap();
    let folder = tempfile::tempdir_in("/dev/shm").unwrap();
    for seed in 0..500_000 {
        let which = (seed % 3) as usize;
        std::fs::write(folder.path().join(graphs[which]), mutated(&texts[which], seed)).unwrap();
        let scenario = format!("graph = \"{}\"\n{head}{tail}", graphs[which]);
        is_read(&folder.path().join("test.toml"), &scenario, &Overrides::default());
    }
}
