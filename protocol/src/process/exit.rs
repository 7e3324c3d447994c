//! Exit codes, the same for every role.

/// Every expectation held.
pub const OK: u8 = 0;
/// The run ended as planned and missed an expectation.
pub const EXPECTATION_MISSED: u8 = 1;
/// The command line was wrong.
pub const USAGE: u8 = 2;
/// The scenario was wrong; nothing was spawned.
pub const BAD_SCENARIO: u8 = 3;
/// A process, the disk or shared memory failed.
pub const INFRASTRUCTURE: u8 = 4;
/// Ended by SIGINT, SIGTERM, SIGHUP, SIGUSR1 or SIGUSR2: 128 + 2, as shells report it.
pub const INTERRUPTED: u8 = 130;
