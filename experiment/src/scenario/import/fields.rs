//! Rows and fields of separated text. The separator is detected: commas, semicolons, tabs or spaces.

use std::ops::Range;

use crate::scenario::diagnostic::{Diagnostic, SourceText};

/// A field without surrounding spaces and quotes, and its byte range in the text.
#[derive(Debug, Clone)]
pub(super) struct TextField<'t> {
    pub(super) text: &'t str,
    pub(super) span: Range<usize>,
}

/// A line with at least one field.
pub(super) type FieldRow<'t> = Vec<TextField<'t>>;

/// The separator of two fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    Comma,
    Semicolon,
    Tab,
    /// One or more spaces or tabs.
    Space,
}

impl Separator {
    /// Returns the name of the separator in messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Separator::Comma => "comma",
            Separator::Semicolon => "semicolon",
            Separator::Tab => "tab",
            Separator::Space => "space",
        }
    }

    fn is_separator(self, c: char) -> bool {
        match self {
            Separator::Comma => c == ',',
            Separator::Semicolon => c == ';',
            Separator::Tab => c == '\t',
            Separator::Space => c.is_whitespace(),
        }
    }
}

/// All rows of a text.
#[derive(Debug)]
pub(super) struct SeparatedText<'t> {
    pub(super) separator: Separator,
    pub(super) rows: Vec<FieldRow<'t>>,
}

impl SeparatedText<'_> {
    /// Returns the number in a field. A decimal comma is accepted unless commas separate the fields.
    pub(super) fn parse_number(&self, text: &str) -> Option<f64> {
        parse_number(text, self.separator)
    }
}

/// Splits a text into rows and fields. Skips empty lines and lines that begin with `#`. Fails if a field contains a
/// quote.
pub(super) fn split_fields<'t>(
    source: &SourceText,
    text: &'t str,
) -> Result<SeparatedText<'t>, Diagnostic> {
    let mut lines: Vec<(usize, &str)> = Vec::new();
    let mut at = 0;
    for line in text.split(['\n', '\r']) {
        if !line.trim().is_empty() && !line.trim_start().starts_with('#') {
            lines.push((at, line));
        }
        at += line.len() + 1;
    }
    let declared = lines.first().and_then(|(_, line)| declared_separator(line));
    if declared.is_some() {
        lines.remove(0);
    }
    let separator = declared.unwrap_or_else(|| detect_separator(&lines));
    let row = |(at, line): (usize, &'t str)| split_line(source, line, at, separator);
    Ok(SeparatedText { separator, rows: lines.into_iter().map(row).collect::<Result<_, _>>()? })
}

/// Returns the separator that spreadsheets declare in a first line `sep=;`.
fn declared_separator(line: &str) -> Option<Separator> {
    let (key, value) = line.trim_matches(['"', ' ']).split_at_checked(4)?;
    match (key.to_ascii_lowercase().as_str(), value) {
        ("sep=", ",") => Some(Separator::Comma),
        ("sep=", ";") => Some(Separator::Semicolon),
        ("sep=", "\t") => Some(Separator::Tab),
        ("sep=", " ") => Some(Separator::Space),
        _ => None,
    }
}

/// Returns the separator that occurs in most lines. In text separated by spaces or tabs, a comma in a number is a
/// decimal comma.
fn detect_separator(lines: &[(usize, &str)]) -> Separator {
    let is_in_most = |separator: Separator| {
        let has_separator =
            |line: &str| unquoted_characters(line.trim()).any(|(_, c)| separator.is_separator(c));
        let count = lines.iter().filter(|(_, line)| has_separator(line)).count();
        count > 0 && 2 * count >= lines.len()
    };
    let is_list_of_numbers = |field: &str| {
        let mut parts = field.split_whitespace().map(|part| parse_number(part, Separator::Comma));
        field.trim().contains(char::is_whitespace) && parts.all(|part| part.is_some())
    };
    let commas_separate = || !lines.iter().any(|(_, line)| line.split(',').any(is_list_of_numbers));
    if is_in_most(Separator::Semicolon) {
        Separator::Semicolon
    } else if is_in_most(Separator::Comma) && commas_separate() {
        Separator::Comma
    } else if is_in_most(Separator::Tab) {
        Separator::Tab
    } else if is_in_most(Separator::Space) {
        Separator::Space
    } else {
        Separator::Comma
    }
}

/// Returns the characters outside of double quotes, with their byte offsets.
fn unquoted_characters(line: &str) -> impl Iterator<Item = (usize, char)> {
    let mut quoted = false;
    line.char_indices().filter(move |(_, c)| {
        quoted ^= *c == '"';
        !quoted && *c != '"'
    })
}

/// Splits the line that begins at byte `line_start` of the text.
fn split_line<'t>(
    source: &SourceText,
    line: &'t str,
    line_start: usize,
    separator: Separator,
) -> Result<FieldRow<'t>, Diagnostic> {
    let mut row = Vec::new();
    let mut start = 0;
    let separators = unquoted_characters(line).filter(|(_, c)| separator.is_separator(*c));
    let separators: Vec<_> = separators.chain([(line.len(), ' ')]).collect();
    for (end, c) in separators {
        let field = &line[start..end];
        let trimmed = field.trim();
        let field_start = line_start + start + (field.len() - field.trim_start().len());
        start = end + c.len_utf8();
        if trimmed.is_empty() && separator == Separator::Space {
            continue;
        }
        let inner = trimmed.strip_prefix('"').and_then(|text| text.strip_suffix('"'));
        let field_start = field_start + usize::from(inner.is_some());
        let text = inner.unwrap_or(trimmed);
        let span = field_start..field_start + text.len();
        if text.contains('"') {
            return Err(source.error_at(
                &span,
                format!("a quotation mark is inside the field {text:?}"),
                "expected names and numbers without quotes in them",
            ));
        }
        row.push(TextField { text, span });
    }
    Ok(row)
}

/// Parses a finite number, or `true` as 1 and `false` as 0.
fn parse_number(text: &str, separator: Separator) -> Option<f64> {
    if text.eq_ignore_ascii_case("true") || text.eq_ignore_ascii_case("false") {
        return Some(f64::from(text.len() == "true".len()));
    }
    let number = match text.matches(',').count() {
        1 if separator != Separator::Comma && !text.contains('.') => text.replace(',', ".").parse(),
        _ => text.parse::<f64>(),
    };
    number.ok().filter(|number| number.is_finite())
}
