//! How far outside the leaders' hull the contained were. (49)

use super::{BOUND, SEEN, WIDTH, about_bands, judged, largest, last_stretch, over_time, row};
use crate::report::axis::Axis;
use crate::report::chart::Figure;
use crate::report::digits::asked;
use crate::report::palette::{Line, line};
use crate::report::run::Run;

pub(super) fn distance(run: &Run) -> Option<Figure> {
    let (contained, leaders) = run.containment()?;
    let outside: Vec<Vec<f64>> = contained
        .iter()
        .map(|&robot| {
            let instants = 0..run.times_s.len();
            instants.map(|instant| run.outside(robot, &leaders, instant)).collect()
        })
        .collect();
    let highest = outside.iter().flatten().copied().filter(|m| m.is_finite()).fold(0.0, f64::max);
    let mut panel = over_time(run, Axis::linear("outside the hull (m)", 0.0, highest.max(1e-3)));
    let curve = |place: usize| {
        let track = run.tracks[contained[place]].iter().zip(&run.times_s).zip(&outside[place]);
        track.map(|((sample, &t_s), &m)| sample.alive.then_some((t_s, m)))
    };
    let worst: Vec<f64> =
        outside.iter().map(|track| track.iter().copied().fold(0.0, f64::max)).collect();
    let named = largest(&worst);
    for place in (0..contained.len()).filter(|place| !named.contains(place)) {
        panel.over_x(curve(place), Line::CROWD);
    }
    let mut key = Vec::new();
    for &place in &named {
        let line = line(contained[place]);
        panel.over_x(curve(place), line.weight(3));
        key.push((line, run.scene.robots[contained[place]].name.clone()));
    }
    if contained.len() > named.len() {
        let crowd = contained.len() - named.len();
        key.push((Line::CROWD.weight(2), format!("{crowd} others")));
    }
    // Since when nobody is outside, as far as was recorded.
    let last_out = (0..run.times_s.len()).rev().find(|&instant| {
        let mut places = 0..contained.len();
        places.any(|place| {
            run.tracks[contained[place]][instant].alive && outside[place][instant] > 0.0
        })
    });
    if let Some(&t_s) = run.times_s.get(last_out.map_or(0, |instant| instant + 1)) {
        panel.upright(t_s, 1.0, format!("all inside from {t_s:.2} s"), SEEN);
    }
    let mut caption = format!(
        "Distance of each contained robot from the convex hull of the leaders, 0 inside.{}",
        about_bands(run)
    );
    if let Some(expectation) =
        run.summary.as_ref().and_then(|summary| summary.expected("hull_distance_m_max"))
    {
        let label = format!("required at the end: {} m", asked(expectation.bound));
        panel.bound(expectation.bound, last_stretch(run), label, BOUND);
        caption += &judged(expectation, "Farthest outside over the last 10 % of the run", "m");
    }
    Some(Figure {
        name: "hull_distance",
        title: "Distance from the leaders' hull".into(),
        caption,
        width: WIDTH,
        height: 240.0,
        panels: vec![(row(0.0, 240.0), panel)],
        key,
    })
}
