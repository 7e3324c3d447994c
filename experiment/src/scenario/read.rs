//! From a file's text to a [`Scenario`]: the whole of it, and its tables without robots in them.
//!
//! Which keys there are, and what each may be, stands in `keys`. What the values mean together is
//! asked in [`crate::check`]. Nothing is spawned.

use std::borrow::Cow;
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
use super::keys::{FORMAT, Format};
use super::laws;
use super::lead::lead;
use super::program::Program;
use super::robots::{Robots, robots};
use super::scale::scale;
use super::table::{Document, Places, Table, Value};
use super::walls::walls;
use super::{Fault, FaultKind, Scenario, seconds};
use crate::check;

/// Most ticks in one run: a day at 1 kHz.
const TICKS_MAX: u64 = 100_000_000;

/// The least time without an answer that may be allowed for, ns.
const HUNG_AFTER_NS_MIN: u64 = 100_000_000;

/// Reads a scenario with the command line's changes.
///
/// Gives the scenario, the text that it was read from (the file's, with the changes applied: a
/// scenario file that can be run again), and what is worth a warning.
pub fn read(
    path: &Path,
    overrides: &Overrides,
    catalog: &Catalog,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    read_for(path, overrides, catalog, For::Reading)
}

/// The same for one that is to be run: the programs that it names must be there.
pub fn read_to_run(
    path: &Path,
    overrides: &Overrides,
    catalog: &Catalog,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    read_for(path, overrides, catalog, For::Running)
}

/// The folder of a scenario's file, in which its programs are.
pub fn folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// The same for a text at hand; `path` is only shown.
pub fn read_text(
    path: &Path,
    text: &str,
    overrides: &Overrides,
    catalog: &Catalog,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    read_text_for(path, text, overrides, catalog, For::Reading)
}

/// What a scenario is read for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum For {
    Reading,
    Running,
}

fn read_for(
    path: &Path,
    overrides: &Overrides,
    catalog: &Catalog,
    purpose: For,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    let expected = "expected a scenario file, such as scenarios/triangle.toml";
    let text = load(path, expected).map_err(|trouble| trouble.about(path))?;
    read_text_for(path, &text, overrides, catalog, purpose)
}

fn read_text_for(
    path: &Path,
    text: &str,
    overrides: &Overrides,
    catalog: &Catalog,
    purpose: For,
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
    let format = Format::of(&laws::known(catalog, &source, entries.get_ref(), None)?);
    let spliced = splice(path, &text, source, entries.get_ref(), &format)?;
    let Spliced { mut text, mut source, warnings: graph_warnings } = spliced;
    if !overrides.name_at_most_a_graph() {
        text = edited(&text, &source, |document| overrides.apply(document))?;
        source = Source::new(path, &text, true);
    }
    let entries = toml(&text, &source)?;
    let files_in = (purpose == For::Running).then(|| folder(path));
    let catalog = laws::known(catalog, &source, entries.get_ref(), files_in)?;
    let format = Format::of(&catalog);
    let document = Document::new(source, &format);
    let root = Table::root(&document, entries.get_ref());
    let (scenario, mut warnings) = scenario(&root, &catalog, &document)?;
    if let (Some(folder), Some(plant)) = (files_in, root.get("plant")) {
        Program::must_be_there(&plant.table()?, folder)?;
    }
    warnings.splice(..0, graph_warnings.into_iter().chain(document.warnings.take()));

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
pub fn toml<'t>(text: &'t str, source: &Source) -> Result<Spanned<DeTable<'t>>, Diagnostic> {
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
    document: &Document<'_>,
) -> Result<(Scenario, Vec<Diagnostic>), Diagnostic> {
    // Before anything else: another format has other keys.
    if let Some(format) = root.get("format").filter(|format| format.whole().is_err()) {
        let expected = format!("expected {FORMAT}, or a phalanx that reads that format");
        return Err(format.wrong("is none that this phalanx reads", expected));
    }
    root.only()?;
    let name = root.need("name")?;
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
    let duration = root.need("duration_s")?;
    let duration_ns = duration.time_ns()?;
    let period = root.need("period_s")?;
    let period_ns = period.time_ns()?;
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
    let seed = root.whole("seed")?;
    let record_hz = root.number("record_hz")?;
    let hung_after_ns = root.time_ns("hung_after_s")?;
    if hung_after_ns < HUNG_AFTER_NS_MIN {
        let (found, least) = (seconds(hung_after_ns), seconds(HUNG_AFTER_NS_MIN));
        let expected = format!("expected at least {least}: every robot waits now and then");
        return Err(root.need("hung_after_s")?.wrong(format!("is {found}"), expected));
    }
    let velocities = [
        ("gamma", PublishedVelocity::Gamma),
        ("gamma+beta", PublishedVelocity::GammaAndBeta),
        ("differenced", PublishedVelocity::Differenced),
    ];
    let published_velocity = root.word("published_velocity", &velocities)?;
    let realtime = root.table("realtime")?;
    let plant_tick_ns = realtime.time_ns("plant_tick_s")?;
    let latency_allowed_ns = realtime.time_ns("latency_allowed_s")?;
    let between_hosts_ns = realtime.time_ns("between_hosts_s")?;
    let hold_periods = realtime.whole("hold_periods")? as u32;
    let control_timer = realtime.truth("control_timer")?;
    let avoidance_table = root.need("avoidance")?.table()?;
    let (method, avoidance) = avoidance(&avoidance_table, &catalog.methods)?;
    let silence = silence(root, period_ns)?;
    let Robots { robots, ties, mut warnings } =
        robots(root, &catalog.laws, avoidance.speed_max_m_s, document)?;
    let graph = graph(root, &robots, &ties)?;
    let lead = lead(root, &robots)?;
    let walls = walls(root)?;
    let laws = laws::laws(root)?;
    let plant = root.get("plant").map(|plant| Program::read(&plant.table()?)).transpose()?;
    let faults = faults(root, &Scene { robots: &robots, graph: &graph, duration_ns, seed })?;
    let expect = expect(root, &robots, &walls, duration_ns)?;
    let end_after = root.get("end_after_converged_s");
    let end_after_converged_ns = end_after.as_ref().map(Value::time_ns).transpose()?;
    let mut scenario = Scenario {
        name: name_text.to_owned(),
        duration_ns,
        end_after_converged_ns,
        period_ns,
        plant_tick_ns,
        latency_allowed_ns,
        between_hosts_ns,
        hold_periods,
        control_timer,
        hung_after_ns,
        seed,
        record_hz,
        published_velocity,
        method,
        avoidance,
        silence,
        laws,
        plant,
        robots,
        graph,
        lead,
        unled_scale: None,
        walls,
        faults,
        expect,
    };
    let clearance = avoidance_table.get("clearance_m");
    if !scenario.walls.is_empty() {
        let half = 0.5 * scenario.avoidance.distance_min_m;
        let given = clearance.map(|clearance| clearance.number()).transpose()?;
        scenario.avoidance.clearance_m = given.unwrap_or(half);
    } else if let Some(clearance) = clearance {
        let mut warning = clearance.wrong(
            "has no effect: there is no wall",
            "expected a `[[wall]]` or an `[[obstacle]]`, or no such key",
        );
        warning.severity = Severity::Warning;
        warnings.push(warning);
    }
    let [noise_m, noise_rad] = noise_bounds(scenario.robots.len(), &scenario.faults);
    let avoidance = &mut scenario.avoidance;
    avoidance.sensing_error_m = avoidance.sensing_error_m.max(noise_m);
    avoidance.heading_error_rad = avoidance.heading_error_rad.max(noise_rad);
    let braking_times_s = scenario.robots.iter().filter_map(|robot| robot.limits);
    scenario.avoidance.braking_time_max_s =
        braking_times_s.map(|limits| limits.braking_time_s).fold(0.0, f64::max);
    scenario.avoidance.sensing_radius_m = match avoidance_table.maybe_number("sensing_radius_m")? {
        Some(radius_m) => radius_m,
        None => scenario.sensing_radius_needed_m(),
    };
    let scale = scale(root, &scenario)?;
    match (&mut scenario.lead, scale) {
        (Some(lead), Some(scale)) => lead.scale = scale,
        (_, scale) => scenario.unled_scale = scale,
    }
    if let Some(end_after) = end_after {
        can_end_early(&scenario, &end_after)?;
    }
    Ok((scenario, warnings))
}

/// Refuses a key by which a run could never end, or would end at once.
fn can_end_early(scenario: &Scenario, key: &Value<'_>) -> Result<(), Diagnostic> {
    let hears = |i| scenario.graph.heard_by(i).next().is_some();
    let is_judged =
        |(i, robot): (usize, &super::Robot)| robot.role.reference.is_its_own() || hears(i);
    if !scenario.robots.iter().enumerate().any(is_judged) {
        return Err(key.wrong(
            "is given, but no robot has an error: nobody leads, has a goal, or hears another",
            "expected an edge, a leader or goals, or no such key",
        ));
    }
    if scenario.plan_over_ns().is_none() {
        return Err(key.wrong(
            "is given, but the plan has no end: the leader never comes to rest, or the scale swings",
            "expected a trajectory that ends and a scale that stays, or no such key",
        ));
    }
    Ok(())
}

/// By how much some robot may be wrong about a position, m, where noise in its own and in those of
/// others adds up, and about its heading, rad.
fn noise_bounds(robots: usize, faults: &[Fault]) -> [f64; 2] {
    let mut bounds = vec![[0.0; 2]; robots];
    for fault in faults {
        if let FaultKind::Sensor { robot, kind, .. } = fault.kind
            && let SensorFaultKind::Noise { bound_m, heading_bound_rad } = kind
        {
            bounds[robot][0] += bound_m;
            bounds[robot][1] += heading_bound_rad;
        }
    }
    let largest = |[m, rad]: [f64; 2], of: [f64; 2]| [m.max(of[0]), rad.max(of[1])];
    bounds.into_iter().fold([0.0; 2], largest)
}

/// `[avoidance]`; the sensing radius and the largest braking time are filled in later, from the whole
/// scenario.
fn avoidance(
    table: &Table<'_>,
    methods: &[AvoidanceDescription],
) -> Result<(AvoidanceDescription, AvoidanceBrief), Diagnostic> {
    let kinds: Vec<_> = methods.iter().map(|method| (method.name, *method)).collect();
    let default = methods[0];
    let method = table.get("kind").map_or(Ok(default), |kind| kind.word(&kinds))?;
    let distance_min_m = table.number("distance_min_m")?;
    let speed_max_m_s = match table.maybe_number("speed_max_m_s")? {
        Some(speed_max_m_s) => speed_max_m_s,
        None if method.clamps_speed => {
            let expected = format!("the {} needs a speed limit, in m/s", method.name);
            return Err(table.missing("speed_max_m_s", &expected));
        }
        None => f64::INFINITY,
    };
    let mut gains = BTreeMap::new();
    for gain in methods.iter().flat_map(|method| method.gains) {
        if let Some(value) = table.get(gain.key) {
            gains.insert(gain.key.to_owned(), value.number()?);
        }
    }
    if let Some(gain) = method.gains.iter().find(|gain| !gains.contains_key(gain.key)) {
        return Err(table.missing(gain.key, gain.meaning));
    }
    let bound = |key| table.maybe_number(key).map(|bound| bound.unwrap_or(0.0));
    let avoidance = AvoidanceBrief {
        kind: method.name.to_owned(),
        distance_min_m,
        speed_max_m_s,
        sensing_radius_m: 0.0,
        sensing_error_m: bound("sensing_error_m")?,
        heading_error_rad: bound("heading_error_rad")?,
        braking_time_max_s: 0.0,
        clearance_m: 0.0,
        gains,
    };
    Ok((method, avoidance))
}

/// `[silence]`.
fn silence(root: &Table<'_>, period_ns: u64) -> Result<SilenceBrief, Diagnostic> {
    let policies = [
        ("last", SilencePolicy::Last),
        ("ignore", SilencePolicy::Ignore),
        ("keep", SilencePolicy::Keep),
        ("stop", SilencePolicy::Stop),
    ];
    let table = root.table("silence")?;
    let (stale, lost) = (table.get("stale_after_s"), table.get("lost_after_s"));
    let time_ns = |value: &Option<Value<'_>>, otherwise_ns| {
        value.as_ref().map_or(Ok(otherwise_ns), |value| value.time_ns())
    };
    let stale_after_ns = time_ns(&stale, 3 * period_ns)?;
    let lost_after_ns = time_ns(&lost, (20 * period_ns).max(100_000_000))?;
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
    let policy = table.word("policy", &policies)?;
    Ok(SilenceBrief { stale_after_ns, lost_after_ns, policy })
}
