//! Key table of campaign files, of the same kind as that of scenarios, and the reference page generated from it.

use protocol::brief::Pace;
use serde::Deserialize;

use crate::reference::format_sections;
use crate::scenario::fields::table_section;
use crate::scenario::format::FileFormat;
use crate::scenario::keys::NumberRange::Positive;
use crate::{keys, schema, tables};

/// Values of `around`: the center of the box of start positions.
const AROUND_VALUES: &[(&str, &str)] = &[
    ("middle", "one box for all robots, around `center_m`"),
    ("each", "one box for each robot, around its start in the scenario"),
];

/// Values of `pace`: the time mode.
const PACE_VALUES: &[(&str, &str)] = &[
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
const KEEP_VALUES: &[(&str, &str)] = &[
    ("summary", "the scenario, `manifest.json` and `summary.json`"),
    ("failed", "all files of runs that missed an expectation, and as `summary` for the others"),
    ("all", "all files"),
];

/// Values of `goals`: the goals of robots with random starts.
const GOALS_VALUES: &[(&str, &str)] = &[
    ("own", "the goals of the scenario"),
    (
        "swaps",
        "each robot goes to the start of its partner in a random pairing; with an odd number of robots, three exchange starts cyclically",
    ),
];

/// Table `[set]`, with any keys of a scenario.
#[derive(Debug)]
pub enum Set {}

/// Table `[vary]`, with any keys of a scenario.
#[derive(Debug)]
pub enum Vary {}

tables! {
    Root "campaign" "A parameter study: many runs of one scenario." has Root;
    Set "set" "Any [key of a scenario](scenario.md), as in `--set`: `duration_s = 20`, \
             `avoidance.kind = \"focus\"`, `robot.r1.pose.x_m = 0.3`." has;
    Vary "vary" "Any [key of a scenario](scenario.md), as in `--set`, with its values: a list, or \
             `{ from, to, count, spacing }` with `spacing` `\"linear\"` (default) or `\"log\"`. \
             The values of `fault` are faults in the syntax of `--fault`, lists of them, or `\"none\"`. Any other \
             name is an axis of numbers or strings for `faults`, which replace `{NAME}` there. With the value \
             `\"none\"` the faults that name the axis are omitted." has;
    Starts "starts" "Random start poses: front points distributed uniformly over a box and clear of walls, headings distributed \
             uniformly over all directions. All runs with the same seed have the same starts." has Starts;
    Case "case" "One value of an axis, which sets the scenario, keys, faults or starts, or several of these. All `[[case]]` \
             with the same `axis` are the values of that axis." has Case;
}

keys! {
    /// Keys of a campaign file.
    pub Root;

    name: Text =>
        .required("a short name of the campaign, such as \"starts\"")
        .with_synonyms("title id");
    description: Text =>
        .optional("description of the campaign, for readers of the file")
        .with_synonyms("comment about notes");
    scenario: Text =>
        .required("path of the scenario file that all runs are based on, relative to the campaign file")
        .with_synonyms("file path base experiment");
    set: Table<Set> =>
        .optional("scenario keys that are set in all runs")
        .with_synonyms("override overrides fixed");
    vary: Table<Vary> =>
        .optional("axes: scenario keys and the values that they take")
        .with_synonyms("varies varied axes axis grid sweep params parameters matrix");
    case: Tables<Case> =>
        .optional("axes whose values set several keys together. In the order of the runs they change more \
            slowly than the axes in `vary`")
        .with_synonyms("cases variant variants scene scenes condition conditions");
    zip: Any("list of lists of axes") =>
        .optional("groups of axes that vary together, such as [[\"period_s\", \"duration_s\"]]; all other axes form a full grid")
        .with_synonyms("paired together");
    faults: Any("list of faults") =>
        .optional("faults of all runs, in the syntax of `--fault`; `{NAME}` is replaced by the value of the axis NAME")
        .with_synonyms("fault");
    seeds: Any("integer, list of integers, or { from, count }") =>
        .rule("one run with the seed of the scenario", "seeds with which each combination of settings is run: \
            their number (1, 2, ...), a list, or a range")
        .with_synonyms("seed runs repeat repeats repetitions trials");
    starts: Table<Starts> =>
        .rule("the starts of the scenario", "random start poses, drawn from each seed")
        .with_synonyms("start random_starts poses");
    pace: Word<Pace>(PACE_VALUES) =>
        .default("'lockstep'", "time mode")
        .with_synonyms("mode time");
    keep: Word<FileRetention>(KEEP_VALUES) =>
        .default("'summary'", "files that are kept of each run")
        .with_synonyms("save record store");
    deadline_s: Number(Positive) =>
        .default("600.0", "maximum wall time of a run; a run that takes longer is repeated")
        .with_synonyms("timeout limit deadline time_limit");
}

keys! {
    /// Keys of `[starts]`.
    pub Starts;

    box_m: Pair =>
        .required("width along x and height along y of the box from which the starts of front points are drawn")
        .with_synonyms("box size area extent");
    apart_m: Number(Positive) =>
        .required("minimum distance of two front points at the start; must be more than d (Assumption 1)")
        .with_synonyms("apart distance min_distance separation spacing");
    center_m: Pair =>
        .rule("the mean of the starts in the scenario", "center of the box")
        .with_synonyms("center centre middle origin");
    around: Word<String>(AROUND_VALUES) =>
        .default("'middle'", "center of the box")
        .with_synonyms("about from at");
    goals: Word<GoalAssignment>(GOALS_VALUES) =>
        .default("'own'", "goals of the robots, also drawn from each seed")
        .with_synonyms("goal destinations targets");
}

keys! {
    /// Keys of `[[case]]`.
    pub Case;

    axis: Text => .required("name of the axis, such as \"scene\"");
    name: Text =>
        .required("name of the value on that axis, such as \"circle-8\"")
        .with_synonyms("value title id");
    scenario: Text =>
        .rule("the scenario of the campaign", "path of the scenario file that the runs of this case are based on, relative to the campaign file")
        .with_synonyms("file path base experiment");
    set: Table<Set> =>
        .optional("scenario keys that are set in the runs of this case")
        .with_synonyms("override overrides fixed");
    faults: Any("list of faults") =>
        .optional("faults of the runs of this case, in the syntax of `--fault`")
        .with_synonyms("fault");
    starts: Table<Starts> =>
        .rule("the starts of the campaign", "random start poses of the runs of this case, drawn from each \
            seed")
        .with_synonyms("start random_starts poses");
}

/// Returns the format of campaign files.
pub fn campaign_format() -> FileFormat {
    FileFormat::without_catalog(vec![
        table_section::<Root>(),
        table_section::<Set>(),
        table_section::<Vary>(),
        table_section::<Starts>(),
        table_section::<Case>(),
    ])
}

/// Files that are kept of each run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FileRetention {
    /// Scenario, manifest and summary.
    Summary,
    /// All files of runs that missed an expectation, and the summary of the others.
    Failed,
    /// All files of all runs.
    All,
}

impl FileRetention {
    /// Returns the value of `keep` in campaign files.
    pub fn keyword(self) -> &'static str {
        match self {
            FileRetention::Summary => "summary",
            FileRetention::Failed => "failed",
            FileRetention::All => "all",
        }
    }
}

/// Goals of robots with random starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GoalAssignment {
    /// The goals of the scenario.
    Own,
    /// The start of the partner in a random pairing. With an odd number of robots, three exchange starts cyclically.
    Swaps,
}

impl GoalAssignment {
    /// Returns the value of `goals` in campaign files.
    pub fn keyword(self) -> &'static str {
        match self {
            GoalAssignment::Own => "own",
            GoalAssignment::Swaps => "swaps",
        }
    }
}

const PAGE_HEAD: &str = "\
# Campaign files

Generated by `phalanx schema --campaign --markdown` from the key table that the campaign parser uses; do not edit it. How to use them:
[a campaign](../tutorial/campaign.md), [on a cluster](../how-to/cluster.md).

A key that is marked **needed** is required if its table is given.
";

/// Returns the JSON Schema of campaign files.
pub fn campaign_schema() -> String {
    schema::schema_for_format(&campaign_format(), "A Phalanx campaign")
}

/// Returns the reference page of campaign keys, in Markdown.
pub fn campaign_reference_page() -> String {
    PAGE_HEAD.to_owned() + &format_sections(&campaign_format(), "The whole campaign file")
}
