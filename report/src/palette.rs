//! Colors and line styles: told apart by people who see colors differently, and in gray print.

use plotters::style::RGBColor;

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
    pub color: RGBColor,
    /// Its dashes.
    pub dash: Dash,
    /// In fifths of 2 px: 1 is a hair, 4 is bold.
    pub weight: u32,
    /// 0 to 1.
    pub opacity: f64,
}

impl Line {
    /// A line of medium weight.
    pub const fn solid(color: RGBColor) -> Line {
        Line { color, dash: Dash::Solid, weight: 3, opacity: 1.0 }
    }

    /// The same, broken up.
    pub const fn dashed(self, dash: Dash) -> Line {
        Line { dash, ..self }
    }

    /// The same, of another weight.
    pub const fn weight(self, weight: u32) -> Line {
        Line { weight, ..self }
    }

    /// What nobody is to follow by name.
    pub const CROWD: Line = Line { weight: 1, opacity: 0.6, ..Line::solid(GRAY) };
}

/// What is written, and what bounds.
pub const BLACK: RGBColor = RGBColor(0, 0, 0);
/// What is there and not looked at.
pub const GRAY: RGBColor = RGBColor(0x80, 0x80, 0x80);
/// The paper.
pub const WHITE: RGBColor = RGBColor(0xff, 0xff, 0xff);
/// Okabe and Ito's vermilion: bounds that shall not be passed, and faults.
pub const VERMILION: RGBColor = RGBColor(0xd5, 0x5e, 0x00);
/// Okabe and Ito's blue.
pub const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xb2);
/// Okabe and Ito's bluish green.
pub const GREEN: RGBColor = RGBColor(0x00, 0x9e, 0x73);
/// Okabe and Ito's orange.
pub const ORANGE: RGBColor = RGBColor(0xe6, 0x9f, 0x00);
const SKY: RGBColor = RGBColor(0x56, 0xb4, 0xe9);
const PURPLE: RGBColor = RGBColor(0xcc, 0x79, 0xa7);

const COLORS: [RGBColor; 7] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK];
const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::DashDotted, Dash::Dotted];

/// The line of the `place`-th of several; 28 of them differ, neighbors in color and dashes both.
pub fn line(place: usize) -> Line {
    Line::solid(COLORS[place % COLORS.len()]).dashed(DASHES[place % DASHES.len()])
}

/// The dashes of the `place`-th of several of one color.
pub fn dash(place: usize) -> Dash {
    DASHES[place % DASHES.len()]
}

/// The colors of robots in formation, in turns: none is that of the main leader, faults or the dead.
pub const FORMATION: [RGBColor; 5] = [BLUE, PURPLE, GREEN, BLACK, ORANGE];

/// The color of the `nth` robot of a role, by the role's word in a scene: one for each role, but
/// robots in formation are told apart.
pub fn of_robot(role: &str, nth: usize) -> RGBColor {
    match role {
        "main-leader" => VERMILION,
        "leader" => ORANGE,
        "contained" => GREEN,
        _ => FORMATION[nth % FORMATION.len()],
    }
}
