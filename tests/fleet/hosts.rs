//! Simulated hosts on one machine and the network between them, created by a test and removed at its end.
//!
//! A host is a sleeping process in separate namespaces. When it exits, its namespaces and its network cables are
//! removed. All hosts are connected to one switch, a network bridge in another namespace.

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Names of the hosts, in the order of their addresses.
pub const NAMES: [&str; 3] = ["a", "b", "c"];
/// Offset between the monotonic clocks of two hosts, s.
const CLOCKS_APART_S: u64 = 86_400;
/// Lifetime of a host, s. Longer than any test; then the host exits by itself.
const SECONDS_MAX: u64 = 3_600;

/// Namespaces of a host. They are removed when it is dropped.
struct HostNamespaces {
    holder: Child,
}

impl HostNamespaces {
    fn make(monotonic_s: u64) -> HostNamespaces {
        let mut command = Command::new("unshare");
        command.args(["--net", "--mount", "--time", "--monotonic", &monotonic_s.to_string()]);
        command.args(["--fork", "--kill-child", "sh", "-c"]);
        command.arg(format!(
            "mount -t tmpfs -o size=256m tmpfs /dev/shm && ip link set lo up && echo ready && exec sleep {SECONDS_MAX}"
        ));
        // SAFETY: a plain system call between fork and exec.
        unsafe {
            command.pre_exec(|| {
                libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
                Ok(())
            });
        }
        let mut holder =
            command.stdin(Stdio::null()).stdout(Stdio::piped()).spawn().expect("unshare starts");
        let mut line = String::new();
        BufReader::new(holder.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert_eq!(line, "ready\n", "namespaces of a host");
        HostNamespaces { holder }
    }

    /// Returns the id of the process that sleeps in the namespaces: the child of `unshare`.
    fn pid(&self) -> String {
        let own = self.holder.id();
        let children = std::fs::read_to_string(format!("/proc/{own}/task/{own}/children"));
        children.unwrap().split_whitespace().next().expect("it sleeps").to_owned()
    }

    /// Prepares a program that runs in the namespaces.
    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--target", &self.pid(), "--net", "--mount", "--time", "--"]).arg(program);
        command
    }

    fn ip(&self, arguments: &str) {
        run(self.command("ip").args(arguments.split(' ')), &format!("ip {arguments}"));
    }

    /// Lets the kernel search for an unreachable host ten times a second instead of once, as `docs/fleet.md`
    /// recommends: a restored link is usable only after the next search.
    fn shorten_neighbor_probing(&self) {
        let script = "echo 100 >/proc/sys/net/ipv4/neigh/eth0/retrans_time_ms";
        run(self.command("sh").args(["-c", script]), script);
    }
}

impl Drop for HostNamespaces {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

/// Helper program of a test network, killed when it is dropped.
struct Helper(Child);

impl Helper {
    fn start(mut command: Command) -> Helper {
        // SAFETY: a plain system call between fork and exec.
        unsafe {
            command.pre_exec(|| {
                libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
                Ok(())
            });
        }
        // The programs exit at the end of their input.
        let command = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        Helper(command.spawn().expect("tests/fleet/install has installed it"))
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Faults of a bad cable to the last host, in each direction.
#[derive(Debug, Clone, Copy)]
pub struct Cable {
    /// Mean delay and its variation, ms.
    pub delay_ms: [u32; 2],
    /// Packet loss, %.
    pub loss_percent: u32,
}

/// Hosts on a switch.
pub struct Hosts {
    // Dropped before the namespaces of the programs.
    helpers: Vec<Helper>,
    hosts: Vec<HostNamespaces>,
    switch: HostNamespaces,
    _sockets: tempfile::TempDir,
}

impl Hosts {
    /// Creates this number of hosts. `None`, with a message, if the machine does not permit it.
    pub fn make(count: usize) -> Option<Hosts> {
        Hosts::make_with(count, None)
    }

    /// Creates this number of hosts with a bad cable to the last one.
    pub fn make_with(count: usize, bad_cable: Option<Cable>) -> Option<Hosts> {
        let probe = Command::new("unshare")
            .args(["--net", "--mount", "--time", "--monotonic", "1", "--fork", "true"])
            .status();
        if !probe.is_ok_and(|status| status.success()) {
            eprintln!(
                "SKIPPED: no namespaces for hosts here; it takes root, and a kernel with time namespaces"
            );
            return None;
        }
        let switch = HostNamespaces::make(0);
        switch.ip("link add hub type bridge");
        switch.ip("link set hub up");
        let sockets = tempfile::tempdir().unwrap();
        let mut helpers = Vec::new();
        let hosts = (0..count).map(|index| {
            let host = HostNamespaces::make(CLOCKS_APART_S * index as u64 + 1_000);
            let (cable, pid) = (format!("port{index}"), host.pid());
            match bad_cable.filter(|_| index == count - 1) {
                None => {
                    switch.ip(&format!("link add {cable} type veth peer name eth0 netns {pid}"))
                }
                Some(bad_cable) => {
                    helpers.extend(taps([&switch, &host], &cable, sockets.path(), bad_cable))
                }
            }
            switch.ip(&format!("link set {cable} master hub up"));
            host.ip(&format!("addr add {}/24 dev eth0", address(index)));
            host.ip("link set eth0 up");
            host.shorten_neighbor_probing();
            host
        });
        let hosts = hosts.collect();
        Some(Hosts { helpers, hosts, switch, _sockets: sockets })
    }

    /// Prepares a program that runs on a host.
    pub fn on(&self, host: usize, program: &str) -> Command {
        self.hosts[host].command(program)
    }

    /// Disconnects a host from the network, or connects it again.
    pub fn plug(&self, host: usize, up: bool) {
        self.switch.ip(&format!("link set port{host} {}", if up { "up" } else { "down" }));
    }

    /// Returns whether the programs of the network still run.
    pub fn is_running(&mut self) -> bool {
        self.helpers.iter_mut().all(|helper| helper.0.try_wait().unwrap().is_none())
    }

    /// Returns the bytes that a host has received and sent.
    pub fn bytes(&self, host: usize) -> u64 {
        let mut total = 0;
        for counter_name in ["rx_bytes", "tx_bytes"] {
            let file = format!("/sys/class/net/port{host}/statistics/{counter_name}");
            // Files below /sys belong to the namespace in which it was mounted.
            let mut cat_command = self.switch.command("sh");
            cat_command.args(["-c", &format!("mount -t sysfs sysfs /sys 2>/dev/null; cat {file}")]);
            let text = String::from_utf8(cat_command.output().unwrap().stdout).unwrap();
            total += text.trim().parse::<u64>().unwrap_or_else(|_| panic!("{file}: {text:?}"));
        }
        total
    }

    /// Returns the text of a fleet file for these robots by host, with the plant on the first one. It has certificates
    /// unless the transport is UDP. `more` has additional keys.
    pub fn fleet(&self, robots: &[&[&str]], more: &str) -> String {
        let mut text = format!("plant = \"a\"\n{more}\n");
        if !more.contains("udp") {
            text += "certificates = \"keys\"\n";
        }
        for (index, robots) in robots.iter().enumerate() {
            let (name, address) = (NAMES[index], address(index));
            text += &format!(
                "[[host]]\nname = \"{name}\"\naddress = \"{address}:7447\"\nrobots = {robots:?}\n"
            );
        }
        text
    }
}

/// Connects a host by a bad cable: a tap device at each end, and a program between them.
fn taps(nodes: [&HostNamespaces; 2], cable: &str, sockets: &Path, bad_cable: Cable) -> [Helper; 3] {
    let [near_end, far_end] = [(nodes[0], cable), (nodes[1], "eth0")].map(|(end, tap)| {
        let socket = sockets.join(format!("of-{tap}"));
        let mut switch = end.command("vde_switch");
        switch.arg("--sock").arg(&socket).args(["--tap", tap]);
        let helper = Helper::start(switch);
        wait_for_file(&socket.join("ctl"));
        (helper, socket)
    });
    let mut filter = Command::new("wirefilter");
    filter.arg("-v").arg(format!("{}:{}", near_end.1.display(), far_end.1.display()));
    let Cable { delay_ms: [delay, varies], loss_percent } = bad_cable;
    filter.arg("-d").arg(format!("{delay}+{varies}")).arg("-l").arg(loss_percent.to_string());
    let filter = Helper::start(filter);
    [near_end.0, far_end.0, filter]
}

/// Waits for a file that a helper program creates.
fn wait_for_file(path: &Path) {
    let start = std::time::Instant::now();
    while !path.exists() {
        assert!(start.elapsed().as_secs() < 10, "{} does not appear", path.display());
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

fn address(index: usize) -> String {
    format!("10.77.0.{}", index + 1)
}

fn run(command: &mut Command, what: &str) {
    let output = command.output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{what}: {error}");
}

/// Returns the processes with this executable and the parent `parent`, with their names.
pub fn children_of(parent: u32) -> Vec<(u32, String)> {
    let list = std::fs::read_to_string(format!("/proc/{parent}/task/{parent}/children"));
    let list = list.unwrap_or_default();
    let pids = list.split_whitespace().filter_map(|pid| pid.parse().ok());
    let named = |pid: u32| {
        let name = std::fs::read_to_string(Path::new("/proc").join(pid.to_string()).join("comm"));
        (pid, name.unwrap_or_default().trim().to_owned())
    };
    pids.map(named).collect()
}
