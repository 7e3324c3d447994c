//! Points at which a trajectory stops and reverses. The leader turns around after such a point, and the formation turns
//! by 180 degrees with it.

use formation::ns_to_seconds;
use formation::{Vec2, portable_math};

use super::finding::{Finding, warning_finding};
use super::steady::leader_motion_samples;
use crate::scenario::Scenario;
use protocol::number::format_short;

/// Length of a step along the trajectory, s. Longer if the run would otherwise take more than [`STEPS_MAX`] steps.
const STEP_S: f64 = 5e-3;
/// Maximum number of steps.
const STEPS_MAX: f64 = 200_000.0;
/// Cosine of the maximum angle between heading and velocity for a leader that has settled on its path.
const SETTLED_ANGLE_COS_MIN: f64 = 0.5;

/// Reversals of a trajectory within the run.
#[derive(Debug, Clone, PartialEq)]
struct Reversals {
    /// Time of the first reversal, s.
    first_reversal_s: f64,
    /// Position of the first reversal, m.
    first_position: Vec2,
    /// Number of reversals.
    count: usize,
}

/// Warns if the formation turns by 180 degrees after a point where the trajectory reverses.
pub(super) fn check_reversals(scenario: &Scenario) -> Vec<Finding> {
    let keeps_heading = scenario.lead.as_ref().is_none_or(|lead| lead.keep_heading);
    let has_offsets = scenario.formation_edges().any(|(_, edge)| edge.offset_m.norm() > 0.0);
    if keeps_heading || !has_offsets {
        return Vec::new();
    }
    let Some(Reversals { first_reversal_s, first_position, count }) = find_reversals(scenario)
    else {
        return Vec::new();
    };
    let [x, y] =
        [first_position.x, first_position.y].map(|m| format_short((m * 1e3).round() / 1e3));
    let repetitions = match count {
        1 => String::new(),
        n => format!(", and {} more times until the end", n - 1),
    };
    let t = format_short((first_reversal_s * 1e2).round() / 1e2);
    vec![warning_finding(
        "trajectory",
        format!(
            "reverses at {t} s, at ({x}, {y}) m{repetitions}: the leader turns around there, and the formation turns by 180 \
             degrees with it"
        ),
        "expected `keep_heading = true`, with which the formation keeps its heading there, or a path that \
         does not lead back along itself",
    )]
}

/// Returns the reversals of the main leader's trajectory; `None` if there are none.
fn find_reversals(scenario: &Scenario) -> Option<Reversals> {
    let leader = scenario.leader()?;
    let duration_s = ns_to_seconds(scenario.duration_ns);
    let step_s = (duration_s / STEPS_MAX).max(STEP_S).min(duration_s);
    let steps = (duration_s / step_s) as usize;
    let start_rad = scenario.robots[leader].start.heading_rad;
    let mut found: Option<Reversals> = None;
    let mut is_settled = false;
    for (t_s, target, frame) in leader_motion_samples(scenario, start_rad, step_s, steps)? {
        let ahead =
            Vec2::new(portable_math::cos(frame.heading_rad), portable_math::sin(frame.heading_rad));
        let cosine = target.velocity.dot(&ahead) / target.velocity.norm();
        // At rest the cosine is NaN, and the comparison is false.
        if cosine > SETTLED_ANGLE_COS_MIN {
            is_settled = true;
        } else if is_settled && cosine < 0.0 {
            is_settled = false;
            let first =
                Reversals { first_reversal_s: t_s, first_position: target.position, count: 0 };
            found.get_or_insert(first).count += 1;
        }
    }
    found
}
