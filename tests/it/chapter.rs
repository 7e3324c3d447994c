//! The tables of `docs/chapter.md`, measured again in the oracle. Each test prints its table and
//! checks that the page has every row of it:
//! `cargo test --test it -- --include-ignored --nocapture assert_page_has`, some minutes in all.

use experiment::check::Theory;

use outcome::metrics::RunMetrics;

use crate::closing::scattered_scenario;
use crate::harness::map_in_parallel;
use crate::oracle::{scenario, simulate};

/// The four starts of case 1, and its minimum distance (d), m.
const STARTS: [&str; 4] = ["triangle", "triangle-b", "triangle-c", "triangle-d"];
const CASE_1_D_M: f64 = 0.2;

/// Cases 2 and 3, and their minimum distances (d), m.
const LED_CASES: [(&str, f64); 2] = [("pentagon", 0.3), ("containment", 0.2)];

/// Returns the minimum distance, and the maximum error of the last 10 % of the run, m.
fn nearest_and_worst(simulated: &RunMetrics) -> (f64, f64) {
    (simulated.min_distance_m.unwrap(), simulated.final_error_m_max.unwrap())
}

#[track_caller]
fn assert_page_has(rows: &[String]) {
    println!("\n{}", rows.join("\n"));
    let page = include_str!("../../docs/chapter.md");
    let missing: Vec<_> =
        rows.iter().filter(|row| !page.lines().any(|line| line == *row)).collect();
    assert!(missing.is_empty(), "docs/chapter.md has other rows than these: {missing:#?}");
}

/// Formats a row of a table.
fn row(cells: impl IntoIterator<Item = String>) -> String {
    let cells: Vec<String> = cells.into_iter().collect();
    format!("| {} |", cells.join(" | "))
}

/// Formats a period given in ms as an assignment for `--set`, in s.
fn period(ms: f64) -> String {
    format!("period_s={}", ms / 1e3)
}

/// Formats an error, m. Rounding errors differ between machines.
fn error(error_m: f64) -> String {
    if error_m < 1e-12 { "rounding".into() } else { format!("{error_m:.0e}") }
}

fn settled_at(converged_at_s: Option<f64>) -> String {
    converged_at_s.map_or("never".into(), |at_s| format!("{at_s:.2}"))
}

#[test]
fn chapter_page_names_existing_items() {
    let page = include_str!("../../docs/chapter.md");
    let (_, rest) = page.split_once("## Where each equation is in the code").expect("a table");
    let (table, _) = rest.split_once("\n## ").expect("a next section");
    let mut names = 0;
    for line in table.lines().filter(|line| line.starts_with("| ")) {
        let mut file = String::new();
        for code in line.split('`').skip(1).step_by(2) {
            if code.contains('/') {
                let path = format!("{}/{code}", env!("CARGO_MANIFEST_DIR"));
                file = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path}: {e}"));
            } else {
                assert!(file.contains(code), "`{code}` is not in the file before it: {line}");
                names += 1;
            }
        }
    }
    assert!(names > 40, "{names} names");
}

#[test]
fn chapter_page_has_the_bounds_and_epsilon_rules() {
    let rows = LED_CASES.map(|(name, _)| {
        let scenario = scenario(name, &[]);
        let theory = Theory::compute(&scenario);
        let (facts, bounds) = (theory.trajectory.unwrap(), theory.bounds.unwrap());
        let speeds = [facts.eta_m_m_s, facts.eta_c_m_s, bounds.lemma_1_m_s, bounds.norm_2_m_s];
        let speeds = speeds.iter().map(|speed| format!("{speed:.3}"));
        let epsilon = theory.epsilon.iter().map(|rule| format!("{:.2}", rule.epsilon_per_s));
        row([name.to_owned()].into_iter().chain(speeds).chain(epsilon))
    });
    assert_page_has(&rows);
}

#[test]
fn chapter_page_has_the_laws_without_avoidance() {
    let names: Vec<&str> = STARTS.into_iter().chain(LED_CASES.map(|(name, _)| name)).collect();
    let rows = map_in_parallel(&names, |name| {
        let simulated = simulate(&scenario(name, &["avoidance.kind=none"]));
        let hull = simulated.hull_distance_m_max_final.map(|hull_m| hull_m.to_string());
        let worst = error(nearest_and_worst(&simulated).1);
        let settled = settled_at(simulated.converged_at_s);
        row([(*name).into(), settled, worst, hull.unwrap_or("-".into())])
    });
    assert_page_has(&rows);
}

#[test]
fn chapter_page_has_case_1_from_four_starts() {
    let rows = map_in_parallel(&STARTS, |name| {
        let guard = simulate(&scenario(name, &[]));
        let focus = simulate(&scenario(name, &["avoidance.kind=focus", "period_s=0.001"]));
        let none = simulate(&scenario(name, &["avoidance.kind=none"]));
        let start = Theory::compute(&scenario(name, &[])).distances.start.unwrap().distance_m;
        let ((near_m, error_m), (focus_m, focus_error_m)) =
            (nearest_and_worst(&guard), nearest_and_worst(&focus));
        assert!(near_m >= CASE_1_D_M, "{name}: {near_m}");
        row([
            (*name).to_owned(),
            format!("{:.3}", start / CASE_1_D_M),
            format!("{:.4}", near_m / CASE_1_D_M),
            settled_at(guard.converged_at_s),
            error(error_m),
            format!("{:.4}", focus_m / CASE_1_D_M),
            settled_at(focus.converged_at_s),
            error(focus_error_m),
            format!("{:.3}", nearest_and_worst(&none).0 / CASE_1_D_M),
        ])
    });
    assert_page_has(&rows);
}

#[test]
fn guard_converges_from_every_start_and_keeps_d() {
    for name in STARTS {
        for period_ms in [1.0, 20.0] {
            let simulated = simulate(&scenario(name, &[&period(period_ms)]));
            let (distance_m, error_m) = nearest_and_worst(&simulated);
            assert!(distance_m >= CASE_1_D_M, "{name} at {period_ms} ms: {distance_m}");
            assert!(error_m < 1e-3, "{name} at {period_ms} ms: {error_m}");
        }
    }
}

/// Period (ms), maximum error (m) and minimum distance / d of cases 2 and 3 in an independent simulation of the same
/// laws without yield priorities. With priorities, robots stay farther apart.
const MEASURED: [(f64, [(f64, f64); 2]); 5] = [
    (1.0, [(6.9e-5, 1.050), (2.2e-4, 1.049)]),
    (2.0, [(1.4e-4, 1.050), (4.3e-4, 1.039)]),
    (5.0, [(3.5e-4, 1.052), (1.1e-3, 1.049)]),
    (10.0, [(7.0e-4, 1.084), (2.2e-3, 1.100)]),
    (20.0, [(1.4e-3, 1.209), (4.4e-3, 1.203)]),
];

#[test]
fn chapter_page_has_cases_2_and_3_with_the_guard() {
    let rows = map_in_parallel(&MEASURED, |&(period_ms, measured)| {
        [0, 1].map(|case| {
            let ((name, d), (error_m, distance)) = (LED_CASES[case], measured[case]);
            let simulated = simulate(&scenario(name, &[&period(period_ms)]));
            let (found_m, found_error_m) = nearest_and_worst(&simulated);
            assert!(found_m >= d && found_m / d > 0.95 * distance, "{name}: {found_m}");
            assert!(found_error_m < 1.1 * error_m, "{name}: {found_error_m}");
            let hull = simulated.hull_distance_m_max_final.map(|hull_m| hull_m.to_string());
            row([
                name.to_owned(),
                format!("{period_ms}"),
                format!("{found_error_m:.1e}"),
                format!("{error_m:.1e}"),
                format!("{:.3}", found_m / d),
                format!("{distance:.3}"),
                settled_at(simulated.converged_at_s),
                hull.unwrap_or("-".into()),
            ])
        })
    });
    assert_page_has(&rows.concat());
}

#[test]
#[ignore = "a table of docs/chapter.md: millions of ticks"]
fn chapter_page_has_the_minimum_distances_of_focus() {
    let literal = |name: &str, ms: f64| {
        let set = ["avoidance.kind=focus", &period(ms), "expect={}"];
        nearest_and_worst(&simulate(&scenario(name, &set)))
    };
    let rows = map_in_parallel(&[0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0], |&ms| {
        let starts = STARTS.map(|name| literal(name, ms));
        let nearest_m = starts.iter().map(|start| start.0).fold(f64::INFINITY, f64::min);
        let with_leader = LED_CASES.map(|(name, d)| {
            let (distance_m, error_m) = literal(name, ms);
            [format!("{:.3}", distance_m / d), error(error_m)]
        });
        let case_1 = [format!("{:.4}", nearest_m / CASE_1_D_M), format!("{:.2}", starts[2].1)];
        row([format!("{ms}")].into_iter().chain(case_1).chain(with_leader.into_iter().flatten()))
    });
    assert_page_has(&rows);
}

#[test]
fn chapter_page_has_the_effect_of_each_published_velocity() {
    let rows = map_in_parallel(&["gamma", "gamma+beta", "differenced"], |kind| {
        let measured = LED_CASES.map(|(name, d)| {
            let set = format!("published_velocity=\"{kind}\"");
            let (distance_m, error_m) = nearest_and_worst(&simulate(&scenario(name, &[&set])));
            assert!(distance_m >= d, "{name}, {kind}: {distance_m}");
            [format!("{error_m:.2e}"), format!("{:.3}", distance_m / d)]
        });
        row([format!("`{kind}`")].into_iter().chain(measured.into_iter().flatten()))
    });
    assert_page_has(&rows);
}

#[test]
#[ignore = "a table of docs/chapter.md: 1400 runs"]
fn chapter_page_has_the_number_of_stuck_lattices() {
    let rows = map_in_parallel(&[1.1, 1.2, 1.5, 2.0, 2.2, 2.5, 3.0], |gap| {
        let stuck = [false, true].map(|both_ways| {
            let runs = (1..=100)
                .map(|seed| simulate(&scattered_scenario(12, CASE_1_D_M * gap, both_ways, seed)));
            let mut stuck = 0;
            for simulated in runs {
                let nearest_m = simulated.min_distance_m.unwrap();
                assert!(nearest_m >= CASE_1_D_M, "{gap}: {nearest_m}");
                stuck += usize::from(simulated.converged_at_s.is_none());
            }
            stuck.to_string()
        });
        row([format!("{gap}")].into_iter().chain(stuck))
    });
    assert_page_has(&rows);
}
