//! Encoding of the two recorded messages about all robots: metrics and events. Messages about one robot are in
//! [`protocol::ros2::messages`].

use protocol::ros2::cdr::{Reader, Writer};

/// Smallest distance between two front points at an instant, m, and the indices of the two robots in the scenario.
pub type Nearest = (f64, [usize; 2]);

/// Content of a `phalanx_msgs/Metrics`. The lists are in scenario order.
#[derive(Debug, PartialEq)]
pub(crate) struct Metrics<'a> {
    pub(crate) nearest: Option<Nearest>,
    pub(crate) robots: Vec<&'a str>,
    pub(crate) errors_m: Vec<Option<f64>>,
    pub(crate) alive: Vec<bool>,
    /// Ideal errors, m; empty in a recording of an earlier version.
    pub(crate) ideal_errors_m: Vec<Option<f64>>,
}

/// Writes a `phalanx_msgs/Metrics`. `errors_m` are the errors to the in-neighbors and to the ideal formation, m.
pub(crate) fn metrics(
    out: &mut Writer,
    stamp_ns: u64,
    robots: &[String],
    nearest: Option<Nearest>,
    errors_m: [&[Option<f64>]; 2],
    alive: &[bool],
) {
    let errors = |out: &mut Writer, errors_m: &[Option<f64>]| {
        out.u32(errors_m.len() as u32);
        errors_m.iter().for_each(|error_m| out.f64s(&[error_m.unwrap_or(f64::NAN)]));
    };
    out.clear();
    out.time(stamp_ns);
    out.f64s(&[nearest.map_or(f64::NAN, |(distance_m, _)| distance_m)]);
    for place in nearest.map_or([0, 0], |(_, pair)| pair) {
        out.u32(place as u32);
    }
    out.u32(robots.len() as u32);
    robots.iter().for_each(|robot| out.string(robot));
    errors(out, errors_m[0]);
    out.u32(alive.len() as u32);
    alive.iter().for_each(|&alive| out.u8(u8::from(alive)));
    errors(out, errors_m[1]);
}

/// Reads a `phalanx_msgs/Metrics`. Returns `None` if the layout differs.
pub(crate) fn read_metrics(message: &[u8]) -> Option<Metrics<'_>> {
    let mut reader = Reader::new(message)?;
    reader.time()?;
    let distance_m = reader.f64()?;
    let pair = [reader.u32()? as usize, reader.u32()? as usize];
    let errors = |reader: &mut Reader<'_>| {
        let list = reader.list(Reader::f64)?.into_iter();
        Some(list.map(|error_m| (!error_m.is_nan()).then_some(error_m)).collect())
    };
    Some(Metrics {
        nearest: (!distance_m.is_nan()).then_some((distance_m, pair)),
        robots: reader.list(Reader::string)?,
        errors_m: errors(&mut reader)?,
        alive: reader.list(|reader| Some(reader.u8()? != 0))?,
        ideal_errors_m: errors(&mut reader).unwrap_or_default(),
    })
}

/// Content of an event in `/rosout`.
#[derive(Debug, PartialEq)]
pub(crate) struct Event<'a> {
    /// ROS log level.
    pub(crate) level: u8,
    /// Name of the robot, or [`SUPERVISOR`](super::recorder::SUPERVISOR) for events of the run.
    pub(crate) name: &'a str,
    pub(crate) kind: &'a str,
    /// Kind of the event, followed by details.
    pub(crate) text: &'a str,
}

/// Writes a `rcl_interfaces/Log`.
pub(crate) fn log(out: &mut Writer, stamp_ns: u64, event: &Event<'_>) {
    out.clear();
    out.time(stamp_ns);
    out.u8(event.level);
    out.string(event.name);
    out.string(event.text);
    out.string("");
    out.string(event.kind);
    out.u32(0);
}

/// Reads a `rcl_interfaces/Log`. Returns `None` if the layout differs.
pub(crate) fn read_log(message: &[u8]) -> Option<Event<'_>> {
    let mut reader = Reader::new(message)?;
    reader.time()?;
    let (level, name, text) = (reader.u8()?, reader.string()?, reader.string()?);
    reader.string()?;
    Some(Event { level, name, kind: reader.string()?, text })
}
