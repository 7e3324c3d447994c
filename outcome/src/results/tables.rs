//! Text of the tables of a run, the same on every target. Must not: depend on where it is written.

use experiment::scenario::Scenario;
use formation::front_point::front_point;
use formation::pose::Pose;
use formation::seconds;
use protocol::message::{TruthHeader, TruthRow};

use crate::metrics::{CurrentErrors, PairDistance};

/// Header line of `samples.csv`.
pub const SAMPLES_HEADER: &str = "t_s,robot,x_m,y_m,heading_rad,v_m_s,w_rad_s,error_m,alive,ideal_error_m,front_x_m,\
     front_y_m\n";
/// Header line of `events.csv`.
pub const EVENTS_HEADER: &str = "t_s,kind,robot,detail\n";

/// Selection and formatting of the samples in `samples.csv`.
pub struct Samples {
    robots: Vec<String>,
    /// Distance of each front point from its axle, m.
    front_points_m: Vec<f64>,
    record_hz: f64,
    /// Number of the newest interval of 1 / record_hz from which a sample was written.
    recorded: Option<u64>,
    newest: NewestSample,
    /// Buffer of the lines of one sample.
    text: String,
}

/// Newest sample, which must be written if the run ends now and it was not written yet.
#[derive(Default)]
pub struct NewestSample {
    unwritten: bool,
    /// Run time, ns.
    pub t_ns: u64,
    /// State of each robot, in scenario order.
    pub rows: Vec<TruthRow>,
    /// Error of each robot to its in-neighbors, m.
    pub errors_m: Vec<Option<f64>>,
    /// Error of each robot to the ideal formation, m.
    pub ideal_errors_m: Vec<Option<f64>>,
    /// Whether each robot is alive.
    pub alive: Vec<bool>,
    /// Smallest distance, m, and the indices of the two robots.
    pub nearest: Option<(f64, [usize; 2])>,
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
            text: String::new(),
        }
    }

    /// Returns the names of the robots, in scenario order.
    pub fn robots(&self) -> &[String] {
        &self.robots
    }

    /// Returns the newest sample.
    pub fn newest(&self) -> &NewestSample {
        &self.newest
    }

    /// Restricts the samples that are due to the first and the last one.
    pub fn record_ends_only(&mut self) {
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
        replace(&mut newest.ideal_errors_m, measured.ideal_errors_m);
        replace(&mut newest.alive, alive);
        newest.nearest = measured.nearest;
        // The time of a tick is a whole number of ns, but the period of the rate is not: rounding errors are
        // tolerated.
        let interval = (seconds(header.t_ns) * self.record_hz + 1e-6) as u64;
        self.recorded.replace(interval) != Some(interval)
    }

    /// Returns the lines of the newest sample, or `None` if they were returned before.
    pub fn format_newest(&mut self) -> Option<&str> {
        if !std::mem::take(&mut self.newest.unwritten) {
            return None;
        }
        let NewestSample { t_ns, rows, errors_m, ideal_errors_m, alive, .. } = &self.newest;
        let t_s = seconds(*t_ns).to_string();
        // The formatter of the standard library is slow for shortest digits.
        let (text, mut digits) = (&mut self.text, zmij::Buffer::new());
        text.clear();
        for (i, row) in rows.iter().enumerate() {
            let &TruthRow { x_m, y_m, heading_rad, v_m_s, w_rad_s, .. } = row;
            text.extend([&t_s, ",", &self.robots[i]]);
            let mut field = |text: &mut String, number: Option<f64>| {
                text.push(',');
                if let Some(number) = number {
                    let number = digits.format(number);
                    text.push_str(number.strip_suffix(".0").unwrap_or(number));
                }
            };
            for number in [x_m, y_m, heading_rad, v_m_s, w_rad_s] {
                field(text, Some(number));
            }
            field(text, errors_m[i]);
            text.push_str(if alive[i] { ",1" } else { ",0" });
            field(text, ideal_errors_m[i]);
            // Distances are between front points.
            let front = front_point(Pose { x_m, y_m, heading_rad }, self.front_points_m[i]);
            field(text, Some(front.x));
            field(text, Some(front.y));
            text.push('\n');
        }
        Some(text)
    }
}

/// Formats a line of `events.csv`.
pub fn event_line(t_ns: u64, kind: &str, robot: &str, detail: &str) -> String {
    format!("{},{kind},{robot},{}\n", seconds(t_ns), quoted(detail))
}

/// Formats `pairs.csv`.
pub fn pairs(pairs: &[PairDistance]) -> String {
    let mut text = "robot_a,robot_b,min_distance_m,t_s\n".to_owned();
    for PairDistance { pair: [a, b], min_distance_m, t_s } in pairs {
        text += &format!("{a},{b},{min_distance_m},{t_s}\n");
    }
    text
}

fn replace<T: Copy>(kept: &mut Vec<T>, with: &[T]) {
    kept.clear();
    kept.extend_from_slice(with);
}

/// Quotes a CSV field if necessary.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_quoted_only_where_csv_asks_for_it() {
        assert_eq!(quoted("exit code 4"), "exit code 4");
        assert_eq!(quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
    }
}
