//! How near every pair came: the chapter's Figures 5, 9 and 13.

use formation::Vec2;

use super::{BOUND, NAMED, NAMED_ALL, WIDTH, about_bands, judged, over_time, row};
use crate::report::axis::Axis;
use crate::report::chart::{Figure, Mark, Panel, Shape};
use crate::report::digits::{asked, digits};
use crate::report::palette::{BLACK, Line, line};
use crate::report::run::Run;

/// Up to so many pairs have all their curves drawn; of more, the smallest of all and the nearest.
const DRAWN_MAX: usize = 120;
/// The lower panel reaches from so many d to so many d.
const NEAR: (f64, f64) = (0.9, 1.6);

pub(super) fn of_pairs(run: &Run) -> Option<Figure> {
    let robots = run.scene.robots.len();
    let pairs: Vec<[usize; 2]> =
        (0..robots).flat_map(|i| (i + 1..robots).map(move |j| [i, j])).collect();
    if pairs.is_empty() {
        return None;
    }
    let instants = run.times_s.len();
    let mut least = vec![f64::INFINITY; pairs.len()];
    let mut least_of_all = Vec::with_capacity(instants);
    let mut alphas: Vec<Vec2> = Vec::new();
    let mut farthest: f64 = 0.0;
    for instant in 0..instants {
        alphas.clear();
        alphas.extend((0..robots).map(|robot| run.alpha(robot, instant)));
        let mut now = f64::INFINITY;
        for (&[i, j], least) in pairs.iter().zip(&mut least) {
            let square = (alphas[i] - alphas[j]).norm_squared();
            *least = least.min(square);
            now = now.min(square);
            farthest = farthest.max(square);
        }
        least_of_all.push(now.sqrt());
    }
    let mut nearest: Vec<usize> = (0..pairs.len()).collect();
    if pairs.len() > NAMED_ALL {
        nearest.sort_by(|&a, &b| least[a].total_cmp(&least[b]));
        nearest.truncate(NAMED);
    }

    let d = run.scene.distance_min_m;
    let envelope = pairs.len() > DRAWN_MAX;
    let curve = |pair: usize| {
        let [i, j] = pairs[pair];
        let apart = move |k: usize| (run.alpha(i, k) - run.alpha(j, k)).norm();
        (0..instants).map(move |k| Some((run.times_s[k], apart(k))))
    };
    let named_far = nearest.iter().flat_map(|&pair| curve(pair)).flatten();
    let named_far = named_far.map(|(_, m)| m).filter(|m| m.is_finite()).fold(d, f64::max);
    let highest = if envelope { named_far } else { farthest.sqrt() };
    let shown_near = least.iter().any(|least| least.sqrt() < NEAR.1 * d);
    let mut whole = over_time(run, Axis::linear("distance (m)", 0.0, highest));
    let mut near = over_time(run, Axis::exact("near d (m)", NEAR.0 * d, NEAR.1 * d));
    near.bands.iter_mut().for_each(|band| band.label.clear());

    let mut key = Vec::new();
    if !envelope {
        let others = (0..pairs.len()).filter(|pair| !nearest.contains(pair));
        for pair in others {
            whole.over_x(curve(pair), Line::CROWD);
            near.over_x(curve(pair), Line::CROWD);
        }
    }
    for (place, &pair) in nearest.iter().enumerate() {
        whole.over_x(curve(pair), line(place).weight(2));
        near.over_x(curve(pair), line(place).weight(2));
        let [a, b] = pairs[pair].map(|robot| run.scene.robots[robot].name.as_str());
        key.push((line(place), format!("{a} \u{2013} {b}")));
    }
    if envelope {
        let smallest = || run.times_s.iter().copied().zip(least_of_all.iter().copied()).map(Some);
        let bold = Line::solid(BLACK).weight(4);
        whole.over_x(smallest(), bold);
        near.over_x(smallest(), bold);
        key.push((bold, format!("smallest of all {} pairs", pairs.len())));
    } else if pairs.len() > nearest.len() {
        key.push((Line::CROWD.weight(2), format!("{} others", pairs.len() - nearest.len())));
    }
    for panel in [&mut whole, &mut near] {
        bounded(run, panel, d);
    }
    let mut caption = match (envelope, pairs.len() > nearest.len()) {
        (true, _) => format!(
            "The smallest of all {} distances between front points, and the {NAMED} pairs that come \
             nearest.",
            pairs.len()
        ),
        (_, true) => format!(
            "All {} distances between front points, the {NAMED} pairs that come nearest by name.",
            pairs.len()
        ),
        _ => "All distances between front points.".to_owned(),
    };
    if shown_near {
        caption += " Below: the same near d.";
    }
    caption += about_bands(run);
    if let Some(summary) = &run.summary {
        match summary.expected("min_distance_m") {
            Some(expectation) => {
                caption += &judged(expectation, "The smallest at any tick", "m");
            }
            None => caption += " The scenario asks for no smallest distance.",
        }
    }
    let mut panels = vec![(row(0.0, 270.0), whole)];
    // Where nobody came near d, there is nothing to see.
    panels.extend(shown_near.then(|| (row(270.0, 200.0), near)));
    Some(Figure {
        name: "distances",
        title: "Distances of all pairs".into(),
        caption,
        width: WIDTH,
        height: if shown_near { 470.0 } else { 270.0 },
        panels,
        key,
    })
}

/// The line d, and the smallest distance at any tick.
fn bounded(run: &Run, panel: &mut Panel, d: f64) {
    panel.bound(d, (0.0, run.end_s()), format!("d = {} m", asked(d)), BOUND);
    let Some(summary) = &run.summary else { return };
    if let (Some(distance_m), Some([a, b]), Some(t_s)) =
        (summary.min_distance_m, &summary.min_distance_pair, summary.min_distance_t_s)
    {
        let label = format!("smallest {} m, {a} \u{2013} {b} at {t_s:.2} s", digits(distance_m));
        panel.marks.push(Mark { at: (t_s, distance_m), shape: Shape::Ring, color: BLACK, label });
    }
}
