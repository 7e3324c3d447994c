//! Fixtures of this crate's tests: a brief and commands with default values.

use formation::drive::DriveKind;
use formation::pose::Pose;
use protocol::brief::{BodyBrief, FormatVersion, Pace, PlantBrief};
use protocol::message::Command;

pub(crate) const NS_PER_MS: u64 = 1_000_000;

/// Returns the brief of robots in real time at these positions on the x axis, heading along it: T = 10 ms, H =
/// 20 ms, d = 0.5 m, v_max = 1 m/s, ell = 0.1 m, sensing radius 3 m.
pub(crate) fn brief(x_m: &[f64]) -> PlantBrief {
    let body = |(&x_m, name): (&f64, char)| BodyBrief {
        name: name.into(),
        front_point_m: 0.1,
        drive_kind: DriveKind::Differential,
        turn_rate_max_rad_s: None,
        turning_radius_min_m: None,
        member: None,
        wheels: None,
        limits: None,
        start: Pose { x_m, y_m: 0.0, heading_rad: 0.0 },
        sensor_faults: Vec::new(),
        wheel_faults: Vec::new(),
        command_faults: Vec::new(),
    };
    PlantBrief {
        format: FormatVersion,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        duration_ns: 1000 * NS_PER_MS,
        period_ns: 10 * NS_PER_MS,
        plant_tick_ns: NS_PER_MS,
        command_lifetime_ns: 20 * NS_PER_MS,
        distance_min_m: 0.5,
        speed_max_m_s: Some(1.0),
        sensing_radius_m: 3.0,
        velocities_sensed: false,
        clearance_m: 0.0,
        program: None,
        obstacles: Vec::new(),
        robots: x_m.iter().zip('a'..).map(body).collect(),
    }
}

/// Returns a command that answers the sample with this stamp.
pub(crate) fn command(stamp_ns: u64, sequence: u64, v_m_s: f64, w_rad_s: f64) -> Command {
    Command { stamp_ns, sequence, v_m_s, w_rad_s, ..Command::default() }
}
