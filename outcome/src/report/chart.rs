//! A figure: panels with axes, what is drawn in them, and a key below, as SVG for screen and print.
//!
//! Lengths are in px of a page at 100 %. Must not know robots.

use std::fmt::Write as _;
use std::io;

use plotters::chart::{ChartBuilder, LabelAreaPosition};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::SVGBackend;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, IntoFont, RGBColor, ShapeStyle, TextStyle};

use crate::report::axis::Axis;
use crate::report::markup::escaped;
use crate::report::palette::{BLACK, Dash, GRAY, Line, VERMILION, WHITE};
use crate::report::simplify::{Point, by_column, clipped, within};

/// Plotters rounds to whole px: on a canvas so many times too large nobody sees it.
const FINE: f64 = 10.0;
/// Size of all letters, px.
const LETTERS: f64 = 12.0;
/// Width of an average letter, px.
const LETTER: f64 = 6.3;
/// From one line of text to the next, px.
const LINE: f64 = 15.0;
/// Room for the numbers and the label of an axis, px: below, and on the left.
const BELOW: f64 = 44.0;
const LEFT: f64 = 64.0;
/// Half of the last number may stand out, px.
const RIGHT: f64 = 18.0;
/// What is nearer than this cannot be told apart, in px of the fine canvas.
const TOLERANCE: f64 = 0.8;

type Canvas<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Failed = DrawingAreaErrorKind<io::Error>;

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
    /// Without the key, px.
    pub height: f64,
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
        let above = if bands.is_empty() { 8.0 } else { 6.0 + LINE * f64::from(band_rows(bands)) };
        Place {
            x: self.x + LEFT,
            y: self.y + above,
            width: self.width - LEFT - RIGHT,
            height: self.height - above - BELOW,
        }
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
    pub areas: Vec<(Vec<Point>, RGBColor, f64)>,
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
    pub color: RGBColor,
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

    /// A curve over x; `None` interrupts it.
    pub fn over_x(&mut self, points: impl IntoIterator<Item = Option<Point>>, line: Line) {
        let mut part = Vec::new();
        for point in points {
            match point.filter(|(x, y)| x.is_finite() && y.is_finite()) {
                Some(point) => part.push(point),
                None if part.is_empty() => {}
                None => self.curves.push((std::mem::take(&mut part), line, true)),
            }
        }
        if !part.is_empty() {
            self.curves.push((part, line, true));
        }
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
}

/// In how many rows the labels of bands are written, at most.
fn band_rows(bands: &[Band]) -> u32 {
    bands.len().clamp(1, 3) as u32
}

impl Figure {
    /// The figure as an SVG file.
    pub fn svg(&self) -> String {
        let height = self.height + self.key_rows().len() as f64 * LINE + 6.0;
        let size = ((self.width * FINE) as u32, (height * FINE) as u32);
        let mut drawn = String::new();
        let canvas = SVGBackend::with_string(&mut drawn, size).into_drawing_area();
        // Into memory nothing fails to be written, and letters are not measured.
        self.draw(&canvas).expect("memory takes everything");
        drop(canvas);
        self.finished(&drawn, height)
    }

    fn draw(&self, canvas: &Canvas<'_>) -> Result<(), Failed> {
        for (place, panel) in &self.panels {
            Drawing { canvas, panel, outer: *place, inner: place.inner(&panel.bands) }.draw()?;
        }
        for (row, entries) in self.key_rows().into_iter().enumerate() {
            let y = self.height + (row as f64 + 0.5) * LINE;
            for (x, (line, words)) in entries {
                path(canvas, &[(x, y), (x + 26.0, y)], *line)?;
                write(canvas, words, (x + 31.0, y), HPos::Left, VPos::Center, BLACK)?;
            }
        }
        canvas.present()
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

    /// What plotters drew, with a head of our own, dashes, and without what says nothing.
    fn finished(&self, drawn: &str, height: f64) -> String {
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" width=\"{}\" \
             height=\"{}\" role=\"img\" font-family=\"Helvetica, Arial, sans-serif\" \
             stroke-linejoin=\"round\">\n<title>{}</title>\n<desc>{}</desc>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>\n",
            (self.width * FINE) as u32,
            (height * FINE) as u32,
            self.width,
            height,
            escaped(&self.title),
            escaped(&self.caption),
        );
        for line in drawn.lines().skip(1) {
            let line =
                line.replace(" opacity=\"1\"", "").replace(" font-family=\"sans-serif\"", "");
            let line = line.replace(" \"/>", "\"/>");
            let Some((before, rest)) = line.split_once(" stroke-width=\"") else {
                svg.push_str(&line);
                svg.push('\n');
                continue;
            };
            let (width, after) = rest.split_once('"').unwrap_or((rest, ""));
            let width: u32 = width.parse().unwrap_or(0);
            let dashes = match width % 4 {
                1 => " stroke-dasharray=\"70 35\"",
                2 => " stroke-dasharray=\"14 26\"",
                3 => " stroke-dasharray=\"90 30 14 30\"",
                _ => "",
            };
            let _ = writeln!(svg, "{before} stroke-width=\"{}\"{dashes}{after}", width / 4 * 4);
        }
        svg
    }
}

/// Plotters knows no dashes. A width on the fine canvas is a multiple of 4; what is beyond names
/// the dashes, until the file is finished.
fn width_of(line: Line) -> u32 {
    let dash = match line.dash {
        Dash::Solid => 0,
        Dash::Dashed => 1,
        Dash::Dotted => 2,
        Dash::DashDotted => 3,
    };
    4 * line.weight.max(1) + dash
}

/// One panel while it is drawn.
struct Drawing<'a, 'b> {
    canvas: &'a Canvas<'b>,
    panel: &'a Panel,
    outer: Place,
    inner: Place,
}

impl Drawing<'_, '_> {
    fn draw(&self) -> Result<(), Failed> {
        self.bands()?;
        self.axes()?;
        for (corners, color, opacity) in &self.panel.areas {
            let corners: Vec<_> = corners.iter().map(|&at| fine(self.place(at))).collect();
            self.canvas.draw(&Polygon::new(corners, color.mix(*opacity)))?;
        }
        for (points, line, over_x) in &self.panel.curves {
            self.curve(points, *line, *over_x)?;
        }
        for rule in &self.panel.rules {
            self.rule(rule)?;
        }
        self.panel.marks.iter().try_for_each(|mark| self.mark(mark))
    }

    fn place(&self, at: Point) -> Point {
        let Place { x, y, width, height } = self.inner;
        (x + self.panel.x.share(at.0) * width, y + (1.0 - self.panel.y.share(at.1)) * height)
    }

    fn axes(&self) -> Result<(), Failed> {
        let (outer, inner) = (self.outer, self.inner);
        let corner = fine((outer.x, inner.y));
        let size = fine((inner.x + inner.width - outer.x, outer.y + outer.height - inner.y));
        let area = self.canvas.clone().shrink(corner, (size.0 as u32, size.1 as u32));
        let mut chart = ChartBuilder::on(&area)
            .set_label_area_size(LabelAreaPosition::Left, (LEFT * FINE) as u32)
            .set_label_area_size(LabelAreaPosition::Bottom, (BELOW * FINE) as u32)
            .build_cartesian_2d(self.panel.x.clone(), self.panel.y.clone())?;
        let ticks = |length: f64, room: f64| ((length / room) as usize).clamp(2, 12);
        chart
            .configure_mesh()
            .x_desc(&self.panel.x.label)
            .y_desc(&self.panel.y.label)
            .x_labels(ticks(inner.width, 62.0))
            .y_labels(ticks(inner.height, 28.0))
            .max_light_lines(0)
            .bold_line_style(style(GRAY, 0.25, Line::solid(GRAY).weight(1)))
            .axis_style(style(BLACK, 1.0, Line::solid(BLACK).weight(2)))
            .set_all_tick_mark_size((5.0 * FINE) as i32)
            .label_style(letters(BLACK))
            .axis_desc_style(letters(BLACK))
            .draw()
    }

    /// The bands, and their labels where there is room for them.
    fn bands(&self) -> Result<(), Failed> {
        let (low, high) = self.panel.x.bounds();
        let rows = band_rows(&self.panel.bands) as usize;
        let mut free_from = vec![f64::NEG_INFINITY; rows];
        for band in &self.panel.bands {
            let x = |value: f64| self.place((value.clamp(low, high), low)).0;
            let (from, to) = (x(band.from), x(band.to).max(x(band.from) + 1.5));
            let (top, bottom) = (self.inner.y, self.inner.y + self.inner.height);
            let corners = [fine((from, top)), fine((to, bottom))];
            self.canvas.draw(&Rectangle::new(corners, VERMILION.mix(0.16).filled()))?;
            path(
                self.canvas,
                &[(from, top), (from, bottom)],
                Line { opacity: 0.7, ..Line::solid(VERMILION).weight(1) },
            )?;
            let width = wide(&band.label);
            let begin = from.min(self.inner.x + self.inner.width - width).max(self.inner.x);
            if let Some(row) = free_from.iter().position(|&free| free <= begin) {
                free_from[row] = begin + width + 8.0;
                let y = top - 3.0 - LINE * (row as f64 + 0.5);
                write(self.canvas, &band.label, (begin, y), HPos::Left, VPos::Center, VERMILION)?;
            }
        }
        Ok(())
    }

    fn curve(&self, points: &[Point], line: Line, over_x: bool) -> Result<(), Failed> {
        let placed = points.iter().filter(|(x, y)| x.is_finite() && y.is_finite());
        let placed = placed.map(|&at| {
            let (x, y) = self.place(at);
            (x * FINE, y * FINE)
        });
        let placed: Vec<Point> = placed.collect();
        let placed = if over_x { by_column(&placed, FINE / 2.0) } else { placed };
        let (top, bottom) = (self.inner.y * FINE, (self.inner.y + self.inner.height) * FINE);
        for part in clipped(&placed, top - 1.0, bottom + 1.0) {
            let kept: Vec<Point> = within(&part, TOLERANCE);
            let mut kept: Vec<Point> = kept.iter().map(|(x, y)| (x / FINE, y / FINE)).collect();
            if let [(x, y)] = kept[..] {
                kept.push((x + 1.0, y)); // one value alone is seen, too
            }
            path(self.canvas, &kept, line)?;
        }
        Ok(())
    }

    fn rule(&self, rule: &Rule) -> Result<(), Failed> {
        let (from, to) = (self.place(rule.from), self.place(rule.to));
        let within = |(_, y): Point| {
            (self.inner.y - 1.0..=self.inner.y + self.inner.height + 1.0).contains(&y)
        };
        if !within(from) || !within(to) {
            return Ok(());
        }
        path(self.canvas, &[from, to], rule.line)?;
        let color = rule.line.color;
        if from.1 == to.1 {
            // Above its right end, or below it where there is no room above.
            let above = from.1 - self.inner.y > LINE + 2.0;
            let y = if above { from.1 - 0.6 * LINE } else { from.1 + 0.7 * LINE };
            let ends = self.place((rule.label_ends, rule.to.1)).0 - 3.0;
            return words(self.canvas, &rule.label, (ends, y), HPos::Right, color);
        }
        let right = from.0 + 4.0 + wide(&rule.label) < self.inner.x + self.inner.width;
        let (x, side) =
            if right { (from.0 + 4.0, HPos::Left) } else { (from.0 - 4.0, HPos::Right) };
        words(self.canvas, &rule.label, (x, from.1.min(to.1) + 0.7 * LINE), side, color)
    }

    fn mark(&self, mark: &Mark) -> Result<(), Failed> {
        let (x, y) = self.place(mark.at);
        let line = Line::solid(mark.color).weight(4);
        match mark.shape {
            Shape::Cross => {
                path(self.canvas, &[(x - 3.5, y - 3.5), (x + 3.5, y + 3.5)], line)?;
                path(self.canvas, &[(x - 3.5, y + 3.5), (x + 3.5, y - 3.5)], line)?;
            }
            Shape::Ring => {
                let ring = style(mark.color, 1.0, line);
                self.canvas.draw(&Circle::new(fine((x, y)), (4.5 * FINE) as i32, ring))?;
            }
            Shape::Words => {
                return words(self.canvas, &mark.label, (x, y), HPos::Center, mark.color);
            }
        }
        let width = wide(&mark.label);
        let right = x + 9.0 + width < self.inner.x + self.inner.width;
        let (x, side) = if right { (x + 8.0, HPos::Left) } else { (x - 8.0, HPos::Right) };
        let lowest = self.inner.y + self.inner.height - 0.6 * LINE;
        words(
            self.canvas,
            &mark.label,
            (x, (y - 0.7 * LINE).clamp(self.inner.y + 6.0, lowest)),
            side,
            mark.color,
        )
    }
}

/// px as places on the fine canvas.
fn fine((x, y): Point) -> (i32, i32) {
    ((x * FINE).round() as i32, (y * FINE).round() as i32)
}

fn style(color: RGBColor, opacity: f64, line: Line) -> ShapeStyle {
    color.mix(opacity).stroke_width(width_of(line))
}

fn letters(color: RGBColor) -> TextStyle<'static> {
    // Plotters divides by this.
    ("sans-serif", LETTERS * FINE * 1.24).into_font().color(&color)
}

/// About how wide a text is, px.
fn wide(text: &str) -> f64 {
    text.chars().count() as f64 * LETTER
}

fn path(canvas: &Canvas<'_>, points: &[Point], line: Line) -> Result<(), Failed> {
    let points: Vec<_> = points.iter().map(|&at| fine(at)).collect();
    canvas.draw(&PathElement::new(points, style(line.color, line.opacity, line)))
}

fn write(
    canvas: &Canvas<'_>,
    text: &str,
    at: Point,
    h_pos: HPos,
    v_pos: VPos,
    color: RGBColor,
) -> Result<(), Failed> {
    // What XML has no words for.
    let text = text.replace(char::is_control, " ");
    let style = letters(color).pos(Pos::new(h_pos, v_pos));
    canvas.draw(&Text::new(text, fine(at), style))
}

/// Words on top of curves: on a pale ground.
fn words(
    canvas: &Canvas<'_>,
    text: &str,
    at: Point,
    h_pos: HPos,
    color: RGBColor,
) -> Result<(), Failed> {
    if text.is_empty() {
        return Ok(());
    }
    let width = wide(text);
    let left = match h_pos {
        HPos::Left => at.0,
        HPos::Center => at.0 - width / 2.0,
        HPos::Right => at.0 - width,
    };
    let corners =
        [fine((left - 2.0, at.1 - 0.5 * LINE)), fine((left + width + 2.0, at.1 + 0.5 * LINE))];
    canvas.draw(&Rectangle::new(corners, WHITE.mix(0.65).filled()))?;
    write(canvas, text, at, h_pos, VPos::Center, color)
}
