//! Shrinking: simpler variants of a run that misses an expectation. Variants with fewer faults come first, then with
//! fewer affected robots and fewer changed starts, then with rounder numbers and earlier times.
//!
//! The caller continues from the first variant that also misses the expectation, until none does.

use formation::portable_math;
use formation::random::SplitMix64;

use crate::hunt::cma::{draw_standard_normal, reflected};
use crate::hunt::plan::{EVERY, Plan, PlannedFault, round_to_digits};
use crate::hunt::search::an_end;
use crate::hunt::space::{Space, round_to_multiple};
use crate::scenario::Scenario;

/// Returns plans with fewer faults, fewest first.
pub fn fewer_faults(plan: &Plan, space: &Space) -> Vec<Plan> {
    let faults = 0..plan.faults.len();
    let mut fewer: Vec<Plan> = Vec::new();
    if !plan.faults.is_empty() {
        fewer.push(Plan { faults: Vec::new(), ..plan.clone() });
    }
    let without = |plan: &Plan, gone: usize| {
        let mut other = plan.clone();
        other.faults.remove(gone);
        other
    };
    fewer.extend(faults.clone().map(|gone| without(plan, gone)));
    for gone in faults.clone() {
        // One fault less, with another one at its maximum strength.
        fewer.extend(faults.clone().filter(|kept| *kept != gone).map(|kept| {
            let mut other = plan.clone();
            other.faults[kept] = space.strongest_fault(&plan.faults[kept]);
            without(&other, gone)
        }));
        fewer.push(space.maximize_faults(&without(plan, gone)));
    }
    let pairs = faults.clone().flat_map(|a| (a + 1..plan.faults.len()).map(move |b| [a, b]));
    for [a, b] in pairs {
        let one = merge_faults(&plan.faults[a], &plan.faults[b], space.can_affect_all());
        fewer.extend(one.map(|one| {
            let mut other = plan.clone();
            other.faults[a] = one;
            without(&other, b)
        }));
        fewer.push(without(&without(plan, b), a));
    }
    fewer
}

/// Merges two faults of the same kind into one, from the earlier start to the later end, with the larger strength. If
/// they affect different robots or links, the result affects one of `all`, where the bounds allow that.
fn merge_faults(a: &PlannedFault, b: &PlannedFault, all: bool) -> Option<PlannedFault> {
    let words = |fault: &PlannedFault| fault.amounts.iter().map(|(word, _)| *word).collect();
    let (these, those): (Vec<&str>, Vec<&str>) = (words(a), words(b));
    let who = match a.who == b.who {
        true => a.who.clone(),
        false => vec![EVERY.to_owned(); a.who.len()],
    };
    let fits = a.who == b.who || all && a.who.len() == b.who.len();
    if !fits || (a.kind, a.what, these) != (b.kind, b.what, those) {
        return None;
    }
    let at_ns = a.at_ns.min(b.at_ns);
    let end_ns = |fault: &PlannedFault| Some(fault.at_ns + fault.for_ns?);
    let for_ns = end_ns(a).zip(end_ns(b)).map(|(a, b)| a.max(b) - at_ns);
    let stronger = |(&(word, a), (_, b)): (&(_, Option<f64>), &(_, Option<f64>))| {
        (word, a.zip(*b).map(|(a, b)| a.max(b)))
    };
    let amounts = a.amounts.iter().zip(&b.amounts).map(stronger).collect();
    Some(PlannedFault { who, amounts, at_ns, for_ns, ..a.clone() })
}

/// Returns a point near another one: some of the continuous coordinates are changed.
pub fn draw_nearby_point(point: &[f64], space: &Space, random: &mut SplitMix64) -> Vec<f64> {
    let (gradual, matters) = (space.coordinate_shape().gradual, space.used_coordinates(point));
    let step = 0.3 * portable_math::pow(0.1, random.unit());
    let change = |(place, &x): (usize, &f64)| match gradual[place] && matters[place] {
        true if random.draw_bool(0.05) => an_end(random),
        true if random.draw_bool(0.25) => reflected(x + step * draw_standard_normal(random)),
        _ => x,
    };
    point.iter().enumerate().map(change).collect()
}

/// Returns other plans with at most as many faults, simplest first.
pub fn simpler_plans(plan: &Plan, space: &Space) -> Vec<Plan> {
    let with = |change: &dyn Fn(&mut Plan)| {
        let mut other = plan.clone();
        change(&mut other);
        other
    };
    let faults = 0..plan.faults.len();
    let mut simpler = fewer_faults(plan, space);
    simpler.extend(fewer_robots(plan, space));
    simpler.push(with(&|other| other.starts.clear()));
    simpler
        .extend((0..plan.starts.len()).map(|start| with(&|other| _ = other.starts.remove(start))));
    simpler.push(with(&|other| other.gains.clear()));
    simpler.extend((0..plan.gains.len()).map(|gain| with(&|other| _ = other.gains.remove(gain))));
    for fault in faults {
        let rounder = rounder_faults(&plan.faults[fault], space.scenario()).into_iter();
        simpler.extend(rounder.map(|rounder| with(&|other| other.faults[fault] = rounder.clone())));
    }
    for (start, (_, pose)) in plan.starts.iter().enumerate() {
        for in_one in [1.0, 10.0, 100.0] {
            let mut round = *pose;
            for number in [&mut round.x_m, &mut round.y_m, &mut round.heading_rad] {
                *number = round_to_multiple(*number, in_one);
            }
            simpler.push(with(&|other| other.starts[start].1 = round));
        }
    }
    for (gain, (_, value)) in plan.gains.iter().enumerate() {
        let round = [1, 2].map(|digits| round_to_digits(*value, digits));
        simpler.extend(round.map(|round| with(&|other| other.gains[gain].1 = round)));
    }
    simpler.retain(|other| other != plan);
    simpler
}

/// Returns plans with one robot or link in place of `*`, or with robots that other faults affect already.
fn fewer_robots(plan: &Plan, space: &Space) -> Vec<Plan> {
    let mut fewer = Vec::new();
    let struck = plan.faulty_robot_names().len();
    for (place, fault) in plan.faults.iter().enumerate() {
        let every = fault.who.iter().any(|name| name == EVERY);
        for who in space.single_targets(&fault.who) {
            let mut other = plan.clone();
            other.faults[place].who = who;
            if every || other.faulty_robot_names().len() < struck {
                fewer.push(other);
            }
        }
    }
    fewer
}

/// Returns variants of a fault with an earlier or rounder time, a rounder or shorter duration, or rounder numbers.
fn rounder_faults(fault: &PlannedFault, scenario: &Scenario) -> Vec<PlannedFault> {
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
            other.amounts[place].1 = Some(round_to_digits(amount, digits));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::row_of_three;
    use crate::scenario::{HuntBounds, Varied};

    fn targets_of_faults(plan: &Plan) -> Vec<(&str, &Vec<String>, &str)> {
        plan.faults.iter().map(|fault| (fault.kind, &fault.who, fault.what)).collect()
    }

    #[test]
    fn merged_fault_covers_both_durations_and_strengths() {
        let fault = |who: &str, by, at_ns, for_ns| PlannedFault {
            kind: "delay",
            who: vec![who.into()],
            what: "odometry",
            amounts: vec![("by", Some(by))],
            at_ns,
            for_ns,
        };
        let [a, b] = [fault("r1", 0.1, 4, Some(6)), fault("r1", 0.2, 2, Some(3))];
        assert_eq!(merge_faults(&a, &b, false), Some(fault("r1", 0.2, 2, Some(8))));
        let other = fault("r2", 0.0, 1, None);
        assert_eq!(merge_faults(&a, &other, true), Some(fault("*", 0.1, 1, None)), "to the end");
        assert_eq!(merge_faults(&a, &other, false), None, "not all may break");
        assert_eq!(merge_faults(&a, &PlannedFault { kind: "loss", ..b.clone() }, true), None);
        assert_eq!(merge_faults(&a, &PlannedFault { what: "commands", ..b }, true), None);
    }

    #[test]
    fn shrunk_faults_are_a_subset_and_near_points_keep_all_faults() {
        let hunt = HuntBounds {
            faults_max: 3,
            kinds: vec!["freeze", "cut", "delay"],
            robots: vec![0, 1, 2],
            until_ns: 10_000_000_000,
            delay_ns_max: 3_000_000_000,
            ..HuntBounds::default()
        };
        let scenario = Scenario { hunt, ..row_of_three() };
        let space = Space::new(&scenario, &[Varied::Faults]).unwrap();
        let mut random = SplitMix64::new(1);
        let mut anywhere =
            || -> Vec<f64> { space.unchanged_point().iter().map(|_| random.unit()).collect() };
        let point = std::iter::repeat_with(&mut anywhere)
            .find(|point| space.plan(point).faults.len() == 3)
            .unwrap();
        let plan = space.plan(&point);
        let fewer: Vec<usize> =
            fewer_faults(&plan, &space).iter().map(|plan| plan.faults.len()).collect();
        assert_eq!(fewer[..10], [0, 2, 2, 2, 2, 2, 2, 2, 2, 2]);
        assert_eq!(fewer[10..].iter().filter(|left| **left == 1).count(), 3, "{fewer:?}");
        let all_near = (0..50).map(|_| space.plan(&draw_nearby_point(&point, &space, &mut random)));
        let all_near: Vec<Plan> = all_near.collect();
        assert!(all_near.iter().any(|other| *other != plan));
        for other in all_near {
            assert_eq!(targets_of_faults(&other), targets_of_faults(&plan));
            assert_eq!(other.clone().with_only(&plan.faults), other);
            let one = other.with_only(&plan.faults[1..2]);
            assert_eq!(targets_of_faults(&one), targets_of_faults(&plan)[1..2]);
        }
    }
}
