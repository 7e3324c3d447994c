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

use super::config::{self, End};
use super::inbox::Inbox;
use crate::topics::{self, Route, Topic};
use crate::wire::{self, WireError};

/// All connections of a bridge.
pub struct PeerSessions {
    brief: BridgeBrief,
    routes: Vec<Route>,
    inbox: Arc<Inbox>,
    links: Vec<Link>,
}

/// Session to one host, or for all hosts that connect to this one.
struct Link {
    end: End,
    /// The open session; `None` if it could not be opened again.
    open: Option<Open>,
    /// Whether the peer was connected before.
    connected: bool,
}

struct Open {
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
        let peers = topics::peers(brief, brief.here);
        let connects = peers.iter().filter(|&&peer| peer < brief.here).map(|&peer| End::To(peer));
        let listens = peers.iter().any(|&peer| End::Listening.is_session_with(brief.here, peer));
        let listens = listens.then_some(End::Listening);
        let link = |end| Link { end, open: None, connected: false };
        let mut wire = PeerSessions {
            brief: brief.clone(),
            routes: routes.to_vec(),
            inbox: inbox.clone(),
            links: listens.into_iter().chain(connects).map(link).collect(),
        };
        for place in 0..wire.links.len() {
            wire.links[place].open = Some(wire.session(wire.links[place].end)?);
        }
        Ok(wire)
    }

    /// Sends a frame of a route. It never blocks: if the queue is full, zenoh drops the frame.
    pub fn send(&self, route: usize, frame: Vec<u8>) -> Result<(), zenoh::Error> {
        let frame = ZBytes::from(frame);
        let mut sent = Ok(());
        for open in self.links.iter().filter_map(|link| link.open.as_ref()) {
            if let Some(sender) = &open.senders[route] {
                sent = sent.and(sender.put(frame.clone()).wait());
            }
        }
        sent
    }

    /// Opens a new session in place of each one that has lost its peer. Call it more often than zenoh tries to
    /// reconnect.
    pub fn mend(&mut self) {
        for place in 0..self.links.len() {
            let Link { end, open, connected } = &mut self.links[place];
            if *end == End::Listening {
                continue;
            }
            if let Some(open) = open {
                let is_there = open.session.info().peers_zid().wait().next().is_some();
                if is_there || !*connected {
                    *connected = is_there;
                    continue;
                }
            }
            *connected = false;
            if let Some(lost) = open.take() {
                // Closing may block.
                std::thread::spawn(move || lost.close());
            }
            match self.session(self.links[place].end) {
                Ok(open) => self.links[place].open = Some(open),
                Err(error) => tracing::debug!(%error, "not connected again"),
            }
        }
    }

    fn session(&self, end: End) -> Result<Open, WireError> {
        let here = self.brief.here;
        let ends_at = |host: usize| end.is_session_with(here, host);
        let address = || self.brief.hosts[here].address.clone();
        let session = wire::open(&config::session_config(&self.brief, end))
            .map_err(|why| WireError::Open(address(), why))?;
        let mut senders = Vec::new();
        for (place, route) in self.routes.iter().enumerate() {
            let sends = route.from == here && route.to.iter().any(|&to| ends_at(to));
            senders.push(sends.then(|| sender(&session, route)).transpose()?);
            if route.to.contains(&here) && ends_at(route.from) {
                receive(&session, place, route, &self.inbox)?;
            }
        }
        Ok(Open { session, senders })
    }

    /// Closes all sessions.
    pub fn close(self) {
        self.links.into_iter().filter_map(|link| link.open).for_each(Open::close);
    }
}

impl Open {
    fn close(self) {
        drop(self.senders);
        wire::close(&self.session);
    }
}

/// Creates a sender that never blocks.
fn sender(session: &zenoh::Session, route: &Route) -> Result<Publisher<'static>, WireError> {
    let (priority, express) = match route.topic {
        Topic::Beacon(_) | Topic::Odometry(_) | Topic::Command(_) => (Priority::RealTime, true),
        Topic::Ask(_) | Topic::Answer(_) => (Priority::InteractiveHigh, true),
        Topic::Orders(_) | Topic::Report(_) => (Priority::InteractiveLow, true),
        Topic::Bridge(_) | Topic::Confirmed(_) => (Priority::Data, false),
        Topic::Told(_) => (Priority::DataLow, false),
    };
    let declared = session
        .declare_publisher(route.key.clone())
        .congestion_control(CongestionControl::Drop)
        .priority(priority)
        .express(express)
        .wait();
    declared.map_err(WireError::declare_error(&route.key))
}

fn receive(
    session: &zenoh::Session,
    place: usize,
    route: &Route,
    inbox: &Arc<Inbox>,
) -> Result<(), WireError> {
    let inbox = inbox.clone();
    let declared = session
        .declare_subscriber(route.key.clone())
        .callback(move |sample| inbox.put(place, &sample.payload().to_bytes()))
        .background()
        .wait();
    declared.map_err(WireError::declare_error(&route.key))
}
