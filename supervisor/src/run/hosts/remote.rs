//! A robot whose process another host has: how it is to be, and how it is said to be.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;

use protocol::message::{OrderRow, ReportRow, Wanted};

/// One robot of another host.
#[derive(Debug, Clone)]
pub(crate) struct Remote {
    /// Its host, by its place.
    pub(crate) host: usize,
    robot: u64,
    starts: u64,
    wanted: Wanted,
    report: ReportRow,
    /// How many of its processes are known to have ended, and to be cleaned up.
    reaped: u64,
    cleaned: u64,
}

impl Remote {
    /// A robot, by its place from 0, whose process was not started yet.
    pub(crate) fn new(robot: usize, host: usize) -> Remote {
        let report = ReportRow::default();
        let robot = robot as u64 + 1;
        Remote { host, robot, starts: 0, wanted: Wanted::Running, report, reaped: 0, cleaned: 0 }
    }

    /// It is to be started once more.
    pub(crate) fn start(&mut self) {
        self.starts += 1;
        self.wanted = Wanted::Running;
    }

    /// It is to be so from now on.
    pub(crate) fn want(&mut self, wanted: Wanted) {
        self.wanted = wanted;
    }

    /// How it is to be.
    pub(crate) fn order(&self) -> OrderRow {
        OrderRow { robot: self.robot, starts: self.starts, wanted: self.wanted as u64 }
    }

    /// Its host says how it is.
    pub(crate) fn report(&mut self, report: ReportRow) {
        // A host that began anew knows less.
        if report.starts >= self.report.starts {
            self.report = report;
        }
    }

    /// Whether it ended, and nobody has asked yet.
    pub(crate) fn has_ended(&self) -> bool {
        let report = &self.report;
        report.ended == 1 && report.starts == self.starts && self.reaped < self.starts
    }

    /// How its process ended, once it has; told once.
    pub(crate) fn reap(&mut self) -> Option<ExitStatus> {
        let ended = self.has_ended();
        ended.then(|| {
            self.reaped = self.starts;
            ExitStatus::from_raw(self.report.status as i32)
        })
    }

    /// Whether what a dead process of it left is removed; told once.
    pub(crate) fn is_cleaned(&mut self) -> bool {
        let cleaned = self.cleaned < self.report.cleaned.min(self.reaped);
        self.cleaned += u64::from(cleaned);
        cleaned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_end_is_told_once_and_only_of_the_process_that_was_started_last() {
        let mut remote = Remote::new(3, 1);
        remote.start();
        assert_eq!(remote.order(), OrderRow { robot: 4, starts: 1, wanted: 0 });
        let row = ReportRow { robot: 4, starts: 1, cleaned: 0, ended: 0, status: 0 };
        remote.report(row);
        assert!(remote.reap().is_none() && !remote.is_cleaned());
        remote.want(Wanted::Killed);
        remote.report(ReportRow { ended: 1, status: 9, cleaned: 1, ..row });
        assert!(!remote.is_cleaned(), "its end is told first");
        assert_eq!(remote.reap().unwrap().signal(), Some(9));
        assert!(remote.reap().is_none() && remote.is_cleaned() && !remote.is_cleaned());
        remote.start();
        assert!(!remote.has_ended(), "the next one was not started yet");
        assert_eq!(remote.order(), OrderRow { robot: 4, starts: 2, wanted: 0 });
    }
}
