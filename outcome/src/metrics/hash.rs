//! The trajectory hash: one word that two runs share only if they are the same bit by bit; and the
//! same of the beginning of a run, second by second, which tells when two runs parted.

use std::fmt::Write as _;

use protocol::message::TruthRow;
use sha2::{Digest, Sha256};

const SECOND_NS: u64 = 1_000_000_000;

/// SHA-256 over, for every tick, the tick and each robot's x, y, heading, v, w and commanded flag
/// in scenario order, all as little-endian 64-bit words.
#[derive(Debug, Clone, Default)]
pub struct TrajectoryHash(Sha256);

impl TrajectoryHash {
    /// The hash of nothing yet.
    pub fn new() -> TrajectoryHash {
        TrajectoryHash::default()
    }

    /// Takes in one tick.
    pub fn update(&mut self, tick: u64, rows: &[TruthRow]) {
        self.0.update(tick.to_le_bytes());
        for row in rows {
            for number in [row.x_m, row.y_m, row.heading_rad, row.v_m_s, row.w_rad_s] {
                self.0.update(number.to_le_bytes());
            }
            self.0.update(row.commanded.to_le_bytes());
        }
    }

    /// Its first 16 hexadecimal digits.
    pub fn finish(&self) -> String {
        let digest = self.0.clone().finalize();
        digest.iter().take(8).fold(String::new(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        })
    }
}

/// The trajectory hash of a run under way, and what it was at the end of each simulated second.
#[derive(Debug, Clone, Default)]
pub struct HashChain {
    hash: TrajectoryHash,
    by_second: Vec<String>,
}

impl HashChain {
    /// Takes in one tick, at `t_ns` of run time.
    pub fn update(&mut self, tick: u64, t_ns: u64, rows: &[TruthRow]) {
        let seconds = (t_ns / SECOND_NS) as usize;
        if self.by_second.len() < seconds {
            self.by_second.resize(seconds, self.hash.finish());
        }
        self.hash.update(tick, rows);
    }

    /// The hash of all that came.
    pub fn finish(&self) -> String {
        self.hash.finish()
    }

    /// Entry k is the hash of all truths before k + 1 s.
    pub fn by_second(&self) -> &[String] {
        &self.by_second
    }
}
