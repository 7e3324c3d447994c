//! Secret in the address. It grants permission to watch the run and, with `--view-control`, to send requests.

use std::fmt;
use std::fs::File;
use std::hint::black_box;
use std::io::{self, Read as _};

/// 128 random bits.
#[derive(Clone, Copy)]
pub(crate) struct Token(u128);

impl Token {
    /// Draws a token from the operating system's random numbers.
    pub(crate) fn draw() -> io::Result<Token> {
        let mut bytes = [0; 16];
        File::open("/dev/urandom")?.read_exact(&mut bytes)?;
        Ok(Token(u128::from_le_bytes(bytes)))
    }

    /// Returns whether the text is this token, in constant time, so that the duration reveals nothing about
    /// the token.
    pub(crate) fn matches(self, text: &str) -> bool {
        let is_hexadecimal = text.len() == 32 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        let bits = u128::from_str_radix(text, 16).unwrap_or_default();
        let differs = black_box(bits ^ self.0);
        is_hexadecimal && differs == 0
    }
}

impl fmt::Display for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:032x}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn token_matches_its_exact_text_only(bits in any::<u128>(), flip in 0..128, other in ".{0,40}") {
            prop_assert_ne!(Token::draw().unwrap().0, bits);
            let token = Token(bits);
            let written = token.to_string();
            prop_assert_eq!(written.len(), 32);
            prop_assert!(token.matches(&written));
            prop_assert!(!Token(bits ^ (1u128 << flip)).matches(&written));
            prop_assert!(!token.matches(&written[1..]));
            let longer = format!("0{written}");
            prop_assert!(!token.matches(&longer));
            prop_assert!(other == written || !token.matches(&other));
        }
    }
}
