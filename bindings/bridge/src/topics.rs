//! Topics between hosts, and their keys: `phalanx/1/<host>/<robot>/<topic>`, where the host is the sender, which
//! alone writes below its own name.
//!
//! If no robot on another host needs a sample, there is no topic, and nothing is sent.

use protocol::brief::BridgeBrief;

/// Prefix of every key, with the version of the keys.
pub const KEY_PREFIX: &str = "phalanx/1";
/// Key part in place of a robot's name for topics of a host. A robot's name has no dot.
const HOST_TOPICS_KEY_PART: &str = ".host";

/// Subject of a sample, with the index of the robot or host, from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// Beacon of a robot, to its out-neighbors.
    Beacon(usize),
    /// Odometry of a robot, from the plant's host.
    Odometry(usize),
    /// Command of a robot, to the plant's host.
    Command(usize),
    /// Orders to the supervisor of a host.
    Orders(usize),
    /// Report of the supervisor of a host.
    Report(usize),
    /// Status of the bridge of a host.
    BridgeStatus(usize),
    /// Status and latencies of the robots of a host.
    StatusRecords(usize),
    /// Acknowledgment of these records, to a host.
    Acknowledgment(usize),
    /// Clock request of a host.
    ClockRequest(usize),
    /// Clock response to a host.
    ClockResponse(usize),
}

impl Topic {
    /// Returns whether the topic is about a robot, and not about a host.
    pub fn is_robot_topic(self) -> bool {
        matches!(self, Topic::Beacon(_) | Topic::Odometry(_) | Topic::Command(_))
    }
}

/// One topic from one host to others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Route {
    /// Topic of the samples.
    pub topic: Topic,
    /// Index of the sending host.
    pub sending_host: usize,
    /// Indices of the receiving hosts.
    pub receiving_hosts: Vec<usize>,
    /// zenoh key.
    pub key: String,
}

/// Returns all routes between hosts.
pub fn routes(brief: &BridgeBrief) -> Vec<Route> {
    let plant = brief.plant;
    let mut routes = Vec::new();
    let mut route = |topic, from: usize, to: Vec<usize>, subject: &str, name_on_wire: &str| {
        if !to.is_empty() {
            let key = format!("{KEY_PREFIX}/{}/{subject}/{name_on_wire}", brief.hosts[from].name);
            routes.push(Route { topic, sending_host: from, receiving_hosts: to, key });
        }
    };
    for (i, robot) in brief.robots.iter().enumerate() {
        let (home, name) = (robot.host, robot.name.as_str());
        route(Topic::Beacon(i), home, robot.heard_on.clone(), name, "beacon");
        if home != plant {
            route(Topic::Odometry(i), plant, vec![home], name, "odometry");
            route(Topic::Command(i), home, vec![plant], name, "command");
        }
    }
    for (host, receiver) in brief.hosts.iter().enumerate() {
        if host != plant {
            let key_of = |name_on_wire: &str| format!("{name_on_wire}/{}", receiver.name);
            route(Topic::Orders(host), plant, vec![host], HOST_TOPICS_KEY_PART, &key_of("orders"));
            route(
                Topic::Acknowledgment(host),
                plant,
                vec![host],
                HOST_TOPICS_KEY_PART,
                &key_of("confirmed"),
            );
            route(
                Topic::ClockResponse(host),
                plant,
                vec![host],
                HOST_TOPICS_KEY_PART,
                &key_of("answer"),
            );
            route(Topic::Report(host), host, vec![plant], HOST_TOPICS_KEY_PART, "report");
            route(Topic::BridgeStatus(host), host, vec![plant], HOST_TOPICS_KEY_PART, "bridge");
            route(Topic::StatusRecords(host), host, vec![plant], HOST_TOPICS_KEY_PART, "told");
            route(Topic::ClockRequest(host), host, vec![plant], HOST_TOPICS_KEY_PART, "ask");
        }
    }
    routes
}

/// Returns the indices of the hosts with which a host communicates.
pub fn peer_hosts(brief: &BridgeBrief, host: usize) -> Vec<usize> {
    let mut peers: Vec<usize> = routes(brief)
        .iter()
        .filter(|route| route.sending_host == host || route.receiving_hosts.contains(&host))
        .flat_map(|route| route.receiving_hosts.iter().copied().chain([route.sending_host]))
        .filter(|&peer| peer != host)
        .collect();
    peers.sort_unstable();
    peers.dedup();
    peers
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::{self, robot};
    use protocol::brief::{HostBrief, PartitionBrief};
    use protocol::fault::Span;

    /// Returns a fleet: r0 on a, which has the plant; r1 and r2 on b; r3 on c. r0 receives from r1, r1 from r2, r3
    /// from r0 and r1.
    fn brief() -> BridgeBrief {
        let host = |name: &str| HostBrief { name: name.into(), address: "127.0.0.1:1".into() };
        let robots = [
            robot("r0", 0, &[2]),
            robot("r1", 1, &[0, 2]),
            robot("r2", 1, &[]),
            robot("r3", 2, &[]),
        ];
        let span = Span { from_ns: 10, until_ns: 20 };
        BridgeBrief {
            partitions: vec![PartitionBrief { hosts: vec![1], span }],
            ..examples::brief(&["a", "b", "c"].map(host), robots)
        }
    }

    #[test]
    fn routes_exist_only_for_hosts_that_need_them() {
        let brief = brief();
        let routes = routes(&brief);
        let robots: Vec<&str> = routes
            .iter()
            .filter(|route| !route.key.contains("/.host/"))
            .map(|route| route.key.as_str())
            .collect();
        assert_eq!(
            robots,
            [
                "phalanx/1/a/r0/beacon",
                "phalanx/1/b/r1/beacon",
                "phalanx/1/a/r1/odometry",
                "phalanx/1/b/r1/command",
                "phalanx/1/a/r2/odometry",
                "phalanx/1/b/r2/command",
                "phalanx/1/a/r3/odometry",
                "phalanx/1/c/r3/command",
            ]
        );
        for route in &routes {
            let own = format!("{KEY_PREFIX}/{}/", brief.hosts[route.sending_host].name);
            assert!(
                route.key.starts_with(&own) && !route.receiving_hosts.contains(&route.sending_host),
                "{route:?}"
            );
        }
        let beacon = routes.iter().find(|route| route.topic == Topic::Beacon(1)).unwrap();
        assert_eq!(beacon.receiving_hosts, [0, 2]);
        let mut keys: Vec<&str> = routes.iter().map(|route| route.key.as_str()).collect();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), routes.len(), "each key is one topic's");
    }

    #[test]
    fn hosts_without_a_common_route_are_not_peers() {
        let mut brief = brief();
        assert_eq!(
            [0, 1, 2].map(|host| peer_hosts(&brief, host)),
            [vec![1, 2], vec![0, 2], vec![0, 1]]
        );
        brief.robots[1].heard_on = vec![0];
        assert_eq!([1, 2].map(|host| peer_hosts(&brief, host)), [vec![0], vec![0]]);
    }

    #[test]
    fn partition_separates_its_sides_during_its_span() {
        let brief = brief();
        assert!(brief.are_partitioned(0, 1, 10) && brief.are_partitioned(1, 2, 19));
        assert!(!brief.are_partitioned(0, 2, 15) && !brief.are_partitioned(0, 1, 20));
        assert!(!brief.are_partitioned(1, 1, 15));
    }
}
