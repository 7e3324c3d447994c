//! Under which keys ROS 2 knows nodes and topics, where rmw_zenoh carries them.
//!
//! A topic's key is `<domain>/<topic>/<type>/<type hash>`. Who is there is told by liveliness tokens, one
//! for each node and one for each of its senders and receivers. The crate `hiroz-protocol` 0.2 has this too, and cannot
//! be had without zenoh's default features: some forty crates for four lines.

use sha2::{Digest as _, Sha256};

/// How many bytes name a sender.
pub const GID_BYTES: usize = 16;
/// Reliable, volatile, the last ten: what `ros2 topic echo` asks for if nobody says otherwise. Left out
/// is what rmw_zenoh takes for granted; the durability is said, for which it changed its mind.
const QOS: &str = ":2:,10:,:,:,,";
/// What all tokens begin with.
const LIVELINESS: &str = "@ros2_lv";

/// A type of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageType {
    /// As DDS has it.
    pub name: &'static str,
    /// By REP 2011: the same from Iron to Lyrical.
    pub hash: &'static str,
}

/// `nav_msgs/msg/Odometry`.
pub const ODOMETRY: MessageType = MessageType {
    name: "nav_msgs::msg::dds_::Odometry_",
    hash: "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
};
/// `tf2_msgs/msg/TFMessage`.
pub const TF: MessageType = MessageType {
    name: "tf2_msgs::msg::dds_::TFMessage_",
    hash: "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
};

/// `geometry_msgs/msg/PoseStamped`.
pub const POSE_STAMPED: MessageType = MessageType {
    name: "geometry_msgs::msg::dds_::PoseStamped_",
    hash: "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
};

/// A node in the root namespace, by its place among those of this session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Node<'a> {
    /// The ROS domain.
    pub domain: u32,
    /// The id of the session, as zenoh prints it.
    pub session: &'a str,
    /// Its place.
    pub id: usize,
    /// Its name.
    pub name: &'a str,
}

impl Node<'_> {
    /// Says that it is there.
    pub fn token(&self) -> String {
        self.entity("NN", self.id)
    }

    /// Says that it sends on a topic, as its entity with this id.
    pub fn publisher_token(&self, id: usize, topic: &str, message: MessageType) -> String {
        self.end("MP", id, topic, message)
    }

    /// Says that it listens to a topic, as its entity with this id.
    pub fn subscriber_token(&self, id: usize, topic: &str, message: MessageType) -> String {
        self.end("MS", id, topic, message)
    }

    fn end(&self, kind: &str, id: usize, topic: &str, message: MessageType) -> String {
        let topic = topic.replace('/', "%");
        format!("{}/{topic}/{}/{}/{QOS}", self.entity(kind, id), message.name, message.hash)
    }

    fn entity(&self, kind: &str, id: usize) -> String {
        let Node { domain, session, id: node, name } = self;
        // No enclave, and the root namespace.
        format!("{LIVELINESS}/{domain}/{session}/{node}/{id}/{kind}/%/%/{name}")
    }
}

/// Under which key the messages of a topic are sent; its name begins with a slash.
pub fn key(domain: u32, topic: &str, message: MessageType) -> String {
    let topic = topic.trim_start_matches('/');
    format!("{domain}/{topic}/{}/{}", message.name, message.hash)
}

/// What names a sender, from its token: its alone, and the same to everybody.
pub fn gid(token: &str) -> [u8; GID_BYTES] {
    let digest = Sha256::digest(token.as_bytes());
    std::array::from_fn(|i| digest[i])
}

/// What rmw_zenoh wants beside each message, without which its receivers drop it: the message's number, from 1, when its
/// sender made it, in ROS time in ns, and who sent it. Three values without names, as since rmw_zenoh 0.2.4, the sender with
/// its length before it. (rmw_zenoh, issue 641)
pub fn attachment(sequence: i64, stamp_ns: i64, gid: &[u8; GID_BYTES]) -> Vec<u8> {
    let length = [GID_BYTES as u8];
    [&sequence.to_le_bytes()[..], &stamp_ns.to_le_bytes(), &length, gid].concat()
}

/// The topic of a robot's odometry.
pub fn odom(robot: &str) -> String {
    format!("/{robot}/odom")
}

/// The topic of a robot's goals.
pub fn goal_pose(robot: &str) -> String {
    format!("/{robot}/goal_pose")
}

/// Whether ROS 2 takes it for the name of a node and for a part of a topic's.
pub fn is_valid(name: &str) -> bool {
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    let only = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    begins && only && !name.contains("__")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODE: Node<'_> = Node { domain: 7, session: "0a1b", id: 3, name: "r1" };

    #[test]
    fn keys_and_tokens_are_those_of_rmw_zenoh() {
        let hash = ODOMETRY.hash;
        assert_eq!(
            key(7, &odom("r1"), ODOMETRY),
            format!("7/r1/odom/nav_msgs::msg::dds_::Odometry_/{hash}")
        );
        assert_eq!(NODE.token(), "@ros2_lv/7/0a1b/3/3/NN/%/%/r1");
        assert_eq!(
            NODE.publisher_token(4, "/r1/odom", ODOMETRY),
            format!(
                "@ros2_lv/7/0a1b/3/4/MP/%/%/r1/%r1%odom/nav_msgs::msg::dds_::Odometry_/{hash}/{QOS}"
            )
        );
        assert_eq!(
            NODE.subscriber_token(5, &goal_pose("r1"), POSE_STAMPED),
            format!(
                "@ros2_lv/7/0a1b/3/5/MS/%/%/r1/%r1%goal_pose/geometry_msgs::msg::dds_::PoseStamped_/{}/{QOS}",
                POSE_STAMPED.hash
            )
        );
    }

    #[test]
    fn an_attachment_is_number_time_and_sender() {
        let gid = std::array::from_fn(|i| i as u8);
        let bytes = attachment(0x0102, -1, &gid);
        assert_eq!(bytes[..8], [2, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[8..16], [0xff; 8]);
        assert_eq!(bytes[16], 16);
        assert_eq!(bytes[17..], gid);
    }

    #[test]
    fn a_sender_is_named_by_its_token() {
        let gids = [4, 5].map(|id| gid(&NODE.publisher_token(id, "/tf", TF)));
        assert_ne!(gids[0], gids[1]);
        assert_eq!(gids[0], gid(&NODE.publisher_token(4, "/tf", TF)));
    }

    #[test]
    fn only_names_that_ros_takes_are_taken() {
        for name in ["r1", "_x", "Leader_2"] {
            assert!(is_valid(name), "{name}");
        }
        for name in ["", "1r", "r-1", "r.1", "a__b", "r/1", "é"] {
            assert!(!is_valid(name), "{name}");
        }
    }
}
