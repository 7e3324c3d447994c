//! Faults of a scenario: all `[[fault]]`, and `[chaos]`, with the check that each is possible, and faults written as
//! such tables.

use formation::graph::FormationGraph;
use protocol::fault::{
    Lie, LinkFaultKind, MessageLie, RobotStream, Sensor, SensorFaultKind, WheelFaultKind,
};
use toml_edit::{Array, Item, value};

use super::availability::Availability;
use super::chaos::Chaos;
use super::diagnostic::Diagnostic;
use super::fault::FaultSyntax;
use super::fields::kinds;
use super::keys;
use super::robots::parse_robot_index;
use super::table::{TableReader, TypedValue};
use super::{Fault, FaultKind, Robot, Scenario, fault, ns_to_seconds};

/// Name that stands for all robots.
const EVERY_ROBOT: &str = "*";

/// Robots, links and times that faults can refer to.
pub(super) struct FaultContext<'a> {
    pub(super) robots: &'a [Robot],
    pub(super) graph: &'a FormationGraph,
    pub(super) duration_ns: u64,
    pub(super) seed: u64,
}

/// Returns all faults sorted by time: those of the file and those that `[chaos]` draws.
pub(super) fn parse_faults(
    root: &TableReader<'_, keys::Root>,
    context: &FaultContext<'_>,
) -> Result<Vec<Fault>, Diagnostic> {
    let mut planned = Vec::new();
    for table in root.tables(keys::Root::fault)? {
        let start = table.required_value(keys::Fault::at_s)?;
        planned.extend(
            parse_fault(&table, &start, context)?.into_iter().map(|fault| (fault, start.clone())),
        );
    }
    planned.sort_by_key(|(fault, _)| fault.start_ns);
    let mut availability = Availability::new(context.robots.len());
    for (fault, start) in &planned {
        availability.record_fault(fault).map_err(|impossible| {
            let name = |robot: usize| context.robots[robot].name.as_str();
            let (state, expected) = impossible.describe(name);
            start.error_about_key(
                format!("is {}, when {state}", ns_to_seconds(fault.start_ns)),
                expected,
            )
        })?;
    }
    let mut faults: Vec<Fault> = planned.into_iter().map(|(fault, _)| fault).collect();
    if let Some(chaos) = root.get(keys::Root::chaos) {
        let chaos_faults =
            Chaos::read(&chaos, context.duration_ns)?.draw(context.seed, &mut availability);
        faults.extend(chaos_faults);
        faults.sort_by_key(|fault| fault.start_ns);
    }
    Ok(faults)
}

/// Parses a `[[fault]]` table, which can affect several robots or links.
fn parse_fault(
    table: &TableReader<'_, keys::Fault>,
    start: &TypedValue<'_, kinds::Time>,
    context: &FaultContext<'_>,
) -> Result<Vec<Fault>, Diagnostic> {
    let kind = table.kind_unchecked()?;
    let is_robot_stream =
        table.get(keys::Fault::robot).is_some() || table.get(keys::Fault::stream).is_some();
    let syntax = FaultSyntax::find(kind, is_robot_stream).expect("a kind has a form");
    table.check_kind_and_keys(&[syntax.required_keys(), syntax.optional_keys()].concat())?;
    let start_ns = start.time_ns()?;
    if start_ns >= context.duration_ns {
        return Err(start.error_about_key(
            format!("is {}, when the run is over", ns_to_seconds(start_ns)),
            format!(
                "expected less than `duration_s`, {} s; `--set fault=[]` runs it without faults",
                ns_to_seconds(context.duration_ns)
            ),
        ));
    }
    let duration_ns = table.optional_time_ns(keys::Fault::for_s)?;
    let for_each_robot = |kind: &dyn Fn(usize) -> FaultKind| -> Result<Vec<FaultKind>, Diagnostic> {
        Ok(parse_robots(table, context)?.into_iter().map(kind).collect())
    };
    let kinds = match kind {
        "kill" if table.required_value(keys::Fault::robot)?.text("expected a name")? == "plant" => {
            parse_plant_kill(table)?
        }
        "kill" => {
            let restart_after_ns = table.optional_time_ns(keys::Fault::restart_after_s)?;
            for_each_robot(&|robot| FaultKind::Kill { robot, restart_after_ns })?
        }
        "freeze" => for_each_robot(&|robot| FaultKind::Freeze { robot })?,
        "slow" => {
            let delay_ns = table.time_ns(keys::Fault::delay_s)?;
            for_each_robot(&|robot| FaultKind::Slowdown { robot, delay_ns })?
        }
        "blackout" | "noise" => {
            let sensor = table.read_word(keys::Fault::sensor)?;
            let kind = parse_sensor_fault(kind, sensor, table)?;
            for_each_robot(&|robot| FaultKind::Sensor { robot, sensor, kind })?
        }
        "wheels" => {
            let kind = parse_wheel_fault(table)?;
            for_each_robot(&|robot| FaultKind::Wheels { robot, kind })?
        }
        "partition" => {
            let hosts = table.required_value(keys::Fault::hosts)?;
            let expected = "expected a list of names of hosts, such as [\"b\"]";
            let host_names = hosts.texts(expected)?;
            if host_names.is_empty() {
                return Err(hosts.error_about_key("is empty", expected));
            }
            vec![FaultKind::Partition { hosts: host_names }]
        }
        "lie" => parse_lies(table, context, is_robot_stream)?,
        "load" => {
            vec![FaultKind::Load { processes: table.integer(keys::Fault::processes)? as usize }]
        }
        _ => {
            let kind = parse_link_fault(kind, table)?;
            let kind = || kind.clone();
            if is_robot_stream {
                let stream: RobotStream = table.read_word(keys::Fault::stream)?;
                for_each_robot(&|robot| FaultKind::Stream { robot, stream, kind: kind() })?
            } else {
                let edges = parse_edges(table, context)?.into_iter();
                edges.map(|edge| FaultKind::Link { edge, kind: kind() }).collect()
            }
        }
    };
    Ok(kinds.into_iter().map(|kind| Fault { start_ns, duration_ns, kind }).collect())
}

impl Fault {
    /// Returns the fault in the syntax of `--fault`.
    pub fn format_argument(&self, scenario: &Scenario) -> String {
        fault::format_fault(&self.to_table(scenario))
    }

    /// Returns the `[[fault]]` table of the fault.
    fn to_table(&self, scenario: &Scenario) -> toml_edit::Table {
        let mut table = self.kind.to_table(scenario);
        table["at_s"] = value(ns_to_seconds(self.start_ns));
        if let Some(duration_ns) = self.duration_ns {
            table["for_s"] = value(ns_to_seconds(duration_ns));
        }
        table
    }
}

impl FaultKind {
    /// Returns the `[[fault]]` table of a fault of this kind, without its time. Keys with default values are omitted.
    pub(super) fn to_table(&self, scenario: &Scenario) -> toml_edit::Table {
        let name = |robot: usize| value(scenario.robots[robot].name.as_str());
        let mut table = toml_edit::Table::new();
        let mut set = |entries: Vec<(&str, Item)>| {
            entries.into_iter().for_each(|(key, item)| table[key] = item)
        };
        match *self {
            FaultKind::Kill { robot, restart_after_ns } => {
                set(vec![("kind", value("kill")), ("robot", name(robot))]);
                set(restart_after_ns
                    .map(|ns| ("restart_after_s", value(ns_to_seconds(ns))))
                    .into_iter()
                    .collect());
            }
            FaultKind::KillPlant => set(vec![("kind", value("kill")), ("robot", value("plant"))]),
            FaultKind::Freeze { robot } => {
                set(vec![("kind", value("freeze")), ("robot", name(robot))])
            }
            FaultKind::Slowdown { robot, delay_ns } => set(vec![
                ("kind", value("slow")),
                ("robot", name(robot)),
                ("delay_s", value(ns_to_seconds(delay_ns))),
            ]),
            FaultKind::Link { edge, ref kind } => {
                let edge = scenario.graph.edges()[edge];
                let (keyword, entries) = link_fault_entries(kind);
                set(vec![
                    ("kind", value(keyword)),
                    ("from", name(edge.from)),
                    ("to", name(edge.to)),
                ]);
                set(entries);
            }
            FaultKind::Stream { robot, stream, ref kind } => {
                let (keyword, entries) = link_fault_entries(kind);
                let stream = value(stream.keyword());
                set(vec![("kind", value(keyword)), ("robot", name(robot)), ("stream", stream)]);
                set(entries);
            }
            FaultKind::Lie { robot, receiver, lie } => {
                set(vec![("kind", value("lie"))]);
                set(match receiver {
                    Some(receiver) => vec![("from", name(robot)), ("to", name(receiver))],
                    None => vec![("robot", name(robot))],
                });
                set(lie_entries(lie));
            }
            FaultKind::Sensor { robot, sensor, kind } => {
                let (keyword, entries) = sensor_fault_entries(kind);
                let sensor = value(sensor_keyword(sensor));
                set(vec![("kind", value(keyword)), ("robot", name(robot)), ("sensor", sensor)]);
                set(entries);
            }
            FaultKind::Wheels { robot, kind } => {
                set(vec![("kind", value("wheels")), ("robot", name(robot))]);
                set(vec![match kind {
                    WheelFaultKind::Stuck => ("stuck", value(true)),
                    WheelFaultKind::Limit { speed_max_m_s } => {
                        ("speed_max_m_s", value(speed_max_m_s))
                    }
                }]);
            }
            FaultKind::Partition { ref hosts } => {
                set(vec![("kind", value("partition")), ("hosts", value(Array::from_iter(hosts)))]);
            }
            FaultKind::Load { processes } => {
                set(vec![("kind", value("load")), ("processes", value(processes as i64))]);
            }
        }
        table
    }
}

/// Returns the indices of the robots that `robot` names.
fn parse_robots(
    table: &TableReader<'_, keys::Fault>,
    context: &FaultContext<'_>,
) -> Result<Vec<usize>, Diagnostic> {
    let value = table.required_value(keys::Fault::robot)?;
    match value.text("expected a name")? {
        EVERY_ROBOT => Ok((0..context.robots.len()).collect()),
        _ => parse_robot_index(&value, context.robots).map(|robot| vec![robot]),
    }
}

/// Parses Byzantine faults to one out-neighbor or to all.
fn parse_lies(
    table: &TableReader<'_, keys::Fault>,
    context: &FaultContext<'_>,
    is_robot_stream: bool,
) -> Result<Vec<FaultKind>, Diagnostic> {
    let pair = |key| Ok(table.get(key).map(|value| value.pair()).transpose()?.unwrap_or_default());
    let number = |key| Ok(table.optional_number(key)?.unwrap_or_default());
    let (by_m, drift_m_s) = (pair(keys::Fault::by_m)?, pair(keys::Fault::drift_m_s)?);
    let lie = Lie {
        by_m,
        drift_m_s,
        random_m: number(keys::Fault::random_m)?,
        turn_rad: number(keys::Fault::turn_rad)?,
        message: parse_message_lie(table)?,
    };
    if lie == Lie::default() {
        let expected = "expected one of `by_m`, `drift_m_s`, `random_m`, `turn_rad`, `message_offset`, `message_noise`, \
                        `message_bit_flips` that is not 0, or `message_scale` other than 1";
        return Err(table.error_at_table("the lie changes nothing", expected));
    }
    if !is_robot_stream {
        let edges =
            parse_edges(table, context)?.into_iter().map(|edge| context.graph.edges()[edge]);
        let edges = edges.map(|edge| (edge.from, Some(edge.to))).collect();
        return lie_fault_kinds(table, context, lie, edges);
    }
    let mut byzantine_robots = parse_robots(table, context)?;
    byzantine_robots.retain(|&robot| context.graph.outgoing_edges(robot).next().is_some());
    if byzantine_robots.is_empty() {
        let value = table.required_value(keys::Fault::robot)?;
        let name = value.text("expected a name")?;
        let message = format!("is \"{name}\", which no robot hears");
        return Err(value.error_about_key(message, "expected a robot that another one hears"));
    }
    lie_fault_kinds(
        table,
        context,
        lie,
        byzantine_robots.into_iter().map(|robot| (robot, None)).collect(),
    )
}

/// Parses the false data in messages.
fn parse_message_lie(table: &TableReader<'_, keys::Fault>) -> Result<MessageLie, Diagnostic> {
    let flips = table.get(keys::Fault::message_bit_flips);
    Ok(MessageLie {
        scale: table.number(keys::Fault::message_scale)?,
        offset: table.number(keys::Fault::message_offset)?,
        noise: table.optional_number(keys::Fault::message_noise)?.unwrap_or_default(),
        bit_flips: flips.map(|value| parse_probability(&value)).transpose()?.unwrap_or_default(),
    })
}

/// Parses a probability above 0.
fn parse_probability(value: &TypedValue<'_, kinds::Number>) -> Result<f64, Diagnostic> {
    match value.number()? {
        probability if probability > 1.0 => Err(value.error_about_key(
            format!("is {probability}"),
            "expected a fraction above 0 and at most 1",
        )),
        probability => Ok(probability),
    }
}

/// Returns the faults in which robots send the false data `lie`, each to one out-neighbor or, with `None`, to all. A
/// lie in nothing but messages is left out where the law of the robot sends none.
fn lie_fault_kinds(
    table: &TableReader<'_, keys::Fault>,
    context: &FaultContext<'_>,
    lie: Lie,
    mut senders: Vec<(usize, Option<usize>)>,
) -> Result<Vec<FaultKind>, Diagnostic> {
    let format = |robot: usize| context.robots[robot].message_format;
    let names = |senders: &[(usize, Option<usize>)]| {
        let mut names: Vec<&str> =
            senders.iter().map(|(robot, _)| context.robots[*robot].name.as_str()).collect();
        names.dedup();
        names.join(", ")
    };
    if !lie.message.is_none() && senders.iter().all(|(robot, _)| format(*robot).is_none()) {
        return Err(table.error_at_table(
            format!("the lie changes messages, but the law of {} sends none", names(&senders)),
            "expected a robot whose law has `message` or `message_bytes_max`, or a lie without a key `message_...`",
        ));
    }
    let is_in_beacons = Lie { message: MessageLie::default(), ..lie } != Lie::default();
    senders.retain(|(robot, _)| is_in_beacons || format(*robot).is_some());
    let without_numbers =
        |sender: &&(usize, Option<usize>)| format(sender.0).is_some_and(|f| f.is_bytes());
    if let (true, Some(sender)) =
        (lie.message.changes_numbers(), senders.iter().find(without_numbers))
    {
        return Err(table.error_at_table(
            format!(
                "the lie changes numbers, but {} sends bytes without a structure",
                names(&[*sender])
            ),
            "expected `message_bit_flips` alone, or a law with `message = { NAME = SHAPE }`",
        ));
    }
    Ok(senders
        .into_iter()
        .map(|(robot, receiver)| FaultKind::Lie { robot, receiver, lie })
        .collect())
}

fn parse_plant_kill(table: &TableReader<'_, keys::Fault>) -> Result<Vec<FaultKind>, Diagnostic> {
    match table.get(keys::Fault::restart_after_s) {
        Some(restart) => Err(restart.error_about_key(
            "is given for the plant",
            "expected none: with the plant's death the run ends, with exit code 4",
        )),
        None => Ok(vec![FaultKind::KillPlant]),
    }
}

/// Parses the fault of a link or a stream.
fn parse_link_fault(
    kind: &str,
    table: &TableReader<'_, keys::Fault>,
) -> Result<LinkFaultKind, Diagnostic> {
    let probability = || parse_probability(&table.required_value(keys::Fault::probability)?);
    Ok(match kind {
        "cut" => LinkFaultKind::Cut,
        "loss" => LinkFaultKind::Loss {
            probability: probability()?,
            burst: table.integer(keys::Fault::burst)?,
        },
        "bursts" => LinkFaultKind::Bursts {
            probability: probability()?,
            mean_burst_ns: table.time_ns(keys::Fault::mean_burst_s)?,
        },
        "fading" => LinkFaultKind::Fading {
            range_m: table.number(keys::Fault::range_m)?,
            exponent: table.number(keys::Fault::exponent)?,
        },
        "delay" => LinkFaultKind::Delay {
            delay_ns: table.time_ns(keys::Fault::delay_s)?,
            jitter_ns: table.time_ns(keys::Fault::jitter_s)?,
        },
        other => unreachable!("{other} is a kind, and read here"),
    })
}

/// Returns the kind and the other keys of the fault of a link or a stream: the inverse of [`parse_link_fault`].
fn link_fault_entries(kind: &LinkFaultKind) -> (&'static str, Vec<(&'static str, Item)>) {
    match *kind {
        LinkFaultKind::Cut => ("cut", Vec::new()),
        LinkFaultKind::Loss { probability, burst } => {
            let burst = (burst != 1).then(|| ("burst", value(burst as i64)));
            let probability_entry = ("probability", value(probability));
            ("loss", [probability_entry].into_iter().chain(burst).collect())
        }
        LinkFaultKind::Bursts { probability, mean_burst_ns } => {
            let mean = ("mean_burst_s", value(ns_to_seconds(mean_burst_ns)));
            ("bursts", vec![("probability", value(probability)), mean])
        }
        LinkFaultKind::Fading { range_m, exponent } => {
            ("fading", vec![("range_m", value(range_m)), ("exponent", value(exponent))])
        }
        LinkFaultKind::Delay { delay_ns, jitter_ns } => {
            let jitter = (jitter_ns != 0).then(|| ("jitter_s", value(ns_to_seconds(jitter_ns))));
            let delay = ("delay_s", value(ns_to_seconds(delay_ns)));
            ("delay", [delay].into_iter().chain(jitter).collect())
        }
    }
}

/// Returns the keys of a Byzantine fault that are not 0.
fn lie_entries(lie: Lie) -> Vec<(&'static str, Item)> {
    let Lie { by_m, drift_m_s, random_m, turn_rad, message } = lie;
    let MessageLie { scale, offset, noise, bit_flips } = message;
    let pairs = [("by_m", by_m), ("drift_m_s", drift_m_s)].into_iter();
    let pairs = pairs.filter(|(_, pair)| *pair != [0.0, 0.0]);
    let numbers = [
        ("random_m", random_m),
        ("turn_rad", turn_rad),
        ("message_offset", offset),
        ("message_noise", noise),
        ("message_bit_flips", bit_flips),
    ];
    let numbers = numbers.into_iter().filter(|(_, number)| *number != 0.0);
    let numbers = numbers.chain((scale != 1.0).then_some(("message_scale", scale)));
    pairs
        .map(|(key, pair)| (key, value(Array::from_iter(pair))))
        .chain(numbers.map(|(key, number)| (key, value(number))))
        .collect()
}

/// Returns the value of `sensor` for a sensor.
fn sensor_keyword(sensor: Sensor) -> &'static str {
    match sensor {
        Sensor::Odometry => "odometry",
        Sensor::Proximity => "proximity",
    }
}

/// Returns the kind and the other keys of the fault of a sensor: the inverse of [`parse_sensor_fault`].
fn sensor_fault_entries(kind: SensorFaultKind) -> (&'static str, Vec<(&'static str, Item)>) {
    match kind {
        SensorFaultKind::Blackout => ("blackout", Vec::new()),
        SensorFaultKind::Noise { bound_m, heading_bound_rad } => {
            let has_heading_error = heading_bound_rad != 0.0;
            let heading =
                has_heading_error.then(|| ("heading_bound_rad", value(heading_bound_rad)));
            ("noise", [("bound_m", value(bound_m))].into_iter().chain(heading).collect())
        }
    }
}

/// Parses the fault of a sensor.
fn parse_sensor_fault(
    kind: &str,
    sensor: Sensor,
    table: &TableReader<'_, keys::Fault>,
) -> Result<SensorFaultKind, Diagnostic> {
    if kind == "blackout" {
        return Ok(SensorFaultKind::Blackout);
    }
    let (bound, heading) = (
        table.required_value(keys::Fault::bound_m)?,
        table.required_value(keys::Fault::heading_bound_rad)?,
    );
    let (bound_m, heading_bound_rad) = (bound.number()?, heading.number()?);
    if sensor == Sensor::Proximity && heading_bound_rad > 0.0 {
        return Err(heading.error_about_key(
            "is given for proximity, which senses no heading",
            "expected it with `sensor = \"odometry\"` only",
        ));
    }
    if bound_m == 0.0 && heading_bound_rad == 0.0 {
        return Err(bound.error_about_key("is 0: there is no noise", "expected more than 0"));
    }
    Ok(SensorFaultKind::Noise { bound_m, heading_bound_rad })
}

/// Parses the fault of wheels.
fn parse_wheel_fault(table: &TableReader<'_, keys::Fault>) -> Result<WheelFaultKind, Diagnostic> {
    match (table.get(keys::Fault::stuck), table.get(keys::Fault::speed_max_m_s)) {
        (Some(stuck), None) if stuck.boolean()? => Ok(WheelFaultKind::Stuck),
        (None, Some(limit)) => Ok(WheelFaultKind::Limit { speed_max_m_s: limit.number()? }),
        (Some(stuck), _) => Err(stuck.error_about_key(
            "is incomplete or contradictory",
            "expected either `stuck = true` or `speed_max_m_s`",
        )),
        (None, None) => {
            Err(table.missing_key_error(keys::Fault::stuck, "or else `speed_max_m_s`, in m/s"))
        }
    }
}

/// Returns the indices of the edges that `from` and `to` name.
fn parse_edges(
    table: &TableReader<'_, keys::Fault>,
    context: &FaultContext<'_>,
) -> Result<Vec<usize>, Diagnostic> {
    let (from, to) =
        (table.required_value(keys::Fault::from)?, table.required_value(keys::Fault::to)?);
    let named = |value: &TypedValue<'_, kinds::Text>| match value.text("expected a name")? {
        EVERY_ROBOT => Ok(None),
        _ => parse_robot_index(value, context.robots).map(Some),
    };
    let [sender, receiver] = [named(&from)?, named(&to)?];
    let (Some(sender), Some(receiver)) = (sender, receiver) else {
        let matches = |expected: Option<usize>, robot: usize| {
            expected.is_none_or(|expected| expected == robot)
        };
        let edges = context.graph.edges().iter().enumerate();
        let matching =
            edges.filter(|(_, edge)| matches(sender, edge.from) && matches(receiver, edge.to));
        let matching: Vec<usize> = matching.map(|(index, _)| index).collect();
        return match matching.is_empty() {
            false => Ok(matching),
            true => Err(to.error_about_key("names no link", "expected one that exists")),
        };
    };
    let endpoints = [sender, receiver];
    let found = context.graph.edges().iter().position(|edge| [edge.from, edge.to] == endpoints);
    found.map(|index| vec![index]).ok_or_else(|| {
        let [sender, receiver] = endpoints.map(|robot| context.robots[robot].name.as_str());
        let in_neighbors = context.graph.incoming_edges(endpoints[1]);
        let in_neighbors: Vec<&str> =
            in_neighbors.map(|edge| context.robots[edge.from].name.as_str()).collect();
        let expected = match in_neighbors[..] {
            [] => format!("expected a link that exists: {receiver} hears no robot"),
            _ => {
                format!("expected a link that exists: {receiver} hears {}", in_neighbors.join(", "))
            }
        };
        to.error_about_key(format!("is \"{receiver}\", which does not hear {sender}"), expected)
    })
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;
    use std::path::Path;

    use proptest::prelude::*;
    use protocol::catalog::Catalog;
    use protocol::law_message::{MessageArray, MessageFormat};
    use toml::de::DeTable;

    use super::super::diagnostic::SourceText;
    use super::super::keys::FileFormat;
    use super::super::table::Document;
    use super::*;
    use crate::examples::row_of_three;

    /// Time of the longest fault, ns. The run takes 20 s.
    const FAULT_TIME_NS_MAX: u64 = 20_000_000_000;

    fn any_time_ns() -> impl Strategy<Value = u64> {
        1..FAULT_TIME_NS_MAX
    }

    fn any_fraction() -> impl Strategy<Value = f64> {
        1e-9..1.0
    }

    fn any_message_fault_kind() -> impl Strategy<Value = LinkFaultKind> {
        prop_oneof![
            (any_fraction(), 1..1000u64)
                .prop_map(|(probability, burst)| LinkFaultKind::Loss { probability, burst }),
            (any_fraction(), any_time_ns()).prop_map(|(probability, mean_burst_ns)| {
                LinkFaultKind::Bursts { probability, mean_burst_ns }
            }),
            (any_time_ns(), 0..FAULT_TIME_NS_MAX)
                .prop_map(|(delay_ns, jitter_ns)| LinkFaultKind::Delay { delay_ns, jitter_ns }),
        ]
    }

    /// Kinds that act on links only.
    fn any_link_fault_kind() -> impl Strategy<Value = LinkFaultKind> {
        let fading = (1e-9..1e9, 1e-9..1e9)
            .prop_map(|(range_m, exponent)| LinkFaultKind::Fading { range_m, exponent });
        prop_oneof![any_message_fault_kind(), Just(LinkFaultKind::Cut), fading]
    }

    fn any_lie() -> impl Strategy<Value = Lie> {
        let pair = || prop::array::uniform2(-1e9..1e9);
        let message = (-1e3..1e3, -1e9..1e9, any_fraction(), any_fraction()).prop_map(
            |(scale, offset, noise, bit_flips)| MessageLie { scale, offset, noise, bit_flips },
        );
        (pair(), pair(), any_fraction(), -1e3..1e3, message).prop_map(
            |(by_m, drift_m_s, random_m, turn_rad, message)| Lie {
                by_m,
                drift_m_s,
                random_m,
                turn_rad,
                message,
            },
        )
    }

    /// Messages of all robots.
    static POINT_MESSAGE_FORMAT: MessageFormat = MessageFormat {
        bytes_max: 16,
        arrays: Cow::Borrowed(&[MessageArray {
            name: Cow::Borrowed("x_m"),
            shape: Cow::Borrowed(&[2]),
        }]),
    };

    /// Faults of all kinds in [`row_of_three`], in which r2 receives from r1, and r3 from r2.
    fn any_fault_kind() -> impl Strategy<Value = FaultKind> {
        let robot = || 0..3usize;
        let stream = prop_oneof![Just(RobotStream::Odometry), Just(RobotStream::Commands)];
        let sensor_kind = prop_oneof![
            Just((Sensor::Odometry, SensorFaultKind::Blackout)),
            Just((Sensor::Proximity, SensorFaultKind::Blackout)),
            (0.0..1e9, any_fraction()).prop_map(|(bound_m, heading_bound_rad)| (
                Sensor::Odometry,
                SensorFaultKind::Noise { bound_m, heading_bound_rad }
            )),
            any_fraction().prop_map(|bound_m| (
                Sensor::Proximity,
                SensorFaultKind::Noise { bound_m, heading_bound_rad: 0.0 }
            )),
        ];
        let wheels = prop_oneof![
            Just(WheelFaultKind::Stuck),
            (1e-9..1e9).prop_map(|speed_max_m_s| WheelFaultKind::Limit { speed_max_m_s }),
        ];
        prop_oneof![
            (robot(), prop::option::of(any_time_ns()))
                .prop_map(|(robot, restart_after_ns)| FaultKind::Kill { robot, restart_after_ns }),
            Just(FaultKind::KillPlant),
            robot().prop_map(|robot| FaultKind::Freeze { robot }),
            (robot(), any_time_ns())
                .prop_map(|(robot, delay_ns)| FaultKind::Slowdown { robot, delay_ns }),
            (0..2usize, any_link_fault_kind())
                .prop_map(|(edge, kind)| FaultKind::Link { edge, kind }),
            (robot(), stream, any_message_fault_kind())
                .prop_map(|(robot, stream, kind)| FaultKind::Stream { robot, stream, kind }),
            (0..2usize, any::<bool>(), any_lie()).prop_map(|(robot, has_receiver, lie)| {
                FaultKind::Lie { robot, receiver: has_receiver.then_some(robot + 1), lie }
            }),
            (robot(), sensor_kind).prop_map(|(robot, (sensor, kind))| FaultKind::Sensor {
                robot,
                sensor,
                kind
            }),
            (robot(), wheels).prop_map(|(robot, kind)| FaultKind::Wheels { robot, kind }),
            prop::collection::vec("[a-z][a-z0-9_-]{0,5}", 1..4)
                .prop_map(|hosts| FaultKind::Partition { hosts }),
            (1..256usize).prop_map(|processes| FaultKind::Load { processes }),
        ]
    }

    proptest! {
        #[test]
        fn printed_faults_of_all_kinds_parse_to_the_same(
            kind in any_fault_kind(),
            start_ns in 0..FAULT_TIME_NS_MAX,
            duration_ns in prop::option::of(any_time_ns()),
        ) {
            let mut scenario = row_of_three();
            scenario.robots.iter_mut().for_each(|robot| robot.message_format = Some(&POINT_MESSAGE_FORMAT));
            let has_duration = !matches!(kind, FaultKind::Kill { .. } | FaultKind::KillPlant);
            let planned = Fault { start_ns, duration_ns: duration_ns.filter(|_| has_duration), kind };
            let argument = planned.format_argument(&scenario);
            let parsed = fault::parse(&argument).unwrap_or_else(|error| panic!("{argument}: {error}"));
            let text = format!("[[fault]]\n{parsed}");
            let format = FileFormat::new(&Catalog { laws: Vec::new(), methods: Vec::new() });
            let document = Document::new(SourceText::new(Path::new("t.toml"), &text, false), &format);
            let entries = DeTable::parse(&text).unwrap();
            let root: TableReader<'_, keys::Root> = TableReader::root(&document, entries.get_ref(), "the scenario");
            let table = &root.tables(keys::Root::fault).unwrap()[0];
            let (robots, graph) = (&scenario.robots[..], &scenario.graph);
            let context = FaultContext { robots, graph, duration_ns: FAULT_TIME_NS_MAX, seed: 1 };
            let read = super::parse_fault(table, &table.required_value(keys::Fault::at_s).unwrap(), &context);
            prop_assert_eq!(read.unwrap(), [planned], "{}", argument);
        }
    }
}
