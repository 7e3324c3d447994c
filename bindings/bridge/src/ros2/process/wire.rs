//! The connection to ROS 2: zenoh, on this machine only, with nothing of its own accord.

use std::cell::Cell;
use std::time::Duration;

use protocol::process::Stop;
use protocol::ros2::Ros2Brief;
use serde_json::{Value, json};
use zenoh::Wait as _;
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::sample::SampleKind;

use crate::ros2::names::{self, GID_BYTES, MessageType};
use crate::wire::{self, WireError};

/// How long one attempt to reach the router may take, ms.
const CONNECT_MS: u64 = 1_000;
/// Between two attempts.
const PAUSE: Duration = Duration::from_millis(500);

/// The session, and what was declared in it so far.
pub struct Wire {
    session: zenoh::Session,
    id: String,
    nodes: Cell<usize>,
    entities: Cell<usize>,
}

/// A node of ROS 2; it is there as long as this is.
pub struct Node {
    domain: u32,
    id: usize,
    name: String,
    _token: LivelinessToken,
}

impl Wire {
    /// Listens; or connects to a router, however long there is none. `None`: it was asked to stop.
    pub fn open(brief: &Ros2Brief, stop: &Stop) -> Result<Option<Wire>, WireError> {
        let mut told = false;
        while !stop.requested() {
            match wire::open(&config(brief)) {
                Ok(session) => {
                    let id = session.zid().to_string();
                    let (nodes, entities) = (Cell::new(0), Cell::new(0));
                    return Ok(Some(Wire { session, id, nodes, entities }));
                }
                Err(why) if brief.listens => {
                    return Err(WireError::Open(brief.address.to_string(), why));
                }
                Err(why) => {
                    if !told {
                        tracing::warn!(address = %brief.address, %why, "no router of ROS 2 there yet");
                        told = true;
                    }
                    std::thread::sleep(PAUSE);
                }
            }
        }
        Ok(None)
    }

    /// Says that a node is there.
    pub fn node(&self, domain: u32, name: &str) -> Result<Node, WireError> {
        let id = self.nodes.replace(self.nodes.get() + 1);
        let token = self.token(names::Node { domain, session: &self.id, id, name }.token())?;
        Ok(Node { domain, id, name: name.into(), _token: token })
    }

    /// Says that a node sends on a topic.
    pub fn sender(
        &self,
        of: &Node,
        topic: &str,
        message: MessageType,
    ) -> Result<Sender, WireError> {
        let (id, node) = self.entity(of);
        let token = node.publisher_token(id, topic, message);
        let gid = names::gid(&token);
        let key = names::key(of.domain, topic, message);
        // Whoever is slow loses messages, and holds up nobody.
        let publisher = self
            .session
            .declare_publisher(key.clone())
            .congestion_control(CongestionControl::Drop)
            .wait();
        let publisher = publisher.map_err(WireError::declaring(&key))?;
        Ok(Sender { publisher, gid, sequence: 0, failing: false, _token: self.token(token)? })
    }

    /// Lets a node listen to a topic, from now to the end of the session: what arrives is handed to `take`, on a thread
    /// of zenoh's.
    pub fn receive(
        &self,
        of: &Node,
        topic: &str,
        message: MessageType,
        take: impl Fn(&[u8]) + Send + Sync + 'static,
    ) -> Result<Receiver, WireError> {
        let (id, node) = self.entity(of);
        let token = node.subscriber_token(id, topic, message);
        let key = names::key(of.domain, topic, message);
        let declared = self
            .session
            .declare_subscriber(key.clone())
            .callback(move |sample| match sample.kind() {
                SampleKind::Put => take(&sample.payload().to_bytes()),
                SampleKind::Delete => {}
            })
            .background()
            .wait();
        declared.map_err(WireError::declaring(&key))?;
        Ok(Receiver { _token: self.token(token)? })
    }

    /// The id of another sender or receiver of a node, and that node.
    fn entity<'n>(&'n self, of: &'n Node) -> (usize, names::Node<'n>) {
        let id = self.entities.replace(self.entities.get() + 1);
        (id, names::Node { domain: of.domain, session: &self.id, id: of.id, name: &of.name })
    }

    fn token(&self, key: String) -> Result<LivelinessToken, WireError> {
        let declared = self.session.liveliness().declare_token(key.clone()).wait();
        declared.map_err(WireError::declaring(&key))
    }

    /// Ends it.
    pub fn close(self) {
        wire::close(&self.session);
    }
}

/// A node that listens to a topic; it says so as long as this is there.
pub struct Receiver {
    _token: LivelinessToken,
}

/// Sends on one topic. Never waits.
pub struct Sender {
    publisher: Publisher<'static>,
    gid: [u8; GID_BYTES],
    sequence: i64,
    failing: bool,
    _token: LivelinessToken,
}

impl Sender {
    /// A message that was made at this time of ROS, ns.
    pub fn send(&mut self, ros_ns: u64, message: &[u8]) {
        self.sequence += 1;
        let beside = names::attachment(self.sequence, ros_ns as i64, &self.gid);
        let sent = self.publisher.put(message).attachment(beside).wait();
        if let Err(error) = &sent
            && !self.failing
        {
            tracing::warn!(key = %self.publisher.key_expr(), %error, "not sent");
        }
        self.failing = sent.is_err();
    }
}

/// The whole configuration, as JSON. A client is the one that routers pass everything on to and from,
/// whatever else is connected. (rmw_zenoh, issues 625 and 929)
fn config(brief: &Ros2Brief) -> Value {
    let endpoint = format!("tcp/{}", brief.address);
    let (mode, listen, connect) = match brief.listens {
        true => ("router", vec![endpoint], vec![]),
        false => ("client", vec![], vec![endpoint]),
    };
    json!({
        "mode": mode,
        "listen": { "timeout_ms": 0, "endpoints": listen, "exit_on_failure": true },
        "connect": { "timeout_ms": CONNECT_MS, "endpoints": connect, "exit_on_failure": true },
        // As rmw_zenoh's router: nodes that are connected to it learn of each other.
        "scouting": {
            "multicast": { "enabled": false },
            "gossip": { "enabled": brief.listens, "multihop": false },
        },
        "timestamping": { "enabled": false, "drop_future_timestamp": false },
        "adminspace": { "enabled": false },
        "transport": { "link": { "protocols": ["tcp"] } },
    })
}
