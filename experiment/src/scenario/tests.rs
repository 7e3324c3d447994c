//! Tests of whole scenario files and of overrides. `tests/bad` has the files with errors and their diagnostics.

use std::path::Path;

use formation::drive::DriveKind;
use formation::ramp::Ramp;
use protocol::avoidance::{
    AvoidanceDescription, AvoidanceWarning, DistanceGuarantee, Gain, RequiredSensing,
};
use protocol::brief::Pace;
use protocol::catalog::Catalog;
use protocol::law::{LawDescription, Role};

use serde::de::value::{Error, StrDeserializer};
use serde::de::{DeserializeOwned, IntoDeserializer as _};

use super::diagnostic::{Diagnostic, Severity};
use super::keys::{FileFormat, ValueType};
use super::read::{Overrides, ReadResult, read_text};
use super::{RestartCondition, Scenario};
use crate::{campaign, check};

const fn test_law(
    name: &'static str,
    role: Role,
    gains: &'static [&'static str],
    correction_max: Option<&'static str>,
) -> LawDescription {
    LawDescription {
        name,
        role,
        source: "(18)",
        gain_keys: gains,
        feed_forward: false,
        correction_max,
        gain_ranges: &[],
        queued_messages_max: 0,
        params: None,
        message_format: None,
        may_withhold_beacon: false,
        signals: &[],
    }
}

const LAWS: [LawDescription; 3] = [
    test_law("formation-unit", Role::FORMATION, &["speed_m_s"], Some("speed_m_s")),
    test_law("formation", Role::FORMATION, &["gain_formation_per_s"], None),
    test_law("mean", Role::CONTAINED, &[], None),
];

/// Returns a catalog with three methods: one that limits speeds and keeps d, one that does neither, and none. Their
/// parameters are simpler than those of the agents' methods.
const METHODS: &[AvoidanceDescription] = &[
    AvoidanceDescription {
        name: "guard",
        distance_guarantee: DistanceGuarantee::Unconditional,
        clamps_speed: true,
        required_sensing: RequiredSensing::Positions,
        sensing_radius_m: |at| {
            1.05 * at.avoidance.distance_min_m + 4.0 * at.speed_max_m_s() * at.period_s
        },
        steering_distance: Some(("d_f", |at| 1.05 * at.avoidance.distance_min_m)),
        ..AvoidanceDescription::NO_AVOIDANCE
    },
    AvoidanceDescription {
        name: "focus",
        distance_guarantee: DistanceGuarantee::UnderIdealAssumptions,
        required_sensing: RequiredSensing::Positions,
        sensing_radius_m: |at| at.avoidance.distance_min_m,
        gains: &[Gain::new(
            "epsilon_per_s",
            "epsilon, gain of the repulsion between robots closer than d, \
                                                  in 1/s; a larger gain repels more strongly",
        )],
        find_warning: |at| {
            (at.avoidance.gains["epsilon_per_s"] > 10.0).then(|| AvoidanceWarning {
                key: "epsilon_per_s",
                message: "too strong".to_owned(),
                expected_value: "expected at most 10".to_owned(),
            })
        },
        ..AvoidanceDescription::NO_AVOIDANCE
    },
    AvoidanceDescription { name: "none", ..AvoidanceDescription::NO_AVOIDANCE },
];

pub(super) fn test_catalog() -> Catalog {
    Catalog { laws: LAWS.to_vec(), methods: METHODS.to_vec() }
}

/// Returns the text of `scenarios/triangle.toml`.
pub(super) fn triangle_text() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/triangle.toml");
    std::fs::read_to_string(path).unwrap()
}

/// The triangle with headed tables and another order of keys.
pub(super) const TRIANGLE_WITH_HEADED_TABLES: &str = r#"
period_s = 5e-3
seed = 1
duration_s = 30
name = 'triangle'
[avoidance]
speed_max_m_s = 0.3
distance_min_m = 0.2
epsilon_per_s = 1
[robot_defaults]
front_point_m = 0.045
law = "formation-unit"
speed_m_s = 0.1
[[robot]]
name = "r1" # the first
pose = { x_m = -0.045, y_m = -0.35, heading_rad = 0 }
[[robot]]
name = "r2"
restart_policy = "on-failure"
pose = { x_m = 0.4, y_m = 0.205, heading_rad = 1.5707963267948966 }
[[robot]]
name = "r3"
pose = { x_m = -0.4, y_m = 0.295, heading_rad = -1.5707963267948966 }
[[edge]]
from = "r2"
to = "r1"
offset_m = [0.15, 0.2598076211353316]
[[edge]]
from = "r3"
to = "r2"
offset_m = [-0.3, 0.0]
[[edge]]
from = "r1"
to = "r3"
offset_m = [0.15, -0.2598076211353316]
[expect]
min_distance_m = 0.2
final_error_m_max = 1e-3
converged_by_s = 10.0
"#;

fn parse(text: &str, overrides: &Overrides) -> ReadResult {
    read_text(Path::new("test.toml"), text, overrides, &test_catalog())
}

fn set_overrides(arguments: &[&str]) -> Overrides {
    Overrides {
        assignments: arguments.iter().map(|&s| s.to_owned()).collect(),
        ..Overrides::default()
    }
}

/// Returns the triangle with these `--set` assignments.
fn triangle_with(arguments: &[&str]) -> Scenario {
    parse(&triangle_text(), &set_overrides(arguments)).unwrap_or_else(|error| panic!("{error}")).0
}

/// Returns the error of the triangle with these `--set` assignments.
fn triangle_error(arguments: &[&str]) -> Diagnostic {
    parse(&triangle_text(), &set_overrides(arguments)).expect_err("an error")
}

/// Returns the output of `phalanx check`.
fn check_report(scenario: &Scenario) -> String {
    check::format_report(scenario, &check::Theory::compute(scenario))
}

#[test]
fn triangle_scenario_matches_the_chapter() {
    let (scenario, text, warnings) = parse(&triangle_text(), &Overrides::default()).unwrap();
    assert_eq!((text, warnings), (triangle_text(), Vec::new()));
    assert_eq!((scenario.duration_ns, scenario.period_ns), (30_000_000_000, 5_000_000));
    assert_eq!(scenario.command_lifetime_ns_max(), 13_000_000);
    assert_eq!(scenario.avoidance.kind, "guard");
    assert!((scenario.avoidance.sensing_radius_m - 0.216).abs() < 1e-12);
    let silence = &scenario.silence;
    assert_eq!((silence.stale_after_ns, silence.lost_after_ns), (15_000_000, 100_000_000));
    assert_eq!(scenario.robots[1].gains["speed_m_s"], 0.1);
    assert_eq!(scenario.robots[1].restart_policy.condition, RestartCondition::OnFailure);
    let in_neighbors =
        |i| scenario.graph.incoming_edges(i).map(|edge| edge.from).collect::<Vec<_>>();
    assert_eq!([0, 1, 2].map(in_neighbors), [[1], [2], [0]]);
    assert_eq!(scenario.expectations.converged_error_m, 0.01);
    assert!(check_report(&scenario).contains("r1 hears r2 (slot at r2 + (0.150, 0.260) m)"));
}

/// The identity of a run in a campaign.
#[test]
fn scenarios_are_equal_only_for_equivalent_texts() {
    let debug = |text: &str| format!("{:?}", parse(text, &Overrides::default()).unwrap().0);
    assert_eq!(debug(TRIANGLE_WITH_HEADED_TABLES), debug(&triangle_text()));
    for (part, other) in [("5e-3", "5.000001e-3"), ("0.205", "0.206"), ("seed = 1", "seed = 2")] {
        assert_ne!(
            debug(&TRIANGLE_WITH_HEADED_TABLES.replace(part, other)),
            debug(TRIANGLE_WITH_HEADED_TABLES),
            "{other}"
        );
    }
}

/// Returns a triangle whose law is a program and whose edges have parameters.
fn triangle_with_a_program() -> String {
    let law = "[laws.mine]\nprogram = ['python3']\nrole = 'free'\ngains = ['k_per_s']\n\
               gain_ranges = { k_per_s = [-2.0, 0.5] }\nparams = { w = 1, name = 'a' }\n";
    let robots = TRIANGLE_WITH_HEADED_TABLES
        .replace("law = \"formation-unit\"\nspeed_m_s = 0.1", "law = \"mine\"\nk_per_s = -1.5");
    let edge = "to = \"r2\"\nparams = { weight = 0.5, shape_m = [[1.0, 2.0]] }";
    format!("{}{law}", robots.replace("to = \"r2\"", edge).replace("final_error_m_max = 1e-3", ""))
}

#[test]
fn parameters_of_laws_robots_and_edges_can_be_set() {
    let read = |arguments: &[&str]| {
        let read = parse(&triangle_with_a_program(), &set_overrides(arguments));
        read.unwrap_or_else(|error| panic!("{}", error.render(false))).0
    };
    let scenario = read(&[]);
    assert_eq!(scenario.robots[0].gains["k_per_s"], -1.5);
    let weight =
        |scenario: &Scenario, endpoints| scenario.edge_params[endpoints]["weight"].as_float();
    assert_eq!(weight(&scenario, &[2, 1]), Some(0.5));
    assert_eq!(scenario.edge_params.len(), 1);
    let set = read(&[
        "laws.mine.params.w=2",
        "robot.r1.params.w=[3, 4]",
        "edge.r3->r2.params.weight=0.75",
        "edge.\"r1->r3\".params.weight=2.0",
        "robot.r2.k_per_s=0.5",
    ]);
    let w = |i: usize| set.robots[i].params["w"].to_string();
    assert_eq!([w(0), w(1)], ["[3, 4]", "2"]);
    assert_eq!(
        [&[2, 1], &[0, 2]].map(|endpoints| weight(&set, endpoints)),
        [Some(0.75), Some(2.0)]
    );
    assert_eq!(set.robots[1].gains["k_per_s"], 0.5);
    let brief = crate::briefs::agent_brief(&set, 1, Pace::Lockstep, Path::new("/run"));
    let [edge] = &brief.neighbors[..] else { panic!("{:?}", brief.neighbors) };
    assert_eq!(edge.params["weight"].as_float(), Some(0.75));
    for (argument, part) in [
        ("robot.r1.k_per_s=0.6", "expected a number from -2 to 0.5"),
        ("edge.r1->r2.params.weight=1", "there is no edge named `r1->r2`"),
    ] {
        let read = parse(&triangle_with_a_program(), &set_overrides(&[argument]));
        let error = read.expect_err("an error").render(false);
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn arguments_edit_both_list_forms_and_the_text_round_trips() {
    let overrides = Overrides {
        faults: vec!["kill r2 @10 restart 2".into(), "kill r1 @0.1".into()],
        seed: Some(7),
        ..set_overrides(&[
            "avoidance.kind=focus",
            "avoidance.epsilon_per_s=2.0",
            "realtime.hold_periods=3",
            "silence.policy=\"keep\"",
            "robot.r2.speed_m_s = 0.2",
            "robot.r1.pose.x_m=-0.05",
            "robot.r3.wheels.track_m=0.1",
            "robot.r3.wheels.speed_max_m_s=0.5",
            "robot_defaults.restart_policy=never",
        ])
    };
    for text in [triangle_text().as_str(), TRIANGLE_WITH_HEADED_TABLES] {
        let (scenario, effective, _) = parse(text, &overrides).unwrap();
        assert_eq!(scenario.avoidance.kind, "focus");
        assert_eq!((scenario.realtime.hold_periods, scenario.seed), (3, 7));
        let [r1, r2, r3] = &scenario.robots[..] else { panic!("three robots") };
        assert_eq!((r1.start.x_m, r2.gains["speed_m_s"]), (-0.05, 0.2));
        assert_eq!(r3.wheels.map(|wheels| wheels.track_m), Some(0.1));
        assert_eq!(r3.restart_policy.condition, RestartCondition::Never);
        let faults =
            scenario.faults.iter().map(|fault| (fault.start_ns, fault.describe(&scenario)));
        let kills = ["kill r1, for good", "kill r2, back after 2 s"].map(str::to_owned);
        assert!(faults.eq([100_000_000, 10_000_000_000].into_iter().zip(kills)));
        for comment in text.lines().filter_map(|line| line.split_once('#')) {
            assert!(effective.contains(comment.1), "{comment:?} is lost");
        }
        let (again, same, _) = parse(&effective, &Overrides::default()).unwrap();
        assert_eq!((again, same), (scenario, effective));
    }
}

#[test]
fn axle_midpoint_takes_its_turn_rate_limit_from_the_wheels() {
    let scenario = triangle_with(&[
        "robot_defaults.model=turtlebot3-burger",
        "robot_defaults.front_point_m=0.0",
        "robot.r2.turn_rate_max_rad_s=1.5",
        "robot.r3.front_point_m=0.1",
    ]);
    let [r1, r2, r3] = &scenario.robots[..] else { panic!("three robots") };
    // 2 wheels.speed_max_m_s / wheels.track_m.
    assert!((r1.turn_rate_max_rad_s.unwrap() - 2.75).abs() < 1e-12);
    assert_eq!((r2.turn_rate_max_rad_s, r3.turn_rate_max_rad_s), (Some(1.5), None));
    // Speed and turn rate are independent, and braking concerns the speed alone.
    let limits = r1.acceleration_limits.unwrap();
    assert_eq!(limits.ramp, Ramp::Independent);
    assert_eq!(limits.braking_time_s, scenario.avoidance.speed_max_m_s / 2.5);
    assert_eq!(r3.acceleration_limits.unwrap().ramp, Ramp::Together);
    // The distance of the smallest front point counts, not that of the axle.
    assert_eq!(scenario.avoidance_conditions().front_point_m, 0.1);
}

#[test]
fn model_supplies_drive_turn_rate_turning_radius_and_speed() {
    // Models of robots without a front point.
    let models = ["robomaster-ep", "f1tenth", "crazyflie"]
        .map(|model| format!("robot_defaults.model={model}"));
    let scenarios = models.map(|model| {
        triangle_with(&[
            &model,
            "robot_defaults.front_point_m=0.0",
            "avoidance.speed_max_m_s=1.5",
            "robot_defaults.speed_m_s=0.5",
            "expect={}",
        ])
    });
    let found = scenarios.each_ref().map(|scenario| {
        let robot = &scenario.robots[0];
        (robot.drive_kind, robot.turn_rate_max_rad_s, robot.turning_radius_min_m)
    });
    let expected = [
        (DriveKind::Omni, Some(10.47), None),
        (DriveKind::Ackermann, None, Some(0.75)),
        (DriveKind::Omni, Some(0.0), None),
    ];
    assert_eq!(found, expected);
    // The lower one of v_max and the speed of the model.
    let speeds = scenarios.each_ref().map(|scenario| scenario.robots[0].speed_max_m_s);
    assert_eq!(speeds, [1.5, 1.5, 1.0]);
    assert!(scenarios.iter().all(|scenario| scenario.robots[0].wheels.is_none()));
}

#[test]
fn robot_model_supplies_missing_keys() {
    let scenario = triangle_with(&["robot_defaults.model=turtlebot3-burger"]);
    let robot = &scenario.robots[0];
    // The file's own front point, and the rest of the model.
    assert_eq!((robot.front_point_m, robot.body_radius_m), (0.045, Some(0.105)));
    assert_eq!(
        robot.wheels.map(|wheels| [wheels.speed_max_m_s, wheels.track_m]),
        Some([0.22, 0.16])
    );
    let limits = robot.acceleration_limits.unwrap();
    assert_eq!([limits.acceleration_m_s2, limits.turn_acceleration_rad_s2], [2.5, 3.2]);
    // Half of the largest turn rate: v_max / (2 ell a_w).
    let braking_time_s = scenario.avoidance.speed_max_m_s / (2.0 * 0.045 * 3.2);
    assert!((limits.braking_time_s - braking_time_s).abs() < 1e-12);
    assert_eq!(scenario.avoidance.braking_time_max_s, limits.braking_time_s);

    let scenario = triangle_with(&[
        "robot_defaults.model=turtlebot3-burger",
        "robot.r2.limits={acceleration_m_s2=1.0, braking_time_s=3.0, ramp=\"independent\"}",
        "robot.r3.wheels={speed_max_m_s=0.1}",
        "robot.r3.body_radius_m=0.2",
    ]);
    let limits = scenario.robots[1].acceleration_limits.unwrap();
    let found = [limits.acceleration_m_s2, limits.turn_acceleration_rad_s2, limits.braking_time_s];
    assert_eq!(found, [1.0, 3.2, 3.0]);
    assert_eq!(scenario.avoidance.braking_time_max_s, 3.0);
    assert_eq!(limits.ramp, Ramp::Independent);
    assert_eq!(scenario.missing_guarantee_reason(), None);
    let robot = &scenario.robots[2];
    assert_eq!(
        robot.wheels.map(|wheels| [wheels.speed_max_m_s, wheels.track_m]),
        Some([0.1, 0.16])
    );
    assert_eq!(robot.body_radius_m, Some(0.2));
}

#[test]
fn missing_offset_is_the_difference_of_slots() {
    let by_places = TRIANGLE_WITH_HEADED_TABLES
        .replace("name = \"r1\"", "hears = [\"r2\"]\nplace_m = [1.0, 1.0]\nname = \"r1\"")
        .replace("name = \"r2\"", "place_m = [0.75, 0.5]\nname = \"r2\"")
        .replace("name = \"r3\"", "place_m = [1.25, 0.5]\nname = \"r3\"")
        .replace("[[edge]]\nfrom = \"r2\"\nto = \"r1\"\noffset_m = [0.15, 0.2598076211353316]", "")
        .replace("offset_m = [-0.3, 0.0]", "")
        .replace("[0.15, -0.2598076211353316]", "[0.25, -0.5]");
    let scenario = parse(&by_places, &Overrides::default()).unwrap().0;
    let edges = scenario.graph.edges().iter();
    let edges: Vec<_> = edges.map(|e| (e.from, e.to, e.offset_m.x, e.offset_m.y)).collect();
    assert_eq!(edges, [(2, 1, -0.5, 0.0), (0, 2, 0.25, -0.5), (1, 0, 0.25, 0.5)]);
    // An explicit offset takes precedence over the slots.
    let error = parse(&by_places.replace("[0.25, -0.5]", "[0.3, -0.5]"), &Overrides::default());
    assert!(error.unwrap_err().message.contains("do not add up to zero"));
}

#[test]
fn invalid_argument_is_quoted_in_the_error() {
    for (argument, part) in [
        ("avoidance.kind", "there is no `=`"),
        ("=1", "`` is not a key"),
        ("a b=1", "`a b` is not a key"),
        ("seed=", "there is no value"),
        ("name.x=1", "`name` is not a table"),
        ("robot.name=x", "say which of them by its name"),
        ("robot.r9.law=x", "there is no robot named `r9`"),
        ("edge=3", "`edge` is a list of tables"),
    ] {
        for text in [triangle_text().as_str(), TRIANGLE_WITH_HEADED_TABLES] {
            let error = parse(text, &set_overrides(&[argument])).unwrap_err();
            let rendered = error.render(false);
            assert!(rendered.contains(part) && rendered.contains(argument), "{rendered}");
            assert_eq!((error.line, rendered.lines().count()), (0, 1));
        }
    }
    let faulty = Overrides { faults: vec!["kill r2 10".into()], ..Overrides::default() };
    let rendered = parse(&triangle_text(), &faulty).unwrap_err().render(false);
    for part in ["--fault 'kill r2 10'", "kill ROBOT|plant @SECONDS"] {
        assert!(rendered.contains(part), "{rendered}");
    }
}

#[test]
fn invalid_argument_is_shown_in_the_resulting_text() {
    for (argument, message, expected) in [
        ("avoidance.knid=focus", "[avoidance] has no key `knid`", "did you mean `kind`?"),
        ("weather.rain=1", "the scenario has no key `weather`", "expected one of format, name"),
        ("robot.r2.sped_m_s=1", "robot 2 has no key `sped_m_s`", "`speed_m_s`"),
        ("avoidance.kind=4", "`kind` is a number", "\"guard\""),
        ("format=2", "not supported by this version of phalanx", "expected 1"),
        ("robot.r1.gain_formation_per_s=2", "a gain of the law \"formation\", but", "speed_m_s"),
        ("period_s=0.0050000000001", "is 0.0050000000001", "such as 0.005000000"),
        ("period_s=1e-10", "is 0.0000000001", "a whole number of nanoseconds"),
        ("period_s=1e-16", "is 1e-16", "a whole number of nanoseconds"),
        ("duration_s=1e8", "is 100000000", "at most 1e7 s"),
        ("duration_s=1e300", "is 1e300", "at most 1e9"),
    ] {
        let error = triangle_error(&[argument]);
        assert!(error.message.contains(message), "{argument}: {}", error.message);
        assert!(error.expected.contains(expected), "{argument}: {}", error.expected);
        assert!(error.render(false).contains("--set, --fault and --seed are applied"));
    }
    for (text, ns) in [("0.005", 5_000_000), ("0.000000333", 333), ("1", 1_000_000_000)] {
        let scenario = triangle_with(&[&format!("realtime.plant_tick_s={text}"), "format=1"]);
        assert_eq!(scenario.realtime.plant_tick_ns, ns);
    }
    assert_eq!(triangle_with(&["duration_s=12.345678901"]).duration_ns, 12_345_678_901);
}

/// Words that users write, and the keys that they mean.
const SYNONYM_EXAMPLES: &str = "\
avoidance.v_max_m_s => `speed_max_m_s`
avoidance.d => `distance_min_m`
avoidance.d_min_m => `distance_min_m`
avoidance.method => `kind`
v_max => `speed_max_m_s` in `avoidance`
dt => `period_s`
T => `period_s`
sample_time_s => `period_s`
t_end => `duration_s`
robots => `robot`
edges => `edge`
L => `latency_allowed_s` in `realtime`
lost_after_s => `lost_after_s` in `silence`
robot_defaults.L => `front_point_m`
robot_defaults.mu => `speed_m_s`
robot_defaults.controller => `law`
robot.r1.pose.theta => `heading_rad`
expect.error_max_m => `final_error_m_max`
seed_s => `seed`
periods => `period_s`
nmae => `name`";

#[test]
fn likely_guesses_of_keys_are_understood() {
    for (guess, suggestion) in SYNONYM_EXAMPLES.lines().map(|line| line.split_once(" => ").unwrap())
    {
        let error = triangle_error(&[&format!("{guess}=1")]);
        assert_eq!(error.expected, format!("did you mean {suggestion}?"), "{guess}");
    }
    let error =
        parse(&TRIANGLE_WITH_HEADED_TABLES.replace("from = ", "source = "), &Overrides::default())
            .unwrap_err();
    assert_eq!(error.expected, "did you mean `from`?");
}

#[test]
fn empty_list_removes_the_faults_of_a_file_in_any_form() {
    let kill = "at_s = 1.0, kind = \"kill\", robot = \"r2\"";
    let inline = format!("fault = [{{ {kill} }}]\n{}", triangle_text());
    let headed =
        format!("{TRIANGLE_WITH_HEADED_TABLES}\n[[fault]]\n{}\n", kill.replace(", ", "\n"));
    for text in [inline, headed, triangle_text()] {
        let faults = vec!["kill r1 @2".to_owned()];
        let overrides = Overrides { faults, ..set_overrides(&["fault = []"]) };
        assert_eq!(parse(&text, &overrides).unwrap().0.faults.len(), 1);
        assert_eq!(parse(&text, &set_overrides(&["fault=[]"])).unwrap().0.faults, []);
    }
}

#[test]
fn guarantee_needs_the_built_in_plant_and_a_proven_method() {
    assert_eq!(triangle_with(&[]).missing_guarantee_reason(), None);
    let plant = "plant.program=[\"physics\", \"--fast\"]";
    let why = "`physics --fast` moves the robots, and the guard is proven for another plant";
    assert_eq!(triangle_with(&[plant]).missing_guarantee_reason().as_deref(), Some(why));
    assert_eq!(triangle_with(&[plant, "avoidance.kind=focus"]).missing_guarantee_reason(), None);
}

#[test]
fn safe_but_unwise_setting_is_a_warning() {
    let two_ways =
        triangle_text().replace("from = \"r1\", to = \"r3\"", "from = \"r3\", to = \"r1\"");
    let other_law = ["robot_defaults.law=formation", "robot_defaults.gain_formation_per_s=3"];
    for (text, arguments, expected) in [
        (
            triangle_text(),
            &["avoidance.distance_min_m=0.29"][..],
            &["in the settled formation"][..],
        ),
        (triangle_text(), &["avoidance.distance_min_m=0.08"], &["but not bodies"]),
        (triangle_text(), &["avoidance.kind=focus", "avoidance.epsilon_per_s=50"], &["too strong"]),
        (triangle_text(), &other_law, &["`speed_m_s` has no effect"]),
        // The mean of the desired positions of r2 and r3 is that of r3.
        (two_ways, &[], &["around a cycle through", "r1 and r3 are 0 m apart"]),
    ] {
        let (_, _, warnings) = parse(&text, &set_overrides(arguments)).unwrap();
        assert_eq!(warnings.len(), expected.len(), "{warnings:#?}");
        for (warning, part) in warnings.iter().zip(expected) {
            assert!(warning.message.contains(part), "{}", warning.message);
            assert!(warning.severity == Severity::Warning && warning.line > 0);
        }
    }
}

#[test]
fn literal_focus_without_speed_limit_has_a_sensing_radius() {
    let text =
        triangle_text().replace("speed_max_m_s = 0.3\n", "").replace("\"guard\"", "\"focus\"");
    let (scenario, _, warnings) = parse(&text, &Overrides::default()).unwrap();
    assert_eq!((warnings, scenario.avoidance.speed_max_m_s), (Vec::new(), f64::INFINITY));
    assert!((scenario.avoidance.sensing_radius_m - 0.2).abs() < 1e-12);
    assert!(check_report(&scenario).contains("no speed limit"));
}

/// Checks that each word of a row deserializes as `T`.
fn assert_words_deserialize<T: DeserializeOwned>(format: &FileFormat, section: &str, key: &str) {
    let ValueType::Word(words) = format.section(section).find_key(key).unwrap().value_type else {
        panic!("{key}")
    };
    for &(word, _) in words {
        let text: StrDeserializer<'_, Error> = word.into_deserializer();
        assert!(T::deserialize(text).is_ok(), "{section}.{key} = {word}");
    }
}

#[test]
fn every_guess_of_a_key_is_understood() {
    let format = FileFormat::new(&test_catalog());
    assert_words_deserialize::<protocol::brief::PublishedVelocity>(
        &format,
        "scenario",
        "published_velocity",
    );
    assert_words_deserialize::<protocol::brief::SilencePolicy>(&format, "silence", "policy");
    assert_words_deserialize::<RestartCondition>(&format, "robot", "restart_policy");
    assert_words_deserialize::<formation::ramp::Ramp>(&format, "limits", "ramp");
    assert_words_deserialize::<protocol::fault::RobotStream>(&format, "fault", "stream");
    assert_words_deserialize::<protocol::fault::Sensor>(&format, "fault", "sensor");
    let format = campaign::keys::campaign_format();
    assert_words_deserialize::<protocol::brief::Pace>(&format, "campaign", "pace");
    assert_words_deserialize::<campaign::file::FileRetention>(&format, "campaign", "keep");
    assert_words_deserialize::<campaign::starts::GoalAssignment>(&format, "starts", "goals");
}

/// Returns a scenario of that number of robots in a row. Each receives from the one before.
fn row_scenario_text(robots: usize) -> String {
    let head = "name = 'row'\nduration_s = 1\nperiod_s = 0.01\n\
                avoidance = { kind = 'guard', distance_min_m = 0.2, speed_max_m_s = 0.3 }\n\
                robot_defaults = { front_point_m = 0.1, law = 'formation-unit', speed_m_s = 0.1 }\n";
    let robot = |k: usize| {
        let hears = if k == 0 { String::new() } else { format!("hears = ['r{}']\n", k - 1) };
        format!(
            "[[robot]]\nname = 'r{k}'\nplace_m = [{k}, 0]\n{hears}\
             pose = {{ x_m = {k}, y_m = 0, heading_rad = 0 }}\n"
        )
    };
    head.to_owned() + &(0..robots).map(robot).collect::<String>()
}

#[test]
fn a_file_with_1025_robots_is_refused_with_the_limit() {
    let error = parse(&row_scenario_text(1025), &set_overrides(&[])).unwrap_err().render(false);
    assert!(error.contains("begins robot 1025"), "{error}");
    assert!(error.contains("at most 1024 robots"), "{error}");
}

#[test]
fn the_default_recording_rate_falls_with_many_robots() {
    let hz = |robots, arguments: &[&str]| {
        parse(&row_scenario_text(robots), &set_overrides(arguments)).unwrap().0.record_hz
    };
    assert_eq!([hz(3, &[]), hz(128, &[]), hz(256, &[])], [100.0, 100.0, 50.0]);
    assert_eq!(hz(256, &["record_hz=80"]), 80.0);
}

#[test]
fn the_default_simulation_step_grows_with_many_robots() {
    let step_ns = |robots, arguments: &[&str]| {
        let overrides = set_overrides(arguments);
        parse(&row_scenario_text(robots), &overrides).unwrap().0.realtime.plant_tick_ns
    };
    assert_eq!([step_ns(3, &[]), step_ns(128, &[])], [1_000_000, 1_000_000]);
    assert_eq!([step_ns(256, &[]), step_ns(1024, &[])], [2_000_000, 8_000_000]);
    assert_eq!(step_ns(1024, &["period_s=0.004"]), 4_000_000, "the control period");
    assert_eq!(step_ns(1024, &["realtime.plant_tick_s=0.001"]), 1_000_000);
    assert_eq!(step_ns(1024, &["period_s=0.0005"]), 1_000_000);
}
