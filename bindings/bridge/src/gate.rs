//! Acceptance of frames from another host: right build, right experiment, the sender's own key, each frame only
//! once and in order.

use protocol::dropped::DropReason;

use crate::frame::{FrameHeader, WIRE_FORMAT_VERSION};

/// Maximum number of replaced bridges of one host that are remembered.
const RETIRED_BOOTS_MAX: usize = 64;

/// Current bridge process of another host. A new one replaces it; frames of replaced ones are then refused.
#[derive(Debug, Clone, Default)]
pub struct BridgeBoots {
    current_boot_id: Option<u64>,
    retired_boot_ids: Vec<u64>,
}

impl BridgeBoots {
    /// Returns whether a frame of the bridge `boot` may be accepted.
    fn accept_boot(&mut self, boot: u64) -> bool {
        if self.current_boot_id == Some(boot) {
            return true;
        }
        if self.retired_boot_ids.contains(&boot) {
            return false;
        }
        if let Some(old) = self.current_boot_id.replace(boot) {
            if self.retired_boot_ids.len() == RETIRED_BOOTS_MAX {
                self.retired_boot_ids.remove(0);
            }
            self.retired_boot_ids.push(old);
        }
        true
    }
}

/// Acceptance check for the frames of one key.
#[derive(Debug, Clone)]
pub struct FrameFilter {
    host: u16,
    layout_hash: u64,
    experiment_hash: u64,
    /// Bridge and sequence number of the newest accepted frame.
    newest_boot_and_sequence: Option<(u64, u64)>,
}

impl FrameFilter {
    /// Creates a check for a key of the host with this index and for frames of this layout.
    pub fn new(host: usize, layout: u64, experiment: u64) -> FrameFilter {
        FrameFilter {
            host: host as u16,
            layout_hash: layout,
            experiment_hash: experiment,
            newest_boot_and_sequence: None,
        }
    }

    /// Returns header and content of a frame, or the reason for dropping it. `boots`: bridges of the sending
    /// host.
    pub fn accept_frame<'f>(
        &mut self,
        frame: &'f [u8],
        boots: &mut BridgeBoots,
    ) -> Result<(FrameHeader, &'f [u8]), DropReason> {
        let (header, content) = FrameHeader::decode(frame).ok_or(DropReason::Garbage)?;
        let expected = [
            (header.version == WIRE_FORMAT_VERSION, DropReason::Version),
            (header.host == self.host, DropReason::WrongSender),
            (header.layout_hash == self.layout_hash, DropReason::Layout),
            (header.experiment_hash == self.experiment_hash, DropReason::OtherExperiment),
        ];
        if let Some(&(_, reason)) = expected.iter().find(|(holds, _)| !holds) {
            return Err(reason);
        }
        let is_newer = match self.newest_boot_and_sequence {
            Some((boot, sequence)) if boot == header.boot_id => header.sequence > sequence,
            _ => true,
        };
        if !boots.accept_boot(header.boot_id) || !is_newer {
            return Err(DropReason::Replayed);
        }
        self.newest_boot_and_sequence = Some((header.boot_id, header.sequence));
        Ok((header, content))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALID_HEADER: FrameHeader = FrameHeader {
        version: WIRE_FORMAT_VERSION,
        host: 1,
        layout_hash: 77,
        experiment_hash: 88,
        boot_id: 5,
        sequence: 10,
        source_ns: 0,
    };

    fn filter_and_boots() -> (FrameFilter, BridgeBoots) {
        (FrameFilter::new(1, 77, 88), BridgeBoots::default())
    }

    fn accept_header(
        gate: &mut (FrameFilter, BridgeBoots),
        header: FrameHeader,
    ) -> Result<u64, DropReason> {
        let frame = header.encode_frame(&[b"content"]);
        let (header, content) = gate.0.accept_frame(&frame, &mut gate.1)?;
        assert_eq!(content, b"content");
        Ok(header.sequence)
    }

    #[test]
    fn unexpected_frame_is_dropped_for_one_reason() {
        let mut gate = filter_and_boots();
        assert_eq!(accept_header(&mut gate, VALID_HEADER), Ok(10));
        for (wrong, reason) in [
            (FrameHeader { version: WIRE_FORMAT_VERSION + 1, ..VALID_HEADER }, DropReason::Version),
            (FrameHeader { host: 2, ..VALID_HEADER }, DropReason::WrongSender),
            (FrameHeader { layout_hash: 78, ..VALID_HEADER }, DropReason::Layout),
            (FrameHeader { experiment_hash: 89, ..VALID_HEADER }, DropReason::OtherExperiment),
            (VALID_HEADER, DropReason::Replayed),
            (FrameHeader { sequence: 9, ..VALID_HEADER }, DropReason::Replayed),
        ] {
            assert_eq!(accept_header(&mut gate, wrong), Err(reason), "{wrong:?}");
        }
        assert_eq!(gate.0.accept_frame(b"garbage", &mut gate.1), Err(DropReason::Garbage));
        assert_eq!(
            accept_header(&mut gate, FrameHeader { sequence: 12, ..VALID_HEADER }),
            Ok(12),
            "some may be lost"
        );
    }

    #[test]
    fn frames_of_a_replaced_bridge_are_refused() {
        let mut gate = filter_and_boots();
        assert_eq!(accept_header(&mut gate, VALID_HEADER), Ok(10));
        assert_eq!(
            accept_header(&mut gate, FrameHeader { boot_id: 6, sequence: 1, ..VALID_HEADER }),
            Ok(1)
        );
        let replayed = FrameHeader { sequence: 11, ..VALID_HEADER };
        assert_eq!(accept_header(&mut gate, replayed), Err(DropReason::Replayed));
        assert_eq!(
            accept_header(&mut gate, FrameHeader { boot_id: 6, sequence: 2, ..VALID_HEADER }),
            Ok(2)
        );
    }

    #[test]
    fn unexpected_frame_replaces_no_bridge() {
        let mut gate = filter_and_boots();
        assert_eq!(accept_header(&mut gate, VALID_HEADER), Ok(10));
        let forged = FrameHeader { boot_id: 9, experiment_hash: 0, ..VALID_HEADER };
        assert_eq!(accept_header(&mut gate, forged), Err(DropReason::OtherExperiment));
        assert_eq!(accept_header(&mut gate, FrameHeader { sequence: 11, ..VALID_HEADER }), Ok(11));
    }
}
