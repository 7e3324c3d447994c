//! Target position that its role gives each robot, computed from the ground truth.

use std::collections::VecDeque;

use formation::Vec2;
use formation::desired::{Target, mean_target};
use formation::frame::OffsetTransform;
use formation::graph::Edge;
use formation::laplacian::settled_positions;
use formation::ns_to_seconds;
use formation::rewiring::Rewiring;
use protocol::brief::{LeadBrief, SilencePolicy};
use protocol::law::Reference;

use crate::metrics::silence::SilenceState;
use experiment::scenario::Scenario;

/// Targets with respect to which the errors of a scenario's robots are measured.
pub(super) struct Targets {
    references: Vec<Reference>,
    /// Links of each robot. Links from backup neighbors follow the edges of the graph.
    rewiring: Rewiring,
    /// Trajectory of each robot that may lead, and its slot about the trajectory at heading 0 and scale 1, m.
    lead_briefs: Vec<Option<Box<(LeadBrief, Vec2)>>>,
    /// Current goal of each robot that goes to goals, m; initially that of the scenario.
    goals: Vec<Option<Vec2>>,
    policy: SilencePolicy,
    /// Targets that the laws of free robots named, oldest first, with the run time of their samples, ns.
    own_targets: Vec<VecDeque<(u64, Option<Target>)>>,
}

impl Targets {
    pub(super) fn new(scenario: &Scenario) -> Targets {
        Targets {
            references: scenario.robots.iter().map(|robot| robot.role.reference).collect(),
            rewiring: scenario.rewiring(),
            lead_briefs: (0..scenario.robots.len())
                .map(|i| lead_brief_and_slot(scenario, i).map(Box::new))
                .collect(),
            goals: scenario.robots.iter().map(|robot| robot.goal_m.map(Vec2::from)).collect(),
            policy: scenario.silence.policy,
            own_targets: vec![VecDeque::new(); scenario.robots.len()],
        }
    }

    /// Sets a new goal, m, for a robot that goes to goals.
    pub(super) fn set_goal(&mut self, robot: usize, goal: Vec2) {
        self.goals[robot] = Some(goal);
    }

    /// Sets the target that the law of a free robot named at its sample of run time `t_ns`, ns. It counts for later
    /// ground-truth samples.
    pub(super) fn set_own_target(&mut self, robot: usize, t_ns: u64, target: Option<Target>) {
        if self.references[robot] == Reference::LawTarget {
            self.own_targets[robot].push_back((t_ns, target));
        }
    }

    /// Drops the targets of free robots that a newer one before run time `t_ns`, ns, replaces.
    pub(super) fn drop_replaced_targets(&mut self, t_ns: u64) {
        for targets in &mut self.own_targets {
            while targets.get(1).is_some_and(|(named_ns, _)| *named_ns < t_ns) {
                targets.pop_front();
            }
        }
    }

    /// Returns whether the robot is free: without a target of its law, it has no error.
    pub(super) fn is_free(&self, robot: usize) -> bool {
        self.references[robot] == Reference::LawTarget
    }

    /// Returns the target of a free robot at run time `t_s`, s, as its law named it before.
    fn own_target(&self, robot: usize, t_s: f64) -> Option<Target> {
        let (named_ns, target) = self.own_targets[robot].front()?;
        let age_s = t_s - ns_to_seconds(*named_ns);
        (age_s > 0.0).then_some(())?;
        target.map(|target| target.extrapolate(age_s))
    }

    /// Returns alpha_i - alpha*_i, m, or `None` for a robot without a reference.
    ///
    /// alpha* is m(t) for the leader (25); the slot about m(t) for a deputy that leads; the mean of the
    /// in-neighbors' positions plus offsets in a formation (13) (24) (45) and for a follower, which has offsets only
    /// while it takes over a leader's slot (46); and the current goal for a robot that goes to goals. During silence,
    /// `counted_edges` selects the in-neighbors.
    pub(super) fn robot_error(
        &self,
        robot: usize,
        t_s: f64,
        frame: &OffsetTransform,
        alphas: &[Vec2],
        silence: &SilenceState,
    ) -> Option<Vec2> {
        let leader_target = self.lead_briefs[robot].as_deref().map(|(lead, slot)| {
            Target::at_rest(lead.trajectory.target_at(t_s).position + frame.apply(*slot).position)
        });
        let target = match self.references[robot] {
            Reference::Trajectory => leader_target,
            Reference::Offsets if silence.is_acting_deputy(robot) => leader_target,
            Reference::Offsets | Reference::NeighborMean => {
                self.mean_neighbor_target(robot, alphas, silence, |c_ji| frame.apply(c_ji))
            }
            Reference::Goal => self.goals[robot].map(Target::at_rest),
            Reference::LawTarget => self.own_target(robot, t_s),
        };
        target.map(|target| alphas[robot] - target.position)
    }

    /// Returns the edges over which a robot's target is the mean, under the silence policy: the edges with beacons,
    /// replacements included, or all in-neighbors if there are no beacons or the policy keeps silent neighbors. An
    /// edge that replaces several others is repeated.
    fn counted_edges(&self, robot: usize, silence: &SilenceState) -> impl Iterator<Item = &Edge> {
        let (receiver, incoming) =
            (self.rewiring.receiver(robot), self.rewiring.incoming_links(robot));
        let links = self.rewiring.links();
        let is_spare = move |i: usize| silence.is_spare(incoming[i]);
        let is_used = move |i: usize| silence.is_used(incoming[i]);
        let has_beacons =
            move |i: usize| silence.carries_beacons(incoming[i], links[incoming[i]].from);
        let has_replacement =
            (0..incoming.len()).any(|i| if is_spare(i) { has_beacons(i) } else { !is_used(i) });
        let keeps_silent_neighbors = self.policy == SilencePolicy::Keep && !has_replacement;
        let counts_all = keeps_silent_neighbors || !(0..incoming.len()).any(has_beacons);
        let counted =
            (0..incoming.len()).filter(move |&i| (counts_all && !is_spare(i)) || has_beacons(i));
        counted.flat_map(move |i| {
            let is_counted = |other| other == i || has_beacons(other);
            let weight = receiver.reported_weight(i, is_used, is_counted);
            std::iter::repeat_n(&links[incoming[i]], weight)
        })
    }

    fn mean_neighbor_target(
        &self,
        robot: usize,
        alphas: &[Vec2],
        silence: &SilenceState,
        offset: impl Fn(Vec2) -> Target,
    ) -> Option<Target> {
        let position = |edge: &Edge| Target::at_rest(alphas[edge.from]);
        let desired = |edge: &Edge| (position(edge), offset(edge.offset_m));
        if silence.is_undisturbed() {
            let incoming = self.rewiring.incoming_links(robot);
            let in_neighbor_links = &incoming[..self.rewiring.receiver(robot).in_neighbor_count()];
            let links = self.rewiring.links();
            return mean_target(in_neighbor_links.iter().map(|&link| desired(&links[link])));
        }
        mean_target(self.counted_edges(robot, silence).map(desired))
    }
}

/// Returns the trajectory of a robot that may lead, and its slot about the trajectory, m.
fn lead_brief_and_slot(scenario: &Scenario, i: usize) -> Option<(LeadBrief, Vec2)> {
    let leader = scenario.leader()?;
    let lead = scenario.lead.clone()?;
    match scenario.repair_plan.deputies.contains(&i) {
        true => Some((lead, settled_positions(&scenario.graph, leader)?[i])),
        false => (i == leader).then(|| (lead, Vec2::zeros())),
    }
}
