//! Agent with a control law in another language: the law returns two numbers, and everything else is the
//! regular agent.
//!
//! If the law returns no valid answer, the error is logged and the process exits at once, like a killed
//! process: its ports stay until the supervisor has detected the exit, and its last beacon reaches all
//! receivers. The control loop therefore handles only laws that answer.

use std::path::Path;

use formation::Vec2;
use formation::desired::Target;
use formation::drive::DriveKind;
use formation::front_point::front_velocity;
use formation::pose::Twist;
use protocol::brief::{self, AgentBrief, VERSION};
use protocol::process::{self, exit};

use crate::control_loop;
use crate::controller::Parts;
use crate::laws::{Law, LawOutput, SendDecision, SignalValues, Situation};

/// Exit code of a process whose law failed. Python uses the same code for an uncaught exception.
pub const LAW_FAILED_EXIT_CODE: u8 = 1;

/// Meaning of the numbers of an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnswerKind {
    /// Velocity of the front point (gamma): (x, y), m/s, in `map`.
    FrontPointVelocity,
    /// Twist of the body: (v, w), m/s and rad/s.
    BodyTwist,
    /// Twist of an omnidirectional body: (v, side, w), m/s, m/s to the left, and rad/s.
    OmniBodyTwist,
}

impl AnswerKind {
    /// Returns the kind of answer of a controller for a robot with this drive.
    pub fn twist_kind_for_drive(drive: DriveKind) -> AnswerKind {
        match drive {
            DriveKind::Differential | DriveKind::Ackermann => AnswerKind::BodyTwist,
            DriveKind::Omni => AnswerKind::OmniBodyTwist,
        }
    }

    /// Returns the name of the method that computes the answer.
    pub fn method_name(self) -> &'static str {
        match self {
            AnswerKind::FrontPointVelocity => "gamma",
            AnswerKind::BodyTwist | AnswerKind::OmniBodyTwist => "twist",
        }
    }

    /// Returns a description of the expected answer.
    pub fn expected_answer(self) -> &'static str {
        match self {
            AnswerKind::FrontPointVelocity => "two finite numbers (x, y) in m/s",
            AnswerKind::BodyTwist => "two finite numbers (v, w) in m/s and rad/s",
            AnswerKind::OmniBodyTwist => {
                "three finite numbers (v, side, w) in m/s, m/s and rad/s, because the robot has `drive = \"omni\"`"
            }
        }
    }

    /// Converts an answer to the output of a control law. Returns `None` for a wrong count of numbers, and for numbers
    /// that are not finite.
    pub fn parse_law_output(self, answer: &[f64]) -> Option<LawOutput> {
        if !answer.iter().all(|number| number.is_finite()) {
            return None;
        }
        match (self, answer) {
            (AnswerKind::FrontPointVelocity, &[x, y]) => Some(LawOutput::Velocity(Vec2::new(x, y))),
            (AnswerKind::BodyTwist, &[v_m_s, w_rad_s]) => {
                Some(LawOutput::Twist(Twist::new(v_m_s, w_rad_s)))
            }
            (AnswerKind::OmniBodyTwist, &[v_m_s, side_m_s, w_rad_s]) => {
                Some(LawOutput::Twist(Twist { v_m_s, side_m_s, w_rad_s }))
            }
            _ => None,
        }
    }
}

/// A control law in another language.
pub trait ForeignLaw: Send {
    /// Returns the output of the law, or an error message for the user.
    fn evaluate(&mut self, situation: &Situation<'_>) -> Result<LawOutput, String>;

    /// Returns the target of a free robot, see [`Law::target`].
    fn target(&mut self) -> Option<Target> {
        None
    }

    /// Returns what leaves to the out-neighbors with the last answer; checked against the brief. See
    /// [`Law::send_decision`].
    fn send_decision(&mut self) -> SendDecision {
        SendDecision::Beacon
    }

    /// Returns the signals that the law has recorded with the last answer. See [`Law::signals`].
    fn signals(&mut self) -> SignalValues {
        SignalValues::NONE
    }
}

/// Runs the robot of this brief with the law that `make` creates, until a stop is requested. Returns the exit
/// code. `of` describes the package that must have the same version as the program that wrote the brief.
pub fn main<L: ForeignLaw + 'static>(
    brief: &Path,
    incarnation: u64,
    realtime_priority: bool,
    of: &str,
    make: impl FnOnce(&AgentBrief) -> Result<L, String>,
) -> u8 {
    if is_version_mismatch(brief, of) {
        return exit::INFRASTRUCTURE_FAILURE;
    }
    control_loop::main_with_parts(brief, incarnation, realtime_priority, |brief| {
        parts_with_foreign_law(brief, make)
    })
}

/// Reads the brief of a robot whose law is a program. Returns an error message for the user if it cannot be
/// read or is of another version. `of` is as in [`main`].
pub fn read_brief(brief: &Path, of: &str) -> Result<AgentBrief, String> {
    match version_mismatch_message(brief, of) {
        Some(why) => Err(why),
        None => brief::read(brief).map_err(|error| error.to_string()),
    }
}

/// Returns whether another version of phalanx wrote the brief, and logs an error if so. `of` is as in [`main`].
pub fn is_version_mismatch(brief: &Path, of: &str) -> bool {
    let Some(why) = version_mismatch_message(brief, of) else { return false };
    process::log_to_stderr();
    tracing::error!("{why}");
    true
}

/// Returns an error message if another version wrote the brief, of which nothing more can be read then.
fn version_mismatch_message(brief: &Path, of: &str) -> Option<String> {
    let writer = brief::read_writer_version(brief).filter(|writer| writer != VERSION)?;
    Some(format!(
        "phalanx {writer} starts this program, but {of} is phalanx {VERSION}: install both from the \
         same release"
    ))
}

fn parts_with_foreign_law<L: ForeignLaw + 'static>(
    brief: &AgentBrief,
    make: impl FnOnce(&AgentBrief) -> Result<L, String>,
) -> Result<Parts, String> {
    if brief.program.is_none() {
        return Err(format!(
            "the brief of {} names the law {:?}, which is built into phalanx: it is for `phalanx agent`",
            brief.name, brief.law
        ));
    }
    Parts::with_law(brief, Box::new(ForeignLawAdapter(make(brief)?)))
        .map_err(|error| error.to_string())
}

/// Adapter from a foreign law to [`Law`]. It exits the process if the law fails.
struct ForeignLawAdapter<L>(L);

impl<L: ForeignLaw> Law for ForeignLawAdapter<L> {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        match self.output(situation) {
            LawOutput::Velocity(gamma) => gamma,
            LawOutput::Twist(twist) => {
                let pose = situation.pose;
                let ell_m = (situation.front_point - Vec2::new(pose.x_m, pose.y_m)).norm();
                front_velocity(pose.heading_rad, ell_m, twist)
            }
        }
    }

    fn output(&mut self, situation: &Situation<'_>) -> LawOutput {
        self.0.evaluate(situation).unwrap_or_else(|why| {
            tracing::error!("{why}");
            std::process::exit(LAW_FAILED_EXIT_CODE.into())
        })
    }

    fn target(&mut self) -> Option<Target> {
        self.0.target()
    }

    fn send_decision(&mut self) -> SendDecision {
        self.0.send_decision()
    }

    fn signals(&mut self) -> SignalValues {
        self.0.signals()
    }
}
