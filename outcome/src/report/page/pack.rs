//! Frames, small enough to travel inside a page.
//!
//! A string of whole numbers as LEB128 (seven bits a byte, the lowest first, the top bit: more
//! follow) in base64. First columns of one number per frame: time in ms, smallest distance in
//! micrometers; then for each robot x and y in mm, heading in mrad, error in 0.1 mm. A number is 0
//! where there is none, or 1 + the zigzag of its difference from the column's last one. Then for
//! each robot and after that for each edge its states as pairs of state and how many frames it lasts.

use base64::prelude::{BASE64_STANDARD, Engine as _};
use serde::Serialize;

use crate::report::scene::{EdgeState, Frame, RobotState, Scene};

/// Nothing larger is drawn; its steps are still whole numbers to a browser.
const MAGNITUDE_MAX: f64 = 1e9;

/// What the page's script unpacks.
#[derive(Debug, Serialize)]
pub(super) struct Packed {
    /// Number of frames.
    count: usize,
    /// As the file's head says.
    data: String,
}

/// A robot or an edge that a frame does not have is drawn as in its default state, nowhere.
pub(super) fn pack(scene: &Scene, frames: &[Frame]) -> Packed {
    let mut bytes = Vec::new();
    column(&mut bytes, 1e3, frames.iter().map(|frame| Some(frame.t_s)));
    column(&mut bytes, 1e6, frames.iter().map(|frame| frame.distance_m));
    for place in 0..scene.robots.len() {
        let robots = || frames.iter().map(move |frame| frame.robots.get(place));
        column(&mut bytes, 1e3, robots().map(|robot| Some(robot?.x_m)));
        column(&mut bytes, 1e3, robots().map(|robot| Some(robot?.y_m)));
        column(&mut bytes, 1e3, robots().map(|robot| Some(robot?.heading_rad)));
        column(&mut bytes, 1e4, robots().map(|robot| robot?.error_m));
    }
    for place in 0..scene.robots.len() {
        let states = frames.iter().map(|frame| frame.robots.get(place).map(|robot| robot.state));
        runs(&mut bytes, states.map(|state| robot_code(state.unwrap_or_default())));
    }
    for place in 0..scene.edges.len() {
        let states = frames.iter().map(|frame| frame.edges.get(place).copied());
        runs(&mut bytes, states.map(|state| edge_code(state.unwrap_or_default())));
    }
    Packed { count: frames.len(), data: BASE64_STANDARD.encode(bytes) }
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
    }
}

/// One value per frame in steps of 1 / `per_unit`.
fn column(bytes: &mut Vec<u8>, per_unit: f64, values: impl Iterator<Item = Option<f64>>) {
    let mut last = 0;
    for value in values {
        match value.filter(|value| value.abs() <= MAGNITUDE_MAX) {
            None => number(bytes, 0),
            Some(value) => {
                let steps = (value * per_unit).round() as i64;
                let difference = steps - last;
                number(bytes, 1 + ((difference << 1) ^ (difference >> 63)) as u64);
                last = steps;
            }
        }
    }
}

fn runs(bytes: &mut Vec<u8>, states: impl Iterator<Item = u64>) {
    let mut states = states.peekable();
    while let Some(state) = states.next() {
        let mut lasts = 1;
        while states.next_if_eq(&state).is_some() {
            lasts += 1;
        }
        number(bytes, state);
        number(bytes, lasts);
    }
}

fn number(bytes: &mut Vec<u8>, mut value: u64) {
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

    /// Reads what [`pack`] wrote, the other way round and in other words.
    struct Unpack {
        bytes: std::vec::IntoIter<u8>,
        count: usize,
    }

    impl Unpack {
        fn number(&mut self) -> u64 {
            let byte = u64::from(self.bytes.next().expect("the packed frames end too early"));
            if byte < 128 { byte } else { byte - 128 + 128 * self.number() }
        }

        fn column(&mut self, per_unit: f64) -> Vec<Option<f64>> {
            let mut last = 0;
            let one = |unpack: &mut Unpack| {
                let code = unpack.number().checked_sub(1)?;
                let half = (code / 2) as i64;
                last += if code % 2 == 0 { half } else { -half - 1 };
                Some(last as f64 / per_unit)
            };
            (0..self.count).scan(one, |one, _| Some(one(self))).collect()
        }

        fn runs(&mut self) -> Vec<u64> {
            let mut states = Vec::new();
            while states.len() < self.count {
                let state = self.number();
                states.extend((0..self.number()).map(|_| state));
            }
            states
        }
    }

    fn scene(robots: usize, edges: usize) -> Scene {
        let robot = SceneRobot { name: "r".into(), role: "formation".into(), front_point_m: 0.1 };
        Scene {
            name: "made up".into(),
            pace: "lockstep".into(),
            duration_s: 80.0,
            distance_min_m: 0.2,
            robots: vec![robot; robots],
            edges: vec![SceneEdge { from: 0, to: 0 }; edges],
            walls: vec![],
            faults: vec![],
        }
    }

    fn close(unpacked: &[Option<f64>], asked: impl Iterator<Item = Option<f64>>, step: f64) {
        for (unpacked, asked) in unpacked.iter().zip(asked) {
            let asked = asked.filter(|asked| asked.is_finite() && asked.abs() <= MAGNITUDE_MAX);
            match (unpacked, asked) {
                (Some(unpacked), Some(asked)) => {
                    let slack = 4.0 * f64::EPSILON * asked.abs();
                    assert!(
                        (unpacked - asked).abs() <= step / 2.0 + slack,
                        "{unpacked} for {asked}"
                    );
                }
                (unpacked, asked) => assert_eq!(*unpacked, asked),
            }
        }
    }

    fn check(scene: &Scene, frames: &[Frame]) {
        let packed = pack(scene, frames);
        assert_eq!(packed.count, frames.len());
        let bytes = BASE64_STANDARD.decode(&packed.data).unwrap();
        let mut unpack = Unpack { bytes: bytes.into_iter(), count: frames.len() };
        close(&unpack.column(1e3), frames.iter().map(|frame| Some(frame.t_s)), 1e-3);
        close(&unpack.column(1e6), frames.iter().map(|frame| frame.distance_m), 1e-6);
        for place in 0..scene.robots.len() {
            let robots = || frames.iter().map(|frame| &frame.robots[place]);
            close(&unpack.column(1e3), robots().map(|robot| Some(robot.x_m)), 1e-3);
            close(&unpack.column(1e3), robots().map(|robot| Some(robot.y_m)), 1e-3);
            close(&unpack.column(1e3), robots().map(|robot| Some(robot.heading_rad)), 1e-3);
            close(&unpack.column(1e4), robots().map(|robot| robot.error_m), 1e-4);
        }
        for place in 0..scene.robots.len() {
            let asked = frames.iter().map(|frame| robot_code(frame.robots[place].state));
            assert_eq!(unpack.runs(), asked.collect::<Vec<_>>());
        }
        for place in 0..scene.edges.len() {
            let asked = frames.iter().map(|frame| edge_code(frame.edges[place]));
            assert_eq!(unpack.runs(), asked.collect::<Vec<_>>());
        }
        assert_eq!(unpack.bytes.next(), None, "bytes are left over");
    }

    /// Lengths of every kind: small, far beyond the picture, and none at all.
    fn length() -> impl Strategy<Value = f64> {
        prop_oneof![
            8 => -20.0..20.0,
            1 => -2e9..2e9,
            1 => prop::num::f64::ANY,
        ]
    }

    fn robot() -> impl Strategy<Value = FrameRobot> {
        use RobotState::{Dead, Frozen, Moving, Orphaned, Starting};
        let state = prop::sample::select(vec![Moving, Frozen, Dead, Starting, Orphaned]);
        let place = (length(), length(), -3.15..3.15, prop::option::of(length()), state);
        place.prop_map(|(x_m, y_m, heading_rad, error_m, state)| FrameRobot {
            x_m,
            y_m,
            heading_rad,
            error_m,
            state,
        })
    }

    fn recorded() -> impl Strategy<Value = (usize, usize, Vec<Frame>)> {
        use EdgeState::{Cut, Dead, Fresh, Lost, Stale};
        (0..4_usize, 0..4_usize, 0..30_usize).prop_flat_map(|(robots, edges, count)| {
            let edge = prop::sample::select(vec![Fresh, Stale, Lost, Cut, Dead]);
            let robot = prop::collection::vec(robot(), robots);
            let edge = prop::collection::vec(edge, edges);
            let frame = (length(), robot, edge, prop::option::of(length()));
            let frame = frame.prop_map(|(t_s, robots, edges, distance_m)| Frame {
                t_s,
                robots,
                edges,
                distance_m,
            });
            (Just(robots), Just(edges), prop::collection::vec(frame, count))
        })
    }

    proptest! {
        #[test]
        fn any_frames_come_back_within_half_a_step((robots, edges, frames) in recorded()) {
            check(&scene(robots, edges), &frames);
        }
    }

    #[test]
    fn a_frame_that_lacks_robots_or_edges_is_packed_all_the_same() {
        let packed = pack(&scene(1, 1), &[Frame { t_s: 0.001, ..Frame::default() }]);
        // t: 1 + 2; no distance, x, y, heading, error; moving for one frame; fresh for one frame.
        assert_eq!(BASE64_STANDARD.decode(packed.data).unwrap(), [3, 0, 0, 0, 0, 0, 0, 1, 0, 1]);
    }

    #[test]
    fn sixty_four_robots_over_eighty_seconds_stay_under_a_megabyte() {
        let frames: Vec<_> = (0..=1600)
            .map(|step| {
                let t_s = f64::from(step) / 20.0;
                let robot = |place: u32| {
                    let turn = 0.7 * t_s + f64::from(place);
                    FrameRobot {
                        x_m: 2.0 * turn.cos(),
                        y_m: 2.0 * turn.sin(),
                        heading_rad: turn.sin().atan2(turn.cos()),
                        error_m: Some((-0.1 * t_s).exp()),
                        state: RobotState::Moving,
                    }
                };
                let robots = (0..64).map(robot).collect();
                Frame { t_s, robots, edges: vec![EdgeState::Fresh; 128], distance_m: Some(0.3) }
            })
            .collect();
        let scene = scene(64, 128);
        check(&scene, &frames);
        let size = pack(&scene, &frames).data.len();
        assert!(size < 1_000_000, "{size} bytes");
    }
}
