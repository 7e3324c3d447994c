//! Process configurations (briefs): the part of the scenario that each process is given at its start.

use std::path::Path;

use formation::graph::{Edge, FormationGraph};
use formation::rewiring::{Receiver, Rewiring, SenderPurpose};
use formation::scale::Scale;
use protocol::avoidance::RequiredSensing;
use protocol::brief::{
    AgentBrief, AvoidanceBrief, BodyBrief, DeputyBrief, FormatVersion, NeighborBrief, Pace,
    PlantBrief, PlantProgramBrief, ProgramBrief, SuccessionBrief, VERSION,
};
use protocol::fault::{LieFault, LinkFault, RobotStream, SensorFault, SlowFault, Span, WheelFault};
use protocol::law::Reference;
use protocol::law_message::hash_bytes;

use crate::check::planned_positions;
use crate::scenario::{Fault, FaultKind, Robot, Scenario};

/// Configurations of all agents of a scenario. What all robots have in common is computed once.
pub struct AgentBriefs<'s> {
    scenario: &'s Scenario,
    rewiring: Rewiring,
    /// The graph of all beacons that any robot may receive.
    receiver_graph: FormationGraph,
    /// For each robot, the indices of its incoming edges in that graph.
    incoming_edges: Vec<Vec<usize>>,
}

impl<'s> AgentBriefs<'s> {
    /// Prepares the configurations of all agents.
    pub fn new(scenario: &'s Scenario) -> AgentBriefs<'s> {
        let receivers = scenario.graph_of_receivers();
        let mut incoming = vec![Vec::new(); scenario.robots.len()];
        let edges = receivers.edges().iter().enumerate();
        edges.for_each(|(e, edge)| incoming[edge.to].push(e));
        AgentBriefs {
            scenario,
            rewiring: scenario.rewiring(),
            receiver_graph: receivers,
            incoming_edges: incoming,
        }
    }

    /// Returns the configuration of the agent of robot `i` (from 0).
    pub fn brief(&self, i: usize, pace: Pace, run_root: &Path) -> AgentBrief {
        let &AgentBriefs {
            scenario,
            ref rewiring,
            receiver_graph: ref receivers,
            incoming_edges: ref incoming,
        } = self;
        let robot = &scenario.robots[i];
        let receiver = rewiring.receiver(i);
        let is_resilient = robot.liars_max() > 0;
        // The position of a free robot gives no information on the formation.
        let is_leader = |other: usize| {
            let reference = scenario.robots[other].role.reference;
            reference.is_local() && reference != Reference::LawTarget
        };
        let is_trusted = |other: usize| is_resilient && is_leader(other);
        let sender = |edge: &Edge, faults: Vec<LinkFault>, range| NeighborBrief {
            range,
            name: scenario.robots[edge.from].name.clone(),
            index: edge.from + 1,
            offset_m: edge.offset_m.into(),
            faults,
            lies: lie_faults(scenario, edge.from, i),
            trusted: is_trusted(edge.from),
            replaces: receiver.in_neighbors_replaced_by(edge.from).map(|lost| lost + 1).collect(),
            message: scenario.message_format(edge.from).cloned(),
            params: scenario.edge_params.get(&[edge.from, i]).cloned().unwrap_or_default(),
        };
        let edge_count = scenario.graph.edges().len();
        let split = incoming[i].partition_point(|&e| e < edge_count);
        let (neighbors, spares) = incoming[i].split_at(split);
        let neighbors = neighbors.iter().map(|&e| {
            sender(&receivers.edges()[e], link_faults(scenario, e), scenario.communication_range(e))
        });
        let spares = spares.iter().map(|&e| sender(&receivers.edges()[e], Vec::new(), None));
        AgentBrief {
            format: FormatVersion,
            name: robot.name.clone(),
            index: i + 1,
            run_root: run_root.into(),
            pace,
            period_ns: scenario.period_ns,
            plant_tick_ns: scenario.realtime.plant_tick_ns,
            command_lifetime_ns: scenario.command_lifetime_ns_of(i, pace),
            late_ns: scenario.command_delay_ns_max(pace),
            front_point_m: robot.front_point_m,
            drive_kind: robot.drive_kind,
            turn_rate_max_rad_s: robot.turn_rate_max_rad_s,
            turning_radius_min_m: robot.turning_radius_min_m,
            law: robot.law.clone(),
            gains: robot.gains.clone(),
            program: scenario.program(i).map(|_| ProgramBrief {
                phalanx: VERSION.to_owned(),
                role: robot.role.name.to_owned(),
            }),
            seed: law_seed(scenario.seed, i),
            place_m: robot.place_m,
            params: robot.params.clone(),
            message_queue: robot.queued_messages_max,
            withholds: robot.withholds_beacons,
            signals: robot.signals.iter().map(|&name| name.to_owned()).collect(),
            records_messages: scenario.recorded_message_format(i).is_some(),
            counts_sent: scenario.counts_sent_messages(),
            message: scenario.message_format(i).cloned(),
            led: scenario.lead.is_some(),
            rank: scenario.yield_rank(i),
            lead: scenario.lead_of(i).cloned(),
            deputy: deputy_brief(scenario, i),
            scale: leaderless_scale(scenario, i),
            goal_m: robot.goal_m,
            goal_heading_rad: robot.goal_heading_rad,
            published_velocity: scenario.published_velocity,
            limits: robot.acceleration_limits,
            avoidance: avoidance_brief(scenario, i, pace),
            silence: scenario.silence.clone(),
            slow: slow_faults(scenario, i),
            odometry_faults: stream_faults(scenario, i, RobotStream::Odometry),
            command_faults: stream_faults(scenario, i, RobotStream::Commands),
            repair_after_ns: scenario.repair_after_ns.unwrap_or(0),
            links_by_hand: false,
            goals_from_outside: false,
            neighbors: neighbors.collect(),
            spares: spares.collect(),
            successions: succession_briefs(receiver, i),
        }
    }
}

/// Returns the configuration of the agent of robot `i` (from 0). For several robots, use [`AgentBriefs`].
pub fn agent_brief(scenario: &Scenario, i: usize, pace: Pace, run_root: &Path) -> AgentBrief {
    AgentBriefs::new(scenario).brief(i, pace, run_root)
}

/// Returns the scale of a formation without a leader; `None` for a robot that keeps no slot in one.
fn leaderless_scale(scenario: &Scenario, i: usize) -> Option<Scale> {
    let keeps_slot = scenario.robots[i].role.reference == Reference::Offsets;
    scenario.leaderless_scale.clone().filter(|_| scenario.lead.is_none() && keeps_slot)
}

/// Returns the faults that delay the answers of robot `i`.
fn slow_faults(scenario: &Scenario, i: usize) -> Vec<SlowFault> {
    collect_faults(scenario, |fault, span, _| match fault.kind {
        FaultKind::Slowdown { robot, delay_ns } if robot == i => Some(SlowFault { span, delay_ns }),
        _ => None,
    })
}

/// Returns the faults of a link, given by the index of its edge.
fn link_faults(scenario: &Scenario, e: usize) -> Vec<LinkFault> {
    collect_faults(scenario, |fault, span, seed| match &fault.kind {
        FaultKind::Link { edge, kind } if *edge == e => {
            Some(LinkFault { span, kind: kind.clone(), seed })
        }
        _ => None,
    })
}

/// Returns the seed of the random numbers of robot `i`'s own law, at most 63 bits because TOML has no more.
fn law_seed(seed: u64, i: usize) -> u64 {
    let robot_number = (i as u64 + 1).to_le_bytes();
    hash_bytes(hash_bytes(0, &seed.to_le_bytes()), &robot_number) >> 1
}

/// Returns the backup leaders of the leaders among the in-neighbors of a robot.
fn succession_briefs(receiver: &Receiver, i: usize) -> Vec<SuccessionBrief> {
    let senders = receiver.senders().iter();
    let slot_keepers = senders.filter(|sender| sender.purpose == SenderPurpose::KeepLeaderSlot);
    let slot_keepers: Vec<usize> = slot_keepers.map(|sender| sender.robot + 1).collect();
    let briefs = receiver.successions().iter().map(|succession| SuccessionBrief {
        leader: succession.leader + 1,
        deputies: succession.deputies.iter().map(|deputy| deputy + 1).collect(),
        by: if succession.deputies.contains(&i) { slot_keepers.clone() } else { Vec::new() },
    });
    briefs.collect()
}

/// Returns the configuration of a backup leader.
fn deputy_brief(scenario: &Scenario, i: usize) -> Option<DeputyBrief> {
    let rank = 1 + scenario.repair_plan.deputies.iter().position(|&deputy| deputy == i)? as u64;
    let (leader, lead) = (scenario.leader()?, scenario.lead.clone()?);
    let positions = planned_positions(scenario)?;
    let Robot {
        front_point_m,
        drive_kind,
        turn_rate_max_rad_s,
        turning_radius_min_m,
        acceleration_limits: limits,
        ..
    } = scenario.robots[leader];
    let place_m = (positions[i] - positions[leader]).into();
    Some(DeputyBrief {
        rank,
        place_m,
        front_point_m,
        drive_kind,
        turn_rate_max_rad_s,
        turning_radius_min_m,
        limits,
        lead,
    })
}

/// Returns the configuration of the avoidance method, with only the gains of that method.
fn avoidance_brief(scenario: &Scenario, i: usize, pace: Pace) -> AvoidanceBrief {
    let mut avoidance = scenario.avoidance_of(i, pace).into_owned();
    let is_own_gain =
        |key: &str| scenario.avoidance_method.gains.iter().any(|gain| gain.key == key);
    avoidance.gains.retain(|key, _| is_own_gain(key));
    avoidance
}

/// Returns the configuration of the plant.
pub fn plant_brief(scenario: &Scenario, pace: Pace, run_root: &Path) -> PlantBrief {
    let robots = scenario.robots.iter().enumerate().map(|(i, robot)| BodyBrief {
        name: robot.name.clone(),
        front_point_m: robot.front_point_m,
        drive_kind: robot.drive_kind,
        turn_rate_max_rad_s: robot.turn_rate_max_rad_s,
        turning_radius_min_m: robot.turning_radius_min_m,
        member: scenario.member(i, pace),
        wheels: robot.wheels,
        limits: robot.acceleration_limits,
        start: robot.start,
        sensor_faults: collect_faults(scenario, |fault, span, seed| match fault.kind {
            FaultKind::Sensor { robot, sensor, kind } if robot == i => {
                Some(SensorFault { span, sensor, kind, seed })
            }
            _ => None,
        }),
        wheel_faults: collect_faults(scenario, |fault, span, _| match fault.kind {
            FaultKind::Wheels { robot, kind } if robot == i => Some(WheelFault { span, kind }),
            _ => None,
        }),
        command_faults: stream_faults(scenario, i, RobotStream::Commands),
    });
    let avoidance = &scenario.avoidance;
    PlantBrief {
        format: FormatVersion,
        run_root: run_root.into(),
        pace,
        duration_ns: scenario.duration_ns,
        period_ns: scenario.period_ns,
        plant_tick_ns: scenario.realtime.plant_tick_ns,
        command_lifetime_ns: scenario.command_lifetime_ns(pace),
        distance_min_m: avoidance.distance_min_m,
        speed_max_m_s: scenario.avoidance_method.clamps_speed.then_some(avoidance.speed_max_m_s),
        sensing_radius_m: avoidance.sensing_radius_m,
        velocities_sensed: scenario.avoidance_method.required_sensing
            == RequiredSensing::PositionsAndVelocities,
        clearance_m: avoidance.clearance_m,
        program: scenario
            .plant_program
            .as_ref()
            .map(|_| PlantProgramBrief { phalanx: VERSION.to_owned() }),
        obstacles: scenario.walls.iter().map(|wall| wall.shape.clone()).collect(),
        robots: robots.collect(),
    }
}

/// Returns the Byzantine faults of `robot` in its beacons to `receiver`.
fn lie_faults(scenario: &Scenario, robot: usize, receiver: usize) -> Vec<LieFault> {
    collect_faults(scenario, |fault, span, seed| match fault.kind {
        FaultKind::Lie { robot: sender, receiver: affected, lie }
            if sender == robot && affected.is_none_or(|affected| affected == receiver) =>
        {
            Some(LieFault { span, lie, seed })
        }
        _ => None,
    })
}

/// Returns the faults of a message stream of a robot.
fn stream_faults(scenario: &Scenario, i: usize, affected_stream: RobotStream) -> Vec<LinkFault> {
    collect_faults(scenario, |fault, span, seed| match &fault.kind {
        FaultKind::Stream { robot, stream, kind } if *robot == i && *stream == affected_stream => {
            Some(LinkFault { span, kind: kind.clone(), seed })
        }
        _ => None,
    })
}

/// Returns the results of `select` for the faults of the scenario, skipping `None`. Each gets a seed of its own.
fn collect_faults<T>(
    scenario: &Scenario,
    select: impl Fn(&Fault, Span, u64) -> Option<T>,
) -> Vec<T> {
    let numbered = (0u64..).zip(&scenario.faults);
    let seed = |number: u64| scenario.seed.wrapping_mul(1 << 20).wrapping_add(number);
    numbered.filter_map(|(number, fault)| select(fault, fault.span(), seed(number))).collect()
}
