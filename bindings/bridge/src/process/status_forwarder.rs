//! Forwarding of status and latencies from robots to the supervisor on the plant's host: received here, sent
//! until they are acknowledged, and published there in place of the robots.

use std::collections::VecDeque;

use protocol::brief::BridgeBrief;
use protocol::dropped::Dropped;
use protocol::latency;
use protocol::message::{LatencyHeader, LatencyRow, NeighborStatus, StatusHeader};
use protocol::service::{self, Node, Publisher, Subscriber};

use super::ports::{PortError, deliver_slice, next_slice};
use crate::unacked_queue::{Kind, Record, RecordReceiver, UnackedQueue};

/// Maximum number of records published at once for each robot: the supervisor's queues hold more.
const AT_ONCE_MAX: usize = 4;

/// Both ends of the forwarding: the robots' host and the plant's host.
pub struct StatusForwarder {
    /// Robots of this host, if the plant is on another host.
    local_robots: Vec<OwnRobot>,
    /// Records of these robots.
    pub queue: UnackedQueue,
    /// Ports of each robot of another host, if the plant is on this host.
    others: Vec<Option<OtherRobot>>,
    /// Received part of the records of each host.
    receivers: Vec<RecordReceiver>,
}

struct OwnRobot {
    robot: usize,
    status: Subscriber<[NeighborStatus], StatusHeader>,
    latency: Subscriber<[LatencyRow], LatencyHeader>,
}

struct OtherRobot {
    host: usize,
    status: Publisher<[NeighborStatus], StatusHeader>,
    latency: Publisher<[LatencyRow], LatencyHeader>,
    /// Records that are not published yet.
    waiting: VecDeque<Record>,
}

impl StatusForwarder {
    /// Opens the ports of this host.
    pub fn open(brief: &BridgeBrief, node: &Node) -> Result<StatusForwarder, PortError> {
        let has_plant = brief.here == brief.plant;
        let (mut own, mut others) = (Vec::new(), Vec::new());
        for (robot, told) in brief.robots.iter().enumerate() {
            let status = service::status(&told.name);
            let latency = service::latency(&told.name);
            others.push(None);
            if told.host == brief.here && !has_plant {
                let status = status.open(node)?.subscriber()?;
                let latency = latency.open(node)?.subscriber()?;
                own.push(OwnRobot { robot, status, latency });
            } else if told.host != brief.here && has_plant {
                let rows_max = latency::rows_max(3 + 2 * told.hears);
                others[robot] = Some(OtherRobot {
                    host: told.host,
                    status: status.open(node)?.publisher(told.hears)?,
                    latency: latency.open(node)?.publisher(rows_max)?,
                    waiting: VecDeque::new(),
                });
            }
        }
        let heard = brief.hosts.iter().map(|_| RecordReceiver::default()).collect();
        Ok(StatusForwarder {
            local_robots: own,
            queue: UnackedQueue::default(),
            others,
            receivers: heard,
        })
    }

    /// Receives records of the robots of this host. Returns the batch to send now, if any.
    pub fn batch(&mut self, now_ns: u64) -> Result<Option<Vec<u8>>, PortError> {
        for &OwnRobot { robot, ref status, ref latency } in &self.local_robots {
            while let Some(content) = next_slice(status)? {
                self.queue.push(Record { kind: Kind::Status, robot, content });
            }
            while let Some(content) = next_slice(latency)? {
                self.queue.push(Record { kind: Kind::Latency, robot, content });
            }
        }
        Ok(if self.local_robots.is_empty() { None } else { self.queue.batch(now_ns) })
    }

    /// Receives a batch of another host's bridge. Returns the indices of the robots that sent its new records.
    pub fn receive_batch(
        &mut self,
        host: usize,
        boot: u64,
        batch: &[u8],
    ) -> Result<Vec<usize>, Dropped> {
        let records = self.receivers[host].receive_batch(boot, batch).ok_or(Dropped::Garbage)?;
        let lives_there = |record: &Record| {
            let other = self.others.get(record.robot).and_then(Option::as_ref);
            other.is_some_and(|other| other.host == host)
        };
        if !records.iter().all(lives_there) {
            return Err(Dropped::Owner);
        }
        let robots = records.iter().map(|record| record.robot).collect();
        for record in records {
            self.others[record.robot].as_mut().expect("just looked at").waiting.push_back(record);
        }
        Ok(robots)
    }

    /// Publishes records of robots of other hosts, no faster than the supervisor reads them. Returns the reasons
    /// for records that were dropped.
    pub fn publish_records(&mut self) -> Result<Vec<Dropped>, PortError> {
        let mut dropped = Vec::new();
        for other in self.others.iter_mut().flatten() {
            for _ in 0..AT_ONCE_MAX {
                let Some(Record { kind, content, .. }) = other.waiting.pop_front() else { break };
                let delivered = match kind {
                    Kind::Status => deliver_slice(&other.status, &content),
                    Kind::Latency => deliver_slice(&other.latency, &content),
                };
                match delivered {
                    Err(PortError::Dropped(why)) => dropped.push(why),
                    other => other?,
                }
            }
        }
        Ok(dropped)
    }

    /// Returns, for each host, the acknowledgment of its records: all of them have been received and published. A
    /// host whose records are acknowledged may end, and with it the run.
    pub fn acknowledgments(&self) -> Vec<(usize, [u64; 2])> {
        let waits = |host| {
            let mut others = self.others.iter().flatten();
            others.any(|other| other.host == host && !other.waiting.is_empty())
        };
        let heard = self.receivers.iter().enumerate().filter(|&(host, _)| !waits(host));
        heard.filter_map(|(host, heard)| Some((host, heard.acknowledgment()?))).collect()
    }
}
