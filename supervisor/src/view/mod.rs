//! The live view: a page served to browsers on this machine while a run goes on.
//!
//! One thread of its own, which every other thread of the machine comes before. The supervisor hands
//! over what is newest and goes on: it waits for no client, and drops what nobody has room for. Must
//! not: touch a process of the run. What a client asks for is a [`Request`], and the supervisor decides.
//!
//! | file | question it answers |
//! |---|---|
//! | `address` | where does it listen, and who may reach it there? |
//! | `handle` | what does the supervisor hand over, and when? |
//! | `act` | what may a client ask for, and what is wrong with it? |
//! | `gate` | who is let in? |
//! | `token` | the secret in the address |
//! | `news` | what is each client told, and what does a slow one miss? |
//! | `listener` | how many connections are there at once? |
//! | `server` | the thread, and what it answers to which address |

mod act;
mod address;
mod gate;
mod handle;
mod listener;
mod news;
mod server;
mod token;

pub use act::{Act, Request};
pub use address::{DEFAULT, address};
pub use handle::{Happened, StageNow, View};
pub use server::{Bound, ViewError, bind};
