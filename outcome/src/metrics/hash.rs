//! Trajectory hash: equal for two runs if and only if they are equal bit by bit.

use std::fmt::Write as _;

use protocol::message::TruthRow;
use sha2::{Digest, Sha256};

/// SHA-256 over, for every tick, the tick and each robot's x, y, heading, v, w, a lateral speed other than 0, and
/// commanded flag in scenario order, all as little-endian 64-bit words.
#[derive(Debug, Clone, Default)]
pub struct TrajectoryHash(Sha256);

impl TrajectoryHash {
    /// Creates the hash of an empty trajectory.
    pub fn new() -> TrajectoryHash {
        TrajectoryHash::default()
    }

    /// Adds one tick.
    pub fn update(&mut self, tick: u64, rows: &[TruthRow]) {
        self.0.update(tick.to_le_bytes());
        for row in rows {
            for number in [row.x_m, row.y_m, row.heading_rad, row.v_m_s, row.w_rad_s] {
                self.0.update(number.to_le_bytes());
            }
            // Robots with two wheels have none, so their hashes do not depend on it.
            if row.side_m_s != 0.0 {
                self.0.update(row.side_m_s.to_le_bytes());
            }
            self.0.update(row.commanded.to_le_bytes());
        }
    }

    /// Returns the first 16 hexadecimal digits of the hash.
    pub fn finish(&self) -> String {
        let digest = self.0.clone().finalize();
        digest.iter().take(8).fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    }
}
