//! Scenarios as whole files: what they mean, what arguments do to them, and that no text at all
//! makes the reader panic.

use std::path::{Path, PathBuf};

use protocol::avoidance::{Advice, AvoidanceDescription, Gain, Promise, Senses};
use protocol::catalog::Catalog;
use protocol::law::{LawDescription, Role};

use super::diagnostic::{Diagnostic, Severity};
use super::read::{Overrides, read, read_text};
use super::{FaultKind, RestartWhen, Scenario};
use crate::check;

const LAWS: &[LawDescription] = &[
    LawDescription {
        role: Role::FORMATION,
        name: "formation-unit",
        source: "(18)",
        gains: &["speed_m_s"],
        feed_forward: false,
        correction_max: Some("speed_m_s"),
    },
    LawDescription {
        role: Role::FORMATION,
        name: "formation",
        source: "(28)",
        gains: &["gain_formation_per_s"],
        feed_forward: false,
        correction_max: None,
    },
];

/// A method that limits speeds and keeps d, one that does neither, and none; with figures of their
/// own, simpler than those of the agents' methods.
const METHODS: &[AvoidanceDescription] = &[
    AvoidanceDescription {
        name: "guard",
        promise: Promise::Always,
        clamps_speed: true,
        senses: Senses::Positions,
        sensing_radius_m: |at| {
            1.05 * at.avoidance.distance_min_m + 4.0 * at.speed_m_s() * at.period_s
        },
        steers_within: Some(("d_f", |at| 1.05 * at.avoidance.distance_min_m)),
        ..AvoidanceDescription::INERT
    },
    AvoidanceDescription {
        name: "focus",
        promise: Promise::Ideal,
        senses: Senses::Positions,
        sensing_radius_m: |at| at.avoidance.distance_min_m,
        gains: &[Gain { key: "epsilon_per_s", meaning: "strength of the focus, in 1/s" }],
        advice: |at| {
            (at.avoidance.gains["epsilon_per_s"] > 10.0).then(|| Advice {
                key: "epsilon_per_s",
                message: "too strong".to_owned(),
                expected: "expected at most 10".to_owned(),
            })
        },
        ..AvoidanceDescription::INERT
    },
    AvoidanceDescription { name: "none", ..AvoidanceDescription::INERT },
];

/// These laws and methods.
pub(super) fn catalog_of(laws: &[LawDescription]) -> Catalog {
    Catalog { laws: laws.to_vec(), methods: METHODS.to_vec() }
}

pub(super) fn catalog() -> Catalog {
    catalog_of(LAWS)
}

fn scenarios() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios")
}

fn triangle() -> String {
    std::fs::read_to_string(scenarios().join("triangle.toml")).unwrap()
}

fn parse(
    text: &str,
    overrides: &Overrides,
) -> Result<(Scenario, String, Vec<Diagnostic>), Diagnostic> {
    read_text(Path::new("test.toml"), text, overrides, &catalog())
}

fn set(arguments: &[&str]) -> Overrides {
    Overrides { set: arguments.iter().map(|&s| s.to_owned()).collect(), ..Overrides::default() }
}

/// What `phalanx check` prints.
fn report(scenario: &Scenario) -> String {
    check::report(scenario, &check::Theory::of(scenario))
}

/// The triangle with some `--set`s: its error.
fn error_with(arguments: &[&str]) -> Diagnostic {
    parse(&triangle(), &set(arguments)).expect_err("an error")
}

/// The triangle with some `--set`s: its only warning.
fn warning_with(arguments: &[&str]) -> String {
    let (_, _, warnings) = parse(&triangle(), &set(arguments)).unwrap();
    assert_eq!(warnings.len(), 1, "{warnings:#?}");
    assert_eq!(warnings[0].severity, Severity::Warning);
    assert!(warnings[0].line > 0);
    warnings[0].message.clone()
}

#[test]
fn the_triangle_is_read_as_the_chapter_has_it() {
    let (scenario, text, warnings) =
        read(&scenarios().join("triangle.toml"), &Overrides::default(), &catalog()).unwrap();
    assert_eq!(text, triangle());
    assert_eq!(warnings, []);
    assert_eq!(scenario.name, "triangle");
    assert_eq!((scenario.duration_ns, scenario.period_ns), (30_000_000_000, 5_000_000));
    assert_eq!(scenario.command_lifetime_ns_max(), 13_000_000);
    assert_eq!(scenario.avoidance.kind, "guard");
    assert!((scenario.avoidance.sensing_radius_m - 0.216).abs() < 1e-12);
    assert_eq!(
        (scenario.silence.stale_after_ns, scenario.silence.lost_after_ns),
        (15_000_000, 100_000_000)
    );
    assert_eq!(scenario.robots[1].gains["speed_m_s"], 0.1);
    assert_eq!(scenario.robots[1].restart.when, RestartWhen::OnFailure);
    assert_eq!(scenario.heard_names(0), ["r2"]);
    assert_eq!(scenario.heard_names(1), ["r3"]);
    assert_eq!(scenario.heard_names(2), ["r1"]);
    assert_eq!(scenario.expect.converged_error_m, 0.01);
    assert!(report(&scenario).contains("r1 hears r2 and wants to be at r2 + (0.150, 0.260) m"));
}

#[test]
fn every_scenario_of_the_house_is_sound_and_without_warnings() {
    let mut count = 0;
    for entry in std::fs::read_dir(scenarios()).unwrap() {
        let path = entry.unwrap().path();
        if path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("triangle")) {
            let (scenario, _, warnings) = read(&path, &Overrides::default(), &catalog())
                .unwrap_or_else(|error| panic!("{}", error.render(false)));
            assert_eq!(warnings, [], "{}", path.display());
            assert_eq!(scenario.name, path.file_stem().unwrap().to_string_lossy());
            assert!(report(&scenario).lines().count() <= 40);
            count += 1;
        }
    }
    assert_eq!(count, 6);
}

#[test]
fn the_effective_text_holds_the_changes_keeps_comments_and_reads_to_the_same_scenario() {
    let overrides = Overrides {
        set: [
            "avoidance.kind=focus",
            "robot.r2.speed_m_s = 0.2",
            "robot.r1.pose.x_m=-0.05",
            "realtime.hold_periods=3",
            "silence.policy=\"keep\"",
            "avoidance.epsilon_per_s=2.0",
        ]
        .map(String::from)
        .to_vec(),
        faults: vec!["kill r2 @10 restart 2".into(), "kill r1 @0.1".into()],
        seed: Some(7),
    };
    let (scenario, text, _) = parse(&triangle(), &overrides).unwrap();
    assert_eq!(scenario.avoidance.kind, "focus");
    assert_eq!(scenario.robots[1].gains["speed_m_s"], 0.2);
    assert_eq!(scenario.robots[0].start.x_m, -0.05);
    assert_eq!((scenario.hold_periods, scenario.seed), (3, 7));
    let kills: Vec<_> =
        scenario.faults.iter().map(|fault| (fault.at_ns, fault.kind.clone())).collect();
    assert_eq!(
        kills,
        [
            (100_000_000, FaultKind::Kill { robot: 0, restart_after_ns: None }),
            (10_000_000_000, FaultKind::Kill { robot: 1, restart_after_ns: Some(2_000_000_000) }),
        ]
    );
    for comment in triangle().lines().filter_map(|line| line.split_once('#')) {
        assert!(text.contains(comment.1), "{comment:?} is lost");
    }
    let (again, same, _) = parse(&text, &Overrides::default()).unwrap();
    assert_eq!((again, same), (scenario, text));
}

/// The triangle with its robots and edges as inline lists.
fn inline_triangle() -> String {
    r#"name = "triangle"
duration_s = 30.0
period_s = 0.005
avoidance = { kind = "guard", distance_min_m = 0.2, speed_max_m_s = 0.3 }
robot_defaults = { front_point_m = 0.045, law = "formation-unit", speed_m_s = 0.1 }
robot = [
    { name = "r1", pose = { x_m = -0.045, y_m = -0.35, heading_rad = 0.0 } },
    # The one that is killed.
    { name = "r2", pose = { x_m = 0.4, y_m = 0.205, heading_rad = 1.5707963267948966 } },
    { name = "r3", pose = { x_m = -0.4, y_m = 0.295, heading_rad = -1.5707963267948966 } },
]
edge = [
    { from = "r2", to = "r1", offset_m = [0.15, 0.2598076211353316] },
    { from = "r3", to = "r2", offset_m = [-0.3, 0.0] },
    { from = "r1", to = "r3", offset_m = [0.15, -0.2598076211353316] },
]
fault = [{ at_s = 1.0, kind = "kill", robot = "r2", restart_after_s = 1.0 }]
expect = { min_distance_m = 0.2, final_error_m_max = 1e-3, converged_by_s = 15.0 }
"#
    .to_owned()
}

#[test]
fn robots_and_edges_may_be_inline_lists() {
    let (inline, _, warnings) = parse(&inline_triangle(), &Overrides::default()).unwrap();
    let (long, _, _) = parse(&triangle(), &Overrides::default()).unwrap();
    assert_eq!(warnings, []);
    assert_eq!((&inline.robots, &inline.graph), (&long.robots, &long.graph));
}

#[test]
fn arguments_change_inline_lists_too() {
    let overrides = Overrides {
        set: [
            "robot.r2.speed_m_s=0.2",
            "robot.r1.pose.x_m=-0.05",
            "robot.r3.wheels.track_m=0.1",
            "robot.r3.wheels.speed_max_m_s=0.5",
            "robot_defaults.restart_policy=never",
        ]
        .map(String::from)
        .to_vec(),
        faults: vec!["kill r2 @10 restart 2".into()],
        seed: None,
    };
    let (scenario, text, _) = parse(&inline_triangle(), &overrides).unwrap();
    assert_eq!(scenario.robots[1].gains["speed_m_s"], 0.2);
    assert_eq!(scenario.robots[0].start.x_m, -0.05);
    assert_eq!(scenario.robots[2].wheels.map(|wheels| wheels.track_m), Some(0.1));
    assert_eq!(scenario.robots[2].restart.when, RestartWhen::Never);
    assert_eq!(scenario.faults.len(), 2);
    assert!(text.contains("# The one that is killed."), "{text}");
    assert_eq!(parse(&text, &Overrides::default()).unwrap().0, scenario);
    for (argument, part) in [
        ("robot.r9.law=x", "there is no robot named `r9`"),
        ("robot.name=x", "say which of them by its name"),
        ("edge=3", "`edge` is a list of tables"),
    ] {
        let error = parse(&inline_triangle(), &set(&[argument])).unwrap_err();
        assert!(error.message.contains(part), "{}", error.message);
    }
    let error = parse(&inline_triangle(), &set(&["robot.r2.sped_m_s=1"])).unwrap_err();
    assert_eq!((error.message.as_str(), error.line), ("robot 2 has no key `sped_m_s`", 9));
}

#[test]
fn a_model_gives_what_the_robots_keys_do_not_say() {
    let burger = set(&["robot_defaults.model=turtlebot3-burger"]);
    let (scenario, ..) = parse(&inline_triangle(), &burger).unwrap();
    let robot = &scenario.robots[0];
    // The file's own front point, and the rest of the model.
    assert_eq!((robot.front_point_m, robot.body_radius_m), (0.045, Some(0.105)));
    assert_eq!(
        robot.wheels.map(|wheels| [wheels.speed_max_m_s, wheels.track_m]),
        Some([0.22, 0.16])
    );
    let limits = robot.limits.unwrap();
    assert_eq!([limits.acceleration_m_s2, limits.turn_acceleration_rad_s2], [2.5, 3.2]);
    // Half of the largest turn rate: v_max / (2 ell a_w).
    let braking_time_s = scenario.avoidance.speed_max_m_s / (2.0 * 0.045 * 3.2);
    assert!((limits.braking_time_s - braking_time_s).abs() < 1e-12);
    assert_eq!(scenario.avoidance.braking_time_max_s, limits.braking_time_s);

    let own = set(&[
        "robot_defaults.model=turtlebot3-burger",
        "robot.r2.limits={acceleration_m_s2=1.0, braking_time_s=3.0, ramp=\"independent\"}",
        "robot.r3.wheels={speed_max_m_s=0.1}",
        "robot.r3.body_radius_m=0.2",
    ]);
    let (scenario, ..) = parse(&inline_triangle(), &own).unwrap();
    let limits = scenario.robots[1].limits.unwrap();
    let found = [limits.acceleration_m_s2, limits.turn_acceleration_rad_s2, limits.braking_time_s];
    assert_eq!(found, [1.0, 3.2, 3.0]);
    assert_eq!(scenario.avoidance.braking_time_max_s, 3.0);
    assert_eq!(scenario.voids_the_promise(), Some("r2"));
    let robot = &scenario.robots[2];
    assert_eq!(
        robot.wheels.map(|wheels| [wheels.speed_max_m_s, wheels.track_m]),
        Some([0.1, 0.16])
    );
    assert_eq!(robot.body_radius_m, Some(0.2));
}

#[test]
fn an_offset_that_is_not_given_is_the_difference_of_places() {
    let by_places = inline_triangle()
        .replace("name = \"r1\"", "name = \"r1\", hears = [\"r2\"], place_m = [1.0, 1.0]")
        .replace("name = \"r2\"", "name = \"r2\", place_m = [0.75, 0.5]")
        .replace("    { from = \"r2\", to = \"r1\", offset_m = [0.15, 0.2598076211353316] },\n", "")
        .replace("name = \"r3\"", "name = \"r3\", place_m = [1.25, 0.5]")
        .replace(", offset_m = [-0.3, 0.0]", "")
        .replace("[0.15, -0.2598076211353316]", "[0.25, -0.5]");
    let (scenario, _, _) = parse(&by_places, &Overrides::default()).unwrap();
    let edges: Vec<_> = scenario
        .graph
        .edges()
        .iter()
        .map(|edge| (edge.from, edge.to, edge.offset_m.x, edge.offset_m.y))
        .collect();
    assert_eq!(edges, [(2, 1, -0.5, 0.0), (0, 2, 0.25, -0.5), (1, 0, 0.25, 0.5)]);
    // What is said outright wins over the places, and is found again where it stands.
    let error = parse(&by_places.replace("[0.25, -0.5]", "[0.3, -0.5]"), &Overrides::default());
    let error = error.unwrap_err();
    assert!(error.message.contains("do not close"), "{}", error.message);
}

#[test]
fn an_argument_that_makes_no_sense_is_quoted() {
    for (arguments, part) in [
        (["avoidance.kind"], "there is no `=`"),
        (["=1"], "`` is not a key"),
        (["a b=1"], "`a b` is not a key"),
        (["seed="], "there is no value"),
        (["name.x=1"], "`name` is not a table"),
        (["robot.name=x"], "say which of them by its name"),
        (["robot.r9.law=x"], "there is no robot named `r9`"),
        (["edge=3"], "`edge` is a list of tables"),
    ] {
        let error = error_with(&arguments);
        assert_eq!(error.line, 0);
        let rendered = error.render(false);
        assert!(rendered.contains(part) && rendered.contains(arguments[0]), "{rendered}");
        assert_eq!(rendered.lines().count(), 1);
    }
    let faulty = Overrides { faults: vec!["kill r2 10".into()], ..Overrides::default() };
    let rendered = parse(&triangle(), &faulty).unwrap_err().render(false);
    assert!(
        rendered.contains("--fault 'kill r2 10'") && rendered.contains("kill ROBOT|plant @SECONDS")
    );
}

#[test]
fn an_argument_with_a_wrong_key_or_value_is_shown_in_the_resulting_text() {
    let error = error_with(&["avoidance.knid=focus"]);
    assert_eq!(error.message, "[avoidance] has no key `knid`");
    assert_eq!(error.expected, "did you mean `kind`?");
    assert!(error.render(false).contains("--set, --fault and --seed are applied"));
    assert_eq!(error_with(&["weather.rain=1"]).message, "the scenario has no key `weather`");
    assert_eq!(error_with(&["avoidance.kind=4"]).message, "`kind` is a number");
}

#[test]
fn likely_guesses_of_keys_are_understood() {
    for (guess, meant) in [
        ("avoidance.v_max_m_s=1", "`speed_max_m_s`"),
        ("avoidance.d=1", "`distance_min_m`"),
        ("avoidance.d_min_m=1", "`distance_min_m`"),
        ("avoidance.min_distance=1", "`distance_min_m`"),
        ("avoidance.method=1", "`kind`"),
        ("v_max=1", "`speed_max_m_s` in `avoidance`"),
        ("min_distance=1", "`distance_min_m` in `avoidance`"),
        ("dt=0.1", "`period_s`"),
        ("T=0.1", "`period_s`"),
        ("sample_time_s=0.1", "`period_s`"),
        ("t_end=9", "`duration_s`"),
        ("random_seed=9", "`seed`"),
        ("robots=1", "`robot`"),
        ("edges=1", "`edge`"),
        ("L=1", "`latency_allowed_s` in `realtime`"),
        ("lost_after_s=1", "`lost_after_s` in `silence`"),
        ("robot_defaults.ell=1", "`front_point_m`"),
        ("robot_defaults.L=1", "`front_point_m`"),
        ("robot_defaults.mu=1", "`speed_m_s`"),
        ("robot_defaults.controller=1", "`law`"),
        ("robot.r1.pose.theta=1", "`heading_rad`"),
        ("expect.error_max_m=1", "`final_error_m_max`"),
        ("seed_s=1", "`seed`"),
    ] {
        let error = error_with(&[guess]);
        assert_eq!(error.expected, format!("did you mean {meant}?"), "{guess}");
    }
    let text = triangle().replace("from = ", "source = ");
    let error = parse(&text, &Overrides::default()).unwrap_err();
    assert_eq!(error.expected, "did you mean `from`?");
    let close = error_with(&["colour=1"]).expected;
    assert!(close.starts_with("expected one of format, name"), "{close}");
}

#[test]
fn an_empty_list_removes_the_faults_of_a_file_however_they_are_written() {
    let kill = "at_s = 1.0, kind = \"kill\", robot = \"r2\"";
    let inline = format!("fault = [{{ {kill} }}]\n{}", triangle());
    let headed = format!("{}\n[[fault]]\n{}\n", triangle(), kill.replace(", ", "\n"));
    for text in [inline, headed, triangle()] {
        let (scenario, effective, _) = parse(&text, &set(&["fault=[]"])).unwrap();
        assert_eq!(scenario.faults, [], "{effective}");
        let faults = vec!["kill r1 @2".to_owned()];
        let overrides = Overrides { faults, ..set(&["fault = []"]) };
        assert_eq!(parse(&text, &overrides).unwrap().0.faults.len(), 1);
    }
}

#[test]
fn the_format_may_be_named() {
    assert_eq!(parse(&format!("format = 1\n{}", triangle()), &set(&[])).unwrap().2, []);
    let error = error_with(&["format=2"]);
    assert!(error.message.contains("none that this phalanx reads"), "{}", error.message);
}

#[test]
fn a_promise_is_of_the_built_in_plant_and_of_methods_that_make_one() {
    let unpromised = |own: &[&str]| parse(&triangle(), &set(own)).unwrap().0.unpromised();
    assert_eq!(unpromised(&[]), None);
    let plant = "plant.program=[\"physics\", \"--fast\"]";
    let why = "`physics --fast` moves the robots, and the guard is proven for another plant";
    assert_eq!(unpromised(&[plant]).as_deref(), Some(why));
    assert_eq!(unpromised(&[plant, "avoidance.kind=focus"]), None);
}

#[test]
fn gains_belong_to_laws() {
    let error = error_with(&["robot.r1.gain_formation_per_s=2"]);
    assert_eq!(
        error.message,
        "`gain_formation_per_s` is a gain of the law \"formation\", but robot r1 follows \"formation-unit\""
    );
    let error = error_with(&["robot_defaults.law=formation"]);
    assert_eq!(error.message, "robot r1 has no `gain_formation_per_s`");
    let message =
        warning_with(&["robot_defaults.law=formation", "robot_defaults.gain_formation_per_s=3"]);
    assert!(message.starts_with("`speed_m_s` has no effect"), "{message}");
    let error = error_with(&["robot_defaults.law=magic"]);
    assert_eq!(error.expected, "expected one of \"formation-unit\", \"formation\"");
}

#[test]
fn times_are_whole_nanoseconds_and_exact() {
    for (text, ns) in
        [("0.005", 5_000_000), ("1e-3", 1_000_000), ("0.000000333", 333), ("1", 1_000_000_000)]
    {
        let (scenario, _, _) =
            parse(&triangle(), &set(&[&format!("realtime.plant_tick_s={text}")])).unwrap();
        assert_eq!(scenario.plant_tick_ns, ns);
    }
    let late = set(&["duration_s=12.345678901"]);
    assert_eq!(parse(&triangle(), &late).unwrap().0.duration_ns, 12_345_678_901);
    assert!(error_with(&["period_s=0.0050000000001"]).expected.contains("0.005000000"));
    assert!(error_with(&["period_s=1e-10"]).expected.contains("nanoseconds"));
    assert!(error_with(&["duration_s=1e8"]).expected.contains("at most 1e7 s"));
    assert!(error_with(&["duration_s=1e300"]).expected.contains("1e9"));
}

#[test]
fn what_is_safe_but_unwise_is_a_warning() {
    assert!(warning_with(&["avoidance.distance_min_m=0.29"]).contains("in the final shape"));
    assert!(warning_with(&["avoidance.distance_min_m=0.08"]).contains("but not bodies"));
    assert!(
        warning_with(&["avoidance.kind=focus", "avoidance.epsilon_per_s=50"])
            .contains("too strong")
    );
    let two_ways = triangle().replace("from = \"r1\", to = \"r3\"", "from = \"r3\", to = \"r1\"");
    let (_, _, warnings) = parse(&two_ways, &Overrides::default()).unwrap();
    assert_eq!(warnings.len(), 2);
    assert!(warnings[0].message.contains("around a cycle through"), "{}", warnings[0].message);
    // Between what r2 and r3 ask for, r1 would settle on top of r3.
    assert!(warnings[1].message.contains("r1 and r3 stand 0 m apart"), "{}", warnings[1].message);
}

#[test]
fn without_a_speed_limit_the_literal_focus_still_has_a_sensing_radius() {
    let text = triangle().replace("speed_max_m_s = 0.3\n", "").replace("\"guard\"", "\"focus\"");
    let (scenario, _, warnings) = parse(&text, &Overrides::default()).unwrap();
    assert_eq!(warnings, []);
    assert_eq!(scenario.avoidance.speed_max_m_s, f64::INFINITY);
    assert!((scenario.avoidance.sensing_radius_m - 0.2).abs() < 1e-12);
    assert!(report(&scenario).contains("no speed limit"));
}
