//! Figure of topology repair: the graph before and after, and which neighbor each robot used when.

use formation::Vec2;

use super::plane::{extent, panel_around, to_canvas_point};
use super::{CURVES_MAX, WIDTH, panel_over_time};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, MarkShape, Panel, Rect};
use crate::report::palette::{BLUE, Dash, GRAY, LineStyle, VERMILION, robot_color};
use crate::report::run::{LoadedRun, NewState, StateChange};
use crate::report::scene::{EdgeState, RobotState, SceneEdge};
use crate::report::simplify::CanvasPoint;

/// Height of both pictures of the graph, px.
const HEIGHT: f64 = 300.0;
/// Height of a row of the time line, px.
const ROW_HEIGHT: f64 = 18.0;
/// Height of the axes of the time line, px.
const AXES_HEIGHT: f64 = 56.0;
/// Maximum number of robots in the time line; further ones are left out.
const TIME_LINE_ROWS_MAX: usize = 24;
/// Gap between an arrow's tip and the receiving robot, as a fraction of the picture's width.
const ARROW_GAP: f64 = 0.035;
/// Length of an arrowhead, as a fraction of the picture's width.
const ARROWHEAD_LENGTH: f64 = 0.03;
/// Margin around the robots, as a fraction of their extent.
const PICTURE_MARGIN: f64 = 0.15;

/// Line style of an edge of the planned graph.
const PLANNED_EDGE_LINE: LineStyle = LineStyle::solid(GRAY);
/// Line style of an edge from a backup neighbor.
const BACKUP_EDGE_LINE: LineStyle = LineStyle::solid(BLUE).with_width(1.6);
/// Line style of an edge with a dead robot.
const DEAD_EDGE_LINE: LineStyle =
    LineStyle::solid(VERMILION).with_width(0.8).with_dash(Dash::Dotted);

pub(super) fn draw_repair(run: &LoadedRun) -> Option<Figure> {
    let (first_s, _, _) = run.repair_events.first()?;
    let before = run.times_s.partition_point(|t_s| t_s < first_s).saturating_sub(1);
    let died = |robot: usize| !run.tracks[robot][before].is_alive;
    // The first picture is from before the loss of the neighbor that was given up.
    let since = |robot: usize| run.tracks[robot].iter().position(|sample| !sample.is_alive);
    let robots = 0..run.scene.robots.len();
    let lost = robots.filter(|&robot| died(robot)).filter_map(since).min();
    let before = lost.map_or(before, |lost| lost.saturating_sub(1).min(before));
    let after = run.times_s.len() - 1;
    let half = |x: f64| Rect { x, y: 0.0, width: WIDTH / 2.0, height: HEIGHT };
    let mut panels = vec![
        (half(0.0), draw_graph(run, before, half(0.0))),
        (half(WIDTH / 2.0), draw_graph(run, after, half(WIDTH / 2.0))),
    ];
    panels.push(draw_time_line(run));
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
        legend: vec![
            (PLANNED_EDGE_LINE, "planned edge".to_owned()),
            (BACKUP_EDGE_LINE, "backup neighbor".to_owned()),
            (DEAD_EDGE_LINE, "dead".to_owned()),
        ],
    })
}

/// Draws the edges in use at one instant.
fn draw_graph(run: &LoadedRun, instant: usize, place: Rect) -> Panel {
    let at: Vec<Vec2> =
        (0..run.scene.robots.len()).map(|robot| run.front_point(robot, instant)).collect();
    let known = |at: &&Vec2| at.x.is_finite() && at.y.is_finite();
    let points: Vec<CanvasPoint> = at.iter().filter(known).map(|at| to_canvas_point(*at)).collect();
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
        let living = [edge.from, edge.to].iter().all(|&robot| run.tracks[robot][instant].is_alive);
        let line = match (living, edge.spare) {
            (false, _) => DEAD_EDGE_LINE,
            (true, true) => BACKUP_EDGE_LINE,
            (true, false) => PLANNED_EDGE_LINE,
        };
        let line = if crowd { line.with_width(0.4) } else { line };
        let way = at[edge.to] - at[edge.from];
        let Some(along) = way.try_normalize(1e-9).filter(|_| known(&&way)) else { continue };
        if crowd {
            panel.curves.push((
                vec![to_canvas_point(at[edge.from]), to_canvas_point(at[edge.to])],
                line,
                false,
            ));
            continue;
        }
        let tip = at[edge.to] - ARROW_GAP * reach_m * along;
        let back = tip - ARROWHEAD_LENGTH * reach_m * along;
        let side = 0.35 * ARROWHEAD_LENGTH * reach_m * Vec2::new(-along.y, along.x);
        panel.curves.push((
            vec![to_canvas_point(at[edge.from]), to_canvas_point(back)],
            line,
            false,
        ));
        let head: Vec<CanvasPoint> = [tip, back + side, back - side].map(to_canvas_point).into();
        panel.areas.push((head, line.color, 1.0));
    }
    for (robot, at) in at.iter().enumerate().filter(|(_, at)| known(at)) {
        if crowd && run.tracks[robot][instant].is_alive {
            continue;
        }
        let label = if crowd { String::new() } else { run.scene.robots[robot].name.clone() };
        let (shape, color) = match run.tracks[robot][instant].is_alive {
            true => (MarkShape::Ring, robot_color(robot)),
            false => (MarkShape::Cross, VERMILION),
        };
        panel.marks.push(Mark { position: to_canvas_point(*at), shape, color, label });
    }
    panel
}

/// Draws a row for each robot that was repaired, with bars while it uses a backup neighbor or leads.
fn draw_time_line(run: &LoadedRun) -> (Rect, Panel) {
    let bars = repair_periods(run);
    let mut robots: Vec<usize> = Vec::new();
    for bar in &bars {
        if !robots.contains(&bar.robot) && robots.len() < TIME_LINE_ROWS_MAX {
            robots.push(bar.robot);
        }
    }
    let rows = robots.len() as f64;
    let place =
        Rect { x: 0.0, y: HEIGHT, width: WIDTH, height: AXES_HEIGHT + ROW_HEIGHT * (rows + 1.0) };
    let mut panel = panel_over_time(run, Axis::exact("", 0.0, rows + 0.5));
    let name = |robot: usize| &run.scene.robots[robot].name;
    for (row, robot) in robots.into_iter().enumerate() {
        for (nth, bar) in bars.iter().filter(|bar| bar.robot == robot).enumerate() {
            let level = rows - row as f64 - 0.25 - 0.16 * nth as f64 % 0.5;
            let ends = vec![(bar.start_s, level), (bar.end_s.min(run.end_s()), level)];
            panel.curves.push((ends, BACKUP_EDGE_LINE.with_width(3.0), true));
            let label = match bar.backup_neighbor {
                Some(by) => format!("{}: {}", name(robot), name(by)),
                None => format!("{} leads", name(robot)),
            };
            let at = (bar.start_s, level);
            panel.marks.push(Mark { position: at, shape: MarkShape::Ring, color: BLUE, label });
        }
    }
    (place, panel)
}

/// Period in which a living robot uses a backup neighbor (`by`) or, without one, leads.
struct RepairPeriod {
    robot: usize,
    backup_neighbor: Option<usize>,
    start_s: f64,
    /// End of the period, s; infinite if nothing ends it.
    end_s: f64,
}

fn repair_periods(run: &LoadedRun) -> Vec<RepairPeriod> {
    let mut bars: Vec<RepairPeriod> = Vec::new();
    for &StateChange { t_s, new_state: to } in &run.state_changes {
        let (robot, by, begins) = match to {
            NewState::Edge(edge, state) if run.scene.edges[edge].spare => {
                let SceneEdge { from, to, .. } = run.scene.edges[edge];
                (to, Some(from), state != EdgeState::Closed)
            }
            NewState::Leads(robot, yes) => (robot, None, yes),
            NewState::Robot(robot, RobotState::Dead) => (robot, None, false),
            _ => continue,
        };
        let dies = matches!(to, NewState::Robot(..));
        let ends = |bar: &&mut RepairPeriod| {
            bar.end_s.is_infinite() && bar.robot == robot && (dies || bar.backup_neighbor == by)
        };
        bars.iter_mut().filter(ends).for_each(|bar| bar.end_s = t_s);
        if begins {
            bars.push(RepairPeriod {
                robot,
                backup_neighbor: by,
                start_s: t_s,
                end_s: f64::INFINITY,
            });
        }
    }
    bars
}
