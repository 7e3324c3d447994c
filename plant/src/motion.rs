//! Motion of the bodies: exact unicycles, or an external physics engine.
//!
//! A motion receives the target twists of all robots and returns the resulting states. Accepting commands,
//! sensing and faults are the responsibility of [`World`](crate::world::World), for every motion.

use std::convert::Infallible;
use std::error::Error;

use formation::pose::{Pose, Twist, wrap_angle};
use formation::unicycle::integrate_arc;
use protocol::brief::{AccelerationLimitsBrief, PlantBrief};

/// Pose and twist of one body in `map`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyState {
    /// Pose of the axle midpoint.
    pub pose: Pose,
    /// Twist, as reported by odometry.
    pub twist: Twist,
}

/// Reason why the bodies could not be moved.
pub type MotionFailure = Box<dyn Error + Send + Sync>;

/// A model that moves the bodies.
pub trait Motion {
    /// Error of a step.
    type Error: Into<MotionFailure>;

    /// Advances by `dt_s`, which is positive and at most one plant tick. `targets` are the target twists of the
    /// robots during this time, within the limits of their wheels, and 0 without a command in force. `states`,
    /// in the same order, holds the states after the previous step (or at the start) and receives the new ones.
    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [BodyState],
    ) -> Result<(), Self::Error>;
}

/// Exact unicycle motion: circular arcs, or ramps if the robot has acceleration limits. The guarantee of the
/// guard assumes this motion.
pub struct UnicycleMotion {
    limits: Vec<Option<AccelerationLimitsBrief>>,
    /// `true` for each robot that is a car.
    is_car: Vec<bool>,
}

impl UnicycleMotion {
    /// Creates the motion of all robots of the brief.
    pub fn new(brief: &PlantBrief) -> UnicycleMotion {
        UnicycleMotion {
            limits: brief.robots.iter().map(|body| body.limits).collect(),
            is_car: brief.robots.iter().map(|body| body.drive().is_car()).collect(),
        }
    }
}

impl Motion for UnicycleMotion {
    type Error = Infallible;

    /// Moves the twist on the segment to the target, and on its ray to 0: `proof/Inertia.v::approaches`.
    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [BodyState],
    ) -> Result<(), Infallible> {
        let robots = states.iter_mut().zip(targets).zip(&self.limits).zip(&self.is_car);
        for (((state, &target), limits), &is_car) in robots {
            let BodyState { pose, twist } = *state;
            let (pose, twist) = match limits {
                None => (integrate_arc(pose, target, dt_s), target),
                Some(limits) if is_car => {
                    let accelerations = limits.maximum_accelerations();
                    accelerations.car_pose_and_twist_after(pose, twist, target, dt_s)
                }
                Some(limits) => {
                    let accelerations = limits.maximum_accelerations();
                    accelerations.pose_and_twist_after(pose, twist, target, limits.ramp, dt_s)
                }
            };
            *state = BodyState { pose, twist };
        }
        Ok(())
    }
}

/// Maximum plausible magnitude of a coordinate, speed or turn rate, in SI units.
const PLAUSIBLE_MAGNITUDE_MAX: f64 = 1e9;

/// Wrapper that validates the states of another motion. A state that is not finite or not plausible ends the
/// run with an error that names the robot, before any robot senses it.
pub struct CheckedMotion<M> {
    motion: M,
    robot_names: Vec<String>,
}

impl<M: Motion> CheckedMotion<M> {
    /// Creates the wrapper for the robots of the brief.
    pub fn new(brief: &PlantBrief, motion: M) -> CheckedMotion<M> {
        CheckedMotion {
            motion,
            robot_names: brief.robots.iter().map(|body| body.name.clone()).collect(),
        }
    }
}

impl<M: Motion> Motion for CheckedMotion<M> {
    type Error = MotionFailure;

    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [BodyState],
    ) -> Result<(), MotionFailure> {
        self.motion.step(targets, dt_s, states).map_err(Into::into)?;
        for (state, name) in states.iter_mut().zip(&self.robot_names) {
            let BodyState { pose, twist } = state;
            let numbers = [
                ("x_m", pose.x_m),
                ("y_m", pose.y_m),
                ("heading_rad", pose.heading_rad),
                ("v_m_s", twist.v_m_s),
                ("side_m_s", twist.side_m_s),
                ("w_rad_s", twist.w_rad_s),
            ];
            let is_invalid =
                |(_, number): &(_, f64)| number.is_nan() || number.abs() > PLAUSIBLE_MAGNITUDE_MAX;
            if let Some((number_name, value)) = numbers.into_iter().find(is_invalid) {
                return Err(format!(
                    "the plant moved {name} to {number_name} = {value}; the magnitude must be at most 1e9"
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
    struct FixedStateMotion(BodyState);

    impl Motion for FixedStateMotion {
        type Error = Infallible;

        fn step(
            &mut self,
            _: &[Twist],
            _: f64,
            states: &mut [BodyState],
        ) -> Result<(), Infallible> {
            states[1] = self.0;
            Ok(())
        }
    }

    fn check_step_to(x_m: f64, heading_rad: f64, w_rad_s: f64) -> Result<BodyState, String> {
        let to = BodyState {
            pose: Pose { x_m, y_m: 0.0, heading_rad },
            twist: Twist::new(0.0, w_rad_s),
        };
        let names = vec!["a".to_owned(), "b".to_owned()];
        let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 };
        let mut states = [BodyState { pose: start, twist: Twist::ZERO }; 2];
        let mut checked = CheckedMotion { motion: FixedStateMotion(to), robot_names: names };
        let done = checked.step(&[Twist::ZERO; 2], 0.001, &mut states);
        done.map(|()| states[1]).map_err(|error| error.to_string())
    }

    #[test]
    fn invalid_state_is_refused_with_robot_and_number() {
        let error_text = |number: &str| {
            Err(format!("the plant moved b to {number}; the magnitude must be at most 1e9"))
        };
        assert_eq!(check_step_to(f64::NAN, 0.0, 0.0), error_text("x_m = NaN"));
        assert_eq!(check_step_to(0.0, f64::INFINITY, 0.0), error_text("heading_rad = inf"));
        assert_eq!(check_step_to(0.0, 0.0, -1e10), error_text("w_rad_s = -10000000000"));
    }

    #[test]
    fn heading_of_an_external_motion_is_wrapped() {
        let state = check_step_to(3.0, 7.0, 0.5).unwrap();
        assert_eq!((state.pose.x_m, state.twist.w_rad_s), (3.0, 0.5));
        assert!((state.pose.heading_rad - (7.0 - std::f64::consts::TAU)).abs() < 1e-15);
    }
}
