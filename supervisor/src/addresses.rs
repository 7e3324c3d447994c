//! Robots at the same addresses, in lockstep.
//!
//! Linux puts the code and memory of each process at addresses drawn at random, which makes it harder to attack.
//! Robots that run one after another on a core then share the code, but little of what the core has learned of it
//! by its addresses. At the same addresses 64 robots make 1.16 times the ticks/s in lockstep, and 256 about 1.5
//! times (`docs/performance.md`). Only for our own agent: the plant and the programs of a scenario keep theirs.

use libc::{ADDR_NO_RANDOMIZE, c_int, c_ulong, personality};

/// Asks, and changes nothing.
const ASK: c_ulong = 0xffff_ffff;

/// As long as it lives, processes that the calling thread starts have the same addresses each time.
pub(crate) struct SameAddresses {
    before: c_int,
}

impl SameAddresses {
    /// `None` where a sandbox forbids it: slower, and no less right.
    pub(crate) fn for_children() -> Option<SameAddresses> {
        // SAFETY: a plain system call.
        let before = unsafe { personality(ASK) };
        set(before | ADDR_NO_RANDOMIZE).then_some(SameAddresses { before })
    }
}

impl Drop for SameAddresses {
    fn drop(&mut self) {
        set(self.before);
    }
}

fn set(wanted: c_int) -> bool {
    // SAFETY: a plain system call; it changes what is started next, and nothing of this process.
    wanted >= 0 && unsafe { personality(wanted as c_ulong) } >= 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    fn of_a_child() -> String {
        let output = Command::new("cat").arg("/proc/self/personality").output().unwrap();
        String::from_utf8(output.stdout).unwrap().trim().to_owned()
    }

    #[test]
    fn children_have_the_same_addresses_for_as_long_as_wanted() {
        let before = of_a_child();
        let Some(same) = SameAddresses::for_children() else { return };
        let asked = c_int::from_str_radix(&of_a_child(), 16).unwrap();
        assert_eq!(asked & ADDR_NO_RANDOMIZE, ADDR_NO_RANDOMIZE);
        drop(same);
        assert_eq!(of_a_child(), before);
    }
}
