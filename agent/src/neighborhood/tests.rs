//! Communication states, estimates and replacement of neighbors. Timeouts in ns: stale after 30, lost after
//! 200.

use proptest::prelude::*;

use protocol::brief::SuccessionBrief;

use super::*;
use crate::testing::{self, brief};

fn in_neighbor_brief(index: usize) -> NeighborBrief {
    NeighborBrief { offset_m: [0.0, 1.0], ..testing::in_neighbor_brief(index) }
}

/// Creates the neighborhood of a robot that receives from r1 and r2.
fn new_neighborhood(policy: SilencePolicy) -> Neighborhood {
    new_neighborhood_with(
        &[1, 2],
        &[],
        SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy },
    )
}

/// Creates a neighborhood with these in-neighbors and spares. Spares are opened after 50 ns.
fn new_neighborhood_with(
    in_neighbors: &[usize],
    spares: &[usize],
    silence: SilenceBrief,
) -> Neighborhood {
    let senders = |robots: &[usize]| robots.iter().copied().map(in_neighbor_brief).collect();
    let (neighbors, spares) = (senders(in_neighbors), senders(spares));
    let brief = AgentBrief { neighbors, spares, silence, repair_after_ns: 50, ..brief() };
    Neighborhood::new(&brief, 0)
}

fn beacon(incarnation: u64, stamp_ns: u64, x_m: f64) -> Beacon {
    Beacon { stamp_ns, incarnation, x_m, vx_m_s: 1e6, ..Beacon::default() }
}

fn desired_target_at(neighborhood: &Neighborhood, stamp_ns: u64) -> Option<Target> {
    let mut estimates = Vec::new();
    neighborhood.estimate_neighbors(stamp_ns, Target::at_rest, &mut estimates);
    neighborhood.desired_target(&estimates)
}

#[test]
fn silent_neighbor_becomes_stale_then_lost_and_can_return() {
    let mut neighborhood = new_neighborhood(SilencePolicy::Ignore);
    let states = |neighborhood: &Neighborhood| -> Vec<u64> {
        neighborhood.status().map(|status| status.contact).collect()
    };
    neighborhood.receive_beacon(0, &beacon(0, 100, 1.0), 100).unwrap();
    for (stamp, state) in [(100, 1), (130, 1), (131, 2), (300, 2), (301, 3)] {
        neighborhood.update_reception_states(stamp, stamp, stamp);
        // r2 was never received, and is lost as soon as if it had fallen silent at the start.
        let never_received =
            if stamp > 300 { ReceptionState::Lost } else { ReceptionState::NothingReceived };
        assert_eq!(states(&neighborhood), [state, never_received as u64], "at {stamp}");
        let age = (stamp <= 300).then_some((1, stamp - 100));
        assert_eq!(neighborhood.beacon_ages_ns(stamp).collect::<Vec<_>>(), Vec::from_iter(age));
    }
    neighborhood.receive_beacon(0, &beacon(1, 290, 1.0), 301).unwrap();
    assert!(neighborhood.update_reception_states(302, 302, 302));
    assert_eq!(states(&neighborhood), [1, 3]);
}

#[test]
fn implausible_or_outdated_beacons_change_nothing() {
    let mut neighborhood = new_neighborhood(SilencePolicy::Ignore);
    neighborhood.receive_beacon(0, &beacon(1, 100, 1.0), 100).unwrap();
    let before = desired_target_at(&neighborhood, 100);
    let fast = Beacon { vy_m_s: 1e300, ..beacon(1, 105, 2.0) };
    let rotated = Beacon { frame_heading_rad: -1e300, ..beacon(1, 105, 2.0) };
    let from_future = beacon(1, 105, 1.0).with_leader_frame(Some((111, LeaderFrame::IDENTITY)));
    for (beacon, why) in [
        (beacon(1, 100, 2.0), BeaconRefusal::NotNewer),
        (beacon(1, 99, 2.0), BeaconRefusal::NotNewer),
        (beacon(0, 101, 2.0), BeaconRefusal::NotNewer),
        (beacon(1, 111, 2.0), BeaconRefusal::FromFuture),
        (from_future, BeaconRefusal::FromFuture),
        (beacon(1, 105, f64::NAN), BeaconRefusal::NotFinite),
        (beacon(1, 105, f64::INFINITY), BeaconRefusal::NotFinite),
        (beacon(1, 105, 1e300), BeaconRefusal::NotPlausible),
        (beacon(1, 105, -1.001e9), BeaconRefusal::NotPlausible),
        (fast, BeaconRefusal::NotPlausible),
        (rotated, BeaconRefusal::NotPlausible),
        // It would be newer than every honest beacon of the rest of the run.
        (beacon(u64::MAX, 105, 2.0), BeaconRefusal::NotPlausible),
    ] {
        assert_eq!(neighborhood.receive_beacon(0, &beacon, 110), Err(why));
    }
    assert_eq!(desired_target_at(&neighborhood, 100), before);
    assert_eq!(neighborhood.receive_beacon(0, &beacon(1, 110, 2.0), 110), Ok(()));
}

#[test]
fn lost_neighbors_are_treated_by_the_silence_policy() {
    use SilencePolicy::{Ignore, Keep, Last, Stop};
    assert_eq!(desired_target_at(&new_neighborhood(Ignore), 0), None, "no robot was received");
    // r1 is lost at 301: 1 m + 200 ns of 1e6 m/s. r2 is at 5 m, and at 5.2 m once it is lost. Offsets are (0,
    // 1).
    for (policy, one_lost_m, all_lost_m) in [
        (Ignore, Some(5.0), None),
        (Last, Some(5.0), Some(3.2)),
        (Keep, Some(3.1), Some(3.2)),
        (Stop, None, None),
    ] {
        let mut neighborhood = new_neighborhood(policy);
        neighborhood.receive_beacon(0, &beacon(0, 100, 1.0), 100).unwrap();
        neighborhood.receive_beacon(1, &beacon(0, 400, 5.0), 400).unwrap();
        for (stamp_ns, x_m) in [(400, one_lost_m), (900, all_lost_m)] {
            neighborhood.update_reception_states(stamp_ns, stamp_ns, stamp_ns);
            let target = desired_target_at(&neighborhood, stamp_ns);
            assert_eq!(target.is_some(), x_m.is_some(), "{policy:?} at {stamp_ns}");
            let Some((target, x_m)) = target.zip(x_m) else { continue };
            assert!(
                (target.position - Vec2::new(x_m, 1.0)).norm() < 1e-9,
                "{policy:?}: {target:?}"
            );
            assert!(stamp_ns == 400 || target.velocity == Vec2::zeros());
        }
    }
}

#[test]
fn recalled_neighbors_are_extrapolated_with_their_age() {
    let mut neighborhood = new_neighborhood(SilencePolicy::Ignore);
    assert_eq!([1, 2, 3].map(|robot| neighborhood.sender_index(robot)), [Some(0), Some(1), None]);
    neighborhood.receive_beacon(0, &beacon(0, 100, 1.0), 100).unwrap();
    let mut estimates = Vec::new();
    let rotated_offset = Target { position: Vec2::new(-1.0, 0.0), velocity: Vec2::new(0.0, 2.0) };
    let offset = |c_ji| {
        assert_eq!(c_ji, Vec2::new(0.0, 1.0));
        rotated_offset
    };
    for (stamp_ns, x_m, vx_m_s, state) in [
        (120, 1.02, 1e6, ReceptionState::Fresh),
        (200, 1.1, 1e6, ReceptionState::Stale),
        (900, 1.2, 0.0, ReceptionState::Lost), // declared lost 200 ns after reception
    ] {
        neighborhood.update_reception_states(stamp_ns, stamp_ns, stamp_ns);
        neighborhood.estimate_neighbors(stamp_ns, offset, &mut estimates);
        let [estimate] = &estimates[..] else { panic!("r2 was never heard: {estimates:?}") };
        assert!((estimate.position - Vec2::new(x_m, 0.0)).norm() < 1e-12, "{estimate:?}");
        assert_eq!(
            (estimate.index, estimate.velocity, estimate.reception_state),
            (1, Vec2::new(vx_m_s, 0.0), state)
        );
        assert_eq!(
            (estimate.offset, estimate.age_s),
            (rotated_offset, (stamp_ns - 100) as f64 / 1e9)
        );
    }
}

#[test]
fn newest_frame_is_used_and_frozen_once_lost() {
    let mut neighborhood = new_neighborhood(SilencePolicy::Ignore);
    let frame =
        |heading_rad| LeaderFrame { heading_rad, turn_rate_rad_s: 1e7, ..LeaderFrame::IDENTITY };
    assert_eq!(neighborhood.frame_at(0), None);
    neighborhood
        .receive_beacon(0, &beacon(0, 100, 1.0).with_leader_frame(Some((90, frame(0.5)))), 100)
        .unwrap();
    neighborhood
        .receive_beacon(1, &beacon(0, 100, 1.0).with_leader_frame(Some((80, frame(9.0)))), 100)
        .unwrap();
    // The same frame relayed by another robot is not newer.
    neighborhood
        .receive_beacon(1, &beacon(0, 125, 1.0).with_leader_frame(Some((90, frame(0.5)))), 125)
        .unwrap();
    // Received at 100 ns, valid for the timeout of 200 ns. Then it is frozen 200 ns after it was sent.
    for (stamp_ns, heading_rad, rate_rad_s, state) in [
        (130, 0.9, 1e7, ReceptionState::Fresh),
        (131, 0.91, 1e7, ReceptionState::Stale),
        (300, 2.6, 1e7, ReceptionState::Stale),
        (301, 2.5, 0.0, ReceptionState::Lost),
        (1000, 2.5, 0.0, ReceptionState::Lost),
    ] {
        neighborhood.update_reception_states(stamp_ns, stamp_ns, stamp_ns);
        assert_eq!(neighborhood.leader_frame_reception().state, state, "at {stamp_ns} ns");
        let known = neighborhood.frame_at(stamp_ns).unwrap();
        assert!((known.heading_rad - heading_rad).abs() < 1e-9, "at {stamp_ns} ns: {known:?}");
        assert_eq!(known.turn_rate_rad_s, rate_rad_s, "at {stamp_ns} ns");
    }
}

#[test]
fn frame_of_the_best_live_rank_is_used_and_relayed() {
    let silence =
        SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy: SilencePolicy::Last };
    let mut neighborhood = new_neighborhood_with(&[1, 2], &[], silence);
    let frame = |heading_rad| Some((0, LeaderFrame { heading_rad, ..LeaderFrame::IDENTITY }));
    let receive_frame =
        |sender_index, now_ns, heading_rad, frame_rank, neighborhood: &mut Neighborhood| {
            let frame = frame(heading_rad).map(|(_, frame)| (now_ns, frame));
            let beacon = Beacon { frame_rank, ..beacon(0, now_ns, 1.0) }.with_leader_frame(frame);
            neighborhood.receive_beacon(sender_index, &beacon, now_ns).unwrap();
        };
    let in_force = |neighborhood: &Neighborhood, stamp_ns| {
        let received = neighborhood.frame_in_force(stamp_ns).unwrap();
        (received.rank, neighborhood.frame_at(stamp_ns).unwrap().heading_rad)
    };
    receive_frame(0, 100, 0.5, 2, &mut neighborhood);
    assert_eq!(in_force(&neighborhood, 100), (2, 0.5));
    receive_frame(1, 110, 0.25, 0, &mut neighborhood);
    assert_eq!(in_force(&neighborhood, 110), (0, 0.25));
    for now_ns in [200, 300, 310] {
        receive_frame(0, now_ns, 0.75, 2, &mut neighborhood);
    }
    assert_eq!(in_force(&neighborhood, 310), (0, 0.25));
    assert_eq!(in_force(&neighborhood, 311), (2, 0.75));
    // All are lost: the last received is used.
    assert_eq!(in_force(&neighborhood, 900), (2, 0.75));
    neighborhood.update_reception_states(900, 900, 900);
    assert_eq!(neighborhood.leader_frame_reception().state, ReceptionState::Lost);
    receive_frame(1, 900, 0.125, 0, &mut neighborhood);
    assert_eq!(in_force(&neighborhood, 900), (0, 0.125));
}

#[test]
fn old_but_regularly_received_frame_is_not_lost() {
    let mut neighborhood = new_neighborhood(SilencePolicy::Ignore);
    let frame = LeaderFrame { turn_rate_rad_s: 1e7, ..LeaderFrame::IDENTITY };
    for now_ns in 1000..1100 {
        let received = beacon(0, now_ns, 1.0).with_leader_frame(Some((now_ns - 500, frame)));
        neighborhood.receive_beacon(0, &received, now_ns).unwrap();
        neighborhood.update_reception_states(now_ns, now_ns, now_ns);
        assert_eq!(neighborhood.leader_frame_reception().state, ReceptionState::Fresh);
        let known = neighborhood.frame_at(now_ns).unwrap();
        assert!((known.heading_rad - 5.0).abs() < 1e-9 && known.turn_rate_rad_s == 1e7);
    }
}

#[test]
fn information_age_is_accumulated_for_silent_neighbors() {
    let mut neighborhood = new_neighborhood(SilencePolicy::Ignore);
    neighborhood.receive_beacon(1, &beacon(0, 100, 1.0), 110).unwrap();
    let sums: Vec<(usize, AgeSums)> = neighborhood.take_information_ages(150).collect();
    // The age rises from 10 to 50 ns in 40 ns: the mean is 30 ns.
    assert_eq!(sums[0], (1, AgeSums::default()));
    let (robot, AgeSums { sample_count, duration_ns, peak_ns, .. }) = sums[1];
    assert_eq!((sums.len(), robot, sample_count, duration_ns, peak_ns), (2, 2, 1, 40, 50));
    assert!((sums[1].1.mean_ns().unwrap() - 30.0).abs() < 1e-9);
    let again: Vec<u64> =
        neighborhood.take_information_ages(160).map(|(_, sums)| sums.duration_ns).collect();
    assert_eq!(again, [0, 10]);
}

/// Returns the in-neighbors and backup neighbors that a robot uses as references, by scenario index, and for each
/// backup neighbor whether the robot receives its beacons.
fn used_references(neighborhood: &Neighborhood) -> (Vec<u64>, Vec<bool>) {
    let used_references =
        neighborhood.status().filter(|status| status.goes_by == 1).map(|status| status.robot);
    (used_references.collect(), neighborhood.spares().map(|(_, opened)| opened.is_some()).collect())
}

/// Time (ns), senders received at that time, resulting references, open spares, and desired position (m).
type RepairStep = (u64, &'static [usize], &'static [u64], [bool; 2], f64);

/// The robot receives from r2 and r3, with the spares r7 and r8.
#[test]
fn spare_replaces_a_failed_neighbor_until_it_has_recovered() {
    use SilencePolicy::{Ignore, Keep, Last, Stop};
    for policy in [Ignore, Keep, Last, Stop] {
        let silence = SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy };
        let mut neighborhood = new_neighborhood_with(&[2, 3], &[7, 8], silence);
        let receive = |neighborhood: &mut Neighborhood, sender_index: usize, t: u64| {
            assert!(neighborhood.needs_beacon_of_tick(sender_index, t));
            let sent = Beacon { tick: t, ..beacon(0, t, [1.0, 5.0, 3.0, 9.0][sender_index]) };
            neighborhood.receive_beacon(sender_index, &Beacon { vx_m_s: 0.0, ..sent }, t).unwrap();
        };
        let rows: [RepairStep; 14] = [
            (100, &[0, 1], &[2, 3], [false; 2], 3.0),
            (300, &[1], &[2, 3], [false; 2], 3.0),
            (350, &[1], &[2, 3], [false; 2], f64::NAN), // r2 is lost from here on
            (399, &[1], &[2, 3], [false; 2], f64::NAN),
            (400, &[1], &[2, 3], [true, false], f64::NAN), // for 50 ns
            (410, &[1, 2], &[3, 7], [true, false], 4.0),
            (620, &[1], &[2, 3], [true, false], f64::NAN), // r7 is lost, too
            (670, &[1], &[2, 3], [true, true], f64::NAN),
            (680, &[1, 3], &[3, 8], [true, true], 7.0),
            (690, &[1, 2, 3], &[3, 7, 8], [true, true], 17.0 / 3.0),
            (740, &[1, 2, 3], &[3, 7], [true, false], 4.0), // for 50 ns again
            (750, &[0, 1, 2], &[3, 7], [true, false], 4.0),
            (799, &[0, 1, 2], &[3, 7], [true, false], 4.0),
            (800, &[0, 1, 2], &[2, 3], [false; 2], 3.0),
        ];
        for (t, senders, references, open_spares, x_m) in rows {
            senders.iter().for_each(|&sender_index| receive(&mut neighborhood, sender_index, t));
            neighborhood.update_reception_states(t, t, t);
            assert_eq!(
                used_references(&neighborhood),
                (references.to_vec(), open_spares.to_vec()),
                "{policy:?} at {t}"
            );
            // While r2 is not replaced, the policy determines the result.
            let target = desired_target_at(&neighborhood, t);
            let x_m = match (x_m.is_nan(), policy) {
                (false, _) => Some(x_m),
                (true, Stop) => None,
                (true, Keep) => Some(3.0),
                (true, Ignore | Last) => Some(5.0),
            };
            assert_eq!(target.map(|target| target.position.x), x_m, "{policy:?} at {t}");
        }
        let sent: Vec<(u64, u64)> =
            neighborhood.status().map(|status| (status.robot, status.goes_by_since_t_ns)).collect();
        assert_eq!(sent, [(2, 800), (3, 0), (7, 800), (8, 740)]);
    }
}

/// The robot receives from r2 and r3. In place of r2 it counts r3 (a second time) and r7 (twice), in place of
/// r3 it counts r8.
#[test]
fn replacement_counts_as_often_as_planned() {
    let silence =
        SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy: SilencePolicy::Keep };
    let sender = |robot: usize, replaces: &[usize]| NeighborBrief {
        replaces: replaces.to_vec(),
        ..in_neighbor_brief(robot)
    };
    let neighbors = vec![sender(2, &[]), sender(3, &[2])];
    let spares = vec![sender(7, &[2, 2]), sender(8, &[3])];
    let brief = AgentBrief { neighbors, spares, silence, repair_after_ns: 50, ..brief() };
    let mut neighborhood = Neighborhood::new(&brief, 0);
    let rows: [RepairStep; 7] = [
        (100, &[0, 1], &[2, 3], [false; 2], 3.0),
        (300, &[1], &[2, 3], [false; 2], 3.0),
        (350, &[1], &[2, 3], [false; 2], 3.0), // r2 is lost from here on, and kept
        (400, &[1], &[3], [true, false], 5.0), // for 50 ns
        (410, &[1, 2], &[3, 7], [true, false], (5.0 + 5.0 + 9.0 + 9.0) / 4.0),
        (500, &[0, 1, 2], &[3, 7], [true, false], 7.0),
        (560, &[0, 1, 2], &[2, 3], [false; 2], 3.0),
    ];
    check_repair_steps(&mut neighborhood, &rows, |_| false);
}

/// Checks the references, the open spares, the succession and the desired position at each instant of `rows`.
#[track_caller]
fn check_repair_steps(
    neighborhood: &mut Neighborhood,
    rows: &[RepairStep],
    takes_place: impl Fn(&[u64]) -> bool,
) {
    for &(t, senders, references, open_spares, x_m) in rows {
        for &sender_index in senders {
            let sent = Beacon { tick: t, ..beacon(0, t, [1.0, 5.0, 9.0, 13.0][sender_index]) };
            neighborhood.receive_beacon(sender_index, &Beacon { vx_m_s: 0.0, ..sent }, t).unwrap();
        }
        neighborhood.update_reception_states(t, t, t);
        assert_eq!(
            used_references(neighborhood),
            (references.to_vec(), open_spares.to_vec()),
            "at {t}"
        );
        assert_eq!(neighborhood.keeps_leader_slot(), takes_place(references), "at {t}");
        assert_eq!(desired_target_at(neighborhood, t).unwrap().position.x, x_m, "at {t}");
    }
}

/// r1 receives from r2, a leader, and r3. Successors of r2 are r7 and then r1 itself, which keeps the slot with
/// r8.
#[test]
fn first_live_deputy_succeeds_the_leader_then_the_robot() {
    let silence =
        SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy: SilencePolicy::Ignore };
    let [neighbors, spares] = [[2, 3], [7, 8]].map(|robots| robots.map(in_neighbor_brief).into());
    let successions = vec![SuccessionBrief { leader: 2, deputies: vec![7, 1], by: vec![8] }];
    let brief =
        AgentBrief { neighbors, spares, successions, silence, repair_after_ns: 50, ..brief() };
    let mut neighborhood = Neighborhood::new(&brief, 0);
    let rows: [RepairStep; 14] = [
        (100, &[0, 1], &[2, 3], [false; 2], 3.0),
        (300, &[1], &[2, 3], [false; 2], 3.0),
        (350, &[1], &[2, 3], [false; 2], 5.0), // r2 is lost from here on
        (400, &[1], &[2, 3], [true, false], 5.0), // for 50 ns
        (410, &[1, 2], &[3, 7], [true, false], 7.0),
        (620, &[1], &[2, 3], [true, false], 5.0), // r7 is lost, too
        (670, &[1], &[2, 3], [true, true], 5.0),
        (680, &[1, 3], &[8], [true, true], 13.0),
        (690, &[1, 2, 3], &[8], [true, true], 13.0),
        (740, &[1, 2, 3], &[3, 7], [true, false], 7.0), // for 50 ns again
        (750, &[0, 1, 2], &[3, 7], [true, false], 7.0),
        (799, &[0, 1, 2], &[3, 7], [true, false], 7.0),
        (800, &[0, 1, 2], &[2, 3], [false; 2], 3.0),
        (850, &[0, 1], &[2, 3], [false; 2], 3.0),
    ];
    check_repair_steps(&mut neighborhood, &rows, |references| references == [8]);
}

#[test]
fn beacons_of_a_spare_before_its_opening_do_not_count() {
    let silence =
        SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy: SilencePolicy::Last };
    let mut neighborhood = new_neighborhood_with(&[2], &[7], silence);
    for t in [0, 201, 251] {
        assert!(!neighborhood.needs_beacon_of_tick(1, t));
        neighborhood.update_reception_states(t, t, t);
    }
    assert_eq!(used_references(&neighborhood), (vec![2], vec![true]));
    assert_eq!([251, 252].map(|tick| neighborhood.needs_beacon_of_tick(1, tick)), [false, true]);
}

fn frames() -> impl Strategy<Value = LeaderFrame> {
    (-3.0..3.0f64, -2.0..2.0f64, -3.0..3.0f64, 0.5..2.0f64, -0.3..0.3f64).prop_map(
        |(heading_rad, turn_rate_rad_s, turn_acceleration_rad_s2, scale, scale_rate_per_s)| {
            LeaderFrame {
                heading_rad,
                turn_rate_rad_s,
                turn_acceleration_rad_s2,
                scale,
                scale_rate_per_s,
            }
        },
    )
}

proptest! {
    /// Lockstep: robot 0 leads and each robot receives from an earlier one. The frame known d hops away is d
    /// ticks old and extrapolated to the current time.
    #[test]
    fn frame_crosses_any_tree_in_hops_and_stays_exact(
        parents in proptest::collection::vec(any::<proptest::sample::Index>(), 1..12),
        start in frames(),
        period_ns in 1_000_000..20_000_000u64,
    ) {
        let parents: Vec<usize> =
            parents.iter().enumerate().map(|(i, parent)| parent.index(i + 1)).collect();
        let mut depth = vec![0u64];
        parents.iter().for_each(|&parent| depth.push(depth[parent] + 1));
        let after_ns = 100 * period_ns;
        let policy = SilencePolicy::Ignore;
        let silence = SilenceBrief { stale_after_ns: after_ns, lost_after_ns: after_ns, policy };
        let neighborhood = |&parent: &usize| new_neighborhood_with(&[parent + 1], &[], silence.clone());
        let mut neighborhoods: Vec<Neighborhood> = parents.iter().map(neighborhood).collect();
        let mut beacons: Vec<Beacon> = Vec::new();
        for tick in 0..20 {
            let stamp_ns = tick * period_ns;
            let truth = start.extrapolate(stamp_ns as f64 / 1e9);
            for (i, neighborhood) in neighborhoods.iter_mut().enumerate() {
                if let Some(beacon) = beacons.get(parents[i]) {
                    neighborhood.receive_beacon(0, beacon, stamp_ns).unwrap();
                }
                let known = neighborhood.frame_at(stamp_ns);
                prop_assert_eq!(known.is_some(), tick >= depth[i + 1]);
                let Some(known) = known else { continue };
                for (known, truth) in [
                    (known.heading_rad, truth.heading_rad),
                    (known.turn_rate_rad_s, truth.turn_rate_rad_s),
                    (known.scale, truth.scale),
                ] {
                    prop_assert!((known - truth).abs() <= 1e-12, "{known} {truth}");
                }
            }
            let frames = neighborhoods.iter().map(|neighborhood| {
                neighborhood.frame_in_force(stamp_ns).map(|received| (received.stamp_ns, received.frame))
            });
            let frames = std::iter::once(Some((stamp_ns, truth))).chain(frames);
            beacons = frames.map(|frame| beacon(0, stamp_ns, 0.0).with_leader_frame(frame)).collect();
        }
    }
}

/// Creates a neighborhood of r1, which leads, and of r2 and r3, of which one may be Byzantine.
fn neighborhood_with_byzantine_bound() -> Neighborhood {
    let silence =
        SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy: SilencePolicy::Ignore };
    let mut neighbors: Vec<NeighborBrief> = (1..4).map(in_neighbor_brief).collect();
    neighbors[0].trusted = true;
    let gains = [("liars_max".into(), 1.0)].into();
    Neighborhood::new(&AgentBrief { neighbors, silence, gains, ..brief() }, 0)
}

#[test]
fn leader_is_kept_and_the_farthest_other_is_discarded() {
    let mut neighborhood = neighborhood_with_byzantine_bound();
    for (sender_index, x_m) in [(0, 0.0), (1, 5.0), (2, 9.0)] {
        neighborhood
            .receive_beacon(sender_index, &Beacon { stamp_ns: 100, x_m, ..Beacon::default() }, 100)
            .unwrap();
    }
    neighborhood.update_reception_states(100, 100, 100);
    let mut estimates = Vec::new();
    neighborhood.estimate_neighbors(100, |_| Target::at_rest(Vec2::zeros()), &mut estimates);
    let own = |x| Target::at_rest(Vec2::new(x, 0.0));
    let desired_x =
        |x| neighborhood.resilient_desired_target(&estimates, own(x)).unwrap().position.x;
    assert_eq!([5.0, 4.0, 10.0].map(desired_x), [2.5, 2.5, 4.5]);
}

#[test]
fn frame_is_the_leaders_or_agreed_by_f_plus_1() {
    let beacon_with_frame = |stamp_ns, heading_rad| {
        let frame = LeaderFrame { heading_rad, ..LeaderFrame::IDENTITY };
        Beacon { stamp_ns, ..Beacon::default() }.with_leader_frame(Some((stamp_ns, frame)))
    };
    let heading =
        |neighborhood: &Neighborhood| neighborhood.frame_at(100).map(|frame| frame.heading_rad);
    let mut neighborhood = neighborhood_with_byzantine_bound();
    for (sender_index, heading_rad) in [(1, 0.5), (2, 3.0)] {
        neighborhood
            .receive_beacon(sender_index, &beacon_with_frame(100, heading_rad), 100)
            .unwrap();
    }
    neighborhood.update_reception_states(100, 100, 100);
    assert_eq!(heading(&neighborhood), None, "two frames cannot reveal the liar");
    neighborhood.receive_beacon(0, &beacon_with_frame(90, 0.25), 100).unwrap();
    neighborhood.update_reception_states(100, 100, 100);
    assert_eq!(heading(&neighborhood), Some(0.25));
    let mut others = neighborhood_with_byzantine_bound();
    others.neighbors.iter_mut().for_each(|neighbor| neighbor.is_trusted = false);
    for (sender_index, heading_rad) in [(0, 0.5), (1, 3.0), (2, 0.5)] {
        others.receive_beacon(sender_index, &beacon_with_frame(100, heading_rad), 100).unwrap();
    }
    others.update_reception_states(100, 100, 100);
    assert_eq!(heading(&others), Some(0.5));
}

#[test]
fn message_stays_until_a_newer_one_or_another_incarnation() {
    let format = MessageFormat::with_bytes(2);
    let sender = NeighborBrief { message: Some(format), ..in_neighbor_brief(5) };
    let mut neighborhood = Neighborhood::new(&AgentBrief { neighbors: vec![sender], ..brief() }, 0);
    let mut estimates = Vec::new();
    let mut receive = |neighborhood: &mut Neighborhood, sent: (Beacon, Option<&[u8]>)| {
        let message = sent.1.map(Into::into);
        let received =
            neighborhood.receive_broadcast(0, &Broadcast { beacon: sent.0, message }, 500);
        neighborhood.estimate_neighbors(500, |_| Target::at_rest(Vec2::zeros()), &mut estimates);
        let message = estimates[0].message.as_ref();
        let message = message.map(|message| (message.bytes.to_vec(), (1e9 * message.age_s) as u64));
        (received, estimates[0].incarnation, message)
    };
    assert_eq!(receive(&mut neighborhood, (beacon(0, 100, 1.0), None)), (Ok(()), 0, None));
    let first = Some((vec![7], 300));
    assert_eq!(
        receive(&mut neighborhood, (beacon(0, 200, 1.0), Some(&[7]))),
        (Ok(()), 0, first.clone())
    );
    assert_eq!(receive(&mut neighborhood, (beacon(0, 300, 1.0), None)), (Ok(()), 0, first.clone()));
    let refused = (Err(BeaconRefusal::WrongMessageFormat), 0, first);
    assert_eq!(receive(&mut neighborhood, (beacon(0, 400, 1.0), Some(&[1, 2, 3]))), refused);
    assert_eq!(
        receive(&mut neighborhood, (beacon(1, 450, 1.0), None)),
        (Ok(()), 1, None),
        "restarted"
    );
}

const SILENCE: SilenceBrief =
    SilenceBrief { stale_after_ns: 30, lost_after_ns: 200, policy: SilencePolicy::Ignore };

#[test]
fn range_has_hysteresis_and_a_neighbor_beyond_it_is_unknown() {
    let range = Some(RangeBrief { radius_m: 1.0, hysteresis_m: 0.1 });
    let neighbors = vec![NeighborBrief { range, ..in_neighbor_brief(1) }, in_neighbor_brief(2)];
    let mut neighborhood =
        Neighborhood::new(&AgentBrief { neighbors, silence: SILENCE, ..brief() }, 0);
    let mut estimates = Vec::new();
    let mut states = Vec::new();
    // Between 1 m and 1.1 m the state stays as it was.
    let distances_m = [1.05, 1.0, 1.09, 1.11, 1.05, 1.11, 0.99, 1.05];
    for (i, r_m) in distances_m.into_iter().enumerate() {
        let now_ns = 10 * i as u64;
        if neighborhood.update_range(0, Some(r_m), now_ns) {
            neighborhood.receive_beacon(0, &beacon(0, now_ns, r_m), now_ns).unwrap();
        }
        neighborhood.update_reception_states(now_ns, now_ns, now_ns);
        neighborhood.estimate_neighbors(now_ns, Target::at_rest, &mut estimates);
        let status = neighborhood.status().next().unwrap();
        states.push((status.contact, status.since_t_ns, estimates.len()));
    }
    let [nothing_received, fresh, out_of_range] =
        [ReceptionState::NothingReceived, ReceptionState::Fresh, ReceptionState::Apart]
            .map(|status| status as u64);
    let expected = [
        (nothing_received, 0, 0),
        (fresh, 10, 1),
        (fresh, 10, 1),
        (out_of_range, 30, 0),
        (out_of_range, 30, 0),
        (out_of_range, 30, 0),
        (fresh, 60, 1),
        (fresh, 60, 1),
    ];
    assert_eq!(states, expected);
    assert!(neighborhood.update_range(1, Some(100.0), 0), "received at any distance");
}

#[test]
fn silent_neighbor_in_range_times_out() {
    let range = Some(RangeBrief { radius_m: 1.0, hysteresis_m: 0.0 });
    let neighbors = vec![NeighborBrief { range, ..in_neighbor_brief(1) }];
    let mut neighborhood =
        Neighborhood::new(&AgentBrief { neighbors, silence: SILENCE, ..brief() }, 0);
    neighborhood.update_reception_states(5000, 5000, 5000);
    let status = neighborhood.status().next().unwrap().contact;
    assert_eq!(status, ReceptionState::NothingReceived as u64, "out of range for long");
    // In range from 5,000 ns on, but a link fault loses its beacons.
    assert!(neighborhood.update_range(0, Some(0.5), 5000));
    let mut state_at = |t_ns: u64| {
        neighborhood.update_reception_states(t_ns, t_ns, t_ns);
        ReceptionState::from_number(neighborhood.status().next().unwrap().contact).unwrap()
    };
    assert_eq!(state_at(5001), ReceptionState::NothingReceived);
    assert_eq!(state_at(6000), ReceptionState::Lost);
}

#[test]
fn queue_keeps_the_newest_messages_and_counts_the_others() {
    let sender =
        NeighborBrief { message: Some(MessageFormat::with_bytes(2)), ..in_neighbor_brief(5) };
    let brief = AgentBrief { neighbors: vec![sender], message_queue: 2, ..brief() };
    let mut neighborhood = Neighborhood::new(&brief, 0);
    let receive = |neighborhood: &mut Neighborhood, incarnation: u64, stamp_ns: u64, byte: u8| {
        let message = Some([byte][..].into());
        let broadcast = Broadcast { beacon: beacon(incarnation, stamp_ns, 1.0), message };
        neighborhood.receive_broadcast(0, &broadcast, 500).unwrap();
    };
    let queued = |neighborhood: &Neighborhood| {
        let mut estimates = Vec::new();
        neighborhood.estimate_neighbors(500, |_| Target::at_rest(Vec2::zeros()), &mut estimates);
        estimates[0].queued_messages.iter().map(|message| message.bytes[0]).collect::<Vec<_>>()
    };
    (1..=4).for_each(|byte| receive(&mut neighborhood, 0, 100 + u64::from(byte), byte));
    assert_eq!((queued(&neighborhood), neighborhood.messages_dropped()), (vec![3, 4], 2));
    neighborhood.discard_queued_messages();
    assert_eq!(
        (queued(&neighborhood), neighborhood.messages_dropped()),
        (vec![], 2),
        "the law has seen them"
    );
    receive(&mut neighborhood, 0, 200, 5);
    receive(&mut neighborhood, 1, 300, 6);
    assert_eq!(queued(&neighborhood), [6], "those of another incarnation are discarded");
}
