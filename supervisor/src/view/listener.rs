//! A listener at which anybody may knock: descriptors are the supervisor's, who needs them for its
//! children.
//!
//! A connection is unauthenticated until a whole request with the token has come over it. Of these
//! there are only so many, the oldest is closed first, and each has only so long: whoever says
//! nothing keeps nobody out. Must not: know what a token is; [`Pass::authenticate`] is called by
//! whoever checks it.

use std::collections::BTreeMap;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::task::yield_now;
use tokio::time::{Sleep, sleep};

/// How many connections there may be, and how long one may go without a request.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// Unauthenticated connections; for one more, the oldest is closed.
    pub(crate) unauthenticated_max: usize,
    /// Connections with a request that has the token; one more is refused.
    pub(crate) authenticated_max: usize,
    /// Within this a connection brings a whole request that has the token, or is closed.
    pub(crate) silent_max: Duration,
}

impl Default for Limits {
    /// Every client's stream and a few for pages and orders, and as many that are not known yet. A
    /// browser sends its request at once; a person with `telnet` has a few seconds.
    fn default() -> Limits {
        let silent_max = Duration::from_secs(5);
        Limits { unauthenticated_max: 32, authenticated_max: 32, silent_max }
    }
}

/// The connections that are open, by number; they count up.
#[derive(Debug, Default)]
struct Open {
    next: u64,
    connections: BTreeMap<u64, Standing>,
}

#[derive(Debug)]
enum Standing {
    /// Closed by a word; dropping it without one says that it may stay.
    Unauthenticated(oneshot::Sender<()>),
    Authenticated,
}

impl Open {
    fn unauthenticated(&self) -> usize {
        let standings = self.connections.values();
        standings.filter(|standing| matches!(standing, Standing::Unauthenticated(_))).count()
    }

    fn close_oldest_unauthenticated(&mut self) {
        let mut standings = self.connections.iter();
        let oldest = standings.find(|(_, at)| matches!(at, Standing::Unauthenticated(_)));
        let Some(number) = oldest.map(|(number, _)| *number) else { return };
        if let Some(Standing::Unauthenticated(close)) = self.connections.remove(&number) {
            // One that is closing by itself need not hear it.
            let _ = close.send(());
        }
    }
}

/// The listener.
pub(crate) struct Limited {
    listener: TcpListener,
    limits: Limits,
    open: Arc<Mutex<Open>>,
}

impl Limited {
    pub(crate) fn new(listener: TcpListener, limits: Limits) -> Limited {
        Limited { listener, limits, open: Arc::default() }
    }
}

impl Listener for Limited {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        let (stream, from) = Listener::accept(&mut self.listener).await;
        // Small frames shall go out at once. Without it they only come a little later.
        let _ = stream.set_nodelay(true);
        if locked(&self.open).unauthenticated() >= self.limits.unauthenticated_max {
            // Whoever has sent a request already is heard before anybody is closed.
            yield_now().await;
        }
        let mut open = locked(&self.open);
        while open.unauthenticated() >= self.limits.unauthenticated_max.max(1) {
            open.close_oldest_unauthenticated();
        }
        let number = open.next;
        open.next += 1;
        let (close, closed) = oneshot::channel();
        open.connections.insert(number, Standing::Unauthenticated(close));
        let authenticated_max = self.limits.authenticated_max;
        let pass = Pass { number, authenticated_max, open: self.open.clone() };
        let time_left = Box::pin(sleep(self.limits.silent_max));
        (Connection { stream, pass, stays: Stays::Until { closed, time_left } }, from)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// What a request knows of the connection it came over.
#[derive(Debug, Clone)]
pub(crate) struct Pass {
    number: u64,
    authenticated_max: usize,
    open: Arc<Mutex<Open>>,
}

impl Pass {
    /// Lets the connection stay for as long as its request takes; `false` if there are too many, or
    /// it is about to be closed.
    pub(crate) fn authenticate(&self) -> bool {
        let mut open = locked(&self.open);
        let authenticated = open.connections.len() - open.unauthenticated();
        match open.connections.get_mut(&self.number) {
            Some(Standing::Authenticated) => true,
            Some(standing) if authenticated < self.authenticated_max => {
                *standing = Standing::Authenticated;
                true
            }
            _ => false,
        }
    }
}

impl Connected<IncomingStream<'_, Limited>> for Pass {
    fn connect_info(stream: IncomingStream<'_, Limited>) -> Pass {
        stream.io().pass.clone()
    }
}

/// A connection, and the room that it takes until it is closed.
pub(crate) struct Connection {
    stream: TcpStream,
    pass: Pass,
    stays: Stays,
}

/// How long a connection stays.
enum Stays {
    /// Unauthenticated: until it is told to go, or its time is up.
    Until { closed: oneshot::Receiver<()>, time_left: Pin<Box<Sleep>> },
    /// Authenticated: for as long as its request takes.
    On,
    /// It is to be closed.
    No,
}

impl Connection {
    /// Whether it is to be closed now; otherwise the task is woken when it may be.
    fn is_over(&mut self, context: &mut Context<'_>) -> bool {
        if let Stays::Until { closed, time_left } = &mut self.stays {
            match Pin::new(closed).poll(context) {
                Poll::Ready(Ok(())) => self.stays = Stays::No,
                Poll::Ready(Err(_)) => self.stays = Stays::On,
                Poll::Pending if time_left.as_mut().poll(context).is_ready() => {
                    self.stays = Stays::No;
                }
                Poll::Pending => {}
            }
        }
        matches!(self.stays, Stays::No)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        locked(&self.pass.open).connections.remove(&self.pass.number);
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        into: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.is_over(context) {
            // As if it had been closed at the other end.
            return Poll::Ready(Ok(()));
        }
        Pin::new(&mut self.stream).poll_read(context, into)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        if self.is_over(context) {
            return Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()));
        }
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

/// Nothing that holds it can panic half-way.
fn locked(open: &Mutex<Open>) -> MutexGuard<'_, Open> {
    open.lock().unwrap_or_else(PoisonError::into_inner)
}
