//! How a mistake in a scenario is shown: what is wrong, where, and what was expected instead.
//!
//! A diagnostic is data first; [`Diagnostic::render`] makes the text, in which nothing of a file
//! reaches a terminal raw. It never decides whether the run goes on: the caller does, by
//! [`Severity`].

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use annotate_snippets::{Annotation, AnnotationKind, Level, Renderer, Snippet};
use protocol::visible::{lines, one_line};
use serde::Serialize;

/// Longest line that is shown as a snippet, bytes; longer ones are no scenario, but noise.
const SNIPPET_LINE_BYTES_MAX: usize = 1000;

/// Whether the scenario can be run all the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// It cannot.
    Error,
    /// It can, but the reader should know.
    Warning,
}

/// One mistake, or one thing to know, about a scenario.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{message}")]
pub struct Diagnostic {
    /// Whether the scenario can be run all the same.
    pub severity: Severity,
    /// What is wrong, with the offending value.
    pub message: String,
    /// What was expected in its place.
    pub expected: String,
    /// Line of the offending value, from 1; 0 where there is no place to point at.
    pub line: u32,
    /// Column of the offending value in characters, from 1; 0 where there is none.
    pub column: u32,
    place: Option<Box<Place>>,
}

/// Where a mistake stands.
#[derive(Debug, Clone, PartialEq)]
struct Place {
    spot: Spot,
    /// Where that file is named in another one.
    imported_by: Option<Spot>,
    /// What else a reader must know about it.
    note: Option<&'static str>,
}

/// A place in a file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Spot {
    /// As it is shown.
    file: Arc<str>,
    text: Arc<str>,
    /// First and last byte.
    span: [u32; 2],
    line: u32,
    column: u32,
}

impl Spot {
    /// The line on which it begins, with `mark` at the place; `None` if that is too long to show.
    /// One line is enough to point at: a value over several lines is underlined on its first.
    fn snippet<'s>(
        &'s self,
        mark: impl FnOnce(Range<usize>) -> Annotation<'s>,
    ) -> Option<Snippet<'s, Annotation<'s>>> {
        let [start, end] = self.span.map(|at| at as usize);
        let line_start = self.text[..start].rfind('\n').map_or(0, |at| at + 1);
        let line_end = self.text[start..].find('\n').map_or(self.text.len(), |at| start + at);
        if line_end - line_start > SNIPPET_LINE_BYTES_MAX {
            return None;
        }
        let end = end.min(line_end);
        let mut line = lines(&self.text[line_start..start]).into_owned();
        let marked_from = line.len();
        line += &lines(&self.text[start..end]);
        let marked = marked_from..line.len();
        line += &lines(self.text[end..line_end].trim_end_matches('\r'));
        let snippet = Snippet::source(line).line_start(self.line as usize);
        Some(snippet.path(self.file.as_ref()).annotation(mark(marked)))
    }
}

impl std::fmt::Display for Spot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}:{}:{}", self.file, self.line, self.column)
    }
}

impl Diagnostic {
    /// An error about a whole file or an argument: one line, without a snippet.
    pub fn plain(message: impl Into<String>, expected: impl Into<String>) -> Diagnostic {
        Diagnostic {
            severity: Severity::Error,
            message: message.into(),
            expected: expected.into(),
            line: 0,
            column: 0,
            place: None,
        }
    }

    /// The same, of a scenario that can be run all the same.
    pub fn as_warning(self) -> Diagnostic {
        Diagnostic { severity: Severity::Warning, ..self }
    }

    /// The text shown to people, without a newline at its end. `color`: with ANSI escapes.
    pub fn render(&self, color: bool) -> String {
        let (level, word) = match self.severity {
            Severity::Error => (Level::ERROR, "error"),
            Severity::Warning => (Level::WARNING, "warning"),
        };
        let (message, expected) = (one_line(&self.message), one_line(&self.expected));
        let Some(place) = &self.place else {
            return format!("{word}: {message}; {expected}");
        };
        let Place { spot, imported_by, note } = place.as_ref();
        let here = |span| AnnotationKind::Primary.span(span).label(expected.as_ref());
        let Some(snippet) = spot.snippet(here) else {
            let imported = imported_by.iter().map(|spot| format!("\n ::: {spot}: imported here"));
            return format!(
                "{word}: {message}; {expected}\n --> {spot}{}",
                imported.collect::<String>()
            );
        };
        let mut group = level.primary_title(message.as_ref()).element(snippet);
        if let Some(importer) = imported_by {
            let there = |span| AnnotationKind::Context.span(span).label("imported here");
            group = match importer.snippet(there) {
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

/// The text that places refer to, and under which name it is shown.
#[derive(Debug, Clone)]
pub struct Source {
    file: Arc<str>,
    text: Arc<str>,
    note: Option<&'static str>,
    imported_by: Option<Spot>,
    parts: Option<Box<Parts>>,
}

/// Where the parts of a text come from that was put together from two files.
#[derive(Debug, Clone)]
struct Parts {
    /// From where on in the text which part stands.
    starts: Vec<(usize, Origin)>,
    scenario: Source,
    graph: Source,
}

/// Where a part of such a text comes from.
#[derive(Debug, Clone)]
pub(crate) enum Origin {
    /// A copy of the scenario from this byte on.
    Scenario(usize),
    /// Something that stands there in the graph's file, written in other words.
    Graph(Range<usize>),
}

impl Source {
    /// `edited`: the text is not the file's own, because arguments changed it.
    pub fn new(file: &Path, text: &str, edited: bool) -> Source {
        Source {
            file: one_line(&file.display().to_string()).into(),
            text: text.into(),
            imported_by: None,
            note: edited.then_some(
                "--set, --fault and --seed are applied: lines are those of the resulting file",
            ),
            parts: None,
        }
    }

    /// The same text, which another file names at that place.
    pub(crate) fn imported_by(self, importer: Spot) -> Source {
        Source { imported_by: Some(importer), ..self }
    }

    /// A text put together from the scenario and a graph; its mistakes are shown in these.
    /// `starts`: from where on in the text which part stands, in order.
    pub(crate) fn spliced(
        file: &Path,
        text: &str,
        starts: Vec<(usize, Origin)>,
        scenario: Source,
        graph: Source,
    ) -> Source {
        let parts = Some(Box::new(Parts { starts, scenario, graph }));
        Source { parts, ..Source::new(file, text, false) }
    }

    /// An error at `span`, a range of bytes of the text.
    pub fn error(
        &self,
        span: &Range<usize>,
        message: impl Into<String>,
        expected: impl Into<String>,
    ) -> Diagnostic {
        if let Some(parts) = &self.parts {
            let part = parts.starts.partition_point(|(start, _)| *start <= span.start);
            match &parts.starts[part.saturating_sub(1)] {
                (start, Origin::Scenario(original)) => {
                    let length = match parts.starts.get(part) {
                        Some((next, _)) => span.end.min(*next).saturating_sub(span.start),
                        None => span.end.saturating_sub(span.start),
                    };
                    let at = original + span.start.saturating_sub(*start);
                    return parts.scenario.error(&(at..at + length), message, expected);
                }
                (_, Origin::Graph(origin)) => return parts.graph.error(origin, message, expected),
            }
        }
        let spot = self.spot(span);
        Diagnostic {
            severity: Severity::Error,
            message: message.into(),
            expected: expected.into(),
            line: spot.line,
            column: spot.column,
            place: Some(Box::new(Place {
                spot,
                imported_by: self.imported_by.clone(),
                note: self.note,
            })),
        }
    }

    /// That range of bytes of the text.
    pub(crate) fn spot(&self, span: &Range<usize>) -> Spot {
        let start = self.boundary(span.start);
        let end = self.boundary(span.end.max(start));
        let before = &self.text[..start];
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let small = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        Spot {
            file: Arc::clone(&self.file),
            text: Arc::clone(&self.text),
            span: [small(start), small(end)],
            line: small(before.matches('\n').count() + 1),
            column: small(before[line_start..].chars().count() + 1),
        }
    }

    /// Returns the line, from 1, of a byte of the text.
    pub(crate) fn line(&self, at: usize) -> u32 {
        self.spot(&(at..at)).line
    }

    /// Returns the file, line and column of a range of bytes. In a spliced text they are those of the file that it
    /// comes from.
    pub(crate) fn location(&self, span: &Range<usize>) -> String {
        let place = self.error(span, "", "").place.expect("an error of a text has a place");
        place.spot.to_string()
    }

    /// The nearest place at or before `at` where a character begins.
    fn boundary(&self, at: usize) -> usize {
        let mut at = at.min(self.text.len());
        while !self.text.is_char_boundary(at) {
            at -= 1;
        }
        at
    }
}

/// A number in a text: with an exponent where its digits would fill a line, below 1e-12 and from 1e16 on.
pub(super) struct Shown(pub(super) f64);

impl std::fmt::Display for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Shown(number) = *self;
        match number.abs() {
            size if size != 0.0 && !(1e-12..1e16).contains(&size) && size.is_finite() => {
                write!(f, "{number:e}")
            }
            _ => write!(f, "{number}"),
        }
    }
}

/// The one of `known` that was probably meant by `word`, if any is close enough.
pub fn meant<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<&'k str> {
    // No key is longer: a line of noise is no slip of the keyboard.
    let begins: String = word.chars().take(64).collect();
    let close = |candidate: &str| {
        let longest = word.chars().count().max(candidate.chars().count());
        let unit_forgotten =
            word.len() >= 3 && (candidate.starts_with(word) || word.starts_with(candidate));
        let distance = strsim::osa_distance(&begins, candidate);
        (distance <= (longest / 3).clamp(1, 3) || unit_forgotten).then_some(distance)
    };
    known
        .into_iter()
        .filter_map(|candidate| close(candidate).map(|distance| (distance, candidate)))
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// The first of these names, and how many there are if there are more than `most`.
pub fn listed(names: &[&str], most: usize) -> String {
    match names.len() {
        count if count > most => format!("{}, ... ({count} in all)", names[..most].join(", ")),
        _ => names.join(", "),
    }
}

#[cfg(test)]
mod tests {
    use protocol::visible::is_hidden;

    use super::*;

    #[test]
    fn any_span_in_any_text_can_be_shown() {
        let text = "ä\t\u{1b}\r\n\n€ = 3\u{0}\n最後";
        for start in 0..text.len() + 3 {
            for end in 0..text.len() + 3 {
                let error = Source::new(Path::new("t"), text, true).error(&(start..end), "m", "e");
                let shown = error.render(false);
                assert!(error.render(true).contains("\u{1b}["));
                assert!(!shown.is_empty() && !shown.contains('\u{1b}'), "{shown:?}");
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
            assert_eq!(Shown(number).to_string(), text);
            assert_eq!(text.parse(), Ok(number));
        }
        assert_eq!(Shown(f64::INFINITY).to_string(), "inf");
    }

    #[test]
    fn nothing_of_a_file_reaches_a_terminal_raw() {
        let text = "name = \"\u{1b}[2J\u{9b}\u{202e}\"\n";
        let importer = Source::new(Path::new("\u{7}.toml"), text, false).spot(&(0..4));
        for path in ["\u{1b}]0;x\u{7}.toml", "b\nc\u{202e}.toml"] {
            for text in [text, &format!("{text} # {}", "\u{1b}".repeat(2 * SNIPPET_LINE_BYTES_MAX))]
            {
                let source =
                    Source::new(Path::new(path), text, false).imported_by(importer.clone());
                for diagnostic in [
                    source.error(&(7..12), format!("`name` is {text}"), text),
                    Diagnostic::plain(format!("`{path}` is {text}"), text),
                ] {
                    let shown = diagnostic.render(false);
                    let raw = |c| is_hidden(c) && c != '\n';
                    assert!(!shown.contains(raw) && shown.lines().count() < 12, "{shown:?}");
                }
            }
        }
    }
}
