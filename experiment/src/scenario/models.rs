//! Commercially available robots: the values of the key `model`. Each number has its source or is marked as assumed.
//! A key that the scenario gives overrides the value of the model.

use formation::drive::DriveKind;
use protocol::brief::WheelsBrief;

/// Parameters of a commercially available robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotModel {
    /// Name in scenario files.
    pub name: &'static str,
    /// Description of the robot, in one line.
    pub description: &'static str,
    /// Drive, with the numbers that only this drive has.
    pub drive: ModelDrive,
    /// Radius of the body around the middle of the axle, or around the center of an omnidirectional robot, m.
    pub body_radius_m: f64,
    /// a_v, maximum linear acceleration, m/s^2.
    pub acceleration_max_m_s2: f64,
    /// a_w, maximum angular acceleration, rad/s^2.
    pub turn_acceleration_max_rad_s2: f64,
    /// Sources of the numbers.
    pub source: &'static str,
}

/// Drive of a commercially available robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ModelDrive {
    /// Two driven wheels on one axle.
    Differential {
        /// ell, distance of the front point ahead of the axle, m. A choice of this project, within the body radius.
        front_point_m: f64,
        /// Wheel speed and track width.
        wheels: WheelsBrief,
    },
    /// Omnidirectional robot, or drone at fixed height.
    Omni {
        /// Maximum speed in any direction, m/s.
        speed_max_m_s: f64,
        /// w_max, maximum turn rate, rad/s; 0 for a robot that keeps its heading.
        turn_rate_max_rad_s: f64,
    },
    /// Car, controlled at the middle of its rear axle.
    Ackermann {
        /// Maximum speed, m/s.
        speed_max_m_s: f64,
        /// R_min, minimum turning radius of the middle of the rear axle, m.
        turning_radius_min_m: f64,
    },
}

impl RobotModel {
    /// Returns the value of the key `drive`.
    pub fn drive_kind(&self) -> DriveKind {
        match self.drive {
            ModelDrive::Differential { .. } => DriveKind::Differential,
            ModelDrive::Omni { .. } => DriveKind::Omni,
            ModelDrive::Ackermann { .. } => DriveKind::Ackermann,
        }
    }

    /// Returns wheel speed and track width of a differential drive.
    pub fn wheels(&self) -> Option<WheelsBrief> {
        match self.drive {
            ModelDrive::Differential { wheels, .. } => Some(wheels),
            _ => None,
        }
    }

    /// Returns the distance of the front point ahead of the axle, m; 0 without one.
    pub fn front_point_m(&self) -> f64 {
        match self.drive {
            ModelDrive::Differential { front_point_m, .. } => front_point_m,
            _ => 0.0,
        }
    }

    /// Returns the maximum speed of the controlled point, m/s. That of a differential drive follows from its wheels.
    pub fn speed_max_m_s(&self) -> Option<f64> {
        match self.drive {
            ModelDrive::Differential { .. } => None,
            ModelDrive::Omni { speed_max_m_s, .. } => Some(speed_max_m_s),
            ModelDrive::Ackermann { speed_max_m_s, .. } => Some(speed_max_m_s),
        }
    }

    /// Returns the maximum turn rate of an omnidirectional robot, rad/s.
    pub fn turn_rate_max_rad_s(&self) -> Option<f64> {
        match self.drive {
            ModelDrive::Omni { turn_rate_max_rad_s, .. } => Some(turn_rate_max_rad_s),
            _ => None,
        }
    }

    /// Returns the minimum turning radius of a car, m.
    pub fn turning_radius_min_m(&self) -> Option<f64> {
        match self.drive {
            ModelDrive::Ackermann { turning_radius_min_m, .. } => Some(turning_radius_min_m),
            _ => None,
        }
    }
}

/// Names and descriptions of all models, for the key table.
pub(super) const MODEL_VALUES: &[(&str, &str)] = &{
    let mut values = [("", ""); MODELS.len()];
    let mut k = 0;
    while k < MODELS.len() {
        values[k] = (MODELS[k].name, MODELS[k].description);
        k += 1;
    }
    values
};

/// Commercially available robots that the key `model` names.
pub const MODELS: [RobotModel; 8] = [
    RobotModel {
        name: "turtlebot3-burger",
        description: "TurtleBot3 Burger: 0.22 m/s, 2.5 m/s^2, 3.2 rad/s^2",
        drive: ModelDrive::Differential {
            front_point_m: 0.1,
            wheels: WheelsBrief { speed_max_m_s: 0.22, track_m: 0.16 },
        },
        body_radius_m: 0.105,
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
        drive: ModelDrive::Differential {
            front_point_m: 0.15,
            wheels: WheelsBrief { speed_max_m_s: 0.26, track_m: 0.287 },
        },
        body_radius_m: 0.22,
        acceleration_max_m_s2: 2.5,
        turn_acceleration_max_rad_s2: 3.2,
        source: "as for the Burger: dwa_local_planner_params_waffle.yaml; track: turtlebot3_bringup/param/waffle.yaml; \
                 body: assumed, from the size of 281 x 306 mm in its specification",
    },
    RobotModel {
        name: "gritsbot-x",
        description: "GRITSBot X of the Robotarium: 0.2 m/s, 1 m/s^2 and 8 rad/s^2 (assumed)",
        drive: ModelDrive::Differential {
            front_point_m: 0.05,
            wheels: WheelsBrief { speed_max_m_s: 0.2, track_m: 0.105 },
        },
        body_radius_m: 0.055,
        acceleration_max_m_s2: 1.0,
        turn_acceleration_max_rad_s2: 8.0,
        source: "speed, track, body: max_linear_velocity, base_length, robot_radius of rps/robotarium_abc.py \
                 (github.com/robotarium/robotarium_python_simulator); accelerations: assumed",
    },
    RobotModel {
        name: "neobotix-mp-500",
        description: "Neobotix MP-500, a warehouse robot: 1.5 m/s, 2.4 m/s^2, 2 rad/s^2 (assumed)",
        drive: ModelDrive::Differential {
            front_point_m: 0.5,
            wheels: WheelsBrief { speed_max_m_s: 1.5, track_m: 0.51 },
        },
        body_radius_m: 0.61,
        acceleration_max_m_s2: 2.4,
        turn_acceleration_max_rad_s2: 2.0,
        source: "speed and acceleration: maximum speed and maximum acceleration of its mechanical properties \
                 (neobotix-docs.de, platforms/mp-500); body: its rear end, 527 mm behind, 592 mm wide; track: \
                 assumed, the width minus that of a wheel; turning acceleration: assumed",
    },
    RobotModel {
        name: "turtlebot4",
        description: "TurtleBot 4: 0.31 m/s, 0.9 m/s^2 and 3 rad/s^2 (assumed)",
        drive: ModelDrive::Differential {
            front_point_m: 0.12,
            wheels: WheelsBrief { speed_max_m_s: 0.31, track_m: 0.233 },
        },
        body_radius_m: 0.175,
        acceleration_max_m_s2: 0.9,
        turn_acceleration_max_rad_s2: 3.0,
        source: "speed in safe mode and size of 342 x 339 mm: features of its user manual \
                 (github.com/turtlebot/turtlebot4-user-manual); track: assumed, the wheel distance of the Create 3; \
                 accelerations: assumed",
    },
    RobotModel {
        name: "robomaster-ep",
        description: "DJI RoboMaster EP or S1, four mecanum wheels: 2 m/s, 600 deg/s, 1 m/s^2 (assumed)",
        drive: ModelDrive::Omni { speed_max_m_s: 2.0, turn_rate_max_rad_s: 10.47 },
        body_radius_m: 0.2,
        acceleration_max_m_s2: 1.0,
        turn_acceleration_max_rad_s2: 5.0,
        source: "turn rate: range of z in Chassis.drive_speed of its SDK (github.com/dji-sdk/RoboMaster-SDK); size of \
                 320 x 240 mm: its specification; speed: assumed, below the 3.5 m/s that drive_speed accepts along x and \
                 y, because the wheels are shared by all directions; accelerations: assumed",
    },
    RobotModel {
        name: "f1tenth",
        description: "F1TENTH, a car of scale 1:10: 2 m/s (assumed), turning radius 0.75 m, 4 m/s^2 (assumed)",
        drive: ModelDrive::Ackermann { speed_max_m_s: 2.0, turning_radius_min_m: 0.75 },
        body_radius_m: 0.48,
        acceleration_max_m_s2: 4.0,
        turn_acceleration_max_rad_s2: 10.0,
        source: "wheelbase 0.3302 m, steering angle 0.4189 rad, size of 0.58 x 0.31 m: params of f110_env.py \
                 (github.com/f1tenth/f1tenth_gym), from which turning radius and body follow, the axles being in the \
                 middle of the body; speed and accelerations: assumed, the 9.51 m/s^2 of params are those of its motor",
    },
    RobotModel {
        name: "crazyflie",
        description: "Crazyflie 2.1, a drone at fixed height: 1 m/s, 2 m/s^2, radius 0.15 m (all assumed)",
        drive: ModelDrive::Omni { speed_max_m_s: 1.0, turn_rate_max_rad_s: 0.0 },
        body_radius_m: 0.15,
        acceleration_max_m_s2: 2.0,
        turn_acceleration_max_rad_s2: 1.0,
        source: "all assumed: its manufacturer publishes no limits of the motion in the plane; the radius includes \
                 downwash",
    },
];
