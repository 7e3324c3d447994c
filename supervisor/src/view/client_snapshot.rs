//! Messages to each client: the newest frame, every event, the newest latencies, and the end of the run.
//!
//! A client receives new messages only after it has received the previous ones. Frames replaced meanwhile
//! are dropped and counted.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;

use async_stream::stream;
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse as _, Response};
use outcome::report::scene::SceneFrame;
use serde::Serialize;
use tokio::sync::watch;

use crate::view::handle::{ClientPermit, EVENTS_MAX, NumberedFrame, ViewMessage};

/// Snapshot of all data for clients. Copying is cheap, because the data is shared.
#[derive(Debug, Default)]
pub(crate) struct ClientSnapshot {
    frame: Option<Arc<NumberedFrame>>,
    /// Newest events, each as JSON.
    events: VecDeque<Arc<str>>,
    /// Number of events before these.
    dropped_event_count: u64,
    /// Number and JSON of the newest latencies.
    latency: Option<(u64, Arc<str>)>,
    run_end: Option<Arc<str>>,
}

impl ClientSnapshot {
    /// Adds a message of the supervisor. Returns whether it is the last.
    pub(crate) fn add(&mut self, message: ViewMessage) -> bool {
        match message {
            ViewMessage::Frame(frame) => self.frame = Some(Arc::new(frame)),
            ViewMessage::Event(event) => {
                if self.events.len() == EVENTS_MAX {
                    self.events.pop_front();
                    self.dropped_event_count += 1;
                }
                self.events.push_back(to_json(&event));
            }
            ViewMessage::Latency(latency) => {
                let number = self.latency.as_ref().map_or(0, |(number, _)| *number);
                self.latency = Some((number + 1, to_json(&latency)));
            }
            ViewMessage::RunEnd(run_end) => self.run_end = Some(to_json(&run_end)),
        }
        self.run_end.is_some()
    }
}

/// Data that one client has received.
#[derive(Debug, Default)]
struct ClientCursor {
    frame_number: u64,
    dropped_count: u64,
    event_count: u64,
    latency_number: u64,
}

/// Frame in the format for clients.
#[derive(Serialize)]
struct ClientFrame<'a> {
    #[serde(flatten)]
    frame: &'a SceneFrame,
    /// Time at which the frame was made, ms since 1970.
    at_unix_ms: u64,
    /// Age of the frame, ms.
    behind_ms: u64,
    /// Number of frames that this client did not receive.
    dropped: u64,
}

/// Name of a server-sent event, empty for a frame, and its data.
type SseMessage = (&'static str, Arc<str>);

impl ClientCursor {
    /// Returns the data that is new to this client, and whether it is the last.
    fn collect_new(&mut self, snapshot: &ClientSnapshot) -> (Vec<SseMessage>, bool) {
        let received_count = self.event_count.saturating_sub(snapshot.dropped_event_count) as usize;
        let new_events = snapshot.events.iter().skip(received_count);
        let mut messages: Vec<SseMessage> =
            new_events.map(|json| ("happened", json.clone())).collect();
        self.event_count = snapshot.dropped_event_count + snapshot.events.len() as u64;
        if let Some(numbered_frame) = snapshot
            .frame
            .as_ref()
            .filter(|numbered_frame| numbered_frame.number > self.frame_number)
        {
            // Frames before its first are not counted as dropped.
            let first = self.frame_number == 0;
            self.dropped_count +=
                if first { 0 } else { numbered_frame.number - self.frame_number - 1 };
            self.frame_number = numbered_frame.number;
            let client_frame = ClientFrame {
                frame: &numbered_frame.frame,
                at_unix_ms: numbered_frame.unix_time_ms,
                behind_ms: numbered_frame.creation_time.elapsed().as_millis() as u64,
                dropped: self.dropped_count,
            };
            messages.push(("", to_json(&client_frame)));
        }
        let latency = snapshot.latency.as_ref().filter(|(number, _)| *number > self.latency_number);
        if let Some((number, json)) = latency {
            self.latency_number = *number;
            messages.push(("latency", json.clone()));
        }
        if let Some(run_end) = &snapshot.run_end {
            messages.push(("ended", run_end.clone()));
        }
        (messages, snapshot.run_end.is_some())
    }
}

/// Sends new data to one client until the run is over or the client disconnects.
pub(crate) fn stream_to_client(
    mut snapshot: watch::Receiver<ClientSnapshot>,
    permit: ClientPermit,
) -> Response {
    let events = stream! {
        let _permit = permit; // until the client is gone
        let mut cursor = ClientCursor::default();
        loop {
            let (messages, is_last) = cursor.collect_new(&snapshot.borrow_and_update());
            for (name, data) in messages {
                let event = match name {
                    "" => Event::default(),
                    name => Event::default().event(name),
                };
                yield Ok::<Event, Infallible>(event.data(data));
            }
            if is_last || snapshot.changed().await.is_err() {
                break;
            }
        }
    };
    Sse::new(events).keep_alive(KeepAlive::default()).into_response()
}

fn to_json(value: &impl Serialize) -> Arc<str> {
    serde_json::to_string(value).expect("string keys and plain values only").into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::handle::{RunEnd, RunEvent};
    use proptest::prelude::*;
    use serde_json::Value;
    use std::time::Instant;

    fn frame(number: u64) -> NumberedFrame {
        let frame = SceneFrame { t_s: number as f64, ..SceneFrame::default() };
        NumberedFrame { number, creation_time: Instant::now(), unix_time_ms: 0, frame }
    }

    fn event(number: u64) -> RunEvent {
        let detail = number.to_string();
        RunEvent { kind: "kill".into(), robot: "a".into(), detail, ..RunEvent::default() }
    }

    proptest! {
        /// Checks that, at any polling rate of a client, every frame since its first is received or counted
        /// as dropped, and every stored event is received once, in order.
        #[test]
        fn missed_frames_are_counted_and_events_are_complete(
            polls in proptest::collection::vec(any::<bool>(), 1..600),
        ) {
            let (mut snapshot, mut cursor) = (ClientSnapshot::default(), ClientCursor::default());
            let (mut first, mut received_frames, mut received_events) = (None, 0, Vec::new());
            let total = polls.len() as u64;
            for (number, is_polled) in (1..).zip(polls.into_iter().chain([true])) {
                if number <= total {
                    prop_assert!(!snapshot.add(ViewMessage::Frame(frame(number))));
                    prop_assert!(!snapshot.add(ViewMessage::Event(event(number))));
                }
                if !is_polled {
                    continue;
                }
                let (messages, is_last) = cursor.collect_new(&snapshot);
                prop_assert!(!is_last);
                for (name, data) in messages {
                    let data: Value = serde_json::from_str(&data).unwrap();
                    if name == "happened" {
                        received_events.push(data["detail"].as_str().unwrap().parse::<u64>().unwrap());
                        continue;
                    }
                    received_frames += 1;
                    let t_s = data["t_s"].as_f64().unwrap() as u64;
                    let since_first = t_s - *first.get_or_insert(t_s) + 1;
                    prop_assert_eq!(received_frames + data["dropped"].as_u64().unwrap(), since_first);
                }
            }
            prop_assert!(received_events.is_sorted_by(|a, b| a < b));
            prop_assert_eq!(received_events.last(), Some(&total));
            let first_kept = total.saturating_sub(EVENTS_MAX as u64) + 1;
            prop_assert!((first_kept..=total).all(|number| received_events.binary_search(&number).is_ok()));
        }
    }

    #[test]
    fn end_of_the_run_is_the_last_message() {
        let mut snapshot = ClientSnapshot::default();
        assert!(!snapshot.add(ViewMessage::Frame(frame(1))));
        assert!(snapshot.add(ViewMessage::RunEnd(RunEnd { exit: 1, text: "missed".into() })));
        let (messages, is_last) = ClientCursor::default().collect_new(&snapshot);
        assert!(is_last);
        assert_eq!(messages.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["", "ended"]);
        assert_eq!(&*messages[1].1, r#"{"exit":1,"text":"missed"}"#);
    }
}
