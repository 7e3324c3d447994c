//! What robots tell the supervisor, from their host to the plant's: taken here, sent until it is confirmed, and handed on
//! there in the robots' place.

use std::collections::VecDeque;

use protocol::brief::BridgeBrief;
use protocol::dropped::Dropped;
use protocol::latency;
use protocol::message::{LatencyHeader, LatencyRow, NeighborStatus, StatusHeader};
use protocol::service::{self, Node, Publisher, Subscriber};

use super::ports::{PortError, deliver_slice, next_slice};
use crate::told::{Heard, Kind, Log, Record};

/// What is told is handed on so much at a time for each robot: the supervisor's queues hold more.
const AT_ONCE_MAX: usize = 4;

/// Both ends of it.
pub struct Telling {
    /// The robots of this host, if the plant is elsewhere.
    own: Vec<OwnRobot>,
    /// What they told.
    pub log: Log,
    /// By robot, those of other hosts, if the plant is here.
    others: Vec<Option<OtherRobot>>,
    /// What arrived of other hosts' logs.
    heard: Vec<Heard>,
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
    /// What was not handed on yet.
    waiting: VecDeque<Record>,
}

impl Telling {
    /// The ports of this host.
    pub fn open(brief: &BridgeBrief, node: &Node) -> Result<Telling, PortError> {
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
        let heard = brief.hosts.iter().map(|_| Heard::default()).collect();
        Ok(Telling { own, log: Log::default(), others, heard })
    }

    /// Takes in what the robots of this host tell; what of it is to be sent now.
    pub fn batch(&mut self, now_ns: u64) -> Result<Option<Vec<u8>>, PortError> {
        for &OwnRobot { robot, ref status, ref latency } in &self.own {
            while let Some(content) = next_slice(status)? {
                self.log.push(Record { kind: Kind::Status, robot, content });
            }
            while let Some(content) = next_slice(latency)? {
                self.log.push(Record { kind: Kind::Latency, robot, content });
            }
        }
        Ok(if self.own.is_empty() { None } else { self.log.batch(now_ns) })
    }

    /// Takes in a batch of another host's bridge; the robots that told something.
    pub fn take(&mut self, host: usize, boot: u64, batch: &[u8]) -> Result<Vec<usize>, Dropped> {
        let records = self.heard[host].take(boot, batch).ok_or(Dropped::Garbage)?;
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

    /// Hands on what other hosts' robots told, no faster than the supervisor takes it; why some of it was dropped.
    pub fn hand_on(&mut self) -> Result<Vec<Dropped>, PortError> {
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

    /// Up to where the log of each host has arrived and all of it was handed on: a host that is confirmed may end, and
    /// the run with it.
    pub fn confirmed(&self) -> Vec<(usize, [u64; 2])> {
        let waits = |host| {
            let mut others = self.others.iter().flatten();
            others.any(|other| other.host == host && !other.waiting.is_empty())
        };
        let heard = self.heard.iter().enumerate().filter(|&(host, _)| !waits(host));
        heard.filter_map(|(host, heard)| Some((host, heard.confirmed()?))).collect()
    }
}
