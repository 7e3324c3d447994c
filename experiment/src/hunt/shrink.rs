//! Shrinking: simpler variants of a run that misses an expectation. Variants with fewer faults come first, then with
//! fewer affected robots and fewer changed starts, then with rounder numbers and earlier times.
//!
//! The caller continues from the first variant that also misses the expectation, until none does.

use formation::portable_math;
use formation::random::SplitMix64;

use crate::hunt::cma::{draw_standard_normal, reflect_into_unit_interval};
use crate::hunt::plan::{ALL_ROBOTS, PlannedFault, RunPlan, round_to_digits};
use crate::hunt::search::draw_range_end;
use crate::hunt::space::{SearchSpace, round_to_multiple};
use crate::scenario::Scenario;

/// Returns plans with fewer faults, fewest first.
pub fn plans_with_fewer_faults(plan: &RunPlan, space: &SearchSpace) -> Vec<RunPlan> {
    let faults = 0..plan.faults.len();
    let mut fewer: Vec<RunPlan> = Vec::new();
    if !plan.faults.is_empty() {
        fewer.push(RunPlan { faults: Vec::new(), ..plan.clone() });
    }
    let without = |plan: &RunPlan, removed: usize| {
        let mut other = plan.clone();
        other.faults.remove(removed);
        other
    };
    fewer.extend(faults.clone().map(|removed| without(plan, removed)));
    for removed in faults.clone() {
        // One fault less, with another one at its maximum strength.
        fewer.extend(faults.clone().filter(|strengthened| *strengthened != removed).map(
            |strengthened| {
                let mut other = plan.clone();
                other.faults[strengthened] = space.strongest_fault(&plan.faults[strengthened]);
                without(&other, removed)
            },
        ));
        fewer.push(space.maximize_faults(&without(plan, removed)));
    }
    let pairs = faults.clone().flat_map(|a| (a + 1..plan.faults.len()).map(move |b| [a, b]));
    for [a, b] in pairs {
        let merged = merge_faults(&plan.faults[a], &plan.faults[b], space.can_affect_all());
        fewer.extend(merged.map(|merged| {
            let mut other = plan.clone();
            other.faults[a] = merged;
            without(&other, b)
        }));
        fewer.push(without(&without(plan, b), a));
    }
    fewer
}

/// Merges two faults of the same kind into one, from the earlier start to the later end, with the larger strength. If
/// they affect different robots or links, the result affects one of `all`, where the bounds allow that.
fn merge_faults(a: &PlannedFault, b: &PlannedFault, all: bool) -> Option<PlannedFault> {
    let keywords = |fault: &PlannedFault| fault.parameters.iter().map(|(word, _)| *word).collect();
    let (a_keywords, b_keywords): (Vec<&str>, Vec<&str>) = (keywords(a), keywords(b));
    let target_names = match a.target_names == b.target_names {
        true => a.target_names.clone(),
        false => vec![ALL_ROBOTS.to_owned(); a.target_names.len()],
    };
    let same_target_count =
        a.target_names == b.target_names || all && a.target_names.len() == b.target_names.len();
    if !same_target_count
        || (a.kind, a.target_component, a_keywords) != (b.kind, b.target_component, b_keywords)
    {
        return None;
    }
    let start_ns = a.start_ns.min(b.start_ns);
    let end_ns = |fault: &PlannedFault| Some(fault.start_ns + fault.duration_ns?);
    let duration_ns = end_ns(a).zip(end_ns(b)).map(|(a, b)| a.max(b) - start_ns);
    let stronger = |(&(word, a), (_, b)): (&(_, Option<f64>), &(_, Option<f64>))| {
        (word, a.zip(*b).map(|(a, b)| a.max(b)))
    };
    let parameters = a.parameters.iter().zip(&b.parameters).map(stronger).collect();
    Some(PlannedFault { target_names, parameters, start_ns, duration_ns, ..a.clone() })
}

/// Returns a point near another one: some of the continuous coordinates are changed.
pub fn draw_nearby_point(point: &[f64], space: &SearchSpace, random: &mut SplitMix64) -> Vec<f64> {
    let (is_continuous, is_used) =
        (space.coordinate_layout().is_continuous, space.used_coordinates(point));
    let step = 0.3 * portable_math::pow(0.1, random.draw_unit());
    let change = |(index, &x): (usize, &f64)| match is_continuous[index] && is_used[index] {
        true if random.draw_bool(0.05) => draw_range_end(random),
        true if random.draw_bool(0.25) => {
            reflect_into_unit_interval(x + step * draw_standard_normal(random))
        }
        _ => x,
    };
    point.iter().enumerate().map(change).collect()
}

/// Returns other plans with at most as many faults, simplest first.
pub fn simpler_plans(plan: &RunPlan, space: &SearchSpace) -> Vec<RunPlan> {
    let modified = |change: &dyn Fn(&mut RunPlan)| {
        let mut other = plan.clone();
        change(&mut other);
        other
    };
    let faults = 0..plan.faults.len();
    let mut simpler = plans_with_fewer_faults(plan, space);
    simpler.extend(plans_with_fewer_robots(plan, space));
    simpler.push(modified(&|other| other.starts.clear()));
    simpler.extend(
        (0..plan.starts.len()).map(|start| modified(&|other| _ = other.starts.remove(start))),
    );
    simpler.push(modified(&|other| other.gains.clear()));
    simpler
        .extend((0..plan.gains.len()).map(|gain| modified(&|other| _ = other.gains.remove(gain))));
    for fault in faults {
        let rounder =
            faults_with_rounder_numbers(&plan.faults[fault], space.scenario()).into_iter();
        simpler.extend(
            rounder.map(|rounder| modified(&|other| other.faults[fault] = rounder.clone())),
        );
    }
    for (start, (_, pose)) in plan.starts.iter().enumerate() {
        for per_unit in [1.0, 10.0, 100.0] {
            let mut round = *pose;
            for number in [&mut round.x_m, &mut round.y_m, &mut round.heading_rad] {
                *number = round_to_multiple(*number, per_unit);
            }
            simpler.push(modified(&|other| other.starts[start].1 = round));
        }
    }
    for (gain, (_, value)) in plan.gains.iter().enumerate() {
        let round = [1, 2].map(|digits| round_to_digits(*value, digits));
        simpler.extend(round.map(|round| modified(&|other| other.gains[gain].1 = round)));
    }
    simpler.retain(|other| other != plan);
    simpler
}

/// Returns plans with one robot or link in place of `*`, or with robots that other faults affect already.
fn plans_with_fewer_robots(plan: &RunPlan, space: &SearchSpace) -> Vec<RunPlan> {
    let mut fewer = Vec::new();
    let affected_count = plan.faulty_robot_names().len();
    for (index, fault) in plan.faults.iter().enumerate() {
        let affects_all = fault.target_names.iter().any(|name| name == ALL_ROBOTS);
        for target_names in space.single_targets(fault) {
            let mut other = plan.clone();
            other.faults[index].target_names = target_names;
            if affects_all || other.faulty_robot_names().len() < affected_count {
                fewer.push(other);
            }
        }
    }
    fewer
}

/// Returns variants of a fault with an earlier or rounder time, a rounder or shorter duration, or rounder numbers.
fn faults_with_rounder_numbers(fault: &PlannedFault, scenario: &Scenario) -> Vec<PlannedFault> {
    let mut rounder = Vec::new();
    let (period_ns, earliest_ns) =
        (scenario.period_ns, scenario.hunt_bounds.earliest_fault_start_ns.min(fault.start_ns));
    let round_down = |ns: u64, unit_ns: u64| ns / unit_ns * unit_ns;
    let units = [10_000_000_000, 1_000_000_000, 100_000_000, 10_000_000];
    let units = units.into_iter().filter(|unit| unit % period_ns == 0);
    let earlier = [earliest_ns, round_down(fault.start_ns / 2, period_ns)].into_iter();
    let earlier = earlier.chain(units.clone().map(|unit| round_down(fault.start_ns, unit)));
    let earlier = earlier.filter(|start_ns| *start_ns >= earliest_ns);
    rounder.extend(earlier.map(|start_ns| PlannedFault { start_ns, ..fault.clone() }));
    if let Some(duration_ns) = fault.duration_ns {
        let shorter = [period_ns, round_down(duration_ns / 2, period_ns)].into_iter();
        let shorter =
            shorter.chain(units.map(|unit| round_down(duration_ns, unit))).filter(|ns| *ns > 0);
        rounder.extend(shorter.map(|ns| PlannedFault { duration_ns: Some(ns), ..fault.clone() }));
    }
    for index in 0..fault.parameters.len() {
        let (word, Some(amount)) = fault.parameters[index] else { continue };
        for digits in [1, 2] {
            let mut other = fault.clone();
            other.parameters[index].1 = Some(round_to_digits(amount, digits));
            rounder.push(other);
        }
        if ["jitter", "heading", "burst", "turn"].contains(&word) {
            let mut other = fault.clone();
            other.parameters.remove(index);
            rounder.push(other);
        }
    }
    rounder
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::examples::row_of_three;
    use crate::scenario::{HuntBounds, VariedPart};

    fn targets_of_faults(plan: &RunPlan) -> Vec<(&str, &Vec<String>, &str)> {
        plan.faults
            .iter()
            .map(|fault| (fault.kind, &fault.target_names, fault.target_component))
            .collect()
    }

    #[test]
    fn merged_fault_covers_both_durations_and_strengths() {
        let fault = |target_names: &str, by, start_ns, duration_ns| PlannedFault {
            kind: "delay",
            target_names: vec![target_names.into()],
            target_component: "odometry",
            parameters: vec![("by", Some(by))],
            start_ns,
            duration_ns,
        };
        let [a, b] = [fault("r1", 0.1, 4, Some(6)), fault("r1", 0.2, 2, Some(3))];
        assert_eq!(merge_faults(&a, &b, false), Some(fault("r1", 0.2, 2, Some(8))));
        let other = fault("r2", 0.0, 1, None);
        assert_eq!(merge_faults(&a, &other, true), Some(fault("*", 0.1, 1, None)), "to the end");
        assert_eq!(merge_faults(&a, &other, false), None, "not all may break");
        assert_eq!(merge_faults(&a, &PlannedFault { kind: "loss", ..b.clone() }, true), None);
        assert_eq!(
            merge_faults(&a, &PlannedFault { target_component: "commands", ..b }, true),
            None
        );
    }

    #[test]
    fn shrunk_faults_are_a_subset_and_near_points_keep_all_faults() {
        let hunt = HuntBounds {
            faults_max: 3,
            fault_kinds: vec!["freeze", "cut", "delay"],
            robots: vec![0, 1, 2],
            latest_fault_end_ns: 10_000_000_000,
            delay_ns_max: 3_000_000_000,
            ..HuntBounds::default()
        };
        let scenario = Scenario { hunt_bounds: hunt, ..row_of_three() };
        let space = SearchSpace::new(&scenario, &[VariedPart::Faults]).unwrap();
        let mut random = SplitMix64::new(1);
        let mut anywhere =
            || -> Vec<f64> { space.unchanged_point().iter().map(|_| random.draw_unit()).collect() };
        let point = std::iter::repeat_with(&mut anywhere)
            .find(|point| space.decode_plan(point).faults.len() == 3)
            .unwrap();
        let plan = space.decode_plan(&point);
        let fewer: Vec<usize> =
            plans_with_fewer_faults(&plan, &space).iter().map(|plan| plan.faults.len()).collect();
        assert_eq!(fewer[..10], [0, 2, 2, 2, 2, 2, 2, 2, 2, 2]);
        assert_eq!(fewer[10..].iter().filter(|count| **count == 1).count(), 3, "{fewer:?}");
        let all_near =
            (0..50).map(|_| space.decode_plan(&draw_nearby_point(&point, &space, &mut random)));
        let all_near: Vec<RunPlan> = all_near.collect();
        assert!(all_near.iter().any(|other| *other != plan));
        for other in all_near {
            assert_eq!(targets_of_faults(&other), targets_of_faults(&plan));
            assert_eq!(other.clone().with_only_faults(&plan.faults), other);
            let reduced = other.with_only_faults(&plan.faults[1..2]);
            assert_eq!(targets_of_faults(&reduced), targets_of_faults(&plan)[1..2]);
        }
    }
}
