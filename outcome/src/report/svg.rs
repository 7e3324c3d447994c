//! SVG as text: elements with attributes, one within the other.

use std::fmt::{self, Display, Write as _};

use crate::report::markup::escaped;
use crate::report::palette::{Color, Dash, Line};
use crate::report::simplify::Point;

/// An element; what is pushed into it is drawn in this order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Element {
    name: &'static str,
    attributes: String,
    content: String,
}

/// Where a text stands, seen from its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// It begins there.
    Start,
    /// It is there in the middle.
    Middle,
    /// It ends there.
    End,
}

impl Element {
    /// Without attributes, and empty.
    pub fn new(name: &'static str) -> Element {
        Element { name, ..Element::default() }
    }

    /// A whole file of this size, px.
    pub fn file(width: f64, height: f64, font: &str) -> Element {
        let svg = Element::new("svg").with("xmlns", "http://www.w3.org/2000/svg");
        let svg = svg.with("viewBox", format!("0 0 {width} {height}"));
        svg.with("width", width).with("height", height).with("font-family", font)
    }

    /// What is pushed into it is seen within this rectangle only: left, top, width, height, px.
    pub fn clip([x, y, width, height]: [f64; 4]) -> Element {
        let [x, y, width, height] = [x, y, width, height].map(px);
        let view = format!("{x} {y} {width} {height}");
        let clip = Element::new("svg").with("x", x).with("y", y);
        clip.with("width", width).with("height", height).with("viewBox", view)
    }

    /// A rectangle: left, top, width, height, px.
    pub fn rect([x, y, width, height]: [f64; 4]) -> Element {
        let rect = Element::new("rect").with("x", px(x)).with("y", px(y));
        rect.with("width", px(width)).with("height", px(height))
    }

    /// A circle.
    pub fn circle((x, y): Point, radius: f64) -> Element {
        Element::new("circle").with("cx", px(x)).with("cy", px(y)).with("r", px(radius))
    }

    /// A path by its steps, see [`way`].
    pub fn path(steps: &str) -> Element {
        Element::new("path").with("d", steps)
    }

    /// Words on this base line.
    pub fn words(words: &str, (x, y): Point, anchor: Anchor) -> Element {
        let text = Element::new("text").with("x", px(x)).with("y", px(y));
        let text = match anchor {
            Anchor::Start => text,
            Anchor::Middle => text.with("text-anchor", "middle"),
            Anchor::End => text.with("text-anchor", "end"),
        };
        text.says(words)
    }

    /// With this attribute.
    pub fn with(mut self, attribute: &str, value: impl Display) -> Element {
        // Writing to a string cannot fail.
        let _ = write!(self.attributes, " {attribute}=\"{}\"", escaped(&value.to_string()));
        self
    }

    /// Filled.
    pub fn filled(self, color: Color, opacity: f64) -> Element {
        let filled = self.with("fill", color);
        if opacity < 1.0 { filled.with("fill-opacity", number(opacity)) } else { filled }
    }

    /// Drawn with a line, and not filled.
    pub fn stroked(self, line: Line) -> Element {
        let stroked = self.with("fill", "none").with("stroke", line.color);
        let stroked = stroked.with("stroke-width", line.width);
        let stroked = match line.dash {
            Dash::Solid => stroked,
            Dash::Dashed => stroked.with("stroke-dasharray", "7 3.5"),
            Dash::Dotted => stroked.with("stroke-dasharray", "1.4 2.6"),
            Dash::DashDotted => stroked.with("stroke-dasharray", "9 3 1.4 3"),
        };
        match line.opacity {
            1.0 => stroked,
            opacity => stroked.with("stroke-opacity", number(opacity)),
        }
    }

    /// With these words in it, which stay words.
    pub fn says(mut self, words: &str) -> Element {
        self.content.push_str(&escaped(words));
        self
    }

    /// With this within it.
    pub fn holding(mut self, inner: Element) -> Element {
        self.push(inner);
        self
    }

    /// Draws something more within it.
    pub fn push(&mut self, inner: Element) {
        let _ = write!(self.content, "\n{inner}");
    }
}

impl Extend<Element> for Element {
    fn extend<T: IntoIterator<Item = Element>>(&mut self, inner: T) {
        inner.into_iter().for_each(|element| self.push(element));
    }
}

impl Display for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Element { name, attributes, content } = self;
        match content.as_str() {
            "" => write!(f, "<{name}{attributes}/>"),
            content => write!(f, "<{name}{attributes}>{content}</{name}>"),
        }
    }
}

/// The steps of a path from point to point.
pub fn way(points: impl IntoIterator<Item = Point>) -> String {
    let mut steps = String::new();
    for (x, y) in points {
        let step = if steps.is_empty() { 'M' } else { 'L' };
        let _ = write!(steps, "{step}{} {}", px(x), px(y));
    }
    steps
}

/// A length in px, to a tenth.
pub fn px(length: f64) -> String {
    let text = format!("{length:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

/// A share, to a thousandth.
fn number(share: f64) -> f64 {
    (share * 1e3).round() / 1e3
}
