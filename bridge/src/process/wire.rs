//! The connection to the other hosts: zenoh, with nothing of its own accord.

use std::sync::Arc;

use protocol::brief::BridgeBrief;
use zenoh::Wait as _;
use zenoh::pubsub::Publisher;
use zenoh::qos::{CongestionControl, Priority};

use super::config;
use super::inbox::Inbox;
use crate::topics::{Route, Topic};

/// Why there is no connection.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// zenoh does not take the configuration, or cannot listen.
    #[error("cannot listen at {address}: {why}")]
    Open {
        /// Where.
        address: String,
        /// Why.
        why: String,
    },
    /// A key could not be declared.
    #[error("cannot declare {key}: {why}")]
    Declare {
        /// Which.
        key: String,
        /// Why.
        why: String,
    },
}

/// The session. Whatever is declared in it ends with it.
pub struct Wire {
    session: zenoh::Session,
}

impl Wire {
    /// Listens, and begins to connect.
    pub fn open(brief: &BridgeBrief) -> Result<Wire, WireError> {
        let refused = |why: zenoh::Error| WireError::Open {
            address: brief.hosts[brief.here].address.clone(),
            why: why.to_string(),
        };
        let config = zenoh::Config::from_json5(&config::of(brief).to_string()).map_err(refused)?;
        let session = zenoh::open(config).wait().map_err(refused)?;
        Ok(Wire { session })
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
        declared.map_err(|why| WireError::Declare { key: route.key.clone(), why: why.to_string() })
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
        declared.map_err(|why| WireError::Declare { key: route.key.clone(), why: why.to_string() })
    }

    /// Ends it.
    pub fn close(self) {
        if let Err(error) = self.session.close().wait() {
            tracing::debug!(%error, "the session did not close");
        }
    }
}
