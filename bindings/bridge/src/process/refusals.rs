//! Counts of what zenoh refuses before it reaches the bridge as a frame: connections without a certificate of the
//! fleet, and messages that the access list denies.
//!
//! zenoh 1.10 reports these only in its log, and only as text: the events of `zenoh-link-tls` and of its access
//! list have no fields, and its feature `stats` counts only a part of the messages that the access list drops,
//! without the reason, and nothing of TLS. So the text is parsed, using as little of it as distinguishes the
//! reasons; `tests/strangers.rs` fails if zenoh changes it. Must not: refuse anything.

use std::cell::Cell;
use std::fmt::{Debug, Write as _};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use protocol::dropped::DropReason;
use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Level, Metadata, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::filter_fn;
use tracing_subscriber::layer::Context;
use tracing_subscriber::registry::LookupSpan;

/// Log targets of zenoh: the listener, the connector, and the access list.
const LISTENER_LOG_TARGET: &str = "zenoh_link_tls";
const ORCHESTRATOR_TARGET: &str = "zenoh::net::runtime::orchestrator";
const ACCESS_CONTROL_TARGET: &str = "zenoh::net::routing::interceptor::access_control";
/// Number of kinds of messages for which the access list logs an answer when a key is declared, without a
/// message.
const ANSWERS_PER_DECLARATION: u32 = 9;

static REFUSAL_COUNTS: [AtomicU64; DropReason::ALL.len()] =
    [const { AtomicU64::new(0) }; DropReason::ALL.len()];
/// First refusal for each reason, for the log.
static FIRST_REFUSALS: Mutex<Vec<(DropReason, String)>> = Mutex::new(Vec::new());

thread_local! {
    /// Number of answers of the access list that are still about a key being declared on this thread.
    static PENDING_DECLARATIONS: Cell<u32> = const { Cell::new(0) };
}

/// Returns the number of refusals for this reason.
pub fn refusal_count(reason: DropReason) -> u64 {
    REFUSAL_COUNTS[reason as usize].load(Ordering::Relaxed)
}

/// Returns the first refusal for each reason since the last call, as zenoh's text.
pub fn take_first_refusals() -> Vec<(DropReason, String)> {
    FIRST_REFUSALS.lock().map(|mut first| std::mem::take(&mut *first)).unwrap_or_default()
}

/// Returns whether events of zenoh's log are counted here and need not be logged: a client can cause any number
/// of them.
pub fn is_counted(metadata: &Metadata<'_>) -> bool {
    match metadata.target() {
        ACCESS_CONTROL_TARGET => true,
        target => target.starts_with(LISTENER_LOG_TARGET) && *metadata.level() == Level::WARN,
    }
}

/// Subscriber layer for zenoh's log.
#[derive(Debug, Clone, Copy)]
pub struct RefusalCounter;

impl RefusalCounter {
    /// Returns a layer that receives only the events that it needs.
    pub fn layer<S>() -> impl Layer<S> + Send + Sync
    where
        S: Subscriber + for<'s> LookupSpan<'s>,
    {
        let is_relevant = filter_fn(|metadata| {
            is_counted(metadata)
                || metadata.target() == ORCHESTRATOR_TARGET && *metadata.level() <= Level::DEBUG
        });
        RefusalCounter.with_filter(is_relevant.with_max_level_hint(LevelFilter::TRACE))
    }
}

impl<S: Subscriber> Layer<S> for RefusalCounter {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let mut message = MessageVisitor(String::new());
        event.record(&mut message);
        let target = event.metadata().target();
        let Some(reason) = refusal_reason(target, &message.0) else { return };
        if REFUSAL_COUNTS[reason as usize].fetch_add(1, Ordering::Relaxed) == 0
            && let Ok(mut first) = FIRST_REFUSALS.lock()
        {
            first.push((reason, message.0));
        }
    }
}

struct MessageVisitor(String);

impl Visit for MessageVisitor {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            let _ = write!(self.0, "{value:?}");
        }
    }
}

/// Returns the reason of a refusal that an event reports; `None` if it reports none.
fn refusal_reason(target: &str, message: &str) -> Option<DropReason> {
    let contains = |pattern: &str| message.contains(pattern);
    let of_certificate = || match contains("invalid peer certificate") {
        true if contains("expired") || contains("not valid yet") => Some(DropReason::Expired),
        true => Some(DropReason::Certificate),
        false => contains("peer sent no certificates").then_some(DropReason::Certificate),
    };
    match target {
        ACCESS_CONTROL_TARGET => access_list_reason(message),
        // Refusals by the other side are counted there.
        ORCHESTRATOR_TARGET => of_certificate(),
        _ if contains("Too many open files") || contains("fatal alert") => None,
        _ => of_certificate().or(contains("file limit").then_some(DropReason::Handshake)),
    }
}

/// Returns the reason of a refusal that an event of the access list reports; `None` if it reports none.
fn access_list_reason(message: &str) -> Option<DropReason> {
    let contains = |pattern: &str| message.contains(pattern);
    if contains("caching permissions") {
        PENDING_DECLARATIONS.set(ANSWERS_PER_DECLARATION);
    } else if contains("did not match any configured ACL subject") {
        return Some(DropReason::UnknownHost);
    } else if contains("authorized to") {
        let of_message = contains("cached result") || PENDING_DECLARATIONS.get() == 0;
        if !of_message {
            PENDING_DECLARATIONS.set(PENDING_DECLARATIONS.get() - 1);
        }
        let denied = of_message && contains("unauthorized to Put (ingress)");
        return denied.then_some(DropReason::Denied);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_events_map_to_one_reason_or_none() {
        let hint = ". Hint: increase the system open file limit.";
        for (target, message, reason) in [
            (
                LISTENER_LOG_TARGET,
                "invalid peer certificate: UnknownIssuer",
                Some(DropReason::Certificate),
            ),
            (LISTENER_LOG_TARGET, "peer sent no certificates", Some(DropReason::Certificate)),
            (
                LISTENER_LOG_TARGET,
                "invalid peer certificate: certificate expired: 5",
                Some(DropReason::Expired),
            ),
            (LISTENER_LOG_TARGET, "received corrupt message", Some(DropReason::Handshake)),
            (LISTENER_LOG_TARGET, "Timeout during TLS handshake", Some(DropReason::Handshake)),
            (LISTENER_LOG_TARGET, "received fatal alert: CertificateExpired", None),
            (LISTENER_LOG_TARGET, "Too many open files (os error 24)", None),
            (
                ORCHESTRATOR_TARGET,
                "Unable to connect: invalid peer certificate: x",
                Some(DropReason::Certificate),
            ),
            (ORCHESTRATOR_TARGET, "Unable to connect: connection refused", None),
            (
                ACCESS_CONTROL_TARGET,
                "x did not match any configured ACL subject. y",
                Some(DropReason::UnknownHost),
            ),
        ] {
            let message = match target {
                LISTENER_LOG_TARGET => format!("{message}{hint}"),
                _ => message.to_owned(),
            };
            assert_eq!(refusal_reason(target, &message), reason, "{message}");
        }
    }

    #[test]
    fn access_list_answer_about_a_key_is_not_counted() {
        let (denied, allowed) = ("is unauthorized to Put (ingress) on", "is authorized to Put on");
        assert_eq!(access_list_reason("ACL (ingress): caching permissions for `k` ..."), None);
        (0..ANSWERS_PER_DECLARATION).for_each(|_| assert_eq!(access_list_reason(denied), None));
        assert_eq!(access_list_reason(denied), Some(DropReason::Denied));
        assert_eq!(
            access_list_reason(&format!("Using cached result: x {denied}")),
            Some(DropReason::Denied)
        );
        assert_eq!(access_list_reason(allowed), None);
        assert_eq!(access_list_reason("is unauthorized to Declare Subscriber (ingress) on"), None);
    }
}
