//! Messages, targets and signals of a law in C: its calls of `phalanx_publish` and others, for the present answer.

use agent::laws::{SendDecision, SignalValues};
use formation::desired::Target;
use protocol::brief::AgentBrief;
use protocol::law::Role;
use protocol::law_message::{MessageFlaw, MessageFormat};

/// Calls of a law that act with its next answer. The first mistake is kept until the function returns.
pub struct LawCalls {
    format: Option<MessageFormat>,
    may_withhold_beacon: bool,
    is_free: bool,
    /// Names of the signals that the scenario declares.
    names: Vec<String>,
    /// Numbers of the arrays that were given, by name.
    arrays: Vec<(String, Vec<f64>)>,
    send_decision: SendDecision,
    target: Option<Target>,
    signals: SignalValues,
    flaw: Option<String>,
}

impl LawCalls {
    /// Creates the calls of the robot of this brief, none yet.
    pub fn new(brief: &AgentBrief) -> LawCalls {
        let role = brief.program.as_ref().map(|program| program.role.as_str());
        LawCalls {
            format: brief.message.clone(),
            may_withhold_beacon: brief.withholds,
            is_free: role == Some(Role::FREE.name),
            names: brief.signals.clone(),
            arrays: Vec::new(),
            send_decision: SendDecision::Beacon,
            target: None,
            signals: SignalValues::NONE,
            flaw: None,
        }
    }

    /// Sets the numbers of an array of the message.
    pub fn publish(&mut self, key: &str, numbers: &[f64]) {
        self.arrays.retain(|(name, _)| name != key);
        self.arrays.push((key.to_owned(), numbers.to_vec()));
    }

    /// Sets the message to bytes without a structure.
    pub fn publish_bytes(&mut self, bytes: &[u8]) {
        match &self.format {
            Some(format) if !format.is_bytes() => {
                let expected = format.describe();
                self.record_flaw(format!(
                    "phalanx_publish_bytes was called, expected arrays: {expected}"
                ));
            }
            _ => self.set_send_decision(SendDecision::Message(bytes.into())),
        }
    }

    /// Withholds the beacon.
    pub fn withhold(&mut self) {
        self.set_send_decision(SendDecision::Withheld);
    }

    /// Sets the target.
    pub fn set_target(&mut self, target: Target) {
        let parts = [target.position.x, target.position.y, target.velocity.x, target.velocity.y];
        if !self.is_free {
            self.record_flaw(
                "phalanx_target was called, expected `role = \"free\"` of the law".to_owned(),
            );
        } else if !parts.iter().all(|part| part.is_finite()) {
            self.record_flaw(format!("the target is {parts:?}, expected finite numbers"));
        } else {
            self.target = Some(target);
        }
    }

    /// Sets the value of a signal.
    pub fn record(&mut self, name: &str, value: f64) {
        match self.names.iter().position(|signal| signal == name) {
            None => self.record_flaw(format!(
                "phalanx_record was called with `{name}`, expected one of `signals` of the law: {}",
                self.names.join(", ")
            )),
            Some(_) if !value.is_finite() => {
                self.record_flaw(format!(
                    "the signal `{name}` is {value}, expected a finite number"
                ));
            }
            Some(index) => self.signals.set(index, value),
        }
    }

    /// Checks the calls of one answer together.
    ///
    /// # Errors
    ///
    /// A message does not have the declared format, or another call was wrong.
    pub fn finish(&mut self) -> Result<(), String> {
        if !self.arrays.is_empty() {
            let arrays = std::mem::take(&mut self.arrays);
            let named_arrays: Vec<(&str, &[f64])> =
                arrays.iter().map(|(name, numbers)| (name.as_str(), &numbers[..])).collect();
            match &self.format {
                None => self.record_flaw(MessageFlaw::UndeclaredMessage.to_string()),
                Some(format) if format.is_bytes() => {
                    let expected = format.describe();
                    self.record_flaw(format!("phalanx_publish was called, expected {expected}"));
                }
                Some(format) => match format.encode(&named_arrays) {
                    Ok(bytes) => self.set_send_decision(SendDecision::Message(bytes)),
                    Err(flaw) => self.record_flaw(flaw.to_string()),
                },
            }
        }
        self.flaw.take().map_or(Ok(()), Err)
    }

    /// Returns what leaves with the present answer.
    pub fn take_send_decision(&mut self) -> SendDecision {
        std::mem::take(&mut self.send_decision)
    }

    /// Returns the target of the present answer.
    pub fn take_target(&mut self) -> Option<Target> {
        self.target.take()
    }

    /// Returns the signals of the present answer.
    pub fn take_signals(&mut self) -> SignalValues {
        std::mem::take(&mut self.signals)
    }

    fn set_send_decision(&mut self, outgoing: SendDecision) {
        let is_withheld = |outgoing: &SendDecision| *outgoing == SendDecision::Withheld;
        if let Err(flaw) = outgoing.check(self.format.as_ref(), self.may_withhold_beacon) {
            self.record_flaw(flaw.to_string());
        } else if self.send_decision != SendDecision::Beacon
            && is_withheld(&self.send_decision) != is_withheld(&outgoing)
        {
            self.record_flaw(
                "a message and phalanx_withhold were both given, expected one of them".to_owned(),
            );
        } else {
            self.send_decision = outgoing;
        }
    }

    fn record_flaw(&mut self, flaw: String) {
        self.flaw.get_or_insert(flaw);
    }
}
