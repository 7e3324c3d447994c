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
/// Okabe and Ito's vermilion: bounds that shall not be passed, and faults. No robot has it.
pub const VERMILION: RGBColor = RGBColor(0xd5, 0x5e, 0x00);
/// Of a curve that stands alone, and of the first robot.
pub const BLUE: RGBColor = RGBColor(0x00, 0x72, 0xb2);
/// Okabe and Ito's orange: hulls, and what is stale.
pub const ORANGE: RGBColor = RGBColor(0xe6, 0x9f, 0x00);

/// Of robots, in scenario order, and of other curves: each dark enough to be seen on white, after Okabe
/// and Ito as far as theirs are. `outcome/assets/page.css` has the same.
pub const COLORS: [RGBColor; 9] = [
    BLUE,
    RGBColor(0x92, 0x41, 0x7b),
    RGBColor(0x00, 0x80, 0x60),
    RGBColor(0x1a, 0x1d, 0x21),
    RGBColor(0xa6, 0x6a, 0x00),
    RGBColor(0xd8, 0x5f, 0x9c),
    RGBColor(0x6b, 0x7a, 0x00),
    RGBColor(0x6a, 0x51, 0xc9),
    RGBColor(0x7a, 0x4b, 0x2a),
];
const DASHES: [Dash; 4] = [Dash::Solid, Dash::Dashed, Dash::DashDotted, Dash::Dotted];

/// The line of the robot at a place in the scenario, or of the `place`-th of other curves; 36 of them
/// differ, neighbors in color and dashes both.
pub fn line(place: usize) -> Line {
    Line::solid(color(place)).dashed(DASHES[place % DASHES.len()])
}

/// The color of the robot at a place in the scenario, in all figures and pictures.
pub fn color(place: usize) -> RGBColor {
    COLORS[place % COLORS.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_has_the_same_colors() {
        let style = include_str!("../../assets/page.css");
        for (place, RGBColor(r, g, b)) in COLORS.into_iter().enumerate() {
            let color = format!("--c{place}: #{r:02x}{g:02x}{b:02x};");
            assert!(style.contains(&color), "no {color}");
        }
    }

    #[test]
    fn lines_differ_and_no_robot_has_the_color_of_faults_or_of_the_dead() {
        let lines: Vec<Line> = (0..36).map(line).collect();
        assert!((0..36).all(|i| !lines[..i].contains(&lines[i])));
        assert!(!COLORS.contains(&VERMILION) && !COLORS.contains(&GRAY));
    }
}
