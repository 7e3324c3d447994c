//! Diagnostics of a scenario: message, source location and remedy.
//!
//! A diagnostic is data; [`Diagnostic::render`] returns its text, in which control characters of a file are escaped.
//! The caller decides by [`Severity`] whether the run continues.

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use annotate_snippets::{Annotation, AnnotationKind, Level, Renderer, Snippet};
use protocol::terminal_escape::{escape_lines, escape_to_one_line};
use serde::Serialize;

/// Maximum length of a line that is shown as a snippet, bytes. Longer lines are assumed to be no scenario.
const SNIPPET_LINE_BYTES_MAX: usize = 1000;

/// Severity of a diagnostic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The scenario cannot be run.
    Error,
    /// The scenario can be run.
    Warning,
}

/// An error or a warning about a scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct Diagnostic {
    /// Whether the problem is an error or a warning.
    pub severity: Severity,
    /// Problem, with the found value.
    pub message: String,
    /// Allowed values or remedy.
    pub expected: String,
    /// Line of the found value, from 1. 0 without a source location.
    pub line: u32,
    /// Column of the found value in characters, from 1. 0 without a source location.
    pub column: u32,
    context: Option<Box<ErrorContext>>,
}

/// Source location of a diagnostic, with its context.
#[derive(Debug, Clone, PartialEq)]
struct ErrorContext {
    location: SourceLocation,
    /// Location at which another file imports this one.
    import_location: Option<SourceLocation>,
    /// Additional sentence that is printed below the diagnostic.
    note: Option<&'static str>,
}

/// Source location: a range in a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SourceLocation {
    /// File name as it is shown.
    file: Arc<str>,
    text: Arc<str>,
    /// Byte range: start and end.
    span: [u32; 2],
    line: u32,
    column: u32,
}

impl SourceLocation {
    /// Returns the first line of the range with the annotation of `mark`, or `None` if the line is too long to show. A
    /// value over several lines is underlined on its first line.
    fn snippet<'s>(
        &'s self,
        annotate: impl FnOnce(Range<usize>) -> Annotation<'s>,
    ) -> Option<Snippet<'s, Annotation<'s>>> {
        let [start, end] = self.span.map(|position| position as usize);
        let line_start = self.text[..start].rfind('\n').map_or(0, |position| position + 1);
        let line_end =
            self.text[start..].find('\n').map_or(self.text.len(), |position| start + position);
        if line_end - line_start > SNIPPET_LINE_BYTES_MAX {
            return None;
        }
        let end = end.min(line_end);
        let mut line = escape_lines(&self.text[line_start..start]).into_owned();
        let marked_from = line.len();
        line += &escape_lines(&self.text[start..end]);
        let marked = marked_from..line.len();
        line += &escape_lines(self.text[end..line_end].trim_end_matches('\r'));
        let snippet = Snippet::source(line).line_start(self.line as usize);
        Some(snippet.path(self.file.as_ref()).annotation(annotate(marked)))
    }
}

impl std::fmt::Display for SourceLocation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}:{}", self.file, self.line, self.column)
    }
}

impl Diagnostic {
    /// Creates an error about a file or an argument, without a source location.
    pub fn without_location(message: impl Into<String>, expected: impl Into<String>) -> Diagnostic {
        Diagnostic {
            severity: Severity::Error,
            message: message.into(),
            expected: expected.into(),
            line: 0,
            column: 0,
            context: None,
        }
    }

    /// Returns the diagnostic as a warning.
    pub fn into_warning(self) -> Diagnostic {
        Diagnostic { severity: Severity::Warning, ..self }
    }

    /// Returns the text of the diagnostic without a newline at the end. `color`: with ANSI escapes.
    pub fn render(&self, color: bool) -> String {
        let (level, word) = match self.severity {
            Severity::Error => (Level::ERROR, "error"),
            Severity::Warning => (Level::WARNING, "warning"),
        };
        let (message, expected) =
            (escape_to_one_line(&self.message), escape_to_one_line(&self.expected));
        let Some(context) = &self.context else {
            return format!("{word}: {message}; {expected}");
        };
        let ErrorContext { location, import_location, note } = context.as_ref();
        let annotate = |span| AnnotationKind::Primary.span(span).label(expected.as_ref());
        let Some(snippet) = location.snippet(annotate) else {
            let imported_text =
                import_location.iter().map(|location| format!("\n ::: {location}: imported here"));
            return format!(
                "{word}: {message}; {expected}\n --> {location}{}",
                imported_text.collect::<String>()
            );
        };
        let mut group = level.primary_title(message.as_ref()).element(snippet);
        if let Some(importer) = import_location {
            let annotate_import = |span| AnnotationKind::Context.span(span).label("imported here");
            group = match importer.snippet(annotate_import) {
                Some(snippet) => group.element(snippet),
                None => group.element(Level::NOTE.message(format!("imported by {importer}"))),
            };
        }
        if let Some(note) = note {
            group = group.element(Level::NOTE.message(*note));
        }
        let renderer = if color { Renderer::styled() } else { Renderer::plain() };
        let rendered = renderer.render(&[group]);
        rendered.lines().map(str::trim_end).collect::<Vec<_>>().join("\n")
    }
}

/// Source text with its displayed file name.
#[derive(Debug, Clone)]
pub struct SourceText {
    file: Arc<str>,
    text: Arc<str>,
    note: Option<&'static str>,
    import_location: Option<SourceLocation>,
    parts: Option<Box<SourceParts>>,
}

/// Origins of the parts of a text that is composed of two files.
#[derive(Debug, Clone)]
struct SourceParts {
    /// Start of each part in the text, with its origin.
    part_starts: Vec<(usize, TextOrigin)>,
    scenario: SourceText,
    graph: SourceText,
}

/// Origin of a part of a composed text.
#[derive(Debug, Clone)]
pub(crate) enum TextOrigin {
    /// A copy of the scenario file from this byte on.
    Scenario(usize),
    /// Generated from this byte range of the graph file.
    Graph(Range<usize>),
}

impl SourceText {
    /// Creates a source. `edited`: the text differs from the file, because overrides were applied.
    pub fn new(file: &Path, text: &str, edited: bool) -> SourceText {
        SourceText {
            file: escape_to_one_line(&file.display().to_string()).into(),
            text: text.into(),
            import_location: None,
            note: edited.then_some(
                "--set, --fault and --seed are applied: lines are those of the resulting file",
            ),
            parts: None,
        }
    }

    /// Sets the location at which another file imports this one.
    pub(crate) fn with_import_location(self, importer: SourceLocation) -> SourceText {
        SourceText { import_location: Some(importer), ..self }
    }

    /// Creates the source of a text composed of the scenario and a graph file. Its diagnostics point into these files.
    /// `starts`: start of each part with its origin, in order.
    pub(crate) fn from_parts(
        file: &Path,
        text: &str,
        starts: Vec<(usize, TextOrigin)>,
        scenario: SourceText,
        graph: SourceText,
    ) -> SourceText {
        let parts = Some(Box::new(SourceParts { part_starts: starts, scenario, graph }));
        SourceText { parts, ..SourceText::new(file, text, false) }
    }

    /// Returns an error at the byte range `span`.
    pub fn error_at(
        &self,
        span: &Range<usize>,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        if let Some(parts) = &self.parts {
            let part = parts.part_starts.partition_point(|(start, _)| *start <= span.start);
            match &parts.part_starts[part.saturating_sub(1)] {
                (start, TextOrigin::Scenario(original)) => {
                    let length = match parts.part_starts.get(part) {
                        Some((next, _)) => span.end.min(*next).saturating_sub(span.start),
                        None => span.end.saturating_sub(span.start),
                    };
                    let at = original + span.start.saturating_sub(*start);
                    return parts.scenario.error_at(&(at..at + length), message, expected);
                }
                (_, TextOrigin::Graph(origin)) => {
                    return parts.graph.error_at(origin, message, expected);
                }
            }
        }
        let location = self.location(span);
        Diagnostic {
            severity: Severity::Error,
            message: message.into(),
            expected: expected.into(),
            line: location.line,
            column: location.column,
            context: Some(Box::new(ErrorContext {
                location,
                import_location: self.import_location.clone(),
                note: self.note,
            })),
        }
    }

    /// Returns the source location of a byte range.
    pub(crate) fn location(&self, span: &Range<usize>) -> SourceLocation {
        let start = self.floor_char_boundary(span.start);
        let end = self.floor_char_boundary(span.end.max(start));
        let before = &self.text[..start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        SourceLocation {
            file: Arc::clone(&self.file),
            text: Arc::clone(&self.text),
            span: [small(start), small(end)],
            line: small(before.matches('\n').count() + 1),
            column: small(before[line_start..].chars().count() + 1),
        }
    }

    /// Returns the line, from 1, of a byte of the text.
    pub(crate) fn line_number_at(&self, at: usize) -> u32 {
        self.location(&(at..at)).line
    }

    /// Returns the file, line and column of a range of bytes. In a spliced text they are those of the file that it
    /// comes from.
    pub(crate) fn original_location(&self, span: &Range<usize>) -> String {
        let context = self.error_at(span, "", "").context.expect("an error of a text has a place");
        context.location.to_string()
    }

    /// Returns the largest character boundary that is at most `position`.
    fn floor_char_boundary(&self, position: usize) -> usize {
        let mut position = position.min(self.text.len());
        while !self.text.is_char_boundary(position) {
            position -= 1;
        }
        position
    }
}

/// A number in a message. It has an exponent below 1e-12 and from 1e16 on, where its digits would fill a line.
pub(super) struct DisplayedNumber(pub(super) f64);

impl std::fmt::Display for DisplayedNumber {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let DisplayedNumber(number) = *self;
        match number.abs() {
            size if size != 0.0 && !(1e-12..1e16).contains(&size) && size.is_finite() => {
                write!(f, "{number:e}")
            }
            _ => write!(f, "{number}"),
        }
    }
}

/// Returns the most similar of the `known` words, or `None` if none is close enough.
pub fn most_similar_word<'k>(
    word: &str,
    known: impl IntoIterator<Item = &'k str>,
) -> Option<&'k str> {
    // No key is longer. A longer word is no typing error.
    let word_start: String = word.chars().take(64).collect();
    let distance_if_close = |candidate: &str| {
        let longest = word.chars().count().max(candidate.chars().count());
        let is_prefix =
            word.len() >= 3 && (candidate.starts_with(word) || word.starts_with(candidate));
        let distance = strsim::osa_distance(&word_start, candidate);
        (distance <= (longest / 3).clamp(1, 3) || is_prefix).then_some(distance)
    };
    known
        .into_iter()
        .filter_map(|candidate| distance_if_close(candidate).map(|distance| (distance, candidate)))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// Returns the first `count_max` names, and their number if there are more.
pub fn format_list(names: &[&str], count_max: usize) -> String {
    match names.len() {
        count if count > count_max => {
            format!("{}, ... ({count} in all)", names[..count_max].join(", "))
        }
        _ => names.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use protocol::terminal_escape::is_hidden;

    use super::*;

    #[test]
    fn any_span_in_any_text_can_be_shown() {
        let text = "ä\t\u{1b}\r\n\n€ = 3\u{0}\n最後";
        for start in 0..text.len() + 3 {
            for end in 0..text.len() + 3 {
                let error =
                    SourceText::new(Path::new("t"), text, true).error_at(&(start..end), "m", "e");
                let rendered = error.render(false);
                assert!(error.render(true).contains("\u{1b}["));
                assert!(!rendered.is_empty() && !rendered.contains('\u{1b}'), "{rendered:?}");
            }
        }
    }

    #[test]
    fn shown_number_is_short_and_reads_back() {
        for (number, text) in [
            (1e-320, "1e-320"),
            (-2.5e-300, "-2.5e-300"),
            (1e300, "1e300"),
            (1e-9, "0.000000001"),
            (0.1, "0.1"),
            (0.0, "0"),
            (1e9, "1000000000"),
        ] {
            assert_eq!(DisplayedNumber(number).to_string(), text);
            assert_eq!(text.parse(), Ok(number));
        }
        assert_eq!(DisplayedNumber(f64::INFINITY).to_string(), "inf");
    }

    #[test]
    fn control_characters_of_a_file_are_escaped() {
        let text = "name = \"\u{1b}[2J\u{9b}\u{202e}\"\n";
        let importer = SourceText::new(Path::new("\u{7}.toml"), text, false).location(&(0..4));
        for path in ["\u{1b}]0;x\u{7}.toml", "b\nc\u{202e}.toml"] {
            for text in [text, &format!("{text} # {}", "\u{1b}".repeat(2 * SNIPPET_LINE_BYTES_MAX))]
            {
                let source = SourceText::new(Path::new(path), text, false)
                    .with_import_location(importer.clone());
                for diagnostic in [
                    source.error_at(&(7..12), format!("`name` is {text}"), text),
                    Diagnostic::without_location(format!("`{path}` is {text}"), text),
                ] {
                    let shown = diagnostic.render(false);
                    let raw = |c| is_hidden(c) && c != '\n';
                    assert!(!shown.contains(raw) && shown.lines().count() < 12, "{shown:?}");
                }
            }
        }
    }
}
