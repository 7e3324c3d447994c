//! An adjacency matrix in CSV: row i, column j is not 0 where robot i receives from robot j. (6)
//!
//! Names or numbers of robots may precede the matrix in a row, a column, or both. Without them, rows and columns are
//! in the order of the robots. A Laplacian or an edge list is rejected with a message that names it.

use std::ops::Range;

use super::fields::{self, FieldRow, SeparatedText, Separator, TextField};
use super::{ImportedGraph, ImportedGraphBuilder, NodeId};
use crate::scenario::diagnostic::{Diagnostic, SourceText};

/// Titles of the two columns of an edge list, in lower case.
const EDGE_LIST_TITLES: &[(&str, &str)] = &[
    ("source", "target"),
    ("from", "to"),
    ("src", "dst"),
    ("src", "dest"),
    ("tail", "head"),
    ("node1", "node2"),
    ("node_1", "node_2"),
    ("sender", "receiver"),
];
/// Words that tools write for a missing number, in lower case.
const MISSING_NUMBER_WORDS: &[&str] = &["", "nan", "na", "n/a", "none", "null", "inf", "-inf"];
const SQUARE_MATRIX_REMEDY: &str =
    "expected a square matrix: row i, column j is 1 where robot i hears robot j, else 0";

pub(super) fn read(
    source: &SourceText,
    text: &str,
    robot_keys: &[&str],
) -> Result<ImportedGraph, Diagnostic> {
    let fields = fields::split_fields(source, text)?;
    if fields.rows.is_empty() {
        let expected = "expected a row for each robot";
        return Err(source.error_at(&(0..0), "the matrix has no rows", expected));
    }
    let matrix = MatrixText { source, fields };
    matrix.build_graph(robot_keys).map_err(|error| matrix.edge_list_error().unwrap_or(error))
}

/// The fields of a file.
struct MatrixText<'a, 't> {
    source: &'a SourceText,
    fields: SeparatedText<'t>,
}

/// A square matrix with its row and column labels, if the file has any.
struct LabeledMatrix<'t> {
    column_labels: Option<FieldRow<'t>>,
    row_labels: Option<FieldRow<'t>>,
    body: Vec<FieldRow<'t>>,
}

impl<'t> MatrixText<'_, 't> {
    fn build_graph(&self, robot_keys: &[&str]) -> Result<ImportedGraph, Diagnostic> {
        let labeled = self.separate_labels()?;
        let values = self.parse_values(&labeled)?;
        self.refuse_negative_values(&labeled, &values)?;
        let mut builder = ImportedGraphBuilder::new(self.source, robot_keys);
        for i in 0..labeled.body.len() {
            let (name, span) = self.node_id(&labeled, i)?;
            builder.add_node(name, span, Vec::new())?;
        }
        for (i, row) in values.iter().enumerate() {
            for (j, value) in row.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                let cell = &labeled.body[i][j];
                let endpoint =
                    |node: usize| (builder.network.nodes[node].name.clone(), cell.span.clone());
                let endpoints = [endpoint(j), endpoint(i)];
                builder.add_edge(endpoints, true, cell.span.clone(), Vec::new())?;
                if *value != 1.0 && builder.network.first_weight.is_none() {
                    builder.network.first_weight = Some((cell.text.to_owned(), cell.span.clone()));
                }
            }
        }
        Ok(builder.network)
    }

    /// Separates labels from the matrix by the shape: with a row of labels there is one row more than columns, with a
    /// column of labels one column more than rows. With both or neither, the first field decides.
    fn separate_labels(&self) -> Result<LabeledMatrix<'t>, Diagnostic> {
        let mut rows = self.fields.rows.clone();
        drop_trailing_separators(&mut rows);
        let (height, width) = (rows.len(), rows[rows.len() - 1].len());
        if let Some(row) = rows[1..].iter().find(|row| row.len() != width) {
            return Err(self.row_length_error(row, &rows[height - 1]));
        }
        let first = &rows[0];
        let column: FieldRow<'_> = rows[1..].iter().map(|row| row[0].clone()).collect();
        let (column_labels, row_labels) = if width == height && first.len() == width {
            let both = self.has_both_labels(first, &column);
            (both, both)
        } else if width == height && first.len() + 1 == width {
            (true, true)
        } else if width + 1 == height
            && first.len() == width
            && self.are_labels(first)
            && (width > 1 || self.fields.parse_number(rows[1][0].text).is_some())
        {
            (true, false)
        } else if width == height + 1 && first.len() == width {
            let column: FieldRow<'_> = rows.iter().map(|row| row[0].clone()).collect();
            if !self.are_labels(&column) {
                return Err(self.not_square_error(height, width));
            }
            (false, true)
        } else if first.len() != width {
            return Err(self.row_length_error(first, &rows[height - 1]));
        } else {
            return Err(self.not_square_error(height, width));
        };
        let column_labels = column_labels.then(|| rows.remove(0));
        let column_labels =
            column_labels.map(|mut row| row.split_off(row.len() + usize::from(row_labels) - width));
        let row_labels = row_labels.then(|| rows.iter_mut().map(|row| row.remove(0)).collect());
        Ok(LabeledMatrix { column_labels, row_labels, body: rows })
    }

    /// Returns whether a square of fields has both a row and a column of labels. `first` is the first row, and `column`
    /// the first column below the corner.
    fn has_both_labels(&self, first: &FieldRow<'_>, column: &FieldRow<'_>) -> bool {
        let column_labels = &first[1..];
        let labels_agree =
            column_labels.iter().map(|cell| cell.text).eq(column.iter().map(|cell| cell.text));
        let is_label = |cell: &TextField<'_>| self.is_label(cell);
        let corner = self.fields.parse_number(first[0].text).is_none();
        let labels = column_labels.iter().any(is_label)
            || first_if_consecutive(column_labels).is_some()
            || labels_agree;
        !column_labels.is_empty() && (column_labels.iter().all(is_label) || (corner && labels))
    }

    /// Returns whether a row or column of fields consists of names, or of consecutive robot numbers. Two fields 0 and 1
    /// do not count as numbers, because they may be part of the matrix.
    fn are_labels(&self, cells: &[TextField<'_>]) -> bool {
        let are_numbers = match first_if_consecutive(cells) {
            Some(0) => cells.len() > 2,
            Some(_) => cells.len() > 1,
            None => false,
        };
        are_numbers || cells.iter().any(|cell| self.is_label(cell))
    }

    fn is_label(&self, cell: &TextField<'_>) -> bool {
        self.fields.parse_number(cell.text).is_none() && !is_missing_number(cell.text)
    }

    /// Returns the name of robot `i`. Labels with names take precedence over labels with numbers.
    fn node_id(
        &self,
        labeled: &LabeledMatrix<'t>,
        i: usize,
    ) -> Result<(NodeId, Range<usize>), Diagnostic> {
        let LabeledMatrix { column_labels, row_labels, body } = labeled;
        let cell = match (row_labels, column_labels) {
            (Some(row_labels), Some(column_labels))
                if row_labels[i].text == column_labels[i].text =>
            {
                &row_labels[i]
            }
            (Some(row_labels), Some(column_labels)) => {
                match (
                    first_if_consecutive(row_labels).is_some(),
                    first_if_consecutive(column_labels).is_some(),
                ) {
                    (true, false) => &column_labels[i],
                    (false, true) => &row_labels[i],
                    _ => {
                        let (row_label, column_label) = (&row_labels[i], &column_labels[i]);
                        return Err(self.source.error_at(
                            &row_label.span,
                            format!(
                                "the row in line {} is called {:?}, but the column with the same index {:?}",
                                self.source.line_number_at(row_label.span.start),
                                row_label.text,
                                column_label.text
                            ),
                            "expected the same names in the same order above and on the left",
                        ));
                    }
                }
            }
            (Some(cells), None) | (None, Some(cells)) => &cells[i],
            (None, None) => return Ok((NodeId::Number(i as i64), body[i][0].span.clone())),
        };
        Ok((NodeId::from_text(cell.text), cell.span.clone()))
    }

    fn parse_values(&self, labeled: &LabeledMatrix<'_>) -> Result<Vec<Vec<f64>>, Diagnostic> {
        let value = |cell: &TextField<'_>| {
            self.fields.parse_number(cell.text).ok_or_else(|| {
                let what = match cell.text {
                    "" => "a field of the matrix is empty".to_owned(),
                    text => format!("a field of the matrix is {text:?}"),
                };
                let expected = match is_missing_number(cell.text) {
                    true => "expected 0 where the row's robot does not hear the column's",
                    false => {
                        "expected a number: 0, or something else where the row's robot hears the column's"
                    }
                };
                self.source.error_at(&cell.span, what, expected)
            })
        };
        labeled.body.iter().map(|row| row.iter().map(value).collect()).collect()
    }

    /// Fails if a number is negative, as in a Laplacian or with signed weights.
    fn refuse_negative_values(
        &self,
        labeled: &LabeledMatrix<'_>,
        values: &[Vec<f64>],
    ) -> Result<(), Diagnostic> {
        let fields = || {
            let row = |(i, row): (usize, &Vec<f64>)| {
                row.iter().enumerate().map(move |(j, value)| (i, j, *value)).collect::<Vec<_>>()
            };
            values.iter().enumerate().flat_map(row)
        };
        let Some((i, j, value)) = fields().find(|(_, _, value)| *value < 0.0) else {
            return Ok(());
        };
        let span = &labeled.body[i][j].span;
        for (sign, name, remedy) in [
            (1.0, "a Laplacian", "(L < 0)"),
            (-1.0, "a Laplacian with its sign turned", "(L > 0) off the diagonal"),
        ] {
            let is_one =
                fields().all(|(i, j, value)| (i == j) == (sign * value > 0.0) || value == 0.0);
            if is_one && fields().any(|(i, j, value)| i == j && value != 0.0) {
                let message = format!(
                    "the matrix is {name}: the sign of its diagonal is opposite to that of its other elements"
                );
                let expected = format!(
                    "expected the adjacency matrix: 1 where robot i hears robot j, 0 elsewhere and on the \
                     diagonal; with numpy, {remedy}.astype(int)"
                );
                return Err(self.source.error_at(span, message, expected));
            }
        }
        Err(self.source.error_at(
            span,
            format!("a field of the matrix is {value}: an edge has no sign, so none repels"),
            "expected 1 where the row's robot hears the column's, else 0: laws treat all neighbors alike",
        ))
    }

    fn row_length_error(&self, row: &FieldRow<'_>, other: &FieldRow<'_>) -> Diagnostic {
        let line = |row: &FieldRow<'_>| self.source.line_number_at(row[0].span.start);
        self.source.error_at(
            &row_span(row),
            format!(
                "line {} has {}, but line {} has {}, separated by {}s",
                line(row),
                format_count(row.len(), "field"),
                line(other),
                format_count(other.len(), "field"),
                self.fields.separator.name(),
            ),
            SQUARE_MATRIX_REMEDY,
        )
    }

    fn not_square_error(&self, height: usize, width: usize) -> Diagnostic {
        let (rows, fields) = (format_count(height, "row"), format_count(width, "field"));
        let (separated, expected) = match width {
            1 => {
                (String::new(), "expected fields that commas, semicolons, tabs or spaces separate")
            }
            _ => {
                (format!(", separated by {}s", self.fields.separator.name()), SQUARE_MATRIX_REMEDY)
            }
        };
        let message =
            format!("the file has {rows} of {fields}{separated}, which is no square matrix");
        self.source.error_at(&row_span(&self.fields.rows[0]), message, expected)
    }

    /// Returns the error for a file that is not a matrix but an edge list or an adjacency list; `None` otherwise.
    fn edge_list_error(&self) -> Option<Diagnostic> {
        let rows = &self.fields.rows;
        let is_name = |cell: &TextField<'_>| self.is_label(cell);
        let is_id = |cell: &TextField<'_>| cell.text.parse::<u32>().is_ok();
        let titles: Vec<String> =
            rows[0].iter().take(2).map(|cell| cell.text.to_ascii_lowercase()).collect();
        let has_titles = EDGE_LIST_TITLES.iter().any(|(a, b)| titles == [*a, *b]);
        // The third field, if there is one, is a weight, or networkx's table of attributes.
        let all_pairs = |is: &dyn Fn(&TextField<'_>) -> bool| {
            let row = |row: &FieldRow<'_>| match &row[..] {
                [from, to] => is(from) && is(to),
                [from, to, third, ..] => {
                    is(from) && is(to) && (!is_name(third) || third.text.starts_with('{'))
                }
                _ => false,
            };
            rows.iter().all(row)
        };
        let width = rows[0].len();
        let are_ids = all_pairs(&is_id) && rows.len() != width && width <= 3;
        let separator = match self.fields.separator {
            Separator::Comma => ", delimiter=\",\"",
            Separator::Semicolon => ", delimiter=\";\"",
            Separator::Tab => ", delimiter=\"\\t\"",
            Separator::Space => "",
        };
        let create = "create_using=nx.DiGraph";
        let (what, read) = if has_titles {
            let [from, to] = [rows[0][0].text, rows[0][1].text];
            let table = format!("pd.read_csv(file{})", separator.replace("delimiter", "sep"));
            ("an edge list", format!("from_pandas_edgelist({table}, {from:?}, {to:?}, {create})"))
        } else if are_ids || all_pairs(&is_name) {
            ("an edge list", format!("read_edgelist(file{separator}, {create})"))
        } else if rows.iter().any(|row| row.len() > 1) && rows.iter().flatten().all(is_name) {
            ("a list of neighbors", format!("read_adjlist(file{separator}, {create})"))
        } else {
            return None;
        };
        let remedy = format!(
            "{SQUARE_MATRIX_REMEDY}; networkx turns it into GraphML: nx.write_graphml(nx.{read}, \"graph.graphml\"), where a \
             target hears its source"
        );
        let message = match are_ids && !has_titles {
            true => format!("this is no square matrix; perhaps it is {what}"),
            false => format!("this is {what}, not an adjacency matrix"),
        };
        Some(self.source.error_at(&row_span(&rows[0]), message, remedy))
    }
}

/// Returns the first number if the fields are consecutive integers that start at 0 or 1.
fn first_if_consecutive(cells: &[TextField<'_>]) -> Option<usize> {
    let first = cells.first()?.text.parse().ok().filter(|first| *first <= 1)?;
    let is_next = |(i, cell): (usize, &TextField<'_>)| cell.text.parse() == Ok(first + i);
    cells.iter().enumerate().all(is_next).then_some(first)
}

/// Removes the empty last fields of all lines, as long as all lines after the first end with one.
fn drop_trailing_separators(rows: &mut [FieldRow<'_>]) {
    let ends_empty = |row: &FieldRow<'_>| row.len() > 1 && row[row.len() - 1].text.is_empty();
    loop {
        let (first, other_rows) = rows.split_first_mut().expect("there is a row");
        let Some(last) = other_rows.last() else {
            while ends_empty(first) {
                first.pop();
            }
            return;
        };
        let width = last.len();
        let has_trailing = first.len() < width || ends_empty(first);
        if has_trailing && other_rows.iter().all(|row| row.len() == width && ends_empty(row)) {
            let trailing = rows.iter_mut().filter(|row| ends_empty(row) && row.len() == width);
            trailing.for_each(|row| row.truncate(width - 1));
            continue;
        }
        while first.len() > width && ends_empty(first) {
            first.pop();
        }
        return;
    }
}

fn is_missing_number(text: &str) -> bool {
    MISSING_NUMBER_WORDS.contains(&text.to_ascii_lowercase().as_str())
}

fn row_span(row: &FieldRow<'_>) -> Range<usize> {
    row[0].span.start..row[row.len() - 1].span.end
}

fn format_count(number: usize, what: &str) -> String {
    format!("{number} {what}{}", if number == 1 { "" } else { "s" })
}
