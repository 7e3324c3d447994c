//! The words of the barrier in the model: outside of the model they are ordinary atomics, in it every
//! access is a step.
//!
//! In a turn one process makes one step. To make it, the process calls the barrier's own code again from the
//! beginning: the steps of earlier turns return their stored results, one more step is executed, and a panic leaves
//! the call before the step after that. The model therefore needs no copy of the code.

use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::rc::Rc;
use std::sync::atomic::{self, Ordering};

use crate::machine::barrier::futex::WakeReason;

/// Kind of access to a word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(in crate::machine::barrier) enum Act {
    Load,
    Store,
    Swap,
    Add,
    Or,
    Update,
    Sleep,
    Wake,
}

/// Access to the word at an address.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::machine::barrier) struct Access {
    pub(in crate::machine::barrier) word: usize,
    pub(in crate::machine::barrier) act: Act,
}

/// End of a turn.
#[derive(Debug, PartialEq)]
pub(in crate::machine::barrier) enum StepResult<R> {
    /// The call returned.
    Returned(R),
    /// The call has more steps to make.
    HasMoreSteps,
    /// The process sleeps on the word at this address.
    Asleep(usize),
}

/// Result of one turn.
pub(in crate::machine::barrier) struct StepOutcome<R> {
    pub(in crate::machine::barrier) result: StepResult<R>,
    /// The step that was made, if any; `None` if it was a sleep that did not happen.
    pub(in crate::machine::barrier) made_step: Option<Access>,
}

/// Result of a sleep that a wake-up ended.
pub(in crate::machine::barrier) const WOKEN_RESULT: u64 = 0;
/// Result of a sleep that a timeout ended.
pub(in crate::machine::barrier) const TIMED_OUT_RESULT: u64 = 1;

struct PartialCall {
    history: Vec<u64>,
    replayed_count: usize,
    made_step: Option<Access>,
    sleep_address: Option<usize>,
    quiet_accesses: Rc<[Access]>,
    omitted_accesses: Rc<[Access]>,
}

thread_local! {
    static CURRENT_CALL: RefCell<Option<PartialCall>> = const { RefCell::new(None) };
}

/// Panic payload: the next step belongs to another turn.
struct TurnEnded;

/// Makes the next step of a call whose earlier steps are `history`, and appends it. Accesses in `quiet_accesses` are
/// not steps: no other process can observe when they happen. Accesses in `omitted_accesses` do nothing.
pub(in crate::machine::barrier) fn step_call<R>(
    history: &mut Vec<u64>,
    quiet_accesses: &Rc<[Access]>,
    omitted_accesses: &Rc<[Access]>,
    call: impl FnOnce() -> R,
) -> StepOutcome<R> {
    let partial_call = PartialCall {
        history: std::mem::take(history),
        replayed_count: 0,
        made_step: None,
        sleep_address: None,
        quiet_accesses: quiet_accesses.clone(),
        omitted_accesses: omitted_accesses.clone(),
    };
    CURRENT_CALL.set(Some(partial_call));
    let outcome = catch_unwind(AssertUnwindSafe(call));
    let turn = CURRENT_CALL.take().expect("set above");
    *history = turn.history;
    let result = match outcome {
        Ok(returned) => StepResult::Returned(returned),
        Err(panic) if panic.is::<TurnEnded>() => {
            turn.sleep_address.map_or(StepResult::HasMoreSteps, StepResult::Asleep)
        }
        Err(panic) => resume_unwind(panic),
    };
    StepOutcome { result, made_step: turn.made_step }
}

/// Makes an access, or returns the result that it had; `None` outside of a turn.
fn step(access: Access, act: impl FnOnce() -> u64, omitted: impl FnOnce() -> u64) -> Option<u64> {
    let result = CURRENT_CALL.with_borrow_mut(|turn| {
        let Some(turn) = turn else { return Some(None) };
        if let Some(&result) = turn.history.get(turn.replayed_count) {
            turn.replayed_count += 1;
            return Some(Some(result));
        }
        if !turn.quiet_accesses.contains(&access) {
            if turn.made_step.is_some() || turn.sleep_address.is_some() {
                return None;
            }
            turn.made_step = Some(access);
        }
        let result = if turn.omitted_accesses.contains(&access) { omitted() } else { act() };
        turn.history.push(result);
        turn.replayed_count += 1;
        Some(Some(result))
    });
    result.unwrap_or_else(|| resume_unwind(Box::new(TurnEnded)))
}

/// A word of either width, for saving and restoring its value.
pub(in crate::machine::barrier) trait Word {
    fn address(&self) -> usize;
    fn get(&self) -> u64;
    fn set(&self, value: u64);
}

macro_rules! stepped {
    ($name:ident, $number:ty) => {
        #[repr(transparent)]
        #[derive(Debug)]
        pub(in crate::machine::barrier) struct $name(atomic::$name);

        // The model's memory is sequentially consistent, as `SeqCst` requires.
        impl $name {
            #[allow(dead_code)] // not of every width
            pub(in crate::machine::barrier) fn new(value: $number) -> $name {
                $name(atomic::$name::new(value))
            }

            /// Returns the word itself, whose accesses are not steps.
            pub(in crate::machine::barrier) fn plain(&self) -> &atomic::$name {
                &self.0
            }

            fn step(&self, act: Act, with: impl Fn(&atomic::$name) -> $number) -> $number {
                let access = Access { word: self.address(), act };
                // A step that is left out returns what it would have returned, and changes nothing.
                let found = || self.0.load(Ordering::SeqCst).into();
                let stepped = step(access, || with(&self.0).into(), found);
                stepped.map_or_else(|| with(&self.0), |result| result as $number)
            }

            pub(in crate::machine::barrier) fn load(&self, order: Ordering) -> $number {
                self.step(Act::Load, |word| word.load(order))
            }

            pub(in crate::machine::barrier) fn store(&self, value: $number, order: Ordering) {
                self.step(Act::Store, |word| {
                    word.store(value, order);
                    value
                });
            }

            #[allow(dead_code)] // not of every width
            pub(in crate::machine::barrier) fn swap(
                &self,
                value: $number,
                order: Ordering,
            ) -> $number {
                self.step(Act::Swap, |word| word.swap(value, order))
            }

            #[allow(dead_code)] // not of every width
            pub(in crate::machine::barrier) fn fetch_add(
                &self,
                value: $number,
                order: Ordering,
            ) -> $number {
                self.step(Act::Add, |word| word.fetch_add(value, order))
            }

            #[allow(dead_code)] // not of every width
            pub(in crate::machine::barrier) fn fetch_or(
                &self,
                value: $number,
                order: Ordering,
            ) -> $number {
                self.step(Act::Or, |word| word.fetch_or(value, order))
            }

            /// One step: a failed exchange is retried, and a successful one has just read the value.
            #[allow(dead_code)] // not of every width
            pub(in crate::machine::barrier) fn fetch_update(
                &self,
                set: Ordering,
                fetch: Ordering,
                new: impl Fn($number) -> Option<$number>,
            ) -> Result<$number, $number> {
                let found = self.step(Act::Update, |word| {
                    word.fetch_update(set, fetch, &new).unwrap_or_else(|now| now)
                });
                new(found).map_or(Err(found), |_| Ok(found))
            }
        }

        impl Word for $name {
            fn address(&self) -> usize {
                std::ptr::from_ref(self) as usize
            }

            fn get(&self) -> u64 {
                self.0.load(Ordering::SeqCst).into()
            }

            fn set(&self, value: u64) {
                self.0.store(value as $number, Ordering::SeqCst);
            }
        }
    };
}

stepped!(AtomicU32, u32);
stepped!(AtomicU64, u64);

/// Sleeps, in a turn; returns `None` outside of one.
pub(in crate::machine::barrier) fn sleep_while(word: &AtomicU32, value: u32) -> Option<WakeReason> {
    CURRENT_CALL.with_borrow(Option::is_some).then(|| {
        let address = word.address();
        let fall_asleep = || {
            // The kernel compares the value and falls asleep atomically.
            let is_unchanged = word.plain().load(Ordering::SeqCst) == value;
            if is_unchanged { FALLS_ASLEEP_RESULT } else { WOKEN_RESULT }
        };
        let access = Access { word: address, act: Act::Sleep };
        let result = step(access, fall_asleep, || WOKEN_RESULT).expect("in a turn");
        if result == FALLS_ASLEEP_RESULT {
            CURRENT_CALL.with_borrow_mut(|turn| {
                let turn = turn.as_mut().expect("in a turn");
                turn.history.pop();
                turn.sleep_address = Some(address);
            });
            resume_unwind(Box::new(TurnEnded));
        }
        if result == WOKEN_RESULT { WakeReason::WordMayHaveChanged } else { WakeReason::TimedOut }
    })
}

/// Internal result of [`sleep_while`]: the process falls asleep.
const FALLS_ASLEEP_RESULT: u64 = u64::MAX;

/// Wakes sleepers, in a turn; returns `false` outside of one. The model knows which processes sleep.
pub(in crate::machine::barrier) fn wake(word: &AtomicU32) -> bool {
    let access = Access { word: word.address(), act: Act::Wake };
    step(access, || 0, || 0).is_some()
}
