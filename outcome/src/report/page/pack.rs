//! Compact encoding of frames inside of a page.
//!
//! The data are unsigned integers as LEB128 (seven bits per byte, lowest first, the top bit marks a continuation)
//! in base64. First come columns of one number per frame: time in ms, smallest distance in micrometers; then for
//! each robot x and y in mm, heading in mrad, error in 0.1 mm. If all robots stay within [`SMALL_SCENE_M_MAX`], x, y
//! and error are in micrometers. A number is 0 if there is no value, else 1 + the zigzag code of its difference from
//! the previous value of the column. Then follow for each robot and then for each edge its states, as pairs of a state
//! and the number of frames that it lasts.

use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde::Serialize;

use crate::report::scene::{EdgeState, RobotState, Scene, SceneFrame};

/// Maximum magnitude of a value. Larger ones are not drawn; steps of this size are still exact integers in a
/// browser.
const MAGNITUDE_MAX: f64 = 1e9;
/// Extent of all positions along x and along y below which they are stored in micrometers, m.
const SMALL_SCENE_M_MAX: f64 = 0.5;

/// Encoded frames for the page's script.
#[derive(Debug, Serialize)]
pub(super) struct PackedFrames {
    /// Number of frames.
    count: usize,
    /// Resolution of x and y, steps per m.
    per_m: f64,
    /// Resolution of errors, steps per m.
    error_per_m: f64,
    /// Encoded data; see the module.
    data: String,
}

/// Encodes the frames. A robot or an edge that a frame does not have is encoded without values, in its default
/// state.
pub(super) fn pack_frames(scene: &Scene, frames: &[SceneFrame]) -> PackedFrames {
    let mut bytes = Vec::new();
    let (per_m, error_per_m) = if is_small_scene(frames) { (1e6, 1e6) } else { (1e3, 1e4) };
    encode_column(&mut bytes, 1e3, frames.iter().map(|frame| Some(frame.t_s)));
    encode_column(&mut bytes, 1e6, frames.iter().map(|frame| frame.distance_m));
    for index in 0..scene.robots.len() {
        let robots = || frames.iter().map(move |frame| frame.robots.get(index));
        encode_column(&mut bytes, per_m, robots().map(|robot| Some(robot?.x_m)));
        encode_column(&mut bytes, per_m, robots().map(|robot| Some(robot?.y_m)));
        encode_column(&mut bytes, 1e3, robots().map(|robot| Some(robot?.heading_rad)));
        encode_column(&mut bytes, error_per_m, robots().map(|robot| robot?.error_m));
    }
    for index in 0..scene.robots.len() {
        let states = frames.iter().map(|frame| frame.robots.get(index).map(|robot| robot.state));
        encode_run_lengths(&mut bytes, states.map(|state| robot_code(state.unwrap_or_default())));
    }
    for index in 0..scene.edges.len() {
        let states = frames.iter().map(|frame| frame.edges.get(index).copied());
        encode_run_lengths(&mut bytes, states.map(|state| edge_code(state.unwrap_or_default())));
    }
    PackedFrames { count: frames.len(), per_m, error_per_m, data: BASE64_STANDARD.encode(bytes) }
}

/// Returns whether all positions lie within [`SMALL_SCENE_M_MAX`] along x and along y.
fn is_small_scene(frames: &[SceneFrame]) -> bool {
    let robots = || frames.iter().flat_map(|frame| &frame.robots);
    let extent_m = |values: &mut dyn Iterator<Item = f64>| {
        let finite = values.filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        high - low
    };
    let [x, y] = [
        extent_m(&mut robots().map(|robot| robot.x_m)),
        extent_m(&mut robots().map(|robot| robot.y_m)),
    ];
    x < SMALL_SCENE_M_MAX && y < SMALL_SCENE_M_MAX
}

fn robot_code(state: RobotState) -> u64 {
    match state {
        RobotState::Moving => 0,
        RobotState::Frozen => 1,
        RobotState::Dead => 2,
        RobotState::Starting => 3,
        RobotState::Orphaned => 4,
    }
}

fn edge_code(state: EdgeState) -> u64 {
    match state {
        EdgeState::Fresh => 0,
        EdgeState::Stale => 1,
        EdgeState::Lost => 2,
        EdgeState::Cut => 3,
        EdgeState::Dead => 4,
        EdgeState::Closed => 5,
    }
}

/// Encodes one value per frame in steps of 1 / `per_unit`.
fn encode_column(bytes: &mut Vec<u8>, per_unit: f64, values: impl Iterator<Item = Option<f64>>) {
    let mut previous = 0;
    for value in values {
        match value.filter(|value| value.abs() <= MAGNITUDE_MAX) {
            None => encode_number(bytes, 0),
            Some(value) => {
                let steps = (value * per_unit).round() as i64;
                let difference = steps - previous;
                encode_number(bytes, 1 + ((difference << 1) ^ (difference >> 63)) as u64);
                previous = steps;
            }
        }
    }
}

fn encode_run_lengths(bytes: &mut Vec<u8>, states: impl Iterator<Item = u64>) {
    let mut states = states.peekable();
    while let Some(state) = states.next() {
        let mut frame_count = 1;
        while states.next_if_eq(&state).is_some() {
            frame_count += 1;
        }
        encode_number(bytes, state);
        encode_number(bytes, frame_count);
    }
}

fn encode_number(bytes: &mut Vec<u8>, mut value: u64) {
    while value > 127 {
        bytes.push(value as u8 | 128);
        value >>= 7;
    }
    bytes.push(value as u8);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::report::scene::{FrameRobot, SceneEdge, SceneRobot};

    /// Decodes what [`number`] wrote, by another algorithm.
    fn decode_numbers(bytes: &[u8]) -> Vec<u64> {
        let value = |bytes: &[u8]| {
            bytes.iter().rev().fold(0, |value, byte| 128 * value + u64::from(byte & 127))
        };
        bytes.split_inclusive(|byte| *byte < 128).map(value).collect()
    }

    fn scene(robots: usize, edges: usize) -> Scene {
        let edges = vec![SceneEdge::default(); edges];
        Scene { robots: vec![SceneRobot::default(); robots], edges, ..Scene::default() }
    }

    /// Generates small values, values far beyond the picture, and missing ones.
    fn length() -> impl Strategy<Value = Option<f64>> {
        prop::option::of(prop_oneof![
            8 => -20.0..20.0,
            1 => -2e9..2e9,
            1 => prop::num::f64::ANY,
        ])
    }

    proptest! {
        #[test]
        fn packed_column_is_restored_within_half_a_step(
            values in prop::collection::vec(length(), 0..30),
            per_unit in prop::sample::select(vec![1e3, 1e4, 1e6]),
        ) {
            let mut bytes = Vec::new();
            encode_column(&mut bytes, per_unit, values.iter().copied());
            let codes = decode_numbers(&bytes);
            prop_assert_eq!(codes.len(), values.len());
            let mut steps = 0;
            for (code, value) in codes.into_iter().zip(values) {
                let value = value.filter(|value| value.abs() <= MAGNITUDE_MAX);
                prop_assert_eq!(code == 0, value.is_none());
                let Some(value) = value else { continue };
                let magnitude = ((code - 1) / 2) as i64;
                steps += if code % 2 == 1 { magnitude } else { -magnitude - 1 };
                let tolerance = 0.5 + 4.0 * f64::EPSILON * (value * per_unit).abs();
                prop_assert!((steps as f64 - value * per_unit).abs() <= tolerance);
            }
        }

        #[test]
        fn encoded_states_are_restored(states in prop::collection::vec(0..5_u64, 0..300)) {
            let mut bytes = Vec::new();
            encode_run_lengths(&mut bytes, states.iter().copied());
            let pairs = decode_numbers(&bytes);
            let decoded = pairs.chunks(2).flat_map(|pair| vec![pair[0]; pair[1] as usize]);
            prop_assert_eq!(decoded.collect::<Vec<u64>>(), states);
        }
    }

    #[test]
    fn packed_columns_keep_order_and_omit_missing_values() {
        let state = RobotState::Dead;
        let robot =
            FrameRobot { x_m: 0.002, y_m: 0.003, heading_rad: 0.004, error_m: Some(5e-4), state };
        let frame = SceneFrame {
            t_s: 0.001,
            robots: vec![robot],
            edges: vec![EdgeState::Lost],
            distance_m: Some(6e-6),
        };
        let packed = pack_frames(&scene(1, 1), &[frame]);
        // Each value v of a first frame is encoded as 2 v + 1; then follow the states and their durations. All
        // positions are within a small extent, so x = 2000, y = 3000 and the error 500 are in micrometers, two bytes
        // each.
        assert_eq!((packed.per_m, packed.error_per_m), (1e6, 1e6));
        let bytes = BASE64_STANDARD.decode(packed.data).unwrap();
        assert_eq!(bytes, [3, 13, 161, 31, 241, 46, 9, 233, 7, 2, 1, 2, 1]);
        let packed =
            pack_frames(&scene(1, 1), &[SceneFrame { t_s: 0.001, ..SceneFrame::default() }]);
        assert_eq!(BASE64_STANDARD.decode(packed.data).unwrap(), [3, 0, 0, 0, 0, 0, 0, 1, 0, 1]);
    }

    #[test]
    fn sixty_four_robots_over_eighty_seconds_stay_under_a_megabyte() {
        let frame = |step: u32| {
            let t_s = f64::from(step) / 20.0;
            let robot = |index: u32| {
                let angle_rad = 0.7 * t_s + f64::from(index);
                let (x_m, y_m) = (2.0 * angle_rad.cos(), 2.0 * angle_rad.sin());
                let heading_rad = angle_rad.sin().atan2(angle_rad.cos());
                let (error_m, state) = (Some((-0.1 * t_s).exp()), RobotState::Moving);
                FrameRobot { x_m, y_m, heading_rad, error_m, state }
            };
            let robots = (0..64).map(robot).collect();
            SceneFrame { t_s, robots, edges: vec![EdgeState::Fresh; 128], distance_m: Some(0.3) }
        };
        let frames: Vec<SceneFrame> = (0..=1600).map(frame).collect();
        let size = pack_frames(&scene(64, 128), &frames).data.len();
        assert!(size < 1_000_000, "{size} bytes");
    }
}
