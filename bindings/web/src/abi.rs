//! WebAssembly interface: a page writes a request to the address that `allocate_request` returns, calls
//! `process_request`, and reads the response. After a panic, the page reads the panic message instead.

use std::cell::RefCell;

use crate::engine::{self, Engine};

#[derive(Default)]
struct State {
    request: Vec<u8>,
    response: Vec<u8>,
    engine: Option<Engine>,
}

thread_local! {
    static STATE: RefCell<State> = RefCell::default();
    static PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Allocates the buffer of a request, in bytes of UTF-8, and returns its address.
#[unsafe(no_mangle)]
pub extern "C" fn allocate_request(bytes: usize) -> *mut u8 {
    std::panic::set_hook(Box::new(|panic| {
        PANIC.with(|message| *message.borrow_mut() = panic.to_string());
    }));
    STATE.with(|state| {
        let request = &mut state.borrow_mut().request;
        *request = vec![0; bytes];
        request.as_mut_ptr()
    })
}

/// Processes the request, and returns the length of the response, bytes.
#[unsafe(no_mangle)]
pub extern "C" fn process_request() -> usize {
    STATE.with(|state| {
        let state = &mut *state.borrow_mut();
        let request = String::from_utf8_lossy(&state.request);
        state.response = engine::answer(&mut state.engine, &request).to_string().into_bytes();
        state.response.len()
    })
}

/// Returns the address of the response.
#[unsafe(no_mangle)]
pub extern "C" fn response() -> *const u8 {
    STATE.with(|state| state.borrow().response.as_ptr())
}

/// Returns the length of the panic message, bytes.
#[unsafe(no_mangle)]
pub extern "C" fn panic_message_len() -> usize {
    PANIC.with(|message| message.borrow().len())
}

/// Returns the address of the panic message.
#[unsafe(no_mangle)]
pub extern "C" fn panic_message() -> *const u8 {
    PANIC.with(|message| message.borrow().as_ptr())
}
