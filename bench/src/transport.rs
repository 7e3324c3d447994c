//! Transports of two messages between two processes: shared memory, pipes, iceoryx2.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::atomic::Ordering::SeqCst;

use anyhow::Context as _;
use clap::ValueEnum;
use iceoryx2::prelude::ZeroCopySend;
use protocol::message::Plain;
use protocol::service::{Publisher, Subscriber};
use rustix::fs::{CWD, FileType, Mode, OFlags, fcntl_setfl, mknodat};
use rustix::thread::futex;
use rustix::time::Timespec;

use crate::memory::{FutexWord, Line, Mapping};

/// Maximum duration of a wait before the receiver checks whether the sender is alive.
const WAIT: Timespec = Timespec { tv_sec: 0, tv_nsec: 200_000_000 };

/// Maximum size of a message, bytes.
const MESSAGE_MAX: usize = 1024;

/// Transport of the two messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Transport {
    /// Shared mapping, polled continuously.
    Spin,
    /// Shared mapping, and a futex for each direction.
    Futex,
    /// Pipe for each direction.
    Pipe,
    /// iceoryx2 publish/subscribe, polled continuously.
    Iceoryx2,
    /// iceoryx2 publish/subscribe, and a futex for each direction.
    Iceoryx2Futex,
}

impl Transport {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Transport::Spin => "shared memory, spinning",
            Transport::Futex => "shared memory + futex",
            Transport::Pipe => "pipe",
            Transport::Iceoryx2 => "iceoryx2, spinning",
            Transport::Iceoryx2Futex => "iceoryx2 + futex",
        }
    }

    /// Returns its word on a command line.
    pub(crate) fn word(self) -> String {
        let value = self.to_possible_value().expect("none is hidden");
        value.get_name().to_owned()
    }

    pub(crate) fn is_iceoryx2(self) -> bool {
        matches!(self, Transport::Iceoryx2 | Transport::Iceoryx2Futex)
    }

    fn sleeps_on_a_word(self) -> bool {
        matches!(self, Transport::Futex | Transport::Iceoryx2Futex)
    }
}

/// One end of one direction. The replying process creates both of its ends before the requesting process starts.
pub(crate) struct Channel<M: ZeroCopySend + std::fmt::Debug + 'static> {
    carrier: Carrier<M>,
    /// Message counter in shared memory, if there is one; the number of messages received; whether a
    /// receiver sleeps on the counter.
    counted: Option<Mapping<Counted<M>>>,
    taken: u32,
    sleeps: bool,
}

/// Carrier of a message.
enum Carrier<M: ZeroCopySend + std::fmt::Debug + 'static> {
    Memory,
    Pipe(File),
    Publisher(Publisher<M>),
    Subscriber(Subscriber<M>),
}

/// Message in shared memory, and a futex word that counts messages.
#[repr(C)]
struct Counted<M> {
    message: Line<M>,
    word: FutexWord,
}

impl<M: Plain + ZeroCopySend + std::fmt::Debug> Channel<M> {
    /// Creates the sending end of the direction with this name. `port` creates an iceoryx2 port. `asks` is
    /// whether this process sends the requests, and may have to wait for the other end.
    pub(crate) fn sending(
        transport: Transport,
        path: &Path,
        asks: bool,
        port: Option<Publisher<M>>,
    ) -> anyhow::Result<Channel<M>> {
        let cannot = || format!("cannot open {}", path.display());
        let carrier = match transport {
            // The requesting end also opens the pipe for reading, so that it need not wait for the other to open it.
            Transport::Pipe => {
                let mut options = OpenOptions::new();
                Carrier::Pipe(options.read(asks).write(true).open(path).with_context(cannot)?)
            }
            _ => port.map_or(Carrier::Memory, Carrier::Publisher),
        };
        Channel::new(transport, path, carrier)
    }

    /// Creates the receiving end.
    pub(crate) fn receiving(
        transport: Transport,
        path: &Path,
        port: Option<Subscriber<M>>,
    ) -> anyhow::Result<Channel<M>> {
        let cannot = || format!("cannot open {}", path.display());
        let carrier = match transport {
            Transport::Pipe => Carrier::Pipe(open_for_reading(path).with_context(cannot)?),
            _ => port.map_or(Carrier::Memory, Carrier::Subscriber),
        };
        Channel::new(transport, path, carrier)
    }

    fn new(transport: Transport, path: &Path, carrier: Carrier<M>) -> anyhow::Result<Channel<M>> {
        let sleeps = transport.sleeps_on_a_word();
        let path = path.with_extension("counted");
        let counted = (sleeps || transport == Transport::Spin)
            // SAFETY: messages and counters are numbers, for which zeros are a value.
            .then(|| unsafe { Mapping::new(&path, 1) });
        Ok(Channel { carrier, counted: counted.transpose()?, taken: 0, sleeps })
    }

    /// Sends a message.
    pub(crate) fn send(&self, message: &M) -> anyhow::Result<()> {
        match &self.carrier {
            // Atomically: all messages are smaller than what a pipe writes at once.
            Carrier::Pipe(file) => { file }.write_all(message.bytes())?,
            Carrier::Publisher(port) => {
                port.send_copy(*message)?;
            }
            Carrier::Memory | Carrier::Subscriber(_) => {}
        }
        if let Some(counted) = self.counted.as_ref().map(|counted| &counted[0]) {
            if matches!(self.carrier, Carrier::Memory) {
                counted.message.write(*message);
            }
            counted.word.0.fetch_add(1, SeqCst);
            if self.sleeps {
                // Fails only for a word that is not mapped.
                let _ = futex::wake(&counted.word.0, futex::Flags::empty(), 1);
            }
        }
        Ok(())
    }

    /// Returns the next message; `None` once the sender is gone.
    pub(crate) fn receive(&mut self, gone: impl Fn() -> bool) -> anyhow::Result<Option<M>> {
        if let Some(counted) = self.counted.as_ref().map(|counted| &counted[0]) {
            let word = &counted.word.0;
            while word.load(SeqCst) == self.taken {
                if gone() {
                    return Ok(None);
                }
                if self.sleeps {
                    // Woken, timed out or interrupted: the counter tells which.
                    let _ = futex::wait(word, futex::Flags::empty(), self.taken, Some(&WAIT));
                } else {
                    std::hint::spin_loop();
                }
            }
            self.taken = word.load(SeqCst);
            if matches!(self.carrier, Carrier::Memory) {
                return Ok(Some(counted.message.read()));
            }
        }
        match &self.carrier {
            Carrier::Pipe(file) => {
                let mut room = [0; MESSAGE_MAX];
                let bytes = &mut room[..size_of::<M>()];
                { file }.read_exact(bytes)?;
                Ok(M::of_bytes(bytes))
            }
            Carrier::Subscriber(port) => loop {
                match port.receive()? {
                    Some(sample) => return Ok(Some(*sample)),
                    None if gone() => return Ok(None),
                    None => std::hint::spin_loop(),
                }
            },
            Carrier::Memory | Carrier::Publisher(_) => Ok(None),
        }
    }
}

/// Creates a named pipe.
pub(crate) fn make_pipe(path: &Path) -> anyhow::Result<()> {
    let made = mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0);
    made.with_context(|| format!("cannot make {}", path.display()))
}

/// Opens a pipe for reading only: a read returns when the last writer has closed it.
fn open_for_reading(path: &Path) -> io::Result<File> {
    let nonblocking = OFlags::NONBLOCK.bits() as i32;
    let file = OpenOptions::new().read(true).custom_flags(nonblocking).open(path)?;
    fcntl_setfl(&file, OFlags::empty())?;
    Ok(file)
}
