//! What breaks in a scenario, and that it can: all `[[fault]]`, and `[chaos]`.

use formation::graph::FormationGraph;
use protocol::fault::{LinkFaultKind, Sensor, SensorFaultKind, WheelFaultKind};

use super::chaos::Chaos;
use super::diagnostic::Diagnostic;
use super::fault::{FORMS, Form};
use super::lives::Lives;
use super::robots::robot_named;
use super::table::{Table, Value};
use super::{Fault, FaultKind, Robot, seconds};

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
        planned.push((fault(&table, &at, scene)?, at));
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

/// One `[[fault]]`.
fn fault(table: &Table<'_>, at: &Value<'_>, scene: &Scene<'_>) -> Result<Fault, Diagnostic> {
    let kinds: Vec<(&str, &Form)> = FORMS.iter().map(|form| (form.kind, form)).collect();
    let form = table.need("kind")?.word(&kinds)?;
    table.only_of(form.kind)?;
    let at_ns = at.time_ns()?;
    if at_ns >= scene.duration_ns {
        return Err(at.wrong(
            format!("is {}, when the run is over", seconds(at_ns)),
            format!("expected less than `duration_s`, {} s", seconds(scene.duration_ns)),
        ));
    }
    let for_ns = table.get("for_s").map(|lasts| lasts.time_ns()).transpose()?;
    let robot_value = || table.need("robot");
    let robot = || robot_named(&robot_value()?, scene.robots);
    let delay_ns = || table.need("delay_s")?.time_ns();
    let kind = match form.kind {
        "kill" => {
            let restart = table.get("restart_after_s");
            if robot_value()?.text("expected a name")? == "plant" {
                if let Some(restart) = restart {
                    return Err(restart.wrong(
                        "is given for the plant",
                        "expected none: with the plant's death the run ends, with exit code 4",
                    ));
                }
                FaultKind::KillPlant
            } else {
                let restart_after_ns = restart.map(|after| after.time_ns()).transpose()?;
                FaultKind::Kill { robot: robot()?, restart_after_ns }
            }
        }
        "freeze" => FaultKind::Freeze { robot: robot()? },
        "slow" => FaultKind::Slow { robot: robot()?, delay_ns: delay_ns()? },
        "cut" => FaultKind::Link { edge: edge(table, scene)?, kind: LinkFaultKind::Cut },
        "loss" => {
            let share = table.need("probability")?;
            let probability = share.number()?;
            if probability > 1.0 {
                return Err(share.wrong(
                    format!("is {probability}"),
                    "expected a share of the beacons, above 0 and at most 1",
                ));
            }
            let burst = table.whole("burst")?;
            let kind = LinkFaultKind::Loss { probability, burst };
            FaultKind::Link { edge: edge(table, scene)?, kind }
        }
        "delay" => {
            let jitter_ns = table.time_ns("jitter_s")?;
            let kind = LinkFaultKind::Delay { delay_ns: delay_ns()?, jitter_ns };
            FaultKind::Link { edge: edge(table, scene)?, kind }
        }
        "blackout" => FaultKind::Sensor {
            robot: robot()?,
            sensor: sensor(table)?,
            kind: SensorFaultKind::Blackout,
        },
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
            FaultKind::Sensor { robot: robot()?, sensor, kind }
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
            FaultKind::Wheels { robot: robot()?, kind }
        }
        "load" => {
            let processes = table.need("processes")?;
            FaultKind::Load { processes: processes.whole()? as usize }
        }
        other => unreachable!("{other} is a form, and read here"),
    };
    Ok(Fault { at_ns, for_ns, kind })
}

/// The place of the edge that `from` and `to` name.
fn edge(table: &Table<'_>, scene: &Scene<'_>) -> Result<usize, Diagnostic> {
    let (from, to) = (table.need("from")?, table.need("to")?);
    let ends = [robot_named(&from, scene.robots)?, robot_named(&to, scene.robots)?];
    let found = scene.graph.edges().iter().position(|edge| [edge.from, edge.to] == ends);
    found.ok_or_else(|| {
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
