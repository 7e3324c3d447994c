//! From a file's text to a [`Scenario`]: the whole of it, and its tables without robots in them.
//!
//! Every key of the format is named in here, in `robots`, `graph`, `lead`, `faults` and `expect`,
//! and nowhere else. What the values mean together is asked in [`crate::check`]. Nothing is
//! spawned.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use protocol::avoidance::AvoidanceDescription;
use protocol::brief::{AvoidanceBrief, PublishedVelocity, SilenceBrief, SilencePolicy};
use protocol::catalog::Catalog;
use protocol::fault::SensorFaultKind;
use protocol::visible::is_hidden;
use toml::Spanned;
use toml::de::DeTable;
use toml_edit::DocumentMut;

pub use super::overrides::Overrides;

use super::diagnostic::{Diagnostic, Severity, Source};
use super::expect::expect;
use super::faults::{Scene, faults};
use super::file::{Trouble, load};
use super::graph::graph;
use super::import::splice::{Spliced, splice};
use super::lead::lead;
use super::robots::{Robots, robot_keys, robots, unit_of};
use super::table::{Document, Places, Table, Value};
use super::{Fault, FaultKind, Scenario, seconds};
use crate::check;

/// Most ticks in one run: a day at 1 kHz.
const TICKS_MAX: u64 = 100_000_000;

/// How long a process may owe the others an answer in lockstep, ns: longer than any law computes.
const HUNG_AFTER_NS: u64 = 60_000_000_000;
/// The least that may be asked for, ns.
const HUNG_AFTER_NS_MIN: u64 = 100_000_000;

/// Most periods that a command may be held.
const HOLD_PERIODS_MAX: u64 = 100;

const ROOT_KEYS: &[&str] = &[
    "name",
    "description",
    "duration_s",
    "period_s",
    "seed",
    "record_hz",
    "hung_after_s",
    "published_velocity",
    "realtime",
    "avoidance",
    "silence",
    "robot_defaults",
    "robot",
    "edge",
    "graph",
    "fault",
    "chaos",
    "expect",
    "trajectory",
    "scale",
];

/// Reads a scenario with the command line's changes.
///
/// Gives the scenario, the text that it was read from (the file's, with the changes applied: a
/// scenario file that can be run again), and what is worth a warning.
pub fn read(
    path: &Path,
    overrides: &Overrides,
    catalog: &Catalog,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    let expected = "expected a scenario file, such as scenarios/triangle.toml";
    let text = load(path, expected).map_err(|trouble| trouble.about(path))?;
    read_text(path, &text, overrides, catalog)
}

/// The same for a text at hand; `path` is only shown.
pub fn read_text(
    path: &Path,
    text: &str,
    overrides: &Overrides,
    catalog: &Catalog,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    if text.trim().is_empty() {
        let expected = "expected a scenario in TOML";
        return Err(Trouble { what: "is empty".to_owned(), expected }.about(path));
    }
    // The file's own text first: its mistakes get places in the file as it is on disk.
    let mut source = Source::new(path, text, false);
    let mut text = Cow::from(text);
    if overrides.name_graph() {
        text = edited(&text, &source, |document| overrides.apply_graph(document))?.into();
        source = Source::new(path, &text, true);
    }
    let entries = toml(&text, &source)?;
    let spliced = splice(path, &text, source, entries.get_ref(), &robot_keys(&catalog.laws))?;
    let Spliced { mut text, mut source, warnings: graph_warnings } = spliced;
    if !overrides.name_at_most_a_graph() {
        text = edited(&text, &source, |document| overrides.apply(document))?;
        source = Source::new(path, &text, true);
    }
    let entries = toml(&text, &source)?;
    let document = Document { source, places: RefCell::default() };
    let root = Table::root(&document, entries.get_ref());
    let (scenario, mut warnings) = scenario(&root, catalog, &document)?;
    warnings.splice(..0, graph_warnings);

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

/// The text's tables.
fn toml<'t>(text: &'t str, source: &Source) -> Result<Spanned<DeTable<'t>>, Diagnostic> {
    DeTable::parse(text).map_err(|error| no_toml(source, error.span(), error.message()))
}

/// The text after a change that keeps its comments.
fn edited(
    text: &str,
    source: &Source,
    change: impl FnOnce(&mut DocumentMut) -> Result<(), Diagnostic>,
) -> Result<String, Diagnostic> {
    let mut document = text
        .parse::<DocumentMut>()
        .map_err(|error| no_toml(source, error.span(), error.message()))?;
    change(&mut document)?;
    Ok(document.to_string())
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
    catalog: &Catalog,
    document: &Document,
) -> Result<(Scenario, Vec<Diagnostic>), Diagnostic> {
    root.only(ROOT_KEYS)?;
    let name = root.need("name", "a short name for the experiment, such as \"triangle\"")?;
    let name_text = name.text("expected a string")?;
    if name_text.trim().is_empty() {
        return Err(name.wrong("is empty", "expected a short name, such as \"triangle\""));
    }
    if name_text.contains(is_hidden) {
        return Err(
            name.wrong(format!("is \"{name_text}\""), "expected a name without control characters")
        );
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
    let hung_after_ns = match root.get("hung_after_s") {
        Some(hung_after) => match hung_after.duration_ns()? {
            ns if ns < HUNG_AFTER_NS_MIN => {
                let (found, least) = (seconds(ns), seconds(HUNG_AFTER_NS_MIN));
                let expected = format!("expected at least {least}: every robot waits now and then");
                return Err(hung_after.wrong(format!("is {found}"), expected));
            }
            ns => ns,
        },
        None => HUNG_AFTER_NS,
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
        .table(&avoidance_keys(&catalog.methods))?;
    let (method, avoidance) = avoidance(&avoidance_table, &catalog.methods)?;
    let silence = silence(root, period_ns)?;
    let Robots { robots, ties, warnings } = robots(root, &catalog.laws, document)?;
    let graph = graph(root, &robots, &ties)?;
    let lead = lead(root, &robots)?;
    let faults = faults(root, &Scene { robots: &robots, graph: &graph, duration_ns, seed })?;
    let expect = expect(root, duration_ns)?;
    let mut scenario = Scenario {
        name: name_text.to_owned(),
        duration_ns,
        period_ns,
        plant_tick_ns,
        latency_allowed_ns,
        hold_periods,
        hung_after_ns,
        seed,
        record_hz,
        published_velocity,
        method,
        avoidance,
        silence,
        robots,
        graph,
        lead,
        faults,
        expect,
    };
    let noise_m = noise_bound_m(scenario.robots.len(), &scenario.faults);
    let avoidance = &mut scenario.avoidance;
    avoidance.sensing_error_m = avoidance.sensing_error_m.max(noise_m);
    scenario.avoidance.sensing_radius_m = match avoidance_table.get("sensing_radius_m") {
        Some(radius) => radius.positive("m")?,
        None => scenario.sensing_radius_needed_m(),
    };
    Ok((scenario, warnings))
}

/// By how much a distance that some robot senses may be off, m: noise in its own position and in
/// those of others adds up.
fn noise_bound_m(robots: usize, faults: &[Fault]) -> f64 {
    let mut bounds_m = vec![0.0; robots];
    for fault in faults {
        if let FaultKind::Sensor { robot, kind: SensorFaultKind::Noise { bound_m }, .. } =
            fault.kind
        {
            bounds_m[robot] += bound_m;
        }
    }
    bounds_m.into_iter().fold(0.0, f64::max)
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

/// What may be said in `[avoidance]`, whatever the method: a scenario may hold what another one
/// needs.
fn avoidance_keys(methods: &[AvoidanceDescription]) -> Vec<&'static str> {
    let common = ["kind", "distance_min_m", "speed_max_m_s", "sensing_radius_m", "sensing_error_m"];
    let own = methods.iter().flat_map(|method| method.gains.iter().map(|gain| gain.key));
    common.into_iter().chain(own).collect()
}

/// `[avoidance]`; the sensing radius is filled in later, from the whole scenario.
fn avoidance(
    table: &Table<'_>,
    methods: &[AvoidanceDescription],
) -> Result<(AvoidanceDescription, AvoidanceBrief), Diagnostic> {
    let kinds: Vec<_> = methods.iter().map(|method| (method.name, *method)).collect();
    let default = methods[0];
    let method = table.get("kind").map_or(Ok(default), |kind| kind.word(&kinds))?;
    let distance_min_m = table
        .need("distance_min_m", "no two front points may be nearer than this, in meters")?
        .positive("m")?;
    let speed_max_m_s = match table.get("speed_max_m_s") {
        Some(speed) => speed.positive("m/s")?,
        None if method.clamps_speed => {
            let expected = format!("the {} needs a speed limit, in m/s", method.name);
            return Err(table.missing("speed_max_m_s", &expected));
        }
        None => f64::INFINITY,
    };
    let mut gains = BTreeMap::new();
    for gain in methods.iter().flat_map(|method| method.gains) {
        if let Some(value) = table.get(gain.key) {
            gains.insert(gain.key.to_owned(), value.positive(unit_of(gain.key))?);
        }
    }
    if let Some(gain) = method.gains.iter().find(|gain| !gains.contains_key(gain.key)) {
        return Err(table.missing(gain.key, gain.meaning));
    }
    let sensing_error_m =
        table.get("sensing_error_m").map_or(Ok(0.0), |error| error.not_negative("m"))?;
    let avoidance = AvoidanceBrief {
        kind: method.name.to_owned(),
        distance_min_m,
        speed_max_m_s,
        sensing_radius_m: 0.0,
        sensing_error_m,
        gains,
    };
    Ok((method, avoidance))
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
