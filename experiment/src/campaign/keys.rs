//! THE table of the format of campaign files, in the rows of which scenarios are made too; and the
//! page of the book that lists them.

use crate::reference::sections;
use crate::scenario::keys::Range::Positive;
use crate::scenario::keys::Takes::{Any, Number, Pair, Table, Tables, Text, Word};
use crate::scenario::keys::{Format, Key, Section, key};
use crate::schema;

/// What a box of starts is around: words of `around`.
const AROUND: &[(&str, &str)] = &[
    ("middle", "one box for all"),
    ("each", "a box for each robot, around its own start in the scenario"),
];

/// How time passes: words of `pace`.
const PACES: &[(&str, &str)] = &[
    ("lockstep", "as fast as the machine allows, as many runs at once as there are cores"),
    (
        "realtime",
        "by the machine's clock, one run at a time: several would ruin each other's timing",
    ),
];
/// What is kept of a run: words of `keep`.
const KEEPS: &[(&str, &str)] = &[
    ("summary", "its scenario, `manifest.json` and `summary.json`"),
    ("failed", "all of a run that missed an expectation, and the summary of others"),
    ("all", "all"),
];

/// Where robots go whose starts are drawn: words of `goals`.
const GOALS: &[(&str, &str)] = &[
    ("own", "where the scenario says"),
    ("swaps", "random pairs swap places; of an odd number of robots, three go around"),
];

fn root() -> Vec<Key> {
    vec![
        key("name", Text)
            .needed("a short name for the campaign, such as \"starts\"")
            .guesses("title id"),
        key("description", Text).optional("what it is about").guesses("comment about notes"),
        key("scenario", Text)
            .needed("the scenario file that all runs begin with, as seen from the campaign file")
            .guesses("file path base experiment"),
        key("set", Table("set"))
            .optional("keys of the scenario that all runs change")
            .guesses("override overrides fixed"),
        key("vary", Table("vary"))
            .optional("keys of the scenario that runs differ in")
            .guesses("varies varied axes axis grid sweep params parameters matrix"),
        key("case", Tables("case"))
            .optional("values of axes that stand for several things at once; such axes change slower than \
                       those in `vary`")
            .guesses("cases variant variants scene scenes condition conditions"),
        key("zip", Any("list of lists of axes"))
            .optional("axes that move together, such as [[\"period_s\", \"duration_s\"]]; all others make a full grid")
            .guesses("paired together"),
        key("faults", Any("list of faults in words"))
            .optional("faults of all runs, in the words of `--fault`; `{NAME}` stands for the value of that axis")
            .guesses("fault"),
        key("seeds", Any("integer, list of integers, or { from, count }"))
            .rule("the scenario's own seed, once", "how many seeds each combination of settings is run with, \
                 from 1 on; or which")
            .guesses("seed runs repeat repeats repetitions trials"),
        key("starts", Table("starts"))
            .rule("those of the scenario", "where robots start, drawn from each seed")
            .guesses("start random_starts poses"),
        key("pace", Word(PACES)).default("'lockstep'", "how time passes").guesses("mode time"),
        key("keep", Word(KEEPS))
            .default("'summary'", "what is kept of each run")
            .guesses("save record store"),
        key("deadline_s", Number(Positive))
            .default("600.0", "longest that a run may take, wall time; one that takes longer is tried again")
            .guesses("timeout limit deadline time_limit"),
    ]
}

fn starts() -> Vec<Key> {
    vec![
        key("box_m", Pair)
            .needed("width along x and height along y of the box that front points are drawn from")
            .guesses("box size area extent"),
        key("apart_m", Number(Positive))
            .needed(
                "no two front points are nearer than this at the start; more than d (Assumption 1)",
            )
            .guesses("apart distance min_distance separation spacing"),
        key("center_m", Pair)
            .rule("the mean of the scenario's own starts", "the middle of the box")
            .guesses("center centre middle origin"),
        key("around", Word(AROUND))
            .default("'middle'", "what the box is around")
            .guesses("about from at"),
        key("goals", Word(GOALS))
            .default("'own'", "where robots go, also drawn from each seed")
            .guesses("goal destinations targets"),
    ]
}

fn case() -> Vec<Key> {
    vec![
        key("axis", Text).needed("the axis that it is a value of, such as \"scene\""),
        key("name", Text).needed("the value, such as \"circle-8\"").guesses("value title id"),
        key("scenario", Text)
            .rule(
                "that of the campaign",
                "the scenario file that its runs begin with, as seen from the campaign file",
            )
            .guesses("file path base experiment"),
        key("set", Table("set"))
            .optional("keys of the scenario that its runs change")
            .guesses("override overrides fixed"),
        key("faults", Any("list of faults in words"))
            .optional("faults of its runs, in the words of `--fault`")
            .guesses("fault"),
        key("starts", Table("starts"))
            .rule("those of the campaign", "where its robots start, drawn from each seed")
            .guesses("start random_starts poses"),
    ]
}

/// The keys that campaign files may have.
pub fn format() -> Format {
    Format::plain(vec![
        Section::new("campaign", "Many runs of one scenario.", root()),
        Section::new(
            "set",
            "Any [key of a scenario](scenario.md), as in `--set`: `duration_s = 20`, \
             `avoidance.kind = \"focus\"`, `robot.r1.pose.x_m = 0.3`.",
            Vec::new(),
        ),
        Section::new(
            "vary",
            "Any [key of a scenario](scenario.md), as in `--set`, with the values that it takes: a list, or \
             `{ from, to, count, spacing }` with `spacing` `\"linear\"` (default) or `\"log\"`. \
             `fault` takes a list of faults in words, or of lists of them, or `\"none\"`. Another \
             name is an axis of numbers or words for `faults`, where `{NAME}` stands for it; with `\"none\"` \
             those faults do not happen.",
            Vec::new(),
        ),
        Section::new(
            "starts",
            "Where robots start: front points even over a box and clear of walls, headings even over a turn, \
             the same for every run with that seed.",
            starts(),
        ),
        Section::new(
            "case",
            "One value of an axis: another scenario, keys, faults or starts, or several of these. All `[[case]]` \
             with the same `axis` are its values.",
            case(),
        ),
    ])
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
