//! Runs that the model searches, and errors that it must find if a kind of step is left out.
//!
//! Results: wake-ups alone end every wait, whichever process dies, freezes, joins or is slow, and at whichever
//! step. Timeouts and alarms are thus needed only for the caller's deadline, and for two ticks that are 65,536
//! apart (the tag in the arrivals word has 16 bits).

use std::collections::BTreeSet;

use super::model::{EventPlan, PlannedAction, ProcessKind, StepKind, search_all_runs};
use super::stepped::Act;

/// Two agents, two ticks, and no event.
fn plan_without_events() -> EventPlan {
    let (slots, groups, lead_max) = (2, 1, u64::MAX);
    EventPlan {
        ticks: vec![0, 1],
        slots,
        groups,
        lead_ticks_max: lead_max,
        deaths_max: 0,
        planned_actions: vec![],
    }
}

/// Two groups, released one after the other.
fn plan_with_two_groups() -> EventPlan {
    EventPlan { groups: 2, ..plan_without_events() }
}

/// The plant may be one tick ahead of the supervisor.
fn plan_with_plant_ahead() -> EventPlan {
    EventPlan { ticks: vec![0, 1, 2], slots: 1, lead_ticks_max: 1, ..plan_without_events() }
}

/// An agent dies, at any step.
fn plan_with_death() -> EventPlan {
    EventPlan { deaths_max: 1, ..plan_without_events() }
}

/// An agent is frozen before the second tick and thawed before the third.
fn plan_with_freeze() -> EventPlan {
    let planned = vec![(1, PlannedAction::Freeze(0)), (2, PlannedAction::Thaw(0))];
    EventPlan { ticks: vec![0, 1, 2], planned_actions: planned, ..plan_without_events() }
}

/// An agent is killed before the second tick and replaced; either may die.
fn plan_with_replacement() -> EventPlan {
    let planned = vec![(1, PlannedAction::Replace(0))];
    EventPlan {
        ticks: vec![0, 1, 2],
        slots: 1,
        deaths_max: 1,
        planned_actions: planned,
        ..plan_without_events()
    }
}

/// An agent is frozen, thawed and replaced, and may die at any step before, between and after.
fn plan_with_all_events() -> EventPlan {
    let planned = [PlannedAction::Freeze(0), PlannedAction::Thaw(0), PlannedAction::Replace(0)];
    let planned = (1..).zip(planned).collect();
    EventPlan {
        ticks: vec![0, 1, 2, 3],
        slots: 1,
        lead_ticks_max: 2,
        deaths_max: 1,
        planned_actions: planned,
        ..plan_without_events()
    }
}

/// Searches all runs of a plan and expects no error.
fn check_plan_without_error(plan: EventPlan) {
    let result = search_all_runs(&plan, None);
    assert_eq!(result.flaw, None, "{plan:?}");
    // A model with few states shows little.
    assert!(result.states > 1000, "{plan:?}: {}", result.states);
}

#[test]
fn waits_end_and_arrivals_count_once_without_faults() {
    check_plan_without_error(plan_without_events());
    check_plan_without_error(plan_with_two_groups());
    check_plan_without_error(plan_with_plant_ahead());
}

#[test]
fn waits_end_and_arrivals_count_once_with_a_death() {
    check_plan_without_error(plan_with_death());
}

#[test]
fn waits_end_and_arrivals_count_once_with_a_freeze() {
    check_plan_without_error(plan_with_freeze());
}

#[test]
fn waits_end_and_arrivals_count_once_with_replacements() {
    check_plan_without_error(plan_with_replacement());
    check_plan_without_error(plan_with_all_events());
}

/// The tag in the arrivals word prevents a late arrival from being counted at a later tick. Here two ticks have
/// the same tag, as in a run of 65,536 ticks: the late arrival is counted, and only a periodic recheck ends the
/// wait.
#[test]
fn late_arrival_with_equal_tick_tag_counts_twice() {
    let flaw =
        search_all_runs(&EventPlan { ticks: vec![0, 1 << 16], ..plan_with_death() }, None).flaw;
    let flaw = flaw.expect("a flaw");
    assert!(flaw.starts_with("at tick 1 an agent was counted twice"), "{flaw}");
}

/// The kinds of steps that cause no error when left out, and their purpose.
const DISPENSABLE_STEPS: [(StepKind, &str); 2] = [
    (
        (ProcessKind::Supervisor, "arrived", Act::Store),
        "no tick comes twice, so what an earlier robot left cannot be taken for an arrival",
    ),
    (
        (ProcessKind::Supervisor, "pause_at", Act::Store),
        "the plant would go on pausing at every tick, which is slow and not wrong",
    ),
];

/// Leaves out every kind of store, count and wake-up in turn. This tests the model itself: it detects a barrier
/// without the nudge, without the second read of `changes` in `begin`, or without any one of its flags or
/// wake-ups.
#[test]
fn barrier_without_any_one_step_fails_in_the_model() {
    let (mut kinds, mut detected) = (BTreeSet::new(), BTreeSet::new());
    for plan in [plan_with_plant_ahead(), plan_with_replacement()] {
        kinds.extend(search_all_runs(&plan, None).kinds);
        for &kind in &kinds {
            if !detected.contains(&kind) && search_all_runs(&plan, Some(kind)).flaw.is_some() {
                detected.insert(kind);
            }
        }
    }
    let not_found: Vec<StepKind> = kinds.difference(&detected).copied().collect();
    assert_eq!(not_found, DISPENSABLE_STEPS.map(|(kind, _)| kind));
    // The nudge exists twice: by the process that changes the members, and by the plant that began a tick
    // meanwhile.
    for role in [ProcessKind::Supervisor, ProcessKind::Plant] {
        assert!(detected.contains(&(role, "arrivals", Act::Or)));
    }
}
