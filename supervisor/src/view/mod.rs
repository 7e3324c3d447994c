//! Live view: a page served to browsers on this machine while a run is in progress.
//!
//! The server has its own thread with the lowest priority. The supervisor passes the newest data and
//! continues: it never waits for a client, and drops data for which there is no space. Must not act on a
//! process of the run: a client sends a [`ClientRequest`], and the supervisor decides.
//!
//! | file | contents |
//! |---|---|
//! | `address` | address at which it listens |
//! | `handle` | data that the supervisor passes, and when |
//! | `act` | requests of clients, and their validation |
//! | `gate` | access control |
//! | `token` | secret in the address |
//! | `client_snapshot` | messages to each client, and the frames that a slow one misses |
//! | `listener` | limits on connections |
//! | `server` | server thread, and its responses |

mod act;
mod address;
mod client_snapshot;
mod gate;
mod handle;
mod listener;
mod server;
mod token;

pub use act::{ClientRequest, RequestedAction};
pub use address::{DEFAULT_ADDRESS, parse_address};
pub use handle::{RunEvent, StageLatency, View};
pub use server::{BoundServer, ViewError, bind};
