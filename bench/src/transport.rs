//! Transports that carry two messages between two processes: shared memory, pipes and iceoryx2.

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

use crate::memory::{CacheAligned, FutexWord, Mapping};

/// Timeout of a futex wait, after which the receiver checks whether the sender still runs.
const FUTEX_WAIT_TIMEOUT: Timespec = Timespec { tv_sec: 0, tv_nsec: 200_000_000 };

/// Maximum size of a message, in bytes.
const MESSAGE_BYTES_MAX: usize = 1024;

/// Transport of the two messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Transport {
    /// Shared memory, polled without sleeping.
    Spin,
    /// Shared memory with a futex for each direction.
    Futex,
    /// One named pipe for each direction.
    Pipe,
    /// iceoryx2 publish/subscribe, polled without sleeping.
    Iceoryx2,
    /// iceoryx2 publish/subscribe with a futex for each direction.
    Iceoryx2Futex,
}

impl Transport {
    /// Returns the name of the baseline in the table.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Transport::Spin => "shared memory, spinning",
            Transport::Futex => "shared memory + futex",
            Transport::Pipe => "pipe",
            Transport::Iceoryx2 => "iceoryx2, spinning",
            Transport::Iceoryx2Futex => "iceoryx2 + futex",
        }
    }

    /// Returns the command-line argument that selects this transport.
    pub(crate) fn to_argument(self) -> String {
        let value = self.to_possible_value().expect("no transport is hidden");
        value.get_name().to_owned()
    }

    pub(crate) fn is_iceoryx2(self) -> bool {
        matches!(self, Transport::Iceoryx2 | Transport::Iceoryx2Futex)
    }

    /// Returns whether the receiver sleeps on a futex word.
    fn uses_futex(self) -> bool {
        matches!(self, Transport::Futex | Transport::Iceoryx2Futex)
    }
}

/// One end of a one-way channel between two processes. The answering process opens its two ends before the requesting
/// process sends the first message.
pub(crate) struct Channel<M: ZeroCopySend + std::fmt::Debug + 'static> {
    carrier: Carrier<M>,
    /// Shared counter of the messages, with the message itself; `None` for transports that do not use it.
    counted_message: Option<Mapping<CountedMessage<M>>>,
    /// Value of the counter at the last received message.
    received_count: u32,
    /// `true` if the receiver sleeps on the counter.
    sleeps_on_counter: bool,
}

/// Carrier of the messages, without the shared counter.
enum Carrier<M: ZeroCopySend + std::fmt::Debug + 'static> {
    Memory,
    Pipe(File),
    Publisher(Publisher<M>),
    Subscriber(Subscriber<M>),
}

/// A message in shared memory, and the counter of sent messages.
#[repr(C)]
struct CountedMessage<M> {
    message: CacheAligned<M>,
    counter: FutexWord,
}

impl<M: Plain + ZeroCopySend + std::fmt::Debug> Channel<M> {
    /// Opens the sending end at `path`. `is_requester` is `true` for the requesting process, which may open a pipe
    /// before the other end. `port` is the iceoryx2 port, if the transport uses iceoryx2.
    pub(crate) fn open_sender(
        transport: Transport,
        path: &Path,
        is_requester: bool,
        port: Option<Publisher<M>>,
    ) -> anyhow::Result<Channel<M>> {
        let error_context = || format!("cannot open {}", path.display());
        let carrier = match transport {
            // Opening a pipe for reading as well does not block until the other end is open.
            Transport::Pipe => {
                let mut options = OpenOptions::new();
                Carrier::Pipe(
                    options
                        .read(is_requester)
                        .write(true)
                        .open(path)
                        .with_context(error_context)?,
                )
            }
            _ => port.map_or(Carrier::Memory, Carrier::Publisher),
        };
        Channel::new(transport, path, carrier)
    }

    /// Opens the receiving end at `path`. `port` is the iceoryx2 port, if the transport uses iceoryx2.
    pub(crate) fn open_receiver(
        transport: Transport,
        path: &Path,
        port: Option<Subscriber<M>>,
    ) -> anyhow::Result<Channel<M>> {
        let error_context = || format!("cannot open {}", path.display());
        let carrier = match transport {
            Transport::Pipe => Carrier::Pipe(open_for_reading(path).with_context(error_context)?),
            _ => port.map_or(Carrier::Memory, Carrier::Subscriber),
        };
        Channel::new(transport, path, carrier)
    }

    fn new(transport: Transport, path: &Path, carrier: Carrier<M>) -> anyhow::Result<Channel<M>> {
        let uses_futex = transport.uses_futex();
        let path = path.with_extension("counted");
        let counted_message = (uses_futex || transport == Transport::Spin)
            // SAFETY: messages and counters are numbers, for which all-zero bytes are valid.
            .then(|| unsafe { Mapping::new(&path, 1) });
        Ok(Channel {
            carrier,
            counted_message: counted_message.transpose()?,
            received_count: 0,
            sleeps_on_counter: uses_futex,
        })
    }

    /// Sends a message and wakes a receiver that sleeps on the counter.
    pub(crate) fn send(&self, message: &M) -> anyhow::Result<()> {
        match &self.carrier {
            // Atomic, because all messages are smaller than PIPE_BUF.
            Carrier::Pipe(file) => { file }.write_all(message.bytes())?,
            Carrier::Publisher(port) => {
                port.send_copy(*message)?;
            }
            Carrier::Memory | Carrier::Subscriber(_) => {}
        }
        if let Some(counted_message) =
            self.counted_message.as_ref().map(|counted_message| &counted_message[0])
        {
            if matches!(self.carrier, Carrier::Memory) {
                counted_message.message.write(*message);
            }
            counted_message.counter.0.fetch_add(1, SeqCst);
            if self.sleeps_on_counter {
                // Fails only if the futex word is not mapped.
                let _ = futex::wake(&counted_message.counter.0, futex::Flags::empty(), 1);
            }
        }
        Ok(())
    }

    /// Waits for the next message. `None` if `is_sender_gone` returns `true` first.
    ///
    /// # Errors
    /// If a pipe is closed or iceoryx2 fails.
    pub(crate) fn receive(
        &mut self,
        is_sender_gone: impl Fn() -> bool,
    ) -> anyhow::Result<Option<M>> {
        if let Some(counted_message) =
            self.counted_message.as_ref().map(|counted_message| &counted_message[0])
        {
            let counter = &counted_message.counter.0;
            while counter.load(SeqCst) == self.received_count {
                if is_sender_gone() {
                    return Ok(None);
                }
                if self.sleeps_on_counter {
                    // The counter shows whether a message arrived, or the wait timed out or was interrupted.
                    let _ = futex::wait(
                        counter,
                        futex::Flags::empty(),
                        self.received_count,
                        Some(&FUTEX_WAIT_TIMEOUT),
                    );
                } else {
                    std::hint::spin_loop();
                }
            }
            self.received_count = counter.load(SeqCst);
            if matches!(self.carrier, Carrier::Memory) {
                return Ok(Some(counted_message.message.read()));
            }
        }
        match &self.carrier {
            Carrier::Pipe(file) => {
                let mut buffer = [0; MESSAGE_BYTES_MAX];
                let bytes = &mut buffer[..size_of::<M>()];
                { file }.read_exact(bytes)?;
                Ok(M::from_bytes(bytes))
            }
            Carrier::Subscriber(port) => loop {
                match port.receive()? {
                    Some(sample) => return Ok(Some(*sample)),
                    None if is_sender_gone() => return Ok(None),
                    None => std::hint::spin_loop(),
                }
            },
            Carrier::Memory | Carrier::Publisher(_) => Ok(None),
        }
    }
}

/// Creates a named pipe.
pub(crate) fn make_pipe(path: &Path) -> anyhow::Result<()> {
    let result = mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0);
    result.with_context(|| format!("cannot create {}", path.display()))
}

/// Opens a pipe for reading only, without waiting for a writer. Its reads block, and end when the last writer has
/// closed it.
fn open_for_reading(path: &Path) -> io::Result<File> {
    let nonblocking = OFlags::NONBLOCK.bits() as i32;
    let file = OpenOptions::new().read(true).custom_flags(nonblocking).open(path)?;
    fcntl_setfl(&file, OFlags::empty())?;
    Ok(file)
}
