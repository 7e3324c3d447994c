use agent::controller::Parts;
use agent::laws::{Law, Situation};
use agent::roles::FORMATION_ROLE;
use agent::{UnfitBrief, avoidance, control_loop};
use formation::Vec2;
use protocol::brief::AgentBrief;

/// A law like a spring with an integrator. Its gains are private to the program.
struct Sprung {
    integral: Vec2,
}

impl Law for Sprung {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let e = situation.error.cap_magnitude(0.2);
        self.integral = (self.integral + situation.period_s * e).cap_magnitude(0.05);
        -0.8 * e - 0.1 * self.integral
    }
}

pub fn parts(brief: &AgentBrief) -> Result<Parts, UnfitBrief> {
    Ok(Parts {
        role: FORMATION_ROLE.make(brief)?,
        law: Box::new(Sprung { integral: Vec2::zeros() }),
        avoidance: avoidance::build(brief)?,
    })
}

/// Runs the robot for `PROGRAM agent BRIEF --incarnation N` in `main`. Returns the exit code.
pub fn agent(brief: &std::path::Path, incarnation: u64) -> u8 {
    control_loop::main_with_parts(brief, incarnation, false, parts)
}
