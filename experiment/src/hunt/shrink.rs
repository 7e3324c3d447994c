//! Which simpler runs are tried in place of one that misses an expectation: fewer faults first, then fewer robots
//! in them and fewer that start elsewhere, then round numbers and early times.
//!
//! Whoever tries them goes on from the first that misses it too, until none does.

use crate::hunt::plan::{EVERY, Plan, PlannedFault, rounded};
use crate::hunt::space::{Space, rounded_to};
use crate::scenario::Scenario;

/// Simpler plans, simplest first; none is the plan itself.
pub fn simpler(plan: &Plan, space: &Space) -> Vec<Plan> {
    let with = |change: &dyn Fn(&mut Plan)| {
        let mut other = plan.clone();
        change(&mut other);
        other
    };
    let faults = 0..plan.faults.len();
    let mut simpler = vec![with(&|other| other.faults.clear())];
    simpler.extend(faults.clone().map(|fault| with(&|other| _ = other.faults.remove(fault))));
    for gone in faults.clone() {
        // One fault less, where another one is as strong as the bounds allow.
        simpler.extend(faults.clone().filter(|kept| *kept != gone).map(|kept| {
            with(&|other| {
                other.faults[kept] = space.strongest(&plan.faults[kept]);
                other.faults.remove(gone);
            })
        }));
    }
    simpler.extend(fewer_robots(plan, space));
    simpler.push(with(&|other| other.starts.clear()));
    simpler
        .extend((0..plan.starts.len()).map(|start| with(&|other| _ = other.starts.remove(start))));
    simpler.push(with(&|other| other.gains.clear()));
    simpler.extend((0..plan.gains.len()).map(|gain| with(&|other| _ = other.gains.remove(gain))));
    for fault in faults {
        let rounder = rounder(&plan.faults[fault], space.scenario()).into_iter();
        simpler.extend(rounder.map(|rounder| with(&|other| other.faults[fault] = rounder.clone())));
    }
    for (start, (_, pose)) in plan.starts.iter().enumerate() {
        for in_one in [1.0, 10.0, 100.0] {
            let mut round = *pose;
            for number in [&mut round.x_m, &mut round.y_m, &mut round.heading_rad] {
                *number = rounded_to(*number, in_one);
            }
            simpler.push(with(&|other| other.starts[start].1 = round));
        }
    }
    for (gain, (_, value)) in plan.gains.iter().enumerate() {
        let round = [1, 2].map(|digits| rounded(*value, digits));
        simpler.extend(round.map(|round| with(&|other| other.gains[gain].1 = round)));
    }
    simpler.retain(|other| other != plan);
    simpler
}

/// One robot or link in place of every one, and robots that break already in place of others.
fn fewer_robots(plan: &Plan, space: &Space) -> Vec<Plan> {
    let mut fewer = Vec::new();
    let struck = plan.struck().len();
    for (place, fault) in plan.faults.iter().enumerate() {
        let every = fault.who.iter().any(|name| name == EVERY);
        for who in space.instead_of_every(&fault.who) {
            let mut other = plan.clone();
            other.faults[place].who = who;
            if every || other.struck().len() < struck {
                fewer.push(other);
            }
        }
    }
    fewer
}

/// The same fault at an earlier, rounder time, for a rounder or shorter one, by rounder amounts.
fn rounder(fault: &PlannedFault, scenario: &Scenario) -> Vec<PlannedFault> {
    let mut rounder = Vec::new();
    let (period_ns, from_ns) = (scenario.period_ns, scenario.hunt.from_ns.min(fault.at_ns));
    let whole = |ns: u64, unit_ns: u64| ns / unit_ns * unit_ns;
    let units = [10_000_000_000, 1_000_000_000, 100_000_000, 10_000_000];
    let units = units.into_iter().filter(|unit| unit % period_ns == 0);
    let earlier = [from_ns, whole(fault.at_ns / 2, period_ns)].into_iter();
    let earlier = earlier.chain(units.clone().map(|unit| whole(fault.at_ns, unit)));
    let earlier = earlier.filter(|at_ns| *at_ns >= from_ns);
    rounder.extend(earlier.map(|at_ns| PlannedFault { at_ns, ..fault.clone() }));
    if let Some(for_ns) = fault.for_ns {
        let shorter = [period_ns, whole(for_ns / 2, period_ns)].into_iter();
        let shorter = shorter.chain(units.map(|unit| whole(for_ns, unit))).filter(|ns| *ns > 0);
        rounder.extend(shorter.map(|ns| PlannedFault { for_ns: Some(ns), ..fault.clone() }));
    }
    for place in 0..fault.amounts.len() {
        let (word, Some(amount)) = fault.amounts[place] else { continue };
        for digits in [1, 2] {
            let mut other = fault.clone();
            other.amounts[place].1 = Some(rounded(amount, digits));
            rounder.push(other);
        }
        if ["jitter", "heading", "burst", "turn"].contains(&word) {
            let mut other = fault.clone();
            other.amounts.remove(place);
            rounder.push(other);
        }
    }
    rounder
}
