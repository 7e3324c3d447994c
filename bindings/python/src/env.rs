//! An episode for training: a lockstep run in this process, with actions from Python.

use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

use agent::controller::{Controller, Parts};
use agent::laws::{self, Law, LawOutput};
use agent::program::AnswerKind;
use experiment::scenario::Scenario;
use experiment::scenario::read::{Overrides, read};
use formation::Vec2;
use formation::drive::DriveKind;
use formation::obstacle::Obstacle;
use outcome::metrics::hash::TrajectoryHash;
use protocol::brief::AgentBrief;
use protocol::message::TruthRow;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use run::in_process::{self, ControllerFactory, InProcessRun};

use crate::outbox::Outbox;
use crate::situation::{InNeighborNames, Situation};

/// One episode of an environment.
#[pyclass(frozen, module = "phalanx")]
pub struct Episode(Mutex<EpisodeState>);

struct EpisodeState {
    run: InProcessRun,
    robots: Vec<Robot>,
    hash: TrajectoryHash,
    period_s: f64,
    speed_max_m_s: f64,
    distance_min_m: f64,
    walls: Vec<Obstacle>,
    seed: u64,
    answer_kind: AnswerKind,
}

/// Pose of a robot as [`Episode::bodies`] returns it: name, x in m, y in m, heading in rad, ell in m, whether its
/// process is alive.
type Body = (String, f64, f64, f64, f64, bool);

struct Robot {
    name: String,
    front_point_m: f64,
    names: InNeighborNames,
    /// Whether the robot's actions come from Python.
    learns: bool,
    /// Messages and target for the robot's next answer, if its actions come from Python.
    outbox: Py<Outbox>,
}

#[pymethods]
impl Episode {
    /// Creates an episode of a scenario with these assignments and faults, before its first step. `robots`: names
    /// of the robots whose actions come from [`Episode::step`]; `None` for all robots.
    #[new]
    fn new(
        scenario: PathBuf,
        set: Vec<String>,
        faults: Vec<String>,
        seed: Option<u64>,
        robots: Option<Vec<String>>,
        twists: bool,
    ) -> PyResult<Episode> {
        let overrides = Overrides { assignments: set, faults, seed };
        let (scenario, ..) = read(&scenario, &overrides, &agent::catalog())
            .map_err(|diagnostic| PyValueError::new_err(diagnostic.render(false)))?;
        let answer_kind =
            if twists { AnswerKind::BodyTwist } else { AnswerKind::FrontPointVelocity };
        let inner =
            EpisodeState::new(scenario, robots, answer_kind).map_err(PyValueError::new_err)?;
        Ok(Episode(Mutex::new(inner)))
    }

    /// Returns name, ell in m and number of in-neighbors of each robot whose actions come from Python.
    #[getter]
    fn robots(&self) -> Vec<(String, f64, usize)> {
        let inner = self.inner();
        let learn = inner.robots.iter().filter(|robot| robot.learns);
        learn.map(|robot| (robot.name.clone(), robot.front_point_m, robot.names.len())).collect()
    }

    #[getter]
    fn period_s(&self) -> f64 {
        self.inner().period_s
    }

    #[getter]
    fn speed_max_m_s(&self) -> f64 {
        self.inner().speed_max_m_s
    }

    /// Smallest distance d between two front points that the scenario allows, m.
    #[getter]
    fn distance_min_m(&self) -> f64 {
        self.inner().distance_min_m
    }

    /// The convex parts of walls and obstacles: corners in m, and a radius in m that is 0 for polygons. A disc has
    /// one corner, its center.
    #[getter]
    fn walls(&self) -> Vec<(Vec<[f64; 2]>, f64)> {
        let part = |wall: &Obstacle| match wall {
            Obstacle::Disc { center_m, radius_m } => (vec![*center_m], *radius_m),
            Obstacle::Polygon { corners_m } => (corners_m.clone(), 0.0),
        };
        self.inner().walls.iter().map(part).collect()
    }

    /// Returns the true pose of every robot, in scenario order.
    fn bodies(&self) -> Vec<Body> {
        let inner = self.inner();
        let states =
            inner.robots.iter().zip(inner.run.world().truth()).zip(inner.run.alive_robots());
        let body = |((robot, row), alive): ((&Robot, TruthRow), &bool)| {
            (robot.name.clone(), row.x_m, row.y_m, row.heading_rad, robot.front_point_m, *alive)
        };
        states.map(body).collect()
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.inner().seed
    }

    #[getter]
    fn is_over(&self) -> bool {
        self.inner().run.is_over()
    }

    #[getter]
    fn trajectory_hash(&self) -> String {
        self.inner().hash.finish()
    }

    /// Returns the current input of a robot's law, or `None` if it has no reference or its process does not take part.
    fn situation(&self, robot: &str) -> PyResult<Option<Situation>> {
        let inner = self.inner();
        let i = inner.index_of(robot)?;
        let situation = inner.run.situation(i);
        Ok(situation.map(|situation| Situation::new(&situation, &inner.robots[i].names)))
    }

    /// Returns the outbox of a robot whose actions come from Python: what it sends with its next answer.
    fn outbox(&self, robot: &str) -> PyResult<Py<Outbox>> {
        let inner = self.inner();
        let i = inner.index_of(robot)?;
        Ok(Python::attach(|py| inner.robots[i].outbox.clone_ref(py)))
    }

    /// Returns whether a robot was killed and will not be restarted.
    fn is_gone(&self, robot: &str) -> PyResult<bool> {
        let inner = self.inner();
        Ok(inner.run.is_permanently_dead(inner.index_of(robot)?))
    }

    /// Applies one action, two numbers, for each robot in `actions`, and advances one period. The other robots
    /// stop.
    fn step(&self, actions: Vec<(String, [f64; 2])>) -> PyResult<()> {
        let mut inner = self.inner();
        let mut outputs = vec![LawOutput::Velocity(Vec2::zeros()); inner.robots.len()];
        for (name, action) in actions {
            let Some(output) = inner.answer_kind.parse_law_output(&action) else {
                let expected = inner.answer_kind.expected_answer();
                let action = format!("({}, {})", action[0], action[1]);
                let why = format!("the action of {name} is {action}, expected {expected}");
                return Err(PyValueError::new_err(why));
            };
            outputs[inner.index_of(&name)?] = output;
        }
        if !inner.run.is_over() {
            inner.step(&outputs);
        }
        Ok(())
    }
}

impl Episode {
    fn inner(&self) -> MutexGuard<'_, EpisodeState> {
        // A panic is an exception in Python, after which the state is not used any more.
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

impl EpisodeState {
    fn new(
        scenario: Scenario,
        robots: Option<Vec<String>>,
        answer_kind: AnswerKind,
    ) -> Result<EpisodeState, String> {
        let names: Vec<&str> = scenario.robots.iter().map(|robot| robot.name.as_str()).collect();
        let mut requested = robots.iter().flatten();
        if let Some(name) = requested.find(|name| !names.contains(&name.as_str())) {
            return Err(format!("no robot is called {name:?}; there are {}", names.join(", ")));
        }
        let learns = move |name: &str| {
            robots.as_ref().is_none_or(|requested| requested.iter().any(|n| n == name))
        };
        let mut all = Vec::new();
        for brief in in_process::agent_briefs(&scenario) {
            controller(&brief, 0, learns(&brief.name))?;
            if answer_kind != AnswerKind::FrontPointVelocity
                && learns(&brief.name)
                && brief.drive_kind == DriveKind::Omni
            {
                return Err(format!(
                    "{} has `drive = \"omni\"`, and actions that are twists have two numbers; expected actions that are \
                     velocities (twists=False)",
                    brief.name
                ));
            }
            all.push(Robot {
                front_point_m: brief.front_point_m,
                names: InNeighborNames::read_in_neighbors(&brief),
                learns: learns(&brief.name),
                outbox: Python::attach(|py| Py::new(py, Outbox::new(&brief)))
                    .map_err(|error| error.to_string())?,
                name: brief.name,
            });
        }
        let (period_s, seed) = (scenario.period_ns as f64 / 1e9, scenario.seed);
        let speed_max_m_s = match scenario.avoidance_method.clamps_speed {
            true => scenario.avoidance.speed_max_m_s,
            false => f64::INFINITY,
        };
        let distance_min_m = scenario.avoidance.distance_min_m;
        let walls = scenario.walls.iter().map(|wall| wall.shape.clone()).collect();
        let make_controller: ControllerFactory =
            Box::new(move |brief: &AgentBrief, incarnation| {
                controller(brief, incarnation, learns(&brief.name)).expect("it was made before")
            });
        let run =
            InProcessRun::new(scenario, make_controller).map_err(|error| error.to_string())?;
        let hash = TrajectoryHash::new();
        let mut inner = EpisodeState {
            run,
            robots: all,
            hash,
            period_s,
            speed_max_m_s,
            distance_min_m,
            walls,
            seed,
            answer_kind,
        };
        inner.sense();
        Ok(inner)
    }

    /// Returns the scenario index of a robot, from 0.
    fn index_of(&self, name: &str) -> PyResult<usize> {
        let found = self.robots.iter().position(|robot| robot.name == name);
        found.ok_or_else(|| PyValueError::new_err(format!("no robot is called {name:?}")))
    }

    fn step(&mut self, outputs: &[LawOutput]) {
        let robots = &self.robots;
        self.run.step(|i, cycle| {
            if !robots[i].learns {
                return cycle.law_output();
            }
            let outbox = robots[i].outbox.get();
            cycle.set_send_decision(outbox.take_send_decision());
            cycle.set_own_target(outbox.take_target());
            outputs[i]
        });
        self.sense();
    }

    /// Hashes the ground truth of the current tick, and lets all robots sense it.
    fn sense(&mut self) {
        let truth: Vec<TruthRow> = self.run.world().truth().collect();
        self.hash.update(self.run.current_tick(), &truth);
        self.run.sense_robots();
    }
}

/// Creates the controller of a robot whose actions come from Python (`is_from_python`), or of one with a built-in law.
fn controller(
    brief: &AgentBrief,
    incarnation: u64,
    is_from_python: bool,
) -> Result<Controller, String> {
    let with_name = |error: &dyn std::fmt::Display| format!("{}: {error}", brief.name);
    if !is_from_python {
        if brief.program.is_some() {
            let (name, law) = (&brief.name, &brief.law);
            return Err(format!(
                "{name} has the law {law:?} of a program, which an environment does not start: \
                 let {name} be one of its agents, or give it another law"
            ));
        }
        return Controller::new(brief, incarnation).map_err(|error| with_name(&error));
    }
    let parts =
        Parts::with_law(brief, Box::new(PlaceholderLaw)).map_err(|error| with_name(&error))?;
    Ok(Controller::with_parts(brief, incarnation, parts))
}

/// Placeholder for the law of a robot whose actions come from Python.
struct PlaceholderLaw;

impl Law for PlaceholderLaw {
    fn gamma(&mut self, _: &laws::Situation<'_>) -> Vec2 {
        Vec2::zeros()
    }
}
