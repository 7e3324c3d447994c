//! An agent whose law is somebody else's, in whatever language: the law is asked for two numbers, and
//! everything else is the agent of every robot.
//!
//! A law that has no answer is told of and ends the process on the spot, as a kill does: its ports stay
//! until the supervisor has seen it die, and what it said last reaches everybody. The agent's loop knows
//! laws that answer, and no others.

use std::path::Path;

use formation::Vec2;
use formation::front_point::front_velocity;
use formation::pose::Twist;
use protocol::brief::{self, AgentBrief, VERSION};
use protocol::process::{self, exit};

use crate::brain::Parts;
use crate::control_loop;
use crate::laws::{Law, Situation, Wish};

/// The exit code of a process whose law has no answer: also Python's own for an exception.
pub const LAW_FAILED: u8 = 1;

/// What the two numbers of an answer are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// gamma, the velocity of the front point: (x, y), m/s, in `map`.
    Law,
    /// The body's twist: (v, w), m/s and rad/s.
    Controller,
}

impl Level {
    /// What the function is called that answers.
    pub fn method(self) -> &'static str {
        match self {
            Level::Law => "gamma",
            Level::Controller => "twist",
        }
    }

    /// What is expected of it, in words.
    pub fn expected(self) -> &'static str {
        match self {
            Level::Law => "two finite numbers (x, y) in m/s",
            Level::Controller => "two finite numbers (v, w) in m/s and rad/s",
        }
    }

    /// What the brain is to do about an answer.
    pub fn wish(self, [first, second]: [f64; 2]) -> Wish {
        match self {
            Level::Law => Wish::Velocity(Vec2::new(first, second)),
            Level::Controller => Wish::Twist(Twist { v_m_s: first, w_rad_s: second }),
        }
    }
}

/// Somebody else's law.
pub trait ForeignLaw: Send {
    /// What its two numbers are.
    fn level(&self) -> Level;

    /// Two finite numbers; or why there are none, as a user is told it.
    fn ask(&mut self, situation: &Situation<'_>) -> Result<[f64; 2], String>;
}

/// Moves the robot of this brief by a law that `make` makes, until told to stop; the exit code. `of`: what
/// must be of one version with the program that wrote the brief, in words.
pub fn main<L: ForeignLaw + 'static>(
    brief: &Path,
    incarnation: u64,
    realtime_priority: bool,
    of: &str,
    make: impl FnOnce(&AgentBrief) -> Result<L, String>,
) -> u8 {
    if is_of_another_version(brief, of) {
        return exit::INFRASTRUCTURE;
    }
    control_loop::main_with(brief, incarnation, realtime_priority, |brief| parts(brief, make))
}

/// The brief of a robot whose law is in a program; or what is to be said. `of`: as of [`main`].
pub fn read(brief: &Path, of: &str) -> Result<AgentBrief, String> {
    match other_version(brief, of) {
        Some(why) => Err(why),
        None => brief::read(brief).map_err(|error| error.to_string()),
    }
}

/// Whether another version of phalanx wrote the brief of a program, which is told. `of`: as of [`main`].
pub fn is_of_another_version(brief: &Path, of: &str) -> bool {
    let Some(why) = other_version(brief, of) else { return false };
    process::log_to_stderr();
    tracing::error!("{why}");
    true
}

/// That another version wrote the brief, if so: no more can be read of it.
fn other_version(brief: &Path, of: &str) -> Option<String> {
    let writer = brief::writer(brief).filter(|writer| writer != VERSION)?;
    Some(format!(
        "phalanx {writer} starts this program, and {of} is phalanx {VERSION}: install both from the \
         same release"
    ))
}

fn parts<L: ForeignLaw + 'static>(
    brief: &AgentBrief,
    make: impl FnOnce(&AgentBrief) -> Result<L, String>,
) -> Result<Parts, String> {
    if brief.program.is_none() {
        return Err(format!(
            "the brief of {} names the law {:?}, which is built into phalanx: it is for `phalanx agent`",
            brief.name, brief.law
        ));
    }
    Parts::with_law(brief, Box::new(Asked(make(brief)?))).map_err(|error| error.to_string())
}

/// A law of somebody else's as the brain knows laws.
struct Asked<L>(L);

impl<L: ForeignLaw> Law for Asked<L> {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        match self.wish(situation) {
            Wish::Velocity(gamma) => gamma,
            Wish::Twist(twist) => {
                let pose = situation.pose;
                let ell_m = (situation.front_point - Vec2::new(pose.x_m, pose.y_m)).norm();
                front_velocity(pose.heading_rad, ell_m, twist)
            }
        }
    }

    fn wish(&mut self, situation: &Situation<'_>) -> Wish {
        let answer = self.0.ask(situation).unwrap_or_else(|why| {
            tracing::error!("{why}");
            std::process::exit(LAW_FAILED.into())
        });
        self.0.level().wish(answer)
    }
}
