//! Where its role wants each robot, from the truth about everybody.

use formation::Vec2;
use formation::desired::{Target, desired};
use formation::frame::LeaderFrame;
use formation::graph::Edge;
use formation::laplacian::settled;
use protocol::brief::{LeadBrief, SilencePolicy};
use protocol::law::Reference;

use crate::metrics::silence::Silent;
use experiment::scenario::Scenario;

/// What the errors of a scenario's robots are measured against.
pub(super) struct Targets {
    references: Vec<Reference>,
    /// For each robot, the edges that end in it, and their places in the graph; its spares behind them.
    heard: Vec<Vec<Ear>>,
    /// The trajectory of each that may lead, and its place about it, at heading 0 and scale 1, m.
    leads: Vec<Option<(LeadBrief, Vec2)>>,
    /// The goal of each, if it goes to one, m: the scenario's, until it is sent to another.
    goals: Vec<Option<Vec2>>,
    policy: SilencePolicy,
}

/// An edge, by its place in the graph, and in place of which others it counts, once for each entry, while those
/// from the deputies of a better rank are silent.
struct Ear {
    place: usize,
    ends: Edge,
    replaces: Vec<(usize, Vec<usize>)>,
}

impl Targets {
    pub(super) fn new(scenario: &Scenario) -> Targets {
        let edges = || scenario.graph.edges().iter().chain(&scenario.spares).copied().enumerate();
        let place_of = |from, to| edges().position(|(_, edge)| (edge.from, edge.to) == (from, to));
        let ear = |(place, ends): (usize, Edge)| {
            let planned = scenario.replaces(ends.to, ends.from).map(|lost| (lost, Vec::new()));
            let taken = scenario.successions_heard(ends.to).filter_map(|one| {
                let rank = one.deputies.iter().position(|&deputy| deputy == ends.from)?;
                let better = one.deputies[..rank].iter();
                Some((one.leader, better.filter_map(|&by| place_of(by, ends.to)).collect()))
            });
            let replaces = planned.chain(taken);
            let replaces = replaces
                .filter_map(|(lost, better)| Some((place_of(lost, ends.to)?, better)))
                .collect();
            Ear { place, ends, replaces }
        };
        let heard = |i| edges().filter(|(_, edge)| edge.to == i).map(ear).collect();
        Targets {
            references: scenario.robots.iter().map(|robot| robot.role.reference).collect(),
            heard: (0..scenario.robots.len()).map(heard).collect(),
            leads: (0..scenario.robots.len()).map(|i| lead_of(scenario, i)).collect(),
            goals: scenario.robots.iter().map(|robot| robot.goal_m.map(Vec2::from)).collect(),
            policy: scenario.silence.policy,
        }
    }

    /// A robot that goes to goals was sent to another one, m.
    pub(super) fn send(&mut self, robot: usize, goal: Vec2) {
        self.goals[robot] = Some(goal);
    }

    /// alpha_i - alpha*_i, m: alpha* is m(t) for the leader (25), its place about m(t) for a deputy that
    /// leads, the mean of what all heard ask for in a formation (13) (24) (45) and for a contained robot, which has offsets
    /// only while it takes a leader's place (46), and of those that go to goals the one in force; see `counted` for the silent. `None` for one that has nothing to go by.
    pub(super) fn error(
        &self,
        robot: usize,
        t_s: f64,
        frame: &LeaderFrame,
        alphas: &[Vec2],
        silent: &Silent,
    ) -> Option<Vec2> {
        let leading = self.leads[robot].as_ref().map(|(lead, place)| {
            Target::still(lead.trajectory.target_at(t_s).position + frame.offset(*place).position)
        });
        let target = match self.references[robot] {
            Reference::Trajectory => leading,
            Reference::Offsets if silent.leads(robot) => leading,
            Reference::Offsets | Reference::Middle => {
                self.mean(robot, alphas, silent, |c_ji| frame.offset(c_ji))
            }
            Reference::Goal => self.goals[robot].map(Target::still),
        };
        target.map(|target| alphas[robot] - target.position)
    }

    /// Those by which a robot's error is measured, as the policy on silence has it, each as often as it counts:
    /// those heard, who replaces somebody included; if nobody is, or if the silent are to count, all in-neighbours.
    fn counted(&self, robot: usize, silent: &Silent) -> impl Iterator<Item = &Edge> {
        let heard = &self.heard[robot];
        let speaks = |ear: &Ear| silent.carries(ear.place, ear.ends.from);
        let replaced = heard.iter().any(|ear| {
            if silent.is_spare(ear.place) { speaks(ear) } else { !silent.goes_by(ear.place) }
        });
        let keep = self.policy == SilencePolicy::Keep && !replaced;
        let all = keep || !heard.iter().any(speaks);
        let counted =
            heard.iter().filter(move |ear| (all && !silent.is_spare(ear.place)) || speaks(ear));
        counted.flat_map(move |ear| {
            let better = |place: &usize| heard.iter().any(|ear| ear.place == *place && speaks(ear));
            let counts = |(other, betters): &&(usize, Vec<usize>)| {
                !silent.goes_by(*other) && !betters.iter().any(better)
            };
            let replaced = ear.replaces.iter().filter(counts).count();
            let once = !silent.is_spare(ear.place) || ear.replaces.is_empty();
            std::iter::repeat_n(&ear.ends, usize::from(once) + replaced)
        })
    }

    fn mean(
        &self,
        robot: usize,
        alphas: &[Vec2],
        silent: &Silent,
        offset: impl Fn(Vec2) -> Target,
    ) -> Option<Target> {
        let counted = self.counted(robot, silent);
        let place = |ends: &Edge| Target::still(alphas[ends.from]);
        desired(counted.map(|ends| (place(ends), offset(ends.offset_m))))
    }
}

/// The trajectory of a robot that may lead, and its place about it, m.
fn lead_of(scenario: &Scenario, i: usize) -> Option<(LeadBrief, Vec2)> {
    let leader = scenario.leader()?;
    let lead = scenario.lead.clone()?;
    match scenario.deputies.contains(&i) {
        true => Some((lead, settled(&scenario.graph, leader)?[i])),
        false => (i == leader).then(|| (lead, Vec2::zeros())),
    }
}
