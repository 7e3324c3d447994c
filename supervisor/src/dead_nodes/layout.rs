//! File layout of iceoryx2 in a run root, as far as the clean-up relies on it: names, IDs and modes.
//! iceoryx2 does not guarantee any of it, hence [`verify`].
//!
//! Must not remove or change anything.

use std::fs;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use protocol::run_root::ICEORYX2_PREFIX;
use protocol::service::{self, Node, Qos, ServiceError};

/// Permissions of shared memory under construction.
pub(super) const INCOMPLETE_PERMISSIONS: u32 = 0o200;
/// Permissions of complete shared memory, which may also be read.
const COMPLETE_PERMISSIONS: u32 = 0o600;
/// Version of iceoryx2 whose layout this is. The workspace pins it.
const ICEORYX2_VERSION: &str = "0.10.0";

/// Failure to verify the file layout.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum LayoutError {
    /// A directory cannot be read.
    #[error("cannot read the directory {path}: {source}")]
    ReadDirectory { path: PathBuf, source: io::Error },
    /// A file or an ID differs from what is expected.
    #[error(
        "the iceoryx2 file layout differs from what phalanx expects, so it could not clean up after \
         a robot that dies: expected {expected} in {directory}, found {found}; phalanx needs iceoryx2 \
         {ICEORYX2_VERSION}: build it with its own Cargo.lock"
    )]
    UnexpectedLayout { expected: String, directory: PathBuf, found: String },
    /// The service for the test could not be created.
    #[error(transparent)]
    Service(#[from] ServiceError),
}

/// IDs of the ports and of the node whose files are examined.
#[derive(Debug, Clone, Copy)]
struct PortAndNodeIds {
    process: u32,
    node: u128,
    sender: u128,
    receiver: u128,
}

/// Creates a node, a sender and a receiver, and checks that their files are as expected.
/// # Errors
/// The first difference found, or a failure to read a directory.
pub fn verify(run_root: &Path, node: &Node) -> Result<(), LayoutError> {
    let probe = service::probe_topic().create(node, Qos { subscribers: 1, queue_length: 1 })?;
    let (sender, receiver) = (probe.publisher()?, probe.subscriber()?);
    let ids = PortAndNodeIds {
        process: std::process::id(),
        node: node.id().value(),
        sender: sender.id().value(),
        receiver: receiver.id().value(),
    };
    verify_files(run_root, ids)
}

fn verify_files(run_root: &Path, ids: PortAndNodeIds) -> Result<(), LayoutError> {
    let expect = |holds: bool, expected: String, directory: &Path| match holds {
        true => Ok(()),
        false => {
            let (directory, found) = (directory.to_owned(), list_directory(directory));
            Err(LayoutError::UnexpectedLayout { expected, directory, found })
        }
    };
    let PortAndNodeIds { process, node, sender, receiver } = ids;
    for (kind, id) in [("node", node), ("sender", sender), ("receiver", receiver)] {
        let expected = format!("process {process} within the id {id} of its {kind}");
        expect(creator_pid(id) == process, expected, run_root)?;
    }
    let node_paths: Vec<PathBuf> =
        list_nodes(run_root)?.filter(|(id, _)| *id == node).map(|(_, path)| path).collect();
    let directories = node_paths.iter().filter(|path| path.is_dir()).count();
    expect(
        directories == 1 && node_paths.len() > 1,
        format!("a directory {node} and a file {ICEORYX2_PREFIX}{node}.*"),
        &nodes_dir(run_root),
    )?;
    let connection =
        list_connections(run_root)?.find(|(_, endpoints)| *endpoints == [sender, receiver]);
    let mode = connection.and_then(|(path, _)| Some(fs::metadata(path).ok()?.mode() & 0o777));
    expect(
        mode == Some(COMPLETE_PERMISSIONS),
        format!(
            "a file {ICEORYX2_PREFIX}*_{sender}_{receiver}.connection of mode {COMPLETE_PERMISSIONS:o}"
        ),
        run_root,
    )
}

/// Returns the entries of a directory as one line.
fn list_directory(directory: &Path) -> String {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    let mode =
        |entry: &fs::DirEntry| entry.metadata().map_or(0, |metadata| metadata.mode() & 0o777);
    let mut names: Vec<String> = entries
        .map(|entry| format!("{} ({:o})", entry.file_name().display(), mode(&entry)))
        .collect();
    names.sort();
    if names.is_empty() { "nothing".into() } else { names.join(", ") }
}

/// Returns the directory of all nodes.
pub(super) fn nodes_dir(run_root: &Path) -> PathBuf {
    run_root.join("nodes")
}

/// Returns the files and directories of nodes, each with the node's ID.
pub(super) fn list_nodes(
    run_root: &Path,
) -> Result<impl Iterator<Item = (u128, PathBuf)> + use<>, LayoutError> {
    Ok(list_names(&nodes_dir(run_root))?
        .filter_map(|(name, path)| Some((parse_node_id(&name)?, path))))
}

/// Returns the connections of a run with the IDs of their endpoints, sender first.
pub(super) fn list_connections(
    run_root: &Path,
) -> Result<impl Iterator<Item = (PathBuf, [u128; 2])> + use<>, LayoutError> {
    Ok(list_names(run_root)?
        .filter_map(|(name, path)| Some((path, parse_connection_endpoints(&name)?))))
}

fn list_names(
    directory: &Path,
) -> Result<impl Iterator<Item = (String, PathBuf)> + use<>, LayoutError> {
    let read_error = |source| LayoutError::ReadDirectory { path: directory.into(), source };
    let entries = fs::read_dir(directory).map_err(read_error)?.flatten();
    Ok(entries.filter_map(|entry| Some((entry.file_name().into_string().ok()?, entry.path()))))
}

/// Parses the IDs of sender and receiver from `<prefix><type>_<sender>_<receiver>.connection`.
fn parse_connection_endpoints(name: &str) -> Option<[u128; 2]> {
    let name = name.strip_prefix(ICEORYX2_PREFIX)?.strip_suffix(".connection")?;
    let (rest, receiver) = name.rsplit_once('_')?;
    let (_, sender) = rest.rsplit_once('_')?;
    Some([sender.parse().ok()?, receiver.parse().ok()?])
}

/// Parses the process ID of the sender from the name of a data segment, `<prefix><type>_<sender>.data`.
pub(crate) fn parse_sender_pid(name: &str) -> Option<u32> {
    let (_, sender) = name.strip_suffix(".data")?.rsplit_once('_')?;
    Some(creator_pid(sender.parse().ok()?))
}

/// Parses the ID of the node to which a file or directory below `nodes/` belongs: `<id>` holds its
/// resources, and `<prefix><id>.node_monitor` and similar files show that it is alive.
fn parse_node_id(name: &str) -> Option<u128> {
    let (stem, _) = name.split_once('.').unwrap_or((name, ""));
    stem.strip_prefix(ICEORYX2_PREFIX).unwrap_or(stem).parse().ok()
}

/// Returns the process that created the ID of a node or a port: its third 32 bits, after seconds and nanoseconds.
pub(super) fn creator_pid(id: u128) -> u32 {
    (id >> 64) as u32
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    const PROCESS: u32 = 77;

    /// Creates a run root as iceoryx2 would, and returns it with its IDs.
    fn create_run_root() -> (tempfile::TempDir, PortAndNodeIds, PathBuf) {
        let root = tempfile::tempdir().unwrap();
        let id = |time_s: u128| u128::from(PROCESS) << 64 | time_s;
        let ids = PortAndNodeIds { process: PROCESS, node: id(1), sender: id(2), receiver: id(3) };
        fs::create_dir_all(nodes_dir(root.path()).join(ids.node.to_string())).unwrap();
        let monitor = format!("{ICEORYX2_PREFIX}{}.node_monitor", ids.node);
        fs::write(nodes_dir(root.path()).join(monitor), "").unwrap();
        let name = format!("{ICEORYX2_PREFIX}a_A-_{}_{}.connection", ids.sender, ids.receiver);
        let connection = root.path().join(name);
        fs::write(&connection, "").unwrap();
        fs::set_permissions(&connection, fs::Permissions::from_mode(COMPLETE_PERMISSIONS)).unwrap();
        (root, ids, connection)
    }

    #[test]
    fn unknown_layout_error_names_expected_and_found_files() {
        let (root, ids, connection) = create_run_root();
        verify_files(root.path(), ids).unwrap();
        let connections = list_connections(root.path()).unwrap().collect::<Vec<_>>();
        assert_eq!(connections, [(connection.clone(), [ids.sender, ids.receiver])]);
        let layout_error =
            |ids: PortAndNodeIds| verify_files(root.path(), ids).unwrap_err().to_string();
        let assert_contains = |error: &str, parts: &[&str]| {
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
        };
        assert_contains(
            &layout_error(PortAndNodeIds { process: PROCESS + 1, ..ids }),
            &["process 78 within the id"],
        );
        layout_error(PortAndNodeIds { sender: ids.receiver, receiver: ids.sender, ..ids });
        fs::set_permissions(&connection, fs::Permissions::from_mode(0o640)).unwrap();
        assert_contains(&layout_error(ids), &["of mode 600", "(640)", ICEORYX2_VERSION]);
        fs::rename(&connection, connection.with_extension("channel")).unwrap();
        assert_contains(
            &layout_error(ids),
            &[&format!("{}_{}.connection", ids.sender, ids.receiver), ".channel ("],
        );
        // Ids in hexadecimal.
        let nodes = nodes_dir(root.path());
        fs::rename(nodes.join(ids.node.to_string()), nodes.join(format!("{:x}", ids.node)))
            .unwrap();
        assert_contains(&layout_error(ids), &[&format!("a directory {}", ids.node)]);
    }
}
