//! What stands in the tables of a run: text, the same on every target. Must not: know where it goes.

use experiment::scenario::Scenario;
use formation::front_point::front_point;
use formation::pose::Pose;
use formation::seconds;
use protocol::message::{TruthHeader, TruthRow};

use crate::metrics::{Now, PairDistance};

/// The first line of `samples.csv`.
pub const SAMPLES_HEADER: &str = "t_s,robot,x_m,y_m,heading_rad,v_m_s,w_rad_s,error_m,alive,ideal_error_m,front_x_m,\
     front_y_m\n";
/// The first line of `events.csv`.
pub const EVENTS_HEADER: &str = "t_s,kind,robot,detail\n";

/// Which truths `samples.csv` has, and how it has them.
pub struct Samples {
    robots: Vec<String>,
    /// How far each front point lies ahead of its axle, m.
    front_points_m: Vec<f64>,
    record_hz: f64,
    /// The newest stretch of 1 / record_hz of which a truth was written.
    recorded: Option<u64>,
    newest: Newest,
    /// The lines of one truth, kept for the next.
    text: String,
}

/// The newest truth, and whether it still has to be written if the run ends now.
#[derive(Default)]
pub struct Newest {
    unwritten: bool,
    /// Run time, ns.
    pub t_ns: u64,
    /// Where everybody is, in scenario order.
    pub rows: Vec<TruthRow>,
    /// The error that each robot has by what it hears, m.
    pub errors_m: Vec<Option<f64>>,
    /// And by the leader's reference, m.
    pub ideal_errors_m: Vec<Option<f64>>,
    /// Who is alive.
    pub alive: Vec<bool>,
    /// The smallest distance, m, and between which two.
    pub nearest: Option<(f64, [usize; 2])>,
}

impl Samples {
    /// Before the first truth.
    pub fn new(scenario: &Scenario) -> Samples {
        Samples {
            robots: scenario.robots.iter().map(|robot| robot.name.clone()).collect(),
            front_points_m: scenario.robots.iter().map(|robot| robot.front_point_m).collect(),
            record_hz: scenario.record_hz,
            recorded: None,
            newest: Newest::default(),
            text: String::new(),
        }
    }

    /// The names of the robots, in scenario order.
    pub fn robots(&self) -> &[String] {
        &self.robots
    }

    /// The newest truth.
    pub fn newest(&self) -> &Newest {
        &self.newest
    }

    /// Of all truths that come, only the first and the last are due.
    pub fn record_nothing(&mut self) {
        self.record_hz = 0.0;
    }

    /// Takes in a truth; whether its lines are due. `measured`: what is known at that truth.
    pub fn truth(
        &mut self,
        header: &TruthHeader,
        rows: &[TruthRow],
        alive: &[bool],
        measured: Now<'_>,
    ) -> bool {
        let newest = &mut self.newest;
        newest.unwritten = true;
        newest.t_ns = header.t_ns;
        replace(&mut newest.rows, rows);
        replace(&mut newest.errors_m, measured.errors_m);
        replace(&mut newest.ideal_errors_m, measured.ideal_errors_m);
        replace(&mut newest.alive, alive);
        newest.nearest = measured.nearest;
        // A tick's time is a whole number of ns, its rate is not: a hair's breadth early counts.
        let stretch = (seconds(header.t_ns) * self.record_hz + 1e-6) as u64;
        self.recorded.replace(stretch) != Some(stretch)
    }

    /// The lines of the newest truth, if they were not taken yet.
    pub fn take_lines(&mut self) -> Option<&str> {
        if !std::mem::take(&mut self.newest.unwritten) {
            return None;
        }
        let Newest { t_ns, rows, errors_m, ideal_errors_m, alive, .. } = &self.newest;
        let t_s = seconds(*t_ns).to_string();
        // Many numbers at a time: the formatter of the standard library is slow at shortest digits.
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
            // Distances are theirs.
            let front = front_point(Pose { x_m, y_m, heading_rad }, self.front_points_m[i]);
            field(text, Some(front.x));
            field(text, Some(front.y));
            text.push('\n');
        }
        Some(text)
    }
}

/// A line of `events.csv`.
pub fn event_line(t_ns: u64, kind: &str, robot: &str, detail: &str) -> String {
    format!("{},{kind},{robot},{}\n", seconds(t_ns), quoted(detail))
}

/// All of `pairs.csv`.
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

/// A CSV field, in quotes if it needs them.
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
