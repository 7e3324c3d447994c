//! Key table of campaign files, of the same kind as that of scenarios, and the reference page generated from it.

use crate::reference::sections;
use crate::scenario::keys::Range::Positive;
use crate::scenario::keys::ValueType::{Any, Number, Pair, Table, Tables, Text, Word};
use crate::scenario::keys::{Format, Key, Section, key};
use crate::schema;

/// Values of `around`: the center of the box of start positions.
const AROUND: &[(&str, &str)] = &[
    ("middle", "one box for all robots, around `center_m`"),
    ("each", "one box for each robot, around its start in the scenario"),
];

/// Values of `pace`: the time mode.
const PACES: &[(&str, &str)] = &[
    (
        "lockstep",
        "simulation as fast as the machine allows, with as many runs in parallel as there are CPU cores",
    ),
    (
        "realtime",
        "real time, one run at a time, because parallel runs would disturb each other's timing",
    ),
];
/// Values of `keep`: the files that are kept of each run.
const KEEPS: &[(&str, &str)] = &[
    ("summary", "the scenario, `manifest.json` and `summary.json`"),
    ("failed", "all files of runs that missed an expectation, and as `summary` for the others"),
    ("all", "all files"),
];

/// Values of `goals`: the goals of robots with random starts.
const GOALS: &[(&str, &str)] = &[
    ("own", "the goals of the scenario"),
    (
        "swaps",
        "each robot goes to the start of its partner in a random pairing; with an odd number of robots, three exchange starts cyclically",
    ),
];

fn root() -> Vec<Key> {
    vec![
        key("name", Text)
            .needed("a short name of the campaign, such as \"starts\"")
            .guesses("title id"),
        key("description", Text).optional("description of the campaign, for readers of the file").guesses("comment about notes"),
        key("scenario", Text)
            .needed("path of the scenario file that all runs are based on, relative to the campaign file")
            .guesses("file path base experiment"),
        key("set", Table("set"))
            .optional("scenario keys that are set in all runs")
            .guesses("override overrides fixed"),
        key("vary", Table("vary"))
            .optional("axes: scenario keys and the values that they take")
            .guesses("varies varied axes axis grid sweep params parameters matrix"),
        key("case", Tables("case"))
            .optional("axes whose values set several keys together. In the order of the runs they change more \
                       slowly than the axes in `vary`")
            .guesses("cases variant variants scene scenes condition conditions"),
        key("zip", Any("list of lists of axes"))
            .optional("groups of axes that vary together, such as [[\"period_s\", \"duration_s\"]]; all other axes form a full grid")
            .guesses("paired together"),
        key("faults", Any("list of faults"))
            .optional("faults of all runs, in the syntax of `--fault`; `{NAME}` is replaced by the value of the axis NAME")
            .guesses("fault"),
        key("seeds", Any("integer, list of integers, or { from, count }"))
            .rule("one run with the seed of the scenario", "seeds with which each combination of settings is run: \
                 their number (1, 2, ...), a list, or a range")
            .guesses("seed runs repeat repeats repetitions trials"),
        key("starts", Table("starts"))
            .rule("the starts of the scenario", "random start poses, drawn from each seed")
            .guesses("start random_starts poses"),
        key("pace", Word(PACES)).default("'lockstep'", "time mode").guesses("mode time"),
        key("keep", Word(KEEPS))
            .default("'summary'", "files that are kept of each run")
            .guesses("save record store"),
        key("deadline_s", Number(Positive))
            .default("600.0", "maximum wall time of a run; a run that takes longer is repeated")
            .guesses("timeout limit deadline time_limit"),
    ]
}

fn starts() -> Vec<Key> {
    vec![
        key("box_m", Pair)
            .needed("width along x and height along y of the box from which the starts of front points are drawn")
            .guesses("box size area extent"),
        key("apart_m", Number(Positive))
            .needed(
                "minimum distance of two front points at the start; must be more than d (Assumption 1)",
            )
            .guesses("apart distance min_distance separation spacing"),
        key("center_m", Pair)
            .rule("the mean of the starts in the scenario", "center of the box")
            .guesses("center centre middle origin"),
        key("around", Word(AROUND))
            .default("'middle'", "center of the box")
            .guesses("about from at"),
        key("goals", Word(GOALS))
            .default("'own'", "goals of the robots, also drawn from each seed")
            .guesses("goal destinations targets"),
    ]
}

fn case() -> Vec<Key> {
    vec![
        key("axis", Text).needed("name of the axis, such as \"scene\""),
        key("name", Text).needed("name of the value on that axis, such as \"circle-8\"").guesses("value title id"),
        key("scenario", Text)
            .rule(
                "the scenario of the campaign",
                "path of the scenario file that the runs of this case are based on, relative to the campaign file",
            )
            .guesses("file path base experiment"),
        key("set", Table("set"))
            .optional("scenario keys that are set in the runs of this case")
            .guesses("override overrides fixed"),
        key("faults", Any("list of faults"))
            .optional("faults of the runs of this case, in the syntax of `--fault`")
            .guesses("fault"),
        key("starts", Table("starts"))
            .rule("the starts of the campaign", "random start poses of the runs of this case, drawn from each \
                                                 seed")
            .guesses("start random_starts poses"),
    ]
}

/// Returns the format of campaign files.
pub fn format() -> Format {
    Format::without_catalog(vec![
        Section::new("campaign", "A parameter study: many runs of one scenario.", root()),
        Section::new(
            "set",
            "Any [key of a scenario](scenario.md), as in `--set`: `duration_s = 20`, \
             `avoidance.kind = \"focus\"`, `robot.r1.pose.x_m = 0.3`.",
            Vec::new(),
        ),
        Section::new(
            "vary",
            "Any [key of a scenario](scenario.md), as in `--set`, with its values: a list, or \
             `{ from, to, count, spacing }` with `spacing` `\"linear\"` (default) or `\"log\"`. \
             The values of `fault` are faults in the syntax of `--fault`, lists of them, or `\"none\"`. Any other \
             name is an axis of numbers or strings for `faults`, which replace `{NAME}` there. With the value \
             `\"none\"` the faults that name the axis are omitted.",
            Vec::new(),
        ),
        Section::new(
            "starts",
            "Random start poses: front points distributed uniformly over a box and clear of walls, headings distributed \
             uniformly over all directions. All runs with the same seed have the same starts.",
            starts(),
        ),
        Section::new(
            "case",
            "One value of an axis, which sets the scenario, keys, faults or starts, or several of these. All `[[case]]` \
             with the same `axis` are the values of that axis.",
            case(),
        ),
    ])
}

const HEAD: &str = "\
# Campaign files

Generated by `phalanx schema --campaign --markdown` from the key table that the campaign parser uses; do not edit it. How to use them:
[a campaign](../tutorial/campaign.md), [on a cluster](../how-to/cluster.md).

A key that is marked **needed** is required if its table is given.
";

/// Returns the JSON Schema of campaign files.
pub fn schema() -> String {
    schema::for_format(&format(), "A Phalanx campaign")
}

/// Returns the reference page of campaign keys, in Markdown.
pub fn reference() -> String {
    HEAD.to_owned() + &sections(&format(), "The whole campaign file")
}
