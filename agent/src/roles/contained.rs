//! Follower of containment control: moves to the mean of its in-neighbors, and so into the convex hull of the
//! leaders. (46) As the deputy of a failed leader it keeps that leader's slot, like a formation robot (an
//! addition to the chapter).

use formation::desired::Target;
use protocol::brief::AgentBrief;

use super::{Role, RoleInput, RoleRow, offsets};
use crate::laws::situation::Heard;

/// Row of the follower role.
pub const CONTAINED: RoleRow = RoleRow {
    description: protocol::law::Role::CONTAINED,
    build: |brief: &AgentBrief| Ok(Box::new(Contained { period_s: brief.period_ns as f64 / 1e9 })),
};

struct Contained {
    /// Control period (T), s.
    period_s: f64,
}

impl Role for Contained {
    fn target(&mut self, moment: &RoleInput<'_>, heard: &mut Vec<Heard>) -> Option<Target> {
        let RoleInput { stamp_ns, neighborhood, .. } = *moment;
        if neighborhood.takes_place() {
            let frame = neighborhood.frame_at(stamp_ns)?;
            let later = frame.extrapolated(0.5 * self.period_s);
            neighborhood.estimate_neighbors(stamp_ns, offsets(frame, later), heard);
        } else {
            moment.recall_without_offsets(heard);
        }
        neighborhood.desired_target(heard)
    }
}
