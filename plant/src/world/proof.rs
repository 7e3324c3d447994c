//! The plant compared with its proof: under arbitrary messages the wheels follow the rule of `proof/Plant.v`,
//! which is reimplemented here.

use proptest::prelude::*;

use super::*;
use crate::testing::{brief, command};

const COMMAND_LIFETIME_NS: u64 = 20_000_000;

/// Implements `proof/Plant.v::accept`, clause by clause. The order of the tuples is `proof/Plant.v::before`.
fn accept(now_ns: u64, command: Command, newest: Option<Command>) -> Option<Command> {
    let order = |c: &Command| (c.incarnation, c.stamp_ns, c.sequence);
    if command.stamp_ns <= now_ns {
        if now_ns < command.stamp_ns + COMMAND_LIFETIME_NS {
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

/// Implements `proof/Plant.v::in_force`. Returns the speed of the wheels, m/s.
fn speed_in_force(now_ns: u64, newest: Option<Command>) -> f64 {
    let alive = newest.filter(|command| now_ns < command.stamp_ns + COMMAND_LIFETIME_NS);
    alive.map_or(0.0, |command| command.v_m_s)
}

/// Generates the time until the next message, ns, often exactly the command timeout.
fn wait_ns() -> impl Strategy<Value = u64> {
    prop_oneof![
        Just(0),
        Just(1),
        Just(COMMAND_LIFETIME_NS - 1),
        Just(COMMAND_LIFETIME_NS),
        0..30_000_000u64
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn command_rule_equals_that_of_the_proof(
        messages in proptest::collection::vec(
            // Age of the answered sample, or 1 ns in the future.
            (wait_ns(), wait_ns(), any::<bool>(), 0..3u64, 0..3u64, -1.0..1.0f64),
            1..30,
        ),
    ) {
        let mut world = World::new(&brief(&[0.0]));
        let mut newest = None;
        for (wait_ns, age_ns, from_future, incarnation, sequence, v_m_s) in messages {
            for part_ns in [wait_ns / 3, wait_ns - wait_ns / 3] {
                world.advance(world.t_ns() + part_ns);
                let now_ns = world.t_ns();
                world.advance(now_ns + 1);
                prop_assert_eq!(world.states[0].twist.v_m_s, speed_in_force(now_ns, newest));
            }
            let now_ns = world.t_ns();
            let stamp_ns = now_ns.saturating_sub(age_ns) + u64::from(from_future);
            let command = Command { incarnation, ..command(stamp_ns, sequence, v_m_s, 0.0) };
            let before = newest.map(|n: Command| (n.incarnation, n.stamp_ns, n.sequence));
            newest = accept(now_ns, command, newest);
            let after = newest.map(|n| (n.incarnation, n.stamp_ns, n.sequence));
            prop_assert_eq!(world.accept_command(0, &command).is_ok(), after != before);
            world.advance(now_ns + 1);
            prop_assert_eq!(world.states[0].twist.v_m_s, speed_in_force(now_ns, newest));
        }
    }
}
