//! Status of the controller, and processing of one sample apart from the control law.

use std::sync::{Arc, Mutex};

use formation::front_point::front_point;
use formation::pose::Twist;
use protocol::fault::{LinkFault, LinkFaultKind, Span};

use super::*;
use crate::testing::{NS_PER_MS, START_NS, beacon, brief, odometry};

fn answer_at(controller: &mut Controller, t_ms: u64) -> Answer {
    let odometry = odometry(t_ms);
    controller.answer(&odometry, odometry.stamp_ns).expect("it knows where it is")
}

#[test]
fn beacon_age_is_one_period_in_lockstep_two_in_real_time() {
    let age = |pace, late_ns| beacon_age_periods(&AgentBrief { pace, late_ns, ..brief() });
    assert_eq!([Pace::Lockstep, Pace::Realtime].map(|pace| age(pace, 0)), [1.0, 2.0]);
    let late_ns = 3 * brief().period_ns;
    assert_eq!([Pace::Lockstep, Pace::Realtime].map(|pace| age(pace, late_ns)), [4.0, 5.0]);
}

#[test]
fn delayed_odometry_is_answered_once_and_in_order() {
    let kind = LinkFaultKind::Delay { delay_ns: 15 * NS_PER_MS, jitter_ns: 0 };
    let span = Span { from_ns: 0, until_ns: 50 * NS_PER_MS };
    let mut delayed = brief();
    delayed.odometry_faults = vec![LinkFault { span, kind, seed: 1 }];
    let mut controller = Controller::new(&delayed, 0).unwrap();
    let mut stamps_ms = Vec::new();
    for t_ms in (0..=90).step_by(10) {
        let odometry = odometry(t_ms);
        let answer = controller.answer(&odometry, odometry.stamp_ns);
        stamps_ms.push(answer.map(|answer| {
            assert_eq!((answer.command.tick, answer.beacon().tick), (t_ms, t_ms));
            assert_eq!(answer.command.stamp_ns, answer.beacon().stamp_ns);
            (answer.command.stamp_ns - START_NS) / NS_PER_MS
        }));
    }
    // From 50 ms on there is no delay, and older samples are not answered any more.
    let expected = [None, None, Some(0), Some(10), Some(20)];
    let in_time = [50, 60, 70, 80, 90].map(Some);
    assert_eq!(stamps_ms, [&expected[..], &in_time].concat());
}

#[test]
fn differenced_velocity_is_displacement_over_time() {
    let published_velocity = PublishedVelocity::Differenced;
    let mut controller = Controller::new(&AgentBrief { published_velocity, ..brief() }, 0).unwrap();
    let velocities = [0, 10, 30].map(|t_ms| answer_at(&mut controller, t_ms).beacon().velocity());
    assert_eq!(velocities[0], Vec2::zeros());
    for velocity in &velocities[1..] {
        assert!((velocity - Vec2::new(1.0, 0.0)).norm() < 1e-9, "{velocity:?}");
    }
}

#[test]
fn heading_of_effect_is_predicted_by_the_turn_rate() {
    /// Records the headings it receives.
    struct RecordingAvoidance(Arc<Mutex<[f64; 2]>>);
    impl Avoidance for RecordingAvoidance {
        fn velocity_to_twist(&self, _: f64, _: Vec2) -> Twist {
            Twist::ZERO
        }
        fn steer(&mut self, sample: &Sample<'_>, _: Vec2) -> Twist {
            *self.0.lock().unwrap() = [sample.heading_rad, sample.heading_at_effect.angle_rad()];
            Twist::ZERO
        }
    }
    let recorded = Arc::new(Mutex::new([0.0; 2]));
    let brief = brief();
    let avoidance = Box::new(RecordingAvoidance(recorded.clone()));
    let parts = Parts { avoidance, ..Parts::from_brief(&brief).unwrap() };
    let mut controller = Controller::with_parts(&brief, 0, parts);
    let odometry = odometry(10);
    controller.answer(&odometry, odometry.stamp_ns + 5 * NS_PER_MS);
    let [heading_rad, effect_rad] = *recorded.lock().unwrap();
    assert_eq!(heading_rad, 0.3);
    assert!((effect_rad - 0.31).abs() < 1e-12, "{effect_rad}");
}

#[test]
fn twist_of_a_controller_is_bounded_and_published() {
    const WANTED_TWIST: Twist = Twist::new(0.1, -0.4);
    struct FixedTwistLaw;
    impl Law for FixedTwistLaw {
        fn gamma(&mut self, _: &Situation<'_>) -> Vec2 {
            unreachable!("the controller calls `output`")
        }
        fn output(&mut self, _: &Situation<'_>) -> LawOutput {
            LawOutput::Twist(WANTED_TWIST)
        }
    }
    let mut brief = brief();
    brief.avoidance.kind = "guard".into();
    (brief.avoidance.speed_max_m_s, brief.avoidance.sensing_radius_m) = (0.5, 5.0);
    let answer_near = |neighbors: &[[f64; 2]]| {
        let parts = Parts { law: Box::new(FixedTwistLaw), ..Parts::from_brief(&brief).unwrap() };
        let mut controller = Controller::with_parts(&brief, 0, parts);
        let mut sample = odometry(10);
        controller.answer(&sample, sample.stamp_ns);
        assert_eq!(controller.receive_beacon(0, &beacon(10), sample.stamp_ns), Ok(()));
        sample = odometry(20);
        sample.proximity_count = neighbors.len() as u32;
        sample.near[..neighbors.len()].copy_from_slice(neighbors);
        controller.answer(&sample, sample.stamp_ns).expect("it knows where it is")
    };
    let free = answer_near(&[]);
    let twist = |answer: &Answer| [answer.command.v_m_s, answer.command.w_rad_s];
    assert_eq!(twist(&free), [WANTED_TWIST.v_m_s, WANTED_TWIST.w_rad_s]);
    let velocity = front_velocity(0.3, brief.front_point_m, WANTED_TWIST);
    assert_eq!(free.beacon().velocity(), velocity);
    // Another robot is right ahead of the front point, at d. Only the command to the plant is restricted.
    let ahead = formation::front_point::front_point(odometry(20).pose(), brief.front_point_m)
        + brief.avoidance.distance_min_m * velocity / velocity.norm();
    let blocked = answer_near(&[ahead.into()]);
    assert!(twist(&blocked)[0].abs() < 1e-6, "{:?}", twist(&blocked));
    assert_eq!(blocked.beacon().velocity(), velocity);
}

/// Returns the answer of a controller that has sensed, from the output of its law.
fn act(controller: &mut Controller, output: LawOutput, effect_ns: u64) -> Option<Answer> {
    // An earlier answer is overwritten.
    let mut answer = Some(Answer { is_withheld: true, delay_ns: 1, ..Answer::default() });
    controller.act(output, effect_ns, &mut answer);
    answer
}

#[test]
fn separate_steps_equal_answer_and_no_target_means_stop() {
    let [mut one_step, mut two_steps] = [(); 2].map(|()| Controller::new(&brief(), 0).unwrap());
    let velocity = Vec2::new(0.1, 0.2);
    assert!(
        two_steps.situation().is_none()
            && act(&mut two_steps, LawOutput::Velocity(velocity), START_NS).is_none()
    );
    // No robot has been received.
    answer_at(&mut one_step, 0);
    two_steps.sense(&odometry(0));
    assert!(two_steps.situation().is_none());
    let answer = act(&mut two_steps, LawOutput::Velocity(velocity), START_NS);
    let answer = answer.expect("it knows where it is");
    assert_eq!((answer.command.twist(), answer.beacon().velocity()), (Twist::ZERO, Vec2::zeros()));

    let now_ns = START_NS + 10 * NS_PER_MS;
    assert_eq!(one_step.receive_beacon(0, &beacon(0), now_ns), Ok(()));
    assert_eq!(two_steps.receive_beacon(0, &beacon(0), now_ns), Ok(()));
    let answer = one_step.answer(&odometry(10), now_ns).expect("it knows where it is");
    two_steps.sense(&odometry(10));
    // r5 is at x = 3 m, and the front point 0.1 m ahead of x = 1.01 m.
    let error = two_steps.situation().expect("r5 was heard").error;
    assert!((error.x - (1.01 + 0.1 * 0.3f64.cos() - 3.0)).abs() < 1e-12, "{error:?}");
    let output = two_steps.law_output();
    let same = act(&mut two_steps, output, now_ns);
    assert_eq!(format!("{same:?}"), format!("{:?}", Some(&answer)));
    assert_ne!(answer.beacon().velocity(), velocity);

    two_steps.sense(&odometry(20));
    let later_ns = START_NS + 20 * NS_PER_MS;
    let other = act(&mut two_steps, LawOutput::Velocity(velocity), later_ns);
    let other = other.expect("it knows where it is");
    assert_eq!(other.beacon().velocity(), velocity, "no method bounds it");
    two_steps.sense(&Odometry { pose_valid: 0, ..odometry(30) });
    assert!(
        two_steps.situation().is_none()
            && act(&mut two_steps, LawOutput::Velocity(velocity), now_ns).is_none()
    );
}

#[test]
fn goal_robot_uses_a_newer_goal_from_the_next_sample() {
    let goal = |stamp_ns, x_m| Goal { stamp_ns, x_m, y_m: 2.0 };
    let goal_in_force = |controller: &Controller| controller.status().0.goal();
    let goal_brief = AgentBrief {
        law: "goal-unit".into(),
        goal_m: Some([9.0, 0.0]),
        neighbors: Vec::new(),
        ..brief()
    };
    let mut controller = Controller::new(&goal_brief, 0).unwrap();
    // At 0 ms the front point is at 1 m + 0.1 cos 0.3 m, and the goal ahead.
    assert!(
        answer_at(&mut controller, 0).beacon().vx_m_s > 0.0 && goal_in_force(&controller).is_none()
    );
    controller.take_status_change();
    for implausible in [f64::NAN, f64::INFINITY, 1e300] {
        controller.request_goal(&goal(5, implausible));
    }
    answer_at(&mut controller, 10);
    assert!(!controller.take_status_change() && goal_in_force(&controller).is_none());
    // Of two goals before the same sample, the newer one counts.
    controller.request_goal(&goal(7, -5.0));
    controller.request_goal(&goal(6, 5.0));
    assert!(answer_at(&mut controller, 20).beacon().vx_m_s < 0.0, "it turns back");
    assert_eq!(goal_in_force(&controller), Some((20 * NS_PER_MS, [-5.0, 2.0])));
    assert_eq!((controller.take_status_change(), controller.take_status_change()), (true, false));
    // A repeated goal has no effect.
    controller.request_goal(&goal(7, -5.0));
    assert!(answer_at(&mut controller, 30).beacon().vx_m_s < 0.0);
    assert_eq!(
        (controller.take_status_change(), goal_in_force(&controller)),
        (false, Some((20 * NS_PER_MS, [-5.0, 2.0])))
    );
    controller.request_goal(&goal(8, 5.0));
    assert!(answer_at(&mut controller, 40).beacon().vx_m_s > 0.0);
    assert_eq!(goal_in_force(&controller), Some((40 * NS_PER_MS, [5.0, 2.0])));
}

#[test]
fn role_without_a_goal_ignores_goals() {
    let mut controller = Controller::new(&brief(), 0).unwrap();
    answer_at(&mut controller, 0);
    controller.take_status_change();
    controller.request_goal(&Goal { stamp_ns: 7, x_m: -5.0, y_m: 2.0 });
    answer_at(&mut controller, 10);
    assert_eq!((controller.take_status_change(), controller.status().0.goal()), (false, None));
}

#[test]
fn follower_error_is_scaled_during_repair() {
    let mut brief_of_follower = AgentBrief {
        law: "containment-tanh".into(),
        gains: [("k_c_m_s".into(), 2.0)].into(),
        rank: YieldPriority::Contained,
        repair_after_ns: 50 * NS_PER_MS,
        ..brief()
    };
    // r2 counts twice, in place of r5.
    brief_of_follower.neighbors[1].replaces = vec![5];
    let mut controller = Controller::new(&brief_of_follower, 0).unwrap();
    controller.sense(&odometry(0));
    let ratios = [0, 40, 90, 140, 190].map(|t_ms| {
        for sender_index in usize::from(t_ms > 0)..2 {
            controller
                .receive_beacon(sender_index, &beacon(t_ms), START_NS + t_ms * NS_PER_MS)
                .unwrap();
        }
        let odometry = odometry(t_ms);
        controller.sense(&odometry);
        let error = front_point(odometry.pose(), 0.1) - beacon(t_ms).position();
        controller.situation().unwrap().error.norm() / error.norm()
    });
    // r5 is lost at 140 ms and declared failed at 190 ms.
    for (ratios, expected) in ratios.iter().zip([1.0, 1.0, 1.0, 1.0, REPAIR_SPEED_FACTOR]) {
        assert!((ratios - expected).abs() < 1e-9, "{ratios:?}");
    }
}

/// A law whose target is 2 m ahead in x.
struct TargetAheadLaw(Option<Target>, bool);

impl Law for TargetAheadLaw {
    fn gamma(&mut self, situation: &Situation<'_>) -> Vec2 {
        let seen = (situation.error, situation.desired_velocity);
        match self.1 {
            // 10 ms after the first sample, in which the front point has moved by 0.01 m.
            true => assert!((seen.0 - Vec2::new(-1.99, -0.005)).norm() < 1e-9, "{seen:?}"),
            false => assert_eq!(seen, (Vec2::zeros(), Vec2::zeros())),
        }
        self.1 = true;
        let position = situation.front_point + Vec2::new(2.0, 0.0);
        self.0 = Some(Target { position, velocity: Vec2::new(0.0, 0.5) });
        Vec2::new(0.1, 0.0)
    }

    fn target(&mut self) -> Option<Target> {
        self.0.take()
    }
}

#[test]
fn law_of_a_free_robot_is_asked_at_once_and_names_the_target() {
    let parts = Parts {
        role: roles::FREE_ROLE.make(&brief()).unwrap(),
        law: Box::new(TargetAheadLaw(None, false)),
        avoidance: avoidance::build(&brief()).unwrap(),
    };
    let mut controller = Controller::with_parts(&brief(), 0, parts);
    assert_eq!(answer_at(&mut controller, 0).beacon().velocity(), Vec2::new(0.1, 0.0));
    let target = controller.status().0.target().expect("the law names one");
    let expected = controller.cycle_state.front_point + Vec2::new(2.0, 0.0);
    assert_eq!((target.position, target.velocity), (expected, Vec2::new(0.0, 0.5)));
    // The avoidance method uses it.
    let error = controller.cycle_state.error.unwrap();
    assert!((error + Vec2::new(2.0, 0.0)).norm() < 1e-12, "{error:?}");
    assert!(controller.take_status_change(), "the supervisor is told");
    // At the next sample the law receives its error relative to that target.
    answer_at(&mut controller, 10);
}
