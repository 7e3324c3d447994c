//! Table of the scenario format: the single source for the type, unit, range, default and description of every key.
//!
//! The parser uses the types, units, ranges and defaults of these rows, diagnostics use their descriptions, and the
//! JSON Schema and the reference page use all columns. The formats of campaign and fleet files have tables of the
//! same kind. [`crate::keys!`] makes of each row the constant by which the key is read and, if the row has `as`, a
//! field of the settings with its reader. Conditions on several values are checked where the values are read, and in
//! [`crate::check`].
//!
//! To rename a key, change the name in its row and add `.formerly(&["old_name"])`. Files with the old name are then
//! accepted with a warning.

use formation::drive::DriveKind;
use std::borrow::Cow;

use formation::ramp::Ramp;
use protocol::avoidance::Gain;
use protocol::brief::{PublishedVelocity, SilencePolicy};
use protocol::catalog::Catalog;
use protocol::fault::{RobotStream, Sensor};
use protocol::law::LIARS_MAX_KEY;
use protocol::law_message::{MESSAGE_BYTES_MAX, MESSAGE_QUEUE_LENGTH};

use super::fault::FAULT_SYNTAXES;
use super::fields::table_section;
use super::models;
use super::reduction::{RobotReduction, TimeReduction};
use super::restart::RestartCondition;
use crate::{keys, tables};

pub use super::format::{
    FileFormat, IfMissing, KeySpec, KindSpec, NumberRange, Section, ValueType, WithdrawnKeys, key,
};

/// Version of the scenario format.
pub const FORMAT_VERSION: u64 = 1;

/// Maximum number of periods for which a command may be held.
const HOLD_PERIODS_MAX: u64 = 100;
/// Maximum number of consecutive messages lost together. A larger value is assumed to be a typing error.
const BURST_MESSAGES_MAX: u64 = 1_000_000;
/// Maximum number of load processes. A larger value is assumed to be a typing error.
const LOAD_PROCESSES_MAX: u64 = 256;
/// Maximum value of the gain `liars_max`: the maximum in-degree of a robot.
const LIARS_LIMIT: u64 = 1000;
/// Maximum number of backup neighbors that are chosen for a robot.
const SPARES_MAX: u64 = 16;
/// Maximum memory limit of an external program, MB (1 TB).
const MEMORY_MB_MAX: u64 = 1 << 20;

impl FileFormat {
    /// Returns the scenario format with the control laws and avoidance methods of `catalog`.
    pub fn new(catalog: &Catalog) -> FileFormat {
        FileFormat {
            sections: FileFormat::sections(catalog),
            law_names: catalog.laws.iter().map(|law| law.name).collect(),
            method_names: catalog.methods.iter().map(|method| method.name).collect(),
        }
    }

    /// Returns all tables of a scenario, in the order of the reference.
    fn sections(catalog: &Catalog) -> Vec<Section> {
        let gains = gain_keys_of_laws(catalog);
        let faults = FAULT_SYNTAXES.iter().map(|form| KindSpec {
            name: form.kind,
            description: form.description,
            required_keys: form.required_keys(),
            optional_keys: form.optional_keys(),
        });
        vec![
            table_section::<Root>(),
            table_section::<Realtime>(),
            table_section::<Avoidance>()
                .with_keys(gain_keys_of_methods(catalog))
                .with_withdrawn_keys(WITHDRAWN_AVOIDANCE_KEYS),
            table_section::<Silence>(),
            table_section::<Law>(),
            table_section::<Plant>(),
            table_section::<RobotDefaults>().with_keys(gains.clone()),
            table_section::<Robot>().with_keys(gains),
            table_section::<Pose>(),
            table_section::<Wheels>(),
            table_section::<Limits>(),
            table_section::<Disk>(),
            table_section::<Edge>(),
            table_section::<Wall>(),
            table_section::<Obstacle>().with_kinds([
                KindSpec::new("disc", "a disc", "center_m radius_m", ""),
                KindSpec::new("polygon", "a convex polygon", "corners_m", ""),
            ]),
            table_section::<Trajectory>().with_kinds(trajectory_kinds()),
            table_section::<Scale>().with_kinds(scale_kinds()),
            table_section::<Fault>().with_kinds(faults),
            table_section::<Chaos>(),
            table_section::<Metric>(),
            table_section::<Expect>(),
            table_section::<ExpectMetric>(),
            table_section::<Hunt>(),
        ]
    }
}

/// Returns the keys of the gains of all control laws. Each is required by the laws that use it.
fn gain_keys_of_laws(catalog: &Catalog) -> Vec<KeySpec> {
    let mut gains: Vec<KeySpec> = Vec::new();
    for &name in catalog.laws.iter().flat_map(|law| law.gain_keys) {
        if gains.iter().all(|gain| gain.name != name) {
            let users = catalog.laws.iter().filter(|law| law.gain_keys.contains(&name));
            let users: Vec<_> = users.map(|law| format!("`{}` {}", law.name, law.source)).collect();
            let laws = if users.len() == 1 { "law" } else { "laws" };
            let meaning = gain_meaning(name);
            let description = format!("{meaning}; used by the {laws} {}", users.join(", "));
            let mut key = gain_key(name, "needed with a law that uses it".into(), description);
            if catalog.laws.iter().any(|law| law.gain_range(name).is_some()) {
                key.value_type = Number(Any);
            }
            gains.push(key);
        }
    }
    gains
}

fn gain_keys_of_methods(catalog: &Catalog) -> Vec<KeySpec> {
    let gains = catalog.methods.iter().flat_map(|m| m.gains.iter().map(move |g| (m.name, g)));
    let key = |(name, g): (&str, &Gain)| {
        let needed_with = format!("needed with `{name}`");
        gain_key(g.key, needed_with.into(), format!("{}; for `{name}`", g.meaning))
    };
    gains.map(key).collect()
}

/// Returns the meaning of a gain of a built-in control law, or "gain of a control law" for any other gain.
fn gain_meaning(name: &str) -> &'static str {
    match name {
        "speed_m_s" => "mu: speed at which the robot moves straight to its desired point",
        "k_m_m_s" => {
            "k_m: maximum velocity, along each axis, with which the leader corrects its tracking error"
        }
        "k_f_m_s" => {
            "k_f: maximum velocity, along each axis, with which the robot corrects its formation error"
        }
        "k_c_m_s" => {
            "k_c: maximum velocity, along each axis, with which the robot moves to the mean of its in-neighbors"
        }
        "k_g_m_s" => {
            "k_g: maximum velocity, along each axis, with which the robot moves to its goal"
        }
        LIARS_MAX_KEY => {
            "F: maximum number of Byzantine in-neighbors of a robot. The robot discards up to F extreme values on either \
             side"
        }
        _ => "gain of a control law",
    }
}

/// Returns the key of a positive gain. `needed_with` names its users.
fn gain_key(name: &'static str, needed_with: Cow<'static, str>, description: String) -> KeySpec {
    if name == LIARS_MAX_KEY {
        return key(name, Integer(1, LIARS_LIMIT))
            .rule(needed_with, description)
            .with_synonyms("f liars f_max liars_max_count adversaries");
    }
    let guesses = match name {
        "speed_m_s" => "mu gain k v velocity",
        "k_f_m_s" => "kf k_formation mu_f",
        "k_c_m_s" => "kc k_containment k_contained mu_c",
        "k_m_m_s" => "km k_m k_leader mu_m",
        "k_g_m_s" => "kg k_g k_goal",
        "epsilon_per_s" => "eps e strength",
        _ => "",
    };
    key(name, Number(Positive)).rule(needed_with, description).with_synonyms(guesses)
}

/// Constants of the deflection, which were keys of earlier versions.
const WITHDRAWN_AVOIDANCE_KEYS: &[WithdrawnKeys] = &[WithdrawnKeys {
    names: &[
        "dither_rad",
        "around",
        "around_at_last",
        "impatience_time",
        "slack_share",
        "margin",
        "look_ahead",
        "look_ahead_share",
        "look_ahead_turn_rad",
        "yield",
        "yield_speed",
        "yield_reach",
    ],
    remedy: "expected no such key: `guard` steers with constants that were found by search",
}];

use NumberRange::{Any, NotNegative, NotZero, Positive};
use ValueType::{Integer, Number};

/// Table `[plant]`: an external program that simulates the robots.
#[derive(Debug)]
pub enum Plant {}

tables! {
    Root "scenario" "One experiment." has Root;
    Realtime "realtime" "Latencies that the experiment tolerates, in real time." has Realtime;
    Avoidance "avoidance" "Collision avoidance: the method, the distances that it keeps, and its parameters." has Avoidance;
    Silence "silence" "Communication timeouts: when an in-neighbor counts as stale and as lost, and what a robot does then." has Silence;
    Law "law" "A control law that an external program computes: a table `[laws.NAME]`." has Law, Program, ProgramFiles;
    Plant "plant" "An external program that simulates the robots, in place of the built-in exact unicycle model." has Program, ProgramFiles;
    RobotDefaults "robot_defaults" "Default values of keys that a `[[robot]]` does not set." has RobotDefaults;
    Robot "robot" "One robot: its name, start, control law, neighbors and hardware." has Robot, RobotDefaults;
    Pose "pose" "A pose in the frame `map`." has Pose;
    Wheels "wheels" "Differential drive: maximum wheel speed and track width." has Wheels;
    Limits "limits" "Inertia: maximum accelerations of the robot." has Limits;
    Disk "disk" "Communication by distance: each robot with the role `free` or `goal` receives the beacons of all robots within a radius, in \
        addition to its edges." has Disk;
    Edge "edge" "A directed communication link: the robot `to` receives the beacons of the robot `from`." has Edge;
    Wall "wall" "A wall: a chain of line segments." has Wall;
    Obstacle "obstacle" "A fixed obstacle." has Obstacle;
    Trajectory "trajectory" "Reference trajectory of the leader's front point." has Trajectory;
    Scale "scale" "Time-varying scale of the formation." has Scale;
    Fault "fault" "An injected fault." has Fault;
    Chaos "chaos" "Kills, freezes and partitions at random times, drawn from the seed." has Chaos;
    Metric "metric" "A metric of the experiment's own, computed from a signal of the laws or by a program: a table `[metrics.NAME]`." has Metric, ProgramFiles;
    Expect "expect" "Acceptance criteria. If one is missed, the exit code is not 0." has Expect;
    ExpectMetric "expect_metric" "Bounds of a metric: a table `[expect.metrics.NAME]`." has ExpectMetric;
    Hunt "hunt" "Search space of `phalanx hunt`: what it varies, and within which bounds." has Hunt;
}

keys! {
    /// Keys at the top level of a scenario file.
    pub Root,
    /// Settings of a run that are values of keys.
    pub struct Settings;

    format: Integer(FORMAT_VERSION, FORMAT_VERSION) =>
        .default("1", "version of the file format")
        .with_synonyms("version format_version schema");
    name: Text =>
        .required("a short name of the experiment, such as \"triangle\"")
        .with_synonyms("title id");
    description: Text =>
        .optional("description of the experiment, for readers of the file")
        .with_synonyms("comment about notes");
    duration_s: Time(Positive) as duration_ns: u64 =>
        .required("maximum duration of the run")
        .with_synonyms("end t_end tmax t_max t_final tf length horizon time total_time");
    end_after_converged_s: Time(Positive) as end_after_converged_ns: Option<u64> =>
        .optional("ends the run early: time for which the errors of all living robots must have stayed below \
            `converged_error_m`. They must also have been below it over the last 10 % of the run so \
            far, and no fault, opening or closing of the formation, or waypoint may still be to come")
        .with_synonyms("end_when_converged_s stop_when_converged_s settle_s early_stop_s");
    period_s: Time(Positive) as period_ns: u64 =>
        .required("control period T: time between two commands of a robot, such as 0.005")
        .with_bounds("above 0, to `duration_s`")
        .with_synonyms("dt t ts delta_t step time_step timestep sample_time sampling_time sampling_period \
            control_period cycle_time tick");
    seed: Integer(0, i64::MAX as u64) as seed: u64 =>
        .default("1", "seed of the random number generator, from which all random values are drawn, such as \
            lost messages, noise and `[chaos]`. In lockstep, the same file and seed give the same \
            run")
        .with_synonyms("random_seed rng_seed rng");
    record_hz: Number(Positive) as record_hz: f64 =>
        .default("100.0", "recording rate: samples per robot and second of run time, in `samples.csv` and in the recording. With more \
            than 128 robots the default is 12,800 Hz divided by their number")
        .with_synonyms("record record_rate sample_rate log_rate rate logging");
    record_messages: Boolean as record_messages: bool =>
        .default("false", "whether the messages of control laws are recorded at `record_hz`, as their senders published them, in \
            `messages.csv` and in the recording")
        .with_synonyms("messages log_messages save_messages");
    hung_after_s: Time(Positive) as hung_after_ns: u64 =>
        .default("60.0", "watchdog timeout in lockstep: maximum wall time that a process may take to answer, counted \
            while it runs or is blocked, not while it waits for a CPU core. After that the process counts \
            as hung, and the run ends with exit code 4")
        .with_bounds("0.1 to 1e7")
        .with_synonyms("hung timeout hang deadline");
    ready_after_s: Time(Positive) as ready_after_ns: u64 =>
        .default("10.0", "start timeout: maximum time that a robot's process may take to become ready, in lockstep and in real \
            time. It is counted while the process runs or is blocked, not while it waits for a CPU core")
        .with_bounds("0.1 to 3600")
        .with_synonyms("ready start_timeout startup_timeout start_limit import_timeout");
    stopped_after_s: Time(Positive) as stopped_after_ns: Option<u64> =>
        .rule("no limit; 60 if the environment variable `CI` is set", "maximum time in lockstep that a process may stay stopped by a SIGSTOP from outside of the run. After \
            that the run ends with exit code 4")
        .with_synonyms("stopped sigstop");
    published_velocity: Word<PublishedVelocity>(&[
                ("gamma", "the nominal velocity, computed by the control law"),
                ("gamma+beta", "the nominal velocity after collision avoidance"),
                ("differenced", "the difference quotient of the last two positions"),
            ]) as published_velocity: PublishedVelocity =>
        .default("'gamma'", "velocity that a robot publishes in its beacons, for control laws of its \
            out-neighbors that use it (feed-forward)");
    trajectory: Table<Trajectory> =>
        .rule("needed with a leader", "reference trajectory of the leader's front point")
        .with_synonyms("path reference m");
    scale: Table<Scale> =>
        .rule("constant 1", "scale of the formation as a function of time: a factor on all offsets between \
            robots")
        .with_synonyms("delta scaling");
    avoidance: Table<Avoidance> =>
        .required("collision avoidance: a table with `kind`, `distance_min_m`, `speed_max_m_s`")
        .with_synonyms("collision_avoidance collision safety guard repulsion");
    realtime: Table<Realtime> =>
        .optional("real time only: latencies that the experiment tolerates")
        .with_synonyms("real_time rt");
    silence: Table<Silence> =>
        .optional("communication timeouts: when an in-neighbor counts as stale and as lost");
    laws: NamedTables<Law> =>
        .optional("control laws that external programs compute, each a table `[laws.NAME]`");
    plant: Table<Plant> =>
        .optional("external program that simulates the robots, in place of the built-in simulator")
        .with_synonyms("simulator physics engine world hardware driver");
    robot_defaults: Table<RobotDefaults> =>
        .optional("default values of keys that a `[[robot]]` does not set")
        .with_synonyms("defaults default robots_defaults");
    robot: Tables<Robot> =>
        .required("the robots: at least one table headed `[[robot]]`, or robot = [{ ... }, ...]")
        .with_synonyms("robots agent agents node nodes vehicle vehicles");
    edge: Tables<Edge> =>
        .optional("communication links between robots; a robot can also list its in-neighbors with `hears`")
        .with_synonyms("edges link links neighbor neighbors neighbour neighbours connections adjacency");
    graph: FileOrTable<Disk> =>
        .optional("graph file with edges and optionally robots: .json (node-link), .csv (adjacency matrix) or .graphml; or \
            { kind = \"disk\", radius_m = 1.0 }, communication by distance, for robots with the role `free` or `goal`")
        .with_synonyms("graph_file network topology import");
    drop_edges_to_leaders: Boolean =>
        .default("false", "true: edges to a leader are dropped. false: they are an error. An undirected `graph` has such an edge \
            for each robot that receives from the leader")
        .with_synonyms("drop_edges ignore_edges_to_leaders");
    wall: Tables<Wall> =>
        .optional("walls: chains of line segments")
        .with_synonyms("walls lines segments boundary");
    obstacle: Tables<Obstacle> =>
        .optional("obstacles: discs and convex polygons")
        .with_synonyms("obstacles disc discs polygon polygons shelf shelves");
    fault: Tables<Fault> =>
        .optional("faults to inject")
        .with_synonyms("faults failure failures event events");
    chaos: Table<Chaos> =>
        .optional("kills, freezes and partitions at random times")
        .with_synonyms("random_faults chaos_monkey");
    metrics: NamedTables<Metric> =>
        .optional("metrics of the experiment's own, computed from signals of the laws or by programs, each a table `[metrics.NAME]`");
    expect: Table<Expect> =>
        .optional("acceptance criteria; if one is missed, the exit code is not 0")
        .with_synonyms("expectations expected assert require check");
    hunt: Table<Hunt> =>
        .optional("search space of `phalanx hunt`")
        .with_synonyms("search fuzz falsify");
    deputies: Names =>
        .optional("backup leaders, in order: while the main leader is lost, the first of them that is alive leads \
            the formation, from its own slot in it")
        .with_synonyms("deputy successors succession backup_leaders");
    repair: Word<String>(&[
                (
                    "none",
                    "a robot with a lost in-neighbor uses the others, according to `silence.policy`",
                ),
                ("spares", "it uses a backup neighbor in place of the lost in-neighbor"),
            ]) =>
        .default("'none'", "topology repair after a permanent loss of robots")
        .with_synonyms("heal healing self_healing reconnect");
    spares: Integer(0, SPARES_MAX) =>
        .default("2", "number of backup neighbors chosen for each robot that does not list its own")
        .with_synonyms("backups fallbacks");
    repair_after_s: Time(NotNegative) =>
        .default("0.5", "time for which an in-neighbor must be lost before a backup neighbor replaces it, and heard again \
            before it replaces the backup neighbor (hysteresis)")
        .with_synonyms("repair_after heal_after");
}

keys! {
    /// Keys of `[realtime]`.
    pub Realtime,
    /// Latencies that the experiment tolerates, and processes that run in real time only.
    pub struct RealtimeSettings;

    plant_tick_s: Time(Positive) as plant_tick_ns: u64 =>
        .default("0.001", "T_p: simulation step of the plant (the simulated robots and sensors) in real \
            time. A smaller step reduces latency and takes more CPU time. With more than 128 robots the default is their \
            number divided by 128,000 Hz, at most the control period")
        .with_synonyms("tick plant_period t_p");
    latency_allowed_s: Time(NotNegative) as latency_allowed_ns: u64 =>
        .default("0.002", "L: maximum latency from an odometry sample to the command that answers it, a part \
            of the command lifetime H. With a larger L the guard brakes earlier")
        .with_synonyms("l latency latency_max");
    between_hosts_s: Time(NotNegative) as between_hosts_latency_ns: u64 =>
        .default("0.0", "additional round-trip latency between the hosts of a fleet. The command lifetime H grows by it, \
            rounded up to whole periods. `--fleet` sets it to `latency_max_s` of the fleet file");
    hold_periods: Integer(1, HOLD_PERIODS_MAX) as hold_periods: u64 =>
        .default("2", "h: number of control periods for which the plant may hold a command if no newer one \
            arrives, a part of the command lifetime H. A larger h tolerates more late commands, \
            but the guard brakes earlier")
        .with_synonyms("h hold periods");
    control_timer: Boolean as control_timer: bool =>
        .default("true", "whether to run one more process, which only waits on the same timer as the robots and computes \
            nothing. Its wake-up latency is the baseline for that of the robots")
        .with_synonyms("control control_group baseline machine");
}

keys! {
    /// Keys of `[avoidance]`, without the gains of methods.
    pub Avoidance;

    kind: Method =>
        .rule("`guard`", "collision avoidance method")
        .with_synonyms("method type mode name");
    distance_min_m: Number(Positive) =>
        .required("d: minimum distance between two front points, unless robots have their own `keep_m`")
        .with_synonyms("d d_min dmin min_distance minimum_distance minimal_distance safe_distance \
            safety_distance distance radius");
    speed_max_m_s: Number(Positive) =>
        .rule("no limit; `guard` needs one", "v_max: maximum speed of a front point, unless a robot has its own")
        .with_synonyms("v_max vmax max_speed speed max_velocity velocity_max speed_limit v");
    clearance_m: Number(Positive) =>
        .rule("half of `distance_min_m`, or the largest `keep_m`", "minimum distance of a front point from walls \
            and obstacles")
        .with_synonyms("clearance wall_distance obstacle_distance margin d_o");
    sensing_radius_m: Number(Positive) =>
        .rule("the largest radius that the method can use", "sensing radius: distance up to which a robot senses other robots and walls")
        .with_synonyms("sensing sensor_range range sensing_range r_s");
    classes_sensed: Boolean =>
        .default("true", "in a team of robots with different `keep_m` or `speed_max_m_s`: whether a robot senses both \
            values of robots in range. If not, it assumes the largest of the team")
        .with_synonyms("classes sense_classes class_sensed senses_sizes");
    sensing_error_m: Number(NotNegative) =>
        .rule("0, or the bound of the noise faults", "maximum error of a sensed distance, which the guard \
            assumes. With a larger value robots keep farther apart")
        .with_synonyms("error sensing_noise");
    heading_error_rad: Number(NotNegative) =>
        .rule("0, or the bound of the noise faults", "maximum error of a robot's own sensed heading, which the guard assumes. With a larger value \
            robots keep farther apart")
        .with_synonyms("heading_noise heading_error_deg");
}

keys! {
    /// Keys of `[silence]`.
    pub Silence;

    stale_after_s: Time(Positive) =>
        .rule("3 periods", "age of an in-neighbor's newest beacon above which the in-neighbor counts as \
            stale: it is still used, extrapolated with its last velocity")
        .with_bounds("above 0, to `lost_after_s`")
        .with_synonyms("stale");
    lost_after_s: Time(Positive) =>
        .rule("20 periods, at least 0.1 s", "age of an in-neighbor's newest beacon above which the \
            in-neighbor counts as lost (timed out), and `policy` applies")
        .with_bounds("`stale_after_s` to 1e7")
        .with_synonyms("lost timeout");
    policy: Word<SilencePolicy>(&[
                ("last", "lost in-neighbors are ignored; if all are lost, as with `keep`"),
                ("ignore", "lost in-neighbors are ignored; a robot without any other in-neighbor stops"),
                ("keep", "lost in-neighbors are assumed to be at rest at their last extrapolated position"),
                ("stop", "a robot stops while any in-neighbor is lost"),
            ]) =>
        .default("'last'", "reaction of a robot to lost in-neighbors");
}

keys! {
    /// Keys of a control law in an external program, without those of the program.
    pub Law;

    role: Word<String>(&[
                ("leader", "the robot tracks the trajectory"),
                ("formation", "the robot keeps a slot in the formation"),
                ("contained", "the robot moves to the mean of its in-neighbors"),
                ("goal", "the robot moves to its `goal_m`"),
                ("free", "the law alone decides; it may name a target, by which the robot is judged"),
            ]) =>
        .required("role of the robots with this law; it determines the desired point, from which their error \
            is measured")
        .with_synonyms("kind type");
    gains: Texts =>
        .rule("none", "names of the gains of the law, each with the unit as suffix. They become keys of the robots with this law, must be given, and must be above 0 or within `gain_ranges`")
        .with_synonyms("parameters params gain");
    gain_ranges: Any("a table of ranges") =>
        .rule("all gains above 0", "lowest and highest value of some of the `gains`, such as { k_turn_per_s = [-2.0, 2.0] }")
        .with_synonyms("ranges gain_range gain_bounds");
    feed_forward: Boolean =>
        .default("false", "whether the law uses the velocities of its in-neighbors. If so, `phalanx check` checks that \
            velocity feedback between robots decays");
    correction_max: Text =>
        .optional("name of one of the `gains`, in m/s: the maximum, along each axis, of the velocity with \
            which the law corrects the error. Velocities of in-neighbors that the law adds do not \
            count. `phalanx check` computes its bounds on speed from it, and none without this key");
    params: Any("a table with any content") =>
        .rule("none", "parameters of the law, which its robots receive; `params` of a robot has precedence, key by key")
        .with_synonyms("parameter settings config options");
    message: Any("a table of shapes") =>
        .optional("message that the law sends with a beacon: named arrays of numbers, each with its shape, such as \
            { v_m_s = 2, plan_m = [20, 2], bid = 1 }; 8 bytes for each number, at most 65536 in all")
        .with_synonyms("messages publishes payload");
    message_bytes_max: Integer(1, MESSAGE_BYTES_MAX as u64) =>
        .optional("maximum length, in bytes, of a message without a structure that the law sends with a beacon, in place of \
            `message`")
        .with_synonyms("message_size message_bytes");
    message_queue: Integer(0, MESSAGE_QUEUE_LENGTH as u64) =>
        .default("0", "maximum number of messages of an in-neighbor that are kept between two calls of the law, which then receives all of \
            them. If more arrive, the oldest are dropped and counted in `messages_dropped`. 0: the law receives the newest one")
        .with_synonyms("queue queue_size message_buffer history");
    withholds: Boolean =>
        .default("false", "whether the law may send no beacon at a sample, as in event-triggered control. Neighbors \
            then extrapolate its position, and time it out after `silence.lost_after_s`")
        .with_synonyms("event_triggered withhold");
    sensing_radius_m: Number(Positive) =>
        .rule("the sensing radius of the avoidance method", "distance up to which a robot with this law senses other robots; all robots \
            of the scenario then sense at least as far. A sample holds the nearest 32 of them, or 16 with a method that senses velocities")
        .with_synonyms("sense_radius near_m sensing_m sensor_range_m");
    signals: Texts =>
        .rule("none", "names of numbers that the law records about itself, each with the unit as suffix, at most 16. They are \
            in `signals.csv`, in the report and in the recording, and `[metrics]` may use them")
        .with_synonyms("signal records record logs log");
}

keys! {
    /// Keys of the table `graph`.
    pub Disk;

    kind: Word<String>(&[("disk", "a robot is received while it is within a distance")]) =>
        .required("kind of the graph")
        .with_synonyms("type");
    radius_m: Number(Positive) =>
        .required("distance of the front points below which a robot is received")
        .with_synonyms("radius range range_m r_m distance_m");
    hysteresis_m: Number(NotNegative) =>
        .rule("5 % of `radius_m`", "distance beyond `radius_m` up to which a robot that is received stays received")
        .with_synonyms("hysteresis margin margin_m");
}

keys! {
    /// Keys of `[metrics.NAME]`.
    pub Metric;

    signal: Text =>
        .optional("name of one of the `signals` of the laws; this key or `program` is needed")
        .with_synonyms("of source name");
    program: Texts =>
        .optional("program that computes the metric from the directory of the run, its last argument, after the run: it prints \
            one JSON object with a number, or null, for each metric that names this program, such as { \"cost_m2\": 0.5 }. \
            The file rules are those of the program of a law")
        .with_synonyms("command cmd executable script run");
    deadline_s: Time(Positive) =>
        .default("60", "maximum time that the program may take")
        .with_synonyms("timeout timeout_s time_limit");
    over_time: Word<TimeReduction>(&[
                ("last", "the value that was recorded last"),
                ("mean", "the mean of all recorded values"),
                ("min", "the smallest recorded value"),
                ("max", "the largest recorded value"),
                ("sum", "the sum of all recorded values"),
            ]) =>
        .default("'last'", "reduction of the values that one robot recorded")
        .with_synonyms("time in_time");
    over_robots: Word<RobotReduction>(&[
                ("max", "the largest value of a robot"),
                ("min", "the smallest value of a robot"),
                ("mean", "the mean of the robots"),
                ("sum", "the sum of the robots"),
            ]) =>
        .default("'max'", "reduction of the values of the robots that recorded the signal and are alive at the end of the run")
        .with_synonyms("robots across");
}

keys! {
    /// Keys of `[expect.metrics.NAME]`.
    pub ExpectMetric;

    min: Number(Any) =>
        .optional("smallest allowed value; this key or `max` is needed")
        .with_synonyms("least lower at_least minimum");
    max: Number(Any) =>
        .optional("largest allowed value; this key or `min` is needed")
        .with_synonyms("most upper at_most maximum bound");
}

keys! {
    /// Keys of an external program.
    pub Program;

    program: Texts =>
        .required("the program and its arguments, as in [\"python3\", \"program.py\"]. Files among them must \
            be in the scenario's folder; they are copied into the directory of the run")
        .with_synonyms("command cmd executable script run");
}

keys! {
    /// Keys of the files and limits of an external program.
    pub ProgramFiles;

    files: Texts =>
        .rule("none", "additional files and folders that the program needs, relative to the scenario's folder. A folder is copied with its contents")
        .with_synonyms("data needs modules");
    memory_max_mb: Integer(1, MEMORY_MB_MAX) =>
        .rule("no limit", "memory limit in MB: for each process of the program (RLIMIT_DATA), and for all of them together")
        .with_synonyms("memory memory_max max_memory memory_limit");
}

keys! {
    /// Keys that only `[[robot]]` has.
    pub Robot;

    name: Text =>
        .required("unique name of the robot: a letter, then letters, digits, `-` or `_`")
        .with_synonyms("id label");
    pose: Table<Pose> =>
        .required("start pose, such as { x_m = 0.0, y_m = 0.0, heading_rad = 0.0 }")
        .with_synonyms("start position initial initial_pose x0 start_pose");
    goal_m: Pair =>
        .rule("needed with the role `goal`", "goal of the robot's front point, in the frame `map`")
        .with_synonyms("goal target destination end");
    goal_heading_rad: Number(Any) =>
        .optional("heading to which the robot turns in place at its goal; needs `front_point_m` = 0")
        .with_bounds("-2π to 2π")
        .with_synonyms("goal_heading final_heading goal_theta goal_yaw");
    hears: Names =>
        .optional("in-neighbors: names of the robots whose beacons this robot receives")
        .with_synonyms("neighbors neighbours listens_to heard");
    spares: Names =>
        .rule("chosen automatically", "backup neighbors, in order of preference, that replace lost in-neighbors; used with \
            `repair = \"spares\"`")
        .with_synonyms("backups fallbacks");
    deputies: Names =>
        .optional("backup leaders of this robot, if it is a secondary leader, in order: while it is lost, \
            the first of them that is alive takes its slot. They must be contained robots; used with \
            `repair = \"spares\"`")
        .with_synonyms("deputy successors");
}

keys! {
    /// Keys that both `[[robot]]` and `robot_defaults` have, without gains.
    pub RobotDefaults;

    place_m: Pair =>
        .rule("needed unless each edge has `offset_m`", "formation slot: desired position in the shape of \
            the formation. With a leader, x is forward and y to \
            the left of the leader's heading")
        .with_synonyms("slot formation place");
    params: Any("a table with any content") =>
        .rule("those of the law", "parameters of the law, if it is a program")
        .with_synonyms("parameter settings config options");
    front_point_m: Number(NotNegative) =>
        .rule("needed without a `model`", "ell: distance from the middle of the axle forward to the front \
            point, the point that control laws steer. With a smaller distance \
            the robot turns faster for the same velocity of that point. 0: control \
            laws steer the middle of the axle itself")
        .with_synonyms("ell l front lookahead look_ahead off_axis");
    drive: Word<DriveKind>(&[
                ("differential", "two driven wheels on one axle"),
                ("omni", "any velocity in the plane, as with mecanum wheels or as a drone at fixed height; control laws \
                    steer the center of the robot (`front_point_m` = 0)"),
                ("ackermann", "a car with steered front wheels, which turns with a radius of at least \
                    `turning_radius_min_m` and not in place; control laws steer the middle of the rear axle \
                    (`front_point_m` = 0)"),
            ]) =>
        .rule("that of the model, or 'differential'", "drive of the robot")
        .with_synonyms("kinematics body_type holonomic robot_type chassis");
    turn_rate_max_rad_s: Number(NotNegative) =>
        .rule("that of the model; that of the wheels where `front_point_m` is 0; otherwise no limit", "w_max: maximum turn \
            rate of the robot. 0 is allowed with `drive = \"omni\"`: the robot keeps its heading, as a drone may")
        .with_synonyms("w_max omega_max turn_rate_max max_turn_rate yaw_rate_max angular_speed_max");
    turning_radius_min_m: Number(Positive) =>
        .rule("that of the model; needed with `drive = \"ackermann\"`", "R_min: minimum turning radius of the middle of the rear axle of a \
            car: wheelbase / tan(maximum steering angle)")
        .with_synonyms("turning_radius min_turning_radius turn_radius r_min radius_min");
    keep_m: Number(Positive) =>
        .rule("half of `avoidance.distance_min_m`", "size: the part of this robot in minimum distances. The front points \
            of two robots keep the sum of their `keep_m`")
        .with_synonyms("keep keep_distance own_distance half_distance");
    speed_max_m_s: Number(Positive) =>
        .rule("that of `avoidance`, or of the model if it is lower", "v_max of this robot: maximum speed of its front point")
        .with_synonyms("own_speed v_max_own robot_speed_max");
    hold_periods: Integer(1, HOLD_PERIODS_MAX) =>
        .rule("that of `realtime`", "h of this robot: number of control periods for which the plant may hold its \
            commands")
        .with_synonyms("own_hold_periods");
    law: Law =>
        .rule("needed in `robot` or in `robot_defaults`", "control law of the robot")
        .with_synonyms("controller control control_law type kind role");
    wheels: Table<Wheels> =>
        .rule("that of the model, or no limit", "differential drive: maximum wheel speed and track width")
        .with_synonyms("wheel");
    model: Word<String>(models::MODEL_VALUES) =>
        .optional("a commercially available robot: supplies drive, front point, body, wheels, turn rate, turning radius, \
            speed and limits that are not given")
        .with_synonyms("robot_model platform vehicle body");
    body_radius_m: Number(Positive) =>
        .rule("that of the model, or unknown", "radius of the robot's body around the middle of the axle")
        .with_synonyms("body_radius robot_radius radius size");
    limits: Table<Limits> =>
        .rule("those of the model, or no inertia", "inertia: maximum accelerations")
        .with_synonyms("limit inertia acceleration accelerations dynamics");
    restart_policy: Word<RestartCondition>(&[
                ("never", "no restart"),
                ("on-failure", "restart after a signal or an exit code other than 0"),
                ("always", "restart after every exit"),
            ]) =>
        .default("'on-failure'", "restart policy for an unexpected exit of the robot's process")
        .with_synonyms("restart");
    max_restarts: Integer(0, 1_000_000) =>
        .default("3", "maximum number of restarts within `restart_window_s`; after them the robot is not \
            restarted and counts as failed")
        .with_synonyms("restarts_max restarts");
    restart_delay_s: Time(NotNegative) =>
        .default("0.5", "backoff: delay before the first restart; it doubles after each restart, up to \
            `max_restart_delay_s`")
        .with_synonyms("delay restart_after");
    max_restart_delay_s: Time(NotNegative) =>
        .rule("10 s, or `restart_delay_s` if that is longer", "maximum delay before a restart")
        .with_bounds("`restart_delay_s` to 1e7")
        .with_synonyms("restart_delay_max");
    restart_window_s: Time(Positive) =>
        .default("60.0", "time window over which restarts are counted")
        .with_synonyms("window");
}

keys! {
    /// Keys of a pose.
    pub Pose;

    x_m: Number(Any) =>
        .required("x of the middle of the axle")
        .with_synonyms("x0");
    y_m: Number(Any) =>
        .required("y of the middle of the axle")
        .with_synonyms("y0");
    heading_rad: Number(Any) =>
        .required("heading, counterclockwise from the x axis")
        .with_bounds("-2π to 2π")
        .with_synonyms("theta yaw phi angle theta0 orientation heading_deg");
}

keys! {
    /// Keys of `wheels`.
    pub Wheels;

    speed_max_m_s: Number(Positive) =>
        .rule("needed without a `model`", "maximum speed of a wheel's rim")
        .with_synonyms("v_max vmax max_speed speed limit");
    track_m: Number(Positive) =>
        .rule("needed without a `model`", "track width: distance between the two wheels")
        .with_synonyms("width wheelbase wheel_base base axle");
}

keys! {
    /// Keys of `limits`.
    pub Limits;

    acceleration_m_s2: Number(Positive) =>
        .rule("needed without a `model`", "a_v: maximum linear acceleration, also when braking")
        .with_synonyms("a a_v acceleration a_max linear_acceleration deceleration");
    turn_acceleration_rad_s2: Number(Positive) =>
        .rule("needed without a `model`", "a_w: maximum angular acceleration")
        .with_synonyms("a_w alpha angular_acceleration turn_acceleration");
    braking_time_s: Number(Positive) =>
        .rule("the longer of v_max / a_v and v_max / (2 a_w `front_point_m`); v_max / a_v where `front_point_m` is 0", "tau: maximum time to brake to rest from any command. It limits the turn rate of a front point to a_w tau")
        .with_synonyms("tau braking_time stopping_time");
    ramp: Word<Ramp>(&[
                ("together", "speed and turn rate reach their targets at the same time"),
                (
                    "independent",
                    "each changes at its own maximum acceleration, as with the `diff_drive_controller` of ROS 2; where \
                    `front_point_m` is 0, no other value is allowed",
                ),
            ]) =>
        .rule("'together', or 'independent' where `front_point_m` is 0", "whether speed and turn rate change together or independently of each other");
}

keys! {
    /// Keys of `[[edge]]`.
    pub Edge;

    from: Text =>
        .required("name of the sending robot")
        .with_synonyms("source src sender speaker heard start tail");
    to: Text =>
        .required("name of the receiving robot")
        .with_synonyms("target dst dest destination receiver hearer end head");
    offset_m: Pair =>
        .rule("difference of the `place_m` of the two robots", "c_ji: desired position of `to` relative to `from`. It rotates with the main leader's heading \
            and is multiplied by `scale`")
        .with_synonyms("c displacement delta d relative_position");
    params: Any("a table with any content") =>
        .rule("none", "parameters of the edge, such as its weight, which the law of `to` receives; that law is a program")
        .with_synonyms("parameter weight distance settings");
}

keys! {
    /// Keys of `[[wall]]`.
    pub Wall;

    points_m: Points =>
        .required("points of the wall, in order: [[0.0, 0.0], [1.0, 0.5]]")
        .with_synonyms("points corners vertices polyline");
    closed: Boolean =>
        .default("false", "whether a segment connects the last point with the first")
        .with_synonyms("loop cyclic");
}

keys! {
    /// Keys of `[[obstacle]]`.
    pub Obstacle;

    kind: Kind =>
        .required("shape: \"disc\" or \"polygon\"")
        .with_synonyms("type shape");
    center_m: Pair =>
        .required("center of the disc")
        .with_synonyms("centre position origin");
    radius_m: Number(Positive) =>
        .required("radius of the disc")
        .with_synonyms("r size");
    corners_m: Points =>
        .required("corners of the convex polygon, in order: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]")
        .with_synonyms("corners points vertices");
}

keys! {
    /// Keys of `[trajectory]`.
    pub Trajectory;

    kind: Kind =>
        .required("shape of the path: \"still\", \"line\", \"circle\", ...")
        .with_synonyms("type shape");
    center_m: Pair =>
        .rule("[0.0, 0.0]", "center of the path; for a line, its start point")
        .with_synonyms("centre origin start");
    velocity_m_s: Pair =>
        .required("velocity along the line")
        .with_synonyms("v speed");
    radius_m: Number(Positive) =>
        .required("radius; for a quadrifolium or lemniscate, half of its largest extent")
        .with_synonyms("r a amplitude");
    radii_m: Pair =>
        .required("half of the extent in x and in y")
        .with_synonyms("amplitudes radius");
    cycles: Pair =>
        .required("numbers of cycles per period in x and in y, two integers")
        .with_synonyms("frequencies ratio");
    phase_rad: Number(Any) =>
        .default("0.0", "phase of the x component")
        .with_synonyms("phi");
    period_s: Number(NotZero) =>
        .required("time for one revolution of the path; a negative value reverses the direction, so that a \
            circle runs clockwise")
        .with_synonyms("t turn clockwise");
    points_m: Points =>
        .required("waypoints, in order: [[0.0, 0.0], [1.0, 0.5]]")
        .with_synonyms("waypoints path");
    speed_m_s: Number(Positive) =>
        .required("speed along the path")
        .with_synonyms("v velocity");
    acceleration_m_s2: Number(Positive) =>
        .rule("`speed_m_s` per second", "acceleration from rest to `speed_m_s`")
        .with_synonyms("a acceleration_max a_max");
    closed: Boolean =>
        .default("false", "whether the path returns to its first point and repeats forever")
        .with_synonyms("loop cyclic repeat");
    keep_heading: Boolean =>
        .default("false", "true: the formation keeps its heading where the trajectory stops and reverses, as if the leader \
            drove backwards. false: the formation turns by 180 degrees after each such point")
        .with_synonyms("backwards reverse keep_frame");
}

keys! {
    /// Keys of `[scale]`.
    pub Scale;

    kind: Kind =>
        .default("'sine'", "type of the scale function: \"sine\" or \"closing\"")
        .with_synonyms("type shape");
    mean: Number(Positive) => .default("1.0", "mean of the scale, which is a factor on all offsets");
    amplitude: Number(NotNegative) =>
        .rule("0: constant scale", "amplitude of the oscillation; must be less than `mean`");
    period_s: Number(Positive) =>
        .rule("needed with `amplitude`", "period of the oscillation")
        .with_synonyms("t");
    from: Number(Positive) =>
        .rule("the scale at which the smallest gap between two slots is max(1.05, 0.625 sqrt(N)) times the gap that a \
            robot passes through, with N the number of robots that keep a slot", "scale of the open formation, at least 1")
        .with_synonyms("open start max");
    hold_s: Time(NotNegative) =>
        .rule("max(2.5 t, 0.25 t D), where t is the longest travel time from a start to its slot in the open \
            formation, and D the graph diameter in hops; times 1.5 if the graph has a directed cycle", "time for which the formation stays open")
        .with_synonyms("hold open_s wait");
    over_s: Time(Positive) =>
        .rule("the shortest time in which no slot moves faster than 0.75 times the speed of the robots", "duration \
            of the closing, and of each later opening")
        .with_synonyms("over duration close_s");
    reopen_at_s: Times =>
        .optional("times at which the formation starts to open again, for robots that return late: [120.0, 300.0]")
        .with_synonyms("reopen open_at again");
}

keys! {
    /// Keys of `[[fault]]`.
    pub Fault;

    at_s: Time(NotNegative) =>
        .required("start time of the fault, since the start of the run")
        .with_bounds("0 to less than `duration_s`")
        .with_synonyms("t time start when from");
    kind: Kind =>
        .required("kind of the fault: \"kill\", \"freeze\", \"cut\", ...")
        .with_synonyms("type fault what");
    robot: Text =>
        .required("name of the affected robot, or \"*\" for all robots")
        .with_synonyms("name agent target who");
    from: Text =>
        .required("name of the sending robot, or \"*\" for all robots")
        .with_synonyms("source sender");
    to: Text =>
        .required("name of the receiving robot, or \"*\" for all robots")
        .with_synonyms("receiver");
    stream: Word<RobotStream>(&[("odometry", "its sensor samples"), ("commands", "its velocity commands")]) =>
        .required("affected message stream of the robot: \"odometry\" or \"commands\"")
        .with_synonyms("what topic channel");
    sensor: Word<Sensor>(&[("odometry", "its own pose"), ("proximity", "positions of the robots in range")]) =>
        .required("affected sensor: \"odometry\" or \"proximity\"");
    hosts: Texts =>
        .required("names of the fleet hosts on one side of the partition; they cannot communicate with the other hosts")
        .with_synonyms("host side islands");
    for_s: Time(Positive) =>
        .rule("until the end of the run", "duration of the fault")
        .with_synonyms("duration length until lasts");
    restart_after_s: Time(Positive) =>
        .rule("no restart", "time from the kill to the start of the replacement process")
        .with_synonyms("restart back_after restart_delay");
    delay_s: Time(Positive) =>
        .required("time by which each affected message is delayed; with `slow`, each answer of the robot")
        .with_synonyms("by latency delay_ms");
    jitter_s: Time(NotNegative) =>
        .default("0.0", "maximum of the random time that is added to the delay of each message")
        .with_synonyms("jitter_ms");
    probability: Number(Positive) =>
        .required("fraction of the messages that is lost")
        .with_bounds("above 0, to 1")
        .with_synonyms("p rate share loss");
    burst: Integer(1, BURST_MESSAGES_MAX) =>
        .default("1", "number of consecutive messages lost together")
        .with_synonyms("burst_length");
    mean_burst_s: Time(Positive) =>
        .required("mean duration of the bad state, in which all messages are lost")
        .with_synonyms("mean_burst burst_time bad");
    range_m: Number(Positive) =>
        .required("distance at which 37 % (1/e) of the beacons arrive")
        .with_synonyms("range distance reach");
    exponent: Number(Positive) =>
        .default("2.0", "path loss exponent: 2 in free space. With a larger one the loss rises more steeply \
            around `range_m`")
        .with_synonyms("n path_loss");
    bound_m: Number(NotNegative) =>
        .required("maximum error of a sensed position")
        .with_bounds("0 to 1e9; above 0 without `heading_bound_rad`")
        .with_synonyms("amplitude sigma std noise bound");
    heading_bound_rad: Number(NotNegative) =>
        .default("0.0", "maximum error of the sensed heading; for the odometry only")
        .with_synonyms("heading heading_noise");
    by_m: Pair =>
        .optional("constant error of the position in the robot's beacons")
        .with_synonyms("offset_m lie_m by");
    drift_m_s: Pair =>
        .optional("velocity with which the position in the robot's beacons drifts from the true one; it is \
            also added to the velocity in them")
        .with_synonyms("drift velocity_m_s");
    random_m: Number(Positive) =>
        .optional("radius of the disc from which a new position error is drawn for every beacon")
        .with_synonyms("random radius_m");
    turn_rad: Number(Any) =>
        .optional("error added to the heading of the leader's frame that the robot relays in its beacons")
        .with_synonyms("turn heading_rad frame_rad");
    message_scale: Number(Any) =>
        .default("1.0", "factor on each number in the messages of the robot's law")
        .with_synonyms("scale factor");
    message_offset: Number(Any) =>
        .default("0.0", "constant error of each number in the messages of the robot's law, in the unit of the number")
        .with_synonyms("offset message_by");
    message_noise: Number(Positive) =>
        .optional("bound of a random error, drawn uniformly for each number of each message of the robot's law, in the unit \
            of the number")
        .with_synonyms("message_random amplitude");
    message_bit_flips: Number(Positive) =>
        .optional("probability with which each bit in the messages of the robot's law is inverted, also in messages without \
            a structure. A receiver refuses, and counts, messages with numbers that are not finite")
        .with_bounds("above 0, at most 1")
        .with_synonyms("bit_flips flips bit_error_rate");
    stuck: Boolean =>
        .rule("needed unless `speed_max_m_s` is given", "the wheels are stuck: the robot does not move");
    speed_max_m_s: Number(Positive) =>
        .rule("needed unless `stuck` is given", "maximum speed of the wheels' rims")
        .with_synonyms("v_max limit");
    processes: Integer(1, LOAD_PROCESSES_MAX) =>
        .required("number of extra processes, each of which takes as much CPU time as it can")
        .with_synonyms("count n number");
}

keys! {
    /// Keys of `[chaos]`.
    pub Chaos;

    mean_time_between_kills_s: Number(Positive) =>
        .optional("mean time between two kills in the whole run, each of a random robot; this key or \
            `mean_time_between_freezes_s` is needed")
        .with_synonyms("kills mtbf");
    restart_after_s: Time(Positive) =>
        .default("1.0", "time from a kill to the start of the replacement process")
        .with_synonyms("restart");
    mean_time_between_freezes_s: Number(Positive) =>
        .optional("mean time between two freezes in the whole run, each of a random robot")
        .with_synonyms("freezes");
    mean_freeze_s: Number(Positive) =>
        .default("0.5", "mean duration of a freeze")
        .with_synonyms("freeze");
    mean_time_between_partitions_s: Number(Positive) =>
        .optional("mean time between two partitions; during each, a random one of the `hosts` cannot communicate \
            with the others")
        .with_synonyms("partitions partition");
    mean_partition_s: Number(Positive) => .default("2.0", "mean duration of a partition");
    hosts: Texts =>
        .rule("needed with `mean_time_between_partitions_s`", "names of the fleet hosts \
            that partitions isolate, one at a time")
        .with_synonyms("host");
    from_s: Time(NotNegative) =>
        .default("0.0", "earliest time of a random fault")
        .with_synonyms("start");
    until_s: Time(NotNegative) =>
        .rule("the end of the run", "time after which no random fault starts")
        .with_synonyms("end to");
}

keys! {
    /// Keys of `[hunt]`.
    pub Hunt;

    vary: Texts =>
        .rule("starts, faults and delays", "what the search varies: \"starts\", \"faults\", \"delays\", \"noise\", \"gains\"")
        .with_synonyms("varies varied");
    faults_max: Integer(1, 20) =>
        .default("3", "maximum number of faults in a run")
        .with_synonyms("faults count n");
    kinds: Texts =>
        .rule("all kinds that a hunt supports, except \"lie\"", "kinds of faults to inject, such as \"freeze\" and \"cut\". \"lie\" \
            also falsifies the messages of laws that send any")
        .with_synonyms("kind fault_kinds");
    robots: Names =>
        .rule("all robots", "robots that faults may affect: the robot itself, or the sender of an affected link")
        .with_synonyms("robot targets");
    from_s: Time(NotNegative) =>
        .default("0.0", "earliest start time of a fault")
        .with_synonyms("start");
    until_s: Time(Positive) =>
        .rule("half of `duration_s`", "time by which every fault has ended")
        .with_bounds("above `from_s`, to `duration_s`")
        .with_synonyms("end to");
    box_m: Pair =>
        .rule("[4 d, 4 d]", "width and height of the box from which the start of each robot's front point is drawn; its \
            center is the start in the scenario")
        .with_bounds("each above 0")
        .with_synonyms("box size area");
    apart_m: Number(Positive) =>
        .rule("1.5 d", "minimum distance of two front points at the start; for two robots that start closer \
            in the scenario, their distance there")
        .with_synonyms("apart separation");
    delay_s_max: Time(Positive) =>
        .rule("4 `period_s`", "maximum delay of a link, of odometry, or of commands")
        .with_synonyms("delay latency delay_max latency_max");
    loss_max: Number(Positive) =>
        .default("0.5", "maximum fraction of the messages that is lost")
        .with_bounds("above 0, to 1")
        .with_synonyms("loss");
    noise_m_max: Number(Positive) =>
        .rule("0.05 d", "maximum error of a sensed position")
        .with_synonyms("noise noise_max");
    noise_heading_rad_max: Number(Positive) =>
        .default("0.02", "maximum error of a sensed heading")
        .with_synonyms("heading_noise noise_heading");
    message_error_max: Number(Positive) =>
        .default("1.0", "maximum offset, and maximum random error, of each number in a false message, in the unit of the number")
        .with_synonyms("message_error message_offset_max message_noise_max");
    gain_factors: Pair =>
        .rule("[0.5, 2]", "smallest and largest factor by which the search multiplies gains of the scenario")
        .with_bounds("each above 0, the first below the second")
        .with_synonyms("gains factors");
}

keys! {
    /// Keys of `[expect]`.
    pub Expect;

    min_distance_m: Number(Positive) =>
        .optional("minimum distance between two front points, at every tick")
        .with_synonyms("distance_min d d_min distance");
    min_distance_over_d: Number(Positive) =>
        .optional("minimum distance between two front points, divided by the minimum distance of the two robots, at \
            every tick: at least 1 if all keep their distance")
        .with_synonyms("distance_over_d relative_distance min_distance_fraction");
    min_clearance_m: Number(Positive) =>
        .optional("minimum distance of a front point from walls and obstacles, at every tick")
        .with_synonyms("clearance clearance_min");
    final_error_m_max: Number(Positive) =>
        .optional("maximum error of any living robot over the last 10 % of the run: the distance of its \
            front point from its desired point")
        .with_synonyms("final_error error_max max_error error");
    final_ideal_error_m_max: Number(Positive) =>
        .optional("maximum distance of any living robot from its slot in the ideal formation, computed from the \
            main leader's true pose and the planned graph, over the last 10 % of the run")
        .with_synonyms("final_ideal_error ideal_error ideal_error_m_max");
    tracking_error_m_max: Number(Positive) =>
        .optional("maximum tracking error of the main leader over the last 10 % of the run")
        .with_synonyms("tracking_error");
    hull_distance_m_max: Number(NotNegative) =>
        .optional("maximum distance of a contained robot from the convex hull of the leaders over the last 10 % of the run")
        .with_synonyms("hull_distance hull");
    converged_by_s: Number(Positive) =>
        .optional("latest time from which on the errors of all living robots must stay below \
            `converged_error_m`")
        .with_bounds("above 0, to `duration_s`")
        .with_synonyms("converged settling_time converged_at");
    recovered_within_s: Number(Positive) =>
        .optional("maximum time after the end of each fault until the errors of all living robots stay below `converged_error_m`")
        .with_synonyms("recovery recovered");
    alive_at_end: NamesOrCount =>
        .rule("no such criterion; the other criteria count all robots except those that a planned fault \
            leaves dead", "names of the robots that must be alive at the end, \
            or their minimum number. The other criteria then \
            count only these robots, or, with a number, only \
            the robots that are alive at the end")
        .with_synonyms("alive survivors living");
    deadline_misses_max: Integer(0, i64::MAX as u64) =>
        .optional("maximum number of deadline misses of all agents (commands sent after the agent's next \
            wake-up was due), in real time only")
        .with_synonyms("deadline_misses misses");
    exit: Integer(0, 255) =>
        .rule("0", "expected exit code of the run itself, before its criteria are evaluated")
        .with_synonyms("exit_code code");
    metrics: NamedTables<ExpectMetric> =>
        .optional("bounds of metrics of the experiment's own, each a table `[expect.metrics.NAME]`")
        .with_synonyms("metric");
    converged_error_m: Number(Positive) =>
        .default("0.01", "threshold below which an error counts as converged")
        .with_synonyms("tolerance converged_error epsilon");
}

fn trajectory_kinds() -> Vec<KindSpec> {
    vec![
        KindSpec::new("still", "a fixed point", "", "center_m"),
        KindSpec::new("line", "a straight line at a constant speed", "velocity_m_s", "center_m"),
        KindSpec::new("circle", "a circle", "radius_m period_s", "center_m"),
        KindSpec::new(
            "quadrifolium",
            "a rose curve with four petals",
            "radius_m period_s",
            "center_m",
        ),
        KindSpec::new(
            "lissajous",
            "a Lissajous curve",
            "radii_m cycles period_s",
            "center_m phase_rad keep_heading",
        ),
        KindSpec::new("lemniscate", "Bernoulli's lemniscate", "radius_m period_s", "center_m"),
        KindSpec::new(
            "waypoints",
            "a path of circular arcs through all points",
            "points_m speed_m_s",
            "acceleration_m_s2 closed keep_heading",
        ),
    ]
}

fn scale_kinds() -> [KindSpec; 2] {
    let closing =
        "open while the robots move to their slots, then closing to 1 along half a cosine";
    [
        KindSpec::new(
            "sine",
            "mean + amplitude sin(2 pi t / period)",
            "",
            "mean amplitude period_s",
        ),
        KindSpec::new("closing", closing, "", "from hold_s over_s reopen_at_s"),
    ]
}
