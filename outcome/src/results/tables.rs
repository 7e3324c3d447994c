//! Tables of a run: their columns and their text, the same on every target. Must not: depend on where it is written.

use experiment::scenario::Scenario;
use formation::Vec2;
use formation::front_point::front_point;
use formation::pose::Pose;
use formation::seconds;
use protocol::message::{TruthHeader, TruthRow};
use serde::{Deserialize, Deserializer, Serialize};

use crate::columns::{Table as _, table};
use crate::metrics::signals::Newest;
use crate::metrics::{CurrentErrors, PairDistance};

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
        #[serde(deserialize_with = "flag")]
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
        /// New state: of a `contact`, `fresh`, `stale` or `lost`; of a `repair`, `used` or `unused`, and of a deputy,
        /// `leads` or `follows`. Empty for other events.
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

/// Reads a flag that is written as 1 or 0.
fn flag<'de, D: Deserializer<'de>>(deserializer: D) -> Result<bool, D::Error> {
    u8::deserialize(deserializer).map(|number| number == 1)
}

/// Selection and formatting of the samples in `samples.csv`.
pub struct Samples {
    robots: Vec<String>,
    /// Distance of each front point from its axle, m.
    front_points_m: Vec<f64>,
    record_hz: f64,
    /// Number of the newest interval of 1 / record_hz from which a sample was written.
    recorded: Option<u64>,
    newest: NewestSample,
    /// Lines of the newest sample that was due, in scenario order.
    lines: Vec<SampleLine>,
    signals: SignalTable,
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
    pub nearest: Option<(f64, [usize; 2])>,
    /// Lines of `signals.csv`, robot by robot: the newest value of each signal that was recorded since the sample before.
    pub signals: &'a [SignalLine],
}

/// Newest sample, which must be written if the run ends now and it was not written yet.
#[derive(Default)]
struct NewestSample {
    unwritten: bool,
    t_ns: u64,
    /// State of each robot, in scenario order.
    rows: Vec<TruthRow>,
    /// Error of each robot to its in-neighbors, m.
    errors_m: Vec<Option<f64>>,
    /// Error vector of each robot, m.
    errors: Vec<Option<Vec2>>,
    /// Error of each robot to the ideal formation, m.
    ideal_errors_m: Vec<Option<f64>>,
    /// Whether each robot is alive.
    alive: Vec<bool>,
    /// Smallest distance, m, and the indices of the two robots.
    nearest: Option<(f64, [usize; 2])>,
    /// Newest values of all signals.
    signals: Vec<Newest>,
}

/// Selection of the values in `signals.csv`.
struct SignalTable {
    /// Names of robot and signal of each value, in the order of the metrics.
    names: Vec<(String, &'static str)>,
    /// Run time of the value of each signal that was written last, ns.
    written_ns: Vec<Option<u64>>,
    /// Lines that are due.
    lines: Vec<SignalLine>,
}

impl SignalTable {
    fn new(scenario: &Scenario) -> SignalTable {
        let robots = scenario.robots.iter();
        let names: Vec<(String, &'static str)> = robots
            .flat_map(|robot| robot.signals.iter().map(|&signal| (robot.name.clone(), signal)))
            .collect();
        SignalTable { written_ns: vec![None; names.len()], names, lines: Vec::new() }
    }

    /// Replaces the lines by the values that are not written yet.
    fn replace_lines(&mut self, newest: &[Newest]) {
        self.lines.clear();
        for ((value, written_ns), (robot, signal)) in
            newest.iter().zip(&mut self.written_ns).zip(&self.names)
        {
            let Some((t_ns, value)) = *value else { continue };
            if written_ns.replace(t_ns) != Some(t_ns) {
                let (robot, signal) = (robot.clone(), (*signal).to_owned());
                self.lines.push(SignalLine { t_s: seconds(t_ns), robot, signal, value });
            }
        }
    }
}

impl Samples {
    /// Creates the state before the first sample.
    pub fn new(scenario: &Scenario) -> Samples {
        Samples {
            robots: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            record_hz: scenario.record_hz,
            recorded: None,
            newest: NewestSample::default(),
            lines: vec![SampleLine::default(); scenario.robots.len()],
            signals: SignalTable::new(scenario),
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
        let has = |robot: &String| names.iter().any(|(of, _)| of == robot);
        self.robots.iter().map(has).collect()
    }

    /// Restricts the samples that are due to the first and the last one.
    pub fn record_first_and_last_only(&mut self) {
        self.record_hz = 0.0;
    }

    /// Stores a sample. Returns whether its lines are due. `measured` are the metrics at this sample.
    pub fn store(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        measured: CurrentErrors<'_>,
    ) -> bool {
        let newest = &mut self.newest;
        newest.unwritten = true;
        newest.t_ns = header.t_ns;
        replace(&mut newest.rows, rows);
        replace(&mut newest.errors_m, measured.errors_m);
        replace(&mut newest.errors, measured.errors);
        replace(&mut newest.ideal_errors_m, measured.ideal_errors_m);
        replace(&mut newest.alive, alive);
        newest.nearest = measured.nearest;
        replace(&mut newest.signals, measured.signals);
        // The time of a tick is a whole number of ns, but the period of the rate is not: rounding errors are
        // tolerated.
        let interval = (seconds(header.t_ns) * self.record_hz + 1e-6) as u64;
        self.recorded.replace(interval) != Some(interval)
    }

    /// Returns the newest sample, or `None` if it was returned before.
    pub fn take_newest(&mut self) -> Option<DueSample<'_>> {
        if !std::mem::take(&mut self.newest.unwritten) {
            return None;
        }
        let newest = &self.newest;
        self.text.clear();
        for (i, line) in self.lines.iter_mut().enumerate() {
            let TruthRow { x_m, y_m, heading_rad, v_m_s, side_m_s, w_rad_s, .. } = newest.rows[i];
            // Distances are between front points.
            let front = front_point(Pose { x_m, y_m, heading_rad }, self.front_points_m[i]);
            let error = find_value(&newest.errors, i).filter(|error| error.norm().is_finite());
            line.robot.clone_from(&self.robots[i]);
            *line = SampleLine {
                t_s: seconds(newest.t_ns),
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
        let (t_ns, nearest) = (newest.t_ns, newest.nearest);
        let signals = &self.signals.lines;
        Some(DueSample { t_ns, lines: &self.lines, text: &self.text, nearest, signals })
    }
}

/// Returns the text of lines of `signals.csv`.
pub fn signals(lines: &[SignalLine]) -> String {
    let mut text = String::new();
    lines.iter().for_each(|line| line.append_to(&mut text));
    text
}

impl EventLine {
    /// Returns the line as text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        self.append_to(&mut text);
        text
    }
}

/// Formats `pairs.csv`.
pub fn pairs(pairs: &[PairDistance]) -> String {
    let mut text = PairDistance::header();
    pairs.iter().for_each(|pair| pair.append_to(&mut text));
    text
}

/// Returns the value of a robot. Of a list that the caller does not give, all values are unknown.
fn find_value<T: Copy>(list: &[Option<T>], robot: usize) -> Option<T> {
    list.get(robot).copied().flatten()
}

fn replace<T: Copy>(kept: &mut Vec<T>, with: &[T]) {
    kept.clear();
    kept.extend_from_slice(with);
}
