//! A C function as a control law: conversion of its input, and checks of its output.

use std::ffi::{c_int, c_void, CString};

use agent::laws::{self, LawOutput};
use agent::program::{ForeignLaw, Level};
use formation::Vec2;
use protocol::brief::AgentBrief;

use crate::{Neighbor, Pose, Situation, Twist, Vector};

/// A user-defined function.
#[derive(Clone, Copy)]
pub enum Function {
    /// A law, which returns the nominal velocity (gamma).
    Gamma(unsafe extern "C-unwind" fn(*const Situation, *mut Vector, *mut c_void) -> c_int),
    /// A controller, which returns a twist.
    Steer(unsafe extern "C-unwind" fn(*const Situation, *mut Twist, *mut c_void) -> c_int),
}

/// A control law that calls a C function.
pub struct CLaw {
    function: Function,
    level: Level,
    user: *mut c_void,
    /// Name of the law in the scenario.
    name: String,
    /// Names of the in-neighbors, with their scenario indices from 1.
    names: Vec<(usize, CString)>,
    near: Vec<Vector>,
    neighbors: Vec<Neighbor>,
}

// SAFETY: the agent's loop calls its law only on the thread that called `phalanx_serve_law`.
unsafe impl Send for CLaw {}

impl CLaw {
    /// Creates the law for the robot of this brief.
    ///
    /// # Safety
    ///
    /// `function` may be called with `user` while this value lives.
    pub unsafe fn new(function: Function, user: *mut c_void, brief: &AgentBrief) -> CLaw {
        let neighbors = brief.senders();
        let name = |name: &str| CString::new(name).expect("a robot's name has letters and digits");
        let level = match function {
            Function::Gamma(_) => Level::Law,
            Function::Steer(_) => Level::controller(brief.drive_kind),
        };
        CLaw {
            function,
            level,
            user,
            name: brief.law.clone(),
            names: neighbors.map(|neighbor| (neighbor.index, name(&neighbor.name))).collect(),
            near: Vec::new(),
            neighbors: Vec::with_capacity(brief.senders().count()),
        }
    }

    /// Returns the input of the function. It points into this law, which must not change while the input is used.
    fn show(&mut self, situation: &laws::Situation<'_>) -> Situation {
        let alpha = situation.front_point;
        self.near.clear();
        self.near.extend(situation.away.iter().map(|away| vector(alpha - away)));
        self.neighbors.clear();
        let named = |index| &self.names.iter().find(|(place, _)| *place == index).expect("heard").1;
        self.neighbors.extend(situation.heard.iter().map(|heard| Neighbor {
            name: named(heard.index).as_ptr(),
            position: vector(heard.position),
            velocity: vector(heard.velocity),
            offset: vector(heard.offset.position),
            offset_velocity: vector(heard.offset.velocity),
            age_s: heard.age_s,
            contact: heard.contact as u32,
        }));
        let pose = situation.pose;
        Situation {
            error: vector(situation.error),
            desired_velocity: vector(situation.desired_velocity),
            pose: Pose { x_m: pose.x_m, y_m: pose.y_m, heading_rad: pose.heading_rad },
            front_point: vector(alpha),
            front_point_m: (alpha - Vec2::new(pose.x_m, pose.y_m)).norm(),
            twist: Twist {
                v_m_s: situation.twist.v_m_s,
                w_rad_s: situation.twist.w_rad_s,
                side_m_s: situation.twist.side_m_s,
            },
            t_s: situation.t_s,
            period_s: situation.period_s,
            near: self.near.as_ptr(),
            near_count: self.near.len(),
            neighbors: self.neighbors.as_ptr(),
            neighbor_count: self.neighbors.len(),
        }
    }
}

impl ForeignLaw for CLaw {
    fn evaluate(&mut self, situation: &laws::Situation<'_>) -> Result<LawOutput, String> {
        let seen = self.show(situation);
        // SAFETY: the caller of `CLaw::new` guarantees that the function may be called with `user`; `seen` and
        // the memory it points to live until it returns.
        let (code, numbers, count): (_, _, usize) = unsafe {
            match self.function {
                Function::Gamma(gamma) => {
                    let mut out = Vector { x: f64::NAN, y: f64::NAN };
                    (gamma(&seen, &mut out, self.user), [out.x, out.y, 0.0], 2)
                }
                Function::Steer(steer) => {
                    let mut out = Twist { v_m_s: f64::NAN, w_rad_s: f64::NAN, side_m_s: 0.0 };
                    let code = steer(&seen, &mut out, self.user);
                    let Twist { v_m_s, w_rad_s, side_m_s } = out;
                    match (self.level, side_m_s == 0.0) {
                        // A lateral speed of a robot that has none is a third number, and so an error.
                        (Level::Controller, true) => (code, [v_m_s, w_rad_s, 0.0], 2),
                        _ => (code, [v_m_s, side_m_s, w_rad_s], 3),
                    }
                }
            }
        };
        let at = || {
            let (method, t_s) = (self.level.method(), situation.t_s);
            format!("the law {:?}: {method} at t = {t_s:.3} s returned", self.name)
        };
        let answer = &numbers[..count];
        match code {
            0 => self.level.law_output(answer).ok_or_else(|| {
                let numbers: Vec<String> = answer.iter().map(f64::to_string).collect();
                let expected = self.level.expected_answer();
                format!("{} ({}), expected {expected}", at(), numbers.join(", "))
            }),
            code => Err(format!("{} {code}, expected 0", at())),
        }
    }
}

fn vector(vector: Vec2) -> Vector {
    Vector { x: vector.x, y: vector.y }
}
