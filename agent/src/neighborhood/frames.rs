//! Received leader frames: of the main leader, and of deputies (backup leaders) that lead in its place.

use formation::frame::LeaderFrame;
use protocol::brief::AgentBrief;

/// A received leader frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReceivedFrame {
    /// Rank of the leader: 0 for the main leader, k for the k-th deputy.
    pub rank: u64,
    /// Stamp of the leader's sample from which the frame was computed, ns.
    pub stamp_ns: u64,
    /// Position and motion of the frame at the stamp.
    pub frame: LeaderFrame,
    /// Time of reception, ns.
    pub(super) received_ns: u64,
}

/// Newest received frame of each rank, best rank first.
pub(super) struct ReceivedFrames {
    received_frames: Vec<ReceivedFrame>,
    /// Frames of this rank and worse are ignored: a deputy follows only leaders of better rank.
    ignored_from_rank: u64,
    lost_after_ns: u64,
}

impl ReceivedFrames {
    pub(super) fn new(brief: &AgentBrief) -> ReceivedFrames {
        ReceivedFrames {
            received_frames: Vec::new(),
            ignored_from_rank: brief.deputy.as_ref().map_or(u64::MAX, |deputy| deputy.rank),
            lost_after_ns: brief.silence.lost_after_ns,
        }
    }

    /// Stores a received frame if it is newer than the stored frame of its rank.
    pub(super) fn store_frame(
        &mut self,
        rank: u64,
        stamp_ns: u64,
        frame: LeaderFrame,
        received_ns: u64,
    ) {
        if rank >= self.ignored_from_rank {
            return;
        }
        let new_frame = ReceivedFrame { rank, stamp_ns, frame, received_ns };
        match self.received_frames.binary_search_by_key(&rank, |frame| frame.rank) {
            Ok(index) if stamp_ns > self.received_frames[index].stamp_ns => {
                self.received_frames[index] = new_frame
            }
            Ok(_) => {}
            Err(index) => self.received_frames.insert(index, new_frame),
        }
    }

    /// Returns the newest frame of the main leader.
    pub(super) fn main_leader_frame(&self) -> Option<&ReceivedFrame> {
        self.received_frames.first().filter(|frame| frame.rank == 0)
    }

    /// Returns the frame of the best rank that is not lost at `stamp_ns`, or the last received if all are lost.
    pub(super) fn frame_in_force(&self, stamp_ns: u64) -> Option<&ReceivedFrame> {
        let silent_ns = |frame: &ReceivedFrame| stamp_ns.saturating_sub(frame.received_ns);
        let alive =
            self.received_frames.iter().find(|frame| silent_ns(frame) <= self.lost_after_ns);
        alive.or_else(|| self.received_frames.iter().min_by_key(|frame| silent_ns(frame)))
    }
}
