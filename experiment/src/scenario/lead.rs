//! Reference trajectory of the main leader: `[trajectory]`.

use formation::path::{Path, PathError, WAYPOINT_DISTANCE_M_MIN, WAYPOINTS_MAX, Waypoints};
use formation::scale::Scale;
use formation::trajectory::Trajectory;
use protocol::brief::LeadBrief;

use super::Robot;
use super::diagnostic::Diagnostic;
use super::fields::kinds;
use super::keys;
use super::table::{TableReader, TypedValue};

/// Parses `[trajectory]`, which must be given if and only if there is a leader. The scale is parsed later, because its
/// defaults depend on the whole scenario.
pub(super) fn parse_trajectory(
    root: &TableReader<'_, keys::Root>,
    robots: &[Robot],
) -> Result<Option<LeadBrief>, Diagnostic> {
    let leader = robots.iter().find(|robot| robot.role.leads);
    match (leader, root.get(keys::Root::trajectory)) {
        (Some(leader), None) => {
            let expected =
                format!("reference trajectory of the leader {}: a table with `kind`", leader.name);
            Err(root.missing_key_error(keys::Root::trajectory, &expected))
        }
        (None, Some(trajectory)) => Err(trajectory.error_about_key(
            "is given, but there is no leader",
            "expected a robot with a leader's law",
        )),
        (Some(_), Some(value)) => {
            let (trajectory, keep_heading) = parse_trajectory_table(&value)?;
            Ok(Some(LeadBrief { scale: Scale::CONSTANT_ONE, trajectory, keep_heading }))
        }
        (None, None) => Ok(None),
    }
}

/// Parses `[trajectory]`. Returns m(t), and whether theta_n keeps its heading where m(t) reverses.
fn parse_trajectory_table(
    value: &TypedValue<'_, kinds::Table<keys::Trajectory>>,
) -> Result<(Trajectory, bool), Diagnostic> {
    let table = value.table()?;
    let kind = table.kind()?;
    let center_m =
        table.get(keys::Trajectory::center_m).map_or(Ok([0.0, 0.0]), |center| center.pair())?;
    let radius = || table.number(keys::Trajectory::radius_m);
    let period = || table.number(keys::Trajectory::period_s);
    // Kinds of trajectories that never reverse do not have the key.
    let keep_heading = matches!(kind, "lissajous" | "waypoints")
        && table.boolean(keys::Trajectory::keep_heading)?;
    let trajectory = match kind {
        "still" => Trajectory::Still { center_m },
        "line" => Trajectory::Line {
            center_m,
            velocity_m_s: table.required_value(keys::Trajectory::velocity_m_s)?.pair()?,
        },
        "circle" => Trajectory::Circle { center_m, radius_m: radius()?, period_s: period()? },
        "quadrifolium" => {
            Trajectory::Quadrifolium { center_m, radius_m: radius()?, period_s: period()? }
        }
        "lemniscate" => {
            Trajectory::Lemniscate { center_m, radius_m: radius()?, period_s: period()? }
        }
        "lissajous" => {
            let cycles = table.required_value(keys::Trajectory::cycles)?;
            let cycle_counts = cycles.pair()?.map(|n| n as u32);
            if cycles.pair()? != cycle_counts.map(f64::from) || cycle_counts.contains(&0) {
                return Err(
                    cycles.error_about_key("are no cycles", "expected two whole numbers above 0")
                );
            }
            Trajectory::Lissajous {
                center_m,
                radii_m: table.required_value(keys::Trajectory::radii_m)?.pair()?,
                cycles: cycle_counts,
                phase_rad: table.number(keys::Trajectory::phase_rad)?,
                period_s: period()?,
            }
        }
        "waypoints" => Trajectory::Waypoints(parse_waypoints(&table)?),
        other => unreachable!("{other} is a kind, and read here"),
    };
    Ok((trajectory, keep_heading))
}

/// Parses a path through waypoints. By default it accelerates to its speed within 1 s.
fn parse_waypoints(table: &TableReader<'_, keys::Trajectory>) -> Result<Path, Diagnostic> {
    let points_value = table.required_value(keys::Trajectory::points_m)?;
    let (points, points_m): (Vec<_>, Vec<_>) = points_value.points()?.into_iter().unzip();
    let speed_m_s = table.number(keys::Trajectory::speed_m_s)?;
    let acceleration_m_s2 =
        table.optional_number(keys::Trajectory::acceleration_m_s2)?.unwrap_or(speed_m_s);
    let closed = table.boolean(keys::Trajectory::closed)?;
    let waypoints = Waypoints { points_m, speed_m_s, acceleration_m_s2, closed };
    waypoints.try_into().map_err(|error| match error {
        PathError::WaypointCount(count) => points_value.error_about_key(
            format!("has {count} waypoint{}", if count == 1 { "" } else { "s" }),
            format!("expected 2 to {WAYPOINTS_MAX}; kind = \"still\" stays at a point"),
        ),
        PathError::CoincidentWaypoints(last, 0) => points[last].error_about_key(
            "is the first waypoint again",
            "expected no repetition: a closed path leads back by itself",
        ),
        PathError::CoincidentWaypoints(_, again) => points[again].error_about_key(
            "is the same point as the waypoint before it",
            format!("expected waypoints at least {WAYPOINT_DISTANCE_M_MIN} m from their neighbors"),
        ),
        PathError::InvalidNumber => points_value
            .error_about_key("makes no path", "expected a speed and an acceleration of sane size"),
    })
}
