//! What a law sees, as Python objects: copies of plain values, made when they are asked for.

use agent::laws::{self, Heard};
use formation::Vec2;
use formation::pose;
use protocol::brief::AgentBrief;
use protocol::message::Contact;
use pyo3::prelude::*;

/// A pose of the axle's mid-point.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct Pose {
    x_m: f64,
    y_m: f64,
    heading_rad: f64,
}

impl From<pose::Pose> for Pose {
    fn from(pose: pose::Pose) -> Pose {
        let pose::Pose { x_m, y_m, heading_rad } = pose;
        Pose { x_m, y_m, heading_rad }
    }
}

#[pymethods]
impl Pose {
    fn __repr__(&self) -> String {
        format!("Pose(x_m={}, y_m={}, heading_rad={})", self.x_m, self.y_m, self.heading_rad)
    }
}

/// A twist of the body.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct Twist {
    v_m_s: f64,
    w_rad_s: f64,
}

#[pymethods]
impl Twist {
    fn __repr__(&self) -> String {
        format!("Twist(v_m_s={}, w_rad_s={})", self.v_m_s, self.w_rad_s)
    }
}

/// What is known of one robot that was heard.
#[pyclass(frozen, module = "phalanx")]
pub struct Neighbor {
    name: String,
    heard: Heard,
}

#[pymethods]
impl Neighbor {
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn position(&self) -> (f64, f64) {
        pair(self.heard.position)
    }

    #[getter]
    fn velocity(&self) -> (f64, f64) {
        pair(self.heard.velocity)
    }

    #[getter]
    fn offset(&self) -> (f64, f64) {
        pair(self.heard.offset.position)
    }

    #[getter]
    fn offset_velocity(&self) -> (f64, f64) {
        pair(self.heard.offset.velocity)
    }

    #[getter]
    fn age_s(&self) -> f64 {
        self.heard.age_s
    }

    #[getter]
    fn contact(&self) -> &'static str {
        match self.heard.contact {
            Contact::Fresh => "fresh",
            Contact::Stale => "stale",
            Contact::Lost => "lost",
            // Whoever was never heard is not among the heard.
            Contact::Unheard => "unheard",
        }
    }

    fn __repr__(&self) -> String {
        format!("Neighbor({}, {}, at {:?})", self.name, self.contact(), self.position())
    }
}

/// One instant as a law sees it.
#[pyclass(frozen, module = "phalanx")]
pub struct Situation(Sensed);

/// What a robot senses and where it is to be, for a controller.
#[pyclass(frozen, module = "phalanx")]
pub struct Odometry(Sensed);

/// A copy of a [`laws::Situation`].
struct Sensed {
    now: laws::Situation<'static>,
    away: Vec<Vec2>,
    neighbors: Vec<(String, Heard)>,
}

impl Sensed {
    /// `names`: of robots by their places in the scenario.
    fn of(situation: &laws::Situation<'_>, names: &Names) -> Sensed {
        let named = |heard: &Heard| (names.of(heard.index), *heard);
        Sensed {
            now: laws::Situation {
                error: situation.error,
                desired_velocity: situation.desired_velocity,
                period_s: situation.period_s,
                age_periods: situation.age_periods,
                t_s: situation.t_s,
                pose: situation.pose,
                front_point: situation.front_point,
                twist: situation.twist,
                away: &[],
                heard: &[],
            },
            away: situation.away.to_vec(),
            neighbors: situation.heard.iter().map(named).collect(),
        }
    }

    fn near(&self) -> Vec<(f64, f64)> {
        self.away.iter().map(|away| pair(self.now.front_point - away)).collect()
    }

    fn pose(&self) -> Pose {
        self.now.pose.into()
    }

    fn twist(&self) -> Twist {
        let pose::Twist { v_m_s, w_rad_s } = self.now.twist;
        Twist { v_m_s, w_rad_s }
    }
}

/// The names of those that a robot hears, by their places in the scenario, from 1.
pub struct Names(Vec<(usize, String)>);

impl Names {
    /// Those of the robots that the robot of this brief hears.
    pub fn of_those_heard(brief: &AgentBrief) -> Names {
        let neighbors = brief.neighbors.iter();
        Names(neighbors.map(|neighbor| (neighbor.index, neighbor.name.clone())).collect())
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    fn of(&self, index: usize) -> String {
        let found = self.0.iter().find(|(place, _)| *place == index);
        found.map_or(String::new(), |(_, name)| name.clone())
    }
}

/// Those heard, as a list.
pub fn neighbors(situation: &laws::Situation<'_>, names: &Names) -> Vec<Neighbor> {
    let heard = situation.heard.iter();
    heard.map(|heard| Neighbor { name: names.of(heard.index), heard: *heard }).collect()
}

impl Situation {
    pub fn of(situation: &laws::Situation<'_>, names: &Names) -> Situation {
        Situation(Sensed::of(situation, names))
    }
}

impl Odometry {
    pub fn of(situation: &laws::Situation<'_>) -> Odometry {
        let alone = laws::Situation { heard: &[], ..*situation };
        Odometry(Sensed::of(&alone, &Names(Vec::new())))
    }
}

#[pymethods]
impl Situation {
    #[getter]
    fn error(&self) -> (f64, f64) {
        pair(self.0.now.error)
    }

    #[getter]
    fn desired_velocity(&self) -> (f64, f64) {
        pair(self.0.now.desired_velocity)
    }

    #[getter]
    fn pose(&self) -> Pose {
        self.0.pose()
    }

    #[getter]
    fn front_point(&self) -> (f64, f64) {
        pair(self.0.now.front_point)
    }

    #[getter]
    fn twist(&self) -> Twist {
        self.0.twist()
    }

    #[getter]
    fn near(&self) -> Vec<(f64, f64)> {
        self.0.near()
    }

    #[getter]
    fn t_s(&self) -> f64 {
        self.0.now.t_s
    }

    #[getter]
    fn period_s(&self) -> f64 {
        self.0.now.period_s
    }

    #[getter]
    fn neighbors(&self) -> Vec<Neighbor> {
        let known = self.0.neighbors.iter();
        known.map(|(name, heard)| Neighbor { name: name.clone(), heard: *heard }).collect()
    }
}

#[pymethods]
impl Odometry {
    #[getter]
    fn pose(&self) -> Pose {
        self.0.pose()
    }

    #[getter]
    fn twist(&self) -> Twist {
        self.0.twist()
    }

    #[getter]
    fn front_point(&self) -> (f64, f64) {
        pair(self.0.now.front_point)
    }

    #[getter]
    fn front_point_m(&self) -> f64 {
        let pose::Pose { x_m, y_m, .. } = self.0.now.pose;
        (self.0.now.front_point - Vec2::new(x_m, y_m)).norm()
    }

    #[getter]
    fn near(&self) -> Vec<(f64, f64)> {
        self.0.near()
    }

    #[getter]
    fn error(&self) -> (f64, f64) {
        pair(self.0.now.error)
    }

    #[getter]
    fn desired_velocity(&self) -> (f64, f64) {
        pair(self.0.now.desired_velocity)
    }

    #[getter]
    fn period_s(&self) -> f64 {
        self.0.now.period_s
    }
}

fn pair(vector: Vec2) -> (f64, f64) {
    (vector.x, vector.y)
}
