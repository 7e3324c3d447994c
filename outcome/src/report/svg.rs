//! SVG as text: nested elements with attributes.

use std::fmt::{self, Display, Write as _};

use crate::report::markup::escape_markup;
use crate::report::palette::{Color, Dash, LineStyle};
use crate::report::simplify::CanvasPoint;

/// An SVG element. Children are drawn in the order in which they are added.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SvgElement {
    name: &'static str,
    attributes: String,
    content: String,
}

/// Horizontal alignment of a text at its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// The text begins at the point.
    Start,
    /// The text is centered at the point.
    Middle,
    /// The text ends at the point.
    End,
}

impl SvgElement {
    /// Creates an empty element without attributes.
    pub fn new(name: &'static str) -> SvgElement {
        SvgElement { name, ..SvgElement::default() }
    }

    /// Creates the root element of a file of this size, px.
    pub fn root(width: f64, height: f64, font: &str) -> SvgElement {
        let svg = SvgElement::new("svg").with_attribute("xmlns", "http://www.w3.org/2000/svg");
        let svg = svg.with_attribute("viewBox", format!("0 0 {width} {height}"));
        svg.with_attribute("width", width)
            .with_attribute("height", height)
            .with_attribute("font-family", font)
    }

    /// Creates an element that clips its children to a rectangle: left, top, width, height, px.
    pub fn clip([x, y, width, height]: [f64; 4]) -> SvgElement {
        let [x, y, width, height] = [x, y, width, height].map(format_px);
        let view = format!("{x} {y} {width} {height}");
        let clip = SvgElement::new("svg").with_attribute("x", x).with_attribute("y", y);
        clip.with_attribute("width", width)
            .with_attribute("height", height)
            .with_attribute("viewBox", view)
    }

    /// Creates a rectangle: left, top, width, height, px.
    pub fn rect([x, y, width, height]: [f64; 4]) -> SvgElement {
        let rect = SvgElement::new("rect")
            .with_attribute("x", format_px(x))
            .with_attribute("y", format_px(y));
        rect.with_attribute("width", format_px(width)).with_attribute("height", format_px(height))
    }

    /// Creates a circle.
    pub fn circle((x, y): CanvasPoint, radius: f64) -> SvgElement {
        SvgElement::new("circle")
            .with_attribute("cx", format_px(x))
            .with_attribute("cy", format_px(y))
            .with_attribute("r", format_px(radius))
    }

    /// Creates a path from path data; see [`path_data`].
    pub fn path(data: &str) -> SvgElement {
        SvgElement::new("path").with_attribute("d", data)
    }

    /// Creates a text on this base line.
    pub fn text(text: &str, (x, y): CanvasPoint, anchor: Anchor) -> SvgElement {
        let element = SvgElement::new("text")
            .with_attribute("x", format_px(x))
            .with_attribute("y", format_px(y));
        let element = match anchor {
            Anchor::Start => element,
            Anchor::Middle => element.with_attribute("text-anchor", "middle"),
            Anchor::End => element.with_attribute("text-anchor", "end"),
        };
        element.with_text(text)
    }

    /// Returns the element with this attribute.
    pub fn with_attribute(mut self, attribute: &str, value: impl Display) -> SvgElement {
        // Writing to a string cannot fail.
        let _ = write!(self.attributes, " {attribute}=\"{}\"", escape_markup(&value.to_string()));
        self
    }

    /// Returns the element with this fill.
    pub fn with_fill(self, color: Color, opacity: f64) -> SvgElement {
        let filled = self.with_attribute("fill", color);
        if opacity < 1.0 {
            filled.with_attribute("fill-opacity", round_opacity(opacity))
        } else {
            filled
        }
    }

    /// Returns the element with this stroke and without fill.
    pub fn with_stroke(self, line: LineStyle) -> SvgElement {
        let stroked = self.with_attribute("fill", "none").with_attribute("stroke", line.color);
        let stroked = stroked.with_attribute("stroke-width", line.width);
        let stroked = match line.dash {
            Dash::Solid => stroked,
            Dash::Dashed => stroked.with_attribute("stroke-dasharray", "7 3.5"),
            Dash::Dotted => stroked.with_attribute("stroke-dasharray", "1.4 2.6"),
            Dash::DashDotted => stroked.with_attribute("stroke-dasharray", "9 3 1.4 3"),
        };
        match line.opacity {
            1.0 => stroked,
            opacity => stroked.with_attribute("stroke-opacity", round_opacity(opacity)),
        }
    }

    /// Returns the element with this text, escaped.
    pub fn with_text(mut self, text: &str) -> SvgElement {
        self.content.push_str(&escape_markup(text));
        self
    }

    /// Returns the element with this child.
    pub fn with_child(mut self, child: SvgElement) -> SvgElement {
        self.push(child);
        self
    }

    /// Appends a child.
    pub fn push(&mut self, child: SvgElement) {
        let _ = write!(self.content, "\n{child}");
    }
}

impl Extend<SvgElement> for SvgElement {
    fn extend<T: IntoIterator<Item = SvgElement>>(&mut self, children: T) {
        children.into_iter().for_each(|child| self.push(child));
    }
}

impl Display for SvgElement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SvgElement { name, attributes, content } = self;
        match content.as_str() {
            "" => write!(f, "<{name}{attributes}/>"),
            content => write!(f, "<{name}{attributes}>{content}</{name}>"),
        }
    }
}

/// Returns the path data of a polyline.
pub fn path_data(points: impl IntoIterator<Item = CanvasPoint>) -> String {
    let mut data = String::new();
    for (x, y) in points {
        let command = if data.is_empty() { 'M' } else { 'L' };
        let _ = write!(data, "{command}{} {}", format_px(x), format_px(y));
    }
    data
}

/// Formats a length, px, rounded to a tenth.
pub fn format_px(length: f64) -> String {
    let text = format!("{length:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// Rounds an opacity to a thousandth.
fn round_opacity(opacity: f64) -> f64 {
    (opacity * 1e3).round() / 1e3
}
