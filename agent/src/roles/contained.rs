//! Goes to the middle of those it hears, and so into the leaders' hull. (46)

use formation::desired::Target;
use protocol::brief::AgentBrief;

use super::{Moment, Role, RoleRow};
use crate::laws::situation::Heard;

/// The row of the contained.
pub const CONTAINED: RoleRow = RoleRow {
    description: protocol::law::Role::CONTAINED,
    build: |_: &AgentBrief| Ok(Box::new(Contained)),
};

struct Contained;

impl Role for Contained {
    fn target(&mut self, moment: &Moment<'_>, heard: &mut Vec<Heard>) -> Option<Target> {
        moment.recall_without_offsets(heard);
        moment.neighborhood.desired(heard)
    }
}
