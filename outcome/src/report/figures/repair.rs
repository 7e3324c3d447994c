//! Figure of topology repair: the graph before and after, and which neighbor each robot used when.

use formation::Vec2;

use super::plane::{extent, panel_around, point};
use super::{CURVES_MAX, WIDTH, over_time};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, Panel, Rect, Shape};
use crate::report::palette::{BLUE, Dash, GRAY, Line, VERMILION, color};
use crate::report::run::{Change, ChangedTo, Run};
use crate::report::scene::{EdgeState, RobotState, SceneEdge};
use crate::report::simplify::CanvasPoint;

/// Height of both pictures of the graph, px.
const HEIGHT: f64 = 300.0;
/// Height of a row of the time line, px.
const ROW_HEIGHT: f64 = 18.0;
/// Height of the axes of the time line, px.
const AXES: f64 = 56.0;
/// Maximum number of robots in the time line; further ones are left out.
const ROWS_MAX: usize = 24;
/// Gap between an arrow's tip and the receiving robot, as a fraction of the picture's width.
const ARROW_GAP: f64 = 0.035;
/// Length of an arrowhead, as a fraction of the picture's width.
const ARROWHEAD_LENGTH: f64 = 0.03;
/// Margin around the robots, as a fraction of their extent.
const PICTURE_MARGIN: f64 = 0.15;

/// Line style of an edge of the planned graph.
const PLANNED_EDGE_LINE: Line = Line::solid(GRAY);
/// Line style of an edge from a backup neighbor.
const SPARE: Line = Line::solid(BLUE).width(1.6);
/// Line style of an edge with a dead robot.
const DEAD_EDGE_LINE: Line = Line::solid(VERMILION).width(0.8).dashed(Dash::Dotted);

pub(super) fn draw_repair(run: &Run) -> Option<Figure> {
    let (first_s, _, _) = run.repairs.first()?;
    let before = run.times_s.partition_point(|t_s| t_s < first_s).saturating_sub(1);
    let died = |robot: usize| !run.tracks[robot][before].alive;
    // The first picture is from before the loss of the neighbor that was given up.
    let since = |robot: usize| run.tracks[robot].iter().position(|sample| !sample.alive);
    let robots = 0..run.scene.robots.len();
    let lost = robots.filter(|&robot| died(robot)).filter_map(since).min();
    let before = lost.map_or(before, |lost| lost.saturating_sub(1).min(before));
    let after = run.times_s.len() - 1;
    let half = |x: f64| Rect { x, y: 0.0, width: WIDTH / 2.0, height: HEIGHT };
    let mut panels = vec![
        (half(0.0), graph(run, before, half(0.0))),
        (half(WIDTH / 2.0), graph(run, after, half(WIDTH / 2.0))),
    ];
    panels.push(time_line(run));
    let caption = format!(
        "{} from sender to receiver, at {:.1} s and at {:.1} s. Below: the times at which a robot uses a backup \
         neighbor in place of a lost one, and at which a deputy leads.",
        if run.scene.robots.len() > CURVES_MAX { "Edges" } else { "Arrows" },
        run.times_s[before],
        run.times_s[after]
    );
    Some(Figure {
        name: "repairs",
        title: "The graph before and after its repair".to_owned(),
        caption,
        width: WIDTH,
        panels,
        key: vec![
            (PLANNED_EDGE_LINE, "planned edge".to_owned()),
            (SPARE, "backup neighbor".to_owned()),
            (DEAD_EDGE_LINE, "dead".to_owned()),
        ],
    })
}

/// Draws the edges in use at one instant.
fn graph(run: &Run, instant: usize, place: Rect) -> Panel {
    let at: Vec<Vec2> =
        (0..run.scene.robots.len()).map(|robot| run.alpha(robot, instant)).collect();
    let known = |at: &&Vec2| at.x.is_finite() && at.y.is_finite();
    let points: Vec<CanvasPoint> = at.iter().filter(known).map(|at| point(*at)).collect();
    let (low, high) = extent(points.iter()).unwrap_or_default();
    let size = |low: f64, high: f64| (high - low + 0.2) * (1.0 + PICTURE_MARGIN);
    let (inner, size) = (place.plot_area(&[]), (size(low.0, high.0), size(low.1, high.1)));
    let (mut panel, m_per_px) = panel_around((low, high), size, inner);
    let reach_m = m_per_px * inner.width;
    // Arrowheads and names of more robots would cover the edges.
    let crowd = run.scene.robots.len() > CURVES_MAX;
    let edges_in_use = run.edges_in_use(run.times_s[instant]);
    for (edge, _) in
        run.scene.edges.iter().zip(edges_in_use).filter(|(_, edges_in_use)| *edges_in_use)
    {
        let living = [edge.from, edge.to].iter().all(|&robot| run.tracks[robot][instant].alive);
        let line = match (living, edge.spare) {
            (false, _) => DEAD_EDGE_LINE,
            (true, true) => SPARE,
            (true, false) => PLANNED_EDGE_LINE,
        };
        let line = if crowd { line.width(0.4) } else { line };
        let way = at[edge.to] - at[edge.from];
        let Some(along) = way.try_normalize(1e-9).filter(|_| known(&&way)) else { continue };
        if crowd {
            panel.curves.push((vec![point(at[edge.from]), point(at[edge.to])], line, false));
            continue;
        }
        let tip = at[edge.to] - ARROW_GAP * reach_m * along;
        let back = tip - ARROWHEAD_LENGTH * reach_m * along;
        let side = 0.35 * ARROWHEAD_LENGTH * reach_m * Vec2::new(-along.y, along.x);
        panel.curves.push((vec![point(at[edge.from]), point(back)], line, false));
        let head: Vec<CanvasPoint> = [tip, back + side, back - side].map(point).into();
        panel.areas.push((head, line.color, 1.0));
    }
    for (robot, at) in at.iter().enumerate().filter(|(_, at)| known(at)) {
        if crowd && run.tracks[robot][instant].alive {
            continue;
        }
        let label = if crowd { String::new() } else { run.scene.robots[robot].name.clone() };
        let (shape, color) = match run.tracks[robot][instant].alive {
            true => (Shape::Ring, color(robot)),
            false => (Shape::Cross, VERMILION),
        };
        panel.marks.push(Mark { at: point(*at), shape, color, label });
    }
    panel
}

/// Draws a row for each robot that was repaired, with bars while it uses a backup neighbor or leads.
fn time_line(run: &Run) -> (Rect, Panel) {
    let bars = bars(run);
    let mut robots: Vec<usize> = Vec::new();
    for bar in &bars {
        if !robots.contains(&bar.robot) && robots.len() < ROWS_MAX {
            robots.push(bar.robot);
        }
    }
    let rows = robots.len() as f64;
    let place = Rect { x: 0.0, y: HEIGHT, width: WIDTH, height: AXES + ROW_HEIGHT * (rows + 1.0) };
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

/// Period in which a living robot uses a backup neighbor (`by`) or, without one, leads.
struct Bar {
    robot: usize,
    by: Option<usize>,
    from_s: f64,
    /// End of the period, s; infinite if nothing ends it.
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
