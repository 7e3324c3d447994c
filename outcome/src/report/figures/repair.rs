//! The graph before and after its repair, and when which robot went by whom.

use formation::Vec2;

use super::plane::{around, point, reach};
use super::{WIDTH, over_time};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, Panel, Place, Shape};
use crate::report::palette::{BLUE, Dash, GRAY, Line, VERMILION, color};
use crate::report::run::{Change, ChangedTo, Run};
use crate::report::scene::{EdgeState, RobotState, SceneEdge};
use crate::report::simplify::Point;

/// Height of both pictures of the graph, and of the time line below them, px.
const HEIGHT: f64 = 300.0;
const ROW: f64 = 18.0;
const AXES: f64 = 56.0;
/// So many robots have a row of the time line at most.
const ROWS_MAX: usize = 24;
/// Arrows end so far before the robot that hears, and their heads are so long and half as wide, as shares of the
/// picture.
const BEFORE: f64 = 0.035;
const HEAD: f64 = 0.03;
/// Room around the robots, as a share of where they are.
const MARGIN: f64 = 0.15;

/// Heard as planned; in place of the lost; no longer.
const HEARD: Line = Line::solid(GRAY);
const SPARE: Line = Line::solid(BLUE).width(1.6);
const LOST: Line = Line::solid(VERMILION).width(0.8).dashed(Dash::Dotted);

pub(super) fn before_and_after(run: &Run) -> Option<Figure> {
    let (first_s, _, _) = run.repairs.first()?;
    let before = run.times_s.partition_point(|t_s| t_s < first_s).saturating_sub(1);
    let died = |robot: usize| !run.tracks[robot][before].alive;
    // Before whoever is given up was lost.
    let since = |robot: usize| run.tracks[robot].iter().position(|sample| !sample.alive);
    let robots = 0..run.scene.robots.len();
    let lost = robots.filter(|&robot| died(robot)).filter_map(since).min();
    let before = lost.map_or(before, |lost| lost.saturating_sub(1).min(before));
    let after = run.times_s.len() - 1;
    let half = |x: f64| Place { x, y: 0.0, width: WIDTH / 2.0, height: HEIGHT };
    let mut panels = vec![
        (half(0.0), graph(run, before, half(0.0))),
        (half(WIDTH / 2.0), graph(run, after, half(WIDTH / 2.0))),
    ];
    panels.push(time_line(run));
    let caption = format!(
        "Arrows from a robot to one that hears it, at {:.1} s and at {:.1} s. Below, when which robot goes by \
         another in place of one that it has lost, and deputies that lead.",
        run.times_s[before], run.times_s[after]
    );
    Some(Figure {
        name: "repairs",
        title: "The graph before and after its repair".to_owned(),
        caption,
        width: WIDTH,
        panels,
        key: vec![
            (HEARD, "hears".to_owned()),
            (SPARE, "in place of the lost".to_owned()),
            (LOST, "dead".to_owned()),
        ],
    })
}

/// Who goes by whom at one instant.
fn graph(run: &Run, instant: usize, place: Place) -> Panel {
    let at: Vec<Vec2> =
        (0..run.scene.robots.len()).map(|robot| run.alpha(robot, instant)).collect();
    let known = |at: &&Vec2| at.x.is_finite() && at.y.is_finite();
    let points: Vec<Point> = at.iter().filter(known).map(|at| point(*at)).collect();
    let (low, high) = reach(points.iter()).unwrap_or_default();
    let size = |low: f64, high: f64| (high - low + 0.2) * (1.0 + MARGIN);
    let (inner, size) = (place.inner(&[]), (size(low.0, high.0), size(low.1, high.1)));
    let (mut panel, m_per_px) = around((low, high), size, inner);
    let reach_m = m_per_px * inner.width;
    let gone_by = run.gone_by(run.times_s[instant]);
    for (edge, _) in run.scene.edges.iter().zip(gone_by).filter(|(_, gone_by)| *gone_by) {
        let living = [edge.from, edge.to].iter().all(|&robot| run.tracks[robot][instant].alive);
        let line = match (living, edge.spare) {
            (false, _) => LOST,
            (true, true) => SPARE,
            (true, false) => HEARD,
        };
        let way = at[edge.to] - at[edge.from];
        let Some(along) = way.try_normalize(1e-9).filter(|_| known(&&way)) else { continue };
        let tip = at[edge.to] - BEFORE * reach_m * along;
        let back = tip - HEAD * reach_m * along;
        let side = 0.35 * HEAD * reach_m * Vec2::new(-along.y, along.x);
        panel.curves.push((vec![point(at[edge.from]), point(back)], line, false));
        let head: Vec<Point> = [tip, back + side, back - side].map(point).into();
        panel.areas.push((head, line.color, 1.0));
    }
    for (robot, at) in at.iter().enumerate().filter(|(_, at)| known(at)) {
        let label = run.scene.robots[robot].name.clone();
        let (shape, color) = match run.tracks[robot][instant].alive {
            true => (Shape::Ring, color(robot)),
            false => (Shape::Cross, VERMILION),
        };
        panel.marks.push(Mark { at: point(*at), shape, color, label });
    }
    panel
}

/// A row for each robot that was ever repaired: bars while it goes by somebody in place of another, or leads.
fn time_line(run: &Run) -> (Place, Panel) {
    let bars = bars(run);
    let mut robots: Vec<usize> = Vec::new();
    for bar in &bars {
        if !robots.contains(&bar.robot) && robots.len() < ROWS_MAX {
            robots.push(bar.robot);
        }
    }
    let rows = robots.len() as f64;
    let place = Place { x: 0.0, y: HEIGHT, width: WIDTH, height: AXES + ROW * (rows + 1.0) };
    let mut panel = over_time(run, Axis::exact("", 0.0, rows + 0.5));
    let name = |robot: usize| &run.scene.robots[robot].name;
    for (row, robot) in robots.into_iter().enumerate() {
        for (nth, bar) in bars.iter().filter(|bar| bar.robot == robot).enumerate() {
            let level = rows - row as f64 - 0.25 - 0.16 * nth as f64 % 0.5;
            let ends = vec![(bar.from_s, level), (bar.to_s.min(run.end_s()), level)];
            panel.curves.push((ends, SPARE.width(3.0), true));
            let label = match bar.by {
                Some(by) => format!("{}: {}", name(robot), name(by)),
                None => format!("{} leads", name(robot)),
            };
            let at = (bar.from_s, level);
            panel.marks.push(Mark { at, shape: Shape::Ring, color: BLUE, label });
        }
    }
    (place, panel)
}

/// While a robot that lives goes by a spare, or, without one, leads.
struct Bar {
    robot: usize,
    by: Option<usize>,
    from_s: f64,
    /// Infinite where nothing ends it.
    to_s: f64,
}

fn bars(run: &Run) -> Vec<Bar> {
    let mut bars: Vec<Bar> = Vec::new();
    for &Change { t_s, to } in &run.changes {
        let (robot, by, begins) = match to {
            ChangedTo::Edge(edge, state) if run.scene.edges[edge].spare => {
                let SceneEdge { from, to, .. } = run.scene.edges[edge];
                (to, Some(from), state != EdgeState::Closed)
            }
            ChangedTo::Leads(robot, yes) => (robot, None, yes),
            ChangedTo::Robot(robot, RobotState::Dead) => (robot, None, false),
            _ => continue,
        };
        let dies = matches!(to, ChangedTo::Robot(..));
        let ends =
            |bar: &&mut Bar| bar.to_s.is_infinite() && bar.robot == robot && (dies || bar.by == by);
        bars.iter_mut().filter(ends).for_each(|bar| bar.to_s = t_s);
        if begins {
            bars.push(Bar { robot, by, from_s: t_s, to_s: f64::INFINITY });
        }
    }
    bars
}
