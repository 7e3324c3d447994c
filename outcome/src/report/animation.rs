//! A run as a picture that moves by itself: one SVG without scripts, for pages that show pictures
//! only.
//!
//! On the left the robots in the plane, as the replay shows them; on the right the largest error and
//! the smallest distance over time, with a line that walks along. All of it is linear between the
//! same instants.

use std::collections::BTreeSet;

use formation::Vec2;
use formation::front_point::front_point;
use formation::obstacle::Obstacle;
use formation::portable_math;
use formation::pose::Pose;

use crate::report::axis::{Axis, round_up};
use crate::report::chart::Place;
use crate::report::figures::{BOUND, over_time};
use crate::report::palette::{BLACK, BLUE, Color, GRAY, Line, ORANGE, VERMILION, WHITE, color};
use crate::report::run::Run;
use crate::report::scene::{EdgeState, Frame, RobotState};
use crate::report::simplify::{Point, within};
use crate::report::svg::{Anchor, Element, px, way};
use protocol::number::short;

/// The whole picture, px.
const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 520.0;
/// Of the plane, px: its width, from the top, and as high as this.
const PLANE_WIDTH: f64 = 560.0;
const PLANE: (f64, f64) = (38.0, 472.0);
/// The two panels beside it, one above the other.
const PANELS: Place = Place { x: 552.0, y: 40.0, width: 346.0, height: 175.0 };
/// What is told below them: where it begins, px.
const LEGEND: Point = (584.0, 412.0);
/// It lasts no longer than this, s: a longer run is shown faster.
const LASTS_S_MAX: f64 = 20.0;
/// So many instants per second that it lasts, and no more bytes than this for all of them.
const INSTANTS_HZ: f64 = 12.0;
const BYTES_MAX: usize = 800_000;
/// Minimum width and height of what is shown, m: one robot alone that stands still is shown, too.
const ROOM_M_MIN: f64 = 1e-6;
/// Trails are as long as this, px.
const TRAIL: f64 = 90.0;
/// Names up to this many robots.
const NAMES_MAX: usize = 24;
/// What is written beside the picture, and the paper's rims.
const QUIET: Color = Color(0x57, 0x60, 0x6a);
const PALE: Color = Color(0xd0, 0xd7, 0xde);

/// The animation of a run; `None` if nothing was recorded.
pub fn animation(run: &Run) -> Option<String> {
    let frames = instants(run);
    if frames.len() < 2 {
        return None;
    }
    let lasts_s = (frames[frames.len() - 1].t_s - frames[0].t_s).clamp(1.0, LASTS_S_MAX);
    let movie = Movie { run, view: View::of(run, &frames)?, frames, lasts_s };
    let rim = Element::rect([0.5, 0.5, WIDTH - 1.0, HEIGHT - 1.0]).with("rx", 8);
    let mut svg = Element::file(WIDTH, HEIGHT, "system-ui, sans-serif")
        .with("font-size", 13)
        .holding(Element::new("title").says(&run.scene.name))
        .holding(Element::new("defs").holding(arrowhead()))
        .holding(rim.filled(WHITE, 1.0).with("stroke", PALE));
    svg.extend(movie.heading());
    let mut plane = Element::clip([0.0, PLANE.0, PLANE_WIDTH, PLANE.1]);
    plane.extend(movie.ground());
    plane.extend(movie.walls());
    plane.extend(movie.trails());
    plane.extend(movie.hull());
    plane.extend(movie.edges());
    plane.extend(movie.robots());
    svg.push(plane);
    svg.push(movie.panels());
    svg.extend(legend(run));
    Some(format!("{svg}\n"))
}

fn arrowhead() -> Element {
    let head = Element::path("M3 0L-5 3.5V-3.5Z").with("fill", "context-stroke");
    let marker = Element::new("marker").with("id", "way").with("viewBox", "-5 -4 8 8");
    let marker = marker.with("markerWidth", 7).with("markerHeight", 7).with("orient", "auto");
    marker.holding(head)
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
        let reach = places.map(|at| (at, at));
        let (low, high) = reach.reduce(|(low, high), (at, _)| (low.inf(&at), high.sup(&at)))?;
        let d_m = run.scene.distance_min_m;
        let room = high - low + Vec2::repeat(1.6 * d_m + (0.5 * d_m).min(0.1));
        let room = room.sup(&Vec2::repeat(ROOM_M_MIN));
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

/// What moves.
struct Movie<'r> {
    run: &'r Run,
    frames: Vec<Frame>,
    view: View,
    /// s.
    lasts_s: f64,
}

impl Movie<'_> {
    /// One value at each instant.
    fn each<T>(&self, value: impl FnMut(&Frame) -> T) -> Vec<T> {
        self.frames.iter().map(value).collect()
    }

    fn repeated(&self, name: &'static str, attribute: &str, values: &[String]) -> Element {
        let animation = Element::new(name).with("attributeName", attribute);
        let animation = animation.with("dur", format!("{}s", self.lasts_s));
        animation.with("repeatCount", "indefinite").with("values", values.join(";"))
    }

    /// An element whose attribute goes through these values.
    fn animated(&self, element: Element, attribute: &str, values: &[String]) -> Element {
        let element = element.with(attribute, &values[0]);
        match values.iter().all(|value| *value == values[0]) {
            true => element,
            false => element.holding(self.repeated("animate", attribute, values)),
        }
    }

    /// An element whose attribute jumps where its value changes.
    fn switched(&self, element: Element, attribute: &str, values: &[String]) -> Element {
        let element = element.with(attribute, &values[0]);
        let last = (values.len() - 1).max(1) as f64;
        let changes = (0..values.len()).filter(|&i| i == 0 || values[i - 1] != values[i]);
        let changes: Vec<(String, String)> =
            changes.map(|i| (format!("{:.4}", i as f64 / last), values[i].clone())).collect();
        let (times, values): (Vec<String>, Vec<String>) = changes.into_iter().unzip();
        if values.len() == 1 {
            return element;
        }
        let animation = self.repeated("animate", attribute, &values);
        let animation = animation.with("calcMode", "discrete").with("keyTimes", times.join(";"));
        element.holding(animation)
    }

    /// An element that is moved (`translate`) or turned (`rotate`) so.
    fn transformed(&self, element: Element, kind: &str, values: &[String]) -> Element {
        let animation = self.repeated("animateTransform", "transform", values).with("type", kind);
        element.with("transform", format!("{kind}({})", values[0])).holding(animation)
    }

    /// What is shown, and what is wrong just now.
    fn heading(&self) -> Vec<Element> {
        let words = |words: &str, x: f64, anchor| {
            let text = Element::words(words, (x, 25.0), anchor);
            text.with("font-size", 15).with("font-weight", 600)
        };
        let faults = &self.run.scene.faults;
        // Of several at once the newest.
        let newest = |t_s: f64| {
            let lasting = faults.iter().enumerate().filter(|(_, fault)| fault.lasts_at(t_s));
            lasting.max_by(|(_, a), (_, b)| a.t_s.total_cmp(&b.t_s)).map(|(place, _)| place)
        };
        let at_each: Vec<Option<usize>> = self.each(|frame| newest(frame.t_s));
        // Only those that are shown at some instant: a run may have thousands.
        let seen: BTreeSet<usize> = at_each.iter().flatten().copied().collect();
        let fault = |place: usize| {
            let shown = at_each.iter().map(|at| u8::from(*at == Some(place)).to_string());
            let shown: Vec<String> = shown.collect();
            let what = &faults[place].what;
            let text = words(what, WIDTH - 16.0, Anchor::End).filled(VERMILION, 1.0);
            self.switched(text, "opacity", &shown)
        };
        let name = words(&self.run.scene.name, 16.0, Anchor::Start);
        std::iter::once(name).chain(seen.into_iter().map(fault)).collect()
    }

    /// A grid of meters, and where the leader is to go.
    fn ground(&self) -> Vec<Element> {
        let (view, bottom) = (&self.view, PLANE.0 + PLANE.1);
        let step_m = round_up(40.0 / view.scale);
        let half = Vec2::new(PLANE_WIDTH, PLANE.1) / 2.0 / view.scale;
        let lines = |axis: usize| {
            let (low, high) = (view.middle[axis] - half[axis], view.middle[axis] + half[axis]);
            let first = (low / step_m).ceil() as i64;
            (first..).map(move |n| n as f64 * step_m).take_while(move |&at| at <= high)
        };
        let upright = lines(0).map(|x| view.at(Vec2::new(x, 0.0)).0);
        let level = lines(1).map(|y| view.at(Vec2::new(0.0, y)).1);
        let upright = upright.map(|x| format!("M{} {}v{}", px(x), PLANE.0, PLANE.1));
        let level = level.map(|y| format!("M0 {}h{PLANE_WIDTH}", px(y)));
        let grid: String = upright.chain(level).collect();
        let mut drawn = vec![Element::path(&grid).stroked(Line::solid(Color(0xec, 0xef, 0xf2)))];
        let lead = self.run.lead_m.iter().map(|&[x, y]| view.at(Vec2::new(x, y)));
        let lead: Vec<Point> = lead.collect();
        if lead.len() > 1 {
            let dots = Element::path(&way(within(&lead, 0.4)));
            let dots = dots.stroked(Line::solid(GRAY).width(2.0).opacity(0.5));
            drawn.push(dots.with("stroke-dasharray", "1 5").with("stroke-linecap", "round"));
        }
        let (step, ends) = (step_m * view.scale, (22.0 + step_m * view.scale, bottom - 8.0));
        let scale = Element::path(&way([(16.0, bottom - 12.0), (16.0 + step, bottom - 12.0)]));
        let meters = Element::words(&format!("{} m", short(step_m)), ends, Anchor::Start);
        drawn.push(scale.stroked(Line::solid(QUIET).width(2.0)));
        drawn.push(meters.filled(QUIET, 1.0));
        drawn
    }

    /// What stands in the way.
    fn walls(&self) -> Option<Element> {
        let shape = |wall: &Obstacle| match wall {
            Obstacle::Disc { center_m, radius_m } => {
                let ((x, y), r) = (self.view.at(Vec2::from(*center_m)), radius_m * self.view.scale);
                let (left, across, r) = (px(x - r), px(2.0 * r), px(r));
                format!("M{left} {}a{r} {r} 0 1 0 {across} 0a{r} {r} 0 1 0 -{across} 0Z", px(y))
            }
            polygon => way(polygon.outline().into_iter().map(|corner| self.view.at(corner))) + "Z",
        };
        let shapes: String = self.run.scene.walls.iter().map(shape).collect();
        let drawn = Element::path(&shapes).filled(PALE, 1.0).with("stroke", QUIET);
        let drawn = drawn.with("stroke-width", 2.5).with("stroke-linejoin", "round");
        (!shapes.is_empty()).then_some(drawn)
    }

    /// Where each robot was lately: a dash that moves along its path.
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
            let path = Element::path(&way(places)).stroked(line).with("stroke-linejoin", "round");
            let path = path.with("stroke-dasharray", format!("{TRAIL} {}", px(whole + TRAIL)));
            (whole >= 1.0).then(|| self.animated(path, "stroke-dashoffset", &offsets))
        };
        (0..self.run.scene.robots.len()).filter_map(trail).collect()
    }

    /// Where a robot is at each instant; where that is not known, where it was last.
    fn path(&self, robot: usize) -> Vec<Point> {
        let mut last = self.view.middle;
        self.each(|frame| {
            let at = fronts(self.run, frame).nth(robot).expect("each frame has every robot");
            last = if known(at) { at } else { last };
            self.view.at(last)
        })
    }

    /// The hull of the leaders, in which the contained are to be.
    fn hull(&self) -> Option<Element> {
        let (_, leaders) = self.run.containment()?;
        let shapes = self.each(|frame| {
            let places: Vec<Vec2> = fronts(self.run, frame).collect();
            let leaders: Vec<Vec2> = leaders.iter().map(|&robot| places[robot]).collect();
            let mut corners = formation::hull::convex_hull(&leaders);
            // As many corners at every instant, from the first leader on, so that it can go over from
            // one to the next.
            let first = leaders.iter().find_map(|leader| corners.iter().position(|c| c == leader));
            corners.rotate_left(first.unwrap_or(0));
            corners.resize(leaders.len(), corners.last().copied().unwrap_or(leaders[0]));
            way(corners.into_iter().map(|corner| self.view.at(corner))) + "Z"
        });
        let hull = Element::new("path").filled(ORANGE, 0.18).with("stroke", ORANGE);
        Some(self.animated(hull.with("stroke-linejoin", "round"), "d", &shapes))
    }

    /// Who hears whom: an arrow the way information flows, broken where none does.
    fn edges(&self) -> Vec<Element> {
        let edge = |place: usize| {
            let edge = self.run.scene.edges[place];
            let ends = self.path(edge.from).into_iter().zip(self.path(edge.to));
            let shapes = ends.map(|((x, y), (u, v))| {
                way([(x, y), (x + 0.66 * (u - x), y + 0.66 * (v - y)), (u, v)])
            });
            let (colors, dashes): (Vec<String>, Vec<String>) = self
                .each(|frame| match frame.edges[place] {
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
            let path = Element::new("path").with("fill", "none").with("stroke-width", 1.3);
            let path = path.with("marker-mid", "url(#way)");
            let path = self.animated(path, "d", &shapes.collect::<Vec<_>>());
            let path = self.switched(path, "stroke", &colors);
            self.switched(path, "stroke-dasharray", &dashes)
        };
        (0..self.run.scene.edges.len()).map(edge).collect()
    }

    /// The robots, each with a circle of radius d/2 around its front point.
    fn robots(&self) -> Vec<Element> {
        let scene = &self.run.scene;
        let reach = scene.distance_min_m / 2.0 * self.view.scale;
        let robot = |i: usize| {
            let places = self.path(i).into_iter().map(|(x, y)| format!("{},{}", px(x), px(y)));
            let mut heading_rad = 0.0;
            let headings = self.each(|frame| {
                let turn: f64 = frame.robots[i].heading_rad - heading_rad;
                if turn.is_finite() {
                    heading_rad +=
                        portable_math::atan2(portable_math::sin(turn), portable_math::cos(turn));
                }
                px(-heading_rad.to_degrees())
            });
            let colors = self.each(|frame| match frame.robots[i].state.moves() {
                true => color(i).to_string(),
                false => GRAY.to_string(),
            });
            let dead = |frame: &Frame| frame.robots[i].state == RobotState::Dead;
            let crossed = self.each(|frame| u8::from(dead(frame)).to_string());
            let length = (scene.robots[i].front_point_m * self.view.scale).max(9.0);
            let corners = [(0.35, 0.0), (-1.35, 0.75), (-0.9, 0.0), (-1.35, -0.75)];
            let body = corners.map(|(x, y)| (x * length, y * length));
            let body = Element::path(&(way(body) + "Z")).with("stroke", WHITE);
            let arm = 1.1 * length;
            let cross = way([(-arm, -arm), (arm, arm)]) + &way([(arm, -arm), (-arm, arm)]);
            let cross = Element::path(&cross).stroked(Line::solid(VERMILION).width(3.0));
            let circle = Element::new("circle").with("r", px(reach)).with("fill-opacity", 0.1);
            let mut group = self
                .switched(Element::new("g"), "fill", &colors)
                .holding(circle.with("stroke", QUIET).with("stroke-opacity", 0.35))
                .holding(self.transformed(Element::new("g").holding(body), "rotate", &headings))
                .holding(self.switched(cross, "opacity", &crossed));
            if scene.robots.len() <= NAMES_MAX {
                let above = (0.0, -length.max(reach) - 4.0);
                let name = Element::words(&scene.robots[i].name, above, Anchor::Middle);
                let name = name.filled(Color(0x24, 0x29, 0x2f), 1.0).with("stroke", WHITE);
                group.push(name.with("stroke-width", 3).with("paint-order", "stroke"));
            }
            self.transformed(group, "translate", &places.collect::<Vec<_>>())
        };
        (0..scene.robots.len()).map(robot).collect()
    }

    /// The largest error and the smallest distance over time, with a line that walks along.
    fn panels(&self) -> Element {
        let all = self.run.frames();
        let errors = all.iter().map(|frame| {
            let living = frame.robots.iter().filter(|robot| robot.state.moves());
            Some((frame.t_s, living.filter_map(|robot| robot.error_m).reduce(f64::max)?))
        });
        let distances = all.iter().map(|frame| Some((frame.t_s, frame.distance_m?)));
        let (errors, distances): (Vec<_>, Vec<_>) = (errors.collect(), distances.collect());
        let axis = |label: &str, values: &[Option<Point>], least: f64| {
            let known = values.iter().flatten().map(|at| at.1).filter(|value| value.is_finite());
            Axis::linear(label, 0.0, known.fold(least, f64::max))
        };
        let d = self.run.scene.distance_min_m;
        let mut error = over_time(self.run, axis("largest error (m)", &errors, 1e-9));
        error.over_x(errors, Line::solid(BLACK));
        let distance = axis("smallest distance (m)", &distances, d);
        let mut distance = over_time(self.run, distance).with_nameless_bands();
        distance.over_x(distances, Line::solid(BLUE));
        distance.bound(d, (0.0, self.run.end_s()), format!("d = {} m", short(d)), BOUND);
        let below = Place { y: PANELS.y + PANELS.height, ..PANELS };
        let (top, bottom) = (PANELS.inner(&error.bands), below.inner(&distance.bands));
        let (first_s, last_s) = (self.frames[0].t_s, self.frames[self.frames.len() - 1].t_s);
        let places = [first_s, last_s].map(|t_s| top.x + error.x.share(t_s) * top.width);
        let line = way([(0.0, top.y), (0.0, bottom.y + bottom.height)]);
        let line = Element::path(&line).stroked(Line::solid(BLACK));
        let places = places.map(|x| format!("{},0", px(x)));
        Element::new("g")
            .with("font-size", 12)
            .holding(error.drawn(PANELS))
            .holding(distance.drawn(below))
            .holding(self.transformed(line, "translate", &places))
    }
}

/// How to read it.
fn legend(run: &Run) -> Vec<Element> {
    let mut lines = vec![
        "Arrows: the way information flows.".to_owned(),
        "Orange, dashed arrows: nothing gets through.".to_owned(),
        format!("Circles: radius d/2, d = {} m.", short(run.scene.distance_min_m)),
        "While none overlap, no pair is nearer than d.".to_owned(),
    ];
    if !run.repairs.is_empty() {
        lines.insert(2, "Blue arrows: heard in place of the lost.".to_owned());
    }
    if !run.lead_m.is_empty() {
        lines.push("Gray dots: where the leader is to go.".to_owned());
    }
    let step = (105.0 / lines.len() as f64).min(21.0);
    let line = |(i, line): (usize, &String)| {
        let at = (LEGEND.0, LEGEND.1 + step * i as f64);
        Element::words(line, at, Anchor::Start).filled(QUIET, 1.0)
    };
    lines.iter().enumerate().map(line).collect()
}
