//! Ground-truth samples of [`experiment::examples::row_of_three`], for tests.

use protocol::message::{TruthHeader, TruthRow};

const SECOND_NS: u64 = 1_000_000_000;

/// Returns a header of a sample in which the plant has measured no distance.
pub fn header(tick: u64) -> TruthHeader {
    TruthHeader {
        tick,
        t_ns: tick * SECOND_NS,
        stamp_ns: tick * SECOND_NS,
        closest_m: f64::INFINITY,
        clearance_m: f64::INFINITY,
        ..TruthHeader::default()
    }
}

/// Returns rows with the front points at these positions along x.
pub fn rows(front_x_m: [f64; 3]) -> [TruthRow; 3] {
    front_x_m.map(|x_m| TruthRow { x_m: x_m - 0.1, commanded: 1, ..TruthRow::default() })
}
