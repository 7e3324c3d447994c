//! Listener with limits on connections, because their descriptors count for the supervisor, which needs
//! descriptors for its children.
//!
//! A connection is unauthenticated until a complete request with the token has arrived over it. The number
//! of such connections is limited, the oldest is closed first, and each has a timeout, so that silent
//! clients cannot block others. Must not know the token: the code that checks it calls
//! [`ConnectionHandle::authenticate`].

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

/// Limits on connections.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ConnectionLimits {
    /// Maximum number of unauthenticated connections; for one more, the oldest is closed.
    pub(crate) unauthenticated_max: usize,
    /// Maximum number of authenticated connections; one more is rejected.
    pub(crate) authenticated_max: usize,
    /// Time for a connection to send a complete request with the token, before it is closed.
    pub(crate) silence_max: Duration,
}

impl Default for ConnectionLimits {
    /// Returns limits for the event stream of every client and some requests, and as many unauthenticated
    /// connections. The timeout allows requests typed by hand.
    fn default() -> ConnectionLimits {
        let silence_max = Duration::from_secs(5);
        ConnectionLimits { unauthenticated_max: 32, authenticated_max: 32, silence_max }
    }
}

/// Open connections, by number. The numbers increase.
#[derive(Debug, Default)]
struct OpenConnections {
    next_number: u64,
    connections: BTreeMap<u64, ConnectionState>,
}

#[derive(Debug)]
enum ConnectionState {
    /// Closed by a message. Dropping the sender without one lets the connection stay.
    Unauthenticated(oneshot::Sender<()>),
    Authenticated,
}

impl OpenConnections {
    fn unauthenticated_count(&self) -> usize {
        let states = self.connections.values();
        states.filter(|state| matches!(state, ConnectionState::Unauthenticated(_))).count()
    }

    fn close_oldest_unauthenticated(&mut self) {
        let mut states = self.connections.iter();
        let oldest = states.find(|(_, state)| matches!(state, ConnectionState::Unauthenticated(_)));
        let Some(number) = oldest.map(|(number, _)| *number) else { return };
        if let Some(ConnectionState::Unauthenticated(close)) = self.connections.remove(&number) {
            // A connection that is already closing does not receive it.
            let _ = close.send(());
        }
    }
}

/// Listener with limits.
pub(crate) struct LimitedListener {
    listener: TcpListener,
    limits: ConnectionLimits,
    open_connections: Arc<Mutex<OpenConnections>>,
}

impl LimitedListener {
    pub(crate) fn new(listener: TcpListener, limits: ConnectionLimits) -> LimitedListener {
        LimitedListener { listener, limits, open_connections: Arc::default() }
    }
}

impl Listener for LimitedListener {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        let (stream, address) = Listener::accept(&mut self.listener).await;
        // Sends small frames without delay. On failure they arrive a little later.
        let _ = stream.set_nodelay(true);
        if lock_connections(&self.open_connections).unauthenticated_count()
            >= self.limits.unauthenticated_max
        {
            // Requests that have already arrived are processed before a connection is closed.
            yield_now().await;
        }
        let mut open_connections = lock_connections(&self.open_connections);
        while open_connections.unauthenticated_count() >= self.limits.unauthenticated_max.max(1) {
            open_connections.close_oldest_unauthenticated();
        }
        let number = open_connections.next_number;
        open_connections.next_number += 1;
        let (close_sender, close_receiver) = oneshot::channel();
        open_connections.connections.insert(number, ConnectionState::Unauthenticated(close_sender));
        let authenticated_max = self.limits.authenticated_max;
        let handle = ConnectionHandle {
            number,
            authenticated_max,
            open_connections: self.open_connections.clone(),
        };
        let time_left = Box::pin(sleep(self.limits.silence_max));
        (
            Connection {
                stream,
                handle,
                lifetime: ConnectionLifetime::UntilTimeout { closed: close_receiver, time_left },
            },
            address,
        )
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// Connection of a request, as seen by its handler.
#[derive(Debug, Clone)]
pub(crate) struct ConnectionHandle {
    number: u64,
    authenticated_max: usize,
    open_connections: Arc<Mutex<OpenConnections>>,
}

impl ConnectionHandle {
    /// Authenticates the connection, so that it stays open while its request is processed. Returns `false`
    /// if there are too many, or if it is about to be closed.
    pub(crate) fn authenticate(&self) -> bool {
        let mut open_connections = lock_connections(&self.open_connections);
        let authenticated_count =
            open_connections.connections.len() - open_connections.unauthenticated_count();
        match open_connections.connections.get_mut(&self.number) {
            Some(ConnectionState::Authenticated) => true,
            Some(state) if authenticated_count < self.authenticated_max => {
                *state = ConnectionState::Authenticated;
                true
            }
            _ => false,
        }
    }
}

impl Connected<IncomingStream<'_, LimitedListener>> for ConnectionHandle {
    fn connect_info(stream: IncomingStream<'_, LimitedListener>) -> ConnectionHandle {
        stream.io().handle.clone()
    }
}

/// Connection, which counts towards the limits until it is closed.
pub(crate) struct Connection {
    stream: TcpStream,
    handle: ConnectionHandle,
    lifetime: ConnectionLifetime,
}

/// Lifetime of a connection.
enum ConnectionLifetime {
    /// Unauthenticated: until the listener closes it, or its timeout.
    UntilTimeout { closed: oneshot::Receiver<()>, time_left: Pin<Box<Sleep>> },
    /// Authenticated: until its request is complete.
    UntilRequestDone,
    /// To be closed.
    Closing,
}

impl Connection {
    /// Returns whether the connection is to be closed now. If not, the task is woken when that may change.
    fn is_over(&mut self, context: &mut Context<'_>) -> bool {
        if let ConnectionLifetime::UntilTimeout { closed, time_left } = &mut self.lifetime {
            match Pin::new(closed).poll(context) {
                Poll::Ready(Ok(())) => self.lifetime = ConnectionLifetime::Closing,
                Poll::Ready(Err(_)) => self.lifetime = ConnectionLifetime::UntilRequestDone,
                Poll::Pending if time_left.as_mut().poll(context).is_ready() => {
                    self.lifetime = ConnectionLifetime::Closing;
                }
                Poll::Pending => {}
            }
        }
        matches!(self.lifetime, ConnectionLifetime::Closing)
    }
}

impl Drop for Connection {
    fn drop(&mut self) {
        lock_connections(&self.handle.open_connections).connections.remove(&self.handle.number);
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.is_over(context) {
            // As if the client had closed the connection.
            return Poll::Ready(Ok(()));
        }
        Pin::new(&mut self.stream).poll_read(context, buffer)
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

/// Locks the connections. No code panics while it holds the lock.
fn lock_connections(connections: &Mutex<OpenConnections>) -> MutexGuard<'_, OpenConnections> {
    connections.lock().unwrap_or_else(PoisonError::into_inner)
}
