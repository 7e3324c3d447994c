//! Interactive faults, through the live view: the same actions as a scenario may plan, executed at once or,
//! in lockstep, at the next tick, before which the plant pauses. A request that is impossible in the
//! present state is rejected with a reason.
//!
//! A robot killed interactively stays dead until it is restarted interactively, because the restart policy
//! applies to unwanted deaths only. Planned faults still take place.

use std::collections::VecDeque;

use protocol::fault::LinkFaultKind;
use protocol::message::LinkFaultByHand;
use protocol::service::{Publisher, SendError, send_slice};

use crate::view::{ClientRequest, RequestedAction, View};
use experiment::scenario::{FaultKind, Scenario};
use run::journal::Journal;
use run::lifecycle::{Initiator, LifecycleEvent, Lifecycles, ProcessState};
use run::state_machine::RunStateMachine;

/// Reason for rejecting a request.
pub(super) type Refusal = String;

/// Live view, and the requests of its clients.
pub(super) struct InteractiveActions<'a> {
    /// Live view; `None` without one.
    pub(super) view: Option<&'a mut View>,
    /// Requests that have not been executed or rejected.
    pending_requests: VecDeque<ClientRequest>,
    /// Number of actions that were executed.
    pub(super) executed_action_count: u64,
    /// Sender of interactive link faults to each robot, in scenario order; empty unless links may be cut
    /// interactively.
    link_fault_publishers: Vec<Publisher<[LinkFaultByHand]>>,
}

impl<'a> InteractiveActions<'a> {
    /// Creates the state without requests.
    pub(super) fn new(
        view: Option<&'a mut View>,
        links: Vec<Publisher<[LinkFaultByHand]>>,
    ) -> InteractiveActions<'a> {
        InteractiveActions {
            view,
            pending_requests: VecDeque::new(),
            executed_action_count: 0,
            link_fault_publishers: links,
        }
    }

    /// Reads the pending requests of the live view. Returns whether there were any.
    pub(super) fn read_requests(&mut self) -> bool {
        let Some(view) = &self.view else { return false };
        let before = self.pending_requests.len();
        self.pending_requests.extend(std::iter::from_fn(|| view.next_request()));
        self.pending_requests.len() > before
    }

    /// Returns whether a request waits for the next action.
    pub(super) fn has_requests(&self) -> bool {
        !self.pending_requests.is_empty()
    }

    /// Removes and returns the next request that waits.
    pub(super) fn next_request(&mut self) -> Option<ClientRequest> {
        self.pending_requests.pop_front()
    }

    /// Returns the event of an action, after registering its fault.
    ///
    /// # Errors
    /// The action is impossible in the present state.
    pub(super) fn register_action(
        &mut self,
        now_ns: u64,
        action: RequestedAction,
        scenario: &Scenario,
        state_machine: &mut RunStateMachine<Journal<'_>>,
    ) -> Result<LifecycleEvent, Refusal> {
        self.check_possible(action, scenario, state_machine)?;
        self.executed_action_count += 1;
        let initiator = Initiator::LiveViewClient;
        Ok(match action {
            RequestedAction::Kill(robot) => {
                let kill = FaultKind::Kill { robot, restart_after_ns: None };
                let fault = state_machine.register_fault(scenario, &kill, initiator);
                LifecycleEvent::Kill { robot, fault, restart_at_ns: None, initiator }
            }
            RequestedAction::Freeze(robot) => {
                let fault =
                    state_machine.register_fault(scenario, &FaultKind::Freeze { robot }, initiator);
                LifecycleEvent::Freeze { robot, fault, has_planned_thaw: false, initiator }
            }
            RequestedAction::Thaw(robot) => {
                let fault = state_machine.lifecycles().freezing_fault(robot).expect("it is frozen");
                LifecycleEvent::Thaw { robot, fault, initiator }
            }
            RequestedAction::Restart(robot) => LifecycleEvent::Restart { robot },
            RequestedAction::Cut(edge) => {
                record_link_change(state_machine, now_ns, "cut", scenario, edge);
                let cut = FaultKind::Link { edge, kind: LinkFaultKind::Cut };
                let fault = state_machine.register_fault(scenario, &cut, initiator);
                LifecycleEvent::CutLink { edge, fault }
            }
            RequestedAction::RepairEdge(edge) => {
                record_link_change(state_machine, now_ns, "mend", scenario, edge);
                LifecycleEvent::RepairLink { edge }
            }
        })
    }

    /// Returns an error if the action is impossible in the present state.
    fn check_possible(
        &self,
        action: RequestedAction,
        scenario: &Scenario,
        state_machine: &RunStateMachine<Journal<'_>>,
    ) -> Result<(), Refusal> {
        let state_text = |robot: usize| match state_machine.lifecycles().process_state(robot) {
            ProcessState::Starting => "starting",
            ProcessState::Moving => "moving",
            ProcessState::Frozen => "frozen",
            ProcessState::Exiting | ProcessState::Dead => "dead",
        };
        let require_robot_state = |robot: usize, expected: &[&str]| match state_text(robot) {
            found if expected.contains(&found) => Ok(()),
            found => {
                let (name, expected) =
                    (state_machine.journal.robot_name(robot), expected.join(" or "));
                Err(format!("{name} is {found}, but must be {expected}"))
            }
        };
        let require_link_state = |edge: usize, is_cut: bool| {
            let link = edge_text(scenario, edge);
            if self.link_fault_publishers.is_empty() {
                return Err(format!(
                    "in lockstep only the scenario cuts links: --fault 'cut {link} @S for S', or cut \
                     interactively with --pace realtime"
                ));
            }
            match (state_machine.lifecycles().is_link_cut(edge), is_cut) {
                (true, false) => Err(format!("{link} is already cut")),
                (false, true) => Err(format!("{link} was not cut interactively")),
                _ => Ok(()),
            }
        };
        match action {
            RequestedAction::Kill(robot) => {
                require_robot_state(robot, &["starting", "moving", "frozen"])
            }
            RequestedAction::Freeze(robot) => require_robot_state(robot, &["moving"]),
            RequestedAction::Thaw(robot) => require_robot_state(robot, &["frozen"]),
            RequestedAction::Restart(robot) => require_robot_state(robot, &["dead"]),
            RequestedAction::Cut(edge) => require_link_state(edge, false),
            RequestedAction::RepairEdge(edge) => require_link_state(edge, true),
        }
    }

    /// Sends to a robot which of its incoming links are cut interactively. The robot may be a replacement.
    pub(super) fn send_cut_links(
        &self,
        receiver: usize,
        scenario: &Scenario,
        lifecycles: &Lifecycles,
    ) -> Result<(), SendError> {
        let Some(publisher) = self.link_fault_publishers.get(receiver) else { return Ok(()) };
        let edges = scenario.graph.edges().iter().enumerate();
        let links: Vec<LinkFaultByHand> = edges
            .filter(|(_, edge)| edge.to == receiver)
            .map(|(index, edge)| LinkFaultByHand {
                robot: edge.from as u64 + 1,
                cut: u64::from(lifecycles.is_link_cut(index)),
            })
            .collect();
        send_slice(publisher, (), links.len(), |index| links[index])?;
        Ok(())
    }
}

/// Records that a link was cut or restored.
fn record_link_change(
    state_machine: &mut RunStateMachine<Journal<'_>>,
    t_ns: u64,
    kind: &'static str,
    scenario: &Scenario,
    edge: usize,
) {
    let link = scenario.graph.edges()[edge];
    let detail = format!("{}, {}", edge_text(scenario, edge), Initiator::LiveViewClient.keyword());
    state_machine.journal.add_link_event(t_ns, kind, [link.from, link.to], detail);
}

/// Returns the names of the robots at the ends of an edge.
fn edge_text(scenario: &Scenario, edge: usize) -> String {
    let link = scenario.graph.edges()[edge];
    let name = |robot: usize| &scenario.robots[robot].name;
    format!("{}->{}", name(link.from), name(link.to))
}
