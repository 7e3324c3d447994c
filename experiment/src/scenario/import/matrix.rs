//! An adjacency matrix in CSV: row i, column j is not 0 where robot i hears robot j. (6)
//!
//! Names may stand in a row above, in a column on the left, or both; without, robots are meant in
//! their order.

use std::ops::Range;

use super::{Builder, Name, Network};
use crate::scenario::diagnostic::{Diagnostic, Source};

/// A field and its place.
type Cell<'t> = (&'t str, Range<usize>);

pub(super) fn read(
    source: &Source,
    text: &str,
    robot_keys: &[&str],
) -> Result<Network, Diagnostic> {
    let rows = rows(source, text)?;
    let Some((first, below)) = rows.split_first() else {
        return Err(source.error(
            &(0..0),
            "the matrix has no rows",
            "expected a row for each robot",
        ));
    };
    let is_number = |cell: &Cell<'_>| cell.0.parse::<f64>().is_ok();
    let corner_empty = first[0].0.is_empty();
    let names_above = corner_empty || first.iter().skip(1).any(|cell| !is_number(cell));
    let body = if names_above { below } else { &rows[..] };
    let names_left = corner_empty || body.first().is_some_and(|row| !is_number(&row[0]));

    let size = body.len();
    let left = usize::from(names_left);
    for row in &rows {
        // Above a column of names there may be nothing at all.
        let short_header = names_above && names_left && row == first && row.len() == size;
        if row.len() != size + left && !short_header {
            return Err(source.error(
                &(row[0].1.start..row[row.len() - 1].1.end),
                format!(
                    "a row has {} fields, but there are {size} rows",
                    row.len() - left.min(row.len())
                ),
                "expected a square matrix: row i, column j is 1 where robot i hears robot j",
            ));
        }
    }
    let above: Option<&[Cell<'_>]> = names_above.then(|| &first[first.len() - size..]);
    let mut builder = Builder::new(source, robot_keys);
    for (i, row) in body.iter().enumerate() {
        let (name, span) = match (names_left.then(|| &row[0]), above.map(|above| &above[i])) {
            (Some(left), Some(above)) if left.0 != above.0 => {
                return Err(source.error(
                    &left.1,
                    format!(
                        "row {} is called {:?}, but column {} {:?}",
                        i + 1,
                        left.0,
                        i + 1,
                        above.0
                    ),
                    "expected the same names in the same order above and on the left",
                ));
            }
            (Some(cell), _) | (None, Some(cell)) => (Name::read(cell.0), cell.1.clone()),
            (None, None) => (Name::Number(i as i64), row[0].1.clone()),
        };
        builder.node(name, span, Vec::new())?;
    }
    for (i, row) in body.iter().enumerate() {
        for (j, (field, span)) in row[left..].iter().enumerate() {
            let hears = match field.parse::<f64>() {
                Ok(number) if number.is_finite() => number != 0.0,
                _ => {
                    return Err(source.error(
                        span,
                        format!("row {}, column {} is {field:?}", i + 1, j + 1),
                        "expected a number: 0, or something else where the row's robot hears the \
                         column's",
                    ));
                }
            };
            if hears {
                let end = |node: usize| (builder.network.nodes[node].name.clone(), span.clone());
                let ends = [end(j), end(i)];
                builder.link(ends, true, span.clone(), Vec::new())?;
            }
        }
    }
    Ok(builder.network)
}

/// All fields, trimmed; no row is empty.
fn rows<'t>(source: &Source, text: &'t str) -> Result<Vec<Vec<Cell<'t>>>, Diagnostic> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .from_reader(text.as_bytes());
    let mut rows = Vec::new();
    let mut record = csv::StringRecord::new();
    loop {
        let more = reader.read_record(&mut record).map_err(|error| {
            source.error(&(0..0), format!("this is no CSV: {error}"), "expected a matrix")
        })?;
        if !more {
            return Ok(rows);
        }
        // Fields keep their order in the text, so each is looked for behind the one before it.
        let mut at = record.position().map_or(0, |position| position.byte() as usize);
        let mut row = Vec::new();
        for field in &record {
            let rest = text.get(at..).unwrap_or_default();
            let Some(found) = rest.find(field) else {
                return Err(source.error(
                    &(at..at),
                    format!("a quote stands within the field {field:?}"),
                    "expected names and numbers without quotes in them",
                ));
            };
            let start = at + found;
            at = start + field.len();
            let trimmed = text[start..at].trim();
            let lead = text[start..at].len() - text[start..at].trim_start().len();
            row.push((trimmed, start + lead..start + lead + trimmed.len()));
            // The comma; within quotes, the quote before it too.
            at += text[at..].find(',').map_or(0, |comma| comma + 1);
        }
        rows.push(row);
    }
}
