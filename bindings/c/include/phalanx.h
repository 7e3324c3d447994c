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
