//! The world against its proof: under arbitrary messages the wheels do what the rule of
//! `proof/Plant.v`, written down here once more, says.

use formation::pose::Pose;
use proptest::prelude::*;
use protocol::brief::Format;

use super::*;

const LIFETIME_NS: u64 = 20_000_000;

/// `proof/Plant.v::accept`, clause by clause; `proof/Plant.v::before` is the order of the tuples.
fn accept(now_ns: u64, command: Command, newest: Option<Command>) -> Option<Command> {
    let order = |c: &Command| (c.incarnation, c.stamp_ns, c.sequence);
    if command.stamp_ns <= now_ns {
        if now_ns < command.stamp_ns + LIFETIME_NS {
            match newest {
                None => Some(command),
                Some(n) if order(&n) < order(&command) => Some(command),
                Some(_) => newest,
            }
        } else {
            newest
        }
    } else {
        newest
    }
}

/// `proof/Plant.v::in_force`: what the wheels do, m/s.
fn in_force(now_ns: u64, newest: Option<Command>) -> f64 {
    let alive = newest.filter(|command| now_ns < command.stamp_ns + LIFETIME_NS);
    alive.map_or(0.0, |command| command.v_m_s)
}

fn world() -> World {
    World::new(&PlantBrief {
        format: Format,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        duration_ns: 1_000_000_000,
        period_ns: 10_000_000,
        plant_tick_ns: 1_000_000,
        command_lifetime_ns: LIFETIME_NS,
        distance_min_m: 0.5,
        speed_max_m_s: Some(1.0),
        sensing_radius_m: 3.0,
        velocities_sensed: false,
        clearance_m: 0.0,
        program: None,
        obstacles: Vec::new(),
        robots: vec![BodyBrief {
            name: "r1".into(),
            front_point_m: 0.1,
            wheels: None,
            limits: None,
            start: Pose { x_m: 0.0, y_m: 0.0, heading_rad: 0.0 },
            sensor_faults: Vec::new(),
            wheel_faults: Vec::new(),
            command_faults: Vec::new(),
        }],
    })
}

/// Time until the next message, ns, often just as much as lets a command die.
fn wait_ns() -> impl Strategy<Value = u64> {
    prop_oneof![Just(0), Just(1), Just(LIFETIME_NS - 1), Just(LIFETIME_NS), 0..30_000_000u64]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn the_rule_for_commands_is_that_of_the_proof(
        messages in proptest::collection::vec(
            // How old the sample is that a message answers; 1 ns from the future at most.
            (wait_ns(), wait_ns(), any::<bool>(), 0..3u64, 0..3u64, -1.0..1.0f64),
            1..30,
        ),
    ) {
        let mut world = world();
        let mut newest = None;
        for (wait_ns, age_ns, from_future, incarnation, sequence, v_m_s) in messages {
            for part_ns in [wait_ns / 3, wait_ns - wait_ns / 3] {
                world.advance(world.t_ns() + part_ns);
                let now_ns = world.t_ns();
                world.advance(now_ns + 1);
                prop_assert_eq!(world.states[0].twist.v_m_s, in_force(now_ns, newest));
            }
            let now_ns = world.t_ns();
            let stamp_ns = now_ns.saturating_sub(age_ns) + u64::from(from_future);
            let command =
                Command { tick: 0, stamp_ns, sent_ns: 0, sequence, incarnation, v_m_s, w_rad_s: 0.0 };
            let before = newest.map(|n: Command| (n.incarnation, n.stamp_ns, n.sequence));
            newest = accept(now_ns, command, newest);
            let after = newest.map(|n| (n.incarnation, n.stamp_ns, n.sequence));
            prop_assert_eq!(world.accept(0, &command).is_ok(), after != before);
            world.advance(now_ns + 1);
            prop_assert_eq!(world.states[0].twist.v_m_s, in_force(now_ns, newest));
        }
    }
}
