//! Requests of a client: parsing, validation and response.

use axum::http::StatusCode;
use outcome::report::scene::Scene;
use serde::Deserialize;
use tokio::sync::oneshot;

/// Requested action, by indices in the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequestedAction {
    /// SIGKILL of this robot; it stays dead until it is restarted interactively.
    Kill(usize),
    /// SIGSTOP of this robot.
    Freeze(usize),
    /// SIGCONT of this robot.
    Thaw(usize),
    /// Start of a replacement for this dead robot.
    Restart(usize),
    /// Cut of this edge.
    Cut(usize),
    /// Repair of this edge, after a cut.
    RepairEdge(usize),
}

/// Request of a client, which waits for the response.
#[derive(Debug)]
pub struct ClientRequest {
    /// Requested action.
    pub action: RequestedAction,
    pub(crate) result_sender: oneshot::Sender<Result<(), String>>,
}

impl ClientRequest {
    /// Sends to the client that the action was executed, or why it was not.
    pub fn send_result(self, result: Result<(), String>) {
        // The client may have disconnected.
        let _ = self.result_sender.send(result);
    }
}

/// Request in the form in which a client sends it.
#[derive(Debug, Deserialize)]
#[serde(tag = "act", rename_all = "lowercase", deny_unknown_fields)]
enum ActionRequest {
    Kill { robot: String },
    Freeze { robot: String },
    Thaw { robot: String },
    Restart { robot: String },
    Cut { from: String, to: String },
    Mend { from: String, to: String },
}

/// Parses a request. An unknown request is answered with status 400, and an unknown robot or edge with 404.
pub(crate) fn parse_action(
    body: &[u8],
    scene: &Scene,
) -> Result<RequestedAction, (StatusCode, String)> {
    let request: ActionRequest = serde_json::from_slice(body).map_err(|error| {
        let reason = format!(
            "{error}; expected such as {{\"act\":\"kill\",\"robot\":\"r1\"}} with kill, freeze, thaw \
             or restart, or {{\"act\":\"cut\",\"from\":\"r1\",\"to\":\"r2\"}} with cut or mend"
        );
        (StatusCode::BAD_REQUEST, reason)
    })?;
    let robot_index = |name: &str| {
        let found = scene.robots.iter().position(|robot| robot.name == name);
        found.ok_or_else(|| {
            let names: Vec<&str> = scene.robots.iter().map(|robot| robot.name.as_str()).collect();
            let reason = format!("there is no robot {name:?}; there are {}", names.join(", "));
            (StatusCode::NOT_FOUND, reason)
        })
    };
    let edge_index = |from: &str, to: &str| {
        let endpoints = (robot_index(from)?, robot_index(to)?);
        let found =
            scene.edges.iter().position(|edge| (edge.from, edge.to) == endpoints && !edge.spare);
        found.ok_or_else(|| {
            let reason = format!("there is no edge {from}->{to}: {to} does not hear {from}");
            (StatusCode::NOT_FOUND, reason)
        })
    };
    Ok(match request {
        ActionRequest::Kill { robot: name } => RequestedAction::Kill(robot_index(&name)?),
        ActionRequest::Freeze { robot: name } => RequestedAction::Freeze(robot_index(&name)?),
        ActionRequest::Thaw { robot: name } => RequestedAction::Thaw(robot_index(&name)?),
        ActionRequest::Restart { robot: name } => RequestedAction::Restart(robot_index(&name)?),
        ActionRequest::Cut { from, to } => RequestedAction::Cut(edge_index(&from, &to)?),
        ActionRequest::Mend { from, to } => RequestedAction::RepairEdge(edge_index(&from, &to)?),
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use outcome::report::scene::{SceneEdge, SceneRobot};

    pub(crate) fn two_robots() -> Scene {
        let scene_robot = |name: &str| SceneRobot {
            name: name.into(),
            role: "formation".into(),
            front_point_m: 0.1,
            keep_m: None,
        };
        Scene {
            name: "two".into(),
            pace: "realtime".into(),
            duration_s: 1.0,
            distance_min_m: 0.2,
            robots: vec![scene_robot("a"), scene_robot("b")],
            edges: vec![SceneEdge { from: 1, to: 0, ..SceneEdge::default() }],
            walls: Vec::new(),
            faults: Vec::new(),
            faults_in_all: 0,
        }
    }
}
