//! The barrier checked exhaustively: its own code, one access to a word at a time, in every order in
//! which a plant, a supervisor and agents can make their steps.
//!
//! Nothing but wake-ups ends a wait here: no alarm and no time-out, with one exception (a supervisor
//! at rest is told of deaths). A frozen agent makes no step; one that somebody else stopped is one
//! that is slow, and every agent may be. Must not: know how the barrier works, beyond the names of
//! its words.

use std::collections::{BTreeSet, HashSet};
use std::hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher};
use std::rc::Rc;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use super::stepped::{self, Access, Act, Ended, TIMED_OUT, WOKEN, turn};
use crate::barrier::Barrier;
use crate::barrier::layout::{NUDGE, REMAINING};

/// No wait ends by its limit.
const LONG: Duration = Duration::from_secs(3600);
/// More are a model that does not end.
const STATES_MAX: usize = 1_000_000;

/// What is to happen in a run.
#[derive(Debug, Clone)]
pub(super) struct Plot {
    /// The numbers of its ticks, in order.
    pub(super) ticks: Vec<u64>,
    pub(super) slots: usize,
    pub(super) groups: usize,
    pub(super) lead_max: u64,
    /// So many agents may die, at any step.
    pub(super) deaths: usize,
    /// What the supervisor does before which tick, by place in `ticks`.
    pub(super) planned: Vec<(usize, Planned)>,
}

/// What the supervisor does to an agent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Planned {
    Freeze(usize),
    Thaw(usize),
    /// Kills it and starts another.
    Replace(usize),
}

/// Who makes a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) enum Role {
    Plant,
    Supervisor,
    Agent,
}

/// A kind of step: who does what to which word.
pub(super) type Kind = (Role, &'static str, Act);

/// Where a process is: at which of its calls, or at what else it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
enum At {
    // The plant, at the tick of this place.
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
    // The supervisor. What is planned from this place on is yet to be done.
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
    // Anybody.
    Ended,
    Dead,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Process {
    at: At,
    /// Results of the steps made in its call.
    history: Vec<u64>,
    /// The word it sleeps on.
    asleep: Option<usize>,
    frozen: bool,
}

impl Process {
    fn new(at: At) -> Process {
        Process { at, history: vec![], asleep: None, frozen: false }
    }
}

/// One instant of a run.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct State {
    words: Vec<u64>,
    /// The plant, the supervisor, the agents.
    processes: Vec<Process>,
    /// So many agents may still die.
    deaths: usize,
    /// Truths sent, and taken in.
    published: usize,
    consumed: usize,
    /// Of each agent the place of the tick that it last said all about.
    said: Vec<Option<usize>>,
    /// Who is dead by nobody's plan, and not yet found to be.
    unburied: Vec<bool>,
}

const PLANT: usize = 0;
const SUPERVISOR: usize = 1;
const AGENTS: usize = 2;
/// A move of this and more: the process dies.
const DIES: usize = 1000;

fn role(process: usize) -> Role {
    match process {
        PLANT => Role::Plant,
        SUPERVISOR => Role::Supervisor,
        _ => Role::Agent,
    }
}

/// What a search found.
#[derive(Debug)]
pub(super) struct Found {
    pub(super) states: usize,
    /// Every kind of step that changes a word or wakes somebody.
    pub(super) kinds: BTreeSet<Kind>,
    /// What goes wrong, and the way there.
    pub(super) flaw: Option<String>,
}

/// Searches all runs of this plot, up to the first that goes wrong. `left_out`: steps of this kind
/// do nothing.
pub(super) fn search(plot: &Plot, left_out: Option<Kind>) -> Found {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("barrier");
    let barrier = Barrier::create(&path, plot.slots, plot.groups, LONG).unwrap();
    (0..plot.slots).for_each(|slot| barrier.set_member(slot, 0));
    barrier.pause_at(plot.next_pause(0));
    Model::new(plot, &barrier, left_out).search()
}

impl Plot {
    fn next_pause(&self, planned: usize) -> u64 {
        self.planned.get(planned).map_or(u64::MAX, |&(place, _)| self.ticks[place])
    }

    /// How many ticks the world has made once so many truths are out.
    fn ticks_at(&self, truths: usize) -> u64 {
        self.ticks.get(truths - 1).map_or_else(|| self.ticks.last().unwrap() + 2, |tick| tick + 1)
    }

    /// Where the supervisor begins with what is planned at this place.
    fn acts_from(&self, planned: usize) -> At {
        match self.planned[planned].1 {
            Planned::Freeze(_) => At::Leaves(planned),
            Planned::Thaw(_) | Planned::Replace(_) => At::Strikes(planned),
        }
    }

    fn struck(&self, planned: usize) -> usize {
        match self.planned[planned].1 {
            Planned::Freeze(slot) | Planned::Thaw(slot) | Planned::Replace(slot) => slot,
        }
    }
}

enum Word<'a> {
    Narrow(&'a stepped::AtomicU32),
    Wide(&'a stepped::AtomicU64),
}

impl Word<'_> {
    fn address(&self) -> usize {
        match self {
            Word::Narrow(word) => word.address(),
            Word::Wide(word) => word.address(),
        }
    }

    fn get(&self) -> u64 {
        match self {
            Word::Narrow(word) => word.plain().load(SeqCst).into(),
            Word::Wide(word) => word.plain().load(SeqCst),
        }
    }

    fn set(&self, value: u64) {
        match self {
            Word::Narrow(word) => word.plain().store(value as u32, SeqCst),
            Word::Wide(word) => word.plain().store(value, SeqCst),
        }
    }
}

fn words(barrier: &Barrier) -> Vec<(&'static str, Word<'_>)> {
    let head = barrier.head();
    let mut words = vec![
        ("arrivals", Word::Narrow(&head.arrivals.0)),
        ("changes", Word::Narrow(&head.changes.0)),
        ("consumed", Word::Wide(&head.consumed.0)),
        ("lead", Word::Narrow(&head.lead.0)),
        ("lead_waiting", Word::Narrow(&head.lead_waiting.0)),
        ("pause_at", Word::Wide(&head.pause_at.0)),
        ("paused", Word::Wide(&head.paused.0)),
        ("resumes", Word::Narrow(&head.resumes.0)),
        ("attention", Word::Narrow(&head.attention.0)),
        ("attention_seen", Word::Narrow(&barrier.attention_seen)),
        ("supervisor_waiting", Word::Narrow(&head.supervisor_waiting.0)),
        ("turns", Word::Narrow(&head.turns.0)),
    ];
    let epochs = head.epochs[..barrier.groups()].iter();
    words.extend(epochs.map(|epoch| ("epochs", Word::Narrow(&epoch.0))));
    words.extend(head.ticks.0.iter().map(|tick| ("ticks", Word::Wide(tick))));
    words.extend(barrier.arrived().iter().map(|arrived| ("arrived", Word::Wide(arrived))));
    for slot in barrier.all_slots() {
        words.push(("since", Word::Wide(&slot.since)));
        words.extend(slot.mute.iter().map(|mute| ("mute", Word::Wide(mute))));
    }
    words
}

/// What a call of the barrier says.
enum Answer {
    Nothing,
    Flag(bool),
    Epoch(u32),
    Tick(Option<(u32, u64)>),
    /// A tick or none.
    When(Option<u64>),
}

/// What goes wrong, where, and from where: of each state by which move and from which other it was
/// reached.
struct Flaw<'a> {
    what: String,
    first: &'a State,
    ways: &'a [(usize, usize)],
    reached: usize,
}

struct Model<'a> {
    plot: &'a Plot,
    barrier: &'a Barrier,
    words: Vec<(&'static str, Word<'a>)>,
    /// By role, accesses that are no steps.
    quiet: [Rc<[Access]>; 3],
    /// By role, steps that do nothing.
    left_out: [Rc<[Access]>; 3],
    kinds: BTreeSet<Kind>,
    /// The step made last.
    made: Option<(&'static str, Act)>,
}

impl<'a> Model<'a> {
    fn new(plot: &'a Plot, barrier: &'a Barrier, left_out: Option<Kind>) -> Model<'a> {
        let words = words(barrier);
        let named = |name: &str, act| {
            let of_name = words.iter().filter(|(of, _)| *of == name);
            of_name.map(|(_, word)| Access { word: word.address(), act }).collect::<Vec<_>>()
        };
        // Whoever alone writes a word may read it at any time; and nobody reads mute words here.
        let own = ["attention_seen", "turns", "mute"];
        let own = own.map(|name| [Act::Load, Act::Store, Act::Add].map(|act| named(name, act)));
        let quiet = [named("epochs", Act::Load), own.concat().concat(), vec![]].map(Rc::from);
        let left_out = [Role::Plant, Role::Supervisor, Role::Agent].map(|role| {
            let kind = left_out.filter(|(of, ..)| *of == role);
            Rc::from(kind.map_or(vec![], |(_, name, act)| named(name, act)))
        });
        Model { plot, barrier, words, quiet, left_out, kinds: BTreeSet::new(), made: None }
    }

    fn search(mut self) -> Found {
        let hasher = BuildHasherDefault::<DefaultHasher>::new();
        let first = State {
            words: self.words.iter().map(|(_, word)| word.get()).collect(),
            processes: [Process::new(At::Publishes(0)), Process::new(At::Rests(0))]
                .into_iter()
                .chain((0..self.plot.slots).map(|_| Process::new(At::TakesEpoch)))
                .collect(),
            deaths: self.plot.deaths,
            published: 0,
            consumed: 0,
            said: vec![None; self.plot.slots],
            unburied: vec![false; self.plot.slots],
        };
        let mut known = HashSet::from([hasher.hash_one(&first)]);
        let mut ways: Vec<(usize, usize)> = vec![(0, 0)];
        let mut open = vec![(first.clone(), 0)];
        while let Some((state, way)) = open.pop() {
            let processes = 0..state.processes.len();
            let movable = processes.clone().filter(|&process| self.can_move(&state, process));
            let movable: Vec<usize> = movable.collect();
            if movable.is_empty()
                && let Some(waits) = processes.clone().find(|&process| waits(&state, process))
            {
                let flaw = format!("{:?} {waits} waits for ever", role(waits));
                let flaw = Flaw { what: flaw, first: &first, ways: &ways, reached: way };
                return self.found(known.len(), Some(flaw));
            }
            let mortal = |process: &usize| {
                state.deaths > 0 && *process >= AGENTS && state.processes[*process].at != At::Dead
            };
            let deaths = processes.filter(mortal).map(|process| process + DIES);
            for next in movable.into_iter().chain(deaths) {
                let mut then = state.clone();
                let flaw = self.moves(&mut then, next).err();
                if flaw.is_some() || known.insert(hasher.hash_one(&then)) {
                    ways.push((way, next));
                }
                let reached = ways.len() - 1;
                if let Some(what) = flaw {
                    let flaw = Flaw { what, first: &first, ways: &ways, reached };
                    return self.found(known.len(), Some(flaw));
                }
                if ways[reached] == (way, next) {
                    open.push((then, reached));
                }
            }
            if known.len() > STATES_MAX {
                let what = "it does not end".into();
                let flaw = Flaw { what, first: &first, ways: &ways, reached: 0 };
                return self.found(known.len(), Some(flaw));
            }
        }
        self.found(known.len(), None)
    }

    /// With the way to the flaw told step by step.
    fn found(mut self, states: usize, flaw: Option<Flaw<'_>>) -> Found {
        let flaw = flaw.map(|Flaw { what, first, ways, reached: mut way }| {
            let mut moves = Vec::new();
            while way != 0 {
                moves.push(ways[way].1);
                way = ways[way].0;
            }
            let mut state = first.clone();
            let mut told = format!("{what}\n");
            for next in moves.into_iter().rev() {
                let at = state.processes[next % DIES].at;
                let wrong = self.moves(&mut state, next).err().unwrap_or_default();
                let made = if next >= DIES { "dies".into() } else { format!("{:?}", self.made) };
                let who = (role(next % DIES), next % DIES);
                told += &format!("  {who:?} {at:?}: {made} {wrong}\n");
            }
            told + &format!("{state:?}")
        });
        Found { states, kinds: self.kinds, flaw }
    }

    fn can_move(&self, state: &State, process: usize) -> bool {
        let Process { at, asleep, frozen, .. } = &state.processes[process];
        let is_ready = |slot: usize| state.processes[AGENTS + slot].at != At::TakesEpoch;
        match at {
            At::Ended | At::Dead => false,
            _ if *frozen => false,
            // The supervisor looks for deaths now and then.
            _ if asleep.is_some() => process == SUPERVISOR && state.unburied.contains(&true),
            At::Publishes(0) => (0..self.plot.slots).all(is_ready),
            At::AwaitsReady(planned) => is_ready(self.plot.struck(*planned)),
            _ => true,
        }
    }

    /// One process makes a step, or dies; what that shows to be wrong.
    fn moves(&mut self, state: &mut State, next: usize) -> Result<(), String> {
        self.made = None;
        if let Some(process) = next.checked_sub(DIES) {
            state.deaths -= 1;
            state.unburied[process - AGENTS] = true;
            state.processes[process] = Process::new(At::Dead);
            return Ok(());
        }
        let process = &mut state.processes[next];
        if process.asleep.take().is_some() {
            process.history.push(TIMED_OUT);
        }
        for ((_, word), &value) in self.words.iter().zip(&state.words) {
            word.set(value);
        }
        let role = role(next);
        let (quiet, left_out) = (&self.quiet[role as usize], &self.left_out[role as usize]);
        let at = process.at;
        let turned = turn(&mut process.history, quiet, left_out, || self.call(at, next));
        for ((_, word), value) in self.words.iter().zip(&mut state.words) {
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
            Ended::Left => {}
            Ended::Asleep(word) => state.processes[next].asleep = Some(word),
            Ended::Returned(answer) => {
                state.processes[next].history.clear();
                state.processes[next].at = self.goes_on(state, next, answer)?;
            }
        }
        self.judge(state)
    }

    /// What a process calls there.
    fn call(&self, at: At, process: usize) -> Answer {
        let Model { plot, barrier, .. } = self;
        let slot = process.wrapping_sub(AGENTS);
        let patience = || true;
        match at {
            At::AsksForPause(i) => Answer::Flag(barrier.pause_due(plot.ticks[i])),
            At::Pauses(i) => Answer::Flag(barrier.pause(plot.ticks[i], patience)),
            At::AwaitsLead(i) => {
                Answer::Flag(barrier.wait_lead(plot.ticks[i], plot.lead_max, patience))
            }
            At::Begins(i) => {
                barrier.begin(plot.ticks[i]);
                Answer::Nothing
            }
            At::Releases(_, group) => {
                barrier.release(group);
                Answer::Nothing
            }
            At::AwaitsArrivals(i) => {
                Answer::Flag(barrier.wait_arrivals(plot.ticks[i], patience).is_ok())
            }
            At::Calls => {
                barrier.attention();
                Answer::Nothing
            }
            At::TakesEpoch => Answer::Epoch(barrier.epoch(slot)),
            At::AwaitsTick { epoch, .. } => Answer::Tick(barrier.wait_tick(slot, epoch, patience)),
            At::LooksForItself { .. } => Answer::When(barrier.member_since(slot)),
            At::Arrives { at, .. } => {
                barrier.arrive(slot, plot.ticks[at]);
                Answer::Nothing
            }
            At::Rests(_) => Answer::Flag(barrier.wait_attention(LONG)),
            At::Consumes(_, truths) => {
                barrier.consumed(plot.ticks_at(truths));
                Answer::Nothing
            }
            At::Buries(_, dead) => {
                barrier.remove_member(dead);
                Answer::Nothing
            }
            At::Leaves(planned) => {
                barrier.remove_member(plot.struck(planned));
                Answer::Nothing
            }
            At::LooksForPause(_) => Answer::When(barrier.paused()),
            At::Joins(planned) => {
                let slot = plot.struck(planned);
                barrier.set_member(slot, plot.ticks[plot.planned[planned].0]);
                Answer::Nothing
            }
            At::SetsPause(planned) => {
                barrier.pause_at(plot.next_pause(planned));
                Answer::Nothing
            }
            At::Resumes(_) => {
                barrier.resume();
                Answer::Nothing
            }
            At::Publishes(_) | At::Strikes(_) | At::AwaitsReady(_) | At::Ended | At::Dead => {
                Answer::Nothing
            }
        }
    }

    /// Where a process goes on after an answer; what that shows to be wrong.
    fn goes_on(&self, state: &mut State, process: usize, answer: Answer) -> Result<At, String> {
        let plot = self.plot;
        let slot = process.wrapping_sub(AGENTS);
        let place = |tick: u64| {
            plot.ticks.iter().position(|&known| known == tick).ok_or(format!("no tick {tick}"))
        };
        Ok(match (state.processes[process].at, answer) {
            (At::Publishes(i), _) => self.publishes(state, i),
            (At::AsksForPause(i), Answer::Flag(true)) => At::Pauses(i),
            (At::AsksForPause(i), _) => At::AwaitsLead(i),
            (At::Pauses(i), Answer::Flag(true)) => At::AwaitsLead(i),
            (At::AwaitsLead(i), Answer::Flag(true)) => {
                let taken = if state.consumed == 0 { 0 } else { plot.ticks_at(state.consumed) };
                if plot.ticks[i].saturating_sub(taken) > plot.lead_max {
                    return Err(format!("tick {i} begins too early"));
                }
                At::Begins(i)
            }
            (At::Begins(i), _) => At::Releases(i, 0),
            (At::Releases(i, group), _) if group + 1 < plot.groups => At::Releases(i, group + 1),
            (At::Releases(i, _), _) => At::AwaitsArrivals(i),
            (At::AwaitsArrivals(i), Answer::Flag(true)) => {
                let silent = self.expected(plot.ticks[i]).find(|&slot| state.said[slot] != Some(i));
                if let Some(slot) = silent {
                    return Err(format!("tick {i} ends without agent {slot}"));
                }
                self.publishes(state, i + 1)
            }
            (At::Calls, _) => At::Ended,
            (At::TakesEpoch, Answer::Epoch(epoch)) => At::AwaitsTick { epoch, last: None },
            (At::AwaitsTick { last, .. }, Answer::Tick(Some((epoch, tick)))) => {
                let at = place(tick)?;
                if at + 1 != epoch as usize || last.is_some_and(|last| last >= at) {
                    return Err(format!("after {last:?} comes tick {at} at epoch {epoch}"));
                }
                At::LooksForItself { epoch, at }
            }
            (At::LooksForItself { epoch, at }, Answer::When(since)) => {
                if since.is_some_and(|since| since <= plot.ticks[at]) {
                    state.said[slot] = Some(at);
                    At::Arrives { epoch, at }
                } else {
                    At::AwaitsTick { epoch, last: Some(at) }
                }
            }
            (At::Arrives { epoch, at }, _) => At::AwaitsTick { epoch, last: Some(at) },
            (At::Rests(planned), _) if state.published > state.consumed => {
                state.consumed = state.published;
                At::Consumes(planned, state.published)
            }
            (At::Consumes(_, truths), _) if truths > plot.ticks.len() => At::Ended,
            (At::Consumes(planned, _), _) => self.looks_for_dead(state, planned),
            (At::Rests(planned), _) => self.looks_for_dead(state, planned),
            (At::Buries(planned, dead), _) => {
                state.unburied[dead] = false;
                self.looks_for_dead(state, planned)
            }
            (At::LooksForPause(planned), Answer::When(paused)) => match paused {
                // It stands, and the truth of its tick was taken in.
                Some(tick) if place(tick)? + 1 == state.consumed => {
                    self.acts_or_resumes(state, planned)?
                }
                _ => At::Rests(planned),
            },
            (At::Leaves(planned), _) => match plot.planned[planned].1 {
                Planned::Freeze(_) => At::Strikes(planned),
                _ => {
                    let slot = plot.struck(planned);
                    state.processes[AGENTS + slot] = Process::new(At::TakesEpoch);
                    At::AwaitsReady(planned)
                }
            },
            (At::Strikes(planned), _) => {
                let slot = plot.struck(planned);
                let struck = &mut state.processes[AGENTS + slot];
                match plot.planned[planned].1 {
                    Planned::Freeze(_) => {
                        struck.frozen = struck.at != At::Dead;
                        self.acts_or_resumes(state, planned + 1)?
                    }
                    Planned::Thaw(_) if std::mem::take(&mut struck.frozen) => At::Joins(planned),
                    Planned::Thaw(_) => self.acts_or_resumes(state, planned + 1)?,
                    Planned::Replace(_) => {
                        *struck = Process::new(At::Dead);
                        state.unburied[slot] = false;
                        At::Leaves(planned)
                    }
                }
            }
            (At::AwaitsReady(planned), _) => At::Joins(planned),
            (At::Joins(planned), _) => self.acts_or_resumes(state, planned + 1)?,
            (At::SetsPause(planned), _) => At::Resumes(planned),
            (At::Resumes(planned), _) => At::Rests(planned),
            (at, _) => return Err(format!("{:?} gave up at {at:?}", role(process))),
        })
    }

    fn publishes(&self, state: &mut State, i: usize) -> At {
        state.published = i + 1;
        if i < self.plot.ticks.len() { At::AsksForPause(i) } else { At::Calls }
    }

    fn looks_for_dead(&self, state: &State, planned: usize) -> At {
        match state.unburied.iter().position(|&unburied| unburied) {
            Some(dead) => At::Buries(planned, dead),
            None => At::LooksForPause(planned),
        }
    }

    /// The next thing planned, if it is due where the plant stands.
    fn acts_or_resumes(&self, state: &State, planned: usize) -> Result<At, String> {
        let At::Pauses(stands) = state.processes[PLANT].at else {
            return Err("the supervisor acts while the plant moves".into());
        };
        Ok(match self.plot.planned.get(planned) {
            Some(&(place, _)) if place <= stands => self.plot.acts_from(planned),
            _ => At::SetsPause(planned),
        })
    }

    /// The slots that must arrive at a tick, by the words themselves.
    fn expected(&self, tick: u64) -> impl Iterator<Item = usize> + '_ {
        let slots = self.barrier.all_slots().iter().enumerate();
        slots.filter(move |(_, slot)| slot.since.plain().load(SeqCst) <= tick).map(|(i, _)| i)
    }

    /// What is wrong with the words, whoever is next.
    fn judge(&self, state: &State) -> Result<(), String> {
        let At::AwaitsArrivals(i) = state.processes[PLANT].at else { return Ok(()) };
        let tick = self.plot.ticks[i];
        let word = self.barrier.head().arrivals.0.plain().load(SeqCst);
        let arrived = |slot: usize| self.barrier.arrived()[slot].plain().load(SeqCst) == tick + 1;
        if word & (NUDGE | REMAINING) == 0 && !self.expected(tick).all(arrived) {
            return Err(format!("at tick {i} somebody was counted twice"));
        }
        Ok(())
    }
}

/// Whether a process waits for something that must come, when nobody moves.
fn waits(state: &State, process: usize) -> bool {
    let Process { at, frozen, .. } = &state.processes[process];
    match at {
        At::Ended | At::Dead => false,
        // Agents are told to end when the run is over.
        At::AwaitsTick { .. } => !frozen && state.processes[PLANT].at != At::Ended,
        _ => !frozen,
    }
}
