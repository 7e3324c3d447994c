//! Several hosts: what the supervisor of the plant's host has to do with those of the others, and what
//! these do.
//!
//! The plant's host decides everything. It says how each process of another host is to be, and hears how
//! it is; both are told again and again, so that nothing has to arrive. The robots need neither.
//!
//! | file | question it answers |
//! |---|---|
//! | `remote` | how does the plant's host see the robots of another? |
//! | `coordinator` | how does the plant's host gather the others, watch and release them? |
//! | `share` | what does the supervisor of another host do? |

pub(crate) mod coordinator;
pub(crate) mod remote;
pub mod share;
