//! What the memory of a process is for, and how many pages of each kind it touched: its `smaps`, sorted.

use std::path::Path;

/// What a mapping is for, by its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Code,
    Static,
    Heap,
    Stack,
    Samples,
    Queues,
    Services,
    Barrier,
    Other,
}

impl Kind {
    /// All of them, in the order of the table.
    pub(crate) const ALL: [Kind; 9] = [
        Kind::Code,
        Kind::Static,
        Kind::Heap,
        Kind::Stack,
        Kind::Samples,
        Kind::Queues,
        Kind::Services,
        Kind::Barrier,
        Kind::Other,
    ];

    pub(crate) fn words(self) -> &'static str {
        match self {
            Kind::Code => "code and constants",
            Kind::Static => "static data",
            Kind::Heap => "heap and other anonymous memory",
            Kind::Stack => "stack",
            Kind::Samples => "iceoryx2: samples",
            Kind::Queues => "iceoryx2: connections with their queues",
            Kind::Services => "iceoryx2: services and nodes",
            Kind::Barrier => "barrier",
            Kind::Other => "anything else",
        }
    }

    fn of(name: &str, writable: bool, run_root: &Path) -> Kind {
        let path = Path::new(name);
        if path.starts_with(run_root) {
            return match path.extension().and_then(|end| end.to_str()) {
                Some("data") => Kind::Samples,
                Some("connection") => Kind::Queues,
                None if path.ends_with("barrier") => Kind::Barrier,
                _ => Kind::Services,
            };
        }
        match name {
            "" | "[heap]" => Kind::Heap,
            "[stack]" => Kind::Stack,
            name if name.starts_with("[anon") => Kind::Heap,
            name if name.starts_with('/') && writable => Kind::Static,
            name if name.starts_with('/') => Kind::Code,
            _ => Kind::Other,
        }
    }
}

/// What there is of one kind.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Touched {
    pub(crate) mappings: f64,
    /// In kB: those of pages that were touched since this was last cleared.
    pub(crate) touched_kb: f64,
}

/// By [`Kind::ALL`].
pub(crate) type Segments = [Touched; Kind::ALL.len()];

/// Sorts the mappings of an `smaps`.
pub(crate) fn sort(smaps: &str, run_root: &Path) -> Segments {
    let mut segments = Segments::default();
    let mut place = None;
    for line in smaps.lines() {
        let mut words = line.split_ascii_whitespace();
        let Some(first) = words.next() else { continue };
        if let Some(key) = first.strip_suffix(':') {
            let kb = words.next().and_then(|word| word.parse::<f64>().ok());
            if let ("Referenced", Some(place), Some(kb)) = (key, place, kb) {
                let of_kind: &mut Touched = &mut segments[place];
                of_kind.touched_kb += kb;
            }
            continue;
        }
        // Addresses, permissions, offset, device, inode, and a name that may have spaces in it.
        let writable = words.next().is_some_and(|permissions| permissions.contains('w'));
        let name = line.splitn(6, ' ').nth(5).unwrap_or_default().trim();
        let name = name.strip_suffix(" (deleted)").unwrap_or(name);
        let kind = Kind::of(name, writable, run_root);
        place = Kind::ALL.iter().position(|&of| of == kind);
        if let Some(place) = place {
            segments[place].mappings += 1.0;
        }
    }
    segments
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMAPS: &str = "\
55e0c0000000-55e0c0100000 r-xp 00000000 fe:00 77                         /opt/my tools/phalanx
Size:               1024 kB
Rss:                 900 kB
Referenced:          120 kB
VmFlags: rd ex mr mw me
55e0c0100000-55e0c0101000 rw-p 00100000 fe:00 77                         /opt/my tools/phalanx
Referenced:            4 kB
55e0c0101000-55e0c0201000 rw-p 00000000 00:00 0                          [heap]
Referenced:           16 kB
7f0000000000-7f0000010000 rw-p 00000000 00:00 0
Referenced:            8 kB
7f0000020000-7f0000030000 rw-s 00000000 00:1a 9                          /dev/shm/phalanx-0/01ab/phx_12.data
Referenced:           12 kB
7f0000040000-7f0000050000 rw-s 00000000 00:1a 10                         /dev/shm/phalanx-0/01ab/phx_13.data (deleted)
Referenced:            0 kB
7f0000060000-7f0000070000 rw-s 00000000 00:1a 11                         /dev/shm/phalanx-0/01ab/phx_14.connection
Referenced:           20 kB
7f0000080000-7f0000090000 rw-s 00000000 00:1a 12                         /dev/shm/phalanx-0/01ab/phx_15.dynamic
Referenced:           24 kB
7f00000a0000-7f00000b0000 rw-s 00000000 00:1a 13                         /dev/shm/phalanx-0/01ab/barrier
Referenced:            4 kB
7ffc00000000-7ffc00021000 rw-p 00000000 00:00 0                          [stack]
Referenced:           28 kB
7ffc00100000-7ffc00102000 r-xp 00000000 00:00 0                          [vdso]
Referenced:            4 kB
";

    #[test]
    fn mappings_are_sorted_by_their_files_and_counted_with_what_was_touched() {
        let of = |mappings, touched_kb| Touched { mappings, touched_kb };
        let expected = [
            of(1.0, 120.0),
            of(1.0, 4.0),
            of(2.0, 24.0),
            of(1.0, 28.0),
            of(2.0, 12.0),
            of(1.0, 20.0),
            of(1.0, 24.0),
            of(1.0, 4.0),
            of(1.0, 4.0),
        ];
        assert_eq!(sort(SMAPS, Path::new("/dev/shm/phalanx-0/01ab")), expected);
    }

    #[test]
    fn this_process_has_code_heap_and_a_stack_and_touches_them() {
        let smaps = std::fs::read_to_string("/proc/self/smaps").unwrap();
        let segments = sort(&smaps, Path::new("/nowhere"));
        for kind in [Kind::Code, Kind::Heap, Kind::Stack] {
            let place = Kind::ALL.iter().position(|&of| of == kind).unwrap();
            assert!(segments[place].touched_kb > 0.0, "{kind:?}: {segments:?}");
        }
    }
}
