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
use crate::report::figures::{BOUND_LINE, panel_over_time};
use crate::report::palette::{
    BLACK, BLUE, Color, GRAY, LineStyle, ORANGE, VERMILION, WHITE, robot_color,
};
use crate::report::run::LoadedRun;
use crate::report::scene::{EdgeState, RobotState, SceneFrame};
use crate::report::simplify::{CanvasPoint, simplify_curve};
use crate::report::svg::{Anchor, SvgElement, format_px, path_data};
use protocol::number::format_short;

/// Width of the picture, px.
const WIDTH: f64 = 900.0;
/// Height of the picture, px.
const HEIGHT: f64 = 520.0;
/// Width of the plane, px.
const PLANE_WIDTH: f64 = 560.0;
/// Top and height of the plane, px.
const PLANE_TOP_AND_HEIGHT: (f64, f64) = (38.0, 472.0);
/// Upper of the two panels next to the plane.
const UPPER_PANEL: Rect = Rect { x: 552.0, y: 40.0, width: 346.0, height: 175.0 };
/// Start of the legend below the panels, px.
const LEGEND_POSITION: CanvasPoint = (584.0, 412.0);
/// Maximum duration of the animation, s. A longer run is shown faster.
const DURATION_S_MAX: f64 = 20.0;
/// Number of instants per second of the animation.
const FRAME_RATE_HZ: f64 = 12.0;
/// Maximum size of all instants, bytes. A larger animation has fewer instants.
const ANIMATION_BYTES_MAX: usize = 800_000;
/// Minimum width and height of the visible area, m, so that a single robot at rest is visible.
const VIEW_SIZE_M_MIN: f64 = 1e-6;
/// Length of trails, px.
const TRAIL_LENGTH: f64 = 90.0;
/// Maximum number of robots with names.
const NAMED_ROBOTS_MAX: usize = 24;
/// Color of text next to the picture.
const SECONDARY_TEXT_COLOR: Color = Color(0x57, 0x60, 0x6a);
/// Color of borders and walls.
const BORDER_COLOR: Color = Color(0xd0, 0xd7, 0xde);

/// Returns the animation of a run; `None` if fewer than two instants were recorded.
pub fn draw_animation(run: &LoadedRun) -> Option<String> {
    let frames = animation_frames(run);
    if frames.len() < 2 {
        return None;
    }
    let duration_s = (frames[frames.len() - 1].t_s - frames[0].t_s).clamp(1.0, DURATION_S_MAX);
    let animation =
        Animation { run, view: PlaneProjection::fit_view(run, &frames)?, frames, duration_s };
    let border = SvgElement::rect([0.5, 0.5, WIDTH - 1.0, HEIGHT - 1.0]).with_attribute("rx", 8);
    let mut svg = SvgElement::root(WIDTH, HEIGHT, "system-ui, sans-serif")
        .with_attribute("font-size", 13)
        .with_child(SvgElement::new("title").with_text(&run.scene.name))
        .with_child(SvgElement::new("defs").with_child(arrowhead()))
        .with_child(border.with_fill(WHITE, 1.0).with_attribute("stroke", BORDER_COLOR));
    svg.extend(animation.draw_heading());
    let mut plane =
        SvgElement::clip([0.0, PLANE_TOP_AND_HEIGHT.0, PLANE_WIDTH, PLANE_TOP_AND_HEIGHT.1]);
    plane.extend(animation.draw_ground());
    plane.extend(animation.draw_walls());
    plane.extend(animation.draw_trails());
    plane.extend(animation.draw_hull());
    plane.extend(animation.draw_edges());
    plane.extend(animation.draw_robots());
    svg.push(plane);
    svg.push(animation.draw_panels());
    svg.extend(draw_legend(run));
    Some(format!("{svg}\n"))
}

fn arrowhead() -> SvgElement {
    let head = SvgElement::path("M3 0L-5 3.5V-3.5Z").with_attribute("fill", "context-stroke");
    let marker = SvgElement::new("marker")
        .with_attribute("id", "way")
        .with_attribute("viewBox", "-5 -4 8 8");
    let marker = marker
        .with_attribute("markerWidth", 7)
        .with_attribute("markerHeight", 7)
        .with_attribute("orient", "auto");
    marker.with_child(head)
}

/// Returns equally spaced frames of the replay.
fn animation_frames(run: &LoadedRun) -> Vec<SceneFrame> {
    let mut frames = run.frames();
    // The last frame is at the end of the run and breaks the spacing.
    if frames.len() > 2 {
        frames.pop();
    }
    let (robots, edges) = (run.scene.robots.len(), run.scene.edges.len());
    let bytes = 50 * robots + 38 * edges + 20;
    let duration_s = run.end_s().min(DURATION_S_MAX);
    let frame_count_max =
        ((duration_s * FRAME_RATE_HZ) as usize).min(ANIMATION_BYTES_MAX / bytes).max(2);
    let step = frames.len().div_ceil(frame_count_max);
    frames.into_iter().step_by(step).collect()
}

/// Mapping from the plane to the picture.
struct PlaneProjection {
    /// Position of the center, m.
    center_m: Vec2,
    /// Scale, px per m.
    scale_px_per_m: f64,
}

impl PlaneProjection {
    fn fit_view(run: &LoadedRun, frames: &[SceneFrame]) -> Option<PlaneProjection> {
        let positions = frames.iter().flat_map(|frame| front_points(run, frame));
        let extents = positions.filter(|at| is_finite(*at)).map(|at| (at, at));
        let (low, high) = extents.reduce(|(low, high), (at, _)| (low.inf(&at), high.sup(&at)))?;
        let d_m = run.scene.distance_min_m;
        let view_size_m = high - low + Vec2::repeat(1.6 * d_m + (0.5 * d_m).min(0.1));
        let view_size_m = view_size_m.sup(&Vec2::repeat(VIEW_SIZE_M_MIN));
        let scale_px_per_m =
            (PLANE_WIDTH / view_size_m.x).min(PLANE_TOP_AND_HEIGHT.1 / view_size_m.y);
        Some(PlaneProjection { center_m: (low + high) / 2.0, scale_px_per_m })
    }

    fn project(&self, position_m: Vec2) -> CanvasPoint {
        let from_center = (position_m - self.center_m) * self.scale_px_per_m;
        (
            PLANE_WIDTH / 2.0 + from_center.x,
            PLANE_TOP_AND_HEIGHT.0 + PLANE_TOP_AND_HEIGHT.1 / 2.0 - from_center.y,
        )
    }
}

/// Returns the front points at an instant, m.
fn front_points<'a>(run: &'a LoadedRun, frame: &'a SceneFrame) -> impl Iterator<Item = Vec2> + 'a {
    frame.robots.iter().zip(&run.scene.robots).map(|(sample, robot)| {
        let pose = Pose { x_m: sample.x_m, y_m: sample.y_m, heading_rad: sample.heading_rad };
        front_point(pose, robot.front_point_m)
    })
}

fn is_finite(position: Vec2) -> bool {
    position.x.is_finite() && position.y.is_finite()
}

/// The animation during drawing.
struct Animation<'r> {
    run: &'r LoadedRun,
    frames: Vec<SceneFrame>,
    view: PlaneProjection,
    /// Duration of the animation, s.
    duration_s: f64,
}

impl Animation<'_> {
    /// Maps each frame to a value.
    fn map_frames<T>(&self, value: impl FnMut(&SceneFrame) -> T) -> Vec<T> {
        self.frames.iter().map(value).collect()
    }

    fn animate_values(&self, name: &'static str, attribute: &str, values: &[String]) -> SvgElement {
        let animation = SvgElement::new(name).with_attribute("attributeName", attribute);
        let animation = animation.with_attribute("dur", format!("{}s", self.duration_s));
        animation
            .with_attribute("repeatCount", "indefinite")
            .with_attribute("values", values.join(";"))
    }

    /// Returns an element whose attribute is animated through these values.
    fn animate_attribute(
        &self,
        element: SvgElement,
        attribute: &str,
        values: &[String],
    ) -> SvgElement {
        let element = element.with_attribute(attribute, &values[0]);
        match values.iter().all(|value| *value == values[0]) {
            true => element,
            false => element.with_child(self.animate_values("animate", attribute, values)),
        }
    }

    /// Returns an element whose attribute switches where its value changes.
    fn animate_switches(
        &self,
        element: SvgElement,
        attribute: &str,
        values: &[String],
    ) -> SvgElement {
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
    fn animate_transform(&self, element: SvgElement, kind: &str, values: &[String]) -> SvgElement {
        let animation = self
            .animate_values("animateTransform", "transform", values)
            .with_attribute("type", kind);
        element.with_attribute("transform", format!("{kind}({})", values[0])).with_child(animation)
    }

    /// Returns the scenario's name, and the newest active fault.
    fn draw_heading(&self) -> Vec<SvgElement> {
        let heading = |text: &str, x: f64, anchor| {
            let text = SvgElement::text(text, (x, 25.0), anchor);
            text.with_attribute("font-size", 15).with_attribute("font-weight", 600)
        };
        let faults = &self.run.scene.faults;
        // The newest fault is shown if several are active.
        let newest_active_fault = |t_s: f64| {
            let active = faults.iter().enumerate().filter(|(_, fault)| fault.is_active_at(t_s));
            active.max_by(|(_, a), (_, b)| a.t_s.total_cmp(&b.t_s)).map(|(index, _)| index)
        };
        let shown_faults: Vec<Option<usize>> =
            self.map_frames(|frame| newest_active_fault(frame.t_s));
        // Only faults that are shown at some instant are drawn, because a run may have thousands.
        let drawn_faults: BTreeSet<usize> = shown_faults.iter().flatten().copied().collect();
        let draw_fault = |index: usize| {
            let opacities =
                shown_faults.iter().map(|shown| u8::from(*shown == Some(index)).to_string());
            let opacities: Vec<String> = opacities.collect();
            let description = &faults[index].what;
            let text = heading(description, WIDTH - 16.0, Anchor::End).with_fill(VERMILION, 1.0);
            self.animate_switches(text, "opacity", &opacities)
        };
        let name = heading(&self.run.scene.name, 16.0, Anchor::Start);
        std::iter::once(name).chain(drawn_faults.into_iter().map(draw_fault)).collect()
    }

    /// Returns a grid in meters, and the leader's trajectory.
    fn draw_ground(&self) -> Vec<SvgElement> {
        let (view, bottom) = (&self.view, PLANE_TOP_AND_HEIGHT.0 + PLANE_TOP_AND_HEIGHT.1);
        let step_m = round_up_to_nice_step(40.0 / view.scale_px_per_m);
        let half_m = Vec2::new(PLANE_WIDTH, PLANE_TOP_AND_HEIGHT.1) / 2.0 / view.scale_px_per_m;
        let lines = |axis: usize| {
            let (low, high) =
                (view.center_m[axis] - half_m[axis], view.center_m[axis] + half_m[axis]);
            let first = (low / step_m).ceil() as i64;
            (first..).map(move |n| n as f64 * step_m).take_while(move |&value| value <= high)
        };
        let vertical = lines(0).map(|x| view.project(Vec2::new(x, 0.0)).0);
        let horizontal = lines(1).map(|y| view.project(Vec2::new(0.0, y)).1);
        let vertical = vertical.map(|x| {
            format!("M{} {}v{}", format_px(x), PLANE_TOP_AND_HEIGHT.0, PLANE_TOP_AND_HEIGHT.1)
        });
        let horizontal = horizontal.map(|y| format!("M0 {}h{PLANE_WIDTH}", format_px(y)));
        let grid: String = vertical.chain(horizontal).collect();
        let mut elements =
            vec![SvgElement::path(&grid).with_stroke(LineStyle::solid(Color(0xec, 0xef, 0xf2)))];
        let leader_path =
            self.run.leader_reference_m.iter().map(|&[x, y]| view.project(Vec2::new(x, y)));
        let leader_path: Vec<CanvasPoint> = leader_path.collect();
        if leader_path.len() > 1 {
            let dotted_path = SvgElement::path(&path_data(simplify_curve(&leader_path, 0.4)));
            let dotted_path =
                dotted_path.with_stroke(LineStyle::solid(GRAY).with_width(2.0).with_opacity(0.5));
            elements.push(
                dotted_path
                    .with_attribute("stroke-dasharray", "1 5")
                    .with_attribute("stroke-linecap", "round"),
            );
        }
        let (step_px, label_position) =
            (step_m * view.scale_px_per_m, (22.0 + step_m * view.scale_px_per_m, bottom - 8.0));
        let scale_bar =
            SvgElement::path(&path_data([(16.0, bottom - 12.0), (16.0 + step_px, bottom - 12.0)]));
        let bar_label =
            SvgElement::text(&format!("{} m", format_short(step_m)), label_position, Anchor::Start);
        elements
            .push(scale_bar.with_stroke(LineStyle::solid(SECONDARY_TEXT_COLOR).with_width(2.0)));
        elements.push(bar_label.with_fill(SECONDARY_TEXT_COLOR, 1.0));
        elements
    }

    /// Returns the walls and obstacles.
    fn draw_walls(&self) -> Option<SvgElement> {
        let wall_path = |wall: &Obstacle| match wall {
            Obstacle::Disc { center_m, radius_m } => {
                let ((x, y), r) =
                    (self.view.project(Vec2::from(*center_m)), radius_m * self.view.scale_px_per_m);
                let (left, diameter, r) = (format_px(x - r), format_px(2.0 * r), format_px(r));
                format!(
                    "M{left} {}a{r} {r} 0 1 0 {diameter} 0a{r} {r} 0 1 0 -{diameter} 0Z",
                    format_px(y)
                )
            }
            polygon => {
                path_data(polygon.outline().into_iter().map(|corner| self.view.project(corner)))
                    + "Z"
            }
        };
        let path_text: String = self.run.scene.walls.iter().map(wall_path).collect();
        let path = SvgElement::path(&path_text)
            .with_fill(BORDER_COLOR, 1.0)
            .with_attribute("stroke", SECONDARY_TEXT_COLOR);
        let path =
            path.with_attribute("stroke-width", 2.5).with_attribute("stroke-linejoin", "round");
        (!path_text.is_empty()).then_some(path)
    }

    /// Returns the recent path of each robot: a dash that moves along its path.
    fn draw_trails(&self) -> Vec<SvgElement> {
        let trail = |robot: usize| {
            let positions = self.robot_path(robot);
            let mut lengths = vec![0.0];
            for pair in positions.windows(2) {
                let length = portable_math::hypot(pair[1].0 - pair[0].0, pair[1].1 - pair[0].1);
                lengths.push(lengths[lengths.len() - 1] + length);
            }
            let total_length = lengths[lengths.len() - 1];
            let offsets: Vec<String> =
                lengths.iter().map(|length| format_px(TRAIL_LENGTH - length)).collect();
            let line = LineStyle::solid(robot_color(robot)).with_width(2.5).with_opacity(0.45);
            let path = SvgElement::path(&path_data(positions))
                .with_stroke(line)
                .with_attribute("stroke-linejoin", "round");
            let path = path.with_attribute(
                "stroke-dasharray",
                format!("{TRAIL_LENGTH} {}", format_px(total_length + TRAIL_LENGTH)),
            );
            (total_length >= 1.0)
                .then(|| self.animate_attribute(path, "stroke-dashoffset", &offsets))
        };
        (0..self.run.scene.robots.len()).filter_map(trail).collect()
    }

    /// Returns the position of a robot at each instant, or the last known position.
    fn robot_path(&self, robot: usize) -> Vec<CanvasPoint> {
        let mut newest = self.view.center_m;
        self.map_frames(|frame| {
            let position =
                front_points(self.run, frame).nth(robot).expect("each frame has every robot");
            newest = if is_finite(position) { position } else { newest };
            self.view.project(newest)
        })
    }

    /// Returns the convex hull of the leaders, in which the followers must be.
    fn draw_hull(&self) -> Option<SvgElement> {
        let (_, leaders) = self.run.followers_and_leaders()?;
        let shapes = self.map_frames(|frame| {
            let positions: Vec<Vec2> = front_points(self.run, frame).collect();
            let leaders: Vec<Vec2> = leaders.iter().map(|&robot| positions[robot]).collect();
            let mut corners = formation::hull::convex_hull(&leaders);
            // The number of corners is constant and begins with the first leader, so that the shape can be
            // interpolated.
            let first_corner =
                leaders.iter().find_map(|leader| corners.iter().position(|c| c == leader));
            corners.rotate_left(first_corner.unwrap_or(0));
            corners.resize(leaders.len(), corners.last().copied().unwrap_or(leaders[0]));
            path_data(corners.into_iter().map(|corner| self.view.project(corner))) + "Z"
        });
        let hull = SvgElement::new("path").with_fill(ORANGE, 0.18).with_attribute("stroke", ORANGE);
        Some(self.animate_attribute(hull.with_attribute("stroke-linejoin", "round"), "d", &shapes))
    }

    /// Returns the edges: arrows from sender to receiver, dashed while no beacon passes.
    fn draw_edges(&self) -> Vec<SvgElement> {
        let edge = |index: usize| {
            let edge = self.run.scene.edges[index];
            let end_positions =
                self.robot_path(edge.from).into_iter().zip(self.robot_path(edge.to));
            let shapes = end_positions.map(|((x, y), (u, v))| {
                path_data([(x, y), (x + 0.66 * (u - x), y + 0.66 * (v - y)), (u, v)])
            });
            let (colors, dashes): (Vec<String>, Vec<String>) = self
                .map_frames(|frame| match frame.edges[index] {
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
            let path = SvgElement::new("path")
                .with_attribute("fill", "none")
                .with_attribute("stroke-width", 1.3);
            let path = path.with_attribute("marker-mid", "url(#way)");
            let path = self.animate_attribute(path, "d", &shapes.collect::<Vec<_>>());
            let path = self.animate_switches(path, "stroke", &colors);
            self.animate_switches(path, "stroke-dasharray", &dashes)
        };
        (0..self.run.scene.edges.len()).map(edge).collect()
    }

    /// Returns the robots, each with a circle of radius d/2, or of its size, around its front point.
    fn draw_robots(&self) -> Vec<SvgElement> {
        let scene = &self.run.scene;
        let robot = |i: usize| {
            let size_m = scene.robots[i].keep_m.unwrap_or(scene.distance_min_m / 2.0);
            let radius_px = size_m * self.view.scale_px_per_m;
            let positions = self
                .robot_path(i)
                .into_iter()
                .map(|(x, y)| format!("{},{}", format_px(x), format_px(y)));
            let mut heading_rad = 0.0;
            let headings = self.map_frames(|frame| {
                let turn_rad: f64 = frame.robots[i].heading_rad - heading_rad;
                if turn_rad.is_finite() {
                    heading_rad += portable_math::atan2(
                        portable_math::sin(turn_rad),
                        portable_math::cos(turn_rad),
                    );
                }
                format_px(-heading_rad.to_degrees())
            });
            let colors = self.map_frames(|frame| match frame.robots[i].state.can_move() {
                true => robot_color(i).to_string(),
                false => GRAY.to_string(),
            });
            let is_dead = |frame: &SceneFrame| frame.robots[i].state == RobotState::Dead;
            let cross_opacities = self.map_frames(|frame| u8::from(is_dead(frame)).to_string());
            let body_length = (scene.robots[i].front_point_m * self.view.scale_px_per_m).max(9.0);
            let corners = [(0.35, 0.0), (-1.35, 0.75), (-0.9, 0.0), (-1.35, -0.75)];
            let body = corners.map(|(x, y)| (x * body_length, y * body_length));
            let body = SvgElement::path(&(path_data(body) + "Z")).with_attribute("stroke", WHITE);
            let arm = 1.1 * body_length;
            let cross =
                path_data([(-arm, -arm), (arm, arm)]) + &path_data([(arm, -arm), (-arm, arm)]);
            let cross =
                SvgElement::path(&cross).with_stroke(LineStyle::solid(VERMILION).with_width(3.0));
            let circle = SvgElement::new("circle")
                .with_attribute("r", format_px(radius_px))
                .with_attribute("fill-opacity", 0.1);
            let mut group = self
                .animate_switches(SvgElement::new("g"), "fill", &colors)
                .with_child(
                    circle
                        .with_attribute("stroke", SECONDARY_TEXT_COLOR)
                        .with_attribute("stroke-opacity", 0.35),
                )
                .with_child(self.animate_transform(
                    SvgElement::new("g").with_child(body),
                    "rotate",
                    &headings,
                ))
                .with_child(self.animate_switches(cross, "opacity", &cross_opacities));
            if scene.robots.len() <= NAMED_ROBOTS_MAX {
                let name_position = (0.0, -body_length.max(radius_px) - 4.0);
                let name = SvgElement::text(&scene.robots[i].name, name_position, Anchor::Middle);
                let name =
                    name.with_fill(Color(0x24, 0x29, 0x2f), 1.0).with_attribute("stroke", WHITE);
                group.push(
                    name.with_attribute("stroke-width", 3).with_attribute("paint-order", "stroke"),
                );
            }
            self.animate_transform(group, "translate", &positions.collect::<Vec<_>>())
        };
        (0..scene.robots.len()).map(robot).collect()
    }

    /// Returns the largest error and the smallest distance over time, with a moving cursor.
    fn draw_panels(&self) -> SvgElement {
        let frames = self.run.frames();
        let errors = frames.iter().map(|frame| {
            let moving_robots = frame.robots.iter().filter(|robot| robot.state.can_move());
            Some((frame.t_s, moving_robots.filter_map(|robot| robot.error_m).reduce(f64::max)?))
        });
        let distances = frames.iter().map(|frame| Some((frame.t_s, frame.distance_m?)));
        let (errors, distances): (Vec<_>, Vec<_>) = (errors.collect(), distances.collect());
        let axis = |label: &str, values: &[Option<CanvasPoint>], minimum: f64| {
            let finite_values =
                values.iter().flatten().map(|point| point.1).filter(|value| value.is_finite());
            Axis::linear(label, 0.0, finite_values.fold(minimum, f64::max))
        };
        let d = self.run.scene.distance_min_m;
        let mut error = panel_over_time(self.run, axis("largest error (m)", &errors, 1e-9));
        error.add_curve(errors, LineStyle::solid(BLACK));
        let distance = axis("smallest distance (m)", &distances, d);
        let mut distance = panel_over_time(self.run, distance).without_band_labels();
        distance.add_curve(distances, LineStyle::solid(BLUE));
        if !self.run.scene.has_sizes() {
            let label = format!("d = {} m", format_short(d));
            distance.add_horizontal_line(d, (0.0, self.run.end_s()), label, BOUND_LINE);
        }
        let lower_panel = Rect { y: UPPER_PANEL.y + UPPER_PANEL.height, ..UPPER_PANEL };
        let (top, bottom) =
            (UPPER_PANEL.plot_area(&error.bands), lower_panel.plot_area(&distance.bands));
        let (first_s, last_s) = (self.frames[0].t_s, self.frames[self.frames.len() - 1].t_s);
        let cursor_x = [first_s, last_s].map(|t_s| top.x + error.x_axis.fraction(t_s) * top.width);
        let line = path_data([(0.0, top.y), (0.0, bottom.y + bottom.height)]);
        let line = SvgElement::path(&line).with_stroke(LineStyle::solid(BLACK));
        let cursor_x = cursor_x.map(|x| format!("{},0", format_px(x)));
        SvgElement::new("g")
            .with_attribute("font-size", 12)
            .with_child(error.draw(UPPER_PANEL))
            .with_child(distance.draw(lower_panel))
            .with_child(self.animate_transform(line, "translate", &cursor_x))
    }
}

/// Returns the legend.
fn draw_legend(run: &LoadedRun) -> Vec<SvgElement> {
    let has_sizes = run.scene.has_sizes();
    let mut lines = vec![
        "Arrows: from sender to receiver.".to_owned(),
        "Orange: stale. Dashed: no beacon arrives.".to_owned(),
        match has_sizes {
            false => {
                format!("Circles: radius d/2, d = {} m.", format_short(run.scene.distance_min_m))
            }
            true => "Circles: radius `keep_m` of each robot.".to_owned(),
        },
        match has_sizes {
            false => "If none overlap, no pair is nearer than d.".to_owned(),
            true => "If none overlap, all distances are kept.".to_owned(),
        },
    ];
    if !run.repair_events.is_empty() {
        lines.insert(2, "Blue arrows: from backup neighbors.".to_owned());
    }
    if !run.leader_reference_m.is_empty() {
        lines.push("Gray dots: reference of the leader.".to_owned());
    }
    let step = (105.0 / lines.len() as f64).min(21.0);
    let line = |(i, line): (usize, &String)| {
        let position = (LEGEND_POSITION.0, LEGEND_POSITION.1 + step * i as f64);
        SvgElement::text(line, position, Anchor::Start).with_fill(SECONDARY_TEXT_COLOR, 1.0)
    };
    lines.iter().enumerate().map(line).collect()
}
