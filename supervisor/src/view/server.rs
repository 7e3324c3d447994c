//! Server thread, and its responses.
//!
//! | address | response |
//! |---|---|
//! | `GET /` | the page |
//! | `GET /events` | events of the run, as server-sent events, until the run is over |
//! | `POST /control` | 204 after execution; 4xx with a reason |

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::mpsc::{Sender, SyncSender, TrySendError, channel, sync_channel};
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::Bytes;
use axum::extract::{ConnectInfo, DefaultBodyLimit, Request as HttpRequest, State};
use axum::http::header::{
    CACHE_CONTROL, CONNECTION, CONTENT_SECURITY_POLICY, CONTENT_TYPE, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use outcome::report::scene::Scene;
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{oneshot, watch};
use tokio::time::{sleep, timeout};

use crate::view::act::{self, ClientRequest};
use crate::view::address::reachable_address;
use crate::view::client_snapshot::{ClientSnapshot, stream_to_client};
use crate::view::gate::{AccessPolicy, HttpRefusal, check_order_headers};
use crate::view::handle::{ClientCount, VIEW_QUEUE_CAPACITY, View, ViewMessage};
use crate::view::listener::{ConnectionHandle, ConnectionLimits, LimitedListener};
use crate::view::token::Token;

/// Maximum time for the last message to reach all clients.
const LAST_MESSAGE_TIMEOUT: Duration = Duration::from_millis(500);
/// Time for written data to be sent.
const FLUSH_TIME: Duration = Duration::from_millis(20);
/// Maximum size of a request body, bytes; a request is far shorter.
const BODY_BYTES_MAX: usize = 4096;
/// Capacity of the queue of requests to the supervisor, which reads it every few milliseconds.
const REQUESTS_MAX: usize = 16;
/// Maximum time for the response to a request, even if the supervisor is delayed.
const RESPONSE_TIMEOUT: Duration = Duration::from_secs(5);
/// Maximum time to read a complete request and to begin its response; slightly more than a request takes.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);
/// Size of the kernel's send buffer of each connection, bytes. Small, so that a slow client misses frames
/// instead of receiving old ones.
const SEND_BUFFER_BYTES: u32 = 32 * 1024;
/// Maximum number of connections that wait to be accepted.
const BACKLOG: u32 = 32;

/// Receiver of messages from the supervisor.
type MessageReceiver = tokio::sync::mpsc::Receiver<ViewMessage>;

const TOO_MANY_CLIENTS: HttpRefusal =
    (StatusCode::SERVICE_UNAVAILABLE, "too many clients watch this run");

/// Headers of all responses: the page must not be cached, embedded in frames, or load data from other
/// sites. Its own content security policy, which lists its scripts, applies in addition. Each connection
/// carries one request, and is not kept for another that may never arrive.
const RESPONSE_HEADERS: [(HeaderName, &str); 5] = [
    (CONNECTION, "close"),
    (CACHE_CONTROL, "no-store"),
    (REFERRER_POLICY, "no-referrer"),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (
        CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
         connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; \
         frame-ancestors 'none'",
    ),
];

/// Failure to start the live view.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum ViewError {
    /// Other machines could connect.
    #[error(
        "--view={0} would let other machines watch the run: use a loopback address such as 127.0.0.1, or add --insecure for no encryption and a token as the only protection (or forward a port: ssh -L 8080:127.0.0.1:PORT)"
    )]
    NotLoopback(SocketAddr),
    /// The port is in use, or the address is not of this machine.
    #[error(
        "cannot listen on {address} for the live view: {source}; another port may be free, and --view alone finds one"
    )]
    Listen { address: SocketAddr, source: io::Error },
    /// A thread, random numbers or descriptors are not available.
    #[error("cannot start the live view: {0}")]
    Start(#[from] io::Error),
}

/// Bound address of a server that has not started.
pub struct BoundServer {
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
    access_policy: AccessPolicy,
    limits: ConnectionLimits,
}

/// Binds the address. `insecure` permits an address that other machines can reach.
pub fn bind(address: SocketAddr, insecure: bool) -> Result<BoundServer, ViewError> {
    let is_loopback = address.ip().is_loopback();
    if !(is_loopback || insecure) {
        return Err(ViewError::NotLoopback(address));
    }
    let runtime = Builder::new_current_thread().enable_io().enable_time().build()?;
    let runtime_guard = runtime.enter();
    let listen = || -> io::Result<TcpListener> {
        let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
        socket.set_reuseaddr(true)?;
        // Connections inherit it.
        socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
        socket.bind(address)?;
        socket.listen(BACKLOG)
    };
    let listener = listen().map_err(|source| ViewError::Listen { address, source })?;
    let address = listener.local_addr()?;
    drop(runtime_guard);
    let access_policy = AccessPolicy { token: Token::draw()?, allows_other_machines: !is_loopback };
    Ok(BoundServer {
        runtime,
        listener,
        address,
        access_policy,
        limits: ConnectionLimits::default(),
    })
}

/// State for the responses.
#[derive(Clone)]
struct ServerState {
    access_policy: AccessPolicy,
    page: Bytes,
    scene: Arc<Scene>,
    /// Sender of requests; `None` if clients may only watch.
    request_sender: Option<SyncSender<ClientRequest>>,
    clients: Arc<ClientCount>,
    snapshot: watch::Receiver<ClientSnapshot>,
}

impl BoundServer {
    /// Returns the address to open in a browser. It contains the token, which grants access.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", reachable_address(self.address), self.access_policy.token)
    }

    /// Starts the server on its own thread. `control` is whether clients may send requests.
    pub fn serve(self, scene: Scene, control: bool) -> Result<View, ViewError> {
        let BoundServer { runtime, listener, access_policy, limits, .. } = self;
        let (messages, received_messages) = tokio::sync::mpsc::channel(VIEW_QUEUE_CAPACITY);
        let clients = Arc::new(ClientCount::default());
        let (requests, request_receiver) = sync_channel(REQUESTS_MAX);
        let (exit_sender, server_exit) = channel::<()>();
        let (snapshot_sender, snapshot) = watch::channel(ClientSnapshot::default());
        let state = ServerState {
            access_policy,
            page: outcome::report::page::live_html(&scene, control).into(),
            scene: Arc::new(scene),
            request_sender: control.then_some(requests),
            clients: clients.clone(),
            snapshot,
        };
        let thread_clients = clients.clone();
        std::thread::Builder::new().name("view".into()).spawn(move || {
            let _exit_sender: Sender<()> = exit_sender; // until the thread ends
            set_idle_priority();
            runtime.block_on(async move {
                let listener = LimitedListener::new(listener, limits);
                let state = router(state).into_make_service_with_connect_info::<ConnectionHandle>();
                tokio::spawn(axum::serve(listener, state).into_future());
                distribute_messages(received_messages, snapshot_sender, &thread_clients).await;
            });
        })?;
        Ok(View::new(messages, clients, control, request_receiver, server_exit))
    }
}

/// Gives this thread the lowest priority (SCHED_IDLE).
fn set_idle_priority() {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: a plain system call that reads `parameters`; 0 is the calling thread. If it fails, the thread
    // keeps its normal priority.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &parameters) };
}

/// Distributes messages of the supervisor to all clients, until the run is over.
async fn distribute_messages(
    mut messages: MessageReceiver,
    snapshot_sender: watch::Sender<ClientSnapshot>,
    clients: &ClientCount,
) {
    let mut is_over = false;
    while !is_over && let Some(first) = messages.recv().await {
        snapshot_sender.send_modify(|snapshot| {
            is_over = snapshot.add(first);
            // Of several queued frames, only the newest is kept.
            while let Ok(next) = messages.try_recv() {
                is_over = snapshot.add(next);
            }
        });
    }
    let deadline = Instant::now() + LAST_MESSAGE_TIMEOUT;
    while clients.count() > 0 && Instant::now() < deadline {
        sleep(FLUSH_TIME).await;
    }
    sleep(FLUSH_TIME).await;
}

fn router(state: ServerState) -> Router {
    Router::new()
        .route("/", get(serve_page))
        .route("/events", get(stream_events))
        .route(
            "/control",
            post(handle_control_request).layer(DefaultBodyLimit::max(BODY_BYTES_MAX)),
        )
        .layer(middleware::from_fn_with_state(state.clone(), check_access))
        .with_state(state)
}

/// Checks access of every request, and adds the headers to every response.
async fn check_access(
    State(state): State<ServerState>,
    ConnectInfo(connection): ConnectInfo<ConnectionHandle>,
    request: HttpRequest,
    next: Next,
) -> Response {
    let mut response = match state.access_policy.check_request(request.uri(), request.headers()) {
        Ok(()) if connection.authenticate() => match timeout(REQUEST_TIMEOUT, next.run(request))
            .await
        {
            Ok(response) => response,
            Err(_) => (StatusCode::REQUEST_TIMEOUT, "the request is incomplete").into_response(),
        },
        Ok(()) => TOO_MANY_CLIENTS.into_response(),
        Err(refusal) => refusal.into_response(),
    };
    for (name, value) in RESPONSE_HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn serve_page(State(state): State<ServerState>) -> Response {
    ([(CONTENT_TYPE, "text/html; charset=utf-8")], state.page).into_response()
}

async fn stream_events(State(state): State<ServerState>) -> Response {
    match state.clients.acquire_client_permit() {
        Some(permit) => stream_to_client(state.snapshot, permit),
        None => TOO_MANY_CLIENTS.into_response(),
    }
}

async fn handle_control_request(
    State(state): State<ServerState>,
    headers: HeaderMap,
    body: Bytes,
) -> Response {
    let Some(requests) = state.request_sender else {
        let reason = "this run is read-only: start it with --view-control to send requests";
        return (StatusCode::FORBIDDEN, reason).into_response();
    };
    if let Err(refusal) = check_order_headers(&headers) {
        return refusal.into_response();
    }
    let action = match act::parse_action(&body, &state.scene) {
        Ok(action) => action,
        Err(refusal) => return refusal.into_response(),
    };
    let (result_sender, result_receiver) = oneshot::channel();
    let run_is_over = (StatusCode::CONFLICT, "the run is over");
    match requests.try_send(ClientRequest { action, result_sender }) {
        Ok(()) => {}
        Err(TrySendError::Disconnected(_)) => return run_is_over.into_response(),
        Err(TrySendError::Full(_)) => {
            return (StatusCode::SERVICE_UNAVAILABLE, "too many orders at once").into_response();
        }
    }
    match timeout(RESPONSE_TIMEOUT, result_receiver).await {
        Ok(Ok(Ok(()))) => StatusCode::NO_CONTENT.into_response(),
        Ok(Ok(Err(reason))) => (StatusCode::CONFLICT, reason).into_response(),
        Ok(Err(_)) => run_is_over.into_response(),
        Err(_) => {
            let reason = "the run does not answer; it may still do it";
            (StatusCode::GATEWAY_TIMEOUT, reason).into_response()
        }
    }
}

#[cfg(test)]
mod tests;
