//! THE table of the scenario format: every key with its type, unit, range, default and meaning.
//!
//! The reader takes types, units, ranges and defaults from these rows, diagnostics their words, the
//! JSON Schema and the page of the book all of it. Files of campaigns and fleets are made of such rows
//! too. What values mean together is asked where they are read, and in [`crate::check`]. Nothing is
//! read here.
//!
//! To rename a key, give its row the new name and put the old one into `was`: files that have it
//! are read as before, with a warning.

use std::borrow::Cow;

use protocol::avoidance::Gain;
use protocol::catalog::Catalog;
use protocol::law::LIARS_MAX;
use toml::de::DeValue;

use super::diagnostic::meant;
use super::fault::FORMS;
use super::models;

/// The number of this format.
pub const FORMAT: u64 = 1;

/// Most periods that a command may be held.
const HOLD_PERIODS_MAX: u64 = 100;
/// Most beacons that are lost together, most load processes: more is a slip of the keyboard.
const BURST_MAX: u64 = 1_000_000;
const LOAD_MAX: u64 = 256;
/// No robot hears more than can lie.
const LIARS_MOST: u64 = 1000;
/// Most spares that are chosen for a robot.
const SPARES_MAX: u64 = 16;
/// Most memory that a program may be bound to, MB: a terabyte.
const MEMORY_MB_MAX: u64 = 1 << 20;

/// One key.
#[derive(Debug, Clone)]
pub struct Key {
    /// Its name, with the unit as suffix.
    pub name: &'static str,
    /// What its value is.
    pub takes: Takes,
    /// What holds where it is not given.
    pub otherwise: Otherwise,
    /// What it is, in one line.
    pub says: Cow<'static, str>,
    /// Names that it had: still read, with a warning.
    pub was: &'static [&'static str],
    /// Which numbers the checker takes, where it asks for more than a range.
    pub bounds: &'static str,
    /// What people write who mean it, without units, in small letters: words.
    pub guesses: &'static str,
}

/// What a value is. Numbers are in the unit that the key's name ends in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Takes {
    /// A string.
    Text,
    /// One of these words, each with its meaning.
    Word(&'static [(&'static str, &'static str)]),
    /// The word of one of the section's kinds.
    Kind,
    /// The name of a control law.
    Law,
    /// The name of an avoidance method.
    Method,
    /// True or false.
    Truth,
    /// A number.
    Number(Range),
    /// A time in seconds that is a whole number of nanoseconds.
    Time(Range),
    /// A list of such times, from 0.
    Times,
    /// A whole number from the first to the second.
    Whole(u64, u64),
    /// `[x, y]`.
    Pair,
    /// A list of `[x, y]`.
    Points,
    /// A list of strings.
    Texts,
    /// A list of names of robots.
    Names,
    /// The same, or a whole number of robots.
    NamesOrCount,
    /// A table with the keys of that section.
    Table(&'static str),
    /// A list of such tables.
    Tables(&'static str),
    /// A table of such tables, each under a name that the file gives it.
    NamedTables(&'static str),
    /// Whatever these words say.
    Any(&'static str),
}

/// Which numbers there may be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Range {
    /// All.
    Any,
    /// From 0 on.
    NotNegative,
    /// Above 0.
    Positive,
    /// All but 0.
    NotZero,
}

/// What holds where a key is not given.
#[derive(Debug, Clone)]
pub enum Otherwise {
    /// It must be given.
    Needed,
    /// That value, as if the file had it.
    Default(DeValue<'static>),
    /// What these words say.
    Rule(Cow<'static, str>),
    /// Nothing: what it asks for does not happen.
    Absent,
}

/// The keys of one table.
#[derive(Debug)]
pub struct Section {
    /// What it is called: the key's name, in general.
    pub name: &'static str,
    /// What it is about, in one line.
    pub says: &'static str,
    /// Its keys, in the order in which people read them.
    pub keys: Vec<Key>,
    /// Where `kind` decides which of them there may be: its words. Empty: all of them.
    pub kinds: Vec<Kind>,
}

/// A word of the key `kind`, and the other keys that there are with it.
#[derive(Debug, Clone)]
pub struct Kind {
    /// The word.
    pub word: &'static str,
    /// What it is, in one line.
    pub says: &'static str,
    /// Keys that must be given.
    pub needs: Vec<&'static str>,
    /// Keys that may be.
    pub may: Vec<&'static str>,
}

/// All sections, with the laws and methods that there are.
#[derive(Debug)]
pub struct Format {
    /// The sections; the first is the whole file.
    pub sections: Vec<Section>,
    /// Names of the control laws.
    pub laws: Vec<&'static str>,
    /// Names of the avoidance methods; the first is the default.
    pub methods: Vec<&'static str>,
}

/// A row that says nothing yet of what holds without the key, nor what it is.
pub fn key(name: &'static str, takes: Takes) -> Key {
    let (otherwise, says) = (Otherwise::Absent, Cow::Borrowed(""));
    Key { name, takes, otherwise, says, was: &[], bounds: "", guesses: "" }
}

impl Key {
    /// It must be given.
    pub fn needed(self, says: &'static str) -> Key {
        Key { otherwise: Otherwise::Needed, says: says.into(), ..self }
    }

    /// It may be given; without it, what it asks for does not happen.
    pub fn optional(self, says: &'static str) -> Key {
        Key { otherwise: Otherwise::Absent, says: says.into(), ..self }
    }

    /// Without it this value holds, written in TOML.
    pub fn default(self, value: &'static str, says: &'static str) -> Key {
        let value = DeValue::parse(value).expect("a default is TOML").into_inner();
        Key { otherwise: Otherwise::Default(value), says: says.into(), ..self }
    }

    /// Without it holds what this rule says.
    pub fn rule(
        self,
        rule: impl Into<Cow<'static, str>>,
        says: impl Into<Cow<'static, str>>,
    ) -> Key {
        Key { otherwise: Otherwise::Rule(rule.into()), says: says.into(), ..self }
    }

    /// It is checked for more than its range.
    fn bounds(self, bounds: &'static str) -> Key {
        Key { bounds, ..self }
    }

    /// Words that people write who mean it, without units, in small letters.
    pub fn guesses(self, guesses: &'static str) -> Key {
        Key { guesses, ..self }
    }

    /// Its name, and those that it had.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        [self.name].into_iter().chain(self.was.iter().copied())
    }

    /// The unit of its numbers; "" where they have none.
    pub(crate) fn unit(&self) -> &'static str {
        match self.takes {
            Takes::Number(_) | Takes::Pair | Takes::Points | Takes::Time(_) | Takes::Times => {
                let name = self.name.strip_suffix("_max").unwrap_or(self.name);
                UNITS.iter().find(|(suffix, _)| name.ends_with(suffix)).map_or("", |unit| unit.1)
            }
            _ => "",
        }
    }

    /// Whether that word may well stand for it: its name without unit, or what others call it.
    pub(crate) fn is_meant_by(&self, word: &str) -> bool {
        let guess = stem(word);
        stem(self.name) == guess || self.guesses.split(' ').any(|known| known == guess)
    }
}

impl Section {
    /// A section with these keys.
    pub fn new(name: &'static str, says: &'static str, keys: Vec<Key>) -> Section {
        Section { name, says, keys, kinds: Vec::new() }
    }

    /// The same where `kind` decides which of its keys there may be.
    fn of_kinds(self, kinds: impl IntoIterator<Item = Kind>) -> Section {
        Section { kinds: kinds.into_iter().collect(), ..self }
    }

    /// The row of that name.
    pub fn key(&self, name: &str) -> Option<&Key> {
        self.keys.iter().find(|key| key.name == name)
    }

    /// The words of its kinds, each once.
    pub fn words(&self) -> Vec<&'static str> {
        let mut words: Vec<&str> = self.kinds.iter().map(|kind| kind.word).collect();
        words.dedup();
        words
    }
}

impl Kind {
    /// With the keys in these lists of words.
    fn new(word: &'static str, says: &'static str, needs: &'static str, may: &'static str) -> Kind {
        let list = |keys: &'static str| keys.split_whitespace().collect();
        Kind { word, says, needs: list(needs), may: list(may) }
    }

    /// Whether there may be that key with it.
    pub(crate) fn has(&self, key: &str) -> bool {
        self.needs.contains(&key) || self.may.contains(&key)
    }
}

impl Format {
    /// The keys that scenarios may have with these laws and methods.
    pub fn of(catalog: &Catalog) -> Format {
        let gains = gains(catalog);
        let faults = FORMS.iter().map(|form| Kind {
            word: form.kind,
            says: form.says,
            needs: form.needs(),
            may: form.may(),
        });
        let sections = vec![
            Section::new("scenario", "One experiment.", root()),
            Section::new("realtime", "How late things may be, in real time.", realtime()),
            Section::new(
                "avoidance",
                "How robots keep their distance.",
                [avoidance(), gains_of_methods(catalog)].concat(),
            ),
            Section::new(
                "silence",
                "When a robot that is not heard counts as stale, and as lost.",
                silence(),
            ),
            Section::new(
                "law",
                "A law in a program of the scenario's own: a table `[laws.NAME]`.",
                [law(), program()].concat(),
            ),
            Section::new(
                "plant",
                "A program of the scenario's own that moves the robots, in place of exact unicycles.",
                program(),
            ),
            Section::new(
                "robot_defaults",
                "What all robots have that do not say otherwise.",
                [defaults(), gains.clone()].concat(),
            ),
            Section::new("robot", "One robot.", [robot(), defaults(), gains].concat()),
            Section::new("pose", "A pose in the frame `map`.", pose()),
            Section::new("wheels", "What a robot's wheels can do.", wheels()),
            Section::new("limits", "How fast a robot's twist can change: its inertia.", limits()),
            Section::new("edge", "One robot hears another.", edge()),
            Section::new("wall", "A wall: segments from point to point.", wall()),
            Section::new("obstacle", "Something fixed that robots keep away from.", obstacle())
                .of_kinds([
                    Kind::new("disc", "a disc", "center_m radius_m", ""),
                    Kind::new("polygon", "a convex polygon", "corners_m", ""),
                ]),
            Section::new("trajectory", "Where the leader's front point goes.", trajectory())
                .of_kinds(trajectories()),
            Section::new("scale", "How the formation grows and shrinks.", scale())
                .of_kinds(scales()),
            Section::new("fault", "Something that breaks on purpose.", fault()).of_kinds(faults),
            Section::new(
                "chaos",
                "Kills, freezes and partitions at random times, drawn from the seed.",
                chaos(),
            ),
            Section::new("expect", "What must hold for exit code 0.", expect()),
            Section::new("hunt", "What `phalanx hunt` may vary, and within which bounds.", hunt()),
        ];
        Format {
            sections,
            laws: catalog.laws.iter().map(|law| law.name).collect(),
            methods: catalog.methods.iter().map(|method| method.name).collect(),
        }
    }

    /// A format that knows no laws and methods.
    pub fn plain(sections: Vec<Section>) -> Format {
        Format { sections, laws: Vec::new(), methods: Vec::new() }
    }

    /// The whole file.
    pub fn root(&self) -> &Section {
        &self.sections[0]
    }

    /// The section of that name, which must be one of a row.
    pub fn section(&self, name: &str) -> &Section {
        let found = self.sections.iter().find(|section| section.name == name);
        found.unwrap_or_else(|| panic!("`{name}` is a section"))
    }

    /// The key that a word means, as `--set` takes it: one of the file's own, or of a table that there is once.
    pub fn key_meant_by(&self, word: &str) -> Option<String> {
        let key = |section: &Section| {
            section.keys.iter().find(|key| key.is_meant_by(word)).map(|key| key.name)
        };
        let tables = ["avoidance", "realtime", "silence", "expect"];
        let within = |table: &&str| Some(format!("{table}.{}", key(self.section(table))?));
        key(self.root()).map(str::to_owned).or_else(|| tables.iter().find_map(within))
    }

    /// What to expect instead of a `word` that is none of the `rows` of the section; `elsewhere`: it
    /// may be a key of another one.
    pub(crate) fn expected(
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

/// The gains of all laws: positive, and needed by those who use them.
fn gains(catalog: &Catalog) -> Vec<Key> {
    let mut gains: Vec<Key> = Vec::new();
    for &name in catalog.laws.iter().flat_map(|law| law.gains) {
        if gains.iter().all(|gain| gain.name != name) {
            let users = catalog.laws.iter().filter(|law| law.gains.contains(&name));
            let users: Vec<_> = users.map(|law| format!("`{}` {}", law.name, law.source)).collect();
            let laws = if users.len() == 1 { "law" } else { "laws" };
            gains.push(gain(name, format!("gain of the {laws} {}", users.join(", "))));
        }
    }
    gains
}

fn gains_of_methods(catalog: &Catalog) -> Vec<Key> {
    let gains = catalog.methods.iter().flat_map(|m| m.gains.iter().map(move |g| (m.name, g)));
    let key = |(name, g): (&str, &Gain)| match g.otherwise {
        None => gain(g.key, format!("{}; `{name}` needs it", g.meaning)),
        Some(otherwise) => key(g.key, Number(Positive))
            .rule(otherwise.to_string(), format!("{}; for `{name}`", g.meaning)),
    };
    gains.map(key).collect()
}

fn gain(name: &'static str, says: String) -> Key {
    if name == LIARS_MAX {
        return key(name, Whole(1, LIARS_MOST))
            .rule(
                "needed by those who use it",
                format!("F: how many of those heard may lie; {says}"),
            )
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
    key(name, Number(Positive)).rule("needed by those who use it", says).guesses(guesses)
}

/// Suffixes and units, longer ones first.
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

/// A word as guesses are written: small letters, no unit.
fn stem(word: &str) -> String {
    let word = word.to_lowercase().replace('-', "_");
    let suffix = UNITS.iter().find_map(|(suffix, _)| word.strip_suffix(suffix));
    suffix.filter(|stem| !stem.is_empty()).unwrap_or(&word).to_owned()
}

use Range::{Any, NotNegative, NotZero, Positive};
use Takes::{
    Law, Method, NamedTables, Names, NamesOrCount, Number, Pair, Points, Table, Tables, Text,
    Texts, Time, Times, Truth, Whole, Word,
};

fn root() -> Vec<Key> {
    let mut keys = run_itself();
    keys.extend(experiment());
    keys.extend(repair());
    keys
}

/// What the run is called, how long it lasts, and when it is given up.
fn run_itself() -> Vec<Key> {
    vec![
        key("format", Whole(FORMAT, FORMAT))
            .default("1", "number of the format that the file is written in")
            .guesses("version format_version schema"),
        key("name", Text)
            .needed("a short name for the experiment, such as \"triangle\"")
            .guesses("title id"),
        key("description", Text).optional("what it is about").guesses("comment about notes"),
        key("duration_s", Time(Positive))
            .needed("how long the run lasts, in seconds")
            .guesses("end t_end tmax t_max t_final tf length horizon time total_time"),
        key("end_after_converged_s", Time(Positive))
            .optional("the run ends before `duration_s` once all living errors have been below \
                       `converged_error_m` for so long, and over the last 10 % of the run, and nothing of the \
                       plan is to come: no fault, no opening or closing of the formation, no waypoint")
            .guesses("end_when_converged_s stop_when_converged_s settle_s early_stop_s"),
        key("period_s", Time(Positive))
            .needed("seconds from one command to the next, such as 0.005")
            .bounds("above 0, to `duration_s`")
            .guesses("dt t ts delta_t step time_step timestep sample_time sampling_time sampling_period \
                      control_period cycle_time tick"),
        key("seed", Whole(0, i64::MAX as u64))
            .default("1", "seed of everything random")
            .guesses("random_seed rng_seed rng"),
        key("record_hz", Number(Positive))
            .default("100.0", "rows per second of run time and robot in `samples.csv` and in the recording")
            .guesses("record record_rate sample_rate log_rate rate logging"),
        key("hung_after_s", Time(Positive))
            .default(
                "60.0",
                "how long a process may owe the others an answer in lockstep: wall time in which it runs or is \
                 blocked",
            )
            .bounds("0.1 to 1e7")
            .guesses("hung timeout hang deadline"),
        key("ready_after_s", Time(Positive))
            .default(
                "10.0",
                "how long a robot's process may take to start, in both paces: time in which it runs or is blocked, \
                 not time in which it waits for a processor",
            )
            .bounds("0.1 to 3600")
            .guesses("ready start_timeout startup_timeout start_limit import_timeout"),
        key("stopped_after_s", Time(Positive))
            .rule(
                "the run waits; 60 where the environment variable `CI` is set",
                "how long a process may be stopped by somebody else (SIGSTOP) in lockstep before the run ends with \
                 exit code 4",
            )
            .guesses("stopped sigstop"),
    ]
}

/// What moves, where, and what becomes of it.
fn experiment() -> Vec<Key> {
    vec![
        key("published_velocity", Word(&[
                ("gamma", "the law's"),
                ("gamma+beta", "the law's with avoidance"),
                ("differenced", "from one position to the next"),
            ]))
            .default("'gamma'", "which velocity robots publish"),
        key("trajectory", Table("trajectory"))
            .rule("needed with a leader", "where the leader's front point goes")
            .guesses("path reference m"),
        key("scale", Table("scale"))
            .rule("always 1", "how the formation grows and shrinks")
            .guesses("delta scaling"),
        key("avoidance", Table("avoidance"))
            .needed("a table with `kind`, `distance_min_m`, `speed_max_m_s`")
            .guesses("collision_avoidance collision safety guard repulsion"),
        key("realtime", Table("realtime"))
            .optional("how late things may be, in real time")
            .guesses("real_time rt"),
        key("silence", Table("silence"))
            .optional("when a robot that is not heard counts as stale, and as lost"),
        key("laws", NamedTables("law"))
            .optional("laws in programs of the scenario's own, each a table `[laws.NAME]`"),
        key("plant", Table("plant"))
            .optional("a program of the scenario's own that moves the robots")
            .guesses("simulator physics engine world hardware driver"),
        key("robot_defaults", Table("robot_defaults"))
            .optional("what all robots have that do not say otherwise")
            .guesses("defaults default robots_defaults"),
        key("robot", Tables("robot"))
            .needed("at least one table headed `[[robot]]`, or robot = [{ ... }, ...]")
            .guesses("robots agent agents node nodes vehicle vehicles"),
        key("edge", Tables("edge"))
            .optional("who hears whom; robots may say so with `hears` too")
            .guesses("edges link links neighbor neighbors neighbour neighbours connections adjacency"),
        key("graph", Text)
            .optional("a file with edges, and perhaps robots: .json (node-link), .csv (matrix) or .graphml")
            .guesses("graph_file network topology import"),
        key("drop_edges_to_leaders", Truth)
            .default(
                "false",
                "whether edges that end at a leader are dropped, and not refused: an undirected `graph` has one for \
                 each robot that receives from the leader",
            )
            .guesses("drop_edges ignore_edges_to_leaders"),
        key("wall", Tables("wall"))
            .optional("walls: lines through points")
            .guesses("walls lines segments boundary"),
        key("obstacle", Tables("obstacle"))
            .optional("discs and convex polygons that robots keep away from")
            .guesses("obstacles disc discs polygon polygons shelf shelves"),
        key("fault", Tables("fault"))
            .optional("what breaks on purpose")
            .guesses("faults failure failures event events"),
        key("chaos", Table("chaos"))
            .optional("kills, freezes and partitions at random times")
            .guesses("random_faults chaos_monkey"),
        key("expect", Table("expect"))
            .optional("what must hold for exit code 0")
            .guesses("expectations expected assert require check"),
        key("hunt", Table("hunt"))
            .optional("what `phalanx hunt` may vary, and within which bounds")
            .guesses("search fuzz falsify"),
    ]
}

/// What becomes of the formation graph when robots are lost.
fn repair() -> Vec<Key> {
    vec![
        key("deputies", Names)
            .optional(
                "the robots that lead in the main leader's place while it is lost, the first that lives: each \
                 from its own place in the formation",
            )
            .guesses("deputy successors succession backup_leaders"),
        key(
            "repair",
            Word(&[
                (
                    "none",
                    "who has lost an in-neighbor goes by the others, or as `silence.policy` says",
                ),
                ("spares", "it goes by a spare in its place"),
            ]),
        )
        .default("'none'", "what becomes of the formation graph when robots are lost for good")
        .guesses("heal healing self_healing reconnect"),
        key("spares", Whole(0, SPARES_MAX))
            .default("2", "so many spares are chosen for each robot that does not name its own")
            .guesses("backups fallbacks"),
        key("repair_after_s", Time(NotNegative))
            .default(
                "0.5",
                "for how long an in-neighbor is lost before a spare is opened, and is heard again \
                      before it is closed",
            )
            .guesses("repair_after heal_after"),
    ]
}

fn realtime() -> Vec<Key> {
    vec![
        key("plant_tick_s", Time(Positive))
            .default("0.001", "T_p: the plant's tick in real time")
            .guesses("tick plant_period t_p"),
        key("latency_allowed_s", Time(NotNegative))
            .default("0.002", "L: latency from odometry to command that is allowed for")
            .guesses("l latency latency_max"),
        key("between_hosts_s", Time(NotNegative)).default(
            "0.0",
            "how much later a sample may come because it goes from host to host, which H has \
                 room for; `--fleet` sets it",
        ),
        key("hold_periods", Whole(1, HOLD_PERIODS_MAX))
            .default("2", "h: for how many periods a command may be held")
            .guesses("h hold periods"),
        key("control_timer", Truth)
            .default(
                "true",
                "whether one process with the robots' timer and nothing else shows what the \
                 machine does to anybody",
            )
            .guesses("control control_group baseline machine"),
    ]
}

fn avoidance() -> Vec<Key> {
    vec![
        key("kind", Method)
            .rule("`guard`", "the avoidance method")
            .guesses("method type mode name"),
        key("distance_min_m", Number(Positive))
            .needed("d: no two front points may be nearer than this, in meters")
            .guesses(
                "d d_min dmin min_distance minimum_distance minimal_distance safe_distance \
                      safety_distance distance radius",
            ),
        key("speed_max_m_s", Number(Positive))
            .rule("no limit; `guard` needs one", "v_max: no front point moves faster than this")
            .guesses("v_max vmax max_speed speed max_velocity velocity_max speed_limit v"),
        key("clearance_m", Number(Positive))
            .rule(
                "half of `distance_min_m`",
                "no front point may be nearer than this to a wall or obstacle, in meters",
            )
            .guesses("clearance wall_distance obstacle_distance margin d_o"),
        key("sensing_radius_m", Number(Positive))
            .rule(
                "as far as the method has a use for",
                "within this distance robots see each other and walls",
            )
            .guesses("sensing sensor_range range sensing_range r_s"),
        key("sensing_error_m", Number(NotNegative))
            .rule("0, or what noise faults make of it", "by how much a sensed distance may be off")
            .guesses("error sensing_noise"),
        key("heading_error_rad", Number(NotNegative))
            .rule(
                "0, or what noise faults make of it",
                "by how much a robot may be wrong about its own heading",
            )
            .guesses("heading_noise heading_error_deg"),
    ]
}

fn silence() -> Vec<Key> {
    vec![
        key("stale_after_s", Time(Positive))
            .rule("3 periods", "who is not heard for longer is stale: extrapolated")
            .bounds("above 0, to `lost_after_s`")
            .guesses("stale"),
        key("lost_after_s", Time(Positive))
            .rule("20 periods, but 0.1 s at least", "who is not heard for longer is lost")
            .bounds("`stale_after_s` to 1e7")
            .guesses("lost timeout"),
        key(
            "policy",
            Word(&[
                ("last", "the lost do not count, unless nobody else is left: then as with keep"),
                ("ignore", "the lost do not count, and who has nobody left stops"),
                ("keep", "the lost are taken to stand at their last extrapolated point"),
                ("stop", "who has lost one stops"),
            ]),
        )
        .default("'last'", "what is done about the lost"),
    ]
}

/// Keys of one law in a program of its own, beside those of its program.
fn law() -> Vec<Key> {
    vec![
        key("role", Word(&[
                ("leader", "it follows the trajectory"),
                ("formation", "it keeps a place in the formation"),
                ("contained", "it goes to the middle of those that it hears"),
                ("goal", "it goes to its `goal_m`"),
            ]))
            .needed("what it makes of a robot: what the error is measured against")
            .guesses("kind type"),
        key("gains", Texts)
            .rule("none", "keys of its gains, with the unit last: robots that follow it must have them, above 0")
            .guesses("parameters params gain"),
        key("feed_forward", Truth)
            .default("false", "whether it uses the velocities of those heard: `phalanx check` asks whether \
                 these die out"),
        key("correction_max", Text)
            .optional("which of its gains, in m/s, bounds each component of what it adds to these velocities"),
    ]
}

/// Keys of a program of the scenario's own.
fn program() -> Vec<Key> {
    vec![
        key("program", Texts)
            .needed("the program and its arguments, as in [\"python3\", \"my_law.py\"]; files among them lie \
                     in the scenario's folder, and are copied into the run's directory")
            .guesses("command cmd executable script run"),
        key("files", Texts)
            .rule("none", "other files and folders of that folder that it needs; folders with all that is in them")
            .guesses("data needs modules"),
        key("memory_max_mb", Whole(1, MEMORY_MB_MAX))
            .rule("no bound", "maximum memory of its own, in MB: of each of its processes (RLIMIT_DATA), and of all together")
            .guesses("memory memory_max max_memory memory_limit"),
    ]
}

/// Keys of one robot alone.
fn robot() -> Vec<Key> {
    vec![
        key("name", Text).needed("a letter, then letters, digits, `-` or `_`").guesses("id label"),
        key("pose", Table("pose"))
            .needed("{ x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }")
            .guesses("start position initial initial_pose x0 start_pose"),
        key("place_m", Pair)
            .rule("offsets stand at the edges", "its place in the formation's shape")
            .guesses("slot formation place"),
        key("goal_m", Pair)
            .rule("needed with a law that goes to a goal", "where its front point goes, in `map`")
            .guesses("goal target destination end"),
        key("hears", Names)
            .optional("the robots that it hears")
            .guesses("neighbors neighbours listens_to heard"),
        key("spares", Names)
            .rule("chosen", "the robots by which it goes in place of those that it has lost, in this order, with \
                   `repair = \"spares\"`")
            .guesses("backups fallbacks"),
        key("deputies", Names)
            .optional("the contained robots that take its place in a containment while it is lost, the first that lives, \
                       with `repair = \"spares\"`")
            .guesses("deputy successors"),
    ]
}

/// Keys that `robot_defaults` may have too, beside gains.
fn defaults() -> Vec<Key> {
    vec![
        key("front_point_m", Number(Positive))
            .rule("needed without a `model`", "how far the front point lies ahead of the axle, in meters")
            .guesses("ell l front lookahead look_ahead off_axis"),
        key("law", Law)
            .rule("needed here or in the other of `robot` and `robot_defaults`", "its control law")
            .guesses("controller control control_law type kind role"),
        key("wheels", Table("wheels"))
            .rule("those of the model, or no limits", "what its wheels can do")
            .guesses("wheel"),
        key("model", Word(models::WORDS))
            .optional("a robot that one can buy: its front point, body, wheels and limits where keys do not \
                       say otherwise")
            .guesses("robot_model platform vehicle body"),
        key("body_radius_m", Number(Positive))
            .rule("that of the model, or not known", "how far its body reaches from the axle's middle")
            .guesses("body_radius robot_radius radius size"),
        key("limits", Table("limits"))
            .rule("those of the model, or it stops at once", "how fast its twist can change")
            .guesses("limit inertia acceleration accelerations dynamics"),
        key("restart_policy", Word(&[
                ("never", "it is not restarted"),
                ("on-failure", "it is, after a signal or an exit code other than 0"),
                ("always", "it is"),
            ]))
            .default("'on-failure'", "whether its process is restarted when it dies unexpectedly")
            .guesses("restart"),
        key("max_restarts", Whole(0, 1_000_000))
            .default("3", "no more restarts than this within the window")
            .guesses("restarts_max restarts"),
        key("restart_delay_s", Time(NotNegative))
            .default("0.5", "wait before the first restart; it doubles each time")
            .guesses("delay restart_after"),
        key("max_restart_delay_s", Time(NotNegative))
            .rule("10 s, or the first wait if that is longer", "the wait grows no longer than this")
            .bounds("`restart_delay_s` to 1e7")
            .guesses("restart_delay_max"),
        key("restart_window_s", Time(Positive))
            .default("60.0", "restarts are counted over this time")
            .guesses("window"),
    ]
}

fn pose() -> Vec<Key> {
    vec![
        key("x_m", Number(Any)).needed("x of the axle's middle, in meters").guesses("x0"),
        key("y_m", Number(Any)).needed("y of the axle's middle, in meters").guesses("y0"),
        key("heading_rad", Number(Any))
            .needed("counter-clockwise from x, in radians")
            .bounds("-2π to 2π")
            .guesses("theta yaw phi angle theta0 orientation heading_deg"),
    ]
}

fn wheels() -> Vec<Key> {
    vec![
        key("speed_max_m_s", Number(Positive))
            .rule("needed without a `model`", "largest speed of a wheel's rim, in m/s")
            .guesses("v_max vmax max_speed speed limit"),
        key("track_m", Number(Positive))
            .rule("needed without a `model`", "distance between the wheels, in meters")
            .guesses("width wheelbase wheel_base base axle"),
    ]
}

fn limits() -> Vec<Key> {
    vec![
        key("acceleration_m_s2", Number(Positive))
            .rule(
                "needed without a `model`",
                "a_v: how fast its speed can change, when braking too",
            )
            .guesses("a a_v acceleration a_max linear_acceleration deceleration"),
        key("turn_acceleration_rad_s2", Number(Positive))
            .rule("needed without a `model`", "a_w: how fast its turn rate can change")
            .guesses("a_w alpha angular_acceleration turn_acceleration"),
        key("braking_time_s", Number(Positive))
            .rule(
                "the longer of v_max / a_v and v_max / (2 a_w `front_point_m`)",
                "tau: no command takes \
                 longer to brake from; its turn rate is a_w tau at most",
            )
            .guesses("tau braking_time stopping_time"),
        key(
            "ramp",
            Word(&[
                ("together", "speed and turn rate arrive at the same time"),
                ("independent", "each is as fast as it can be: the guard promises nothing then"),
            ]),
        )
        .default("'together'", "how speed and turn rate change together"),
    ]
}

fn edge() -> Vec<Key> {
    vec![
        key("from", Text)
            .needed("the robot that is heard")
            .guesses("source src sender speaker heard start tail"),
        key("to", Text)
            .needed("the robot that hears")
            .guesses("target dst dest destination receiver hearer end head"),
        key("offset_m", Pair)
            .rule(
                "the difference of both robots' `place_m`",
                "where `to` stands as seen from `from`",
            )
            .guesses("c displacement delta d relative_position"),
    ]
}

fn wall() -> Vec<Key> {
    vec![
        key("points_m", Points)
            .needed("its points in order: [[0.0, 0.0], [1.0, 0.5]]")
            .guesses("points corners vertices polyline"),
        key("closed", Truth)
            .default("false", "whether it leads back to its first point")
            .guesses("loop cyclic"),
    ]
}

fn obstacle() -> Vec<Key> {
    vec![
        key("kind", Takes::Kind).needed("\"disc\" or \"polygon\"").guesses("type shape"),
        key("center_m", Pair).needed("center of a disc").guesses("centre position origin"),
        key("radius_m", Number(Positive)).needed("radius of a disc").guesses("r size"),
        key("corners_m", Points)
            .needed("corners of a convex polygon, in order: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]")
            .guesses("corners points vertices"),
    ]
}

fn trajectory() -> Vec<Key> {
    vec![
        key("kind", Takes::Kind)
            .needed("\"still\", \"line\", \"circle\", ...")
            .guesses("type shape"),
        key("center_m", Pair)
            .rule("[0.0, 0.0]", "its center; of a line, where it begins")
            .guesses("centre origin start"),
        key("velocity_m_s", Pair).needed("velocity along a line").guesses("v speed"),
        key("radius_m", Number(Positive))
            .needed("radius; of a curve with leaves, half its largest extent")
            .guesses("r a amplitude"),
        key("radii_m", Pair).needed("half the extent in x and in y").guesses("amplitudes radius"),
        key("cycles", Pair)
            .needed("two whole numbers: cycles per period in x and in y")
            .guesses("frequencies ratio"),
        key("phase_rad", Number(Any)).default("0.0", "phase of x").guesses("phi"),
        key("period_s", Number(NotZero))
            .needed("time for one turn; below 0 in the opposite direction, a circle clockwise")
            .guesses("t turn clockwise"),
        key("points_m", Points)
            .needed("the waypoints in order: [[0.0, 0.0], [1.0, 0.5]]")
            .guesses("waypoints path"),
        key("speed_m_s", Number(Positive))
            .needed("how fast the path is driven, in m/s")
            .guesses("v velocity"),
        key("acceleration_m_s2", Number(Positive))
            .rule("`speed_m_s` within 1 s", "how fast its speed is reached")
            .guesses("a acceleration_max a_max"),
        key("closed", Truth)
            .default("false", "whether it leads back to its first point, and goes on for ever")
            .guesses("loop cyclic repeat"),
        key("keep_heading", Truth)
            .default(
                "false",
                "whether the formation keeps its heading where the trajectory stops and reverses: theta_n is \
                 then that of a leader that drives backwards there. Without it, the formation turns by 180 \
                 degrees behind each such point",
            )
            .guesses("backwards reverse keep_frame"),
    ]
}

fn scale() -> Vec<Key> {
    vec![
        key("kind", Takes::Kind).default("'sine'", "\"sine\" or \"closing\"").guesses("type shape"),
        key("mean", Number(Positive)).default("1.0", "mean scale"),
        key("amplitude", Number(NotNegative))
            .rule("0: the scale does not change", "by how much it swings, less than the mean"),
        key("period_s", Number(Positive))
            .rule("needed with `amplitude`", "length of a swing, in seconds")
            .guesses("t"),
        key("from", Number(Positive))
            .rule(
                "what opens the smallest gap to 0.625 times what a robot passes through, times the \
                 square root of the number of robots; to 1.05 times that at least",
                "how large it is while open, 1 or more",
            )
            .guesses("open start max"),
        key("hold_s", Time(NotNegative))
            .rule(
                "2.5 times what the longest way from a start to a place takes, or a quarter of it for \
                 each hop between the two robots farthest apart in the graph; 1.5 times the longer \
                 where robots hear each other, directly or by others",
                "how long it stays open",
            )
            .guesses("hold open_s wait"),
        key("over_s", Time(Positive))
            .rule("so long that no place moves faster than three quarters of the speed of the robots", "how \
                 long it takes to close, and to open again")
            .guesses("over duration close_s"),
        key("reopen_at_s", Times)
            .optional("when it begins to open again, for those that come back late: [120.0, 300.0]")
            .guesses("reopen open_at again"),
    ]
}

fn fault() -> Vec<Key> {
    vec![
        key("at_s", Time(NotNegative))
            .needed("when it happens, in seconds since the start")
            .bounds("0 to less than `duration_s`")
            .guesses("t time start when from"),
        key("kind", Takes::Kind)
            .needed("\"kill\", \"freeze\", \"cut\", ...")
            .guesses("type fault what"),
        key("robot", Text)
            .needed("the name of a robot, or \"*\" for each")
            .guesses("name agent target who"),
        key("from", Text)
            .needed("the robot that is heard, or \"*\" for each")
            .guesses("source sender"),
        key("to", Text).needed("the robot that hears, or \"*\" for each").guesses("receiver"),
        key("stream", Word(&[("odometry", "what it senses"), ("commands", "how it is to move")]))
            .needed("\"odometry\" or \"commands\"")
            .guesses("what topic channel"),
        key("sensor", Word(&[("odometry", "its own pose"), ("proximity", "where others are")]))
            .needed("\"odometry\" or \"proximity\""),
        key("hosts", Texts)
            .needed("names of hosts of the fleet: these and all others cannot hear each other")
            .guesses("host side islands"),
        key("for_s", Time(Positive))
            .rule("to the end of the run", "how long it lasts")
            .guesses("duration length until lasts"),
        key("restart_after_s", Time(Positive))
            .rule("it stays dead", "how long after a kill its replacement is started")
            .guesses("restart back_after restart_delay"),
        key("delay_s", Time(Positive))
            .needed("how much later, in seconds")
            .guesses("by latency delay_ms"),
        key("jitter_s", Time(NotNegative))
            .default("0.0", "by how much the delay varies at most")
            .guesses("jitter_ms"),
        key("probability", Number(Positive))
            .needed("share of what is sent that is lost")
            .bounds("above 0, to 1")
            .guesses("p rate share loss"),
        key("burst", Whole(1, BURST_MAX))
            .default("1", "how many are lost together")
            .guesses("burst_length"),
        key("mean_burst_s", Time(Positive))
            .needed("how long the link stays bad on average")
            .guesses("mean_burst burst_time bad"),
        key("range_m", Number(Positive))
            .needed("the distance at which 37 % (1/e) get through")
            .guesses("range distance reach"),
        key("exponent", Number(Positive))
            .default("2.0", "exponent of the path loss: 2 in free space")
            .guesses("n path_loss"),
        key("bound_m", Number(NotNegative))
            .needed("positions are off by at most this, in meters")
            .bounds("0 to 1e9; above 0 without `heading_bound_rad`")
            .guesses("amplitude sigma std noise bound"),
        key("heading_bound_rad", Number(NotNegative))
            .default("0.0", "the heading is off by at most this; of odometry only")
            .guesses("heading heading_noise"),
        key("by_m", Pair)
            .optional("the position that its beacons say is off by this, in meters")
            .guesses("offset_m lie_m by"),
        key("drift_m_s", Pair)
            .optional("it drifts off at this velocity, which its beacons say it has beside its own, in m/s")
            .guesses("drift velocity_m_s"),
        key("random_m", Number(Positive))
            .optional("it is off by a draw for each beacon, of the disc of this radius, in meters")
            .guesses("random radius_m"),
        key("turn_rad", Number(Any))
            .optional("the heading of the leader's frame that it passes on is off by this")
            .guesses("turn heading_rad frame_rad"),
        key("stuck", Truth).rule("or else `speed_max_m_s`", "the robot stands"),
        key("speed_max_m_s", Number(Positive))
            .rule("or else `stuck`", "its wheels' rims are no faster")
            .guesses("v_max limit"),
        key("processes", Whole(1, LOAD_MAX))
            .needed("how many processes take processor time")
            .guesses("count n number"),
    ]
}

fn chaos() -> Vec<Key> {
    vec![
        key("mean_time_between_kills_s", Number(Positive))
            .optional("how often a robot is killed, in seconds, or `mean_time_between_freezes_s`")
            .guesses("kills mtbf"),
        key("restart_after_s", Time(Positive))
            .default("1.0", "how long after a kill its replacement is started")
            .guesses("restart"),
        key("mean_time_between_freezes_s", Number(Positive))
            .optional("how often a robot is frozen, in seconds")
            .guesses("freezes"),
        key("mean_freeze_s", Number(Positive))
            .default("0.5", "mean length of a freeze")
            .guesses("freeze"),
        key("mean_time_between_partitions_s", Number(Positive))
            .optional(
                "how often one of the `hosts` and all others cannot hear each other, in seconds",
            )
            .guesses("partitions partition"),
        key("mean_partition_s", Number(Positive)).default("2.0", "mean length of a partition"),
        key("hosts", Texts)
            .rule(
                "needed with `mean_time_between_partitions_s`",
                "names of hosts of the fleet, one of which \
                 is cut off at a time",
            )
            .guesses("host"),
        key("from_s", Time(NotNegative)).default("0.0", "nothing happens before").guesses("start"),
        key("until_s", Time(NotNegative))
            .rule("the end of the run", "nothing begins from here on")
            .guesses("end to"),
    ]
}

fn hunt() -> Vec<Key> {
    vec![
        key("vary", Texts)
            .rule(
                "starts, faults and delays",
                "what varies: \"starts\", \"faults\", \"delays\", \"noise\", \"gains\"",
            )
            .guesses("varies varied"),
        key("faults_max", Whole(1, 20))
            .default("3", "most faults in a run")
            .guesses("faults count n"),
        key("kinds", Texts)
            .rule(
                "all that a hunt knows but \"lie\"",
                "kinds of faults, such as \"freeze\" and \"cut\"",
            )
            .guesses("kind fault_kinds"),
        key("robots", Names)
            .rule("all robots", "which robots break, or send on links that do")
            .guesses("robot targets"),
        key("from_s", Time(NotNegative)).default("0.0", "no fault begins before").guesses("start"),
        key("until_s", Time(Positive))
            .rule("half of `duration_s`", "every fault has ended by then")
            .bounds("above `from_s`, to `duration_s`")
            .guesses("end to"),
        key("box_m", Pair)
            .rule(
                "[4 d, 4 d]",
                "the box around each robot's own start in which its front point starts",
            )
            .bounds("each above 0")
            .guesses("box size area"),
        key("apart_m", Number(Positive))
            .rule("1.5 d", "no two front points start nearer than this, or than in the scenario")
            .guesses("apart separation"),
        key("delay_s_max", Time(Positive))
            .rule("4 `period_s`", "longest delay of a link, of odometry, or of commands")
            .guesses("delay latency delay_max latency_max"),
        key("loss_max", Number(Positive))
            .default("0.5", "largest share of what is sent that is lost")
            .bounds("above 0, to 1")
            .guesses("loss"),
        key("noise_m_max", Number(Positive))
            .rule("0.05 d", "largest error of a position that a sensor says")
            .guesses("noise noise_max"),
        key("noise_heading_rad_max", Number(Positive))
            .default("0.02", "largest error of a heading that a sensor says")
            .guesses("heading_noise noise_heading"),
        key("gain_factors", Pair)
            .rule("[0.5, 2]", "gains are those of the scenario times a factor between these two")
            .bounds("each above 0, the first below the second")
            .guesses("gains factors"),
    ]
}

fn expect() -> Vec<Key> {
    vec![
        key("min_distance_m", Number(Positive))
            .optional("no two front points nearer than this at any tick")
            .guesses("distance_min d d_min distance"),
        key("min_clearance_m", Number(Positive))
            .optional("no front point nearer than this to a wall or obstacle at any tick")
            .guesses("clearance clearance_min"),
        key("final_error_m_max", Number(Positive))
            .optional("bound on the worst living error over the last 10 % of the run")
            .guesses("final_error error_max max_error error"),
        key("final_ideal_error_m_max", Number(Positive))
            .optional("bound on the worst living error to the ideal formation, by the main leader's true pose \
                       and the whole graph as planned, over the last 10 % of the run")
            .guesses("final_ideal_error ideal_error ideal_error_m_max"),
        key("tracking_error_m_max", Number(Positive))
            .optional("bound on the main leader's error over the last 10 % of the run")
            .guesses("tracking_error"),
        key("hull_distance_m_max", Number(NotNegative))
            .optional("bound on the distance of contained robots from the leaders' hull over the last 10 %")
            .guesses("hull_distance hull"),
        key("converged_by_s", Number(Positive))
            .optional("all living errors are below `converged_error_m` from then on")
            .bounds("above 0, to `duration_s`")
            .guesses("converged settling_time converged_at"),
        key("recovered_within_s", Number(Positive))
            .optional("the same within this long after each fault's end")
            .guesses("recovery recovered"),
        key("alive_at_end", NamesOrCount)
            .rule("no bound, and the other expectations count all but those that the plan leaves dead", "names \
                 of the robots that live at the end, or how many do at least; others count in no expectation")
            .guesses("alive survivors living"),
        key("deadline_misses_max", Whole(0, i64::MAX as u64))
            .optional("bound on deadline misses of all agents, in real time")
            .guesses("deadline_misses misses"),
        key("exit", Whole(0, 255))
            .rule("0", "the exit code that the run itself ends with")
            .guesses("exit_code code"),
        key("converged_error_m", Number(Positive))
            .default("0.01", "errors below this count as converged")
            .guesses("tolerance converged_error epsilon"),
    ]
}

fn trajectories() -> Vec<Kind> {
    vec![
        Kind::new("still", "a point", "", "center_m"),
        Kind::new("line", "a straight line at a constant speed", "velocity_m_s", "center_m"),
        Kind::new("circle", "a circle", "radius_m period_s", "center_m"),
        Kind::new("quadrifolium", "a rose of four leaves", "radius_m period_s", "center_m"),
        Kind::new(
            "lissajous",
            "a Lissajous curve",
            "radii_m cycles period_s",
            "center_m phase_rad keep_heading",
        ),
        Kind::new("lemniscate", "Bernoulli's lemniscate", "radius_m period_s", "center_m"),
        Kind::new(
            "waypoints",
            "arcs through all points",
            "points_m speed_m_s",
            "acceleration_m_s2 closed keep_heading",
        ),
    ]
}

fn scales() -> [Kind; 2] {
    let closing =
        "open while the robots come to their places, then closing along half a cosine to 1";
    [
        Kind::new("sine", "mean + amplitude sin(2 pi t / period)", "", "mean amplitude period_s"),
        Kind::new("closing", closing, "", "from hold_s over_s reopen_at_s"),
    ]
}
