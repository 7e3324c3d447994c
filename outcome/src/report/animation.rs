//! Animated picture of a run: one SVG without scripts, for pages that show only images.
//!
//! On the left are the robots in the plane, as in the replay; on the right the largest error and the smallest
//! distance over time, with a moving cursor. All values are interpolated linearly between the same instants.

use std::collections::BTreeSet;

use formation::Vec2;
use formation::front_point::front_point;
use formation::obstacle::Obstacle;
use formation::portable_math;
use formation::pose::Pose;

use crate::report::axis::{Axis, round_up_to_nice_step};
use crate::report::chart::Rect;
use crate::report::figures::{BOUND, over_time};
use crate::report::palette::{BLACK, BLUE, Color, GRAY, Line, ORANGE, VERMILION, WHITE, color};
use crate::report::run::Run;
use crate::report::scene::{EdgeState, Frame, RobotState};
use crate::report::simplify::{CanvasPoint, simplify_curve};
use crate::report::svg::{Anchor, Element, path_data, px};
use protocol::number::format_short;

/// Width of the picture, px.
const WIDTH: f64 = 900.0;
/// Height of the picture, px.
const HEIGHT: f64 = 520.0;
/// Width of the plane, px.
const PLANE_WIDTH: f64 = 560.0;
/// Top and height of the plane, px.
const PLANE: (f64, f64) = (38.0, 472.0);
/// Upper of the two panels next to the plane.
const PANELS: Rect = Rect { x: 552.0, y: 40.0, width: 346.0, height: 175.0 };
/// Start of the legend below the panels, px.
const LEGEND: CanvasPoint = (584.0, 412.0);
/// Maximum duration of the animation, s. A longer run is shown faster.
const LASTS_S_MAX: f64 = 20.0;
/// Number of instants per second of the animation.
const INSTANTS_HZ: f64 = 12.0;
/// Maximum size of all instants, bytes. A larger animation has fewer instants.
const BYTES_MAX: usize = 800_000;
/// Minimum width and height of the visible area, m, so that a single robot at rest is visible.
const ROOM_M_MIN: f64 = 1e-6;
/// Length of trails, px.
const TRAIL: f64 = 90.0;
/// Maximum number of robots with names.
const NAMES_MAX: usize = 24;
/// Color of text next to the picture.
const SECONDARY_TEXT_COLOR: Color = Color(0x57, 0x60, 0x6a);
/// Color of borders and walls.
const BORDER_COLOR: Color = Color(0xd0, 0xd7, 0xde);

/// Returns the animation of a run; `None` if fewer than two instants were recorded.
pub fn animation(run: &Run) -> Option<String> {
    let frames = instants(run);
    if frames.len() < 2 {
        return None;
    }
    let lasts_s = (frames[frames.len() - 1].t_s - frames[0].t_s).clamp(1.0, LASTS_S_MAX);
    let animation = Animation { run, view: View::fit_view(run, &frames)?, frames, lasts_s };
    let rim = Element::rect([0.5, 0.5, WIDTH - 1.0, HEIGHT - 1.0]).with_attribute("rx", 8);
    let mut svg = Element::file(WIDTH, HEIGHT, "system-ui, sans-serif")
        .with_attribute("font-size", 13)
        .with_child(Element::new("title").with_text(&run.scene.name))
        .with_child(Element::new("defs").with_child(arrowhead()))
        .with_child(rim.filled(WHITE, 1.0).with_attribute("stroke", BORDER_COLOR));
    svg.extend(animation.heading());
    let mut plane = Element::clip([0.0, PLANE.0, PLANE_WIDTH, PLANE.1]);
    plane.extend(animation.ground());
    plane.extend(animation.walls());
    plane.extend(animation.trails());
    plane.extend(animation.hull());
    plane.extend(animation.edges());
    plane.extend(animation.robots());
    svg.push(plane);
    svg.push(animation.panels());
    svg.extend(legend(run));
    Some(format!("{svg}\n"))
}

fn arrowhead() -> Element {
    let head = Element::path("M3 0L-5 3.5V-3.5Z").with_attribute("fill", "context-stroke");
    let marker =
        Element::new("marker").with_attribute("id", "way").with_attribute("viewBox", "-5 -4 8 8");
    let marker = marker
        .with_attribute("markerWidth", 7)
        .with_attribute("markerHeight", 7)
        .with_attribute("orient", "auto");
    marker.with_child(head)
}

/// Returns equally spaced frames of the replay.
fn instants(run: &Run) -> Vec<Frame> {
    let mut frames = run.frames();
    // The last frame is at the end of the run and breaks the spacing.
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

/// Mapping from the plane to the picture.
struct View {
    /// Position of the center, m.
    middle: Vec2,
    /// Scale, px per m.
    scale: f64,
}

impl View {
    fn fit_view(run: &Run, frames: &[Frame]) -> Option<View> {
        let places = frames.iter().flat_map(|frame| fronts(run, frame)).filter(|at| is_finite(*at));
        let reach = places.map(|at| (at, at));
        let (low, high) = reach.reduce(|(low, high), (at, _)| (low.inf(&at), high.sup(&at)))?;
        let d_m = run.scene.distance_min_m;
        let room = high - low + Vec2::repeat(1.6 * d_m + (0.5 * d_m).min(0.1));
        let room = room.sup(&Vec2::repeat(ROOM_M_MIN));
        let scale = (PLANE_WIDTH / room.x).min(PLANE.1 / room.y);
        Some(View { middle: (low + high) / 2.0, scale })
    }

    fn project(&self, place: Vec2) -> CanvasPoint {
        let from_middle = (place - self.middle) * self.scale;
        (PLANE_WIDTH / 2.0 + from_middle.x, PLANE.0 + PLANE.1 / 2.0 - from_middle.y)
    }
}

/// Returns the front points at an instant, m.
fn fronts<'a>(run: &'a Run, frame: &'a Frame) -> impl Iterator<Item = Vec2> + 'a {
    frame.robots.iter().zip(&run.scene.robots).map(|(at, robot)| {
        let pose = Pose { x_m: at.x_m, y_m: at.y_m, heading_rad: at.heading_rad };
        front_point(pose, robot.front_point_m)
    })
}

fn is_finite(at: Vec2) -> bool {
    at.x.is_finite() && at.y.is_finite()
}

/// The animation during drawing.
struct Animation<'r> {
    run: &'r Run,
    frames: Vec<Frame>,
    view: View,
    /// Duration of the animation, s.
    lasts_s: f64,
}

impl Animation<'_> {
    /// Maps each frame to a value.
    fn map_frames<T>(&self, value: impl FnMut(&Frame) -> T) -> Vec<T> {
        self.frames.iter().map(value).collect()
    }

    fn animate_values(&self, name: &'static str, attribute: &str, values: &[String]) -> Element {
        let animation = Element::new(name).with_attribute("attributeName", attribute);
        let animation = animation.with_attribute("dur", format!("{}s", self.lasts_s));
        animation
            .with_attribute("repeatCount", "indefinite")
            .with_attribute("values", values.join(";"))
    }

    /// Returns an element whose attribute is animated through these values.
    fn animated(&self, element: Element, attribute: &str, values: &[String]) -> Element {
        let element = element.with_attribute(attribute, &values[0]);
        match values.iter().all(|value| *value == values[0]) {
            true => element,
            false => element.with_child(self.animate_values("animate", attribute, values)),
        }
    }

    /// Returns an element whose attribute switches where its value changes.
    fn animate_switches(&self, element: Element, attribute: &str, values: &[String]) -> Element {
        let element = element.with_attribute(attribute, &values[0]);
        let last = (values.len() - 1).max(1) as f64;
        let changes = (0..values.len()).filter(|&i| i == 0 || values[i - 1] != values[i]);
        let changes: Vec<(String, String)> =
            changes.map(|i| (format!("{:.4}", i as f64 / last), values[i].clone())).collect();
        let (times, values): (Vec<String>, Vec<String>) = changes.into_iter().unzip();
        if values.len() == 1 {
            return element;
        }
        let animation = self.animate_values("animate", attribute, &values);
        let animation = animation
            .with_attribute("calcMode", "discrete")
            .with_attribute("keyTimes", times.join(";"));
        element.with_child(animation)
    }

    /// Returns an element that is animated by a transform (`translate` or `rotate`).
    fn transformed(&self, element: Element, kind: &str, values: &[String]) -> Element {
        let animation = self
            .animate_values("animateTransform", "transform", values)
            .with_attribute("type", kind);
        element.with_attribute("transform", format!("{kind}({})", values[0])).with_child(animation)
    }

    /// Returns the scenario's name, and the newest active fault.
    fn heading(&self) -> Vec<Element> {
        let words = |words: &str, x: f64, anchor| {
            let text = Element::text(words, (x, 25.0), anchor);
            text.with_attribute("font-size", 15).with_attribute("font-weight", 600)
        };
        let faults = &self.run.scene.faults;
        // The newest fault is shown if several are active.
        let newest = |t_s: f64| {
            let lasting = faults.iter().enumerate().filter(|(_, fault)| fault.is_active_at(t_s));
            lasting.max_by(|(_, a), (_, b)| a.t_s.total_cmp(&b.t_s)).map(|(place, _)| place)
        };
        let at_each: Vec<Option<usize>> = self.map_frames(|frame| newest(frame.t_s));
        // Only faults that are shown at some instant are drawn, because a run may have thousands.
        let seen: BTreeSet<usize> = at_each.iter().flatten().copied().collect();
        let fault = |place: usize| {
            let shown = at_each.iter().map(|at| u8::from(*at == Some(place)).to_string());
            let shown: Vec<String> = shown.collect();
            let what = &faults[place].what;
            let text = words(what, WIDTH - 16.0, Anchor::End).filled(VERMILION, 1.0);
            self.animate_switches(text, "opacity", &shown)
        };
        let name = words(&self.run.scene.name, 16.0, Anchor::Start);
        std::iter::once(name).chain(seen.into_iter().map(fault)).collect()
    }

    /// Returns a grid in meters, and the leader's trajectory.
    fn ground(&self) -> Vec<Element> {
        let (view, bottom) = (&self.view, PLANE.0 + PLANE.1);
        let step_m = round_up_to_nice_step(40.0 / view.scale);
        let half = Vec2::new(PLANE_WIDTH, PLANE.1) / 2.0 / view.scale;
        let lines = |axis: usize| {
            let (low, high) = (view.middle[axis] - half[axis], view.middle[axis] + half[axis]);
            let first = (low / step_m).ceil() as i64;
            (first..).map(move |n| n as f64 * step_m).take_while(move |&at| at <= high)
        };
        let upright = lines(0).map(|x| view.project(Vec2::new(x, 0.0)).0);
        let level = lines(1).map(|y| view.project(Vec2::new(0.0, y)).1);
        let upright = upright.map(|x| format!("M{} {}v{}", px(x), PLANE.0, PLANE.1));
        let level = level.map(|y| format!("M0 {}h{PLANE_WIDTH}", px(y)));
        let grid: String = upright.chain(level).collect();
        let mut drawn = vec![Element::path(&grid).stroked(Line::solid(Color(0xec, 0xef, 0xf2)))];
        let lead = self.run.lead_m.iter().map(|&[x, y]| view.project(Vec2::new(x, y)));
        let lead: Vec<CanvasPoint> = lead.collect();
        if lead.len() > 1 {
            let dots = Element::path(&path_data(simplify_curve(&lead, 0.4)));
            let dots = dots.stroked(Line::solid(GRAY).width(2.0).opacity(0.5));
            drawn.push(
                dots.with_attribute("stroke-dasharray", "1 5")
                    .with_attribute("stroke-linecap", "round"),
            );
        }
        let (step, ends) = (step_m * view.scale, (22.0 + step_m * view.scale, bottom - 8.0));
        let scale =
            Element::path(&path_data([(16.0, bottom - 12.0), (16.0 + step, bottom - 12.0)]));
        let meters = Element::text(&format!("{} m", format_short(step_m)), ends, Anchor::Start);
        drawn.push(scale.stroked(Line::solid(SECONDARY_TEXT_COLOR).width(2.0)));
        drawn.push(meters.filled(SECONDARY_TEXT_COLOR, 1.0));
        drawn
    }

    /// Returns the walls and obstacles.
    fn walls(&self) -> Option<Element> {
        let shape = |wall: &Obstacle| match wall {
            Obstacle::Disc { center_m, radius_m } => {
                let ((x, y), r) =
                    (self.view.project(Vec2::from(*center_m)), radius_m * self.view.scale);
                let (left, across, r) = (px(x - r), px(2.0 * r), px(r));
                format!("M{left} {}a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0Z", px(y))
            }
            polygon => {
                path_data(polygon.outline().into_iter().map(|corner| self.view.project(corner)))
                    + "Z"
            }
        };
        let shapes: String = self.run.scene.walls.iter().map(shape).collect();
        let drawn = Element::path(&shapes)
            .filled(BORDER_COLOR, 1.0)
            .with_attribute("stroke", SECONDARY_TEXT_COLOR);
        let drawn =
            drawn.with_attribute("stroke-width", 2.5).with_attribute("stroke-linejoin", "round");
        (!shapes.is_empty()).then_some(drawn)
    }

    /// Returns the recent path of each robot: a dash that moves along its path.
    fn trails(&self) -> Vec<Element> {
        let trail = |robot: usize| {
            let places = self.path(robot);
            let mut lengths = vec![0.0];
            for pair in places.windows(2) {
                let step = portable_math::hypot(pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
                lengths.push(lengths[lengths.len() - 1] + step);
            }
            let whole = lengths[lengths.len() - 1];
            let offsets: Vec<String> = lengths.iter().map(|length| px(TRAIL - length)).collect();
            let line = Line::solid(color(robot)).width(2.5).opacity(0.45);
            let path = Element::path(&path_data(places))
                .stroked(line)
                .with_attribute("stroke-linejoin", "round");
            let path =
                path.with_attribute("stroke-dasharray", format!("{TRAIL} {}", px(whole + TRAIL)));
            (whole >= 1.0).then(|| self.animated(path, "stroke-dashoffset", &offsets))
        };
        (0..self.run.scene.robots.len()).filter_map(trail).collect()
    }

    /// Returns the position of a robot at each instant, or the last known position.
    fn path(&self, robot: usize) -> Vec<CanvasPoint> {
        let mut last = self.view.middle;
        self.map_frames(|frame| {
            let at = fronts(self.run, frame).nth(robot).expect("each frame has every robot");
            last = if is_finite(at) { at } else { last };
            self.view.project(last)
        })
    }

    /// Returns the convex hull of the leaders, in which the followers must be.
    fn hull(&self) -> Option<Element> {
        let (_, leaders) = self.run.containment()?;
        let shapes = self.map_frames(|frame| {
            let places: Vec<Vec2> = fronts(self.run, frame).collect();
            let leaders: Vec<Vec2> = leaders.iter().map(|&robot| places[robot]).collect();
            let mut corners = formation::hull::convex_hull(&leaders);
            // The number of corners is constant and begins with the first leader, so that the shape can be
            // interpolated.
            let first = leaders.iter().find_map(|leader| corners.iter().position(|c| c == leader));
            corners.rotate_left(first.unwrap_or(0));
            corners.resize(leaders.len(), corners.last().copied().unwrap_or(leaders[0]));
            path_data(corners.into_iter().map(|corner| self.view.project(corner))) + "Z"
        });
        let hull = Element::new("path").filled(ORANGE, 0.18).with_attribute("stroke", ORANGE);
        Some(self.animated(hull.with_attribute("stroke-linejoin", "round"), "d", &shapes))
    }

    /// Returns the edges: arrows from sender to receiver, dashed while no beacon passes.
    fn edges(&self) -> Vec<Element> {
        let edge = |place: usize| {
            let edge = self.run.scene.edges[place];
            let ends = self.path(edge.from).into_iter().zip(self.path(edge.to));
            let shapes = ends.map(|((x, y), (u, v))| {
                path_data([(x, y), (x + 0.66 * (u - x), y + 0.66 * (v - y)), (u, v)])
            });
            let (colors, dashes): (Vec<String>, Vec<String>) = self
                .map_frames(|frame| match frame.edges[place] {
                    EdgeState::Closed => ("transparent".to_owned(), "1 0".to_owned()),
                    EdgeState::Fresh if edge.spare => (BLUE.to_string(), "1 0".to_owned()),
                    EdgeState::Fresh => (GRAY.to_string(), "1 0".to_owned()),
                    EdgeState::Stale => (ORANGE.to_string(), "1 0".to_owned()),
                    EdgeState::Lost | EdgeState::Cut | EdgeState::Dead => {
                        (VERMILION.to_string(), "3 5".to_owned())
                    }
                })
                .into_iter()
                .unzip();
            let path = Element::new("path")
                .with_attribute("fill", "none")
                .with_attribute("stroke-width", 1.3);
            let path = path.with_attribute("marker-mid", "url(#way)");
            let path = self.animated(path, "d", &shapes.collect::<Vec<_>>());
            let path = self.animate_switches(path, "stroke", &colors);
            self.animate_switches(path, "stroke-dasharray", &dashes)
        };
        (0..self.run.scene.edges.len()).map(edge).collect()
    }

    /// Returns the robots, each with a circle of radius d/2 around its front point.
    fn robots(&self) -> Vec<Element> {
        let scene = &self.run.scene;
        let reach = scene.distance_min_m / 2.0 * self.view.scale;
        let robot = |i: usize| {
            let places = self.path(i).into_iter().map(|(x, y)| format!("{},{}", px(x), px(y)));
            let mut heading_rad = 0.0;
            let headings = self.map_frames(|frame| {
                let turn: f64 = frame.robots[i].heading_rad - heading_rad;
                if turn.is_finite() {
                    heading_rad +=
                        portable_math::atan2(portable_math::sin(turn), portable_math::cos(turn));
                }
                px(-heading_rad.to_degrees())
            });
            let colors = self.map_frames(|frame| match frame.robots[i].state.can_move() {
                true => color(i).to_string(),
                false => GRAY.to_string(),
            });
            let dead = |frame: &Frame| frame.robots[i].state == RobotState::Dead;
            let crossed = self.map_frames(|frame| u8::from(dead(frame)).to_string());
            let length = (scene.robots[i].front_point_m * self.view.scale).max(9.0);
            let corners = [(0.35, 0.0), (-1.35, 0.75), (-0.9, 0.0), (-1.35, -0.75)];
            let body = corners.map(|(x, y)| (x * length, y * length));
            let body = Element::path(&(path_data(body) + "Z")).with_attribute("stroke", WHITE);
            let arm = 1.1 * length;
            let cross =
                path_data([(-arm, -arm), (arm, arm)]) + &path_data([(arm, -arm), (-arm, arm)]);
            let cross = Element::path(&cross).stroked(Line::solid(VERMILION).width(3.0));
            let circle = Element::new("circle")
                .with_attribute("r", px(reach))
                .with_attribute("fill-opacity", 0.1);
            let mut group = self
                .animate_switches(Element::new("g"), "fill", &colors)
                .with_child(
                    circle
                        .with_attribute("stroke", SECONDARY_TEXT_COLOR)
                        .with_attribute("stroke-opacity", 0.35),
                )
                .with_child(self.transformed(
                    Element::new("g").with_child(body),
                    "rotate",
                    &headings,
                ))
                .with_child(self.animate_switches(cross, "opacity", &crossed));
            if scene.robots.len() <= NAMES_MAX {
                let above = (0.0, -length.max(reach) - 4.0);
                let name = Element::text(&scene.robots[i].name, above, Anchor::Middle);
                let name =
                    name.filled(Color(0x24, 0x29, 0x2f), 1.0).with_attribute("stroke", WHITE);
                group.push(
                    name.with_attribute("stroke-width", 3).with_attribute("paint-order", "stroke"),
                );
            }
            self.transformed(group, "translate", &places.collect::<Vec<_>>())
        };
        (0..scene.robots.len()).map(robot).collect()
    }

    /// Returns the largest error and the smallest distance over time, with a moving cursor.
    fn panels(&self) -> Element {
        let all = self.run.frames();
        let errors = all.iter().map(|frame| {
            let living = frame.robots.iter().filter(|robot| robot.state.can_move());
            Some((frame.t_s, living.filter_map(|robot| robot.error_m).reduce(f64::max)?))
        });
        let distances = all.iter().map(|frame| Some((frame.t_s, frame.distance_m?)));
        let (errors, distances): (Vec<_>, Vec<_>) = (errors.collect(), distances.collect());
        let axis = |label: &str, values: &[Option<CanvasPoint>], least: f64| {
            let known = values.iter().flatten().map(|at| at.1).filter(|value| value.is_finite());
            Axis::linear(label, 0.0, known.fold(least, f64::max))
        };
        let d = self.run.scene.distance_min_m;
        let mut error = over_time(self.run, axis("largest error (m)", &errors, 1e-9));
        error.add_curve(errors, Line::solid(BLACK));
        let distance = axis("smallest distance (m)", &distances, d);
        let mut distance = over_time(self.run, distance).with_nameless_bands();
        distance.add_curve(distances, Line::solid(BLUE));
        distance.add_horizontal_line(
            d,
            (0.0, self.run.end_s()),
            format!("d = {} m", format_short(d)),
            BOUND,
        );
        let below = Rect { y: PANELS.y + PANELS.height, ..PANELS };
        let (top, bottom) = (PANELS.plot_area(&error.bands), below.plot_area(&distance.bands));
        let (first_s, last_s) = (self.frames[0].t_s, self.frames[self.frames.len() - 1].t_s);
        let places = [first_s, last_s].map(|t_s| top.x + error.x.fraction(t_s) * top.width);
        let line = path_data([(0.0, top.y), (0.0, bottom.y + bottom.height)]);
        let line = Element::path(&line).stroked(Line::solid(BLACK));
        let places = places.map(|x| format!("{},0", px(x)));
        Element::new("g")
            .with_attribute("font-size", 12)
            .with_child(error.draw(PANELS))
            .with_child(distance.draw(below))
            .with_child(self.transformed(line, "translate", &places))
    }
}

/// Returns the legend.
fn legend(run: &Run) -> Vec<Element> {
    let mut lines = vec![
        "Arrows: from sender to receiver.".to_owned(),
        "Orange: stale. Dashed: no beacon arrives.".to_owned(),
        format!("Circles: radius d/2, d = {} m.", format_short(run.scene.distance_min_m)),
        "If none overlap, no pair is nearer than d.".to_owned(),
    ];
    if !run.repairs.is_empty() {
        lines.insert(2, "Blue arrows: from backup neighbors.".to_owned());
    }
    if !run.lead_m.is_empty() {
        lines.push("Gray dots: reference of the leader.".to_owned());
    }
    let step = (105.0 / lines.len() as f64).min(21.0);
    let line = |(i, line): (usize, &String)| {
        let at = (LEGEND.0, LEGEND.1 + step * i as f64);
        Element::text(line, at, Anchor::Start).filled(SECONDARY_TEXT_COLOR, 1.0)
    };
    lines.iter().enumerate().map(line).collect()
}
