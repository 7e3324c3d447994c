//! Exit codes, the same for every process.

/// Success: every expectation was met.
pub const OK: u8 = 0;
/// The run ended as planned, and an expectation was not met.
pub const EXPECTATION_MISSED: u8 = 1;
/// Invalid command line.
pub const USAGE_ERROR: u8 = 2;
/// Invalid scenario; no process was started.
pub const BAD_SCENARIO: u8 = 3;
/// A process, the disk or shared memory failed.
pub const INFRASTRUCTURE_FAILURE: u8 = 4;
/// The run was interrupted by SIGINT, SIGTERM, SIGHUP, SIGUSR1 or SIGUSR2: 128 + 2, as shells report SIGINT.
pub const INTERRUPTED: u8 = 130;
