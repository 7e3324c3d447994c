//! Figure of the containment error (49): distance of the followers from the leaders' convex hull.

use super::{
    CurveSet, OBSERVED_EVENT_LINE, bands_caption, draw_final_bound, full_width_row, panel_over_time,
};
use crate::report::axis::Axis;
use crate::report::chart::Figure;
use crate::report::palette::robot_line;
use crate::report::run::LoadedRun;

pub(super) fn draw_hull_distance(run: &LoadedRun) -> Option<Figure> {
    let (contained, leaders) = run.followers_and_leaders()?;
    let instants = 0..run.times_s.len();
    let robot_distances_m = |&robot: &usize| -> Vec<f64> {
        instants.clone().map(|instant| run.distance_from_hull(robot, &leaders, instant)).collect()
    };
    let distances_m: Vec<Vec<f64>> = contained.iter().map(robot_distances_m).collect();
    let largest_finite =
        |track: &Vec<f64>| track.iter().copied().filter(|m| m.is_finite()).fold(0.0, f64::max);
    let largest_m: Vec<f64> = distances_m.iter().map(largest_finite).collect();
    let highest = largest_m.iter().copied().fold(1e-3, f64::max);
    let mut panel = panel_over_time(run, Axis::linear("outside the hull (m)", 0.0, highest));
    let curves = CurveSet::select_largest(&largest_m);
    let line_style = |index: usize| robot_line(contained[index]);
    curves.draw(&mut panel, line_style, |index| {
        let track = run.tracks[contained[index]].iter().zip(&run.times_s).zip(&distances_m[index]);
        track.map(|((sample, &t_s), &m)| sample.is_alive.then_some((t_s, m)))
    });
    // The first instant after which no living follower is outside.
    let is_outside = |instant: &usize| {
        let alive = contained.iter().map(|&robot| run.tracks[robot][*instant].is_alive);
        alive.zip(&distances_m).any(|(alive, track)| alive && track[*instant] > 0.0)
    };
    let first_inside = instants.rev().find(is_outside).map_or(0, |last_outside| last_outside + 1);
    if let Some(&t_s) = run.times_s.get(first_inside) {
        panel.add_vertical_line(
            t_s,
            1.0,
            format!("all inside from {t_s:.2} s"),
            OBSERVED_EVENT_LINE,
        );
    }
    let mut caption = format!(
        "Distance of each follower from the convex hull of the leaders; 0 inside.{}",
        bands_caption(run)
    );
    let subject = "Farthest outside over the last 10 % of the run";
    caption += &draw_final_bound(run, &mut panel, "hull_distance_m_max", subject);
    let legend =
        curves.legend_entries(line_style, |index| run.scene.robots[contained[index]].name.clone());
    let title = "Distance from the leaders' hull";
    Some(Figure::single_panel(
        "hull_distance",
        title,
        caption,
        full_width_row(0.0, 240.0),
        panel,
        legend,
    ))
}
