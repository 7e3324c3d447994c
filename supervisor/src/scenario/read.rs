//! From a file's text to a [`Scenario`]: types, units, ranges, names.
//!
//! Every key of the format is named here and nowhere else. What the values mean together is
//! asked in [`crate::check`]. Nothing is spawned and nothing but the one file is read.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use formation::Vec2;
use formation::frame::Scale;
use formation::graph::{Edge, FormationGraph};
use formation::pose::{Pose, wrap_angle};
use formation::trajectory::Trajectory;
use protocol::brief::{
    AvoidanceBrief, AvoidanceKind, LeadBrief, PublishedVelocity, SilenceBrief, SilencePolicy,
    WheelsBrief,
};
use protocol::law::{LawDescription, Role};
use toml::de::DeTable;

pub use super::overrides::Overrides;

use super::diagnostic::{Diagnostic, Severity, Source, meant};
use super::table::{Document, Places, Table, Value};
use super::{Expectations, Fault, FaultKind, RestartPolicy, RestartWhen, Robot, Scenario, seconds};
use crate::check;

/// Largest scenario file, bytes. 256 robots that all hear each other fit.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Most robots in one scenario: each is a process.
const ROBOTS_MAX: usize = 256;
/// Most ticks in one run: a day at 1 kHz.
const TICKS_MAX: u64 = 100_000_000;
/// Most periods that a command may be held.
const HOLD_PERIODS_MAX: u64 = 100;

const ROOT_KEYS: &[&str] = &[
    "name",
    "description",
    "duration_s",
    "period_s",
    "seed",
    "record_hz",
    "published_velocity",
    "realtime",
    "avoidance",
    "silence",
    "robot_defaults",
    "robot",
    "edge",
    "fault",
    "expect",
    "trajectory",
    "scale",
];
const ROBOT_KEYS: &[&str] = &[
    "front_point_m",
    "law",
    "wheels",
    "restart_policy",
    "max_restarts",
    "restart_delay_s",
    "max_restart_delay_s",
    "restart_window_s",
];
const EXPECT_KEYS: &[&str] = &[
    "min_distance_m",
    "final_error_m_max",
    "hull_distance_m_max",
    "converged_by_s",
    "recovered_within_s",
    "deadline_misses_max",
    "exit",
    "converged_error_m",
];

/// Reads a scenario with the command line's changes.
///
/// Gives the scenario, the text that it was read from (the file's, with the changes applied: a
/// scenario file that can be run again), and what is worth a warning.
pub fn read(
    path: &Path,
    overrides: &Overrides,
    laws: &[LawDescription],
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    read_text(path, &load(path)?, overrides, laws)
}

/// The same for a text at hand; `path` is only shown.
pub fn read_text(
    path: &Path,
    text: &str,
    overrides: &Overrides,
    laws: &[LawDescription],
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    if text.trim().is_empty() {
        return Err(about(path, "is empty", "expected a scenario in TOML"));
    }
    // The file's own text first: its mistakes get places in the file as it is on disk.
    let source = Source::new(path, text, false);
    DeTable::parse(text).map_err(|error| no_toml(&source, error.span(), error.message()))?;
    let text = if overrides.is_empty() {
        text.to_owned()
    } else {
        let mut document = text
            .parse::<toml_edit::DocumentMut>()
            .map_err(|error| no_toml(&source, error.span(), error.message()))?;
        overrides.apply(&mut document)?;
        document.to_string()
    };
    let source = Source::new(path, &text, !overrides.is_empty());
    let entries =
        DeTable::parse(&text).map_err(|error| no_toml(&source, error.span(), error.message()))?;
    let document = Document { source, places: RefCell::default() };
    let root = Table::root(&document, entries.get_ref());
    let (scenario, mut warnings) = scenario(&root, laws, &document)?;

    let places = document.places.borrow();
    for finding in check::check(&scenario) {
        let mut diagnostic = document.source.error(
            &place(&places, &finding.path),
            finding.message,
            finding.expected,
        );
        if finding.severity == Severity::Error {
            return Err(diagnostic);
        }
        diagnostic.severity = Severity::Warning;
        warnings.push(diagnostic);
    }
    drop(places);
    Ok((scenario, text, warnings))
}

/// The place of `path`, or of the nearest thing around it that the text has.
fn place(places: &Places, path: &str) -> Range<usize> {
    let mut path = path;
    loop {
        if let Some(span) = places.get(path) {
            return span.clone();
        }
        match path.rsplit_once('.') {
            Some((parent, _)) => path = parent,
            None => return 0..0,
        }
    }
}

/// The file's text.
fn load(path: &Path) -> Result<String, Diagnostic> {
    let expected = "expected a scenario file, such as scenarios/triangle.toml";
    let cannot = |error: std::io::Error| match error.kind() {
        std::io::ErrorKind::NotFound => about(path, "does not exist", expected),
        std::io::ErrorKind::PermissionDenied => {
            about(path, "may not be read by this user", expected)
        }
        _ => about(path, &format!("cannot be read: {error}"), expected),
    };
    let metadata = std::fs::metadata(path).map_err(cannot)?;
    if metadata.is_dir() {
        return Err(about(path, "is a directory", expected));
    }
    if !metadata.is_file() {
        return Err(about(path, "is not a regular file", expected));
    }
    let too_large = |bytes: u64| {
        about(path, &format!("has {bytes} bytes"), "expected a scenario of at most 1 MiB")
    };
    if metadata.len() > FILE_BYTES_MAX {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::new();
    // It may have grown since.
    File::open(path)
        .and_then(|file| file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes))
        .map_err(cannot)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(too_large(bytes.len() as u64));
    }
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes()[..at].iter().filter(|&&byte| byte == b'\n').count() + 1;
        let byte = error.as_bytes()[at];
        about(
            path,
            &format!("is not UTF-8: byte 0x{byte:02x} at offset {at}, on line {line}"),
            "expected a scenario in TOML, which is UTF-8 text",
        )
    })
}

/// A diagnostic about the file as a whole.
fn about(path: &Path, message: &str, expected: &str) -> Diagnostic {
    Diagnostic::plain(format!("`{}` {message}", path.display()), expected)
}

/// What the TOML parser has to say.
fn no_toml(source: &Source, span: Option<Range<usize>>, message: &str) -> Diagnostic {
    let message = message.lines().collect::<Vec<_>>().join(", ");
    let (what, expected) = match message.split_once(", expected ") {
        Some((what, "nothing")) => (what, "expected nothing more here".to_owned()),
        Some((what, expected)) => (what, format!("expected {expected}")),
        None if message.contains("duplicate key") => {
            (message.as_str(), "expected every key once in its table".to_owned())
        }
        None => (message.as_str(), "expected TOML here".to_owned()),
    };
    source.error(&span.unwrap_or(0..0), format!("this is not TOML: {what}"), expected)
}

/// The whole scenario.
fn scenario(
    root: &Table<'_>,
    laws: &[LawDescription],
    document: &Document,
) -> Result<(Scenario, Vec<Diagnostic>), Diagnostic> {
    root.only(ROOT_KEYS)?;
    let name = root.need("name", "a short name for the experiment, such as \"triangle\"")?;
    let name_text = name.text("expected a string")?;
    if name_text.trim().is_empty() {
        return Err(name.wrong("is empty", "expected a short name, such as \"triangle\""));
    }
    if let Some(description) = root.get("description") {
        description.text("expected a string")?;
    }
    let duration = root.need("duration_s", "how long the run lasts, in seconds")?;
    let duration_ns = duration.duration_ns()?;
    let period = root.need("period_s", "seconds from one command to the next, such as 0.005")?;
    let period_ns = period.duration_ns()?;
    if duration_ns < period_ns {
        return Err(duration.wrong(
            format!("is {}, shorter than one period", seconds(duration_ns)),
            format!("expected at least `period_s`, {} s", seconds(period_ns)),
        ));
    }
    let ticks = duration_ns / period_ns;
    if ticks > TICKS_MAX {
        return Err(period.wrong(
            format!("is {}: {ticks} ticks in {} s", seconds(period_ns), seconds(duration_ns)),
            format!("expected at most {TICKS_MAX} ticks: a longer period or a shorter run"),
        ));
    }
    let seed = match root.get("seed") {
        Some(seed) => seed.integer(0, i64::MAX as u64)?,
        None => 1,
    };
    let record_hz = match root.get("record_hz") {
        Some(record_hz) => record_hz.positive("Hz")?,
        None => 100.0,
    };
    let velocities = [
        ("gamma", PublishedVelocity::Gamma),
        ("gamma+beta", PublishedVelocity::GammaAndBeta),
        ("differenced", PublishedVelocity::Differenced),
    ];
    let published_velocity = root
        .get("published_velocity")
        .map_or(Ok(PublishedVelocity::Gamma), |kind| kind.word(&velocities))?;
    let (plant_tick_ns, latency_allowed_ns, hold_periods) = realtime(root)?;
    let avoidance_table = root
        .need("avoidance", "a table with `kind`, `distance_min_m`, `speed_max_m_s`")?
        .table(&[
            "kind",
            "distance_min_m",
            "speed_max_m_s",
            "epsilon_per_s",
            "sensing_radius_m",
            "sensing_error_m",
        ])?;
    let avoidance = avoidance(&avoidance_table)?;
    let silence = silence(root, period_ns)?;
    let (robots, warnings) = robots(root, laws, document)?;
    let graph = graph(root, &robots)?;
    let lead = lead(root, &robots)?;
    let faults = faults(root, &robots, duration_ns)?;
    let expect = expect(root, duration_ns)?;
    let mut scenario = Scenario {
        name: name_text.to_owned(),
        duration_ns,
        period_ns,
        plant_tick_ns,
        latency_allowed_ns,
        hold_periods,
        seed,
        record_hz,
        published_velocity,
        avoidance,
        silence,
        robots,
        graph,
        lead,
        faults,
        expect,
    };
    scenario.avoidance.sensing_radius_m = match avoidance_table.get("sensing_radius_m") {
        Some(radius) => radius.positive("m")?,
        None => scenario.sensing_radius_needed_m(),
    };
    Ok((scenario, warnings))
}

/// T_p, L and h.
fn realtime(root: &Table<'_>) -> Result<(u64, u64, u32), Diagnostic> {
    let table = root
        .get("realtime")
        .map(|t| t.table(&["plant_tick_s", "latency_allowed_s", "hold_periods"]))
        .transpose()?;
    let get = |key: &str| table.as_ref().and_then(|table| table.get(key));
    let plant_tick_ns = get("plant_tick_s").map_or(Ok(1_000_000), |v| v.duration_ns())?;
    let latency_ns = get("latency_allowed_s").map_or(Ok(2_000_000), |v| v.instant_ns())?;
    let hold = get("hold_periods").map_or(Ok(2), |v| v.integer(1, HOLD_PERIODS_MAX))?;
    Ok((plant_tick_ns, latency_ns, hold as u32))
}

/// `[avoidance]`; the sensing radius is filled in later, from the whole scenario.
fn avoidance(table: &Table<'_>) -> Result<AvoidanceBrief, Diagnostic> {
    let kinds = [
        ("none", AvoidanceKind::None),
        ("focus", AvoidanceKind::Focus),
        ("guard", AvoidanceKind::Guard),
    ];
    let kind = table.get("kind").map_or(Ok(AvoidanceKind::Guard), |kind| kind.word(&kinds))?;
    let distance_min_m = table
        .need("distance_min_m", "no two front points may be nearer than this, in meters")?
        .positive("m")?;
    let speed_max_m_s = match table.get("speed_max_m_s") {
        Some(speed) => speed.positive("m/s")?,
        None if kind == AvoidanceKind::Guard => {
            return Err(table.missing("speed_max_m_s", "the guard needs a speed limit, in m/s"));
        }
        None => f64::INFINITY,
    };
    let epsilon_per_s = match table.get("epsilon_per_s") {
        Some(epsilon) => epsilon.positive("1/s")?,
        None if kind == AvoidanceKind::Focus => {
            return Err(table.missing("epsilon_per_s", "strength of the focus, in 1/s"));
        }
        None => 0.0,
    };
    let sensing_error_m =
        table.get("sensing_error_m").map_or(Ok(0.0), |error| error.not_negative("m"))?;
    Ok(AvoidanceBrief {
        kind,
        distance_min_m,
        speed_max_m_s,
        epsilon_per_s,
        sensing_radius_m: 0.0,
        sensing_error_m,
    })
}

/// `[silence]`.
fn silence(root: &Table<'_>, period_ns: u64) -> Result<SilenceBrief, Diagnostic> {
    let policies = [
        ("ignore", SilencePolicy::Ignore),
        ("keep", SilencePolicy::Keep),
        ("stop", SilencePolicy::Stop),
    ];
    let table = root
        .get("silence")
        .map(|t| t.table(&["stale_after_s", "lost_after_s", "policy"]))
        .transpose()?;
    let get = |key: &str| table.as_ref().and_then(|table| table.get(key));
    let stale = get("stale_after_s");
    let lost = get("lost_after_s");
    let stale_after_ns = stale.as_ref().map_or(Ok(3 * period_ns), Value::duration_ns)?;
    let lost_after_ns =
        lost.as_ref().map_or(Ok((20 * period_ns).max(100_000_000)), Value::duration_ns)?;
    if lost_after_ns < stale_after_ns {
        let (stale_s, lost_s) = (seconds(stale_after_ns), seconds(lost_after_ns));
        return Err(match (&lost, &stale) {
            (Some(lost), _) => lost.wrong(
                format!("is {lost_s}: a neighbor would be lost before it is stale"),
                format!("expected at least `stale_after_s`, {stale_s} s"),
            ),
            (None, Some(stale)) => stale.wrong(
                format!("is {stale_s}: a neighbor would be lost before it is stale"),
                format!("expected at most `lost_after_s`, {lost_s} s"),
            ),
            (None, None) => unreachable!("3 T <= 20 T"),
        });
    }
    let policy =
        get("policy").map_or(Ok(SilencePolicy::Ignore), |policy| policy.word(&policies))?;
    Ok(SilenceBrief { stale_after_ns, lost_after_ns, policy })
}

/// All `[[robot]]`, and gains that nobody uses.
fn robots(
    root: &Table<'_>,
    laws: &[LawDescription],
    document: &Document,
) -> Result<(Vec<Robot>, Vec<Diagnostic>), Diagnostic> {
    let all_gains: Vec<&str> = laws.iter().flat_map(|law| law.gains.iter().copied()).collect();
    let default_keys = [ROBOT_KEYS, &all_gains].concat();
    let robot_keys = [&["name", "pose"], ROBOT_KEYS, &all_gains].concat();
    let defaults =
        root.get("robot_defaults").map(|value| value.table(&default_keys)).transpose()?;
    let tables = root.tables("robot")?;
    if tables.is_empty() {
        return Err(root.missing("robot", "at least one table headed `[[robot]]`"));
    }
    let mut robots: Vec<Robot> = Vec::new();
    for table in tables {
        table.only(&robot_keys)?;
        let name = table.need("name", "a letter, then letters, digits, `-` or `_`")?;
        let name_text = robot_name(&name)?;
        if let Some(first) = robots.iter().position(|robot| robot.name == name_text) {
            return Err(name.wrong(
                format!("is \"{name_text}\", which robot {} is called already", first + 1),
                "expected a name of its own",
            ));
        }
        if robots.len() == ROBOTS_MAX {
            return Err(name.wrong(
                format!("begins robot {}", ROBOTS_MAX + 1),
                format!("expected at most {ROBOTS_MAX} robots: each is a process"),
            ));
        }
        let table = table.named(&format!("robot.{name_text}"), &format!("robot {name_text}"));
        let robot = robot(&table, defaults.as_ref(), name_text, laws, document)?;
        let leads = |other: &&Robot| other.role == Role::Leader;
        if let (Role::Leader, Some(first)) = (robot.role, robots.iter().find(leads)) {
            return Err(name.wrong(
                format!("is \"{name_text}\", a second leader beside {}", first.name),
                "expected one main leader; others keep their place to it with a formation law",
            ));
        }
        robots.push(robot);
    }
    let unused = |(key, span): (&str, Range<usize>)| {
        let owner = laws.iter().find(|law| law.gains.contains(&key))?;
        let used = |robot: &Robot| {
            laws.iter().any(|law| law.name == robot.law && law.gains.contains(&key))
        };
        if robots.iter().any(used) {
            return None;
        }
        let mut warning = document.source.error(
            &span,
            format!("`{key}` has no effect: no robot follows the law \"{}\"", owner.name),
            "expected a gain of a law that is used, or none",
        );
        warning.severity = Severity::Warning;
        Some(warning)
    };
    let warnings =
        defaults.iter().flat_map(|defaults| defaults.keys()).filter_map(unused).collect();
    Ok((robots, warnings))
}

/// One robot.
fn robot(
    table: &Table<'_>,
    defaults: Option<&Table<'_>>,
    name: &str,
    laws: &[LawDescription],
    document: &Document,
) -> Result<Robot, Diagnostic> {
    let start = pose(&table.need("pose", "{ x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }")?)?;
    let need = |key: &str, expected: &str| {
        table.get_or(defaults, key).ok_or_else(|| table.missing(key, expected))
    };
    let front_point_m =
        need("front_point_m", "how far the front point lies ahead of the axle, in meters")?
            .positive("m")?;
    let wheels = match table.get_or(defaults, "wheels") {
        Some(value) => {
            let wheels = value.table(&["speed_max_m_s", "track_m"])?;
            Some(WheelsBrief {
                speed_max_m_s: wheels
                    .need("speed_max_m_s", "largest speed of a wheel's rim, in m/s")?
                    .positive("m/s")?,
                track_m: wheels
                    .need("track_m", "distance between the wheels, in meters")?
                    .positive("m")?,
            })
        }
        None => None,
    };
    let law_names: Vec<&str> = laws.iter().map(|law| law.name).collect();
    let known_laws = format!("one of {}", quoted(&law_names));
    let law_value = need("law", &known_laws)?;
    let law_name = law_value.text(&format!("expected {known_laws}"))?;
    let Some(law) = laws.iter().find(|law| law.name == law_name) else {
        let expected = match meant(law_name, law_names.iter().copied()) {
            Some(close) => format!("did you mean \"{close}\"?"),
            None => format!("expected {known_laws}"),
        };
        return Err(law_value.wrong(format!("is \"{law_name}\", which is no known law"), expected));
    };
    for (key, span) in table.keys() {
        let owner = laws.iter().find(|other| other.gains.contains(&key));
        if let Some(owner) = owner.filter(|_| !law.gains.contains(&key)) {
            return Err(document.source.error(
                &span,
                format!(
                    "`{key}` is a gain of the law \"{}\", but robot {name} follows \"{}\"",
                    owner.name, law.name
                ),
                format!("expected gains of \"{}\": {}", law.name, law.gains.join(", ")),
            ));
        }
    }
    let mut gains = BTreeMap::new();
    for &key in law.gains {
        let expected = format!("a gain of the law \"{}\", above 0", law.name);
        gains.insert(key.to_owned(), need(key, &expected)?.positive(unit_of(key))?);
    }
    Ok(Robot {
        name: name.to_owned(),
        start,
        front_point_m,
        wheels,
        law: law.name.to_owned(),
        role: law.role,
        gains,
        restart: restart(table, defaults)?,
    })
}

/// A robot's name, which becomes part of names of services, processes and files.
fn robot_name<'t>(value: &Value<'t>) -> Result<&'t str, Diagnostic> {
    let expected = "expected a letter, then at most 30 letters, digits, `-` or `_`";
    let name = value.text(expected)?;
    let sound = name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.len() <= 31
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if !sound {
        return Err(value.wrong(format!("is \"{name}\""), expected));
    }
    if name == "plant" || name == "supervisor" {
        return Err(value.wrong(
            format!("is \"{name}\", which is a process of every run already"),
            "expected another name",
        ));
    }
    Ok(name)
}

/// A start pose.
fn pose(value: &Value<'_>) -> Result<Pose, Diagnostic> {
    let table = value.table(&["x_m", "y_m", "heading_rad"])?;
    let coordinate = |key: &str| table.need(key, "a number of meters")?.number("m");
    let (x_m, y_m) = (coordinate("x_m")?, coordinate("y_m")?);
    let heading = table.need("heading_rad", "counter-clockwise from x, in radians")?;
    let heading_rad = heading.number("rad")?;
    if heading_rad.abs() > std::f64::consts::TAU {
        return Err(heading.wrong(
            format!("is {heading_rad}: more than one turn"),
            format!(
                "expected radians from -pi to pi; {heading_rad} degrees are {:.6}",
                wrap_angle(heading_rad.to_radians())
            ),
        ));
    }
    Ok(Pose { x_m, y_m, heading_rad: wrap_angle(heading_rad) })
}

/// What happens when a robot's process dies unasked.
fn restart(table: &Table<'_>, defaults: Option<&Table<'_>>) -> Result<RestartPolicy, Diagnostic> {
    let words = [
        ("never", RestartWhen::Never),
        ("on-failure", RestartWhen::OnFailure),
        ("always", RestartWhen::Always),
    ];
    let get = |key: &str| table.get_or(defaults, key);
    let when = get("restart_policy").map_or(Ok(RestartWhen::OnFailure), |v| v.word(&words))?;
    let restarts_max = get("max_restarts").map_or(Ok(3), |v| v.integer(0, 1_000_000))? as u32;
    let delay_ns = get("restart_delay_s").map_or(Ok(500_000_000), |v| v.instant_ns())?;
    let ceiling = get("max_restart_delay_s");
    let delay_ns_max =
        ceiling.as_ref().map_or(Ok(delay_ns.max(10_000_000_000)), Value::instant_ns)?;
    if let Some(ceiling) = ceiling.filter(|_| delay_ns_max < delay_ns) {
        return Err(ceiling.wrong(
            format!("is {}, shorter than the first wait", seconds(delay_ns_max)),
            format!("expected at least `restart_delay_s`, {} s", seconds(delay_ns)),
        ));
    }
    let window_ns = get("restart_window_s").map_or(Ok(60_000_000_000), |v| v.duration_ns())?;
    Ok(RestartPolicy { when, delay_ns, delay_ns_max, restarts_max, window_ns })
}

/// The place of the robot that `value` names.
fn robot_named(value: &Value<'_>, robots: &[Robot]) -> Result<usize, Diagnostic> {
    let names: Vec<&str> = robots.iter().map(|robot| robot.name.as_str()).collect();
    let expected = format!("expected the name of a robot: {}", shortened(&names));
    let name = value.text(&expected)?;
    names.iter().position(|known| *known == name).ok_or_else(|| {
        let expected = match meant(name, names.iter().copied()) {
            Some(close) if close.len() > 2 => format!("did you mean \"{close}\"?"),
            _ => expected,
        };
        value.wrong(format!("is \"{name}\", but there is no such robot"), expected)
    })
}

/// All `[[edge]]`.
fn graph(root: &Table<'_>, robots: &[Robot]) -> Result<FormationGraph, Diagnostic> {
    let mut edges: Vec<Edge> = Vec::new();
    let mut seen = BTreeMap::new();
    for (index, table) in root.tables("edge")?.into_iter().enumerate() {
        table.only(&["from", "to", "offset_m"])?;
        let from = table.need("from", "the robot that is heard")?;
        let to = table.need("to", "the robot that hears")?;
        let ends = (robot_named(&from, robots)?, robot_named(&to, robots)?);
        if ends.0 == ends.1 {
            return Err(to.wrong(
                format!("is \"{}\", the same as `from`", robots[ends.1].name),
                "expected another robot: nobody hears itself",
            ));
        }
        if let Some(first) = seen.insert(ends, index + 1) {
            return Err(to.wrong(
                format!(
                    "is \"{}\": edge {first} leads from {} to {} already",
                    robots[ends.1].name, robots[ends.0].name, robots[ends.1].name
                ),
                "expected one edge for a pair and direction",
            ));
        }
        let hearer = &robots[ends.1];
        let [x, y] = match (hearer.role, table.get("offset_m")) {
            (Role::Leader, _) => {
                return Err(to.wrong(
                    format!("is \"{}\", the leader", hearer.name),
                    "expected another robot: a leader goes by its trajectory and hears nobody",
                ));
            }
            (Role::Formation, Some(offset)) => offset.pair("m")?,
            (Role::Formation, None) => {
                let expected = "where to stand as seen from the robot heard: [x, y], in meters";
                return Err(table.missing("offset_m", expected));
            }
            (Role::Contained, None) => [0.0, 0.0],
            (Role::Contained, Some(offset)) => {
                return Err(offset.wrong(
                    format!("is given, but {} is contained: its law knows no offsets", hearer.name),
                    "expected no `offset_m` here, or a formation law for that robot",
                ));
            }
        };
        edges.push(Edge { from: ends.0, to: ends.1, offset_m: Vec2::new(x, y) });
    }
    Ok(FormationGraph::new(robots.len(), edges))
}

/// `[trajectory]` and `[scale]`: there if and only if somebody leads.
fn lead(root: &Table<'_>, robots: &[Robot]) -> Result<Option<LeadBrief>, Diagnostic> {
    let leader = robots.iter().find(|robot| robot.role == Role::Leader);
    let (Some(trajectory_value), scale_value) = (root.get("trajectory"), root.get("scale")) else {
        return match (leader, root.get("scale")) {
            (Some(leader), _) => {
                let expected = format!("where {} leads: a table with `kind`", leader.name);
                Err(root.missing("trajectory", &expected))
            }
            (None, Some(scale)) => {
                Err(scale
                    .wrong("is given, but nobody leads", "expected a robot with a leader's law"))
            }
            (None, None) => Ok(None),
        };
    };
    if leader.is_none() {
        return Err(trajectory_value
            .wrong("is given, but nobody leads", "expected a robot with a leader's law"));
    }
    let trajectory = trajectory(&trajectory_value)?;
    let scale = scale_value.as_ref().map_or(Ok(Scale::ONE), scale)?;
    Ok(Some(LeadBrief { scale, trajectory }))
}

/// m(t).
fn trajectory(value: &Value<'_>) -> Result<Trajectory, Diagnostic> {
    const KEYS: &[&str] = &[
        "kind",
        "center_m",
        "velocity_m_s",
        "radius_m",
        "radii_m",
        "cycles",
        "phase_rad",
        "period_s",
    ];
    #[derive(Clone, Copy)]
    enum Kind {
        Still,
        Line,
        Circle,
        Quadrifolium,
        Lissajous,
    }
    let kinds = [
        ("still", Kind::Still, &["center_m"][..]),
        ("line", Kind::Line, &["center_m", "velocity_m_s"]),
        ("circle", Kind::Circle, &["center_m", "radius_m", "period_s"]),
        ("quadrifolium", Kind::Quadrifolium, &["center_m", "radius_m", "period_s"]),
        ("lissajous", Kind::Lissajous, &["center_m", "radii_m", "cycles", "phase_rad", "period_s"]),
    ];
    let words = kinds.map(|(word, kind, _)| (word, kind));
    let table = value.table(KEYS)?;
    let kind_value = table.need("kind", "\"still\", \"line\", \"circle\", ...")?;
    let kind = kind_value.word(&words)?;
    let (word, _, keys) = kinds[kind as usize];
    table.only(&[&["kind"], keys].concat())?;
    let expected = format!("a key of the trajectory \"{word}\"");
    let need = |key: &str| table.need(key, &expected);
    let center_m = table.get("center_m").map_or(Ok([0.0, 0.0]), |center| center.pair("m"))?;
    let radius = || need("radius_m")?.positive("m");
    let period = || need("period_s")?.positive("s");
    Ok(match kind {
        Kind::Still => Trajectory::Still { center_m },
        Kind::Line => {
            Trajectory::Line { center_m, velocity_m_s: need("velocity_m_s")?.pair("m/s")? }
        }
        Kind::Circle => Trajectory::Circle { center_m, radius_m: radius()?, period_s: period()? },
        Kind::Quadrifolium => {
            Trajectory::Quadrifolium { center_m, radius_m: radius()?, period_s: period()? }
        }
        Kind::Lissajous => {
            let cycles = need("cycles")?;
            let whole = cycles.pair("cycles per period")?.map(|n| n as u32);
            if cycles.pair("")? != whole.map(f64::from) || whole.contains(&0) {
                return Err(cycles.wrong("are no cycles", "expected two whole numbers above 0"));
            }
            Trajectory::Lissajous {
                center_m,
                radii_m: need("radii_m")?.pair("m")?,
                cycles: whole,
                phase_rad: table.get("phase_rad").map_or(Ok(0.0), |phase| phase.number("rad"))?,
                period_s: period()?,
            }
        }
    })
}

/// delta(t), which must stay above 0.
fn scale(value: &Value<'_>) -> Result<Scale, Diagnostic> {
    let table = value.table(&["mean", "amplitude", "period_s"])?;
    let mean = table.get("mean").map_or(Ok(1.0), |mean| mean.positive(""))?;
    let Some(amplitude) = table.get("amplitude") else {
        return Ok(Scale { mean, ..Scale::ONE });
    };
    let swing = amplitude.not_negative("")?;
    if swing >= mean {
        return Err(amplitude.wrong(
            format!("is {swing}: the formation would shrink to a point"),
            format!("expected less than `mean`, {mean}"),
        ));
    }
    let period_s = table.need("period_s", "length of a swing, in seconds")?.positive("s")?;
    Ok(Scale { mean, amplitude: swing, period_s })
}

/// All `[[fault]]`, in order of time.
fn faults(root: &Table<'_>, robots: &[Robot], duration_ns: u64) -> Result<Vec<Fault>, Diagnostic> {
    let mut faults = Vec::new();
    for table in root.tables("fault")? {
        table.only(&["at_s", "kind", "robot", "restart_after_s"])?;
        let at = table.need("at_s", "when it happens, in seconds since the start")?;
        let at_ns = at.instant_ns()?;
        if at_ns >= duration_ns {
            return Err(at.wrong(
                format!("is {}, when the run is over", seconds(at_ns)),
                format!("expected less than `duration_s`, {} s", seconds(duration_ns)),
            ));
        }
        table.need("kind", "\"kill\"")?.word(&[("kill", ())])?;
        let robot = robot_named(&table.need("robot", "the name of a robot")?, robots)?;
        let restart_after_ns =
            table.get("restart_after_s").map(|after| after.duration_ns()).transpose()?;
        faults.push((
            Fault { at_ns, for_ns: None, kind: FaultKind::Kill { robot, restart_after_ns } },
            at,
        ));
    }
    faults.sort_by_key(|(fault, _)| fault.at_ns);
    // For each robot: when it is up again after its latest kill; `None` for never.
    let mut dead_until: Vec<Option<u64>> = vec![Some(0); robots.len()];
    for (fault, at) in &faults {
        let FaultKind::Kill { robot, restart_after_ns } = fault.kind else { continue };
        let name = &robots[robot].name;
        let at_s = seconds(fault.at_ns);
        match dead_until[robot] {
            Some(back_ns) if back_ns < fault.at_ns || back_ns == 0 => {}
            Some(back_ns) => {
                return Err(at.wrong(
                    format!("is {at_s}, when {name} is dead already"),
                    format!(
                        "expected more than {} s, when {name} is started again",
                        seconds(back_ns)
                    ),
                ));
            }
            None => {
                return Err(at.wrong(
                    format!("is {at_s}, when {name} is dead already"),
                    format!("expected `restart_after_s` in the kill of {name} before this one"),
                ));
            }
        }
        dead_until[robot] = restart_after_ns.map(|after_ns| fault.at_ns + after_ns);
    }
    Ok(faults.into_iter().map(|(fault, _)| fault).collect())
}

/// `[expect]`.
fn expect(root: &Table<'_>, duration_ns: u64) -> Result<Expectations, Diagnostic> {
    let table = root.get("expect").map(|value| value.table(EXPECT_KEYS)).transpose()?;
    let get = |key: &str| table.as_ref().and_then(|table| table.get(key));
    let positive = |key: &str, unit: &str| get(key).map(|v| v.positive(unit)).transpose();
    let converged_by_s = positive("converged_by_s", "s")?;
    if let (Some(by_s), Some(value)) = (converged_by_s, get("converged_by_s"))
        && by_s > seconds(duration_ns)
    {
        return Err(value.wrong(
            format!("is {by_s}, when the run is over"),
            format!("expected at most `duration_s`, {} s", seconds(duration_ns)),
        ));
    }
    Ok(Expectations {
        min_distance_m: positive("min_distance_m", "m")?,
        final_error_m_max: positive("final_error_m_max", "m")?,
        hull_distance_m_max: get("hull_distance_m_max").map(|v| v.not_negative("m")).transpose()?,
        converged_by_s,
        recovered_within_s: positive("recovered_within_s", "s")?,
        deadline_misses_max: get("deadline_misses_max")
            .map(|value| value.integer(0, i64::MAX as u64))
            .transpose()?,
        exit: get("exit").map(|value| value.integer(0, 255)).transpose()?.map(|code| code as u8),
        converged_error_m: positive("converged_error_m", "m")?.unwrap_or(0.01),
    })
}

/// The unit that a gain's key ends in.
fn unit_of(key: &str) -> &'static str {
    match key {
        key if key.ends_with("_per_s") => "1/s",
        key if key.ends_with("_rad_s") => "rad/s",
        key if key.ends_with("_m_s") => "m/s",
        key if key.ends_with("_m") => "m",
        key if key.ends_with("_s") => "s",
        _ => "",
    }
}

fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}

/// The first few of many names.
fn shortened(names: &[&str]) -> String {
    match names {
        [_, _, _, _, _, _, _, _, _, ..] => {
            format!("{}, ... ({} in all)", names[..8].join(", "), names.len())
        }
        few => few.join(", "),
    }
}
