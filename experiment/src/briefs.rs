//! Process configurations (briefs): the part of the scenario that each process is given at its start.

use std::path::Path;

use formation::graph::Edge;
use formation::rewiring::{Purpose, Receiver};
use protocol::avoidance::Senses;
use protocol::brief::{
    AgentBrief, AvoidanceBrief, BodyBrief, DeputyBrief, Format, NeighborBrief, Pace, PlantBrief,
    PlantProgramBrief, ProgramBrief, SuccessionBrief, VERSION,
};
use protocol::fault::{LieFault, LinkFault, SensorFault, SlowFault, Span, Stream, WheelFault};
use protocol::law::Reference;
use protocol::law_message::hash_bytes;

use crate::check::planned_positions;
use crate::scenario::{Fault, FaultKind, Robot, Scenario};

/// Returns the configuration of the agent of robot `i` (from 0).
pub fn agent(scenario: &Scenario, i: usize, pace: Pace, run_root: &Path) -> AgentBrief {
    let robot = &scenario.robots[i];
    let rewiring = scenario.rewiring();
    let receiver = rewiring.receiver(i);
    let leaves_out_liars = robot.liars_max() > 0;
    // The place of a free robot says nothing of the formation.
    let leads = |other: usize| {
        let reference = scenario.robots[other].role.reference;
        reference.is_local() && reference != Reference::Free
    };
    let trusts = |other: usize| leaves_out_liars && leads(other);
    let sender = |edge: &Edge, faults: Vec<LinkFault>| NeighborBrief {
        name: scenario.robots[edge.from].name.clone(),
        index: edge.from + 1,
        offset_m: edge.offset_m.into(),
        faults,
        lies: lie_faults(scenario, edge.from, i),
        trusted: trusts(edge.from),
        replaces: receiver.replaced_by_plan(edge.from).map(|lost| lost + 1).collect(),
        message: scenario.message_format(edge.from).cloned(),
    };
    let edges = scenario.graph.edges().iter().enumerate();
    let neighbors = edges.filter(|(_, edge)| edge.to == i).map(|(e, edge)| {
        let faults = faults(scenario, |fault, span, seed| match &fault.kind {
            FaultKind::Link { edge, kind } if *edge == e => {
                Some(LinkFault { span, kind: kind.clone(), seed })
            }
            _ => None,
        });
        sender(edge, faults)
    });
    let in_graph = scenario.graph.edges().len();
    let receivers = scenario.graph_of_receivers();
    let spares = receivers.edges()[in_graph..].iter().filter(|edge| edge.to == i);
    let spares = spares.map(|edge| sender(edge, Vec::new()));
    AgentBrief {
        format: Format,
        name: robot.name.clone(),
        index: i + 1,
        run_root: run_root.into(),
        pace,
        period_ns: scenario.period_ns,
        plant_tick_ns: scenario.realtime.plant_tick_ns,
        command_lifetime_ns: scenario.command_lifetime_ns(pace),
        late_ns: scenario.late_ns(pace),
        front_point_m: robot.front_point_m,
        drive_kind: robot.drive_kind,
        turn_rate_max_rad_s: robot.turn_rate_max_rad_s,
        law: robot.law.clone(),
        gains: robot.gains.clone(),
        program: scenario.program(i).map(|_| ProgramBrief {
            phalanx: VERSION.to_owned(),
            role: robot.role.name.to_owned(),
        }),
        seed: law_seed(scenario.seed, i),
        place_m: robot.place_m,
        params: robot.params.clone(),
        withholds: robot.withholds,
        signals: robot.signals.iter().map(|&name| name.to_owned()).collect(),
        counts_sent: scenario.counts_sent(),
        message: scenario.message_format(i).cloned(),
        led: scenario.lead.is_some(),
        rank: scenario.rank(i),
        lead: scenario.lead_of(i).cloned(),
        deputy: deputy(scenario, i),
        scale: (scenario.lead.is_none() && robot.role.reference == Reference::Offsets)
            .then(|| scenario.unled_scale.clone())
            .flatten(),
        goal_m: robot.goal_m,
        goal_heading_rad: robot.goal_heading_rad,
        published_velocity: scenario.published_velocity,
        limits: robot.limits,
        avoidance: avoidance(scenario),
        silence: scenario.silence.clone(),
        slow: faults(scenario, |fault, span, _| match fault.kind {
            FaultKind::Slow { robot, delay_ns } if robot == i => Some(SlowFault { span, delay_ns }),
            _ => None,
        }),
        odometry_faults: stream_faults(scenario, i, Stream::Odometry),
        command_faults: stream_faults(scenario, i, Stream::Commands),
        repair_after_ns: scenario.repair_after_ns.unwrap_or(0),
        links_by_hand: false,
        goals_from_outside: false,
        neighbors: neighbors.collect(),
        spares: spares.collect(),
        successions: successions(receiver, i),
    }
}

/// Returns the seed of the random numbers of robot `i`'s own law, at most 63 bits because TOML has no more.
fn law_seed(seed: u64, i: usize) -> u64 {
    let place = (i as u64 + 1).to_le_bytes();
    hash_bytes(hash_bytes(0, &seed.to_le_bytes()), &place) >> 1
}

/// Returns the backup leaders of the leaders that a robot hears.
fn successions(receiver: &Receiver, i: usize) -> Vec<SuccessionBrief> {
    let senders = receiver.senders().iter();
    let own = senders.filter(|sender| sender.purpose == Purpose::LeaderSlot);
    let own: Vec<usize> = own.map(|sender| sender.robot + 1).collect();
    let told = receiver.successions().iter().map(|one| SuccessionBrief {
        leader: one.leader + 1,
        deputies: one.deputies.iter().map(|deputy| deputy + 1).collect(),
        by: if one.deputies.contains(&i) { own.clone() } else { Vec::new() },
    });
    told.collect()
}

/// Returns the configuration of a backup leader.
fn deputy(scenario: &Scenario, i: usize) -> Option<DeputyBrief> {
    let rank = 1 + scenario.repair.deputies.iter().position(|&deputy| deputy == i)? as u64;
    let (leader, lead) = (scenario.leader()?, scenario.lead.clone()?);
    let places = planned_positions(scenario)?;
    let Robot { front_point_m, drive_kind, turn_rate_max_rad_s, limits, .. } =
        scenario.robots[leader];
    let place_m = (places[i] - places[leader]).into();
    Some(DeputyBrief {
        rank,
        place_m,
        front_point_m,
        drive_kind,
        turn_rate_max_rad_s,
        limits,
        lead,
    })
}

/// Returns the configuration of the avoidance method, with only the gains of that method.
fn avoidance(scenario: &Scenario) -> AvoidanceBrief {
    let mut avoidance = scenario.avoidance.clone();
    let own = |key: &str| scenario.method.gains.iter().any(|gain| gain.key == key);
    avoidance.gains.retain(|key, _| own(key));
    avoidance
}

/// Returns the configuration of the plant.
pub fn plant(scenario: &Scenario, pace: Pace, run_root: &Path) -> PlantBrief {
    let robots = scenario.robots.iter().enumerate().map(|(i, robot)| BodyBrief {
        name: robot.name.clone(),
        front_point_m: robot.front_point_m,
        drive_kind: robot.drive_kind,
        turn_rate_max_rad_s: robot.turn_rate_max_rad_s,
        wheels: robot.wheels,
        limits: robot.limits,
        start: robot.start,
        sensor_faults: faults(scenario, |fault, span, seed| match fault.kind {
            FaultKind::Sensor { robot, sensor, kind } if robot == i => {
                Some(SensorFault { span, sensor, kind, seed })
            }
            _ => None,
        }),
        wheel_faults: faults(scenario, |fault, span, _| match fault.kind {
            FaultKind::Wheels { robot, kind } if robot == i => Some(WheelFault { span, kind }),
            _ => None,
        }),
        command_faults: stream_faults(scenario, i, Stream::Commands),
    });
    let avoidance = &scenario.avoidance;
    PlantBrief {
        format: Format,
        run_root: run_root.into(),
        pace,
        duration_ns: scenario.duration_ns,
        period_ns: scenario.period_ns,
        plant_tick_ns: scenario.realtime.plant_tick_ns,
        command_lifetime_ns: scenario.command_lifetime_ns(pace),
        distance_min_m: avoidance.distance_min_m,
        speed_max_m_s: scenario.method.clamps_speed.then_some(avoidance.speed_max_m_s),
        sensing_radius_m: avoidance.sensing_radius_m,
        velocities_sensed: scenario.method.senses == Senses::Velocities,
        clearance_m: avoidance.clearance_m,
        program: scenario.plant.as_ref().map(|_| PlantProgramBrief { phalanx: VERSION.to_owned() }),
        obstacles: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
        robots: robots.collect(),
    }
}

/// Returns the Byzantine faults of `robot` in its beacons to `hearer`.
fn lie_faults(scenario: &Scenario, robot: usize, hearer: usize) -> Vec<LieFault> {
    faults(scenario, |fault, span, seed| match fault.kind {
        FaultKind::Lie { robot: liar, hearer: only, lie }
            if liar == robot && only.is_none_or(|only| only == hearer) =>
        {
            Some(LieFault { span, lie, seed })
        }
        _ => None,
    })
}

/// Returns the faults of a message stream of a robot.
fn stream_faults(scenario: &Scenario, i: usize, of: Stream) -> Vec<LinkFault> {
    faults(scenario, |fault, span, seed| match &fault.kind {
        FaultKind::Stream { robot, stream, kind } if *robot == i && *stream == of => {
            Some(LinkFault { span, kind: kind.clone(), seed })
        }
        _ => None,
    })
}

/// Returns the results of `of` for the faults of the scenario, skipping `None`. Each gets a seed of its own.
fn faults<T>(scenario: &Scenario, of: impl Fn(&Fault, Span, u64) -> Option<T>) -> Vec<T> {
    let numbered = (0u64..).zip(&scenario.faults);
    let seed = |number: u64| scenario.seed.wrapping_mul(1 << 20).wrapping_add(number);
    numbered.filter_map(|(number, fault)| of(fault, fault.span(), seed(number))).collect()
}
