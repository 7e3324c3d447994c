//! Truths of [`experiment::examples::row_of_three`], for the tests of those that take some.

use protocol::message::{TruthHeader, TruthRow};

const SECOND_NS: u64 = 1_000_000_000;

/// A truth at which the plant itself has seen nothing.
pub fn header(tick: u64) -> TruthHeader {
    TruthHeader {
        tick,
        t_ns: tick * SECOND_NS,
        stamp_ns: tick * SECOND_NS,
        sent_ns: 0,
        closest_m: f64::INFINITY,
        closest_t_ns: 0,
        closest_pair: [0, 0],
        violations: 0,
        clearance_m: f64::INFINITY,
        clearance_t_ns: 0,
        clearance_at_m: [0.0; 2],
        clearance_between: [0; 2],
        clearance_violations: 0,
        commands_late: 0,
        commands_old: 0,
        commands_not_finite: 0,
        commands_scaled: 0,
        commands_expired: 0,
        command_age_ns_max: 0,
    }
}

/// Rows with the front points at these places along x.
pub fn rows(front_x_m: [f64; 3]) -> [TruthRow; 3] {
    front_x_m.map(|x_m| TruthRow {
        x_m: x_m - 0.1,
        y_m: 0.0,
        heading_rad: 0.0,
        v_m_s: 0.0,
        w_rad_s: 0.0,
        commanded: 1,
    })
}
