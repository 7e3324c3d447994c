//! How a page asks: it writes a question of so many bytes where `question` says, calls `ask`, and reads the answer.
//! Where the engine panics, the answer is what it said.

use std::cell::RefCell;

use crate::engine::{self, Engine};

#[derive(Default)]
struct State {
    question: Vec<u8>,
    answer: Vec<u8>,
    engine: Option<Engine>,
}

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Room for a question of so many bytes of UTF-8: where it begins.
#[unsafe(no_mangle)]
pub extern "C" fn question(bytes: usize) -> *mut u8 {
    std::panic::set_hook(Box::new(|panic| {
        PANIC.with(|said| *said.borrow_mut() = panic.to_string());
    }));
    STATE.with(|state| {
        let question = &mut state.borrow_mut().question;
        *question = vec![0; bytes];
        question.as_mut_ptr()
    })
}

/// Answers it: how many bytes the answer has.
#[unsafe(no_mangle)]
pub extern "C" fn ask() -> usize {
    STATE.with(|state| {
        let state = &mut *state.borrow_mut();
        let question = String::from_utf8_lossy(&state.question);
        state.answer = engine::answer(&mut state.engine, &question).to_string().into_bytes();
        state.answer.len()
    })
}

/// Where the answer begins.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    STATE.with(|state| state.borrow().answer.as_ptr())
}

/// How many bytes were said in a panic.
#[unsafe(no_mangle)]
pub extern "C" fn panicked() -> usize {
    PANIC.with(|said| said.borrow().len())
}

/// Where they begin.
#[unsafe(no_mangle)]
pub extern "C" fn panic_said() -> *const u8 {
    PANIC.with(|said| said.borrow().as_ptr())
}
