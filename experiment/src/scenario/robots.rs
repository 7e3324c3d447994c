//! Robots of a scenario: `[robot_defaults]` and all `[[robot]]`.

use std::collections::BTreeMap;
use std::ops::Range;

use formation::drive::{Drive, DriveKind};
use formation::pose::{Pose, wrap_angle};
use formation::ramp::Ramp;
use protocol::brief::{AccelerationLimitsBrief, WheelsBrief};
use protocol::law::{LawDescription, Reference};

use super::diagnostic::{Diagnostic, format_list, most_similar_word};
use super::fields::{HasGroup, TypedKey, kinds};
use super::keys;
use super::models::{MODELS, RobotModel};
use super::table::{Document, TableReader, TypedValue};
use super::{RestartPolicy, Robot, ns_to_seconds};

/// Maximum number of robots of a scenario. Each is a process.
const ROBOTS_MAX: usize = 1024;

/// Names of processes and table rows of a run that are no robots. A robot with such a name would share its log file.
const RESERVED_NAMES: &[&str] =
    &["awake", "bridge", "load", "machine", "plant", "reaper", "ros2", "supervisor"];

/// All robots, and the keys of each that define the graph.
pub(super) struct ParsedRobots<'t> {
    /// All robots, in the order of the file.
    pub(super) robots: Vec<Robot>,
    /// Keys of each robot that name its neighbors.
    pub(super) neighbor_keys: Vec<NeighborKeys<'t>>,
    /// Warnings about gains that no robot uses.
    pub(super) warnings: Vec<Diagnostic>,
}

/// Keys of a robot that define its neighbors, other than `[[edge]]`.
pub(super) struct NeighborKeys<'t> {
    /// Formation slot, m.
    pub(super) place_m: Option<[f64; 2]>,
    /// In-neighbors: a list of names.
    pub(super) hears: Option<TypedValue<'t, kinds::Names>>,
    /// Backup neighbors: a list of names.
    pub(super) spares: Option<TypedValue<'t, kinds::Names>>,
    /// Backup leaders: a list of names.
    pub(super) deputies: Option<TypedValue<'t, kinds::Names>>,
}

/// Parameters of robots that do not have their own values.
#[derive(Debug, Clone, Copy)]
pub(super) struct DefaultRobotParameters {
    /// Half of d, m.
    pub(super) keep_m: f64,
    /// Maximum speed of a front point, m/s.
    pub(super) speed_max_m_s: f64,
    /// Number of periods for which the plant may hold a command.
    pub(super) hold_periods: u64,
}

/// Parses all `[[robot]]` tables.
pub(super) fn parse_robots<'t>(
    root: &TableReader<'t, keys::Root>,
    laws: &[LawDescription],
    shared: DefaultRobotParameters,
    document: &Document<'_>,
) -> Result<ParsedRobots<'t>, Diagnostic> {
    let defaults = root.get(keys::Root::robot_defaults).map(|value| value.table()).transpose()?;
    let tables = root.tables(keys::Root::robot)?;
    if tables.is_empty() {
        root.required_value(keys::Root::robot)?;
        return Err(root.error_at_table(
            "the scenario has no robot",
            "expected at least one table headed `[[robot]]`, or robot = [{ ... }, ...]",
        ));
    }
    let mut robots: Vec<Robot> = Vec::new();
    let mut neighbor_keys = Vec::new();
    for table in tables {
        table.check_keys()?;
        let name = table.required_value(keys::Robot::name)?;
        let name_text = parse_robot_name(&name)?;
        if let Some(first) = robots.iter().position(|robot| robot.name == name_text) {
            return Err(name.error_about_key(
                format!("is \"{name_text}\", which is already the name of robot {}", first + 1),
                "expected a unique name",
            ));
        }
        if robots.len() == ROBOTS_MAX {
            return Err(name.error_about_key(
                format!("begins robot {}", ROBOTS_MAX + 1),
                format!("expected at most {ROBOTS_MAX} robots: each is a process"),
            ));
        }
        let table = table.with_title(&format!("robot.{name_text}"), &format!("robot {name_text}"));
        let table = table.with_defaults(defaults.clone());
        let robot = parse_robot(&table, name_text, laws, shared, document)?;
        let is_leader = |other: &&Robot| other.role.leads;
        if let (true, Some(first)) = (robot.role.leads, robots.iter().find(is_leader)) {
            return Err(name.error_about_key(
                format!("is \"{name_text}\", a second leader in addition to {}", first.name),
                "expected one main leader; the others keep slots relative to it with a formation law",
            ));
        }
        let place_m =
            table.get(keys::RobotDefaults::place_m).map(|place| place.pair()).transpose()?;
        let link_keys = [keys::Robot::hears, keys::Robot::spares, keys::Robot::deputies];
        let [hears, spares, deputies] = link_keys.map(|key| table.get(key));
        neighbor_keys.push(NeighborKeys { place_m, hears, spares, deputies });
        robots.push(robot);
    }
    let unused_gain = |(key, span): (&str, Range<usize>)| {
        let owner = laws.iter().find(|law| law.gain_keys.contains(&key))?;
        let uses_gain = |robot: &Robot| {
            laws.iter().any(|law| law.name == robot.law && law.gain_keys.contains(&key))
        };
        if robots.iter().any(uses_gain) {
            return None;
        }
        let message = format!("`{key}` has no effect: no robot follows the law \"{}\"", owner.name);
        let expected = "expected a gain of a law that is used, or none";
        Some(document.source.error_at(&span, message, expected).into_warning())
    };
    let warnings =
        defaults.iter().flat_map(|defaults| defaults.keys()).filter_map(unused_gain).collect();
    Ok(ParsedRobots { robots, neighbor_keys, warnings })
}

/// Parses one `[[robot]]` table.
fn parse_robot(
    table: &TableReader<'_, keys::Robot>,
    name: &str,
    laws: &[LawDescription],
    shared: DefaultRobotParameters,
    document: &Document<'_>,
) -> Result<Robot, Diagnostic> {
    let start = parse_pose(&table.required_value(keys::Robot::pose)?)?;
    let models: Vec<_> = MODELS.iter().map(|model| (model.name, model)).collect();
    let model =
        table.get(keys::RobotDefaults::model).map(|model| model.parse_word(&models)).transpose()?;
    let drive_kind = parse_drive_kind(table, model)?;
    let speed_max_m_s = parse_speed_max(table, model, shared.speed_max_m_s)?;
    let front_point_m = parse_front_point_m(table, drive_kind, model)?;
    let body_radius_m = table.optional_number(keys::RobotDefaults::body_radius_m)?;
    let wheels = parse_wheels(table, model)?;
    let drive = Drive::new(drive_kind, front_point_m, None);
    let turning_radius_min_m = parse_turning_radius(table, drive, model)?;
    let turn_rate_max_rad_s = match drive.is_car() {
        // It follows from speed and turning radius.
        true => None,
        false => parse_turn_rate_max(table, drive, wheels.as_ref(), model)?,
    };
    let has_limits = model.is_some() || table.get(keys::RobotDefaults::limits).is_some();
    let limits = has_limits.then(|| {
        parse_limits(
            &table.table(keys::RobotDefaults::limits)?,
            model,
            front_point_m,
            speed_max_m_s,
        )
    });
    let limits = limits.transpose()?;
    let law = parse_law(table, laws)?;
    check_foreign_gains(table, name, law, laws, document)?;
    let goal_m = parse_goal_m(table, name, law, laws)?;
    let can_turn_in_place = front_point_m == 0.0 && !drive.is_car();
    let goal_heading_rad = parse_goal_heading(table, name, can_turn_in_place, goal_m.is_some())?;
    let mut gains = BTreeMap::new();
    for &key in law.gain_keys {
        gains.insert(key.to_owned(), parse_gain(table, law, key)?);
    }
    Ok(Robot {
        name: name.to_owned(),
        start,
        front_point_m,
        drive_kind,
        turn_rate_max_rad_s,
        turning_radius_min_m,
        keep_m: table.optional_number(keys::RobotDefaults::keep_m)?.unwrap_or(shared.keep_m),
        speed_max_m_s,
        hold_periods: match table.get(keys::RobotDefaults::hold_periods) {
            Some(own) => own.integer()?,
            None => shared.hold_periods,
        },
        wheels,
        body_radius_m: body_radius_m.or(model.map(|model| model.body_radius_m)),
        acceleration_limits: limits,
        goal_m,
        goal_heading_rad,
        law: law.name.to_owned(),
        role: law.role,
        uses_feed_forward: law.feed_forward,
        correction_max_m_s: law.correction_max.map(|key| gains[key]),
        message_format: law.message_format,
        queued_messages_max: law.queued_messages_max,
        withholds_beacons: law.may_withhold_beacon,
        signals: law.signals,
        gain_ranges: law.gain_ranges,
        takes_params: law.params.is_some(),
        place_m: table.get(keys::RobotDefaults::place_m).map(|place| place.pair()).transpose()?,
        params: parse_params(table, law)?,
        gains,
        restart_policy: parse_restart_policy(table)?,
    })
}

/// Parses `drive`, by default that of the model, or two driven wheels without a model.
fn parse_drive_kind(
    table: &TableReader<'_, keys::Robot>,
    model: Option<&RobotModel>,
) -> Result<DriveKind, Diagnostic> {
    let of_model = model.map(RobotModel::drive_kind);
    let Some(value) = table.get(keys::RobotDefaults::drive) else {
        return Ok(of_model.unwrap_or_default());
    };
    let given = value.read_word()?;
    match model.filter(|model| model.drive_kind() != given) {
        None => Ok(given),
        Some(model) => Err(value.error_about_key(
            format!("is not the drive of the model \"{}\"", model.name),
            "expected no such key with this `model`, or no `model`; in a mixed team give it to each robot instead of \
             `robot_defaults`",
        )),
    }
}

/// Parses the speed limit of the robot, m/s, by default `shared`, or that of the model if it is lower.
fn parse_speed_max(
    table: &TableReader<'_, keys::Robot>,
    model: Option<&RobotModel>,
    shared: f64,
) -> Result<f64, Diagnostic> {
    let of_model = model.and_then(RobotModel::speed_max_m_s).unwrap_or(f64::INFINITY);
    let Some(value) = table.get(keys::RobotDefaults::speed_max_m_s) else {
        return Ok(shared.min(of_model));
    };
    let given = value.number()?;
    if given > of_model {
        return Err(value.error_about_key(
            format!("is {given}, but the model moves at most at {of_model} m/s"),
            "expected at most that, or no such key",
        ));
    }
    Ok(given)
}

/// Parses `wheels`. The values of the model are the defaults. Returns `None` if `wheels` is missing and the model has none.
fn parse_wheels(
    table: &TableReader<'_, keys::Robot>,
    model: Option<&RobotModel>,
) -> Result<Option<WheelsBrief>, Diagnostic> {
    let of_model = model.and_then(RobotModel::wheels);
    if of_model.is_none() && table.get(keys::RobotDefaults::wheels).is_none() {
        return Ok(None);
    }
    let table = table.table(keys::RobotDefaults::wheels)?;
    Ok(Some(WheelsBrief {
        speed_max_m_s: number_or_model_value(
            &table,
            keys::Wheels::speed_max_m_s,
            of_model.map(|wheels| wheels.speed_max_m_s),
        )?,
        track_m: number_or_model_value(
            &table,
            keys::Wheels::track_m,
            of_model.map(|wheels| wheels.track_m),
        )?,
    }))
}

/// Parses a gain of the law, which is above 0 unless the law gives it a range.
fn parse_gain(
    table: &TableReader<'_, keys::Robot>,
    law: &LawDescription,
    key: &str,
) -> Result<f64, Diagnostic> {
    let range = law.gain_range(key);
    let values = match range {
        None => "above 0".to_owned(),
        Some([lowest, highest]) => format!("from {lowest} to {highest}"),
    };
    let expected =
        format!("a gain of the law \"{}\", {values}; write `{key} = ...` next to `law`", law.name);
    table.gain(key, range)?.ok_or_else(|| table.missing_gain_error(key, &expected))
}

/// Parses the parameters of the law: those in its own table, with those of the robot in place of equal keys.
fn parse_params(
    table: &TableReader<'_, keys::Robot>,
    law: &LawDescription,
) -> Result<toml::Table, Diagnostic> {
    let mut params = law.params.cloned().unwrap_or_default();
    if let Some(own_params) = table.get(keys::RobotDefaults::params) {
        if law.params.is_none() {
            return Err(own_params.error_about_key(
                format!("is given, but the law \"{}\" takes no parameters", law.name),
                "expected no such key, or a law that is a program: `[laws.NAME]`",
            ));
        }
        params.extend(own_params.any_table()?);
    }
    Ok(params)
}

/// Parses the control law.
fn parse_law<'l>(
    table: &TableReader<'_, keys::Robot>,
    laws: &'l [LawDescription],
) -> Result<&'l LawDescription, Diagnostic> {
    let names: Vec<&str> = laws.iter().map(|law| law.name).collect();
    let known = format!("one of {}", quote_names(&names));
    let value = table
        .get(keys::RobotDefaults::law)
        .ok_or_else(|| table.missing_key_error(keys::RobotDefaults::law, &known))?;
    let name = value.text(&format!("expected {known}"))?;
    laws.iter().find(|law| law.name == name).ok_or_else(|| {
        let expected = match most_similar_word(name, names.iter().copied()) {
            Some(close) => format!("did you mean \"{close}\"?"),
            None => format!("expected {known}"),
        };
        value.error_about_key(format!("is \"{name}\", which is no known law"), expected)
    })
}

/// Returns an error if the robot's own table has a gain of another law.
fn check_foreign_gains(
    table: &TableReader<'_, keys::Robot>,
    name: &str,
    law: &LawDescription,
    laws: &[LawDescription],
    document: &Document<'_>,
) -> Result<(), Diagnostic> {
    for (key, span) in table.keys().filter(|(key, _)| !law.gain_keys.contains(key)) {
        if let Some(owner) = laws.iter().find(|other| other.gain_keys.contains(&key)) {
            let message = format!(
                "`{key}` is a gain of the law \"{}\", but robot {name} follows \"{}\"",
                owner.name, law.name
            );
            let expected =
                format!("expected gains of \"{}\": {}", law.name, law.gain_keys.join(", "));
            return Err(document.source.error_at(&span, message, expected));
        }
    }
    Ok(())
}

/// Parses the goal, m, which must be given if and only if the law goes to a goal.
fn parse_goal_m(
    table: &TableReader<'_, keys::Robot>,
    name: &str,
    law: &LawDescription,
    laws: &[LawDescription],
) -> Result<Option<[f64; 2]>, Diagnostic> {
    match (law.role.reference, table.get(keys::Robot::goal_m)) {
        (Reference::Goal, Some(goal)) => goal.pair().map(Some),
        (Reference::Goal, None) => {
            let expected =
                format!("goal of a robot with the law \"{}\": [x, y], in meters", law.name);
            Err(table.missing_key_error(keys::Robot::goal_m, &expected))
        }
        (_, Some(goal)) => {
            let goal_laws = laws.iter().filter(|law| law.role.reference == Reference::Goal);
            let goal_laws: Vec<&str> = goal_laws.map(|law| law.name).collect();
            Err(goal.error_about_key(
                format!("is given, but {name} follows \"{}\", which goes to no goal", law.name),
                format!("expected no such key, or a law that does: {}", quote_names(&goal_laws)),
            ))
        }
        (_, None) => Ok(None),
    }
}

/// Parses the distance of the front point, m: 0 for an omnidirectional robot and for a car, which have no `wheels`.
fn parse_front_point_m(
    table: &TableReader<'_, keys::Robot>,
    drive: DriveKind,
    model: Option<&RobotModel>,
) -> Result<f64, Diagnostic> {
    if drive.is_differential() {
        let of_model = model.map(RobotModel::front_point_m);
        return number_or_model_value(table, keys::RobotDefaults::front_point_m, of_model);
    }
    let drive_name = if drive == DriveKind::Omni { "omni" } else { "ackermann" };
    let of_wheels = format!(
        "describes two driven wheels on one axle, but the robot has `drive = \"{drive_name}\"`"
    );
    let expected = "expected no such key, or `drive = \"differential\"`; in a mixed team give it to each robot with a \
                    differential drive instead of `robot_defaults`";
    if let Some(wheels) = table.get(keys::RobotDefaults::wheels) {
        return Err(wheels.error_about_key(of_wheels, expected));
    }
    let Some(given) = table.get(keys::RobotDefaults::front_point_m) else { return Ok(0.0) };
    let front_point_m = given.number()?;
    if front_point_m > 0.0 {
        return Err(given.error_about_key(
            format!("is {front_point_m}, but the robot has `drive = \"{drive_name}\"`"),
            match drive {
                DriveKind::Ackermann => {
                    "expected 0, or no such key: a car is controlled at its rear axle. Controlled at a front point, \
                     none arrives"
                }
                _ => "expected 0, or no such key: an omnidirectional robot is controlled at its center",
            },
        ));
    }
    Ok(0.0)
}

/// Parses the minimum turning radius of a car, m, by default that of the model. Other drives have none.
fn parse_turning_radius(
    table: &TableReader<'_, keys::Robot>,
    drive: Drive,
    model: Option<&RobotModel>,
) -> Result<Option<f64>, Diagnostic> {
    let given = table.get(keys::RobotDefaults::turning_radius_min_m);
    let turn_rate = table.get(keys::RobotDefaults::turn_rate_max_rad_s);
    if let (true, Some(turn_rate)) = (drive.is_car(), turn_rate) {
        return Err(turn_rate.error_about_key(
            "is given, but the turn rate of a car follows from its speed and turning radius",
            "expected no such key with `drive = \"ackermann\"`",
        ));
    }
    let of_model = model.and_then(RobotModel::turning_radius_min_m);
    match (drive.is_car(), given) {
        (true, Some(radius)) => radius.number().map(Some),
        (true, None) if of_model.is_some() => Ok(of_model),
        (true, None) => {
            let expected = "above 0, in meters: a car with `drive = \"ackermann\"` has a minimum turning \
                            radius";
            Err(table.missing_key_error(keys::RobotDefaults::turning_radius_min_m, expected))
        }
        (false, Some(radius)) => Err(radius.error_about_key(
            "is given, but the robot is no car",
            "expected `drive = \"ackermann\"`, or no such key",
        )),
        (false, None) => Ok(None),
    }
}

/// Parses the maximum turn rate, rad/s. Unless given it is that of the model or, at the axle midpoint, of the wheels.
fn parse_turn_rate_max(
    table: &TableReader<'_, keys::Robot>,
    drive: Drive,
    wheels: Option<&WheelsBrief>,
    model: Option<&RobotModel>,
) -> Result<Option<f64>, Diagnostic> {
    if let Some(value) = table.get(keys::RobotDefaults::turn_rate_max_rad_s) {
        let given = value.number()?;
        if given == 0.0 && drive.kind.is_differential() {
            return Err(value.error_about_key(
                "is 0: a robot with two wheels that does not turn moves along one line only",
                "expected a number above 0, in rad/s; 0 is for `drive = \"omni\"`",
            ));
        }
        return Ok(Some(given));
    }
    if !drive.turns_freely() {
        return Ok(None);
    }
    let of_wheels = |wheels: &WheelsBrief| 2.0 * wheels.speed_max_m_s / wheels.track_m;
    let of_model = model.and_then(RobotModel::turn_rate_max_rad_s);
    let Some(turn_rate_max_rad_s) = of_model.or(wheels.map(of_wheels)) else {
        let expected = match drive.kind {
            DriveKind::Differential => {
                "above 0, in rad/s, or `wheels` or a `model`: with `front_point_m` = 0 the robot turns independently of \
                 its speed"
            }
            DriveKind::Omni | DriveKind::Ackermann => {
                "at least 0, in rad/s: an omnidirectional robot turns independently of its speed; with 0 it keeps its heading"
            }
        };
        return Err(table.missing_key_error(keys::RobotDefaults::turn_rate_max_rad_s, expected));
    };
    Ok(Some(turn_rate_max_rad_s))
}

/// Parses the heading at the goal, rad.
fn parse_goal_heading(
    table: &TableReader<'_, keys::Robot>,
    name: &str,
    can_turn_in_place: bool,
    has_goal: bool,
) -> Result<Option<f64>, Diagnostic> {
    let Some(value) = table.get(keys::Robot::goal_heading_rad) else { return Ok(None) };
    if !has_goal {
        return Err(value.error_about_key(
            format!("is given, but {name} has no goal"),
            "expected a law with the role `goal` and its `goal_m`, or no such key",
        ));
    }
    if !can_turn_in_place {
        return Err(value.error_about_key(
            format!("is given, but {name} cannot turn without moving its front point"),
            "expected `front_point_m = 0` with another drive than \"ackermann\", or no such key",
        ));
    }
    parse_heading(&value).map(Some)
}

/// Returns the number `key`, or that of the model. Returns an error if there is neither.
fn number_or_model_value<S: HasGroup<G>, G>(
    table: &TableReader<'_, S>,
    key: TypedKey<G, kinds::Number>,
    of_model: Option<f64>,
) -> Result<f64, Diagnostic> {
    match (table.optional_number(key)?, of_model) {
        (Some(number), _) | (None, Some(number)) => Ok(number),
        (None, None) => table.number(key),
    }
}

/// Parses `limits`. Without a speed limit the braking time is not used.
fn parse_limits(
    table: &TableReader<'_, keys::Limits>,
    model: Option<&RobotModel>,
    front_point_m: f64,
    speed_max_m_s: f64,
) -> Result<AccelerationLimitsBrief, Diagnostic> {
    let of_model =
        model.map(|model| [model.acceleration_max_m_s2, model.turn_acceleration_max_rad_s2]);
    let acceleration_m_s2 = number_or_model_value(
        table,
        keys::Limits::acceleration_m_s2,
        of_model.map(|limits| limits[0]),
    )?;
    let turn_acceleration_rad_s2 = number_or_model_value(
        table,
        keys::Limits::turn_acceleration_rad_s2,
        of_model.map(|limits| limits[1]),
    )?;
    let braking_time_s = match table.optional_number(keys::Limits::braking_time_s)? {
        Some(braking_time_s) => braking_time_s,
        None if speed_max_m_s.is_finite() && front_point_m == 0.0 => {
            speed_max_m_s / acceleration_m_s2
        }
        None if speed_max_m_s.is_finite() => {
            let turning_s = 0.5 * speed_max_m_s / (front_point_m * turn_acceleration_rad_s2);
            turning_s.max(speed_max_m_s / acceleration_m_s2)
        }
        None => 0.0,
    };
    let ramp = match table.get(keys::Limits::ramp) {
        Some(given) => {
            let ramp: Ramp = given.read_word()?;
            if front_point_m == 0.0 && ramp.is_coupled() {
                return Err(given.error_about_key(
                    "is \"together\" with `front_point_m` = 0: a slow turn would prolong the braking",
                    "expected no such key: speed and turn rate of the axle midpoint change independently",
                ));
            }
            ramp
        }
        None if front_point_m == 0.0 => Ramp::Independent,
        None => Ramp::Together,
    };
    Ok(AccelerationLimitsBrief {
        acceleration_m_s2,
        turn_acceleration_rad_s2,
        braking_time_s,
        ramp,
    })
}

/// Parses the name of a robot, which becomes a part of the names of services, processes and files.
fn parse_robot_name<'t>(value: &TypedValue<'t, kinds::Text>) -> Result<&'t str, Diagnostic> {
    let expected = "expected a letter, then at most 30 letters, digits, `-` or `_`";
    let name = value.text(expected)?;
    let is_valid = name.starts_with(|c: char| c.is_ascii_alphabetic())
        && name.len() <= 31
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_');
    if !is_valid {
        return Err(value.error_about_key(format!("is \"{name}\""), expected));
    }
    if RESERVED_NAMES.contains(&name) {
        return Err(value.error_about_key(
            format!("is \"{name}\", which is the name of another part of a run"),
            format!("expected another name, none of {}", RESERVED_NAMES.join(", ")),
        ));
    }
    Ok(name)
}

/// Parses a start pose.
fn parse_pose(value: &TypedValue<'_, kinds::Table<keys::Pose>>) -> Result<Pose, Diagnostic> {
    let table = value.table()?;
    let (x_m, y_m) = (table.number(keys::Pose::x_m)?, table.number(keys::Pose::y_m)?);
    Ok(Pose {
        x_m,
        y_m,
        heading_rad: parse_heading(&table.required_value(keys::Pose::heading_rad)?)?,
    })
}

/// Parses a heading, rad.
fn parse_heading(value: &TypedValue<'_, kinds::Number>) -> Result<f64, Diagnostic> {
    let heading_rad = value.number()?;
    if heading_rad.abs() > std::f64::consts::TAU {
        return Err(value.error_about_key(
            format!("is {heading_rad}: more than one turn"),
            format!(
                "expected radians from -2 pi to 2 pi; {heading_rad} degrees are {:.6}",
                wrap_angle(heading_rad.to_radians())
            ),
        ));
    }
    Ok(wrap_angle(heading_rad))
}

/// Parses the restart policy.
fn parse_restart_policy(table: &TableReader<'_, keys::Robot>) -> Result<RestartPolicy, Diagnostic> {
    let condition = table.read_word(keys::RobotDefaults::restart_policy)?;
    let restarts_max = table.integer(keys::RobotDefaults::max_restarts)? as u32;
    let delay_ns = table.time_ns(keys::RobotDefaults::restart_delay_s)?;
    let delay_max = table.get(keys::RobotDefaults::max_restart_delay_s);
    let delay_ns_max = delay_max
        .as_ref()
        .map_or(Ok(delay_ns.max(10_000_000_000)), |delay_max| delay_max.time_ns())?;
    if let Some(delay_max) = delay_max.filter(|_| delay_ns_max < delay_ns) {
        return Err(delay_max.error_about_key(
            format!("is {}, shorter than the first wait", ns_to_seconds(delay_ns_max)),
            format!("expected at least `restart_delay_s`, {} s", ns_to_seconds(delay_ns)),
        ));
    }
    let window_ns = table.time_ns(keys::RobotDefaults::restart_window_s)?;
    Ok(RestartPolicy { condition, delay_ns, delay_ns_max, restarts_max, window_ns })
}

/// Returns the index of the robot that `value` names.
pub(super) fn parse_robot_index<T>(
    value: &TypedValue<'_, T>,
    robots: &[Robot],
) -> Result<usize, Diagnostic> {
    let names: Vec<&str> = robots.iter().map(|robot| robot.name.as_str()).collect();
    let expected = format!("expected the name of a robot: {}", format_list(&names, 8));
    let name = value.text(&expected)?;
    names.iter().position(|known| *known == name).ok_or_else(|| {
        let expected = match most_similar_word(name, names.iter().copied()) {
            Some(close) if close.len() > 2 => format!("did you mean \"{close}\"?"),
            _ => expected,
        };
        value.error_about_key(format!("is \"{name}\", but there is no such robot"), expected)
    })
}

pub(super) fn quote_names(names: &[&str]) -> String {
    names.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}
