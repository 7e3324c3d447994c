//! WebAssembly interface: a page writes a request to the address that `question` returns, calls `ask`, and reads
//! the response. After a panic, the page reads the panic message instead.

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

/// Allocates the buffer of a request, in bytes of UTF-8, and returns its address.
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

/// Processes the request, and returns the length of the response, bytes.
#[unsafe(no_mangle)]
pub extern "C" fn ask() -> usize {
    STATE.with(|state| {
        let state = &mut *state.borrow_mut();
        let question = String::from_utf8_lossy(&state.question);
        state.answer = engine::answer(&mut state.engine, &question).to_string().into_bytes();
        state.answer.len()
    })
}

/// Returns the address of the response.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    STATE.with(|state| state.borrow().answer.as_ptr())
}

/// Returns the length of the panic message, bytes.
#[unsafe(no_mangle)]
pub extern "C" fn panicked() -> usize {
    PANIC.with(|said| said.borrow().len())
}

/// Returns the address of the panic message.
#[unsafe(no_mangle)]
pub extern "C" fn panic_said() -> *const u8 {
    PANIC.with(|said| said.borrow().as_ptr())
}
