//! What processes are called that are none of the run's: read once of each, and told by the kernel when it
//! changes.

use std::collections::BTreeMap;

/// So many names are kept, those of holders of cores aside.
const NAMES_MAX: usize = 100_000;

/// Names by process.
#[derive(Debug, Default)]
pub(super) struct Names(BTreeMap<u32, Name>);

#[derive(Debug, Default)]
struct Name {
    /// `None`: it could not be read.
    text: Option<String>,
    /// Another process may have this number now.
    old: bool,
    /// It held a core while a robot waited.
    held: bool,
}

impl Names {
    /// This process held a core: its name is read if it is not known.
    pub(super) fn held(&mut self, process: u32) {
        self.held_by(process, read);
    }

    fn held_by(&mut self, process: u32, read: impl FnOnce(u32) -> Option<String>) {
        let name = self.0.entry(process).or_default();
        if name.text.is_none() || name.old {
            // Who has ended keeps the name that its number had.
            name.text = read(process).map(|text| short(&text)).or(name.text.take());
            name.old = false;
        }
        name.held = true;
    }

    /// A process began under this number.
    pub(super) fn began(&mut self, process: u32) {
        if let Some(name) = self.0.get_mut(&process) {
            name.old = true;
        }
    }

    /// A process is called this from now on.
    pub(super) fn named(&mut self, process: u32, name: &str) {
        if self.0.len() >= NAMES_MAX {
            self.0.retain(|_, name| name.held);
        }
        let held = self.0.get(&process).is_some_and(|name| name.held);
        self.0.insert(process, Name { text: Some(short(name)), old: false, held });
    }

    /// What it is called.
    pub(super) fn get(&self, process: u32) -> Option<&str> {
        self.0.get(&process)?.text.as_deref()
    }
}

/// `None` once it has ended.
fn read(process: u32) -> Option<String> {
    std::fs::read_to_string(format!("/proc/{process}/comm")).ok()
}

/// Without the number of a kernel thread's core.
fn short(name: &str) -> String {
    name.trim().split('/').next().unwrap_or_default().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_read_once_and_again_only_for_another_process_of_that_number() {
        let mut names = Names::default();
        names.held_by(7, |_| Some("kworker/0:1\n".to_owned()));
        names.held_by(7, |_| panic!("it is known"));
        assert_eq!(names.get(7), Some("kworker"));
        names.began(7);
        assert_eq!(names.get(7), Some("kworker"), "until it holds a core");
        names.held_by(7, |_| Some("sh".to_owned()));
        assert_eq!(names.get(7), Some("sh"));
        names.named(7, "cargo");
        names.held_by(7, |_| panic!("the kernel told it"));
        assert_eq!(names.get(7), Some("cargo"));
    }

    #[test]
    fn who_has_ended_has_the_name_that_the_kernel_told_or_none() {
        let mut names = Names::default();
        names.held_by(8, |_| None);
        assert_eq!(names.get(8), None);
        names.named(9, "ld");
        names.held_by(9, |_| None);
        assert_eq!(names.get(9), Some("ld"));
    }

    #[test]
    fn names_of_those_that_never_held_a_core_do_not_pile_up() {
        let mut names = Names::default();
        names.held_by(1, |_| Some("first".to_owned()));
        let many = 2 * NAMES_MAX as u32;
        (2..many).for_each(|process| names.named(process, "cc"));
        assert!(names.0.len() <= NAMES_MAX, "{}", names.0.len());
        assert_eq!(names.get(1), Some("first"));
    }
}
