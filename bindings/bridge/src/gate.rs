//! Acceptance of frames from another host: right build, right experiment, the sender's own key, each frame only
//! once and in order.

use protocol::dropped::Dropped;

use crate::frame::{Header, VERSION};

/// Maximum number of replaced bridges of one host that are remembered.
const RETIRED_MAX: usize = 64;

/// Current bridge process of another host. A new one replaces it; frames of replaced ones are then refused.
#[derive(Debug, Clone, Default)]
pub struct Boots {
    current: Option<u64>,
    retired: Vec<u64>,
}

impl Boots {
    /// Returns whether a frame of the bridge `boot` may be accepted.
    fn admit(&mut self, boot: u64) -> bool {
        if self.current == Some(boot) {
            return true;
        }
        if self.retired.contains(&boot) {
            return false;
        }
        if let Some(old) = self.current.replace(boot) {
            if self.retired.len() == RETIRED_MAX {
                self.retired.remove(0);
            }
            self.retired.push(old);
        }
        true
    }
}

/// Acceptance check for the frames of one key.
#[derive(Debug, Clone)]
pub struct Gate {
    host: u16,
    layout: u64,
    experiment: u64,
    /// Bridge and sequence number of the newest accepted frame.
    newest_header: Option<(u64, u64)>,
}

impl Gate {
    /// Creates a check for a key of the host with this index and for frames of this layout.
    pub fn new(host: usize, layout: u64, experiment: u64) -> Gate {
        Gate { host: host as u16, layout, experiment, newest_header: None }
    }

    /// Returns header and content of a frame, or the reason for dropping it. `boots`: bridges of the sending
    /// host.
    pub fn accept_frame<'f>(
        &mut self,
        frame: &'f [u8],
        boots: &mut Boots,
    ) -> Result<(Header, &'f [u8]), Dropped> {
        let (header, content) = Header::decode(frame).ok_or(Dropped::Garbage)?;
        let expected = [
            (header.version == VERSION, Dropped::Version),
            (header.host == self.host, Dropped::Owner),
            (header.layout == self.layout, Dropped::Layout),
            (header.experiment == self.experiment, Dropped::Experiment),
        ];
        if let Some(&(_, why)) = expected.iter().find(|(holds, _)| !holds) {
            return Err(why);
        }
        let goes_on = match self.newest_header {
            Some((boot, sequence)) if boot == header.boot => header.sequence > sequence,
            _ => true,
        };
        if !boots.admit(header.boot) || !goes_on {
            return Err(Dropped::Replayed);
        }
        self.newest_header = Some((header.boot, header.sequence));
        Ok((header, content))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VALID_HEADER: Header = Header {
        version: VERSION,
        host: 1,
        layout: 77,
        experiment: 88,
        boot: 5,
        sequence: 10,
        source_ns: 0,
    };

    fn gate() -> (Gate, Boots) {
        (Gate::new(1, 77, 88), Boots::default())
    }

    fn accept_header(gate: &mut (Gate, Boots), header: Header) -> Result<u64, Dropped> {
        let frame = header.frame(&[b"content"]);
        let (header, content) = gate.0.accept_frame(&frame, &mut gate.1)?;
        assert_eq!(content, b"content");
        Ok(header.sequence)
    }

    #[test]
    fn unexpected_frame_is_dropped_for_one_reason() {
        let mut gate = gate();
        assert_eq!(accept_header(&mut gate, VALID_HEADER), Ok(10));
        for (wrong, why) in [
            (Header { version: VERSION + 1, ..VALID_HEADER }, Dropped::Version),
            (Header { host: 2, ..VALID_HEADER }, Dropped::Owner),
            (Header { layout: 78, ..VALID_HEADER }, Dropped::Layout),
            (Header { experiment: 89, ..VALID_HEADER }, Dropped::Experiment),
            (VALID_HEADER, Dropped::Replayed),
            (Header { sequence: 9, ..VALID_HEADER }, Dropped::Replayed),
        ] {
            assert_eq!(accept_header(&mut gate, wrong), Err(why), "{wrong:?}");
        }
        assert_eq!(gate.0.accept_frame(b"garbage", &mut gate.1), Err(Dropped::Garbage));
        assert_eq!(
            accept_header(&mut gate, Header { sequence: 12, ..VALID_HEADER }),
            Ok(12),
            "some may be lost"
        );
    }

    #[test]
    fn frames_of_a_replaced_bridge_are_refused() {
        let mut gate = gate();
        assert_eq!(accept_header(&mut gate, VALID_HEADER), Ok(10));
        assert_eq!(
            accept_header(&mut gate, Header { boot: 6, sequence: 1, ..VALID_HEADER }),
            Ok(1)
        );
        let replayed = Header { sequence: 11, ..VALID_HEADER };
        assert_eq!(accept_header(&mut gate, replayed), Err(Dropped::Replayed));
        assert_eq!(
            accept_header(&mut gate, Header { boot: 6, sequence: 2, ..VALID_HEADER }),
            Ok(2)
        );
    }

    #[test]
    fn unexpected_frame_replaces_no_bridge() {
        let mut gate = gate();
        assert_eq!(accept_header(&mut gate, VALID_HEADER), Ok(10));
        let forged = Header { boot: 9, experiment: 0, ..VALID_HEADER };
        assert_eq!(accept_header(&mut gate, forged), Err(Dropped::Experiment));
        assert_eq!(accept_header(&mut gate, Header { sequence: 11, ..VALID_HEADER }), Ok(11));
    }
}
