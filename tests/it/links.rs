//! Links that fail like radio links, and odometry and commands that are late or lost: the guard keeps d in both time
//! modes, and a guard that assumes a shorter command lifetime (H) does not.

use agent::controller::{Controller, Parts};
use agent::laws::{Law, Situation};
use experiment::check::Theory;
use formation::Vec2;
use outcome::metrics::RunMetrics;
use protocol::brief::{AgentBrief, Pace};

use crate::harness::{map_in_parallel, run};
use crate::hostile::{hostile_trial, margin};
use crate::model::{ADVERSARIES, Fleet, RequestedVelocity};
use crate::oracle::{simulate, simulate_with, with_faults};

/// Faults of 20 % burst loss, and of 40 ms and more of delay in each direction.
const LATE_FAULTS: [&str; 4] = [
    "bursts * odometry of 0.2 mean 0.1 @0",
    "bursts * commands of 0.2 mean 0.1 @0",
    "delay * odometry by 0.04 @0",
    "delay * commands by 0.04 jitter 0.02 @0.5",
];

/// Control law that drives at the nearest neighbor with maximum speed, and to the goal while no robot is near.
struct RammingLaw {
    speed_m_s: f64,
}

impl Law for RammingLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let relative_position =
            situation.neighbor_vectors.first().copied().unwrap_or(situation.error);
        -self.speed_m_s * relative_position / relative_position.norm().max(f64::MIN_POSITIVE)
    }
}

/// Simulates robots in lockstep that go to goals and ram each other on the way. `change_brief` changes their briefs.
fn ramming(
    set: &[&str],
    faults: &[&str],
    change_brief: impl Fn(&mut AgentBrief) + Send + 'static,
) -> RunMetrics {
    let scenario = with_faults("antipodal-8", set, faults);
    let make_controller = move |brief: &AgentBrief, incarnation| {
        let mut brief = brief.clone();
        change_brief(&mut brief);
        let parts = Parts::from_brief(&brief).expect("a checked brief");
        let law = Box::new(RammingLaw { speed_m_s: brief.avoidance.speed_max_m_s });
        Controller::with_parts(&brief, incarnation, Parts { law, ..parts })
    };
    simulate_with(&scenario, Box::new(make_controller))
}

#[test]
fn check_reports_io_delay_and_h_accounts_for_it() {
    let set = ["period_s=0.02"];
    let scenario = with_faults("triangle", &set, &LATE_FAULTS);
    let guard = Theory::compute(&scenario).guard;
    // 2 and 3 ticks in lockstep; 40 ms and 60 ms in real time.
    assert_eq!(guard.late_s, [0.1, 0.1]);
    assert_eq!((guard.lifetime_lockstep_s, guard.lifetime_realtime_s), (0.12, 0.143));
    let lossy = with_faults("triangle", &set, &LATE_FAULTS[..2]);
    assert_eq!(lossy.command_delay_ns_max(Pace::Lockstep), 0);
    assert_eq!(lossy.faults.len(), 6, "each of the three robots, twice");
}

#[test]
fn lockstep_keeps_d_under_any_odometry_and_command_delay() {
    let kills = ["kill r1 @2 restart 0.1", "kill r5 @3 restart 0.02", "freeze r3 @4 for 0.5"];
    let faults = [&LATE_FAULTS[..], &kills].concat();
    let periods = ["period_s=0.02", "period_s=0.005"];
    let runs = periods.map(|period| (1..=4).map(move |seed| (period, seed)));
    map_in_parallel(&runs.into_iter().flatten().collect::<Vec<_>>(), |(period, seed)| {
        let set = [*period, "duration_s=10", "expect={}", &format!("seed={seed}")];
        let measures = ramming(&set, &faults, |_| ());
        let distance_m = measures.min_distance_m.unwrap();
        let d_m = with_faults("antipodal-8", &set, &[]).avoidance.distance_min_m;
        assert!(distance_m >= d_m, "{set:?}: {distance_m} m");
        // The robots did come near each other.
        assert!(distance_m < 1.3 * d_m, "{set:?}: {distance_m} m");
    });
}

#[test]
fn guard_that_ignores_command_delay_violates_d() {
    let set = ["period_s=0.02", "duration_s=10", "expect={}"];
    let measures = ramming(&set, &LATE_FAULTS, |brief| {
        (brief.command_lifetime_ns, brief.late_ns) = (brief.period_ns, 0);
    });
    let d_m = with_faults("antipodal-8", &set, &[]).avoidance.distance_min_m;
    assert!(measures.min_distance_m.unwrap() < d_m - 1e-3, "{:?}", measures.min_distance_m);
}

#[test]
fn real_time_model_also_keeps_d() {
    let names = ["triangle", "pentagon", "antipodal-8"];
    let fleets = ["period_s=0.005", "period_s=0.02"].map(|period| names.map(|name| (period, name)));
    let fleets: Vec<_> = fleets.into_iter().flatten().zip(0..).collect();
    map_in_parallel(&fleets, |&((period, name), number)| {
        let fleet = Fleet::from_scenario(&with_faults(name, &[period, "expect={}"], &LATE_FAULTS));
        let attacks = ADVERSARIES
            .iter()
            .flat_map(|&by| [(by, RequestedVelocity::Law), (by, RequestedVelocity::Ram)]);
        for (seed, (adversary, requested_velocity)) in (77_000 + 100 * number..).zip(attacks) {
            let (margin_m, outcome) =
                margin(&fleet, hostile_trial(seed, adversary, requested_velocity));
            assert!(margin_m >= 0.0, "{name}, {period}, {seed}: {margin_m}, {outcome:?}");
        }
    });
}

#[test]
fn late_robots_still_come_to_their_places() {
    for name in ["triangle", "antipodal-8"] {
        let set = ["period_s=0.02", "duration_s=60", "expect={}"];
        let measures = simulate(&with_faults(name, &set, &LATE_FAULTS));
        let error_m = measures.final_error_m_max.unwrap();
        assert!(error_m < 0.02, "{name}: {error_m} m");
    }
}

#[test]
fn in_real_time_late_robots_keep_d_and_come_to_their_places() {
    let ended = run("triangle").faults(LATE_FAULTS).sets(["duration_s=20", "expect={}"]).finish();
    ended.exits_with(0).assert_leaves_nothing().assert_keeps_d();
    ended.assert_holds(ended.number("/final_error_m_max") < 0.02, "the formation stands");
}
