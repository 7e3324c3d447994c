//! The connections to the other hosts: zenoh, with nothing of its own accord.
//!
//! Of two hosts one connects, and the other listens. Whoever connects has a session for each host that it
//! connects to, and opens another one when the link is lost. For zenoh tells sessions apart by a number that
//! each draws when it is opened: a session that connects again is taken for the old one by a host that has not
//! yet noticed the loss, and then neither tells the other anew what it hears, and under which numbers keys go.
//! Over TLS such a host may notice only when the link is back, for it waits to say goodbye.

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
pub struct Wire {
    brief: BridgeBrief,
    routes: Vec<Route>,
    inbox: Arc<Inbox>,
    links: Vec<Link>,
}

/// A connection to one host, or all that others open to this one.
struct Link {
    end: End,
    /// `None` if it could not be opened again.
    open: Option<Open>,
    /// Whether the host that it connects to was there.
    connected: bool,
}

struct Open {
    session: zenoh::Session,
    /// By route, of those that begin here and end there.
    senders: Vec<Option<Publisher<'static>>>,
}

impl Wire {
    /// Listens, and begins to connect. What arrives under the key of a route goes into the inbox, at the
    /// route's place.
    pub fn open(
        brief: &BridgeBrief,
        routes: &[Route],
        inbox: &Arc<Inbox>,
    ) -> Result<Wire, WireError> {
        let peers = topics::peers(brief, brief.here);
        let connects = peers.iter().filter(|&&peer| peer < brief.here).map(|&peer| End::To(peer));
        let listens = peers.iter().any(|&peer| End::Listening.is_with(brief.here, peer));
        let listens = listens.then_some(End::Listening);
        let link = |end| Link { end, open: None, connected: false };
        let mut wire = Wire {
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

    /// Sends a frame of this route. It never waits: what finds no place is dropped by zenoh.
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

    /// Opens another session in place of each that has lost its host. To be called more often than zenoh tries
    /// to connect again.
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
                // It may have to wait.
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
        let ends_at = |host: usize| end.is_with(here, host);
        let address = || self.brief.hosts[here].address.clone();
        let session = wire::open(&config::of(&self.brief, end))
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

    /// Ends all of them.
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

/// A sender that never waits.
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
    declared.map_err(WireError::declaring(&route.key))
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
    declared.map_err(WireError::declaring(&route.key))
}
