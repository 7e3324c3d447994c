//! Parsing of a fleet file to a [`Fleet`], the hosts of a run and their robots, with the diagnostics of
//! scenarios.

use std::net::IpAddr;
use std::path::{Path, PathBuf};

use experiment::scenario::diagnostic::{Diagnostic, SourceText};
use experiment::scenario::fields::kinds;
use experiment::scenario::file::load_text;
use experiment::scenario::read::parse_toml;
use experiment::scenario::table::{Document, TableReader, TypedValue};
use experiment::scenario::{FaultKind, Scenario};
use protocol::brief::{
    BridgeBrief, BridgedRobotBrief, CertificatesBrief, FormatVersion, HostBrief, PartitionBrief,
};
use protocol::regular_file::{self, SymlinkPolicy};

use crate::keys;

/// Maximum number of hosts: indices have 16 bits on the wire. More are an error.
const HOSTS_MAX: usize = 1_000;

/// Hosts that run one scenario together.
#[derive(Debug, Clone, PartialEq)]
pub struct Fleet {
    /// Text of the fleet file.
    pub text: String,
    /// Hosts of the fleet.
    pub hosts: Vec<Host>,
    /// Index of the plant's host.
    pub plant_host: usize,
    /// Maximum time in transit of a sample and its answer together, between hosts (L), ns.
    pub latency_max_ns: u64,
    /// Transport protocol: `tcp` or `udp`.
    pub transport: String,
    /// Folder of the certificates, if there are any.
    pub certificates: Option<PathBuf>,
    /// Maximum time for which hosts wait for each other before the run, ns.
    pub join_within_ns: u64,
    /// Time without a message after which another host is unreachable, ns.
    pub unreachable_after_ns: u64,
    /// Time without a message of the plant's host after which a host ends its part of the run, ns.
    pub silence_ns_max: u64,
}

/// One host of a fleet.
#[derive(Debug, Clone, PartialEq)]
pub struct Host {
    /// Name of the host.
    pub name: String,
    /// Address of its bridge, as `ADDRESS:PORT`.
    pub address: String,
    /// Names of the robots on this host.
    pub robots: Vec<String>,
}

/// Mismatch of a fleet with a scenario, a command line or the file system.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FleetError {
    /// The name on the command line is not a host: that name, and the hosts.
    #[error("the fleet has no host {:?}: expected one of {}", .0, .1.join(", "))]
    UnknownHost(String, Vec<String>),
    /// Robots of the scenario without a host.
    #[error("the fleet has no host for {}: expected each robot of the scenario in one `robots`", .0.join(", "))]
    RobotsWithoutHost(Vec<String>),
    /// A host has a robot that is not in the scenario: host, robot, and a robot that is.
    #[error(
        "host {0}: robot {1:?} is not in the scenario; expected robots of the scenario, such as {2}"
    )]
    UnknownRobot(String, String, String),
    /// A partition names an unknown host: that name, and the hosts.
    #[error("the fault `partition {}` names no host of the fleet: expected hosts of {}", .0, .1.join(", "))]
    UnknownPartitionHost(String, Vec<String>),
    /// A partition names all hosts.
    #[error("the fault `partition {0}` names all hosts: expected only the hosts on one side")]
    PartitionOfAllHosts(String),
    /// Other machines could read and write the messages: host and address.
    #[error(
        "host {0} is at {1}, which other machines can reach: expected `certificates` in the fleet file, or \
         --insecure if all machines on that network may control the robots"
    )]
    InsecureHost(String, String),
    /// A certificate file cannot be read: file and reason.
    #[error("cannot read {}: {}; the fleet file's `certificates` needs ca.pem, HOST.pem and HOST.key there", .0.display(), .1)]
    UnreadableCertificate(PathBuf, String),
}

/// Reads a fleet file.
pub fn read(path: &Path) -> Result<Fleet, Diagnostic> {
    let expected = "expected a fleet file, such as scenarios/fleets/two.toml";
    let about = |what: String| {
        Diagnostic::without_location(format!("`{}` {what}", path.display()), expected)
    };
    let text = load_text(path, expected).map_err(|trouble| about(trouble.problem))?;
    parse_text(path, &text)
}

/// Parses the text of a fleet file.
pub fn parse_text(path: &Path, text: &str) -> Result<Fleet, Diagnostic> {
    let source = SourceText::new(path, text, false);
    let entries = parse_toml(text, &source)?;
    let format = keys::fleet_file_format();
    let document = Document::new(source, &format);
    let root: TableReader<'_, keys::Fleet> =
        TableReader::root(&document, entries.get_ref(), "the fleet");
    root.check_keys()?;
    if let Some(description) = root.get(keys::Fleet::description) {
        description.text("expected a string")?;
    }
    let mut hosts: Vec<Host> = Vec::new();
    let list = root.required_value(keys::Fleet::host)?;
    for table in root.tables(keys::Fleet::host)? {
        hosts.push(parse_host(&table, &hosts)?);
    }
    if !(2..=HOSTS_MAX).contains(&hosts.len()) {
        let expected = format!("expected 2 to {HOSTS_MAX}; one host needs no fleet");
        return Err(list.error_about_key(format!("has {} hosts", hosts.len()), expected));
    }
    let plant = root.required_value(keys::Fleet::plant)?;
    let name = plant.text("expected the name of a host")?;
    let Some(plant) = hosts.iter().position(|host| host.name == name) else {
        let known: Vec<&str> = hosts.iter().map(|host| host.name.as_str()).collect();
        let expected = format!("expected one of {}", known.join(", "));
        return Err(plant.error_about_key(format!("is \"{name}\", which is no host"), expected));
    };
    let transport = root.read_word(keys::Fleet::transport)?;
    let certificates = root.get(keys::Fleet::certificates);
    if let (Some(certificates), "udp") = (&certificates, transport.as_str()) {
        let expected = "expected it with `transport = \"tcp\"` only: TLS goes over TCP";
        return Err(certificates.error_about_key("is given with UDP", expected));
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let certificates = certificates.map(|keys| keys.text("expected a folder")).transpose()?;
    Ok(Fleet {
        text: text.to_owned(),
        hosts,
        plant_host: plant,
        latency_max_ns: root.time_ns(keys::Fleet::latency_max_s)?,
        transport,
        certificates: certificates.map(|keys| folder.join(keys)),
        join_within_ns: root.time_ns(keys::Fleet::join_within_s)?,
        unreachable_after_ns: root.time_ns(keys::Fleet::unreachable_after_s)?,
        silence_ns_max: root.time_ns(keys::Fleet::silence_max_s)?,
    })
}

fn parse_host(table: &TableReader<'_, keys::Host>, before: &[Host]) -> Result<Host, Diagnostic> {
    table.check_keys()?;
    let name = table.required_value(keys::Host::name)?;
    let text = name.text("expected a string")?;
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    if text.is_empty() || !text.chars().all(is_allowed) {
        let expected =
            "expected letters, digits, `-` and `_`, because the name is part of keys on the wire";
        return Err(name.error_about_key(format!("is \"{text}\""), expected));
    }
    if before.iter().any(|host| host.name == text) {
        return Err(name.error_about_key(format!("is \"{text}\" again"), "expected another name"));
    }
    let address = table.required_value(keys::Host::address)?;
    let address_text = address.text(EXPECTED_ADDRESS)?;
    split_address(address_text).ok_or_else(|| {
        address.error_about_key(format!("is \"{address_text}\""), EXPECTED_ADDRESS)
    })?;
    if let Some(other) = before.iter().find(|host| host.address == address_text) {
        let message = format!("is \"{address_text}\", that of {}", other.name);
        return Err(address.error_about_key(message, "expected another address or port"));
    }
    let robots = match table.get(keys::Host::robots) {
        Some(robots) => parse_robot_names(&robots, before)?,
        None => Vec::new(),
    };
    Ok(Host { name: text.to_owned(), address: address_text.to_owned(), robots })
}

const EXPECTED_ADDRESS: &str = "expected an address and a port, such as \"192.168.1.10:7447\"";

fn parse_robot_names(
    robots: &TypedValue<'_, kinds::Names>,
    before: &[Host],
) -> Result<Vec<String>, Diagnostic> {
    let expected = "expected a list of names of robots, such as [\"r1\", \"r2\"]";
    let mut names: Vec<String> = Vec::new();
    for robot in robots.elements(expected)? {
        let name = robot.text("expected the name of a robot")?;
        if names.iter().any(|other| other == name) {
            return Err(
                robot.error_about_key(format!("is \"{name}\" again"), "expected each robot once")
            );
        }
        if let Some(other) = before.iter().find(|host| host.robots.iter().any(|r| r == name)) {
            let message = format!("is \"{name}\", which is already on host {}", other.name);
            return Err(robot.error_about_key(message, "expected each robot on one host"));
        }
        names.push(name.to_owned());
    }
    Ok(names)
}

/// Splits an address into host and port; `None` if it has another form.
fn split_address(address: &str) -> Option<(&str, u16)> {
    let (host, port) = address.rsplit_once(':')?;
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "-._:[]".contains(c);
    let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']')).unwrap_or(host);
    let has_valid_host = !bare.is_empty() && host.chars().all(is_allowed);
    // Without brackets, the last group of an IPv6 address would be taken for a port.
    let is_clear = !bare.contains(':') || bare.len() < host.len();
    (has_valid_host && is_clear).then_some((bare, port.parse().ok().filter(|&port| port > 0)?))
}

/// Returns whether only this machine can reach an address.
fn is_loopback(address: &str) -> bool {
    let host = split_address(address).map_or("", |(host, _)| host);
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

impl Fleet {
    /// Returns the index of the host with a name.
    pub fn find_host(&self, name: &str) -> Result<usize, FleetError> {
        let index = self.hosts.iter().position(|host| host.name == name);
        index.ok_or_else(|| FleetError::UnknownHost(name.to_owned(), self.host_names()))
    }

    fn host_names(&self) -> Vec<String> {
        self.hosts.iter().map(|host| host.name.clone()).collect()
    }

    /// Checks that hosts reachable by other machines have certificates.
    pub fn check_certificates_configured(&self) -> Result<(), FleetError> {
        let is_public = |host: &&Host| !is_loopback(&host.address);
        match self.hosts.iter().find(is_public) {
            Some(host) if self.certificates.is_none() => {
                Err(FleetError::InsecureHost(host.name.clone(), host.address.clone()))
            }
            _ => Ok(()),
        }
    }

    /// Returns the index of each robot's host, in scenario order.
    pub fn hosts_of_robots(&self, scenario: &Scenario) -> Result<Vec<usize>, FleetError> {
        let known = |name: &str| scenario.robots.iter().any(|robot| robot.name == name);
        for host in &self.hosts {
            if let Some(robot) = host.robots.iter().find(|robot| !known(robot)) {
                let example = scenario.robots[0].name.clone();
                return Err(FleetError::UnknownRobot(host.name.clone(), robot.clone(), example));
            }
        }
        let host_of = |name: &str| {
            self.hosts.iter().position(|host| host.robots.iter().any(|robot| robot == name))
        };
        let names = scenario.robots.iter().map(|robot| robot.name.as_str());
        let without_host: Vec<String> =
            names.clone().filter(|name| host_of(name).is_none()).map(str::to_owned).collect();
        match without_host.is_empty() {
            true => Ok(names.filter_map(host_of).collect()),
            false => Err(FleetError::RobotsWithoutHost(without_host)),
        }
    }

    /// Returns the brief of the bridge of host `here`, without its run root, which the supervisor sets. `effective`:
    /// text of the scenario.
    pub fn bridge_brief(
        &self,
        here: usize,
        scenario: &Scenario,
        effective: &str,
    ) -> Result<BridgeBrief, FleetError> {
        let host_of_robot = self.hosts_of_robots(scenario)?;
        let graph = scenario.graph_of_receivers();
        let robots = scenario.robots.iter().enumerate().map(|(i, robot)| {
            let receiver_hosts = graph.outgoing_edges(i).map(|edge| host_of_robot[edge.to]);
            let mut heard_on: Vec<usize> =
                receiver_hosts.filter(|&host| host != host_of_robot[i]).collect();
            heard_on.sort_unstable();
            heard_on.dedup();
            let in_neighbor_count = graph.incoming_edges(i).count();
            BridgedRobotBrief {
                name: robot.name.clone(),
                host: host_of_robot[i],
                heard_on,
                hears: in_neighbor_count,
                message_bytes_max: scenario.message_format(i).map_or(0, |format| format.bytes_max),
            }
        });
        let certificates = self.certificates.as_ref().map(|folder| {
            let name = &self.hosts[here].name;
            let file = |name: String| check_readable(folder.join(name));
            Ok(CertificatesBrief {
                authority: file("ca.pem".into())?,
                certificate: file(format!("{name}.pem"))?,
                key: file(format!("{name}.key"))?,
            })
        });
        Ok(BridgeBrief {
            format: FormatVersion,
            run_root: PathBuf::new(),
            experiment: format!("{:016x}", self.experiment_hash(effective)),
            here,
            plant: self.plant_host,
            odometry_age_ns_max: scenario.command_lifetime_ns(protocol::brief::Pace::Realtime),
            beacon_age_ns_max: scenario.silence.lost_after_ns,
            join_within_ns: self.join_within_ns,
            unreachable_after_ns: self.unreachable_after_ns,
            silence_ns_max: self.silence_ns_max,
            transport: self.transport.clone(),
            records_messages: scenario.record_messages,
            certificates: certificates.transpose()?,
            hosts: self
                .hosts
                .iter()
                .map(|host| HostBrief { name: host.name.clone(), address: host.address.clone() })
                .collect(),
            robots: robots.collect(),
            partitions: self.partition_briefs(scenario)?,
        })
    }

    fn partition_briefs(&self, scenario: &Scenario) -> Result<Vec<PartitionBrief>, FleetError> {
        let mut partitions = Vec::new();
        for fault in &scenario.faults {
            let FaultKind::Partition { hosts } = &fault.kind else { continue };
            let host_index = |name: &String| {
                let unknown = |_| FleetError::UnknownPartitionHost(name.clone(), self.host_names());
                self.find_host(name).map_err(unknown)
            };
            let mut side: Vec<usize> = hosts.iter().map(host_index).collect::<Result<_, _>>()?;
            side.sort_unstable();
            side.dedup();
            if side.len() == self.hosts.len() {
                return Err(FleetError::PartitionOfAllHosts(hosts.join(",")));
            }
            partitions.push(PartitionBrief { hosts: side, span: fault.span() });
        }
        Ok(partitions)
    }

    /// Returns a hash (FNV-1a) of scenario and fleet file.
    fn experiment_hash(&self, effective: &str) -> u64 {
        let bytes = effective.bytes().chain([0xff]).chain(self.text.bytes());
        bytes.fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        })
    }
}

/// Returns the path if the file can be read.
fn check_readable(path: PathBuf) -> Result<PathBuf, FleetError> {
    let absolute =
        regular_file::open(&path, SymlinkPolicy::Followed).and_then(|_| path.canonicalize());
    absolute.map_err(|error| FleetError::UnreadableCertificate(path, error.to_string()))
}

#[cfg(test)]
mod tests;
