//! Figures as SVG for screen and print: panels with axes, their content, and a legend below.
//!
//! Lengths are in px of a page at 100 %. Must not depend on robots.

use crate::report::axis::Axis;
use crate::report::palette::{BLACK, Color, GRAY, LineStyle, VERMILION, WHITE};
use crate::report::simplify::{CanvasPoint, simplify_by_column, simplify_curve};
use crate::report::svg::{Anchor, SvgElement, format_px, path_data};

/// Font size, px.
const FONT_SIZE: f64 = 12.0;
/// Width of an average letter, px.
pub const LETTER_WIDTH: f64 = 6.3;
/// Line height of text, px.
const LINE_HEIGHT: f64 = 15.0;
/// Space for the numbers and the label of the x axis, px.
const BOTTOM_SPACE: f64 = 44.0;
/// Space for the numbers and the label of the y axis, px.
const LEFT_SPACE: f64 = 64.0;
/// Space on the right for half of the last number, px.
const RIGHT_SPACE: f64 = 18.0;
/// Tolerance of the simplification of curves, px. Smaller differences are not visible.
const SIMPLIFICATION_TOLERANCE: f64 = 0.08;
/// Width of a column, px. Of a curve over x at most four points per column are drawn.
const DECIMATION_BIN_WIDTH: f64 = 0.5;
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
    /// Legend: line styles and their descriptions.
    pub legend: Vec<(LineStyle, String)>,
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
        let top_space =
            if bands.is_empty() { 8.0 } else { 6.0 + LINE_HEIGHT * band_label_rows(bands) as f64 };
        Rect {
            x: self.x + LEFT_SPACE,
            y: self.y + top_space,
            width: self.width - LEFT_SPACE - RIGHT_SPACE,
            height: self.height - top_space - BOTTOM_SPACE,
        }
    }

    fn right_px(self) -> f64 {
        self.x + self.width
    }

    fn bottom_px(self) -> f64 {
        self.y + self.height
    }
}

/// Axes, and everything that is drawn in them.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Horizontal axis.
    pub x_axis: Axis,
    /// Vertical axis.
    pub y_axis: Axis,
    /// Tinted intervals of x.
    pub bands: Vec<Band>,
    /// Filled areas: corners, color and opacity.
    pub areas: Vec<(Vec<CanvasPoint>, Color, f64)>,
    /// Polylines: points, style, and whether x never decreases.
    pub curves: Vec<(Vec<CanvasPoint>, LineStyle, bool)>,
    /// Straight reference lines.
    pub reference_lines: Vec<ReferenceLine>,
    /// Labeled points.
    pub marks: Vec<Mark>,
}

/// A tinted interval of x.
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    /// Start of the interval.
    pub start_x: f64,
    /// End of the interval.
    pub end_x: f64,
    /// Label above the interval.
    pub label: String,
}

/// A horizontal or vertical reference line with a label.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceLine {
    /// Start of the line.
    pub start: CanvasPoint,
    /// End of the line.
    pub end: CanvasPoint,
    /// Label: of a horizontal line, ending at `label_end_x`; of a vertical line, at its top.
    pub label: String,
    /// x at which the label of a horizontal line ends.
    pub label_end_x: f64,
    /// Style of the line.
    pub style: LineStyle,
}

/// Shape of a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkShape {
    /// Cross-shaped mark at a point.
    Cross,
    /// A ring around a point.
    Ring,
    /// Text only, centered at the point.
    LabelOnly,
}

/// A labeled point.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// Position of the point.
    pub position: CanvasPoint,
    /// Shape of the mark.
    pub shape: MarkShape,
    /// Color of the mark.
    pub color: Color,
    /// Label next to the point.
    pub label: String,
}

impl Panel {
    /// Creates empty axes.
    pub fn new(x: Axis, y: Axis) -> Panel {
        Panel {
            x_axis: x,
            y_axis: y,
            bands: Vec::new(),
            areas: Vec::new(),
            curves: Vec::new(),
            reference_lines: Vec::new(),
            marks: Vec::new(),
        }
    }

    /// Returns the panel without labels of its bands, for a panel below one with the same bands.
    pub fn without_band_labels(mut self) -> Panel {
        self.bands.iter_mut().for_each(|band| band.label.clear());
        self
    }

    /// Adds a curve over x; `None` interrupts it.
    pub fn add_curve(
        &mut self,
        points: impl IntoIterator<Item = Option<CanvasPoint>>,
        style: LineStyle,
    ) {
        let points = points.into_iter().map(|point| point.filter(is_finite));
        let points: Vec<Option<CanvasPoint>> = points.collect();
        for segment in points.split(Option::is_none).filter(|segment| !segment.is_empty()) {
            self.curves.push((segment.iter().flatten().copied().collect(), style, true));
        }
    }

    /// Adds a closed polyline.
    pub fn add_outline(&mut self, mut corners: Vec<CanvasPoint>, style: LineStyle) {
        corners.extend(corners.first().copied());
        self.curves.push((corners, style, false));
    }

    /// Adds a horizontal line from `start` to `end`, labeled at its right end.
    pub fn add_horizontal_line(
        &mut self,
        y: f64,
        (start, end): (f64, f64),
        label: String,
        style: LineStyle,
    ) {
        let (start, end) = ((start, y), (end, y));
        self.reference_lines.push(ReferenceLine { start, end, label, label_end_x: end.0, style });
    }

    /// Adds a vertical line from the bottom to a fraction of the height.
    pub fn add_vertical_line(
        &mut self,
        x: f64,
        height_fraction: f64,
        label: String,
        style: LineStyle,
    ) {
        let (start, end) =
            ((x, self.y_axis.value_at(height_fraction)), (x, self.y_axis.value_at(0.0)));
        self.reference_lines.push(ReferenceLine { start, end, label, label_end_x: x, style });
    }

    /// Draws the panel with its axes in a rectangle.
    pub fn draw(&self, outer: Rect) -> SvgElement {
        let drawing = PanelDrawing { panel: self, plot_area: outer.plot_area(&self.bands) };
        let Rect { x, y, width, height } = drawing.plot_area;
        let (both_margins, margin) = (2.0 * HALF_LINE_WIDTH, HALF_LINE_WIDTH);
        let mut clip =
            SvgElement::clip([x - margin, y - margin, width + both_margins, height + both_margins]);
        clip.extend(self.bands.iter().flat_map(|band| drawing.draw_band(band)));
        clip.push(drawing.draw_grid());
        clip.extend(self.areas.iter().map(|(corners, color, opacity)| {
            SvgElement::path(&(drawing.path_data(corners) + "Z")).with_fill(*color, *opacity)
        }));
        clip.extend(self.curves.iter().filter_map(|curve| drawing.draw_curve(curve)));
        let visible_lines = || self.reference_lines.iter().filter(|line| drawing.is_in_range(line));
        let line_path = |line: &ReferenceLine| {
            path_data([drawing.project(line.start), drawing.project(line.end)])
        };
        clip.extend(
            visible_lines().map(|line| SvgElement::path(&line_path(line)).with_stroke(line.style)),
        );
        clip.extend(self.marks.iter().filter_map(|mark| drawing.draw_mark(mark)));
        let mut group = SvgElement::new("g").with_child(clip);
        group.extend(drawing.draw_band_labels());
        group.extend(drawing.draw_axes(outer));
        group.extend(visible_lines().filter_map(|line| drawing.draw_reference_line_label(line)));
        group.extend(self.marks.iter().filter_map(|mark| drawing.draw_mark_label(mark)));
        group
    }
}

fn is_finite(&(x, y): &CanvasPoint) -> bool {
    x.is_finite() && y.is_finite()
}

/// Returns the number of rows for the labels of bands, at most 3.
fn band_label_rows(bands: &[Band]) -> usize {
    bands.len().clamp(1, 3)
}

impl Figure {
    /// Creates a figure of one panel.
    pub fn single_panel(
        name: &'static str,
        title: &str,
        caption: String,
        rect: Rect,
        panel: Panel,
        legend: Vec<(LineStyle, String)>,
    ) -> Figure {
        let (title, width) = (title.to_owned(), rect.width);
        Figure { name, title, caption, width, panels: vec![(rect, panel)], legend }
    }

    /// Returns the figure as an SVG file.
    pub fn to_svg(&self) -> String {
        let panels_bottom =
            self.panels.iter().map(|(rect, _)| rect.bottom_px()).fold(0.0, f64::max);
        let rows = self.legend_rows();
        let height = panels_bottom + rows.len() as f64 * LINE_HEIGHT + 6.0;
        let svg = SvgElement::root(self.width, height, "Helvetica, Arial, sans-serif");
        let mut svg = svg
            .with_attribute("role", "img")
            .with_attribute("font-size", FONT_SIZE)
            .with_attribute("stroke-linejoin", "round")
            .with_child(SvgElement::new("title").with_text(&self.title))
            .with_child(SvgElement::new("desc").with_text(&self.caption))
            .with_child(SvgElement::rect([0.0, 0.0, self.width, height]).with_fill(WHITE, 1.0));
        svg.extend(self.panels.iter().map(|(rect, panel)| panel.draw(*rect)));
        for (row, entries) in rows.into_iter().enumerate() {
            let y = panels_bottom + (row as f64 + 0.5) * LINE_HEIGHT;
            for (x, (style, text)) in entries {
                svg.push(SvgElement::path(&path_data([(x, y), (x + 26.0, y)])).with_stroke(*style));
                svg.push(SvgElement::text(text, centered_baseline((x + 31.0, y)), Anchor::Start));
            }
        }
        format!("{svg}\n")
    }

    /// Arranges the legend in rows. Returns the x position of each entry, and the entry.
    fn legend_rows(&self) -> Vec<Vec<(f64, &(LineStyle, String))>> {
        let mut rows: Vec<Vec<_>> = Vec::new();
        let mut x = f64::INFINITY;
        for entry in &self.legend {
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
struct PanelDrawing<'a> {
    panel: &'a Panel,
    plot_area: Rect,
}

impl PanelDrawing<'_> {
    fn project(&self, (x, y): CanvasPoint) -> CanvasPoint {
        let clamped_fraction =
            |axis: &Axis, value| axis.fraction(value).clamp(-POSITION_MAX, POSITION_MAX);
        let Rect { x: left, y: top, width, height } = self.plot_area;
        let (x_fraction, y_fraction) =
            (clamped_fraction(&self.panel.x_axis, x), clamped_fraction(&self.panel.y_axis, y));
        (left + x_fraction * width, top + (1.0 - y_fraction) * height)
    }

    fn path_data(&self, points: &[CanvasPoint]) -> String {
        path_data(points.iter().filter(|point| is_finite(point)).map(|&point| self.project(point)))
    }

    /// Returns for each axis the positions, px, and texts of the ticks, and its label.
    fn ticks(&self) -> [(Vec<(f64, String)>, String); 2] {
        let Rect { width, height, .. } = self.plot_area;
        let tick_count = |length: f64, spacing: f64| ((length / spacing) as usize).clamp(2, 12);
        let Panel { x_axis: x, y_axis: y, .. } = self.panel;
        let axis_ticks = |axis: &Axis, tick_count, position_px: &dyn Fn(f64) -> f64| {
            let (ticks, label) = axis.tick_labels(tick_count);
            let labeled =
                ticks.into_iter().map(|(tick, text)| (position_px(axis.fraction(tick)), text));
            (labeled.collect(), label)
        };
        [
            axis_ticks(x, tick_count(width, 62.0), &|fraction| self.plot_area.x + fraction * width),
            axis_ticks(y, tick_count(height, 28.0), &|fraction| {
                self.plot_area.bottom_px() - fraction * height
            }),
        ]
    }

    fn draw_grid(&self) -> SvgElement {
        let Rect { x, y, width, height } = self.plot_area;
        let [(x_ticks, _), (y_ticks, _)] = self.ticks();
        let vertical = x_ticks.iter().map(|(position, _)| {
            format!("M{} {}v{}", format_px(*position), format_px(y), format_px(height))
        });
        let horizontal = y_ticks.iter().map(|(position, _)| {
            format!("M{} {}h{}", format_px(x), format_px(*position), format_px(width))
        });
        let lines: String = vertical.chain(horizontal).collect();
        SvgElement::path(&lines)
            .with_stroke(LineStyle::solid(GRAY).with_width(0.4).with_opacity(0.25))
    }

    fn draw_axes(&self, outer: Rect) -> Vec<SvgElement> {
        let inner = self.plot_area;
        let (right, bottom) = (inner.right_px(), inner.bottom_px());
        let [(x_ticks, x_label), (y_ticks, y_label)] = self.ticks();
        let mut lines = path_data([(inner.x, inner.y), (inner.x, bottom), (right, bottom)]);
        lines.extend(
            x_ticks
                .iter()
                .map(|(position, _)| format!("M{} {}v5", format_px(*position), format_px(bottom))),
        );
        lines.extend(
            y_ticks.iter().map(|(position, _)| {
                format!("M{} {}h-5", format_px(inner.x), format_px(*position))
            }),
        );
        let mut elements =
            vec![SvgElement::path(&lines).with_stroke(LineStyle::solid(BLACK).with_width(0.8))];
        let number = |(position, number): &(f64, String)| {
            SvgElement::text(number, centered_baseline((*position, bottom + 13.0)), Anchor::Middle)
        };
        elements.extend(x_ticks.iter().map(number));
        let number = |(position, number): &(f64, String)| {
            SvgElement::text(number, centered_baseline((inner.x - 8.0, *position)), Anchor::End)
        };
        elements.extend(y_ticks.iter().map(number));
        let x_label_position = (inner.x + inner.width / 2.0, outer.bottom_px() - 0.5 * LINE_HEIGHT);
        elements.push(SvgElement::text(
            &x_label,
            centered_baseline(x_label_position),
            Anchor::Middle,
        ));
        let y_label_position = (outer.x + 14.0, inner.y + inner.height / 2.0);
        let rotation = format!(
            "translate({} {}) rotate(-90)",
            format_px(y_label_position.0),
            format_px(y_label_position.1)
        );
        let label = SvgElement::text(&y_label, (0.0, 0.0), Anchor::Middle);
        elements.push(label.with_attribute("transform", rotation));
        elements
    }

    /// Returns the horizontal extent of a band, px.
    fn band_extent_px(&self, band: &Band) -> (f64, f64) {
        let x = |value: f64| {
            self.project((value, 0.0)).0.clamp(self.plot_area.x, self.plot_area.right_px())
        };
        (x(band.start_x), x(band.end_x).max(x(band.start_x) + 1.5))
    }

    fn draw_band(&self, band: &Band) -> [SvgElement; 2] {
        let ((left, right), Rect { y, height, .. }) = (self.band_extent_px(band), self.plot_area);
        let border_style = LineStyle::solid(VERMILION).with_width(0.4).with_opacity(0.7);
        [
            SvgElement::rect([left, y, right - left, height]).with_fill(VERMILION, 0.16),
            SvgElement::path(&path_data([(left, y), (left, y + height)])).with_stroke(border_style),
        ]
    }

    /// Returns the labels of the bands that fit.
    fn draw_band_labels(&self) -> Vec<SvgElement> {
        let mut free_x = vec![f64::NEG_INFINITY; band_label_rows(&self.panel.bands)];
        let mut labels = Vec::new();
        for band in &self.panel.bands {
            let width = text_width(&band.label);
            let left = self
                .band_extent_px(band)
                .0
                .min(self.plot_area.right_px() - width)
                .max(self.plot_area.x);
            let Some(row) = free_x.iter().position(|&free_x| free_x <= left) else { continue };
            free_x[row] = left + width + 8.0;
            let position = centered_baseline((
                left,
                self.plot_area.y - 3.0 - LINE_HEIGHT * (row as f64 + 0.5),
            ));
            labels.push(
                SvgElement::text(&band.label, position, Anchor::Start).with_fill(VERMILION, 1.0),
            );
        }
        labels
    }

    fn draw_curve(
        &self,
        (points, style, is_over_x): &(Vec<CanvasPoint>, LineStyle, bool),
    ) -> Option<SvgElement> {
        let projected =
            points.iter().filter(|point| is_finite(point)).map(|&point| self.project(point));
        let projected: Vec<CanvasPoint> = projected.collect();
        let projected = if *is_over_x {
            simplify_by_column(&projected, DECIMATION_BIN_WIDTH)
        } else {
            projected
        };
        let mut simplified = simplify_curve(&projected, SIMPLIFICATION_TOLERANCE);
        if let [(x, y)] = simplified[..] {
            simplified.push((x + 1.0, y)); // a single value is drawn as a short line
        }
        (!simplified.is_empty())
            .then(|| SvgElement::path(&path_data(simplified)).with_stroke(*style))
    }

    fn is_in_range(&self, line: &ReferenceLine) -> bool {
        let rows = self.plot_area.y - 1.0..=self.plot_area.bottom_px() + 1.0;
        [line.start, line.end]
            .iter()
            .all(|&point| is_finite(&point) && rows.contains(&self.project(point).1))
    }

    fn draw_reference_line_label(&self, line: &ReferenceLine) -> Option<SvgElement> {
        let (start, end) = (self.project(line.start), self.project(line.end));
        if start.1 == end.1 {
            // Above the right end, or below it if there is no space above.
            let has_space_above = start.1 - self.plot_area.y > LINE_HEIGHT + 2.0;
            let y = if has_space_above {
                start.1 - 0.6 * LINE_HEIGHT
            } else {
                start.1 + 0.7 * LINE_HEIGHT
            };
            let label_end = self.project((line.label_end_x, line.end.1)).0 - 3.0;
            return text_with_background(
                &line.label,
                (label_end, y),
                Anchor::End,
                line.style.color,
            );
        }
        let (x, anchor) = self.label_position(start.0, 4.0, &line.label);
        text_with_background(
            &line.label,
            (x, start.1.min(end.1) + 0.7 * LINE_HEIGHT),
            anchor,
            line.style.color,
        )
    }

    fn draw_mark(&self, mark: &Mark) -> Option<SvgElement> {
        let (x, y) = self.project(mark.position);
        let shape = match mark.shape {
            _ if !is_finite(&(x, y)) => return None,
            MarkShape::Cross => {
                let [left, top] = [x - 3.5, y - 3.5].map(format_px);
                SvgElement::path(&format!("M{left} {top}l7 7m0 -7l-7 7"))
            }
            MarkShape::Ring => SvgElement::circle((x, y), 4.5),
            MarkShape::LabelOnly => return None,
        };
        Some(shape.with_stroke(LineStyle::solid(mark.color).with_width(1.6)))
    }

    fn draw_mark_label(&self, mark: &Mark) -> Option<SvgElement> {
        let (x, y) = self.project(mark.position);
        if !is_finite(&(x, y)) {
            return None;
        }
        if mark.shape == MarkShape::LabelOnly {
            return text_with_background(&mark.label, (x, y), Anchor::Middle, mark.color);
        }
        let (x, anchor) = self.label_position(x, 8.0, &mark.label);
        let lowest = self.plot_area.bottom_px() - 0.6 * LINE_HEIGHT;
        let y = (y - 0.7 * LINE_HEIGHT).min(lowest).max(self.plot_area.y + 6.0);
        text_with_background(&mark.label, (x, y), anchor, mark.color)
    }

    /// Returns the position and the alignment of a label at this distance to the right of x, or to the left if
    /// there is no space.
    fn label_position(&self, x: f64, gap: f64, label: &str) -> (f64, Anchor) {
        match x + gap + 1.0 + text_width(label) < self.plot_area.right_px() {
            true => (x + gap, Anchor::Start),
            false => (x - gap, Anchor::End),
        }
    }
}

/// Returns the base line of a text that is vertically centered at this point.
fn centered_baseline((x, y): CanvasPoint) -> CanvasPoint {
    (x, y + 0.35 * FONT_SIZE)
}

/// Returns the estimated width of a text, px.
fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * LETTER_WIDTH
}

/// Returns a text on a translucent background, for drawing over curves; `None` for an empty text.
fn text_with_background(
    text: &str,
    position: CanvasPoint,
    anchor: Anchor,
    color: Color,
) -> Option<SvgElement> {
    let width = text_width(text);
    let left = match anchor {
        Anchor::Start => position.0,
        Anchor::Middle => position.0 - width / 2.0,
        Anchor::End => position.0 - width,
    };
    let background =
        SvgElement::rect([left - 2.0, position.1 - 0.5 * LINE_HEIGHT, width + 4.0, LINE_HEIGHT]);
    let element = SvgElement::text(text, centered_baseline(position), anchor).with_fill(color, 1.0);
    let group =
        SvgElement::new("g").with_child(background.with_fill(WHITE, 0.65)).with_child(element);
    (!text.is_empty()).then_some(group)
}
