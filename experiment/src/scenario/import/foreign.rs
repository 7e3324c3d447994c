//! Tests with graph files as other tools write them: files that are accepted, errors that name the cause, and
//! arbitrary bytes, which never make the reader panic.

use proptest::prelude::*;

use crate::scenario::Scenario;
use crate::scenario::diagnostic::Diagnostic;
use crate::scenario::read::{Overrides, ReadResult, read_text};
use crate::scenario::tests::test_catalog;

const SCENARIO: &str = "name = \"t\"\nduration_s = 1.0\nperiod_s = 0.005\n\
    avoidance = { distance_min_m = 0.2, speed_max_m_s = 0.3 }\n\
    robot_defaults = { front_point_m = 0.045, law = \"formation-unit\", speed_m_s = 0.1 }\n\
    robot = [\n\
    { name = \"r1\", place_m = [0.6, 0.0], pose = { x_m = 0.69, y_m = 0.0, heading_rad = 0.0 } },\n\
    { name = \"r2\", place_m = [-0.3, 0.52], pose = { x_m = -0.34, y_m = 0.57, heading_rad = 0.0 } },\n\
    { name = \"r3\", place_m = [-0.3, -0.52], pose = { x_m = -0.34, y_m = -0.57, heading_rad = 0.0 } },\n]\n";

/// The graph in most of these files: r1 -> r3 -> r2 -> r1, as pairs of sender and receiver.
const RING_EDGES: [(usize, usize); 3] = [(0, 2), (1, 0), (2, 1)];
const COMPLETE_EDGES: [(usize, usize); 6] = [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)];

fn read_scenario_with_graph(name: &str, bytes: impl AsRef<[u8]>) -> ReadResult {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    let scenario = format!("{SCENARIO}graph = \"{name}\"\n");
    read_text(&folder.path().join("s.toml"), &scenario, &Overrides::default(), &test_catalog())
}

fn edges(scenario: &Scenario) -> Vec<(usize, usize)> {
    let mut edges: Vec<_> =
        scenario.graph.edges().iter().map(|edge| (edge.from, edge.to)).collect();
    edges.sort_unstable();
    edges
}

/// Returns the edges of a graph and the warnings about its file.
fn import_edges(name: &str, bytes: impl AsRef<[u8]>) -> (Vec<(usize, usize)>, Vec<Diagnostic>) {
    let text = String::from_utf8_lossy(bytes.as_ref()).into_owned();
    let (scenario, _, mut warnings) = read_scenario_with_graph(name, bytes)
        .unwrap_or_else(|error| panic!("{}\n{text}", error.render(false)));
    warnings.retain(|warning| warning.message.contains("no meaning"));
    (edges(&scenario), warnings)
}

/// Checks that a graph is read without a warning about its file.
fn assert_edges(name: &str, bytes: impl AsRef<[u8]>, expected: &[(usize, usize)]) {
    let text = String::from_utf8_lossy(bytes.as_ref()).into_owned();
    assert_eq!(import_edges(name, bytes), (expected.to_vec(), vec![]), "{text}");
}

/// Checks that an error has all of these parts; returns its text.
fn assert_refused(name: &str, bytes: impl AsRef<[u8]>, parts: &[&str]) -> String {
    let error = read_scenario_with_graph(name, bytes).expect_err(parts[0]);
    let rendered = error.render(false);
    assert!(parts.iter().all(|part| rendered.contains(part)), "{parts:?}:\n{rendered}");
    rendered
}

/// Returns node-link JSON of the ring with these members in each node and edge.
fn ring_as_json(node: &str, edge: &str) -> String {
    let node = |id| format!("{{'id': 'r{id}'{node}}}");
    let edge = |(from, to)| format!("{{'source': 'r{}', 'target': 'r{}'{edge}}}", from + 1, to + 1);
    let nodes = [1, 2, 3].map(node).join(",\n");
    let edges = RING_EDGES.map(edge).join(",\n");
    format!("{{'directed': true, 'nodes': [\n{nodes}],\n'edges': [\n{edges}]}}").replace('\'', "\"")
}

/// Returns GraphML of the ring with one attribute in each node and edge.
fn ring_as_graphml(name: &str, kind: &str, value: &str) -> String {
    let data = format!("<data key=\"a\">{value}</data>");
    let node = |id| format!("<node id=\"r{id}\">{data}</node>\n");
    let edge = |(from, to)| {
        format!("<edge source=\"r{}\" target=\"r{}\">{data}</edge>\n", from + 1, to + 1)
    };
    format!(
        "<graphml><key id=\"a\" for=\"all\" attr.name=\"{name}\" attr.type=\"{kind}\"/>\n\
         <graph edgedefault=\"directed\">\n{}{}</graph></graphml>",
        [1, 2, 3].map(node).concat(),
        RING_EDGES.map(edge).concat()
    )
}

#[test]
fn attribute_without_meaning_is_ignored_whatever_its_value() {
    let deep = format!("{}1{}", "[".repeat(5000), "]".repeat(5000));
    for value in
        ["null", "NaN", "-Infinity", "1", "''", "{'a': {'b': [1]}}", "[[[[[[1]]]]]]", &deep]
    {
        let member = format!(", 'label': {value}");
        let (edges, warnings) = import_edges("g.json", ring_as_json(&member, &member));
        assert_eq!(edges, RING_EDGES, "{value}");
        assert!(matches!(&warnings[..], [w] if w.message.contains("`label`")), "{warnings:?}");
    }
    for (kind, value) in [
        ("double", "NaN"),
        ("double", "INF"),
        ("int", ""),
        ("boolean", "1"),
        ("boolean", "perhaps"),
        ("string", "<y:ShapeNode xmlns:y=\"y\"/>"),
    ] {
        let (edges, warnings) = import_edges("g.graphml", ring_as_graphml("label", kind, value));
        assert_eq!(edges, RING_EDGES, "{kind} {value}");
        assert!(matches!(&warnings[..], [w] if w.message.contains("`label`")), "{warnings:?}");
    }
    let undeclared = ring_as_graphml("label", "int", "1").replace("id=\"a\"", "id=\"b\"");
    let (edges, warnings) = import_edges("g.graphml", undeclared);
    assert_eq!((edges, warnings.len()), (RING_EDGES.to_vec(), 1));
    let twice = ring_as_json(", 'label': 1, 'label': 2", "");
    assert_eq!(import_edges("g.json", twice).0, RING_EDGES);
}

#[test]
fn attribute_that_resembles_a_key_is_ignored_with_a_hint() {
    for (name, close) in
        [("speed", "`speed_m_s`"), ("heading", "`heading_rad`"), ("sped_m_s", "`speed_m_s`")]
    {
        for (file, text) in [
            ("g.json", ring_as_json(&format!(", '{name}': 1.0"), "")),
            ("g.graphml", ring_as_graphml(name, "double", "1.0")),
        ] {
            let (edges, warnings) = import_edges(file, text);
            assert_eq!((edges, warnings.len()), (RING_EDGES.to_vec(), 1), "{name}");
            assert!(warnings[0].expected.contains(close), "{}", warnings[0].render(false));
        }
    }
    let (_, warnings) = import_edges("g.json", ring_as_json("", ", 'offset': 1"));
    assert!(warnings[0].expected.contains("`offset_m`"), "{warnings:?}");
}

#[test]
fn attribute_with_meaning_is_checked() {
    for value in ["null", "NaN", "[1, Infinity]", "[[[[[1]]]]]", "'x'", "{'a': 1, 'a': 2}"] {
        assert_refused(
            "g.json",
            ring_as_json("", &format!(", 'offset_m': {value}")),
            &["`offset_m`"],
        );
    }
    assert_refused("g.json", ring_as_json(", 'law': 'no-such'", ""), &["`law`"]);
    assert_refused(
        "g.json",
        ring_as_json(", 'speed_m_s': 1, 'speed_m_s': 2", ""),
        &["`speed_m_s` twice"],
    );
    for (kind, value) in [("double", "NaN"), ("int", ""), ("double", "fast"), ("string", "1")] {
        assert_refused("g.graphml", ring_as_graphml("speed_m_s", kind, value), &["`speed_m_s`"]);
    }
    let undeclared = ring_as_graphml("x", "double", "1").replace("key=\"a\"", "key=\"speed_m_s\"");
    assert_refused("g.graphml", undeclared, &["speed_m_s", "is not declared"]);
}

#[test]
fn unknown_attributes_get_a_bounded_number_of_warnings() {
    let members: String = (0..100).map(|i| format!(", 'zz{i}': 1")).collect();
    let (_, warnings) = import_edges("g.json", ring_as_json(&members, ""));
    assert_eq!(warnings.len(), 9);
    assert!(warnings[8].message.starts_with("92 more attributes"), "{}", warnings[8].message);
}

#[test]
fn separator_and_decimal_comma_are_detected() {
    let rows = ["0,1,0", "0,0,1", "1,0,0"];
    for separator in [",", ";", "\t", " ", "   ", ", ", ",\t", " ; "] {
        for end in ["\n", "\r\n", "\r"] {
            let text = rows.map(|row| row.replace(',', separator) + end).concat();
            assert_edges("g.csv", text, &RING_EDGES);
        }
    }
    for text in [
        "0;1,0;0\n0;0;1,0\n1,0;0;0\n",
        "0\t1,0\t0\n0\t0\t1,0\n1,0\t0\t0\n",
        "0 1,0 0\n0 0 1,0\n1,0 0 0\n",
        "0,0 1,0 0,0\n0,0 0,0 1,0\n1,0 0,0 0,0\n",
        "sep=;\n0;1;0\n0;0;1\n1;0;0\n",
        "# r1 r2 r3\n\n0.0e+00 1.0e+00 0.0e+00\n 0.0e+00 0.0e+00 1.0e+00\n1.0e+00 0.0e+00 0.0e+00\n",
        ";r1;r2;r3\nr1;0;1;0\nr2;0;0;1\nr3;1;0;0\n",
        "\"\"\t\"r1\"\t\"r2\"\t\"r3\"\n\"r1\"\t0\t1\t0\n\"r2\"\t0\t0\t1\n\"r3\"\t1\t0\t0\n",
    ] {
        assert_edges("g.csv", text, &RING_EDGES);
    }
    for text in ["0|1|0\n0|0|1\n1|0|0\n", "0|1\n1|0\n"] {
        assert_refused("g.csv", text, &["commas, semicolons, tabs or spaces"]);
    }
    assert_refused(
        "g.csv",
        "0;1;0\n0;0\n1;0;0\n",
        &["line 2 has 2 fields", "line 3", "semicolons"],
    );
    assert_refused("g.csv", "0;1,0;0,5,5\n0;0;1\n1;0;0\n", &["0,5,5"]);
}

#[test]
fn index_header_and_trailing_separator_are_read() {
    for text in [
        "id,0,1,2\n0,0,1,0\n1,0,0,1\n2,1,0,0\n",
        ",1,2,3\n1,0,1,0\n2,0,0,1\n3,1,0,0\n",
        "0,1,2\n0,1,0\n0,0,1\n1,0,0\n",
        "1,2,3\n0,1,0\n0,0,1\n1,0,0\n",
        "0,0,1,0\n1,0,0,1\n2,1,0,0\n",
        "0,1,2\n0,0,1,0\n1,0,0,1\n2,1,0,0\n",
        ",r1,r2,r3\n0,0,1,0\n1,0,0,1\n2,1,0,0\n",
        "id,0,1,2\nr1,0,1,0\nr2,0,0,1\nr3,1,0,0\n",
        "r1,r2,r3\n0,1,0\n0,0,1\n1,0,0\n",
        "r1,0,1,0\nr2,0,0,1\nr3,1,0,0\n",
        "0,1,0,\n0,0,1,\n1,0,0,\n",
        "0,1,0,,\n0,0,1,,\n1,0,0,,\n",
        "r1,r2,r3,\n0,1,0,\n0,0,1,\n1,0,0,\n",
        ",r1,r2,r3,\nr1,0,1,0,\nr2,0,0,1,\nr3,1,0,0,\n",
        "r1;r2;r3\n0;1;0;\n0;0;1;\n1;0;0;\n",
        "False,True,False\nFalse,False,True\nTrue,False,False\n",
        "nan,0,1,2\n0,0,TRUE,0\n1,0,0,true\n2,1,false,0\n",
    ] {
        assert_edges("g.csv", text, &RING_EDGES);
    }
    let order = ",r2,r1\nr1,0,1\nr2,0,0\n";
    assert_refused("g.csv", order, &["the row in line 2 is called \"r1\"", "\"r2\""]);
    assert_refused("g.csv", "0,1,0\n0,,1\n1,0,0\n", &["g.csv:2:3", "empty", "0 where"]);
    assert_refused("g.csv", "0;1\n1;\n", &["g.csv:2:3", "empty"]);
    assert_refused("g.csv", "0,1,0\n0,NaN,1\n1,0,0\n", &["g.csv:2:3", "NaN", "0 where"]);
    assert_refused("g.csv", "0,1,0,0\n0,0,1,0\n", &["2 rows of 4 fields"]);
}

#[test]
fn weights_of_a_matrix_are_ignored_with_one_warning() {
    let (edges, warnings) = import_edges("g.csv", "0,0.1,0.9\n0.5,0,0.5\n0.2,0.8,0\n");
    assert_eq!(edges, COMPLETE_EDGES);
    let [warning] = &warnings[..] else { panic!("{warnings:?}") };
    assert!(warning.render(false).contains("g.csv:1:3") && warning.message.contains("0.1"));
    let (_, warnings) = import_edges("g.json", ring_as_json("", ", 'weight': -0.1"));
    assert_eq!(warnings.len(), 1);
    assert_edges("g.csv", "0,1.0,1\n1,0,1e0\n1,1,-0\n", &COMPLETE_EDGES);
}

#[test]
fn negative_weight_and_laplacian_are_called_by_name() {
    assert_refused("g.csv", "0,-1,1\n1,0,-1\n-1,1,0\n", &["g.csv:1:3", "is -1", "sign"]);
    for text in [
        "2,-1,-1\n-1,2,-1\n-1,-1,2\n",
        "1,-1,0\n0,1,-1\n-1,0,1\n",
        "1,-0.5,-0.5\n-0.5,1,-0.5\n-0.5,-0.5,1\n",
        "r1,r2,r3\n0,0,0\n-1,1,0\n-1,0,1\n",
    ] {
        assert_refused("g.csv", text, &["a Laplacian:", "adjacency matrix", "(L < 0)"]);
    }
    assert_refused("g.csv", "-1,1,0\n0,-1,1\n1,0,-1\n", &["Laplacian with its sign turned"]);
}

#[test]
fn edge_and_neighbor_lists_are_recognized() {
    for text in [
        "source,target\nr1,r2\nr2,r3\nr3,r1\n",
        "Source;Target;Type;Weight\nr1;r2;Directed;1.0\nr2;r3;Directed;1.0\n",
        "from,to\nr1,r2\n",
        "r1,r2\nr2,r3\nr3,r1\n",
        "r1 r2 {}\nr2 r3 {}\nr3 r1 {}\n",
        "r1 r2 {'weight': 1.0}\nr2 r3 {'weight': 0.5}\n",
        "r1,r2,0.5\nr2,r3,1\n",
    ] {
        assert_refused("g.csv", text, &["an edge list, not", "_edgelist("]);
    }
    for text in ["0,1\n1,2\n2,0\n0,2\n", "0 1 0.5\n1 2 0.5\n2 0 0.5\n0 2 0.5\n"] {
        assert_refused("g.csv", text, &["no square matrix", "perhaps it is an edge list"]);
    }
    assert_refused("g.csv", "r1 r2 r3\nr2 r3\nr3\n", &["a list of neighbors", "read_adjlist"]);
}

#[test]
fn undirected_edge_may_be_given_from_both_ends() {
    let node = |id| format!("<node id=\"r{id}\"/>");
    let edge = |[from, to]: [u32; 2]| format!("<edge source=\"r{from}\" target=\"r{to}\"/>\n");
    let graph = |edges: &[[u32; 2]]| {
        let edges: String = edges.iter().map(|endpoints| edge(*endpoints)).collect();
        let nodes = [1, 2, 3].map(node).concat();
        format!("<graphml><graph edgedefault=\"undirected\">{nodes}\n{edges}</graph></graphml>")
    };
    assert_edges("g.graphml", graph(&[[1, 2], [2, 3], [3, 1], [2, 1]]), &COMPLETE_EDGES);
    let parallel = graph(&[[1, 2], [2, 3], [3, 1], [1, 2]]);
    assert_refused(
        "g.graphml",
        parallel,
        &["\"r1\" - \"r2\" occurs twice, first in line 2", ":5:1"],
    );
}

#[test]
fn multigraph_without_parallel_edges_is_read() {
    let text = ring_as_json("", ", 'key': 0").replacen(
        "\"directed\"",
        "\"multigraph\": true, \"directed\"",
        1,
    );
    assert_edges("g.json", &text, &RING_EDGES);
    let parallel = text.replace(
        "\"edges\": [\n",
        "\"edges\": [\n{\"source\": \"r1\", \"target\": \"r3\", \"key\": 1},\n",
    );
    assert_refused(
        "g.json",
        parallel,
        &["g.json:7:1", "occurs twice, first in line 6", "parallel"],
    );
}

#[test]
fn edge_of_graph_and_scenario_names_both_places() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("g.json"), ring_as_json("", "")).unwrap();
    let keys = "graph = \"g.json\"\nedge = [{ from = \"r1\", to = \"r3\" }]\n";
    let path = folder.path().join("s.toml");
    let read =
        read_text(&path, &format!("{SCENARIO}{keys}"), &Overrides::default(), &test_catalog());
    let rendered = read.unwrap_err().render(false);
    assert!(rendered.contains("g.json:6:1") && rendered.contains("s.toml:12:29"), "{rendered}");
}

#[test]
fn document_type_is_ignored_and_entities_are_refused() {
    let head =
        "<?xml version=\"1.0\"?>\n<!DOCTYPE graphml SYSTEM \"http://example.org/graphml.dtd\">\n";
    let text = head.to_owned() + &ring_as_graphml("label", "string", "x");
    assert_eq!(import_edges("g.graphml", text).0, RING_EDGES);
    let bomb =
        "<!DOCTYPE graphml [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;\">]>\n";
    let text = bomb.to_owned() + &ring_as_graphml("label", "string", "&b;");
    assert_refused("g.graphml", text, &["g.graphml:1:20", "declares an entity"]);
}

#[test]
fn declared_encoding_is_read_or_named() {
    let utf_16 = |text: &str, unit: fn(u16) -> [u8; 2], has_mark: bool| -> Vec<u8> {
        let mark = has_mark.then_some(0xfeff);
        mark.into_iter().chain(text.encode_utf16()).flat_map(unit).collect()
    };
    let latin = |text: &str| -> Vec<u8> { text.chars().map(|c| c as u32 as u8).collect() };
    let declare = |encoding: &str, text: &str| {
        format!("<?xml version=\"1.0\" encoding=\"{encoding}\"?>\n{text}")
    };
    let xml = ring_as_graphml("label", "string", "größer");
    for unit in [u16::to_le_bytes, u16::to_be_bytes] {
        for has_mark in [false, true] {
            let bytes = utf_16(&declare("UTF-16", &xml), unit, has_mark);
            assert_eq!(import_edges("g.graphml", bytes).0, RING_EDGES);
            assert_edges(
                "g.csv",
                utf_16("0\t1\t0\r\n0\t0\t1\r\n1\t0\t0\r\n", unit, has_mark),
                &RING_EDGES,
            );
            assert_edges("g.json", utf_16(&ring_as_json("", ""), unit, has_mark), &RING_EDGES);
        }
    }
    for encoding in ["ISO-8859-1", "iso-8859-1", "latin1", "windows-1252"] {
        assert_eq!(
            import_edges("g.graphml", latin(&declare(encoding, &xml))).0,
            RING_EDGES,
            "{encoding}"
        );
    }
    assert_eq!(import_edges("g.graphml", declare("utf-8", &xml)).0, RING_EDGES);
    let ascii = declare("Shift_JIS", &ring_as_graphml("label", "string", "x"));
    assert_eq!(import_edges("g.graphml", ascii).0, RING_EDGES);
    assert_refused("g.graphml", latin(&declare("Shift_JIS", &xml)), &["shift_jis", "iconv"]);
    assert_refused("g.graphml", latin(&xml), &["not UTF-8", "0xf6", "ISO-8859-1"]);
    assert_refused("g.csv", [0xff, 0xfe, 0, 0, 0x30, 0, 0, 0], &["UTF-32"]);
    assert_refused("g.csv", [0xff, 0xfe, 0x30, 0, 0], &["UTF-16", "half a character"]);
    assert_refused("g.csv", [0xff, 0xfe, 0, 0xd8, 0x30, 0], &["UTF-16", "on line 1"]);
}

#[test]
fn ending_in_capitals_is_that_format() {
    assert_edges("g.CSV", "0,1,0\n0,0,1\n1,0,0\n", &RING_EDGES);
    assert_edges("g.JSON", ring_as_json("", ""), &RING_EDGES);
    assert_eq!(import_edges("g.GraphML", ring_as_graphml("label", "int", "1")).0, RING_EDGES);
}

#[test]
fn value_in_a_message_is_on_one_line_and_short() {
    let grid = ring_as_json("", "").replacen("\"r1\"", "[\n0,\n   0\n]", 1);
    let rendered =
        assert_refused("g.json", grid, &["`id` is [ 0, 0 ]", "convert_node_labels_to_integers"]);
    assert!(!rendered.contains("\\n"), "{rendered}");
    let long =
        ring_as_json("", "").replacen("\"r1\"", &format!("[{}]", "7, ".repeat(500) + "7"), 1);
    let error = read_scenario_with_graph("g.json", long).unwrap_err();
    assert!(error.message.len() < 100, "{}", error.message);
}

#[test]
fn other_json_format_is_called_by_name() {
    for (text, name) in [
        ("{'directed': false, 'elements': {'nodes': [], 'edges': []}}", "Cytoscape JSON"),
        ("{'directed': false, 'nodes': [], 'adjacency': []}", "adjacency JSON"),
    ] {
        assert_refused("g.json", text.replace('\'', "\""), &[name, "node_link_data"]);
    }
}

#[test]
fn number_as_id_is_the_robot_of_that_number_in_any_order() {
    let numbered = |quote: &str| {
        let edge = |(from, to)| format!("{{'source': {from}, 'target': {to}}}");
        let nodes = [2, 0, 1].map(|id| format!("{{'id': {quote}{id}{quote}}}")).join(", ");
        let edges = RING_EDGES.map(edge).join(", ");
        format!("{{'directed': true, 'nodes': [{nodes}], 'edges': [{edges}]}}").replace('\'', "\"")
    };
    assert_edges("g.json", numbered(""), &RING_EDGES);
    assert_edges("g.json", numbered("'"), &RING_EDGES);
}

const TOKENS: [&str; 34] = [
    "0",
    "1",
    "-1",
    "0,5",
    ",",
    ";",
    "\t",
    " ",
    "\n",
    "\r",
    "\"",
    "r1",
    "r2",
    "True",
    "NaN",
    "sep=;",
    "#",
    "{",
    "}",
    "[",
    "]",
    ":",
    "\\",
    "\"id\"",
    "Infinity",
    "<!DOCTYPE g>",
    "<!ENTITY a \"b\">",
    "&a;",
    "<graphml>",
    "</graphml>",
    "<?xml encoding=\"latin1\"?>",
    "\u{feff}",
    "é",
    "null",
];

proptest! {
    #[test]
    fn no_bytes_make_the_reader_panic(
        bytes in proptest::collection::vec(any::<u8>(), 0..200),
        pieces in proptest::collection::vec(proptest::sample::select(&TOKENS[..]), 0..40),
        fraction in 0.0..1.0,
    ) {
        let pieces = pieces.concat();
        let valid = [ring_as_json(", 'x': NaN", ""), ring_as_graphml("x", "double", "1"), "0;1,0;0\n0;0;1\n1;0;0\n".to_owned()];
        for (name, valid) in ["g.json", "g.graphml", "g.csv"].into_iter().zip(valid) {
            let mut position = (valid.len() as f64 * fraction) as usize;
            while !valid.is_char_boundary(position) { position -= 1; }
            let changed = format!("{}{pieces}{}", &valid[..position], &valid[position..]);
            for bytes in [&bytes[..], pieces.as_bytes(), changed.as_bytes()] {
                if let Err(error) = read_scenario_with_graph(name, bytes) {
                    prop_assert!(error.render(false).starts_with("error: "));
                }
            }
        }
    }
}
