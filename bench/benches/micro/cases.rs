//! What is measured: one body for each case, with all that is needed made beforehand.
//!
//! Inputs are fixed, and time goes on by one period with each call, as in lockstep.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::hint::black_box;
use std::path::Path;

use agent::avoidance::{self, Sample};
use agent::brain::Brain;
use agent::laws::{LAWS, Situation};
use experiment::briefs;
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read_text};
use formation::Vec2;
use formation::closest::closest_pair;
use formation::hull::hull_distance;
use formation::pose::Twist;
use outcome::metrics::Metrics;
use outcome::recording::recorder::{Nearest, Recorder, Run, State};
use plant::world::World;
use protocol::brief::Pace;
use protocol::message::{Beacon, Command, TruthRow};

/// T, s.
const PERIOD_S: f64 = 0.005;
/// The same in ns.
const PERIOD_NS: u64 = 5_000_000;
/// As long as a run may be, and longer than anybody calls anything.
const TICKS: u64 = 100_000_000;
/// How many instants are made beforehand.
const RECORDED: usize = 256;
/// Of a golden turn: points that fill a disk evenly.
const GOLDEN: f64 = 0.618_033_988_7;

/// One call of what is measured.
type Body = Box<dyn FnMut()>;

/// Something to be measured.
pub struct Case {
    /// What, in a few words.
    pub name: String,
    start: Box<dyn Fn() -> Body>,
}

/// All cases.
pub fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    let mut case = |name: String, start: Box<dyn Fn() -> Body>| cases.push(Case { name, start });
    for (row, law) in LAWS.iter().enumerate() {
        case(format!("law {}", law.name), Box::new(move || a_law(row)));
    }
    for near in [0, 4, 8, 31] {
        case(format!("guard, {near} near"), Box::new(move || the_guard(near)));
    }
    for robots in [8, 64] {
        let name = format!("brain, 4 heard, {robots} robots");
        case(name, Box::new(move || a_brain(robots)));
        case(format!("world, step of {robots}"), Box::new(move || a_step(robots)));
        case(format!("world, odometry of {robots}"), Box::new(move || odometry(robots)));
    }
    for leaders in [4, 8] {
        case(format!("hull distance, {leaders} leaders"), Box::new(move || hull(leaders)));
    }
    for robots in [8, 64, 256] {
        case(format!("closest pair of {robots}"), Box::new(move || closest(robots)));
        case(format!("metrics, truth of {robots}"), Box::new(move || truth(robots)));
    }
    for robots in [8, 64] {
        case(format!("recording, an instant of {robots}"), Box::new(move || recorded(robots)));
    }
    cases
}

/// The body of the case of this name.
pub fn start(name: &str) -> Option<Body> {
    all().into_iter().find(|case| case.name == name).map(|case| (case.start)())
}

fn a_law(row: usize) -> Body {
    let law = &LAWS[row];
    let gains = law.gains.iter().map(|&key| (key.to_owned(), 0.5)).collect();
    let mut law = law.make(&gains).expect("positive gains of its own");
    let situation = Situation {
        error: Vec2::new(0.3, -0.2),
        desired_velocity: Vec2::new(0.05, 0.01),
        period_s: PERIOD_S,
        ..Situation::ALONE
    };
    Box::new(move || {
        black_box(law.gamma(black_box(&situation)));
    })
}

/// Others on a spiral from 0.25 m to 0.4 m away, where d is 0.2 m.
fn the_guard(near: usize) -> Body {
    let scenario = ring(8);
    let brief = briefs::agent(&scenario, 0, Pace::Lockstep, Path::new("/"));
    let mut guard = avoidance::build(&brief).expect("a sound brief");
    let away: Vec<Vec2> =
        (0..near).map(|k| at(0.25 + 0.005 * k as f64, TAU * GOLDEN * k as f64)).collect();
    let gamma = guard.admit(Vec2::new(0.1, 0.05));
    let mut tick = 0;
    Box::new(move || {
        tick += 1;
        let sample = Sample {
            stamp_ns: tick * PERIOD_NS,
            t_s: tick as f64 * PERIOD_S,
            heading_rad: 0.4,
            heading_effect_rad: 0.4,
            twist: Twist::ZERO,
            away: &away,
            proximity_valid: true,
            proximity_cut: false,
            velocities: &[],
            walls: &[],
            walls_cut: false,
            error: None,
        };
        black_box(guard.steer(black_box(&sample), gamma));
    })
}

/// A tick of one robot: four beacons heard, one sample answered.
fn a_brain(robots: usize) -> Body {
    let scenario = ring(robots);
    let brief = briefs::agent(&scenario, 0, Pace::Lockstep, Path::new("/"));
    let mut brain = Brain::new(&brief, 0).expect("a sound brief");
    let world = World::new(&briefs::plant(&scenario, Pace::Lockstep, Path::new("/")));
    let mut odometry = world.odometry(0);
    let heard: Vec<Beacon> = brief
        .neighbors
        .iter()
        .map(|neighbor| {
            let other = world.odometry(neighbor.index - 1);
            Beacon { x_m: other.x_m, y_m: other.y_m, vx_m_s: 0.05, ..Beacon::default() }
        })
        .collect();
    let mut tick = 0;
    Box::new(move || {
        for (place, beacon) in heard.iter().enumerate().filter(|_| tick > 0) {
            let beacon = Beacon { tick: tick - 1, stamp_ns: (tick - 1) * PERIOD_NS, ..*beacon };
            brain.hear(place, black_box(&beacon), tick * PERIOD_NS).expect("a sound beacon");
        }
        let stamp_ns = tick * PERIOD_NS;
        (odometry.tick, odometry.t_ns, odometry.stamp_ns) = (tick, stamp_ns, stamp_ns);
        black_box(brain.answer(black_box(&odometry), stamp_ns)).expect("it knows where it is");
        tick += 1;
    })
}

/// A tick of the world: everybody's command, one arc, the closest pair.
fn a_step(robots: usize) -> Body {
    let mut world = World::new(&briefs::plant(&ring(robots), Pace::Lockstep, Path::new("/")));
    let mut tick = 0;
    Box::new(move || {
        let command = Command {
            tick,
            stamp_ns: tick * PERIOD_NS,
            sequence: tick,
            v_m_s: 0.1,
            w_rad_s: 0.5,
            ..Command::default()
        };
        for robot in 0..robots {
            world.accept(robot, black_box(&command)).expect("it answers this very tick");
        }
        tick += 1;
        world.advance(tick * PERIOD_NS);
        world.next_tick();
    })
}

/// What everybody senses at one tick.
fn odometry(robots: usize) -> Body {
    let world = World::new(&briefs::plant(&ring(robots), Pace::Lockstep, Path::new("/")));
    Box::new(move || {
        for robot in 0..robots {
            black_box(world.odometry(black_box(robot)));
        }
    })
}

/// Leaders on a circle of 1 m, and a point outside, by one of its sides.
fn hull(leaders: usize) -> Body {
    let leaders: Vec<Vec2> =
        (0..leaders).map(|k| at(1.0, TAU * k as f64 / leaders as f64)).collect();
    let point = Vec2::new(1.2, 0.5);
    Box::new(move || {
        black_box(hull_distance(black_box(point), black_box(&leaders)));
    })
}

/// Of points spread evenly over a disk.
fn closest(robots: usize) -> Body {
    let spread = |k: usize| at((k as f64 + 0.5).sqrt() * 0.3, TAU * GOLDEN * k as f64);
    let points: Vec<Vec2> = (0..robots).map(spread).collect();
    Box::new(move || {
        black_box(closest_pair(black_box(&points)));
    })
}

/// Everything that the supervisor measures at one tick: hash, errors, every pair's distance.
fn truth(robots: usize) -> Body {
    let scenario = ring(robots);
    let world = World::new(&briefs::plant(&scenario, Pace::Lockstep, Path::new("/")));
    let rows: Vec<TruthRow> = world.truth().collect();
    let mut metrics = Metrics::new(&scenario, Pace::Lockstep);
    let alive = vec![true; robots];
    let mut header = world.truth_header();
    Box::new(move || {
        metrics.truth(black_box(&header), black_box(&rows), &alive);
        header.tick += 1;
        header.t_ns += PERIOD_NS;
    })
}

/// What is recorded of one instant, chunks compressed and written out.
fn recorded(robots: usize) -> Body {
    let scratch = tempfile::tempdir().expect("a place for the file");
    let names: Vec<String> = (1..=robots).map(|number| format!("r{number}")).collect();
    let run = Run {
        started_unix_ns: 1_795_233_599_000_000_000,
        reproducible: false,
        robots: &names,
        walls: &[],
        facts: BTreeMap::new(),
        attachments: &[],
    };
    let mut recorder = Recorder::create(&scratch.path().join("run.mcap"), &run).expect("a file");
    let (errors_m, alive) = (vec![Some(0.01); robots], vec![true; robots]);
    let state = |tick: usize, robot: usize| {
        let (t_s, number) = (tick as f64 * PERIOD_S, robot as f64);
        let phase_rad = 0.1 * t_s + number;
        State {
            x_m: phase_rad.cos(),
            y_m: phase_rad.sin(),
            heading_rad: (phase_rad + 0.3) % TAU,
            v_m_s: 0.1 + 0.01 * (t_s + number).sin(),
            w_rad_s: 0.1 + 0.02 * (t_s - number).cos(),
        }
    };
    // Every number is another at every instant; only after many chunks do they come again.
    let states: Vec<Vec<State>> =
        (0..RECORDED).map(|tick| (0..robots).map(|robot| state(tick, robot)).collect()).collect();
    let mut tick = 0;
    Box::new(move || {
        let states = &states[tick as usize % RECORDED];
        let nearest = Some(Nearest { distance_m: states[0].v_m_s, pair: [0, 1] });
        let states = black_box(states).iter().copied();
        let errors_m = [&errors_m[..]; 2];
        recorder.instant(tick * PERIOD_NS, states, errors_m, &alive, nearest).expect("room");
        tick += 1;
        // The file lives as long as its recorder.
        let _ = &scratch;
    })
}

fn at(radius_m: f64, angle_rad: f64) -> Vec2 {
    let (sin, cos) = angle_rad.sin_cos();
    Vec2::new(radius_m * cos, radius_m * sin)
}

/// The scenario of `phalanx bench`, for so many robots.
fn ring(robots: usize) -> Scenario {
    let text = bench::ring::text(robots, TICKS, PERIOD_S);
    let nothing = Overrides { set: Vec::new(), faults: Vec::new(), seed: None };
    let catalog = agent::catalog();
    match read_text(Path::new("ring.toml"), &text, &nothing, &catalog) {
        Ok((scenario, ..)) => scenario,
        Err(diagnostic) => panic!("{}", diagnostic.render(false)),
    }
}
