//! The frames of leaders that others passed on: the main leader's, and those of deputies that lead in its place.

use formation::frame::LeaderFrame;
use protocol::brief::AgentBrief;

/// A leader's frame that somebody passed on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeardFrame {
    /// 0: the main leader's; k: that of the k-th deputy.
    pub rank: u64,
    /// Stamp of the leader's sample that it is from, ns.
    pub stamp_ns: u64,
    /// The frame.
    pub frame: LeaderFrame,
    /// When it came, ns.
    pub(super) heard_ns: u64,
}

/// The newest of each rank, the best rank first.
pub(super) struct Frames {
    heard: Vec<HeardFrame>,
    /// Those of this rank and worse are not listened to: a deputy is led by its betters alone.
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

    /// Takes a frame that somebody passed on, if it is newer than that of the same rank.
    pub(super) fn hear(&mut self, rank: u64, stamp_ns: u64, frame: LeaderFrame, heard_ns: u64) {
        if rank >= self.worse_from {
            return;
        }
        let new = HeardFrame { rank, stamp_ns, frame, heard_ns };
        match self.heard.binary_search_by_key(&rank, |heard| heard.rank) {
            Ok(place) if stamp_ns > self.heard[place].stamp_ns => self.heard[place] = new,
            Ok(_) => {}
            Err(place) => self.heard.insert(place, new),
        }
    }

    /// The newest of the main leader.
    pub(super) fn of_the_main_leader(&self) -> Option<&HeardFrame> {
        self.heard.first().filter(|heard| heard.rank == 0)
    }

    /// That of the best rank that is not lost at `stamp_ns`; of those that all are, the last heard.
    pub(super) fn in_force(&self, stamp_ns: u64) -> Option<&HeardFrame> {
        let silent_ns = |heard: &HeardFrame| stamp_ns.saturating_sub(heard.heard_ns);
        let living = self.heard.iter().find(|heard| silent_ns(heard) <= self.lost_after_ns);
        living.or_else(|| self.heard.iter().min_by_key(|heard| silent_ns(heard)))
    }
}
