//! What moves the bodies: exact unicycles, or a physics engine from outside.
//!
//! A motion is told what the wheels of everybody are to do, and says where that leads. Which commands
//! count, what is sensed and what breaks is the world's, whatever moves the bodies.

use std::convert::Infallible;
use std::error::Error;

use formation::pose::{Pose, Twist, wrap_angle};
use formation::unicycle::arc;
use protocol::brief::{LimitsBrief, PlantBrief};

/// Where one body is in `map`, and what it does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// The axle's middle.
    pub pose: Pose,
    /// Forward speed and turn rate, as odometry shows them.
    pub twist: Twist,
}

/// Why bodies could not be moved, in words.
pub type Failure = Box<dyn Error + Send + Sync>;

/// Moves bodies.
pub trait Motion {
    /// Why time could not pass.
    type Error: Into<Failure>;

    /// Lets `dt_s` pass, more than 0 and at most a plant tick. `targets`: the twist that each robot is
    /// to have meanwhile, within its wheels' limits; 0 for one without a command in force. `states`, in
    /// the same order: where the last step left them, or the start; where this one leaves them.
    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [State],
    ) -> Result<(), Self::Error>;
}

/// Exact arcs of unicycles: at once, or with limits as fast as those let them. The guard's promise is
/// made for these.
pub struct Unicycles {
    limits: Vec<Option<LimitsBrief>>,
}

impl Unicycles {
    /// Of every robot of the brief.
    pub fn new(brief: &PlantBrief) -> Unicycles {
        Unicycles { limits: brief.robots.iter().map(|body| body.limits).collect() }
    }
}

impl Motion for Unicycles {
    type Error = Infallible;

    /// On the segment to the target, and on its ray to 0: `proof/Inertia.v::approaches`.
    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [State],
    ) -> Result<(), Infallible> {
        for ((state, &target), limits) in states.iter_mut().zip(targets).zip(&self.limits) {
            let State { pose, twist } = *state;
            let (pose, twist) = match limits {
                None => (arc(pose, target, dt_s), target),
                Some(limits) => {
                    let accelerations = limits.accelerations();
                    accelerations.drive(pose, twist, target, limits.ramp, dt_s)
                }
            };
            *state = State { pose, twist };
        }
        Ok(())
    }
}

/// No place, speed or turn rate of a robot is larger than this, in its SI unit.
const PLAUSIBLE_MAX: f64 = 1e9;

/// A motion of which nothing is taken on trust: what is not finite or not plausible ends the run, by the
/// robot's name, before anybody senses it.
pub struct Checked<M> {
    motion: M,
    names: Vec<String>,
}

impl<M: Motion> Checked<M> {
    /// Of the robots of the brief.
    pub fn new(brief: &PlantBrief, motion: M) -> Checked<M> {
        Checked { motion, names: brief.robots.iter().map(|body| body.name.clone()).collect() }
    }
}

impl<M: Motion> Motion for Checked<M> {
    type Error = Failure;

    fn step(&mut self, targets: &[Twist], dt_s: f64, states: &mut [State]) -> Result<(), Failure> {
        self.motion.step(targets, dt_s, states).map_err(Into::into)?;
        for (state, name) in states.iter_mut().zip(&self.names) {
            let State { pose, twist } = state;
            let numbers = [
                ("x_m", pose.x_m),
                ("y_m", pose.y_m),
                ("heading_rad", pose.heading_rad),
                ("v_m_s", twist.v_m_s),
                ("w_rad_s", twist.w_rad_s),
            ];
            let wrong = |(_, number): &(_, f64)| number.is_nan() || number.abs() > PLAUSIBLE_MAX;
            if let Some((what, value)) = numbers.into_iter().find(wrong) {
                return Err(format!(
                    "the plant moved {name} to {what} = {value}, expected a number of at most 1e9"
                )
                .into());
            }
            pose.heading_rad = wrap_angle(pose.heading_rad);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Goes where it is told, whatever the targets are.
    struct To(State);

    impl Motion for To {
        type Error = Infallible;

        fn step(&mut self, _: &[Twist], _: f64, states: &mut [State]) -> Result<(), Infallible> {
            states[1] = self.0;
            Ok(())
        }
    }

    fn step(x_m: f64, heading_rad: f64, w_rad_s: f64) -> Result<State, String> {
        let to = State {
            pose: Pose { x_m, y_m: 0.0, heading_rad },
            twist: Twist { v_m_s: 0.0, w_rad_s },
        };
        let names = vec!["a".to_owned(), "b".to_owned()];
        let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };
        let mut states = [State { pose: start, twist: Twist::ZERO }; 2];
        let mut checked = Checked { motion: To(to), names };
        let done = checked.step(&[Twist::ZERO; 2], 0.001, &mut states);
        done.map(|()| states[1]).map_err(|error| error.to_string())
    }

    #[test]
    fn a_motion_that_is_none_is_told_with_the_robot_and_the_number() {
        let said = |what: &str| {
            Err(format!("the plant moved b to {what}, expected a number of at most 1e9"))
        };
        assert_eq!(step(f64::NAN, 0.0, 0.0), said("x_m = NaN"));
        assert_eq!(step(0.0, f64::INFINITY, 0.0), said("heading_rad = inf"));
        assert_eq!(step(0.0, 0.0, -1e10), said("w_rad_s = -10000000000"));
    }

    #[test]
    fn a_heading_from_outside_is_wrapped() {
        let state = step(3.0, 7.0, 0.5).unwrap();
        assert_eq!((state.pose.x_m, state.twist.w_rad_s), (3.0, 0.5));
        assert!((state.pose.heading_rad - (7.0 - std::f64::consts::TAU)).abs() < 1e-15);
    }
}
