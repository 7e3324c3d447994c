//! Avoidance methods of the literature on wheeled robots in the plant, without delays: which guarantees each keeps
//! there, and the known deadlocks. (Tests with the robots that the papers assume are in the crate `agent`.)

use experiment::check::{Theory, format_report};
use outcome::metrics::RunMetrics;

use crate::oracle::{scenario, simulate, with_faults};

/// Settings of ORCA for robots with d = 0.2 m and a speed of 0.3 m/s.
const ORCA: [&str; 2] = ["avoidance.kind=orca", "avoidance.horizon_s=2"];
const CBF_QP: [&str; 2] = ["avoidance.kind=cbf-qp", "avoidance.barrier_per_s=2"];
const RBL: [&str; 4] = [
    "avoidance.kind=rbl",
    "avoidance.cell_radius_m=0.6",
    "avoidance.spread_m=0.1",
    "avoidance.approach_per_s=10",
];

fn run(name: &str, kind: &[&str], set: &[&str]) -> RunMetrics {
    simulate(&scenario(name, &[kind, &["expect={}"], set].concat()))
}

fn final_error_max_m(measures: &RunMetrics) -> f64 {
    measures.final_error_m_max.unwrap()
}

#[test]
fn methods_on_wheels_keep_d_and_arrive_or_deadlock_as_known() {
    for (kind, can_resolve, tolerance_m) in
        [(&ORCA[..], false, 1e-6), (&CBF_QP, false, 1e-6), (&RBL, true, 0.05)]
    {
        let [antipodal, swaps] =
            ["antipodal-8", "random-swaps-10"].map(|name| run(name, kind, &[]));
        for measures in [&antipodal, &swaps] {
            let closest = measures.min_distance_m.unwrap();
            assert!(closest > 0.2 && measures.violations == 0, "{kind:?}: {closest}");
        }
        assert!(final_error_max_m(&swaps) < tolerance_m, "{kind:?}: {}", final_error_max_m(&swaps));
        // Robots that meet many others in the center deadlock, unless the method has rules against it.
        let has_arrived = final_error_max_m(&antipodal) < tolerance_m;
        assert!(
            has_arrived == can_resolve && (has_arrived || final_error_max_m(&antipodal) > 1.0),
            "{kind:?}: {}",
            final_error_max_m(&antipodal)
        );
    }
}

#[test]
fn robot_without_proximity_sensing_stops() {
    for kind in [&ORCA[..], &CBF_QP, &RBL] {
        let set = [kind, &["expect={}", "duration_s=5"]].concat();
        let without_proximity = with_faults("antipodal-8", &set, &["blackout r1 proximity @0"]);
        let errors = simulate(&without_proximity).final_error_m;
        let error = |robot: usize| errors[robot].1.unwrap();
        assert!((error(0) - 1.6).abs() < 1e-5 && error(1) < 1.3, "{kind:?}: {errors:?}");
    }
}

#[test]
fn check_reports_each_method_guarantee_and_its_assumptions() {
    for (kind, guarantee) in
        [(&ORCA[..], "horizon_s"), (&CBF_QP, "barrier_per_s"), (&RBL, "arrival")]
    {
        let scenario = scenario("antipodal-8", kind);
        let page = format_report(&scenario, &Theory::compute(&scenario));
        let line = |label: &str| page.lines().find(|line| line.starts_with(label)).unwrap();
        assert!(line("guarantees").contains(guarantee), "{page}");
        assert!(line("assumes").contains("no delay, no inertia"), "{page}");
    }
}
