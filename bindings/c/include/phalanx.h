/* C interface of Phalanx's agent, for control laws in C or C++.
 *
 * A program opens the robot that its command line names, reads the gains of its law, and serves the law:
 *
 *     int answer(const phalanx_situation *seen, phalanx_vector *out, void *user);
 *
 *     int main(int argc, char **argv) {
 *         phalanx_robot *robot = phalanx_open(argc, argv);
 *         struct my_law law = {phalanx_gain(robot, "k_f_m_s")};
 *         return phalanx_serve_law(robot, answer, &law);
 *     }
 *
 * SI units; positions and velocities are in the frame `map`, headings counter-clockwise from x. Link with
 * -lphalanx_agent; header, library and the program `phalanx` must be of the same release. cbindgen generates
 * this header from bindings/c/src/abi.rs. */

#ifndef PHALANX_H
#define PHALANX_H

#include <stddef.h>
#include <stdint.h>

// Contact state of a neighbor: its beacons are recent.
#define PHALANX_FRESH 1

// Contact state of a neighbor: its beacons are stale, and its position is extrapolated by its velocity.
#define PHALANX_STALE 2

// Contact state of a neighbor: it is lost, because its beacons have timed out.
#define PHALANX_LOST 3

// Message of a neighbor's law, in the format that the scenario declares: see phalanx_numbers and phalanx_bytes.
typedef struct phalanx_message phalanx_message;

// Message, target and signals that a law sends and records with its answer.
typedef struct phalanx_outbox phalanx_outbox;

// The robot that this process controls.
typedef struct phalanx_robot phalanx_robot;

// A position (m) or a velocity (m/s), in `map`.
typedef struct phalanx_vector {
  // Component to the right.
  double x;
  // Component upwards.
  double y;
} phalanx_vector;

// A pose of the axle mid-point, in `map`.
typedef struct phalanx_pose {
  // Position, x, m.
  double x_m;
  // Position, y, m.
  double y_m;
  // Heading, counter-clockwise from x, rad, in (-pi, pi].
  double heading_rad;
} phalanx_pose;

// A twist of the body.
typedef struct phalanx_twist {
  // Forward speed, m/s.
  double v_m_s;
  // Turn rate, rad/s, counter-clockwise.
  double w_rad_s;
  // Lateral speed, m/s, to the left; 0 unless the robot is omnidirectional.
  double side_m_s;
} phalanx_twist;

// State of one neighbor, as known from its beacons.
typedef struct phalanx_neighbor {
  // Name of the neighbor in the scenario.
  const char *name;
  // Front point, m: extrapolated by its velocity to the sample; for a lost neighbor, to the time at which it
  // was declared lost.
  struct phalanx_vector position;
  // Published velocity, m/s; zero for a lost neighbor.
  struct phalanx_vector velocity;
  // Desired position relative to the neighbor, m, rotated and scaled with the formation. (20)
  struct phalanx_vector offset;
  // Rate of change of the offset, m/s. (22)
  struct phalanx_vector offset_velocity;
  // Age of the newest beacon, s. In real time it is negative for a beacon newer than the sample.
  double age_s;
  // Contact state: PHALANX_FRESH, PHALANX_STALE or PHALANX_LOST.
  uint32_t contact;
  // Number of earlier starts of its process: it increases when the neighbor restarts.
  uint64_t incarnation;
  // Newest message of its law in this incarnation; NULL before the first one.
  const struct phalanx_message *message;
  // Age of that message, s; NaN without one.
  double message_age_s;
} phalanx_neighbor;

// Input of a law: what the robot knows at one odometry sample. Valid until the function returns.
typedef struct phalanx_situation {
  // Front point minus its target by the robot's role, m. (13) (32)
  struct phalanx_vector error;
  // Velocity of that target, m/s.
  struct phalanx_vector desired_velocity;
  // Pose of the robot.
  struct phalanx_pose pose;
  // Front point of the robot, m.
  struct phalanx_vector front_point;
  // Distance of the front point ahead of the axle, m.
  double front_point_m;
  // Twist of the robot at the sample.
  struct phalanx_twist twist;
  // Time since the start of the run, s.
  double t_s;
  // Control period, s.
  double period_s;
  // Front points of the robots in sensing range, m, nearest first.
  const struct phalanx_vector *near;
  // Length of `near`.
  size_t near_count;
  // Neighbors from which a beacon was received at least once, including lost ones.
  const struct phalanx_neighbor *neighbors;
  // Length of `neighbors`.
  size_t neighbor_count;
  // Destination of phalanx_publish and the other functions that send or record.
  struct phalanx_outbox *outbox;
} phalanx_situation;

// A control law: writes the desired velocity of the front point, m/s, to `out` and returns 0. It is called once
// for every odometry sample, in order, but not while the robot has no reference. A return value other than 0 and
// numbers that are not finite end the process. A C++ exception must not leave it: it would end the process
// without a message (phalanx.hpp catches them). `user` is the argument of phalanx_serve_law.
typedef int (*phalanx_gamma)(const struct phalanx_situation *seen, struct phalanx_vector *out, void *user);

// A controller, one level lower than a law: writes the desired twist of the body to `out`. Calls and errors are
// as for phalanx_gamma.
typedef int (*phalanx_steer)(const struct phalanx_situation *seen, struct phalanx_twist *out, void *user);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Opens the robot that the command line names, with the arguments that `phalanx run` adds. If it names none, or
// one of another release, prints an error and ends the process, with exit code 2 or 4. The program's own
// arguments come before those of `phalanx run`, and are not interpreted.
//
// # Safety
//
// `argv` has `argc` strings, as in `main`.
struct phalanx_robot *phalanx_open(int argc,
                                   char **argv);

// Returns the gain `key` of the robot's law, one of `gains` in the scenario's `[laws.NAME]`, in the unit that
// its name ends in. If there is none, prints an error and ends the process, with exit code 1.
//
// # Safety
//
// `robot` comes from phalanx_open and is not served yet; `key` is a string.
double phalanx_gain(const struct phalanx_robot *robot,
                    const char *key);

// Controls the robot with a law until the end of the run. Returns the exit code of the process: 0 at the end of
// the run, 4 if a resource is missing. `user` is passed to every call of `law`. Frees the robot.
//
// # Safety
//
// `robot` comes from phalanx_open and is not served yet; `law` may be called with `user`.
int phalanx_serve_law(struct phalanx_robot *robot,
                      phalanx_gamma law,
                      void *user);

// Controls the robot with a controller until the end of the run. Returns the exit code of the process: 0 at the
// end of the run, 4 if a resource is missing. `user` is passed to every call of `controller`. Frees the robot.
//
// # Safety
//
// `robot` comes from phalanx_open and is not served yet; `controller` may be called with `user`.
int phalanx_serve_controller(struct phalanx_robot *robot,
                             phalanx_steer controller,
                             void *user);

// Copies the numbers of the array `key` of a message to `out`, row by row, at most `count`. Returns how many numbers
// the array has; 0 if the message has no such array.
//
// # Safety
//
// `message` is that of a neighbor, in the call of the law; `key` is a string; `out` has room for `count` numbers.
size_t phalanx_numbers(const struct phalanx_message *message,
                       const char *key,
                       double *out,
                       size_t count);

// Returns the bytes of a message, and writes their number to `length`. They are valid until the law returns.
//
// # Safety
//
// `message` is that of a neighbor, in the call of the law; `length` may be written.
const uint8_t *phalanx_bytes(const struct phalanx_message *message,
                             size_t *length);

// Sets the array `key` of the message that leaves with the present answer to `count` numbers, row by row. A message
// needs all arrays that `message` of `[laws.NAME]` declares. Otherwise the process ends with the reason when the law
// returns, as it does after any wrong call of this and the following functions.
//
// # Safety
//
// `seen` is the input of the law, in its call; `key` is a string; `numbers` has `count` numbers.
void phalanx_publish(const struct phalanx_situation *seen,
                     const char *key,
                     const double *numbers,
                     size_t count);

// Sets the message that leaves with the present answer to bytes, for `message_bytes_max` of `[laws.NAME]`.
//
// # Safety
//
// `seen` is the input of the law, in its call; `bytes` has `length` bytes.
void phalanx_publish_bytes(const struct phalanx_situation *seen,
                           const uint8_t *bytes,
                           size_t length);

// Sends no beacon with the present answer, as in event-triggered control. Needs `withholds = true` in `[laws.NAME]`.
//
// # Safety
//
// `seen` is the input of the law, in its call.
void phalanx_withhold(const struct phalanx_situation *seen);

// Sets where the front point of a robot with `role = "free"` is to be at this sample, m, and the velocity of that
// point, m/s.
//
// # Safety
//
// `seen` is the input of the law, in its call.
void phalanx_target(const struct phalanx_situation *seen,
                    struct phalanx_vector position,
                    struct phalanx_vector velocity);

// Records the value of a signal, one of `signals` in `[laws.NAME]`.
//
// # Safety
//
// `seen` is the input of the law, in its call; `signal` is a string.
void phalanx_record(const struct phalanx_situation *seen, const char *signal, double value);

// Returns tanh(x), as the built-in laws compute it. This function and the following ones give the same result on
// every machine; those of the C library may differ in the last digit, which changes the trajectory.
double phalanx_tanh(double x);

// Returns the direction of (x, y), rad, in (-pi, pi].
double phalanx_atan2(double y, double x);

// Returns the cosine of an angle in rad.
double phalanx_cos(double x);

// Returns e^x.
double phalanx_exp(double x);

// Returns the length of (x, y).
double phalanx_hypot(double x, double y);

// Returns the natural logarithm of x.
double phalanx_ln(double x);

// Returns x^y.
double phalanx_pow(double x, double y);

// Returns the sine of an angle in rad.
double phalanx_sin(double x);

#ifdef __cplusplus
} // extern "C"
#endif // __cplusplus

#endif /* PHALANX_H */
