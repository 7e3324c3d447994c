//! Commercially available robots: the values of the key `model`. Each number has its source or is marked as assumed.
//! A key that the scenario gives overrides the value of the model.

use protocol::brief::WheelsBrief;

/// Parameters of a commercially available robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotModel {
    /// Name in scenario files.
    pub name: &'static str,
    /// Description of the robot, in one line.
    pub description: &'static str,
    /// ell, distance of the front point ahead of the axle, m. A choice of this project, within the body radius.
    pub front_point_m: f64,
    /// Radius of the body around the middle of the axle, m.
    pub body_radius_m: f64,
    /// Wheel speed and track width.
    pub wheels: WheelsBrief,
    /// a_v, maximum linear acceleration, m/s^2.
    pub acceleration_max_m_s2: f64,
    /// a_w, maximum angular acceleration, rad/s^2.
    pub turn_acceleration_max_rad_s2: f64,
    /// Sources of the numbers.
    pub source: &'static str,
}

/// Names and descriptions of all models, for the key table.
pub(super) const MODEL_VALUES: &[(&str, &str)] = &[
    (MODELS[0].name, MODELS[0].description),
    (MODELS[1].name, MODELS[1].description),
    (MODELS[2].name, MODELS[2].description),
    (MODELS[3].name, MODELS[3].description),
];

/// Commercially available robots that the key `model` names.
pub const MODELS: [RobotModel; 4] = [
    RobotModel {
        name: "turtlebot3-burger",
        description: "TurtleBot3 Burger: 0.22 m/s, 2.5 m/s^2, 3.2 rad/s^2",
        front_point_m: 0.1,
        body_radius_m: 0.105,
        wheels: WheelsBrief { speed_max_m_s: 0.22, track_m: 0.16 },
        acceleration_max_m_s2: 2.5,
        turn_acceleration_max_rad_s2: 3.2,
        source: "speed and accelerations: max_trans_vel, acc_lim_x, acc_lim_theta of \
                 turtlebot3_navigation/param/dwa_local_planner_params_burger.yaml; track: wheels.separation of \
                 turtlebot3_node/param/burger.yaml (both github.com/ROBOTIS-GIT/turtlebot3); body: assumed, from the \
                 size of 138 x 178 mm in its specification",
    },
    RobotModel {
        name: "turtlebot3-waffle",
        description: "TurtleBot3 Waffle: 0.26 m/s, 2.5 m/s^2, 3.2 rad/s^2",
        front_point_m: 0.15,
        body_radius_m: 0.22,
        wheels: WheelsBrief { speed_max_m_s: 0.26, track_m: 0.287 },
        acceleration_max_m_s2: 2.5,
        turn_acceleration_max_rad_s2: 3.2,
        source: "as for the Burger: dwa_local_planner_params_waffle.yaml; track: turtlebot3_bringup/param/waffle.yaml; \
                 body: assumed, from the size of 281 x 306 mm in its specification",
    },
    RobotModel {
        name: "gritsbot-x",
        description: "GRITSBot X of the Robotarium: 0.2 m/s, 1 m/s^2 and 8 rad/s^2 (assumed)",
        front_point_m: 0.05,
        body_radius_m: 0.055,
        wheels: WheelsBrief { speed_max_m_s: 0.2, track_m: 0.105 },
        acceleration_max_m_s2: 1.0,
        turn_acceleration_max_rad_s2: 8.0,
        source: "speed, track, body: max_linear_velocity, base_length, robot_radius of rps/robotarium_abc.py \
                 (github.com/robotarium/robotarium_python_simulator); accelerations: assumed",
    },
    RobotModel {
        name: "neobotix-mp-500",
        description: "Neobotix MP-500, a warehouse robot: 1.5 m/s, 2.4 m/s^2, 2 rad/s^2 (assumed)",
        front_point_m: 0.5,
        body_radius_m: 0.61,
        wheels: WheelsBrief { speed_max_m_s: 1.5, track_m: 0.51 },
        acceleration_max_m_s2: 2.4,
        turn_acceleration_max_rad_s2: 2.0,
        source: "speed and acceleration: maximum speed and maximum acceleration of its mechanical properties \
                 (neobotix-docs.de, platforms/mp-500); body: its rear end, 527 mm behind, 592 mm wide; track: \
                 assumed, the width minus that of a wheel; turning acceleration: assumed",
    },
];
