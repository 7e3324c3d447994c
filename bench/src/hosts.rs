//! How long a sample takes from one host to another, one way: 96 bytes every millisecond over zenoh with
//! mutual TLS, set up as a bridge sets it up, and a robot's beacon through two bridges, against plain UDP.
//!
//! Two hosts are two network namespaces with a cable (veth) between them, which takes root. They share one
//! clock, so that a time is the difference of two stamps. In each round all three go over the same cable,
//! one after the other.

mod ends;

use std::ffi::OsString;
use std::path::Path;
use std::process::Command;

use bridge::certificates::{Authority, CertificatesError, Validity};
use protocol::brief::{self, BridgeBrief, BridgedBrief, CertificatesBrief, Format, HostBrief};
use protocol::run_root::RunRoot;
use serde::{Deserialize, Serialize};

use crate::peers::Peers;
use crate::quantiles::{QUANTILES, Quantiles};
use crate::table::Row;
use crate::{BenchError, Place, Setting, failed};

pub(crate) use ends::peer;

/// Names of the hosts; the first sends.
const NAMES: [&str; 2] = ["a", "b"];
/// Where they are on the cable.
const ADDRESSES: [&str; 2] = ["10.213.0.1", "10.213.0.2"];
/// The robot whose beacon goes through bridges.
const ROBOT: &str = "r1";
/// Where its bridge listens.
const PORT: u16 = 7447;
/// Bytes of a sample, but for beacons.
const SAMPLE_BYTES: usize = 96;
/// From one sample to the next, ns.
const PERIOD_NS: u64 = 1_000_000;

/// What carries samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Way {
    /// Datagrams.
    Udp,
    /// zenoh, with mutual TLS.
    Zenoh,
    /// A robot's beacon, by iceoryx2, a bridge, zenoh with mutual TLS, a bridge and iceoryx2.
    Bridges,
}

impl Way {
    const ALL: [Way; 3] = [Way::Udp, Way::Zenoh, Way::Bridges];
}

/// What arrived by each way.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Seen {
    /// From sending to arrival, us.
    way_us: Quantiles,
    /// Of those sent, how many did not arrive.
    lost: u64,
}

/// Measures each way for about `seconds` a round. Also returns notes.
pub(crate) fn measure(
    setting: &Setting<'_>,
    seconds: f64,
) -> Result<(Vec<Row>, Vec<String>), BenchError> {
    if !rustix::process::geteuid().is_root() {
        let note = "bridge: SKIPPED: two hosts are namespaces with a network, which takes root";
        return Ok((Vec::new(), vec![note.into()]));
    }
    let samples = ((seconds * 1e9 / PERIOD_NS as f64) as u64).max(1);
    let mut rounds: Vec<[Seen; 3]> = Vec::new();
    for round in 1..=setting.rounds {
        setting.progress(&format!("from host to host, round {round}"));
        rounds.push(one_round(setting, samples)?);
    }
    let column = |way: Way, figure: &dyn Fn(&Seen) -> f64| -> Vec<f64> {
        rounds.iter().map(|round| figure(&round[way as usize])).collect()
    };
    let mut rows = Vec::new();
    for (way, words) in [(Way::Zenoh, "zenoh with TLS"), (Way::Bridges, "a beacon by two bridges")]
    {
        for (place, (_, name, _)) in QUANTILES.iter().enumerate() {
            let of = |way| column(way, &|seen| seen.way_us[place]);
            let what = format!("host to host at 1 kHz, {words}, {name}, us");
            rows.push(Row::against("bridge", &what, "plain UDP, 96 bytes", of(way), of(Way::Udp)));
        }
        let of = |way| column(way, &|seen| seen.lost as f64);
        let what = format!("host to host at 1 kHz, {words}, lost of {samples}");
        rows.push(Row::against("bridge", &what, "plain UDP, 96 bytes", of(way), of(Way::Udp)));
    }
    let note = "bridge: beacons are looked for every 0.5 ms by the bridge, and every 0.05 ms where they end";
    Ok((rows, vec![note.into()]))
}

fn one_round(setting: &Setting<'_>, samples: u64) -> Result<[Seen; 3], BenchError> {
    let place = Place::new(setting.root, "hosts")?;
    let dir = place.path();
    certify(dir)?;
    // Each host's share of a run, in the directory of this user's.
    let base = setting.root.path().parent().unwrap_or(dir);
    let shares = [RunRoot::create(base)?, RunRoot::create(base)?];
    let mut words: Vec<Vec<OsString>> = Vec::new();
    for (here, share) in shares.iter().enumerate() {
        let path = dir.join(format!("brief-{here}.toml"));
        let text = brief::to_text(&told(dir, here, share.path()));
        std::fs::write(&path, text).map_err(failed("write", &path))?;
        let peer = ["peer".into(), "host".into(), path.into(), samples.to_string().into()];
        words.push(peer.into_iter().chain([dir.join("seen.json").into()]).collect());
    }
    let peers = Peers::start(dir, setting.stop, words)?;
    peers.wait_ready()?;
    let ends = [peers.pid(0), peers.pid(1)].map(|pid| pid.to_string());
    let cable = ["link", "add", "eth0", "netns", &ends[0], "type", "veth", "peer", "name", "eth0"];
    ip(cable.into_iter().chain(["netns", &ends[1]]))?;
    peers.go()?;
    let seen = peers.told(&dir.join("seen.json"))?;
    drop(peers);
    for share in shares {
        let path = share.path().to_owned();
        share.remove().map_err(failed("remove", &path))?;
    }
    Ok(seen)
}

/// Certificates of both hosts.
fn certify(dir: &Path) -> Result<(), BenchError> {
    let refused = |error: CertificatesError| BenchError::Wrong(error.to_string());
    let valid = Validity::of_days(1);
    let authority = Authority::new(valid).map_err(refused)?;
    let save = |name: String, text: String| {
        let path = dir.join(name);
        std::fs::write(&path, text).map_err(failed("write", &path))
    };
    save("ca.pem".into(), authority.certificate())?;
    for (name, address) in NAMES.iter().zip(ADDRESSES) {
        let (certificate, key) =
            authority.host(name, &format!("{address}:{PORT}"), valid).map_err(refused)?;
        save(format!("{name}.pem"), certificate)?;
        save(format!("{name}.key"), key)?;
    }
    Ok(())
}

/// What the bridge of a host is told: one robot, on the first host, is heard on the second.
fn told(dir: &Path, here: usize, share: &Path) -> BridgeBrief {
    let second_ns = 1_000_000_000;
    let file = |ending: &str| dir.join(format!("{}.{ending}", NAMES[here]));
    let host = |(name, address): (&&str, &str)| HostBrief {
        name: (*name).into(),
        address: format!("{address}:{PORT}"),
    };
    BridgeBrief {
        format: Format,
        run_root: share.into(),
        experiment: "0".repeat(16),
        here,
        plant: 0,
        odometry_age_ns_max: second_ns,
        beacon_age_ns_max: second_ns,
        join_within_ns: second_ns,
        unreachable_after_ns: second_ns,
        silence_ns_max: second_ns,
        transport: "tcp".into(),
        certificates: Some(CertificatesBrief {
            authority: dir.join("ca.pem"),
            certificate: file("pem"),
            key: file("key"),
        }),
        hosts: NAMES.iter().zip(ADDRESSES).map(host).collect(),
        robots: vec![BridgedBrief { name: ROBOT.into(), host: 0, heard_on: vec![1], hears: 1 }],
        partitions: Vec::new(),
    }
}

/// Sets up a network of the calling process's namespace.
fn ip<'w>(words: impl IntoIterator<Item = &'w str>) -> Result<(), BenchError> {
    let words: Vec<&str> = words.into_iter().collect();
    let done =
        Command::new("ip").args(&words).output().map_err(failed("start", Path::new("ip")))?;
    match done.status.success() {
        true => Ok(()),
        false => {
            let why = String::from_utf8_lossy(&done.stderr);
            Err(BenchError::Wrong(format!("ip {}: {}", words.join(" "), why.trim())))
        }
    }
}
