//! C interface of the agent. cbindgen generates `include/phalanx.h` from this file.

use std::ffi::{c_char, c_int, c_void, CStr, OsStr};
use std::io::Write as _;
use std::os::unix::ffi::OsStrExt as _;

use agent::laws::ReceivedMessage;
use agent::program::{self, LAW_FAILED_EXIT_CODE};
use clap::Parser as _;
use formation::desired::Target;
use formation::portable_math;
use formation::Vec2;
use protocol::brief::AgentBrief;
use protocol::process::{self, exit};

use crate::command_line::{strip_own_arguments, Arguments, MANUAL_START_HINT};
use crate::law::{CLaw, UserFunction};
use crate::outbox::LawCalls;

/// Contact state of a neighbor: its beacons are recent.
pub const PHALANX_FRESH: u32 = 1;
/// Contact state of a neighbor: its beacons are stale, and its position is extrapolated by its velocity.
pub const PHALANX_STALE: u32 = 2;
/// Contact state of a neighbor: it is lost, because its beacons have timed out.
pub const PHALANX_LOST: u32 = 3;

/// A position (m) or a velocity (m/s), in `map`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector {
    /// Component to the right.
    pub x: f64,
    /// Component upwards.
    pub y: f64,
}

/// A pose of the axle mid-point, in `map`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Position, x, m.
    pub x_m: f64,
    /// Position, y, m.
    pub y_m: f64,
    /// Heading, counter-clockwise from x, rad, in (-pi, pi].
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
    /// Lateral speed, m/s, to the left; 0 unless the robot is omnidirectional.
    pub side_m_s: f64,
}

/// State of one neighbor, as known from its beacons.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Neighbor {
    /// Name of the neighbor in the scenario.
    pub name: *const c_char,
    /// Front point, m: extrapolated by its velocity to the sample; for a lost neighbor, to the time at which it
    /// was declared lost.
    pub position: Vector,
    /// Published velocity, m/s; zero for a lost neighbor.
    pub velocity: Vector,
    /// Desired position relative to the neighbor, m, rotated and scaled with the formation. (20)
    pub offset: Vector,
    /// Rate of change of the offset, m/s. (22)
    pub offset_velocity: Vector,
    /// Age of the newest beacon, s. In real time it is negative for a beacon newer than the sample.
    pub age_s: f64,
    /// Contact state: PHALANX_FRESH, PHALANX_STALE or PHALANX_LOST.
    pub contact: u32,
    /// Number of earlier starts of its process: it increases when the neighbor restarts.
    pub incarnation: u64,
    /// Newest message of its law in this incarnation; NULL before the first one.
    pub message: *const Message,
    /// Age of that message, s; NaN without one.
    pub message_age_s: f64,
}

/// Message of a neighbor's law, in the format that the scenario declares: see phalanx_numbers and phalanx_bytes.
pub struct Message(pub(crate) ReceivedMessage);

/// Message, target and signals that a law sends and records with its answer.
pub struct Outbox(pub(crate) LawCalls);

/// Input of a law: what the robot knows at one odometry sample. Valid until the function returns.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct Situation {
    /// Front point minus its target by the robot's role, m. (13) (32)
    pub error: Vector,
    /// Velocity of that target, m/s.
    pub desired_velocity: Vector,
    /// Pose of the robot.
    pub pose: Pose,
    /// Front point of the robot, m.
    pub front_point: Vector,
    /// Distance of the front point ahead of the axle, m.
    pub front_point_m: f64,
    /// Twist of the robot at the sample.
    pub twist: Twist,
    /// Time since the start of the run, s.
    pub t_s: f64,
    /// Control period, s.
    pub period_s: f64,
    /// Front points of the robots in sensing range, m, nearest first.
    pub near: *const Vector,
    /// Length of `near`.
    pub near_count: usize,
    /// Neighbors from which a beacon was received at least once, including lost ones.
    pub neighbors: *const Neighbor,
    /// Length of `neighbors`.
    pub neighbor_count: usize,
    /// Destination of phalanx_publish and the other functions that send or record.
    pub outbox: *mut Outbox,
}

/// A control law: writes the desired velocity of the front point, m/s, to `out` and returns 0. It is called once
/// for every odometry sample, in order, but not while the robot has no reference. A return value other than 0 and
/// numbers that are not finite end the process. A C++ exception must not leave it: it would end the process
/// without a message (phalanx.hpp catches them). `user` is the argument of phalanx_serve_law.
pub type Gamma = Option<
    unsafe extern "C-unwind" fn(
        seen: *const Situation,
        out: *mut Vector,
        user: *mut c_void,
    ) -> c_int,
>;

/// A controller, one level lower than a law: writes the desired twist of the body to `out`. Calls and errors are
/// as for phalanx_gamma.
pub type Steer = Option<
    unsafe extern "C-unwind" fn(
        seen: *const Situation,
        out: *mut Twist,
        user: *mut c_void,
    ) -> c_int,
>;

/// The robot that this process controls.
pub struct Robot {
    arguments: Arguments,
    brief: AgentBrief,
}

/// Opens the robot that the command line names, with the arguments that `phalanx run` adds. If it names none, or
/// one of another release, prints an error and ends the process, with exit code 2 or 4. The program's own
/// arguments come before those of `phalanx run`, and are not interpreted.
///
/// # Safety
///
/// `argv` has `argc` strings, as in `main`.
#[no_mangle]
pub unsafe extern "C" fn phalanx_open(argc: c_int, argv: *mut *mut c_char) -> *mut Robot {
    // SAFETY: guaranteed by the caller.
    let given = (0..argc).map(|i| unsafe { CStr::from_ptr(*argv.offset(i as isize)) });
    let given = given.map(|argument| OsStr::from_bytes(argument.to_bytes()).to_owned());
    let arguments = match Arguments::try_parse_from(strip_own_arguments(given.collect())) {
        Ok(arguments) => arguments,
        Err(usage) => {
            let _ = writeln!(process::Stderr, "{usage}{MANUAL_START_HINT}");
            std::process::exit(exit::USAGE_ERROR.into());
        }
    };
    match program::read_brief(&arguments.brief, LIBRARY_NAME) {
        Ok(brief) => Box::into_raw(Box::new(Robot { arguments, brief })),
        Err(why) => exit_with_error(exit::INFRASTRUCTURE_FAILURE, &why),
    }
}

/// Returns the gain `key` of the robot's law, one of `gains` in the scenario's `[laws.NAME]`, in the unit that
/// its name ends in. If there is none, prints an error and ends the process, with exit code 1.
///
/// # Safety
///
/// `robot` comes from phalanx_open and is not served yet; `key` is a string.
#[no_mangle]
pub unsafe extern "C" fn phalanx_gain(robot: *const Robot, key: *const c_char) -> f64 {
    // SAFETY: guaranteed by the caller.
    let (brief, key) = unsafe { (&(*robot).brief, CStr::from_ptr(key).to_string_lossy()) };
    brief.gains.get(key.as_ref()).copied().unwrap_or_else(|| {
        let known: Vec<&str> = brief.gains.keys().map(String::as_str).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        exit_with_error(
            LAW_FAILED_EXIT_CODE,
            &format!("the law {:?} has no gain {key:?}; its gains: {known}", brief.law),
        )
    })
}

/// Controls the robot with a law until the end of the run. Returns the exit code of the process: 0 at the end of
/// the run, 4 if a resource is missing. `user` is passed to every call of `law`. Frees the robot.
///
/// # Safety
///
/// `robot` comes from phalanx_open and is not served yet; `law` may be called with `user`.
#[no_mangle]
pub unsafe extern "C" fn phalanx_serve_law(
    robot: *mut Robot,
    law: Gamma,
    user: *mut c_void,
) -> c_int {
    // SAFETY: guaranteed by the caller.
    unsafe { serve(robot, law.map(UserFunction::Law), user) }
}

/// Controls the robot with a controller until the end of the run. Returns the exit code of the process: 0 at the
/// end of the run, 4 if a resource is missing. `user` is passed to every call of `controller`. Frees the robot.
///
/// # Safety
///
/// `robot` comes from phalanx_open and is not served yet; `controller` may be called with `user`.
#[no_mangle]
pub unsafe extern "C" fn phalanx_serve_controller(
    robot: *mut Robot,
    controller: Steer,
    user: *mut c_void,
) -> c_int {
    // SAFETY: guaranteed by the caller.
    unsafe { serve(robot, controller.map(UserFunction::Controller), user) }
}

/// Component whose version must equal that of the program that starts it, as error messages name it.
const LIBRARY_NAME: &str = "its libphalanx_agent";

/// Controls the robot with a function until the end of the run.
///
/// # Safety
///
/// As for [`phalanx_serve_law`].
unsafe fn serve(robot: *mut Robot, function: Option<UserFunction>, user: *mut c_void) -> c_int {
    // SAFETY: it is a box made by `phalanx_open`, which the caller no longer uses.
    let Robot { arguments, .. } = *unsafe { Box::from_raw(robot) };
    let code = program::main(
        &arguments.brief,
        arguments.incarnation,
        arguments.realtime_priority,
        LIBRARY_NAME,
        |brief| {
            let function = function.ok_or_else(|| format!("the law {:?} is NULL", brief.law))?;
            // SAFETY: guaranteed by the caller.
            Ok(unsafe { CLaw::new(function, user, brief) })
        },
    );
    code.into()
}

/// Logs an error and ends the process with this exit code.
fn exit_with_error(code: u8, why: &str) -> ! {
    process::log_to_stderr();
    tracing::error!("{why}");
    std::process::exit(code.into())
}

/// Copies the numbers of the array `key` of a message to `out`, row by row, at most `count`. Returns how many numbers
/// the array has; 0 if the message has no such array.
///
/// # Safety
///
/// `message` is that of a neighbor, in the call of the law; `key` is a string; `out` has room for `count` numbers.
#[no_mangle]
pub unsafe extern "C" fn phalanx_numbers(
    message: *const Message,
    key: *const c_char,
    out: *mut f64,
    count: usize,
) -> usize {
    // SAFETY: guaranteed by the caller.
    let (message, key) = unsafe { (&(*message).0, CStr::from_ptr(key).to_string_lossy()) };
    let numbers = message.numbers(&key).unwrap_or_default();
    for (i, number) in numbers.iter().take(count).enumerate() {
        // SAFETY: guaranteed by the caller.
        unsafe { *out.add(i) = *number };
    }
    numbers.len()
}

/// Returns the bytes of a message, and writes their number to `length`. They are valid until the law returns.
///
/// # Safety
///
/// `message` is that of a neighbor, in the call of the law; `length` may be written.
#[no_mangle]
pub unsafe extern "C" fn phalanx_bytes(message: *const Message, length: *mut usize) -> *const u8 {
    // SAFETY: guaranteed by the caller.
    let bytes = unsafe { &(*message).0.bytes };
    // SAFETY: guaranteed by the caller.
    unsafe { *length = bytes.len() };
    bytes.as_ptr()
}

/// Sets the array `key` of the message that leaves with the present answer to `count` numbers, row by row. A message
/// needs all arrays that `message` of `[laws.NAME]` declares. Otherwise the process ends with the reason when the law
/// returns, as it does after any wrong call of this and the following functions.
///
/// # Safety
///
/// `seen` is the input of the law, in its call; `key` is a string; `numbers` has `count` numbers.
#[no_mangle]
pub unsafe extern "C" fn phalanx_publish(
    seen: *const Situation,
    key: *const c_char,
    numbers: *const f64,
    count: usize,
) {
    // SAFETY: guaranteed by the caller.
    let (outbox, key) = unsafe { (&mut *(*seen).outbox, CStr::from_ptr(key).to_string_lossy()) };
    // SAFETY: guaranteed by the caller.
    outbox.0.publish(&key, unsafe { slice(numbers, count) });
}

/// Sets the message that leaves with the present answer to bytes, for `message_bytes_max` of `[laws.NAME]`.
///
/// # Safety
///
/// `seen` is the input of the law, in its call; `bytes` has `length` bytes.
#[no_mangle]
pub unsafe extern "C" fn phalanx_publish_bytes(
    seen: *const Situation,
    bytes: *const u8,
    length: usize,
) {
    // SAFETY: guaranteed by the caller.
    unsafe { (*(*seen).outbox).0.publish_bytes(slice(bytes, length)) }
}

/// Sends no beacon with the present answer, as in event-triggered control. Needs `withholds = true` in `[laws.NAME]`.
///
/// # Safety
///
/// `seen` is the input of the law, in its call.
#[no_mangle]
pub unsafe extern "C" fn phalanx_withhold(seen: *const Situation) {
    // SAFETY: guaranteed by the caller.
    unsafe { (*(*seen).outbox).0.withhold() }
}

/// Sets where the front point of a robot with `role = "free"` is to be at this sample, m, and the velocity of that
/// point, m/s.
///
/// # Safety
///
/// `seen` is the input of the law, in its call.
#[no_mangle]
pub unsafe extern "C" fn phalanx_target(
    seen: *const Situation,
    position: Vector,
    velocity: Vector,
) {
    let vector = |at: Vector| Vec2::new(at.x, at.y);
    let target = Target { position: vector(position), velocity: vector(velocity) };
    // SAFETY: guaranteed by the caller.
    unsafe { (*(*seen).outbox).0.set_target(target) }
}

/// Records the value of a signal, one of `signals` in `[laws.NAME]`.
///
/// # Safety
///
/// `seen` is the input of the law, in its call; `signal` is a string.
#[no_mangle]
pub unsafe extern "C" fn phalanx_record(seen: *const Situation, signal: *const c_char, value: f64) {
    // SAFETY: guaranteed by the caller.
    let (outbox, signal) =
        unsafe { (&mut *(*seen).outbox, CStr::from_ptr(signal).to_string_lossy()) };
    outbox.0.record(&signal, value);
}

/// Returns the elements at `first`; none if `count` is 0, also for NULL.
///
/// # Safety
///
/// `first` has `count` elements.
unsafe fn slice<'a, T>(first: *const T, count: usize) -> &'a [T] {
    match count {
        0 => &[],
        // SAFETY: guaranteed by the caller.
        _ => unsafe { std::slice::from_raw_parts(first, count) },
    }
}

/// Returns tanh(x), as the built-in laws compute it. This function and the following ones give the same result on
/// every machine; those of the C library may differ in the last digit, which changes the trajectory.
#[no_mangle]
pub extern "C" fn phalanx_tanh(x: f64) -> f64 {
    portable_math::tanh(x)
}

/// Returns the direction of (x, y), rad, in (-pi, pi].
#[no_mangle]
pub extern "C" fn phalanx_atan2(y: f64, x: f64) -> f64 {
    portable_math::atan2(y, x)
}

/// Returns the cosine of an angle in rad.
#[no_mangle]
pub extern "C" fn phalanx_cos(x: f64) -> f64 {
    portable_math::cos(x)
}

/// Returns e^x.
#[no_mangle]
pub extern "C" fn phalanx_exp(x: f64) -> f64 {
    portable_math::exp(x)
}

/// Returns the length of (x, y).
#[no_mangle]
pub extern "C" fn phalanx_hypot(x: f64, y: f64) -> f64 {
    portable_math::hypot(x, y)
}

/// Returns the natural logarithm of x.
#[no_mangle]
pub extern "C" fn phalanx_ln(x: f64) -> f64 {
    portable_math::ln(x)
}

/// Returns x^y.
#[no_mangle]
pub extern "C" fn phalanx_pow(x: f64, y: f64) -> f64 {
    portable_math::pow(x, y)
}

/// Returns the sine of an angle in rad.
#[no_mangle]
pub extern "C" fn phalanx_sin(x: f64) -> f64 {
    portable_math::sin(x)
}
