//! The thread, and what it answers to which address.
//!
//! | address | answer |
//! |---|---|
//! | `GET /` | the page |
//! | `GET /events` | what happens, as server-sent events, until the run is over |
//! | `POST /control` | 204 once it is done; 4xx with a reason |

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

use crate::view::act::{self, Request};
use crate::view::address::reachable;
use crate::view::gate::{Gate, Refusal, may_order};
use crate::view::handle::{Clients, LETTERS_MAX, Letter, View};
use crate::view::listener::{Limited, Limits, Pass};
use crate::view::news::{News, tell};
use crate::view::token::Token;

/// The last event gets this long to reach everybody.
const FAREWELL_MAX: Duration = Duration::from_millis(500);
/// What was written gets this long to be sent.
const FLUSH: Duration = Duration::from_millis(20);
/// An order is far shorter, bytes.
const BODY_MAX: usize = 4096;
/// Orders that wait for the supervisor; it looks every few milliseconds.
const REQUESTS_MAX: usize = 16;
/// An order is answered within this, even if the supervisor is held up.
const ANSWER_MAX: Duration = Duration::from_secs(5);
/// A whole request is read and its answer begins within this; a little more than an order takes.
const REQUEST_MAX: Duration = Duration::from_secs(10);
/// What the kernel keeps of a stream for a client that does not read, bytes. Little, so that a slow
/// client misses frames instead of getting old ones.
const SEND_BUFFER: u32 = 32 * 1024;
/// Connections that wait to be accepted.
const BACKLOG: u32 = 32;

/// What the supervisor hands over.
type Letters = tokio::sync::mpsc::Receiver<Letter>;

const TOO_MANY: Refusal = (StatusCode::SERVICE_UNAVAILABLE, "too many look at this run");

/// The page is given away by nobody, framed by nobody, and asks nobody but us. Its own policy, which
/// names its scripts, holds beside this one. One request for each connection: none is kept for
/// another that may never come.
const HEADERS: [(HeaderName, &str); 5] = [
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

/// Why there is no live view.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum ViewError {
    /// Others could come.
    #[error(
        "--view={0} would let other machines see the run: expected a loopback address such as 127.0.0.1, or --insecure for no encryption and a token as the only protection (or forward a port: ssh -L 8080:127.0.0.1:PORT)"
    )]
    NotLoopback(SocketAddr),
    /// The port is taken, or the address is not ours.
    #[error(
        "cannot listen on {address} for the live view: {source}; another port may be free, and --view alone finds one"
    )]
    Listen { address: SocketAddr, source: io::Error },
    /// No thread, no random numbers, no descriptors.
    #[error("cannot start the live view: {0}")]
    Start(#[from] io::Error),
}

/// A place that is taken, with nobody there yet to answer.
pub struct Bound {
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
    gate: Gate,
    limits: Limits,
}

/// Takes the place. `insecure`: other machines may come, if the address lets them.
pub fn bind(address: SocketAddr, insecure: bool) -> Result<Bound, ViewError> {
    let loopback = address.ip().is_loopback();
    if !(loopback || insecure) {
        return Err(ViewError::NotLoopback(address));
    }
    let runtime = Builder::new_current_thread().enable_io().enable_time().build()?;
    let entered = runtime.enter();
    let listen = || -> io::Result<TcpListener> {
        let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
        socket.set_reuseaddr(true)?;
        // Connections inherit it.
        socket.set_send_buffer_size(SEND_BUFFER)?;
        socket.bind(address)?;
        socket.listen(BACKLOG)
    };
    let listener = listen().map_err(|source| ViewError::Listen { address, source })?;
    let address = listener.local_addr()?;
    drop(entered);
    let gate = Gate { token: Token::draw()?, open_to_others: !loopback };
    Ok(Bound { runtime, listener, address, gate, limits: Limits::default() })
}

/// What the answers are made of.
#[derive(Clone)]
struct Answers {
    gate: Gate,
    page: Bytes,
    scene: Arc<Scene>,
    /// `None`: this page only looks.
    control: Option<SyncSender<Request>>,
    clients: Arc<Clients>,
    news: watch::Receiver<News>,
}

impl Bound {
    /// What to open in a browser; the token in it lets in whoever has it.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", reachable(self.address), self.gate.token)
    }

    /// Starts to answer, on a thread of its own. `control`: clients may act.
    pub fn serve(self, scene: Scene, control: bool) -> Result<View, ViewError> {
        let Bound { runtime, listener, gate, limits, .. } = self;
        let (letters, taken) = tokio::sync::mpsc::channel(LETTERS_MAX);
        let clients = Arc::new(Clients::default());
        let (requests, asked) = sync_channel(REQUESTS_MAX);
        let (here, gone) = channel::<()>();
        let (told, news) = watch::channel(News::default());
        let answers = Answers {
            gate,
            page: outcome::report::page::live(&scene, control).into(),
            scene: Arc::new(scene),
            control: control.then_some(requests),
            clients: clients.clone(),
            news,
        };
        let told_clients = clients.clone();
        std::thread::Builder::new().name("view".into()).spawn(move || {
            let _here: Sender<()> = here; // until the thread ends
            give_way();
            runtime.block_on(async move {
                let listener = Limited::new(listener, limits);
                let answers = router(answers).into_make_service_with_connect_info::<Pass>();
                tokio::spawn(axum::serve(listener, answers).into_future());
                deliver(taken, told, &told_clients).await;
            });
        })?;
        Ok(View::new(letters, clients, control, asked, gone))
    }
}

/// Lets every other thread of the machine run before this one.
fn give_way() {
    let parameters = libc::sched_param { sched_priority: 0 };
    // SAFETY: a plain system call that reads `parameters`; 0 is the calling thread. Where it fails
    // the thread is an ordinary one.
    unsafe { libc::sched_setscheduler(0, libc::SCHED_IDLE, &parameters) };
}

/// Brings what the supervisor hands over to everybody, until the run is over.
async fn deliver(mut letters: Letters, told: watch::Sender<News>, clients: &Clients) {
    let mut over = false;
    while !over && let Some(first) = letters.recv().await {
        told.send_modify(|news| {
            over = news.take(first);
            // Of frames that came meanwhile, the newest.
            while let Ok(next) = letters.try_recv() {
                over = news.take(next);
            }
        });
    }
    let end = Instant::now() + FAREWELL_MAX;
    while clients.count() > 0 && Instant::now() < end {
        sleep(FLUSH).await;
    }
    sleep(FLUSH).await;
}

fn router(answers: Answers) -> Router {
    Router::new()
        .route("/", get(page))
        .route("/events", get(events))
        .route("/control", post(control).layer(DefaultBodyLimit::max(BODY_MAX)))
        .layer(middleware::from_fn_with_state(answers.clone(), guarded))
        .with_state(answers)
}

/// Nobody gets past the gate, and every answer has its headers.
async fn guarded(
    State(answers): State<Answers>,
    ConnectInfo(pass): ConnectInfo<Pass>,
    request: HttpRequest,
    next: Next,
) -> Response {
    let mut response = match answers.gate.admits(request.uri(), request.headers()) {
        Ok(()) if pass.authenticate() => match timeout(REQUEST_MAX, next.run(request)).await {
            Ok(response) => response,
            Err(_) => (StatusCode::REQUEST_TIMEOUT, "the request is not whole").into_response(),
        },
        Ok(()) => TOO_MANY.into_response(),
        Err(refusal) => refusal.into_response(),
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn page(State(answers): State<Answers>) -> Response {
    ([(CONTENT_TYPE, "text/html; charset=utf-8")], answers.page).into_response()
}

async fn events(State(answers): State<Answers>) -> Response {
    match answers.clients.seat() {
        Some(seat) => tell(answers.news, seat),
        None => TOO_MANY.into_response(),
    }
}

async fn control(State(answers): State<Answers>, headers: HeaderMap, body: Bytes) -> Response {
    let Some(requests) = answers.control else {
        let reason = "this run is only to be looked at: start it with --view-control to act";
        return (StatusCode::FORBIDDEN, reason).into_response();
    };
    if let Err(refusal) = may_order(&headers) {
        return refusal.into_response();
    }
    let act = match act::read(&body, &answers.scene) {
        Ok(act) => act,
        Err(refusal) => return refusal.into_response(),
    };
    let (answer, answered) = oneshot::channel();
    let over = (StatusCode::CONFLICT, "the run is over");
    match requests.try_send(Request { act, answer }) {
        Ok(()) => {}
        Err(TrySendError::Disconnected(_)) => return over.into_response(),
        Err(TrySendError::Full(_)) => {
            return (StatusCode::SERVICE_UNAVAILABLE, "too many orders at once").into_response();
        }
    }
    match timeout(ANSWER_MAX, answered).await {
        Ok(Ok(Ok(()))) => StatusCode::NO_CONTENT.into_response(),
        Ok(Ok(Err(reason))) => (StatusCode::CONFLICT, reason).into_response(),
        Ok(Err(_)) => over.into_response(),
        Err(_) => {
            let reason = "the run does not answer; it may still do it";
            (StatusCode::GATEWAY_TIMEOUT, reason).into_response()
        }
    }
}

#[cfg(test)]
mod tests;
