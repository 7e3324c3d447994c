//! Motion of the bodies: exact unicycles, or an external physics engine.
//!
//! A motion receives the target twists of all robots and returns the resulting states. Accepting commands,
//! sensing and faults are the responsibility of [`World`](crate::world::World), for every motion.

use std::convert::Infallible;
use std::error::Error;

use formation::pose::{Pose, Twist, wrap_angle};
use formation::unicycle::arc;
use protocol::brief::{LimitsBrief, PlantBrief};

/// Pose and twist of one body in `map`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Pose of the axle midpoint.
    pub pose: Pose,
    /// Twist, as reported by odometry.
    pub twist: Twist,
}

/// Reason why the bodies could not be moved.
pub type Failure = Box<dyn Error + Send + Sync>;

/// A model that moves the bodies.
pub trait Motion {
    /// Error of a step.
    type Error: Into<Failure>;

    /// Advances by `dt_s`, which is positive and at most one plant tick. `targets` are the target twists of the
    /// robots during this time, within the limits of their wheels, and 0 without a command in force. `states`,
    /// in the same order, holds the states after the previous step (or at the start) and receives the new ones.
    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [State],
    ) -> Result<(), Self::Error>;
}

/// Exact unicycle motion: circular arcs, or ramps if the robot has acceleration limits. The guarantee of the
/// guard assumes this motion.
pub struct Unicycles {
    limits: Vec<Option<LimitsBrief>>,
}

impl Unicycles {
    /// Creates the motion of all robots of the brief.
    pub fn new(brief: &PlantBrief) -> Unicycles {
        Unicycles { limits: brief.robots.iter().map(|body| body.limits).collect() }
    }
}

impl Motion for Unicycles {
    type Error = Infallible;

    /// Moves the twist on the segment to the target, and on its ray to 0: `proof/Inertia.v::approaches`.
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
                    let accelerations = limits.maximum_accelerations();
                    accelerations.drive(pose, twist, target, limits.ramp, dt_s)
                }
            };
            *state = State { pose, twist };
        }
        Ok(())
    }
}

/// Maximum plausible magnitude of a coordinate, speed or turn rate, in SI units.
const PLAUSIBLE_MAX: f64 = 1e9;

/// Wrapper that validates the states of another motion. A state that is not finite or not plausible ends the
/// run with an error that names the robot, before any robot senses it.
pub struct Checked<M> {
    motion: M,
    names: Vec<String>,
}

impl<M: Motion> Checked<M> {
    /// Creates the wrapper for the robots of the brief.
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
                ("side_m_s", twist.side_m_s),
                ("w_rad_s", twist.w_rad_s),
            ];
            let wrong = |(_, number): &(_, f64)| number.is_nan() || number.abs() > PLAUSIBLE_MAX;
            if let Some((what, value)) = numbers.into_iter().find(wrong) {
                return Err(format!(
                    "the plant moved {name} to {what} = {value}; the magnitude must be at most 1e9"
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

    /// Moves robot 1 to a fixed state, regardless of the targets.
    struct To(State);

    impl Motion for To {
        type Error = Infallible;

        fn step(&mut self, _: &[Twist], _: f64, states: &mut [State]) -> Result<(), Infallible> {
            states[1] = self.0;
            Ok(())
        }
    }

    fn step(x_m: f64, heading_rad: f64, w_rad_s: f64) -> Result<State, String> {
        let to =
            State { pose: Pose { x_m, y_m: 0.0, heading_rad }, twist: Twist::new(0.0, w_rad_s) };
        let names = vec!["a".to_owned(), "b".to_owned()];
        let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };
        let mut states = [State { pose: start, twist: Twist::ZERO }; 2];
        let mut checked = Checked { motion: To(to), names };
        let done = checked.step(&[Twist::ZERO; 2], 0.001, &mut states);
        done.map(|()| states[1]).map_err(|error| error.to_string())
    }

    #[test]
    fn invalid_state_is_refused_with_robot_and_number() {
        let said = |what: &str| {
            Err(format!("the plant moved b to {what}; the magnitude must be at most 1e9"))
        };
        assert_eq!(step(f64::NAN, 0.0, 0.0), said("x_m = NaN"));
        assert_eq!(step(0.0, f64::INFINITY, 0.0), said("heading_rad = inf"));
        assert_eq!(step(0.0, 0.0, -1e10), said("w_rad_s = -10000000000"));
    }

    #[test]
    fn heading_of_an_external_motion_is_wrapped() {
        let state = step(3.0, 7.0, 0.5).unwrap();
        assert_eq!((state.pose.x_m, state.twist.w_rad_s), (3.0, 0.5));
        assert!((state.pose.heading_rad - (7.0 - std::f64::consts::TAU)).abs() < 1e-15);
    }
}
