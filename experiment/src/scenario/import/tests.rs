//! Graphs of other tools: what they mean, where their mistakes are shown, and that nothing in
//! them makes the reader panic. The files in `tests/graphs` were written by networkx, numpy and
//! pandas.

use std::path::{Path, PathBuf};

use proptest::prelude::*;
use protocol::law::{LawDescription, Role};

use crate::scenario::Scenario;
use crate::scenario::diagnostic::Diagnostic;
use crate::scenario::read::{Overrides, read, read_text};
use crate::scenario::tests::catalog_of;

const LAWS: &[LawDescription] = &[
    LawDescription {
        role: Role::FORMATION,
        name: "formation-unit",
        source: "(18)",
        gains: &["speed_m_s"],
        feed_forward: false,
        correction_max: None,
    },
    LawDescription {
        role: Role::CONTAINED,
        name: "mean",
        source: "(47)",
        gains: &[],
        feed_forward: false,
        correction_max: None,
    },
];

const HEAD: &str = "name = \"t\"\nduration_s = 1.0\nperiod_s = 0.005\n\
    avoidance = { distance_min_m = 0.2, speed_max_m_s = 0.3 }\n\
    robot_defaults = { front_point_m = 0.045, law = \"formation-unit\", speed_m_s = 0.1 }\n";

const ROBOTS: &str = "robot = [\n\
    { name = \"r1\", pose = { x_m = -0.045, y_m = -0.35, heading_rad = 0.0 } }, # first\n\
    { name = \"r2\", pose = { x_m = 0.4, y_m = 0.205, heading_rad = 1.5707963267948966 } },\n\
    { name = \"r3\", pose = { x_m = -0.4, y_m = 0.295, heading_rad = -1.5707963267948966 } },\n]\n";

/// The chapter's triangle: r1 hears r2, r2 hears r3, r3 hears r1.
const EDGES: &str = "edge = [\n\
    { from = \"r2\", to = \"r1\", offset_m = [0.15, 0.2598076211353316] },\n\
    { from = \"r3\", to = \"r2\", offset_m = [-0.3, 0.0] },\n\
    { from = \"r1\", to = \"r3\", offset_m = [0.15, -0.2598076211353316] },\n]\n";

fn graphs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/graphs")
}

/// A scenario beside the graphs.
fn parse_with(
    text: &str,
    overrides: &Overrides,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    read_text(&graphs().join("test.toml"), text, overrides, &catalog_of(LAWS))
}

fn parse(text: &str) -> (Scenario, String) {
    let (scenario, text, warnings) = parse_with(text, &Overrides::default())
        .unwrap_or_else(|error| panic!("{}\n{text}", error.render(false)));
    assert_eq!(warnings, []);
    (scenario, text)
}

/// Edges in an order that all formats can be held against.
fn edges(scenario: &Scenario) -> Vec<(usize, usize, [f64; 2])> {
    let mut edges: Vec<_> =
        scenario.graph.edges().iter().map(|e| (e.from, e.to, e.offset_m.into())).collect();
    edges.sort_by_key(|&(from, to, _)| (from, to));
    edges
}

/// The effective text is whole: it is read without any graph, to the same scenario and text.
fn reads_again(scenario: &Scenario, text: &str) {
    let elsewhere = Path::new("/nowhere/scenario.toml");
    let (again, same, _) = read_text(elsewhere, text, &Overrides::default(), &catalog_of(LAWS))
        .unwrap_or_else(|error| panic!("{}\n{text}", error.render(false)));
    assert_eq!((&again, same.as_str()), (scenario, text));
}

#[test]
fn node_link_json_and_graphml_with_poses_and_offsets_are_the_inline_scenario() {
    let (inline, _) = parse(&format!("{HEAD}{ROBOTS}{EDGES}"));
    for file in ["triangle-edges.json", "triangle-links.json", "triangle.graphml"] {
        let (imported, text) = parse(&format!("{HEAD}graph = \"{file}\" # whose?\n"));
        assert_eq!(imported.robots, inline.robots, "{file}");
        assert_eq!(edges(&imported), edges(&inline), "{file}");
        assert!(text.contains("# whose?"));
        reads_again(&imported, &text);
    }
}

#[test]
fn places_give_the_offsets_of_graphs_that_have_none() {
    let placed = ROBOTS
        .replace("name = \"r1\"", "name = \"r1\", place_m = [0.0, 0.0]")
        .replace("name = \"r2\"", "name = \"r2\", place_m = [-0.25, -0.5]")
        .replace("name = \"r3\"", "name = \"r3\", place_m = [0.25, -0.5]");
    for file in [
        "triangle-numbers.json",
        "triangle-numbers.graphml",
        "triangle-matrix.csv",
        "triangle-names.csv",
    ] {
        let (imported, text) = parse(&format!("{HEAD}graph = \"{file}\"\n{placed}"));
        let expected = [(0, 2, [0.25, -0.5]), (1, 0, [0.25, 0.5]), (2, 1, [-0.5, 0.0])];
        assert_eq!(edges(&imported), expected, "{file}");
        reads_again(&imported, &text);
    }
}

#[test]
fn an_edge_without_a_direction_is_heard_at_both_ends() {
    let placed = ROBOTS.replace("pose =", "place_m = [0.0, 0.0], pose =");
    let placed =
        placed.replacen("[0.0, 0.0]", "[0.5, 0.5]", 1).replacen("[0.0, 0.0]", "[0.0, 1.0]", 1);
    for file in ["all-hear-all.json", "all-hear-all.graphml"] {
        let (imported, text) = parse(&format!("{HEAD}graph = \"{file}\"\n{placed}"));
        let expected = [
            (0, 1, [-0.5, 0.5]),
            (0, 2, [-0.5, -0.5]),
            (1, 0, [0.5, -0.5]),
            (1, 2, [0.0, -1.0]),
            (2, 0, [0.5, 0.5]),
            (2, 1, [0.0, 1.0]),
        ];
        assert_eq!(edges(&imported), expected, "{file}");
        reads_again(&imported, &text);
    }
}

#[test]
fn a_robots_own_keys_win_over_what_its_node_says() {
    let headed = "[[robot]]\nname = \"r2\" # the second\nspeed_m_s = 0.25\n\
        pose = { x_m = 2.0, y_m = 2.0, heading_rad = 0.0 }\n[[robot]]\nname = \"r1\"";
    let (imported, text) = parse(&format!("{HEAD}graph = \"triangle.graphml\"\n{headed}"));
    let names: Vec<&str> = imported.robots.iter().map(|robot| robot.name.as_str()).collect();
    assert_eq!(names, ["r2", "r1", "r3"]);
    assert_eq!(imported.robots[0].start.x_m, 2.0);
    assert_eq!(imported.robots[0].gains["speed_m_s"], 0.25);
    assert_eq!(imported.robots[1].start.x_m, -0.045);
    assert_eq!(imported.robots[1].gains["speed_m_s"], 0.1);
    assert!(text.contains("# the second"));
    reads_again(&imported, &text);
}

#[test]
fn edges_of_the_graph_stand_beside_those_of_the_scenario() {
    let hears = "robot = [{ name = \"r3\", hears = [\"r2\"], place_m = [0.0, 0.0], \
        pose = { x_m = 5.0, y_m = 0.0, heading_rad = 0.0 } }, \
        { name = \"r2\", place_m = [-0.3, 0.0] }]\nedge = [ ]\n";
    let (imported, text) = parse(&format!("{HEAD}graph = \"triangle-edges.json\"\n{hears}"));
    assert_eq!(imported.graph.edges().len(), 4);
    reads_again(&imported, &text);
    let (imported, text) = parse(&format!(
        "{HEAD}graph = \"triangle-edges.json\"\n[[edge]]\nfrom = \"r1\"\nto = \"r2\"\n\
         offset_m = [-0.15, -0.2598076211353316]"
    ));
    assert_eq!(imported.graph.edges().len(), 4);
    assert_eq!(imported.graph.edges()[0].to, 1);
    reads_again(&imported, &text);
}

#[test]
fn arguments_change_imported_robots_and_name_another_graph() {
    let overrides = Overrides {
        set: ["robot.r2.speed_m_s=0.25".into(), "graph=triangle.graphml".into()].into(),
        faults: vec!["kill r3 @0.5".into()],
        seed: Some(3),
    };
    for before in ["", "graph = \"no-such.json\"\n"] {
        let (imported, text, _) = parse_with(&format!("{HEAD}{before}"), &overrides)
            .unwrap_or_else(|error| panic!("{}", error.render(false)));
        assert_eq!(imported.robots[1].gains["speed_m_s"], 0.25);
        assert_eq!((imported.robots.len(), imported.faults.len(), imported.seed), (3, 1, 3));
        reads_again(&imported, &text);
    }
}

#[test]
fn numbers_count_robots_from_0_or_from_1_and_make_r1_r2_where_there_are_none() {
    let folder = tempfile::tempdir().unwrap();
    let read_graph = |nodes: [i64; 2]| {
        let node = |id: i64, law: &str| {
            format!(
                "{{\"id\": {id}, \"x_m\": {id}, \"y_m\": 0, \"heading_rad\": 0, \"law\": {law}}}"
            )
        };
        let json = format!(
            "{{\"directed\": true, \"nodes\": [{}, {}], \"edges\": [{{\"source\": {}, \"target\": {}}}]}}",
            node(nodes[0], "\"formation-unit\", \"speed_m_s\": 1"),
            node(nodes[1], "\"mean\""),
            nodes[0],
            nodes[1]
        );
        std::fs::write(folder.path().join("g.json"), json).unwrap();
        let path = folder.path().join("s.toml");
        let scenario = format!("{HEAD}graph = \"g.json\"\n");
        read_text(&path, &scenario, &Overrides::default(), &catalog_of(LAWS))
            .map(|(scenario, _, _)| scenario)
    };
    for (nodes, first) in [([0, 1], "r1"), ([1, 2], "r1"), ([2, 1], "r2")] {
        let scenario = read_graph(nodes).unwrap();
        assert_eq!(scenario.robots[0].name, first, "{nodes:?}");
        assert_eq!(scenario.robots[0].start.x_m, nodes[0] as f64);
        assert_eq!(edges(&scenario), [(0, 1, [0.0, 0.0])]);
    }
    for nodes in [[0, 2], [2, 3], [-1, 0], [i64::MIN, i64::MAX]] {
        let error = read_graph(nodes).unwrap_err();
        assert!(error.expected.contains("from 0 to 1, or from 1 to 2"), "{}", error.render(false));
    }
}

#[test]
fn a_mistake_in_the_graph_is_shown_in_its_file_and_one_in_the_scenario_in_the_scenario() {
    let error = parse_with(
        &format!(
            "{HEAD}graph = \"triangle-edges.json\"\nedge = [\n{{ from = \"r2\", to = \"r1\" }}]"
        ),
        &Overrides::default(),
    );
    // The scenario's own edge comes first and has neither an offset nor places.
    let rendered = error.unwrap_err().render(false);
    assert!(rendered.contains("test.toml:8:1\n"), "{rendered}");
    let error = parse_with(
        &format!(
            "{HEAD}graph = \"triangle-edges.json\"\nedge = [\n{{ from = \"r2\", to = \"r1\", offset_m = [0.15, 0.2598076211353316] }}]"
        ),
        &Overrides::default(),
    );
    let rendered = error.unwrap_err().render(false);
    assert!(rendered.contains("triangle-edges.json:40:3\n"), "{rendered}");
    assert!(rendered.contains("repeats edge 1"), "{rendered}");
    // What comes behind the imported robots keeps its line.
    let error = parse_with(
        &format!("{HEAD}graph = \"triangle-edges.json\"\n[expect]\nexit = 256\n"),
        &Overrides::default(),
    );
    let rendered = error.unwrap_err().render(false);
    assert!(rendered.contains("test.toml:8:8\n"), "{rendered}");
}

#[test]
fn an_attribute_without_a_meaning_is_left_out_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let json = std::fs::read_to_string(graphs().join("triangle-edges.json")).unwrap();
    let json = json.replace("\"id\":", "\"color\": \"red\", \"pos\": [0, 1], \"id\":");
    std::fs::write(folder.path().join("g.json"), json).unwrap();
    std::fs::write(folder.path().join("s.toml"), format!("{HEAD}graph = \"g.json\"\n")).unwrap();
    let (_, _, warnings) =
        read(&folder.path().join("s.toml"), &Overrides::default(), &catalog_of(LAWS)).unwrap();
    let messages: Vec<&str> = warnings.iter().map(|warning| warning.message.as_str()).collect();
    assert_eq!(messages.len(), 2, "{messages:?}");
    assert!(messages[0].contains("`color`") && messages[1].contains("`pos`"));
}

#[test]
fn a_file_that_nests_without_end_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let deep = 200_000;
    for (file, text) in [
        ("a.json", "[".repeat(deep)),
        ("b.json", "{\"nodes\":".repeat(deep)),
        (
            "c.json",
            format!(
                "{{\"directed\": true, \"nodes\": [{{\"id\": \"a\", \"pose\": {}1{}}}], \"edges\": []}}",
                "[".repeat(deep),
                "]".repeat(deep)
            ),
        ),
        ("d.graphml", "<graphml>".repeat(deep)),
        ("e.graphml", format!("{}{}", "<graphml>".repeat(deep), "</graphml>".repeat(deep))),
    ] {
        std::fs::write(folder.path().join(file), text).unwrap();
        let scenario = format!("{HEAD}graph = \"{file}\"\n");
        let path = folder.path().join("s.toml");
        let error =
            read_text(&path, &scenario, &Overrides::default(), &catalog_of(LAWS)).unwrap_err();
        assert!(error.render(false).contains(file), "{}", error.message);
    }
}

/// One change to a text: where, how much of it goes, and what comes instead.
type Change = (prop::sample::Index, usize, String);

fn changes() -> impl Strategy<Value = Vec<Change>> {
    let pieces = prop::sample::select(vec![
        "",
        "{",
        "}",
        "[",
        "]",
        "\"",
        ":",
        ",",
        "\n",
        "null",
        "true",
        "-1",
        "1e999",
        "0",
        "r1",
        "#",
        "<",
        ">",
        "/>",
        "<node id=\"x\">",
        "<data key=\"d0\">",
        "&amp;",
        "&x;",
        "\u{feff}",
        "ä",
        "\u{0}",
        "'''",
        "\"id\": 7, ",
        "\"pose\": 3, ",
        "\\ud800",
        "9223372036854775808",
    ]);
    let piece = prop_oneof![3 => pieces.prop_map(str::to_owned), 1 => ".{0,6}"];
    prop::collection::vec((any::<prop::sample::Index>(), 0..12usize, piece), 0..5)
}

fn mutated(text: &str, changes: &[Change]) -> String {
    let mut text: Vec<char> = text.chars().collect();
    for (at, cut, piece) in changes {
        let at = at.index(text.len() + 1);
        let cut = (*cut).min(text.len() - at);
        text.splice(at..at + cut, piece.chars());
    }
    text.into_iter().collect()
}

fn changes_of_toml() -> impl Strategy<Value = Vec<Change>> {
    let pieces = prop::sample::select(vec![
        "",
        "{",
        "}",
        "[",
        "]",
        "[[",
        "\"",
        ",",
        "=",
        "\n",
        "\r\n",
        "#",
        "\"\"\"",
        "'",
        ".",
        "ä",
        "graph",
        "graph = \"triangle.graphml\"\n",
        "[graph]\n",
        "robot = []\n",
        "[[robot]]\n",
        "[[edge]]\n",
        "edge = 3\n",
        "name = \"r1\"\n",
        "{ name = \"r2\" },",
        "\u{feff}",
    ]);
    let piece = pieces.prop_map(str::to_owned);
    prop::collection::vec((any::<prop::sample::Index>(), 0..8usize, piece), 0..4)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn no_graph_makes_the_reader_panic_and_what_is_read_reads_again(
        changes in changes(), noise in any::<bool>(), bytes in ".{0,60}",
    ) {
        let folder = tempfile::tempdir().unwrap();
        for file in [
            "triangle-edges.json", "triangle-numbers.json", "triangle.graphml",
            "all-hear-all.graphml", "triangle-matrix.csv", "triangle-names.csv",
        ] {
            let whole = std::fs::read_to_string(graphs().join(file)).unwrap();
            let text = if noise && changes.is_empty() { &bytes } else { &whole };
            let text = mutated(text, &changes);
            std::fs::write(folder.path().join(file), text).unwrap();
            let placed = ROBOTS.replace("pose =", "law = \"mean\", pose =");
            for robots in ["", &placed] {
                let scenario = format!("{HEAD}graph = \"{file}\"\n{robots}");
                let path = folder.path().join("s.toml");
                match read_text(&path, &scenario, &Overrides::default(), &catalog_of(LAWS)) {
                    Ok((scenario, effective, warnings)) => {
                        prop_assert!(warnings.iter().all(|w| !w.render(false).is_empty()));
                        reads_again(&scenario, &effective);
                    }
                    Err(error) => prop_assert!(error.render(false).starts_with("error: ")),
                }
            }
        }
    }

    #[test]
    fn no_scenario_around_a_graph_makes_the_reader_panic_and_what_is_read_reads_again(
        form in 0..4usize, file in 0..3usize, changes in changes_of_toml(), seed in any::<bool>(),
    ) {
        let file = ["triangle.graphml", "triangle-edges.json", "triangle-names.csv"][file];
        let tables = [
            "robot = [{ name = \"r3\", pose = { x_m = 5, y_m = 0, heading_rad = 0 } }, # c\n]\n\
             edge = [] # e\n",
            "[[robot]]\nname = \"r3\" # c\n[robot.pose]\nx_m = 5\ny_m = 0\nheading_rad = 0\n\
             [[edge]]\nfrom = \"r1\"\nto = \"r2\"\noffset_m = [-0.15, -0.2598076211353316]",
            "robot = [{ name = \"r1\" }, { name = \"r2\", hears = [\"r1\"], place_m = [0, 0] }]",
            "[expect]\nmin_distance_m = 0.1\n",
        ][form];
        let text = mutated(&format!("{HEAD}graph = \"{file}\" # g\n{tables}"), &changes);
        let overrides = Overrides { seed: seed.then_some(7), ..Overrides::default() };
        match parse_with(&text, &overrides) {
            Ok((scenario, effective, _)) => reads_again(&scenario, &effective),
            Err(error) => prop_assert!(error.render(false).starts_with("error: ")),
        }
    }
}
