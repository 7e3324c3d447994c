//! Surviving graph after failures: the remaining in-neighbors, the robots that stop, and the robots that the leader
//! reaches.

use formation::Vec2;
use formation::graph::Edge;
use protocol::brief::SilencePolicy;
use protocol::law::Reference;

use super::{Broken, Cause, Predictor};

/// Surviving formation after failures.
///
/// Positions have two halves: those of the robots, and after them the last known position of each, which the policies
/// `keep` and `last` use.
#[derive(Debug)]
pub(super) struct SurvivingGraph {
    pub(super) alive: Vec<bool>,
    /// In-neighbors that each robot uses, with c_ji, m, including backup neighbors. Empty for dead robots and for
    /// robots that stop.
    pub(super) heard: Vec<Vec<(usize, Vec2)>>,
    /// First lost in-neighbor of each robot.
    pub(super) lost: Vec<Option<usize>>,
    /// Leader whose slot each robot takes, if it does.
    pub(super) takes: Vec<Option<usize>>,
    /// Robots that use each robot.
    hearers: Vec<Vec<usize>>,
    /// Robots that lead: the main leader, or backup leaders that no leader of a better rank reaches.
    pub(super) leads: Vec<bool>,
    pub(super) moving: bool,
}

/// Surviving in-neighbors of one robot.
#[derive(Debug, Default)]
pub(super) struct SurvivingNeighbors {
    pub(super) heard: Vec<(usize, Vec2)>,
    pub(super) lost: Option<usize>,
    pub(super) takes: Option<usize>,
}

impl SurvivingNeighbors {
    /// Returns the in-neighbors that robot `i`, which is alive, uses after the robots `dead` have failed and the edges
    /// `cut` are down.
    pub(super) fn compute(
        p: &Predictor,
        i: usize,
        dead: &[usize],
        cut: &[usize],
    ) -> SurvivingNeighbors {
        let mut row = SurvivingNeighbors::default();
        if p.robots[i].reference.is_local() {
            return row;
        }
        let (n, rewiring) = (p.robots.len(), &p.rewiring);
        let (receiver, incoming) = (rewiring.receiver(i), rewiring.incoming(i));
        let sender = |place: usize| {
            let Edge { from, offset_m, .. } = rewiring.links()[incoming[place]];
            (from, offset_m)
        };
        let references = rewiring.references(i, dead, cut);
        let replacements = receiver.replacements(&references);
        let mut stops = false;
        for (place, &link) in incoming.iter().enumerate().take(receiver.in_neighbors()) {
            let (from, offset_m) = sender(place);
            if !rewiring.is_silent(link, dead, cut) {
                row.heard.push((from, offset_m));
                continue;
            }
            row.lost.get_or_insert(from);
            if references.uses(place) {
                // Lost and not replaced.
                stops = p.robots[i].silence == SilencePolicy::Stop;
                if p.robots[i].silence == SilencePolicy::Keep {
                    row.heard.push((n + from, offset_m));
                }
            }
            let instead = replacements.iter().filter(|one| one.lost == place);
            row.heard.extend(instead.map(|one| sender(one.by)));
        }
        match p.robots[i].silence {
            SilencePolicy::Stop if stops => row.heard.clear(),
            // Without any in-neighbor, the last known positions of all.
            SilencePolicy::Last if row.heard.is_empty() => {
                let last = |place| {
                    let (from, offset_m) = sender(place);
                    (n + from, offset_m)
                };
                row.heard = (0..receiver.in_neighbors()).map(last).collect();
            }
            _ => {}
        }
        if references.takes_slot {
            row.takes = replacements.first().map(|one| sender(one.lost).0);
            row.heard = replacements.iter().map(|one| sender(one.by)).collect();
        }
        row
    }
}

impl SurvivingGraph {
    /// Computes the surviving graph without these robots and edges. `moving`: the formation moves.
    pub(super) fn compute(
        p: &Predictor,
        dead: &[usize],
        cut: &[usize],
        moving: bool,
    ) -> SurvivingGraph {
        let n = p.robots.len();
        let mut surviving = SurvivingGraph {
            alive: (0..n).map(|i| !dead.contains(&i)).collect(),
            heard: vec![Vec::new(); n],
            lost: vec![None; n],
            takes: vec![None; n],
            hearers: vec![Vec::new(); n],
            leads: vec![false; n],
            moving,
        };
        for i in (0..n).filter(|i| !dead.contains(i)) {
            let row = SurvivingNeighbors::compute(p, i, dead, cut);
            (surviving.heard[i], surviving.lost[i], surviving.takes[i]) =
                (row.heard, row.lost, row.takes);
            for &(from, _) in surviving.heard[i].iter().filter(|(from, _)| *from < n) {
                surviving.hearers[from].push(i);
            }
        }
        for robot in p.rewiring.leading(p.leader, &p.deputies, dead, cut) {
            // A leader uses no in-neighbors.
            surviving.leads[robot] = true;
            surviving.heard[robot].clear();
            surviving.hearers.iter_mut().for_each(|hearers| hearers.retain(|&i| i != robot));
        }
        surviving
    }

    /// Returns the positions of the robots and their last known positions.
    pub(super) fn settled_positions(&self, planned: &[Vec2]) -> Vec<Vec2> {
        [planned, planned].concat()
    }

    /// Returns the robots that use one of `sources` directly or indirectly, and these.
    pub(super) fn downstream(&self, sources: &[usize]) -> Vec<bool> {
        let mut reached = vec![false; self.heard.len()];
        let mut open = sources.to_vec();
        while let Some(robot) = open.pop() {
            if !std::mem::replace(&mut reached[robot], true) {
                open.extend(self.hearers[robot].iter().filter(|&&next| !reached[next]));
            }
        }
        reached
    }

    /// Returns the living robots that use others, and the groups among them without in-edges from outside. One robot of
    /// each group is left out, because a fixed point is needed to settle the others.
    pub(super) fn free_robots(&self, p: &Predictor) -> (Vec<usize>, Vec<Vec<usize>>) {
        let n = self.heard.len();
        let living = || (0..n).filter(|&i| self.alive[i]);
        let kept = |i: usize| self.heard[i].iter().any(|&(from, _)| from >= n);
        let anchored =
            |i: &usize| self.heard[*i].is_empty() || kept(*i) || p.robots[*i].reference.is_local();
        let mut reached = self.downstream(&living().filter(anchored).collect::<Vec<_>>());
        let (mut pinned, mut groups) = (Vec::new(), Vec::new());
        while let Some(first) = living().find(|&i| !reached[i]) {
            let group = self.closed_group(first);
            let from = self.downstream(&group);
            reached.iter_mut().zip(from).for_each(|(reached, from)| *reached |= from);
            pinned.push(group[0]);
            groups.push(group);
        }
        let free =
            living().filter(|&i| !self.heard[i].is_empty() && !pinned.contains(&i)).collect();
        (free, groups)
    }

    /// Returns a group that receives nothing from outside itself and that reaches `robot`, in order. No robot that
    /// receives from none may reach `robot`.
    fn closed_group(&self, mut robot: usize) -> Vec<usize> {
        loop {
            let group = self.upstream(robot);
            // A member that `robot` does not reach is reached by fewer: by itself and some of the group.
            let below = self.downstream(&[robot]);
            match group.iter().find(|&&member| !below[member]) {
                Some(&member) => robot = member,
                None => return group,
            }
        }
    }

    /// Returns the robots that this robot uses directly or indirectly, and the robot itself, in order.
    fn upstream(&self, robot: usize) -> Vec<usize> {
        let mut reached = vec![false; self.heard.len()];
        let mut open = vec![robot];
        while let Some(robot) = open.pop() {
            if !std::mem::replace(&mut reached[robot], true) {
                let heard = self.heard[robot].iter().map(|&(from, _)| from);
                open.extend(heard.filter(|&from| from < reached.len() && !reached[from]));
            }
        }
        (0..reached.len()).filter(|&i| reached[i]).collect()
    }

    /// Returns the robots that a moving formation leaves behind, and those that they hold back. None in a formation at
    /// rest.
    pub(super) fn left_behind(&self, p: &Predictor) -> Vec<Option<Broken>> {
        let n = self.heard.len();
        let mut causes = vec![None; n];
        let (Some(leader), true) = (p.leader, self.moving) else { return causes };
        let follows = |i: usize| p.robots[i].reference.is_local() || self.leads[i];
        let leads: Vec<usize> = (0..n).filter(|&i| self.alive[i] && follows(i)).collect();
        let led = self.downstream(&leads);
        let places: Vec<usize> = (0..n)
            .filter(|&i| self.alive[i] && p.robots[i].reference != Reference::Middle)
            .collect();
        let held = self.downstream(&places);
        let kept = |i: usize| self.heard[i].iter().find(|&&(from, _)| from >= n);
        let behind = |&i: &usize| self.alive[i] && !follows(i) && (!led[i] || kept(i).is_some());
        let behind: Vec<usize> = (0..n).filter(behind).collect();
        let dragged = self.downstream(&behind);
        for i in (0..n).filter(|&i| self.alive[i] && !follows(i) && dragged[i]) {
            let contained = p.robots[i].reference == Reference::Middle;
            let cause = if self.heard[i].is_empty()
                && let Some(lost) = self.lost[i]
            {
                Cause::Stops { lost }
            } else if let Some(&(lost, _)) = kept(i)
                && self.heard[i].iter().all(|&(from, _)| from >= n)
            {
                Cause::Kept { lost: lost - n }
            } else if contained && !held[i] {
                Cause::Uncontained
            } else if !led[i] {
                Cause::Unled { leader }
            } else if let Some(&(lost, _)) = kept(i) {
                Cause::Kept { lost: lost - n }
            } else {
                let stray = |&&(from, _): &&(usize, Vec2)| dragged[from];
                let by = self.heard[i].iter().find(stray);
                Cause::Pulled { by: by.map_or(leader, |&(by, _)| by) }
            };
            causes[i] = Some(Broken { robot: i, cause, off_m: None, outside_m: None });
        }
        causes
    }
}
