//! THE table of the scenario format: every key with its type, unit, range, default and meaning.
//!
//! The reader takes types, units, ranges and defaults from these rows, diagnostics their words, the
//! JSON Schema all of it. What values mean together is asked where they are read, and in
//! [`crate::check`]. Nothing is read here.
//!
//! To rename a key, give its row the new name and put the old one into `was`: files that have it
//! are read as before, with a warning.

use std::borrow::Cow;

use protocol::catalog::Catalog;

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
    /// What people write who mean it, without units, in small letters.
    pub guesses: &'static [&'static str],
}

/// What a value is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Takes {
    /// A string.
    Text,
    /// One of these words, each with its meaning.
    Word(&'static [(&'static str, &'static str)]),
    /// The name of a control law.
    Law,
    /// The name of an avoidance method.
    Method,
    /// True or false.
    Truth,
    /// A number in this unit (none: "").
    Number(&'static str, Range),
    /// A time in seconds that is a whole number of nanoseconds.
    Time(Range),
    /// A list of such times, from 0.
    Times,
    /// A whole number from the first to the second.
    Whole(u64, u64),
    /// `[x, y]` in this unit.
    Pair(&'static str),
    /// A list of `[x, y]` in this unit.
    Points(&'static str),
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
}

/// What holds where a key is not given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Otherwise {
    /// It must be given.
    Needed,
    /// That number.
    Number(f64),
    /// That whole number.
    Whole(u64),
    /// That word.
    Word(&'static str),
    /// No.
    No,
    /// Yes.
    Yes,
    /// What these words say.
    Rule(&'static str),
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

impl Section {
    /// The row of that name.
    pub fn key(&self, name: &str) -> Option<&Key> {
        self.keys.iter().find(|key| key.name == name)
    }
}

impl Format {
    /// The keys that scenarios may have with these laws and methods.
    pub fn of(catalog: &Catalog) -> Format {
        let kind = |&(word, says, needs, may): &KindRow| Kind {
            word,
            says,
            needs: needs.to_vec(),
            may: may.to_vec(),
        };
        let faults = FORMS.iter().map(|form| Kind {
            word: form.kind,
            says: form.says,
            needs: form.needs(),
            may: form.may(),
        });
        let section = |name, says, keys: &[Key]| Section {
            name,
            says,
            keys: keys.to_vec(),
            kinds: Vec::new(),
        };
        let mut avoidance = section("avoidance", "How robots keep their distance.", AVOIDANCE);
        for (method, gain) in
            catalog.methods.iter().flat_map(|m| m.gains.iter().map(move |g| (m, g)))
        {
            let says = format!("{}; `{}` needs it", gain.meaning, method.name);
            avoidance.keys.push(gain_row(gain.key, says));
        }
        let mut gains: Vec<Key> = Vec::new();
        for &name in catalog.laws.iter().flat_map(|law| law.gains) {
            if gains.iter().all(|gain| gain.name != name) {
                let users = catalog.laws.iter().filter(|law| law.gains.contains(&name));
                let users: Vec<_> =
                    users.map(|law| format!("`{}` {}", law.name, law.source)).collect();
                let laws = if users.len() == 1 { "law" } else { "laws" };
                gains.push(gain_row(name, format!("gain of the {laws} {}", users.join(", "))));
            }
        }
        let defaults = [DEFAULTS, &gains].concat();
        let robots = [ROBOT, DEFAULTS, &gains].concat();
        let sections = vec![
            section("scenario", "One experiment.", ROOT),
            section("realtime", "How late things may be, in real time.", REALTIME),
            avoidance,
            section(
                "silence",
                "When a robot that is not heard counts as stale, and as lost.",
                SILENCE,
            ),
            section(
                "law",
                "A law in a program of the scenario's own: a table `[laws.NAME]`.",
                &[LAW, PROGRAM].concat(),
            ),
            section(
                "plant",
                "A program of the scenario's own that moves the robots, in place of exact unicycles.",
                PROGRAM,
            ),
            section("robot_defaults", "What all robots have that do not say otherwise.", &defaults),
            section("robot", "One robot.", &robots),
            section("pose", "A pose in the frame `map`.", POSE),
            section("wheels", "What a robot's wheels can do.", WHEELS),
            section("limits", "How fast a robot's twist can change: its inertia.", LIMITS),
            section("edge", "One robot hears another.", EDGE),
            section("wall", "A wall: segments from point to point.", WALL),
            Section {
                kinds: OBSTACLES.iter().map(kind).collect(),
                ..section("obstacle", "Something fixed that robots keep away from.", OBSTACLE)
            },
            Section {
                kinds: TRAJECTORIES.iter().map(kind).collect(),
                ..section("trajectory", "Where the leader's front point goes.", TRAJECTORY)
            },
            Section {
                kinds: SCALES.iter().map(kind).collect(),
                ..section("scale", "How the formation grows and shrinks.", SCALE)
            },
            Section {
                kinds: faults.collect(),
                ..section("fault", "Something that breaks on purpose.", FAULT)
            },
            section(
                "chaos",
                "Kills, freezes and partitions at random times, drawn from the seed.",
                CHAOS,
            ),
            section("expect", "What must hold for exit code 0.", EXPECT),
        ];
        Format {
            sections,
            laws: catalog.laws.iter().map(|law| law.name).collect(),
            methods: catalog.methods.iter().map(|method| method.name).collect(),
        }
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

    /// What was probably meant by a `word` that is none of the `rows` of the section; `elsewhere`:
    /// it may be a key of another one.
    pub fn meant(
        &self,
        section: &Section,
        rows: &[&Key],
        word: &str,
        elsewhere: bool,
    ) -> Option<String> {
        let guess = stem(word);
        let guessed = |key: &Key| key.guesses.contains(&guess.as_str());
        if let Some(key) = rows.iter().find(|key| guessed(key)) {
            return Some(format!("`{}`", key.name));
        }
        if let Some(close) = meant(word, rows.iter().map(|key| key.name)) {
            return Some(format!("`{close}`"));
        }
        let others = self.sections.iter().filter(|other| elsewhere && other.name != section.name);
        others.into_iter().find_map(|other| {
            let key = other.keys.iter().find(|key| stem(key.name) == guess || guessed(key))?;
            Some(match std::ptr::eq(other, self.root()) {
                true => format!("`{}`, outside of all tables", key.name),
                false => format!("`{}` in `{}`", key.name, other.name),
            })
        })
    }
}

impl Key {
    /// Its name, and those that it had.
    pub(crate) fn names(&self) -> impl Iterator<Item = &'static str> {
        [self.name].into_iter().chain(self.was.iter().copied())
    }

    /// The same row with what people write who mean it.
    pub const fn guessed(mut self, guesses: &'static [&'static str]) -> Key {
        self.guesses = guesses;
        self
    }
}

/// A row without old names and guesses.
pub const fn key(
    name: &'static str,
    takes: Takes,
    otherwise: Otherwise,
    says: &'static str,
) -> Key {
    Key { name, takes, otherwise, says: Cow::Borrowed(says), was: &[], guesses: &[] }
}

/// A gain: positive, and needed by those who use it.
fn gain_row(name: &'static str, says: String) -> Key {
    let guesses = GAIN_GUESSES.iter().find(|(key, _)| *key == name).map_or(&[][..], |row| row.1);
    let takes = Takes::Number(unit_of(name), Range::Positive);
    let otherwise = Otherwise::Rule("needed by those who use it");
    Key { name, takes, otherwise, says: says.into(), was: &[], guesses }
}

/// The unit that a gain's key ends in.
fn unit_of(key: &str) -> &'static str {
    UNITS.iter().find(|(suffix, _)| key.ends_with(suffix)).map_or("", |(_, unit)| unit)
}

/// Suffixes and units, longer ones first.
const UNITS: &[(&str, &str)] = &[
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

use Otherwise::{Absent, Needed, No, Rule};
use Range::{Any, NotNegative, Positive};
use Takes::{
    Law, Method, NamedTables, Names, NamesOrCount, Number, Pair, Points, Table, Tables, Text,
    Texts, Time, Times, Truth, Whole, Word,
};

const ROOT: &[Key] = &[
    key(
        "format",
        Whole(FORMAT, FORMAT),
        Otherwise::Whole(FORMAT),
        "number of the format that the file is written in",
    )
    .guessed(&["version", "format_version", "schema"]),
    key("name", Text, Needed, "a short name for the experiment, such as \"triangle\"")
        .guessed(&["title", "id"]),
    key("description", Text, Absent, "what it is about").guessed(&["comment", "about", "notes"]),
    key("duration_s", Time(Positive), Needed, "how long the run lasts, in seconds").guessed(&[
        "end",
        "t_end",
        "tmax",
        "t_max",
        "t_final",
        "tf",
        "length",
        "horizon",
        "time",
        "total_time",
    ]),
    key(
        "end_after_converged_s",
        Time(Positive),
        Absent,
        "the run ends before `duration_s` once all living errors have been below `converged_error_m` for so long, and over the last 10 % of the run, and nothing of the plan is to come: no fault, no opening or closing of the formation, no waypoint",
    )
    .guessed(&["end_when_converged_s", "stop_when_converged_s", "settle_s", "early_stop_s"]),
    key("period_s", Time(Positive), Needed, "seconds from one command to the next, such as 0.005")
        .guessed(&[
            "dt",
            "t",
            "ts",
            "delta_t",
            "step",
            "time_step",
            "timestep",
            "sample_time",
            "sampling_time",
            "sampling_period",
            "control_period",
            "cycle_time",
            "tick",
        ]),
    key("seed", Whole(0, i64::MAX as u64), Otherwise::Whole(1), "seed of everything random")
        .guessed(&["random_seed", "rng_seed", "rng"]),
    key(
        "record_hz",
        Number("Hz", Positive),
        Otherwise::Number(100.0),
        "rows per second of run time and robot in `samples.csv` and in the recording",
    )
    .guessed(&["record", "record_rate", "sample_rate", "log_rate", "rate", "logging"]),
    key(
        "hung_after_s",
        Time(Positive),
        Otherwise::Number(60.0),
        "how long a process may owe the others an answer in lockstep: wall time in which it runs or is blocked",
    )
    .guessed(&["hung", "timeout", "hang", "deadline"]),
    key(
        "published_velocity",
        Word(&[
            ("gamma", "the law's"),
            ("gamma+beta", "the law's with avoidance"),
            ("differenced", "from one position to the next"),
        ]),
        Otherwise::Word("gamma"),
        "which velocity robots publish",
    ),
    key(
        "trajectory",
        Table("trajectory"),
        Rule("needed with a leader"),
        "where the leader's front point goes",
    )
    .guessed(&["path", "reference", "m"]),
    key("scale", Table("scale"), Rule("always 1"), "how the formation grows and shrinks")
        .guessed(&["delta", "scaling"]),
    key(
        "avoidance",
        Table("avoidance"),
        Needed,
        "a table with `kind`, `distance_min_m`, `speed_max_m_s`",
    )
    .guessed(&["collision_avoidance", "collision", "safety", "guard", "repulsion"]),
    key("realtime", Table("realtime"), Absent, "how late things may be, in real time")
        .guessed(&["real_time", "rt"]),
    key(
        "silence",
        Table("silence"),
        Absent,
        "when a robot that is not heard counts as stale, and as lost",
    ),
    key(
        "laws",
        NamedTables("law"),
        Absent,
        "laws in programs of the scenario's own, each a table `[laws.NAME]`",
    ),
    key("plant", Table("plant"), Absent, "a program of the scenario's own that moves the robots")
        .guessed(&["simulator", "physics", "engine", "world", "hardware", "driver"]),
    key(
        "robot_defaults",
        Table("robot_defaults"),
        Absent,
        "what all robots have that do not say otherwise",
    )
    .guessed(&["defaults", "default", "robots_defaults"]),
    key(
        "robot",
        Tables("robot"),
        Needed,
        "at least one table headed `[[robot]]`, or robot = [{ ... }, ...]",
    )
    .guessed(&["robots", "agent", "agents", "node", "nodes", "vehicle", "vehicles"]),
    key("edge", Tables("edge"), Absent, "who hears whom; robots may say so with `hears` too")
        .guessed(&[
            "edges",
            "link",
            "links",
            "neighbor",
            "neighbors",
            "neighbour",
            "neighbours",
            "connections",
            "adjacency",
        ]),
    key(
        "graph",
        Text,
        Absent,
        "a file with edges, and perhaps robots: .json (node-link), .csv (matrix) or .graphml",
    )
    .guessed(&["graph_file", "network", "topology", "import"]),
    key("wall", Tables("wall"), Absent, "walls: lines through points")
        .guessed(&["walls", "lines", "segments", "boundary"]),
    key("obstacle", Tables("obstacle"), Absent, "discs and convex polygons that robots keep away from")
        .guessed(&["obstacles", "disc", "discs", "polygon", "polygons", "shelf", "shelves"]),
    key("fault", Tables("fault"), Absent, "what breaks on purpose")
        .guessed(&["faults", "failure", "failures", "event", "events"]),
    key("chaos", Table("chaos"), Absent, "kills, freezes and partitions at random times")
        .guessed(&["random_faults", "chaos_monkey"]),
    key("expect", Table("expect"), Absent, "what must hold for exit code 0").guessed(&[
        "expectations",
        "expected",
        "assert",
        "require",
        "check",
    ]),
];

const REALTIME: &[Key] = &[
    key(
        "plant_tick_s",
        Time(Positive),
        Otherwise::Number(0.001),
        "T_p: the plant's tick in real time",
    )
    .guessed(&["tick", "plant_period", "t_p"]),
    key(
        "latency_allowed_s",
        Time(NotNegative),
        Otherwise::Number(0.002),
        "L: latency from odometry to command that is allowed for",
    )
    .guessed(&["l", "latency", "latency_max"]),
    key(
        "between_hosts_s",
        Time(NotNegative),
        Otherwise::Number(0.0),
        "how much later a sample may come because it goes from host to host, which H has room for; `--fleet` sets it",
    ),
    key(
        "hold_periods",
        Whole(1, HOLD_PERIODS_MAX),
        Otherwise::Whole(2),
        "h: for how many periods a command may be held",
    )
    .guessed(&["h", "hold", "periods"]),
    key(
        "control_timer",
        Truth,
        Otherwise::Yes,
        "whether one process with the robots' timer and nothing else shows what the machine does to anybody",
    )
    .guessed(&["control", "control_group", "baseline", "machine"]),
];

const AVOIDANCE: &[Key] = &[
    key("kind", Method, Rule("`guard`"), "the avoidance method")
        .guessed(&["method", "type", "mode", "name"]),
    key(
        "distance_min_m",
        Number("m", Positive),
        Needed,
        "d: no two front points may be nearer than this, in meters",
    )
    .guessed(&[
        "d",
        "d_min",
        "dmin",
        "min_distance",
        "minimum_distance",
        "minimal_distance",
        "safe_distance",
        "safety_distance",
        "distance",
        "radius",
    ]),
    key(
        "speed_max_m_s",
        Number("m/s", Positive),
        Rule("no limit; `guard` needs one"),
        "v_max: no front point moves faster than this",
    )
    .guessed(&[
        "v_max",
        "vmax",
        "max_speed",
        "speed",
        "max_velocity",
        "velocity_max",
        "speed_limit",
        "v",
    ]),
    key(
        "clearance_m",
        Number("m", Positive),
        Rule("half of `distance_min_m`"),
        "no front point may be nearer than this to a wall or obstacle, in meters",
    )
    .guessed(&["clearance", "wall_distance", "obstacle_distance", "margin", "d_o"]),
    key(
        "sensing_radius_m",
        Number("m", Positive),
        Rule("as far as the method needs"),
        "within this distance robots see each other and walls",
    )
    .guessed(&["sensing", "sensor_range", "range", "sensing_range", "r_s"]),
    key(
        "sensing_error_m",
        Number("m", NotNegative),
        Rule("0, or what noise faults make of it"),
        "by how much a sensed distance may be off",
    )
    .guessed(&["error", "sensing_noise"]),
    key(
        "heading_error_rad",
        Number("rad", NotNegative),
        Rule("0, or what noise faults make of it"),
        "by how much a robot may be wrong about its own heading",
    )
    .guessed(&["heading_noise", "heading_error_deg"]),
];

const SILENCE: &[Key] = &[
    key(
        "stale_after_s",
        Time(Positive),
        Rule("3 periods"),
        "who is not heard for longer is stale: extrapolated",
    )
    .guessed(&["stale"]),
    key(
        "lost_after_s",
        Time(Positive),
        Rule("20 periods, but 0.1 s at least"),
        "who is not heard for longer is lost",
    )
    .guessed(&["lost", "timeout"]),
    key(
        "policy",
        Word(&[
            ("last", "the lost do not count, unless nobody else is left: then as with keep"),
            ("ignore", "the lost do not count, and who has nobody left stops"),
            ("keep", "the lost are taken to stand at their last extrapolated point"),
            ("stop", "who has lost one stops"),
        ]),
        Otherwise::Word("last"),
        "what is done about the lost",
    ),
];

/// Keys of one law in a program of its own, beside those of its program.
const LAW: &[Key] = &[
    key(
        "role",
        Word(&[
            ("leader", "it follows the trajectory"),
            ("formation", "it keeps a place in the formation"),
            ("contained", "it goes to the middle of those that it hears"),
            ("goal", "it goes to its `goal_m`"),
        ]),
        Needed,
        "what it makes of a robot: what the error is measured against",
    )
    .guessed(&["kind", "type"]),
    key(
        "gains",
        Texts,
        Rule("none"),
        "keys of its gains, with the unit last: robots that follow it must have them, above 0",
    )
    .guessed(&["parameters", "params", "gain"]),
    key(
        "feed_forward",
        Truth,
        No,
        "whether it uses the velocities of those heard: `phalanx check` asks whether these die out",
    ),
    key(
        "correction_max",
        Text,
        Absent,
        "which of its gains, in m/s, bounds each component of what it adds to these velocities",
    ),
];

/// Keys of a program of the scenario's own.
const PROGRAM: &[Key] = &[
    key(
        "program",
        Texts,
        Needed,
        "the program and its arguments, as in [\"python3\", \"my_law.py\"]; files among them lie in the \
         scenario's folder, and are copied into the run's directory",
    )
    .guessed(&["command", "cmd", "executable", "script", "run"]),
    key("files", Texts, Rule("none"), "other files of that folder that it needs")
        .guessed(&["data", "needs", "modules"]),
    key(
        "memory_max_mb",
        Whole(1, MEMORY_MB_MAX),
        Rule("no bound"),
        "it may have no more memory of its own than this, in MB (RLIMIT_DATA)",
    )
    .guessed(&["memory", "memory_max", "max_memory", "memory_limit"]),
];

/// Most memory that a program may be bound to, MB: a terabyte.
const MEMORY_MB_MAX: u64 = 1 << 20;

/// Keys of one robot alone.
const ROBOT: &[Key] =
    &[
        key("name", Text, Needed, "a letter, then letters, digits, `-` or `_`")
            .guessed(&["id", "label"]),
        key("pose", Table("pose"), Needed, "{ x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }")
            .guessed(&["start", "position", "initial", "initial_pose", "x0", "start_pose"]),
        key(
            "place_m",
            Pair("m"),
            Rule("offsets stand at the edges"),
            "its place in the formation's shape",
        )
        .guessed(&["slot", "formation", "place"]),
        key(
            "goal_m",
            Pair("m"),
            Rule("needed with a law that goes to a goal"),
            "where its front point goes, in `map`",
        )
        .guessed(&["goal", "target", "destination", "end"]),
        key("hears", Names, Absent, "the robots that it hears").guessed(&[
            "neighbors",
            "neighbours",
            "listens_to",
            "heard",
        ]),
    ];

/// Keys that `robot_defaults` may have too, beside gains.
const DEFAULTS: &[Key] = &[
    key(
        "front_point_m",
        Number("m", Positive),
        Rule("needed without a `model`"),
        "how far the front point lies ahead of the axle, in meters",
    )
    .guessed(&["ell", "l", "front", "lookahead", "look_ahead", "off_axis"]),
    key("law", Law, Needed, "its control law").guessed(&[
        "controller",
        "control",
        "control_law",
        "type",
        "kind",
        "role",
    ]),
    key("wheels", Table("wheels"), Rule("those of the model, or no limits"), "what its wheels can do").guessed(&["wheel"]),
    key(
        "model",
        Word(models::WORDS),
        Absent,
        "a robot that one can buy: its front point, body, wheels and limits where keys do not say otherwise",
    )
    .guessed(&["robot_model", "platform", "vehicle", "body"]),
    key(
        "body_radius_m",
        Number("m", Positive),
        Rule("that of the model, or not known"),
        "how far its body reaches from the axle's middle",
    )
    .guessed(&["body_radius", "robot_radius", "radius", "size"]),
    key(
        "limits",
        Table("limits"),
        Rule("those of the model, or it stops at once"),
        "how fast its twist can change",
    )
        .guessed(&["limit", "inertia", "acceleration", "accelerations", "dynamics"]),
    key(
        "restart_policy",
        Word(&[
            ("never", "it is not restarted"),
            ("on-failure", "it is, after a signal or an exit code other than 0"),
            ("always", "it is"),
        ]),
        Otherwise::Word("on-failure"),
        "whether its process is restarted when it dies unexpectedly",
    )
    .guessed(&["restart"]),
    key(
        "max_restarts",
        Whole(0, 1_000_000),
        Otherwise::Whole(3),
        "no more restarts than this within the window",
    )
    .guessed(&["restarts_max", "restarts"]),
    key(
        "restart_delay_s",
        Time(NotNegative),
        Otherwise::Number(0.5),
        "wait before the first restart; it doubles each time",
    )
    .guessed(&["delay", "restart_after"]),
    key(
        "max_restart_delay_s",
        Time(NotNegative),
        Rule("10 s, or the first wait if that is longer"),
        "the wait grows no longer than this",
    )
    .guessed(&["restart_delay_max"]),
    key(
        "restart_window_s",
        Time(Positive),
        Otherwise::Number(60.0),
        "restarts are counted over this time",
    )
    .guessed(&["window"]),
];

const GAIN_GUESSES: &[(&str, &[&str])] = &[
    ("speed_m_s", &["mu", "gain", "k", "v", "velocity"]),
    ("k_f_m_s", &["kf", "k_formation", "mu_f"]),
    ("k_c_m_s", &["kc", "k_containment", "k_contained", "mu_c"]),
    ("k_m_m_s", &["km", "k_m", "k_leader", "mu_m"]),
    ("k_g_m_s", &["kg", "k_g", "k_goal"]),
    ("epsilon_per_s", &["eps", "e", "strength"]),
];

const POSE: &[Key] = &[
    key("x_m", Number("m", Any), Needed, "x of the axle's middle, in meters").guessed(&["x0"]),
    key("y_m", Number("m", Any), Needed, "y of the axle's middle, in meters").guessed(&["y0"]),
    key("heading_rad", Number("rad", Any), Needed, "counter-clockwise from x, in radians")
        .guessed(&["theta", "yaw", "phi", "angle", "theta0", "orientation", "heading_deg"]),
];

const WHEELS: &[Key] = &[
    key(
        "speed_max_m_s",
        Number("m/s", Positive),
        Rule("needed without a `model`"),
        "largest speed of a wheel's rim, in m/s",
    )
    .guessed(&["v_max", "vmax", "max_speed", "speed", "limit"]),
    key(
        "track_m",
        Number("m", Positive),
        Rule("needed without a `model`"),
        "distance between the wheels, in meters",
    )
    .guessed(&["width", "wheelbase", "wheel_base", "base", "axle"]),
];

const LIMITS: &[Key] = &[
    key(
        "acceleration_m_s2",
        Number("m/s^2", Positive),
        Rule("needed without a `model`"),
        "a_v: how fast its speed can change, when braking too",
    )
    .guessed(&["a", "a_v", "acceleration", "a_max", "linear_acceleration", "deceleration"]),
    key(
        "turn_acceleration_rad_s2",
        Number("rad/s^2", Positive),
        Rule("needed without a `model`"),
        "a_w: how fast its turn rate can change",
    )
    .guessed(&["a_w", "alpha", "angular_acceleration", "turn_acceleration"]),
    key(
        "braking_time_s",
        Number("s", Positive),
        Rule("the longer of v_max / a_v and v_max / (2 a_w `front_point_m`)"),
        "tau: no command takes longer to brake from; its turn rate is a_w tau at most",
    )
    .guessed(&["tau", "braking_time", "stopping_time"]),
    key(
        "ramp",
        Word(&[
            ("together", "speed and turn rate arrive at the same time"),
            ("independent", "each is as fast as it can be: the guard promises nothing then"),
        ]),
        Otherwise::Word("together"),
        "how speed and turn rate change together",
    ),
];

const EDGE: &[Key] = &[
    key("from", Text, Needed, "the robot that is heard")
        .guessed(&["source", "src", "sender", "speaker", "heard", "start", "tail"]),
    key("to", Text, Needed, "the robot that hears").guessed(&[
        "target",
        "dst",
        "dest",
        "destination",
        "receiver",
        "hearer",
        "end",
        "head",
    ]),
    key(
        "offset_m",
        Pair("m"),
        Rule("the difference of both robots' `place_m`"),
        "where `to` stands as seen from `from`",
    )
    .guessed(&["c", "displacement", "delta", "d", "relative_position"]),
];

const WALL: &[Key] = &[
    key("points_m", Points("m"), Needed, "its points in order: [[0.0, 0.0], [1.0, 0.5]]")
        .guessed(&["points", "corners", "vertices", "polyline"]),
    key("closed", Truth, No, "whether it leads back to its first point")
        .guessed(&["loop", "cyclic"]),
];

const OBSTACLE: &[Key] = &[
    key("kind", Word(&[("disc", ""), ("polygon", "")]), Needed, "\"disc\" or \"polygon\"")
        .guessed(&["type", "shape"]),
    key("center_m", Pair("m"), Needed, "center of a disc")
        .guessed(&["centre", "position", "origin"]),
    key("radius_m", Number("m", Positive), Needed, "radius of a disc").guessed(&["r", "size"]),
    key(
        "corners_m",
        Points("m"),
        Needed,
        "corners of a convex polygon, in order: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]",
    )
    .guessed(&["corners", "points", "vertices"]),
];

const OBSTACLES: &[KindRow] = &[
    ("disc", "a disc", &["center_m", "radius_m"], &[]),
    ("polygon", "a convex polygon", &["corners_m"], &[]),
];

const TRAJECTORY: &[Key] = &[
    key(
        "kind",
        Word(&[
            ("still", ""),
            ("line", ""),
            ("circle", ""),
            ("quadrifolium", ""),
            ("lissajous", ""),
            ("lemniscate", ""),
            ("waypoints", ""),
        ]),
        Needed,
        "\"still\", \"line\", \"circle\", ...",
    )
    .guessed(&["type", "shape"]),
    key("center_m", Pair("m"), Rule("[0.0, 0.0]"), "its center; of a line, where it begins")
        .guessed(&["centre", "origin", "start"]),
    key("velocity_m_s", Pair("m/s"), Needed, "velocity along a line").guessed(&["v", "speed"]),
    key(
        "radius_m",
        Number("m", Positive),
        Needed,
        "radius; of a curve with leaves, half its largest extent",
    )
    .guessed(&["r", "a", "amplitude"]),
    key("radii_m", Pair("m"), Needed, "half the extent in x and in y")
        .guessed(&["amplitudes", "radius"]),
    key(
        "cycles",
        Pair("cycles per period"),
        Needed,
        "two whole numbers: cycles per period in x and in y",
    )
    .guessed(&["frequencies", "ratio"]),
    key("phase_rad", Number("rad", Any), Otherwise::Number(0.0), "phase of x").guessed(&["phi"]),
    key("period_s", Number("s", Positive), Needed, "time for one turn").guessed(&["t", "turn"]),
    key("points_m", Points("m"), Needed, "the waypoints in order: [[0.0, 0.0], [1.0, 0.5]]")
        .guessed(&["waypoints", "path"]),
    key("speed_m_s", Number("m/s", Positive), Needed, "how fast the path is driven, in m/s")
        .guessed(&["v", "velocity"]),
    key(
        "acceleration_m_s2",
        Number("m/s^2", Positive),
        Rule("`speed_m_s` within 1 s"),
        "how fast its speed is reached",
    )
    .guessed(&["a", "acceleration_max", "a_max"]),
    key("closed", Truth, No, "whether it leads back to its first point, and goes on for ever")
        .guessed(&["loop", "cyclic", "repeat"]),
];

/// Word, meaning, keys that it needs, keys that it may have.
type KindRow = (&'static str, &'static str, &'static [&'static str], &'static [&'static str]);

const TRAJECTORIES: &[KindRow] = &[
    ("still", "a point", &[], &["center_m"]),
    ("line", "a straight line at a constant speed", &["velocity_m_s"], &["center_m"]),
    ("circle", "a circle", &["radius_m", "period_s"], &["center_m"]),
    ("quadrifolium", "a rose of four leaves", &["radius_m", "period_s"], &["center_m"]),
    (
        "lissajous",
        "a Lissajous curve",
        &["radii_m", "cycles", "period_s"],
        &["center_m", "phase_rad"],
    ),
    ("lemniscate", "Bernoulli's lemniscate", &["radius_m", "period_s"], &["center_m"]),
    (
        "waypoints",
        "arcs through all points",
        &["points_m", "speed_m_s"],
        &["acceleration_m_s2", "closed"],
    ),
];

const SCALE: &[Key] = &[
    key(
        "kind",
        Word(&[("sine", ""), ("closing", "")]),
        Otherwise::Word("sine"),
        "\"sine\" or \"closing\"",
    )
    .guessed(&["type", "shape"]),
    key("mean", Number("", Positive), Otherwise::Number(1.0), "mean scale"),
    key(
        "amplitude",
        Number("", NotNegative),
        Rule("0: the scale does not change"),
        "by how much it swings, less than the mean",
    ),
    key(
        "period_s",
        Number("s", Positive),
        Rule("needed with `amplitude`"),
        "length of a swing, in seconds",
    )
    .guessed(&["t"]),
    key(
        "from",
        Number("", Positive),
        Rule("what opens the smallest gap to 0.625 times what a robot passes through, times the square root of the number of robots; to 1.05 times that at least"),
        "how large it is while open, 1 or more",
    )
    .guessed(&["open", "start", "max"]),
    key(
        "hold_s",
        Time(NotNegative),
        Rule("2.5 times what the longest way from a start to a place takes, or a quarter of it for each hop between the two robots farthest apart in the graph; 1.5 times the longer where robots hear each other, directly or by others"),
        "how long it stays open",
    )
    .guessed(&["hold", "open_s", "wait"]),
    key(
        "over_s",
        Time(Positive),
        Rule("so long that no place moves faster than three quarters of the speed of the robots"),
        "how long it takes to close, and to open again",
    )
    .guessed(&["over", "duration", "close_s"]),
    key(
        "reopen_at_s",
        Times,
        Absent,
        "when it begins to open again, for those that come back late: [120.0, 300.0]",
    )
    .guessed(&["reopen", "open_at", "again"]),
];

const SCALES: &[KindRow] = &[
    ("sine", "mean + amplitude sin(2 pi t / period)", &[], &["mean", "amplitude", "period_s"]),
    (
        "closing",
        "open while the robots come to their places, then closing along half a cosine to 1",
        &[],
        &["from", "hold_s", "over_s", "reopen_at_s"],
    ),
];

const FAULT: &[Key] = &[
    key("at_s", Time(NotNegative), Needed, "when it happens, in seconds since the start")
        .guessed(&["t", "time", "start", "when", "from"]),
    key(
        "kind",
        Word(&[
            ("kill", ""),
            ("freeze", ""),
            ("slow", ""),
            ("cut", ""),
            ("loss", ""),
            ("bursts", ""),
            ("fading", ""),
            ("delay", ""),
            ("blackout", ""),
            ("noise", ""),
            ("wheels", ""),
            ("partition", ""),
            ("load", ""),
        ]),
        Needed,
        "\"kill\", \"freeze\", \"cut\", ...",
    )
    .guessed(&["type", "fault", "what"]),
    key("robot", Text, Needed, "the name of a robot, or \"*\" for each")
        .guessed(&["name", "agent", "target", "who"]),
    key("from", Text, Needed, "the robot that is heard, or \"*\" for each")
        .guessed(&["source", "sender"]),
    key("to", Text, Needed, "the robot that hears, or \"*\" for each").guessed(&["receiver"]),
    key(
        "stream",
        Word(&[("odometry", "what it senses"), ("commands", "how it is to move")]),
        Needed,
        "\"odometry\" or \"commands\"",
    )
    .guessed(&["what", "topic", "channel"]),
    key(
        "sensor",
        Word(&[("odometry", "its own pose"), ("proximity", "where others are")]),
        Needed,
        "\"odometry\" or \"proximity\"",
    ),
    key(
        "hosts",
        Texts,
        Needed,
        "names of hosts of the fleet: these and all others cannot hear each other",
    )
    .guessed(&["host", "side", "islands"]),
    key("for_s", Time(Positive), Rule("to the end of the run"), "how long it lasts")
        .guessed(&["duration", "length", "until", "lasts"]),
    key(
        "restart_after_s",
        Time(Positive),
        Rule("it stays dead"),
        "how long after a kill its replacement is started",
    )
    .guessed(&["restart", "back_after", "restart_delay"]),
    key("delay_s", Time(Positive), Needed, "how much later, in seconds")
        .guessed(&["by", "latency", "delay_ms"]),
    key(
        "jitter_s",
        Time(NotNegative),
        Otherwise::Number(0.0),
        "by how much the delay varies at most",
    )
    .guessed(&["jitter_ms"]),
    key("probability", Number("", Positive), Needed, "share of what is sent that is lost")
        .guessed(&["p", "rate", "share", "loss"]),
    key("burst", Whole(1, BURST_MAX), Otherwise::Whole(1), "how many are lost together")
        .guessed(&["burst_length"]),
    key("mean_burst_s", Time(Positive), Needed, "how long the link stays bad on average")
        .guessed(&["mean_burst", "burst_time", "bad"]),
    key("range_m", Number("m", Positive), Needed, "the distance at which 37 % (1/e) get through")
        .guessed(&["range", "distance", "reach"]),
    key(
        "exponent",
        Number("", Positive),
        Otherwise::Number(2.0),
        "exponent of the path loss: 2 in free space",
    )
    .guessed(&["n", "path_loss"]),
    key(
        "bound_m",
        Number("m", NotNegative),
        Needed,
        "positions are off by at most this, in meters",
    )
    .guessed(&["amplitude", "sigma", "std", "noise", "bound"]),
    key(
        "heading_bound_rad",
        Number("rad", NotNegative),
        Otherwise::Number(0.0),
        "the heading is off by at most this; of odometry only",
    )
    .guessed(&["heading", "heading_noise"]),
    key("stuck", Truth, Rule("or else `speed_max_m_s`"), "the robot stands"),
    key(
        "speed_max_m_s",
        Number("m/s", Positive),
        Rule("or else `stuck`"),
        "its wheels' rims are no faster",
    )
    .guessed(&["v_max", "limit"]),
    key("processes", Whole(1, LOAD_MAX), Needed, "how many processes take processor time")
        .guessed(&["count", "n", "number"]),
];

const CHAOS: &[Key] = &[
    key(
        "mean_time_between_kills_s",
        Number("s", Positive),
        Absent,
        "how often a robot is killed, in seconds, or `mean_time_between_freezes_s`",
    )
    .guessed(&["kills", "mtbf"]),
    key(
        "restart_after_s",
        Time(Positive),
        Otherwise::Number(1.0),
        "how long after a kill its replacement is started",
    )
    .guessed(&["restart"]),
    key(
        "mean_time_between_freezes_s",
        Number("s", Positive),
        Absent,
        "how often a robot is frozen, in seconds",
    )
    .guessed(&["freezes"]),
    key("mean_freeze_s", Number("s", Positive), Otherwise::Number(0.5), "mean length of a freeze")
        .guessed(&["freeze"]),
    key(
        "mean_time_between_partitions_s",
        Number("s", Positive),
        Absent,
        "how often one of the `hosts` and all others cannot hear each other, in seconds",
    )
    .guessed(&["partitions", "partition"]),
    key(
        "mean_partition_s",
        Number("s", Positive),
        Otherwise::Number(2.0),
        "mean length of a partition",
    ),
    key(
        "hosts",
        Texts,
        Rule("needed with `mean_time_between_partitions_s`"),
        "names of hosts of the fleet, one of which is cut off at a time",
    )
    .guessed(&["host"]),
    key("from_s", Time(NotNegative), Otherwise::Number(0.0), "nothing happens before")
        .guessed(&["start"]),
    key("until_s", Time(NotNegative), Rule("the end of the run"), "nothing begins from here on")
        .guessed(&["end", "to"]),
];

const EXPECT: &[Key] = &[
    key(
        "min_distance_m",
        Number("m", Positive),
        Absent,
        "no two front points nearer than this at any tick",
    )
    .guessed(&["distance_min", "d", "d_min", "distance"]),
    key(
        "min_clearance_m",
        Number("m", Positive),
        Absent,
        "no front point nearer than this to a wall or obstacle at any tick",
    )
    .guessed(&["clearance", "clearance_min"]),
    key(
        "final_error_m_max",
        Number("m", Positive),
        Absent,
        "bound on the worst living error over the last 10 % of the run",
    )
    .guessed(&["final_error", "error_max", "max_error", "error"]),
    key(
        "final_ideal_error_m_max",
        Number("m", Positive),
        Absent,
        "bound on the worst living error to the ideal formation, by the main leader's true pose and \
         the whole graph as planned, over the last 10 % of the run",
    )
    .guessed(&["final_ideal_error", "ideal_error", "ideal_error_m_max"]),
    key(
        "tracking_error_m_max",
        Number("m", Positive),
        Absent,
        "bound on the main leader's error over the last 10 % of the run",
    )
    .guessed(&["tracking_error"]),
    key(
        "hull_distance_m_max",
        Number("m", NotNegative),
        Absent,
        "bound on the distance of contained robots from the leaders' hull over the last 10 %",
    )
    .guessed(&["hull_distance", "hull"]),
    key(
        "converged_by_s",
        Number("s", Positive),
        Absent,
        "all living errors are below `converged_error_m` from then on",
    )
    .guessed(&["converged", "settling_time", "converged_at"]),
    key(
        "recovered_within_s",
        Number("s", Positive),
        Absent,
        "the same within this long after each fault's end",
    )
    .guessed(&["recovery", "recovered"]),
    key(
        "alive_at_end",
        NamesOrCount,
        Rule("no bound, and the other expectations count all but those that the plan leaves dead"),
        "names of the robots that live at the end, or how many do at least; others count in no \
         expectation",
    )
    .guessed(&["alive", "survivors", "living"]),
    key(
        "deadline_misses_max",
        Whole(0, i64::MAX as u64),
        Absent,
        "bound on deadline misses of all agents, in real time",
    )
    .guessed(&["deadline_misses", "misses"]),
    key("exit", Whole(0, 255), Rule("0"), "the exit code that the run itself ends with")
        .guessed(&["exit_code", "code"]),
    key(
        "converged_error_m",
        Number("m", Positive),
        Otherwise::Number(0.01),
        "errors below this count as converged",
    )
    .guessed(&["tolerance", "converged_error", "epsilon"]),
];
