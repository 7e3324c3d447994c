//! What breaks in a scenario, and that it can: all `[[fault]]`.

use super::diagnostic::Diagnostic;
use super::robots::robot_named;
use super::table::Table;
use super::{Fault, FaultKind, Robot, seconds};

/// All `[[fault]]`, in order of time.
pub(super) fn faults(
    root: &Table<'_>,
    robots: &[Robot],
    duration_ns: u64,
) -> Result<Vec<Fault>, Diagnostic> {
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
