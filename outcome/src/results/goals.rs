//! Goals that robots got from outside, as events in `events.csv`.

/// Kind of these events.
pub const EVENT: &str = "goal";

/// Formats the detail of such an event: the goal position, m, and the source of the goal.
pub fn format_event_detail([x_m, y_m]: [f64; 2], source: &str) -> String {
    format!("to {x_m} {y_m} m, from {source}")
}

/// Parses the goal position, m, from such a detail. Returns `None` if it is malformed.
pub fn parse_position_m(detail: &str) -> Option<[f64; 2]> {
    let mut words = detail.strip_prefix("to ")?.split(' ');
    let mut number = || words.next()?.parse().ok().filter(|number: &f64| number.is_finite());
    Some([number()?, number()?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_of_a_goal_is_read_again() {
        for place in [[1.25, -0.5], [1e-9, -1e9], [0.1 + 0.2, 0.0]] {
            assert_eq!(parse_position_m(&format_event_detail(place, "ros2")), Some(place));
        }
        assert_eq!(format_event_detail([1.25, -0.5], "ros2"), "to 1.25 -0.5 m, from ros2");
        for other in ["", "to", "to 1 m", "to NaN 2 m", "at 1 2 m"] {
            assert_eq!(parse_position_m(other), None, "{other}");
        }
    }
}
