//! A plant with robot motion in Python: the user's class gets the twists of all robots, and returns their poses.
//! Command handling, sensing and faults stay in the plant in Rust.

use std::path::PathBuf;

use agent::program::is_version_mismatch;
use formation::drive::DriveKind;
use formation::pose::{Pose, Twist};
use formation::unicycle::twist_between;
use plant::motion::{BodyState, Motion};
use plant::world_loop;
use protocol::brief::{BodyBrief, PlantBrief};
use protocol::process::exit;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};

use crate::law::{
    flush, format_exception, is_no_sequence_of_numbers, name, source_location, truncated_repr,
};
use crate::serve::PACKAGE;
use crate::situation;

/// Name of the method that moves the robots.
const STEP_METHOD: &str = "step";

/// Runs the plant of this brief until it is asked to stop. Returns the exit code.
#[pyfunction]
pub fn serve_plant(plant: &Bound<'_, PyAny>, brief: PathBuf, realtime_priority: bool) -> u8 {
    if is_version_mismatch(&brief, PACKAGE) {
        return exit::INFRASTRUCTURE_FAILURE;
    }
    let code = world_loop::main_with_motion(&brief, realtime_priority, |brief| {
        PythonMotion::new(plant, brief)
    });
    flush(plant.py());
    code
}

/// An instance of the user's class.
struct PythonMotion {
    instance: Py<PyAny>,
    /// Bound method of the instance.
    method: Py<PyAny>,
    /// Drive of each robot.
    drives: Vec<DriveKind>,
    t_s: f64,
}

impl PythonMotion {
    /// Creates an instance of the class with the robots of the brief.
    fn new(class: &Bound<'_, PyAny>, brief: &PlantBrief) -> Result<PythonMotion, String> {
        let py = class.py();
        let create = || -> PyResult<PythonMotion> {
            let robots: Vec<_> =
                brief.robots.iter().map(|body| robot(py, body)).collect::<PyResult<_>>()?;
            let instance = class.call1((PyList::new(py, robots)?,))?;
            let method = instance.getattr(STEP_METHOD)?;
            let drives = brief.robots.iter().map(|body| body.drive_kind).collect();
            let (instance, method) = (instance.unbind(), method.unbind());
            Ok(PythonMotion { instance, method, drives, t_s: 0.0 })
        };
        create().map_err(|error| {
            format!(
                "cannot make the plant {}(robots): {}",
                name(class),
                format_exception(py, &error)
            )
        })
    }

    /// Calls the method with the twists and `dt_s`, and updates the states of the robots by its result.
    fn call_step(
        &self,
        py: Python<'_>,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [BodyState],
    ) -> Result<(), String> {
        let where_called = || {
            let location =
                source_location(self.instance.bind(py), self.method.bind(py), STEP_METHOD);
            format!("{location} at t = {:.3} s", self.t_s)
        };
        let twist = |(&Twist { v_m_s, side_m_s, w_rad_s }, drive): (&Twist, &DriveKind)| match drive
        {
            DriveKind::Differential | DriveKind::Ackermann => PyTuple::new(py, [v_m_s, w_rad_s]),
            DriveKind::Omni => PyTuple::new(py, [v_m_s, side_m_s, w_rad_s]),
        };
        let twists = targets.iter().zip(&self.drives).map(twist).collect::<PyResult<Vec<_>>>();
        let twists = twists.map_err(|error| format_exception(py, &error))?;
        let result = self.method.call1(py, (twists, dt_s));
        let answer = result.map_err(|error| {
            format!("{} raised\n{}", where_called(), format_exception(py, &error))
        })?;
        let answer = answer.bind(py);
        let found = rows(answer, &self.drives).ok_or_else(|| {
            let robots = states.len();
            format!(
                "{} returned {}, expected {robots} poses, one for each robot: (x, y, heading) in m and rad, or \
                 (x, y, heading, v, w) with m/s and rad/s; (x, y, heading, v, side, w) for `drive = \"omni\"`",
                where_called(),
                truncated_repr(answer)
            )
        })?;
        for (state, row) in states.iter_mut().zip(found) {
            *state = row.state(state.pose, dt_s);
        }
        Ok(())
    }
}

impl Motion for PythonMotion {
    type Error = String;

    fn step(
        &mut self,
        targets: &[Twist],
        dt_s: f64,
        states: &mut [BodyState],
    ) -> Result<(), String> {
        Python::attach(|py| self.call_step(py, targets, dt_s, states))?;
        self.t_s += dt_s;
        Ok(())
    }
}

/// Pose, and perhaps twist, of one robot in a result.
struct Row {
    pose: Pose,
    twist: Option<Twist>,
    drive: DriveKind,
}

impl Row {
    /// Parses a pose, and perhaps a twist of this drive; `None` for another count of numbers.
    fn parse(numbers: &[f64], drive: DriveKind) -> Option<Row> {
        let (&[x_m, y_m, heading_rad], twist) = numbers.split_first_chunk()?;
        let twist = match (twist, drive) {
            ([], _) => None,
            (&[v_m_s, w_rad_s], DriveKind::Differential | DriveKind::Ackermann) => {
                Some(Twist::new(v_m_s, w_rad_s))
            }
            (&[v_m_s, side_m_s, w_rad_s], DriveKind::Omni) => {
                Some(Twist { v_m_s, side_m_s, w_rad_s })
            }
            _ => return None,
        };
        Some(Row { pose: Pose { x_m, y_m, heading_rad }, twist, drive })
    }

    /// Returns the new state, with the twist of the row or, if it has none, that of the arc from `from`.
    fn state(&self, from: Pose, dt_s: f64) -> BodyState {
        let arc = || {
            let moved = twist_between(from, self.pose, dt_s);
            // Wheels that slip sideways give a differential drive no lateral speed.
            if self.drive == DriveKind::Omni { moved } else { Twist { side_m_s: 0.0, ..moved } }
        };
        let twist = self.twist.unwrap_or_else(arc);
        BodyState { pose: self.pose, twist }
    }
}

/// Returns the robots of a result of any sequence type, one for each drive; `None` if it is not valid.
fn rows(answer: &Bound<'_, PyAny>, drives: &[DriveKind]) -> Option<Vec<Row>> {
    // A numpy array is converted to a list of lists at once.
    let as_list = answer.getattr("tolist").and_then(|list| list.call0());
    let answer = as_list.as_ref().unwrap_or(answer);
    if is_no_sequence_of_numbers(answer) {
        return None;
    }
    if answer.len().ok()? != drives.len() {
        return None;
    }
    let row = |(i, &drive)| Row::parse(&numbers(&answer.get_item(i).ok()?)?, drive);
    drives.iter().enumerate().map(row).collect()
}

/// Returns the numbers of a sequence of any type; `None` if it is not one.
fn numbers(row: &Bound<'_, PyAny>) -> Option<Vec<f64>> {
    if is_no_sequence_of_numbers(row) {
        return None;
    }
    (0..row.len().ok()?).map(|i| row.get_item(i).ok()?.extract().ok()).collect()
}

/// Creates a `phalanx.Robot`.
fn robot<'py>(py: Python<'py>, body: &BodyBrief) -> PyResult<Bound<'py, PyAny>> {
    let module = py.import("phalanx.plant")?;
    let construct = |class: &str, parts: &[(&str, f64)]| -> PyResult<Bound<'py, PyAny>> {
        let keywords = PyDict::new(py);
        parts.iter().try_for_each(|(key, value)| keywords.set_item(key, value))?;
        module.getattr(class)?.call((), Some(&keywords))
    };
    let wheels = body.wheels.map(|wheels| {
        let parts = [("speed_max_m_s", wheels.speed_max_m_s), ("track_m", wheels.track_m)];
        construct("Wheels", &parts)
    });
    let limits = body.limits.map(|limits| {
        let parts = [
            ("acceleration_m_s2", limits.acceleration_m_s2),
            ("turn_acceleration_rad_s2", limits.turn_acceleration_rad_s2),
            ("braking_time_s", limits.braking_time_s),
        ];
        construct("Limits", &parts)
    });
    let keywords = PyDict::new(py);
    keywords.set_item("name", &body.name)?;
    keywords.set_item("start", Bound::new(py, situation::Pose::from(body.start))?)?;
    keywords.set_item("front_point_m", body.front_point_m)?;
    keywords.set_item(
        "drive",
        match body.drive_kind {
            DriveKind::Differential => "differential",
            DriveKind::Omni => "omni",
            DriveKind::Ackermann => "ackermann",
        },
    )?;
    keywords.set_item("wheels", wheels.transpose()?)?;
    keywords.set_item("limits", limits.transpose()?)?;
    module.getattr("Robot")?.call((), Some(&keywords))
}
