//! Encoding of the two recorded messages about all robots: metrics and events. Messages about one robot are in
//! [`protocol::ros2::messages`].

use protocol::ros2::cdr::{Reader, Writer};

use crate::columns::{Column, Kind, Table as _, Value};
use crate::results::tables::{SampleLine, SignalLine};

/// Smallest distance between two front points at an instant, m, and the indices of the two robots in the scenario.
pub type Nearest = (f64, [usize; 2]);

/// Content of a `phalanx_msgs/Metrics`. The lists are in scenario order.
#[derive(Debug, PartialEq)]
pub(crate) struct MetricsMessage<'a> {
    pub(crate) nearest: Option<Nearest>,
    pub(crate) robots: Vec<&'a str>,
    /// Values of the recorded columns of `samples.csv`, in order, one for each robot. A recording of an earlier version
    /// has no values in later columns.
    pub(crate) columns: Vec<Vec<Value<'static>>>,
}

/// Writes a `phalanx_msgs/Metrics`, with one line of `samples.csv` for each robot.
pub(crate) fn metrics(
    out: &mut Writer,
    stamp_ns: u64,
    lines: &[SampleLine],
    nearest: Option<Nearest>,
) {
    out.clear();
    out.time(stamp_ns);
    out.f64s(&[nearest.map_or(f64::NAN, |(distance_m, _)| distance_m)]);
    for place in nearest.map_or([0, 0], |(_, pair)| pair) {
        out.u32(place as u32);
    }
    out.u32(lines.len() as u32);
    lines.iter().for_each(|line| out.string(&line.robot));
    for column in SampleLine::recorded_columns() {
        out.u32(lines.len() as u32);
        for line in lines {
            match (column.value)(line) {
                Value::Number(number) => out.f64s(&[number.unwrap_or(f64::NAN)]),
                Value::Decimal(number) => out.f64s(&[number]),
                Value::Count(count) => out.u32(u32::try_from(count).unwrap_or(u32::MAX)),
                Value::Flag(flag) => out.u8(u8::from(flag)),
                Value::Text(text) => out.string(text),
            }
        }
    }
}

/// Returns the fields of `phalanx_msgs/Metrics` that are recorded columns, in the language of ROS 2 messages.
pub(crate) fn recorded_fields() -> String {
    let field = |column: &Column<SampleLine>| {
        let (kind, absent) = match column.kind {
            Kind::Number => ("float64", " NaN where `samples.csv` is empty."),
            Kind::Count => ("uint32", ""),
            Kind::Flag => ("bool", ""),
            Kind::Text => ("string", ""),
        };
        format!("# {}{absent}\n{kind}[] {}\n", column.text.trim(), column.name)
    };
    SampleLine::recorded_columns().map(field).collect()
}

/// Reads a `phalanx_msgs/Metrics`. Returns `None` if the layout differs.
pub(crate) fn read_metrics(message: &[u8]) -> Option<MetricsMessage<'_>> {
    let mut reader = Reader::new(message)?;
    reader.time()?;
    let distance_m = reader.f64()?;
    let pair = [reader.u32()? as usize, reader.u32()? as usize];
    let robots = reader.list(Reader::string)?;
    let mut columns = Vec::new();
    for column in SampleLine::recorded_columns() {
        // A recording of an earlier version ends before the later columns.
        columns.push(match reader.is_done() {
            true => Vec::new(),
            false => reader.list(|reader| read_value(reader, column.kind))?,
        });
    }
    let nearest = (!distance_m.is_nan()).then_some((distance_m, pair));
    Some(MetricsMessage { nearest, robots, columns })
}

/// Reads a value of a recorded column. Returns `None` if it is malformed.
fn read_value(reader: &mut Reader<'_>, kind: Kind) -> Option<Value<'static>> {
    Some(match kind {
        Kind::Number => Value::Number(Some(reader.f64()?).filter(|number| !number.is_nan())),
        Kind::Count => Value::Count(reader.u32()?.into()),
        Kind::Flag => Value::Flag(reader.u8()? != 0),
        // Texts are not recorded in `/metrics`.
        Kind::Text => return None,
    })
}

/// Writes a `phalanx_msgs/Signals`: lines of one robot. `started_unix_ns` is the start of the run.
pub(crate) fn signals(out: &mut Writer, started_unix_ns: u64, lines: &[SignalLine]) {
    out.clear();
    out.u32(lines.len() as u32);
    for line in lines {
        out.time(started_unix_ns + (line.t_s * 1e9).round() as u64);
        out.string(&line.signal);
        out.f64s(&[line.value]);
    }
}

/// Reads a `phalanx_msgs/Signals`: stamp, ns since 1970, name and value of each. Returns `None` if the layout differs.
pub(crate) fn read_signals(message: &[u8]) -> Option<Vec<(u64, &str, f64)>> {
    let mut reader = Reader::new(message)?;
    reader.list(|reader| Some((reader.time()?, reader.string()?, reader.f64()?)))
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
