//! Forwarding of status and latencies from robots to the supervisor on the plant's host: received here, sent
//! until they are acknowledged, and published there in place of the robots.

use std::collections::VecDeque;

use protocol::brief::BridgeBrief;
use protocol::dropped::DropReason;
use protocol::latency;
use protocol::message::{LatencyHeader, LatencyRow, StatusHeader};
use protocol::service::{self, Node, Publisher, Subscriber};

use super::ports::{PortError, deliver_slice, receive_encoded_slice};
use crate::unacked_queue::{RecordKind, RecordReceiver, StatusRecord, UnackedQueue};

/// Maximum number of records published at once for each robot: the supervisor's queues hold more.
const PUBLISHED_RECORDS_MAX: usize = 4;

/// Both ends of the forwarding: the robots' host and the plant's host.
pub struct StatusForwarder {
    /// Robots of this host, if the plant is on another host.
    local_robots: Vec<LocalRobot>,
    /// Records of these robots.
    pub queue: UnackedQueue,
    /// Ports of each robot of another host, if the plant is on this host.
    remote_robots: Vec<Option<RemoteRobot>>,
    /// Received part of the records of each host.
    receivers: Vec<RecordReceiver>,
}

struct LocalRobot {
    robot: usize,
    status: Subscriber<[u8], StatusHeader>,
    latency: Subscriber<[LatencyRow], LatencyHeader>,
}

struct RemoteRobot {
    host: usize,
    status: Publisher<[u8], StatusHeader>,
    latency: Publisher<[LatencyRow], LatencyHeader>,
    /// Records that are not published yet.
    unpublished_records: VecDeque<StatusRecord>,
}

impl StatusForwarder {
    /// Opens the ports of this host.
    pub fn open(brief: &BridgeBrief, node: &Node) -> Result<StatusForwarder, PortError> {
        let has_plant = brief.here == brief.plant;
        let (mut local_robots, mut remote_robots) = (Vec::new(), Vec::new());
        for (robot, bridged_robot) in brief.robots.iter().enumerate() {
            let status = service::status_topic(&bridged_robot.name);
            let latency = service::latency_topic(&bridged_robot.name);
            remote_robots.push(None);
            if bridged_robot.host == brief.here && !has_plant {
                let status = status.open(node)?.subscriber()?;
                let latency = latency.open(node)?.subscriber()?;
                local_robots.push(LocalRobot { robot, status, latency });
            } else if bridged_robot.host != brief.here && has_plant {
                let rows_max =
                    latency::recorder_capacity(latency::robot_rows_per_tick(bridged_robot.hears));
                let message_bytes_max =
                    if brief.records_messages { bridged_robot.message_bytes_max } else { 0 };
                let status_bytes_max =
                    StatusHeader::payload_bytes_max(bridged_robot.hears, message_bytes_max);
                remote_robots[robot] = Some(RemoteRobot {
                    host: bridged_robot.host,
                    status: status.open(node)?.publisher(status_bytes_max)?,
                    latency: latency.open(node)?.publisher(rows_max)?,
                    unpublished_records: VecDeque::new(),
                });
            }
        }
        let receivers = brief.hosts.iter().map(|_| RecordReceiver::default()).collect();
        Ok(StatusForwarder {
            local_robots,
            queue: UnackedQueue::default(),
            remote_robots,
            receivers,
        })
    }

    /// Receives records of the robots of this host. Returns the batch to send now, if any.
    pub fn next_batch(&mut self, now_ns: u64) -> Result<Option<Vec<u8>>, PortError> {
        for &LocalRobot { robot, ref status, ref latency } in &self.local_robots {
            while let Some(content) = receive_encoded_slice(status)? {
                self.queue.push(StatusRecord { kind: RecordKind::Status, robot, content });
            }
            while let Some(content) = receive_encoded_slice(latency)? {
                self.queue.push(StatusRecord { kind: RecordKind::Latency, robot, content });
            }
        }
        Ok(if self.local_robots.is_empty() { None } else { self.queue.next_batch(now_ns) })
    }

    /// Receives a batch of another host's bridge. Returns the indices of the robots that sent its new records.
    pub fn receive_batch(
        &mut self,
        host: usize,
        boot: u64,
        batch: &[u8],
    ) -> Result<Vec<usize>, DropReason> {
        let records = self.receivers[host].receive_batch(boot, batch).ok_or(DropReason::Garbage)?;
        let is_on_host = |record: &StatusRecord| {
            let remote_robot = self.remote_robots.get(record.robot).and_then(Option::as_ref);
            remote_robot.is_some_and(|remote_robot| remote_robot.host == host)
        };
        if !records.iter().all(is_on_host) {
            return Err(DropReason::WrongSender);
        }
        let robots = records.iter().map(|record| record.robot).collect();
        for record in records {
            self.remote_robots[record.robot]
                .as_mut()
                .expect("just looked at")
                .unpublished_records
                .push_back(record);
        }
        Ok(robots)
    }

    /// Publishes records of robots of other hosts, no faster than the supervisor reads them. Returns the reasons
    /// for records that were dropped.
    pub fn publish_records(&mut self) -> Result<Vec<DropReason>, PortError> {
        let mut dropped = Vec::new();
        for remote_robot in self.remote_robots.iter_mut().flatten() {
            for _ in 0..PUBLISHED_RECORDS_MAX {
                let Some(StatusRecord { kind, content, .. }) =
                    remote_robot.unpublished_records.pop_front()
                else {
                    break;
                };
                let delivered = match kind {
                    RecordKind::Status => deliver_slice(&remote_robot.status, &content),
                    RecordKind::Latency => deliver_slice(&remote_robot.latency, &content),
                };
                match delivered {
                    Err(PortError::Dropped(reason)) => dropped.push(reason),
                    remote_robot => remote_robot?,
                }
            }
        }
        Ok(dropped)
    }

    /// Returns, for each host, the acknowledgment of its records: all of them have been received and published. A
    /// host whose records are acknowledged may end, and with it the run.
    pub fn acknowledgments(&self) -> Vec<(usize, [u64; 2])> {
        let has_unpublished = |host| {
            let mut remote_robots = self.remote_robots.iter().flatten();
            remote_robots.any(|remote_robot| {
                remote_robot.host == host && !remote_robot.unpublished_records.is_empty()
            })
        };
        let receivers =
            self.receivers.iter().enumerate().filter(|&(host, _)| !has_unpublished(host));
        receivers.filter_map(|(host, receiver)| Some((host, receiver.acknowledgment()?))).collect()
    }
}
