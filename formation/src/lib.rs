//! Mathematics shared by all processes: pure functions on plain values.
//!
//! This crate does no I/O, reads no clock and does not know iceoryx2. Units are SI. The world frame is `map`: x
//! forward, y left, angles counter-clockwise in (-pi, pi].
//!
//! | file | question it answers |
//! |---|---|
//! | `pose` | where is a robot, and how does it move in its own frame? |
//! | `unicycle` | which pose follows from a constant (v, w), in closed form? (1) |
//! | `ramp` | which pose follows while (v, w) changes at bounded rates? |
//! | `front_point` | which point is controlled, and how does (v, w) move it? (2) (3) (17) |
//! | `drive` | which twists can a robot execute, and how fast does it stop? |
//! | `graph` | which robot receives from which, at which offset? (Definition 1) |
//! | `reachability` | which robots does a robot's information reach, and what do others lose when it dies? |
//! | `rewiring` | which robots does a robot use as references once some robots or links are lost? |
//! | `robustness` | how many Byzantine robots does a graph tolerate (r-robustness)? |
//! | `laplacian` | what are the matrices L and A, and where does the formation settle? (4)-(6) (31) |
//! | `trajectory` | what is the reference trajectory of the main leader? |
//! | `path` | which curve passes through given waypoints, and which point of it is reached at a time? |
//! | `scale` | what is the scale factor of the formation over time? |
//! | `frame` | how do offsets rotate and scale with the leader? (20)-(23) |
//! | `desired` | what is the desired position of a robot, given its in-neighbors? (13) (24) (46) |
//! | `resilient` | what is the desired position if some in-neighbors are Byzantine (W-MSR)? |
//! | `hull` | how far is a follower from the leaders' convex hull? (7) (49) |
//! | `closest` | which two robots have the smallest distance? (15) |
//! | `pair_minima` | how near did each pair of points come, and when? |
//! | `neighbor_list` | which robots are within a cutoff radius of each other, updated incrementally? |
//! | `obstacle` | which point of a wall is nearest, and which walls are within a radius? |
//! | `random` | which pseudo-random numbers follow from a seed? |
//! | `portable_math` | what are the elementary functions, bit-identical on every target? |

#![cfg_attr(test, allow(clippy::disallowed_methods))]

// Stands in this crate because every other crate depends on it, so an unsupported target reports only this
// error.
#[cfg(not(any(target_os = "linux", target_arch = "wasm32")))]
compile_error!(
    "Phalanx runs on Linux only: on macOS and Windows, use Docker (see the Dockerfile) or WSL2."
);

pub mod closest;
pub mod desired;
pub mod drive;
pub mod frame;
pub mod front_point;
pub mod graph;
pub mod hull;
pub mod laplacian;
pub mod neighbor_list;
pub mod obstacle;
pub mod pair_minima;
pub mod path;
pub mod portable_math;
pub mod pose;
pub mod ramp;
pub mod random;
pub mod reachability;
pub mod resilient;
pub mod rewiring;
pub mod robustness;
pub mod scale;
pub mod trajectory;
pub mod unicycle;

/// A point or vector of the plane in the frame `map`, in meters or meters per second.
pub type Vec2 = nalgebra::Vector2<f64>;

/// Upper bound on the relative rounding error of a coordinate, a distance or a squared distance.
pub const RELATIVE_ROUNDING_ERROR_MAX: f64 = 1e-9;

/// Converts nanoseconds to seconds. The division, unlike a multiplication by 1e-9, makes 15 ms exactly the
/// literal 0.015.
pub fn ns_to_seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}
