//! Why a goal from outside is refused: the places of [`crate::message::GoalCounts::refused`].

use crate::message::GoalCounts;

/// Why a goal was refused. Each has one reason: the first of these that holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Refused {
    /// It is not laid out as its type says.
    Layout = 0,
    /// A number in it is none: infinite, or not a number.
    NotFinite = 1,
    /// It is in another frame than the run.
    Frame = 2,
    /// It is farther from the origin than any front point may be.
    Far = 3,
    /// A closed wall is between the robot's start and it.
    Outside = 4,
    /// It is nearer to a wall or obstacle than the clearance.
    Blocked = 5,
}

impl Refused {
    /// All, in the order of their numbers.
    pub const ALL: [Refused; 6] = [
        Refused::Layout,
        Refused::NotFinite,
        Refused::Frame,
        Refused::Far,
        Refused::Outside,
        Refused::Blocked,
    ];

    /// The word for it in files.
    pub fn word(self) -> &'static str {
        match self {
            Refused::Layout => "layout",
            Refused::NotFinite => "not-finite",
            Refused::Frame => "frame",
            Refused::Far => "far",
            Refused::Outside => "outside",
            Refused::Blocked => "blocked",
        }
    }
}

impl GoalCounts {
    /// One more was refused.
    pub fn refuse(&mut self, why: Refused) {
        self.refused[why as usize] += 1;
    }

    /// How many were refused, with the words for why, without those that were none.
    pub fn refused_in_words(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let all = Refused::ALL.into_iter().map(|why| (why.word(), self.refused[why as usize]));
        all.filter(|&(_, count)| count > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_reason_has_a_word_and_a_place_of_its_own() {
        let mut counts = GoalCounts::default();
        for (place, why) in Refused::ALL.into_iter().enumerate() {
            assert_eq!(why as usize, place);
            (0..=place).for_each(|_| counts.refuse(why));
        }
        let told: Vec<_> = counts.refused_in_words().collect();
        assert!(told.iter().enumerate().all(|(place, (_, count))| *count == place as u64 + 1));
        let words: std::collections::BTreeSet<_> = told.iter().map(|(word, _)| word).collect();
        assert_eq!(words.len(), Refused::ALL.len());
    }
}
