//! Tests with texts of briefs: no text makes a process panic.

use formation::drive::DriveKind;
use formation::random::draw_unit_by_number;
use formation::trajectory::Trajectory;

use super::*;
use crate::fault::{
    Lie, LinkFaultKind, MessageLie, Sensor, SensorFaultKind, SlowFault, Span, WheelFault,
    WheelFaultKind,
};
use crate::law_message::MessageArray;

const SPAN: Span = Span { from_ns: 5, until_ns: 9 };

/// Returns a motion that stands still.
fn lead_at_rest(center_m: [f64; 2]) -> LeadBrief {
    LeadBrief {
        scale: Scale::CONSTANT_ONE,
        trajectory: Trajectory::Still { center_m },
        keep_heading: false,
    }
}

fn avoidance() -> AvoidanceBrief {
    AvoidanceBrief {
        kind: "focus".into(),
        distance_min_m: 0.2,
        speed_max_m_s: 0.3,
        sensing_radius_m: 0.3,
        sensing_error_m: 0.0,
        heading_error_rad: 0.1,
        braking_time_max_s: 0.5,
        clearance_m: 0.0,
        command_timeout_max_s: 0.05,
        classes: vec![RobotClassBrief { distance_min_m: 0.15, speed_max_m_s: 0.5 }],
        gains: [("epsilon_per_s".into(), 1.0)].into(),
    }
}

fn deputy() -> DeputyBrief {
    DeputyBrief {
        rank: 1,
        place_m: [0.5, -0.25],
        front_point_m: 0.2,
        drive_kind: DriveKind::Differential,
        turn_rate_max_rad_s: Some(3.0),
        turning_radius_min_m: Some(0.5),
        limits: None,
        lead: lead_at_rest([1.0, 2.0]),
    }
}

fn link_fault(kind: LinkFaultKind) -> LinkFault {
    LinkFault { span: SPAN, kind, seed: 3 }
}

const LIE: Lie = Lie {
    by_m: [0.0; 2],
    drift_m_s: [0.0; 2],
    random_m: 0.0,
    turn_rad: 0.5,
    message: MessageLie { scale: 1.0, offset: 0.5, noise: 0.0, bit_flips: 0.0 },
};

fn neighbor() -> NeighborBrief {
    NeighborBrief {
        name: "r2".into(),
        index: 2,
        offset_m: [0.15, 0.25],
        faults: vec![
            link_fault(LinkFaultKind::Cut),
            link_fault(LinkFaultKind::Delay { delay_ns: 1, jitter_ns: 2 }),
        ],
        trusted: false,
        message: Some(MessageFormat::with_arrays(vec![MessageArray {
            name: "plan_m".into(),
            shape: vec![20, 2].into(),
        }])),
        replaces: vec![2, 2],
        range: Some(RangeBrief { radius_m: 1.0, hysteresis_m: 0.05 }),
        params: toml::toml! { weight = 0.5 },
        lies: vec![LieFault { span: SPAN, lie: LIE, seed: 5 }],
    }
}

fn spare() -> NeighborBrief {
    NeighborBrief {
        name: "r3".into(),
        index: 3,
        offset_m: [0.25, 0.5],
        faults: Vec::new(),
        lies: Vec::new(),
        trusted: true,
        message: None,
        replaces: Vec::new(),
        range: None,
        params: toml::Table::new(),
    }
}

fn agent() -> AgentBrief {
    AgentBrief {
        format: FormatVersion,
        name: "r1".into(),
        index: 1,
        run_root: "/nowhere".into(),
        pace: Pace::Realtime,
        period_ns: 5_000_000,
        plant_tick_ns: 1_000_000,
        command_lifetime_ns: 13_000_000,
        late_ns: 4_000_000,
        front_point_m: 0.045,
        drive_kind: DriveKind::Differential,
        turn_rate_max_rad_s: Some(4.0),
        turning_radius_min_m: Some(0.5),
        law: "formation-unit".into(),
        gains: [("speed_m_s".into(), 0.1)].into(),
        seed: 7,
        place_m: Some([0.5, 1.0]),
        params: toml::toml! { weights = [1, 2] },
        withholds: true,
        message_queue: 4,
        signals: vec!["cost_m2".into()],
        records_messages: true,
        counts_sent: true,
        message: Some(MessageFormat::with_bytes(9)),
        program: Some(ProgramBrief { phalanx: VERSION.into(), role: "formation".into() }),
        led: true,
        rank: YieldPriority::Contained,
        lead: Some(lead_at_rest([0.0, 1.0])),
        deputy: Some(deputy()),
        scale: Some(Scale::Closing {
            from: 2.4,
            hold_s: 40.0,
            over_s: 20.0,
            reopen_at_s: vec![90.0],
        }),
        goal_m: Some([1.0, -0.5]),
        goal_heading_rad: Some(0.5),
        published_velocity: PublishedVelocity::GammaAndBeta,
        limits: Some(AccelerationLimitsBrief {
            acceleration_m_s2: 2.5,
            turn_acceleration_rad_s2: 3.2,
            braking_time_s: 0.35,
            ramp: Ramp::Together,
        }),
        avoidance: avoidance(),
        silence: SilenceBrief {
            stale_after_ns: 15_000_000,
            lost_after_ns: 100_000_000,
            policy: SilencePolicy::Ignore,
        },
        slow: vec![SlowFault { span: SPAN, delay_ns: 7 }],
        odometry_faults: vec![link_fault(LinkFaultKind::Bursts {
            probability: 0.2,
            mean_burst_ns: 9,
        })],
        command_faults: vec![link_fault(LinkFaultKind::Fading { range_m: 4.0, exponent: 2.5 })],
        repair_after_ns: 500_000_000,
        links_by_hand: true,
        goals_from_outside: true,
        neighbors: vec![neighbor()],
        spares: vec![spare()],
        successions: vec![SuccessionBrief { leader: 2, deputies: vec![4, 1], by: vec![3] }],
    }
}

fn plant() -> PlantBrief {
    PlantBrief {
        format: FormatVersion,
        run_root: "/nowhere".into(),
        pace: Pace::Lockstep,
        duration_ns: 30_000_000_000,
        period_ns: 5_000_000,
        plant_tick_ns: 1_000_000,
        command_lifetime_ns: 13_000_000,
        distance_min_m: 0.2,
        speed_max_m_s: Some(0.3),
        sensing_radius_m: 0.3,
        velocities_sensed: true,
        clearance_m: 0.1,
        program: Some(PlantProgramBrief { phalanx: VERSION.into() }),
        obstacles: vec![
            Obstacle::Disc { center_m: [1.0, 2.0], radius_m: 0.5 },
            Obstacle::segment([0.0, 1.0], [1.0, 1.0]),
        ],
        robots: vec![BodyBrief {
            name: "r1".into(),
            front_point_m: 0.045,
            drive_kind: DriveKind::Differential,
            turn_rate_max_rad_s: Some(4.0),
            turning_radius_min_m: Some(0.5),
            member: Some(MemberBrief {
                keep_m: 0.1,
                speed_max_m_s: Some(0.2),
                command_lifetime_ns: 10_000_000,
                class: 2,
            }),
            wheels: Some(WheelsBrief { speed_max_m_s: 0.5, track_m: 0.1 }),
            limits: Some(AccelerationLimitsBrief {
                acceleration_m_s2: 1.0,
                turn_acceleration_rad_s2: 3.0,
                braking_time_s: 0.5,
                ramp: Ramp::Independent,
            }),
            start: Pose { x_m: 0.0, y_m: -0.5, heading_rad: 1.0 },
            sensor_faults: vec![SensorFault {
                span: SPAN,
                sensor: Sensor::Proximity,
                kind: SensorFaultKind::Blackout,
                seed: 1,
            }],
            wheel_faults: vec![WheelFault { span: SPAN, kind: WheelFaultKind::Stuck }],
            command_faults: vec![LinkFault { span: SPAN, kind: LinkFaultKind::Cut, seed: 5 }],
        }],
    }
}

/// Texts inserted by mutations, separated by blanks.
const TOKENS: &str = "[ ] [[ ]] { } = \" ' # . , - 0 9 e9 1e400 nan inf 0x 1979-05-27 true ä 𝔘 robot \u{0} \
    \u{feff} \n \r\n index=0 period_ns=0\n [[neighbor]]\n 99999999999999999999 -0.0";

/// Returns `original` with a few random changes, drawn by `seed`.
fn mutate_text(original: &str, seed: u64) -> String {
    let mut draw_count = 0;
    let mut below = |bound: usize| {
        draw_count += 1;
        (draw_unit_by_number(seed, draw_count) * bound as f64) as usize
    };
    let tokens: Vec<&str> = TOKENS.split(' ').collect();
    let mut text: Vec<char> = original.chars().collect();
    for _ in 0..1 + below(3) {
        let start = below(text.len() + 1);
        let length = below(4).min(text.len() - start);
        // Half of the changes delete text, which numbers and names often survive.
        let token = if below(2) == 0 { "" } else { tokens[below(tokens.len())] };
        text.splice(start..start + length, token.chars());
    }
    text.into_iter().collect()
}

/// Parses mutated texts of `original`, one for each seed. Returns the numbers of accepted and refused texts, and
/// checks that the text of an accepted brief parses again.
fn fuzz_round_trip<B: Brief>(original: &B, seeds: std::ops::Range<u64>) -> (u64, u64) {
    let text = original.to_toml();
    let (mut accepted, mut refused) = (0, 0);
    for seed in seeds {
        let mutated = mutate_text(&text, seed);
        match parse::<B>(Path::new("r1.toml"), &mutated) {
            Ok(brief) => {
                accepted += 1;
                // Compared as texts, because NaN is not equal to itself.
                let written = brief.to_toml();
                let reread: B =
                    parse(Path::new("r1.toml"), &written).expect("it reads what it wrote");
                assert_eq!(reread.to_toml(), written, "seed {seed}");
            }
            Err(error) => {
                refused += 1;
                assert!(error.to_string().starts_with("r1.toml "), "seed {seed}: {error}");
            }
        }
    }
    (accepted, refused)
}

/// `PHALANX_TIMES=500` takes minutes.
#[test]
fn mutated_briefs_never_panic_and_round_trip() {
    let texts = 2000 * std::env::var("PHALANX_TIMES").map_or(1, |times| times.parse().unwrap());
    let found = [fuzz_round_trip(&agent(), 0..texts), fuzz_round_trip(&plant(), 0..texts)];
    for (accepted, refused) in found {
        assert!(accepted > texts / 50 && refused > texts / 50, "{found:?}");
    }
}

/// Returns the message for a text in which this key has another value; `-` if it is accepted.
fn flaw_with_value<B: Brief>(original: &B, key: &str, value: &str) -> String {
    let text = original.to_toml();
    let (before, rest) = text.split_once(&format!("{key} = ")).expect("the key is there");
    let (_, after) = rest.split_once('\n').expect("it is not last");
    let changed = format!("{before}{key} = {value}\n{after}");
    parse::<B>(Path::new("r1.toml"), &changed)
        .map_or_else(|error| error.to_string(), |_| "-".into())
}

#[test]
fn value_out_of_range_names_key_and_allowed_values() {
    let error_with = |key: &str, rest: &str| format!("r1.toml is invalid: {key}{rest}");
    for (key, value, rest) in [
        ("period_ns", "0", "period_ns is 0, expected 1 to 6148914691236517205"),
        ("index", "0", "index is 0, expected 1 or more"),
        ("front_point_m", "nan", "front_point_m is NaN, expected a number of 0 or more"),
        ("front_point_m", "inf", "front_point_m is inf, expected a number of 0 or more"),
        (
            "front_point_m",
            "0.0",
            "limits.ramp is \"together\" with front_point_m = 0, expected \"independent\"",
        ),
        ("turn_rate_max_rad_s", "0.0", "turn_rate_max_rad_s is 0, expected a number above 0"),
        ("distance_min_m", "0.0", "avoidance.distance_min_m is 0, expected a number above 0"),
        (
            "sensing_error_m",
            "-0.01",
            "avoidance.sensing_error_m is -0.01, expected a number of 0 or more",
        ),
        (
            "heading_error_rad",
            "nan",
            "avoidance.heading_error_rad is NaN, expected a number of 0 or more",
        ),
        (
            "speed_max_m_s",
            "9.0",
            "avoidance.speed_max_m_s is 9, expected more than 0 and less than front_point_m / \
             period = 9 m/s",
        ),
        (
            "speed_max_m_s",
            "nan",
            "avoidance.speed_max_m_s is NaN, expected more than 0 and less than front_point_m / \
             period = 9 m/s",
        ),
        ("acceleration_m_s2", "0.0", "limits.acceleration_m_s2 is 0, expected a number above 0"),
        (
            "turn_acceleration_rad_s2",
            "inf",
            "limits.turn_acceleration_rad_s2 is inf, expected a number above 0",
        ),
        ("braking_time_s", "nan", "limits.braking_time_s is NaN, expected a number of 0 or more"),
        (
            "braking_time_s",
            "0.6",
            "limits.braking_time_s is 0.6, expected at most avoidance.braking_time_max_s = 0.5",
        ),
    ] {
        assert_eq!(flaw_with_value(&agent(), key, value), error_with(rest, ""));
    }
    let unlimited = AgentBrief { turn_rate_max_rad_s: None, limits: None, ..agent() };
    let expected = "front_point_m is 0 without turn_rate_max_rad_s, expected both";
    assert_eq!(flaw_with_value(&unlimited, "front_point_m", "0.0"), error_with(expected, ""));
    let mut far = agent();
    far.avoidance.classes[0].distance_min_m = 0.3;
    let error = parse::<AgentBrief>(Path::new("r1.toml"), &far.to_toml()).unwrap_err().to_string();
    let expected = "avoidance.class.distance_min_m is 0.3, expected more than 0 and at most \
                    avoidance.distance_min_m = 0.2";
    assert_eq!(error, error_with(expected, ""));
    let car = AgentBrief {
        drive_kind: DriveKind::Ackermann,
        front_point_m: 0.0,
        turning_radius_min_m: None,
        limits: None,
        ..agent()
    };
    let error = parse::<AgentBrief>(Path::new("r1.toml"), &car.to_toml()).unwrap_err().to_string();
    assert!(
        error.contains("turning_radius_min_m is missing with drive = \"ackermann\""),
        "{error}"
    );
    // Without a speed limit, no check depends on it.
    assert_eq!(flaw_with_value(&agent(), "speed_max_m_s", "inf"), "-");
    for (key, value, rest) in [
        ("distance_min_m", "nan", " is NaN, expected a number above 0"),
        ("speed_max_m_s", "inf", " is inf, expected a number above 0"),
        ("duration_ns", "0", " is 0, expected 1 to 6148914691236517205"),
        ("clearance_m", "-1.0", " is -1, expected a number of 0 or more"),
    ] {
        assert_eq!(flaw_with_value(&plant(), key, value), error_with(key, rest));
    }
    let error = flaw_with_value(&plant(), "turn_acceleration_rad_s2", "-3.0");
    assert!(error.contains("robot.limits.turn_acceleration_rad_s2 is -3, expected"), "{error}");
    let error = flaw_with_value(&plant(), "\nradius_m", "nan");
    assert!(error.contains("expected a convex one of finite numbers"), "{error}");
    let empty = PlantBrief { robots: Vec::new(), ..plant() }.to_toml();
    let error = parse::<PlantBrief>(Path::new("plant.toml"), &empty).unwrap_err().to_string();
    assert!(error.ends_with("there is no robot, expected one or more"), "{error}");
}

#[test]
fn brief_of_another_format_names_both_formats() {
    let text = agent().to_toml();
    assert!(text.starts_with(&format!("format = {FORMAT_VERSION}\n")), "{text}");
    let error_of =
        |text: &str| parse::<AgentBrief>(Path::new("r1.toml"), text).unwrap_err().to_string();
    let newer =
        text.replacen(&format!("format = {FORMAT_VERSION}"), "format = 99\na_new_key = 3", 1);
    let older = text.replacen(&format!("format = {FORMAT_VERSION}\n"), "", 1);
    for (text, found) in [(newer, "format 99"), (older, "no format")] {
        let expected = format!(
            "r1.toml has {found}, and this program reads format {FORMAT_VERSION}: another build wrote it; \
             start supervisor, agents and plant from the same build"
        );
        assert_eq!(error_of(&text), expected);
    }
}
