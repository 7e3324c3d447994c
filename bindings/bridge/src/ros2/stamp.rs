//! ROS time, which is the wall clock, from stamps of the monotonic clock.

const NS_PER_S: u64 = 1_000_000_000;

/// What is to be added to CLOCK_MONOTONIC for CLOCK_REALTIME. Read once: stamps of a run never go back,
/// even if somebody sets the wall clock meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RosClock {
    offset_ns: u64,
}

impl RosClock {
    /// Of both clocks at one instant, ns; the wall clock counts from 1970.
    pub fn new(monotonic_ns: u64, wall_ns: u64) -> RosClock {
        RosClock { offset_ns: wall_ns.saturating_sub(monotonic_ns) }
    }

    /// The time of ROS at a stamp of the monotonic clock, ns since 1970.
    pub fn at(self, stamp_ns: u64) -> u64 {
        stamp_ns + self.offset_ns
    }
}

/// As messages have a time of ROS, ns since 1970: whole seconds, and the ns beyond them.
pub fn split(ros_ns: u64) -> (i32, u32) {
    ((ros_ns / NS_PER_S) as i32, (ros_ns % NS_PER_S) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_become_wall_time_and_keep_their_distances() {
        let ros = RosClock::new(5_000_000_000, 1_700_000_000_000_000_007);
        assert_eq!(ros.at(5_000_000_000), 1_700_000_000_000_000_007);
        assert_eq!(split(ros.at(6_500_000_000)), (1_700_000_001, 500_000_007));
    }
}
