//! A C function as a control law: conversion of its input, and checks of its output.

use std::ffi::{c_int, c_void, CString};

use agent::laws::{self, LawOutput, SendDecision, SignalValues};
use agent::program::{AnswerKind, ForeignLaw};
use formation::desired::Target;
use formation::Vec2;
use protocol::brief::AgentBrief;

use crate::outbox::LawCalls;
use crate::{Message, Neighbor, Outbox, Pose, Situation, Twist, Vector};

/// A user-defined function.
#[derive(Clone, Copy)]
pub enum UserFunction {
    /// A law, which returns the nominal velocity (gamma).
    Law(unsafe extern "C-unwind" fn(*const Situation, *mut Vector, *mut c_void) -> c_int),
    /// A controller, which returns a twist.
    Controller(unsafe extern "C-unwind" fn(*const Situation, *mut Twist, *mut c_void) -> c_int),
}

/// A control law that calls a C function.
pub struct CLaw {
    function: UserFunction,
    answer_kind: AnswerKind,
    user_data: *mut c_void,
    /// Name of the law in the scenario.
    name: String,
    /// Names of the in-neighbors, with their scenario indices from 1.
    neighbor_names: Vec<(usize, CString)>,
    sensed_front_points: Vec<Vector>,
    neighbors: Vec<Neighbor>,
    messages: Vec<Message>,
    outbox: Outbox,
}

// SAFETY: the agent's loop calls its law only on the thread that called `phalanx_serve_law`.
unsafe impl Send for CLaw {}

impl CLaw {
    /// Creates the law for the robot of this brief.
    ///
    /// # Safety
    ///
    /// `function` may be called with `user_data` while this value lives.
    pub unsafe fn new(function: UserFunction, user_data: *mut c_void, brief: &AgentBrief) -> CLaw {
        let neighbors = brief.senders();
        let name = |name: &str| CString::new(name).expect("a robot's name has letters and digits");
        let answer_kind = match function {
            UserFunction::Law(_) => AnswerKind::FrontPointVelocity,
            UserFunction::Controller(_) => AnswerKind::twist_kind_for_drive(brief.drive_kind),
        };
        CLaw {
            function,
            answer_kind,
            user_data,
            name: brief.law.clone(),
            neighbor_names: neighbors
                .map(|neighbor| (neighbor.index, name(&neighbor.name)))
                .collect(),
            sensed_front_points: Vec::new(),
            neighbors: Vec::with_capacity(brief.senders().count()),
            messages: Vec::with_capacity(brief.senders().count()),
            outbox: Outbox(LawCalls::new(brief)),
        }
    }

    /// Returns the input of the function. It points into this law, which must not change while the input is used.
    fn c_situation(&mut self, situation: &laws::Situation<'_>) -> Situation {
        let alpha = situation.front_point;
        self.sensed_front_points.clear();
        self.sensed_front_points.extend(
            situation.neighbor_vectors.iter().map(|to_neighbor| to_c_vector(alpha - to_neighbor)),
        );
        self.neighbors.clear();
        self.messages.clear();
        let messages =
            situation.neighbor_estimates.iter().filter_map(|estimate| estimate.message.clone());
        self.messages.extend(messages.map(Message));
        let mut messages = self.messages.iter();
        let name_of = |index| {
            &self
                .neighbor_names
                .iter()
                .find(|(neighbor_index, _)| *neighbor_index == index)
                .expect("heard")
                .1
        };
        self.neighbors.extend(situation.neighbor_estimates.iter().map(|estimate| Neighbor {
            name: name_of(estimate.index).as_ptr(),
            position: to_c_vector(estimate.position),
            velocity: to_c_vector(estimate.velocity),
            offset: to_c_vector(estimate.offset.position),
            offset_velocity: to_c_vector(estimate.offset.velocity),
            age_s: estimate.age_s,
            contact: estimate.reception_state as u32,
            incarnation: estimate.incarnation,
            message: match &estimate.message {
                Some(_) => messages.next().expect("one for each"),
                None => std::ptr::null(),
            },
            message_age_s: estimate.message.as_ref().map_or(f64::NAN, |message| message.age_s),
        }));
        let pose = situation.pose;
        Situation {
            error: to_c_vector(situation.error),
            desired_velocity: to_c_vector(situation.desired_velocity),
            pose: Pose { x_m: pose.x_m, y_m: pose.y_m, heading_rad: pose.heading_rad },
            front_point: to_c_vector(alpha),
            front_point_m: (alpha - Vec2::new(pose.x_m, pose.y_m)).norm(),
            twist: Twist {
                v_m_s: situation.twist.v_m_s,
                w_rad_s: situation.twist.w_rad_s,
                side_m_s: situation.twist.side_m_s,
            },
            t_s: situation.t_s,
            period_s: situation.period_s,
            near: self.sensed_front_points.as_ptr(),
            near_count: self.sensed_front_points.len(),
            neighbors: self.neighbors.as_ptr(),
            neighbor_count: self.neighbors.len(),
            outbox: &mut self.outbox,
        }
    }
}

impl ForeignLaw for CLaw {
    fn evaluate(&mut self, situation: &laws::Situation<'_>) -> Result<LawOutput, String> {
        let input = self.c_situation(situation);
        // SAFETY: the caller of `CLaw::new` guarantees that the function may be called with `user_data`; `input` and
        // the memory it points to live until it returns.
        let (code, numbers, count): (_, _, usize) = unsafe {
            match self.function {
                UserFunction::Law(gamma) => {
                    let mut out = Vector { x: f64::NAN, y: f64::NAN };
                    (gamma(&input, &mut out, self.user_data), [out.x, out.y, 0.0], 2)
                }
                UserFunction::Controller(steer) => {
                    let mut out = Twist { v_m_s: f64::NAN, w_rad_s: f64::NAN, side_m_s: 0.0 };
                    let code = steer(&input, &mut out, self.user_data);
                    let Twist { v_m_s, w_rad_s, side_m_s } = out;
                    match (self.answer_kind, side_m_s == 0.0) {
                        // A lateral speed of a robot that has none is a third number, and so an error.
                        (AnswerKind::BodyTwist, true) => (code, [v_m_s, w_rad_s, 0.0], 2),
                        _ => (code, [v_m_s, side_m_s, w_rad_s], 3),
                    }
                }
            }
        };
        let call_description = || {
            let (method, t_s) = (self.answer_kind.method_name(), situation.t_s);
            format!("the law {:?}: {method} at t = {t_s:.3} s returned", self.name)
        };
        let answer = &numbers[..count];
        self.outbox.0.finish().map_err(|flaw| {
            let (method, t_s) = (self.answer_kind.method_name(), situation.t_s);
            format!("the law {:?}: {method} at t = {t_s:.3} s: {flaw}", self.name)
        })?;
        match code {
            0 => self.answer_kind.parse_law_output(answer).ok_or_else(|| {
                let numbers: Vec<String> = answer.iter().map(f64::to_string).collect();
                let expected = self.answer_kind.expected_answer();
                format!("{} ({}), expected {expected}", call_description(), numbers.join(", "))
            }),
            code => Err(format!("{} {code}, expected 0", call_description())),
        }
    }

    fn target(&mut self) -> Option<Target> {
        self.outbox.0.take_target()
    }

    fn send_decision(&mut self) -> SendDecision {
        self.outbox.0.take_send_decision()
    }

    fn signals(&mut self) -> SignalValues {
        self.outbox.0.take_signals()
    }
}

fn to_c_vector(vector: Vec2) -> Vector {
    Vector { x: vector.x, y: vector.y }
}
