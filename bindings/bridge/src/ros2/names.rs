//! zenoh keys and tokens of ROS 2 nodes and topics in rmw_zenoh.
//!
//! The key of a topic is `<domain>/<topic>/<type>/<type hash>`. Entities are announced by liveliness tokens, one
//! for each node and one for each of its senders and receivers. The crate `hiroz-protocol` 0.2 has this too, but
//! requires zenoh's default features: some forty crates for four lines.

use sha2::{Digest as _, Sha256};

/// Length of the global id (GID) of a sender, bytes.
pub const GID_BYTES: usize = 16;
/// Quality of service: reliable, volatile, the last ten, the default of `ros2 topic echo`. Defaults of rmw_zenoh
/// are left out, except the durability, whose default has changed.
const QOS: &str = ":2:,10:,:,:,,";
/// Prefix of all tokens.
const LIVELINESS_PREFIX: &str = "@ros2_lv";

/// A message type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageType {
    /// Name in DDS form.
    pub name: &'static str,
    /// Type hash by REP 2011: the same from Iron to Lyrical.
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

/// A node in the root namespace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeName<'a> {
    /// ROS domain ID.
    pub domain: u32,
    /// Session ID, as zenoh prints it.
    pub session: &'a str,
    /// Number of the node within its session.
    pub id: usize,
    /// Name of the node.
    pub name: &'a str,
}

impl NodeName<'_> {
    /// Returns the liveliness token of the node.
    pub fn node_token(&self) -> String {
        self.entity_key("NN", self.id)
    }

    /// Returns the liveliness token of a sender of the node, with the entity number `id`.
    pub fn publisher_token(&self, id: usize, topic: &str, message: MessageType) -> String {
        self.endpoint_token("MP", id, topic, message)
    }

    /// Returns the liveliness token of a receiver of the node, with the entity number `id`.
    pub fn subscriber_token(&self, id: usize, topic: &str, message: MessageType) -> String {
        self.endpoint_token("MS", id, topic, message)
    }

    fn endpoint_token(&self, kind: &str, id: usize, topic: &str, message: MessageType) -> String {
        let topic = topic.replace('/', "%");
        format!("{}/{topic}/{}/{}/{QOS}", self.entity_key(kind, id), message.name, message.hash)
    }

    fn entity_key(&self, kind: &str, id: usize) -> String {
        let NodeName { domain, session, id: node, name } = self;
        // No enclave, and the root namespace.
        format!("{LIVELINESS_PREFIX}/{domain}/{session}/{node}/{id}/{kind}/%/%/{name}")
    }
}

/// Returns the key of a topic, whose name begins with a slash.
pub fn topic_key(domain: u32, topic: &str, message: MessageType) -> String {
    let topic = topic.trim_start_matches('/');
    format!("{domain}/{topic}/{}/{}", message.name, message.hash)
}

/// Returns the global id of a sender, derived from its token: unique, and the same for all receivers.
pub fn derive_gid(token: &str) -> [u8; GID_BYTES] {
    let digest = Sha256::digest(token.as_bytes());
    std::array::from_fn(|i| digest[i])
}

/// Returns the attachment that rmw_zenoh requires with each message, without which receivers drop it: sequence
/// number from 1, time of sending in ROS time, ns, and sender. Three values without names, as since rmw_zenoh
/// 0.2.4, the sender with a length prefix. (rmw_zenoh, issue 641)
pub fn encode_attachment(sequence: i64, stamp_ns: i64, gid: &[u8; GID_BYTES]) -> Vec<u8> {
    let length = [GID_BYTES as u8];
    [&sequence.to_le_bytes()[..], &stamp_ns.to_le_bytes(), &length, gid].concat()
}

/// Returns the topic of a robot's odometry.
pub fn odometry_topic(robot: &str) -> String {
    format!("/{robot}/odom")
}

/// Returns the topic of a robot's goals.
pub fn goal_topic(robot: &str) -> String {
    format!("/{robot}/goal_pose")
}

/// Returns whether ROS 2 accepts a name for a node and as part of a topic.
pub fn is_valid_name(name: &str) -> bool {
    let begins = name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    let only = name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    begins && only && !name.contains("__")
}

#[cfg(test)]
mod tests {
    use super::*;

    const NODE: NodeName<'_> = NodeName { domain: 7, session: "0a1b", id: 3, name: "r1" };

    #[test]
    fn keys_and_tokens_equal_those_of_rmw_zenoh() {
        let hash = ODOMETRY.hash;
        assert_eq!(
            topic_key(7, &odometry_topic("r1"), ODOMETRY),
            format!("7/r1/odom/nav_msgs::msg::dds_::Odometry_/{hash}")
        );
        assert_eq!(NODE.node_token(), "@ros2_lv/7/0a1b/3/3/NN/%/%/r1");
        assert_eq!(
            NODE.publisher_token(4, "/r1/odom", ODOMETRY),
            format!(
                "@ros2_lv/7/0a1b/3/4/MP/%/%/r1/%r1%odom/nav_msgs::msg::dds_::Odometry_/{hash}/{QOS}"
            )
        );
        assert_eq!(
            NODE.subscriber_token(5, &goal_topic("r1"), POSE_STAMPED),
            format!(
                "@ros2_lv/7/0a1b/3/5/MS/%/%/r1/%r1%goal_pose/geometry_msgs::msg::dds_::PoseStamped_/{}/{QOS}",
                POSE_STAMPED.hash
            )
        );
    }

    #[test]
    fn attachment_has_number_time_and_sender() {
        let gid = std::array::from_fn(|i| i as u8);
        let bytes = encode_attachment(0x0102, -1, &gid);
        assert_eq!(bytes[..8], [2, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(bytes[8..16], [0xff; 8]);
        assert_eq!(bytes[16], 16);
        assert_eq!(bytes[17..], gid);
    }

    #[test]
    fn gid_is_derived_from_the_token() {
        let gids = [4, 5].map(|id| derive_gid(&NODE.publisher_token(id, "/tf", TF)));
        assert_ne!(gids[0], gids[1]);
        assert_eq!(gids[0], derive_gid(&NODE.publisher_token(4, "/tf", TF)));
    }

    #[test]
    fn names_invalid_in_ros_are_refused() {
        for name in ["r1", "_x", "Leader_2"] {
            assert!(is_valid_name(name), "{name}");
        }
        for name in ["", "1r", "r-1", "r.1", "a__b", "r/1", "é"] {
            assert!(!is_valid_name(name), "{name}");
        }
    }
}
