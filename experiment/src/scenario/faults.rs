//! Faults of a scenario: all `[[fault]]`, and `[chaos]`, with the check that each is possible.

use formation::graph::FormationGraph;
use protocol::fault::{Lie, LinkFaultKind, Sensor, SensorFaultKind, Stream, WheelFaultKind};

use super::availability::Availability;
use super::chaos::Chaos;
use super::diagnostic::Diagnostic;
use super::fault::Form;
use super::fields::kinds;
use super::keys;
use super::robots::robot_named;
use super::table::{Table, Value};
use super::{Fault, FaultKind, Robot, seconds};

/// Name that stands for all robots.
const EVERY: &str = "*";

/// Robots, links and times that faults can refer to.
pub(super) struct Scene<'a> {
    pub(super) robots: &'a [Robot],
    pub(super) graph: &'a FormationGraph,
    pub(super) duration_ns: u64,
    pub(super) seed: u64,
}

/// Returns all faults sorted by time: those of the file and those that `[chaos]` draws.
pub(super) fn faults(
    root: &Table<'_, keys::Root>,
    scene: &Scene<'_>,
) -> Result<Vec<Fault>, Diagnostic> {
    let mut planned = Vec::new();
    for table in root.tables(keys::Root::fault)? {
        let at = table.need(keys::Fault::at_s)?;
        planned.extend(fault(&table, &at, scene)?.into_iter().map(|fault| (fault, at.clone())));
    }
    planned.sort_by_key(|(fault, _)| fault.at_ns);
    let mut availability = Availability::new(scene.robots.len());
    for (fault, at) in &planned {
        availability.record_fault(fault).map_err(|why| {
            let name = |robot: usize| scene.robots[robot].name.as_str();
            let (is, expected) = why.describe(name);
            at.wrong(format!("is {}, when {is}", seconds(fault.at_ns)), expected)
        })?;
    }
    let mut faults: Vec<Fault> = planned.into_iter().map(|(fault, _)| fault).collect();
    if let Some(chaos) = root.get(keys::Root::chaos) {
        let drawn = Chaos::read(&chaos, scene.duration_ns)?.draw(scene.seed, &mut availability);
        faults.extend(drawn);
        faults.sort_by_key(|fault| fault.at_ns);
    }
    Ok(faults)
}

/// Parses a `[[fault]]` table, which can affect several robots or links.
fn fault(
    table: &Table<'_, keys::Fault>,
    at: &Value<'_, kinds::Time>,
    scene: &Scene<'_>,
) -> Result<Vec<Fault>, Diagnostic> {
    let kind = table.kind_alone()?;
    let of_robot =
        table.get(keys::Fault::robot).is_some() || table.get(keys::Fault::stream).is_some();
    let form = Form::find(kind, of_robot).expect("a kind has a form");
    table.only_with(&[form.needs(), form.may()].concat())?;
    let at_ns = at.time_ns()?;
    if at_ns >= scene.duration_ns {
        return Err(at.wrong(
            format!("is {}, when the run is over", seconds(at_ns)),
            format!(
                "expected less than `duration_s`, {} s; `--set fault=[]` runs it without faults",
                seconds(scene.duration_ns)
            ),
        ));
    }
    let for_ns = table.maybe_time_ns(keys::Fault::for_s)?;
    let each = |kind: &dyn Fn(usize) -> FaultKind| -> Result<Vec<FaultKind>, Diagnostic> {
        Ok(robots(table, scene)?.into_iter().map(kind).collect())
    };
    let struck = match kind {
        "kill" if table.need(keys::Fault::robot)?.text("expected a name")? == "plant" => {
            parse_plant_kill(table)?
        }
        "kill" => {
            let restart_after_ns = table.maybe_time_ns(keys::Fault::restart_after_s)?;
            each(&|robot| FaultKind::Kill { robot, restart_after_ns })?
        }
        "freeze" => each(&|robot| FaultKind::Freeze { robot })?,
        "slow" => {
            let delay_ns = table.time_ns(keys::Fault::delay_s)?;
            each(&|robot| FaultKind::Slow { robot, delay_ns })?
        }
        "blackout" | "noise" => {
            let sensor = table.word(keys::Fault::sensor)?;
            let kind = sensor_fault(kind, sensor, table)?;
            each(&|robot| FaultKind::Sensor { robot, sensor, kind })?
        }
        "wheels" => {
            let kind = wheel_fault(table)?;
            each(&|robot| FaultKind::Wheels { robot, kind })?
        }
        "partition" => {
            let hosts = table.need(keys::Fault::hosts)?;
            let expected = "expected a list of names of hosts, such as [\"b\"]";
            let names = hosts.texts(expected)?;
            if names.is_empty() {
                return Err(hosts.wrong("is empty", expected));
            }
            vec![FaultKind::Partition { hosts: names }]
        }
        "lie" => lies(table, scene, of_robot)?,
        "load" => {
            vec![FaultKind::Load { processes: table.whole(keys::Fault::processes)? as usize }]
        }
        _ => {
            let kind = link_fault(kind, table)?;
            let kind = || kind.clone();
            if of_robot {
                let stream: Stream = table.word(keys::Fault::stream)?;
                each(&|robot| FaultKind::Stream { robot, stream, kind: kind() })?
            } else {
                let edges = edges(table, scene)?.into_iter();
                edges.map(|edge| FaultKind::Link { edge, kind: kind() }).collect()
            }
        }
    };
    Ok(struck.into_iter().map(|kind| Fault { at_ns, for_ns, kind }).collect())
}

/// Returns the indices of the robots that `robot` names.
fn robots(table: &Table<'_, keys::Fault>, scene: &Scene<'_>) -> Result<Vec<usize>, Diagnostic> {
    let value = table.need(keys::Fault::robot)?;
    match value.text("expected a name")? {
        EVERY => Ok((0..scene.robots.len()).collect()),
        _ => robot_named(&value, scene.robots).map(|robot| vec![robot]),
    }
}

/// Parses Byzantine faults to one out-neighbor or to all.
fn lies(
    table: &Table<'_, keys::Fault>,
    scene: &Scene<'_>,
    of_robot: bool,
) -> Result<Vec<FaultKind>, Diagnostic> {
    let pair = |key| Ok(table.get(key).map(|value| value.pair()).transpose()?.unwrap_or_default());
    let number = |key| Ok(table.maybe_number(key)?.unwrap_or_default());
    let (by_m, drift_m_s) = (pair(keys::Fault::by_m)?, pair(keys::Fault::drift_m_s)?);
    let lie = Lie {
        by_m,
        drift_m_s,
        random_m: number(keys::Fault::random_m)?,
        turn_rad: number(keys::Fault::turn_rad)?,
    };
    if lie == Lie::default() {
        let expected = "expected one of `by_m`, `drift_m_s`, `random_m`, `turn_rad` that is not 0";
        return Err(table.here("the lie changes nothing", expected));
    }
    if !of_robot {
        let ends = edges(table, scene)?.into_iter().map(|edge| scene.graph.edges()[edge]);
        let lie = ends.map(|ends| FaultKind::Lie { robot: ends.from, hearer: Some(ends.to), lie });
        return Ok(lie.collect());
    }
    let mut liars = robots(table, scene)?;
    liars.retain(|&robot| scene.graph.outgoing_edges(robot).next().is_some());
    if liars.is_empty() {
        let value = table.need(keys::Fault::robot)?;
        let said = value.text("expected a name")?;
        let what = format!("is \"{said}\", which no robot hears");
        return Err(value.wrong(what, "expected a robot that another one hears"));
    }
    Ok(liars.into_iter().map(|robot| FaultKind::Lie { robot, hearer: None, lie }).collect())
}

fn parse_plant_kill(table: &Table<'_, keys::Fault>) -> Result<Vec<FaultKind>, Diagnostic> {
    match table.get(keys::Fault::restart_after_s) {
        Some(restart) => Err(restart.wrong(
            "is given for the plant",
            "expected none: with the plant's death the run ends, with exit code 4",
        )),
        None => Ok(vec![FaultKind::KillPlant]),
    }
}

/// Parses the fault of a link or a stream.
fn link_fault(kind: &str, table: &Table<'_, keys::Fault>) -> Result<LinkFaultKind, Diagnostic> {
    let share = || {
        let value = table.need(keys::Fault::probability)?;
        match value.number()? {
            share if share > 1.0 => {
                Err(value.wrong(format!("is {share}"), "expected a fraction above 0 and at most 1"))
            }
            share => Ok(share),
        }
    };
    Ok(match kind {
        "cut" => LinkFaultKind::Cut,
        "loss" => {
            LinkFaultKind::Loss { probability: share()?, burst: table.whole(keys::Fault::burst)? }
        }
        "bursts" => LinkFaultKind::Bursts {
            probability: share()?,
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

/// Parses the fault of a sensor.
fn sensor_fault(
    kind: &str,
    sensor: Sensor,
    table: &Table<'_, keys::Fault>,
) -> Result<SensorFaultKind, Diagnostic> {
    if kind == "blackout" {
        return Ok(SensorFaultKind::Blackout);
    }
    let (bound, heading) =
        (table.need(keys::Fault::bound_m)?, table.need(keys::Fault::heading_bound_rad)?);
    let (bound_m, heading_bound_rad) = (bound.number()?, heading.number()?);
    if sensor == Sensor::Proximity && heading_bound_rad > 0.0 {
        return Err(heading.wrong(
            "is given for proximity, which senses no heading",
            "expected it with `sensor = \"odometry\"` only",
        ));
    }
    if bound_m == 0.0 && heading_bound_rad == 0.0 {
        return Err(bound.wrong("is 0: there is no noise", "expected more than 0"));
    }
    Ok(SensorFaultKind::Noise { bound_m, heading_bound_rad })
}

/// Parses the fault of wheels.
fn wheel_fault(table: &Table<'_, keys::Fault>) -> Result<WheelFaultKind, Diagnostic> {
    match (table.get(keys::Fault::stuck), table.get(keys::Fault::speed_max_m_s)) {
        (Some(stuck), None) if stuck.truth()? => Ok(WheelFaultKind::Stuck),
        (None, Some(limit)) => Ok(WheelFaultKind::Limit { speed_max_m_s: limit.number()? }),
        (Some(stuck), _) => Err(stuck.wrong(
            "is incomplete or contradictory",
            "expected either `stuck = true` or `speed_max_m_s`",
        )),
        (None, None) => Err(table.missing(keys::Fault::stuck, "or else `speed_max_m_s`, in m/s")),
    }
}

/// Returns the indices of the edges that `from` and `to` name.
fn edges(table: &Table<'_, keys::Fault>, scene: &Scene<'_>) -> Result<Vec<usize>, Diagnostic> {
    let (from, to) = (table.need(keys::Fault::from)?, table.need(keys::Fault::to)?);
    let named = |value: &Value<'_, kinds::Text>| match value.text("expected a name")? {
        EVERY => Ok(None),
        _ => robot_named(value, scene.robots).map(Some),
    };
    let [speaker, hearer] = [named(&from)?, named(&to)?];
    let (Some(speaker), Some(hearer)) = (speaker, hearer) else {
        let of = |robot: Option<usize>, end: usize| robot.is_none_or(|robot| robot == end);
        let edges = scene.graph.edges().iter().enumerate();
        let meant = edges.filter(|(_, edge)| of(speaker, edge.from) && of(hearer, edge.to));
        let meant: Vec<usize> = meant.map(|(place, _)| place).collect();
        return match meant.is_empty() {
            false => Ok(meant),
            true => Err(to.wrong("names no link", "expected one that exists")),
        };
    };
    let ends = [speaker, hearer];
    let found = scene.graph.edges().iter().position(|edge| [edge.from, edge.to] == ends);
    found.map(|place| vec![place]).ok_or_else(|| {
        let [speaker, hearer] = ends.map(|end| scene.robots[end].name.as_str());
        let heard = scene.graph.incoming_edges(ends[1]);
        let heard: Vec<&str> = heard.map(|edge| scene.robots[edge.from].name.as_str()).collect();
        let expected = match heard[..] {
            [] => format!("expected a link that exists: {hearer} hears no robot"),
            _ => format!("expected a link that exists: {hearer} hears {}", heard.join(", ")),
        };
        to.wrong(format!("is \"{hearer}\", which does not hear {speaker}"), expected)
    })
}
