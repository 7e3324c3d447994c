//! Interactive faults, through the live view: the same actions as a scenario may plan, executed at once or,
//! in lockstep, at the next tick, before which the plant pauses. A request that is impossible in the
//! present state is rejected with a reason.
//!
//! A robot killed interactively stays dead until it is restarted interactively, because the restart policy
//! applies to unwanted deaths only. Planned faults still take place.

use std::collections::VecDeque;

use protocol::fault::LinkFaultKind;
use protocol::message::LinkFaultByHand;
use protocol::service::{Publisher, send_slice};

use super::{Run, RunError};
use crate::view::{Request, RequestedAction, View};
use experiment::scenario::FaultKind;
use run::lifecycle::{Event, Initiator, ProcessState};

/// Reason for rejecting a request.
type Refusal = String;

/// Live view, and the requests of its clients.
pub(super) struct ByHand<'a> {
    /// Live view; `None` without one.
    pub(super) view: Option<&'a mut View>,
    /// Requests that have not been executed or rejected.
    asked: VecDeque<Request>,
    /// Number of actions that were executed.
    pub(super) acts: u64,
    /// Sender of interactive link faults to each robot, in scenario order; empty unless links may be cut
    /// interactively.
    pub(super) links: Vec<Publisher<[LinkFaultByHand]>>,
}

impl<'a> ByHand<'a> {
    /// Creates the state without requests.
    pub(super) fn new(
        view: Option<&'a mut View>,
        links: Vec<Publisher<[LinkFaultByHand]>>,
    ) -> ByHand<'a> {
        ByHand { view, asked: VecDeque::new(), acts: 0, links }
    }

    /// Reads the pending requests of the live view. Returns whether there were any.
    pub(super) fn read_requests(&mut self) -> bool {
        let Some(view) = &self.view else { return false };
        let before = self.asked.len();
        self.asked.extend(std::iter::from_fn(|| view.request()));
        self.asked.len() > before
    }

    /// Returns whether a request waits for the next action.
    pub(super) fn has_requests(&self) -> bool {
        !self.asked.is_empty()
    }
}

impl Run<'_> {
    /// Reads the pending requests. They are executed with the next actions.
    pub(super) fn take_requests(&mut self) {
        if self.by_hand.read_requests() {
            self.set_next_pause();
        }
    }

    /// Executes the pending requests.
    pub(super) fn apply_requests(&mut self, now_ns: u64) -> Result<(), RunError> {
        while let Some(request) = self.by_hand.asked.pop_front() {
            let done = match self.intake.newest {
                Some(_) => self.do_by_hand(request.act, now_ns)?,
                None => Err("the run has not begun: not all robots are ready".into()),
            };
            request.answer(done);
        }
        Ok(())
    }

    fn do_by_hand(
        &mut self,
        act: RequestedAction,
        now_ns: u64,
    ) -> Result<Result<(), Refusal>, RunError> {
        if let Err(refusal) = self.check_possible(act) {
            return Ok(Err(refusal));
        }
        let who = Initiator::Hand;
        let event = match act {
            RequestedAction::Kill(robot) => {
                let fault = self.new_fault(&FaultKind::Kill { robot, restart_after_ns: None }, who);
                Event::Kill { robot, fault, restart_at_ns: None, who }
            }
            RequestedAction::Freeze(robot) => {
                let fault = self.new_fault(&FaultKind::Freeze { robot }, who);
                Event::Freeze { robot, fault, ends: false, who }
            }
            RequestedAction::Thaw(robot) => {
                let fault = self.course.lifecycles().frozen_by(robot).expect("it is frozen");
                Event::Thaw { robot, fault, who }
            }
            RequestedAction::Restart(robot) => Event::Restart { robot },
            RequestedAction::Cut(edge) => {
                self.link_event(now_ns, "cut", edge);
                let cut = FaultKind::Link { edge, kind: LinkFaultKind::Cut };
                let fault = self.new_fault(&cut, who);
                Event::Cut { edge, fault }
            }
            RequestedAction::Mend(edge) => {
                self.link_event(now_ns, "mend", edge);
                Event::Mend { edge }
            }
        };
        self.by_hand.acts += 1;
        self.handle(now_ns, event)?;
        Ok(Ok(()))
    }

    /// Returns an error if the action is impossible in the present state.
    fn check_possible(&self, act: RequestedAction) -> Result<(), Refusal> {
        let name = |robot: usize| self.course.journal.name(robot);
        let is = |robot: usize| match self.course.lifecycles().process_state(robot) {
            ProcessState::Starting => "starting",
            ProcessState::Moving => "moving",
            ProcessState::Frozen => "frozen",
            ProcessState::Ending | ProcessState::Down => "dead",
        };
        let of_robot = |robot: usize, expected: &[&str]| match is(robot) {
            found if expected.contains(&found) => Ok(()),
            found => {
                Err(format!("{} is {found}, but must be {}", name(robot), expected.join(" or ")))
            }
        };
        let of_edge = |edge: usize, cut: bool| {
            let link = self.link(edge);
            if self.by_hand.links.is_empty() {
                return Err(format!(
                    "in lockstep only the scenario cuts links: --fault 'cut {link} @S for S', or cut \
                     interactively with --pace realtime"
                ));
            }
            match (self.course.lifecycles().is_cut(edge), cut) {
                (true, false) => Err(format!("{link} is already cut")),
                (false, true) => Err(format!("{link} was not cut interactively")),
                _ => Ok(()),
            }
        };
        match act {
            RequestedAction::Kill(robot) => of_robot(robot, &["starting", "moving", "frozen"]),
            RequestedAction::Freeze(robot) => of_robot(robot, &["moving"]),
            RequestedAction::Thaw(robot) => of_robot(robot, &["frozen"]),
            RequestedAction::Restart(robot) => of_robot(robot, &["dead"]),
            RequestedAction::Cut(edge) => of_edge(edge, false),
            RequestedAction::Mend(edge) => of_edge(edge, true),
        }
    }

    /// Registers an unplanned fault for the report and returns its number.
    pub(super) fn new_fault(&mut self, kind: &FaultKind, who: Initiator) -> usize {
        let what = format!("{}, {}", kind.describe(self.scenario), who.keyword());
        self.course.journal.metrics.register_fault(what, kind.struck(self.scenario))
    }

    /// Records that a link was cut or restored.
    fn link_event(&mut self, t_ns: u64, kind: &'static str, edge: usize) {
        let ends = self.scenario.graph.edges()[edge];
        let detail = format!("{}, {}", self.link(edge), Initiator::Hand.keyword());
        self.course.journal.link(t_ns, kind, [ends.from, ends.to], detail);
    }

    /// Sends to a robot which of its incoming links are cut interactively. The robot may be a replacement.
    pub(super) fn tell_links(&self, hearer: usize) -> Result<(), RunError> {
        let Some(publisher) = self.by_hand.links.get(hearer) else { return Ok(()) };
        let edges = self.scenario.graph.edges().iter().enumerate();
        let links: Vec<LinkFaultByHand> = edges
            .filter(|(_, edge)| edge.to == hearer)
            .map(|(place, edge)| LinkFaultByHand {
                robot: edge.from as u64 + 1,
                cut: u64::from(self.course.lifecycles().is_cut(place)),
            })
            .collect();
        send_slice(publisher, (), links.len(), |place| links[place])?;
        Ok(())
    }

    fn link(&self, edge: usize) -> String {
        let ends = self.scenario.graph.edges()[edge];
        format!("{}->{}", self.course.journal.name(ends.from), self.course.journal.name(ends.to))
    }
}
