//! zenoh connections to other hosts, without discovery.
//!
//! Of two hosts, one connects and the other listens. The connecting host has one session for each peer, and opens
//! a new session when the connection is lost. The reason: zenoh identifies a session by a random number drawn
//! when it is opened. A session that reconnects is taken for the old one by a peer that has not noticed the loss,
//! and then neither side sends its subscriptions and key numbers again. Over TLS such a peer may notice only when
//! the connection is back, because it waits to send a close message.

use std::sync::Arc;

use protocol::brief::BridgeBrief;
use zenoh::Wait as _;
use zenoh::bytes::ZBytes;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use super::config::{self, SessionRole};
use super::inbox::Inbox;
use crate::topics::{self, Route, Topic};
use crate::wire::{self, WireError};

/// All connections of a bridge.
pub struct PeerSessions {
    brief: BridgeBrief,
    routes: Vec<Route>,
    inbox: Arc<Inbox>,
    sessions: Vec<PeerSession>,
}

/// Session to one host, or for all hosts that connect to this one.
struct PeerSession {
    role: SessionRole,
    /// The open session; `None` if it could not be opened again.
    open_session: Option<OpenSession>,
    /// Whether the peer was connected before.
    was_connected: bool,
}

struct OpenSession {
    session: zenoh::Session,
    /// Sender of each route that starts here and ends at a peer of this session.
    senders: Vec<Option<Publisher<'static>>>,
}

impl PeerSessions {
    /// Listens, and starts to connect. Frames under the key of a route are added to the inbox, under the route's
    /// index.
    pub fn open(
        brief: &BridgeBrief,
        routes: &[Route],
        inbox: &Arc<Inbox>,
    ) -> Result<PeerSessions, WireError> {
        let peers = topics::peer_hosts(brief, brief.here);
        let connects = peers
            .iter()
            .filter(|&&peer| peer < brief.here)
            .map(|&peer| SessionRole::Connecting(peer));
        let listens =
            peers.iter().any(|&peer| SessionRole::Listening.is_session_with(brief.here, peer));
        let listens = listens.then_some(SessionRole::Listening);
        let open_peer = |role| PeerSession { role, open_session: None, was_connected: false };
        let mut peer_sessions = PeerSessions {
            brief: brief.clone(),
            routes: routes.to_vec(),
            inbox: inbox.clone(),
            sessions: listens.into_iter().chain(connects).map(open_peer).collect(),
        };
        for index in 0..peer_sessions.sessions.len() {
            peer_sessions.sessions[index].open_session =
                Some(peer_sessions.open_session(peer_sessions.sessions[index].role)?);
        }
        Ok(peer_sessions)
    }

    /// Sends a frame of a route. It never blocks: if the queue is full, zenoh drops the frame.
    pub fn send(&self, route: usize, frame: Vec<u8>) -> Result<(), zenoh::Error> {
        let frame = ZBytes::from(frame);
        let mut sent = Ok(());
        for open_session in
            self.sessions.iter().filter_map(|peer_session| peer_session.open_session.as_ref())
        {
            if let Some(sender) = &open_session.senders[route] {
                sent = sent.and(sender.put(frame.clone()).wait());
            }
        }
        sent
    }

    /// Opens a new session in place of each one that has lost its peer. Call it more often than zenoh tries to
    /// reconnect.
    pub fn reopen_lost_sessions(&mut self) {
        for index in 0..self.sessions.len() {
            let PeerSession { role, open_session: open, was_connected } = &mut self.sessions[index];
            if *role == SessionRole::Listening {
                continue;
            }
            if let Some(open) = open {
                let has_peer = open.session.info().peers_zid().wait().next().is_some();
                if has_peer || !*was_connected {
                    *was_connected = has_peer;
                    continue;
                }
            }
            *was_connected = false;
            if let Some(lost) = open.take() {
                // Closing may block.
                std::thread::spawn(move || lost.close());
            }
            match self.open_session(self.sessions[index].role) {
                Ok(open) => self.sessions[index].open_session = Some(open),
                Err(error) => tracing::debug!(%error, "not connected again"),
            }
        }
    }

    fn open_session(&self, role: SessionRole) -> Result<OpenSession, WireError> {
        let own_host = self.brief.here;
        let is_session_with = |host: usize| role.is_session_with(own_host, host);
        let address = || self.brief.hosts[own_host].address.clone();
        let session = wire::open(&config::session_config(&self.brief, role))
            .map_err(|why| WireError::Open(address(), why))?;
        let mut senders = Vec::new();
        for (index, route) in self.routes.iter().enumerate() {
            let sends = route.sending_host == own_host
                && route.receiving_hosts.iter().any(|&to| is_session_with(to));
            senders.push(sends.then(|| declare_sender(&session, route)).transpose()?);
            if route.receiving_hosts.contains(&own_host) && is_session_with(route.sending_host) {
                declare_receiver(&session, index, route, &self.inbox)?;
            }
        }
        Ok(OpenSession { session, senders })
    }

    /// Closes all sessions.
    pub fn close(self) {
        self.sessions
            .into_iter()
            .filter_map(|peer_session| peer_session.open_session)
            .for_each(OpenSession::close);
    }
}

impl OpenSession {
    fn close(self) {
        drop(self.senders);
        wire::close(&self.session);
    }
}

/// Creates a sender that never blocks.
fn declare_sender(
    session: &zenoh::Session,
    route: &Route,
) -> Result<Publisher<'static>, WireError> {
    let (priority, express) = match route.topic {
        Topic::Beacon(_) | Topic::Odometry(_) | Topic::Command(_) => (Priority::RealTime, true),
        Topic::ClockRequest(_) | Topic::ClockResponse(_) => (Priority::InteractiveHigh, true),
        Topic::Orders(_) | Topic::Report(_) => (Priority::InteractiveLow, true),
        Topic::BridgeStatus(_) | Topic::Acknowledgment(_) => (Priority::Data, false),
        Topic::StatusRecords(_) => (Priority::DataLow, false),
    };
    let declared = session
        .declare_publisher(route.key.clone())
        .congestion_control(CongestionControl::Drop)
        .priority(priority)
        .express(express)
        .wait();
    declared.map_err(WireError::declare_error(&route.key))
}

fn declare_receiver(
    session: &zenoh::Session,
    index: usize,
    route: &Route,
    inbox: &Arc<Inbox>,
) -> Result<(), WireError> {
    let inbox = inbox.clone();
    let declared = session
        .declare_subscriber(route.key.clone())
        .callback(move |sample| inbox.push_frame(index, &sample.payload().to_bytes()))
        .background()
        .wait();
    declared.map_err(WireError::declare_error(&route.key))
}
