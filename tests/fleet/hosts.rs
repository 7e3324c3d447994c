//! Hosts on one machine, and the network between them: made by a test, and gone with it.
//!
//! A host is a process that sleeps in namespaces of its own; with it they vanish, and with its network
//! the cables into it. All of them hang on one switch, a bridge in a namespace of its own.

use std::io::{BufRead as _, BufReader};
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Names of hosts, in the order of their addresses.
pub const NAMES: [&str; 3] = ["a", "b", "c"];
/// How far the monotonic clocks of two hosts are apart, s.
const CLOCKS_APART_S: u64 = 86_400;
/// No test takes longer than this, s: then its hosts end by themselves.
const SECONDS_MAX: u64 = 3_600;

/// Namespaces, for as long as this lives.
struct Place {
    holder: Child,
}

impl Place {
    fn make(monotonic_s: u64) -> Place {
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
        Place { holder }
    }

    /// The process that sleeps in them: the child of `unshare`.
    fn pid(&self) -> String {
        let own = self.holder.id();
        let children = std::fs::read_to_string(format!("/proc/{own}/task/{own}/children"));
        children.unwrap().split_whitespace().next().expect("it sleeps").to_owned()
    }

    /// A program in there.
    fn command(&self, program: impl AsRef<std::ffi::OsStr>) -> Command {
        let mut command = Command::new("nsenter");
        command.args(["--target", &self.pid(), "--net", "--mount", "--time", "--"]).arg(program);
        command
    }

    fn ip(&self, words: &str) {
        run(self.command("ip").args(words.split(' ')), &format!("ip {words}"));
    }

    /// Lets it look for a host that is gone ten times a second, not once, as `docs/fleet.md` says: a link that is
    /// back is of no use before.
    fn ask_often(&self) {
        let words = "echo 100 >/proc/sys/net/ipv4/neigh/eth0/retrans_time_ms";
        run(self.command("sh").args(["-c", words]), words);
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = self.holder.kill();
        let _ = self.holder.wait();
    }
}

/// A program of a test's network, killed with it.
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
        // They end with their input.
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

/// What a bad cable to the last host does, each way.
#[derive(Debug, Clone, Copy)]
pub struct Cable {
    /// By how much it delays, ms, and by how much that varies.
    pub delay_ms: [u32; 2],
    /// How much it loses, %.
    pub loss_percent: u32,
}

/// Some hosts on a switch.
pub struct Hosts {
    // Before the namespaces that they are in.
    helpers: Vec<Helper>,
    hosts: Vec<Place>,
    switch: Place,
    _sockets: tempfile::TempDir,
}

impl Hosts {
    /// So many; `None`, with a word about it, where that is not possible.
    pub fn make(count: usize) -> Option<Hosts> {
        Hosts::make_with(count, None)
    }

    /// The same with a bad cable to the last of them.
    pub fn make_with(count: usize, bad: Option<Cable>) -> Option<Hosts> {
        let able = Command::new("unshare")
            .args(["--net", "--mount", "--time", "--monotonic", "1", "--fork", "true"])
            .status();
        if !able.is_ok_and(|status| status.success()) {
            eprintln!(
                "SKIPPED: no namespaces for hosts here; it takes root, and a kernel with time namespaces"
            );
            return None;
        }
        let switch = Place::make(0);
        switch.ip("link add hub type bridge");
        switch.ip("link set hub up");
        let sockets = tempfile::tempdir().unwrap();
        let mut helpers = Vec::new();
        let hosts = (0..count).map(|place| {
            let host = Place::make(CLOCKS_APART_S * place as u64 + 1_000);
            let (cable, pid) = (format!("port{place}"), host.pid());
            match bad.filter(|_| place == count - 1) {
                None => {
                    switch.ip(&format!("link add {cable} type veth peer name eth0 netns {pid}"))
                }
                Some(bad) => helpers.extend(taps([&switch, &host], &cable, sockets.path(), bad)),
            }
            switch.ip(&format!("link set {cable} master hub up"));
            host.ip(&format!("addr add {}/24 dev eth0", address(place)));
            host.ip("link set eth0 up");
            host.ask_often();
            host
        });
        let hosts = hosts.collect();
        Some(Hosts { helpers, hosts, switch, _sockets: sockets })
    }

    /// A program on a host.
    pub fn on(&self, host: usize, program: &str) -> Command {
        self.hosts[host].command(program)
    }

    /// Takes a host from the network, or puts it back.
    pub fn plug(&self, host: usize, up: bool) {
        self.switch.ip(&format!("link set port{host} {}", if up { "up" } else { "down" }));
    }

    /// Whether the network's programs still run.
    pub fn is_whole(&mut self) -> bool {
        self.helpers.iter_mut().all(|helper| helper.0.try_wait().unwrap().is_none())
    }

    /// Bytes that went to and from a host so far.
    pub fn bytes(&self, host: usize) -> u64 {
        let mut total = 0;
        for way in ["rx_bytes", "tx_bytes"] {
            let file = format!("/sys/class/net/port{host}/statistics/{way}");
            // What is below /sys is of the namespace in which it was mounted.
            let mut shown = self.switch.command("sh");
            shown.args(["-c", &format!("mount -t sysfs sysfs /sys 2>/dev/null; cat {file}")]);
            let text = String::from_utf8(shown.output().unwrap().stdout).unwrap();
            total += text.trim().parse::<u64>().unwrap_or_else(|_| panic!("{file}: {text:?}"));
        }
        total
    }

    /// A fleet file for these robots by host; the plant is on the first. With certificates, but over UDP. `more`:
    /// other keys.
    pub fn fleet(&self, robots: &[&[&str]], more: &str) -> String {
        let mut text = format!("plant = \"a\"\n{more}\n");
        if !more.contains("udp") {
            text += "certificates = \"keys\"\n";
        }
        for (place, robots) in robots.iter().enumerate() {
            let (name, address) = (NAMES[place], address(place));
            text += &format!(
                "[[host]]\nname = \"{name}\"\naddress = \"{address}:7447\"\nrobots = {robots:?}\n"
            );
        }
        text
    }
}

/// A bad cable: a tap at each end, and what is between them.
fn taps(ends: [&Place; 2], cable: &str, sockets: &Path, bad: Cable) -> [Helper; 3] {
    let [near, far] = [(ends[0], cable), (ends[1], "eth0")].map(|(place, tap)| {
        let socket = sockets.join(format!("of-{tap}"));
        let mut switch = place.command("vde_switch");
        switch.arg("--sock").arg(&socket).args(["--tap", tap]);
        let helper = Helper::start(switch);
        appears(&socket.join("ctl"));
        (helper, socket)
    });
    let mut filter = Command::new("wirefilter");
    filter.arg("-v").arg(format!("{}:{}", near.1.display(), far.1.display()));
    let Cable { delay_ms: [delay, varies], loss_percent } = bad;
    filter.arg("-d").arg(format!("{delay}+{varies}")).arg("-l").arg(loss_percent.to_string());
    let filter = Helper::start(filter);
    [near.0, far.0, filter]
}

/// Waits for a file that a helper makes.
fn appears(path: &Path) {
    let began = std::time::Instant::now();
    while !path.exists() {
        assert!(began.elapsed().as_secs() < 10, "{} does not appear", path.display());
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
}

fn address(place: usize) -> String {
    format!("10.77.0.{}", place + 1)
}

fn run(command: &mut Command, what: &str) {
    let output = command.output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{what}: {error}");
}

/// Processes whose executable is this one and whose parent is `parent`, with their names.
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
