//! A robot whose process runs on another host: the state ordered for it, and the state that its host reports.

use std::os::unix::process::ExitStatusExt as _;
use std::process::ExitStatus;
use std::time::Duration;

use protocol::message::{OrderRow, PolledState, ReportRow, WantedState};
use protocol::watchdog::{ProcessSample, SchedulingState};

/// Robot of another host.
#[derive(Debug, Clone)]
pub(crate) struct RemoteRobot {
    /// Index of the robot's host.
    pub(crate) host: usize,
    robot: u64,
    starts: u64,
    wanted_state: WantedState,
    report: ReportRow,
    /// Number of the robot's processes that are known to have exited and to need a clean-up.
    reaped_count: u64,
    cleaned_count: u64,
}

impl RemoteRobot {
    /// Creates the state of a robot, by its index from 0, whose process has not been started.
    pub(crate) fn new(robot: usize, host: usize) -> RemoteRobot {
        let report = ReportRow::default();
        let robot = robot as u64 + 1;
        RemoteRobot {
            host,
            robot,
            starts: 0,
            wanted_state: WantedState::Running,
            report,
            reaped_count: 0,
            cleaned_count: 0,
        }
    }

    /// Orders another start of the robot's process.
    pub(crate) fn order_start(&mut self) {
        self.starts += 1;
        self.wanted_state = WantedState::Running;
    }

    /// Orders this state for the robot's process.
    pub(crate) fn order_state(&mut self, state: WantedState) {
        self.wanted_state = state;
    }

    /// Returns the order for the robot's host.
    pub(crate) fn order(&self) -> OrderRow {
        OrderRow { robot: self.robot, starts: self.starts, wanted: self.wanted_state as u64 }
    }

    /// Updates the state from a report of the robot's host.
    pub(crate) fn update_report(&mut self, report: ReportRow) {
        // A restarted host has counted fewer starts; its report is ignored.
        if report.starts >= self.report.starts {
            self.report = report;
        }
    }

    /// Returns whether the robot's process has exited and was not yet returned by [`RemoteRobot::reap`].
    pub(crate) fn has_ended(&self) -> bool {
        let report = &self.report;
        report.ended == 1 && report.starts == self.starts && self.reaped_count < self.starts
    }

    /// Returns the exit status of the robot's process, once for each process; `None` if it has not exited.
    pub(crate) fn reap(&mut self) -> Option<ExitStatus> {
        let has_ended = self.has_ended();
        has_ended.then(|| {
            self.reaped_count = self.starts;
            ExitStatus::from_raw(self.report.status as i32)
        })
    }

    /// Returns whether the robot's process exited before its host learned that the run is over, and was not yet
    /// returned by [`RemoteRobot::reap`].
    pub(crate) fn ended_early(&self) -> bool {
        self.has_ended() && self.report.ended_early == 1
    }

    /// Returns whether the robot's newest process is stopped without an order.
    pub(crate) fn is_stopped(&self) -> bool {
        self.sample().is_some_and(|sample| sample.state == SchedulingState::Stopped)
    }

    /// Returns the last polled state of the robot's newest process, by its host's clock; `None` if there is none, or it
    /// was not polled since the last order, or is stopped as ordered.
    pub(crate) fn sample(&self) -> Option<ProcessSample> {
        let report = &self.report;
        let state = match PolledState::from_number(report.state)? {
            PolledState::NotPolled => return None,
            PolledState::Runnable => SchedulingState::Runnable,
            PolledState::Blocked => SchedulingState::Blocked,
            PolledState::Stopped => SchedulingState::Stopped,
        };
        let is_newest = report.starts == self.starts && report.ended == 0;
        is_newest.then(|| ProcessSample {
            state,
            cpu_time: Duration::from_nanos(report.computed_ns),
            time_ns: report.polled_ns,
            start_time_ticks: report.starts,
        })
    }

    /// Returns the number of starts ordered so far.
    pub(crate) fn starts(&self) -> u64 {
        self.starts
    }

    /// Returns whether the stale resources of a dead process of the robot have been removed, once for each process.
    pub(crate) fn take_cleanup(&mut self) -> bool {
        let is_cleaned = self.cleaned_count < self.report.cleaned.min(self.reaped_count);
        self.cleaned_count += u64::from(is_cleaned);
        is_cleaned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_exit_is_returned_once_for_the_newest_process() {
        let mut remote = RemoteRobot::new(3, 1);
        remote.order_start();
        assert_eq!(remote.order(), OrderRow { robot: 4, starts: 1, wanted: 0 });
        let row = ReportRow { robot: 4, starts: 1, ..ReportRow::default() };
        remote.update_report(row);
        assert!(remote.reap().is_none() && !remote.take_cleanup());
        remote.order_state(WantedState::Killed);
        remote.update_report(ReportRow { ended: 1, status: 9, cleaned: 1, ..row });
        assert!(!remote.take_cleanup(), "its end is told first");
        assert_eq!(remote.reap().unwrap().signal(), Some(9));
        assert!(remote.reap().is_none() && remote.take_cleanup() && !remote.take_cleanup());
        remote.order_start();
        assert!(!remote.has_ended(), "the next one was not started yet");
        assert_eq!(remote.order(), OrderRow { robot: 4, starts: 2, wanted: 0 });
    }

    #[test]
    fn process_state_counts_for_the_newest_process_alone() {
        let mut remote = RemoteRobot::new(0, 1);
        remote.order_start();
        assert!(remote.sample().is_none(), "it was not polled yet");
        let stopped = PolledState::Stopped as u64;
        let row = ReportRow { robot: 1, starts: 1, state: stopped, ..ReportRow::default() };
        remote.update_report(ReportRow { computed_ns: 7, polled_ns: 9, ..row });
        let cpu_time = Duration::from_nanos(7);
        let expected = ProcessSample {
            state: SchedulingState::Stopped,
            cpu_time,
            time_ns: 9,
            start_time_ticks: 1,
        };
        assert_eq!((remote.sample(), remote.is_stopped()), (Some(expected), true));
        remote.update_report(ReportRow { ended: 1, status: 9, ended_early: 1, ..row });
        assert!(!remote.is_stopped() && remote.ended_early());
        remote.reap();
        assert!(!remote.ended_early(), "it was reaped here");
        remote.order_start();
        assert!(remote.sample().is_none() && !remote.is_stopped());
    }
}
