//! A control law in Python: conversion of its input, and checks of its output.

use agent::laws::{LawOutput, SendDecision, SignalValues, Situation};
use agent::program::{AnswerKind, ForeignLaw};
use formation::desired::Target;
use protocol::brief::AgentBrief;
use pyo3::exceptions::{PyBaseException, PyMemoryError};
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyDict, PyString, PyTuple};

use crate::outbox::Outbox;
use crate::own_robot::OwnRobot;
use crate::situation::{self, InNeighborNames};

/// An instance of the user's class.
pub struct PythonLaw {
    instance: Py<PyAny>,
    /// Bound method of the instance: `gamma` or `twist`.
    method: Py<PyAny>,
    answer_kind: AnswerKind,
    names: InNeighborNames,
    outbox: Py<Outbox>,
}

impl PythonLaw {
    /// Creates an instance of the class with the robot's gains. Its attribute `robot` is set before its constructor
    /// runs. Returns a message if that raises an exception.
    pub fn new(
        class: &Bound<'_, PyAny>,
        brief: &AgentBrief,
        incarnation: u64,
    ) -> Result<PythonLaw, String> {
        let (py, gains, names) =
            (class.py(), &brief.gains, InNeighborNames::read_in_neighbors(brief));
        let create = || -> PyResult<PythonLaw> {
            // Imported now, because there may be no memory for it when an error is reported.
            py.import("traceback")?;
            let controller = py.import("phalanx")?.getattr("Controller")?;
            let answer_kind = match class.cast::<pyo3::types::PyType>()?.is_subclass(&controller)? {
                true => AnswerKind::twist_kind_for_drive(brief.drive_kind),
                false => AnswerKind::FrontPointVelocity,
            };
            let keywords = PyDict::new(py);
            for (key, gain) in gains {
                keywords.set_item(key, gain)?;
            }
            let outbox = Py::new(py, Outbox::new(brief))?;
            // As a call of the class, but with attributes that its constructor may use.
            let instance = class.call_method("__new__", (class,), Some(&keywords))?;
            let object = py.import("builtins")?.getattr("object")?;
            let set = |name: &str, value: Bound<'_, PyAny>| {
                object.call_method1("__setattr__", (&instance, name, value)).map(drop)
            };
            set("robot", Bound::new(py, OwnRobot::new(py, brief, incarnation)?)?.into_any())?;
            set("_outbox", outbox.bind(py).clone().into_any())?;
            class.call_method("__init__", (&instance,), Some(&keywords))?;
            let method = instance.getattr(answer_kind.method_name())?;
            let (instance, method) = (instance.unbind(), method.unbind());
            Ok(PythonLaw { instance, method, answer_kind, names, outbox })
        };
        create().map_err(|error| {
            let gains: Vec<String> =
                gains.iter().map(|(key, gain)| format!("{key}={gain}")).collect();
            let call = format!("{}({})", name(class), gains.join(", "));
            format!("cannot make the law {call}: {}", format_exception(py, &error))
        })
    }

    /// Calls the method and returns its answer, or a message about what it raised or returned.
    fn call(&self, py: Python<'_>, situation: &Situation<'_>) -> Result<LawOutput, String> {
        let result = match self.answer_kind {
            AnswerKind::FrontPointVelocity => {
                let input = situation::Situation::new(situation, &self.names);
                self.method.call1(py, (input,))
            }
            AnswerKind::BodyTwist | AnswerKind::OmniBodyTwist => {
                let input = situation::Odometry::new(situation);
                let neighbors = situation::neighbors(situation, &self.names);
                self.method.call1(py, (input, neighbors, situation.t_s))
            }
        };
        let where_called = || {
            let location = source_location(
                self.instance.bind(py),
                self.method.bind(py),
                self.answer_kind.method_name(),
            );
            format!("{location} at t = {:.3} s", situation.t_s)
        };
        let answer = result.map_err(|error| {
            format!("{} raised\n{}", where_called(), format_exception(py, &error))
        })?;
        let answer = answer.bind(py);
        let output = match self.answer_kind {
            AnswerKind::OmniBodyTwist => {
                numbers::<3>(answer).and_then(|twist| self.answer_kind.parse_law_output(&twist))
            }
            _ => numbers::<2>(answer).and_then(|pair| self.answer_kind.parse_law_output(&pair)),
        };
        output.ok_or_else(|| {
            format!(
                "{} returned {}, expected {}",
                where_called(),
                truncated_repr(answer),
                self.answer_kind.expected_answer()
            )
        })
    }
}

/// Maximum length of a wrong return value in a message, in characters.
const SHOWN_ANSWER_CHARS_MAX: usize = 200;

impl ForeignLaw for PythonLaw {
    fn evaluate(&mut self, situation: &Situation<'_>) -> Result<LawOutput, String> {
        Python::attach(|py| self.call(py, situation).inspect_err(|_| flush(py)))
    }

    fn target(&mut self) -> Option<Target> {
        self.outbox.get().take_target()
    }

    fn send_decision(&mut self) -> SendDecision {
        self.outbox.get().take_send_decision()
    }

    fn signals(&mut self) -> SignalValues {
        self.outbox.get().take_signals()
    }
}

/// Returns whether a value is of a type whose items are never the numbers of a result: text, bytes, or a dict.
pub fn is_no_sequence_of_numbers(answer: &Bound<'_, PyAny>) -> bool {
    answer.is_instance_of::<PyString>()
        || answer.is_instance_of::<PyBytes>()
        || answer.is_instance_of::<PyByteArray>()
        || answer.is_instance_of::<PyDict>()
}

/// Returns the N finite numbers of a sequence of any type; `None` if it is something else.
pub fn numbers<const N: usize>(answer: &Bound<'_, PyAny>) -> Option<[f64; N]> {
    if is_no_sequence_of_numbers(answer) {
        return None;
    }
    let mut numbers = [0.0; N];
    match answer.cast_exact::<PyTuple>() {
        Ok(tuple) if tuple.len() == N => {
            for (k, number) in numbers.iter_mut().enumerate() {
                *number = tuple.get_item(k).ok()?.extract().ok()?;
            }
        }
        _ => {
            if answer.len().ok()? != N {
                return None;
            }
            for (k, number) in numbers.iter_mut().enumerate() {
                *number = answer.get_item(k).ok()?.extract().ok()?;
            }
        }
    }
    numbers.iter().all(|number: &f64| number.is_finite()).then_some(numbers)
}

/// Returns the `repr` of a value, or its beginning.
pub fn truncated_repr(answer: &Bound<'_, PyAny>) -> String {
    let found = answer.repr().map_or_else(|_| name(&answer.get_type()), |repr| repr.to_string());
    found.chars().take(SHOWN_ANSWER_CHARS_MAX).collect()
}

/// Returns the name of a method of an instance and its source location: `MyLaw.gamma (my_law.py:7)`.
pub fn source_location(
    instance: &Bound<'_, PyAny>,
    method: &Bound<'_, PyAny>,
    method_name: &str,
) -> String {
    let qualified_name = format!("{}.{method_name}", name(instance.get_type().as_any()));
    let location = || -> PyResult<String> {
        let code = method.getattr("__code__")?;
        let (file, line) = (code.getattr("co_filename")?, code.getattr("co_firstlineno")?);
        let file = file.to_string();
        let file = file.rsplit('/').next().unwrap_or_default();
        Ok(format!("{qualified_name} ({file}:{line})"))
    };
    location().unwrap_or(qualified_name)
}

/// Flushes the program's standard output. An error is ignored, because there is no way to report it.
pub fn flush(py: Python<'_>) {
    let flush = || py.import("sys")?.getattr("stdout")?.call_method0("flush");
    let _ = flush();
}

/// Returns the name of a class.
pub fn name(class: &Bound<'_, PyAny>) -> String {
    class.getattr("__name__").map_or_else(|_| "?".into(), |name| name.to_string())
}

/// Returns an exception with its traceback, formatted as Python prints it.
pub fn format_exception(py: Python<'_>, error: &PyErr) -> String {
    let lines = || -> PyResult<String> {
        let traceback = py.import("traceback")?;
        let value: &Bound<'_, PyBaseException> = error.value(py);
        if error.is_instance_of::<PyMemoryError>(py) {
            // The local variables of the law hold the memory that is missing.
            traceback.call_method1("clear_frames", (error.traceback(py),))?;
        }
        let parts = (error.get_type(py), value, error.traceback(py));
        let lines = traceback.call_method1("format_exception", parts)?;
        PyString::new(py, "").call_method1("join", (lines,))?.extract()
    };
    lines().map_or_else(|_| error.to_string(), |text| text.trim_end().to_owned())
}
