//! Who is broken, why, and by how much.

use protocol::number::short;
use serde::Serialize;

use crate::scenario::Robot;
use crate::scenario::diagnostic::listed;

/// No line names more robots than this.
const NAMES_MAX: usize = 24;

/// A robot that ends off its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Broken {
    /// Who, by its place in the scenario.
    pub robot: usize,
    /// Why.
    pub cause: Cause,
    /// How far from its place it settles, m; `None` for one that is left behind.
    pub off_m: Option<f64>,
    /// How far outside the hull of those that lead or keep a place, m, if it is to be inside.
    pub outside_m: Option<f64>,
}

/// Why a robot ends off its place. Robots by their places in the scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// The main leader is dead: nobody follows the trajectory. (Assumptions 3, 5)
    LeaderDead {
        /// The main leader.
        leader: usize,
    },
    /// The main leader lives, but nothing that it says reaches the robot. (Assumptions 3, 5)
    Unled {
        /// The main leader.
        leader: usize,
    },
    /// It stops while the formation goes on: it goes by nobody that it still hears.
    Stops {
        /// Whom it has lost.
        lost: usize,
    },
    /// It goes by the point where it lost somebody, which stays behind.
    Kept {
        /// Whom it has lost.
        lost: usize,
    },
    /// The leader reaches it, but it goes by one who is left behind, too.
    Pulled {
        /// By whom.
        by: usize,
    },
    /// Nobody who leads or keeps a place reaches it: its hull is empty. (Assumption 4)
    Uncontained,
    /// Its place is elsewhere without one that it has lost.
    Without {
        /// Whom it has lost.
        lost: usize,
    },
    /// It takes the place of a leader that it has lost.
    TakesPlace {
        /// Whose.
        of: usize,
    },
    /// It goes by one whose place is elsewhere.
    Follows {
        /// By whom.
        whom: usize,
    },
    /// It wants a place nearer to another than robots come to rest. (Remark 1)
    Taken {
        /// Whose place.
        by: usize,
    },
    /// Another wants a place that near to its own. (Remark 1)
    Crowded {
        /// Who.
        by: usize,
    },
}

impl Cause {
    /// One word for it in files, and the robot that it names.
    pub fn word(self) -> (&'static str, Option<usize>) {
        match self {
            Cause::LeaderDead { leader } => ("leader-dead", Some(leader)),
            Cause::Unled { leader } => ("unled", Some(leader)),
            Cause::Stops { lost } => ("stops", Some(lost)),
            Cause::Kept { lost } => ("kept", Some(lost)),
            Cause::Pulled { by } => ("pulled", Some(by)),
            Cause::Uncontained => ("uncontained", None),
            Cause::Without { lost } => ("without", Some(lost)),
            Cause::TakesPlace { of } => ("takes-place", Some(of)),
            Cause::Follows { whom } => ("follows", Some(whom)),
            Cause::Taken { by } => ("place-taken", Some(by)),
            Cause::Crowded { by } => ("crowded", Some(by)),
        }
    }

    /// It in words that suit one robot and several, with the names that `name` gives robots.
    pub fn words<'s>(self, name: impl Fn(usize) -> &'s str) -> String {
        match self {
            Cause::LeaderDead { leader } => format!("the leader {} is dead", name(leader)),
            Cause::Unled { leader } => format!("not reached by the leader {}", name(leader)),
            Cause::Stops { lost } => format!("no in-neighbor left without {}", name(lost)),
            Cause::Kept { lost } => format!("follows the last known point of {}", name(lost)),
            Cause::Pulled { by } => format!("held back by {}, which is left behind", name(by)),
            Cause::Uncontained => "an empty hull: nobody who leads or keeps a place".to_owned(),
            Cause::Without { lost } => format!("place elsewhere without {}", name(lost)),
            Cause::TakesPlace { of } => format!("takes the place of {}", name(of)),
            Cause::Follows { whom } => format!("follows {}, itself off its place", name(whom)),
            Cause::Taken { by } => format!("wants {}'s place (Remark 1)", name(by)),
            Cause::Crowded { by } => format!("{} wants the same place (Remark 1)", name(by)),
        }
    }
}

/// The same with names, as files have it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BrokenRobot<'s> {
    /// Who.
    pub robot: &'s str,
    /// [`Cause::word`].
    pub cause: &'static str,
    /// Whom that names.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<&'s str>,
    /// How far from its place it settles, m, if it is not left behind.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub off_m: Option<f64>,
    /// How far outside the hull it settles, m, if it does and should not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outside_m: Option<f64>,
    /// [`Broken::why`].
    pub why: String,
}

impl Broken {
    /// Why, in words.
    pub fn why<'s>(&self, name: impl Fn(usize) -> &'s str) -> String {
        let why = self.cause.words(name);
        match self.outside_m {
            Some(outside_m) => format!("{why}, {} m outside the hull", short(outside_m)),
            None => why,
        }
    }

    /// It with the names of these robots.
    pub fn named<'s>(&self, robots: &'s [Robot]) -> BrokenRobot<'s> {
        let name = |i: usize| robots[i].name.as_str();
        let (cause, by) = self.cause.word();
        BrokenRobot {
            robot: name(self.robot),
            cause,
            by: by.map(name),
            off_m: self.off_m,
            outside_m: self.outside_m,
            why: self.why(name),
        }
    }
}

/// What broken means, in words, for whoever is to be told who is.
pub fn broken_means(bound_m: f64) -> String {
    format!(
        "a robot is broken if, when the fault ends (one for good: at the end of the run), it is more than {} m \
         from the place that the plan gives it in the formation",
        short(bound_m)
    )
}

/// Who and why, one line for all whom the same befalls: `r1, r2: the leader r5 is dead`.
pub fn lines<'a>(broken: impl IntoIterator<Item = (&'a str, String)>) -> Vec<String> {
    let mut lines: Vec<(String, Vec<&str>)> = Vec::new();
    for (robot, why) in broken {
        match lines.iter_mut().find(|(same, _)| *same == why) {
            Some((_, robots)) => robots.push(robot),
            None => lines.push((why, vec![robot])),
        }
    }
    lines
        .into_iter()
        .map(|(why, robots)| format!("{}: {why}", listed(&robots, NAMES_MAX)))
        .collect()
}
