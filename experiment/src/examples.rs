//! Small experiment for tests.

use formation::drive::DriveKind;
use std::collections::BTreeMap;

use formation::Vec2;
use formation::graph::{Edge, FormationGraph};
use formation::pose::Pose;
use formation::rewiring::RepairPlan;
use protocol::avoidance::AvoidanceDescription;
use protocol::brief::{AvoidanceBrief, SilenceBrief, SilencePolicy};
use protocol::law::Role;

use crate::scenario::read::parse_settings;
use crate::scenario::{
    Expectations, HuntBounds, RealtimeSettings, RestartCondition, RestartPolicy, Robot, Scenario,
};

const NS_PER_S: u64 = 1_000_000_000;

/// Returns three robots in a row along x, 1 m apart: r1 leads, r2 receives from r1, r3 receives from r2. The run takes
/// 20 s with a period of 1 s and d = 0.2 m.
pub fn row_of_three() -> Scenario {
    let robot = |name: &str| Robot {
        role: Role::FORMATION,
        name: name.to_owned(),
        start: Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 },
        front_point_m: 0.1,
        drive_kind: DriveKind::Differential,
        turn_rate_max_rad_s: None,
        turning_radius_min_m: None,
        keep_m: 0.1,
        speed_max_m_s: 0.3,
        hold_periods: 1,
        wheels: None,
        body_radius_m: None,
        acceleration_limits: None,
        goal_m: None,
        goal_heading_rad: None,
        law: "formation-unit".to_owned(),
        gains: BTreeMap::new(),
        uses_feed_forward: false,
        correction_max_m_s: None,
        message_format: None,
        queued_messages_max: 0,
        withholds_beacons: false,
        signals: &[],
        gain_ranges: &[],
        takes_params: false,
        place_m: None,
        params: Default::default(),
        restart_policy: RestartPolicy {
            condition: RestartCondition::Never,
            delay_ns: 0,
            delay_ns_max: 0,
            restarts_max: 0,
            window_ns: 0,
        },
    };
    let behind = |from, to| Edge { from, to, offset_m: Vec2::new(-1.0, 0.0) };
    Scenario {
        name: "row".to_owned(),
        settings: parse_settings("duration_s = 20\nperiod_s = 1\nseed = 7\nrecord_hz = 0.5"),
        realtime: RealtimeSettings {
            plant_tick_ns: 1_000_000,
            latency_allowed_ns: 0,
            between_hosts_latency_ns: 0,
            hold_periods: 1,
            control_timer: true,
        },
        avoidance_method: AvoidanceDescription::NO_AVOIDANCE,
        avoidance: AvoidanceBrief {
            kind: "guard".to_owned(),
            distance_min_m: 0.2,
            speed_max_m_s: 0.3,
            sensing_radius_m: 2.0,
            sensing_error_m: 0.0,
            heading_error_rad: 0.0,
            braking_time_max_s: 0.0,
            clearance_m: 0.0,
            command_timeout_max_s: 0.0,
            classes: Vec::new(),
            gains: BTreeMap::new(),
        },
        classes_sensed: true,
        silence: SilenceBrief {
            stale_after_ns: 3 * NS_PER_S,
            lost_after_ns: 20 * NS_PER_S,
            policy: SilencePolicy::Ignore,
        },
        laws: Vec::new(),
        plant_program: None,
        robots: vec![robot("r1"), robot("r2"), robot("r3")],
        graph: FormationGraph::new(3, vec![behind(0, 1), behind(1, 2)]),
        edge_params: BTreeMap::new(),
        walls: Vec::new(),
        faults: Vec::new(),
        repair_plan: RepairPlan::default(),
        repair_after_ns: None,
        lead: None,
        leaderless_scale: None,
        disk_graph: None,
        metrics: Vec::new(),
        expectations: Expectations { converged_error_m: 0.01, ..Expectations::default() },
        hunt_bounds: HuntBounds::default(),
    }
}
