//! A run as a picture that moves by itself: one SVG without scripts, for pages that show pictures
//! only.
//!
//! On the left the robots in the plane, as the replay shows them; on the right the largest error and
//! the smallest distance over time, with a line that walks along. All of it is linear between the
//! same instants.

use std::fmt::Write as _;

use formation::Vec2;
use formation::front_point::front_point;
use formation::obstacle::Obstacle;
use formation::pose::Pose;
use plotters::style::RGBColor;

use crate::report::axis::Axis;
use crate::report::digits::asked;
use crate::report::markup::escaped;
use crate::report::palette::{self, BLACK, BLUE, GRAY, ORANGE, VERMILION};
use crate::report::run::Run;
use crate::report::scene::{EdgeState, Frame, RobotState};
use crate::report::simplify::{Point, by_column, within};

/// The whole picture, px.
const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 520.0;
/// Of the plane, px: its width, from the top, and as high as this.
const PLANE_WIDTH: f64 = 560.0;
const PLANE: (f64, f64) = (38.0, 472.0);
/// Of each strip beside it, px: from the top, and as high as this.
const STRIPS: [(f64, f64); 2] = [(74.0, 120.0), (232.0, 120.0)];
/// From where to where time goes from left to right, px.
const TIME: (f64, f64) = (620.0, 880.0);
/// What is told below the strips: from the top, px.
const LEGEND: f64 = 410.0;
/// It lasts no longer than this, s: a longer run is shown faster.
const LASTS_S_MAX: f64 = 20.0;
/// So many instants per second that it lasts, and no more bytes than this for all of them.
const INSTANTS_HZ: f64 = 12.0;
const BYTES_MAX: usize = 800_000;
/// Trails are as long as this, px.
const TRAIL: f64 = 90.0;
/// Names up to this many robots.
const NAMES_MAX: usize = 24;

/// The animation of a run; `None` if nothing was recorded.
pub fn animation(run: &Run) -> Option<String> {
    let frames = instants(run);
    if frames.len() < 2 {
        return None;
    }
    let lasts_s = (frames[frames.len() - 1].t_s - frames[0].t_s).clamp(1.0, LASTS_S_MAX);
    let view = View::of(run, &frames)?;
    let mut svg = Svg { text: String::new(), lasts_s };
    svg.line(format_args!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" \
         height=\"{HEIGHT}\" font-family=\"system-ui, sans-serif\" font-size=\"13\">"
    ));
    svg.line(format_args!("<title>{}</title>", escaped(&run.scene.name)));
    svg.line(format_args!(
        "<defs><marker id=\"way\" viewBox=\"-5 -4 8 8\" markerWidth=\"7\" markerHeight=\"7\" \
         orient=\"auto\"><path d=\"M3 0L-5 3.5V-3.5Z\" fill=\"context-stroke\"/></marker>\
         <clipPath id=\"plane\"><rect width=\"{PLANE_WIDTH}\" y=\"{}\" height=\"{}\"/></clipPath></defs>",
        PLANE.0, PLANE.1
    ));
    svg.line(format_args!(
        "<rect x=\".5\" y=\".5\" width=\"{}\" height=\"{}\" rx=\"8\" fill=\"#fff\" stroke=\"#d0d7de\"/>",
        WIDTH - 1.0,
        HEIGHT - 1.0
    ));
    heading(&mut svg, run, &frames);
    svg.line(format_args!("<g clip-path=\"url(#plane)\">"));
    ground(&mut svg, run, &view);
    walls(&mut svg, run, &view);
    trails(&mut svg, run, &frames, &view);
    hull(&mut svg, run, &frames, &view);
    edges(&mut svg, run, &frames, &view);
    robots(&mut svg, run, &frames, &view);
    svg.line(format_args!("</g>"));
    strips(&mut svg, run, &frames);
    legend(&mut svg, run);
    svg.line(format_args!("</svg>"));
    Some(svg.text)
}

/// Equally spaced frames of the replay.
fn instants(run: &Run) -> Vec<Frame> {
    let mut frames = run.frames();
    // The last one comes when the run ends, whenever that is.
    if frames.len() > 2 {
        frames.pop();
    }
    let (robots, edges) = (run.scene.robots.len(), run.scene.edges.len());
    let bytes = 50 * robots + 38 * edges + 20;
    let lasts_s = run.end_s().min(LASTS_S_MAX);
    let most = ((lasts_s * INSTANTS_HZ) as usize).min(BYTES_MAX / bytes).max(2);
    let every = frames.len().div_ceil(most);
    frames.into_iter().step_by(every).collect()
}

/// From the plane to the picture.
struct View {
    /// What is in the middle, m.
    middle: Vec2,
    /// px per m.
    scale: f64,
}

impl View {
    fn of(run: &Run, frames: &[Frame]) -> Option<View> {
        let places = frames.iter().flat_map(|frame| fronts(run, frame)).filter(|at| known(*at));
        let (low, high) = places
            .fold((Vec2::repeat(1e300), Vec2::repeat(-1e300)), |(low, high), at| {
                (low.inf(&at), high.sup(&at))
            });
        if low.x > high.x {
            return None;
        }
        let room = high - low + Vec2::repeat(1.6 * run.scene.distance_min_m + 0.1);
        let scale = (PLANE_WIDTH / room.x).min(PLANE.1 / room.y);
        Some(View { middle: (low + high) / 2.0, scale })
    }

    fn at(&self, place: Vec2) -> Point {
        let from_middle = (place - self.middle) * self.scale;
        (PLANE_WIDTH / 2.0 + from_middle.x, PLANE.0 + PLANE.1 / 2.0 - from_middle.y)
    }
}

/// Front points at an instant, m.
fn fronts<'a>(run: &'a Run, frame: &'a Frame) -> impl Iterator<Item = Vec2> + 'a {
    frame.robots.iter().zip(&run.scene.robots).map(|(at, robot)| {
        let pose = Pose { x_m: at.x_m, y_m: at.y_m, heading_rad: at.heading_rad };
        front_point(pose, robot.front_point_m)
    })
}

fn known(at: Vec2) -> bool {
    at.x.is_finite() && at.y.is_finite()
}

/// The picture so far.
struct Svg {
    text: String,
    lasts_s: f64,
}

impl Svg {
    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "{line}");
    }

    /// Lets an attribute go through these values.
    fn animate(&mut self, attribute: &str, values: &[String]) {
        if values.windows(2).any(|pair| pair[0] != pair[1]) {
            let lasts_s = self.lasts_s;
            self.line(format_args!(
                "<animate attributeName=\"{attribute}\" dur=\"{lasts_s}s\" repeatCount=\"indefinite\" \
                 values=\"{}\"/>",
                values.join(";")
            ));
        }
    }

    fn transform(&mut self, kind: &str, values: &[String]) {
        let lasts_s = self.lasts_s;
        self.line(format_args!(
            "<animateTransform attributeName=\"transform\" type=\"{kind}\" dur=\"{lasts_s}s\" \
             repeatCount=\"indefinite\" values=\"{}\"/>",
            values.join(";")
        ));
    }

    /// Lets an attribute jump where its value changes.
    fn switch(&mut self, attribute: &str, values: &[&str]) {
        let last = (values.len() - 1).max(1) as f64;
        let changes: Vec<(f64, &str)> = values
            .iter()
            .enumerate()
            .filter(|&(i, value)| i == 0 || values[i - 1] != *value)
            .map(|(i, value)| (i as f64 / last, *value))
            .collect();
        if changes.len() > 1 {
            let times: Vec<String> = changes.iter().map(|(at, _)| format!("{at:.4}")).collect();
            let words: Vec<&str> = changes.iter().map(|(_, value)| *value).collect();
            let lasts_s = self.lasts_s;
            self.line(format_args!(
                "<animate attributeName=\"{attribute}\" dur=\"{lasts_s}s\" repeatCount=\"indefinite\" \
                 calcMode=\"discrete\" keyTimes=\"{}\" values=\"{}\"/>",
                times.join(";"),
                words.join(";")
            ));
        }
    }
}

fn px(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").unwrap_or(&text).to_owned()
}

fn hex(RGBColor(r, g, b): RGBColor) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn way(points: impl IntoIterator<Item = Point>) -> String {
    let steps: Vec<String> =
        points.into_iter().map(|(x, y)| format!("{} {}", px(x), px(y))).collect();
    format!("M{}", steps.join("L"))
}

/// What is shown, and what is wrong just now.
fn heading(svg: &mut Svg, run: &Run, frames: &[Frame]) {
    let scene = &run.scene;
    svg.line(format_args!(
        "<text x=\"16\" y=\"25\" font-size=\"15\" font-weight=\"600\">{}</text>",
        escaped(&scene.name)
    ));
    for fault in &scene.faults {
        let shown: Vec<&str> =
            frames.iter().map(|frame| if lasts(fault, frame.t_s) { "1" } else { "0" }).collect();
        svg.line(format_args!(
            "<text x=\"{}\" y=\"25\" font-size=\"15\" font-weight=\"600\" text-anchor=\"end\" \
             fill=\"{}\" opacity=\"{}\">{}",
            WIDTH - 16.0,
            hex(VERMILION),
            shown[0],
            escaped(&fault.what)
        ));
        svg.switch("opacity", &shown);
        svg.line(format_args!("</text>"));
    }
}

fn lasts(fault: &crate::report::scene::SceneFault, t_s: f64) -> bool {
    fault.t_s <= t_s && fault.until_s.is_none_or(|until_s| t_s < until_s)
}

/// A grid of meters, and where the leader is to go.
fn ground(svg: &mut Svg, run: &Run, view: &View) {
    let step_m = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 50.0, 100.0];
    let step_m = step_m.into_iter().find(|m| m * view.scale >= 40.0).unwrap_or(1000.0);
    let half = Vec2::new(PLANE_WIDTH, PLANE.1) / 2.0 / view.scale;
    let lines = |low: f64, high: f64| {
        let first = (low / step_m).ceil() as i64;
        (first..).map(move |n| n as f64 * step_m).take_while(move |&at| at <= high)
    };
    let mut grid = String::new();
    for x in lines(view.middle.x - half.x, view.middle.x + half.x) {
        let (x, _) = view.at(Vec2::new(x, 0.0));
        let _ = write!(grid, "M{} {}v{}", px(x), PLANE.0, PLANE.1);
    }
    for y in lines(view.middle.y - half.y, view.middle.y + half.y) {
        let (_, y) = view.at(Vec2::new(0.0, y));
        let _ = write!(grid, "M0 {}h{PLANE_WIDTH}", px(y));
    }
    svg.line(format_args!("<path d=\"{grid}\" stroke=\"#eceff2\" fill=\"none\"/>"));
    let lead: Vec<Point> = run.lead_m.iter().map(|&[x, y]| view.at(Vec2::new(x, y))).collect();
    if lead.len() > 1 {
        svg.line(format_args!(
            "<path d=\"{}\" stroke=\"{}\" stroke-opacity=\".5\" stroke-dasharray=\"1 5\" \
             stroke-linecap=\"round\" stroke-width=\"2\" fill=\"none\"/>",
            way(within(&lead, 0.4)),
            hex(GRAY)
        ));
    }
    svg.line(format_args!(
        "<path d=\"M16 {y}h{}\" stroke=\"#57606a\" stroke-width=\"2\"/><text x=\"{}\" y=\"{}\" \
         fill=\"#57606a\">{} m</text>",
        px(step_m * view.scale),
        px(22.0 + step_m * view.scale),
        PLANE.0 + PLANE.1 - 8.0,
        asked(step_m),
        y = PLANE.0 + PLANE.1 - 12.0,
    ));
}

/// What stands in the way.
fn walls(svg: &mut Svg, run: &Run, view: &View) {
    let shape = |wall: &Obstacle| match wall {
        Obstacle::Disc { center_m, radius_m } => {
            let ((x, y), r) = (view.at(Vec2::from(*center_m)), px(radius_m * view.scale));
            let left = px(x - radius_m * view.scale);
            let across = px(2.0 * radius_m * view.scale);
            format!("M{left} {}a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0Z", px(y))
        }
        polygon => way(polygon.outline().into_iter().map(|corner| view.at(corner))) + "Z",
    };
    let shapes: String = run.scene.walls.iter().map(shape).collect();
    if !shapes.is_empty() {
        svg.line(format_args!(
            "<path d=\"{shapes}\" fill=\"#d0d7de\" stroke=\"#57606a\" stroke-width=\"2.5\" \
             stroke-linejoin=\"round\"/>"
        ));
    }
}

/// Where each robot was lately: a dash that moves along its path.
fn trails(svg: &mut Svg, run: &Run, frames: &[Frame], view: &View) {
    for robot in 0..run.scene.robots.len() {
        let places: Vec<Point> = path(run, frames, view, robot);
        let mut lengths = vec![0.0];
        for pair in places.windows(2) {
            let step = (pair[1].0 - pair[0].0).hypot(pair[1].1 - pair[0].1);
            lengths.push(lengths[lengths.len() - 1] + step);
        }
        let whole = lengths[lengths.len() - 1];
        if whole < 1.0 {
            continue;
        }
        let offsets: Vec<String> = lengths.iter().map(|length| px(TRAIL - length)).collect();
        svg.line(format_args!(
            "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-opacity=\".45\" stroke-width=\"2.5\" \
             stroke-linejoin=\"round\" stroke-dasharray=\"{TRAIL} {}\" stroke-dashoffset=\"{TRAIL}\">",
            way(places),
            hex(palette::color(robot)),
            px(whole + TRAIL)
        ));
        svg.animate("stroke-dashoffset", &offsets);
        svg.line(format_args!("</path>"));
    }
}

fn path(run: &Run, frames: &[Frame], view: &View, robot: usize) -> Vec<Point> {
    let mut last = view.middle;
    let places = frames.iter().map(|frame| {
        let at = fronts(run, frame).nth(robot).expect("each frame has every robot");
        last = if known(at) { at } else { last };
        view.at(last)
    });
    places.collect()
}

/// The hull of the leaders, in which the contained are to be.
fn hull(svg: &mut Svg, run: &Run, frames: &[Frame], view: &View) {
    let Some((_, leaders)) = run.containment() else { return };
    let shapes: Vec<String> = frames
        .iter()
        .map(|frame| {
            let places: Vec<Vec2> = fronts(run, frame).collect();
            let leaders: Vec<Vec2> = leaders.iter().map(|&robot| places[robot]).collect();
            let mut corners = formation::hull::convex_hull(&leaders);
            // As many corners at every instant, from the first leader on, so that it can go over from
            // one to the next.
            let first = leaders.iter().find_map(|leader| corners.iter().position(|c| c == leader));
            corners.rotate_left(first.unwrap_or(0));
            let last = corners.last().copied().unwrap_or(view.middle);
            corners.resize(leaders.len(), last);
            way(corners.into_iter().map(|corner| view.at(corner)))
        })
        .collect();
    svg.line(format_args!(
        "<path d=\"{}\" fill=\"{orange}\" fill-opacity=\".13\" stroke=\"{orange}\" stroke-width=\"1.5\" \
         stroke-linejoin=\"round\">",
        shapes[0],
        orange = hex(ORANGE),
    ));
    svg.animate("d", &shapes);
    svg.line(format_args!("</path>"));
}

/// Who hears whom: an arrow the way information flows, broken where none does.
fn edges(svg: &mut Svg, run: &Run, frames: &[Frame], view: &View) {
    for (place, edge) in run.scene.edges.iter().enumerate() {
        let (from, to) = (path(run, frames, view, edge.from), path(run, frames, view, edge.to));
        let shapes: Vec<String> = from
            .iter()
            .zip(&to)
            .map(|(&(x, y), &(u, v))| {
                way([(x, y), (x + 0.66 * (u - x), y + 0.66 * (v - y)), (u, v)])
            })
            .collect();
        let state = |frame: &Frame| frame.edges[place];
        let colors: Vec<String> = frames
            .iter()
            .map(|frame| match state(frame) {
                EdgeState::Fresh => hex(GRAY),
                EdgeState::Stale => hex(ORANGE),
                EdgeState::Lost | EdgeState::Cut | EdgeState::Dead => hex(VERMILION),
            })
            .collect();
        let dashes: Vec<&str> = frames
            .iter()
            .map(|frame| match state(frame) {
                EdgeState::Fresh | EdgeState::Stale => "1 0",
                EdgeState::Lost | EdgeState::Cut | EdgeState::Dead => "3 5",
            })
            .collect();
        let colors: Vec<&str> = colors.iter().map(String::as_str).collect();
        svg.line(format_args!(
            "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-dasharray=\"{}\" stroke-width=\"1.3\" \
             marker-mid=\"url(#way)\">",
            shapes[0], colors[0], dashes[0]
        ));
        svg.animate("d", &shapes);
        svg.switch("stroke", &colors);
        svg.switch("stroke-dasharray", &dashes);
        svg.line(format_args!("</path>"));
    }
}

/// The robots, each with a circle of radius d/2 around its front point.
fn robots(svg: &mut Svg, run: &Run, frames: &[Frame], view: &View) {
    let reach = px(run.scene.distance_min_m / 2.0 * view.scale);
    for (i, robot) in run.scene.robots.iter().enumerate() {
        let places: Vec<String> = path(run, frames, view, i)
            .into_iter()
            .map(|(x, y)| format!("{},{}", px(x), px(y)))
            .collect();
        let mut heading_rad = 0.0;
        let mut turned = |frame: &Frame| {
            let turn = frame.robots[i].heading_rad - heading_rad;
            if turn.is_finite() {
                heading_rad += turn.sin().atan2(turn.cos());
            }
            px(-heading_rad.to_degrees())
        };
        let headings: Vec<String> = frames.iter().map(&mut turned).collect();
        let own = hex(palette::color(i));
        let gray = hex(GRAY);
        let state = |frame: &Frame| frame.robots[i].state;
        let colors: Vec<&str> = frames
            .iter()
            .map(|frame| if state(frame).moves() { own.as_str() } else { &gray })
            .collect();
        let crossed: Vec<&str> = frames
            .iter()
            .map(|frame| if state(frame) == RobotState::Dead { "1" } else { "0" })
            .collect();
        let length = (robot.front_point_m * view.scale).max(9.0);
        svg.line(format_args!("<g transform=\"translate({})\" fill=\"{own}\">", places[0]));
        svg.transform("translate", &places);
        svg.switch("fill", &colors);
        svg.line(format_args!(
            "<circle r=\"{reach}\" fill-opacity=\".1\" stroke=\"#57606a\" stroke-opacity=\".35\"/>"
        ));
        svg.line(format_args!("<g transform=\"rotate({})\">", headings[0]));
        svg.transform("rotate", &headings);
        svg.line(format_args!(
            "<path d=\"M{} 0L{} {}L{} 0L{} {}Z\" stroke=\"#fff\" stroke-width=\"1\"/></g>",
            px(0.35 * length),
            px(-1.35 * length),
            px(0.75 * length),
            px(-0.9 * length),
            px(-1.35 * length),
            px(-0.75 * length),
        ));
        let arm = px(1.1 * length);
        svg.line(format_args!(
            "<path d=\"M-{arm} -{arm}L{arm} {arm}M{arm} -{arm}L-{arm} {arm}\" stroke=\"{}\" \
             stroke-width=\"3\" opacity=\"{}\">",
            hex(VERMILION),
            crossed[0]
        ));
        svg.switch("opacity", &crossed);
        svg.line(format_args!("</path>"));
        if run.scene.robots.len() <= NAMES_MAX {
            svg.line(format_args!(
                "<text y=\"-{}\" text-anchor=\"middle\" fill=\"#24292f\" \
                 stroke=\"#fff\" stroke-width=\"3\" paint-order=\"stroke\">{}</text>",
                px(length.max(run.scene.distance_min_m / 2.0 * view.scale) + 4.0),
                escaped(&robot.name)
            ));
        }
        svg.line(format_args!("</g>"));
    }
}

/// The largest error and the smallest distance over time.
fn strips(svg: &mut Svg, run: &Run, frames: &[Frame]) {
    let (first_s, last_s) = (frames[0].t_s, frames[frames.len() - 1].t_s);
    let x = |t_s: f64| TIME.0 + (t_s - first_s) / (last_s - first_s).max(1e-9) * (TIME.1 - TIME.0);
    let d = run.scene.distance_min_m;
    let bottom = STRIPS[1].0 + STRIPS[1].1;
    for fault in &run.scene.faults {
        let (from, to) = (x(fault.t_s), x(fault.until_s.unwrap_or(last_s).min(last_s)));
        svg.line(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"{}\" fill-opacity=\".12\"/>",
            px(from),
            STRIPS[0].0,
            px((to - from).max(1.5)),
            bottom - STRIPS[0].0,
            hex(BLACK)
        ));
    }
    let all = run.frames();
    let errors = all.iter().map(|frame| {
        let living = frame.robots.iter().filter(|robot| robot.state.moves());
        (frame.t_s, living.filter_map(|robot| robot.error_m).fold(f64::NAN, f64::max))
    });
    let distances = all.iter().map(|frame| (frame.t_s, frame.distance_m.unwrap_or(f64::NAN)));
    let strips: [(&str, Vec<Point>, Option<f64>, RGBColor); 2] = [
        ("largest error, m", errors.collect(), None, BLACK),
        ("smallest distance, m", distances.collect(), Some(d), BLUE),
    ];
    for ((label, values, bound, color), (top, height)) in strips.into_iter().zip(STRIPS) {
        let values: Vec<Point> =
            values.into_iter().filter(|(_, value)| value.is_finite()).collect();
        let most = values.iter().map(|value| value.1).fold(bound.unwrap_or(0.0), f64::max);
        let (_, most) = Axis::linear(label, 0.0, most.max(1e-9)).bounds();
        let y = |value: f64| top + height * (1.0 - value / most);
        svg.line(format_args!(
            "<path d=\"M{} {top}V{}H{}\" fill=\"none\" stroke=\"#8c959f\"/><text x=\"{}\" y=\"{}\" \
             fill=\"#57606a\">{label}</text>",
            TIME.0,
            top + height,
            TIME.1,
            TIME.0,
            top - 5.0
        ));
        let marks =
            [(0.0, "0".to_owned()), (most, asked(most)), (bound.unwrap_or(0.0), String::new())];
        for (value, text) in &marks {
            svg.line(format_args!(
                "<text x=\"{}\" y=\"{}\" text-anchor=\"end\" font-size=\"11\" fill=\"#57606a\">{text}</text>",
                TIME.0 - 5.0,
                px(y(*value) + 4.0)
            ));
        }
        if let Some(bound) = bound {
            svg.line(format_args!(
                "<path d=\"M{} {y}H{}\" stroke=\"{color}\" stroke-dasharray=\"6 4\"/><text x=\"{}\" \
                 y=\"{}\" text-anchor=\"end\" fill=\"{color}\">d = {}</text>",
                TIME.0,
                TIME.1,
                TIME.1,
                px(y(bound) - 4.0),
                asked(bound),
                y = px(y(bound)),
                color = hex(VERMILION),
            ));
        }
        let curve: Vec<Point> = values.iter().map(|&(t_s, value)| (x(t_s), y(value))).collect();
        if curve.len() > 1 {
            svg.line(format_args!(
                "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.5\" stroke-linejoin=\"round\"/>",
                way(by_column(&curve, 1.0)),
                hex(color)
            ));
        }
    }
    // Round times, and the end where it is not near one of these.
    let lasts_s = (last_s - first_s).max(1e-9);
    let seconds = [1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 120.0, 300.0, 600.0, 1800.0, 3600.0];
    let step_s = seconds.into_iter().find(|s| s / lasts_s >= 0.14).unwrap_or(36000.0);
    let mut ticks: Vec<f64> =
        (0..=(lasts_s / step_s) as usize).map(|n| first_s + n as f64 * step_s).collect();
    let end_s = run.end_s();
    match ticks.last() {
        Some(tick) if end_s - tick < 0.5 * step_s => {}
        _ => ticks.push(end_s),
    }
    for t_s in ticks {
        svg.line(format_args!(
            "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\" font-size=\"11\" fill=\"#57606a\">{} s</text>",
            px(x(t_s).min(TIME.1)),
            bottom + 15.0,
            asked(t_s)
        ));
    }
    svg.line(format_args!(
        "<path d=\"M0 {}V{bottom}\" stroke=\"{}\" stroke-width=\"1.5\" transform=\"translate({} 0)\">",
        STRIPS[0].0,
        hex(BLACK),
        TIME.0
    ));
    svg.transform("translate", &[format!("{},0", TIME.0), format!("{},0", TIME.1)]);
    svg.line(format_args!("</path>"));
}

/// How to read it.
fn legend(svg: &mut Svg, run: &Run) {
    let mut lines = vec![
        "Arrows: the way information flows.".to_owned(),
        "Orange, dashed arrows: nothing gets through.".to_owned(),
        format!("Circles: radius d/2, d = {} m.", asked(run.scene.distance_min_m)),
        "While none overlap, no pair is nearer than d.".to_owned(),
    ];
    if !run.lead_m.is_empty() {
        lines.push("Gray dots: where the leader is to go.".to_owned());
    }
    for (i, line) in lines.iter().enumerate() {
        svg.line(format_args!(
            "<text x=\"{}\" y=\"{}\" fill=\"#57606a\">{line}</text>",
            TIME.0 - 36.0,
            LEGEND + 21.0 * i as f64
        ));
    }
}
