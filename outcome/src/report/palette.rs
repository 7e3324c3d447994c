//! Colors and line styles that are distinguishable with color vision deficiency and in gray print.

use std::fmt;

/// An sRGB color: red, green, blue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Color(pub u8, pub u8, pub u8);

impl fmt::Display for Color {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Color(red, green, blue) = self;
        write!(f, "#{red:02x}{green:02x}{blue:02x}")
    }
}

/// Dash pattern of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dash {
    /// Continuous line.
    Solid,
    /// Long dashes.
    Dashed,
    /// Dotted line.
    Dotted,
    /// Alternating dashes and dots.
    DashDotted,
}

/// Style of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineStyle {
    /// Color of the line.
    pub color: Color,
    /// Dash pattern.
    pub dash: Dash,
    /// Width, px.
    pub width: f64,
    /// Opacity of the line, from 0 (transparent) to 1.
    pub opacity: f64,
}

impl LineStyle {
    /// Returns a solid line of medium width.
    pub const fn solid(color: Color) -> LineStyle {
        LineStyle { color, dash: Dash::Solid, width: 1.2, opacity: 1.0 }
    }

    /// Returns the line with this dash pattern.
    pub const fn with_dash(self, dash: Dash) -> LineStyle {
        LineStyle { dash, ..self }
    }

    /// Returns the line with this width, px.
    pub const fn with_width(self, width: f64) -> LineStyle {
        LineStyle { width, ..self }
    }

    /// Returns the line with this opacity.
    pub const fn with_opacity(self, opacity: f64) -> LineStyle {
        LineStyle { opacity, ..self }
    }

    /// Style of curves without a name in the key.
    pub const UNNAMED_CURVE_LINE: LineStyle =
        LineStyle::solid(GRAY).with_width(0.4).with_opacity(0.6);
}

/// Black: text and axes.
pub const BLACK: Color = Color(0, 0, 0);
/// Gray: background elements.
pub const GRAY: Color = Color(0x80, 0x80, 0x80);
/// White: background of figures.
pub const WHITE: Color = Color(0xff, 0xff, 0xff);
/// Okabe and Ito's vermilion: bounds that must not be crossed, and faults. No robot has this color.
pub const VERMILION: Color = Color(0xd5, 0x5e, 0x00);
/// Blue: single curves, and the first robot.
pub const BLUE: Color = Color(0x00, 0x72, 0xb2);
/// Okabe and Ito's orange: convex hulls, and stale edges.
pub const ORANGE: Color = Color(0xe6, 0x9f, 0x00);

/// Colors of robots, in scenario order, and of other curves. Each is dark enough on white; most follow Okabe and
/// Ito. `outcome/assets/page.css` has the same colors.
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

/// Returns the line style of the robot with this index, or of other curves. 36 styles differ, and neighboring ones
/// differ in color and dashes.
pub fn robot_line(index: usize) -> LineStyle {
    LineStyle::solid(robot_color(index)).with_dash(DASHES[index % DASHES.len()])
}

/// Returns the color of the robot with this index in all figures and pictures.
pub fn robot_color(index: usize) -> Color {
    COLORS[index % COLORS.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_match_the_page_and_lines_differ_from_faults() {
        let style = include_str!("../../assets/page.css");
        for (index, color) in COLORS.into_iter().enumerate() {
            assert!(style.contains(&format!("--c{index}: {color};")), "no {color}");
        }
        let lines: Vec<LineStyle> = (0..36).map(robot_line).collect();
        assert!((0..36).all(|i| !lines[..i].contains(&lines[i])));
        assert!(!COLORS.contains(&VERMILION) && !COLORS.contains(&GRAY));
    }
}
