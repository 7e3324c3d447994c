//! Formation robot: keeps its slot in the formation relative to its in-neighbors. (13) (24) (45)

use formation::Vec2;
use formation::desired::Target;
use formation::frame::LeaderFrame;
use formation::front_point::front_point;
use formation::scale::Scale;
use protocol::brief::AgentBrief;

use super::deputy::Deputy;
use super::{Role, RoleInput, RoleRow, offset_function};
use crate::avoidance::Avoidance;
use crate::laws::situation::NeighborEstimate;

/// Row of the formation role.
pub const FORMATION_ROLE: RoleRow = RoleRow {
    description: protocol::law::Role::FORMATION,
    build: |brief: &AgentBrief| {
        Ok(Box::new(FormationRole {
            has_leader: brief.led,
            scale: brief.scale.clone(),
            period_s: brief.period_ns as f64 / 1e9,
            deputy: Deputy::from_brief(brief)?,
            w_msr: (brief.liars_max() > 0).then(|| WMsrFilter {
                front_point_m: brief.front_point_m,
                desired_velocity: Vec2::zeros(),
            }),
        }))
    },
};

struct FormationRole {
    /// `true` if offsets rotate and scale with a leader's frame.
    has_leader: bool,
    /// Scale delta(t) of a leaderless formation, which every robot evaluates from the run time.
    scale: Option<Scale>,
    /// Control period (T), s.
    period_s: f64,
    /// State as a deputy of the main leader.
    deputy: Option<Deputy>,
    /// State of the W-MSR filter, if the law discards values of Byzantine robots.
    w_msr: Option<WMsrFilter>,
}

/// State of the W-MSR filter.
struct WMsrFilter {
    /// Distance of the front point from the axle (ell), m.
    front_point_m: f64,
    /// Desired velocity (alpha*') at the previous sample, m/s.
    desired_velocity: Vec2,
}

impl Role for FormationRole {
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        if let Some(target) = self.deputy.as_ref().and_then(|deputy| deputy.target(input)) {
            input.estimate_without_offsets(estimates);
            return Some(target);
        }
        let (now_s, later_s) = (input.t_s, input.t_s + 0.5 * self.period_s);
        let (frame, later) = match (self.has_leader, &self.scale) {
            (true, _) => {
                let frame = input.neighborhood.frame_at(input.stamp_ns)?;
                (frame, frame.extrapolate(0.5 * self.period_s))
            }
            (false, Some(scale)) => (
                LeaderFrame::for_leaderless_formation(scale, now_s),
                LeaderFrame::for_leaderless_formation(scale, later_s),
            ),
            (false, None) => (LeaderFrame::IDENTITY, LeaderFrame::IDENTITY),
        };
        input.neighborhood.estimate_neighbors(
            input.stamp_ns,
            offset_function(frame, later),
            estimates,
        );
        let Some(filter) = &mut self.w_msr else {
            return input.neighborhood.desired_target(estimates);
        };
        let own = Target {
            position: front_point(input.pose, filter.front_point_m),
            velocity: filter.desired_velocity,
        };
        let target = input.neighborhood.resilient_desired_target(estimates, own);
        filter.desired_velocity = target.map_or(Vec2::zeros(), |target| target.velocity);
        target
    }

    fn formation_frame(&mut self, input: &RoleInput<'_>, _: &dyn Avoidance) -> Option<LeaderFrame> {
        self.deputy.as_mut()?.frame_while_leading(input)
    }
}
