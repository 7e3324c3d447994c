//! What breaks in a scenario, and that it can: all `[[fault]]`, and `[chaos]`.

use formation::graph::FormationGraph;
use protocol::fault::{LinkFaultKind, Sensor, SensorFaultKind, Stream, WheelFaultKind};

use super::chaos::Chaos;
use super::diagnostic::Diagnostic;
use super::fault::{Form, kinds};
use super::lives::Lives;
use super::robots::robot_named;
use super::table::{Table, Value};
use super::{Fault, FaultKind, Robot, seconds};

/// In place of a robot's name: every one.
const EVERY: &str = "*";

/// What faults of a scenario may name, and when.
pub(super) struct Scene<'a> {
    pub(super) robots: &'a [Robot],
    pub(super) graph: &'a FormationGraph,
    pub(super) duration_ns: u64,
    pub(super) seed: u64,
}

/// All faults in order of time: those of the file, then those that chaos draws around them.
pub(super) fn faults(root: &Table<'_>, scene: &Scene<'_>) -> Result<Vec<Fault>, Diagnostic> {
    let mut planned = Vec::new();
    for table in root.tables("fault")? {
        let at = table.need("at_s")?;
        planned.extend(fault(&table, &at, scene)?.into_iter().map(|fault| (fault, at.clone())));
    }
    planned.sort_by_key(|(fault, _)| fault.at_ns);
    let mut lives = Lives::new(scene.robots.len());
    for (fault, at) in &planned {
        lives.take(fault).map_err(|why| {
            let name = |robot: usize| scene.robots[robot].name.as_str();
            let (is, expected) = why.in_words(name);
            at.wrong(format!("is {}, when {is}", seconds(fault.at_ns)), expected)
        })?;
    }
    let mut faults: Vec<Fault> = planned.into_iter().map(|(fault, _)| fault).collect();
    if let Some(chaos) = root.get("chaos") {
        let drawn = Chaos::read(&chaos, scene.duration_ns)?.draw(scene.seed, &mut lives);
        faults.extend(drawn);
        faults.sort_by_key(|fault| fault.at_ns);
    }
    Ok(faults)
}

/// One `[[fault]]`, which may strike many.
fn fault(table: &Table<'_>, at: &Value<'_>, scene: &Scene<'_>) -> Result<Vec<Fault>, Diagnostic> {
    let kinds: Vec<(&str, &str)> = kinds().map(|kind| (kind, kind)).collect();
    let kind = table.need("kind")?.word(&kinds)?;
    let stream = table.get("robot").is_some() || table.get("stream").is_some();
    let form = Form::of(kind, stream).expect("a kind has a form");
    table.only_with(&[form.needs(), form.may()].concat())?;
    let at_ns = at.time_ns()?;
    if at_ns >= scene.duration_ns {
        return Err(at.wrong(
            format!("is {}, when the run is over", seconds(at_ns)),
            format!("expected less than `duration_s`, {} s", seconds(scene.duration_ns)),
        ));
    }
    let for_ns = table.get("for_s").map(|lasts| lasts.time_ns()).transpose()?;
    let robot_value = || table.need("robot");
    let robots = || {
        let value = robot_value()?;
        match value.text("expected a name")? {
            EVERY => Ok((0..scene.robots.len()).collect()),
            _ => robot_named(&value, scene.robots).map(|robot| vec![robot]),
        }
    };
    let each = |of: &dyn Fn(usize) -> FaultKind| -> Result<Vec<FaultKind>, Diagnostic> {
        let robots: Vec<usize> = robots()?;
        Ok(robots.into_iter().map(of).collect())
    };
    let carried = |kind: LinkFaultKind| -> Result<Vec<FaultKind>, Diagnostic> {
        if !stream {
            let link = |edge| FaultKind::Link { edge, kind: kind.clone() };
            return Ok(edges(table, scene)?.into_iter().map(link).collect());
        }
        let words = [("odometry", Stream::Odometry), ("commands", Stream::Commands)];
        let stream = table.need("stream")?.word(&words)?;
        each(&|robot| FaultKind::Stream { robot, stream, kind: kind.clone() })
    };
    let share = || {
        let value = table.need("probability")?;
        let share = value.number()?;
        match share > 1.0 {
            true => Err(value.wrong(
                format!("is {share}"),
                "expected a share of what is sent, above 0 and at most 1",
            )),
            false => Ok(share),
        }
    };
    let delay_ns = || table.need("delay_s")?.time_ns();
    let struck = match form.kind {
        "kill" => {
            let restart = table.get("restart_after_s");
            if robot_value()?.text("expected a name")? == "plant" {
                if let Some(restart) = restart {
                    return Err(restart.wrong(
                        "is given for the plant",
                        "expected none: with the plant's death the run ends, with exit code 4",
                    ));
                }
                vec![FaultKind::KillPlant]
            } else {
                let restart_after_ns = restart.map(|after| after.time_ns()).transpose()?;
                each(&|robot| FaultKind::Kill { robot, restart_after_ns })?
            }
        }
        "freeze" => each(&|robot| FaultKind::Freeze { robot })?,
        "slow" => {
            let delay_ns = delay_ns()?;
            each(&|robot| FaultKind::Slow { robot, delay_ns })?
        }
        "cut" => carried(LinkFaultKind::Cut)?,
        "loss" => {
            carried(LinkFaultKind::Loss { probability: share()?, burst: table.whole("burst")? })?
        }
        "bursts" => carried(LinkFaultKind::Bursts {
            probability: share()?,
            mean_burst_ns: table.need("mean_burst_s")?.time_ns()?,
        })?,
        "fading" => carried(LinkFaultKind::Fading {
            range_m: table.number("range_m")?,
            exponent: table.number("exponent")?,
        })?,
        "delay" => {
            let jitter_ns = table.time_ns("jitter_s")?;
            carried(LinkFaultKind::Delay { delay_ns: delay_ns()?, jitter_ns })?
        }
        "blackout" => {
            let (sensor, kind) = (sensor(table)?, SensorFaultKind::Blackout);
            each(&|robot| FaultKind::Sensor { robot, sensor, kind })?
        }
        "noise" => {
            let (bound, sensor) = (table.need("bound_m")?, sensor(table)?);
            let (bound_m, heading_bound_rad) =
                (bound.number()?, table.number("heading_bound_rad")?);
            if sensor == Sensor::Proximity && heading_bound_rad > 0.0 {
                return Err(table.need("heading_bound_rad")?.wrong(
                    "is given for proximity, which senses no heading",
                    "expected it with `sensor = \"odometry\"` only",
                ));
            }
            if bound_m == 0.0 && heading_bound_rad == 0.0 {
                return Err(bound.wrong("is 0: there is no noise", "expected more than 0"));
            }
            let kind = SensorFaultKind::Noise { bound_m, heading_bound_rad };
            each(&|robot| FaultKind::Sensor { robot, sensor, kind })?
        }
        "wheels" => {
            let kind = match (table.get("stuck"), table.get("speed_max_m_s")) {
                (Some(stuck), None) if stuck.truth()? => WheelFaultKind::Stuck,
                (None, Some(limit)) => WheelFaultKind::Limit { speed_max_m_s: limit.number()? },
                (Some(stuck), _) => {
                    return Err(stuck.wrong(
                        "says too little, or too much",
                        "expected either `stuck = true` or `speed_max_m_s`",
                    ));
                }
                (None, None) => {
                    return Err(table.missing("stuck", "or else `speed_max_m_s`, in m/s"));
                }
            };
            each(&|robot| FaultKind::Wheels { robot, kind })?
        }
        "partition" => {
            let hosts = table.need("hosts")?;
            let expected = "expected a list of names of hosts, such as [\"b\"]";
            let names = hosts.texts(expected)?;
            if names.is_empty() {
                return Err(hosts.wrong("is empty", expected));
            }
            vec![FaultKind::Partition { hosts: names }]
        }
        "load" => {
            let processes = table.need("processes")?;
            vec![FaultKind::Load { processes: processes.whole()? as usize }]
        }
        other => unreachable!("{other} is a form, and read here"),
    };
    Ok(struck.into_iter().map(|kind| Fault { at_ns, for_ns, kind }).collect())
}

/// The places of the edges that `from` and `to` name.
fn edges(table: &Table<'_>, scene: &Scene<'_>) -> Result<Vec<usize>, Diagnostic> {
    let (from, to) = (table.need("from")?, table.need("to")?);
    let named = |value: &Value<'_>| match value.text("expected a name")? {
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
        let heard = scene.graph.heard_by(ends[1]);
        let heard: Vec<&str> = heard.map(|edge| scene.robots[edge.from].name.as_str()).collect();
        let expected = match heard[..] {
            [] => format!("expected a link that exists: {hearer} hears nobody"),
            _ => format!("expected a link that exists: {hearer} hears {}", heard.join(", ")),
        };
        to.wrong(format!("is \"{hearer}\", which does not hear {speaker}"), expected)
    })
}

fn sensor(table: &Table<'_>) -> Result<Sensor, Diagnostic> {
    let words = [("odometry", Sensor::Odometry), ("proximity", Sensor::Proximity)];
    table.need("sensor")?.word(&words)
}
