//! What people do to a run by hand, through the live view: the same as a scenario may plan, at once
//! or, in lockstep, at the next tick, before which the plant pauses. What makes no sense now is
//! refused with a reason.
//!
//! Who was killed by hand stays dead until restarted by hand: whoever kills wants to see it dead,
//! and the restart policy is for deaths that nobody wanted. What the scenario plans still happens.

use protocol::fault::LinkFaultKind;
use protocol::message::LinkFaultByHand;
use protocol::service::send_slice;

use super::{Run, RunError};
use crate::robot::Seat;
use crate::timeline;
use experiment::scenario::FaultKind;
use metrics::fault::End;

/// Why something was not done.
type Refusal = String;

impl Run<'_> {
    /// Takes what was asked for; it is done when the next acts are.
    pub(super) fn take_requests(&mut self) {
        let Some(view) = &self.view else { return };
        let before = self.asked.len();
        self.asked.extend(std::iter::from_fn(|| view.request()));
        if self.asked.len() > before {
            self.set_next_pause();
        }
    }

    /// Does everything that was asked for.
    pub(super) fn act_by_hand(&mut self, now_ns: u64) -> Result<(), RunError> {
        while let Some(request) = self.asked.pop_front() {
            let done = match self.outcome.truth {
                Some(_) => self.do_by_hand(request.act, now_ns)?,
                None => Err("the run has not begun: not everybody is ready".into()),
            };
            request.answer(done);
        }
        Ok(())
    }

    fn do_by_hand(&mut self, act: view::Act, now_ns: u64) -> Result<Result<(), Refusal>, RunError> {
        if let Err(refusal) = self.makes_sense(act) {
            return Ok(Err(refusal));
        }
        match act {
            view::Act::Kill(robot) => {
                let kind = FaultKind::Kill { robot, restart_after_ns: None };
                let act = timeline::Act::Kill { robot, restart_at_ns: None };
                self.strike_by_hand(&kind, act, now_ns)?;
            }
            view::Act::Freeze(robot) => {
                let kind = FaultKind::Freeze { robot };
                self.strike_by_hand(&kind, timeline::Act::Freeze { robot }, now_ns)?;
            }
            view::Act::Thaw(robot) => {
                let fault = self.robots[robot].frozen_by.expect("it is frozen");
                let act = timeline::Act::Thaw { robot };
                self.act_on(timeline::Due { at_ns: now_ns, fault, act }, now_ns, BY_HAND)?;
            }
            view::Act::Restart(robot) => self.robots[robot].restart_at_ns = Some(now_ns),
            view::Act::Cut(edge) => {
                let fault = self.new_fault(&FaultKind::Link { edge, kind: LinkFaultKind::Cut });
                self.cuts[edge] = Some(fault);
                self.link_event(now_ns, "cut", edge)?;
                self.metrics.fault_began(fault, now_ns);
                self.metrics.fault_ended(fault, End::ForGood, now_ns);
            }
            view::Act::Mend(edge) => {
                let fault = self.cuts[edge].take().expect("it is cut");
                self.link_event(now_ns, "mend", edge)?;
                self.metrics.fault_ended(fault, End::Whole, now_ns);
            }
        }
        Ok(Ok(()))
    }

    /// Whether it can be done now.
    fn makes_sense(&self, act: view::Act) -> Result<(), Refusal> {
        let name = |robot: usize| self.robots[robot].name.as_str();
        let is = |robot: usize| match self.robots[robot].seat {
            Seat::Starting { .. } => "starting",
            Seat::Flying { .. } => "flying",
            Seat::Frozen { .. } => "frozen",
            Seat::Ending { .. } | Seat::Down => "dead",
        };
        let of_robot = |robot: usize, expected: &[&str]| match is(robot) {
            found if expected.contains(&found) => Ok(()),
            found => Err(format!("{} is {found}, expected {}", name(robot), expected.join(" or "))),
        };
        let of_edge = |edge: usize, cut: bool| {
            let link = self.link(edge);
            if self.faults_by_hand.is_empty() {
                return Err(format!(
                    "in lockstep only the scenario cuts links: --fault 'cut {link} @S for S', or cut \
                     by hand with --pace realtime"
                ));
            }
            match (self.cuts[edge].is_some(), cut) {
                (true, false) => Err(format!("{link} is cut already")),
                (false, true) => Err(format!("{link} was not cut by hand")),
                _ => Ok(()),
            }
        };
        match act {
            view::Act::Kill(robot) => of_robot(robot, &["starting", "flying", "frozen"]),
            view::Act::Freeze(robot) => of_robot(robot, &["flying"]),
            view::Act::Thaw(robot) => of_robot(robot, &["frozen"]),
            view::Act::Restart(robot) => of_robot(robot, &["dead"]),
            view::Act::Cut(edge) => of_edge(edge, false),
            view::Act::Mend(edge) => of_edge(edge, true),
        }
    }

    fn strike_by_hand(
        &mut self,
        kind: &FaultKind,
        act: timeline::Act,
        now_ns: u64,
    ) -> Result<(), RunError> {
        let fault = self.new_fault(kind);
        self.act_on(timeline::Due { at_ns: now_ns, fault, act }, now_ns, BY_HAND)
    }

    /// A fault of the report that is not the scenario's.
    fn new_fault(&mut self, kind: &FaultKind) -> usize {
        let (what, struck) = kind.struck(self.scenario);
        self.metrics.new_fault(format!("{what}, {BY_HAND}"), struck)
    }

    /// Writes down what became of a link, and tells the robot that hears.
    fn link_event(&mut self, t_ns: u64, kind: &str, edge: usize) -> Result<(), RunError> {
        let hearer = self.scenario.graph.edges()[edge].to;
        let detail = format!("{}, {BY_HAND}", self.link(edge));
        self.event(t_ns, kind, Some(hearer), &detail)?;
        self.tell_links(hearer)
    }

    /// Tells a robot which of its links are cut by hand: it may be a replacement.
    pub(super) fn tell_links(&self, hearer: usize) -> Result<(), RunError> {
        let Some(publisher) = self.faults_by_hand.get(hearer) else { return Ok(()) };
        let edges = self.scenario.graph.edges().iter().zip(&self.cuts);
        let links: Vec<LinkFaultByHand> = edges
            .filter(|(edge, _)| edge.to == hearer)
            .map(|(edge, cut)| LinkFaultByHand {
                robot: edge.from as u64 + 1,
                cut: u64::from(cut.is_some()),
            })
            .collect();
        send_slice(publisher, (), links.len(), |place| links[place])?;
        Ok(())
    }

    fn link(&self, edge: usize) -> String {
        let ends = self.scenario.graph.edges()[edge];
        format!("{}->{}", self.robots[ends.from].name, self.robots[ends.to].name)
    }
}

/// In events and reports.
const BY_HAND: &str = "by hand";
