//! Trajectory hash: equal for two runs if and only if they are equal bit by bit.

use std::fmt::Write as _;

use protocol::message::TruthRow;
use sha2::{Digest, Sha256};

/// SHA-256 over, for every tick, the tick and each robot's x, y, heading, v, w, a lateral speed other than 0, and
/// commanded flag in scenario order, all as little-endian 64-bit words.
#[derive(Debug, Clone, Default)]
pub struct TrajectoryHash {
    digest: Sha256,
    /// Bytes of one tick, so that the digest receives them in one call.
    buffer: Vec<u8>,
}

impl TrajectoryHash {
    /// Creates the hash of an empty trajectory.
    pub fn new() -> TrajectoryHash {
        TrajectoryHash::default()
    }

    /// Adds one tick.
    pub fn update(&mut self, tick: u64, rows: &[TruthRow]) {
        let buffer = &mut self.buffer;
        buffer.clear();
        buffer.extend_from_slice(&tick.to_le_bytes());
        for row in rows {
            for number in [row.x_m, row.y_m, row.heading_rad, row.v_m_s, row.w_rad_s] {
                buffer.extend_from_slice(&number.to_bits().to_le_bytes());
            }
            // Robots with two wheels have no lateral speed, so their hashes do not depend on it.
            if row.side_m_s != 0.0 {
                buffer.extend_from_slice(&row.side_m_s.to_bits().to_le_bytes());
            }
            buffer.extend_from_slice(&row.commanded.to_le_bytes());
        }
        self.digest.update(&self.buffer);
    }

    /// Returns the first 16 hexadecimal digits of the hash.
    pub fn finish(&self) -> String {
        let digest = self.digest.clone().finalize();
        digest.iter().take(8).fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    }
}
