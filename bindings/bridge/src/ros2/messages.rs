//! The messages: `nav_msgs/msg/Odometry` and `tf2_msgs/msg/TFMessage` out, `geometry_msgs/msg/PoseStamped`
//! in, in SI units.
//!
//! Poses are in `map`, twists in the robot's own frame. Covariances are 0, which says that nothing is
//! known of them: what a run knows of its noise are bounds, and those are no covariances.

use formation::pose::{Pose, Twist};

use super::cdr::{Reader, Writer};
use super::names::base_link;
use super::stamp::split;

/// The frame that stands still.
pub const MAP: &str = "map";
/// Of a pose or a twist: six by six.
const COVARIANCE: [f64; 36] = [0.0; 36];

/// Where one robot is, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct State<'a> {
    /// Which.
    pub robot: &'a str,
    /// When, in ROS time, ns since 1970.
    pub ros_ns: u64,
    /// Of the axle's mid-point, in `map`.
    pub pose: Pose,
    /// In the robot's frame.
    pub twist: Twist,
}

/// As `nav_msgs/msg/Odometry`.
pub fn odometry(state: &State<'_>) -> Vec<u8> {
    let mut out = Writer::new();
    header(&mut out, state.ros_ns);
    out.string(&base_link(state.robot));
    out.f64s(&[state.pose.x_m, state.pose.y_m, 0.0]);
    out.f64s(&quaternion(state.pose.heading_rad));
    out.f64s(&COVARIANCE);
    out.f64s(&[state.twist.v_m_s, 0.0, 0.0]);
    out.f64s(&[0.0, 0.0, state.twist.w_rad_s]);
    out.f64s(&COVARIANCE);
    out.finish()
}

/// As `tf2_msgs/msg/TFMessage`: from `map` to each robot's `base_link`.
pub fn transforms(states: &[State<'_>]) -> Vec<u8> {
    let mut out = Writer::new();
    out.u32(states.len() as u32);
    for state in states {
        header(&mut out, state.ros_ns);
        out.string(&base_link(state.robot));
        out.f64s(&[state.pose.x_m, state.pose.y_m, 0.0]);
        out.f64s(&quaternion(state.pose.heading_rad));
    }
    out.finish()
}

/// A place in a frame, as a goal is given.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place<'a> {
    /// The frame.
    pub frame: &'a str,
    /// x, y, z, m.
    pub position_m: [f64; 3],
    /// x, y, z, w.
    pub orientation: [f64; 4],
}

/// Of `geometry_msgs/msg/PoseStamped`, without its stamp; `None` if it is laid out otherwise.
pub fn pose_stamped(message: &[u8]) -> Option<Place<'_>> {
    let mut read = Reader::new(message)?;
    let _stamp = (read.u32()?, read.u32()?);
    let frame = read.string()?;
    let place = Place { frame, position_m: read.f64s()?, orientation: read.f64s()? };
    read.is_done().then_some(place)
}

/// `std_msgs/msg/Header`, of `map`.
fn header(out: &mut Writer, ros_ns: u64) {
    let (s, ns) = split(ros_ns);
    out.i32(s);
    out.u32(ns);
    out.string(MAP);
}

/// x, y, z, w of a turn about z.
fn quaternion(heading_rad: f64) -> [f64; 4] {
    let half = heading_rad / 2.0;
    [0.0, 0.0, half.sin(), half.cos()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(robot: &str) -> State<'_> {
        State {
            robot,
            ros_ns: 1_700_000_000_000_000_007,
            pose: Pose { x_m: 1.5, y_m: -2.5, heading_rad: 0.5 },
            twist: Twist { v_m_s: 0.25, w_rad_s: -0.75 },
        }
    }

    /// Numbers at known places; `tests/ros2/by_rosbags.py` compares all bytes with another encoder.
    #[test]
    fn every_number_of_an_odometry_message_is_in_its_place() {
        let bytes = odometry(&state("r1"));
        let at = |place: usize| f64::from_le_bytes(bytes[place..place + 8].try_into().unwrap());
        assert_eq!(&bytes[4..12], &[0x00, 0xf1, 0x53, 0x65, 7, 0, 0, 0]);
        assert_eq!(&bytes[12..20], b"\x04\0\0\0map\0");
        assert_eq!(&bytes[20..37], b"\x0d\0\0\0r1/base_link\0");
        assert_eq!([44, 52, 60].map(at), [1.5, -2.5, 0.0]);
        assert_eq!([68, 76, 84, 92].map(at), [0.0, 0.0, 0.25_f64.sin(), 0.25_f64.cos()]);
        let twist = 100 + 36 * 8;
        assert_eq!(
            [0, 8, 16, 24, 32, 40].map(|i| at(twist + i)),
            [0.25, 0.0, 0.0, 0.0, 0.0, -0.75]
        );
        assert_eq!(bytes.len(), twist + 48 + 36 * 8);
    }

    #[test]
    fn transforms_have_one_entry_for_each_robot() {
        let one = transforms(&[state("r1")]);
        let two = transforms(&[state("r1"), state("robot_2")]);
        assert_eq!((one[4], two[4]), (1, 2));
        assert_eq!(&one[24..41], b"\x0d\0\0\0r1/base_link\0");
        assert_eq!(&two[8..one.len()], &one[8..]);
        assert!(two.windows(17).any(|bytes| bytes == b"robot_2/base_link"));
    }

    #[test]
    fn a_pose_is_read_as_it_is_written_and_in_no_other_layout() {
        let mut out = Writer::new();
        header(&mut out, 1_700_000_000_000_000_007);
        out.f64s(&[1.5, -2.5, 0.25]);
        out.f64s(&quaternion(0.5));
        let bytes = out.finish();
        let orientation = [0.0, 0.0, 0.25_f64.sin(), 0.25_f64.cos()];
        let expected = Place { frame: "map", position_m: [1.5, -2.5, 0.25], orientation };
        assert_eq!(pose_stamped(&bytes), Some(expected));
        (0..bytes.len()).for_each(|length| assert_eq!(pose_stamped(&bytes[..length]), None));
        let more = |count: usize| [&bytes[..], &vec![0; count]].concat();
        assert_eq!(pose_stamped(&more(3)), Some(expected), "padding");
        for count in [4, 8] {
            assert_eq!(pose_stamped(&more(count)), None, "{count} bytes more");
        }
        assert_eq!(pose_stamped(&odometry(&state("r1"))), None);
        assert_eq!(pose_stamped(&transforms(&[state("r1")])), None);
    }

    proptest::proptest! {
        #[test]
        fn garbage_is_never_a_panic(
            bytes in proptest::collection::vec(proptest::prelude::any::<u8>(), 0..120),
        ) {
            let _ = pose_stamped(&bytes);
            let _ = pose_stamped(&[&[0, 1, 0, 0][..], &bytes].concat());
        }
    }
}
