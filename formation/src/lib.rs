//! The mathematics that every process shares: plain values in, plain values out.
//!
//! No I/O, no clock, no iceoryx2 in here. SI units; world frame `map`; x forward, y left, angles
//! counter-clockwise and in (-pi, pi].
//!
//! | file | question it answers |
//! |---|---|
//! | `pose` | where is a robot, and how does it move in its own frame? |
//! | `unicycle` | where does a held (v, w) take it, exactly? (1) |
//! | `ramp` | where does it take it while it changes gradually? |
//! | `front_point` | which point is controlled, and how does (v, w) move it? (2) (3) (17) |
//! | `graph` | who hears whom, at which offset? (Definition 1) |
//! | `reachability` | whose information reaches whom, and what does a death take from whom? |
//! | `robustness` | how many liars does a graph bear? |
//! | `laplacian` | what do the matrices L and A say, and where does the formation settle? (4)-(6) (31) |
//! | `trajectory` | where is the main leader to be? |
//! | `path` | which curve goes through waypoints, and where on it is one at a time? |
//! | `scale` | how large is the formation to be, and when does it open and close? |
//! | `frame` | how do offsets turn and grow with the leader? (20)-(23) |
//! | `desired` | where should a robot be, seen from those it hears? (13) (24) (46) |
//! | `resilient` | the same where some of them may lie? |
//! | `hull` | how far is a follower from the leaders' convex hull? (7) (49) |
//! | `closest` | which two robots are nearest to each other? (15) |
//! | `near` | which robots are near which, from one instant to the next? |
//! | `obstacle` | which point of a wall is nearest, and which walls are near? |
//! | `random` | what does a seed draw? |
//! | `real` | what are sine, exponential and the like, the same on every target? |

#![cfg_attr(test, allow(clippy::disallowed_methods))]

// Here, because everything is built on this: whoever builds elsewhere sees this sentence and no other.
#[cfg(not(any(target_os = "linux", target_arch = "wasm32")))]
compile_error!(
    "Phalanx runs on Linux only: on macOS and Windows, use Docker (see the Dockerfile) or WSL2."
);

pub mod closest;
pub mod desired;
pub mod frame;
pub mod front_point;
pub mod graph;
pub mod hull;
pub mod laplacian;
pub mod near;
pub mod obstacle;
pub mod path;
pub mod pose;
pub mod ramp;
pub mod random;
pub mod reachability;
pub mod real;
pub mod resilient;
pub mod robustness;
pub mod scale;
pub mod trajectory;
pub mod unicycle;

/// A point or vector of the plane in metres or metres per second, in the frame `map`.
pub type Vec2 = nalgebra::Vector2<f64>;

/// Rounding changes no coordinate, distance or square of one by so large a share.
pub const ROUNDING: f64 = 1e-9;

/// Nanoseconds as seconds. Divided, not multiplied by 1e-9: 15 ms are 0.015 s, with no digits behind.
pub fn seconds(ns: u64) -> f64 {
    ns as f64 / 1e9
}
