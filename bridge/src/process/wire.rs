//! The connection to the other hosts: zenoh, with nothing of its own accord.

use std::sync::Arc;

use protocol::brief::BridgeBrief;
use zenoh::Wait as _;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use super::config;
use super::inbox::Inbox;
use crate::topics::{Route, Topic};
use crate::wire::{self, WireError};

/// The session. Whatever is declared in it ends with it.
pub struct Wire {
    session: zenoh::Session,
}

impl Wire {
    /// Listens, and begins to connect.
    pub fn open(brief: &BridgeBrief) -> Result<Wire, WireError> {
        let address = || brief.hosts[brief.here].address.clone();
        let session = wire::open(&config::of(brief));
        Ok(Wire { session: session.map_err(|why| WireError::Open { address: address(), why })? })
    }

    /// A sender that never waits.
    pub fn sender(&self, route: &Route) -> Result<Publisher<'static>, WireError> {
        let (priority, express) = match route.topic {
            Topic::Beacon(_) | Topic::Odometry(_) | Topic::Command(_) => (Priority::RealTime, true),
            Topic::Ask(_) | Topic::Answer(_) => (Priority::InteractiveHigh, true),
            Topic::Orders(_) | Topic::Report(_) => (Priority::InteractiveLow, true),
            Topic::Bridge(_) | Topic::Confirmed(_) => (Priority::Data, false),
            Topic::Told(_) => (Priority::DataLow, false),
        };
        let declared = self
            .session
            .declare_publisher(route.key.clone())
            .congestion_control(CongestionControl::Drop)
            .priority(priority)
            .express(express)
            .wait();
        declared.map_err(WireError::declaring(&route.key))
    }

    /// What arrives under the key of a route goes into the inbox.
    pub fn receive(
        &self,
        place: usize,
        route: &Route,
        inbox: &Arc<Inbox>,
    ) -> Result<(), WireError> {
        let inbox = inbox.clone();
        let declared = self
            .session
            .declare_subscriber(route.key.clone())
            .callback(move |sample| inbox.put(place, &sample.payload().to_bytes()))
            .background()
            .wait();
        declared.map_err(WireError::declaring(&route.key))
    }

    /// Ends it.
    pub fn close(self) {
        wire::close(&self.session);
    }
}
