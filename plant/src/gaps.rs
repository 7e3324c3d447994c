//! Whether commands got lost on their way: their numbers have gaps then.

use protocol::message::Command;

/// The newest command taken from one robot.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Gaps {
    incarnation: u64,
    sequence: u64,
}

impl Gaps {
    /// How many commands were lost between the newest one and this one. An incarnation counts its
    /// commands from 1.
    pub(crate) fn before(&mut self, command: &Command) -> u64 {
        let Command { incarnation, sequence, .. } = *command;
        let known = if incarnation == self.incarnation { self.sequence } else { 0 };
        if incarnation < self.incarnation || sequence <= known {
            return 0;
        }
        *self = Gaps { incarnation, sequence };
        sequence - known - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_that_was_overwritten_is_missed_and_one_from_before_a_death_is_not() {
        let mut gaps = Gaps::default();
        let lost = [(0, 1), (0, 2), (0, 5), (0, 4), (1, 1), (0, 6), (1, 3), (2, 2)].map(
            |(incarnation, sequence)| {
                gaps.before(&Command { incarnation, sequence, ..Command::default() })
            },
        );
        assert_eq!(lost, [0, 0, 2, 0, 0, 0, 1, 1]);
    }
}
