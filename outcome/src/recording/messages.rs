//! Encoding of the recorded messages that are no types of ROS 2: metrics, events, and what control laws recorded and
//! sent. All others are in [`protocol::ros2::messages`].

use protocol::ros2::cdr::{Reader, Writer};

use crate::columns::{Column, ColumnKind, ColumnValue, Table as _};
use crate::results::tables::{RecordedMessage, SampleLine, SignalLine};

/// Smallest distance between two front points at an instant, m, and the indices of the two robots in the scenario.
pub type NearestPair = (f64, [usize; 2]);

/// Content of a `phalanx_msgs/Metrics`. The lists are in scenario order.
#[derive(Debug, PartialEq)]
pub(crate) struct MetricsMessage<'a> {
    pub(crate) nearest_pair: Option<NearestPair>,
    pub(crate) robots: Vec<&'a str>,
    /// Values of the recorded columns of `samples.csv`, in order, one for each robot. A recording of an earlier version
    /// has no values in later columns.
    pub(crate) columns: Vec<Vec<ColumnValue<'static>>>,
}

/// Writes a `phalanx_msgs/Metrics`, with one line of `samples.csv` for each robot.
pub(crate) fn write_metrics(
    out: &mut Writer,
    stamp_ns: u64,
    lines: &[SampleLine],
    nearest_pair: Option<NearestPair>,
) {
    out.clear();
    out.write_time(stamp_ns);
    out.write_f64s(&[nearest_pair.map_or(f64::NAN, |(distance_m, _)| distance_m)]);
    for robot in nearest_pair.map_or([0, 0], |(_, pair)| pair) {
        out.write_u32(robot as u32);
    }
    out.write_u32(lines.len() as u32);
    lines.iter().for_each(|line| out.write_string(&line.robot));
    for column in SampleLine::recorded_columns() {
        out.write_u32(lines.len() as u32);
        for line in lines {
            match (column.value)(line) {
                ColumnValue::Number(number) => out.write_f64s(&[number.unwrap_or(f64::NAN)]),
                ColumnValue::Decimal(number) => out.write_f64s(&[number]),
                ColumnValue::Count(count) => {
                    out.write_u32(u32::try_from(count).unwrap_or(u32::MAX))
                }
                ColumnValue::Flag(flag) => out.write_u8(u8::from(flag)),
                ColumnValue::Text(text) => out.write_string(text),
            }
        }
    }
}

/// Returns the fields of `phalanx_msgs/Metrics` that are recorded columns, in the language of ROS 2 messages.
pub(crate) fn recorded_fields() -> String {
    let field = |column: &Column<SampleLine>| {
        let (kind, missing_value_note) = match column.kind {
            ColumnKind::Number => ("float64", " NaN where `samples.csv` is empty."),
            ColumnKind::Count => ("uint32", ""),
            ColumnKind::Flag => ("bool", ""),
            ColumnKind::Text => ("string", ""),
        };
        format!("# {}{missing_value_note}\n{kind}[] {}\n", column.text.trim(), column.name)
    };
    SampleLine::recorded_columns().map(field).collect()
}

/// Reads a `phalanx_msgs/Metrics`. Returns `None` if the layout differs.
pub(crate) fn read_metrics(message: &[u8]) -> Option<MetricsMessage<'_>> {
    let mut reader = Reader::new(message)?;
    reader.read_time()?;
    let distance_m = reader.read_f64()?;
    let pair = [reader.read_u32()? as usize, reader.read_u32()? as usize];
    let robots = reader.read_list(Reader::read_string)?;
    let mut columns = Vec::new();
    for column in SampleLine::recorded_columns() {
        // A recording of an earlier version ends before the later columns.
        columns.push(match reader.is_done() {
            true => Vec::new(),
            false => reader.read_list(|reader| read_value(reader, column.kind))?,
        });
    }
    let nearest_pair = (!distance_m.is_nan()).then_some((distance_m, pair));
    Some(MetricsMessage { nearest_pair, robots, columns })
}

/// Reads a value of a recorded column. Returns `None` if it is malformed.
fn read_value(reader: &mut Reader<'_>, kind: ColumnKind) -> Option<ColumnValue<'static>> {
    Some(match kind {
        ColumnKind::Number => {
            ColumnValue::Number(Some(reader.read_f64()?).filter(|number| !number.is_nan()))
        }
        ColumnKind::Count => ColumnValue::Count(reader.read_u32()?.into()),
        ColumnKind::Flag => ColumnValue::Flag(reader.read_u8()? != 0),
        // Texts are not recorded in `/metrics`.
        ColumnKind::Text => return None,
    })
}

/// Writes a `phalanx_msgs/Signals`: lines of one robot. `started_unix_ns` is the start of the run.
pub(crate) fn write_signals(out: &mut Writer, started_unix_ns: u64, lines: &[SignalLine]) {
    out.clear();
    out.write_u32(lines.len() as u32);
    for line in lines {
        out.write_time(started_unix_ns + (line.t_s * 1e9).round() as u64);
        out.write_string(&line.signal);
        out.write_f64s(&[line.value]);
    }
}

/// Reads a `phalanx_msgs/Signals`: stamp, ns since 1970, name and value of each. Returns `None` if the layout differs.
pub(crate) fn read_signals(message: &[u8]) -> Option<Vec<(u64, &str, f64)>> {
    let mut reader = Reader::new(message)?;
    reader
        .read_list(|reader| Some((reader.read_time()?, reader.read_string()?, reader.read_f64()?)))
}

/// Writes a `phalanx_msgs/LawMessage`. `started_unix_ns` is the start of the run.
pub(crate) fn write_law_message(out: &mut Writer, started_unix_ns: u64, message: &RecordedMessage) {
    out.clear();
    out.write_time(started_unix_ns + message.t_ns);
    let arrays: Vec<_> = message.arrays().collect();
    out.write_u32(arrays.len() as u32);
    for (name, numbers) in arrays {
        out.write_string(name);
        out.write_u32(numbers.len() as u32);
        numbers.iter().for_each(|&number| out.write_f64s(&[number]));
    }
    let bytes = message.bytes_without_structure();
    out.write_u32(bytes.len() as u32);
    bytes.iter().for_each(|byte| out.write_u8(*byte));
}

/// Content of a `phalanx_msgs/LawMessage`.
#[derive(Debug, PartialEq)]
pub(crate) struct LawMessage<'a> {
    /// Time of the odometry sample, ns since 1970.
    pub(crate) stamp_ns: u64,
    /// Key and numbers of each array.
    pub(crate) arrays: Vec<(&'a str, Vec<f64>)>,
    /// Bytes of a message without a structure.
    pub(crate) bytes: Vec<u8>,
}

/// Reads a `phalanx_msgs/LawMessage`. Returns `None` if the layout differs.
pub(crate) fn read_law_message(message: &[u8]) -> Option<LawMessage<'_>> {
    let mut reader = Reader::new(message)?;
    let stamp_ns = reader.read_time()?;
    let arrays = reader
        .read_list(|reader| Some((reader.read_string()?, reader.read_list(Reader::read_f64)?)))?;
    Some(LawMessage { stamp_ns, arrays, bytes: reader.read_list(Reader::read_u8)? })
}

/// Content of an event in `/rosout`.
#[derive(Debug, PartialEq)]
pub(crate) struct LogEvent<'a> {
    /// ROS log level.
    pub(crate) level: u8,
    /// Name of the robot, or [`SUPERVISOR`](super::recorder::SUPERVISOR) for events of the run.
    pub(crate) name: &'a str,
    pub(crate) kind: &'a str,
    /// Kind of the event, followed by details.
    pub(crate) text: &'a str,
}

/// Writes a `rcl_interfaces/Log`.
pub(crate) fn write_log(out: &mut Writer, stamp_ns: u64, event: &LogEvent<'_>) {
    out.clear();
    out.write_time(stamp_ns);
    out.write_u8(event.level);
    out.write_string(event.name);
    out.write_string(event.text);
    out.write_string("");
    out.write_string(event.kind);
    out.write_u32(0);
}

/// Reads a `rcl_interfaces/Log`. Returns `None` if the layout differs.
pub(crate) fn read_log(message: &[u8]) -> Option<LogEvent<'_>> {
    let mut reader = Reader::new(message)?;
    reader.read_time()?;
    let (level, name, text) = (reader.read_u8()?, reader.read_string()?, reader.read_string()?);
    reader.read_string()?;
    Some(LogEvent { level, name, kind: reader.read_string()?, text })
}
