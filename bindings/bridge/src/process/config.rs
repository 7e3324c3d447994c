//! Configuration of zenoh: peers are configured explicitly, and discovery is off.
//!
//! The defaults of zenoh listen on all interfaces, search for peers by multicast, and forward discovered peers;
//! all of that is disabled.

use protocol::brief::BridgeBrief;
use serde_json::{Value, json};

use crate::topics::{self, KEY_PREFIX};

/// Time without a message after which a peer is gone, ms. zenoh sends four keep-alive messages in that time.
const LEASE_MS: u64 = 1_000;
/// Maximum time for opening a connection, ms.
const OPEN_TIMEOUT_MS: u64 = 500;
/// Backoff of reconnection attempts, ms: initial and maximum.
const RECONNECT_BACKOFF_MS: [u64; 2] = [100, 200];
/// Maximum time for which a sample waits for space in the queue before it is dropped, us.
const QUEUE_WAIT_US_MAX: u64 = 500;
/// Maximum length of a frame, bytes. Longer ones are refused.
const FRAME_BYTES_MAX: u64 = 1 << 20;

/// Purpose of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionRole {
    /// Listens for connections of other hosts.
    Listening,
    /// Connects to the host with this index.
    Connecting(usize),
}

impl SessionRole {
    /// Returns whether the session of host `here` is for communication with `host`. Of two hosts, the one with
    /// the larger index connects.
    pub fn is_session_with(self, here: usize, host: usize) -> bool {
        match self {
            SessionRole::Listening => host > here,
            SessionRole::Connecting(peer) => host == peer,
        }
    }
}

/// Returns the complete configuration of a session, as JSON.
pub fn session_config(brief: &BridgeBrief, role: SessionRole) -> Value {
    let protocol = if brief.certificates.is_some() { "tls" } else { &brief.transport };
    let endpoint = |host: usize| format!("{protocol}/{}", brief.hosts[host].address);
    let (listen, connect) = match role {
        SessionRole::Listening => (vec![endpoint(brief.here)], vec![]),
        SessionRole::Connecting(peer) => (vec![], vec![endpoint(peer)]),
    };
    let mut peers = topics::peer_hosts(brief, brief.here);
    peers.retain(|&peer| role.is_session_with(brief.here, peer));
    let retry = json!({
        "period_init_ms": RECONNECT_BACKOFF_MS[0],
        "period_max_ms": RECONNECT_BACKOFF_MS[1],
        "period_increase_factor": 1.5,
    });
    let mut config = json!({
        "mode": "peer",
        "listen": {
            "timeout_ms": 0,
            "endpoints": listen,
            "exit_on_failure": true,
        },
        "connect": {
            "timeout_ms": -1,
            "endpoints": connect,
            "exit_on_failure": false,
            "retry": retry,
        },
        "open": { "return_conditions": { "connect_scouted": false, "declares": false } },
        "scouting": {
            "multicast": { "enabled": false },
            "gossip": { "enabled": false },
        },
        "timestamping": { "enabled": false, "drop_future_timestamp": false },
        "adminspace": { "enabled": false },
        "transport": {
            "unicast": {
                "open_timeout": OPEN_TIMEOUT_MS,
                "accept_timeout": OPEN_TIMEOUT_MS,
                "accept_pending": 64,
                "max_sessions": 2 * brief.hosts.len() + 2,
                "max_links": 1,
                "qos": { "enabled": true },
            },
            "link": {
                "protocols": [protocol],
                "tx": {
                    "lease": LEASE_MS,
                    "keep_alive": 4,
                    "queue": {
                        "size": { "real_time": 16 },
                        "congestion_control": { "drop": { "wait_before_drop": QUEUE_WAIT_US_MAX } },
                    },
                },
                "rx": { "max_message_size": FRAME_BYTES_MAX },
            },
        },
    });
    if let Some(files) = &brief.certificates {
        config["transport"]["link"]["tls"] = json!({
            "root_ca_certificate": files.authority,
            "listen_certificate": files.certificate,
            "listen_private_key": files.key,
            "connect_certificate": files.certificate,
            "connect_private_key": files.key,
            "enable_mtls": true,
            "verify_name_on_connect": true,
            "close_link_on_expiration": true,
        });
        config["access_control"] = access_control_config(brief, &peers);
    }
    config
}

/// Returns the access list, by the common names of certificates: each host may write below its own name, and
/// receive. Everything else is denied.
fn access_control_config(brief: &BridgeBrief, peers: &[usize]) -> Value {
    let names: Vec<&str> = peers.iter().map(|&peer| brief.hosts[peer].name.as_str()).collect();
    let keys_below = |name: &str| format!("{KEY_PREFIX}/{name}/**");
    let own = keys_below(&brief.hosts[brief.here].name);
    let rule = |id: String, message: &str, flow: &str, key: &str| {
        json!({
            "id": id,
            "messages": [message],
            "flows": [flow],
            "permission": "allow",
            "key_exprs": [key],
        })
    };
    let mut rules = vec![
        rule("say".into(), "put", "egress", &own),
        rule("be-heard".into(), "declare_subscriber", "ingress", &own),
        rule("hear".into(), "declare_subscriber", "egress", &format!("{KEY_PREFIX}/**")),
    ];
    let (mut subjects, mut policies) = (Vec::new(), Vec::new());
    for name in names {
        rules.push(rule(format!("said-by-{name}"), "put", "ingress", &keys_below(name)));
        subjects.push(json!({ "id": name, "cert_common_names": [name] }));
        policies.push(json!({
            "rules": ["say", "be-heard", "hear", format!("said-by-{name}")],
            "subjects": [name],
        }));
    }
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    })
}
