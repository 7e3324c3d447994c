//! Runs that the model searches, and errors that it must find if a kind of step is left out.
//!
//! Results: wake-ups alone end every wait, whichever process dies, freezes, joins or is slow, and at whichever
//! step. Timeouts and alarms are thus needed only for the caller's deadline, and for two ticks that are 65,536
//! apart (the tag in the arrivals word has 16 bits).

use std::collections::BTreeSet;

use super::model::{Kind, Planned, Plot, ProcessKind, search};
use super::stepped::Act;

/// Two agents, two ticks, and no event.
fn plot_without_events() -> Plot {
    let (slots, groups, lead_max) = (2, 1, u64::MAX);
    Plot { ticks: vec![0, 1], slots, groups, lead_max, deaths: 0, planned: vec![] }
}

/// Two groups, released one after the other.
fn groups() -> Plot {
    Plot { groups: 2, ..plot_without_events() }
}

/// The plant may be one tick ahead of the supervisor.
fn plot_with_plant_ahead() -> Plot {
    Plot { ticks: vec![0, 1, 2], slots: 1, lead_max: 1, ..plot_without_events() }
}

/// An agent dies, at any step.
fn death() -> Plot {
    Plot { deaths: 1, ..plot_without_events() }
}

/// An agent is frozen before the second tick and thawed before the third.
fn freeze() -> Plot {
    let planned = vec![(1, Planned::Freeze(0)), (2, Planned::Thaw(0))];
    Plot { ticks: vec![0, 1, 2], planned, ..plot_without_events() }
}

/// An agent is killed before the second tick and replaced; either may die.
fn replacement() -> Plot {
    let planned = vec![(1, Planned::Replace(0))];
    Plot { ticks: vec![0, 1, 2], slots: 1, deaths: 1, planned, ..plot_without_events() }
}

/// An agent is frozen, thawed and replaced, and may die at any step before, between and after.
fn plot_with_all_events() -> Plot {
    let planned = [Planned::Freeze(0), Planned::Thaw(0), Planned::Replace(0)];
    let planned = (1..).zip(planned).collect();
    Plot {
        ticks: vec![0, 1, 2, 3],
        slots: 1,
        lead_max: 2,
        deaths: 1,
        planned,
        ..plot_without_events()
    }
}

/// Searches a plot exhaustively and expects no error.
fn search_without_error(plot: Plot) {
    let found = search(&plot, None);
    assert_eq!(found.flaw, None, "{plot:?}");
    // A model with few states shows little.
    assert!(found.states > 1000, "{plot:?}: {}", found.states);
}

#[test]
fn waits_end_and_arrivals_count_once_without_faults() {
    search_without_error(plot_without_events());
    search_without_error(groups());
    search_without_error(plot_with_plant_ahead());
}

#[test]
fn waits_end_and_arrivals_count_once_with_a_death() {
    search_without_error(death());
}

#[test]
fn waits_end_and_arrivals_count_once_with_a_freeze() {
    search_without_error(freeze());
}

#[test]
fn waits_end_and_arrivals_count_once_with_replacements() {
    search_without_error(replacement());
    search_without_error(plot_with_all_events());
}

/// The tag in the arrivals word prevents a late arrival from being counted at a later tick. Here two ticks have
/// the same tag, as in a run of 65,536 ticks: the late arrival is counted, and only a periodic recheck ends the
/// wait.
#[test]
fn late_arrival_with_equal_tick_tag_counts_twice() {
    let flaw = search(&Plot { ticks: vec![0, 1 << 16], ..death() }, None).flaw;
    let flaw = flaw.expect("a flaw");
    assert!(flaw.starts_with("at tick 1 an agent was counted twice"), "{flaw}");
}

/// The kinds of steps that cause no error when left out, and their purpose.
const DISPENSABLE_STEPS: [(Kind, &str); 2] = [
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
    let (mut kinds, mut found_out) = (BTreeSet::new(), BTreeSet::new());
    for plot in [plot_with_plant_ahead(), replacement()] {
        kinds.extend(search(&plot, None).kinds);
        for &kind in &kinds {
            if !found_out.contains(&kind) && search(&plot, Some(kind)).flaw.is_some() {
                found_out.insert(kind);
            }
        }
    }
    let not_found: Vec<Kind> = kinds.difference(&found_out).copied().collect();
    assert_eq!(not_found, DISPENSABLE_STEPS.map(|(kind, _)| kind));
    // The nudge exists twice: by the process that changes the members, and by the plant that began a tick
    // meanwhile.
    for role in [ProcessKind::Supervisor, ProcessKind::Plant] {
        assert!(found_out.contains(&(role, "arrivals", Act::Or)));
    }
}
