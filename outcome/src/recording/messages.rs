//! One recorded instant as messages. They are put together once; an instant only replaces the numbers
//! in them, in place, so that writing it allocates nothing.

use crate::recording::cdr::{Reader, Sheet};

/// The frame in which everything is told.
pub(crate) const MAP: &str = "map";
/// A covariance of 6 x 6; zeros say that the truth is known exactly.
const COVARIANCE: usize = 36;
/// How many bytes behind a pose's x its orientation's z stands, with y, z, x and y between them.
const ORIENTATION_Z: usize = 5 * 8;
/// How many bytes behind a twist's linear x its angular z stands.
const ANGULAR_Z: usize = 5 * 8;

/// The true state of one robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State {
    /// Middle of the axle, m.
    pub x_m: f64,
    /// Middle of the axle, m.
    pub y_m: f64,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Longitudinal speed over the arc that ends here, m/s.
    pub v_m_s: f64,
    /// Turn rate over the arc that ends here, rad/s.
    pub w_rad_s: f64,
}

/// A rotation about the vertical: the two numbers of a quaternion that are not 0.
#[derive(Clone, Copy)]
struct Turn {
    z: f64,
    w: f64,
}

impl Turn {
    fn of(heading_rad: f64) -> Turn {
        let (z, w) = (heading_rad / 2.0).sin_cos();
        Turn { z, w }
    }

    fn heading_rad(self) -> f64 {
        2.0 * self.z.atan2(self.w)
    }
}

/// Where a robot's frame is.
fn frame(robot: &str) -> String {
    format!("{robot}/base_link")
}

/// Position and orientation, or translation and rotation: they look alike. Where x is.
fn put_pose(sheet: &mut Sheet) -> usize {
    let at = sheet.f64(0.0);
    put_zeros(sheet, 6);
    at
}

fn set_pose(sheet: &mut Sheet, at: usize, state: &State, turn: Turn) {
    sheet.set_f64(at, state.x_m);
    sheet.set_f64(at + 8, state.y_m);
    sheet.set_f64(at + ORIENTATION_Z, turn.z);
    sheet.set_f64(at + ORIENTATION_Z + 8, turn.w);
}

/// The linear and the angular velocity. Where the linear one's x is.
fn put_twist(sheet: &mut Sheet) -> usize {
    let at = sheet.f64(0.0);
    put_zeros(sheet, 5);
    at
}

fn set_twist(sheet: &mut Sheet, at: usize, state: &State) {
    sheet.set_f64(at, state.v_m_s);
    sheet.set_f64(at + ANGULAR_Z, state.w_rad_s);
}

fn put_zeros(sheet: &mut Sheet, count: usize) {
    for _ in 0..count {
        sheet.f64(0.0);
    }
}

/// `nav_msgs/Odometry`, `geometry_msgs/PoseStamped` and `geometry_msgs/Twist` of one robot, and its
/// places in the `tf2_msgs/TFMessage` of all.
pub(crate) struct RobotSheets {
    odometry: Sheet,
    odometry_pose: usize,
    odometry_twist: usize,
    pose: Sheet,
    pose_pose: usize,
    command: Sheet,
    command_twist: usize,
    transform_stamp: usize,
    transform: usize,
}

/// Where the stamp of a message is that begins with one.
const STAMP: usize = 4;

impl RobotSheets {
    fn new(robot: &str, tf: &mut Sheet) -> RobotSheets {
        let mut odometry = Sheet::new();
        odometry.time(0);
        odometry.text(MAP);
        odometry.text(&frame(robot));
        let odometry_pose = put_pose(&mut odometry);
        put_zeros(&mut odometry, COVARIANCE);
        let odometry_twist = put_twist(&mut odometry);
        put_zeros(&mut odometry, COVARIANCE);
        let mut pose = Sheet::new();
        pose.time(0);
        pose.text(MAP);
        let pose_pose = put_pose(&mut pose);
        let mut command = Sheet::new();
        let command_twist = put_twist(&mut command);
        let transform_stamp = tf.time(0);
        tf.text(MAP);
        tf.text(&frame(robot));
        let transform = put_pose(tf);
        RobotSheets {
            odometry,
            odometry_pose,
            odometry_twist,
            pose,
            pose_pose,
            command,
            command_twist,
            transform_stamp,
            transform,
        }
    }

    /// Odometry, pose and command, as bytes.
    pub(crate) fn bytes(&self) -> [&[u8]; 3] {
        [self.odometry.bytes(), self.pose.bytes(), self.command.bytes()]
    }
}

/// All messages of one instant but the events.
pub(crate) struct Sheets {
    pub(crate) robots: Vec<RobotSheets>,
    tf: Sheet,
    metrics: Sheet,
    metrics_distance: usize,
    metrics_errors: usize,
    metrics_alive: usize,
    metrics_ideal: usize,
}

/// The smallest distance between two front points at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// How near, m.
    pub distance_m: f64,
    /// Which two: places in the scenario, from 0.
    pub pair: [usize; 2],
}

impl Sheets {
    pub(crate) fn new(names: &[String]) -> Sheets {
        let count = names.len() as u32;
        let mut tf = Sheet::new();
        tf.u32(count);
        let robots = names.iter().map(|name| RobotSheets::new(name, &mut tf)).collect();
        let mut metrics = Sheet::new();
        metrics.time(0);
        let metrics_distance = metrics.f64(f64::NAN);
        metrics.u32(0);
        metrics.u32(0);
        metrics.u32(count);
        for name in names {
            metrics.text(name);
        }
        metrics.u32(count);
        // The first number decides where the others are; without any there is nothing to set.
        let errors: Vec<usize> = names.iter().map(|_| metrics.f64(f64::NAN)).collect();
        metrics.u32(count);
        let alive: Vec<usize> = names.iter().map(|_| metrics.u8(0)).collect();
        metrics.u32(count);
        let ideal: Vec<usize> = names.iter().map(|_| metrics.f64(f64::NAN)).collect();
        Sheets {
            robots,
            tf,
            metrics,
            metrics_distance,
            metrics_errors: errors.first().copied().unwrap_or(0),
            metrics_alive: alive.first().copied().unwrap_or(0),
            metrics_ideal: ideal.first().copied().unwrap_or(0),
        }
    }

    /// Writes this instant into all messages. The lists are in scenario order.
    pub(crate) fn set(
        &mut self,
        stamp_ns: u64,
        states: impl Iterator<Item = State>,
        errors_m: [&[Option<f64>]; 2],
        alive: &[bool],
        nearest: Option<Nearest>,
    ) {
        for (sheets, state) in self.robots.iter_mut().zip(states) {
            let turn = Turn::of(state.heading_rad);
            sheets.odometry.set_time(STAMP, stamp_ns);
            set_pose(&mut sheets.odometry, sheets.odometry_pose, &state, turn);
            set_twist(&mut sheets.odometry, sheets.odometry_twist, &state);
            sheets.pose.set_time(STAMP, stamp_ns);
            set_pose(&mut sheets.pose, sheets.pose_pose, &state, turn);
            set_twist(&mut sheets.command, sheets.command_twist, &state);
            self.tf.set_time(sheets.transform_stamp, stamp_ns);
            set_pose(&mut self.tf, sheets.transform, &state, turn);
        }
        self.metrics.set_time(STAMP, stamp_ns);
        self.metrics.set_f64(self.metrics_distance, nearest.map_or(f64::NAN, |n| n.distance_m));
        let pair = nearest.map_or([0, 0], |n| n.pair);
        self.metrics.set_u32(self.metrics_distance + 8, pair[0] as u32);
        self.metrics.set_u32(self.metrics_distance + 12, pair[1] as u32);
        for (at, errors_m) in [self.metrics_errors, self.metrics_ideal].into_iter().zip(errors_m) {
            for (i, error_m) in errors_m.iter().enumerate().take(self.robots.len()) {
                self.metrics.set_f64(at + 8 * i, error_m.unwrap_or(f64::NAN));
            }
        }
        for (i, &alive) in alive.iter().enumerate().take(self.robots.len()) {
            self.metrics.set_u8(self.metrics_alive + i, u8::from(alive));
        }
    }

    pub(crate) fn tf(&self) -> &[u8] {
        self.tf.bytes()
    }

    pub(crate) fn metrics(&self) -> &[u8] {
        self.metrics.bytes()
    }
}

/// `rcl_interfaces/Log`: the stamp, how bad it is, and what happened to whom.
pub(crate) fn write_log(sheet: &mut Sheet, stamp_ns: u64, event: &Event<'_>) {
    let Event { level, name, kind, text } = event;
    sheet.clear();
    sheet.time(stamp_ns);
    sheet.u8(*level);
    sheet.text(name);
    sheet.text(text);
    sheet.text("");
    sheet.text(kind);
    sheet.u32(0);
}

/// What an event says in `/rosout`.
#[derive(Debug, PartialEq)]
pub(crate) struct Event<'a> {
    pub(crate) level: u8,
    /// The robot, or who speaks for the run as a whole.
    pub(crate) name: &'a str,
    pub(crate) kind: &'a str,
    /// The kind, and behind it what there is to say.
    pub(crate) text: &'a str,
}

/// What a `rcl_interfaces/Log` says.
pub(crate) fn read_log(message: &[u8]) -> Option<Event<'_>> {
    let mut reader = Reader::new(message)?;
    reader.time()?;
    let (level, name, text) = (reader.u8()?, reader.text()?, reader.text()?);
    reader.text()?;
    Some(Event { level, name, kind: reader.text()?, text })
}

/// x, y and heading of a `geometry_msgs/PoseStamped`, m and rad.
pub(crate) fn read_pose(message: &[u8]) -> Option<[f64; 3]> {
    let mut reader = Reader::new(message)?;
    reader.time()?;
    reader.text()?;
    let (x_m, y_m, _) = (reader.f64()?, reader.f64()?, reader.f64()?);
    let (_, _, z, w) = (reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?);
    Some([x_m, y_m, Turn { z, w }.heading_rad()])
}

/// v and w of a `geometry_msgs/Twist`, m/s and rad/s.
pub(crate) fn read_twist(message: &[u8]) -> Option<[f64; 2]> {
    let mut reader = Reader::new(message)?;
    let numbers: Option<Vec<f64>> = (0..6).map(|_| reader.f64()).collect();
    numbers.map(|numbers| [numbers[0], numbers[5]])
}

/// What a `phalanx_msgs/Metrics` says.
pub(crate) struct Metrics<'a> {
    pub(crate) nearest: Option<Nearest>,
    pub(crate) robots: Vec<&'a str>,
    pub(crate) errors_m: Vec<Option<f64>>,
    pub(crate) alive: Vec<bool>,
    /// Empty in a recording of an earlier version.
    pub(crate) ideal_errors_m: Vec<Option<f64>>,
}

pub(crate) fn read_metrics(message: &[u8]) -> Option<Metrics<'_>> {
    let mut reader = Reader::new(message)?;
    reader.time()?;
    let distance_m = reader.f64()?;
    let pair = [reader.u32()? as usize, reader.u32()? as usize];
    let errors = |reader: &mut Reader<'_>| {
        let list = reader.list(Reader::f64)?.into_iter();
        Some(list.map(|error_m| (!error_m.is_nan()).then_some(error_m)).collect())
    };
    Some(Metrics {
        nearest: (!distance_m.is_nan()).then_some(Nearest { distance_m, pair }),
        robots: reader.list(Reader::text)?,
        errors_m: errors(&mut reader)?,
        alive: reader.list(|reader| Some(reader.u8()? != 0))?,
        ideal_errors_m: errors(&mut reader).unwrap_or_default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn what_is_written_in_place_is_read_again_whatever_the_names(
            names in prop::collection::vec("[a-z]{1,9}", 1..6),
            numbers in prop::array::uniform5(-9.0..9.0f64),
            heading_rad in -3.1..3.1f64,
            stamp_ns in 0..2_000_000_000_000_000_000u64,
            lives in any::<bool>(),
        ) {
            let mut sheets = Sheets::new(&names);
            let state = |i: usize| State {
                x_m: numbers[0] + i as f64,
                y_m: numbers[1],
                heading_rad,
                v_m_s: numbers[2],
                w_rad_s: numbers[3],
            };
            let last = names.len() - 1;
            let errors: Vec<_> = (0..names.len()).map(|i| (i > 0).then_some(numbers[4])).collect();
            let ideal: Vec<_> = errors.iter().map(|error| error.map(|e| 2.0 * e)).collect();
            let alive = vec![lives; names.len()];
            let nearest = (last > 0).then_some(Nearest { distance_m: 0.3, pair: [0, last] });
            // Twice: the second must not depend on what the first left.
            for _ in 0..2 {
                let errors = [&errors[..], &ideal[..]];
                sheets.set(stamp_ns, (0..names.len()).map(state), errors, &alive, nearest);
            }
            for (i, robot) in sheets.robots.iter().enumerate() {
                let [odometry, pose, command] = robot.bytes();
                let [x_m, y_m, heading] = read_pose(pose).unwrap();
                prop_assert_eq!([x_m, y_m], [state(i).x_m, state(i).y_m]);
                prop_assert!((heading - heading_rad).abs() < 1e-14);
                prop_assert_eq!(read_twist(command), Some([state(i).v_m_s, state(i).w_rad_s]));
                let mut reader = Reader::new(odometry).unwrap();
                prop_assert_eq!(reader.time(), Some(stamp_ns));
                prop_assert_eq!(reader.text(), Some(MAP));
                let frame = frame(&names[i]);
                prop_assert_eq!(reader.text(), Some(frame.as_str()));
                let all: Vec<f64> = std::iter::from_fn(|| reader.f64()).collect();
                prop_assert_eq!(all.len(), 7 + 36 + 6 + 36);
                prop_assert_eq!([all[0], all[1]], [x_m, y_m]);
                prop_assert_eq!([all[43], all[48]], [state(i).v_m_s, state(i).w_rad_s]);
            }
            let mut tf = Reader::new(sheets.tf()).unwrap();
            prop_assert_eq!(tf.u32(), Some(names.len() as u32));
            for (i, name) in names.iter().enumerate() {
                prop_assert_eq!(tf.time(), Some(stamp_ns));
                let frame = frame(name);
                prop_assert_eq!((tf.text(), tf.text()), (Some(MAP), Some(frame.as_str())));
                prop_assert_eq!(tf.f64(), Some(state(i).x_m));
                prop_assert!((0..6).all(|_| tf.f64().is_some()));
            }
            prop_assert_eq!(tf.u8(), None);
            let metrics = read_metrics(sheets.metrics()).unwrap();
            prop_assert_eq!(metrics.nearest, nearest);
            prop_assert_eq!(metrics.robots, names);
            prop_assert_eq!(metrics.errors_m, errors);
            prop_assert_eq!(metrics.alive, alive);
            prop_assert_eq!(metrics.ideal_errors_m, ideal);
        }
    }
}
