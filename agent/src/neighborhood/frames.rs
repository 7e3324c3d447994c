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
    pub(super) heard_ns: u64,
}

/// Newest received frame of each rank, best rank first.
pub(super) struct Frames {
    heard: Vec<ReceivedFrame>,
    /// Frames of this rank and worse are ignored: a deputy follows only leaders of better rank.
    worse_from: u64,
    lost_after_ns: u64,
}

impl Frames {
    pub(super) fn new(brief: &AgentBrief) -> Frames {
        Frames {
            heard: Vec::new(),
            worse_from: brief.deputy.as_ref().map_or(u64::MAX, |deputy| deputy.rank),
            lost_after_ns: brief.silence.lost_after_ns,
        }
    }

    /// Stores a received frame if it is newer than the stored frame of its rank.
    pub(super) fn store_frame(
        &mut self,
        rank: u64,
        stamp_ns: u64,
        frame: LeaderFrame,
        heard_ns: u64,
    ) {
        if rank >= self.worse_from {
            return;
        }
        let new = ReceivedFrame { rank, stamp_ns, frame, heard_ns };
        match self.heard.binary_search_by_key(&rank, |heard| heard.rank) {
            Ok(place) if stamp_ns > self.heard[place].stamp_ns => self.heard[place] = new,
            Ok(_) => {}
            Err(place) => self.heard.insert(place, new),
        }
    }

    /// Returns the newest frame of the main leader.
    pub(super) fn main_leader_frame(&self) -> Option<&ReceivedFrame> {
        self.heard.first().filter(|heard| heard.rank == 0)
    }

    /// Returns the frame of the best rank that is not lost at `stamp_ns`, or the last received if all are lost.
    pub(super) fn in_force(&self, stamp_ns: u64) -> Option<&ReceivedFrame> {
        let silent_ns = |heard: &ReceivedFrame| stamp_ns.saturating_sub(heard.heard_ns);
        let living = self.heard.iter().find(|heard| silent_ns(heard) <= self.lost_after_ns);
        living.or_else(|| self.heard.iter().min_by_key(|heard| silent_ns(heard)))
    }
}
