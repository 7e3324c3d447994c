//! THE table of the format of campaign files, in the rows of which scenarios are made too; and the
//! page of the book that lists them.

use crate::reference::sections;
use crate::scenario::keys::{Format, Key, Otherwise, Range, Section, Takes, key};
use crate::schema;

/// Longest that a run may take unless the file says otherwise, s.
pub(crate) const DEADLINE_S: f64 = 600.0;

/// What a box of starts is around: words of `around`.
const AROUND: &[(&str, &str)] = &[
    ("middle", "one box for all"),
    ("each", "a box for each robot, around its own start in the scenario"),
];

/// How time passes: words of `pace`.
pub(crate) const PACES: &[(&str, &str)] = &[
    ("lockstep", "as fast as the machine allows, as many runs at once as there are cores"),
    (
        "realtime",
        "by the machine's clock, one run at a time: several would ruin each other's timing",
    ),
];
/// What is kept of a run: words of `keep`.
pub(crate) const KEEPS: &[(&str, &str)] = &[
    ("summary", "its scenario, `manifest.json` and `summary.json`"),
    ("failed", "all of a run that missed an expectation, and the summary of others"),
    ("all", "all"),
];

/// Where robots go whose starts are drawn: words of `goals`.
pub(crate) const GOALS: &[(&str, &str)] = &[
    ("own", "where the scenario says"),
    ("swaps", "random pairs swap places; of an odd number of robots, three go around"),
];

const ROOT: &[Key] = &[
    key("name", Takes::Text, Otherwise::Needed, "a short name for the campaign, such as \"starts\"")
        .guessed(&["title", "id"]),
    key("description", Takes::Text, Otherwise::Absent, "what it is about")
        .guessed(&["comment", "about", "notes"]),
    key(
        "scenario",
        Takes::Text,
        Otherwise::Needed,
        "the scenario file that all runs begin with, as seen from the campaign file",
    )
    .guessed(&["file", "path", "base", "experiment"]),
    key("set", Takes::Table("set"), Otherwise::Absent, "keys of the scenario that all runs change")
        .guessed(&["override", "overrides", "fixed"]),
    key("vary", Takes::Table("vary"), Otherwise::Absent, "keys of the scenario that runs differ in")
        .guessed(&["axes", "axis", "grid", "sweep", "params", "parameters", "matrix"]),
    key(
        "case",
        Takes::Tables("case"),
        Otherwise::Absent,
        "values of axes that stand for several things at once; such axes change slower than those in `vary`",
    )
    .guessed(&["cases", "variant", "variants", "scene", "scenes", "condition", "conditions"]),
    key(
        "zip",
        Takes::Any("list of lists of axes"),
        Otherwise::Absent,
        "axes that move together, such as [[\"period_s\", \"duration_s\"]]; all others make a full grid",
    )
    .guessed(&["paired", "together"]),
    key(
        "faults",
        Takes::Any("list of faults in words"),
        Otherwise::Absent,
        "faults of all runs, in the words of `--fault`; `{NAME}` stands for the value of that axis",
    )
    .guessed(&["fault"]),
    key(
        "seeds",
        Takes::Any("integer, list of integers, or { from, count }"),
        Otherwise::Rule("the scenario's own seed, once"),
        "how many seeds each combination of settings is run with, from 1 on; or which",
    )
    .guessed(&["seed", "runs", "repeat", "repeats", "repetitions", "trials"]),
    key(
        "starts",
        Takes::Table("starts"),
        Otherwise::Rule("those of the scenario"),
        "where robots start, drawn from each seed",
    )
    .guessed(&["start", "random_starts", "poses"]),
    key("pace", Takes::Word(PACES), Otherwise::Word("lockstep"), "how time passes")
        .guessed(&["mode", "time"]),
    key("keep", Takes::Word(KEEPS), Otherwise::Word("summary"), "what is kept of each run")
        .guessed(&["save", "record", "store"]),
    key(
        "deadline_s",
        Takes::Number("s", Range::Positive),
        Otherwise::Number(DEADLINE_S),
        "longest that a run may take, wall time; one that takes longer is tried again",
    )
    .guessed(&["timeout", "limit", "deadline", "time_limit"]),
];

const STARTS: &[Key] = &[
    key(
        "box_m",
        Takes::Pair("m"),
        Otherwise::Needed,
        "width along x and height along y of the box that front points are drawn from",
    )
    .guessed(&["box", "size", "area", "extent"]),
    key(
        "apart_m",
        Takes::Number("m", Range::Positive),
        Otherwise::Needed,
        "no two front points are nearer than this at the start; more than d (Assumption 1)",
    )
    .guessed(&["apart", "distance", "min_distance", "separation", "spacing"]),
    key(
        "center_m",
        Takes::Pair("m"),
        Otherwise::Rule("the mean of the scenario's own starts"),
        "the middle of the box",
    )
    .guessed(&["center", "centre", "middle", "origin"]),
    key("around", Takes::Word(AROUND), Otherwise::Word("middle"), "what the box is around")
        .guessed(&["about", "from", "at"]),
    key(
        "goals",
        Takes::Word(GOALS),
        Otherwise::Word("own"),
        "where robots go, also drawn from each seed",
    )
    .guessed(&["goal", "destinations", "targets"]),
];

const CASE: &[Key] = &[
    key(
        "axis",
        Takes::Text,
        Otherwise::Needed,
        "the axis that it is a value of, such as \"scene\"",
    ),
    key("name", Takes::Text, Otherwise::Needed, "the value, such as \"circle-8\"")
        .guessed(&["value", "title", "id"]),
    key(
        "scenario",
        Takes::Text,
        Otherwise::Rule("that of the campaign"),
        "the scenario file that its runs begin with, as seen from the campaign file",
    )
    .guessed(&["file", "path", "base", "experiment"]),
    key("set", Takes::Table("set"), Otherwise::Absent, "keys of the scenario that its runs change")
        .guessed(&["override", "overrides", "fixed"]),
    key(
        "faults",
        Takes::Any("list of faults in words"),
        Otherwise::Absent,
        "faults of its runs, in the words of `--fault`",
    )
    .guessed(&["fault"]),
    key(
        "starts",
        Takes::Table("starts"),
        Otherwise::Rule("those of the campaign"),
        "where its robots start, drawn from each seed",
    )
    .guessed(&["start", "random_starts", "poses"]),
];

/// The keys that campaign files may have.
pub fn format() -> Format {
    let section =
        |name, says, keys: &[Key]| Section { name, says, keys: keys.to_vec(), kinds: Vec::new() };
    Format {
        sections: vec![
            section("campaign", "Many runs of one scenario.", ROOT),
            section(
                "set",
                "Any [key of a scenario](scenario.md), as in `--set`: `duration_s = 20`, \
                 `avoidance.kind = \"focus\"`, `robot.r1.pose.x_m = 0.3`.",
                &[],
            ),
            section(
                "vary",
                "Any [key of a scenario](scenario.md), as in `--set`, with the values that it takes: a list, or \
                 `{ from, to, count, spacing }` with `spacing` `\"linear\"` (default) or `\"log\"`. \
                 `fault` takes a list of faults in words, or of lists of them, or `\"none\"`. Another \
                 name is an axis of numbers or words for `faults`, where `{NAME}` stands for it; with `\"none\"` \
                 those faults do not happen.",
                &[],
            ),
            section(
                "starts",
                "Where robots start: front points even over a box and clear of walls, headings even over a turn, the same for every run with that seed.",
                STARTS,
            ),
            section(
                "case",
                "One value of an axis: another scenario, keys, faults or starts, or several of these. All `[[case]]` \
                 with the same `axis` are its values.",
                CASE,
            ),
        ],
        laws: Vec::new(),
        methods: Vec::new(),
    }
}

const HEAD: &str = "\
# Campaign files

Written by `phalanx schema --campaign --markdown` from the table that the reader of campaigns uses; do not edit it. How to use them:
[a campaign](../tutorial/campaign.md), [on a cluster](../how-to/cluster.md).

A key that is marked **needed** must be given where its table is.
";

/// The JSON Schema of campaign files, as text.
pub fn schema() -> String {
    schema::of(&format(), "A Phalanx campaign")
}

/// The page of the book that lists every key, in Markdown.
pub fn reference() -> String {
    HEAD.to_owned() + &sections(&format(), "The whole campaign file")
}
