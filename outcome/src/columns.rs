//! Declaration of the tables of a run: one place for the name, text and value of every column. The lines of a file,
//! its header, the recording, its export and the reference page follow from it.
//!
//! A table is a struct, and each of its fields is a column. The doc comment of a field is the column's text.

use serde::{Serialize, Serializer};

/// Value of a column in one line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ColumnValue<'a> {
    /// Number in its shortest form; empty if it is unknown.
    Number(Option<f64>),
    /// Number in its shortest form without an exponent.
    Decimal(f64),
    /// Number of things or events.
    Count(u64),
    /// Flag, written as 1 or 0.
    Flag(bool),
    /// Text; empty if there is none.
    Text(&'a str),
}

/// Kind of the values of a column, by which a recording encodes them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColumnKind {
    /// Numbers, which may be unknown.
    Number,
    /// Numbers of things or events.
    Count,
    /// Flags, written as 1 or 0.
    Flag,
    /// Texts, quoted in a file if necessary.
    Text,
}

impl Serialize for ColumnValue<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match *self {
            ColumnValue::Number(number) => number.serialize(serializer),
            ColumnValue::Decimal(number) => serializer.serialize_f64(number),
            ColumnValue::Count(count) => serializer.serialize_u64(count),
            ColumnValue::Flag(flag) => serializer.serialize_u8(u8::from(flag)),
            ColumnValue::Text(text) => serializer.serialize_str(text),
        }
    }
}

/// Type of a field that is a column.
pub trait CsvCell {
    /// Kind of the column.
    const KIND: ColumnKind;

    /// Returns the value of the field.
    fn value(&self) -> ColumnValue<'_>;
}

impl CsvCell for f64 {
    const KIND: ColumnKind = ColumnKind::Number;

    fn value(&self) -> ColumnValue<'_> {
        ColumnValue::Number(Some(*self))
    }
}

impl CsvCell for Option<f64> {
    const KIND: ColumnKind = ColumnKind::Number;

    fn value(&self) -> ColumnValue<'_> {
        ColumnValue::Number(*self)
    }
}

impl CsvCell for u64 {
    const KIND: ColumnKind = ColumnKind::Count;

    fn value(&self) -> ColumnValue<'_> {
        ColumnValue::Count(*self)
    }
}

impl CsvCell for bool {
    const KIND: ColumnKind = ColumnKind::Flag;

    fn value(&self) -> ColumnValue<'_> {
        ColumnValue::Flag(*self)
    }
}

impl CsvCell for String {
    const KIND: ColumnKind = ColumnKind::Text;

    fn value(&self) -> ColumnValue<'_> {
        ColumnValue::Text(self)
    }
}

impl CsvCell for Option<String> {
    const KIND: ColumnKind = ColumnKind::Text;

    fn value(&self) -> ColumnValue<'_> {
        ColumnValue::Text(self.as_deref().unwrap_or_default())
    }
}

/// Column of a table with lines of type `L`.
#[derive(Debug)]
pub struct Column<L> {
    /// Name in the header. Its suffix is the unit.
    pub name: &'static str,
    /// Text for the reference page, as in the doc comment of the field.
    pub text: &'static str,
    /// Kind of the values.
    pub kind: ColumnKind,
    /// Whether a recording has the column in `/metrics`.
    pub is_recorded: bool,
    /// Function that returns the value in a line.
    pub value: for<'l> fn(&'l L) -> ColumnValue<'l>,
}

/// Flag of a column that a recording has in `/metrics`.
pub const RECORDED: bool = true;

/// Table with one line for each value of the type.
pub trait Table: Sized + 'static {
    /// Name of the file.
    const FILE: &str;
    /// Columns in order.
    const COLUMNS: &'static [Column<Self>];

    /// Returns the header line.
    fn header() -> String {
        let names: Vec<&str> = Self::COLUMNS.iter().map(|column| column.name).collect();
        names.join(",") + "\n"
    }

    /// Appends the line to the text of the file.
    fn append_to(&self, text: &mut String) {
        for (index, column) in Self::COLUMNS.iter().enumerate() {
            if index > 0 {
                text.push(',');
            }
            append_value(text, (column.value)(self));
        }
        text.push('\n');
    }

    /// Returns the columns that a recording has in `/metrics`.
    fn recorded_columns() -> impl Iterator<Item = &'static Column<Self>> {
        Self::COLUMNS.iter().filter(|column| column.is_recorded)
    }

    /// Returns the table of the columns for the reference page, in Markdown.
    fn reference_table() -> String {
        let row =
            |column: &Column<Self>| format!("| `{}` | {} |\n", column.name, column.text.trim());
        let rows: String = Self::COLUMNS.iter().map(row).collect();
        format!("| column | meaning |\n|---|---|\n{rows}")
    }
}

fn append_value(text: &mut String, value: ColumnValue<'_>) {
    match value {
        ColumnValue::Number(None) => {}
        // The formatter of the standard library is slow for shortest digits.
        ColumnValue::Number(Some(number)) => {
            text.push_str(format_shortest(&mut zmij::Buffer::new(), number))
        }
        ColumnValue::Decimal(number) => {
            let mut digits = zmij::Buffer::new();
            match format_shortest(&mut digits, number) {
                exponent if exponent.contains('e') => text.push_str(&number.to_string()),
                plain => text.push_str(plain),
            }
        }
        ColumnValue::Count(count) => text.push_str(&count.to_string()),
        ColumnValue::Flag(flag) => text.push(if flag { '1' } else { '0' }),
        ColumnValue::Text(field) if field.contains([',', '"', '\n', '\r']) => {
            text.extend(["\"", &field.replace('"', "\"\""), "\""]);
        }
        ColumnValue::Text(field) => text.push_str(field),
    }
}

/// Formats a number in its shortest form.
pub fn format_number(number: f64) -> String {
    format_shortest(&mut zmij::Buffer::new(), number).to_owned()
}

fn format_shortest(digits: &mut zmij::Buffer, number: f64) -> &str {
    let text = digits.format(number);
    text.strip_suffix(".0").unwrap_or(text)
}

/// Declares a struct whose fields are the columns of a table, in order.
///
/// A column has the name of its field, or the one after `as`. After the type there may be `as` and the form of
/// [`Value`] in which the column is written, and `=> RECORDED` for a column that a recording has in `/metrics`.
macro_rules! table {
    (
        $(#[$meta:meta])*
        $vis:vis struct $Line:ident in $file:literal {
            $(
                $(#[doc = $text:literal])+
                $(#[serde($($serde:tt)*)])?
                pub $field:ident $(as $name:literal)?: $type:ty $(as $form:ident)? $(=> $flag:ident)?
            ),* $(,)?
        }
    ) => {
        $(#[$meta])*
        $vis struct $Line {
            $(
                $(#[doc = $text])+
                $(#[serde($($serde)*)])?
                $(#[serde(rename = $name)])?
                pub $field: $type,
            )*
        }

        impl $crate::columns::Table for $Line {
            const FILE: &str = $file;
            const COLUMNS: &'static [$crate::columns::Column<$Line>] = &[$(
                $crate::columns::Column {
                    name: $crate::columns::table!(@name $field $($name)?),
                    text: concat!($($text),+),
                    kind: <$type as $crate::columns::CsvCell>::KIND,
                    is_recorded: false $(|| $crate::columns::$flag)?,
                    value: |line: &$Line| $crate::columns::table!(@value line $field $($form)?),
                },
            )*];
        }
    };
    (@name $field:ident) => { stringify!($field) };
    (@name $field:ident $name:literal) => { $name };
    (@value $line:ident $field:ident) => { $crate::columns::CsvCell::value(&$line.$field) };
    (@value $line:ident $field:ident $form:ident) => {
        $crate::columns::ColumnValue::$form($line.$field)
    };
}
pub(crate) use table;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::PairDistance;
    use crate::metrics::summary::{LatencyInterval, StageLatency};
    use crate::results::tables::{EventLine, MessageLine, SampleLine};

    fn text(value: ColumnValue<'_>) -> String {
        let mut text = String::new();
        append_value(&mut text, value);
        text
    }

    #[test]
    fn numbers_have_shortest_digits_and_text_is_quoted_if_needed() {
        assert_eq!(text(ColumnValue::Number(Some(2.0))), "2");
        assert_eq!(text(ColumnValue::Number(Some(0.1 + 0.2))), "0.30000000000000004");
        assert_eq!(text(ColumnValue::Number(Some(1e-7))), "1e-7");
        assert_eq!(text(ColumnValue::Decimal(1e-7)), "0.0000001");
        assert_eq!(text(ColumnValue::Decimal(0.05)), "0.05");
        assert_eq!(text(ColumnValue::Number(None)), "");
        assert_eq!(text(ColumnValue::Flag(true)), "1");
        assert_eq!(text(ColumnValue::Text("exit code 4")), "exit code 4");
        assert_eq!(text(ColumnValue::Text("a, \"b\"")), "\"a, \"\"b\"\"\"");
    }

    /// Returns the columns of a table whose text does not name the unit of the column's name.
    fn columns_without_unit<L: Table>() -> Vec<&'static str> {
        let units = [
            ("_rad_s", "rad/s"),
            ("_m_s", "m/s"),
            ("_rad", "rad"),
            ("_ns", "ns"),
            ("_m", "m"),
            ("_s", "s"),
        ];
        let wrong = L::COLUMNS.iter().filter(|column| {
            let unit = units.iter().find(|(suffix, _)| column.name.ends_with(suffix));
            let numbers = [ColumnKind::Number, ColumnKind::Count].contains(&column.kind);
            numbers && unit.is_some_and(|(_, unit)| !column.text.contains(&format!(", {unit}")))
        });
        wrong.map(|column| column.name).collect()
    }

    #[test]
    fn text_of_every_column_names_the_unit_of_its_name() {
        assert_eq!(columns_without_unit::<SampleLine>(), [""; 0]);
        assert_eq!(columns_without_unit::<EventLine>(), [""; 0]);
        assert_eq!(columns_without_unit::<MessageLine>(), [""; 0]);
        assert_eq!(columns_without_unit::<PairDistance>(), [""; 0]);
        assert_eq!(columns_without_unit::<StageLatency>(), [""; 0]);
        assert_eq!(columns_without_unit::<LatencyInterval>(), [""; 0]);
    }
}
