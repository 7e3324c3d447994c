//! Model checker of the barrier: its own code, one access to a word at a time, in every order in which a plant, a
//! supervisor and agents can make their steps.
//!
//! Only wake-ups end a wait here, no alarm and no timeout, with one exception (a sleeping supervisor is notified
//! of exits). A frozen agent makes no step; one stopped by another process is a slow one, and every agent may be
//! slow. Must not: know how the barrier works, beyond the names of its words.

use std::collections::{BTreeSet, HashSet};
use std::hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher};
use std::rc::Rc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use super::stepped::{Access, Act, StepResult, TIMED_OUT_RESULT, WOKEN_RESULT, Word, step_call};
use crate::machine::barrier::Barrier;
use crate::machine::barrier::layout::{MEMBERS_CHANGED_FLAG, REMAINING_MEMBERS_MASK};

/// Timeout that no wait reaches.
const UNREACHED_TIMEOUT: Duration = Duration::from_secs(3600);
/// Maximum number of states; a larger search means that the model does not end.
const STATES_MAX: usize = 1_000_000;

/// Events of a run.
#[derive(Debug, Clone)]
pub(super) struct EventPlan {
    /// Numbers of its ticks, in order.
    pub(super) ticks: Vec<u64>,
    pub(super) slots: usize,
    pub(super) groups: usize,
    pub(super) lead_ticks_max: u64,
    /// Maximum number of agents that die, at any step.
    pub(super) deaths_max: usize,
    /// Planned action of the supervisor before a tick, by the tick's index in `ticks`.
    pub(super) planned_actions: Vec<(usize, PlannedAction)>,
}

/// Planned action of the supervisor on an agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum PlannedAction {
    Freeze(usize),
    Thaw(usize),
    /// Kill, and start a replacement.
    Replace(usize),
}

/// Kind of process that makes a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum ProcessKind {
    Plant,
    Supervisor,
    Agent,
}

/// Kind of a step: process, word and access.
pub(super) type StepKind = (ProcessKind, &'static str, Act);

/// Position of a process: its current call, or its activity between calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum ProcessPosition {
    // The plant, at the tick with this index.
    Publishes(usize),
    ChecksPauseDue(usize),
    Pauses(usize),
    AwaitsLead(usize),
    Begins(usize),
    Releases(usize, usize),
    AwaitsArrivals(usize),
    RequestsAttention,
    // An agent.
    ReadsEpoch,
    AwaitsTick { epoch: u32, last: Option<usize> },
    ChecksMembership { epoch: u32, at: usize },
    Arrives { epoch: u32, at: usize },
    // The supervisor. The planned actions from this index on have not been carried out.
    AwaitsAttention(usize),
    Consumes(usize, usize),
    RemovesDeadMember(usize, usize),
    ChecksWhetherPaused(usize),
    ExecutesAction(usize),
    RemovesMember(usize),
    AwaitsReady(usize),
    AddsMember(usize),
    SetsPause(usize),
    Resumes(usize),
    // Any process.
    Ended,
    Dead,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct ModelProcess {
    position: ProcessPosition,
    /// Results of the steps made in the current call.
    history: Vec<u64>,
    /// Index of the word on which it sleeps.
    sleep_word: Option<usize>,
    frozen: bool,
}

impl ModelProcess {
    fn new(at: ProcessPosition) -> ModelProcess {
        ModelProcess { position: at, history: vec![], sleep_word: None, frozen: false }
    }
}

/// State of all words and processes.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct ModelState {
    barrier_words: Vec<u64>,
    /// Plant, supervisor, agents.
    processes: Vec<ModelProcess>,
    /// Number of agents that may still die.
    remaining_deaths: usize,
    /// Number of ground truth messages sent; `consumed` is the number received.
    published_truths: usize,
    consumed_truths: usize,
    /// For each agent, the index of the last tick whose messages were all sent.
    last_sent_ticks: Vec<Option<usize>>,
    /// Processes that died unplanned and have not been noticed.
    unnoticed_deaths: Vec<bool>,
}

const PLANT_INDEX: usize = 0;
const SUPERVISOR_INDEX: usize = 1;
const FIRST_AGENT_INDEX: usize = 2;
/// Offset of the moves in which a process dies.
const DEATH_MOVE_OFFSET: usize = 1000;

fn process_kind(process: usize) -> ProcessKind {
    match process {
        PLANT_INDEX => ProcessKind::Plant,
        SUPERVISOR_INDEX => ProcessKind::Supervisor,
        _ => ProcessKind::Agent,
    }
}

/// Result of a search.
#[derive(Debug)]
pub(super) struct SearchResult {
    pub(super) states: usize,
    /// Every kind of step that changes a word or wakes a process.
    pub(super) kinds: BTreeSet<StepKind>,
    /// Description of the error, and the steps that lead to it.
    pub(super) flaw: Option<String>,
}

/// Searches all runs of this plan, up to the first error. Steps of the kind `omitted_step` do nothing.
pub(super) fn search_all_runs(plan: &EventPlan, omitted_step: Option<StepKind>) -> SearchResult {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("barrier");
    let barrier = Barrier::create(&path, plan.slots, plan.groups, UNREACHED_TIMEOUT).unwrap();
    (0..plan.slots).for_each(|slot| barrier.set_member(slot, 0));
    barrier.pause_at(plan.next_pause_tick(0));
    Model::new(plan, &barrier, omitted_step).search()
}

impl EventPlan {
    fn next_pause_tick(&self, planned: usize) -> u64 {
        self.planned_actions.get(planned).map_or(u64::MAX, |&(index, _)| self.ticks[index])
    }

    /// Returns the index of a tick.
    fn find_tick(&self, tick: u64) -> Result<usize, String> {
        self.ticks.iter().position(|&known| known == tick).ok_or(format!("no tick {tick}"))
    }

    /// Returns the number of ticks that the plant has completed once `truths` messages have been sent.
    fn completed_ticks(&self, truths: usize) -> u64 {
        self.ticks.get(truths - 1).map_or_else(|| self.ticks.last().unwrap() + 2, |tick| tick + 1)
    }

    /// Returns the position at which the supervisor starts the planned action with this index.
    fn position_of_planned_action(&self, planned: usize) -> ProcessPosition {
        match self.planned_actions[planned].1 {
            PlannedAction::Freeze(_) => ProcessPosition::RemovesMember(planned),
            PlannedAction::Thaw(_) | PlannedAction::Replace(_) => {
                ProcessPosition::ExecutesAction(planned)
            }
        }
    }

    fn target_agent(&self, planned: usize) -> usize {
        match self.planned_actions[planned].1 {
            PlannedAction::Freeze(slot)
            | PlannedAction::Thaw(slot)
            | PlannedAction::Replace(slot) => slot,
        }
    }
}

fn list_words(barrier: &Barrier) -> Vec<(&'static str, &dyn Word)> {
    let head = barrier.header();
    let single: [(&str, &dyn Word); 12] = [
        ("arrivals", &head.arrivals.0),
        ("changes", &head.changes.0),
        ("consumed", &head.consumed.0),
        ("lead", &head.lead.0),
        ("lead_waiting", &head.lead_waiting.0),
        ("pause_at", &head.pause_at.0),
        ("paused", &head.paused.0),
        ("resumes", &head.resumes.0),
        ("attention", &head.attention.0),
        ("attention_seen", &barrier.seen_attention_count),
        ("supervisor_waiting", &head.supervisor_waiting.0),
        ("heartbeats", &head.heartbeats.0),
    ];
    let mut words = single.to_vec();
    let epochs = head.epochs[..barrier.groups()].iter();
    words.extend(epochs.map(|epoch| ("epochs", &epoch.0 as &dyn Word)));
    words.extend(head.ticks.0.iter().map(|tick| ("ticks", tick as &dyn Word)));
    words.extend(barrier.arrived_ticks().iter().map(|arrived| ("arrived", arrived as &dyn Word)));
    for slot in barrier.all_slots() {
        words.push(("since", &slot.since));
        words.extend(slot.mute.iter().map(|mute| ("mute", mute as &dyn Word)));
    }
    words
}

/// Continuation after a call: the next position, or a description of the error that the result shows.
type Continuation = Box<dyn FnOnce(&Model<'_>, &mut ModelState) -> Result<ProcessPosition, String>>;

fn continue_at(at: ProcessPosition) -> Continuation {
    Box::new(move |_, _| Ok(at))
}

fn continue_with(
    next: impl FnOnce(&Model<'_>, &mut ModelState) -> Result<ProcessPosition, String> + 'static,
) -> Continuation {
    Box::new(next)
}

/// Predecessor of a state: its index, the process that moved, and the step made.
struct Predecessor {
    from: usize,
    process: usize,
    position: ProcessPosition,
    step: Option<(&'static str, Act)>,
}

struct Model<'a> {
    plan: &'a EventPlan,
    barrier: &'a Barrier,
    words: Vec<(&'static str, &'a dyn Word)>,
    /// Accesses that are not steps, by role.
    quiet_accesses: [Rc<[Access]>; 3],
    /// Steps that do nothing, by role.
    omitted_accesses: [Rc<[Access]>; 3],
    kinds: BTreeSet<StepKind>,
    /// The last step.
    last_step: Option<(&'static str, Act)>,
}

impl<'a> Model<'a> {
    fn new(plan: &'a EventPlan, barrier: &'a Barrier, omitted_step: Option<StepKind>) -> Model<'a> {
        let words = list_words(barrier);
        let named = |name: &str, act| {
            let named_words = words.iter().filter(|(of, _)| *of == name);
            named_words.map(|(_, word)| Access { word: word.address(), act }).collect::<Vec<_>>()
        };
        // A word with a single writer may be read by it at any time; and no process reads mute words here.
        let own = ["attention_seen", "heartbeats", "mute"];
        let own = own.map(|name| [Act::Load, Act::Store, Act::Add].map(|act| named(name, act)));
        let quiet = [named("epochs", Act::Load), own.concat().concat(), vec![]].map(Rc::from);
        let omitted_accesses = [ProcessKind::Plant, ProcessKind::Supervisor, ProcessKind::Agent]
            .map(|role| {
                let kind = omitted_step.filter(|(of, ..)| *of == role);
                Rc::from(kind.map_or(vec![], |(_, name, act)| named(name, act)))
            });
        Model {
            plan,
            barrier,
            words,
            quiet_accesses: quiet,
            omitted_accesses,
            kinds: BTreeSet::new(),
            last_step: None,
        }
    }

    fn search(mut self) -> SearchResult {
        let hasher = BuildHasherDefault::<DefaultHasher>::new();
        let first = ModelState {
            barrier_words: self.words.iter().map(|(_, word)| word.get()).collect(),
            processes: [
                ModelProcess::new(ProcessPosition::Publishes(0)),
                ModelProcess::new(ProcessPosition::AwaitsAttention(0)),
            ]
            .into_iter()
            .chain((0..self.plan.slots).map(|_| ModelProcess::new(ProcessPosition::ReadsEpoch)))
            .collect(),
            remaining_deaths: self.plan.deaths_max,
            published_truths: 0,
            consumed_truths: 0,
            last_sent_ticks: vec![None; self.plan.slots],
            unnoticed_deaths: vec![false; self.plan.slots],
        };
        let mut known = HashSet::from([hasher.hash_one(&first)]);
        let mut predecessors = vec![];
        let mut open = vec![(first, 0)];
        while let Some((state, from)) = open.pop() {
            let moves = self.possible_moves(&state);
            let find_waiting =
                || (0..state.processes.len()).find(|&process| is_waiting(&state, process));
            if moves.iter().all(|&next| next >= DEATH_MOVE_OFFSET)
                && let Some(waiting) = find_waiting()
            {
                let what = format!("{:?} {waiting} waits for ever", process_kind(waiting));
                return self.into_result(
                    known.len(),
                    Some(describe_flaw_with_steps(&what, &predecessors, from, &state)),
                );
            }
            for next in moves {
                let (mut then, process) = (state.clone(), next % DEATH_MOVE_OFFSET);
                let at = state.processes[process].position;
                let flaw = self.step_process(&mut then, next).err();
                if flaw.is_some() || known.insert(hasher.hash_one(&then)) {
                    predecessors.push(Predecessor {
                        from,
                        process,
                        position: at,
                        step: self.last_step,
                    });
                    if let Some(what) = flaw {
                        let flaw = describe_flaw_with_steps(
                            &what,
                            &predecessors,
                            predecessors.len(),
                            &then,
                        );
                        return self.into_result(known.len(), Some(flaw));
                    }
                    open.push((then, predecessors.len()));
                }
            }
            if known.len() > STATES_MAX {
                return self.into_result(known.len(), Some("it does not end".into()));
            }
        }
        self.into_result(known.len(), None)
    }

    fn into_result(self, states: usize, flaw: Option<String>) -> SearchResult {
        SearchResult { states, kinds: self.kinds, flaw }
    }

    /// Returns all possible moves: steps and deaths.
    fn possible_moves(&self, state: &ModelState) -> Vec<usize> {
        let processes = 0..state.processes.len();
        let can_die = |process: &usize| {
            state.remaining_deaths > 0
                && *process >= FIRST_AGENT_INDEX
                && state.processes[*process].position != ProcessPosition::Dead
        };
        let deaths = processes.clone().filter(can_die).map(|process| process + DEATH_MOVE_OFFSET);
        processes.filter(|&process| self.can_move(state, process)).chain(deaths).collect()
    }

    fn can_move(&self, state: &ModelState, process: usize) -> bool {
        let ModelProcess { position: at, sleep_word, frozen, .. } = &state.processes[process];
        let is_ready = |slot: usize| {
            state.processes[FIRST_AGENT_INDEX + slot].position != ProcessPosition::ReadsEpoch
        };
        match at {
            ProcessPosition::Ended | ProcessPosition::Dead => false,
            _ if *frozen => false,
            // The supervisor checks for exits from time to time.
            _ if sleep_word.is_some() => {
                process == SUPERVISOR_INDEX && state.unnoticed_deaths.contains(&true)
            }
            ProcessPosition::Publishes(0) => (0..self.plan.slots).all(is_ready),
            ProcessPosition::AwaitsReady(planned) => is_ready(self.plan.target_agent(*planned)),
            _ => true,
        }
    }

    /// Lets one process make a step or die. Returns a description of the error that this shows.
    fn step_process(&mut self, state: &mut ModelState, next: usize) -> Result<(), String> {
        self.last_step = None;
        if let Some(process) = next.checked_sub(DEATH_MOVE_OFFSET) {
            state.remaining_deaths -= 1;
            state.unnoticed_deaths[process - FIRST_AGENT_INDEX] = true;
            state.processes[process] = ModelProcess::new(ProcessPosition::Dead);
            return Ok(());
        }
        let process = &mut state.processes[next];
        if process.sleep_word.take().is_some() {
            process.history.push(TIMED_OUT_RESULT);
        }
        for ((_, word), &value) in self.words.iter().zip(&state.barrier_words) {
            word.set(value);
        }
        let role = process_kind(next);
        let (quiet, omitted) =
            (&self.quiet_accesses[role as usize], &self.omitted_accesses[role as usize]);
        let at = process.position;
        let outcome = step_call(&mut process.history, quiet, omitted, || self.call(at, next));
        for ((_, word), value) in self.words.iter().zip(&mut state.barrier_words) {
            *value = word.get();
        }
        if let Some(made_step) = outcome.made_step {
            let name = self.words.iter().find(|(_, word)| word.address() == made_step.word);
            let name = name.expect("all words are known").0;
            self.last_step = Some((name, made_step.act));
            if !matches!(made_step.act, Act::Load | Act::Sleep) {
                self.kinds.insert((role, name, made_step.act));
            }
            if made_step.act == Act::Wake && !omitted.contains(&made_step) {
                for other in &mut state.processes {
                    if other.sleep_word == Some(made_step.word) {
                        other.sleep_word = None;
                        other.history.push(WOKEN_RESULT);
                    }
                }
            }
        }
        match outcome.result {
            StepResult::HasMoreSteps => {}
            StepResult::Asleep(word) => state.processes[next].sleep_word = Some(word),
            StepResult::Returned(then) => {
                state.processes[next].history.clear();
                state.processes[next].position = then(self, state)?;
            }
        }
        self.check_invariants(state)
    }

    /// Makes the call of a process at a position, and returns the continuation.
    fn call(&self, at: ProcessPosition, process: usize) -> Continuation {
        match process_kind(process) {
            ProcessKind::Plant => self.call_plant(at),
            ProcessKind::Supervisor => self.call_supervisor(at),
            ProcessKind::Agent => self.call_agent(at, process - FIRST_AGENT_INDEX),
        }
    }

    fn call_plant(&self, at: ProcessPosition) -> Continuation {
        let Model { plan, barrier, .. } = self;
        let keep_waiting = || true;
        match at {
            ProcessPosition::ChecksPauseDue(i) => {
                let due = barrier.is_pause_due(plan.ticks[i]);
                continue_at(if due {
                    ProcessPosition::Pauses(i)
                } else {
                    ProcessPosition::AwaitsLead(i)
                })
            }
            ProcessPosition::Pauses(i) => {
                assert!(barrier.pause(plan.ticks[i], keep_waiting));
                continue_at(ProcessPosition::AwaitsLead(i))
            }
            ProcessPosition::AwaitsLead(i) => {
                assert!(barrier.wait_for_lead_limit(
                    plan.ticks[i],
                    plan.lead_ticks_max,
                    keep_waiting
                ));
                continue_with(move |Model { plan, .. }, state| {
                    let consumed = if state.consumed_truths == 0 {
                        0
                    } else {
                        plan.completed_ticks(state.consumed_truths)
                    };
                    let is_early = plan.ticks[i].saturating_sub(consumed) > plan.lead_ticks_max;
                    if is_early {
                        Err(format!("tick {i} begins too early"))
                    } else {
                        Ok(ProcessPosition::Begins(i))
                    }
                })
            }
            ProcessPosition::Begins(i) => {
                barrier.begin_tick(plan.ticks[i]);
                continue_at(ProcessPosition::Releases(i, 0))
            }
            ProcessPosition::Releases(i, group) => {
                barrier.release_group(group);
                let last = group + 1 == plan.groups;
                continue_at(if last {
                    ProcessPosition::AwaitsArrivals(i)
                } else {
                    ProcessPosition::Releases(i, group + 1)
                })
            }
            ProcessPosition::AwaitsArrivals(i) => {
                barrier
                    .wait_for_arrivals(plan.ticks[i], keep_waiting)
                    .expect("its patience does not end");
                continue_with(move |model, state| {
                    let mut expected = model.expected_slots(model.plan.ticks[i]);
                    match expected.find(|&slot| state.last_sent_ticks[slot] != Some(i)) {
                        Some(slot) => Err(format!("tick {i} ends without agent {slot}")),
                        None => Ok(model.publish_truth(state, i + 1)),
                    }
                })
            }
            ProcessPosition::Publishes(i) => {
                continue_with(move |model, state| Ok(model.publish_truth(state, i)))
            }
            ProcessPosition::RequestsAttention => {
                barrier.request_attention();
                continue_at(ProcessPosition::Ended)
            }
            at => unreachable!("the plant is never at {at:?}"),
        }
    }

    fn call_agent(&self, at: ProcessPosition, slot: usize) -> Continuation {
        let Model { plan, barrier, .. } = self;
        match at {
            ProcessPosition::ReadsEpoch => {
                continue_at(ProcessPosition::AwaitsTick { epoch: barrier.epoch(slot), last: None })
            }
            ProcessPosition::AwaitsTick { epoch, last } => {
                let released = barrier.wait_for_tick(slot, epoch, || true);
                let (epoch, tick) = released.expect("its patience does not end");
                continue_with(move |Model { plan, .. }, _| {
                    let at = plan.find_tick(tick)?;
                    if at + 1 != epoch as usize || last.is_some_and(|last| last >= at) {
                        return Err(format!("after {last:?} comes tick {at} at epoch {epoch}"));
                    }
                    Ok(ProcessPosition::ChecksMembership { epoch, at })
                })
            }
            ProcessPosition::ChecksMembership { epoch, at } => {
                let since = barrier.first_member_tick(slot);
                if since.is_none_or(|since| since > plan.ticks[at]) {
                    return continue_at(ProcessPosition::AwaitsTick { epoch, last: Some(at) });
                }
                continue_with(move |_, state| {
                    state.last_sent_ticks[slot] = Some(at);
                    Ok(ProcessPosition::Arrives { epoch, at })
                })
            }
            ProcessPosition::Arrives { epoch, at } => {
                barrier.arrive(slot, plan.ticks[at]);
                continue_at(ProcessPosition::AwaitsTick { epoch, last: Some(at) })
            }
            at => unreachable!("an agent is never at {at:?}"),
        }
    }

    fn call_supervisor(&self, at: ProcessPosition) -> Continuation {
        let Model { plan, barrier, .. } = self;
        match at {
            ProcessPosition::AwaitsAttention(planned) => {
                barrier.wait_for_attention(UNREACHED_TIMEOUT);
                continue_with(move |model, state| {
                    if state.published_truths == state.consumed_truths {
                        return Ok(model.find_dead_agent(state, planned));
                    }
                    state.consumed_truths = state.published_truths;
                    Ok(ProcessPosition::Consumes(planned, state.published_truths))
                })
            }
            ProcessPosition::Consumes(planned, truths) => {
                barrier.set_consumed_ticks(plan.completed_ticks(truths));
                if truths > plan.ticks.len() {
                    return continue_at(ProcessPosition::Ended);
                }
                continue_with(move |model, state| Ok(model.find_dead_agent(state, planned)))
            }
            ProcessPosition::RemovesDeadMember(planned, dead) => {
                barrier.remove_member(dead);
                continue_with(move |model, state| {
                    state.unnoticed_deaths[dead] = false;
                    Ok(model.find_dead_agent(state, planned))
                })
            }
            ProcessPosition::ChecksWhetherPaused(planned) => match barrier.paused_before_tick() {
                None => continue_at(ProcessPosition::AwaitsAttention(planned)),
                // The plant is paused; has the ground truth of its tick been received?
                Some(tick) => continue_with(move |model, state| {
                    let is_consumed = model.plan.find_tick(tick)? + 1 == state.consumed_truths;
                    if is_consumed {
                        model.act_or_resume(state, planned)
                    } else {
                        Ok(ProcessPosition::AwaitsAttention(planned))
                    }
                }),
            },
            ProcessPosition::RemovesMember(planned) => {
                let slot = plan.target_agent(planned);
                barrier.remove_member(slot);
                if let PlannedAction::Freeze(_) = plan.planned_actions[planned].1 {
                    return continue_at(ProcessPosition::ExecutesAction(planned));
                }
                continue_with(move |_, state| {
                    state.processes[FIRST_AGENT_INDEX + slot] =
                        ModelProcess::new(ProcessPosition::ReadsEpoch);
                    Ok(ProcessPosition::AwaitsReady(planned))
                })
            }
            ProcessPosition::ExecutesAction(planned) => {
                continue_with(move |model, state| model.execute_action(state, planned))
            }
            ProcessPosition::AwaitsReady(planned) => {
                continue_at(ProcessPosition::AddsMember(planned))
            }
            ProcessPosition::AddsMember(planned) => {
                barrier.set_member(
                    plan.target_agent(planned),
                    plan.ticks[plan.planned_actions[planned].0],
                );
                continue_with(move |model, state| model.act_or_resume(state, planned + 1))
            }
            ProcessPosition::SetsPause(planned) => {
                barrier.pause_at(plan.next_pause_tick(planned));
                continue_at(ProcessPosition::Resumes(planned))
            }
            ProcessPosition::Resumes(planned) => {
                barrier.resume();
                continue_at(ProcessPosition::AwaitsAttention(planned))
            }
            at => unreachable!("the supervisor is never at {at:?}"),
        }
    }

    /// Carries out a planned action on an agent.
    fn execute_action(
        &self,
        state: &mut ModelState,
        planned: usize,
    ) -> Result<ProcessPosition, String> {
        let slot = self.plan.target_agent(planned);
        let agent = &mut state.processes[FIRST_AGENT_INDEX + slot];
        match self.plan.planned_actions[planned].1 {
            PlannedAction::Freeze(_) => agent.frozen = agent.position != ProcessPosition::Dead,
            PlannedAction::Thaw(_) if std::mem::take(&mut agent.frozen) => {
                return Ok(ProcessPosition::AddsMember(planned));
            }
            PlannedAction::Thaw(_) => {}
            PlannedAction::Replace(_) => {
                *agent = ModelProcess::new(ProcessPosition::Dead);
                state.unnoticed_deaths[slot] = false;
                return Ok(ProcessPosition::RemovesMember(planned));
            }
        }
        self.act_or_resume(state, planned + 1)
    }

    fn publish_truth(&self, state: &mut ModelState, i: usize) -> ProcessPosition {
        state.published_truths = i + 1;
        if i < self.plan.ticks.len() {
            ProcessPosition::ChecksPauseDue(i)
        } else {
            ProcessPosition::RequestsAttention
        }
    }

    fn find_dead_agent(&self, state: &ModelState, planned: usize) -> ProcessPosition {
        match state.unnoticed_deaths.iter().position(|&is_unnoticed| is_unnoticed) {
            Some(dead) => ProcessPosition::RemovesDeadMember(planned, dead),
            None => ProcessPosition::ChecksWhetherPaused(planned),
        }
    }

    /// Starts the next planned action if it is due at the tick at which the plant is paused, or resumes the
    /// plant.
    fn act_or_resume(&self, state: &ModelState, planned: usize) -> Result<ProcessPosition, String> {
        let ProcessPosition::Pauses(tick_index) = state.processes[PLANT_INDEX].position else {
            return Err("the supervisor acts while the plant moves".into());
        };
        Ok(match self.plan.planned_actions.get(planned) {
            Some(&(index, _)) if index <= tick_index => {
                self.plan.position_of_planned_action(planned)
            }
            _ => ProcessPosition::SetsPause(planned),
        })
    }

    /// Returns the slots that must arrive at a tick, according to the words.
    fn expected_slots(&self, tick: u64) -> impl Iterator<Item = usize> + '_ {
        let slots = self.barrier.all_slots().iter().enumerate();
        slots.filter(move |(_, slot)| slot.since.plain().load(SeqCst) <= tick).map(|(i, _)| i)
    }

    /// Checks invariants of the words.
    fn check_invariants(&self, state: &ModelState) -> Result<(), String> {
        let ProcessPosition::AwaitsArrivals(i) = state.processes[PLANT_INDEX].position else {
            return Ok(());
        };
        let tick = self.plan.ticks[i];
        let word = self.barrier.header().arrivals.0.plain().load(SeqCst);
        let arrived =
            |slot: usize| self.barrier.arrived_ticks()[slot].plain().load(SeqCst) == tick + 1;
        if word & (MEMBERS_CHANGED_FLAG | REMAINING_MEMBERS_MASK) == 0
            && !self.expected_slots(tick).all(arrived)
        {
            return Err(format!("at tick {i} an agent was counted twice"));
        }
        Ok(())
    }
}

/// Returns whether a process waits for something that must come, if no process can move.
fn is_waiting(state: &ModelState, process: usize) -> bool {
    let ModelProcess { position: at, frozen, .. } = &state.processes[process];
    match at {
        ProcessPosition::Ended | ProcessPosition::Dead => false,
        // Agents receive a stop request when the run is over.
        ProcessPosition::AwaitsTick { .. } => {
            !frozen && state.processes[PLANT_INDEX].position != ProcessPosition::Ended
        }
        _ => !frozen,
    }
}

/// Returns the description of an error and the steps that lead to it.
fn describe_flaw_with_steps(
    what: &str,
    predecessors: &[Predecessor],
    mut reached: usize,
    state: &ModelState,
) -> String {
    let mut steps = Vec::new();
    while let Some(Predecessor { from, process, position: at, step }) =
        reached.checked_sub(1).map(|index| &predecessors[index])
    {
        let step = step.map_or("dies or goes on".to_owned(), |step| format!("{step:?}"));
        steps.push(format!("  {:?} {process} {at:?}: {step}", process_kind(*process)));
        reached = *from;
    }
    steps.reverse();
    format!("{what}\n{}\n{state:?}", steps.join("\n"))
}
