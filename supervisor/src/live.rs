//! What the live view shows of a run under way: one instant of it, and how late it all is.

use formation::front_point::front_point;
use formation::graph::Edge;
use protocol::message::{Contact, TruthHeader, TruthRow};
use report::scene::{EdgeState, Frame, FrameRobot, RobotState};
use results::scene::is_cut;
use view::{Happened, StageNow};

use crate::run::lives::Seat;
use experiment::scenario::Scenario;
use formation::seconds;
use results::latency::Latency;

/// The instant of one truth. `seat` of a robot; how a robot is `heard` by another; whether an edge
/// is `cut_by_hand`.
pub(crate) fn frame(
    scenario: &Scenario,
    header: &TruthHeader,
    rows: &[TruthRow],
    errors_m: &[Option<f64>],
    seat: impl Fn(usize) -> Seat,
    heard: impl Fn(usize, usize) -> Contact,
    cut_by_hand: impl Fn(usize) -> bool,
) -> Frame {
    let alphas: Vec<_> = rows
        .iter()
        .zip(&scenario.robots)
        .map(|(row, robot)| front_point(row.pose(), robot.front_point_m))
        .collect();
    let pairs = alphas.iter().enumerate().flat_map(|(i, a)| {
        let others = &alphas[i + 1..];
        others.iter().map(move |b| (a - b).norm())
    });
    let shown = rows.iter().zip(errors_m).enumerate().map(|(robot, (row, error_m))| {
        let state = state(seat(robot));
        FrameRobot {
            x_m: row.x_m,
            y_m: row.y_m,
            heading_rad: row.heading_rad,
            error_m: error_m.filter(|_| state != RobotState::Dead),
            state,
        }
    });
    let edge = |(place, ends): (usize, &Edge)| {
        let contact = match heard(ends.from, ends.to) {
            Contact::Fresh => EdgeState::Fresh,
            Contact::Stale | Contact::Unheard => EdgeState::Stale,
            Contact::Lost => EdgeState::Lost,
        };
        let cut = cut_by_hand(place) || is_cut(scenario, place, header.t_ns);
        contact.of([ends.from, ends.to].map(|end| state(seat(end))), cut)
    };
    Frame {
        t_s: seconds(header.t_ns),
        robots: shown.collect(),
        edges: scenario.graph.edges().iter().enumerate().map(edge).collect(),
        distance_m: pairs.reduce(f64::min),
    }
}

fn state(seat: Seat) -> RobotState {
    match seat {
        Seat::Moving => RobotState::Moving,
        Seat::Frozen => RobotState::Frozen,
        Seat::Starting => RobotState::Starting,
        Seat::Ending | Seat::Down => RobotState::Dead,
    }
}

/// An event of the run.
pub(crate) fn happened(t_ns: u64, kind: &str, robot: &str, detail: &str) -> Happened {
    Happened { t_s: seconds(t_ns), kind: kind.into(), robot: robot.into(), detail: detail.into() }
}

/// How late every stage is so far.
pub(crate) fn stages(latency: &Latency) -> Vec<StageNow> {
    let us = |ns: u64| ns as f64 / 1e3;
    let stages = latency.latest().into_iter().map(|line| StageNow {
        worst: line.edge(),
        stage: line.stage,
        p50_us: us(line.p50_ns),
        p99_us: us(line.p99_ns),
        max_us: us(line.max_ns),
        count: line.count,
    });
    stages.collect()
}
