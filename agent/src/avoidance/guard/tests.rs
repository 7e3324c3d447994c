//! The lemma that the guard's proof rests on, when a robot stands because it does not see enough,
//! and the figures by which it is led around others.

use formation::front_point::{front_point, front_velocity};
use formation::obstacle::Obstacle;
use formation::pose::{Pose, wrap_angle};
use formation::unicycle::arc;
use proptest::prelude::*;
use protocol::brief::{
    AvoidanceBrief, Format, PublishedVelocity, Rank, SilenceBrief, SilencePolicy,
};

use super::*;

/// d = 0.2 m, v_max = 0.5 m/s, ell = 0.1 m, T = 10 ms, H = 25 ms, exact sensors.
pub(in super::super) fn brief() -> AgentBrief {
    AgentBrief {
        format: Format,
        name: "r1".into(),
        index: 1,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        period_ns: 10_000_000,
        plant_tick_ns: 1_000_000,
        command_lifetime_ns: 25_000_000,
        late_ns: 0,
        front_point_m: 0.1,
        law: String::new(),
        gains: Default::default(),
        program: None,
        led: false,
        rank: Rank::First,
        lead: None,
        scale: None,
        goal_m: None,
        published_velocity: PublishedVelocity::Gamma,
        limits: None,
        avoidance: AvoidanceBrief {
            kind: "guard".into(),
            distance_min_m: 0.2,
            speed_max_m_s: 0.5,
            sensing_radius_m: f64::INFINITY,
            sensing_error_m: 0.0,
            heading_error_rad: 0.0,
            braking_time_max_s: 0.0,
            clearance_m: 0.0,
            gains: Default::default(),
        },
        silence: SilenceBrief {
            stale_after_ns: 1,
            lost_after_ns: 1,
            policy: SilencePolicy::Ignore,
        },
        slow: Vec::new(),
        odometry_faults: Vec::new(),
        command_faults: Vec::new(),
        links_by_hand: false,
        goals_from_outside: false,
        neighbors: Vec::new(),
    }
}

pub(in super::super) fn sample(stamp_ns: u64, heading_rad: f64, away: &[Vec2]) -> Sample<'_> {
    Sample {
        stamp_ns,
        t_s: stamp_ns as f64 / 1e9,
        heading_rad,
        heading_effect_rad: heading_rad,
        twist: Twist::ZERO,
        away,
        proximity_valid: true,
        proximity_cut: false,
        velocities: &[],
        walls: &[],
        walls_cut: false,
        error: None,
    }
}

#[test]
fn no_guard_is_made_of_a_brief_outside_its_proof() {
    let refused = |change: &dyn Fn(&mut AvoidanceBrief)| {
        let mut brief = brief();
        change(&mut brief.avoidance);
        super::super::build(&brief).err().map(|why| why.to_string())
    };
    let needed_m = sensing_radius_m(&Conditions::of(&brief()));
    assert_eq!(refused(&|a| a.sensing_radius_m = needed_m), None);
    let nearly = refused(&|a| a.sensing_radius_m = needed_m.next_down()).unwrap();
    assert!(nearly.contains("\"guard\" sees too late"), "{nearly}");
    assert!(refused(&|a| a.sensing_radius_m = f64::NAN).unwrap().contains("sees too late"));
    // Errors of the sensors ask for a larger radius.
    let erring: [&dyn Fn(&mut AvoidanceBrief); 2] =
        [&|a| a.sensing_error_m = 0.01, &|a| a.heading_error_rad = 0.01];
    for err in erring {
        assert!(
            refused(&|a| {
                a.sensing_radius_m = needed_m;
                err(a);
            })
            .is_some()
        );
    }
    assert!(refused(&|a| a.speed_max_m_s = f64::INFINITY).unwrap().contains("a speed limit"));
}

/// A direction, rad.
fn direction() -> impl Strategy<Value = f64> {
    -3.2..3.2f64
}

/// How fast to go, in v_max, and where to, rad.
fn drive() -> impl Strategy<Value = (f64, f64)> {
    (direction(), prop_oneof![Just(1.0), 0.0..1.0f64])
}

/// Another robot, or a wall.
#[derive(Debug, Clone)]
struct Other {
    /// A segment across the way to it, that ends so far to either side, m; it stands.
    wall: Option<[f64; 2]>,
    /// How far beyond d it is at the first sample, in v_max H.
    far: f64,
    /// In which direction, rad.
    direction: f64,
    /// Where it drives at v_max, rad.
    course: f64,
    /// Where it is reported, off its place: at each sample, a direction, rad.
    reported_off: [f64; 2],
}

fn others() -> impl Strategy<Value = Vec<Other>> {
    let far = prop_oneof![1 => Just(0.0), 3 => 0.0..3.0f64];
    let reported_off = [direction(), direction()];
    let wall = proptest::option::of([0.0..0.5f64, 1e-3..0.5f64]);
    let other = (far, direction(), direction(), reported_off, wall).prop_map(
        |(far, direction, course, reported_off, wall)| Other {
            wall,
            far,
            direction,
            course,
            reported_off,
        },
    );
    proptest::collection::vec(other, 1..5)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6000))]

    /// The lemma that the proof rests on. Two samples less than H apart; the plant obeys the
    /// answer to the first one until that to the second takes effect, at whatever moment. After
    /// a restart it obeys some command of the robot's predecessor before. Wheels that are too weak
    /// make of each command a slower one of the same path.
    #[test]
    fn while_a_command_acts_it_approaches_nobody_faster_than_its_share_of_the_slack(
        d in 0.1..0.4f64,
        clearance in 0.05..0.4f64,
        // v_max H in units of min(d/4, ell/2), the advised limit. The claim holds above it too.
        steps in prop_oneof![0.05..1.0f64, 1.0..6.0f64],
        ell in 0.03..0.2f64,
        period_share in 0.1..0.9f64,
        error_m in prop_oneof![Just(0.0), 0.0..0.05f64],
        heading_error in prop_oneof![Just(0.0), 0.0..0.5f64],
        headings_off in [-1.0..1.0f64, -1.0..1.0f64], // at each sample, in heading_error
        others in others(),
        heading_rad in -3.1..3.1f64,
        wishes in [drive(), drive()],
        bounds_alone in any::<bool>(),
        predecessor in proptest::option::of(drive()),
        wheels in prop_oneof![Just([1.0, 1.0]), [0.2..1.0f64, 0.2..1.0f64]],
        second in 0.05..0.95f64,   // the second sample's stamp, in H after the first
        effects in [0.0..1.0f64, 0.0..1.0f64], // when each takes effect, in H after its stamp
    ) {
        let lifetime = 0.02;
        let v_max = steps * (0.25 * d).min(0.5 * ell) / lifetime;
        let period = period_share * lifetime.min(ell / v_max);
        let mut brief = brief();
        brief.command_lifetime_ns = 20_000_000;
        brief.period_ns = (period * 1e9) as u64;
        brief.front_point_m = ell;
        brief.avoidance.distance_min_m = d;
        brief.avoidance.clearance_m = clearance;
        brief.avoidance.speed_max_m_s = v_max;
        brief.avoidance.sensing_error_m = error_m;
        brief.avoidance.heading_error_rad = heading_error;
        let mut guard = Guard::new(&brief);
        let first_ns = 1_000_000_000;
        let start = Pose { x_m: 0.0, y_m: 0.0, heading_rad };
        let driven = |(angle, share): (f64, f64)| {
            let body = rotate(angle, Vec2::new(share * v_max, 0.0));
            Twist { v_m_s: body.x, w_rad_s: body.y / ell }
        };
        let before = predecessor.map_or(Twist::ZERO, driven);
        if predecessor.is_none() {
            // Its first sample is long ago: no predecessor's command is alive.
            guard.steer(&sample(0, heading_rad, &[]), Vec2::zeros());
        }

        let alpha = front_point(start, ell);
        let at_angle = |length: f64, angle: f64| rotate(angle, Vec2::new(length, 0.0));
        let kept = |other: &Other| if other.wall.is_some() { clearance } else { d };
        // Its point that is nearest to `from`.
        let other_at = |other: &Other, t: f64, from: Vec2| {
            let far = kept(other) + other.far * v_max * lifetime;
            let place = alpha + at_angle(far, other.direction);
            let Some([left, right]) = other.wall else {
                return place + t * at_angle(v_max, other.course);
            };
            let ends = [left, -right].map(|way| (place + at_angle(way, other.direction + 0.5 * PI)).into());
            Obstacle::segment(ends[0], ends[1]).nearest(from)
        };
        let mut answer = |which: usize, t: f64, pose: Pose| {
            let heading_rad = pose.heading_rad + headings_off[which] * heading_error;
            let alpha = front_point(Pose { heading_rad, ..pose }, ell);
            let reported = |other: &Other| {
                // What is nearest is so to where the front point really is.
                let point = other_at(other, t, front_point(pose, ell));
                alpha - point + at_angle(error_m, other.reported_off[which])
            };
            let near = |walls: bool| {
                let some = others.iter().filter(|other| other.wall.is_some() == walls);
                let mut near: Vec<Vec2> = some.map(reported).collect();
                near.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
                near
            };
            let (away, walls) = (near(false), near(true));
            let stamp_ns = first_ns + (t * 1e9) as u64;
            let sample = Sample { walls: &walls, ..sample(stamp_ns, heading_rad, &away) };
            if bounds_alone {
                // As if all that leads around others had failed.
                guard.forget_the_dead(stamp_ns);
                let granted = guard.bound(&sample, driven(wishes[which]));
                guard.alive.push_back((stamp_ns, granted));
                granted
            } else {
                let (angle, share) = wishes[which];
                guard.steer(&sample, at_angle(share * v_max, angle))
            }
        };

        let one = answer(0, 0.0, start);
        let t_second = second * lifetime;
        let t_one = effects[0] * t_second;
        let moved = arc(start, before, t_one);
        let turned = arc(moved, one.scaled(wheels[0]), t_second - t_one);
        let two = answer(1, t_second, turned);

        let dies_one = lifetime;
        let t_two = t_second + effects[1] * lifetime;
        let dies_two = t_second + lifetime;
        let stands_from = dies_one.min(t_two);
        let before_two = arc(turned, one.scaled(wheels[0]), stands_from - t_second);

        // (from, until, pose and twist from then on, and its command's sample: time and pose,
        // fastest own command)
        let fastest_one = front_speed(ell, one).max(front_speed(ell, before));
        let fastest_two = front_speed(ell, one).max(front_speed(ell, two));
        let acting = [
            (t_one, stands_from, moved, one.scaled(wheels[0]), 0.0, start, fastest_one),
            (t_two, dies_two, before_two, two.scaled(wheels[1]), t_second, turned, fastest_two),
        ];
        for (from, until, pose, twist, sampled, sampled_pose, v_own) in acting {
            for k in 0..=20 {
                let t = from + (until - from) * f64::from(k) / 20.0;
                let now = arc(pose, twist, t - from);
                let velocity = front_velocity(now.heading_rad, ell, twist);
                for other in &others {
                    let alpha = front_point(sampled_pose, ell);
                    let r = (alpha - other_at(other, sampled, alpha)).norm();
                    let rho = (r - kept(other)).max(0.0);
                    // A wall does not come, and leaves all of the slack.
                    let (its_speed, share) = if other.wall.is_some() { (0.0, 2.0) } else { (v_max, 1.0) };
                    let reach = (its_speed + v_own) * lifetime; // M
                    let b = share * (rho * (-2.0f64).exp()).max(rho - reach) / lifetime;
                    let alpha = front_point(now, ell);
                    let z = alpha - other_at(other, t, alpha);
                    let approach = -z.normalize().dot(&velocity);
                    prop_assert!(approach <= b + 1e-9, "{approach} > {b} at {t}");
                }
            }
        }
    }
}

#[test]
fn a_robot_that_may_not_see_everybody_who_matters_stands() {
    let needed = Guard::new(&brief()).kept.robots_radius;
    let (inside, beyond) = ([Vec2::new(0.99 * needed, 0.0)], [Vec2::new(1.01 * needed, 0.0)]);
    for (valid, cut, away, moves) in [
        (true, false, &[][..], true),
        (true, false, &inside, true),
        (true, true, &beyond, true),
        (true, true, &[Vec2::new(needed, 0.0)], true),
        // Others that were left out may be nearer than they matter from.
        (true, true, &inside, false),
        (true, true, &[], false),
        (false, false, &[], false),
        (false, false, &inside, false),
        (false, true, &beyond, false),
    ] {
        let mut guard = Guard::new(&brief());
        let seen = Sample {
            proximity_valid: valid,
            proximity_cut: cut,
            ..sample(1_000_000_000, 0.0, away)
        };
        // Whoever is near is behind it.
        let twist = guard.steer(&seen, Vec2::new(0.3, 0.0));
        let wanted = if moves { Twist { v_m_s: 0.3, w_rad_s: 0.0 } } else { Twist::ZERO };
        let off = (twist.v_m_s - wanted.v_m_s).hypot(twist.w_rad_s - wanted.w_rad_s);
        assert!(off < 1e-12, "valid: {valid}, cut: {cut}, {away:?}: {twist:?}");
    }
}

#[test]
fn a_robot_that_may_not_see_every_wall_that_matters_stands() {
    let mut brief = brief();
    brief.avoidance.clearance_m = 0.1;
    let needed = Guard::new(&brief).kept.walls_radius;
    // The clearance + 1.5 v_max H is less than c_f + 4 v_max T: 0.1 + 0.75 v_max H + 0.02.
    assert!((needed - (0.1 + 0.009375 + 0.02)).abs() < 1e-12, "{needed}");
    let (inside, beyond) = ([Vec2::new(0.99 * needed, 0.0)], [Vec2::new(1.01 * needed, 0.0)]);
    for (cut, walls, moves) in [
        (false, &[][..], true),
        (false, &inside, true),
        (true, &beyond, true),
        (true, &inside, false),
        (true, &[], false),
    ] {
        let seen = Sample { walls, walls_cut: cut, ..sample(1_000_000_000, 0.0, &[]) };
        for limits in [0.0, 0.1] {
            let mut brief = AgentBrief { pace: Pace::Lockstep, ..brief.clone() };
            brief.avoidance.braking_time_max_s = limits;
            let mut guard = super::super::build(&brief).unwrap();
            let far = limits > 0.0 && walls == beyond;
            let stands = guard.steer(&seen, Vec2::new(0.3, 0.0)) == Twist::ZERO;
            assert!(far || stands != moves, "cut: {cut}, {walls:?}, {limits}");
        }
    }
}

#[test]
fn along_a_wall_a_robot_is_led_to_the_side_that_it_wants_and_no_nearer_than_c_f() {
    let mut brief = brief();
    brief.avoidance.clearance_m = 0.1;
    let guard = Guard::new(&brief);
    let c_f = 0.109375; // 0.75 v_max H
    let led = |far: f64, p: Vec2| {
        let walls = [rotate(0.7, Vec2::new(-far, 0.0))]; // ahead, turned by 0.7
        rotate(
            -0.7,
            guard
                .deflection
                .deflect(&Sample { walls: &walls, ..sample(0, 0.0, &[]) }, rotate(0.7, p)),
        )
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

#[test]
fn one_that_gives_way_is_led_around_from_farther_away_and_asks_for_a_wider_view() {
    let [keeps, gives] = [Rank::First, Rank::Contained].map(of_rank);
    let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
    assert!((keeps.deflection.d_f - expected_d_f).abs() < 1e-12, "{}", keeps.deflection.d_f);
    assert!((of_rank(Rank::Follower).deflection.d_f - 1.1 * expected_d_f).abs() < 1e-12);
    assert!((gives.deflection.d_f - 1.12 * expected_d_f).abs() < 1e-12, "{}", gives.deflection.d_f);
    assert!((gives.kept.robots_radius - (gives.deflection.d_f + 4.0 * 0.3 * 0.005)).abs() < 1e-12);

    // The other stands ahead, between the two d_f; both want to go there.
    let (ahead, away) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
    let sample = sample(0, 0.0, &away);
    assert_eq!(keeps.deflection.deflect(&sample, ahead), ahead);
    let led = gives.deflection.deflect(&sample, ahead);
    assert!(led.x < 0.0 && led.y.abs() > 0.0, "back, and around: {led:?}");
}

/// d_f = 0.21 m for the first rank, 0.231 m for followers, 0.2352 m for contained robots.
fn of_rank(rank: Rank) -> Guard {
    let mut brief = AgentBrief { rank, ..brief() };
    (brief.period_ns, brief.command_lifetime_ns) = (5_000_000, 5_000_000);
    brief.avoidance.speed_max_m_s = 0.3;
    Guard::new(&brief)
}

#[test]
fn a_place_that_is_taken_is_not_asked_for_but_one_beside_it() {
    let mut guard = of_rank(Rank::Contained);
    let other = Vec2::new(1.0, 0.0); // seen from the robot
    let mut asked = |place: Vec2| -guard.stand_off(&[-other], -place); // alpha* - alpha
    let close = |found: Vec2, expected: Vec2| (found - expected).norm() < 1e-9;
    // Farther from the other than d_f, all is as it was.
    let free = other + Vec2::new(0.0, 0.2362);
    assert!(close(asked(free), free));
    // Right where the other stands: in line with it, a tenth farther away than d_f.
    assert!(close(asked(other), Vec2::new(1.0 - 1.1 * 0.2352, 0.0)));
    // Near it: on the side where the place is, without a jump where it becomes free.
    let aside = asked(other + Vec2::new(0.0, 0.1176));
    assert!(close(aside - other, rotate(0.25 * PI, Vec2::new(0.0, 1.05 * 0.2352))), "{aside:?}");
    let nearly = other + Vec2::new(0.0, 0.2352 - 1e-6);
    assert!((asked(nearly) - nearly).norm() < 1e-5, "{:?}", asked(nearly));
    // Of two the one nearer to the place counts.
    let two = [-other, -other - Vec2::new(0.0, 0.1)];
    let asked = -of_rank(Rank::Contained).stand_off(&two, -(other + Vec2::new(0.0, 0.1)));
    assert!(((asked - other).y - 0.1).abs() < 0.2352 && asked.x < 1.0, "{asked:?}");
    let from_second = asked + two[1];
    assert!((from_second.norm() - 1.1 * 0.2352).abs() < 1e-9, "{asked:?}");
    // Two sensed at one point, which d forbids, leave what was asked.
    let place = Vec2::new(0.1, 0.0);
    assert_eq!(of_rank(Rank::Contained).stand_off(&[Vec2::zeros()], -place), -place);
}

#[test]
fn whoever_leads_or_keeps_a_place_asks_for_it_whoever_stands_there() {
    let other = Vec2::new(1.0, 0.0);
    for rank in [Rank::First, Rank::Follower] {
        assert_eq!(of_rank(rank).stand_off(&[-other], -other), -other);
    }
}

#[test]
fn who_stands_off_is_held_back_and_not_led_around_until_its_place_is_free() {
    let mut guard = of_rank(Rank::Contained);
    let (ahead, away) = (Vec2::new(1.5e-3, 0.0), [Vec2::new(-0.233, 0.0)]);
    let at = |t_ns| sample(t_ns, 0.0, &away);
    let around = guard.deflection.deflect(&at(0), ahead);
    assert!(around.y.abs() > 1e-4, "{around:?}");
    guard.stand_off(&away, Vec2::new(-0.233, 0.0));
    // Neither around nor, while the dither's clock goes round, to either side.
    for t_ns in [0, 300_000_000, 900_000_000] {
        let back = guard.deflection.deflect(&at(t_ns), ahead);
        assert!(back.x < 0.0 && back.y == 0.0, "{back:?}");
    }
    guard.stand_off(&away, Vec2::new(-1.0, 0.0));
    assert_eq!(guard.deflection.deflect(&at(0), ahead), around);
}

#[test]
fn who_stands_off_gives_way_to_others_from_farther_away_than_to_whoever_has_its_place() {
    let mut guard = of_rank(Rank::Contained);
    let taker = Vec2::new(-0.25, 0.0); // ahead; both nearer than d_s, and farther away than d_f
    let beside = Vec2::new(0.0, -0.257);
    let moved = |guard: &Guard, away: &[Vec2]| {
        guard.deflection.deflect(&sample(0, 0.0, away), Vec2::zeros())
    };
    guard.stand_off(&[taker, beside], taker);
    assert_eq!(moved(&guard, &[taker]), Vec2::zeros());
    let back = 0.25 * (1.1 * 0.2352 - 0.257);
    assert!((moved(&guard, &[taker, beside]) - Vec2::new(0.0, -back)).norm() < 1e-12);
    guard.stand_off(&[taker, beside], Vec2::new(1.0, 1.0));
    assert_eq!(moved(&guard, &[taker, beside]), Vec2::zeros());
}

proptest! {
    /// The promise is the same for every rank: whatever is wanted, both are granted the same.
    #[test]
    fn the_bound_does_not_know_who_gives_way(near in others(), (angle, share) in drive()) {
        let brief = brief();
        let gives_way = AgentBrief { rank: Rank::Contained, ..brief.clone() };
        let away: Vec<Vec2> = { near }
            .iter()
            .map(|near| rotate(near.direction, Vec2::new(0.2 + 0.0125 * near.far, 0.0)))
            .collect();
        let sample = sample(0, 0.4, &away);
        let body = rotate(angle, Vec2::new(0.5 * share, 0.0));
        let wanted = Twist { v_m_s: body.x, w_rad_s: body.y / 0.1 };
        let [keeps, gives] =
            [&brief, &gives_way].map(|brief| Guard::new(brief).bound(&sample, wanted));
        prop_assert_eq!(keeps, gives);
    }
}
#[test]
fn its_figures_are_those_of_the_documentation() {
    let figures = |period_s: f64, ell: f64, v_max: f64| {
        let mut brief = brief();
        brief.period_ns = (period_s * 1e9) as u64;
        brief.front_point_m = ell;
        brief.avoidance.speed_max_m_s = v_max;
        let at = Conditions::of(&brief);
        [deflection_distance_m(&at), sensing_radius_m(&at), speed_cap_m_s(&at)]
    };
    let near = |found: [f64; 3], expected: [f64; 3]| {
        let off = found.iter().zip(expected).map(|(found, expected)| (found - expected).abs());
        assert!(off.fold(0.0, f64::max) < 1e-12, "{found:?} is not {expected:?}");
    };
    // d + 1.5 v_max H; d_f + 4 v_max T; d/4 and ell/2 over H.
    near(figures(0.01, 0.2, 0.5), [0.21875, 0.23875, 2.0]);
    near(figures(0.01, 0.08, 0.5), [0.21875, 0.23875, 1.6]);
    // d + 3 v_max H is more, and 1.05 d.
    near(figures(0.001, 0.2, 0.5), [0.21875, 0.2375, 2.0]);
    near(figures(0.001, 0.2, 0.2), [0.21, 0.215, 2.0]);
}

#[test]
fn more_than_the_advised_speed_is_advised_against_and_the_advised_one_is_not() {
    let advice = |v_max: f64| {
        let mut brief = brief();
        brief.avoidance.speed_max_m_s = v_max;
        braking(&Conditions::of(&brief))
    };
    assert_eq!((advice(1.9), advice(2.0), advice(f64::INFINITY)), (None, None, None));
    let Advice { key, message, expected } = advice(2.5).unwrap();
    assert_eq!(key, "speed_max_m_s");
    assert!(
        message.contains("2.5 m/s is above") && expected.contains("at most 2 m/s"),
        "{message}"
    );
}

#[test]
fn with_nobody_near_the_front_point_moves_by_gamma_and_never_faster_than_v_max() {
    let mut guard = Guard::new(&brief());
    guard.steer(&sample(0, 0.0, &[]), Vec2::zeros());
    assert!((guard.admit(Vec2::new(3.0, 4.0)) - Vec2::new(0.3, 0.4)).norm() < 1e-15);
    let gamma = Vec2::new(0.1, 0.3);
    let twist = guard.follow(0.7, gamma);
    assert_eq!(twist, exact_hold(0.7, 0.1, 0.01 * gamma, 0.01));
    assert_eq!(guard.steer(&sample(1_000_000_000, 0.7, &[]), gamma), twist);
    // Sideways the arc is longer than its chord: the twist is slowed down to the limit.
    let twist = guard.steer(&sample(2_000_000_000, 0.0, &[]), Vec2::new(0.0, 0.5));
    let literal = exact_hold(0.0, 0.1, Vec2::new(0.0, 0.005), 0.01);
    assert!(front_speed(0.1, literal) > 0.5 + 1e-6);
    assert!((front_speed(0.1, twist) - 0.5).abs() < 1e-12, "{twist:?}");
    assert!((twist.w_rad_s * literal.v_m_s - twist.v_m_s * literal.w_rad_s).abs() < 1e-12);
}

#[test]
fn a_command_is_remembered_for_as_long_as_it_may_act_and_a_predecessors_only_in_real_time() {
    let stamps = [1_000_000_000, 1_010_000_000, 1_025_000_000, 2_000_000_000];
    let mut guard = Guard::new(&brief());
    let remembered = stamps.map(|stamp_ns| {
        guard.steer(&sample(stamp_ns, 0.0, &[]), Vec2::zeros());
        guard.alive.iter().map(|(answered_ns, _)| *answered_ns).collect::<Vec<u64>>()
    });
    let [a, b, c, d] = stamps;
    // The first dies at 1.025 s: it acts no more at the sample of that instant.
    assert_eq!(remembered, [vec![a], vec![a, b], vec![b, c], vec![d]]);
    assert_eq!(guard.predecessor_until_ns, Some(1_025_000_000));
    let mut lockstep = Guard::new(&AgentBrief { pace: Pace::Lockstep, ..brief() });
    lockstep.steer(&sample(0, 0.0, &[]), Vec2::zeros());
    assert_eq!(lockstep.predecessor_until_ns, None);
}

/// All of it turned by an angle at which no component is 0.
#[test]
fn one_in_the_way_is_gone_around_by_a_focus_that_is_as_strong_as_needed() {
    let guard = Guard::new(&AgentBrief { index: 2, ..brief() });
    assert!((guard.deflection.dither_phase - 0.236_067_977_4).abs() < 1e-9);
    assert!(
        (guard.deflection.dither_period - 1.5 * (1.0 + 4.0 * 0.236_067_977_4 / 3.0)).abs() < 1e-9
    );
    let turned = |x: f64, y: f64| rotate(0.7, Vec2::new(x, y));
    // The instant at which the dither has gone through this many of its periods.
    let at = |turns: f64| (turns - guard.deflection.dither_phase) * guard.deflection.dither_period;
    let deflect = |turns: f64, away: &[Vec2], p: Vec2| {
        guard.deflection.deflect(&Sample { t_s: at(turns), ..sample(0, 0.0, away) }, p)
    };
    let near = |found: Vec2, expected: Vec2| {
        assert!((found - expected).norm() < 1e-12, "{found:?} is not {expected:?}");
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
    // At the same place there is no direction to go around by.
    assert!(deflect(3.0, &[Vec2::zeros()], turned(reach, 0.0)).norm() <= reach);
}

/// By how much the angle `to` may be less than `reach` away from `from`, rad: 0 if it is.
fn beyond(from: f64, to: f64, reach: f64) -> f64 {
    (wrap_angle(from - to).abs() - reach).max(0.0)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6000))]

    /// What the lemma above meets by chance, at its worst: the command granted, at every heading
    /// that it may be obeyed at, towards everybody wherever they may have gone.
    #[test]
    fn no_heading_and_no_direction_that_are_possible_make_a_command_approach_too_fast(
        steps in 0.1..2.0f64, // v_max H in min(d/4, ell/2)
        ell in 0.02..0.2f64,
        error_m in prop_oneof![Just(0.0), 0.0..0.02f64],
        heading_error in prop_oneof![Just(0.0), 0.0..0.3f64],
        others in others(),
        heading_rad in direction(),
        wanted in drive(),
        alive in proptest::collection::vec(drive(), 0..3),
    ) {
        let (d, lifetime): (f64, f64) = (0.2, 0.025);
        let v_max = steps * (0.25 * d).min(0.5 * ell) / lifetime;
        let mut brief = AgentBrief { pace: Pace::Lockstep, front_point_m: ell, ..brief() };
        brief.avoidance.speed_max_m_s = v_max;
        brief.avoidance.sensing_error_m = error_m;
        brief.avoidance.heading_error_rad = heading_error;
        let mut guard = Guard::new(&brief);
        let driven = |(angle, share): (f64, f64)| {
            let body = rotate(angle, Vec2::new(share * v_max, 0.0));
            Twist { v_m_s: body.x, w_rad_s: body.y / ell }
        };
        guard.alive = alive.into_iter().map(|drive| (0, driven(drive))).collect();
        let place = |other: &Other| {
            rotate(other.direction, Vec2::new(d + other.far * v_max * lifetime, 0.0))
        };
        let away: Vec<Vec2> = others.iter().map(place).collect();
        let granted = guard.bound(&sample(0, heading_rad, &away), driven(wanted));

        let acting = || guard.alive.iter().map(|(_, twist)| *twist).chain([granted]);
        let turns = |of: fn(f64, f64) -> f64| acting().map(|twist| twist.w_rad_s).fold(0.0, of);
        let (w_low, w_high) = (turns(f64::min), turns(f64::max));
        let v_own = acting().map(|twist| front_speed(ell, twist)).fold(0.0, f64::max);
        let middle = heading_rad + 0.5 * lifetime * (w_low + w_high);
        let delta = 0.5 * lifetime * (w_high - w_low) + heading_error;
        let course = (ell * granted.w_rad_s).atan2(granted.v_m_s) + middle;
        let error_m = Conditions::of(&brief).distance_error_m();
        let reach = (v_max + v_own) * lifetime; // M
        for z in &away {
            let rho = (z.norm() - error_m - d).max(0.0);
            let b = (rho * (-2.0f64).exp()).max(rho - reach) / lifetime;
            let sine = (reach + error_m) / z.norm();
            let swing = if sine < 1.0 { sine.asin() } else { PI };
            let off = beyond((-z.y).atan2(-z.x), course, delta + swing);
            let approach = front_speed(ell, granted) * off.cos();
            prop_assert!(approach <= b + 1e-9, "{approach} > {b}: {granted:?}");
        }
    }

    /// The command is that of the scale which gets on best, by a choice made once more here.
    #[test]
    fn of_the_scales_tried_the_one_that_gets_on_best_is_granted(
        others in others(), heading_rad in direction(), wanted in drive(),
    ) {
        let mut guard = Guard::new(&AgentBrief { pace: Pace::Lockstep, ..brief() });
        let body = rotate(wanted.0, Vec2::new(0.5 * wanted.1, 0.0));
        let wanted = Twist { v_m_s: body.x, w_rad_s: body.y / 0.1 };
        let place = |other: &Other| rotate(other.direction, Vec2::new(0.2 + 0.0125 * other.far, 0.0));
        let away: Vec<Vec2> = others.iter().map(place).collect();
        let sample = sample(0, heading_rad, &away);
        let granted = guard.bound(&sample, wanted);
        let tried = [1.0, 0.5, 0.25].map(|sigma| guard.grant(&sample, wanted.scaled(sigma)));
        let merit = |twist: Twist| {
            twist.v_m_s * wanted.v_m_s + 0.1 * twist.w_rad_s * (0.1 * wanted.w_rad_s)
        };
        if tried[0] == wanted {
            prop_assert_eq!(granted, wanted);
        } else if tried.iter().all(|twist| merit(*twist) <= 0.0) {
            prop_assert_eq!(granted, tried[0]);
        } else {
            let best = tried.into_iter().map(merit).fold(0.0, f64::max);
            prop_assert!(tried.contains(&granted));
            prop_assert!((merit(granted) - best).abs() < 1e-12, "{granted:?} of {tried:?}");
        }
    }
}

#[test]
fn straight_at_somebody_it_goes_as_fast_as_its_share_of_the_slack_allows_and_no_slower() {
    let (d, v_max, lifetime) = (0.2, 0.5, 0.025);
    for slack_m in [0.0, 0.001, 0.005, 0.01, 0.02, 0.03, 0.1] {
        let mut guard = Guard::new(&AgentBrief { pace: Pace::Lockstep, ..brief() });
        let away = [Vec2::new(-(d + slack_m), 0.0)];
        let wanted = Twist { v_m_s: v_max, w_rad_s: 0.0 };
        let granted = guard.bound(&sample(0, 0.0, &away), wanted);
        let at_scale = |sigma: f64| {
            let reach = (1.0 + sigma) * v_max * lifetime; // M
            let b = (slack_m * (-2.0f64).exp()).max(slack_m - reach) / lifetime;
            let half_step = 0.5 * (reach / (d + slack_m)).asin();
            (sigma * v_max).min(if b < sigma * v_max { b * half_step.cos() } else { f64::MAX })
        };
        let expected = [1.0, 0.5, 0.25].map(at_scale).into_iter().fold(0.0, f64::max);
        assert!((granted.v_m_s - expected).abs() < 1e-6, "{slack_m}: {granted:?}, {expected}");
        assert!(granted.w_rad_s.abs() < 1e-6, "{granted:?}");
    }
}

#[test]
fn a_predecessors_commands_count_as_the_worst_there_can_be_for_as_long_as_they_may_act() {
    let stamp_ns = 1_000_000_000;
    let away = [Vec2::new(-0.21, 0.02)];
    let tried = Twist { v_m_s: 0.3, w_rad_s: 1.0 };
    // In the air since just now, or for H.
    let granted_after = |since_ns: u64| {
        let mut guard = Guard::new(&brief());
        guard.forget_the_dead(stamp_ns - since_ns);
        guard.grant(&sample(stamp_ns, 0.2, &away), tried)
    };
    let granted_beside = |alive: &[f64]| {
        let mut guard = Guard::new(&AgentBrief { pace: Pace::Lockstep, ..brief() });
        guard.alive = { alive }.iter().map(|&w_rad_s| (0, Twist { v_m_s: 0.0, w_rad_s })).collect();
        guard.grant(&sample(stamp_ns, 0.2, &away), tried)
    };
    // v_max / ell = 5 rad/s.
    assert_eq!(granted_after(0), granted_beside(&[-5.0, 5.0]));
    assert_eq!(granted_after(24_999_999), granted_beside(&[-5.0, 5.0]));
    assert_eq!(granted_after(25_000_000), granted_beside(&[]));
    assert_ne!(granted_beside(&[-5.0, 5.0]), granted_beside(&[]));
    assert_ne!(granted_beside(&[-5.0, 5.0]), granted_beside(&[5.0]));
}

#[test]
fn a_robot_must_see_as_far_as_the_bound_beside_walls_asks_for_even_where_robots_ask_for_less() {
    let mut far = brief();
    far.command_lifetime_ns = 100_000_000;
    far.avoidance.clearance_m = 1.0;
    // The clearance + 3/2 v_max H; from there on b is at least v_max.
    let radius_m = sensing_radius_m(&Conditions::of(&far));
    assert!((radius_m - 1.075).abs() < 1e-12, "{radius_m}");
    // What robots ask for, d + 3 v_max H, is all there is without walls.
    far.avoidance.clearance_m = 0.0;
    let radius_m = sensing_radius_m(&Conditions::of(&far));
    assert!((radius_m - 0.35).abs() < 1e-12, "{radius_m}");
}
