//! Which way leads around others, who gives way to whom, and who stands off.

use std::f64::consts::PI;

use formation::scale::Scale;
use formation::trajectory::Trajectory;
use protocol::brief::LeadBrief;

use super::super::guard::tests::brief;
use super::*;

/// The chapter's focus alone, as strong as needed, and a dither of 1 rad: no look ahead, no yield.
fn plain(mut brief: AgentBrief) -> AgentBrief {
    let gains = [
        ("dither_rad", 1.0),
        ("around", 1.0),
        ("around_at_last", 1.0),
        ("slack_share", 0.25),
        ("margin", 1.5),
        ("look_ahead_turn_rad", 1e-12),
        ("yield", 1e-12),
    ];
    brief.avoidance.gains.extend(gains.map(|(key, value)| (key.to_owned(), value)));
    brief
}

/// d = 0.2 m, v_max = 0.3 m/s, T = H = 5 ms: d_f = 0.21 m for the first rank, 0.231 m for followers, 0.2352 m
/// for contained robots.
fn slow(rank: Rank) -> AgentBrief {
    let mut brief = AgentBrief { rank, ..brief() };
    (brief.period_ns, brief.command_lifetime_ns) = (5_000_000, 5_000_000);
    brief.avoidance.speed_max_m_s = 0.3;
    brief
}

fn of_rank(rank: Rank) -> Deflection {
    Deflection::new(&plain(slow(rank)))
}

#[test]
fn along_a_wall_a_robot_is_led_to_the_side_that_it_wants_and_no_nearer_than_c_f() {
    let mut brief = plain(brief());
    brief.avoidance.clearance_m = 0.1;
    let mut deflection = Deflection::new(&brief);
    let c_f = 0.109375; // 0.75 v_max H
    let mut led = |far: f64, p: Vec2| {
        let walls = [rotate(0.7, Vec2::new(-far, 0.0))]; // ahead, turned by 0.7
        let beside = Sample { walls: &walls, ..Sample::default() };
        rotate(-0.7, deflection.deflect(&beside, rotate(0.7, p)))
    };
    let near = |found: Vec2, x: f64, y: f64| {
        assert!((found - Vec2::new(x, y)).norm() < 1e-12, "{found:?} is not {x}, {y}");
    };
    // At c_f nothing is left of what leads into it; to the side, all that it lost.
    near(led(c_f, Vec2::new(3e-3, 2e-3)), 0.0, 5e-3);
    near(led(c_f, Vec2::new(3e-3, -2e-3)), 0.0, -5e-3);
    near(led(c_f, Vec2::new(4e-3, 0.0)), 0.0, 0.0);
    // Hardly to a side: more of it, without a jump.
    let side = 1e-4 / (16e-6f64 + 1e-8).sqrt();
    near(led(c_f, Vec2::new(4e-3, 1e-4)), 0.0, 1e-4 + 4e-3 * 4.0 * side);
    // Nearer, away from it, whatever is wanted; farther away, a quarter of the rest is left.
    near(led(c_f - 4e-3, Vec2::zeros()), -1e-3, 0.0);
    near(led(c_f + 4e-3, Vec2::new(3e-3, 1e-3)), 1e-3, 3e-3);
    near(led(c_f + 4e-3, Vec2::new(1e-3, 2e-3)), 1e-3, 2e-3);
    near(led(c_f + 4e-3, Vec2::new(-4e-3, 2e-3)), -4e-3, 2e-3);
}

/// All of it turned by an angle at which no component is 0.
#[test]
fn one_in_the_way_is_gone_around_by_a_focus_that_is_as_strong_as_needed() {
    let mut deflection = Deflection::new(&plain(AgentBrief { index: 2, ..brief() }));
    let (phase, period_s) = (deflection.dither_phase, deflection.dither_period);
    assert!((phase - 0.236_067_977_4).abs() < 1e-9);
    assert!((period_s - 1.5 * (1.0 + 4.0 * 0.236_067_977_4 / 3.0)).abs() < 1e-9);
    let turned = |x: f64, y: f64| rotate(0.7, Vec2::new(x, y));
    // The instant at which the dither has gone through this many of its periods.
    let at = |turns: f64| (turns - phase) * period_s;
    let mut deflect = |turns: f64, away: &[Vec2], p: Vec2| {
        deflection.deflect(&Sample { t_s: at(turns), away, ..Sample::default() }, p)
    };
    let near = |found: Vec2, expected: Vec2| {
        assert!((found - expected).norm() < 1e-10, "{found:?} is not {expected:?}");
    };
    let (d_f, reach) = (0.21875, 0.005); // V
    let other = [turned(-0.212, 0.0)]; // ahead: n = (-1, 0), t = (0, -1)
    let excess = 0.25 * (d_f - 0.212);
    let clipped = |x: f64, y: f64| turned(x, y) * (reach / x.hypot(y));

    // Straight at it, while the dither turns by nothing.
    near(deflect(3.0, &other, turned(reach, 0.0)), clipped(-excess, -(excess + reach)));
    // While the dither turns by 1 rad: less straight at it, and less is added.
    let (sin, cos) = 1f64.sin_cos();
    let lambda = excess + reach * cos;
    let expected = turned(reach * cos - lambda, reach * sin - lambda);
    near(deflect(3.25, &other, turned(reach, 0.0)), expected);
    // Away from it faster than its share: nothing turns or pushes.
    near(deflect(3.25, &other, turned(-0.004, 0.001)), turned(-0.004, 0.001));
    // One that is too far to be reached in a period does not count, even where nearer ones push
    // towards it by more than a period's way.
    let deep = turned(-0.2, 0.0);
    let excess = 0.25 * (d_f - 0.2);
    let expected = clipped(-excess, -(excess + reach));
    near(deflect(3.0, &[deep], turned(reach, 0.0)), expected);
    near(deflect(3.0, &[deep, turned(0.0, 0.24)], turned(reach, 0.0)), expected);
    // One that is only just near enough holds back what a period could bring too much.
    let half_of_it = turned(-(d_f + 0.5 * reach / 0.25), 0.0); // kappa = 0.25
    near(deflect(3.0, &[half_of_it], turned(reach, 0.0)), turned(0.5 * reach, -0.5 * reach));
    // At the same place there is no direction to go around by.
    assert!(deflect(3.0, &[Vec2::zeros()], turned(reach, 0.0)).norm() <= reach);
}

#[test]
fn one_that_gives_way_is_led_around_from_farther_away_and_asks_for_a_wider_view() {
    let [mut keeps, mut gives] = [Rank::First, Rank::Contained].map(of_rank);
    let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
    assert!((keeps.d_f - expected_d_f).abs() < 1e-12, "{}", keeps.d_f);
    assert!((of_rank(Rank::Follower).d_f - 1.1 * expected_d_f).abs() < 1e-12);
    assert!((gives.d_f - 1.12 * expected_d_f).abs() < 1e-12, "{}", gives.d_f);

    // The other stands ahead, between the two d_f; both want to go there.
    let (ahead, away) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
    let sample = Sample { away: &away, ..Sample::default() };
    assert!((keeps.deflect(&sample, ahead) - ahead).norm() < 1e-12);
    let led = gives.deflect(&sample, ahead);
    assert!(led.x < 0.0 && led.y.abs() > 0.0, "back, and around: {led:?}");
}

/// What a robot that wants nothing does beside another that is `z` away and moves like this, after it has seen
/// that for 20 s; the error of its own place is `error`, and the place moves as well.
fn answers(
    brief: &AgentBrief,
    error: Vec2,
    z: Vec2,
    [velocity, place_velocity]: [Vec2; 2],
) -> Vec2 {
    let mut robot = Deflection::new(brief);
    let mut answer = Vec2::zeros();
    for step in 0..=4000u64 {
        let t_s = 0.005 * step as f64;
        let away = [z + velocity * (20.0 - t_s)]; // z at the last
        let stamp_ns = 5_000_000 * step;
        let at = Sample { stamp_ns, t_s, place_velocity, ..Sample::default() };
        let seen = Sample { away: &away, error: Some(error), ..at };
        robot.stand_off(&seen, error);
        answer = robot.deflect(&seen, Vec2::zeros());
    }
    answer
}

#[test]
fn who_has_arrived_gives_way_to_whoever_comes_and_to_nobody_else() {
    let yielding = |rank| {
        let mut brief = plain(slow(rank));
        brief.avoidance.gains.extend([("yield".into(), 0.5), ("yield_speed".into(), 0.5)]);
        brief
    };
    let first = yielding(Rank::First);
    let z = rotate(0.4, Vec2::new(0.31, 0.0)); // between d_f and 1.5 d_f = 0.315 m
    let (comes, passes) = (0.6 * z, 0.6 * Vec2::new(-z.y, z.x)); // 0.19 m/s
    let at_home = Vec2::new(0.001, 0.0);
    let nothing = Vec2::zeros();
    let aside = answers(&first, at_home, z, [comes, nothing]);
    assert!(aside.dot(&z) > 0.0 && aside.norm() > 1e-4, "{aside:?}");
    for (what, error, velocities) in [
        ("one that stands", at_home, [nothing, nothing]),
        ("one that goes away", at_home, [-comes, nothing]),
        ("one that passes as in a formation that turns", at_home, [passes, nothing]),
        ("one that goes along as in a formation that moves", at_home, [comes, comes]),
        ("one that is on its own way", Vec2::new(3.0, 0.0), [comes, nothing]),
    ] {
        assert!(answers(&first, error, z, velocities).norm() < 1e-6, "{what}");
    }
    let without = answers(&plain(slow(Rank::First)), at_home, z, [comes, nothing]);
    assert!(without.norm() < 1e-12, "nobody yields without the gain");
    let contained = answers(&yielding(Rank::Contained), at_home, z, [comes, nothing]);
    assert!(contained.norm() < 1e-12, "another may want to stay at a contained robot's place");
    let leader = answers(&leading(first), at_home, z, [comes, nothing]);
    assert!(leader.norm() < 1e-12, "all others go by a leader's way");
}

/// Of a robot that leads all others.
fn leading(brief: AgentBrief) -> AgentBrief {
    let trajectory = Trajectory::Still { center_m: [0.0, 0.0] };
    AgentBrief { lead: Some(LeadBrief { scale: Scale::ONE, trajectory }), ..brief }
}

#[test]
fn a_robot_turns_early_to_the_side_on_which_it_passes_anyway() {
    let mut brief = plain(slow(Rank::First));
    brief.avoidance.gains.remove("look_ahead_turn_rad");
    brief.avoidance.gains.extend([("look_ahead".into(), 4.0), ("look_ahead_share".into(), 1.0)]);
    let ahead = Vec2::new(1.5e-3, 0.0); // 0.3 m/s
    // The other's place, and its velocity: seen twice, so that it is known at once.
    let turn_of = |brief: &AgentBrief, at: Vec2, velocity: Vec2| {
        let mut robot = Deflection::new(brief);
        for step in 0..=200u64 {
            let stamp_ns = 5_000_000 * step;
            let away = [-(at - velocity * (1.0 - 0.005 * step as f64))];
            robot.motion.observe(&Sample { stamp_ns, away: &away, ..Sample::default() });
        }
        let led = robot.look_ahead(ahead);
        assert!((led.norm() - ahead.norm()).abs() < 1e-15, "as fast as before: {led:?}");
        led.y.atan2(led.x)
    };
    let turn = |at: Vec2, velocity: Vec2| turn_of(&brief, at, velocity);
    let still = Vec2::zeros();
    let [left, right] = [0.05, -0.05].map(|y| turn(Vec2::new(0.6, -y), still));
    assert!(left > 0.01 && (left + right).abs() < 1e-12, "{left}, {right}");
    assert!(turn(Vec2::new(0.6, 0.0), still) != 0.0, "straight at it, to one side");
    for (what, at, velocity) in [
        ("behind", Vec2::new(-0.4, 0.05), still),
        ("wide of it", Vec2::new(0.6, 0.22), still),
        ("too far ahead to be met soon", Vec2::new(1.0, 0.05), still),
        ("going the same way as fast", Vec2::new(0.4, 0.05), Vec2::new(0.3, 0.0)),
    ] {
        assert!(turn(at, velocity).abs() < 1e-9, "{what}: {}", turn(at, velocity));
    }
    let leader = turn_of(&leading(brief.clone()), Vec2::new(0.6, -0.05), still);
    assert_eq!(leader, 0.0, "all others go by a leader's way");
    // The sooner, the more; and never more than the limit.
    let sooner = turn(Vec2::new(0.4, -0.05), still);
    assert!(sooner > left, "{sooner}, {left}");
    let comes = turn(Vec2::new(0.4, -0.05), Vec2::new(-0.3, 0.0));
    assert!(comes > sooner, "{comes}");
    brief.avoidance.gains.insert("look_ahead_turn_rad".into(), 0.1);
    let mut robot = Deflection::new(&brief);
    let away = [Vec2::new(-0.22, 0.05)];
    robot.motion.observe(&Sample { away: &away, ..Sample::default() });
    let led = robot.look_ahead(ahead);
    assert!((led.y.atan2(led.x).abs() - 0.1).abs() < 1e-12, "{led:?}");
}

/// What it asks for, as seen from it, with others at `away` that have been there for as long.
fn asks(robot: &mut Deflection, away: &[Vec2], place: Vec2, since_s: f64) -> Vec2 {
    let mut asked = place;
    let steps = (since_s / 0.01).round() as u64;
    for step in 0..=steps {
        let stamp_ns = 10_000_000 * step;
        asked = -robot.stand_off(&Sample { stamp_ns, away, ..Sample::default() }, -place);
    }
    asked
}

#[test]
fn a_place_that_is_taken_is_not_asked_for_but_one_beside_it() {
    let other = Vec2::new(1.0, 0.0); // seen from the robot
    let close = |found: Vec2, expected: Vec2| (found - expected).norm() < 1e-9;
    // A contained robot's at once, any other's once who is there has been still for long.
    for (rank, d_f, since_s) in [
        (Rank::Contained, 0.2352, 0.0),
        (Rank::Follower, 0.231, TAKEN_AFTER_S + 0.01),
        (Rank::First, 0.21, TAKEN_AFTER_S + 0.01),
    ] {
        let asked = |place| asks(&mut of_rank(rank), &[-other], place, since_s);
        // Farther from the other than d_f, all is as it was.
        let free = other + Vec2::new(0.0, d_f + 1e-3);
        assert!(close(asked(free), free));
        // Right where the other stands: in line with it, a tenth farther away than d_f.
        assert!(close(asked(other), Vec2::new(1.0 - 1.1 * d_f, 0.0)));
        // Near it: on the side where the place is, without a jump where it becomes free.
        let aside = asked(other + Vec2::new(0.0, 0.5 * d_f));
        let expected = rotate(0.25 * PI, Vec2::new(0.0, 1.05 * d_f));
        assert!(close(aside - other, expected), "{aside:?}");
        let nearly = other + Vec2::new(0.0, d_f - 1e-6);
        assert!((asked(nearly) - nearly).norm() < 1e-5, "{:?}", asked(nearly));
        // Of two the one nearer to the place counts.
        let two = [-other, -other - Vec2::new(0.0, 0.3)];
        let asked = asks(&mut of_rank(rank), &two, other + Vec2::new(0.0, 0.3), since_s);
        assert!(((asked + two[1]).norm() - 1.1 * d_f).abs() < 1e-9, "{asked:?}");
    }
    // Two sensed at one point, which d forbids, leave what was asked.
    let place = Vec2::new(0.1, 0.0);
    assert_eq!(asks(&mut of_rank(Rank::Contained), &[Vec2::zeros()], place, 0.0), place);
}

#[test]
fn whoever_leads_or_keeps_a_place_asks_for_it_while_who_stands_there_may_go_on() {
    let other = Vec2::new(1.0, 0.0);
    for rank in [Rank::First, Rank::Follower] {
        let nearly_s = TAKEN_AFTER_S - 0.02;
        assert_eq!(asks(&mut of_rank(rank), &[-other], other, nearly_s), other);
    }
}

#[test]
fn who_stands_off_is_held_back_and_not_led_around_until_its_place_is_free() {
    let mut robot = of_rank(Rank::Contained);
    let (ahead, away) = (Vec2::new(1.5e-3, 0.0), [Vec2::new(-0.233, 0.0)]);
    let at = |t_s| Sample { t_s, away: &away, ..Sample::default() };
    let around = robot.deflect(&at(0.0), ahead);
    assert!(around.y.abs() > 1e-4, "{around:?}");
    robot.stand_off(&at(0.0), Vec2::new(-0.233, 0.0));
    // Neither around nor, while the dither's clock goes round, to either side.
    for t_s in [0.0, 0.3, 0.9] {
        let back = robot.deflect(&at(t_s), ahead);
        assert!(back.x < 0.0 && back.y == 0.0, "{back:?}");
    }
    robot.stand_off(&at(0.0), Vec2::new(-1.0, 0.0));
    assert_eq!(robot.deflect(&at(0.0), ahead), around);
}

#[test]
fn who_stands_off_gives_way_to_others_from_farther_away_than_to_whoever_has_its_place() {
    let mut robot = of_rank(Rank::Contained);
    let taker = Vec2::new(-0.25, 0.0); // ahead; both nearer than d_s, and farther away than d_f
    let beside = Vec2::new(0.0, -0.257);
    let both = Sample { away: &[taker, beside], ..Sample::default() };
    let mut moved = |wanted: Vec2, away: &[Vec2]| {
        robot.stand_off(&both, wanted);
        robot.deflect(&Sample { away, ..Sample::default() }, Vec2::zeros())
    };
    assert_eq!(moved(taker, &[taker]), Vec2::zeros());
    let back = 0.25 * (1.1 * 0.2352 - 0.257);
    assert!((moved(taker, &[taker, beside]) - Vec2::new(0.0, -back)).norm() < 1e-12);
    assert_eq!(moved(Vec2::new(1.0, 1.0), &[taker, beside]), Vec2::zeros());
}

#[test]
fn a_robot_that_gets_nowhere_goes_around_more_and_at_last_rests_for_longer_each_time() {
    let mut robot = of_rank(Rank::First);
    let (unit_s, error) = (0.2 / 0.3, Vec2::new(-1.0, 0.0));
    let wanted = Vec2::new(1.5e-3, 0.0);
    // It stands, blocked, and wants to go on: when it rests, s.
    let away = [Vec2::new(-0.205, 0.0)];
    let mut rests = Vec::new();
    let mut was = false;
    for step in 0..30_000u64 {
        let (stamp_ns, t_s) = (10_000_000 * step, 0.01 * step as f64);
        let seen = Sample { stamp_ns, t_s, away: &away, error: Some(error), ..Sample::default() };
        robot.deflect(&seen, wanted);
        let rests_now = robot.patience.rests();
        if rests_now != was {
            rests.push(t_s / unit_s);
        }
        was = rests_now;
        assert!(robot.patience.lost() > 0.0 || t_s < unit_s, "it counts as getting nowhere");
    }
    let lasts: Vec<f64> = rests.windows(2).map(|pair| (pair[1] - pair[0]).round()).collect();
    assert!(lasts.starts_with(&[30.0, 30.0, 60.0, 30.0, 120.0][..]), "tries and rests: {lasts:?}");
    // Nearer to its place, or with another, it tries again at once.
    for error in [Vec2::new(-0.98, 0.0), Vec2::new(-1.5, 0.0)] {
        let mut robot = of_rank(Rank::First);
        for step in 0..4000u64 {
            let error = Some(if step < 3999 { Vec2::new(-1.0, 0.0) } else { error });
            let stamp_ns = 10_000_000 * step;
            robot.deflect(&Sample { stamp_ns, away: &away, error, ..Sample::default() }, wanted);
            let expected = step < 3999 && 0.01 * step as f64 > 31.0 * unit_s;
            if expected || step == 3999 {
                assert_eq!(robot.patience.rests(), expected, "{step}");
            }
        }
    }
}
