//! Input of a law as Python objects: copies of plain values, converted to Python objects on access.

use std::sync::Arc;

use agent::laws::{self, NeighborEstimate, ReceivedMessage};
use formation::Vec2;
use formation::pose;
use protocol::brief::AgentBrief;
use protocol::message::ReceptionState;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyList};

use crate::own_robot;

/// Components x and y.
type Pair = (f64, f64);

/// A pose of the axle mid-point.
#[pyclass(frozen, get_all, skip_from_py_object, module = "phalanx")]
#[derive(Clone, Copy)]
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
#[pyclass(frozen, get_all, skip_from_py_object, module = "phalanx")]
#[derive(Clone, Copy)]
pub struct Twist {
    v_m_s: f64,
    side_m_s: f64,
    w_rad_s: f64,
}

impl From<pose::Twist> for Twist {
    fn from(twist: pose::Twist) -> Twist {
        let pose::Twist { v_m_s, side_m_s, w_rad_s } = twist;
        Twist { v_m_s, side_m_s, w_rad_s }
    }
}

#[pymethods]
impl Twist {
    fn __repr__(&self) -> String {
        let Twist { v_m_s, side_m_s, w_rad_s } = self;
        format!("Twist(v_m_s={v_m_s}, side_m_s={side_m_s}, w_rad_s={w_rad_s})")
    }
}

/// State of one neighbor, as known from its beacons.
#[pyclass(frozen, skip_from_py_object, module = "phalanx")]
#[derive(Clone)]
pub struct Neighbor {
    #[pyo3(get)]
    name: String,
    #[pyo3(get)]
    index: usize,
    #[pyo3(get)]
    position: Pair,
    #[pyo3(get)]
    velocity: Pair,
    #[pyo3(get)]
    offset: Pair,
    #[pyo3(get)]
    offset_velocity: Pair,
    #[pyo3(get)]
    age_s: f64,
    #[pyo3(get)]
    contact: &'static str,
    #[pyo3(get)]
    incarnation: u64,
    newest_message: Option<ReceivedMessage>,
    queued: Vec<ReceivedMessage>,
    params: Arc<toml::Table>,
}

#[pymethods]
impl Neighbor {
    fn __repr__(&self) -> String {
        format!("Neighbor({}, {}, at {:?})", self.name, self.contact, self.position)
    }

    /// Returns the newest message of its law: a dict of its arrays, or bytes; `None` before the first.
    #[getter]
    fn message<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.newest_message.as_ref().map(|received| message(py, received)).transpose()
    }

    /// Returns the messages of its law that arrived since the last call, oldest first.
    #[getter]
    fn messages<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        self.queued.iter().map(|received| message(py, received)).collect()
    }

    /// Returns the parameters of the edge from this robot.
    #[getter]
    fn params<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        own_robot::dict(py, &self.params)
    }

    /// Returns the age of that message, s.
    #[getter]
    fn message_age_s(&self) -> Option<f64> {
        self.newest_message.as_ref().map(|received| received.age_s)
    }
}

/// Input of a law: what the robot knows at one odometry sample.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct Situation {
    error: Pair,
    desired_velocity: Pair,
    pose: Pose,
    front_point: Pair,
    twist: Twist,
    near: Option<Vec<Pair>>,
    near_cut: bool,
    t_s: f64,
    period_s: f64,
    neighbors: Vec<Neighbor>,
}

/// Sensor data and target of a robot, the input of a controller.
#[pyclass(frozen, get_all, module = "phalanx")]
pub struct Odometry {
    pose: Pose,
    twist: Twist,
    front_point: Pair,
    front_point_m: f64,
    near: Option<Vec<Pair>>,
    near_cut: bool,
    error: Pair,
    desired_velocity: Pair,
    period_s: f64,
}

impl Situation {
    /// Converts the input of a law. `names`: names of the in-neighbors.
    pub fn new(situation: &laws::Situation<'_>, names: &InNeighborNames) -> Situation {
        Situation {
            error: pair(situation.error),
            desired_velocity: pair(situation.desired_velocity),
            pose: situation.pose.into(),
            front_point: pair(situation.front_point),
            twist: situation.twist.into(),
            near: near(situation),
            near_cut: situation.neighbors_truncated,
            t_s: situation.t_s,
            period_s: situation.period_s,
            neighbors: neighbors(situation, names),
        }
    }
}

impl Odometry {
    pub fn new(situation: &laws::Situation<'_>) -> Odometry {
        let pose::Pose { x_m, y_m, .. } = situation.pose;
        Odometry {
            pose: situation.pose.into(),
            twist: situation.twist.into(),
            front_point: pair(situation.front_point),
            front_point_m: (situation.front_point - Vec2::new(x_m, y_m)).norm(),
            near: near(situation),
            near_cut: situation.neighbors_truncated,
            error: pair(situation.error),
            desired_velocity: pair(situation.desired_velocity),
            period_s: situation.period_s,
        }
    }
}

/// Names of the in-neighbors of a robot, with their scenario indices from 1, and the parameters of the edges from them.
pub struct InNeighborNames(Vec<(usize, String, Arc<toml::Table>)>);

impl InNeighborNames {
    /// Returns the names of the in-neighbors in a brief.
    pub fn read_in_neighbors(brief: &AgentBrief) -> InNeighborNames {
        let neighbors = brief.senders();
        let entries = neighbors.map(|neighbor| {
            (neighbor.index, neighbor.name.clone(), Arc::new(neighbor.params.clone()))
        });
        InNeighborNames(entries.collect())
    }

    /// Returns the number of in-neighbors.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// Returns the in-neighbors from which a beacon was received.
pub fn neighbors(situation: &laws::Situation<'_>, names: &InNeighborNames) -> Vec<Neighbor> {
    let neighbor = |estimate: &NeighborEstimate| {
        let found = names.0.iter().find(|(index, ..)| *index == estimate.index);
        let (_, name, params) = found.cloned().unwrap_or_default();
        Neighbor {
            name,
            params,
            position: pair(estimate.position),
            velocity: pair(estimate.velocity),
            offset: pair(estimate.offset.position),
            offset_velocity: pair(estimate.offset.velocity),
            index: estimate.index,
            age_s: estimate.age_s,
            incarnation: estimate.incarnation,
            newest_message: estimate.message.clone(),
            queued: estimate.queued_messages.clone(),
            contact: match estimate.reception_state {
                ReceptionState::Fresh => "fresh",
                ReceptionState::Stale => "stale",
                ReceptionState::Lost => "lost",
                // A neighbor without a received beacon is not in the list.
                ReceptionState::NothingReceived | ReceptionState::Apart => "unheard",
            },
        }
    };
    situation.neighbor_estimates.iter().map(neighbor).collect()
}

/// Returns a message as a dict of its arrays, or bytes.
fn message<'py>(py: Python<'py>, received: &ReceivedMessage) -> PyResult<Bound<'py, PyAny>> {
    if received.format.is_bytes() {
        return Ok(PyBytes::new(py, &received.bytes).into_any());
    }
    let arrays = PyDict::new(py);
    for (array, numbers) in received.format.decode_arrays(&received.bytes) {
        arrays.set_item(&*array.name, nested(py, &array.shape, &numbers)?)?;
    }
    Ok(arrays.into_any())
}

/// Returns numbers as nested lists of this shape, or as a number.
fn nested<'py>(py: Python<'py>, shape: &[usize], numbers: &[f64]) -> PyResult<Bound<'py, PyAny>> {
    match shape {
        [] => Ok(numbers.first().copied().unwrap_or(f64::NAN).into_pyobject(py)?.into_any()),
        [_] => Ok(PyList::new(py, numbers)?.into_any()),
        [_, inner @ ..] => {
            let rows = numbers.chunks(inner.iter().product::<usize>().max(1));
            let rows = rows.map(|row| nested(py, inner, row)).collect::<PyResult<Vec<_>>>()?;
            Ok(PyList::new(py, rows)?.into_any())
        }
    }
}

/// Returns the front points of the robots in sensing range, m; `None` while the sensor fails.
fn near(situation: &laws::Situation<'_>) -> Option<Vec<Pair>> {
    let points = situation
        .neighbor_vectors
        .iter()
        .map(|to_neighbor| pair(situation.front_point - to_neighbor));
    situation.proximity_valid.then(|| points.collect())
}

fn pair(vector: Vec2) -> Pair {
    (vector.x, vector.y)
}
