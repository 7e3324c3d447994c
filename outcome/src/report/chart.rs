//! A figure: panels with axes, what is drawn in them, and a key below, as SVG for screen and print.
//!
//! Lengths are in px of a page at 100 %. Must not know robots.

use crate::report::axis::Axis;
use crate::report::palette::{BLACK, Color, GRAY, Line, VERMILION, WHITE};
use crate::report::simplify::{Point, by_column, within};
use crate::report::svg::{Anchor, Element, px, way};

/// Size of all letters, px.
const LETTERS: f64 = 12.0;
/// Width of an average letter, px.
pub const LETTER: f64 = 6.3;
/// From one line of text to the next, px.
const LINE: f64 = 15.0;
/// Room for the numbers and the label of an axis, px: below, and on the left.
const BELOW: f64 = 44.0;
const LEFT: f64 = 64.0;
/// Half of the last number may stand out, px.
const RIGHT: f64 = 18.0;
/// What is nearer than this cannot be told apart, px.
const TOLERANCE: f64 = 0.08;
/// Of a curve over x, no more than four points are drawn for each of so many px.
const COLUMN: f64 = 0.5;
/// Half of the widest line, px: lines on the frame of a panel are seen.
const MARGIN: f64 = 1.5;
/// So many lengths of an axis beyond its ends, places make no difference.
const FAR: f64 = 1e3;

/// One figure.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Its file below `figures/`, without `.svg`.
    pub name: &'static str,
    /// What it shows, in a few words.
    pub title: String,
    /// What is to be seen in it, in sentences.
    pub caption: String,
    /// px.
    pub width: f64,
    /// Where each panel is, from the upper left corner.
    pub panels: Vec<(Place, Panel)>,
    /// Lines and what they stand for.
    pub key: Vec<(Line, String)>,
}

/// Where a panel is, with its axes: px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// From the left.
    pub x: f64,
    /// From the top.
    pub y: f64,
    /// Its width.
    pub width: f64,
    /// Its height.
    pub height: f64,
}

impl Place {
    /// What remains for the curves: the place within the axes.
    pub fn inner(self, bands: &[Band]) -> Place {
        let above = if bands.is_empty() { 8.0 } else { 6.0 + LINE * band_rows(bands) as f64 };
        Place {
            x: self.x + LEFT,
            y: self.y + above,
            width: self.width - LEFT - RIGHT,
            height: self.height - above - BELOW,
        }
    }

    fn right(self) -> f64 {
        self.x + self.width
    }

    fn bottom(self) -> f64 {
        self.y + self.height
    }
}

/// Axes, and everything that is drawn in them.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// From left to right.
    pub x: Axis,
    /// From bottom to top.
    pub y: Axis,
    /// Stretches of x that are tinted.
    pub bands: Vec<Band>,
    /// Tinted areas.
    pub areas: Vec<(Vec<Point>, Color, f64)>,
    /// Lines from point to point; with `true`, x never falls along it.
    pub curves: Vec<(Vec<Point>, Line, bool)>,
    /// Bounds.
    pub rules: Vec<Rule>,
    /// Points that are told by name.
    pub marks: Vec<Mark>,
}

/// A stretch of x.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Its beginning.
    pub from: f64,
    /// Its end.
    pub to: f64,
    /// Written above it.
    pub label: String,
}

/// A bound: a straight line, level or upright, and what it says.
#[derive(Debug, Clone, PartialEq)]
pub struct Rule {
    /// From here
    pub from: Point,
    /// to there.
    pub to: Point,
    /// Written along it: of a level one, so that it ends at this x; of an upright one at its top.
    pub label: String,
    /// See `label`.
    pub label_ends: f64,
    /// How it looks.
    pub line: Line,
}

/// What a mark looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A cross: where something began.
    Cross,
    /// A ring around what is shown.
    Ring,
    /// Words only, in the middle.
    Words,
}

/// A point, and what is to be said of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Where.
    pub at: Point,
    /// How it looks.
    pub shape: Shape,
    /// Its color.
    pub color: Color,
    /// Written beside it.
    pub label: String,
}

impl Panel {
    /// Empty axes.
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

    /// The same, without words above its bands: those of the panel above it say it.
    pub fn with_nameless_bands(mut self) -> Panel {
        self.bands.iter_mut().for_each(|band| band.label.clear());
        self
    }

    /// A curve over x; `None` interrupts it.
    pub fn over_x(&mut self, points: impl IntoIterator<Item = Option<Point>>, line: Line) {
        let points = points.into_iter().map(|point| point.filter(is_finite));
        let points: Vec<Option<Point>> = points.collect();
        for part in points.split(Option::is_none).filter(|part| !part.is_empty()) {
            self.curves.push((part.iter().flatten().copied().collect(), line, true));
        }
    }

    /// A closed line around an area.
    pub fn outline(&mut self, mut corners: Vec<Point>, line: Line) {
        corners.extend(corners.first().copied());
        self.curves.push((corners, line, false));
    }

    /// A level bound from `from` to `to`, told at its right end.
    pub fn bound(&mut self, level: f64, (from, to): (f64, f64), label: String, line: Line) {
        let (from, to) = ((from, level), (to, level));
        self.rules.push(Rule { from, to, label, label_ends: to.0, line });
    }

    /// An upright line from the bottom to a share of the height.
    pub fn upright(&mut self, x: f64, share: f64, label: String, line: Line) {
        let (from, to) = ((x, self.y.at(share)), (x, self.y.at(0.0)));
        self.rules.push(Rule { from, to, label, label_ends: x, line });
    }

    /// The panel with its axes at a place.
    pub fn drawn(&self, place: Place) -> Element {
        let drawing = Drawing { panel: self, inner: place.inner(&self.bands) };
        let Place { x, y, width, height } = drawing.inner;
        let (two, margin) = (2.0 * MARGIN, MARGIN);
        let mut clip = Element::clip([x - margin, y - margin, width + two, height + two]);
        clip.extend(self.bands.iter().flat_map(|band| drawing.band(band)));
        clip.push(drawing.grid());
        clip.extend(self.areas.iter().map(|(corners, color, opacity)| {
            Element::path(&(drawing.way(corners) + "Z")).filled(*color, *opacity)
        }));
        clip.extend(self.curves.iter().filter_map(|curve| drawing.curve(curve)));
        let rules = || self.rules.iter().filter(|rule| drawing.shows(rule));
        let placed = |rule: &Rule| way([drawing.at(rule.from), drawing.at(rule.to)]);
        clip.extend(rules().map(|rule| Element::path(&placed(rule)).stroked(rule.line)));
        clip.extend(self.marks.iter().filter_map(|mark| drawing.mark(mark)));
        let mut group = Element::new("g").holding(clip);
        group.extend(drawing.band_labels());
        group.extend(drawing.axes(place));
        group.extend(rules().filter_map(|rule| drawing.rule_label(rule)));
        group.extend(self.marks.iter().filter_map(|mark| drawing.mark_label(mark)));
        group
    }
}

fn is_finite(&(x, y): &Point) -> bool {
    x.is_finite() && y.is_finite()
}

/// In how many rows the labels of bands are written, at most.
fn band_rows(bands: &[Band]) -> usize {
    bands.len().clamp(1, 3)
}

impl Figure {
    /// A figure that is one panel.
    pub fn of_one(
        name: &'static str,
        title: &str,
        caption: String,
        place: Place,
        panel: Panel,
        key: Vec<(Line, String)>,
    ) -> Figure {
        let (title, width) = (title.to_owned(), place.width);
        Figure { name, title, caption, width, panels: vec![(place, panel)], key }
    }

    /// The figure as an SVG file.
    pub fn svg(&self) -> String {
        let panels = self.panels.iter().map(|(place, _)| place.bottom()).fold(0.0, f64::max);
        let rows = self.key_rows();
        let height = panels + rows.len() as f64 * LINE + 6.0;
        let svg = Element::file(self.width, height, "Helvetica, Arial, sans-serif");
        let mut svg = svg
            .with("role", "img")
            .with("font-size", LETTERS)
            .with("stroke-linejoin", "round")
            .holding(Element::new("title").says(&self.title))
            .holding(Element::new("desc").says(&self.caption))
            .holding(Element::rect([0.0, 0.0, self.width, height]).filled(WHITE, 1.0));
        svg.extend(self.panels.iter().map(|(place, panel)| panel.drawn(*place)));
        for (row, entries) in rows.into_iter().enumerate() {
            let y = panels + (row as f64 + 0.5) * LINE;
            for (x, (line, words)) in entries {
                svg.push(Element::path(&way([(x, y), (x + 26.0, y)])).stroked(*line));
                svg.push(Element::words(words, on_line((x + 31.0, y)), Anchor::Start));
            }
        }
        format!("{svg}\n")
    }

    /// The key in rows: where each entry begins, and the entry.
    fn key_rows(&self) -> Vec<Vec<(f64, &(Line, String))>> {
        let mut rows: Vec<Vec<_>> = Vec::new();
        let mut x = f64::INFINITY;
        for entry in &self.key {
            let width = 48.0 + wide(&entry.1);
            if x + width > self.width {
                rows.push(Vec::new());
                x = LEFT.min(self.width / 8.0);
            }
            rows.last_mut().expect("just made").push((x, entry));
            x += width;
        }
        rows
    }
}

/// One panel while it is drawn.
struct Drawing<'a> {
    panel: &'a Panel,
    inner: Place,
}

impl Drawing<'_> {
    fn at(&self, (x, y): Point) -> Point {
        let share = |axis: &Axis, value| axis.share(value).clamp(-FAR, FAR);
        let Place { x: left, y: top, width, height } = self.inner;
        let (right, up) = (share(&self.panel.x, x), share(&self.panel.y, y));
        (left + right * width, top + (1.0 - up) * height)
    }

    fn way(&self, points: &[Point]) -> String {
        way(points.iter().filter(|at| is_finite(at)).map(|&at| self.at(at)))
    }

    /// For each axis, where its numbers stand, px, and what they say; and its label.
    fn ticks(&self) -> [(Vec<(f64, String)>, String); 2] {
        let Place { width, height, .. } = self.inner;
        let many = |length: f64, room: f64| ((length / room) as usize).clamp(2, 12);
        let Panel { x, y, .. } = self.panel;
        let along = |axis: &Axis, many, place: &dyn Fn(f64) -> f64| {
            let (ticks, label) = axis.labels(many);
            let placed = ticks.into_iter().map(|(tick, text)| (place(axis.share(tick)), text));
            (placed.collect(), label)
        };
        [
            along(x, many(width, 62.0), &|share| self.inner.x + share * width),
            along(y, many(height, 28.0), &|share| self.inner.bottom() - share * height),
        ]
    }

    fn grid(&self) -> Element {
        let Place { x, y, width, height } = self.inner;
        let [(across, _), (up, _)] = self.ticks();
        let upright = across.iter().map(|(at, _)| format!("M{} {}v{}", px(*at), px(y), px(height)));
        let level = up.iter().map(|(at, _)| format!("M{} {}h{}", px(x), px(*at), px(width)));
        let lines: String = upright.chain(level).collect();
        Element::path(&lines).stroked(Line::solid(GRAY).width(0.4).opacity(0.25))
    }

    fn axes(&self, outer: Place) -> Vec<Element> {
        let inner = self.inner;
        let (right, bottom) = (inner.right(), inner.bottom());
        let [(across, x_label), (up, y_label)] = self.ticks();
        let mut lines = way([(inner.x, inner.y), (inner.x, bottom), (right, bottom)]);
        lines.extend(across.iter().map(|(at, _)| format!("M{} {}v5", px(*at), px(bottom))));
        lines.extend(up.iter().map(|(at, _)| format!("M{} {}h-5", px(inner.x), px(*at))));
        let mut drawn = vec![Element::path(&lines).stroked(Line::solid(BLACK).width(0.8))];
        let number = |(at, number): &(f64, String)| {
            Element::words(number, on_line((*at, bottom + 13.0)), Anchor::Middle)
        };
        drawn.extend(across.iter().map(number));
        let number = |(at, number): &(f64, String)| {
            Element::words(number, on_line((inner.x - 8.0, *at)), Anchor::End)
        };
        drawn.extend(up.iter().map(number));
        let below = (inner.x + inner.width / 2.0, outer.bottom() - 0.5 * LINE);
        drawn.push(Element::words(&x_label, on_line(below), Anchor::Middle));
        let beside = (outer.x + 14.0, inner.y + inner.height / 2.0);
        let turned = format!("translate({} {}) rotate(-90)", px(beside.0), px(beside.1));
        let label = Element::words(&y_label, (0.0, 0.0), Anchor::Middle);
        drawn.push(label.with("transform", turned));
        drawn
    }

    /// Where a band begins and ends, px.
    fn reach(&self, band: &Band) -> (f64, f64) {
        let x = |value: f64| self.at((value, 0.0)).0.clamp(self.inner.x, self.inner.right());
        (x(band.from), x(band.to).max(x(band.from) + 1.5))
    }

    fn band(&self, band: &Band) -> [Element; 2] {
        let ((from, to), Place { y, height, .. }) = (self.reach(band), self.inner);
        let begins = Line::solid(VERMILION).width(0.4).opacity(0.7);
        [
            Element::rect([from, y, to - from, height]).filled(VERMILION, 0.16),
            Element::path(&way([(from, y), (from, y + height)])).stroked(begins),
        ]
    }

    /// The labels of bands, as far as there is room for them.
    fn band_labels(&self) -> Vec<Element> {
        let mut free_from = vec![f64::NEG_INFINITY; band_rows(&self.panel.bands)];
        let mut labels = Vec::new();
        for band in &self.panel.bands {
            let width = wide(&band.label);
            let begin = self.reach(band).0.min(self.inner.right() - width).max(self.inner.x);
            let Some(row) = free_from.iter().position(|&free| free <= begin) else { continue };
            free_from[row] = begin + width + 8.0;
            let at = on_line((begin, self.inner.y - 3.0 - LINE * (row as f64 + 0.5)));
            labels.push(Element::words(&band.label, at, Anchor::Start).filled(VERMILION, 1.0));
        }
        labels
    }

    fn curve(&self, (points, line, over_x): &(Vec<Point>, Line, bool)) -> Option<Element> {
        let placed = points.iter().filter(|at| is_finite(at)).map(|&at| self.at(at));
        let placed: Vec<Point> = placed.collect();
        let placed = if *over_x { by_column(&placed, COLUMN) } else { placed };
        let mut seen = within(&placed, TOLERANCE);
        if let [(x, y)] = seen[..] {
            seen.push((x + 1.0, y)); // one value alone is seen, too
        }
        (!seen.is_empty()).then(|| Element::path(&way(seen)).stroked(*line))
    }

    fn shows(&self, rule: &Rule) -> bool {
        let rows = self.inner.y - 1.0..=self.inner.bottom() + 1.0;
        [rule.from, rule.to].iter().all(|&end| is_finite(&end) && rows.contains(&self.at(end).1))
    }

    fn rule_label(&self, rule: &Rule) -> Option<Element> {
        let (from, to) = (self.at(rule.from), self.at(rule.to));
        if from.1 == to.1 {
            // Above its right end, or below it where there is no room above.
            let above = from.1 - self.inner.y > LINE + 2.0;
            let y = if above { from.1 - 0.6 * LINE } else { from.1 + 0.7 * LINE };
            let ends = self.at((rule.label_ends, rule.to.1)).0 - 3.0;
            return on_paper(&rule.label, (ends, y), Anchor::End, rule.line.color);
        }
        let (x, side) = self.beside(from.0, 4.0, &rule.label);
        on_paper(&rule.label, (x, from.1.min(to.1) + 0.7 * LINE), side, rule.line.color)
    }

    fn mark(&self, mark: &Mark) -> Option<Element> {
        let (x, y) = self.at(mark.at);
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
        let (x, y) = self.at(mark.at);
        if !is_finite(&(x, y)) {
            return None;
        }
        if mark.shape == Shape::Words {
            return on_paper(&mark.label, (x, y), Anchor::Middle, mark.color);
        }
        let (x, side) = self.beside(x, 8.0, &mark.label);
        let lowest = self.inner.bottom() - 0.6 * LINE;
        let y = (y - 0.7 * LINE).min(lowest).max(self.inner.y + 6.0);
        on_paper(&mark.label, (x, y), side, mark.color)
    }

    /// Where a label stands that is so far right of x, or left of it where there is no room.
    fn beside(&self, x: f64, gap: f64, label: &str) -> (f64, Anchor) {
        match x + gap + 1.0 + wide(label) < self.inner.right() {
            true => (x + gap, Anchor::Start),
            false => (x - gap, Anchor::End),
        }
    }
}

/// The base line of words whose middle is at this height.
fn on_line((x, y): Point) -> Point {
    (x, y + 0.35 * LETTERS)
}

/// About how wide a text is, px.
fn wide(text: &str) -> f64 {
    text.chars().count() as f64 * LETTER
}

/// Words on top of curves: on a pale ground.
fn on_paper(words: &str, at: Point, anchor: Anchor, color: Color) -> Option<Element> {
    let width = wide(words);
    let left = match anchor {
        Anchor::Start => at.0,
        Anchor::Middle => at.0 - width / 2.0,
        Anchor::End => at.0 - width,
    };
    let paper = Element::rect([left - 2.0, at.1 - 0.5 * LINE, width + 4.0, LINE]);
    let text = Element::words(words, on_line(at), anchor).filled(color, 1.0);
    let both = Element::new("g").holding(paper.filled(WHITE, 0.65)).holding(text);
    (!words.is_empty()).then_some(both)
}
