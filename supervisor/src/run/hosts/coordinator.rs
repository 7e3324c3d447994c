//! The plant's host: gathers the other hosts, sends them the wanted states of their processes, receives the
//! actual states, and detects hosts that are unreachable. Must not wait for a host while the run is in
//! progress.

use std::time::{Duration, Instant};

use protocol::brief::BridgeBrief;
use protocol::dropped::dropped_counts;
use protocol::message::{
    BridgeHeader, OrderHeader, OrderRow, PeerRow, Phase, ReportHeader, ReportRow,
};
use protocol::process::StopFlag;
use protocol::service::{
    self, Factory, Node, Publisher, Qos, ServiceError, Subscriber, send_slice,
};

use super::remote::RemoteRobot;
use crate::dead_nodes::Cleaner;
use crate::run::RunError;
use crate::run::helper_process::HelperProcess;
use crate::run::processes::TERMINATION_GRACE_TIME;
use outcome::metrics::summary::HostSummary;

/// Interval at which orders are sent.
const ORDER_INTERVAL: Duration = Duration::from_millis(20);
/// Time without a report of a host's supervisor after which a warning is printed.
const REPORT_SILENCE_MAX: Duration = Duration::from_secs(5);
/// Duration of one iteration of a wait.
const POLL_INTERVAL: Duration = Duration::from_millis(2);
/// Maximum time for hosts to end their processes, which can take twice the grace time, and to deliver the last messages.
const HOSTS_END_TIMEOUT: Duration = Duration::from_secs(2 * TERMINATION_GRACE_TIME.as_secs() + 4);
/// Duration for which the end of the run is announced to hosts.
const END_ANNOUNCEMENT_TIME: Duration = Duration::from_millis(200);

/// Services between a host's bridge and its supervisor, kept open.
pub(crate) struct HostServices {
    /// Service of orders from the plant's host; on other hosts only.
    orders: Option<Factory<[OrderRow], OrderHeader>>,
    report: Option<Factory<[ReportRow], ReportHeader>>,
    bridge: Factory<[PeerRow], BridgeHeader>,
}

impl HostServices {
    /// Creates the services of the plant's host, one set for each host.
    pub(crate) fn create(node: &Node, brief: &BridgeBrief) -> Result<Vec<Self>, ServiceError> {
        let qos = Qos::for_hosts(1);
        let hosts = brief.hosts.iter().enumerate().map(|(index, host)| {
            let other_host_name = (index != brief.here).then_some(host.name.as_str());
            Ok(HostServices {
                orders: other_host_name
                    .map(|name| service::orders_topic(name).create(node, qos))
                    .transpose()?,
                report: other_host_name
                    .map(|name| service::host_report_topic(name).create(node, qos))
                    .transpose()?,
                bridge: service::bridge_topic(&host.name).create(node, qos)?,
            })
        });
        hosts.collect()
    }
}

/// All other hosts, and this host's bridge.
pub(crate) struct Hosts {
    brief: BridgeBrief,
    pub(crate) bridge: HelperProcess,
    hosts: Vec<Host>,
    phase: Phase,
    has_failed: bool,
    sequence: u64,
    last_order: Option<Instant>,
    _services: Vec<HostServices>,
}

/// State of a host as its supervisor reported it.
struct ReportedState {
    newest_report: Option<ReportHeader>,
    /// Arrival time of the newest report.
    arrival: Instant,
    /// Time between the two newest reports.
    interval: Duration,
    /// Whether a warning was printed that no reports arrive.
    is_silent: bool,
    /// Whether the supervisor left while the run was in progress.
    has_left: bool,
    /// Whether the supervisor knows that the run has ended, and has reported its robots' states at that time.
    confirmed_end: bool,
}

impl ReportedState {
    /// Returns the state before the first report.
    fn before_first_report() -> ReportedState {
        let (arrival, interval) = (Instant::now(), Duration::ZERO);
        let (is_silent, has_left, confirmed_end) = (false, false, false);
        ReportedState { newest_report: None, arrival, interval, is_silent, has_left, confirmed_end }
    }

    /// Updates the state from the header of a report that arrives while the run is in `phase`.
    fn update(&mut self, header: ReportHeader, phase: Phase) {
        self.newest_report = Some(header);
        self.interval = self.arrival.elapsed();
        self.arrival = Instant::now();
        self.is_silent = false;
        let reported_phase = Phase::from_number(header.phase);
        match phase {
            Phase::Gathering | Phase::Running => {
                self.has_left = reported_phase == Some(Phase::Done)
            }
            Phase::Ending | Phase::Done => {
                self.confirmed_end |= !self.has_left && reported_phase >= Some(Phase::Ending);
            }
        }
    }
}

/// State of one host, including this one.
struct Host {
    orders: Option<Publisher<[OrderRow], OrderHeader>>,
    reports: Option<Subscriber<[ReportRow], ReportHeader>>,
    bridge_subscriber: Subscriber<[PeerRow], BridgeHeader>,
    reported_state: ReportedState,
    /// Newest status of the host's bridge, and the arrival time of the status.
    bridge_status: Option<(BridgeHeader, Vec<PeerRow>, Instant)>,
    /// Sum of the counts of earlier bridge processes of the host.
    earlier_counts: BridgeHeader,
    reachable: bool,
    /// Number of times the host was unreachable.
    times_unreachable: u64,
}

impl Host {
    /// Returns the sum of the counts of all bridge processes of the host.
    fn bridge_counts(&self) -> BridgeHeader {
        match &self.bridge_status {
            None => self.earlier_counts,
            Some((header, ..)) => add_counts(&self.earlier_counts, header),
        }
    }
}

fn add_counts(a: &BridgeHeader, b: &BridgeHeader) -> BridgeHeader {
    BridgeHeader {
        sent: a.sent + b.sent,
        samples_sent: a.samples_sent + b.samples_sent,
        taken: a.taken + b.taken,
        told_dropped: a.told_dropped + b.told_dropped,
        dropped: std::array::from_fn(|index| a.dropped[index] + b.dropped[index]),
        ..*b
    }
}

/// Change of another host, by index.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum HostChange {
    /// The host is unreachable.
    Lost(usize),
    /// The supervisor of the host reported that it leaves.
    Left(usize),
    /// The bridge of the host is reachable, but its supervisor does not report.
    SupervisorSilent(usize),
    /// The host is reachable again.
    ReachableAgain(usize),
    /// The bridge of the host was restarted.
    BridgeRestarted(usize),
}

impl Hosts {
    /// Creates the state after this host's bridge was started with this brief.
    pub(crate) fn new(
        brief: BridgeBrief,
        bridge: HelperProcess,
        services: Vec<HostServices>,
    ) -> Result<Hosts, ServiceError> {
        let robots = brief.robots.len();
        let hosts = services.iter().map(|HostServices { orders, report, bridge }| {
            Ok(Host {
                orders: orders.as_ref().map(|orders| orders.publisher(robots)).transpose()?,
                reports: report.as_ref().map(|report| report.subscriber()).transpose()?,
                bridge_subscriber: bridge.subscriber()?,
                reported_state: ReportedState::before_first_report(),
                bridge_status: None,
                earlier_counts: BridgeHeader::default(),
                reachable: true,
                times_unreachable: 0,
            })
        });
        let hosts = hosts.collect::<Result<_, ServiceError>>()?;
        let (phase, has_failed, sequence, last_order) = (Phase::Gathering, false, 0, None);
        Ok(Hosts {
            brief,
            bridge,
            hosts,
            phase,
            has_failed,
            sequence,
            last_order,
            _services: services,
        })
    }

    /// Returns the name of a host.
    pub(crate) fn host_name(&self, host: usize) -> &str {
        &self.brief.hosts[host].name
    }

    /// Returns the time without a message after which a host is unreachable, ns.
    pub(crate) fn silence_max_ns(&self) -> u64 {
        self.brief.unreachable_after_ns
    }

    /// Returns the robots of a host, by index.
    pub(crate) fn robots_of_host(&self, host: usize) -> Vec<usize> {
        let robots = self.brief.robots.iter().enumerate();
        robots.filter(|(_, robot)| robot.host == host).map(|(index, _)| index).collect()
    }

    /// Returns whether a host is reachable.
    pub(crate) fn is_reachable(&self, host: usize) -> bool {
        self.hosts[host].reachable
    }

    /// Returns the time between the two newest reports of a host: events of the newest report took place in it.
    pub(crate) fn report_interval(&self, host: usize) -> Duration {
        self.hosts[host].reported_state.interval
    }

    /// Returns the other hosts that did not report the states of their robots at the end of the run.
    pub(crate) fn hosts_without_confirmed_end(&self) -> Vec<usize> {
        self.other_hosts().filter(|&host| !self.hosts[host].reported_state.confirmed_end).collect()
    }

    /// Returns whether a planned partition separates a host from this one at a run time, ns.
    pub(crate) fn is_partitioned(&self, host: usize, t_ns: u64) -> bool {
        self.brief.are_partitioned(self.brief.here, host, t_ns)
    }

    /// Returns the other hosts, by index.
    fn other_hosts(&self) -> impl Iterator<Item = usize> + use<> {
        let own_host = self.brief.here;
        (0..self.hosts.len()).filter(move |&host| host != own_host)
    }

    /// Waits until all hosts have joined and synchronized their clocks, at most for the time in the fleet file.
    pub(crate) fn wait_for_hosts(
        &mut self,
        remotes: &mut [Option<&mut RemoteRobot>],
        cleaner: &Cleaner,
        stop: &StopFlag,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let timeout = Duration::from_nanos(self.brief.join_within_ns);
        loop {
            self.read_reports(remotes)?;
            self.send_orders(remotes)?;
            if self.watch_bridge(cleaner)?.is_some() {
                tracing::warn!("the bridge died before the run began");
            }
            while cleaner.next_cleaned_owner().is_some() {
                self.bridge.restart_after_cleanup()?;
            }
            let missing_hosts: Vec<&str> = self
                .other_hosts()
                .filter(|&host| !self.is_ready(host))
                .map(|host| self.host_name(host))
                .collect();
            let hosts = missing_hosts.join(", ");
            if missing_hosts.is_empty() {
                self.phase = Phase::Running;
                self.last_order = None;
                return Ok(());
            }
            if stop.is_requested() {
                return Err(RunError::Interrupted { hosts });
            }
            if start.elapsed() > timeout {
                let own_counts = self.hosts[self.brief.here].bridge_counts();
                let dropped_text: Vec<String> = dropped_counts(&own_counts)
                    .map(|(keyword, count)| format!("{keyword} {count}"))
                    .collect();
                let dropped_text = match &dropped_text[..] {
                    [] => String::new(),
                    counts => format!("; samples of theirs were dropped: {}", counts.join(", ")),
                };
                return Err(RunError::HostsMissing {
                    hosts,
                    waited: timeout,
                    dropped: dropped_text,
                });
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }

    /// Returns whether a host reports and has compared clocks.
    fn is_ready(&self, host: usize) -> bool {
        let host = &self.hosts[host];
        let plant = self.brief.plant as u64;
        let has_compared_clocks = host.bridge_status.as_ref().is_some_and(|(_, peers, _)| {
            peers.iter().any(|peer| peer.host == plant && peer.round_trip_ns > 0)
        });
        host.reported_state.newest_report.is_some()
            && !host.reported_state.has_left
            && has_compared_clocks
    }

    /// Sends the wanted states of processes to all hosts, if due.
    pub(crate) fn send_orders(
        &mut self,
        remotes: &[Option<&mut RemoteRobot>],
    ) -> Result<(), RunError> {
        if self.last_order.is_some_and(|last_order| last_order.elapsed() < ORDER_INTERVAL) {
            return Ok(());
        }
        self.last_order = Some(Instant::now());
        self.sequence += 1;
        let header = OrderHeader {
            sequence: self.sequence,
            phase: self.phase as u64,
            failed: u64::from(self.has_failed),
        };
        for (index, host) in self.hosts.iter().enumerate() {
            let Some(orders) = &host.orders else { continue };
            let host_remotes = remotes.iter().flatten().filter(|remote| remote.host == index);
            let rows: Vec<OrderRow> = host_remotes.map(|remote| remote.order()).collect();
            send_slice(orders, header, rows.len(), |row| rows[row])?;
        }
        Ok(())
    }

    /// Reads the reports of hosts and the status of bridges. Returns the changes.
    pub(crate) fn read_reports(
        &mut self,
        remotes: &mut [Option<&mut RemoteRobot>],
    ) -> Result<Vec<HostChange>, RunError> {
        let mut changes = Vec::new();
        for (index, host) in self.hosts.iter_mut().enumerate() {
            while let Some(sample) = host.bridge_subscriber.receive()? {
                let header = *sample.user_header();
                if let Some((previous, ..)) = &host.bridge_status
                    && previous.boot != header.boot
                {
                    host.earlier_counts = add_counts(&host.earlier_counts, previous);
                    changes.push(HostChange::BridgeRestarted(index));
                }
                host.bridge_status = Some((header, sample.payload().to_vec(), Instant::now()));
            }
            let Some(reports) = &host.reports else { continue };
            while let Some(sample) = reports.receive()? {
                host.reported_state.update(*sample.user_header(), self.phase);
                for row in sample.payload() {
                    let robot = (row.robot as usize).checked_sub(1);
                    let remote = robot.and_then(|robot| remotes.get_mut(robot)?.as_deref_mut());
                    if let Some(remote) = remote.filter(|remote| remote.host == index) {
                        remote.update_report(*row);
                    }
                }
            }
        }
        let timeout = Duration::from_nanos(self.brief.unreachable_after_ns);
        for host in self.other_hosts() {
            let silence = self.silence_of_host(host);
            let is_received = silence.is_none_or(|silence| silence <= timeout);
            let is_running = self.phase == Phase::Running;
            let host_state = &mut self.hosts[host];
            let is_reachable = is_received && !host_state.reported_state.has_left;
            if std::mem::replace(&mut host_state.reachable, is_reachable) != is_reachable {
                host_state.times_unreachable += u64::from(!is_reachable);
                changes.push(match is_reachable {
                    true => HostChange::ReachableAgain(host),
                    false if host_state.reported_state.has_left => HostChange::Left(host),
                    false => HostChange::Lost(host),
                });
            }
            let reported_state = &mut host_state.reported_state;
            let is_silent =
                is_running && is_reachable && reported_state.arrival.elapsed() > REPORT_SILENCE_MAX;
            if is_silent && !std::mem::replace(&mut reported_state.is_silent, true) {
                changes.push(HostChange::SupervisorSilent(host));
            }
        }
        Ok(changes)
    }

    /// Polls this host's bridge. Returns how it died if it has just exited. Fails if it cannot be restarted.
    pub(crate) fn watch_bridge(&mut self, cleaner: &Cleaner) -> Result<Option<String>, RunError> {
        self.bridge.poll(cleaner).map(RunError::check_given_up).transpose()
    }

    /// Returns the time since the bridge received a message of a host; `None` while it is unknown.
    fn silence_of_host(&self, host: usize) -> Option<Duration> {
        let (_, peers, arrival) = self.hosts[self.brief.here].bridge_status.as_ref()?;
        let peer = peers.iter().find(|peer| peer.host == host as u64)?;
        (peer.silent_ns < u64::MAX)
            .then(|| Duration::from_nanos(peer.silent_ns) + arrival.elapsed())
    }

    /// Announces the end of the run, so that hosts end their processes and deliver their last messages,
    /// which `read_messages` reads. Does not wait for unreachable hosts.
    pub(crate) fn announce_end(
        &mut self,
        remotes: &mut [Option<&mut RemoteRobot>],
        has_failed: bool,
        mut read_messages: impl FnMut(),
    ) -> Result<(), RunError> {
        self.phase = Phase::Ending;
        self.has_failed = has_failed;
        self.last_order = None;
        let start = Instant::now();
        while start.elapsed() < HOSTS_END_TIMEOUT {
            self.read_reports(remotes)?;
            self.send_orders(remotes)?;
            read_messages();
            let is_done = |host: usize| {
                let report = self.hosts[host].reported_state.newest_report.as_ref();
                report.is_none_or(|report| Phase::from_number(report.phase) == Some(Phase::Done))
            };
            if self.other_hosts().all(|host| !self.hosts[host].reachable || is_done(host)) {
                break;
            }
            std::thread::sleep(POLL_INTERVAL);
        }
        self.phase = Phase::Done;
        let done_time = Instant::now();
        while done_time.elapsed() < END_ANNOUNCEMENT_TIME {
            self.read_reports(remotes)?;
            self.send_orders(remotes)?;
            read_messages();
            std::thread::sleep(POLL_INTERVAL);
        }
        Ok(())
    }

    /// Returns the summary of each host for the results.
    pub(crate) fn summaries(&self) -> Vec<HostSummary> {
        let hosts = self.hosts.iter().enumerate().map(|(index, host)| {
            let counts = host.bridge_counts();
            let peers = host.bridge_status.as_ref().map_or(&[][..], |(_, peers, _)| peers);
            let plant = peers.iter().find(|peer| peer.host == self.brief.plant as u64);
            let robots = self.robots_of_host(index).into_iter();
            HostSummary {
                name: self.host_name(index).to_owned(),
                robots: robots.map(|robot| self.brief.robots[robot].name.clone()).collect(),
                reachable: host.reachable,
                lost: host.times_unreachable,
                bridge_restarts: match &host.reported_state.newest_report {
                    Some(report) => report.bridge_restarts,
                    None => self.bridge.restarts(),
                },
                round_trip_ns: plant.map(|peer| peer.round_trip_ns),
                stamp_error_ns_max: plant.map(|peer| peer.uncertainty_ns_max),
                sent: counts.sent,
                samples_sent: counts.samples_sent,
                taken: counts.taken,
                told_dropped: counts.told_dropped,
                dropped: dropped_counts(&counts)
                    .map(|(keyword, count)| (keyword.to_owned(), count))
                    .collect(),
            }
        });
        hosts.collect()
    }
}
