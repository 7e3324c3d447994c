//! Why a goal from outside is refused: the places of [`crate::message::GoalCounts::refused`].

use crate::message::GoalCounts;
use crate::numbered::in_words;

numbered! {
    /// Why a goal was refused. Each has one reason: the first of these that holds.
    Refused: usize {
        /// It is not laid out as its type says.
        Layout = 0 "layout",
        /// A number in it is none: infinite, or not a number.
        NotFinite = 1 "not-finite",
        /// It is in another frame than the run.
        Frame = 2 "frame",
        /// It is farther from the origin than any front point may be.
        Far = 3 "far",
        /// A closed wall is between the robot's start and it.
        Outside = 4 "outside",
        /// It is nearer to a wall or obstacle than the clearance.
        Blocked = 5 "blocked",
    }
}

impl GoalCounts {
    /// One more was refused.
    pub fn refuse(&mut self, why: Refused) {
        self.refused[why as usize] += 1;
    }

    /// How many were refused, with the words for why, without those that were none.
    pub fn refused_in_words(&self) -> impl Iterator<Item = (&'static str, u64)> {
        in_words(Refused::ALL.map(Refused::word), &self.refused)
    }
}
