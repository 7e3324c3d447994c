//! Where everybody went: the chapter's Figures 4, 8 and 12.

use formation::Vec2;
use formation::obstacle::Obstacle;

use super::{WIDTH, judged};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, Panel, Place, Shape};
use crate::report::palette::{BLACK, Dash, GRAY, Line, ORANGE, VERMILION, color, line};
use crate::report::run::{Change, ChangedTo, Run};
use crate::report::scene::RobotState;
use crate::report::simplify::Point;

/// Robots are named in the picture and in its key up to this many.
const NAMES_MAX: usize = 10;
/// Height of the picture: at least, and at most, px.
const HEIGHT: (f64, f64) = (240.0, 620.0);
/// A robot is at least so long, px.
const BODY: f64 = 9.0;
/// Between two instants at which the robots are drawn they have moved by so many times the size of
/// the formation.
const APART: f64 = 1.3;
/// Walls are shown so far beside where the robots were, as a share of that.
const BESIDE: f64 = 0.15;
/// Half of the room that a time takes, and what is drawn of a robot, px.
const LABEL: (f64, f64) = (21.0, 7.5);
const ROBOT: (f64, f64) = (8.0, 8.0);
/// A letter is about so wide, px.
const LETTER: f64 = 6.3;
/// The robots of the first instant shown are so pale, those of the last one not at all.
const PALEST: f64 = 0.3;
/// So many deaths are marked at most.
const DEATHS_MAX: usize = 12;
/// Robots are drawn at so many instants at most.
const INSTANTS_MAX: usize = 8;

pub(super) fn trajectories(run: &Run) -> Option<Figure> {
    let robots = run.scene.robots.len();
    let instants = run.times_s.len();
    let paths: Vec<Vec<Point>> = (0..robots)
        .map(|robot| (0..instants).map(|instant| point(run.alpha(robot, instant))).collect())
        .collect();
    let lead: Vec<Point> = run.lead_m.iter().map(|&[x, y]| (x, y)).collect();
    let finite = |at: &&Point| at.0.is_finite() && at.1.is_finite();
    let all = || paths.iter().chain([&lead]).flatten().filter(finite);
    let robots_reach = reach(all());
    if !(robots_reach.0.0.is_finite() && robots_reach.1.0.is_finite()) {
        return None;
    }
    let (lowest, highest) = with_walls(run, robots_reach);

    // Both axes have the same scale: the height follows the width within bounds, then one of both
    // ranges grows until it fits.
    let margin = |low: f64, high: f64| (high - low).max(0.1) * 0.06 + 0.02;
    let (dx, dy) = (margin(lowest.0, highest.0), margin(lowest.1, highest.1));
    let size = (highest.0 - lowest.0 + 2.0 * dx, highest.1 - lowest.1 + 2.0 * dy);
    let mut place = Place { x: 0.0, y: 0.0, width: WIDTH, height: 0.0 };
    let frame = place.height - place.inner(&[]).height;
    let (low, high) = HEIGHT;
    place.height = (place.inner(&[]).width * size.1 / size.0 + frame).clamp(low, high);
    let inner = place.inner(&[]);
    let m_per_px = (size.0 / inner.width).max(size.1 / inner.height);
    let axis = |label: &str, low: f64, high: f64, px: f64| {
        let (middle, half) = ((low + high) / 2.0, m_per_px * px / 2.0);
        Axis::exact(label, middle - half, middle + half)
    };
    let mut panel = Panel::new(
        axis("x (m)", lowest.0, highest.0, inner.width),
        axis("y (m)", lowest.1, highest.1, inner.height),
    );

    let half = (m_per_px * inner.width / 2.0, m_per_px * inner.height / 2.0);
    let middle = ((lowest.0 + highest.0) / 2.0, (lowest.1 + highest.1) / 2.0);
    let drawn = ((middle.0 - half.0, middle.1 - half.1), (middle.0 + half.0, middle.1 + half.1));
    for wall in &run.scene.walls {
        let mut outline = seen(wall, drawn);
        panel.areas.push((outline.clone(), GRAY, 0.35));
        outline.extend(outline.first().copied());
        panel.curves.push((outline, Line::solid(BLACK).weight(2), false));
    }

    let mut key = Vec::new();
    let few = robots <= NAMES_MAX;
    if !lead.is_empty() {
        let line = Line { opacity: 0.35, ..Line::solid(GRAY).weight(16) };
        panel.curves.push((lead, line, false));
        key.push((line, "m(t), the main leader's reference".to_owned()));
    }
    for (robot, path) in paths.iter().enumerate() {
        let role = run.scene.robots[robot].role.as_str();
        let line = if few { line(robot).weight(2) } else { Line::solid(color(robot)).weight(1) };
        panel.curves.push((path.clone(), line, false));
        if few {
            key.push((line, format!("{} ({})", run.scene.robots[robot].name, in_words(role))));
        }
        let name = if few { run.scene.robots[robot].name.clone() } else { String::new() };
        panel.marks.push(Mark { at: path[0], shape: Shape::Cross, color: BLACK, label: name });
    }
    let deaths = deaths(run);
    let died = !deaths.is_empty();
    panel.marks.extend(deaths);
    let shown = instants_apart(run);
    for (nth, &instant) in shown.iter().enumerate() {
        let newness = (nth + 1) as f64 / shown.len() as f64;
        let opacity = PALEST + (1.0 - PALEST) * newness;
        formation(run, instant, m_per_px, opacity, &mut panel);
    }
    let mut taken = Taken::of(run, &shown, &panel, m_per_px);
    for &instant in &shown {
        panel.marks.extend(taken.time(run, instant));
    }
    let times: Vec<String> =
        shown.iter().map(|&instant| format!("{:.1}", run.times_s[instant])).collect();
    let drawn = match run.containment() {
        Some(_) => {
            key.push((Line::solid(ORANGE).weight(4), "hull of the leaders".to_owned()));
            "with the hull of the leaders"
        }
        None => "with the edges of the formation graph",
    };
    let mut caption = format!(
        "Paths of the front points. Black crosses: starts{}. Robots as triangles that point forward, \
         {drawn}, each time that they have gone as far again, the older the paler: at {} s.",
        if died { "; orange crosses: deaths, and when" } else { "" },
        times.join(", ")
    );
    if !run.scene.walls.is_empty() {
        caption += " Gray: walls and obstacles.";
    }
    if !few {
        caption += " Colors are those of the replay and repeat.";
    }
    if let Some(summary) = &run.summary {
        if let Some(expectation) = summary.expected("min_clearance_m") {
            caption += &judged(expectation, "The smallest clearance at any tick", "m");
        }
        if let Some(expectation) = summary.expected("tracking_error_m_max") {
            caption +=
                &judged(expectation, "The main leader's worst distance from m(t) at the end", "m");
        }
        if let Some(expectation) = summary.expected("final_error_m_max") {
            caption += &judged(expectation, "The worst error of the living at the end", "m");
        }
        if let Some(expectation) = summary.expected("hull_distance_m_max") {
            caption += &judged(
                expectation,
                "The contained robots, farthest outside the hull at the end",
                "m",
            );
        }
    }
    Some(Figure {
        name: "trajectories",
        title: "Trajectories in the plane".into(),
        caption,
        width: WIDTH,
        height: place.height,
        panels: vec![(place, panel)],
        key,
    })
}

/// The lowest and the highest x and y.
type Reach = (Point, Point);

fn reach<'p>(points: impl Iterator<Item = &'p Point>) -> Reach {
    let nowhere = ((f64::INFINITY, f64::INFINITY), (-f64::INFINITY, -f64::INFINITY));
    points.fold(nowhere, |(low, high), at| {
        ((low.0.min(at.0), low.1.min(at.1)), (high.0.max(at.0), high.1.max(at.1)))
    })
}

/// The same with the walls beside where the robots were, as far as they are near.
fn with_walls(run: &Run, robots: Reach) -> Reach {
    let ((left, low), (right, high)) = robots;
    let beside = BESIDE * (right - left).max(high - low);
    let near = ((left - beside, low - beside), (right + beside, high + beside));
    let walls: Vec<Point> = run.scene.walls.iter().flat_map(|wall| seen(wall, near)).collect();
    reach(walls.iter().chain([&robots.0, &robots.1]))
}

/// The part of a wall within a rectangle. (Sutherland and Hodgman: side by side)
fn seen(wall: &Obstacle, (low, high): Reach) -> Vec<Point> {
    let mut outline: Vec<Point> = wall.outline().into_iter().map(point).collect();
    // How far inside of each side a point is.
    let sides: [&dyn Fn(Point) -> f64; 4] =
        [&|p| p.0 - low.0, &|p| high.0 - p.0, &|p| p.1 - low.1, &|p| high.1 - p.1];
    for inside in sides {
        let mut kept = Vec::new();
        for (i, &to) in outline.iter().enumerate() {
            let from = outline[(i + outline.len() - 1) % outline.len()];
            let (a, b) = (inside(from), inside(to));
            if (a < 0.0) != (b < 0.0) {
                let share = a / (a - b);
                kept.push((from.0 + share * (to.0 - from.0), from.1 + share * (to.1 - from.1)));
            }
            if b >= 0.0 {
                kept.push(to);
            }
        }
        outline = kept;
    }
    outline
}

fn point(at: Vec2) -> Point {
    (at.x, at.y)
}

fn in_words(role: &str) -> &str {
    match role {
        "main-leader" => "main leader",
        "leader" => "secondary leader",
        "formation" => "in formation",
        other => other,
    }
}

/// Where robots died, and when: the first deaths.
fn deaths(run: &Run) -> Vec<Mark> {
    let died = |change: &Change| match change.to {
        ChangedTo::Robot(robot, RobotState::Dead) if robot < run.tracks.len() => {
            let after = run.times_s.partition_point(|&t_s| t_s < change.t_s);
            let at = point(run.alpha(robot, after.min(run.times_s.len() - 1)));
            let name = &run.scene.robots[robot].name;
            let label = format!("{name} dead, {:.1} s", change.t_s);
            Some(Mark { at, shape: Shape::Cross, color: VERMILION, label })
        }
        _ => None,
    };
    run.changes.iter().filter_map(died).take(DEATHS_MAX).collect()
}

/// The robots at one instant, and what holds them together.
fn formation(run: &Run, instant: usize, m_per_px: f64, opacity: f64, panel: &mut Panel) {
    let robots = run.scene.robots.len();
    if let Some((_, leaders)) = run.containment() {
        let mut corners: Vec<Point> = run.hull(&leaders, instant).into_iter().map(point).collect();
        panel.areas.push((corners.clone(), ORANGE, 0.2 * opacity));
        corners.extend(corners.first().copied());
        panel.curves.push((corners, Line { opacity, ..Line::solid(ORANGE).weight(2) }, false));
    } else {
        for edge in &run.scene.edges {
            let ends = [edge.from, edge.to].map(|robot| point(run.alpha(robot, instant)));
            // Nothing goes from or to the dead.
            let living = [edge.from, edge.to].iter().all(|&r| run.tracks[r][instant].alive);
            let (dash, opacity) =
                if living { (Dash::Solid, opacity) } else { (Dash::Dotted, 0.6 * opacity) };
            let line = Line { opacity, ..Line::solid(GRAY).weight(1) };
            panel.curves.push((ends.into(), line.dashed(dash), false));
        }
    }
    for robot in 0..robots {
        let sample = run.tracks[robot][instant];
        let nose = run.alpha(robot, instant);
        if !(nose.x.is_finite() && nose.y.is_finite()) {
            continue;
        }
        let length = length_m(run, robot, m_per_px);
        let (sin, cos) = sample.heading_rad.sin_cos();
        let back = nose - length * Vec2::new(cos, sin);
        let side = 0.4 * length * Vec2::new(-sin, cos);
        let color = if sample.alive { color(robot) } else { GRAY };
        let body: Vec<Point> = [nose, back + side, back - side].into_iter().map(point).collect();
        let mut outline = body.clone();
        outline.push(body[0]);
        panel.areas.push((body, color, opacity));
        panel.curves.push((outline, Line { opacity, ..Line::solid(BLACK).weight(1) }, false));
    }
}

/// Where something is drawn that a time shall not stand on: middles, m, and half of the room, px.
struct Taken {
    m_per_px: f64,
    rooms: Vec<(Point, Point)>,
}

impl Taken {
    /// All robots that are shown, and the marks of the panel with their labels.
    fn of(run: &Run, shown: &[usize], panel: &Panel, m_per_px: f64) -> Taken {
        let mut rooms = Vec::new();
        for &instant in shown {
            let robots = 0..run.tracks.len();
            rooms.extend(robots.map(|robot| (body(run, robot, instant, m_per_px), ROBOT)));
        }
        for mark in &panel.marks {
            let half = mark.label.chars().count() as f64 * LETTER / 2.0;
            let (x, y) = (mark.at.0 + (8.0 + half) * m_per_px, mark.at.1 + 10.0 * m_per_px);
            rooms.extend([(mark.at, (4.0, 4.0)), ((x, y), (half, LABEL.1))]);
        }
        rooms.retain(|((x, y), _)| x.is_finite() && y.is_finite());
        Taken { m_per_px, rooms }
    }

    fn is_free(&self, at: Point) -> bool {
        let apart = |a: f64, b: f64, room: f64| (a - b).abs() >= room * self.m_per_px;
        self.rooms.iter().all(|&(other, half)| {
            apart(at.0, other.0, half.0 + LABEL.0) || apart(at.1, other.1, half.1 + LABEL.1)
        })
    }

    /// The time of an instant beside one of its robots: the highest one that has room for it above,
    /// below or at a side; nothing if none has.
    fn time(&mut self, run: &Run, instant: usize) -> Option<Mark> {
        let robots = 0..run.tracks.len();
        let mut bodies: Vec<Point> =
            robots.map(|robot| body(run, robot, instant, self.m_per_px)).collect();
        bodies.retain(|(x, y)| x.is_finite() && y.is_finite());
        bodies.sort_by(|a, b| b.1.total_cmp(&a.1));
        let (aside, above) = (ROBOT.0 + LABEL.0 + 1.0, ROBOT.1 + LABEL.1 + 1.0);
        let ways = [(0.0, above), (0.0, -above), (aside, 0.0), (-aside, 0.0)];
        let beside = |&(x, y): &Point| {
            ways.map(|(right, up)| (x + right * self.m_per_px, y + up * self.m_per_px))
        };
        let at = bodies.iter().flat_map(beside).find(|&at| self.is_free(at))?;
        self.rooms.push((at, LABEL));
        let label = format!("{:.1} s", run.times_s[instant]);
        Some(Mark { at, shape: Shape::Words, color: BLACK, label })
    }
}

/// The middle of what is drawn of a robot.
fn body(run: &Run, robot: usize, instant: usize, m_per_px: f64) -> Point {
    let length = length_m(run, robot, m_per_px);
    let (sin, cos) = run.tracks[robot][instant].heading_rad.sin_cos();
    point(run.alpha(robot, instant) - 0.6 * length * Vec2::new(cos, sin))
}

/// How long a robot is drawn, m.
fn length_m(run: &Run, robot: usize, m_per_px: f64) -> f64 {
    run.scene.robots[robot].front_point_m.max(BODY * m_per_px)
}

/// Instants between which the robots have moved far enough to be told apart; the last one is the
/// end of the run.
fn instants_apart(run: &Run) -> Vec<usize> {
    let robots = run.scene.robots.len();
    let instants = run.times_s.len();
    let step = |instant: usize| {
        let moved = (0..robots).map(|robot| {
            let moved = (run.alpha(robot, instant) - run.alpha(robot, instant - 1)).norm();
            if moved.is_finite() { moved } else { 0.0 }
        });
        moved.sum::<f64>() / robots as f64
    };
    let mut walked = vec![0.0];
    for instant in 1..instants {
        walked.push(walked[instant - 1] + step(instant));
    }
    let whole = walked[instants - 1];
    let size = (1..robots)
        .map(|robot| (run.alpha(robot, instants - 1) - run.alpha(0, instants - 1)).norm())
        .fold(1e-3, f64::max);
    let many = ((whole / (APART * size)) as usize).clamp(2, INSTANTS_MAX);
    let mut shown: Vec<usize> = (1..=many)
        .map(|n| walked.partition_point(|&way| way < whole * n as f64 / many as f64 - 1e-12))
        .map(|instant| instant.min(instants - 1))
        .collect();
    if let Some(last) = shown.last_mut() {
        *last = instants - 1;
    }
    shown.dedup();
    shown
}
