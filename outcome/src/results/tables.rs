//! Tables of a run: their columns and their text, the same on every target. Must not: depend on where it is written.

use experiment::scenario::Scenario;
use formation::Vec2;
use formation::front_point::front_point;
use formation::ns_to_seconds;
use formation::pose::Pose;
use protocol::law_message::MessageFormat;
use protocol::message::{TruthHeader, TruthRow};
use serde::{Deserialize, Deserializer, Serialize};

use crate::columns::{Table, table};
use crate::metrics::pending::PendingValues;
use crate::metrics::signals::NewestValue;
use crate::metrics::{CurrentMetrics, PairDistance};

table! {
    /// Line of `samples.csv`: one robot at one time. Lines of earlier versions lack the later columns.
    #[derive(Debug, Clone, Default, PartialEq, Deserialize)]
    pub struct SampleLine in "samples.csv" {
        /// Time since the start of the run, s.
        pub t_s: f64 as Decimal,
        /// Name of the robot.
        pub robot: String,
        /// True x of the midpoint of the axle, m.
        pub x_m: f64,
        /// True y of the midpoint of the axle, m.
        pub y_m: f64,
        /// True heading, in (-pi, pi], rad.
        pub heading_rad: f64,
        /// Longitudinal speed over the interval that ends at `t_s`, m/s.
        pub v_m_s: f64,
        /// Turn rate over this interval, rad/s.
        pub w_rad_s: f64,
        /// Distance of the front point from its desired point, m; empty while the robot has no desired point. It is
        /// also given for a dead robot.
        pub error_m: Option<f64> => RECORDED,
        /// Whether the process of the robot was alive: 1 or 0.
        #[serde(deserialize_with = "deserialize_flag")]
        pub alive: bool => RECORDED,
        /// Distance of the front point from its slot in the ideal formation, m; empty while the robot has no slot. It
        /// is also given for a dead robot.
        pub ideal_error_m: Option<f64> => RECORDED,
        /// x of the front point, which is `front_point_m` ahead of the axle, m. Smallest distances are distances
        /// between front points.
        pub front_x_m: Option<f64>,
        /// y of the front point, m.
        pub front_y_m: Option<f64>,
        /// x component of the error: of the front point minus its desired point, m; empty if `error_m` is empty or
        /// not finite.
        pub error_x_m: Option<f64> => RECORDED,
        /// y component of the error, m.
        pub error_y_m: Option<f64> => RECORDED,
        /// Lateral speed over the interval that ends at `t_s`, m/s, to the left; 0 unless the robot is omnidirectional.
        #[serde(default)]
        pub side_m_s: f64,
    }
}

table! {
    /// Line of `events.csv`.
    #[derive(Debug, Clone, Default, PartialEq, Deserialize)]
    pub struct EventLine in "events.csv" {
        /// Time of the event, s.
        pub t_s: f64 as Decimal,
        /// Kind of the event; see below.
        pub kind: String,
        /// Name of the robot concerned; empty if the event concerns the whole run.
        pub robot: String,
        /// Description as text.
        pub detail: String,
        /// Name of the other robot: of a `contact`, the in-neighbor; of a `repair`, the robot that is used or no longer
        /// used; of a `cut` or `mend`, the sender. Empty for other events.
        #[serde(default)]
        pub other: String,
        /// New state: of a `contact`, `fresh`, `stale`, `lost` or `apart`; of a `repair`, `used` or `unused`, and of a
        /// deputy, `leads` or `follows`. Empty for other events.
        #[serde(default)]
        pub state: String,
        /// x of the new goal of a `goal`, m. Empty for other events.
        pub goal_x_m: Option<f64>,
        /// y of the new goal, m.
        pub goal_y_m: Option<f64>,
    }
}

table! {
    /// Line of `signals.csv`.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    pub struct SignalLine in "signals.csv" {
        /// Time of the odometry sample at which the law recorded the value, s.
        pub t_s: f64 as Decimal,
        /// Name of the robot.
        pub robot: String,
        /// Name of the signal.
        pub signal: String,
        /// Value, in the unit of the signal's suffix.
        pub value: f64,
    }
}

table! {
    /// Line of `messages.csv`: one number of a message, or a message without a structure.
    #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
    pub struct MessageLine in "messages.csv" {
        /// Time of the odometry sample whose answer the message left with, s.
        pub t_s: f64 as Decimal,
        /// Name of the robot that sent the message.
        pub robot: String,
        /// Key of the array in the message; empty for a message without a structure.
        pub array: String,
        /// Index of the number in the array, row by row, from 0.
        pub index: u64,
        /// The number; empty for a message without a structure.
        pub value: Option<f64>,
        /// Bytes of a message without a structure, two hexadecimal digits each; empty for a number.
        #[serde(default)]
        pub bytes: String,
    }
}

impl MessageLine {
    /// Returns the lines of a message that left at `t_s`, s: one for each number of its arrays, each with its key, or
    /// one with its bytes if it has no structure.
    pub fn lines_of_message<'a>(
        t_s: f64,
        robot: &str,
        arrays: impl Iterator<Item = (&'a str, Vec<f64>)>,
        bytes: &[u8],
    ) -> Vec<MessageLine> {
        let line = || MessageLine { t_s, robot: robot.to_owned(), ..MessageLine::default() };
        let mut lines = Vec::new();
        for (array, numbers) in arrays {
            lines.extend((0..).zip(numbers).map(|(index, value)| {
                let value = Some(value);
                MessageLine { array: array.to_owned(), index, value, ..line() }
            }));
        }
        if !bytes.is_empty() {
            let digits = bytes.iter().map(|byte| format!("{byte:02x}"));
            lines.push(MessageLine { bytes: digits.collect(), ..line() });
        }
        lines
    }
}

/// Message of a control law, for `messages.csv` and the recording.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedMessage {
    /// Name of the robot that sent the message.
    pub robot: String,
    /// Run time of the odometry sample whose answer the message left with, ns.
    pub t_ns: u64,
    /// Format of the messages of the robot's law.
    pub format: &'static MessageFormat,
    /// Bytes of the message, in this format.
    pub message: Vec<u8>,
}

impl RecordedMessage {
    /// Returns the arrays of the message; none if it has no structure.
    pub fn arrays(&self) -> impl Iterator<Item = (&str, Vec<f64>)> {
        let arrays = self.format.decode_arrays(&self.message);
        arrays.map(|(array, numbers)| (&*array.name, numbers))
    }

    /// Returns the bytes of a message without a structure; empty if it has one.
    pub fn bytes_without_structure(&self) -> &[u8] {
        if self.format.is_bytes() { &self.message } else { &[] }
    }

    /// Returns the lines of the message.
    pub fn lines(&self) -> Vec<MessageLine> {
        let (t_s, bytes) = (ns_to_seconds(self.t_ns), self.bytes_without_structure());
        MessageLine::lines_of_message(t_s, &self.robot, self.arrays(), bytes)
    }
}

/// Reads a flag that is written as 1 or 0.
fn deserialize_flag<'de, D: Deserializer<'de>>(deserializer: D) -> Result<bool, D::Error> {
    u8::deserialize(deserializer).map(|number| number == 1)
}

/// Selection and formatting of the samples in `samples.csv`.
pub struct SampleSelector {
    robots: Vec<String>,
    /// Distance of each front point from its axle, m.
    front_point_offsets_m: Vec<f64>,
    record_hz: f64,
    /// Number of the newest interval of 1 / record_hz from which a sample was written.
    newest_interval: Option<u64>,
    newest_sample: NewestSample,
    /// Lines of the newest sample that was due, in scenario order.
    lines: Vec<SampleLine>,
    signals: SignalTable,
    messages: MessageTable,
    /// Buffer of the text of these lines.
    text: String,
}

/// Sample that is due.
pub struct DueSample<'a> {
    /// Run time, ns.
    pub t_ns: u64,
    /// Lines of `samples.csv`, in scenario order.
    pub lines: &'a [SampleLine],
    /// Text of these lines.
    pub text: &'a str,
    /// Smallest distance, m, and the indices of the two robots.
    pub nearest_pair: Option<(f64, [usize; 2])>,
    /// Lines of `signals.csv`, robot by robot: the newest value of each signal that was recorded since the sample
    /// before.
    pub signals: &'a [SignalLine],
    /// Newest message of each robot that sent one since the sample before, robot by robot, if messages are recorded.
    pub messages: &'a [RecordedMessage],
}

/// Newest sample, which must be written if the run ends now and it was not written yet.
#[derive(Default)]
struct NewestSample {
    is_unwritten: bool,
    t_ns: u64,
    /// State of each robot, in scenario order.
    rows: Vec<TruthRow>,
    /// Error of each robot to its in-neighbors, m.
    errors_m: Vec<Option<f64>>,
    /// Error vector of each robot, m.
    error_vectors: Vec<Option<Vec2>>,
    /// Error of each robot to the ideal formation, m.
    ideal_errors_m: Vec<Option<f64>>,
    /// Whether each robot is alive.
    alive: Vec<bool>,
    /// Smallest distance, m, and the indices of the two robots.
    nearest_pair: Option<(f64, [usize; 2])>,
    /// Newest values of all signals.
    signals: Vec<NewestValue>,
}

/// Selection of the values in `signals.csv`.
struct SignalTable {
    /// Names of robot and signal of each value, in the order of the metrics.
    names: Vec<(String, &'static str)>,
    /// Run time of the value of each signal that was written last, ns.
    last_written_ns: Vec<Option<u64>>,
    /// Lines that are due.
    lines: Vec<SignalLine>,
}

impl SignalTable {
    fn new(scenario: &Scenario) -> SignalTable {
        let robots = scenario.robots.iter();
        let names: Vec<(String, &'static str)> = robots
            .flat_map(|robot| robot.signals.iter().map(|&signal| (robot.name.clone(), signal)))
            .collect();
        SignalTable { last_written_ns: vec![None; names.len()], names, lines: Vec::new() }
    }

    /// Replaces the lines by the values that are not written yet.
    fn replace_lines(&mut self, newest: &[NewestValue]) {
        self.lines.clear();
        for ((value, written_ns), (robot, signal)) in
            newest.iter().zip(&mut self.last_written_ns).zip(&self.names)
        {
            let Some((t_ns, value)) = *value else { continue };
            if written_ns.replace(t_ns) != Some(t_ns) {
                let (robot, signal) = (robot.clone(), (*signal).to_owned());
                self.lines.push(SignalLine { t_s: ns_to_seconds(t_ns), robot, signal, value });
            }
        }
    }
}

/// Selection of the messages in `messages.csv`.
struct MessageTable {
    /// Format of the recorded messages of each robot; `None` if its messages are not recorded.
    formats: Vec<Option<&'static MessageFormat>>,
    pending: PendingValues<Vec<u8>>,
    /// Newest message of each robot that is not written yet, with the run time of its sample, ns.
    newest: Vec<Option<(u64, Vec<u8>)>>,
    /// Messages that are due.
    due: Vec<RecordedMessage>,
}

impl MessageTable {
    fn new(scenario: &Scenario) -> MessageTable {
        let robots = scenario.robots.len();
        MessageTable {
            formats: (0..robots).map(|i| scenario.recorded_message_format(i)).collect(),
            pending: PendingValues::new(robots),
            newest: vec![None; robots],
            due: Vec::new(),
        }
    }

    /// Makes the messages of samples before run time `t_ns`, ns, the newest ones of their robots.
    fn apply_messages_before(&mut self, t_ns: u64) {
        let newest = &mut self.newest;
        self.pending.take_before(t_ns, |robot, at_ns, message| {
            newest[robot] = Some((at_ns, message));
        });
    }

    /// Replaces the messages that are due by the unwritten ones.
    fn replace_due(&mut self, names: &[String]) {
        self.due.clear();
        for ((newest, format), robot) in self.newest.iter_mut().zip(&self.formats).zip(names) {
            let (Some(format), Some((t_ns, message))) = (*format, newest.take()) else { continue };
            self.due.push(RecordedMessage { robot: robot.clone(), t_ns, format, message });
        }
    }
}

impl SampleSelector {
    /// Creates the state before the first sample.
    pub fn new(scenario: &Scenario) -> SampleSelector {
        SampleSelector {
            robots: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            front_point_offsets_m: scenario
                .robots
                .iter()
                .map(|robot| robot.front_point_m)
                .collect(),
            record_hz: scenario.record_hz,
            newest_interval: None,
            newest_sample: NewestSample::default(),
            lines: vec![SampleLine::default(); scenario.robots.len()],
            signals: SignalTable::new(scenario),
            messages: MessageTable::new(scenario),
            text: String::new(),
        }
    }

    /// Returns the names of the robots, in scenario order.
    pub fn robots(&self) -> &[String] {
        &self.robots
    }

    /// Returns for each robot, in scenario order, whether its law records signals.
    pub fn robots_with_signals(&self) -> Vec<bool> {
        let names = &self.signals.names;
        let has_signals = |robot: &String| names.iter().any(|(owner, _)| owner == robot);
        self.robots.iter().map(has_signals).collect()
    }

    /// Returns for each robot, in scenario order, whether the messages of its law are recorded.
    pub fn robots_with_messages(&self) -> Vec<bool> {
        self.messages.formats.iter().map(Option::is_some).collect()
    }

    /// Adds the message that a robot's law sent with the answer to its sample of run time `t_ns`, ns. It counts from
    /// the next sample on. Does nothing if the robot's messages are not recorded, or without a message of its format.
    pub fn add_law_message(&mut self, robot: usize, t_ns: u64, message: &[u8]) {
        let format = self.messages.formats[robot];
        if format.is_some_and(|format| format.check_bytes(message).is_ok()) {
            self.messages.pending.push(robot, t_ns, message.to_vec());
        }
    }

    /// Restricts the samples that are due to the first and the last one.
    pub fn record_first_and_last_only(&mut self) {
        self.record_hz = 0.0;
    }

    /// Stores a sample. Returns whether its lines are due. `metrics` are those at this sample.
    pub fn store_sample(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        metrics: CurrentMetrics<'_>,
    ) -> bool {
        let newest = &mut self.newest_sample;
        newest.is_unwritten = true;
        newest.t_ns = header.t_ns;
        replace_values(&mut newest.rows, rows);
        replace_values(&mut newest.errors_m, metrics.errors_m);
        replace_values(&mut newest.error_vectors, metrics.error_vectors);
        replace_values(&mut newest.ideal_errors_m, metrics.ideal_errors_m);
        replace_values(&mut newest.alive, alive);
        newest.nearest_pair = metrics.nearest_pair;
        replace_values(&mut newest.signals, metrics.signals);
        self.messages.apply_messages_before(header.t_ns);
        // The time of a tick is a whole number of ns, but the period of the rate is not: rounding errors are
        // tolerated.
        let interval = (ns_to_seconds(header.t_ns) * self.record_hz + 1e-6) as u64;
        self.newest_interval.replace(interval) != Some(interval)
    }

    /// Returns the newest sample, or `None` if it was returned before.
    pub fn take_newest_sample(&mut self) -> Option<DueSample<'_>> {
        if !std::mem::take(&mut self.newest_sample.is_unwritten) {
            return None;
        }
        let newest = &self.newest_sample;
        self.text.clear();
        for (i, line) in self.lines.iter_mut().enumerate() {
            let TruthRow { x_m, y_m, heading_rad, v_m_s, side_m_s, w_rad_s, .. } = newest.rows[i];
            // Distances are between front points.
            let front = front_point(Pose { x_m, y_m, heading_rad }, self.front_point_offsets_m[i]);
            let error =
                find_value(&newest.error_vectors, i).filter(|error| error.norm().is_finite());
            line.robot.clone_from(&self.robots[i]);
            *line = SampleLine {
                t_s: ns_to_seconds(newest.t_ns),
                robot: std::mem::take(&mut line.robot),
                x_m,
                y_m,
                heading_rad,
                v_m_s,
                w_rad_s,
                error_m: find_value(&newest.errors_m, i),
                alive: newest.alive[i],
                ideal_error_m: find_value(&newest.ideal_errors_m, i),
                front_x_m: Some(front.x),
                front_y_m: Some(front.y),
                error_x_m: error.map(|error| error.x),
                error_y_m: error.map(|error| error.y),
                side_m_s,
            };
            line.append_to(&mut self.text);
        }
        self.signals.replace_lines(&newest.signals);
        self.messages.replace_due(&self.robots);
        let (t_ns, nearest_pair) = (newest.t_ns, newest.nearest_pair);
        let (signals, messages) = (&self.signals.lines, &self.messages.due);
        Some(DueSample {
            t_ns,
            lines: &self.lines,
            text: &self.text,
            nearest_pair,
            signals,
            messages,
        })
    }
}

/// Returns the text of lines of a table.
pub fn format_lines<L: Table>(lines: &[L]) -> String {
    let mut text = String::new();
    lines.iter().for_each(|line| line.append_to(&mut text));
    text
}

impl EventLine {
    /// Returns the line as text.
    pub fn to_csv_line(&self) -> String {
        let mut text = String::new();
        self.append_to(&mut text);
        text
    }
}

/// Formats `pairs.csv`.
pub fn format_pairs(pairs: &[PairDistance]) -> String {
    let mut text = PairDistance::header();
    pairs.iter().for_each(|pair| pair.append_to(&mut text));
    text
}

/// Returns the value of a robot. Of a list that the caller does not give, all values are unknown.
fn find_value<T: Copy>(list: &[Option<T>], robot: usize) -> Option<T> {
    list.get(robot).copied().flatten()
}

fn replace_values<T: Copy>(values: &mut Vec<T>, new_values: &[T]) {
    values.clear();
    values.extend_from_slice(new_values);
}
