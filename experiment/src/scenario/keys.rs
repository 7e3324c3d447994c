//! Table of the scenario format: the single source for the type, unit, range, default and description of every key.
//!
//! The parser uses the types, units, ranges and defaults of these rows, diagnostics use their descriptions, and the
//! JSON Schema and the reference page use all columns. The formats of campaign and fleet files have tables of the
//! same kind. Conditions on several values are checked where the values are parsed, and in [`crate::check`]. This
//! module parses nothing.
//!
//! To rename a key, change the name in its row and add the old name to `old_names`. Files with the old name are then
//! accepted with a warning.

use std::borrow::Cow;

use protocol::avoidance::Gain;
use protocol::catalog::Catalog;
use protocol::law::LIARS_MAX;
use toml::de::DeValue;

use super::diagnostic::meant;
use super::fault::FORMS;
use super::models;

/// Version of the scenario format.
pub const FORMAT: u64 = 1;

/// Maximum number of periods for which a command may be held.
const HOLD_PERIODS_MAX: u64 = 100;
/// Maximum number of consecutive messages lost together. A larger value is assumed to be a typing error.
const BURST_MAX: u64 = 1_000_000;
/// Maximum number of load processes. A larger value is assumed to be a typing error.
const LOAD_MAX: u64 = 256;
/// Maximum value of the gain `liars_max`: the maximum in-degree of a robot.
const LIARS_LIMIT: u64 = 1000;
/// Maximum number of backup neighbors that are chosen for a robot.
const SPARES_MAX: u64 = 16;
/// Maximum memory limit of an external program, MB (1 TB).
const MEMORY_MB_MAX: u64 = 1 << 20;

/// A key of a table: one row of the format.
#[derive(Debug, Clone)]
pub struct Key {
    /// Name of the key, with the unit as suffix.
    pub name: &'static str,
    /// Type and range of the value of the key.
    pub value_type: ValueType,
    /// Behavior if the key is missing.
    pub if_missing: IfMissing,
    /// Description of the key, in one line.
    pub description: Cow<'static, str>,
    /// Former names of the key. They are accepted with a warning.
    pub old_names: &'static [&'static str],
    /// Accepted range as text, if more is checked than the range of the type. Empty otherwise.
    pub bounds: &'static str,
    /// Words that users write for this key, in lower case and without unit, separated by spaces.
    pub guesses: &'static str,
}

/// Type of a value. Numbers have the unit in which the name of the key ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ValueType {
    /// A string, not limited to certain words.
    Text,
    /// A string that is one of the given words, each with its description.
    Word(&'static [(&'static str, &'static str)]),
    /// Name of one of the kinds of the section.
    Kind,
    /// Name of a control law.
    Law,
    /// Name of an avoidance method.
    Method,
    /// A boolean, `true` or `false`.
    Truth,
    /// A floating-point number within a range.
    Number(Range),
    /// A time in seconds that is a whole number of nanoseconds.
    Time(Range),
    /// A list of times in seconds, at least 0, that are whole numbers of nanoseconds.
    Times,
    /// An integer with its minimum and maximum.
    Whole(u64, u64),
    /// Two numbers, `[x, y]`.
    Pair,
    /// A list of points `[x, y]`.
    Points,
    /// A list of strings.
    Texts,
    /// A list of robot names.
    Names,
    /// A list of robot names, or a number of robots.
    NamesOrCount,
    /// A table with the keys of the named section.
    Table(&'static str),
    /// A list of tables with the keys of the named section.
    Tables(&'static str),
    /// A table of tables with the keys of the named section. The file chooses the name of each.
    NamedTables(&'static str),
    /// A value of any type, described by this text.
    Any(&'static str),
}

/// Range of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Range {
    /// No bound other than the magnitude.
    Any,
    /// Numbers from 0.
    NotNegative,
    /// Numbers greater than 0.
    Positive,
    /// All numbers other than 0.
    NotZero,
}

/// Behavior if a key is missing.
#[derive(Debug, Clone)]
pub enum IfMissing {
    /// Error: the key is required.
    Needed,
    /// This value is used.
    Default(DeValue<'static>),
    /// A rule, described by this text, determines the value.
    Rule(Cow<'static, str>),
    /// The feature of the key is off.
    Absent,
}

/// A section of the format: the keys of one table.
#[derive(Debug)]
pub struct Section {
    /// Name of the section, in general the key of the table.
    pub name: &'static str,
    /// Description of the table, in one line.
    pub description: &'static str,
    /// Keys of the table, in the order of the reference page.
    pub keys: Vec<Key>,
    /// Values of the key `kind`, if it determines which other keys are allowed. If empty, all keys are.
    pub kinds: Vec<Kind>,
    /// Keys of earlier versions that have no successor.
    pub withdrawn: &'static [Withdrawn],
}

/// Keys of earlier versions of the format that have no successor.
#[derive(Debug)]
pub struct Withdrawn {
    /// Names of the keys.
    pub names: &'static [&'static str],
    /// Remedy: what holds now, and what to write instead.
    pub remedy: &'static str,
}

/// A value of the key `kind`, and the other keys that it requires and allows.
#[derive(Debug, Clone)]
pub struct Kind {
    /// Value of the key `kind`.
    pub word: &'static str,
    /// Description of the kind, in one line.
    pub description: &'static str,
    /// Required keys.
    pub needs: Vec<&'static str>,
    /// Optional keys.
    pub may: Vec<&'static str>,
}

/// File format: all sections, and the known control laws and avoidance methods.
#[derive(Debug)]
pub struct Format {
    /// Sections. The first is the whole file.
    pub sections: Vec<Section>,
    /// Names of the control laws.
    pub laws: Vec<&'static str>,
    /// Names of the avoidance methods. The first is the default.
    pub methods: Vec<&'static str>,
}

/// Returns the row of an optional key without a description.
pub fn key(name: &'static str, value_type: ValueType) -> Key {
    Key {
        name,
        value_type,
        if_missing: IfMissing::Absent,
        description: Cow::Borrowed(""),
        old_names: &[],
        bounds: "",
        guesses: "",
    }
}

impl Key {
    /// Makes the key required and sets its description.
    pub fn needed(self, description: &'static str) -> Key {
        Key { if_missing: IfMissing::Needed, description: description.into(), ..self }
    }

    /// Makes the key optional and sets its description. Without the key, its feature is off.
    pub fn optional(self, description: &'static str) -> Key {
        Key { if_missing: IfMissing::Absent, description: description.into(), ..self }
    }

    /// Sets the default value, written in TOML, and the description.
    ///
    /// # Panics
    ///
    /// If `value` is not TOML.
    pub fn default(self, value: &'static str, description: &'static str) -> Key {
        let value = DeValue::parse(value).expect("a default is TOML").into_inner();
        Key { if_missing: IfMissing::Default(value), description: description.into(), ..self }
    }

    /// Sets the rule, as text, that holds if the key is missing, and the description.
    pub fn rule(
        self,
        rule: impl Into<Cow<'static, str>>,
        description: impl Into<Cow<'static, str>>,
    ) -> Key {
        Key { if_missing: IfMissing::Rule(rule.into()), description: description.into(), ..self }
    }

    /// Sets the text of the accepted range, for a key with more checks than the range of its type.
    fn bounds(self, bounds: &'static str) -> Key {
        Key { bounds, ..self }
    }

    /// Sets the words that users write for this key, in lower case, without unit, separated by spaces.
    pub fn guesses(self, guesses: &'static str) -> Key {
        Key { guesses, ..self }
    }

    /// Returns the name of the key and its former names.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        [self.name].into_iter().chain(self.old_names.iter().copied())
    }

    /// Returns the unit of the value, or "" if it has none.
    pub(crate) fn unit(&self) -> &'static str {
        match self.value_type {
            ValueType::Number(_)
            | ValueType::Pair
            | ValueType::Points
            | ValueType::Time(_)
            | ValueType::Times => {
                let name = self.name.strip_suffix("_max").unwrap_or(self.name);
                UNITS.iter().find(|(suffix, _)| name.ends_with(suffix)).map_or("", |unit| unit.1)
            }
            _ => "",
        }
    }

    /// Returns whether a user probably means this key by `word`: it is the name without unit, or one of the `guesses`.
    pub(crate) fn is_meant_by(&self, word: &str) -> bool {
        let guess = stem(word);
        stem(self.name) == guess || self.guesses.split(' ').any(|known| known == guess)
    }
}

impl Section {
    /// Creates a section with these keys.
    pub fn new(name: &'static str, description: &'static str, keys: Vec<Key>) -> Section {
        Section { name, description, keys, kinds: Vec::new(), withdrawn: &[] }
    }

    /// Adds the values of the key `kind`, which determine the allowed keys.
    fn with_kinds(self, kinds: impl IntoIterator<Item = Kind>) -> Section {
        Section { kinds: kinds.into_iter().collect(), ..self }
    }

    /// Adds the keys of earlier versions that have no successor.
    fn without(self, withdrawn: &'static [Withdrawn]) -> Section {
        Section { withdrawn, ..self }
    }

    /// Returns the remedy for the withdrawn key `word`, or `None` if it was never a key.
    pub(crate) fn remedy_for_withdrawn(&self, word: &str) -> Option<&'static str> {
        let lost = self.withdrawn.iter().find(|lost| lost.names.contains(&word));
        lost.map(|lost| lost.remedy)
    }

    /// Returns the row of the key `name`, or `None` if the section has none.
    pub fn key(&self, name: &str) -> Option<&Key> {
        self.keys.iter().find(|key| key.name == name)
    }

    /// Returns the values of the key `kind`, without repetitions.
    pub fn kind_names(&self) -> Vec<&'static str> {
        let mut words: Vec<&str> = self.kinds.iter().map(|kind| kind.word).collect();
        words.dedup();
        words
    }
}

impl Kind {
    /// Creates a kind. `needs` and `may` are lists of keys, separated by spaces.
    fn new(
        word: &'static str,
        description: &'static str,
        needs: &'static str,
        may: &'static str,
    ) -> Kind {
        let list = |keys: &'static str| keys.split_whitespace().collect();
        Kind { word, description, needs: list(needs), may: list(may) }
    }

    /// Returns whether the kind requires or allows `key`.
    pub(crate) fn allows(&self, key: &str) -> bool {
        self.needs.contains(&key) || self.may.contains(&key)
    }
}

impl Format {
    /// Returns the scenario format with the control laws and avoidance methods of `catalog`.
    pub fn new(catalog: &Catalog) -> Format {
        Format {
            sections: Format::sections(catalog),
            laws: catalog.laws.iter().map(|law| law.name).collect(),
            methods: catalog.methods.iter().map(|method| method.name).collect(),
        }
    }

    /// Returns all tables of a scenario, in the order of the reference.
    fn sections(catalog: &Catalog) -> Vec<Section> {
        let gains = gains(catalog);
        let faults = FORMS.iter().map(|form| Kind {
            word: form.kind,
            description: form.description,
            needs: form.needs(),
            may: form.may(),
        });
        vec![
            Section::new("scenario", "One experiment.", root()),
            Section::new(
                "realtime",
                "Latencies that the experiment tolerates, in real time.",
                realtime(),
            ),
            Section::new(
                "avoidance",
                "Collision avoidance: the method, the distances that it keeps, and its parameters.",
                [avoidance(), gains_of_methods(catalog)].concat(),
            )
            .without(WITHDRAWN_FROM_AVOIDANCE),
            Section::new(
                "silence",
                "Communication timeouts: when an in-neighbor counts as stale and as lost, and what a robot does then.",
                silence(),
            ),
            Section::new(
                "law",
                "A control law that an external program computes: a table `[laws.NAME]`.",
                [law(), program()].concat(),
            ),
            Section::new(
                "plant",
                "An external program that simulates the robots, in place of the built-in exact unicycle model.",
                program(),
            ),
            Section::new(
                "robot_defaults",
                "Default values of keys that a `[[robot]]` does not set.",
                [defaults(), gains.clone()].concat(),
            ),
            Section::new(
                "robot",
                "One robot: its name, start, control law, neighbors and hardware.",
                [robot(), defaults(), gains].concat(),
            ),
            Section::new("pose", "A pose in the frame `map`.", pose()),
            Section::new(
                "wheels",
                "Differential drive: maximum wheel speed and track width.",
                wheels(),
            ),
            Section::new("limits", "Inertia: maximum accelerations of the robot.", limits()),
            Section::new(
                "edge",
                "A directed communication link: the robot `to` receives the beacons of the robot `from`.",
                edge(),
            ),
            Section::new("wall", "A wall: a chain of line segments.", wall()),
            Section::new("obstacle", "A fixed obstacle.", obstacle()).with_kinds([
                Kind::new("disc", "a disc", "center_m radius_m", ""),
                Kind::new("polygon", "a convex polygon", "corners_m", ""),
            ]),
            Section::new(
                "trajectory",
                "Reference trajectory of the leader's front point.",
                trajectory(),
            )
            .with_kinds(trajectories()),
            Section::new("scale", "Time-varying scale of the formation.", scale())
                .with_kinds(scales()),
            Section::new("fault", "An injected fault.", fault()).with_kinds(faults),
            Section::new(
                "chaos",
                "Kills, freezes and partitions at random times, drawn from the seed.",
                chaos(),
            ),
            Section::new(
                "expect",
                "Acceptance criteria. If one is missed, the exit code is not 0.",
                expect(),
            ),
            Section::new(
                "hunt",
                "Search space of `phalanx hunt`: what it varies, and within which bounds.",
                hunt(),
            ),
        ]
    }

    /// Returns a format without control laws and avoidance methods.
    pub fn without_catalog(sections: Vec<Section>) -> Format {
        Format { sections, laws: Vec::new(), methods: Vec::new() }
    }

    /// Returns the section of the whole file.
    pub fn root(&self) -> &Section {
        &self.sections[0]
    }

    /// Returns the section `name`.
    ///
    /// # Panics
    ///
    /// If there is no such section.
    pub fn section(&self, name: &str) -> &Section {
        let found = self.sections.iter().find(|section| section.name == name);
        found.unwrap_or_else(|| panic!("`{name}` is a section"))
    }

    /// Returns the key that a user probably means by `word`, as a path for `--set`, or `None`. Searches the top level
    /// and the tables that occur once.
    pub fn key_meant_by(&self, word: &str) -> Option<String> {
        let key = |section: &Section| {
            section.keys.iter().find(|key| key.is_meant_by(word)).map(|key| key.name)
        };
        let tables = ["avoidance", "realtime", "silence", "expect"];
        let within = |table: &&str| Some(format!("{table}.{}", key(self.section(table))?));
        key(self.root()).map(str::to_owned).or_else(|| tables.iter().find_map(within))
    }

    /// Returns the remedy for the unknown key `word`: the most similar key, or the list of allowed keys. `rows` are the
    /// allowed keys of the section. If `elsewhere` is set, keys of other sections are suggested, too.
    pub(crate) fn suggestion(
        &self,
        section: &Section,
        rows: &[&Key],
        word: &str,
        elsewhere: bool,
    ) -> String {
        let names = || rows.iter().map(|key| key.name);
        let guessed = rows.iter().find(|key| key.is_meant_by(word)).map(|key| key.name);
        if let Some(close) = guessed.or_else(|| meant(word, names())) {
            return format!("did you mean `{close}`?");
        }
        let others = self.sections.iter().filter(|other| elsewhere && other.name != section.name);
        let mut keys = others.flat_map(|other| other.keys.iter().map(move |key| (other, key)));
        match keys.find(|(_, key)| key.is_meant_by(word)) {
            Some((other, key)) if std::ptr::eq(other, self.root()) => {
                format!("did you mean `{}`, outside of all tables?", key.name)
            }
            Some((other, key)) => format!("did you mean `{}` in `{}`?", key.name, other.name),
            None => format!("expected one of {}", names().collect::<Vec<_>>().join(", ")),
        }
    }
}

/// Returns the keys of the gains of all control laws. Each is required by the laws that use it.
fn gains(catalog: &Catalog) -> Vec<Key> {
    let mut gains: Vec<Key> = Vec::new();
    for &name in catalog.laws.iter().flat_map(|law| law.gains) {
        if gains.iter().all(|gain| gain.name != name) {
            let users = catalog.laws.iter().filter(|law| law.gains.contains(&name));
            let users: Vec<_> = users.map(|law| format!("`{}` {}", law.name, law.source)).collect();
            let laws = if users.len() == 1 { "law" } else { "laws" };
            let meaning = gain_meaning(name);
            let description = format!("{meaning}; used by the {laws} {}", users.join(", "));
            gains.push(gain(name, "needed with a law that uses it".into(), description));
        }
    }
    gains
}

fn gains_of_methods(catalog: &Catalog) -> Vec<Key> {
    let gains = catalog.methods.iter().flat_map(|m| m.gains.iter().map(move |g| (m.name, g)));
    let key = |(name, g): (&str, &Gain)| {
        let needed_with = format!("needed with `{name}`");
        gain(g.key, needed_with.into(), format!("{}; for `{name}`", g.meaning))
    };
    gains.map(key).collect()
}

/// Returns the meaning of a gain of a built-in control law, or "gain of a control law" for any other gain.
fn gain_meaning(name: &str) -> &'static str {
    match name {
        "speed_m_s" => "mu: speed at which the robot moves straight to its desired point",
        "k_m_m_s" => {
            "k_m: maximum velocity, along each axis, with which the leader corrects its tracking error"
        }
        "k_f_m_s" => {
            "k_f: maximum velocity, along each axis, with which the robot corrects its formation error"
        }
        "k_c_m_s" => {
            "k_c: maximum velocity, along each axis, with which the robot moves to the mean of its in-neighbors"
        }
        "k_g_m_s" => {
            "k_g: maximum velocity, along each axis, with which the robot moves to its goal"
        }
        LIARS_MAX => {
            "F: maximum number of Byzantine in-neighbors of a robot. The robot discards up to F extreme values on either \
             side"
        }
        _ => "gain of a control law",
    }
}

/// Returns the key of a positive gain. `needed_with` names its users.
fn gain(name: &'static str, needed_with: Cow<'static, str>, description: String) -> Key {
    if name == LIARS_MAX {
        return key(name, Whole(1, LIARS_LIMIT))
            .rule(needed_with, description)
            .guesses("f liars f_max liars_max_count adversaries");
    }
    let guesses = match name {
        "speed_m_s" => "mu gain k v velocity",
        "k_f_m_s" => "kf k_formation mu_f",
        "k_c_m_s" => "kc k_containment k_contained mu_c",
        "k_m_m_s" => "km k_m k_leader mu_m",
        "k_g_m_s" => "kg k_g k_goal",
        "epsilon_per_s" => "eps e strength",
        _ => "",
    };
    key(name, Number(Positive)).rule(needed_with, description).guesses(guesses)
}

/// Constants of the deflection, which were keys of earlier versions.
const WITHDRAWN_FROM_AVOIDANCE: &[Withdrawn] = &[Withdrawn {
    names: &[
        "dither_rad",
        "around",
        "around_at_last",
        "impatience_time",
        "slack_share",
        "margin",
        "look_ahead",
        "look_ahead_share",
        "look_ahead_turn_rad",
        "yield",
        "yield_speed",
        "yield_reach",
    ],
    remedy: "expected no such key: `guard` steers with constants that were found by search",
}];

/// Suffixes of key names and their units, longer suffixes first.
const UNITS: &[(&str, &str)] = &[
    ("cycles", "cycles per period"),
    ("_rad_s2", "rad/s^2"),
    ("_m_s2", "m/s^2"),
    ("_per_s", "1/s"),
    ("_rad_s", "rad/s"),
    ("_m_s", "m/s"),
    ("_rad", "rad"),
    ("_hz", "Hz"),
    ("_ms", "ms"),
    ("_m", "m"),
    ("_s", "s"),
];

/// Returns `word` as in `guesses`: in lower case, without unit.
fn stem(word: &str) -> String {
    let word = word.to_lowercase().replace('-', "_");
    let suffix = UNITS.iter().find_map(|(suffix, _)| word.strip_suffix(suffix));
    suffix.filter(|stem| !stem.is_empty()).unwrap_or(&word).to_owned()
}

use Range::{Any, NotNegative, NotZero, Positive};
use ValueType::{
    Law, Method, NamedTables, Names, NamesOrCount, Number, Pair, Points, Table, Tables, Text,
    Texts, Time, Times, Truth, Whole, Word,
};

fn root() -> Vec<Key> {
    let mut keys = run_keys();
    keys.extend(experiment());
    keys.extend(repair());
    keys
}

/// Returns the keys of the run: name, duration and timeouts.
fn run_keys() -> Vec<Key> {
    vec![
        key("format", Whole(FORMAT, FORMAT))
            .default("1", "version of the file format")
            .guesses("version format_version schema"),
        key("name", Text)
            .needed("a short name of the experiment, such as \"triangle\"")
            .guesses("title id"),
        key("description", Text).optional("description of the experiment, for readers of the file").guesses("comment about notes"),
        key("duration_s", Time(Positive))
            .needed("maximum duration of the run")
            .guesses("end t_end tmax t_max t_final tf length horizon time total_time"),
        key("end_after_converged_s", Time(Positive))
            .optional("ends the run early: time for which the errors of all living robots must have stayed below \
                       `converged_error_m`. They must also have been below it over the last 10 % of the run so \
                       far, and no fault, opening or closing of the formation, or waypoint may still be to come")
            .guesses("end_when_converged_s stop_when_converged_s settle_s early_stop_s"),
        key("period_s", Time(Positive))
            .needed("control period T: time between two commands of a robot, such as 0.005")
            .bounds("above 0, to `duration_s`")
            .guesses("dt t ts delta_t step time_step timestep sample_time sampling_time sampling_period \
                      control_period cycle_time tick"),
        key("seed", Whole(0, i64::MAX as u64))
            .default("1", "seed of the random number generator, from which all random values are drawn, such as \
                           lost messages, noise and `[chaos]`. In lockstep, the same file and seed give the same \
                           run")
            .guesses("random_seed rng_seed rng"),
        key("record_hz", Number(Positive))
            .default("100.0", "recording rate: samples per robot and second of run time, in `samples.csv` and in the recording")
            .guesses("record record_rate sample_rate log_rate rate logging"),
        key("hung_after_s", Time(Positive))
            .default(
                "60.0",
                "watchdog timeout in lockstep: maximum wall time that a process may take to answer, counted \
                 while it runs or is blocked, not while it waits for a CPU core. After that the process counts \
                 as hung, and the run ends with exit code 4",
            )
            .bounds("0.1 to 1e7")
            .guesses("hung timeout hang deadline"),
        key("ready_after_s", Time(Positive))
            .default(
                "10.0",
                "start timeout: maximum time that a robot's process may take to become ready, in lockstep and in real \
                 time. It is counted while the process runs or is blocked, not while it waits for a CPU core",
            )
            .bounds("0.1 to 3600")
            .guesses("ready start_timeout startup_timeout start_limit import_timeout"),
        key("stopped_after_s", Time(Positive))
            .rule(
                "no limit; 60 if the environment variable `CI` is set",
                "maximum time in lockstep that a process may stay stopped by a SIGSTOP from outside of the run. After \
                 that the run ends with exit code 4",
            )
            .guesses("stopped sigstop"),
    ]
}

/// Returns the keys of the experiment: robots, graph, environment, faults and acceptance criteria.
fn experiment() -> Vec<Key> {
    vec![
        key("published_velocity", Word(&[
                ("gamma", "the nominal velocity, computed by the control law"),
                ("gamma+beta", "the nominal velocity after collision avoidance"),
                ("differenced", "the difference quotient of the last two positions"),
            ]))
            .default("'gamma'", "velocity that a robot publishes in its beacons, for control laws of its \
                                 out-neighbors that use it (feed-forward)"),
        key("trajectory", Table("trajectory"))
            .rule("needed with a leader", "reference trajectory of the leader's front point")
            .guesses("path reference m"),
        key("scale", Table("scale"))
            .rule("constant 1", "scale of the formation as a function of time: a factor on all offsets between \
                                 robots")
            .guesses("delta scaling"),
        key("avoidance", Table("avoidance"))
            .needed("collision avoidance: a table with `kind`, `distance_min_m`, `speed_max_m_s`")
            .guesses("collision_avoidance collision safety guard repulsion"),
        key("realtime", Table("realtime"))
            .optional("real time only: latencies that the experiment tolerates")
            .guesses("real_time rt"),
        key("silence", Table("silence"))
            .optional("communication timeouts: when an in-neighbor counts as stale and as lost"),
        key("laws", NamedTables("law"))
            .optional("control laws that external programs compute, each a table `[laws.NAME]`"),
        key("plant", Table("plant"))
            .optional("external program that simulates the robots, in place of the built-in simulator")
            .guesses("simulator physics engine world hardware driver"),
        key("robot_defaults", Table("robot_defaults"))
            .optional("default values of keys that a `[[robot]]` does not set")
            .guesses("defaults default robots_defaults"),
        key("robot", Tables("robot"))
            .needed("the robots: at least one table headed `[[robot]]`, or robot = [{ ... }, ...]")
            .guesses("robots agent agents node nodes vehicle vehicles"),
        key("edge", Tables("edge"))
            .optional("communication links between robots; a robot can also list its in-neighbors with `hears`")
            .guesses("edges link links neighbor neighbors neighbour neighbours connections adjacency"),
        key("graph", Text)
            .optional("graph file with edges and optionally robots: .json (node-link), .csv (adjacency matrix) or .graphml")
            .guesses("graph_file network topology import"),
        key("drop_edges_to_leaders", Truth)
            .default(
                "false",
                "true: edges to a leader are dropped. false: they are an error. An undirected `graph` has such an edge \
                 for each robot that receives from the leader",
            )
            .guesses("drop_edges ignore_edges_to_leaders"),
        key("wall", Tables("wall"))
            .optional("walls: chains of line segments")
            .guesses("walls lines segments boundary"),
        key("obstacle", Tables("obstacle"))
            .optional("obstacles: discs and convex polygons")
            .guesses("obstacles disc discs polygon polygons shelf shelves"),
        key("fault", Tables("fault"))
            .optional("faults to inject")
            .guesses("faults failure failures event events"),
        key("chaos", Table("chaos"))
            .optional("kills, freezes and partitions at random times")
            .guesses("random_faults chaos_monkey"),
        key("expect", Table("expect"))
            .optional("acceptance criteria; if one is missed, the exit code is not 0")
            .guesses("expectations expected assert require check"),
        key("hunt", Table("hunt"))
            .optional("search space of `phalanx hunt`")
            .guesses("search fuzz falsify"),
    ]
}

/// Returns the keys of topology repair and leader failover.
fn repair() -> Vec<Key> {
    vec![
        key("deputies", Names)
            .optional(
                "backup leaders, in order: while the main leader is lost, the first of them that is alive leads \
                 the formation, from its own slot in it",
            )
            .guesses("deputy successors succession backup_leaders"),
        key(
            "repair",
            Word(&[
                (
                    "none",
                    "a robot with a lost in-neighbor uses the others, according to `silence.policy`",
                ),
                ("spares", "it uses a backup neighbor in place of the lost in-neighbor"),
            ]),
        )
        .default("'none'", "topology repair after a permanent loss of robots")
        .guesses("heal healing self_healing reconnect"),
        key("spares", Whole(0, SPARES_MAX))
            .default("2", "number of backup neighbors chosen for each robot that does not list its own")
            .guesses("backups fallbacks"),
        key("repair_after_s", Time(NotNegative))
            .default(
                "0.5",
                "time for which an in-neighbor must be lost before a backup neighbor replaces it, and heard again \
                 before it replaces the backup neighbor (hysteresis)",
            )
            .guesses("repair_after heal_after"),
    ]
}

fn realtime() -> Vec<Key> {
    vec![
        key("plant_tick_s", Time(Positive))
            .default("0.001", "T_p: simulation step of the plant (the simulated robots and sensors) in real \
                               time. A smaller step reduces latency and takes more CPU time")
            .guesses("tick plant_period t_p"),
        key("latency_allowed_s", Time(NotNegative))
            .default("0.002", "L: maximum latency from an odometry sample to the command that answers it, a part \
                               of the command lifetime H. With a larger L the guard brakes earlier")
            .guesses("l latency latency_max"),
        key("between_hosts_s", Time(NotNegative)).default(
            "0.0",
            "additional round-trip latency between the hosts of a fleet. The command lifetime H grows by it, \
             rounded up to whole periods. `--fleet` sets it to `latency_max_s` of the fleet file",
        ),
        key("hold_periods", Whole(1, HOLD_PERIODS_MAX))
            .default("2", "h: number of control periods for which the plant may hold a command if no newer one \
                           arrives, a part of the command lifetime H. A larger h tolerates more late commands, \
                           but the guard brakes earlier")
            .guesses("h hold periods"),
        key("control_timer", Truth)
            .default(
                "true",
                "whether to run one more process, which only waits on the same timer as the robots and computes \
                 nothing. Its wake-up latency is the baseline for that of the robots",
            )
            .guesses("control control_group baseline machine"),
    ]
}

fn avoidance() -> Vec<Key> {
    vec![
        key("kind", Method)
            .rule("`guard`", "collision avoidance method")
            .guesses("method type mode name"),
        key("distance_min_m", Number(Positive))
            .needed("d: minimum distance between two front points")
            .guesses(
                "d d_min dmin min_distance minimum_distance minimal_distance safe_distance \
                      safety_distance distance radius",
            ),
        key("speed_max_m_s", Number(Positive))
            .rule("no limit; `guard` needs one", "v_max: maximum speed of a front point")
            .guesses("v_max vmax max_speed speed max_velocity velocity_max speed_limit v"),
        key("clearance_m", Number(Positive))
            .rule(
                "half of `distance_min_m`",
                "minimum distance of a front point from walls and obstacles",
            )
            .guesses("clearance wall_distance obstacle_distance margin d_o"),
        key("sensing_radius_m", Number(Positive))
            .rule(
                "the largest radius that the method can use",
                "sensing radius: distance up to which a robot senses other robots and walls",
            )
            .guesses("sensing sensor_range range sensing_range r_s"),
        key("sensing_error_m", Number(NotNegative))
            .rule("0, or the bound of the noise faults", "maximum error of a sensed distance, which the guard \
                                                          assumes. With a larger value robots keep farther apart")
            .guesses("error sensing_noise"),
        key("heading_error_rad", Number(NotNegative))
            .rule(
                "0, or the bound of the noise faults",
                "maximum error of a robot's own sensed heading, which the guard assumes. With a larger value \
                 robots keep farther apart",
            )
            .guesses("heading_noise heading_error_deg"),
    ]
}

fn silence() -> Vec<Key> {
    vec![
        key("stale_after_s", Time(Positive))
            .rule("3 periods", "age of an in-neighbor's newest beacon above which the in-neighbor counts as \
                                stale: it is still used, extrapolated with its last velocity")
            .bounds("above 0, to `lost_after_s`")
            .guesses("stale"),
        key("lost_after_s", Time(Positive))
            .rule("20 periods, at least 0.1 s", "age of an in-neighbor's newest beacon above which the \
                                                 in-neighbor counts as lost (timed out), and `policy` applies")
            .bounds("`stale_after_s` to 1e7")
            .guesses("lost timeout"),
        key(
            "policy",
            Word(&[
                ("last", "lost in-neighbors are ignored; if all are lost, as with `keep`"),
                ("ignore", "lost in-neighbors are ignored; a robot without any other in-neighbor stops"),
                ("keep", "lost in-neighbors are assumed to be at rest at their last extrapolated position"),
                ("stop", "a robot stops while any in-neighbor is lost"),
            ]),
        )
        .default("'last'", "reaction of a robot to lost in-neighbors"),
    ]
}

/// Returns the keys of a control law in an external program, without those of the program.
fn law() -> Vec<Key> {
    vec![
        key("role", Word(&[
                ("leader", "the robot tracks the trajectory"),
                ("formation", "the robot keeps a slot in the formation"),
                ("contained", "the robot moves to the mean of its in-neighbors"),
                ("goal", "the robot moves to its `goal_m`"),
            ]))
            .needed("role of the robots with this law; it determines the desired point, from which their error \
                     is measured")
            .guesses("kind type"),
        key("gains", Texts)
            .rule("none", "names of the gains of the law, each with the unit as suffix. They become keys of the robots with this law, must be given, and must be above 0")
            .guesses("parameters params gain"),
        key("feed_forward", Truth)
            .default("false", "whether the law uses the velocities of its in-neighbors. If so, `phalanx check` checks that \
                 velocity feedback between robots decays"),
        key("correction_max", Text)
            .optional("name of one of the `gains`, in m/s: the maximum, along each axis, of the velocity with \
                       which the law corrects the error. Velocities of in-neighbors that the law adds do not \
                       count. `phalanx check` computes its bounds on speed from it, and none without this key"),
    ]
}

/// Returns the keys of an external program.
fn program() -> Vec<Key> {
    vec![
        key("program", Texts)
            .needed("the program and its arguments, as in [\"python3\", \"program.py\"]. Files among them must \
                     be in the scenario's folder; they are copied into the directory of the run")
            .guesses("command cmd executable script run"),
        key("files", Texts)
            .rule("none", "additional files and folders that the program needs, relative to the scenario's folder. A folder is copied with its contents")
            .guesses("data needs modules"),
        key("memory_max_mb", Whole(1, MEMORY_MB_MAX))
            .rule("no limit", "memory limit in MB: for each process of the program (RLIMIT_DATA), and for all of them together")
            .guesses("memory memory_max max_memory memory_limit"),
    ]
}

/// Returns the keys that only `[[robot]]` has.
fn robot() -> Vec<Key> {
    vec![
        key("name", Text).needed("unique name of the robot: a letter, then letters, digits, `-` or `_`").guesses("id label"),
        key("pose", Table("pose"))
            .needed("start pose, such as { x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }")
            .guesses("start position initial initial_pose x0 start_pose"),
        key("place_m", Pair)
            .rule("needed unless each edge has `offset_m`", "formation slot: desired position in the shape of \
                                                             the formation. With a leader, x is forward and y to \
                                                             the left of the leader's heading")
            .guesses("slot formation place"),
        key("goal_m", Pair)
            .rule("needed with the role `goal`", "goal of the robot's front point, in the frame `map`")
            .guesses("goal target destination end"),
        key("hears", Names)
            .optional("in-neighbors: names of the robots whose beacons this robot receives")
            .guesses("neighbors neighbours listens_to heard"),
        key("spares", Names)
            .rule("chosen automatically", "backup neighbors, in order of preference, that replace lost in-neighbors; used with \
                   `repair = \"spares\"`")
            .guesses("backups fallbacks"),
        key("deputies", Names)
            .optional("backup leaders of this robot, if it is a secondary leader, in order: while it is lost, \
                       the first of them that is alive takes its slot. They must be contained robots; used with \
                       `repair = \"spares\"`")
            .guesses("deputy successors"),
    ]
}

/// Returns the keys that both `[[robot]]` and `robot_defaults` have, without gains.
fn defaults() -> Vec<Key> {
    vec![
        key("front_point_m", Number(Positive))
            .rule("needed without a `model`", "ell: distance from the middle of the axle forward to the front \
                                               point, the point that control laws steer. With a smaller distance \
                                               the robot turns faster for the same velocity of that point")
            .guesses("ell l front lookahead look_ahead off_axis"),
        key("law", Law)
            .rule("needed in `robot` or in `robot_defaults`", "control law of the robot")
            .guesses("controller control control_law type kind role"),
        key("wheels", Table("wheels"))
            .rule("that of the model, or no limit", "differential drive: maximum wheel speed and track width")
            .guesses("wheel"),
        key("model", Word(models::WORDS))
            .optional("a commercially available robot: supplies front point, body, wheels and limits that are not \
                       given")
            .guesses("robot_model platform vehicle body"),
        key("body_radius_m", Number(Positive))
            .rule("that of the model, or unknown", "radius of the robot's body around the middle of the axle")
            .guesses("body_radius robot_radius radius size"),
        key("limits", Table("limits"))
            .rule("those of the model, or no inertia", "inertia: maximum accelerations")
            .guesses("limit inertia acceleration accelerations dynamics"),
        key("restart_policy", Word(&[
                ("never", "no restart"),
                ("on-failure", "restart after a signal or an exit code other than 0"),
                ("always", "restart after every exit"),
            ]))
            .default("'on-failure'", "restart policy for an unexpected exit of the robot's process")
            .guesses("restart"),
        key("max_restarts", Whole(0, 1_000_000))
            .default("3", "maximum number of restarts within `restart_window_s`; after them the robot is not \
                           restarted and counts as failed")
            .guesses("restarts_max restarts"),
        key("restart_delay_s", Time(NotNegative))
            .default("0.5", "backoff: delay before the first restart; it doubles after each restart, up to \
                             `max_restart_delay_s`")
            .guesses("delay restart_after"),
        key("max_restart_delay_s", Time(NotNegative))
            .rule("10 s, or `restart_delay_s` if that is longer", "maximum delay before a restart")
            .bounds("`restart_delay_s` to 1e7")
            .guesses("restart_delay_max"),
        key("restart_window_s", Time(Positive))
            .default("60.0", "time window over which restarts are counted")
            .guesses("window"),
    ]
}

fn pose() -> Vec<Key> {
    vec![
        key("x_m", Number(Any)).needed("x of the middle of the axle").guesses("x0"),
        key("y_m", Number(Any)).needed("y of the middle of the axle").guesses("y0"),
        key("heading_rad", Number(Any))
            .needed("heading, counterclockwise from the x axis")
            .bounds("-2π to 2π")
            .guesses("theta yaw phi angle theta0 orientation heading_deg"),
    ]
}

fn wheels() -> Vec<Key> {
    vec![
        key("speed_max_m_s", Number(Positive))
            .rule("needed without a `model`", "maximum speed of a wheel's rim")
            .guesses("v_max vmax max_speed speed limit"),
        key("track_m", Number(Positive))
            .rule("needed without a `model`", "track width: distance between the two wheels")
            .guesses("width wheelbase wheel_base base axle"),
    ]
}

fn limits() -> Vec<Key> {
    vec![
        key("acceleration_m_s2", Number(Positive))
            .rule("needed without a `model`", "a_v: maximum linear acceleration, also when braking")
            .guesses("a a_v acceleration a_max linear_acceleration deceleration"),
        key("turn_acceleration_rad_s2", Number(Positive))
            .rule("needed without a `model`", "a_w: maximum angular acceleration")
            .guesses("a_w alpha angular_acceleration turn_acceleration"),
        key("braking_time_s", Number(Positive))
            .rule(
                "the longer of v_max / a_v and v_max / (2 a_w `front_point_m`)",
                "tau: maximum time to brake to rest from any command. It limits the turn rate to a_w tau",
            )
            .guesses("tau braking_time stopping_time"),
        key(
            "ramp",
            Word(&[
                ("together", "speed and turn rate reach their targets at the same time"),
                (
                    "independent",
                    "each changes at its own maximum acceleration, and the guard guarantees no distance",
                ),
            ]),
        )
        .default("'together'", "whether speed and turn rate change together or independently of each other"),
    ]
}

fn edge() -> Vec<Key> {
    vec![
        key("from", Text)
            .needed("name of the sending robot")
            .guesses("source src sender speaker heard start tail"),
        key("to", Text)
            .needed("name of the receiving robot")
            .guesses("target dst dest destination receiver hearer end head"),
        key("offset_m", Pair)
            .rule(
                "difference of the `place_m` of the two robots",
                "c_ji: desired position of `to` relative to `from`. It rotates with the main leader's heading \
                 and is multiplied by `scale`",
            )
            .guesses("c displacement delta d relative_position"),
    ]
}

fn wall() -> Vec<Key> {
    vec![
        key("points_m", Points)
            .needed("points of the wall, in order: [[0.0, 0.0], [1.0, 0.5]]")
            .guesses("points corners vertices polyline"),
        key("closed", Truth)
            .default("false", "whether a segment connects the last point with the first")
            .guesses("loop cyclic"),
    ]
}

fn obstacle() -> Vec<Key> {
    vec![
        key("kind", ValueType::Kind).needed("shape: \"disc\" or \"polygon\"").guesses("type shape"),
        key("center_m", Pair).needed("center of the disc").guesses("centre position origin"),
        key("radius_m", Number(Positive)).needed("radius of the disc").guesses("r size"),
        key("corners_m", Points)
            .needed("corners of the convex polygon, in order: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]")
            .guesses("corners points vertices"),
    ]
}

fn trajectory() -> Vec<Key> {
    vec![
        key("kind", ValueType::Kind)
            .needed("shape of the path: \"still\", \"line\", \"circle\", ...")
            .guesses("type shape"),
        key("center_m", Pair)
            .rule("[0.0, 0.0]", "center of the path; for a line, its start point")
            .guesses("centre origin start"),
        key("velocity_m_s", Pair).needed("velocity along the line").guesses("v speed"),
        key("radius_m", Number(Positive))
            .needed("radius; for a quadrifolium or lemniscate, half of its largest extent")
            .guesses("r a amplitude"),
        key("radii_m", Pair)
            .needed("half of the extent in x and in y")
            .guesses("amplitudes radius"),
        key("cycles", Pair)
            .needed("numbers of cycles per period in x and in y, two integers")
            .guesses("frequencies ratio"),
        key("phase_rad", Number(Any)).default("0.0", "phase of the x component").guesses("phi"),
        key("period_s", Number(NotZero))
            .needed("time for one revolution of the path; a negative value reverses the direction, so that a \
                     circle runs clockwise")
            .guesses("t turn clockwise"),
        key("points_m", Points)
            .needed("waypoints, in order: [[0.0, 0.0], [1.0, 0.5]]")
            .guesses("waypoints path"),
        key("speed_m_s", Number(Positive)).needed("speed along the path").guesses("v velocity"),
        key("acceleration_m_s2", Number(Positive))
            .rule("`speed_m_s` per second", "acceleration from rest to `speed_m_s`")
            .guesses("a acceleration_max a_max"),
        key("closed", Truth)
            .default("false", "whether the path returns to its first point and repeats forever")
            .guesses("loop cyclic repeat"),
        key("keep_heading", Truth)
            .default(
                "false",
                "true: the formation keeps its heading where the trajectory stops and reverses, as if the leader \
                 drove backwards. false: the formation turns by 180 degrees after each such point",
            )
            .guesses("backwards reverse keep_frame"),
    ]
}

fn scale() -> Vec<Key> {
    vec![
        key("kind", ValueType::Kind).default("'sine'", "type of the scale function: \"sine\" or \"closing\"").guesses("type shape"),
        key("mean", Number(Positive)).default("1.0", "mean of the scale, which is a factor on all offsets"),
        key("amplitude", Number(NotNegative))
            .rule("0: constant scale", "amplitude of the oscillation; must be less than `mean`"),
        key("period_s", Number(Positive))
            .rule("needed with `amplitude`", "period of the oscillation")
            .guesses("t"),
        key("from", Number(Positive))
            .rule(
                "the scale at which the smallest gap between two slots is max(1.05, 0.625 sqrt(N)) times the gap that a \
                 robot passes through, with N the number of robots that keep a slot",
                "scale of the open formation, at least 1",
            )
            .guesses("open start max"),
        key("hold_s", Time(NotNegative))
            .rule(
                "max(2.5 t, 0.25 t D), where t is the longest travel time from a start to its slot in the open \
                 formation, and D the graph diameter in hops; times 1.5 if the graph has a directed cycle",
                "time for which the formation stays open",
            )
            .guesses("hold open_s wait"),
        key("over_s", Time(Positive))
            .rule("the shortest time in which no slot moves faster than 0.75 times the speed of the robots", "duration \
                 of the closing, and of each later opening")
            .guesses("over duration close_s"),
        key("reopen_at_s", Times)
            .optional("times at which the formation starts to open again, for robots that return late: [120.0, 300.0]")
            .guesses("reopen open_at again"),
    ]
}

fn fault() -> Vec<Key> {
    vec![
        key("at_s", Time(NotNegative))
            .needed("start time of the fault, since the start of the run")
            .bounds("0 to less than `duration_s`")
            .guesses("t time start when from"),
        key("kind", ValueType::Kind)
            .needed("kind of the fault: \"kill\", \"freeze\", \"cut\", ...")
            .guesses("type fault what"),
        key("robot", Text)
            .needed("name of the affected robot, or \"*\" for all robots")
            .guesses("name agent target who"),
        key("from", Text)
            .needed("name of the sending robot, or \"*\" for all robots")
            .guesses("source sender"),
        key("to", Text).needed("name of the receiving robot, or \"*\" for all robots").guesses("receiver"),
        key("stream", Word(&[("odometry", "its sensor samples"), ("commands", "its velocity commands")]))
            .needed("affected message stream of the robot: \"odometry\" or \"commands\"")
            .guesses("what topic channel"),
        key("sensor", Word(&[("odometry", "its own pose"), ("proximity", "positions of the robots in range")]))
            .needed("affected sensor: \"odometry\" or \"proximity\""),
        key("hosts", Texts)
            .needed("names of the fleet hosts on one side of the partition; they cannot communicate with the other hosts")
            .guesses("host side islands"),
        key("for_s", Time(Positive))
            .rule("until the end of the run", "duration of the fault")
            .guesses("duration length until lasts"),
        key("restart_after_s", Time(Positive))
            .rule("no restart", "time from the kill to the start of the replacement process")
            .guesses("restart back_after restart_delay"),
        key("delay_s", Time(Positive))
            .needed("time by which each affected message is delayed; with `slow`, each answer of the robot")
            .guesses("by latency delay_ms"),
        key("jitter_s", Time(NotNegative))
            .default("0.0", "maximum of the random time that is added to the delay of each message")
            .guesses("jitter_ms"),
        key("probability", Number(Positive))
            .needed("fraction of the messages that is lost")
            .bounds("above 0, to 1")
            .guesses("p rate share loss"),
        key("burst", Whole(1, BURST_MAX))
            .default("1", "number of consecutive messages lost together")
            .guesses("burst_length"),
        key("mean_burst_s", Time(Positive))
            .needed("mean duration of the bad state, in which all messages are lost")
            .guesses("mean_burst burst_time bad"),
        key("range_m", Number(Positive))
            .needed("distance at which 37 % (1/e) of the beacons arrive")
            .guesses("range distance reach"),
        key("exponent", Number(Positive))
            .default("2.0", "path loss exponent: 2 in free space. With a larger one the loss rises more steeply \
                             around `range_m`")
            .guesses("n path_loss"),
        key("bound_m", Number(NotNegative))
            .needed("maximum error of a sensed position")
            .bounds("0 to 1e9; above 0 without `heading_bound_rad`")
            .guesses("amplitude sigma std noise bound"),
        key("heading_bound_rad", Number(NotNegative))
            .default("0.0", "maximum error of the sensed heading; for the odometry only")
            .guesses("heading heading_noise"),
        key("by_m", Pair)
            .optional("constant error of the position in the robot's beacons")
            .guesses("offset_m lie_m by"),
        key("drift_m_s", Pair)
            .optional("velocity with which the position in the robot's beacons drifts from the true one; it is \
                       also added to the velocity in them")
            .guesses("drift velocity_m_s"),
        key("random_m", Number(Positive))
            .optional("radius of the disc from which a new position error is drawn for every beacon")
            .guesses("random radius_m"),
        key("turn_rad", Number(Any))
            .optional("error added to the heading of the leader's frame that the robot relays in its beacons")
            .guesses("turn heading_rad frame_rad"),
        key("stuck", Truth).rule("needed unless `speed_max_m_s` is given", "the wheels are stuck: the robot does not move"),
        key("speed_max_m_s", Number(Positive))
            .rule("needed unless `stuck` is given", "maximum speed of the wheels' rims")
            .guesses("v_max limit"),
        key("processes", Whole(1, LOAD_MAX))
            .needed("number of extra processes, each of which takes as much CPU time as it can")
            .guesses("count n number"),
    ]
}

fn chaos() -> Vec<Key> {
    vec![
        key("mean_time_between_kills_s", Number(Positive))
            .optional("mean time between two kills in the whole run, each of a random robot; this key or \
                       `mean_time_between_freezes_s` is needed")
            .guesses("kills mtbf"),
        key("restart_after_s", Time(Positive))
            .default("1.0", "time from a kill to the start of the replacement process")
            .guesses("restart"),
        key("mean_time_between_freezes_s", Number(Positive))
            .optional("mean time between two freezes in the whole run, each of a random robot")
            .guesses("freezes"),
        key("mean_freeze_s", Number(Positive))
            .default("0.5", "mean duration of a freeze")
            .guesses("freeze"),
        key("mean_time_between_partitions_s", Number(Positive))
            .optional(
                "mean time between two partitions; during each, a random one of the `hosts` cannot communicate \
                 with the others",
            )
            .guesses("partitions partition"),
        key("mean_partition_s", Number(Positive)).default("2.0", "mean duration of a partition"),
        key("hosts", Texts)
            .rule(
                "needed with `mean_time_between_partitions_s`",
                "names of the fleet hosts \
                 that partitions isolate, one at a time",
            )
            .guesses("host"),
        key("from_s", Time(NotNegative)).default("0.0", "earliest time of a random fault").guesses("start"),
        key("until_s", Time(NotNegative))
            .rule("the end of the run", "time after which no random fault starts")
            .guesses("end to"),
    ]
}

fn hunt() -> Vec<Key> {
    vec![
        key("vary", Texts)
            .rule(
                "starts, faults and delays",
                "what the search varies: \"starts\", \"faults\", \"delays\", \"noise\", \"gains\"",
            )
            .guesses("varies varied"),
        key("faults_max", Whole(1, 20))
            .default("3", "maximum number of faults in a run")
            .guesses("faults count n"),
        key("kinds", Texts)
            .rule(
                "all kinds that a hunt supports, except \"lie\"",
                "kinds of faults to inject, such as \"freeze\" and \"cut\"",
            )
            .guesses("kind fault_kinds"),
        key("robots", Names)
            .rule("all robots", "robots that faults may affect: the robot itself, or the sender of an affected link")
            .guesses("robot targets"),
        key("from_s", Time(NotNegative)).default("0.0", "earliest start time of a fault").guesses("start"),
        key("until_s", Time(Positive))
            .rule("half of `duration_s`", "time by which every fault has ended")
            .bounds("above `from_s`, to `duration_s`")
            .guesses("end to"),
        key("box_m", Pair)
            .rule(
                "[4 d, 4 d]",
                "width and height of the box from which the start of each robot's front point is drawn; its \
                 center is the start in the scenario",
            )
            .bounds("each above 0")
            .guesses("box size area"),
        key("apart_m", Number(Positive))
            .rule("1.5 d", "minimum distance of two front points at the start; for two robots that start closer \
                            in the scenario, their distance there")
            .guesses("apart separation"),
        key("delay_s_max", Time(Positive))
            .rule("4 `period_s`", "maximum delay of a link, of odometry, or of commands")
            .guesses("delay latency delay_max latency_max"),
        key("loss_max", Number(Positive))
            .default("0.5", "maximum fraction of the messages that is lost")
            .bounds("above 0, to 1")
            .guesses("loss"),
        key("noise_m_max", Number(Positive))
            .rule("0.05 d", "maximum error of a sensed position")
            .guesses("noise noise_max"),
        key("noise_heading_rad_max", Number(Positive))
            .default("0.02", "maximum error of a sensed heading")
            .guesses("heading_noise noise_heading"),
        key("gain_factors", Pair)
            .rule("[0.5, 2]", "smallest and largest factor by which the search multiplies gains of the scenario")
            .bounds("each above 0, the first below the second")
            .guesses("gains factors"),
    ]
}

fn expect() -> Vec<Key> {
    vec![
        key("min_distance_m", Number(Positive))
            .optional("minimum distance between two front points, at every tick")
            .guesses("distance_min d d_min distance"),
        key("min_clearance_m", Number(Positive))
            .optional("minimum distance of a front point from walls and obstacles, at every tick")
            .guesses("clearance clearance_min"),
        key("final_error_m_max", Number(Positive))
            .optional("maximum error of any living robot over the last 10 % of the run: the distance of its \
                       front point from its desired point")
            .guesses("final_error error_max max_error error"),
        key("final_ideal_error_m_max", Number(Positive))
            .optional("maximum distance of any living robot from its slot in the ideal formation, computed from the \
                       main leader's true pose and the planned graph, over the last 10 % of the run")
            .guesses("final_ideal_error ideal_error ideal_error_m_max"),
        key("tracking_error_m_max", Number(Positive))
            .optional("maximum tracking error of the main leader over the last 10 % of the run")
            .guesses("tracking_error"),
        key("hull_distance_m_max", Number(NotNegative))
            .optional("maximum distance of a contained robot from the convex hull of the leaders over the last 10 % of the run")
            .guesses("hull_distance hull"),
        key("converged_by_s", Number(Positive))
            .optional("latest time from which on the errors of all living robots must stay below \
                       `converged_error_m`")
            .bounds("above 0, to `duration_s`")
            .guesses("converged settling_time converged_at"),
        key("recovered_within_s", Number(Positive))
            .optional("maximum time after the end of each fault until the errors of all living robots stay below `converged_error_m`")
            .guesses("recovery recovered"),
        key("alive_at_end", NamesOrCount)
            .rule("no such criterion; the other criteria count all robots except those that a planned fault \
                   leaves dead", "names of the robots that must be alive at the end, \
                                                             or their minimum number. The other criteria then \
                                                             count only these robots, or, with a number, only \
                                                             the robots that are alive at the end")
            .guesses("alive survivors living"),
        key("deadline_misses_max", Whole(0, i64::MAX as u64))
            .optional("maximum number of deadline misses of all agents (commands sent after the agent's next \
                       wake-up was due), in real time only")
            .guesses("deadline_misses misses"),
        key("exit", Whole(0, 255))
            .rule("0", "expected exit code of the run itself, before its criteria are evaluated")
            .guesses("exit_code code"),
        key("converged_error_m", Number(Positive))
            .default("0.01", "threshold below which an error counts as converged")
            .guesses("tolerance converged_error epsilon"),
    ]
}

fn trajectories() -> Vec<Kind> {
    vec![
        Kind::new("still", "a fixed point", "", "center_m"),
        Kind::new("line", "a straight line at a constant speed", "velocity_m_s", "center_m"),
        Kind::new("circle", "a circle", "radius_m period_s", "center_m"),
        Kind::new("quadrifolium", "a rose curve with four petals", "radius_m period_s", "center_m"),
        Kind::new(
            "lissajous",
            "a Lissajous curve",
            "radii_m cycles period_s",
            "center_m phase_rad keep_heading",
        ),
        Kind::new("lemniscate", "Bernoulli's lemniscate", "radius_m period_s", "center_m"),
        Kind::new(
            "waypoints",
            "a path of circular arcs through all points",
            "points_m speed_m_s",
            "acceleration_m_s2 closed keep_heading",
        ),
    ]
}

fn scales() -> [Kind; 2] {
    let closing =
        "open while the robots move to their slots, then closing to 1 along half a cosine";
    [
        Kind::new("sine", "mean + amplitude sin(2 pi t / period)", "", "mean amplitude period_s"),
        Kind::new("closing", closing, "", "from hold_s over_s reopen_at_s"),
    ]
}
