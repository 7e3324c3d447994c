//! An example role: its target is the mean position of the in-neighbors that are not stale.

use formation::Vec2;
use formation::desired::{Target, mean_target};
use protocol::law::Role as Description;
use protocol::message::ReceptionState;

use super::{NeighborEstimate, Role, RoleInput, RoleRow};

pub const CONTAINED_FRESH: RoleRow = RoleRow {
    description: Description { name: "contained-fresh", ..Description::CONTAINED },
    build: |_| Ok(Box::new(ContainedFresh)),
};

struct ContainedFresh;

impl Role for ContainedFresh {
    fn target(
        &mut self,
        input: &RoleInput<'_>,
        estimates: &mut Vec<NeighborEstimate>,
    ) -> Option<Target> {
        let no_offset = Target::at_rest(Vec2::zeros());
        input.neighborhood.estimate_neighbors(input.stamp_ns, |_| no_offset, estimates);
        let fresh =
            estimates.iter().filter(|neighbor| neighbor.reception_state == ReceptionState::Fresh);
        mean_target(fresh.map(|&NeighborEstimate { position, velocity, offset, .. }| {
            (Target { position, velocity }, offset)
        }))
    }
}
