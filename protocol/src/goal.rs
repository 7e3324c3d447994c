//! Reasons for which a goal from outside is refused: the indices of [`crate::message::GoalCounts::refused`].

use crate::message::GoalCounts;
use crate::wire_enum::nonzero_counts;

wire_enum! {
    /// Reason for which a goal was refused: the first of these that applies.
    RefusalReason: usize {
        /// The message does not have the layout of its type.
        Layout = 0 "layout",
        /// A number is infinite or NaN.
        NotFinite = 1 "not-finite",
        /// The frame is not `map`.
        WrongFrame = 2 "frame",
        /// The goal is farther from the origin than the coordinate limit.
        Far = 3 "far",
        /// A closed wall lies between the robot's start and the goal.
        BehindWall = 4 "outside",
        /// The goal is closer to a wall or obstacle than the clearance.
        TooCloseToWall = 5 "blocked",
    }
}

impl GoalCounts {
    /// Counts a refused goal.
    pub fn count_refusal(&mut self, why: RefusalReason) {
        self.refused[why as usize] += 1;
    }

    /// Returns the nonzero counts of refused goals, with their keywords.
    pub fn refused_counts(&self) -> impl Iterator<Item = (&'static str, u64)> {
        nonzero_counts(RefusalReason::ALL.map(RefusalReason::keyword), &self.refused)
    }
}
