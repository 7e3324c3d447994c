//! The round trip: an odometry sample to another process, and a command back.
//!
//! Ours is one lockstep tick of one robot: the world, iceoryx2, the barrier, and a real agent that
//! thinks. The floors carry the same two messages between two processes, and think nothing. Each end
//! has a core of its own.

use std::ffi::OsString;
use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use experiment::briefs;
use iceoryx2::prelude::ZeroCopySend;
use plant::world::World;
use protocol::barrier::Barrier;
use protocol::brief::{self, Pace};
use protocol::clock;
use protocol::message::{Command, Odometry};
use protocol::process::Stop;
use protocol::run_root::{self, RunRoot};
use protocol::service::{self, Factory, Node, Publisher, Qos, Subscriber};
use rustix::thread::futex;
use rustix::time::Timespec;
use supervisor::spawn::{Launcher, Role};

use crate::cores::{Cores, on_the_other};
use crate::mapping::{Line, Mapping, Plain, Word};
use crate::peers::{self, Peers};
use crate::quantiles::quantiles_us;
use crate::table::Row;
use crate::{BenchError, HUNG_AFTER, Measured, Place, Setting, failed, pipe, ring};

/// How long a wait lasts before it is looked whether the other lives.
const WAIT_MAX: Duration = Duration::from_millis(200);
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: WAIT_MAX.as_nanos() as i64 };
/// A robot must be ready, and a tick done, within this.
const READY_MAX: Duration = Duration::from_secs(10);
const READY_EVERY: Duration = Duration::from_millis(1);
/// Trips that nobody times: caches are cold, and a robot hears and finds everything for the first
/// time.
const WARM_UP: usize = 200;
/// T of the robot alone, s. Simulated: it takes no time.
const PERIOD_S: f64 = 0.005;

/// What carries the two messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Transport {
    /// A mapping, looked at all the time.
    Spin,
    /// A mapping, and a futex for each direction.
    Futex,
    /// A pipe for each direction.
    Pipe,
    /// A Unix datagram socket at each end.
    Datagram,
    /// iceoryx2 publish/subscribe, looked at all the time.
    Iceoryx2,
    /// iceoryx2 publish/subscribe, and a futex for each direction.
    Iceoryx2Futex,
}

impl Transport {
    const ALL: [Transport; 6] = [
        Transport::Spin,
        Transport::Futex,
        Transport::Pipe,
        Transport::Datagram,
        Transport::Iceoryx2,
        Transport::Iceoryx2Futex,
    ];

    fn name(self) -> &'static str {
        match self {
            Transport::Spin => "shared memory, spinning",
            Transport::Futex => "shared memory + futex",
            Transport::Pipe => "pipe",
            Transport::Datagram => "unix datagram",
            Transport::Iceoryx2 => "iceoryx2, spinning",
            Transport::Iceoryx2Futex => "iceoryx2 + futex",
        }
    }

    fn is_iceoryx2(self) -> bool {
        matches!(self, Transport::Iceoryx2 | Transport::Iceoryx2Futex)
    }

    fn word(self) -> String {
        let value = self.to_possible_value().expect("none is hidden");
        value.get_name().to_owned()
    }
}

/// How long so many trips took, us.
struct Trips {
    p50_us: f64,
    p99_us: f64,
}

impl Trips {
    fn of(trips_ns: Vec<u32>) -> Trips {
        let [p50_us, p99_us, _] = quantiles_us(trips_ns).expect("at least one trip");
        Trips { p50_us, p99_us }
    }
}

/// Measures in turns: `trips` round trips by each transport, at most for `limit` each.
pub(crate) fn measure(setting: &Setting<'_>, trips: usize, limit: Duration) -> Measured {
    let &Setting { root, stop, rounds, .. } = setting;
    run_root::join(root.path())?;
    let node = service::node("bench")?;
    let cores = Cores::take();
    let with = With { root, stop, cores: cores.as_ref(), node: &node, trips, limit };
    let mut ours = Vec::new();
    let mut floors: Vec<Vec<Trips>> = Transport::ALL.iter().map(|_| Vec::new()).collect();
    for round in 0..rounds {
        setting.progress(&format!("round trip, ours, round {}", round + 1));
        ours.push(with.an_agent(round)?);
        for (transport, floor) in Transport::ALL.into_iter().zip(&mut floors) {
            setting.progress(&format!("round trip, {}, round {}", transport.name(), round + 1));
            floor.push(with.bare(transport, round)?);
        }
    }
    drop(cores);
    let mut rows = Vec::new();
    let mut rows_of = |name: &str, figure: fn(&Trips) -> f64| {
        let column = |trips: &[Trips]| trips.iter().map(figure).collect::<Vec<_>>();
        for (transport, floor) in Transport::ALL.into_iter().zip(&floors) {
            let what = format!("round trip {name}, us");
            let (ours, floor) = (column(&ours), column(floor));
            rows.push(Row::against("floors", &what, transport.name(), ours, floor));
        }
    };
    rows_of("p50", |trips| trips.p50_us);
    rows_of("p99", |trips| trips.p99_us);
    Ok(rows)
}

/// What all round trips of a bench are measured with.
#[derive(Clone, Copy)]
struct With<'a> {
    root: &'a RunRoot,
    stop: &'a Stop,
    cores: Option<&'a Cores>,
    node: &'a Node,
    /// Trips in a round.
    trips: usize,
    limit: Duration,
}

impl With<'_> {
    /// Times trips until there are enough or time is up.
    fn timed(
        &self,
        mut trip: impl FnMut(u64) -> Result<(), BenchError>,
    ) -> Result<Trips, BenchError> {
        let With { stop, trips, limit, .. } = *self;
        for tick in 0..WARM_UP {
            trip(tick as u64)?;
        }
        let mut trips_ns = Vec::with_capacity(trips);
        let began = Instant::now();
        let mut last = began;
        for tick in (WARM_UP as u64..).take(trips) {
            trip(tick)?;
            let now = Instant::now();
            trips_ns.push((now - last).as_nanos().min(u128::from(u32::MAX)) as u32);
            last = now;
            if stop.requested() {
                return Err(BenchError::Interrupted);
            }
            if now - began > limit {
                break;
            }
        }
        Ok(Trips::of(trips_ns))
    }

    /// Ours: the bench in the plant's place, and a real agent.
    fn an_agent(&self, round: usize) -> Result<Trips, BenchError> {
        let With { root, stop, cores, node, trips, .. } = *self;
        let name = format!("alone-{round}");
        let scenario = ring::read(&ring::alone(&name, (WARM_UP + trips) as u64, PERIOD_S))?;
        let told = briefs::agent(&scenario, 0, Pace::Lockstep, root.path());
        let plant = briefs::plant(&scenario, Pace::Lockstep, root.path());
        let own = Services::of(&name, node)?;
        // Nobody receives these.
        let others = (
            service::beacon(&name).create(node, Qos::of_robot(Pace::Lockstep, 0))?,
            service::status(&name).create(node, Qos::of_status(1))?,
            service::latency(&name).create(node, Qos::of_latency(1))?,
        );
        let barrier = Barrier::create(&root.barrier_path(), 1, 1, HUNG_AFTER)?;
        barrier.set_member(0, 0);
        let place = Place::new(root, &name)?;
        let path = place.path().join("brief.toml");
        std::fs::write(&path, brief::to_text(&told)).map_err(failed("write", &path))?;
        let (odometry, command) = (own.odometry.publisher()?, own.command.subscriber()?);
        let mut world = World::new(&plant);
        let role = Role::Agent { brief: &path, program: None, incarnation: 0 };
        let log = place.path().join("agent.log");
        let mut agent = on_the_other(cores, || Launcher::of_this_executable().spawn(role, &log))?;
        let mut lives = || match agent.ended() {
            _ if stop.requested() => Err(BenchError::Interrupted),
            None => Ok(()),
            Some(_) => {
                let what = "the agent ended early".to_owned();
                Err(BenchError::Peer { what, log: agent.last_lines(8) })
            }
        };
        let began = Instant::now();
        while own.command.number_of_publishers() == 0 {
            lives()?;
            if began.elapsed() > READY_MAX {
                return Err(BenchError::Wrong("the agent was not ready in time".into()));
            }
            std::thread::sleep(READY_EVERY);
        }
        let timed = self.timed(|tick| {
            let sample = Odometry { sent_ns: clock::now_ns(), ..world.odometry(0) };
            odometry.send_copy(sample).map_err(not_sent)?;
            barrier.begin(tick);
            barrier.release(0);
            let began = Instant::now();
            let mut lived = Ok(());
            let arrived = barrier.wait_arrivals(tick, || {
                lived = lives();
                lived.is_ok() && began.elapsed() < READY_MAX
            });
            if arrived.is_err() {
                lived?;
                return Err(BenchError::Wrong("the agent did not answer in time".into()));
            }
            let answer = command.receive().map_err(not_received)?;
            let answer = answer.filter(|answer| answer.tick == tick);
            let answer =
                answer.ok_or_else(|| BenchError::Wrong(format!("no command at tick {tick}")))?;
            world.accept(0, &answer).map_err(|refusal| BenchError::Wrong(refusal.to_string()))?;
            world.advance((tick + 1) * plant.period_ns);
            world.next_tick();
            Ok(())
        });
        drop((odometry, command, agent, own, others));
        timed
    }

    /// A floor: the bench, and a peer that answers at once.
    fn bare(&self, transport: Transport, round: usize) -> Result<Trips, BenchError> {
        let With { root, stop, cores, node, .. } = *self;
        let place = Place::new(root, &format!("{}-{round}", transport.word()))?;
        let services = match transport.is_iceoryx2() {
            true => Some(Services::of(&service_name(place.path()), node)?),
            false => None,
        };
        if transport == Transport::Pipe {
            pipe::make(&place.path().join(Odometry::NAME))?;
            pipe::make(&place.path().join(Command::NAME))?;
        }
        let mut end = match &services {
            None => End::<Odometry, Command>::new(transport, place.path())?,
            Some(Services { odometry, command }) => {
                let (out, incoming) = (odometry.publisher()?, command.subscriber()?);
                End::of_iceoryx2(transport, place.path(), out, incoming)?
            }
        };
        let words: Vec<OsString> =
            vec!["peer".into(), "round-trip".into(), transport.word().into(), place.path().into()];
        let peers = on_the_other(cores, || Peers::start(place.path(), stop, [words]))?;
        peers.wait_ready()?;
        let answers = |_: BenchError| peers.why();
        let timed = self.timed(|tick| {
            end.send(&Odometry { tick, ..Odometry::default() }).map_err(answers)?;
            let answer = end.receive(|| peers.gone()).map_err(answers)?;
            match answer {
                None => Err(peers.why()),
                Some(Command { tick: answered, .. }) if answered != tick => {
                    let name = transport.name();
                    Err(BenchError::Wrong(format!("{name}: {answered} came back for {tick}")))
                }
                Some(_) => Ok(()),
            }
        });
        drop((end, peers, services));
        timed
    }
}

/// Answers every sample until killed.
pub(crate) fn peer(transport: Transport, dir: &Path) -> Result<(), BenchError> {
    let (mut end, _kept) = match transport.is_iceoryx2() {
        false => (End::<Command, Odometry>::new(transport, dir)?, None),
        true => {
            run_root::join(dir.parent().unwrap_or(dir))?;
            let node = service::node("echo")?;
            let services = Services::open(&node, dir)?;
            let Services { odometry, command } = &services;
            let (out, incoming) = (command.publisher()?, odometry.subscriber()?);
            (End::of_iceoryx2(transport, dir, out, incoming)?, Some((services, node)))
        }
    };
    peers::say_ready(dir, 0)?;
    while let Some(Odometry { tick, .. }) = end.receive(|| false)? {
        end.send(&Command { tick, ..Command::default() })?;
    }
    Ok(())
}

struct Services {
    odometry: Factory<Odometry>,
    command: Factory<Command>,
}

impl Services {
    /// Creates those of a robot of this name.
    fn of(name: &str, node: &Node) -> Result<Services, BenchError> {
        let one = Qos::of_robot(Pace::Lockstep, 1);
        Ok(Services {
            odometry: service::odometry(name).create(node, one)?,
            command: service::command(name).create(node, one)?,
        })
    }

    fn open(node: &Node, dir: &Path) -> Result<Services, BenchError> {
        let name = service_name(dir);
        Ok(Services {
            odometry: service::odometry(&name).open(node)?,
            command: service::command(&name).open(node)?,
        })
    }
}

fn service_name(dir: &Path) -> String {
    dir.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn not_sent(cause: iceoryx2::port::SendError) -> BenchError {
    BenchError::Wrong(format!("not sent: {cause}"))
}

fn not_received(cause: iceoryx2::port::ReceiveError) -> BenchError {
    BenchError::Wrong(format!("not received: {cause}"))
}

/// Two messages in shared memory, and a word each that counts them.
#[repr(C)]
struct Exchange {
    odometry: Line<Odometry>,
    command: Line<Command>,
    asked: Word,
    answered: Word,
}

/// What the transports carry.
trait Sent: Plain + Copy + Default + std::fmt::Debug + ZeroCopySend + 'static {
    /// Of its pipe, and of the socket of whoever sends it.
    const NAME: &'static str;
    /// Its place in shared memory, and the word that counts it.
    fn line(exchange: &Exchange) -> (&Line<Self>, &AtomicU32);
}

impl Sent for Odometry {
    const NAME: &'static str = "odometry";
    fn line(exchange: &Exchange) -> (&Line<Odometry>, &AtomicU32) {
        (&exchange.odometry, &exchange.asked.0)
    }
}

impl Sent for Command {
    const NAME: &'static str = "command";
    fn line(exchange: &Exchange) -> (&Line<Command>, &AtomicU32) {
        (&exchange.command, &exchange.answered.0)
    }
}

/// One end of a transport; `O` goes out, `I` comes in.
struct End<O: Sent, I: Sent> {
    data: Data<O, I>,
    /// Where the words are, if any, and how many messages were taken.
    exchange: Option<Mapping<Exchange>>,
    taken: u32,
    /// Sleeps on the word instead of looking all the time.
    sleeps: bool,
}

/// What carries the messages.
enum Data<O: Sent, I: Sent> {
    Mapped,
    Piped { out: File, incoming: File },
    Socket { socket: UnixDatagram, other: PathBuf },
    Iceoryx2 { out: Publisher<O>, incoming: Subscriber<I> },
}

impl<O: Sent, I: Sent> End<O, I> {
    fn new(transport: Transport, dir: &Path) -> Result<End<O, I>, BenchError> {
        let data = match transport {
            Transport::Pipe => {
                // Who asks opens first, so that nobody waits for the other to open.
                let asks = O::NAME == Odometry::NAME;
                let open = if asks { pipe::open } else { pipe::open_for_writing };
                let incoming = pipe::open_for_reading(&dir.join(I::NAME))?;
                Data::Piped { out: open(&dir.join(O::NAME))?, incoming }
            }
            Transport::Datagram => {
                let own = dir.join(format!("{}.socket", O::NAME));
                let socket = UnixDatagram::bind(&own).map_err(failed("bind", &own))?;
                socket.set_read_timeout(Some(WAIT_MAX)).map_err(failed("set up", &own))?;
                Data::Socket { socket, other: dir.join(format!("{}.socket", I::NAME)) }
            }
            _ => Data::Mapped,
        };
        End::with(transport, dir, data)
    }

    fn of_iceoryx2(
        transport: Transport,
        dir: &Path,
        out: Publisher<O>,
        incoming: Subscriber<I>,
    ) -> Result<End<O, I>, BenchError> {
        End::with(transport, dir, Data::Iceoryx2 { out, incoming })
    }

    fn with(transport: Transport, dir: &Path, data: Data<O, I>) -> Result<End<O, I>, BenchError> {
        let sleeps = matches!(transport, Transport::Futex | Transport::Iceoryx2Futex);
        let exchange = match sleeps || transport == Transport::Spin {
            // SAFETY: messages and counters are numbers, for which zeros are a value.
            true => Some(unsafe { Mapping::new(&dir.join("exchange"), 1) }?),
            false => None,
        };
        Ok(End { data, exchange, taken: 0, sleeps })
    }

    /// Sends a message.
    fn send(&mut self, message: &O) -> Result<(), BenchError> {
        let here = Path::new(O::NAME);
        match &self.data {
            Data::Mapped => {}
            Data::Piped { out, .. } => pipe::write(out, message).map_err(failed("write", here))?,
            Data::Socket { socket, other } => {
                let sent = socket.send_to(pipe::bytes(message), other);
                sent.map(drop).map_err(failed("send", other))?;
            }
            Data::Iceoryx2 { out, .. } => {
                let sent = out.send_copy(*message);
                sent.map(drop).map_err(not_sent)?;
            }
        }
        if let Some(exchange) = self.exchange.as_ref().map(|exchange| &exchange[0]) {
            let (line, word) = O::line(exchange);
            if matches!(self.data, Data::Mapped) {
                line.write(*message);
            }
            word.fetch_add(1, SeqCst);
            if self.sleeps {
                // Fails only for a word that is not mapped.
                let _ = futex::wake(word, futex::Flags::empty(), 1);
            }
        }
        Ok(())
    }

    /// The next message; `None` once nobody is there to send one.
    fn receive(&mut self, gone: impl Fn() -> bool) -> Result<Option<I>, BenchError> {
        if let Some(exchange) = self.exchange.as_ref().map(|exchange| &exchange[0]) {
            let (_, word) = I::line(exchange);
            while word.load(SeqCst) == self.taken {
                if gone() {
                    return Ok(None);
                }
                match self.sleeps {
                    true => {
                        // Woken, timed out or interrupted: the word tells.
                        let flags = futex::Flags::empty();
                        let _ = futex::wait(word, flags, self.taken, Some(&WAIT));
                    }
                    false => std::hint::spin_loop(),
                }
            }
            self.taken = word.load(SeqCst);
        }
        let here = Path::new(I::NAME);
        match &self.data {
            Data::Mapped => Ok(self.exchange.as_ref().map(|shared| I::line(&shared[0]).0.read())),
            Data::Piped { incoming, .. } => {
                pipe::read(incoming).map(Some).map_err(failed("read", here))
            }
            Data::Socket { socket, .. } => {
                let mut message = I::default();
                loop {
                    match socket.recv(pipe::bytes_mut(&mut message)) {
                        Ok(_) => return Ok(Some(message)),
                        Err(error) if error.kind() != ErrorKind::WouldBlock => {
                            return Err(failed("receive", here)(error));
                        }
                        Err(_) if gone() => return Ok(None),
                        Err(_) => {}
                    }
                }
            }
            Data::Iceoryx2 { incoming, .. } => loop {
                let sample = incoming.receive();
                match sample.map_err(not_received)? {
                    Some(sample) => return Ok(Some(*sample)),
                    None if gone() => return Ok(None),
                    None => std::hint::spin_loop(),
                }
            },
        }
    }
}
