//! Tests of imported graphs. Locations of their errors are tested in `tests/bad`, robustness against arbitrary bytes in
//! `fuzz`. The files in `tests/graphs` were written by networkx, numpy and pandas.

use std::path::{Path, PathBuf};

use crate::scenario::Scenario;
use crate::scenario::read::{Overrides, ReadResult, read_text};
use crate::scenario::tests::test_catalog;

const SCENARIO_HEAD: &str = "name = \"t\"\nduration_s = 1.0\nperiod_s = 0.005\n\
    avoidance = { distance_min_m = 0.2, speed_max_m_s = 0.3 }\n\
    robot_defaults = { front_point_m = 0.045, law = \"formation-unit\", speed_m_s = 0.1 }\n";

const ROBOTS_TOML: &str = "robot = [\n\
    { name = \"r1\", pose = { x_m = -0.045, y_m = -0.35, heading_rad = 0.0 } }, # first\n\
    { name = \"r2\", pose = { x_m = 0.4, y_m = 0.205, heading_rad = 1.5707963267948966 } },\n\
    { name = \"r3\", pose = { x_m = -0.4, y_m = 0.295, heading_rad = -1.5707963267948966 } },\n]\n";

/// The chapter's triangle: r1 receives from r2, r2 from r3, r3 from r1.
const EDGES_TOML: &str = "edge = [\n\
    { from = \"r2\", to = \"r1\", offset_m = [0.15, 0.2598076211353316] },\n\
    { from = \"r3\", to = \"r2\", offset_m = [-0.3, 0.0] },\n\
    { from = \"r1\", to = \"r3\", offset_m = [0.15, -0.2598076211353316] },\n]\n";

fn graphs_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/graphs")
}

/// Returns a scenario that imports the graphs.
fn parse_with_overrides(text: &str, overrides: &Overrides) -> ReadResult {
    read_text(&graphs_dir().join("test.toml"), text, overrides, &test_catalog())
}

fn parse(text: &str) -> (Scenario, String) {
    let (scenario, text, warnings) = parse_with_overrides(text, &Overrides::default())
        .unwrap_or_else(|error| panic!("{}\n{text}", error.render(false)));
    assert_eq!(warnings, []);
    (scenario, text)
}

/// Returns the edges in an order that is comparable between formats.
fn edges(scenario: &Scenario) -> Vec<(usize, usize, [f64; 2])> {
    let mut edges: Vec<_> =
        scenario.graph.edges().iter().map(|e| (e.from, e.to, e.offset_m.into())).collect();
    edges.sort_by_key(|&(from, to, _)| (from, to));
    edges
}

/// Checks that the effective text needs no graph file and parses to the same scenario and text.
fn assert_effective_text_parses(scenario: &Scenario, text: &str) {
    let other_path = Path::new("/nowhere/scenario.toml");
    let (again, same, _) = read_text(other_path, text, &Overrides::default(), &test_catalog())
        .unwrap_or_else(|error| panic!("{}\n{text}", error.render(false)));
    assert_eq!((&again, same.as_str()), (scenario, text));
}

#[test]
fn imported_graph_with_poses_equals_the_inline_scenario() {
    let (inline, _) = parse(&format!("{SCENARIO_HEAD}{ROBOTS_TOML}{EDGES_TOML}"));
    for file in ["triangle-edges.json", "triangle-links.json", "triangle.graphml"] {
        let (imported, text) = parse(&format!("{SCENARIO_HEAD}graph = \"{file}\" # whose?\n"));
        assert_eq!(imported.robots, inline.robots, "{file}");
        assert_eq!(edges(&imported), edges(&inline), "{file}");
        assert!(text.contains("# whose?"));
        assert_effective_text_parses(&imported, &text);
    }
}

#[test]
fn places_give_the_offsets_of_graphs_that_have_none() {
    let placed = ROBOTS_TOML
        .replace("name = \"r1\"", "name = \"r1\", place_m = [0.0, 0.0]")
        .replace("name = \"r2\"", "name = \"r2\", place_m = [-0.25, -0.5]")
        .replace("name = \"r3\"", "name = \"r3\", place_m = [0.25, -0.5]");
    for file in [
        "triangle-numbers.json",
        "triangle-numbers.graphml",
        "triangle-matrix.csv",
        "triangle-names.csv",
    ] {
        let (imported, text) = parse(&format!("{SCENARIO_HEAD}graph = \"{file}\"\n{placed}"));
        let expected = [(0, 2, [0.25, -0.5]), (1, 0, [0.25, 0.5]), (2, 1, [-0.5, 0.0])];
        assert_eq!(edges(&imported), expected, "{file}");
        assert_effective_text_parses(&imported, &text);
    }
}

#[test]
fn undirected_edge_becomes_two_directed_edges() {
    let placed = ROBOTS_TOML.replace("pose =", "place_m = [0.0, 0.0], pose =");
    let placed =
        placed.replacen("[0.0, 0.0]", "[0.5, 0.5]", 1).replacen("[0.0, 0.0]", "[0.0, 1.0]", 1);
    for file in ["all-hear-all.json", "all-hear-all.graphml"] {
        let (imported, text) = parse(&format!("{SCENARIO_HEAD}graph = \"{file}\"\n{placed}"));
        let expected = [
            (0, 1, [-0.5, 0.5]),
            (0, 2, [-0.5, -0.5]),
            (1, 0, [0.5, -0.5]),
            (1, 2, [0.0, -1.0]),
            (2, 0, [0.5, 0.5]),
            (2, 1, [0.0, 1.0]),
        ];
        assert_eq!(edges(&imported), expected, "{file}");
        assert_effective_text_parses(&imported, &text);
    }
}

#[test]
fn robot_keys_override_node_attributes() {
    let headed = "[[robot]]\nname = \"r2\" # the second\nspeed_m_s = 0.25\n\
        pose = { x_m = 2.0, y_m = 2.0, heading_rad = 0.0 }\n[[robot]]\nname = \"r1\"";
    let (imported, text) = parse(&format!("{SCENARIO_HEAD}graph = \"triangle.graphml\"\n{headed}"));
    let names: Vec<&str> = imported.robots.iter().map(|robot| robot.name.as_str()).collect();
    assert_eq!(names, ["r2", "r1", "r3"]);
    assert_eq!(imported.robots[0].start.x_m, 2.0);
    assert_eq!(imported.robots[0].gains["speed_m_s"], 0.25);
    assert_eq!(imported.robots[1].start.x_m, -0.045);
    assert_eq!(imported.robots[1].gains["speed_m_s"], 0.1);
    assert!(text.contains("# the second"));
    assert_effective_text_parses(&imported, &text);
}

#[test]
fn edges_of_the_graph_stand_beside_those_of_the_scenario() {
    let hears = "robot = [{ name = \"r3\", hears = [\"r2\"], place_m = [0.0, 0.0], \
        pose = { x_m = 5.0, y_m = 0.0, heading_rad = 0.0 } }, \
        { name = \"r2\", place_m = [-0.3, 0.0] }]\nedge = [ ]\n";
    let (imported, text) =
        parse(&format!("{SCENARIO_HEAD}graph = \"triangle-edges.json\"\n{hears}"));
    assert_eq!(imported.graph.edges().len(), 4);
    assert_effective_text_parses(&imported, &text);
    let (imported, text) = parse(&format!(
        "{SCENARIO_HEAD}graph = \"triangle-edges.json\"\n[[edge]]\nfrom = \"r1\"\nto = \"r2\"\n\
         offset_m = [-0.15, -0.2598076211353316]"
    ));
    assert_eq!(imported.graph.edges().len(), 4);
    assert_eq!(imported.graph.edges()[0].to, 1);
    assert_effective_text_parses(&imported, &text);
}

#[test]
fn arguments_change_imported_robots_and_name_another_graph() {
    let overrides = Overrides {
        assignments: ["robot.r2.speed_m_s=0.25".into(), "graph=triangle.graphml".into()].into(),
        faults: vec!["kill r3 @0.5".into()],
        seed: Some(3),
    };
    for before in ["", "graph = \"no-such.json\"\n"] {
        let (imported, text, _) =
            parse_with_overrides(&format!("{SCENARIO_HEAD}{before}"), &overrides)
                .unwrap_or_else(|error| panic!("{}", error.render(false)));
        assert_eq!(imported.robots[1].gains["speed_m_s"], 0.25);
        assert_eq!((imported.robots.len(), imported.faults.len(), imported.seed), (3, 1, 3));
        assert_effective_text_parses(&imported, &text);
    }
}

/// Imports a graph file with this name and text into a scenario without anything else.
fn import_text(name: &str, text: &str) -> ReadResult {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), text).unwrap();
    let scenario = format!("{SCENARIO_HEAD}graph = \"{name}\"\n");
    read_text(&folder.path().join("s.toml"), &scenario, &Overrides::default(), &test_catalog())
}

#[test]
fn numeric_ids_start_at_0_or_1_and_default_to_r1_r2() {
    let read_graph = |[first, second]: [i64; 2]| {
        let node = |id: i64, law: &str| {
            format!("{{'id': {id}, 'x_m': {id}, 'y_m': 0, 'heading_rad': 0, 'law': {law}}}")
        };
        let nodes = [node(first, "'formation-unit', 'speed_m_s': 1"), node(second, "'mean'")];
        let edge = format!("{{'source': {first}, 'target': {second}}}");
        let json =
            format!("{{'directed': true, 'nodes': [{}], 'edges': [{edge}]}}", nodes.join(", "));
        import_text("g.json", &json.replace('\'', "\""))
    };
    for (nodes, first) in [([0, 1], "r1"), ([1, 2], "r1"), ([2, 1], "r2")] {
        let scenario = read_graph(nodes).unwrap().0;
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
fn diagnostics_point_into_the_graph_file_or_the_scenario() {
    let edge = "edge = [\n{ from = \"r2\", to = \"r1\"";
    for (after, place) in [
        // The scenario's own edge comes first and has neither an offset nor places.
        (format!("{edge} }}]"), "test.toml:8:1\n"),
        (
            format!("{edge}, offset_m = [0.15, 0.2598076211353316] }}]"),
            "triangle-edges.json:40:3\n",
        ),
        // What comes behind the imported robots keeps its line.
        ("[expect]\nexit = 256\n".to_owned(), "test.toml:8:8\n"),
    ] {
        let text = format!("{SCENARIO_HEAD}graph = \"triangle-edges.json\"\n{after}");
        let rendered =
            parse_with_overrides(&text, &Overrides::default()).unwrap_err().render(false);
        assert!(rendered.contains(place), "{rendered}");
    }
}

#[test]
fn unknown_graph_attribute_is_ignored_with_a_warning() {
    let json = std::fs::read_to_string(graphs_dir().join("triangle-edges.json")).unwrap();
    let json = json.replace("\"id\":", "\"color\": \"red\", \"pos\": [0, 1], \"id\":");
    let (_, _, warnings) = import_text("g.json", &json).unwrap();
    let messages: Vec<&str> = warnings.iter().map(|warning| warning.message.as_str()).collect();
    assert_eq!(messages.len(), 2, "{messages:?}");
    assert!(messages[0].contains("`color`") && messages[1].contains("`pos`"));
}

#[test]
fn file_nested_too_deeply_is_refused() {
    let deep = |part: &str| part.repeat(200_000);
    let pose = format!("{}1{}", deep("["), deep("]"));
    let node =
        format!("{{'directed': true, 'nodes': [{{'id': 'a', 'pose': {pose}}}], 'edges': []}}");
    for (file, text) in [
        ("a.json", deep("[")),
        ("b.json", deep("{\"nodes\":")),
        ("c.json", node.replace('\'', "\"")),
        ("d.graphml", deep("<graphml>")),
        ("e.graphml", deep("<graphml>") + &deep("</graphml>")),
    ] {
        let error = import_text(file, &text).unwrap_err();
        assert!(error.render(false).contains(file), "{}", error.message);
    }
}
