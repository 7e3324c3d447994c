//! Connection to ROS 2: zenoh on this machine only, without discovery.

use std::cell::Cell;
use std::time::Duration;

use protocol::process::StopFlag;
use protocol::ros2::Ros2Brief;
use serde_json::{Value, json};
use zenoh::Wait as _;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::sample::SampleKind;

use crate::ros2::names::{self, GID_BYTES, MessageType};
use crate::wire::{self, WireError};

/// Maximum duration of one attempt to reach the router, ms.
const CONNECT_TIMEOUT_MS: u64 = 1_000;
/// Pause between two attempts.
const RECONNECT_PAUSE: Duration = Duration::from_millis(500);

/// A session and its declared nodes.
pub struct Ros2Session {
    session: zenoh::Session,
    id: String,
    next_node_id: Cell<usize>,
    next_entity_id: Cell<usize>,
}

/// A ROS 2 node, announced while this value lives.
pub struct AnnouncedNode {
    domain: u32,
    id: usize,
    name: String,
    _token: LivelinessToken,
}

impl Ros2Session {
    /// Listens, or connects to a router, for which it waits without a limit. Returns `None` if the process is
    /// asked to stop.
    pub fn open(brief: &Ros2Brief, stop: &StopFlag) -> Result<Option<Ros2Session>, WireError> {
        let mut has_warned = false;
        while !stop.is_requested() {
            match wire::open(&session_config(brief)) {
                Ok(session) => {
                    let id = session.zid().to_string();
                    let (nodes, entities) = (Cell::new(0), Cell::new(0));
                    return Ok(Some(Ros2Session {
                        session,
                        id,
                        next_node_id: nodes,
                        next_entity_id: entities,
                    }));
                }
                Err(why) if brief.listens => {
                    return Err(WireError::Open(brief.address.to_string(), why));
                }
                Err(why) => {
                    if !has_warned {
                        tracing::warn!(address = %brief.address, %why, "waiting for a ROS 2 router");
                        has_warned = true;
                    }
                    std::thread::sleep(RECONNECT_PAUSE);
                }
            }
        }
        Ok(None)
    }

    /// Announces a node.
    pub fn announce_node(&self, domain: u32, name: &str) -> Result<AnnouncedNode, WireError> {
        let id = self.next_node_id.replace(self.next_node_id.get() + 1);
        let token = self
            .declare_token(names::NodeName { domain, session: &self.id, id, name }.node_token())?;
        Ok(AnnouncedNode { domain, id, name: name.into(), _token: token })
    }

    /// Declares a sender of a node on a topic.
    pub fn declare_sender(
        &self,
        owner: &AnnouncedNode,
        topic: &str,
        message: MessageType,
    ) -> Result<Sender, WireError> {
        let (id, node) = self.allocate_entity_id(owner);
        let token = node.publisher_token(id, topic, message);
        let gid = names::derive_gid(&token);
        let key = names::topic_key(owner.domain, topic, message);
        // A slow receiver loses messages, and delays no other.
        let publisher = self
            .session
            .declare_publisher(key.clone())
            .congestion_control(CongestionControl::Drop)
            .wait();
        let publisher = publisher.map_err(WireError::declare_error(&key))?;
        Ok(Sender {
            publisher,
            gid,
            sequence: 0,
            is_failing: false,
            _token: self.declare_token(token)?,
        })
    }

    /// Declares a receiver of a node on a topic until the end of the session. Messages are passed to `handle_message`,
    /// on a thread of zenoh.
    pub fn declare_receiver(
        &self,
        owner: &AnnouncedNode,
        topic: &str,
        message: MessageType,
        handle_message: impl Fn(&[u8]) + Send + Sync + 'static,
    ) -> Result<Receiver, WireError> {
        let (id, node) = self.allocate_entity_id(owner);
        let token = node.subscriber_token(id, topic, message);
        let key = names::topic_key(owner.domain, topic, message);
        let declared = self
            .session
            .declare_subscriber(key.clone())
            .callback(move |sample| match sample.kind() {
                SampleKind::Put => handle_message(&sample.payload().to_bytes()),
                SampleKind::Delete => {}
            })
            .background()
            .wait();
        declared.map_err(WireError::declare_error(&key))?;
        Ok(Receiver { _token: self.declare_token(token)? })
    }

    /// Returns the next entity number of a node, and that node.
    fn allocate_entity_id<'n>(&'n self, owner: &'n AnnouncedNode) -> (usize, names::NodeName<'n>) {
        let id = self.next_entity_id.replace(self.next_entity_id.get() + 1);
        (
            id,
            names::NodeName {
                domain: owner.domain,
                session: &self.id,
                id: owner.id,
                name: &owner.name,
            },
        )
    }

    fn declare_token(&self, key: String) -> Result<LivelinessToken, WireError> {
        let declared = self.session.liveliness().declare_token(key.clone()).wait();
        declared.map_err(WireError::declare_error(&key))
    }

    /// Closes the session.
    pub fn close(self) {
        wire::close(&self.session);
    }
}

/// A receiver of a node, announced while this value lives.
pub struct Receiver {
    _token: LivelinessToken,
}

/// Sender on one topic. It never blocks.
pub struct Sender {
    publisher: Publisher<'static>,
    gid: [u8; GID_BYTES],
    sequence: i64,
    is_failing: bool,
    _token: LivelinessToken,
}

impl Sender {
    /// Sends a message with this ROS time, ns.
    pub fn send(&mut self, ros_ns: u64, message: &[u8]) {
        self.sequence += 1;
        let attachment = names::encode_attachment(self.sequence, ros_ns as i64, &self.gid);
        let sent = self.publisher.put(message).attachment(attachment).wait();
        if let Err(error) = &sent
            && !self.is_failing
        {
            tracing::warn!(key = %self.publisher.key_expr(), %error, "not sent");
        }
        self.is_failing = sent.is_err();
    }
}

/// Returns the complete configuration, as JSON. A client is the mode for which routers forward everything in both
/// directions, whatever else is connected. (rmw_zenoh, issues 625 and 929)
fn session_config(brief: &Ros2Brief) -> Value {
    let endpoint = format!("tcp/{}", brief.address);
    let (mode, listen, connect) = match brief.listens {
        true => ("router", vec![endpoint], vec![]),
        false => ("client", vec![], vec![endpoint]),
    };
    json!({
        "mode": mode,
        "listen": { "timeout_ms": 0, "endpoints": listen, "exit_on_failure": true },
        "connect": { "timeout_ms": CONNECT_TIMEOUT_MS, "endpoints": connect, "exit_on_failure": true },
        // As in rmw_zenoh's router: nodes connected to it discover each other.
        "scouting": {
            "multicast": { "enabled": false },
            "gossip": { "enabled": brief.listens, "multihop": false },
        },
        "timestamping": { "enabled": false, "drop_future_timestamp": false },
        "adminspace": { "enabled": false },
        "transport": { "link": { "protocols": ["tcp"] } },
    })
}
