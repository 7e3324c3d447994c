//! Parser of scenario files: top-level keys, and tables that do not describe robots.
//!
//! `keys` defines the keys and their ranges. Conditions on several values are checked in [`crate::check`]. No process
//! is started.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use formation::rewiring::RepairPlan;
use protocol::avoidance::{AvoidanceDescription, Gain};
use protocol::brief::{AvoidanceBrief, SilenceBrief};
use protocol::catalog::Catalog;
use protocol::fault::SensorFaultKind;
use protocol::law::LawDescription;
use protocol::terminal_escape::is_hidden;
use toml::Spanned;
use toml::de::DeTable;
use toml_edit::DocumentMut;

pub use super::overrides::Overrides;

use super::diagnostic::{Diagnostic, Severity, SourceText};
use super::expect::parse_expectations;
use super::faults::{FaultContext, parse_faults};
use super::fields::kinds;
use super::file::{FileError, load_text};
use super::graph::parse_graph;
use super::hunt::parse_hunt;
use super::import::splice::{SplicedText, splice_graph};
use super::keys::{self, FORMAT_VERSION, FileFormat, RealtimeSettings, Settings};
use super::laws;
use super::lead::parse_trajectory;
use super::metrics::{self, parse_metrics};
use super::program::ExternalProgram;
use super::robots::{DefaultRobotParameters, ParsedRobots, parse_robots};
use super::scale::parse_scale;
use super::spares::parse_repair;
use super::table::{Document, KeySpans, TableReader, TypedValue};
use super::team;
use super::walls::parse_walls;
use super::{Fault, FaultKind, Robot, Scenario, ns_to_seconds};
use crate::check;

/// Maximum number of ticks of a run (a day at 1 kHz).
const TICKS_MAX: u64 = 100_000_000;

/// Maximum number of samples of all robots in a second of run time that are recorded by default.
pub const RECORDED_SAMPLES_PER_S_MAX: f64 = 12_800.0;

/// Maximum number of odometry samples that the plant sends by default to all robots in a second of real time.
const ODOMETRY_SAMPLES_PER_S_MAX: u64 = 128_000;

/// Minimum of `hung_after_s`, ns.
const HUNG_AFTER_NS_MIN: u64 = 100_000_000;
/// Minimum and maximum of `ready_after_s`, ns. The plant and the other robots wait for a robot up to the maximum.
const READY_AFTER_NS_RANGE: [u64; 2] = [100_000_000, 3_600_000_000_000];

/// A parsed scenario, its effective text and its warnings, or the first error. The effective text is that of the file
/// with the overrides applied; it is a scenario file that can be run again.
pub type ReadResult = Result<(Scenario, String, Vec<Diagnostic>), Diagnostic>;

/// Reads and checks a scenario file with the overrides applied.
pub fn read(path: &Path, overrides: &Overrides, catalog: &Catalog) -> ReadResult {
    read_file(path, overrides, catalog, None)
}

/// Reads and checks a scenario that is to be run. The programs that it names must exist.
pub fn read_for_run(path: &Path, overrides: &Overrides, catalog: &Catalog) -> ReadResult {
    read_file(path, overrides, catalog, Some(scenario_folder(path)))
}

/// Returns the folder of a scenario file, which contains its programs.
pub fn scenario_folder(path: &Path) -> &Path {
    path.parent().unwrap_or(Path::new(""))
}

/// Parses and checks the text of a scenario. `path` is only used in messages.
pub fn read_text(path: &Path, text: &str, overrides: &Overrides, catalog: &Catalog) -> ReadResult {
    parse_scenario_text(path, text, overrides, catalog, None)
}

fn read_file(
    path: &Path,
    overrides: &Overrides,
    catalog: &Catalog,
    program_folder: Option<&Path>,
) -> ReadResult {
    let expected = "expected a scenario file, such as scenarios/triangle.toml";
    let text = load_text(path, expected).map_err(|error| error.into_diagnostic(path))?;
    parse_scenario_text(path, &text, overrides, catalog, program_folder)
}

/// Parses and checks a text. `program_folder` is the folder that must contain the files of programs; `None`: not
/// checked.
fn parse_scenario_text(
    path: &Path,
    text: &str,
    overrides: &Overrides,
    catalog: &Catalog,
    program_folder: Option<&Path>,
) -> ReadResult {
    if text.trim().is_empty() {
        let expected = "expected a scenario in TOML";
        return Err(
            FileError { problem: "is empty".to_owned(), remedy: expected }.into_diagnostic(path)
        );
    }
    // The text of the file is parsed before overrides are applied, so that its errors have their locations on disk.
    let mut source = SourceText::new(path, text, false);
    let mut text = Cow::from(text);
    if overrides.sets_graph() {
        text = apply_edit(&text, &source, |document| overrides.apply_graph(document))?.into();
        source = SourceText::new(path, &text, true);
    }
    let entries = parse_toml(&text, &source)?;
    let format =
        FileFormat::new(&laws::add_external_laws(catalog, &source, entries.get_ref(), None)?);
    let spliced = splice_graph(path, &text, source, entries.get_ref(), &format)?;
    let SplicedText { mut text, mut source, warnings: graph_warnings } = spliced;
    if !overrides.sets_only_graph() {
        text = apply_edit(&text, &source, |document| overrides.apply(document))?;
        source = SourceText::new(path, &text, true);
    }
    let entries = parse_toml(&text, &source)?;
    let catalog = laws::add_external_laws(catalog, &source, entries.get_ref(), program_folder)?;
    let format = FileFormat::new(&catalog);
    let document = Document::new(source, &format);
    let root = TableReader::root(&document, entries.get_ref(), "the scenario");
    let (scenario, mut warnings) = parse_scenario(&root, &catalog, &document)?;
    if let Some(folder) = program_folder {
        if let Some(plant) = root.get(keys::Root::plant) {
            ExternalProgram::check_files_exist(&plant.table()?, folder)?;
        }
        metrics::check_files_exist(&root, folder)?;
    }
    warnings.splice(..0, graph_warnings.into_iter().chain(document.warnings.take()));

    let locations = document.key_locations.borrow();
    for finding in check::check_scenario(&scenario) {
        let location = find_span(&locations, &finding.path);
        let diagnostic = document.source.error_at(&location, finding.message, finding.expected);
        match finding.severity {
            Severity::Error => return Err(diagnostic),
            Severity::Warning => warnings.push(diagnostic.into_warning()),
        }
    }
    drop(locations);
    Ok((scenario, text, warnings))
}

/// Returns the laws in external programs that the scenario file at `path` declares, with the others known by `catalog`;
/// none if the file has a mistake, which its reader reports.
pub(crate) fn external_laws(path: &Path, catalog: &Catalog) -> Vec<LawDescription> {
    let Ok(text) = load_text(path, "expected a scenario file") else { return Vec::new() };
    let source = SourceText::new(path, &text, false);
    let Ok(entries) = parse_toml(&text, &source) else { return Vec::new() };
    let known = laws::add_external_laws(catalog, &source, entries.get_ref(), None);
    known.map_or_else(|_| Vec::new(), |known| known.laws[catalog.laws.len()..].to_vec())
}

/// Parses TOML.
pub fn parse_toml<'t>(
    text: &'t str,
    source: &SourceText,
) -> Result<Spanned<DeTable<'t>>, Diagnostic> {
    DeTable::parse(text).map_err(|error| toml_syntax_error(source, error.span(), error.message()))
}

/// Returns the text after a change. Comments are kept.
fn apply_edit(
    text: &str,
    source: &SourceText,
    change: impl FnOnce(&mut DocumentMut) -> Result<(), Diagnostic>,
) -> Result<String, Diagnostic> {
    let mut document = text
        .parse::<DocumentMut>()
        .map_err(|error| toml_syntax_error(source, error.span(), error.message()))?;
    change(&mut document)?;
    Ok(document.to_string())
}

/// Returns the source range of `path`, or of the nearest enclosing table in the text.
fn find_span(locations: &KeySpans, path: &str) -> Range<usize> {
    let mut path = path;
    loop {
        if let Some(span) = locations.get(path) {
            return span.clone();
        }
        match path.rsplit_once('.') {
            Some((parent, _)) => path = parent,
            None => return 0..0,
        }
    }
}

/// Returns the diagnostic of a TOML syntax error.
fn toml_syntax_error(source: &SourceText, span: Option<Range<usize>>, message: &str) -> Diagnostic {
    let message = message.lines().collect::<Vec<_>>().join(", ");
    let (problem, expected) = match message.split_once(", expected ") {
        Some((problem, "nothing")) => (problem, "expected nothing more here".to_owned()),
        Some((problem, expected)) => (problem, format!("expected {expected}")),
        None if message.contains("duplicate key") => {
            (message.as_str(), "expected every key once in its table".to_owned())
        }
        None => (message.as_str(), "expected TOML here".to_owned()),
    };
    source.error_at(&span.unwrap_or(0..0), format!("this is not TOML: {problem}"), expected)
}

/// Lowers the recording rate and increases the simulation step for many robots, unless the file sets them.
fn lower_default_rates(
    root: &TableReader<'_, keys::Root>,
    robot_count: usize,
    settings: &mut Settings,
    realtime: &mut RealtimeSettings,
) -> Result<(), Diagnostic> {
    if root.get(keys::Root::record_hz).is_none() {
        settings.record_hz =
            settings.record_hz.min(RECORDED_SAMPLES_PER_S_MAX / robot_count as f64);
    }
    if root.table(keys::Root::realtime)?.get(keys::Realtime::plant_tick_s).is_none() {
        let tick_ns = robot_count as u64 * 1_000_000_000 / ODOMETRY_SAMPLES_PER_S_MAX;
        realtime.plant_tick_ns = realtime.plant_tick_ns.max(tick_ns.min(settings.period_ns));
    }
    Ok(())
}

/// Parses the whole scenario.
fn parse_scenario(
    root: &TableReader<'_, keys::Root>,
    catalog: &Catalog,
    document: &Document<'_>,
) -> Result<(Scenario, Vec<Diagnostic>), Diagnostic> {
    // Checked first, because another version of the format has other keys.
    if let Some(format) = root.get(keys::Root::format).filter(|format| format.integer().is_err()) {
        let expected =
            format!("expected {FORMAT_VERSION}, or a version of phalanx that supports this format");
        return Err(format.error_about_key("is not supported by this version of phalanx", expected));
    }
    root.check_keys()?;
    let name = parse_name(root)?;
    let mut settings = read_settings(root)?;
    let Settings { duration_ns, period_ns, seed, .. } = settings;
    let avoidance_table = root.required_value(keys::Root::avoidance)?.table()?;
    let method = parse_method(&avoidance_table, &catalog.methods)?;
    let speed_max_m_s = parse_speed_max_m_s(&avoidance_table, &method)?;
    let mut realtime = RealtimeSettings::read(&root.table(keys::Root::realtime)?)?;
    let defaults = DefaultRobotParameters {
        keep_m: 0.5 * avoidance_table.number(keys::Avoidance::distance_min_m)?,
        speed_max_m_s,
        hold_periods: realtime.hold_periods,
    };
    let ParsedRobots { robots, neighbor_keys, mut warnings } =
        parse_robots(root, &catalog.laws, defaults, document)?;
    lower_default_rates(root, robots.len(), &mut settings, &mut realtime)?;
    check_recorded_messages(root, &settings, &robots)?;
    let (graph, disk, edge_params) = parse_graph(root, &robots, &neighbor_keys)?;
    let lead = parse_trajectory(root, &robots)?;
    let walls = parse_walls(root)?;
    let faults =
        parse_faults(root, &FaultContext { robots: &robots, graph: &graph, duration_ns, seed })?;
    let keep_m_max = robots.iter().map(|robot| robot.keep_m).fold(0.0, f64::max);
    let clearance_m =
        parse_clearance_m(&avoidance_table, walls.is_empty(), keep_m_max, &mut warnings)?;
    let avoidance = AvoidanceBrief {
        clearance_m,
        ..parse_avoidance(&avoidance_table, (&method, &catalog.methods), &robots, &faults)?
    };
    let metrics = parse_metrics(root, &robots)?;
    let mut scenario = Scenario {
        name,
        settings,
        realtime,
        classes_sensed: avoidance_table.boolean(keys::Avoidance::classes_sensed)?,
        avoidance_method: method,
        silence: parse_silence(root, period_ns)?,
        laws: laws::parse_laws(root)?,
        plant_program: root
            .get(keys::Root::plant)
            .map(|plant| ExternalProgram::read(&plant.table()?))
            .transpose()?,
        expectations: parse_expectations(root, &robots, &walls, &metrics, duration_ns)?,
        metrics,
        hunt_bounds: parse_hunt(root, &robots, [duration_ns, period_ns], avoidance.distance_min_m)?,
        avoidance,
        robots,
        graph,
        disk_graph: disk,
        edge_params,
        repair_plan: RepairPlan::default(),
        repair_after_ns: None,
        lead,
        leaderless_scale: None,
        walls,
        faults,
    };
    if avoidance_table.get(keys::Avoidance::sensing_radius_m).is_none() {
        scenario.avoidance.sensing_radius_m = scenario.sensing_radius_useful_m();
    }
    let law_radii_m = scenario.used_program_laws().filter_map(|law| law.sensing_radius_m);
    let radius_m = law_radii_m.fold(scenario.avoidance.sensing_radius_m, f64::max);
    scenario.avoidance.sensing_radius_m = radius_m;
    let scale = parse_scale(root, &scenario)?;
    let scenario = scenario.with_scale(scale);
    let (repair_plan, repair_after_ns) =
        parse_repair(root, &scenario, &neighbor_keys, &mut warnings)?;
    let scenario = Scenario { repair_plan, repair_after_ns, ..scenario };
    if let Some(end_after) = root.get(keys::Root::end_after_converged_s) {
        check_can_end_early(&scenario, &end_after)?;
    }
    Ok((scenario, warnings))
}

/// Parses the name. The description is checked but not used.
fn parse_name(root: &TableReader<'_, keys::Root>) -> Result<String, Diagnostic> {
    let name = root.required_value(keys::Root::name)?;
    let text = name.text("expected a string")?;
    if text.trim().is_empty() {
        return Err(name.error_about_key("is empty", "expected a short name, such as \"triangle\""));
    }
    if text.contains(is_hidden) {
        let expected = "expected a name without control characters";
        return Err(name.error_about_key(format!("is \"{text}\""), expected));
    }
    root.get(keys::Root::description)
        .map(|description| description.text("expected a string"))
        .transpose()?;
    Ok(text.to_owned())
}

/// Returns the settings that a text has, with the defaults of the other keys, for examples.
///
/// # Panics
///
/// If a key is missing or wrong.
pub(crate) fn parse_settings(text: &str) -> Settings {
    let format = FileFormat::new(&Catalog { laws: Vec::new(), methods: Vec::new() });
    let document = Document::new(SourceText::new(Path::new("example"), text, false), &format);
    let entries = DeTable::parse(text).expect("an example is TOML");
    let root = TableReader::root(&document, entries.get_ref(), "the example");
    Settings::read::<keys::Root>(&root).expect("an example has all needed keys")
}

/// Parses the settings of the run. Checks the number of ticks and the ranges of the timeouts.
fn read_settings(root: &TableReader<'_, keys::Root>) -> Result<Settings, Diagnostic> {
    let settings = Settings::read(root)?;
    check_tick_count(root, &settings)?;
    check_hung_after(root, &settings)?;
    check_ready_after(root, &settings)?;
    Ok(settings)
}

/// Checks that some law sends messages if they are to be recorded.
fn check_recorded_messages(
    root: &TableReader<'_, keys::Root>,
    settings: &Settings,
    robots: &[Robot],
) -> Result<(), Diagnostic> {
    if !settings.record_messages || robots.iter().any(|robot| robot.message_format.is_some()) {
        return Ok(());
    }
    Err(root.required_value(keys::Root::record_messages)?.error_about_key(
        "is true, but no law of the robots sends messages",
        "expected a robot whose law has `message` or `message_bytes_max`, or no key `record_messages`",
    ))
}

/// Checks that the number of ticks is between 1 and [`TICKS_MAX`].
fn check_tick_count(
    root: &TableReader<'_, keys::Root>,
    settings: &Settings,
) -> Result<(), Diagnostic> {
    let (duration, period) =
        (root.required_value(keys::Root::duration_s)?, root.required_value(keys::Root::period_s)?);
    let &Settings { duration_ns, period_ns, .. } = settings;
    let (duration_s, period_s) = (ns_to_seconds(duration_ns), ns_to_seconds(period_ns));
    let ticks = duration_ns / period_ns;
    if ticks == 0 {
        return Err(duration.error_about_key(
            format!("is {duration_s}, shorter than one period"),
            format!("expected at least `period_s`, {period_s} s"),
        ));
    }
    if ticks > TICKS_MAX {
        return Err(period.error_about_key(
            format!("is {period_s}: {ticks} ticks in {duration_s} s"),
            format!("expected at most {TICKS_MAX} ticks: a longer period or a shorter run"),
        ));
    }
    Ok(())
}

fn check_hung_after(
    root: &TableReader<'_, keys::Root>,
    settings: &Settings,
) -> Result<(), Diagnostic> {
    let hung_after_ns = settings.hung_after_ns;
    if hung_after_ns < HUNG_AFTER_NS_MIN {
        let (found, minimum) = (ns_to_seconds(hung_after_ns), ns_to_seconds(HUNG_AFTER_NS_MIN));
        let expected =
            format!("expected at least {minimum} s: any process may be delayed for a short time");
        let hung_timeout = root.required_value(keys::Root::hung_after_s)?;
        return Err(hung_timeout.error_about_key(format!("is {found}"), expected));
    }
    Ok(())
}

fn check_ready_after(
    root: &TableReader<'_, keys::Root>,
    settings: &Settings,
) -> Result<(), Diagnostic> {
    let ready_after_ns = settings.ready_after_ns;
    let [minimum, maximum] = READY_AFTER_NS_RANGE.map(ns_to_seconds);
    match (READY_AFTER_NS_RANGE[0]..=READY_AFTER_NS_RANGE[1]).contains(&ready_after_ns) {
        true => Ok(()),
        false => Err(root.required_value(keys::Root::ready_after_s)?.error_about_key(
            format!("is {}", ns_to_seconds(ready_after_ns)),
            format!("expected {minimum} to {maximum} s: the time that a program takes to import what it needs, and some more"),
        )),
    }
}

/// Returns an error if `end_after_converged_s` could never end the run, or would end it at once.
fn check_can_end_early(
    scenario: &Scenario,
    key: &TypedValue<'_, kinds::Time>,
) -> Result<(), Diagnostic> {
    let has_in_neighbor = |i| scenario.graph.incoming_edges(i).next().is_some();
    let has_error =
        |(i, robot): (usize, &Robot)| robot.role.reference.is_local() || has_in_neighbor(i);
    if !scenario.robots.iter().enumerate().any(has_error) {
        return Err(key.error_about_key(
            "is given, but no robot has an error, because none leads, has a goal, or hears another",
            "expected an edge, a leader or goals, or no such key",
        ));
    }
    if scenario.plan_end_ns().is_none() {
        return Err(key.error_about_key(
            "is given, but the plan has no end: the leader never comes to rest, or the scale oscillates",
            "expected a trajectory that ends and a scale that becomes constant, or no such key",
        ));
    }
    Ok(())
}

/// Returns the maximum error of a position, m, and of a heading, rad, that noise faults cause. Simultaneous noise in a
/// robot's own position and in those of others adds up.
fn noise_bounds(robot_count: usize, faults: &[Fault]) -> [f64; 2] {
    let mut bounds = vec![[0.0; 2]; robot_count];
    for fault in faults {
        if let FaultKind::Sensor { robot, kind, .. } = fault.kind
            && let SensorFaultKind::Noise { bound_m, heading_bound_rad } = kind
        {
            bounds[robot][0] += bound_m;
            bounds[robot][1] += heading_bound_rad;
        }
    }
    let largest = |[m, rad]: [f64; 2], other: [f64; 2]| [m.max(other[0]), rad.max(other[1])];
    bounds.into_iter().fold([0.0; 2], largest)
}

/// Parses the avoidance method.
fn parse_method(
    table: &TableReader<'_, keys::Avoidance>,
    methods: &[AvoidanceDescription],
) -> Result<AvoidanceDescription, Diagnostic> {
    let kinds: Vec<_> = methods.iter().map(|method| (method.name, *method)).collect();
    table.get(keys::Avoidance::kind).map_or(Ok(methods[0]), |kind| kind.parse_word(&kinds))
}

/// Parses v_max, m/s. Infinite if it is not given and the method needs none.
fn parse_speed_max_m_s(
    table: &TableReader<'_, keys::Avoidance>,
    method: &AvoidanceDescription,
) -> Result<f64, Diagnostic> {
    match table.optional_number(keys::Avoidance::speed_max_m_s)? {
        Some(speed_max_m_s) => Ok(speed_max_m_s),
        None if method.clamps_speed => {
            let expected = format!("the {} needs a speed limit, in m/s", method.name);
            Err(table.missing_key_error(keys::Avoidance::speed_max_m_s, &expected))
        }
        None => Ok(f64::INFINITY),
    }
}

/// Parses the gains, also those of other methods. The gains of the method must be given.
fn parse_gains(
    table: &TableReader<'_, keys::Avoidance>,
    method: &AvoidanceDescription,
    methods: &[AvoidanceDescription],
) -> Result<BTreeMap<String, f64>, Diagnostic> {
    let mut gains = BTreeMap::new();
    for gain in methods.iter().flat_map(|method| method.gains) {
        if let Some(value) = table.gain(gain.key, None)? {
            gains.insert(gain.key.to_owned(), value);
        }
    }
    let lacks = |gain: &&Gain| !gains.contains_key(gain.key);
    match method.gains.iter().find(lacks) {
        Some(gain) => Err(table.missing_gain_error(gain.key, gain.meaning)),
        None => Ok(gains),
    }
}

/// Parses the parameters of the avoidance method, except the clearance: the largest distance and speed limit of the
/// robots. Without its key, the sensing radius is infinite, because it depends on the whole scenario.
fn parse_avoidance(
    table: &TableReader<'_, keys::Avoidance>,
    (method, methods): (&AvoidanceDescription, &[AvoidanceDescription]),
    robots: &[Robot],
    faults: &[Fault],
) -> Result<AvoidanceBrief, Diagnostic> {
    let (distance_min_m, speed_max_m_s) = team::largest_distance_and_speed(robots);
    let sensing_radius_m = table.optional_number(keys::Avoidance::sensing_radius_m)?;
    let [noise_m, noise_rad] = noise_bounds(robots.len(), faults);
    let error = |key| table.optional_number(key).map(|bound| bound.unwrap_or(0.0));
    let braking_times_s = robots.iter().filter_map(|robot| robot.acceleration_limits);
    Ok(AvoidanceBrief {
        kind: method.name.to_owned(),
        distance_min_m,
        speed_max_m_s,
        sensing_radius_m: sensing_radius_m.unwrap_or(f64::INFINITY),
        sensing_error_m: error(keys::Avoidance::sensing_error_m)?.max(noise_m),
        heading_error_rad: error(keys::Avoidance::heading_error_rad)?.max(noise_rad),
        braking_time_max_s: braking_times_s.map(|limits| limits.braking_time_s).fold(0.0, f64::max),
        clearance_m: 0.0,
        command_timeout_max_s: 0.0,
        classes: Vec::new(),
        gains: parse_gains(table, method, methods)?,
    })
}

/// Parses the minimum distance from walls, m: by default the largest size of a robot. 0 without walls.
fn parse_clearance_m(
    table: &TableReader<'_, keys::Avoidance>,
    no_walls: bool,
    keep_m_max: f64,
    warnings: &mut Vec<Diagnostic>,
) -> Result<f64, Diagnostic> {
    let clearance = table.get(keys::Avoidance::clearance_m);
    if !no_walls {
        let given = clearance.map(|clearance| clearance.number()).transpose()?;
        return Ok(given.unwrap_or(keep_m_max));
    }
    if let Some(clearance) = clearance {
        let warning = clearance.error_about_key(
            "has no effect: there is no wall",
            "expected a `[[wall]]` or an `[[obstacle]]`, or no such key",
        );
        warnings.push(warning.into_warning());
    }
    Ok(0.0)
}

/// Parses `[silence]`.
fn parse_silence(
    root: &TableReader<'_, keys::Root>,
    period_ns: u64,
) -> Result<SilenceBrief, Diagnostic> {
    let table = root.table(keys::Root::silence)?;
    let (stale, lost) =
        (table.get(keys::Silence::stale_after_s), table.get(keys::Silence::lost_after_s));
    let stale_after_ns =
        table.optional_time_ns(keys::Silence::stale_after_s)?.unwrap_or(3 * period_ns);
    let lost_after_ns = table.optional_time_ns(keys::Silence::lost_after_s)?;
    let lost_after_ns = lost_after_ns.unwrap_or((20 * period_ns).max(100_000_000));
    if lost_after_ns < stale_after_ns {
        let (stale_s, lost_s) = (ns_to_seconds(stale_after_ns), ns_to_seconds(lost_after_ns));
        return Err(match (&lost, &stale) {
            (Some(lost), _) => lost.error_about_key(
                format!("is {lost_s}: a neighbor would be lost before it is stale"),
                format!("expected at least `stale_after_s`, {stale_s} s"),
            ),
            (None, Some(stale)) => stale.error_about_key(
                format!("is {stale_s}: a neighbor would be lost before it is stale"),
                format!("expected at most `lost_after_s`, {lost_s} s"),
            ),
            (None, None) => unreachable!("3 T <= 20 T"),
        });
    }
    Ok(SilenceBrief {
        stale_after_ns,
        lost_after_ns,
        policy: table.read_word(keys::Silence::policy)?,
    })
}
