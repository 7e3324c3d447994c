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
    let instant_before = run.times_s.partition_point(|t_s| t_s < first_s).saturating_sub(1);
    let is_dead = |robot: usize| !run.tracks[robot][instant_before].is_alive;
    // The first picture is from before the loss of the neighbor that was given up.
    let death_instant = |robot: usize| run.tracks[robot].iter().position(|sample| !sample.is_alive);
    let robots = 0..run.scene.robots.len();
    let first_death = robots.filter(|&robot| is_dead(robot)).filter_map(death_instant).min();
    let instant_before = first_death
        .map_or(instant_before, |first_death| first_death.saturating_sub(1).min(instant_before));
    let instant_after = run.times_s.len() - 1;
    let half_rect = |x: f64| Rect { x, y: 0.0, width: WIDTH / 2.0, height: HEIGHT };
    let mut panels = vec![
        (half_rect(0.0), draw_graph(run, instant_before, half_rect(0.0))),
        (half_rect(WIDTH / 2.0), draw_graph(run, instant_after, half_rect(WIDTH / 2.0))),
    ];
    panels.push(draw_time_line(run));
    let caption = format!(
        "{} from sender to receiver, at {:.1} s and at {:.1} s. Below: the times at which a robot uses a backup \
         neighbor in place of a lost one, and at which a deputy leads.",
        if run.scene.robots.len() > CURVES_MAX { "Edges" } else { "Arrows" },
        run.times_s[instant_before],
        run.times_s[instant_after]
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
fn draw_graph(run: &LoadedRun, instant: usize, rect: Rect) -> Panel {
    let positions: Vec<Vec2> =
        (0..run.scene.robots.len()).map(|robot| run.front_point(robot, instant)).collect();
    let is_finite_point = |position: &&Vec2| position.x.is_finite() && position.y.is_finite();
    let points: Vec<CanvasPoint> = positions
        .iter()
        .filter(is_finite_point)
        .map(|position| to_canvas_point(*position))
        .collect();
    let (low, high) = extent(points.iter()).unwrap_or_default();
    let size = |low: f64, high: f64| (high - low + 0.2) * (1.0 + PICTURE_MARGIN);
    let (inner, size) = (rect.plot_area(&[]), (size(low.0, high.0), size(low.1, high.1)));
    let (mut panel, m_per_px) = panel_around((low, high), size, inner);
    let panel_width_m = m_per_px * inner.width;
    // Arrowheads and names of more robots would cover the edges.
    let has_many = run.scene.robots.len() > CURVES_MAX;
    let is_in_use = run.edges_in_use(run.times_s[instant]);
    for (edge, _) in run.scene.edges.iter().zip(is_in_use).filter(|(_, is_in_use)| *is_in_use) {
        let both_alive =
            [edge.from, edge.to].iter().all(|&robot| run.tracks[robot][instant].is_alive);
        let style = match (both_alive, edge.spare) {
            (false, _) => DEAD_EDGE_LINE,
            (true, true) => BACKUP_EDGE_LINE,
            (true, false) => PLANNED_EDGE_LINE,
        };
        let style = if has_many { style.with_width(0.4) } else { style };
        let edge_vector = positions[edge.to] - positions[edge.from];
        let Some(direction) =
            edge_vector.try_normalize(1e-9).filter(|_| is_finite_point(&&edge_vector))
        else {
            continue;
        };
        if has_many {
            panel.curves.push((
                vec![to_canvas_point(positions[edge.from]), to_canvas_point(positions[edge.to])],
                style,
                false,
            ));
            continue;
        }
        let tip = positions[edge.to] - ARROW_GAP * panel_width_m * direction;
        let head_base = tip - ARROWHEAD_LENGTH * panel_width_m * direction;
        let half_width =
            0.35 * ARROWHEAD_LENGTH * panel_width_m * Vec2::new(-direction.y, direction.x);
        panel.curves.push((
            vec![to_canvas_point(positions[edge.from]), to_canvas_point(head_base)],
            style,
            false,
        ));
        let arrowhead: Vec<CanvasPoint> =
            [tip, head_base + half_width, head_base - half_width].map(to_canvas_point).into();
        panel.areas.push((arrowhead, style.color, 1.0));
    }
    for (robot, position) in
        positions.iter().enumerate().filter(|(_, position)| is_finite_point(position))
    {
        if has_many && run.tracks[robot][instant].is_alive {
            continue;
        }
        let label = if has_many { String::new() } else { run.scene.robots[robot].name.clone() };
        let (shape, color) = match run.tracks[robot][instant].is_alive {
            true => (MarkShape::Ring, robot_color(robot)),
            false => (MarkShape::Cross, VERMILION),
        };
        panel.marks.push(Mark { position: to_canvas_point(*position), shape, color, label });
    }
    panel
}

/// Draws a row for each robot that was repaired, with bars while it uses a backup neighbor or leads.
fn draw_time_line(run: &LoadedRun) -> (Rect, Panel) {
    let periods = repair_periods(run);
    let mut robots: Vec<usize> = Vec::new();
    for period in &periods {
        if !robots.contains(&period.robot) && robots.len() < TIME_LINE_ROWS_MAX {
            robots.push(period.robot);
        }
    }
    let rows = robots.len() as f64;
    let rect =
        Rect { x: 0.0, y: HEIGHT, width: WIDTH, height: AXES_HEIGHT + ROW_HEIGHT * (rows + 1.0) };
    let mut panel = panel_over_time(run, Axis::exact("", 0.0, rows + 0.5));
    let name = |robot: usize| &run.scene.robots[robot].name;
    for (row, robot) in robots.into_iter().enumerate() {
        for (index, period) in periods.iter().filter(|period| period.robot == robot).enumerate() {
            let y = rows - row as f64 - 0.25 - 0.16 * index as f64 % 0.5;
            let points = vec![(period.start_s, y), (period.end_s.min(run.end_s()), y)];
            panel.curves.push((points, BACKUP_EDGE_LINE.with_width(3.0), true));
            let label = match period.backup_neighbor {
                Some(backup) => format!("{}: {}", name(robot), name(backup)),
                None => format!("{} leads", name(robot)),
            };
            let position = (period.start_s, y);
            panel.marks.push(Mark { position, shape: MarkShape::Ring, color: BLUE, label });
        }
    }
    (rect, panel)
}

/// Period in which a living robot uses a backup neighbor or, without one, leads.
struct RepairPeriod {
    robot: usize,
    backup_neighbor: Option<usize>,
    start_s: f64,
    /// End of the period, s; infinite if nothing ends it.
    end_s: f64,
}

fn repair_periods(run: &LoadedRun) -> Vec<RepairPeriod> {
    let mut periods: Vec<RepairPeriod> = Vec::new();
    for &StateChange { t_s, new_state } in &run.state_changes {
        let (robot, backup_neighbor, is_start) = match new_state {
            NewState::Edge(edge, state) if run.scene.edges[edge].spare => {
                let SceneEdge { from, to, .. } = run.scene.edges[edge];
                (to, Some(from), state != EdgeState::Closed)
            }
            NewState::Leads(robot, is_leading) => (robot, None, is_leading),
            NewState::Robot(robot, RobotState::Dead) => (robot, None, false),
            _ => continue,
        };
        let is_death = matches!(new_state, NewState::Robot(..));
        let is_ended = |period: &&mut RepairPeriod| {
            period.end_s.is_infinite()
                && period.robot == robot
                && (is_death || period.backup_neighbor == backup_neighbor)
        };
        periods.iter_mut().filter(is_ended).for_each(|period| period.end_s = t_s);
        if is_start {
            periods.push(RepairPeriod {
                robot,
                backup_neighbor,
                start_s: t_s,
                end_s: f64::INFINITY,
            });
        }
    }
    periods
}
