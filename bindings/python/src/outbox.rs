//! Messages, targets and signals of a law in Python: its calls of `publish`, `withhold`, `target` and `record`, checked
//! at the call.

use std::sync::{Mutex, MutexGuard, PoisonError};

use formation::Vec2;
use formation::desired::Target;
use protocol::brief::AgentBrief;
use protocol::law::Role;
use protocol::law_message::{MessageArray, MessageFlaw, MessageFormat, SendDecision};
use protocol::signals::SignalValues;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyDict, PyString};

/// Calls of a law that act with its next answer.
#[pyclass(frozen, module = "phalanx._phalanx")]
pub struct Outbox {
    format: Option<MessageFormat>,
    may_withhold_beacon: bool,
    send_decision: Mutex<SendDecision>,
    /// Role of the robot, which may have the law name a target.
    role: String,
    target: Mutex<Option<Target>>,
    /// Names of the signals that the scenario declares.
    signals: Vec<String>,
    recorded: Mutex<SignalValues>,
}

impl Outbox {
    /// Creates the outbox of the robot of this brief.
    pub fn new(brief: &AgentBrief) -> Outbox {
        Outbox {
            format: brief.message.clone(),
            may_withhold_beacon: brief.withholds,
            send_decision: Mutex::new(SendDecision::Beacon),
            role: brief.program.as_ref().map_or(String::new(), |program| program.role.clone()),
            target: Mutex::new(None),
            signals: brief.signals.clone(),
            recorded: Mutex::new(SignalValues::NONE),
        }
    }

    /// Returns what leaves with the present answer.
    pub fn take_send_decision(&self) -> SendDecision {
        std::mem::take(&mut *self.lock_send_decision())
    }

    /// Returns the target that the law has named for the present answer.
    pub fn take_target(&self) -> Option<Target> {
        self.target.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Returns the signals that the law has recorded for the present answer.
    pub fn take_signals(&self) -> SignalValues {
        std::mem::take(&mut *self.recorded.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn lock_send_decision(&self) -> MutexGuard<'_, SendDecision> {
        self.send_decision.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set(&self, outgoing: SendDecision) -> PyResult<()> {
        outgoing.check(self.format.as_ref(), self.may_withhold_beacon).map_err(flaw_error)?;
        let mut send_decision = self.lock_send_decision();
        if *send_decision != SendDecision::Beacon
            && (*send_decision == SendDecision::Withheld) != (outgoing == SendDecision::Withheld)
        {
            return Err(PyValueError::new_err(
                "publish and withhold were both called for one answer, expected one of them",
            ));
        }
        *send_decision = outgoing;
        Ok(())
    }
}

#[pymethods]
impl Outbox {
    /// Sends a message with the beacon of the present answer: bytes, or all arrays that the scenario declares. The last
    /// call of an answer counts. Raises a `ValueError` if the message does not have the declared format.
    #[pyo3(signature = (data=None, /, **arrays))]
    fn publish(
        &self,
        data: Option<&Bound<'_, PyAny>>,
        arrays: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let format =
            self.format.as_ref().ok_or_else(|| flaw_error(MessageFlaw::UndeclaredMessage))?;
        let message = match (data, arrays.filter(|arrays| !arrays.is_empty())) {
            (Some(_), Some(_)) => {
                return Err(PyTypeError::new_err("publish takes bytes or named arrays, not both"));
            }
            (Some(data), None) => bytes(format, data)?.into(),
            (None, None) => {
                return Err(PyTypeError::new_err(format!("publish needs {}", format.describe())));
            }
            (None, Some(_)) if format.is_bytes() => {
                return Err(PyTypeError::new_err(format!(
                    "publish was called with named arrays, expected {}",
                    format.describe()
                )));
            }
            (None, Some(arrays)) => encode(format, arrays)?,
        };
        self.set(SendDecision::Message(message))
    }

    /// Sets the point where the front point is to be, m, and the velocity of that point, m/s, for the present answer.
    #[pyo3(signature = (position, velocity=None))]
    fn target(
        &self,
        position: &Bound<'_, PyAny>,
        velocity: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        if self.role != Role::FREE.name {
            return Err(PyValueError::new_err(format!(
                "target was called by a law with `role = \"{}\"`, which determines the target: expected `role = \"free\"` in \
                 its table [laws.NAME]",
                self.role
            )));
        }
        let pair = |name: &str, value: &Bound<'_, PyAny>| {
            crate::law::numbers::<2>(value).map(Vec2::from).ok_or_else(|| {
                let found = crate::law::truncated_repr(value);
                PyValueError::new_err(format!(
                    "the {name} of the target is {found}, expected two finite numbers (x, y)"
                ))
            })
        };
        let velocity = velocity.map(|velocity| pair("velocity", velocity)).transpose()?;
        let target = Target {
            position: pair("position", position)?,
            velocity: velocity.unwrap_or_default(),
        };
        *self.target.lock().unwrap_or_else(PoisonError::into_inner) = Some(target);
        Ok(())
    }

    /// Records values of signals that the scenario declares, for the present answer. The last value of a signal counts.
    #[pyo3(signature = (**values))]
    fn record(&self, values: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
        let mut recorded = self.recorded.lock().unwrap_or_else(PoisonError::into_inner);
        for (name, value) in values.into_iter().flatten() {
            let name: String = name.extract()?;
            let Some(index) = self.signals.iter().position(|signal| *signal == name) else {
                let expected = match &self.signals[..] {
                    [] => format!("`signals = [\"{name}\"]` in its table [laws.NAME]"),
                    declared => format!("one of {}", declared.join(", ")),
                };
                return Err(PyValueError::new_err(format!(
                    "record was called with `{name}`, which the law does not declare, expected {expected}"
                )));
            };
            let number = value.extract().ok().filter(|number: &f64| number.is_finite());
            let number = number.ok_or_else(|| {
                let found = crate::law::truncated_repr(&value);
                PyValueError::new_err(format!(
                    "the signal `{name}` is {found}, expected a finite number"
                ))
            })?;
            recorded.set(index, number);
        }
        Ok(())
    }

    /// Sends no beacon with the present answer.
    fn withhold(&self) -> PyResult<()> {
        self.set(SendDecision::Withheld)
    }
}

fn flaw_error(flaw: MessageFlaw) -> PyErr {
    PyValueError::new_err(flaw.to_string())
}

fn bytes(format: &MessageFormat, data: &Bound<'_, PyAny>) -> PyResult<Vec<u8>> {
    let is_bytes = data.is_instance_of::<PyBytes>() || data.is_instance_of::<PyByteArray>();
    if !(is_bytes && format.is_bytes()) {
        let (found, expected) = (data.get_type().name()?, format.describe());
        return Err(PyTypeError::new_err(format!(
            "publish was called with {found}, expected {expected}"
        )));
    }
    data.extract()
}

/// Encodes the arrays of a message.
fn encode(format: &MessageFormat, arrays: &Bound<'_, PyDict>) -> PyResult<std::sync::Arc<[u8]>> {
    let mut named_arrays = Vec::with_capacity(arrays.len());
    for (name, value) in arrays {
        let name: String = name.extract()?;
        let mut numbers = Vec::new();
        // An array that is not declared is named as such below.
        if let Some(array) = format.arrays.iter().find(|array| array.name == name) {
            flatten(array, &array.shape, &value, &mut numbers)?;
        }
        named_arrays.push((name, numbers));
    }
    let named_arrays: Vec<_> =
        named_arrays.iter().map(|(name, numbers)| (name.as_str(), &numbers[..])).collect();
    format.encode(&named_arrays).map_err(flaw_error)
}

/// Appends the numbers of a nested sequence of this shape, row by row.
fn flatten(
    array: &MessageArray,
    shape: &[usize],
    value: &Bound<'_, PyAny>,
    numbers: &mut Vec<f64>,
) -> PyResult<()> {
    let shape_error = |found: String| {
        let expected = match &array.shape[..] {
            [] => "a number".to_owned(),
            [count] => format!("{count} numbers"),
            shape => format!("numbers in the shape {shape:?}"),
        };
        PyValueError::new_err(format!("`{}` {found}, expected {expected}", array.name))
    };
    let Some((&length, inner)) = shape.split_first() else {
        let number = value
            .extract()
            .map_err(|_| shape_error(format!("has {}", crate::law::truncated_repr(value))))?;
        numbers.push(number);
        return Ok(());
    };
    if value.is_instance_of::<PyString>() || value.is_instance_of::<PyDict>() {
        return Err(shape_error(format!("has {}", crate::law::truncated_repr(value))));
    }
    let found = value
        .len()
        .map_err(|_| shape_error(format!("has {}", crate::law::truncated_repr(value))))?;
    if found != length {
        return Err(shape_error(format!("has {found} elements where {length} are declared")));
    }
    (0..length).try_for_each(|i| flatten(array, inner, &value.get_item(i)?, numbers))
}
