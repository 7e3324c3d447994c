//! Fixtures of this crate's tests: a brief, odometry and beacons with default values.

use formation::drive::DriveKind;
use protocol::brief::{
    AgentBrief, AvoidanceBrief, FormatVersion, NeighborBrief, Pace, PublishedVelocity,
    SilenceBrief, SilencePolicy, YieldPriority,
};
use protocol::message::{Beacon, Odometry};

pub(crate) const NS_PER_MS: u64 = 1_000_000;
/// Stamp of t = 0, ns.
pub(crate) const START_NS: u64 = 500 * NS_PER_MS;

/// Returns an in-neighbor with offset 0 and without faults.
pub(crate) fn in_neighbor_brief(index: usize) -> NeighborBrief {
    NeighborBrief {
        name: format!("r{index}"),
        index,
        offset_m: [0.0, 0.0],
        faults: Vec::new(),
        lies: Vec::new(),
        trusted: false,
        replaces: Vec::new(),
        message: None,
        range: None,
        params: Default::default(),
    }
}

/// Returns the brief of r1, which receives from r5 and r2, in this order.
pub(crate) fn brief() -> AgentBrief {
    AgentBrief {
        format: FormatVersion,
        name: "r1".into(),
        index: 1,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        period_ns: 10 * NS_PER_MS,
        plant_tick_ns: NS_PER_MS,
        command_lifetime_ns: 25 * NS_PER_MS,
        late_ns: 0,
        front_point_m: 0.1,
        drive_kind: DriveKind::Differential,
        turn_rate_max_rad_s: None,
        turning_radius_min_m: None,
        law: "formation-unit".into(),
        gains: [("speed_m_s".into(), 0.1)].into(),
        program: None,
        seed: 0,
        place_m: None,
        params: Default::default(),
        withholds: false,
        message_queue: 0,
        signals: Vec::new(),
        records_messages: false,
        counts_sent: false,
        message: None,
        led: false,
        rank: YieldPriority::First,
        lead: None,
        deputy: None,
        scale: None,
        goal_m: None,
        goal_heading_rad: None,
        published_velocity: PublishedVelocity::Gamma,
        limits: None,
        avoidance: AvoidanceBrief {
            kind: "none".into(),
            distance_min_m: 0.2,
            speed_max_m_s: f64::INFINITY,
            sensing_radius_m: 0.0,
            sensing_error_m: 0.0,
            heading_error_rad: 0.0,
            braking_time_max_s: 0.0,
            clearance_m: 0.0,
            command_timeout_max_s: 0.0,
            classes: Vec::new(),
            gains: Default::default(),
        },
        silence: SilenceBrief {
            stale_after_ns: 30 * NS_PER_MS,
            lost_after_ns: 100 * NS_PER_MS,
            policy: SilencePolicy::Ignore,
        },
        slow: Vec::new(),
        odometry_faults: Vec::new(),
        command_faults: Vec::new(),
        repair_after_ns: 0,
        links_by_hand: false,
        goals_from_outside: false,
        neighbors: vec![in_neighbor_brief(5), in_neighbor_brief(2)],
        spares: Vec::new(),
        successions: Vec::new(),
    }
}

/// Returns the sample `t_ms` milliseconds after the start, at x = 1 m + 1 m/s t.
pub(crate) fn odometry(t_ms: u64) -> Odometry {
    Odometry {
        tick: t_ms,
        t_ns: t_ms * NS_PER_MS,
        stamp_ns: START_NS + t_ms * NS_PER_MS,
        x_m: 1.0 + 1e-3 * t_ms as f64,
        heading_rad: 0.3,
        w_rad_s: 2.0,
        pose_valid: 1,
        proximity_valid: 1,
        ..Odometry::default()
    }
}

/// Returns a beacon of a robot at x = 3 m, `t_ms` milliseconds after the start.
pub(crate) fn beacon(t_ms: u64) -> Beacon {
    Beacon { tick: t_ms, stamp_ns: START_NS + t_ms * NS_PER_MS, x_m: 3.0, ..Beacon::default() }
}
