//! From a neighbor's publication to its use over zenoh or Unix datagrams: what `phalanx bench --only
//! neighbor` measures of Phalanx and of bare iceoryx2, by the same graph, timers and phases.
//!
//! Processes on a ring, each of which hears the next four, or all others in smaller rings. Each
//! wakes by its own absolute timer, takes what came, and publishes as many bytes as a beacon has.
//!
//! | how | an age is taken |
//! |---|---|
//! | `polled` | when the timer of whoever hears looks, for the newest sample |
//! | `woken` | when the sample comes: in zenoh's callback, or in a thread that blocks in `recv` |
//!
//! Usage: `neighbors TRANSPORT HOW ROBOTS RATE_HZ SECONDS`. It prints means over all edges.

mod transport;

use std::io::{self, BufRead as _, BufReader, Write as _};
use std::process::{Child, Command, ExitCode, Stdio};
use std::time::Duration;

use agent::golden_phase;
use protocol::clock::{self, Timer};
use protocol::message::Beacon;

use transport::{Ages, How, Transport};

/// As many bytes as robots tell each other.
pub const PAYLOAD_BYTES: usize = size_of::<Beacon>();
/// How many of the next processes each one hears.
const HEARS_MAX: usize = 4;
/// From the beginning to the first sample that counts: all links are then up.
const SETTLE_NS: u64 = 1_000_000_000;
/// Longer than the samples are to take, everything has ended by then.
const SLACK: Duration = Duration::from_secs(60);
/// Of each edge's ages.
const SHARES: [f64; 3] = [0.5, 0.99, 0.999];

type Failed = Box<dyn std::error::Error + Send + Sync>;

/// What is measured, and by whom.
#[derive(Debug, Clone)]
pub struct Plan {
    /// `zenoh` or `datagram`.
    pub transport: String,
    /// When an age is taken.
    pub how: How,
    /// Processes on the ring.
    pub robots: usize,
    /// Rate of each, Hz.
    pub rate_hz: u64,
    /// For so long, s.
    pub seconds: u64,
    /// Tells this measurement from others on the machine: a TCP port for each process.
    pub ports: Vec<u16>,
}

impl Plan {
    /// Whom this process hears, from 0.
    pub fn heard_by(&self, own: usize) -> Vec<usize> {
        (1..=HEARS_MAX.min(self.robots - 1)).map(|next| (own + next) % self.robots).collect()
    }

    fn from(words: &[String]) -> Result<Plan, Failed> {
        let [transport, how, robots, rate_hz, seconds, ports @ ..] = words else {
            return Err("expected TRANSPORT HOW ROBOTS RATE_HZ SECONDS".into());
        };
        let plan = Plan {
            transport: transport.clone(),
            how: how.parse()?,
            robots: number("ROBOTS", robots)?,
            rate_hz: number("RATE_HZ", rate_hz)?,
            seconds: number("SECONDS", seconds)?,
            ports: ports.iter().map(|port| number("a port", port)).collect::<Result<_, _>>()?,
        };
        match (plan.robots, plan.rate_hz, plan.seconds) {
            (2..=256, 1..=10_000, 1..=3600) => Ok(plan),
            _ => Err("expected 2 to 256 ROBOTS, RATE_HZ up to 10000, SECONDS up to 3600".into()),
        }
    }

    fn words(&self) -> Vec<String> {
        let numbers = [self.robots as u64, self.rate_hz, self.seconds].map(|n| n.to_string());
        let ports = self.ports.iter().map(u16::to_string);
        let how = self.how.word().to_owned();
        [self.transport.clone(), how].into_iter().chain(numbers).chain(ports).collect()
    }
}

fn number<N: std::str::FromStr>(what: &str, word: &str) -> Result<N, Failed> {
    word.parse().map_err(|_| format!("{what}: expected a number, got {word:?}").into())
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let done = match words.split_first() {
        Some((peer, rest)) if peer == "peer" => be_one(rest),
        _ => measure(&words),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let _ = writeln!(io::stderr(), "error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Ends this process if it hangs.
fn limit_life(plan: &Plan) {
    let limit = Duration::from_secs(plan.seconds) + SLACK;
    std::thread::spawn(move || {
        std::thread::sleep(limit);
        let _ = writeln!(io::stderr(), "error: not done within {} s", limit.as_secs());
        std::process::exit(1);
    });
}

/// The processes; dropped, they are dead.
struct Ring(Vec<Child>);

impl Drop for Ring {
    fn drop(&mut self) {
        for child in &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

/// Starts the processes one after the other, lets all begin at once, and prints what they saw.
fn measure(words: &[String]) -> Result<(), Failed> {
    let mut plan = Plan::from(words)?;
    limit_life(&plan);
    plan.ports = free_ports(plan.robots)?;
    let mut ring = Ring(Vec::new());
    let mut outputs = Vec::new();
    for own in 0..plan.robots {
        let mut child = Command::new(std::env::current_exe()?)
            .args(["peer".to_owned(), own.to_string()])
            .args(plan.words())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let mut output = BufReader::new(child.stdout.take().expect("piped")).lines();
        ring.0.push(child);
        let ready = output.next().transpose()?;
        if ready.as_deref() != Some("ready") {
            return Err(format!("process {own} is not ready: it said {ready:?}").into());
        }
        outputs.push(output);
    }
    let from_ns = clock::now_ns() + SETTLE_NS;
    for child in &mut ring.0 {
        writeln!(child.stdin.take().expect("piped"), "{from_ns}")?;
    }
    let mut edges: Vec<Vec<f64>> = Vec::new();
    for line in outputs.into_iter().flatten() {
        let line = line?;
        let quantiles = line.split(' ').map(|word| number("an age", word));
        edges.push(quantiles.collect::<Result<_, Failed>>()?);
    }
    let expected = plan.robots * plan.heard_by(0).len();
    if edges.len() != expected {
        return Err(format!("{} of {expected} edges carried anything", edges.len()).into());
    }
    let mean = |place: usize| {
        edges.iter().map(|quantiles| quantiles[place]).sum::<f64>() / edges.len() as f64
    };
    writeln!(
        io::stdout(),
        "{{\"p50_us\": {:.1}, \"p99_us\": {:.1}, \"p99.9_us\": {:.1}, \"samples\": {}}}",
        mean(0),
        mean(1),
        mean(2),
        edges.iter().map(|quantiles| quantiles[SHARES.len()]).sum::<f64>(),
    )?;
    Ok(())
}

/// Ports of the loopback interface that nobody listens on now.
fn free_ports(count: usize) -> Result<Vec<u16>, Failed> {
    let listen = |_| std::net::TcpListener::bind("127.0.0.1:0");
    let listeners = (0..count).map(listen).collect::<Result<Vec<_>, _>>()?;
    Ok(listeners.iter().map(|it| Ok(it.local_addr()?.port())).collect::<Result<_, Failed>>()?)
}

/// One process of the ring.
fn be_one(words: &[String]) -> Result<(), Failed> {
    let (own, rest) = words.split_first().ok_or("expected which process to be")?;
    let own: usize = number("a process", own)?;
    let plan = Plan::from(rest)?;
    limit_life(&plan);
    clock::tighten_timer_slack();
    let heard = plan.heard_by(own);
    let ages = Ages::of(heard.len());
    let mut transport: Box<dyn Transport> = match plan.transport.as_str() {
        "zenoh" => Box::new(transport::Zenoh::new(&plan, own, &heard, &ages)?),
        "datagram" => Box::new(transport::Datagram::new(&plan, own, &heard, &ages)?),
        other => return Err(format!("expected zenoh or datagram, got {other:?}").into()),
    };
    writeln!(io::stdout(), "ready")?;
    let mut line = String::new();
    std::io::stdin().read_line(&mut line)?;
    let from_ns = number("when to begin", line.trim())?;
    ages.count_from(from_ns);
    let until_ns: u64 = from_ns + plan.seconds * 1_000_000_000;
    let period_ns = 1_000_000_000 / plan.rate_hz;
    let mut timer = Timer::new(period_ns, (golden_phase(own + 1) * period_ns as f64) as u64);
    while timer.due_ns() < until_ns {
        if timer.wait().is_some() {
            transport.look()?;
            let mut payload = [0; PAYLOAD_BYTES];
            payload[8..16].copy_from_slice(&(own as u64).to_le_bytes());
            payload[..8].copy_from_slice(&clock::now_ns().to_le_bytes());
            transport.publish(&payload)?;
        }
    }
    for mut ages_ns in ages.take() {
        ages_ns.sort_unstable();
        let Some(last) = ages_ns.len().checked_sub(1) else { continue };
        let at = |share: f64| ages_ns[(share * last as f64).round() as usize] as f64 / 1e3;
        let [p50, p99, p99_9] = SHARES.map(at);
        writeln!(io::stdout(), "{p50} {p99} {p99_9} {}", ages_ns.len())?;
    }
    Ok(())
}
