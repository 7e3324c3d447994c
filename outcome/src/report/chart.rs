//! Figures as SVG for screen and print: panels with axes, their content, and a key below.
//!
//! Lengths are in px of a page at 100 %. Must not depend on robots.

use crate::report::axis::Axis;
use crate::report::palette::{BLACK, Color, GRAY, Line, VERMILION, WHITE};
use crate::report::simplify::{CanvasPoint, simplify_by_column, simplify_curve};
use crate::report::svg::{Anchor, Element, path_data, px};

/// Font size, px.
const LETTERS: f64 = 12.0;
/// Width of an average letter, px.
pub const LETTER: f64 = 6.3;
/// Line height of text, px.
const LINE_HEIGHT: f64 = 15.0;
/// Space for the numbers and the label of the x axis, px.
const BOTTOM_SPACE: f64 = 44.0;
/// Space for the numbers and the label of the y axis, px.
const LEFT_SPACE: f64 = 64.0;
/// Space on the right for half of the last number, px.
const RIGHT_SPACE: f64 = 18.0;
/// Tolerance of the simplification of curves, px. Smaller differences are not visible.
const TOLERANCE: f64 = 0.08;
/// Width of a column, px. Of a curve over x at most four points per column are drawn.
const COLUMN: f64 = 0.5;
/// Half of the widest line, px, so that lines on the frame of a panel are visible.
const HALF_LINE_WIDTH: f64 = 1.5;
/// Maximum position on an axis, in lengths of the axis. Points farther out are drawn there.
const POSITION_MAX: f64 = 1e3;

/// A figure of one or more panels.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// File name below `figures/`, without `.svg`.
    pub name: &'static str,
    /// Title of the figure.
    pub title: String,
    /// Caption, in sentences.
    pub caption: String,
    /// Width, px.
    pub width: f64,
    /// Panels with their positions, from the upper left corner.
    pub panels: Vec<(Rect, Panel)>,
    /// Key: line styles and their descriptions.
    pub key: Vec<(Line, String)>,
}

/// Rectangle of a panel with its axes, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Distance from the left, px.
    pub x: f64,
    /// Distance from the top, px.
    pub y: f64,
    /// Width, px.
    pub width: f64,
    /// Height, px.
    pub height: f64,
}

impl Rect {
    /// Returns the rectangle inside of the axes, in which curves are drawn.
    pub fn plot_area(self, bands: &[Band]) -> Rect {
        let above =
            if bands.is_empty() { 8.0 } else { 6.0 + LINE_HEIGHT * band_rows(bands) as f64 };
        Rect {
            x: self.x + LEFT_SPACE,
            y: self.y + above,
            width: self.width - LEFT_SPACE - RIGHT_SPACE,
            height: self.height - above - BOTTOM_SPACE,
        }
    }

    fn right_px(self) -> f64 {
        self.x + self.width
    }

    fn bottom(self) -> f64 {
        self.y + self.height
    }
}

/// Axes, and everything that is drawn in them.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// Tinted intervals of x.
    pub bands: Vec<Band>,
    /// Filled areas: corners, color and opacity.
    pub areas: Vec<(Vec<CanvasPoint>, Color, f64)>,
    /// Polylines: points, style, and whether x never decreases.
    pub curves: Vec<(Vec<CanvasPoint>, Line, bool)>,
    /// Straight reference lines.
    pub rules: Vec<Rule>,
    /// Labeled points.
    pub marks: Vec<Mark>,
}

/// A tinted interval of x.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Start of the interval.
    pub from: f64,
    /// End of the interval.
    pub to: f64,
    /// Label above the interval.
    pub label: String,
}

/// A horizontal or vertical reference line with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// Start of the line.
    pub from: CanvasPoint,
    /// End of the line.
    pub to: CanvasPoint,
    /// Label: of a horizontal line, ending at `label_ends`; of a vertical line, at its top.
    pub label: String,
    /// x at which the label of a horizontal line ends.
    pub label_ends: f64,
    /// Style of the line.
    pub line: Line,
}

/// Shape of a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// Cross-shaped mark at a point.
    Cross,
    /// A ring around a point.
    Ring,
    /// Text only, centered at the point.
    Words,
}

/// A labeled point.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Position of the point.
    pub at: CanvasPoint,
    /// Shape of the mark.
    pub shape: Shape,
    /// Color of the mark.
    pub color: Color,
    /// Label next to the point.
    pub label: String,
}

impl Panel {
    /// Creates empty axes.
    pub fn new(x: Axis, y: Axis) -> Panel {
        Panel {
            x,
            y,
            bands: Vec::new(),
            areas: Vec::new(),
            curves: Vec::new(),
            rules: Vec::new(),
            marks: Vec::new(),
        }
    }

    /// Returns the panel without labels of its bands, for a panel below one with the same bands.
    pub fn with_nameless_bands(mut self) -> Panel {
        self.bands.iter_mut().for_each(|band| band.label.clear());
        self
    }

    /// Adds a curve over x; `None` interrupts it.
    pub fn add_curve(&mut self, points: impl IntoIterator<Item = Option<CanvasPoint>>, line: Line) {
        let points = points.into_iter().map(|point| point.filter(is_finite));
        let points: Vec<Option<CanvasPoint>> = points.collect();
        for part in points.split(Option::is_none).filter(|part| !part.is_empty()) {
            self.curves.push((part.iter().flatten().copied().collect(), line, true));
        }
    }

    /// Adds a closed polyline.
    pub fn outline(&mut self, mut corners: Vec<CanvasPoint>, line: Line) {
        corners.extend(corners.first().copied());
        self.curves.push((corners, line, false));
    }

    /// Adds a horizontal line from `from` to `to`, labeled at its right end.
    pub fn add_horizontal_line(
        &mut self,
        level: f64,
        (from, to): (f64, f64),
        label: String,
        line: Line,
    ) {
        let (from, to) = ((from, level), (to, level));
        self.rules.push(Rule { from, to, label, label_ends: to.0, line });
    }

    /// Adds a vertical line from the bottom to a fraction of the height.
    pub fn add_vertical_line(&mut self, x: f64, share: f64, label: String, line: Line) {
        let (from, to) = ((x, self.y.value_at(share)), (x, self.y.value_at(0.0)));
        self.rules.push(Rule { from, to, label, label_ends: x, line });
    }

    /// Draws the panel with its axes in a rectangle.
    pub fn draw(&self, place: Rect) -> Element {
        let drawing = Drawing { panel: self, inner: place.plot_area(&self.bands) };
        let Rect { x, y, width, height } = drawing.inner;
        let (two, margin) = (2.0 * HALF_LINE_WIDTH, HALF_LINE_WIDTH);
        let mut clip = Element::clip([x - margin, y - margin, width + two, height + two]);
        clip.extend(self.bands.iter().flat_map(|band| drawing.band(band)));
        clip.push(drawing.grid());
        clip.extend(self.areas.iter().map(|(corners, color, opacity)| {
            Element::path(&(drawing.path_data(corners) + "Z")).filled(*color, *opacity)
        }));
        clip.extend(self.curves.iter().filter_map(|curve| drawing.curve(curve)));
        let rules = || self.rules.iter().filter(|rule| drawing.is_in_range(rule));
        let placed =
            |rule: &Rule| path_data([drawing.project(rule.from), drawing.project(rule.to)]);
        clip.extend(rules().map(|rule| Element::path(&placed(rule)).stroked(rule.line)));
        clip.extend(self.marks.iter().filter_map(|mark| drawing.mark(mark)));
        let mut group = Element::new("g").with_child(clip);
        group.extend(drawing.band_labels());
        group.extend(drawing.axes(place));
        group.extend(rules().filter_map(|rule| drawing.rule_label(rule)));
        group.extend(self.marks.iter().filter_map(|mark| drawing.mark_label(mark)));
        group
    }
}

fn is_finite(&(x, y): &CanvasPoint) -> bool {
    x.is_finite() && y.is_finite()
}

/// Returns the number of rows for the labels of bands, at most 3.
fn band_rows(bands: &[Band]) -> usize {
    bands.len().clamp(1, 3)
}

impl Figure {
    /// Creates a figure of one panel.
    pub fn single_panel(
        name: &'static str,
        title: &str,
        caption: String,
        place: Rect,
        panel: Panel,
        key: Vec<(Line, String)>,
    ) -> Figure {
        let (title, width) = (title.to_owned(), place.width);
        Figure { name, title, caption, width, panels: vec![(place, panel)], key }
    }

    /// Returns the figure as an SVG file.
    pub fn svg(&self) -> String {
        let panels = self.panels.iter().map(|(place, _)| place.bottom()).fold(0.0, f64::max);
        let rows = self.key_rows();
        let height = panels + rows.len() as f64 * LINE_HEIGHT + 6.0;
        let svg = Element::file(self.width, height, "Helvetica, Arial, sans-serif");
        let mut svg = svg
            .with_attribute("role", "img")
            .with_attribute("font-size", LETTERS)
            .with_attribute("stroke-linejoin", "round")
            .with_child(Element::new("title").with_text(&self.title))
            .with_child(Element::new("desc").with_text(&self.caption))
            .with_child(Element::rect([0.0, 0.0, self.width, height]).filled(WHITE, 1.0));
        svg.extend(self.panels.iter().map(|(place, panel)| panel.draw(*place)));
        for (row, entries) in rows.into_iter().enumerate() {
            let y = panels + (row as f64 + 0.5) * LINE_HEIGHT;
            for (x, (line, words)) in entries {
                svg.push(Element::path(&path_data([(x, y), (x + 26.0, y)])).stroked(*line));
                svg.push(Element::text(words, baseline((x + 31.0, y)), Anchor::Start));
            }
        }
        format!("{svg}\n")
    }

    /// Arranges the key in rows. Returns the x position of each entry, and the entry.
    fn key_rows(&self) -> Vec<Vec<(f64, &(Line, String))>> {
        let mut rows: Vec<Vec<_>> = Vec::new();
        let mut x = f64::INFINITY;
        for entry in &self.key {
            let width = 48.0 + text_width(&entry.1);
            if x + width > self.width {
                rows.push(Vec::new());
                x = LEFT_SPACE.min(self.width / 8.0);
            }
            rows.last_mut().expect("just made").push((x, entry));
            x += width;
        }
        rows
    }
}

/// A panel during drawing, with its inner rectangle.
struct Drawing<'a> {
    panel: &'a Panel,
    inner: Rect,
}

impl Drawing<'_> {
    fn project(&self, (x, y): CanvasPoint) -> CanvasPoint {
        let share = |axis: &Axis, value| axis.fraction(value).clamp(-POSITION_MAX, POSITION_MAX);
        let Rect { x: left, y: top, width, height } = self.inner;
        let (right, up) = (share(&self.panel.x, x), share(&self.panel.y, y));
        (left + right * width, top + (1.0 - up) * height)
    }

    fn path_data(&self, points: &[CanvasPoint]) -> String {
        path_data(points.iter().filter(|at| is_finite(at)).map(|&at| self.project(at)))
    }

    /// Returns for each axis the positions, px, and texts of the ticks, and its label.
    fn ticks(&self) -> [(Vec<(f64, String)>, String); 2] {
        let Rect { width, height, .. } = self.inner;
        let many = |length: f64, room: f64| ((length / room) as usize).clamp(2, 12);
        let Panel { x, y, .. } = self.panel;
        let along = |axis: &Axis, many, place: &dyn Fn(f64) -> f64| {
            let (ticks, label) = axis.labels(many);
            let placed = ticks.into_iter().map(|(tick, text)| (place(axis.fraction(tick)), text));
            (placed.collect(), label)
        };
        [
            along(x, many(width, 62.0), &|share| self.inner.x + share * width),
            along(y, many(height, 28.0), &|share| self.inner.bottom() - share * height),
        ]
    }

    fn grid(&self) -> Element {
        let Rect { x, y, width, height } = self.inner;
        let [(across, _), (up, _)] = self.ticks();
        let upright = across.iter().map(|(at, _)| format!("M{} {}v{}", px(*at), px(y), px(height)));
        let level = up.iter().map(|(at, _)| format!("M{} {}h{}", px(x), px(*at), px(width)));
        let lines: String = upright.chain(level).collect();
        Element::path(&lines).stroked(Line::solid(GRAY).width(0.4).opacity(0.25))
    }

    fn axes(&self, outer: Rect) -> Vec<Element> {
        let inner = self.inner;
        let (right, bottom) = (inner.right_px(), inner.bottom());
        let [(across, x_label), (up, y_label)] = self.ticks();
        let mut lines = path_data([(inner.x, inner.y), (inner.x, bottom), (right, bottom)]);
        lines.extend(across.iter().map(|(at, _)| format!("M{} {}v5", px(*at), px(bottom))));
        lines.extend(up.iter().map(|(at, _)| format!("M{} {}h-5", px(inner.x), px(*at))));
        let mut drawn = vec![Element::path(&lines).stroked(Line::solid(BLACK).width(0.8))];
        let number = |(at, number): &(f64, String)| {
            Element::text(number, baseline((*at, bottom + 13.0)), Anchor::Middle)
        };
        drawn.extend(across.iter().map(number));
        let number = |(at, number): &(f64, String)| {
            Element::text(number, baseline((inner.x - 8.0, *at)), Anchor::End)
        };
        drawn.extend(up.iter().map(number));
        let below = (inner.x + inner.width / 2.0, outer.bottom() - 0.5 * LINE_HEIGHT);
        drawn.push(Element::text(&x_label, baseline(below), Anchor::Middle));
        let beside = (outer.x + 14.0, inner.y + inner.height / 2.0);
        let turned = format!("translate({} {}) rotate(-90)", px(beside.0), px(beside.1));
        let label = Element::text(&y_label, (0.0, 0.0), Anchor::Middle);
        drawn.push(label.with_attribute("transform", turned));
        drawn
    }

    /// Returns the horizontal extent of a band, px.
    fn band_extent_px(&self, band: &Band) -> (f64, f64) {
        let x =
            |value: f64| self.project((value, 0.0)).0.clamp(self.inner.x, self.inner.right_px());
        (x(band.from), x(band.to).max(x(band.from) + 1.5))
    }

    fn band(&self, band: &Band) -> [Element; 2] {
        let ((from, to), Rect { y, height, .. }) = (self.band_extent_px(band), self.inner);
        let begins = Line::solid(VERMILION).width(0.4).opacity(0.7);
        [
            Element::rect([from, y, to - from, height]).filled(VERMILION, 0.16),
            Element::path(&path_data([(from, y), (from, y + height)])).stroked(begins),
        ]
    }

    /// Returns the labels of the bands that fit.
    fn band_labels(&self) -> Vec<Element> {
        let mut free_from = vec![f64::NEG_INFINITY; band_rows(&self.panel.bands)];
        let mut labels = Vec::new();
        for band in &self.panel.bands {
            let width = text_width(&band.label);
            let begin =
                self.band_extent_px(band).0.min(self.inner.right_px() - width).max(self.inner.x);
            let Some(row) = free_from.iter().position(|&free| free <= begin) else { continue };
            free_from[row] = begin + width + 8.0;
            let at = baseline((begin, self.inner.y - 3.0 - LINE_HEIGHT * (row as f64 + 0.5)));
            labels.push(Element::text(&band.label, at, Anchor::Start).filled(VERMILION, 1.0));
        }
        labels
    }

    fn curve(&self, (points, line, add_curve): &(Vec<CanvasPoint>, Line, bool)) -> Option<Element> {
        let placed = points.iter().filter(|at| is_finite(at)).map(|&at| self.project(at));
        let placed: Vec<CanvasPoint> = placed.collect();
        let placed = if *add_curve { simplify_by_column(&placed, COLUMN) } else { placed };
        let mut seen = simplify_curve(&placed, TOLERANCE);
        if let [(x, y)] = seen[..] {
            seen.push((x + 1.0, y)); // a single value is drawn as a short line
        }
        (!seen.is_empty()).then(|| Element::path(&path_data(seen)).stroked(*line))
    }

    fn is_in_range(&self, rule: &Rule) -> bool {
        let rows = self.inner.y - 1.0..=self.inner.bottom() + 1.0;
        [rule.from, rule.to]
            .iter()
            .all(|&end| is_finite(&end) && rows.contains(&self.project(end).1))
    }

    fn rule_label(&self, rule: &Rule) -> Option<Element> {
        let (from, to) = (self.project(rule.from), self.project(rule.to));
        if from.1 == to.1 {
            // Above the right end, or below it if there is no space above.
            let above = from.1 - self.inner.y > LINE_HEIGHT + 2.0;
            let y = if above { from.1 - 0.6 * LINE_HEIGHT } else { from.1 + 0.7 * LINE_HEIGHT };
            let ends = self.project((rule.label_ends, rule.to.1)).0 - 3.0;
            return text_with_background(&rule.label, (ends, y), Anchor::End, rule.line.color);
        }
        let (x, side) = self.label_position(from.0, 4.0, &rule.label);
        text_with_background(
            &rule.label,
            (x, from.1.min(to.1) + 0.7 * LINE_HEIGHT),
            side,
            rule.line.color,
        )
    }

    fn mark(&self, mark: &Mark) -> Option<Element> {
        let (x, y) = self.project(mark.at);
        let drawn = match mark.shape {
            _ if !is_finite(&(x, y)) => return None,
            Shape::Cross => {
                let [left, top] = [x - 3.5, y - 3.5].map(px);
                Element::path(&format!("M{left} {top}l7 7m0 -7l-7 7"))
            }
            Shape::Ring => Element::circle((x, y), 4.5),
            Shape::Words => return None,
        };
        Some(drawn.stroked(Line::solid(mark.color).width(1.6)))
    }

    fn mark_label(&self, mark: &Mark) -> Option<Element> {
        let (x, y) = self.project(mark.at);
        if !is_finite(&(x, y)) {
            return None;
        }
        if mark.shape == Shape::Words {
            return text_with_background(&mark.label, (x, y), Anchor::Middle, mark.color);
        }
        let (x, side) = self.label_position(x, 8.0, &mark.label);
        let lowest = self.inner.bottom() - 0.6 * LINE_HEIGHT;
        let y = (y - 0.7 * LINE_HEIGHT).min(lowest).max(self.inner.y + 6.0);
        text_with_background(&mark.label, (x, y), side, mark.color)
    }

    /// Returns the position and the alignment of a label at this distance to the right of x, or to the left if
    /// there is no space.
    fn label_position(&self, x: f64, gap: f64, label: &str) -> (f64, Anchor) {
        match x + gap + 1.0 + text_width(label) < self.inner.right_px() {
            true => (x + gap, Anchor::Start),
            false => (x - gap, Anchor::End),
        }
    }
}

/// Returns the base line of a text that is vertically centered at this point.
fn baseline((x, y): CanvasPoint) -> CanvasPoint {
    (x, y + 0.35 * LETTERS)
}

/// Returns the estimated width of a text, px.
fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * LETTER
}

/// Returns a text on a translucent background, for drawing over curves; `None` for an empty text.
fn text_with_background(
    words: &str,
    at: CanvasPoint,
    anchor: Anchor,
    color: Color,
) -> Option<Element> {
    let width = text_width(words);
    let left = match anchor {
        Anchor::Start => at.0,
        Anchor::Middle => at.0 - width / 2.0,
        Anchor::End => at.0 - width,
    };
    let paper = Element::rect([left - 2.0, at.1 - 0.5 * LINE_HEIGHT, width + 4.0, LINE_HEIGHT]);
    let text = Element::text(words, baseline(at), anchor).filled(color, 1.0);
    let both = Element::new("g").with_child(paper.filled(WHITE, 0.65)).with_child(text);
    (!words.is_empty()).then_some(both)
}
