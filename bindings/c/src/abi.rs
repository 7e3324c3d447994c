//! What a C program sees and calls. `include/phalanx.h` is made of this file.

use std::ffi::{c_char, c_int, c_void, CStr, OsStr};
use std::io::Write as _;
use std::os::unix::ffi::OsStrExt as _;

use agent::program::{self, LAW_FAILED};
use clap::Parser as _;
use formation::portable_math;
use protocol::brief::AgentBrief;
use protocol::process::{self, exit};

use crate::law::{CLaw, Function};
use crate::words::{without_own, Words, STARTED_BY};

/// Of a neighbour's contact: its beacons are recent.
pub const PHALANX_FRESH: u32 = 1;
/// Of a neighbour's contact: its beacons are old, and it is extrapolated by its velocity.
pub const PHALANX_STALE: u32 = 2;
/// Of a neighbour's contact: it was given up.
pub const PHALANX_LOST: u32 = 3;

/// A position (m) or a velocity (m/s), in `map`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector {
    /// To the right.
    pub x: f64,
    /// Up.
    pub y: f64,
}

/// A pose of the middle of the axle, in `map`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// m.
    pub x_m: f64,
    /// m.
    pub y_m: f64,
    /// Counter-clockwise from x, in (-pi, pi].
    pub heading_rad: f64,
}

/// A twist of the body.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Twist {
    /// Forward speed, m/s.
    pub v_m_s: f64,
    /// Turn rate, rad/s, counter-clockwise.
    pub w_rad_s: f64,
}

/// What is known of one robot that was heard.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Neighbor {
    /// Its name in the scenario.
    pub name: *const c_char,
    /// Its front point, m: extrapolated by its velocity to the sample; of a lost robot, to the moment at
    /// which it was given up.
    pub position: Vector,
    /// The velocity that it publishes, m/s; zero once it is lost.
    pub velocity: Vector,
    /// Where to stand as seen from it, m: turned and scaled as the formation is now. (20)
    pub offset: Vector,
    /// How the offset changes, m/s. (22)
    pub offset_velocity: Vector,
    /// How old its newest beacon is, s; in real time below 0 for one that is newer than the sample.
    pub age_s: f64,
    /// PHALANX_FRESH, PHALANX_STALE or PHALANX_LOST.
    pub contact: u32,
}

/// One odometry sample as a law sees it. It is gone when the function returns.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Situation {
    /// Own front point minus where the robot's role wants it, m. (13) (32)
    pub error: Vector,
    /// The velocity of the place that the role wants, m/s.
    pub desired_velocity: Vector,
    /// Own pose.
    pub pose: Pose,
    /// Own front point, m.
    pub front_point: Vector,
    /// How far the front point lies ahead of the axle, m.
    pub front_point_m: f64,
    /// Own twist in force at the sample.
    pub twist: Twist,
    /// Time since the run's start, s.
    pub t_s: f64,
    /// Time from one answer to the next, s.
    pub period_s: f64,
    /// Front points of the robots sensed near, m, nearest first.
    pub near: *const Vector,
    /// How many they are.
    pub near_count: usize,
    /// Whoever of those that it hears was heard at least once; the lost are among them.
    pub neighbors: *const Neighbor,
    /// How many they are.
    pub neighbor_count: usize,
}

/// A law: writes the velocity that the front point is to have, m/s, to `out`, and returns 0. Asked once for
/// every odometry sample, in their order, but not while the robot has nothing to go by. Anything but 0, and
/// numbers that are not finite, end the process. An exception of C++ must not leave it: it would end the
/// process too, and nobody would say why (phalanx.hpp does). `user` is what was given to
/// phalanx_serve_law.
pub type Gamma = Option<
    unsafe extern "C-unwind" fn(
        seen: *const Situation,
        out: *mut Vector,
        user: *mut c_void,
    ) -> c_int,
>;

/// A controller, one level lower than a law: writes the twist that the body is to have to `out`. The rest is
/// as for phalanx_gamma.
pub type Steer = Option<
    unsafe extern "C-unwind" fn(
        seen: *const Situation,
        out: *mut Twist,
        user: *mut c_void,
    ) -> c_int,
>;

/// The robot that this process is to be.
pub struct Robot {
    words: Words,
    brief: AgentBrief,
}

/// Opens the robot that the command line names: what `phalanx run` starts a scenario's program with. If it
/// names none, or one of another release, that is said and the process ends, with exit code 2 or 4. Arguments of the
/// program's own come before those that `phalanx run` adds, and are left to the program.
///
/// # Safety
///
/// `argv` has `argc` strings, as those of `main`.
#[no_mangle]
pub unsafe extern "C" fn phalanx_open(argc: c_int, argv: *mut *mut c_char) -> *mut Robot {
    // SAFETY: as the caller promises.
    let given = (0..argc).map(|i| unsafe { CStr::from_ptr(*argv.offset(i as isize)) });
    let given = given.map(|word| OsStr::from_bytes(word.to_bytes()).to_owned());
    let words = match Words::try_parse_from(without_own(given.collect())) {
        Ok(words) => words,
        Err(usage) => {
            let _ = writeln!(process::Stderr, "{usage}{STARTED_BY}");
            std::process::exit(exit::USAGE.into());
        }
    };
    match program::read(&words.brief, LIBRARY) {
        Ok(brief) => Box::into_raw(Box::new(Robot { words, brief })),
        Err(why) => fail(exit::INFRASTRUCTURE, &why),
    }
}

/// The gain `key` of the robot's law, one of `gains` in the scenario's `[laws.NAME]`, in the unit that its name
/// ends in. If there is none, that is said and the process ends, with exit code 1.
///
/// # Safety
///
/// `robot` is of phalanx_open and not served yet; `key` is a string.
#[no_mangle]
pub unsafe extern "C" fn phalanx_gain(robot: *const Robot, key: *const c_char) -> f64 {
    // SAFETY: as the caller promises.
    let (brief, key) = unsafe { (&(*robot).brief, CStr::from_ptr(key).to_string_lossy()) };
    brief.gains.get(key.as_ref()).copied().unwrap_or_else(|| {
        let known: Vec<&str> = brief.gains.keys().map(String::as_str).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        fail(
            LAW_FAILED,
            &format!("the law {:?} has no gain {key:?}; its gains: {known}", brief.law),
        )
    })
}

/// Moves the robot by a law until the run is over. Returns the exit code of the process: 0 at the end of the
/// run, 4 for want of anything that it needs. `user` is given to `law` at every call. The robot is gone then.
///
/// # Safety
///
/// `robot` is of phalanx_open and not served yet; `law` may be called with `user`.
#[no_mangle]
pub unsafe extern "C" fn phalanx_serve_law(
    robot: *mut Robot,
    law: Gamma,
    user: *mut c_void,
) -> c_int {
    // SAFETY: as the caller promises.
    unsafe { serve(robot, law.map(Function::Gamma), user) }
}

/// The same by a controller.
///
/// # Safety
///
/// As of phalanx_serve_law.
#[no_mangle]
pub unsafe extern "C" fn phalanx_serve_controller(
    robot: *mut Robot,
    controller: Steer,
    user: *mut c_void,
) -> c_int {
    // SAFETY: as the caller promises.
    unsafe { serve(robot, controller.map(Function::Steer), user) }
}

/// What must be of one version with the program that starts it.
const LIBRARY: &str = "its libphalanx_agent";

/// # Safety
///
/// As of [`phalanx_serve_law`].
unsafe fn serve(robot: *mut Robot, function: Option<Function>, user: *mut c_void) -> c_int {
    // SAFETY: it is a box of `phalanx_open`, and nobody else's any more.
    let Robot { words, .. } = *unsafe { Box::from_raw(robot) };
    let code =
        program::main(&words.brief, words.incarnation, words.realtime_priority, LIBRARY, |brief| {
            let function = function.ok_or_else(|| format!("the law {:?} is NULL", brief.law))?;
            // SAFETY: as the caller promises.
            Ok(unsafe { CLaw::new(function, user, brief) })
        });
    code.into()
}

/// Says why and ends the process.
fn fail(code: u8, why: &str) -> ! {
    process::log_to_stderr();
    tracing::error!("{why}");
    std::process::exit(code.into())
}

/// tanh as the built-in laws have it. It and the functions below are the same on every machine; those of the C
/// library may differ in the last digit, and with it the trajectory.
#[no_mangle]
pub extern "C" fn phalanx_tanh(x: f64) -> f64 {
    portable_math::tanh(x)
}

/// The direction of (x, y), rad, in (-pi, pi].
#[no_mangle]
pub extern "C" fn phalanx_atan2(y: f64, x: f64) -> f64 {
    portable_math::atan2(y, x)
}

/// Of an angle in rad.
#[no_mangle]
pub extern "C" fn phalanx_cos(x: f64) -> f64 {
    portable_math::cos(x)
}

/// e^x.
#[no_mangle]
pub extern "C" fn phalanx_exp(x: f64) -> f64 {
    portable_math::exp(x)
}

/// The length of (x, y).
#[no_mangle]
pub extern "C" fn phalanx_hypot(x: f64, y: f64) -> f64 {
    portable_math::hypot(x, y)
}

/// The natural logarithm.
#[no_mangle]
pub extern "C" fn phalanx_ln(x: f64) -> f64 {
    portable_math::ln(x)
}

/// x^y.
#[no_mangle]
pub extern "C" fn phalanx_pow(x: f64, y: f64) -> f64 {
    portable_math::pow(x, y)
}

/// Of an angle in rad.
#[no_mangle]
pub extern "C" fn phalanx_sin(x: f64) -> f64 {
    portable_math::sin(x)
}
