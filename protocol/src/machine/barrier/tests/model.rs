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

use super::stepped::{Access, Act, StepResult, TIMED_OUT, WOKEN, Word, step_call};
use crate::machine::barrier::Barrier;
use crate::machine::barrier::layout::{NUDGE, REMAINING};

/// Timeout that no wait reaches.
const UNREACHED_TIMEOUT: Duration = Duration::from_secs(3600);
/// Maximum number of states; a larger search means that the model does not end.
const STATES_MAX: usize = 1_000_000;

/// Events of a run.
#[derive(Debug, Clone)]
pub(super) struct Plot {
    /// Numbers of its ticks, in order.
    pub(super) ticks: Vec<u64>,
    pub(super) slots: usize,
    pub(super) groups: usize,
    pub(super) lead_max: u64,
    /// Maximum number of agents that die, at any step.
    pub(super) deaths: usize,
    /// Planned action of the supervisor before a tick, by the tick's index in `ticks`.
    pub(super) planned: Vec<(usize, Planned)>,
}

/// Planned action of the supervisor on an agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Planned {
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
pub(super) type Kind = (ProcessKind, &'static str, Act);

/// Position of a process: its current call, or its activity between calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum ProcessPosition {
    // The plant, at the tick with this index.
    Publishes(usize),
    AsksForPause(usize),
    Pauses(usize),
    AwaitsLead(usize),
    Begins(usize),
    Releases(usize, usize),
    AwaitsArrivals(usize),
    Calls,
    // An agent.
    TakesEpoch,
    AwaitsTick { epoch: u32, last: Option<usize> },
    LooksForItself { epoch: u32, at: usize },
    Arrives { epoch: u32, at: usize },
    // The supervisor. The planned actions from this index on have not been carried out.
    Rests(usize),
    Consumes(usize, usize),
    Buries(usize, usize),
    LooksForPause(usize),
    Strikes(usize),
    Leaves(usize),
    AwaitsReady(usize),
    Joins(usize),
    SetsPause(usize),
    Resumes(usize),
    // Any process.
    Ended,
    Dead,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Process {
    at: ProcessPosition,
    /// Results of the steps made in the current call.
    history: Vec<u64>,
    /// Index of the word on which it sleeps.
    asleep: Option<usize>,
    frozen: bool,
}

impl Process {
    fn new(at: ProcessPosition) -> Process {
        Process { at, history: vec![], asleep: None, frozen: false }
    }
}

/// State of all words and processes.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct ModelState {
    barrier_words: Vec<u64>,
    /// Plant, supervisor, agents.
    processes: Vec<Process>,
    /// Number of agents that may still die.
    deaths: usize,
    /// Number of ground truth messages sent; `consumed` is the number received.
    published: usize,
    consumed: usize,
    /// For each agent, the index of the last tick whose messages were all sent.
    said: Vec<Option<usize>>,
    /// Processes that died unplanned and have not been noticed.
    unburied: Vec<bool>,
}

const PLANT: usize = 0;
const SUPERVISOR: usize = 1;
const AGENTS: usize = 2;
/// Offset of the moves in which a process dies.
const DEATH_MOVE_OFFSET: usize = 1000;

fn role(process: usize) -> ProcessKind {
    match process {
        PLANT => ProcessKind::Plant,
        SUPERVISOR => ProcessKind::Supervisor,
        _ => ProcessKind::Agent,
    }
}

/// Result of a search.
#[derive(Debug)]
pub(super) struct SearchResult {
    pub(super) states: usize,
    /// Every kind of step that changes a word or wakes a process.
    pub(super) kinds: BTreeSet<Kind>,
    /// Description of the error, and the steps that lead to it.
    pub(super) flaw: Option<String>,
}

/// Searches all runs of this plot, up to the first error. Steps of the kind `left_out` do nothing.
pub(super) fn search(plot: &Plot, left_out: Option<Kind>) -> SearchResult {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("barrier");
    let barrier = Barrier::create(&path, plot.slots, plot.groups, UNREACHED_TIMEOUT).unwrap();
    (0..plot.slots).for_each(|slot| barrier.set_member(slot, 0));
    barrier.pause_at(plot.next_pause(0));
    Model::new(plot, &barrier, left_out).search()
}

impl Plot {
    fn next_pause(&self, planned: usize) -> u64 {
        self.planned.get(planned).map_or(u64::MAX, |&(place, _)| self.ticks[place])
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
        match self.planned[planned].1 {
            Planned::Freeze(_) => ProcessPosition::Leaves(planned),
            Planned::Thaw(_) | Planned::Replace(_) => ProcessPosition::Strikes(planned),
        }
    }

    fn struck_agent(&self, planned: usize) -> usize {
        match self.planned[planned].1 {
            Planned::Freeze(slot) | Planned::Thaw(slot) | Planned::Replace(slot) => slot,
        }
    }
}

fn list_words(barrier: &Barrier) -> Vec<(&'static str, &dyn Word)> {
    let head = barrier.head();
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
        ("attention_seen", &barrier.attention_seen),
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
type Then = Box<dyn FnOnce(&Model<'_>, &mut ModelState) -> Result<ProcessPosition, String>>;

fn then_move_to(at: ProcessPosition) -> Then {
    Box::new(move |_, _| Ok(at))
}

fn then_run(
    next: impl FnOnce(&Model<'_>, &mut ModelState) -> Result<ProcessPosition, String> + 'static,
) -> Then {
    Box::new(next)
}

/// Predecessor of a state: its index, the process that moved, and the step made.
struct Predecessor {
    from: usize,
    process: usize,
    at: ProcessPosition,
    made: Option<(&'static str, Act)>,
}

struct Model<'a> {
    plot: &'a Plot,
    barrier: &'a Barrier,
    words: Vec<(&'static str, &'a dyn Word)>,
    /// Accesses that are not steps, by role.
    quiet: [Rc<[Access]>; 3],
    /// Steps that do nothing, by role.
    left_out: [Rc<[Access]>; 3],
    kinds: BTreeSet<Kind>,
    /// The last step.
    made: Option<(&'static str, Act)>,
}

impl<'a> Model<'a> {
    fn new(plot: &'a Plot, barrier: &'a Barrier, left_out: Option<Kind>) -> Model<'a> {
        let words = list_words(barrier);
        let named = |name: &str, act| {
            let of_name = words.iter().filter(|(of, _)| *of == name);
            of_name.map(|(_, word)| Access { word: word.address(), act }).collect::<Vec<_>>()
        };
        // A word with a single writer may be read by it at any time; and no process reads mute words here.
        let own = ["attention_seen", "heartbeats", "mute"];
        let own = own.map(|name| [Act::Load, Act::Store, Act::Add].map(|act| named(name, act)));
        let quiet = [named("epochs", Act::Load), own.concat().concat(), vec![]].map(Rc::from);
        let left_out =
            [ProcessKind::Plant, ProcessKind::Supervisor, ProcessKind::Agent].map(|role| {
                let kind = left_out.filter(|(of, ..)| *of == role);
                Rc::from(kind.map_or(vec![], |(_, name, act)| named(name, act)))
            });
        Model { plot, barrier, words, quiet, left_out, kinds: BTreeSet::new(), made: None }
    }

    fn search(mut self) -> SearchResult {
        let hasher = BuildHasherDefault::<DefaultHasher>::new();
        let first = ModelState {
            barrier_words: self.words.iter().map(|(_, word)| word.get()).collect(),
            processes: [
                Process::new(ProcessPosition::Publishes(0)),
                Process::new(ProcessPosition::Rests(0)),
            ]
            .into_iter()
            .chain((0..self.plot.slots).map(|_| Process::new(ProcessPosition::TakesEpoch)))
            .collect(),
            deaths: self.plot.deaths,
            published: 0,
            consumed: 0,
            said: vec![None; self.plot.slots],
            unburied: vec![false; self.plot.slots],
        };
        let mut known = HashSet::from([hasher.hash_one(&first)]);
        let mut ways = vec![];
        let mut open = vec![(first, 0)];
        while let Some((state, from)) = open.pop() {
            let moves = self.possible_moves(&state);
            let stuck = || (0..state.processes.len()).find(|&process| waits(&state, process));
            if moves.iter().all(|&next| next >= DEATH_MOVE_OFFSET)
                && let Some(waits) = stuck()
            {
                let what = format!("{:?} {waits} waits for ever", role(waits));
                return self.found(known.len(), Some(flaw_and_way(&what, &ways, from, &state)));
            }
            for next in moves {
                let (mut then, process) = (state.clone(), next % DEATH_MOVE_OFFSET);
                let at = state.processes[process].at;
                let flaw = self.step_process(&mut then, next).err();
                if flaw.is_some() || known.insert(hasher.hash_one(&then)) {
                    ways.push(Predecessor { from, process, at, made: self.made });
                    if let Some(what) = flaw {
                        let flaw = flaw_and_way(&what, &ways, ways.len(), &then);
                        return self.found(known.len(), Some(flaw));
                    }
                    open.push((then, ways.len()));
                }
            }
            if known.len() > STATES_MAX {
                return self.found(known.len(), Some("it does not end".into()));
            }
        }
        self.found(known.len(), None)
    }

    fn found(self, states: usize, flaw: Option<String>) -> SearchResult {
        SearchResult { states, kinds: self.kinds, flaw }
    }

    /// Returns all possible moves: steps and deaths.
    fn possible_moves(&self, state: &ModelState) -> Vec<usize> {
        let processes = 0..state.processes.len();
        let mortal = |process: &usize| {
            state.deaths > 0
                && *process >= AGENTS
                && state.processes[*process].at != ProcessPosition::Dead
        };
        let deaths = processes.clone().filter(mortal).map(|process| process + DEATH_MOVE_OFFSET);
        processes.filter(|&process| self.can_move(state, process)).chain(deaths).collect()
    }

    fn can_move(&self, state: &ModelState, process: usize) -> bool {
        let Process { at, asleep, frozen, .. } = &state.processes[process];
        let is_ready =
            |slot: usize| state.processes[AGENTS + slot].at != ProcessPosition::TakesEpoch;
        match at {
            ProcessPosition::Ended | ProcessPosition::Dead => false,
            _ if *frozen => false,
            // The supervisor checks for exits from time to time.
            _ if asleep.is_some() => process == SUPERVISOR && state.unburied.contains(&true),
            ProcessPosition::Publishes(0) => (0..self.plot.slots).all(is_ready),
            ProcessPosition::AwaitsReady(planned) => is_ready(self.plot.struck_agent(*planned)),
            _ => true,
        }
    }

    /// Lets one process make a step or die. Returns a description of the error that this shows.
    fn step_process(&mut self, state: &mut ModelState, next: usize) -> Result<(), String> {
        self.made = None;
        if let Some(process) = next.checked_sub(DEATH_MOVE_OFFSET) {
            state.deaths -= 1;
            state.unburied[process - AGENTS] = true;
            state.processes[process] = Process::new(ProcessPosition::Dead);
            return Ok(());
        }
        let process = &mut state.processes[next];
        if process.asleep.take().is_some() {
            process.history.push(TIMED_OUT);
        }
        for ((_, word), &value) in self.words.iter().zip(&state.barrier_words) {
            word.set(value);
        }
        let role = role(next);
        let (quiet, left_out) = (&self.quiet[role as usize], &self.left_out[role as usize]);
        let at = process.at;
        let turned = step_call(&mut process.history, quiet, left_out, || self.call(at, next));
        for ((_, word), value) in self.words.iter().zip(&mut state.barrier_words) {
            *value = word.get();
        }
        if let Some(made) = turned.made {
            let name = self.words.iter().find(|(_, word)| word.address() == made.word);
            let name = name.expect("all words are known").0;
            self.made = Some((name, made.act));
            if !matches!(made.act, Act::Load | Act::Sleep) {
                self.kinds.insert((role, name, made.act));
            }
            if made.act == Act::Wake && !left_out.contains(&made) {
                for other in &mut state.processes {
                    if other.asleep == Some(made.word) {
                        other.asleep = None;
                        other.history.push(WOKEN);
                    }
                }
            }
        }
        match turned.ended {
            StepResult::Left => {}
            StepResult::Asleep(word) => state.processes[next].asleep = Some(word),
            StepResult::Returned(then) => {
                state.processes[next].history.clear();
                state.processes[next].at = then(self, state)?;
            }
        }
        self.judge(state)
    }

    /// Makes the call of a process at a position, and returns the continuation.
    fn call(&self, at: ProcessPosition, process: usize) -> Then {
        match role(process) {
            ProcessKind::Plant => self.plant(at),
            ProcessKind::Supervisor => self.supervisor(at),
            ProcessKind::Agent => self.agent(at, process - AGENTS),
        }
    }

    fn plant(&self, at: ProcessPosition) -> Then {
        let Model { plot, barrier, .. } = self;
        let patience = || true;
        match at {
            ProcessPosition::AsksForPause(i) => {
                let due = barrier.pause_due(plot.ticks[i]);
                then_move_to(if due {
                    ProcessPosition::Pauses(i)
                } else {
                    ProcessPosition::AwaitsLead(i)
                })
            }
            ProcessPosition::Pauses(i) => {
                assert!(barrier.pause(plot.ticks[i], patience));
                then_move_to(ProcessPosition::AwaitsLead(i))
            }
            ProcessPosition::AwaitsLead(i) => {
                assert!(barrier.wait_lead(plot.ticks[i], plot.lead_max, patience));
                then_run(move |Model { plot, .. }, state| {
                    let taken =
                        if state.consumed == 0 { 0 } else { plot.completed_ticks(state.consumed) };
                    let early = plot.ticks[i].saturating_sub(taken) > plot.lead_max;
                    if early {
                        Err(format!("tick {i} begins too early"))
                    } else {
                        Ok(ProcessPosition::Begins(i))
                    }
                })
            }
            ProcessPosition::Begins(i) => {
                barrier.begin(plot.ticks[i]);
                then_move_to(ProcessPosition::Releases(i, 0))
            }
            ProcessPosition::Releases(i, group) => {
                barrier.release(group);
                let last = group + 1 == plot.groups;
                then_move_to(if last {
                    ProcessPosition::AwaitsArrivals(i)
                } else {
                    ProcessPosition::Releases(i, group + 1)
                })
            }
            ProcessPosition::AwaitsArrivals(i) => {
                barrier.wait_arrivals(plot.ticks[i], patience).expect("its patience does not end");
                then_run(move |model, state| {
                    let mut expected = model.expected_slots(model.plot.ticks[i]);
                    match expected.find(|&slot| state.said[slot] != Some(i)) {
                        Some(slot) => Err(format!("tick {i} ends without agent {slot}")),
                        None => Ok(model.publishes(state, i + 1)),
                    }
                })
            }
            ProcessPosition::Publishes(i) => {
                then_run(move |model, state| Ok(model.publishes(state, i)))
            }
            ProcessPosition::Calls => {
                barrier.attention();
                then_move_to(ProcessPosition::Ended)
            }
            at => unreachable!("the plant is never at {at:?}"),
        }
    }

    fn agent(&self, at: ProcessPosition, slot: usize) -> Then {
        let Model { plot, barrier, .. } = self;
        match at {
            ProcessPosition::TakesEpoch => {
                then_move_to(ProcessPosition::AwaitsTick { epoch: barrier.epoch(slot), last: None })
            }
            ProcessPosition::AwaitsTick { epoch, last } => {
                let ticked = barrier.wait_tick(slot, epoch, || true);
                let (epoch, tick) = ticked.expect("its patience does not end");
                then_run(move |Model { plot, .. }, _| {
                    let at = plot.find_tick(tick)?;
                    if at + 1 != epoch as usize || last.is_some_and(|last| last >= at) {
                        return Err(format!("after {last:?} comes tick {at} at epoch {epoch}"));
                    }
                    Ok(ProcessPosition::LooksForItself { epoch, at })
                })
            }
            ProcessPosition::LooksForItself { epoch, at } => {
                let since = barrier.member_since(slot);
                if since.is_none_or(|since| since > plot.ticks[at]) {
                    return then_move_to(ProcessPosition::AwaitsTick { epoch, last: Some(at) });
                }
                then_run(move |_, state| {
                    state.said[slot] = Some(at);
                    Ok(ProcessPosition::Arrives { epoch, at })
                })
            }
            ProcessPosition::Arrives { epoch, at } => {
                barrier.arrive(slot, plot.ticks[at]);
                then_move_to(ProcessPosition::AwaitsTick { epoch, last: Some(at) })
            }
            at => unreachable!("an agent is never at {at:?}"),
        }
    }

    fn supervisor(&self, at: ProcessPosition) -> Then {
        let Model { plot, barrier, .. } = self;
        match at {
            ProcessPosition::Rests(planned) => {
                barrier.wait_attention(UNREACHED_TIMEOUT);
                then_run(move |model, state| {
                    if state.published == state.consumed {
                        return Ok(model.looks_for_dead(state, planned));
                    }
                    state.consumed = state.published;
                    Ok(ProcessPosition::Consumes(planned, state.published))
                })
            }
            ProcessPosition::Consumes(planned, truths) => {
                barrier.consumed(plot.completed_ticks(truths));
                if truths > plot.ticks.len() {
                    return then_move_to(ProcessPosition::Ended);
                }
                then_run(move |model, state| Ok(model.looks_for_dead(state, planned)))
            }
            ProcessPosition::Buries(planned, dead) => {
                barrier.remove_member(dead);
                then_run(move |model, state| {
                    state.unburied[dead] = false;
                    Ok(model.looks_for_dead(state, planned))
                })
            }
            ProcessPosition::LooksForPause(planned) => match barrier.paused_before_tick() {
                None => then_move_to(ProcessPosition::Rests(planned)),
                // The plant is paused; has the ground truth of its tick been received?
                Some(tick) => then_run(move |model, state| {
                    let taken = model.plot.find_tick(tick)? + 1 == state.consumed;
                    if taken {
                        model.acts_or_resumes(state, planned)
                    } else {
                        Ok(ProcessPosition::Rests(planned))
                    }
                }),
            },
            ProcessPosition::Leaves(planned) => {
                let slot = plot.struck_agent(planned);
                barrier.remove_member(slot);
                if let Planned::Freeze(_) = plot.planned[planned].1 {
                    return then_move_to(ProcessPosition::Strikes(planned));
                }
                then_run(move |_, state| {
                    state.processes[AGENTS + slot] = Process::new(ProcessPosition::TakesEpoch);
                    Ok(ProcessPosition::AwaitsReady(planned))
                })
            }
            ProcessPosition::Strikes(planned) => {
                then_run(move |model, state| model.strikes(state, planned))
            }
            ProcessPosition::AwaitsReady(planned) => then_move_to(ProcessPosition::Joins(planned)),
            ProcessPosition::Joins(planned) => {
                barrier.set_member(plot.struck_agent(planned), plot.ticks[plot.planned[planned].0]);
                then_run(move |model, state| model.acts_or_resumes(state, planned + 1))
            }
            ProcessPosition::SetsPause(planned) => {
                barrier.pause_at(plot.next_pause(planned));
                then_move_to(ProcessPosition::Resumes(planned))
            }
            ProcessPosition::Resumes(planned) => {
                barrier.resume();
                then_move_to(ProcessPosition::Rests(planned))
            }
            at => unreachable!("the supervisor is never at {at:?}"),
        }
    }

    /// Carries out a planned action on an agent.
    fn strikes(&self, state: &mut ModelState, planned: usize) -> Result<ProcessPosition, String> {
        let slot = self.plot.struck_agent(planned);
        let struck = &mut state.processes[AGENTS + slot];
        match self.plot.planned[planned].1 {
            Planned::Freeze(_) => struck.frozen = struck.at != ProcessPosition::Dead,
            Planned::Thaw(_) if std::mem::take(&mut struck.frozen) => {
                return Ok(ProcessPosition::Joins(planned));
            }
            Planned::Thaw(_) => {}
            Planned::Replace(_) => {
                *struck = Process::new(ProcessPosition::Dead);
                state.unburied[slot] = false;
                return Ok(ProcessPosition::Leaves(planned));
            }
        }
        self.acts_or_resumes(state, planned + 1)
    }

    fn publishes(&self, state: &mut ModelState, i: usize) -> ProcessPosition {
        state.published = i + 1;
        if i < self.plot.ticks.len() {
            ProcessPosition::AsksForPause(i)
        } else {
            ProcessPosition::Calls
        }
    }

    fn looks_for_dead(&self, state: &ModelState, planned: usize) -> ProcessPosition {
        match state.unburied.iter().position(|&unburied| unburied) {
            Some(dead) => ProcessPosition::Buries(planned, dead),
            None => ProcessPosition::LooksForPause(planned),
        }
    }

    /// Starts the next planned action if it is due at the tick at which the plant is paused, or resumes the
    /// plant.
    fn acts_or_resumes(
        &self,
        state: &ModelState,
        planned: usize,
    ) -> Result<ProcessPosition, String> {
        let ProcessPosition::Pauses(stands) = state.processes[PLANT].at else {
            return Err("the supervisor acts while the plant moves".into());
        };
        Ok(match self.plot.planned.get(planned) {
            Some(&(place, _)) if place <= stands => self.plot.position_of_planned_action(planned),
            _ => ProcessPosition::SetsPause(planned),
        })
    }

    /// Returns the slots that must arrive at a tick, according to the words.
    fn expected_slots(&self, tick: u64) -> impl Iterator<Item = usize> + '_ {
        let slots = self.barrier.all_slots().iter().enumerate();
        slots.filter(move |(_, slot)| slot.since.plain().load(SeqCst) <= tick).map(|(i, _)| i)
    }

    /// Checks invariants of the words.
    fn judge(&self, state: &ModelState) -> Result<(), String> {
        let ProcessPosition::AwaitsArrivals(i) = state.processes[PLANT].at else { return Ok(()) };
        let tick = self.plot.ticks[i];
        let word = self.barrier.head().arrivals.0.plain().load(SeqCst);
        let arrived =
            |slot: usize| self.barrier.arrived_ticks()[slot].plain().load(SeqCst) == tick + 1;
        if word & (NUDGE | REMAINING) == 0 && !self.expected_slots(tick).all(arrived) {
            return Err(format!("at tick {i} an agent was counted twice"));
        }
        Ok(())
    }
}

/// Returns whether a process waits for something that must come, if no process can move.
fn waits(state: &ModelState, process: usize) -> bool {
    let Process { at, frozen, .. } = &state.processes[process];
    match at {
        ProcessPosition::Ended | ProcessPosition::Dead => false,
        // Agents are asked to end when the run is over.
        ProcessPosition::AwaitsTick { .. } => {
            !frozen && state.processes[PLANT].at != ProcessPosition::Ended
        }
        _ => !frozen,
    }
}

/// Returns the description of an error and the steps that lead to it.
fn flaw_and_way(
    what: &str,
    ways: &[Predecessor],
    mut reached: usize,
    state: &ModelState,
) -> String {
    let mut steps = Vec::new();
    while let Some(Predecessor { from, process, at, made }) =
        reached.checked_sub(1).map(|way| &ways[way])
    {
        let made = made.map_or("dies or goes on".to_owned(), |made| format!("{made:?}"));
        steps.push(format!("  {:?} {process} {at:?}: {made}", role(*process)));
        reached = *from;
    }
    steps.reverse();
    format!("{what}\n{}\n{state:?}", steps.join("\n"))
}
