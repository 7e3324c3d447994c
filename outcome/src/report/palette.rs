//! Colors and line styles: told apart by people who see colors differently, and in gray print.

use std::fmt;

/// A color by its red, green and blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Color(red, green, blue) = self;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}

/// How a line is broken up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dash {
    /// Not at all.
    Solid,
    /// Strokes.
    Dashed,
    /// Dots.
    Dotted,
    /// Both in turns.
    DashDotted,
}

/// How a line looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Its color.
    pub color: Color,
    /// Its dashes.
    pub dash: Dash,
    /// px.
    pub width: f64,
    /// 0 to 1.
    pub opacity: f64,
}

impl Line {
    /// A line of medium width.
    pub const fn solid(color: Color) -> Line {
        Line { color, dash: Dash::Solid, width: 1.2, opacity: 1.0 }
    }

    /// The same, broken up.
    pub const fn dashed(self, dash: Dash) -> Line {
        Line { dash, ..self }
    }

    /// The same, of another width, px.
    pub const fn width(self, width: f64) -> Line {
        Line { width, ..self }
    }

    /// The same, so that what is below it is seen as well.
    pub const fn opacity(self, opacity: f64) -> Line {
        Line { opacity, ..self }
    }

    /// What nobody is to follow by name.
    pub const CROWD: Line = Line::solid(GRAY).width(0.4).opacity(0.6);
}

/// What is written, and what bounds.
pub const BLACK: Color = Color(0, 0, 0);
/// What is there and not looked at.
pub const GRAY: Color = Color(0x80, 0x80, 0x80);
/// The paper.
pub const WHITE: Color = Color(0xff, 0xff, 0xff);
/// Okabe and Ito's vermilion: bounds that shall not be passed, and faults. No robot has it.
pub const VERMILION: Color = Color(0xd5, 0x5e, 0x00);
/// Of a curve that stands alone, and of the first robot.
pub const BLUE: Color = Color(0x00, 0x72, 0xb2);
/// Okabe and Ito's orange: hulls, and what is stale.
pub const ORANGE: Color = Color(0xe6, 0x9f, 0x00);

/// Of robots, in scenario order, and of other curves: each dark enough to be seen on white, after Okabe
/// and Ito as far as theirs are. `outcome/assets/page.css` has the same.
pub const COLORS: [Color; 9] = [
    BLUE,
    Color(0x92, 0x41, 0x7b),
    Color(0x00, 0x80, 0x60),
    Color(0x1a, 0x1d, 0x21),
    Color(0xa6, 0x6a, 0x00),
    Color(0xd8, 0x5f, 0x9c),
    Color(0x6b, 0x7a, 0x00),
    Color(0x6a, 0x51, 0xc9),
    Color(0x7a, 0x4b, 0x2a),
];
const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::DashDotted, Dash::Dotted];

/// The line of the robot at a place in the scenario, or of the `place`-th of other curves; 36 of them
/// differ, neighbors in color and dashes both.
pub fn line(place: usize) -> Line {
    Line::solid(color(place)).dashed(DASHES[place % DASHES.len()])
}

/// The color of the robot at a place in the scenario, in all figures and pictures.
pub fn color(place: usize) -> Color {
    COLORS[place % COLORS.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_those_of_the_page_and_lines_differ_from_each_other_and_from_faults() {
        let style = include_str!("../../assets/page.css");
        for (place, color) in COLORS.into_iter().enumerate() {
            assert!(style.contains(&format!("--c{place}: {color};")), "no {color}");
        }
        let lines: Vec<Line> = (0..36).map(line).collect();
        assert!((0..36).all(|i| !lines[..i].contains(&lines[i])));
        assert!(!COLORS.contains(&VERMILION) && !COLORS.contains(&GRAY));
    }
}
