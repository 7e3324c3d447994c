use formation::obstacle::Obstacle;
use proptest::prelude::*;

use super::*;
use crate::metrics::summary::Summary;
use crate::report::html;
use crate::report::palette::{self, Dash};
use crate::report::run::{
    LatencyDistribution, LatencyInterval, NewState, RobotSample, SignalTrack, StateChange,
};
use crate::report::scene::{EdgeState, RobotState, Scene, SceneEdge, SceneFault, SceneRobot};

/// Returns a run of robots in a row, half a meter apart, that come to rest. The last robot is the main leader, the
/// others have `role`, and the second is killed.
fn example_run(robots: usize, instants: usize, role: &str) -> LoadedRun {
    let end_s = instants.saturating_sub(1) as f64 * 0.1;
    let name = |robot: usize| format!("r{}", robot + 1);
    let sample = |robot: usize, instant: usize| {
        let error = 0.9f64.powi(instant as i32);
        RobotSample {
            x_m: 0.5 * robot as f64 + error,
            y_m: error * robot as f64,
            heading_rad: 0.3,
            error_m: Some(error),
            ideal_error_m: Some(2.0 * error),
            error_xy_m: Some([0.6 * error, -0.8 * error]),
            is_alive: robot != 1 || instant % 7 != 3,
        }
    };
    let scene = Scene {
        name: "row </script><b>&".into(),
        pace: "lockstep".into(),
        duration_s: end_s,
        distance_min_m: 0.2,
        robots: (0..robots)
            .map(|robot| SceneRobot {
                name: name(robot),
                role: if robot + 1 == robots { "main-leader" } else { role }.into(),
                front_point_m: 0.1,
                keep_m: None,
            })
            .collect(),
        edges: (1..robots)
            .map(|to| SceneEdge { from: to, to: to - 1, ..SceneEdge::default() })
            .collect(),
        walls: vec![
            Obstacle::segment([0.0, -9.0], [0.0, 9.0]),
            Obstacle::Disc { center_m: [0.5, 0.5], radius_m: 0.1 },
        ],
        faults: vec![SceneFault {
            t_s: 0.3,
            until_s: Some(0.5),
            what: "kill r2".into(),
            robots: vec![1],
            cuts: None,
        }],
        faults_in_all: 0,
    };
    let stages = [("beacon_age", Some("r2")), ("wake", None), ("late_core", None)];
    let interval = |stage: &str, from: Option<&str>| LatencyInterval {
        t_s: 0.5,
        stage: stage.into(),
        robot: "r1".into(),
        from: from.map(str::to_owned),
        count: 3,
        p50_ns: 5_000_000,
        p99_ns: 6_000_000,
        max_ns: 7_000_000,
    };
    LoadedRun {
        converged_error_m: 0.01,
        stale_after_s: 0.015,
        lost_after_s: 0.1,
        times_s: (0..instants).map(|instant| instant as f64 * 0.1).collect(),
        tracks: (0..robots)
            .map(|robot| (0..instants).map(|instant| sample(robot, instant)).collect())
            .collect(),
        leader_reference_m: vec![[0.0, 0.0]; instants],
        decimation: 1,
        repair_events: Vec::new(),
        signals: vec![SignalTrack {
            name: "cost_m2".into(),
            values: (0..robots).map(|robot| vec![(0.0, 1.0), (0.1, robot as f64)]).collect(),
        }],
        state_changes: vec![
            StateChange { t_s: 0.3, new_state: NewState::Robot(1, RobotState::Dead) },
            StateChange { t_s: 0.4, new_state: NewState::Edge(0, EdgeState::Stale) },
            StateChange { t_s: 0.5, new_state: NewState::Robot(1, RobotState::Moving) },
        ],
        summary: Some(summary(end_s)),
        missing_guarantee: None,
        introduction: None,
        damage: None,
        manifest: vec![("kernel".into(), "Linux <6>".into())],
        latency_over_time: stages.map(|(stage, from)| interval(stage, from)).into(),
        latency_distributions: vec![LatencyDistribution {
            stage: "beacon_age".into(),
            robot_or_edge: "r2->r1".into(),
            exceedance: vec![(5_000_000, 0.01), (7_000_000, 0.0)],
        }],
        scene,
    }
}

/// Returns the summary of that run.
fn summary(end_s: f64) -> Summary {
    serde_json::from_value(serde_json::json!({
        "t_s": end_s, "min_distance_m": 0.2107, "min_distance_pair": ["r1", "r2"],
        "min_distance_t_s": 0.2, "converged_at_s": 0.7, "final_error_m": { "r1": 1e-3, "r2": null },
        "expectations": [
            { "name": "min_distance_m", "value": 0.2107, "bound": 0.2, "held": true },
            { "name": "final_error_m_max", "value": 0.02, "bound": 0.01, "held": false },
            { "name": "final_ideal_error_m_max", "value": 0.02, "bound": 0.04, "held": true },
            { "name": "tracking_error_m_max", "value": 1e-4, "bound": 0.01, "held": true },
            { "name": "hull_distance_m_max", "value": 0.0, "bound": 0.0, "held": true },
            { "name": "converged_by_s", "value": 0.7, "bound": 0.9, "held": true },
        ],
        "information_ages": [{ "robot": "r1", "from": "r2", "heard": 9, "over_ns": 1_000_000_000,
            "mean_ns": 7.5e6, "peak_ns": 4_001_000_000u64 }],
        "faults": [{ "t_s": 0.3, "what": "kill r2", "robot": "r2", "predicted": ["r1"] }],
        "wall": {
            "latency": [{ "stage": "wake", "robot": "plant", "count": 3, "max_ns": 5_000_000 }],
            "processes": [{ "name": "r1", "starts": 1 }],
        },
    }))
    .unwrap()
}

/// Returns the texts in a figure.
fn figure_texts(figure: &Figure) -> Vec<String> {
    let svg = figure.to_svg();
    let document = roxmltree::Document::parse(&svg).unwrap_or_else(|e| panic!("{e}\n{svg}"));
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    texts.map(|node| node.text().unwrap_or_default().trim().to_owned()).collect()
}

fn find_figure<'a>(figures: &'a [Figure], name: &str) -> &'a Figure {
    figures.iter().find(|figure| figure.name == name).unwrap_or_else(|| panic!("no {name}"))
}

#[test]
fn full_run_gets_every_figure_with_bounds_marks_and_faults() {
    let figures = all_figures(&example_run(4, 30, "contained"));
    let expected: [(&str, &[&str]); 10] = [
        ("trajectories", &["x (m)", "y (m)", "r1", "r4 (main leader)", "hull of the leaders"]),
        (
            "distances",
            &["d = 0.2 m", "smallest 0.2107 m, r1 \u{2013} r2 at 0.20 s", "kill r2", "time (s)"],
        ),
        (
            "errors",
            &["converged at 0.70 s", "required by 0.9 s", "required at the end: 0.01 m", "kill r2"],
        ),
        ("ideal_errors", &["r1", "required at the end: 0.04 m", "kill r2"]),
        ("error_components", &["error along x (m)", "error along y (m)", "kill r2"]),
        ("hull_distance", &["required at the end: 0 m", "outside the hull (m)", "kill r2"]),
        ("signals", &["cost_m2", "r4", "kill r2"]),
        (
            "information_age",
            &["stale after 15 ms", "lost after 100 ms", "age at use (ms)", "r2->r1"],
        ),
        ("late_by_cause", &["cumulative count", "waited for a core: 3", "kill r2"]),
        ("wake_lateness", &["lateness (ms)", "fraction of samples above (CCDF)", "kill r2"]),
    ];
    assert_eq!(figures.len(), expected.len());
    for (name, labels) in expected {
        let texts = figure_texts(find_figure(&figures, name));
        for label in labels {
            assert!(texts.iter().any(|text| text == label), "{name}: no {label:?} in {texts:?}");
        }
    }
    for (name, describe_expectation) in [
        ("distances", "The smallest at any tick: 0.2107 m, required 0.2 m: held."),
        ("errors", "worst over the last 10 % of the run: 0.02 m, required 0.01 m: missed."),
        ("trajectories", "The main leader's worst distance from m(t) at the end: 0.0001 m"),
    ] {
        let caption = &find_figure(&figures, name).caption;
        assert!(caption.contains(describe_expectation), "{name}: {caption}");
    }
}

#[test]
fn sixty_four_robots_are_mostly_unnamed_with_one_distance_line() {
    let figures = all_figures(&example_run(64, 30, "formation"));
    let distances = figure_texts(find_figure(&figures, "distances"));
    assert!(distances.iter().any(|text| text == "smallest of all 2016 pairs"), "{distances:?}");
    let errors = figure_texts(find_figure(&figures, "errors"));
    assert!(errors.iter().any(|text| text == "58 others"), "{errors:?}");
    for figure in &figures {
        assert!(
            figure.to_svg().len() < 400_000,
            "{}: {} bytes",
            figure.name,
            figure.to_svg().len()
        );
    }
}

#[test]
fn plane_figure_has_equal_scales_on_both_axes() {
    let figures = all_figures(&example_run(4, 30, "formation"));
    let [(rect, panel)] = &find_figure(&figures, "trajectories").panels[..] else {
        panic!("one panel")
    };
    let (inner, x, y) =
        (rect.plot_area(&[]), panel.x_axis.value_range(), panel.y_axis.value_range());
    let scales = (inner.width / (x.1 - x.0), inner.height / (y.1 - y.0));
    assert!((scales.0 / scales.1 - 1.0).abs() < 1e-9, "{scales:?} px per m");
}

#[test]
fn page_escapes_markup_and_names_why_no_guarantee_holds() {
    let with_guarantee = example_run(4, 30, "contained");
    let without_guarantee = Some("r1 <slips>".to_owned());
    let without_guarantee =
        LoadedRun { missing_guarantee: without_guarantee, ..with_guarantee.clone() };
    let [with_guarantee, without_guarantee] =
        [with_guarantee, without_guarantee].map(|run| html::report_html(&run, &all_figures(&run)));
    assert!(!with_guarantee.contains("no promise"));
    for text in [
        "row &lt;/script&gt;&lt;b&gt;&amp;",
        "Linux &lt;6&gt;",
        "<td class=\"missed\">missed</td>",
        "no promise about distances: r1 &lt;slips&gt;",
    ] {
        assert!(without_guarantee.contains(text), "{text}");
    }
    assert!(!without_guarantee.contains("</script><b>"));
}

#[test]
fn replay_has_at_most_twenty_frames_a_second_and_the_last_one() {
    let mut run = example_run(3, 301, "formation");
    run.times_s = (0..301).map(|instant| f64::from(instant) / 100.0).collect();
    run.scene.duration_s = 3.0;
    run.summary = None;
    let frames = run.frames();
    assert_eq!(frames.len(), 61);
    assert_eq!(frames[60].t_s, 3.0);
    assert_eq!(frames[7].robots[1].state, RobotState::Dead, "killed at 0.3 s");
    assert_eq!(frames[10].robots[1].state, RobotState::Moving);
}

#[test]
fn repaired_graph_is_drawn_twice_with_spares_in_use_as_edges() {
    let mut run = example_run(3, 20, "formation");
    assert!(all_figures(&run).iter().all(|figure| figure.name != "repairs"));
    // r1 receives from r2, which dies at 0.3 s, and uses r3 from 0.6 s to 1.2 s.
    let spare = run.scene.edges.len();
    run.scene.edges.push(SceneEdge {
        from: 2,
        to: 0,
        spare: true,
        for_place: true,
        by_distance: false,
    });
    run.repair_events =
        vec![(0.6, "r1".into(), "uses r3".into()), (1.2, "r1".into(), "no longer uses r3".into())];
    let edge_changes = [(0.6, EdgeState::Fresh), (1.2, EdgeState::Closed)];
    run.state_changes.extend(
        edge_changes
            .map(|(t_s, state)| StateChange { t_s, new_state: NewState::Edge(spare, state) }),
    );
    // r2 returns at 0.5 s, leads, and dies again.
    let deputy_changes =
        [(0.8, NewState::Leads(1, true)), (1.5, NewState::Robot(1, RobotState::Dead))];
    run.state_changes.extend(deputy_changes.map(|(t_s, new_state)| StateChange { t_s, new_state }));
    run.state_changes.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    assert_eq!(
        [0.5, 0.6, 1.1, 1.2].map(|t_s| run.edges_in_use(t_s)[spare]),
        [false, true, true, false]
    );
    let states: Vec<EdgeState> = run.frames().iter().map(|frame| frame.edges[spare]).collect();
    assert!(
        states.contains(&EdgeState::Closed) && states.contains(&EdgeState::Fresh),
        "{states:?}"
    );
    let figures = all_figures(&run);
    let repairs = figures.iter().find(|figure| figure.name == "repairs").expect("it was repaired");
    // Bars of the time line, with start and end; a dead robot does not lead.
    let time_line = &repairs.panels[2].1;
    let bars = time_line.curves.iter().map(|(points, ..)| (points[0].0, points[1].0));
    assert_eq!(bars.collect::<Vec<_>>(), [(0.6, 1.2), (0.8, 1.5)]);
    let labels = time_line.marks.iter().map(|mark| mark.label.as_str());
    assert_eq!(labels.collect::<Vec<_>>(), ["r1: r3", "r2 leads"]);
    // While r1 uses r3, it takes the slot of r2 and is a corner of the leaders' hull.
    let corners = |t_s: f64| {
        let instant = run.times_s.partition_point(|instant_s| *instant_s < t_s);
        run.hull(&[1, 2], instant).contains(&run.front_point(0, instant))
    };
    assert_eq!([0.5, 0.7, 1.1, 1.3].map(corners), [false, true, true, false]);
    let page = html::report_html(&run, &figures);
    assert!(page.contains("no longer uses r3"));
}

#[test]
fn dead_and_cut_edges_have_their_state_while_the_fault_lasts() {
    let mut run = example_run(3, 11, "formation");
    let cut =
        SceneFault { what: "cut r3->r2".into(), cuts: Some(1), ..run.scene.faults[0].clone() };
    run.scene.faults.push(SceneFault { t_s: 0.7, until_s: Some(0.9), robots: vec![], ..cut });
    let frames = run.frames();
    let states = |t_s: f64| {
        let frame = frames.iter().find(|frame| (frame.t_s - t_s).abs() < 1e-6).unwrap();
        [frame.edges[0], frame.edges[1]]
    };
    use EdgeState::{Cut, Dead, Fresh, Stale};
    assert_eq!(states(0.2), [Fresh, Fresh]);
    assert_eq!(states(0.4), [Dead, Dead], "r2, at one end of both, is dead");
    assert_eq!(states(0.6), [Stale, Fresh], "the last known state");
    assert_eq!(states(0.8), [Stale, Cut]);
    assert_eq!(states(1.0), [Stale, Fresh]);
}

#[test]
fn page_of_20000_faults_has_bounded_size() {
    let mut run = example_run(3, 11, "formation");
    let first = run.scene.faults[0].clone();
    let fault = |i: usize| {
        let t_s = i as f64 * 5e-5;
        SceneFault { t_s, until_s: Some(t_s + 1e-5), ..first.clone() }
    };
    run.scene.faults = (0..20_000).map(fault).collect();
    let summary = run.summary.as_mut().expect("a summary");
    summary.faults = vec![summary.faults[0].clone(); 20_000];
    let figures = all_figures(&run);
    let page = html::report_html(&run, &figures);
    assert!(page.len() < 2_000_000, "{} bytes", page.len());
    for text in [
        "any of the 20000 faults was active",
        "the first 200 of 20000; summary.json has all",
        "\"faults_in_all\":20000",
    ] {
        assert!(page.contains(text), "{text}");
    }
    let animation = crate::report::animation::draw_animation(&run).expect("an animation");
    assert!(animation.len() < 200_000, "{} bytes", animation.len());
    let screen = crate::report::screen::format_screen(run.summary.as_ref().unwrap());
    assert!(screen.lines().count() < 2_000, "{} lines", screen.lines().count());
}

/// Moves and scales all positions of a run.
fn move_and_scale(mut run: LoadedRun, [x_m, y_m]: [f64; 2], scale: f64) -> LoadedRun {
    run.tracks.iter_mut().flatten().for_each(|sample| {
        (sample.x_m, sample.y_m) = (x_m + scale * sample.x_m, y_m + scale * sample.y_m);
    });
    run.leader_reference_m
        .iter_mut()
        .for_each(|point| *point = [x_m + scale * point[0], y_m + scale * point[1]]);
    run.scene.robots.iter_mut().for_each(|robot| robot.front_point_m *= scale);
    run.scene.distance_min_m *= scale;
    run.scene.walls.clear();
    run
}

#[test]
fn axes_of_the_plane_are_labeled_at_any_coordinates() {
    for (origin_m, scale, labels) in [
        ([500_000.0, 4_650_000.0], 1.0, &["x \u{2212} 500000 (m)", "y \u{2212} 4650000 (m)"][..]),
        ([500_000.0, 4_650_000.0], 1e-3, &["x \u{2212} 500000", "y \u{2212} 4650000"]),
        ([0.0, 0.0], 1e5, &["x (m)", "y (m)"]),
        ([0.0, 0.0], 1e-3, &["x (m)", "y (m)"]),
    ] {
        let run = move_and_scale(example_run(3, 11, "formation"), origin_m, scale);
        let figures = all_figures(&run);
        let plane = find_figure(&figures, "trajectories");
        let (_, panel) = &plane.panels[0];
        for axis in [&panel.x_axis, &panel.y_axis] {
            let (ticks, _) = axis.tick_labels(6);
            let distinct_texts: std::collections::BTreeSet<_> =
                ticks.iter().map(|(_, text)| text).collect();
            assert!(
                ticks.len() > 1 && distinct_texts.len() == ticks.len(),
                "{origin_m:?} {scale}: {ticks:?}"
            );
        }
        let svg = plane.to_svg();
        assert!(labels.iter().all(|label| svg.contains(label)), "{origin_m:?} {scale}");
        let animation = crate::report::animation::draw_animation(&run).expect("an animation");
        let lines = animation.matches("v472").count();
        assert!((2..30).contains(&lines), "{origin_m:?} {scale}: {lines} lines of the grid");
    }
}

#[test]
fn robot_has_the_same_color_in_every_figure() {
    let colors: Vec<_> = (0..9).map(palette::robot_color).collect();
    assert!(colors.iter().enumerate().all(|(i, color)| !colors[..i].contains(color)));
    for role in ["formation", "contained"] {
        let figures = all_figures(&example_run(9, 30, role));
        let named = figures.iter().flat_map(|figure| &figure.legend).filter_map(|(line, text)| {
            let name = text.split(' ').next().filter(|_| !text.contains('\u{2013}'))?;
            let number = name.strip_prefix('r')?.parse::<usize>().ok()?;
            Some((colors[number - 1], line.color))
        });
        let named: Vec<_> = named.collect();
        assert!(
            named.len() > 3 * 9 && named.iter().all(|(robot, line)| robot == line),
            "{named:?}"
        );
        // The bodies drawn last are those at the end, which are opaque.
        let bodies = figures[0].panels[0].1.areas.iter().filter(|(_, _, opacity)| *opacity == 1.0);
        let bodies: Vec<_> = bodies.map(|(_, color, _)| *color).collect();
        assert_eq!(bodies, colors);
    }
}

#[test]
fn deaths_are_marked_and_no_solid_edge_leads_to_dead_robots() {
    let mut run = example_run(4, 30, "formation");
    run.tracks[1].iter_mut().skip(4).for_each(|sample| sample.is_alive = false);
    run.state_changes.truncate(1);
    let figures = all_figures(&run);
    let trajectories = find_figure(&figures, "trajectories");
    assert!(figure_texts(trajectories).iter().any(|text| text == "r2 dead, 0.3 s"));
    assert!(trajectories.caption.contains("deaths"), "{}", trajectories.caption);
    let edges = trajectories.panels[0].1.curves.iter().filter(|(points, _, _)| points.len() == 2);
    assert!(edges.clone().any(|(_, line, _)| line.dash == Dash::Dotted));
    let frames = run.frames();
    let errors = frames.iter().map(|frame| frame.robots[1].error_m.is_some());
    assert!(errors.eq(frames.iter().map(|frame| frame.t_s < 0.3)), "a dead robot has no error");
}

#[test]
fn age_curve_has_gaps_without_received_beacons() {
    let mut run = example_run(4, 30, "formation");
    let age = run.latency_over_time[0].clone();
    run.latency_over_time =
        [0.25, 0.75, 2.25].map(|t_s| LatencyInterval { t_s, ..age.clone() }).into();
    let figures = all_figures(&run);
    let (_, panel) = &find_figure(&figures, "information_age").panels[0];
    let intervals: Vec<(f64, f64)> = panel.curves[..2]
        .iter()
        .map(|(points, _, _)| (points[0].0, points[points.len() - 1].0))
        .collect();
    assert_eq!(intervals, [(0.0, 1.0), (2.0, 2.5)]);
}

#[test]
fn distance_figure_omits_d_if_distances_are_larger() {
    let mut run = example_run(3, 30, "formation");
    run.scene.distance_min_m = 0.4;
    assert_eq!(find_figure(&all_figures(&run), "distances").panels.len(), 2);
    run.scene.distance_min_m = 0.2;
    let figures = all_figures(&run);
    let distances = find_figure(&figures, "distances");
    assert!(distances.panels.len() == 1 && !distances.caption.contains("Below"));
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![-9.0..9.0f64, any::<f64>(), Just(0.0)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// For any recorded values, the figures are well-formed and the page is complete.
    #[test]
    fn figures_are_well_formed_whatever_was_recorded(
        robots in 0..14_usize,
        instants in 0..9_usize,
        contained in any::<bool>(),
        numbers in prop::collection::vec(any_number(), 16),
        text in "\\PC*|[\\x00-\\x7f]{0,9}",
    ) {
        let mut run = example_run(robots, instants, if contained { "contained" } else { "formation" });
        if robots < 2 {
            run.state_changes.clear(); // they are about the second robot
        }
        let mut next = numbers.iter().copied().cycle();
        let mut number = || next.next().unwrap();
        for sample in run.tracks.iter_mut().flatten() {
            (sample.x_m, sample.y_m, sample.heading_rad) = (number(), number(), number());
            sample.error_m = sample.error_m.map(|_| number());
            sample.error_xy_m = sample.error_xy_m.map(|_| [number(), number()]);
        }
        run.scene.name = text.clone();
        run.scene.faults[0].what = text.clone();
        run.scene.faults[0].t_s = number();
        run.scene.faults[0].until_s = Some(number());
        run.scene.distance_min_m = number();
        run.converged_error_m = number();
        let summary = run.summary.as_mut().unwrap();
        summary.t_s = number();
        summary.converged_at_s = Some(number());
        summary.min_distance_m = Some(number());
        summary.min_distance_t_s = Some(number());
        summary.expectations.iter_mut().for_each(|expectation| expectation.bound = number());
        let figures = all_figures(&run);
        for figure in &figures {
            figure_texts(figure);
        }
        let page = html::report_html(&run, &figures);
        prop_assert!(page.ends_with("</html>\n"));
    }
}

#[test]
fn many_robots_are_drawn_as_a_distribution_with_few_names() {
    let mut run = example_run(CURVES_MAX + 1, 40, "formation");
    // Errors that grow with the index of the robot.
    for (robot, track) in run.tracks.iter_mut().enumerate() {
        track.iter_mut().for_each(|sample| sample.error_m = Some(1.0 + robot as f64));
    }
    let figure = error::draw_neighbor_errors(&run).unwrap();
    let panel = &figure.panels[0].1;
    assert_eq!(panel.areas.len(), BAND_QUANTILES.len());
    let highest =
        |corners: &[CanvasPoint]| corners.iter().fold(0.0f64, |high, point| high.max(point.1));
    assert!(highest(&panel.areas[0].0) > highest(&panel.areas[1].0));
    let median = panel.curves.iter().find(|(_, line, _)| *line == MEDIAN_LINE).unwrap();
    assert!(median.0.iter().all(|(_, y)| (y - 101.0).abs() <= 1.0), "{median:?}");
    assert!(
        panel.curves.len() < 2 * ALL_NAMED_CURVES_MAX
            && figure.legend.len() <= NAMED_CURVE_COUNT + 2
    );
    let figure_of_few =
        error::draw_neighbor_errors(&example_run(CURVES_MAX, 40, "formation")).unwrap();
    assert!(figure_of_few.panels[0].1.areas.is_empty());
    // Each robot is drawn once in the plane, and the picture names none.
    let plane = plane::draw_trajectories(&run).unwrap();
    assert_eq!(plane.panels[0].1.areas.len(), CURVES_MAX + 1 + run.scene.walls.len());
    assert!(plane.panels[0].1.marks.iter().all(|mark| mark.label.len() < 7), "{:?}", plane.legend);
}
