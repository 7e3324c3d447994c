//! The lemma that the guard's proof rests on, when a robot stands because it does not see enough,
//! and the figures by which it is led around others.

use formation::front_point::{front_point, front_velocity};
use formation::pose::Pose;
use formation::unicycle::arc;
use proptest::prelude::*;
use protocol::brief::{AvoidanceBrief, Format, PublishedVelocity, SilenceBrief, SilencePolicy};

use super::*;

/// d = 0.2 m, v_max = 0.5 m/s, ell = 0.1 m, T = 10 ms, H = 25 ms, exact sensors.
pub(super) fn brief() -> AgentBrief {
    AgentBrief {
        format: Format,
        name: "r1".into(),
        index: 1,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        period_ns: 10_000_000,
        plant_tick_ns: 1_000_000,
        command_lifetime_ns: 25_000_000,
        front_point_m: 0.1,
        law: String::new(),
        gains: Default::default(),
        led: false,
        rank: Rank::First,
        lead: None,
        published_velocity: PublishedVelocity::Gamma,
        avoidance: AvoidanceBrief {
            kind: "guard".into(),
            distance_min_m: 0.2,
            speed_max_m_s: 0.5,
            sensing_radius_m: f64::INFINITY,
            sensing_error_m: 0.0,
            heading_error_rad: 0.0,
            gains: Default::default(),
        },
        silence: SilenceBrief {
            stale_after_ns: 1,
            lost_after_ns: 1,
            policy: SilencePolicy::Ignore,
        },
        slow: Vec::new(),
        links_by_hand: false,
        neighbors: Vec::new(),
    }
}

fn sample(stamp_ns: u64, heading_rad: f64, away: &[Vec2]) -> Sample<'_> {
    Sample {
        stamp_ns,
        t_s: stamp_ns as f64 / 1e9,
        heading_rad,
        heading_effect_rad: heading_rad,
        away,
        proximity_valid: true,
        proximity_cut: false,
        velocities: &[],
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

/// Another robot.
#[derive(Debug, Clone)]
struct Other {
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
    let other = (far, direction(), direction(), reported_off).prop_map(
        |(far, direction, course, reported_off)| Other { far, direction, course, reported_off },
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
        let other_at = |other: &Other, t: f64| {
            let place = alpha + at_angle(d + other.far * v_max * lifetime, other.direction);
            place + t * at_angle(v_max, other.course)
        };
        let mut answer = |which: usize, t: f64, pose: Pose| {
            let heading_rad = pose.heading_rad + headings_off[which] * heading_error;
            let alpha = front_point(Pose { heading_rad, ..pose }, ell);
            let reported = |other: &Other| {
                alpha - other_at(other, t) + at_angle(error_m, other.reported_off[which])
            };
            let mut away: Vec<Vec2> = others.iter().map(reported).collect();
            away.sort_by(|a, b| a.norm().total_cmp(&b.norm()));
            let stamp_ns = first_ns + (t * 1e9) as u64;
            let sample = sample(stamp_ns, heading_rad, &away);
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
                    let r = (front_point(sampled_pose, ell) - other_at(other, sampled)).norm();
                    let rho = (r - d).max(0.0);
                    let reach = (v_max + v_own) * lifetime; // M
                    let b = (rho * (-2.0f64).exp()).max(rho - reach) / lifetime;
                    let z = front_point(now, ell) - other_at(other, t);
                    let approach = -z.normalize().dot(&velocity);
                    prop_assert!(approach <= b + 1e-9, "{approach} > {b} at {t}");
                }
            }
        }
    }
}

#[test]
fn a_robot_that_may_not_see_everybody_who_matters_stands() {
    let needed = Guard::new(&brief()).radius_needed;
    let (inside, beyond) = ([Vec2::new(0.99 * needed, 0.0)], [Vec2::new(1.01 * needed, 0.0)]);
    for (valid, cut, away, moves) in [
        (true, false, &[][..], true),
        (true, false, &inside, true),
        (true, true, &beyond, true),
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
fn one_that_gives_way_is_led_around_from_farther_away_and_asks_for_a_wider_view() {
    let [keeps, gives] = [Rank::First, Rank::Contained].map(of_rank);
    let expected_d_f = 0.21; // 0.05 d is more than 1.5 v_max H
    assert!((keeps.d_f - expected_d_f).abs() < 1e-12, "{}", keeps.d_f);
    assert!((of_rank(Rank::Follower).d_f - 1.1 * expected_d_f).abs() < 1e-12);
    assert!((gives.d_f - 1.2 * expected_d_f).abs() < 1e-12, "{}", gives.d_f);
    assert!((gives.radius_needed - (gives.d_f + 4.0 * 0.3 * 0.005)).abs() < 1e-12);

    // The other stands ahead, between the two d_f; both want to go there.
    let (ahead, away) = (Vec2::new(1e-3, 0.0), [Vec2::new(-0.23, 0.0)]);
    let sample = sample(0, 0.0, &away);
    assert_eq!(keeps.deflect(&sample, ahead), ahead);
    let led = gives.deflect(&sample, ahead);
    assert!(led.x < 0.0 && led.y.abs() > 0.0, "back, and around: {led:?}");
}

/// d_f = 0.21 m for the first rank, 0.231 m for followers, 0.252 m for contained robots.
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
    let free = other + Vec2::new(0.0, 0.253);
    assert!(close(asked(free), free));
    // Right where the other stands: in line with it.
    assert!(close(asked(other), Vec2::new(1.0 - 0.252, 0.0)));
    // Near it: on the side where the place is, without a jump where it becomes free.
    let aside = asked(other + Vec2::new(0.0, 0.126));
    assert!(((aside - other).norm() - 0.252).abs() < 1e-9, "{aside:?}");
    assert!(close(aside - other, rotate(0.25 * PI, Vec2::new(0.0, 0.252))));
    let nearly = other + Vec2::new(0.0, 0.252 - 1e-6);
    assert!((asked(nearly) - nearly).norm() < 1e-5, "{:?}", asked(nearly));
    // Of two the one nearer to the place counts.
    let two = [-other, -other - Vec2::new(0.0, 0.1)];
    let asked = -of_rank(Rank::Contained).stand_off(&two, -(other + Vec2::new(0.0, 0.1)));
    assert!(((asked - other).y - 0.1).abs() < 0.252 && asked.x < 1.0, "{asked:?}");
    let from_second = asked + two[1];
    assert!((from_second.norm() - 0.252).abs() < 1e-9, "{asked:?}");
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
    let (ahead, away) = (Vec2::new(1.5e-3, 0.0), [Vec2::new(-0.25, 0.0)]);
    let at = |t_ns| sample(t_ns, 0.0, &away);
    let around = guard.deflect(&at(0), ahead);
    assert!(around.y.abs() > 1e-4, "{around:?}");
    guard.stand_off(&away, Vec2::new(-0.25, 0.0));
    // Neither around nor, while the dither's clock goes round, to either side.
    for t_ns in [0, 300_000_000, 900_000_000] {
        let back = guard.deflect(&at(t_ns), ahead);
        assert!(back.x < 0.0 && back.y == 0.0, "{back:?}");
    }
    guard.stand_off(&away, Vec2::new(-1.0, 0.0));
    assert_eq!(guard.deflect(&at(0), ahead), around);
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
