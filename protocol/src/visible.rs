//! Text from anywhere, made fit for a terminal: what would command it is written out instead.

use std::borrow::Cow;

/// Whether a character could command a terminal, or hide or reorder what stands around it: control
/// characters, line and paragraph separators, and marks of writing direction.
pub fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The text on one line, with every hidden character as an escape such as `\u{1b}`.
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, is_hidden, |c| c.escape_default().to_string())
}

/// The same, but line breaks and tabs stay.
pub fn lines(text: &str) -> Cow<'_, str> {
    let hidden = |c| is_hidden(c) && c != '\n' && c != '\t';
    escaped(text, hidden, |c| c.escape_default().to_string())
}

/// JSON that says the same; outside its strings it has no such character but line breaks.
pub fn json(text: &str) -> Cow<'_, str> {
    escaped(text, |c| is_hidden(c) && c != '\n', |c| format!("\\u{:04x}", u32::from(c)))
}

fn escaped(
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
    fn what_commands_a_terminal_is_written_out_and_the_rest_stays() {
        assert_eq!(one_line("a\u{1b}[2Jb\r\n"), r"a\u{1b}[2Jb\r\n");
        assert_eq!(one_line("\u{9b}31m \u{202e}"), r"\u{9b}31m \u{202e}");
        assert_eq!(lines("a\tb\n\u{7}c"), "a\tb\n\\u{7}c");
        assert_eq!(json("[\"\u{9b}\u{202e}\"]\n"), "[\"\\u009b\\u202e\"]\n");
        assert!(matches!(lines("grün, 最後\n"), Cow::Borrowed(_)));
    }
}
