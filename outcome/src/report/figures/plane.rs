//! Figure of the trajectories: the chapter's Figures 4, 8 and 12.

use formation::Vec2;
use formation::obstacle::Obstacle;
use formation::portable_math;

use super::{CURVES_MAX, WIDTH, describe_expectation};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, LETTER_WIDTH, Mark, MarkShape, Panel, Rect};
use crate::report::palette::{
    BLACK, Dash, GRAY, LineStyle, ORANGE, VERMILION, robot_color, robot_line,
};
use crate::report::run::{LoadedRun, NewState, StateChange};
use crate::report::scene::RobotState;
use crate::report::simplify::CanvasPoint;

/// Maximum number of robots that are named in the picture and in its key.
const NAMED_ROBOTS_MAX: usize = 10;
/// Minimum and maximum height of the picture, px.
const HEIGHT_RANGE: (f64, f64) = (240.0, 620.0);
/// Minimum length of a robot, px.
const BODY_LENGTH_MIN: f64 = 9.0;
/// Minimum length of a robot among more than [`CURVES_MAX`], px.
const MANY_ROBOTS_BODY_LENGTH_MIN: f64 = 6.0;
/// Style of a path among more than [`CURVES_MAX`].
const MANY_ROBOTS_PATH_LINE: LineStyle = LineStyle::solid(GRAY).with_width(0.4).with_opacity(0.5);
/// Distance that robots move between two instants at which they are drawn, in sizes of the formation.
const INSTANT_SPACING: f64 = 1.3;
/// Maximum distance of visible walls from the robots' paths, as a fraction of the paths' extent.
const WALL_DISTANCE_MAX: f64 = 0.15;
/// Half width and half height of the label of a time, px.
const LABEL_HALF_SIZE: (f64, f64) = (21.0, 7.5);
/// Half width and half height of a robot, px.
const ROBOT_HALF_SIZE: (f64, f64) = (8.0, 8.0);
/// Opacity of the robots at the first instant; it grows to 1 at the last one.
const OPACITY_MIN: f64 = 0.3;
/// Maximum number of marked deaths; later ones are left out.
const MARKED_DEATHS_MAX: usize = 12;
/// Maximum number of instants at which robots are drawn.
const DRAWN_INSTANTS_MAX: usize = 8;

pub(super) fn draw_trajectories(run: &LoadedRun) -> Option<Figure> {
    let paths: Vec<Vec<CanvasPoint>> = (0..run.scene.robots.len())
        .map(|robot| {
            (0..run.times_s.len()).map(|k| to_canvas_point(run.front_point(robot, k))).collect()
        })
        .collect();
    let leader_path: Vec<CanvasPoint> =
        run.leader_reference_m.iter().map(|&[x, y]| (x, y)).collect();
    let finite = |point: &&CanvasPoint| point.0.is_finite() && point.1.is_finite();
    let extent = extent(paths.iter().chain([&leader_path]).flatten().filter(finite))?;
    let (rect, mut panel, m_per_px) = equal_scale_panel(extend_to_walls(run, extent));
    draw_walls(run, &mut panel);

    let mut legend = Vec::new();
    let names_robots = paths.len() <= NAMED_ROBOTS_MAX;
    let has_many = has_many_robots(run);
    if !leader_path.is_empty() {
        let style = LineStyle::solid(GRAY).with_width(6.4).with_opacity(0.35);
        panel.curves.push((leader_path, style, false));
        legend.push((style, "m(t), the main leader's reference".to_owned()));
    }
    for (robot, path) in paths.into_iter().enumerate() {
        let (name, role) = (&run.scene.robots[robot].name, &run.scene.robots[robot].role);
        let style = match (names_robots, has_many) {
            (true, _) => robot_line(robot).with_width(0.8),
            (false, true) => MANY_ROBOTS_PATH_LINE,
            (false, false) => LineStyle::solid(robot_color(robot)).with_width(0.4),
        };
        let label = if names_robots { name.clone() } else { String::new() };
        if !has_many {
            panel.marks.push(Mark {
                position: path[0],
                shape: MarkShape::Cross,
                color: BLACK,
                label,
            });
        }
        panel.curves.push((path, style, false));
        if names_robots {
            legend.push((style, format!("{name} ({})", role_text(role))));
        }
    }
    if run.followers_and_leaders().is_some() {
        legend.push((LineStyle::solid(ORANGE).with_width(1.6), "hull of the leaders".to_owned()));
    }
    panel.marks.extend(death_marks(run));
    let drawn_instants = spaced_instants(run);
    for (index, &instant) in drawn_instants.iter().enumerate() {
        let recency = (index + 1) as f64 / drawn_instants.len() as f64;
        let opacity = OPACITY_MIN + (1.0 - OPACITY_MIN) * recency;
        draw_formation(run, instant, m_per_px, opacity, &mut panel);
    }
    let time_labels = place_time_labels(run, &drawn_instants, &panel, m_per_px);
    panel.marks.extend(time_labels);
    let (title, caption) = ("Trajectories in the plane", caption(run, &drawn_instants));
    Some(Figure::single_panel("trajectories", title, caption, rect, panel, legend))
}

/// Returns the caption, with the results of the expectations about positions.
fn caption(run: &LoadedRun, drawn_instants: &[usize]) -> String {
    let times: Vec<String> =
        drawn_instants.iter().map(|&instant| format!("{:.1}", run.times_s[instant])).collect();
    let connection_text = match run.followers_and_leaders() {
        _ if has_many_robots(run) => return many_robots_caption(run, &times),
        Some(_) => "with the hull of the leaders",
        None => "with the edges of the formation graph",
    };
    let mut caption = format!(
        "Paths of the front points. Black crosses: starts{}. Robots are triangles that point forward, \
         {connection_text}, at equal distances along their paths, older ones paler: at {} s.",
        if death_marks(run).is_empty() { "" } else { "; orange crosses: deaths, with times" },
        times.join(", ")
    );
    if !run.scene.walls.is_empty() {
        caption += " Gray: walls and obstacles.";
    }
    if run.scene.robots.len() > NAMED_ROBOTS_MAX {
        caption += " Colors are those of the replay and repeat.";
    }
    caption + &describe_expectations(run)
}

/// Returns the caption of a picture with more than [`CURVES_MAX`] robots.
fn many_robots_caption(run: &LoadedRun, times: &[String]) -> String {
    let deaths_note = if death_marks(run).is_empty() { "" } else { " Orange crosses: deaths." };
    let walls_note =
        if run.scene.walls.is_empty() { "" } else { " Walls and obstacles are darker." };
    format!(
        "All {} robots at {} s as triangles that point forward, in the colors of the replay, which repeat. Gray: the paths \
         of their front points.{deaths_note}{walls_note}{}",
        run.scene.robots.len(),
        times.join(", "),
        describe_expectations(run)
    )
}

/// Describes the expectations about positions.
fn describe_expectations(run: &LoadedRun) -> String {
    let mut caption = String::new();
    for (name, subject) in [
        ("min_clearance_m", "Smallest clearance at any tick"),
        ("tracking_error_m_max", "The main leader's worst distance from m(t) at the end"),
        ("final_error_m_max", "Worst error of a living robot at the end"),
        ("hull_distance_m_max", "Largest distance of a follower from the hull at the end"),
    ] {
        caption += &describe_expectation(run, name, subject, "m");
    }
    caption
}

/// Lowest and highest x and y of a set of points.
pub(super) type Extent = (CanvasPoint, CanvasPoint);

/// Returns the extent of points; `None` without points.
pub(super) fn extent<'p>(points: impl Iterator<Item = &'p CanvasPoint>) -> Option<Extent> {
    points.map(|&point| (point, point)).reduce(|(low, high), (point, _)| {
        ((low.0.min(point.0), low.1.min(point.1)), (high.0.max(point.0), high.1.max(point.1)))
    })
}

/// Creates a panel with the same scale on both axes. The height follows the width within bounds; then one of the
/// ranges grows to fit. Returns the rectangle, the panel and the scale, m per px.
fn equal_scale_panel((lowest, highest): Extent) -> (Rect, Panel, f64) {
    // Small formations have small margins.
    let extent_m = (highest.0 - lowest.0).max(highest.1 - lowest.1);
    let [margin_base_m, margin_offset_m] = match extent_m > 0.0 {
        true => [(0.2 * extent_m).min(0.1), (0.02 * extent_m).min(0.02)],
        false => [0.1, 0.02],
    };
    let margin = |low: f64, high: f64| (high - low).max(margin_base_m) * 0.06 + margin_offset_m;
    let (dx, dy) = (margin(lowest.0, highest.0), margin(lowest.1, highest.1));
    let size = (highest.0 - lowest.0 + 2.0 * dx, highest.1 - lowest.1 + 2.0 * dy);
    let mut rect = Rect { x: 0.0, y: 0.0, width: WIDTH, height: 0.0 };
    let frame_height = rect.height - rect.plot_area(&[]).height;
    let height = rect.plot_area(&[]).width * size.1 / size.0 + frame_height;
    rect.height = height.clamp(HEIGHT_RANGE.0, HEIGHT_RANGE.1);
    let (panel, m_per_px) = panel_around((lowest, highest), size, rect.plot_area(&[]));
    (rect, panel, m_per_px)
}

/// Creates a panel with the same scale on both axes that shows at least `size`, m, with the extent in the middle.
/// Returns the panel and the scale, m per px.
pub(super) fn panel_around((low, high): Extent, size: CanvasPoint, inner: Rect) -> (Panel, f64) {
    let m_per_px = (size.0 / inner.width).max(size.1 / inner.height);
    let axis = |label: &str, low: f64, high: f64, px: f64| {
        let (middle, half) = ((low + high) / 2.0, m_per_px * px / 2.0);
        Axis::exact(label, middle - half, middle + half)
    };
    let x = axis("x (m)", low.0, high.0, inner.width);
    (Panel::new(x, axis("y (m)", low.1, high.1, inner.height)), m_per_px)
}

/// Returns the extent of the robots, extended by the walls near them.
fn extend_to_walls(run: &LoadedRun, robots: Extent) -> Extent {
    let ((left, low), (right, high)) = robots;
    let wall_margin = WALL_DISTANCE_MAX * (right - left).max(high - low);
    let (lower, upper) =
        ((left - wall_margin, low - wall_margin), (right + wall_margin, high + wall_margin));
    let clamp_to_view =
        |(x, y): CanvasPoint| (x.clamp(lower.0, upper.0), y.clamp(lower.1, upper.1));
    let walls = run.scene.walls.iter().filter_map(|wall| extent(wall_outline(wall).iter()));
    let walls = walls.filter(|(low, high)| {
        (low.0 <= upper.0 && high.0 >= lower.0) && (low.1 <= upper.1 && high.1 >= lower.1)
    });
    let walls = walls.map(|(low, high)| (clamp_to_view(low), clamp_to_view(high)));
    let corners: Vec<CanvasPoint> = walls.flat_map(|(low, high)| [low, high]).collect();
    extent(corners.iter().chain([&robots.0, &robots.1])).unwrap_or(robots)
}

/// Draws the walls and obstacles.
fn draw_walls(run: &LoadedRun, panel: &mut Panel) {
    for wall in &run.scene.walls {
        panel.areas.push((wall_outline(wall), GRAY, 0.35));
        panel.add_outline(wall_outline(wall), LineStyle::solid(BLACK).with_width(0.8));
    }
}

fn wall_outline(wall: &Obstacle) -> Vec<CanvasPoint> {
    wall.outline().into_iter().map(to_canvas_point).collect()
}

pub(super) fn to_canvas_point(point: Vec2) -> CanvasPoint {
    (point.x, point.y)
}

fn role_text(role: &str) -> &str {
    match role {
        "main-leader" => "main leader",
        "leader" => "secondary leader",
        "formation" => "in formation",
        other => other,
    }
}

/// Returns whether the robots are too many to be drawn more than once.
fn has_many_robots(run: &LoadedRun) -> bool {
    run.scene.robots.len() > CURVES_MAX
}

/// Returns marks of the first deaths, with their times; of all deaths, without their times, if the robots are many.
fn death_marks(run: &LoadedRun) -> Vec<Mark> {
    let has_many = has_many_robots(run);
    let death_mark = |change: &StateChange| match change.new_state {
        NewState::Robot(robot, RobotState::Dead) if robot < run.tracks.len() => {
            let instant = run.times_s.partition_point(|&t_s| t_s < change.t_s);
            let position =
                to_canvas_point(run.front_point(robot, instant.min(run.times_s.len() - 1)));
            let name = &run.scene.robots[robot].name;
            let label =
                if has_many { String::new() } else { format!("{name} dead, {:.1} s", change.t_s) };
            Some(Mark { position, shape: MarkShape::Cross, color: VERMILION, label })
        }
        _ => None,
    };
    let count_max = if has_many { usize::MAX } else { MARKED_DEATHS_MAX };
    run.state_changes.iter().filter_map(death_mark).take(count_max).collect()
}

/// Draws the robots at one instant with the hull of the leaders, or with the edges.
fn draw_formation(run: &LoadedRun, instant: usize, m_per_px: f64, opacity: f64, panel: &mut Panel) {
    if let Some((_, leaders)) = run.followers_and_leaders() {
        let corners: Vec<CanvasPoint> =
            run.hull(&leaders, instant).into_iter().map(to_canvas_point).collect();
        panel.areas.push((corners.clone(), ORANGE, 0.2 * opacity));
        panel.add_outline(corners, LineStyle::solid(ORANGE).with_width(0.8).with_opacity(opacity));
    } else if !has_many_robots(run) {
        let is_in_use = run.edges_in_use(run.times_s[instant]);
        for (edge, _) in run.scene.edges.iter().zip(is_in_use).filter(|(_, is_in_use)| *is_in_use) {
            let endpoints =
                [edge.from, edge.to].map(|robot| to_canvas_point(run.front_point(robot, instant)));
            // Edges with a dead robot are dotted.
            let both_alive = [edge.from, edge.to].iter().all(|&r| run.tracks[r][instant].is_alive);
            let (dash, opacity) =
                if both_alive { (Dash::Solid, opacity) } else { (Dash::Dotted, 0.6 * opacity) };
            let style = LineStyle::solid(GRAY).with_width(0.4).with_opacity(opacity);
            panel.curves.push((endpoints.into(), style.with_dash(dash), false));
        }
    }
    for robot in 0..run.scene.robots.len() {
        let sample = run.tracks[robot][instant];
        let front = run.front_point(robot, instant);
        if !(front.x.is_finite() && front.y.is_finite()) {
            continue;
        }
        let length = body_length_m(run, robot, m_per_px);
        let (sin, cos) = portable_math::sin_cos(sample.heading_rad);
        let rear = front - length * Vec2::new(cos, sin);
        let half_width = 0.4 * length * Vec2::new(-sin, cos);
        let color = if sample.is_alive { robot_color(robot) } else { GRAY };
        let body: Vec<CanvasPoint> = [front, rear + half_width, rear - half_width]
            .into_iter()
            .map(to_canvas_point)
            .collect();
        panel.areas.push((body.clone(), color, opacity));
        if !has_many_robots(run) {
            panel.add_outline(body, LineStyle::solid(BLACK).with_width(0.4).with_opacity(opacity));
        }
    }
}

/// Places the times of these instants next to one of the robots each: the highest one with space above, below or at
/// a side. A time without space is left out.
fn place_time_labels(
    run: &LoadedRun,
    drawn_instants: &[usize],
    panel: &Panel,
    m_per_px: f64,
) -> Vec<Mark> {
    let body_centers = |instant: usize| {
        let body_centers =
            (0..run.tracks.len()).map(move |robot| body_center(run, robot, instant, m_per_px));
        body_centers.filter(|(x, y)| x.is_finite() && y.is_finite())
    };
    // Center and half size, px, of everything that is already drawn.
    let robots = drawn_instants
        .iter()
        .flat_map(|&instant| body_centers(instant))
        .map(|position| (position, ROBOT_HALF_SIZE));
    let mut occupied: Vec<(CanvasPoint, CanvasPoint)> = robots.collect();
    for Mark { position, label, .. } in &panel.marks {
        let half = label.chars().count() as f64 * LETTER_WIDTH / 2.0;
        let label_center = (position.0 + (8.0 + half) * m_per_px, position.1 + 10.0 * m_per_px);
        occupied.extend([(*position, (4.0, 4.0)), (label_center, (half, LABEL_HALF_SIZE.1))]);
    }
    occupied.retain(|((x, y), _)| x.is_finite() && y.is_finite());
    let is_separate = |a: f64, b: f64, distance_px: f64| (a - b).abs() >= distance_px * m_per_px;
    let (side_offset, vertical_offset) =
        (ROBOT_HALF_SIZE.0 + LABEL_HALF_SIZE.0 + 1.0, ROBOT_HALF_SIZE.1 + LABEL_HALF_SIZE.1 + 1.0);
    let label_offsets =
        [(0.0, vertical_offset), (0.0, -vertical_offset), (side_offset, 0.0), (-side_offset, 0.0)];
    let mut marks = Vec::new();
    for &instant in drawn_instants {
        let mut centers: Vec<CanvasPoint> = body_centers(instant).collect();
        centers.sort_by(|a, b| b.1.total_cmp(&a.1));
        let label_positions = |&(x, y): &CanvasPoint| {
            label_offsets.map(|(dx, dy)| (x + dx * m_per_px, y + dy * m_per_px))
        };
        let is_free = |position: &CanvasPoint| {
            occupied.iter().all(|(other, half)| {
                is_separate(position.0, other.0, half.0 + LABEL_HALF_SIZE.0)
                    || is_separate(position.1, other.1, half.1 + LABEL_HALF_SIZE.1)
            })
        };
        let Some(position) = centers.iter().flat_map(label_positions).find(is_free) else {
            continue;
        };
        occupied.push((position, LABEL_HALF_SIZE));
        let label = format!("{:.1} s", run.times_s[instant]);
        marks.push(Mark { position, shape: MarkShape::LabelOnly, color: BLACK, label });
    }
    marks
}

/// Returns the center of the drawn robot.
fn body_center(run: &LoadedRun, robot: usize, instant: usize, m_per_px: f64) -> CanvasPoint {
    let length = body_length_m(run, robot, m_per_px);
    let (sin, cos) = portable_math::sin_cos(run.tracks[robot][instant].heading_rad);
    to_canvas_point(run.front_point(robot, instant) - 0.6 * length * Vec2::new(cos, sin))
}

/// Returns the length of the drawn robot, m.
fn body_length_m(run: &LoadedRun, robot: usize, m_per_px: f64) -> f64 {
    let length_min =
        if has_many_robots(run) { MANY_ROBOTS_BODY_LENGTH_MIN } else { BODY_LENGTH_MIN };
    run.scene.robots[robot].front_point_m.max(length_min * m_per_px)
}

/// Returns instants between which the robots have moved far enough to be distinguished. The last instant is the end
/// of the run.
fn spaced_instants(run: &LoadedRun) -> Vec<usize> {
    let robots = run.scene.robots.len();
    let instants = run.times_s.len();
    if has_many_robots(run) {
        return vec![instants - 1];
    }
    let mean_step_m = |instant: usize| {
        let distance_m = (0..robots).map(|robot| {
            let distance_m =
                (run.front_point(robot, instant) - run.front_point(robot, instant - 1)).norm();
            if distance_m.is_finite() { distance_m } else { 0.0 }
        });
        distance_m.sum::<f64>() / robots as f64
    };
    let mut path_lengths_m = vec![0.0];
    for instant in 1..instants {
        path_lengths_m.push(path_lengths_m[instant - 1] + mean_step_m(instant));
    }
    let total_m = path_lengths_m[instants - 1];
    let formation_size_m = (1..robots)
        .map(|robot| {
            (run.front_point(robot, instants - 1) - run.front_point(0, instants - 1)).norm()
        })
        .fold(1e-3, f64::max);
    let instant_count =
        ((total_m / (INSTANT_SPACING * formation_size_m)) as usize).clamp(2, DRAWN_INSTANTS_MAX);
    let mut drawn_instants: Vec<usize> = (1..=instant_count)
        .map(|n| {
            path_lengths_m.partition_point(|&length_m| {
                length_m < total_m * n as f64 / instant_count as f64 - 1e-12
            })
        })
        .map(|instant| instant.min(instants - 1))
        .collect();
    if let Some(last_instant) = drawn_instants.last_mut() {
        *last_instant = instants - 1;
    }
    drawn_instants.dedup();
    drawn_instants
}
