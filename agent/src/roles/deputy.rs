//! Deputy (backup leader) of the main leader: while it receives no frame of a better rank, it leads from its
//! own slot in the formation. It continues the last received frame, so that the followers see no jump, and two
//! deputies that lead at the same time in two partitions of the network use the same frame. An addition to the
//! chapter.

use formation::Vec2;
use formation::desired::Target;
use formation::drive::Drive;
use formation::frame::LeaderFrame;
use protocol::brief::{AgentBrief, DeputyBrief, LeadBrief};
use protocol::message::ReceptionState;

use super::RoleInput;
use super::nominal_frame::NominalFrameGenerator;
use crate::UnfitBrief;
use crate::avoidance::{self, Avoidance};

/// State of a deputy.
pub(super) struct Deputy {
    lead_brief: LeadBrief,
    /// Slot relative to the main leader, at heading 0 and scale 1, m.
    slot_offset: Vec2,
    /// Control period (T), s.
    period_s: f64,
    /// Avoidance method of a leader with the main leader's front point, which determines how it would follow
    /// m(t).
    leader_avoidance: Box<dyn Avoidance>,
    /// Drive of the main leader.
    leader_drive: Drive,
    /// Generator of the leader frame while this robot leads, and the frame at the newest sample.
    own_frame: Option<(NominalFrameGenerator, TimedFrame)>,
}

/// A frame and its run time, s.
#[derive(Clone, Copy)]
struct TimedFrame {
    t_s: f64,
    frame: LeaderFrame,
}

impl Deputy {
    /// Creates the deputy described in the brief, or `None` if there is none. Returns an error if the leader's
    /// avoidance method cannot be created.
    pub(super) fn from_brief(brief: &AgentBrief) -> Result<Option<Deputy>, UnfitBrief> {
        let Some(deputy) = &brief.deputy else { return Ok(None) };
        let &DeputyBrief { place_m, ref lead, .. } = deputy;
        let leader_brief = AgentBrief {
            front_point_m: deputy.front_point_m,
            drive_kind: deputy.drive_kind,
            turn_rate_max_rad_s: deputy.turn_rate_max_rad_s,
            turning_radius_min_m: deputy.turning_radius_min_m,
            limits: deputy.limits,
            ..brief.clone()
        };
        Ok(Some(Deputy {
            lead_brief: lead.clone(),
            slot_offset: place_m.into(),
            period_s: brief.period_ns as f64 / 1e9,
            leader_drive: leader_brief.drive(),
            leader_avoidance: avoidance::build(&leader_brief)?,
            own_frame: None,
        }))
    }

    /// Returns the target (alpha*) while this robot leads: the robot's slot relative to m(t). Returns `None` while a
    /// frame of a better rank is received, or if none ever was.
    pub(super) fn target(&self, input: &RoleInput<'_>) -> Option<Target> {
        let TimedFrame { t_s, frame } = self.newest_known_frame(input)?;
        let (now, half_s) = (frame.extrapolate(input.t_s - t_s), 0.5 * self.period_s);
        let LeadBrief { trajectory, .. } = &self.lead_brief;
        let position = trajectory.target_at(input.t_s).position
            + now.transform_offset(self.slot_offset).position;
        let velocity = trajectory.target_at(input.t_s + half_s).velocity
            + now.extrapolate(half_s).transform_offset(self.slot_offset).velocity;
        Some(Target { position, velocity })
    }

    /// Returns the frame that this robot sends to others while it leads.
    pub(super) fn frame_while_leading(&mut self, input: &RoleInput<'_>) -> Option<LeaderFrame> {
        let Some(known) = self.newest_known_frame(input) else {
            self.own_frame = None;
            return None;
        };
        let (mut nominal, _) = self.own_frame.take().unwrap_or_else(|| {
            (
                NominalFrameGenerator::continue_from(
                    self.period_s,
                    self.leader_drive,
                    known.t_s,
                    known.frame,
                ),
                known,
            )
        });
        let heading_rad = known.frame.heading_rad;
        let frame =
            nominal.advance(input.t_s, heading_rad, &self.lead_brief, &*self.leader_avoidance);
        self.own_frame = Some((nominal, TimedFrame { t_s: input.t_s, frame }));
        Some(frame)
    }

    /// Returns the newest known frame while it leads: its own, or the last received of a better rank.
    fn newest_known_frame(&self, input: &RoleInput<'_>) -> Option<TimedFrame> {
        if input.neighborhood.leader_frame_reception().state != ReceptionState::Lost {
            return None;
        }
        self.own_frame.as_ref().map(|(_, known)| *known).or_else(|| {
            let received = input.neighborhood.frame_in_force(input.stamp_ns)?;
            Some(TimedFrame { t_s: input.run_time_s(received.stamp_ns), frame: received.frame })
        })
    }
}
