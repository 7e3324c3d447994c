//! ROS 2 messages that a recording and the ROS 2 process have in common, in SI units: `nav_msgs/Odometry`,
//! `tf2_msgs/TFMessage`, `geometry_msgs/PoseStamped` and `geometry_msgs/Twist`.
//!
//! Frames follow REP 103 and 105: `map` is fixed, and `<robot>/base_link` lies on the axle mid-point, x forward.
//! Poses are in `map`, twists in the robot's own frame. Covariances are 0, which means unknown: the noise of a
//! run has known bounds, which are not covariances.

use formation::portable_math;
use formation::pose::{Pose, Twist};

use super::cdr::{Reader, Writer};

/// Fixed frame.
pub const MAP_FRAME: &str = "map";
/// Number of entries of the covariance of a pose or twist: six by six.
const COVARIANCE_ENTRIES: usize = 36;

/// Returns the name of the frame on a robot's axle.
pub fn base_link(robot: &str) -> String {
    format!("{robot}/base_link")
}

/// Pose and twist of one robot at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedState<'a> {
    frame: &'a str,
    stamp_ns: u64,
    /// x, y, z of the axle mid-point in `map`, m, and x, y, z, w of the orientation quaternion.
    pose: [f64; 7],
    twist: Twist,
}

impl<'a> StampedState<'a> {
    /// Creates the state of the robot with this [`base_link`]. `stamp_ns`: ns since 1970.
    pub fn new(frame: &'a str, stamp_ns: u64, pose: Pose, twist: Twist) -> StampedState<'a> {
        let (z, w) = portable_math::sin_cos(pose.heading_rad / 2.0);
        StampedState { frame, stamp_ns, pose: [pose.x_m, pose.y_m, 0.0, 0.0, 0.0, z, w], twist }
    }
}

/// Writes a `nav_msgs/Odometry`.
pub fn write_odometry(out: &mut Writer, state: &StampedState<'_>) {
    out.clear();
    write_header(out, state.stamp_ns);
    out.write_string(state.frame);
    out.write_f64s(&state.pose);
    out.write_f64s(&[0.0; COVARIANCE_ENTRIES]);
    write_linear_and_angular(out, state.twist);
    out.write_f64s(&[0.0; COVARIANCE_ENTRIES]);
}

/// Writes a `geometry_msgs/PoseStamped`.
pub fn write_pose_stamped(out: &mut Writer, state: &StampedState<'_>) {
    out.clear();
    write_header(out, state.stamp_ns);
    out.write_f64s(&state.pose);
}

/// Writes a `geometry_msgs/Twist`.
pub fn write_twist(out: &mut Writer, twist: Twist) {
    out.clear();
    write_linear_and_angular(out, twist);
}

/// Starts a `tf2_msgs/TFMessage` with `count` transforms.
pub fn begin_transforms(out: &mut Writer, count: usize) {
    out.clear();
    out.write_u32(count as u32);
}

/// Appends a transform from `map` to the robot's frame.
pub fn write_transform(out: &mut Writer, state: &StampedState<'_>) {
    write_header(out, state.stamp_ns);
    out.write_string(state.frame);
    out.write_f64s(&state.pose);
}

/// Writes a `std_msgs/Header` for the frame `map`.
fn write_header(out: &mut Writer, stamp_ns: u64) {
    out.write_time(stamp_ns);
    out.write_string(MAP_FRAME);
}

fn write_linear_and_angular(out: &mut Writer, twist: Twist) {
    out.write_f64s(&[twist.v_m_s, twist.side_m_s, 0.0, 0.0, 0.0, twist.w_rad_s]);
}

/// Pose of a `geometry_msgs/PoseStamped` in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose<'a> {
    /// Name of the frame.
    pub frame: &'a str,
    /// Position x, y, z, m.
    pub position_m: [f64; 3],
    /// Orientation quaternion x, y, z, w.
    pub orientation: [f64; 4],
}

impl StampedPose<'_> {
    /// Returns the pose in the plane.
    pub fn pose(&self) -> Pose {
        let ([x_m, y_m, _], [_, _, z, w]) = (self.position_m, self.orientation);
        Pose { x_m, y_m, heading_rad: 2.0 * portable_math::atan2(z, w) }
    }
}

/// Reads a `geometry_msgs/PoseStamped` without its stamp; `None` if it has another layout.
pub fn read_pose_stamped(message: &[u8]) -> Option<StampedPose<'_>> {
    let mut reader = Reader::new(message)?;
    let _stamp_ns = reader.read_time()?;
    let frame = reader.read_string()?;
    let pose =
        StampedPose { frame, position_m: reader.read_f64s()?, orientation: reader.read_f64s()? };
    reader.is_done().then_some(pose)
}

/// Reads a `geometry_msgs/Twist`; `None` if it has another layout.
pub fn read_twist(message: &[u8]) -> Option<Twist> {
    let mut reader = Reader::new(message)?;
    let [v_m_s, side_m_s, _, _, _, w_rad_s] = reader.read_f64s()?;
    reader.is_done().then_some(Twist { v_m_s, side_m_s, w_rad_s })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRAME: &str = "r1/base_link";
    const POSE: Pose = Pose { x_m: 1.5, y_m: -2.5, heading_rad: 0.5 };

    fn state(frame: &str, pose: Pose) -> StampedState<'_> {
        let twist = Twist::new(0.25, -0.75);
        StampedState::new(frame, 1_700_000_000_000_000_007, pose, twist)
    }

    fn encode(write: impl FnOnce(&mut Writer)) -> Vec<u8> {
        let mut out = Writer::new();
        write(&mut out);
        out.bytes().to_vec()
    }

    /// Checks numbers at known offsets; `tests/ros2/by_rosbags.py` compares all bytes with another encoder.
    #[test]
    fn odometry_numbers_have_their_offsets() {
        assert_eq!(base_link("r1"), FRAME);
        let bytes = encode(|out| write_odometry(out, &state(FRAME, POSE)));
        let number_at =
            |offset: usize| f64::from_le_bytes(bytes[offset..offset + 8].try_into().unwrap());
        assert_eq!(&bytes[4..12], &[0x00, 0xf1, 0x53, 0x65, 7, 0, 0, 0]);
        assert_eq!(&bytes[12..20], b"\x04\0\0\0map\0");
        assert_eq!(&bytes[20..37], b"\x0d\0\0\0r1/base_link\0");
        assert_eq!([44, 52, 60].map(number_at), [1.5, -2.5, 0.0]);
        assert_eq!([68, 76, 84, 92].map(number_at), [0.0, 0.0, 0.25_f64.sin(), 0.25_f64.cos()]);
        let twist = 100 + COVARIANCE_ENTRIES * 8;
        let numbers = [0, 8, 16, 24, 32, 40].map(|offset| number_at(twist + offset));
        assert_eq!(numbers, [0.25, 0.0, 0.0, 0.0, 0.0, -0.75]);
        assert_eq!(bytes.len(), twist + 48 + COVARIANCE_ENTRIES * 8);
    }

    #[test]
    fn transforms_have_one_entry_for_each_robot() {
        let (own, other) = (state(FRAME, POSE), state("robot_2/base_link", POSE));
        let all = |states: &[&StampedState<'_>]| {
            encode(|out| {
                begin_transforms(out, states.len());
                states.iter().for_each(|state| write_transform(out, state));
            })
        };
        let (one, two) = (all(&[&own]), all(&[&own, &other]));
        assert_eq!((one[4], two[4]), (1, 2));
        assert_eq!(&one[24..41], b"\x0d\0\0\0r1/base_link\0");
        assert_eq!(&two[8..one.len()], &one[8..]);
        assert!(two.windows(17).any(|bytes| bytes == b"robot_2/base_link"));
    }

    #[test]
    fn pose_round_trips_and_other_layouts_are_refused() {
        let bytes = encode(|out| write_pose_stamped(out, &state(FRAME, POSE)));
        let stamped_pose = read_pose_stamped(&bytes).unwrap();
        let orientation = [0.0, 0.0, 0.25_f64.sin(), 0.25_f64.cos()];
        assert_eq!(
            stamped_pose,
            StampedPose { frame: "map", position_m: [1.5, -2.5, 0.0], orientation }
        );
        (0..bytes.len()).for_each(|length| assert_eq!(read_pose_stamped(&bytes[..length]), None));
        let more = |count: usize| [&bytes[..], &vec![0; count]].concat();
        assert_eq!(read_pose_stamped(&more(3)), Some(stamped_pose), "padding");
        for count in [4, 8] {
            assert_eq!(read_pose_stamped(&more(count)), None, "{count} bytes more");
        }
        assert_eq!(
            read_pose_stamped(&encode(|out| write_odometry(out, &state(FRAME, POSE)))),
            None
        );
        assert_eq!(read_pose_stamped(&encode(|out| begin_transforms(out, 1))), None);
    }

    proptest! {
        #[test]
        fn pose_and_twist_round_trip(
            numbers in prop::array::uniform5(-9.0..9.0f64), heading_rad in -3.1..3.1f64,
        ) {
            let [x_m, y_m, v_m_s, side_m_s, w_rad_s] = numbers;
            let pose = Pose { x_m, y_m, heading_rad };
            let bytes = encode(|out| write_pose_stamped(out, &state(FRAME, pose)));
            let read = read_pose_stamped(&bytes).unwrap().pose();
            prop_assert_eq!([read.x_m, read.y_m], [x_m, y_m]);
            prop_assert!((read.heading_rad - heading_rad).abs() < 1e-14);
            let moved = Twist { v_m_s, side_m_s, w_rad_s };
            prop_assert_eq!(read_twist(&encode(|out| write_twist(out, moved))), Some(moved));
        }

        #[test]
        fn garbage_is_never_a_panic(bytes in prop::collection::vec(any::<u8>(), 0..120)) {
            let _ = read_pose_stamped(&bytes);
            let _ = read_pose_stamped(&[&[0, 1, 0, 0][..], &bytes].concat());
        }
    }
}
