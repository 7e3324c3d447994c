//! Escaping of untrusted text for a terminal: characters that could control it are replaced by escapes.

use std::borrow::Cow;

/// Returns whether a character could control a terminal, or hide or reorder the text around it: control
/// characters, line and paragraph separators, and marks of writing direction.
pub fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// Returns the text on one line, with every hidden character as an escape such as `\u{1b}`.
pub fn escape_to_one_line(text: &str) -> Cow<'_, str> {
    escape_hidden(text, is_hidden, |c| c.escape_default().to_string())
}

/// Returns the text with every hidden character as an escape, except line breaks and tabs.
pub fn escape_lines(text: &str) -> Cow<'_, str> {
    let hidden = |c| is_hidden(c) && c != '\n' && c != '\t';
    escape_hidden(text, hidden, |c| c.escape_default().to_string())
}

/// Returns equivalent JSON without hidden characters, except line breaks outside of its strings.
pub fn escape_json(text: &str) -> Cow<'_, str> {
    escape_hidden(text, |c| is_hidden(c) && c != '\n', |c| format!("\\u{:04x}", u32::from(c)))
}

fn escape_hidden(
    text: &str,
    hidden: impl Fn(char) -> bool,
    escape: impl Fn(char) -> String,
) -> Cow<'_, str> {
    if !text.contains(&hidden) {
        return text.into();
    }
    let mut visible = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if hidden(c) {
            visible += &escape(c);
        } else {
            visible.push(c);
        }
    }
    visible.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_other_text_is_kept() {
        assert_eq!(escape_to_one_line("a\u{1b}[2Jb\r\n"), r"a\u{1b}[2Jb\r\n");
        assert_eq!(escape_to_one_line("\u{9b}31m \u{202e}"), r"\u{9b}31m \u{202e}");
        assert_eq!(escape_lines("a\tb\n\u{7}c"), "a\tb\n\\u{7}c");
        assert_eq!(escape_json("[\"\u{9b}\u{202e}\"]\n"), "[\"\\u009b\\u202e\"]\n");
        assert!(matches!(escape_lines("grün, 最後\n"), Cow::Borrowed(_)));
    }
}
