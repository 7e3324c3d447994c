/* Phalanx's agent with a law of your own, in C or C++.
 *
 * A program opens the robot that its command line names, asks for the gains of its law, and serves:
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
 * -lphalanx_agent; header, library and the program `phalanx` must be of one release. cbindgen makes this
 * header from bindings/c/src/abi.rs. */

#ifndef PHALANX_H
#define PHALANX_H

#include <stddef.h>
#include <stdint.h>

// Of a neighbour's contact: its beacons are recent.
#define PHALANX_FRESH 1

// Of a neighbour's contact: its beacons are old, and it is extrapolated by its velocity.
#define PHALANX_STALE 2

// Of a neighbour's contact: it was given up.
#define PHALANX_LOST 3

// The robot that this process is to be.
typedef struct phalanx_robot phalanx_robot;

// A position (m) or a velocity (m/s), in `map`.
typedef struct phalanx_vector {
  // To the right.
  double x;
  // Up.
  double y;
} phalanx_vector;

// A pose of the middle of the axle, in `map`.
typedef struct phalanx_pose {
  // m.
  double x_m;
  // m.
  double y_m;
  // Counter-clockwise from x, in (-pi, pi].
  double heading_rad;
} phalanx_pose;

// A twist of the body.
typedef struct phalanx_twist {
  // Forward speed, m/s.
  double v_m_s;
  // Turn rate, rad/s, counter-clockwise.
  double w_rad_s;
} phalanx_twist;

// What is known of one robot that was heard.
typedef struct phalanx_neighbor {
  // Its name in the scenario.
  const char *name;
  // Its front point, m: extrapolated by its velocity to the sample; of a lost robot, to the moment at
  // which it was given up.
  struct phalanx_vector position;
  // The velocity that it publishes, m/s; zero once it is lost.
  struct phalanx_vector velocity;
  // Where to stand as seen from it, m: turned and scaled as the formation is now. (20)
  struct phalanx_vector offset;
  // How the offset changes, m/s. (22)
  struct phalanx_vector offset_velocity;
  // How old its newest beacon is, s; in real time below 0 for one that is newer than the sample.
  double age_s;
  // PHALANX_FRESH, PHALANX_STALE or PHALANX_LOST.
  uint32_t contact;
} phalanx_neighbor;

// One odometry sample as a law sees it. It is gone when the function returns.
typedef struct phalanx_situation {
  // Own front point minus where the robot's role wants it, m. (13) (32)
  struct phalanx_vector error;
  // The velocity of the place that the role wants, m/s.
  struct phalanx_vector desired_velocity;
  // Own pose.
  struct phalanx_pose pose;
  // Own front point, m.
  struct phalanx_vector front_point;
  // How far the front point lies ahead of the axle, m.
  double front_point_m;
  // Own twist in force at the sample.
  struct phalanx_twist twist;
  // Time since the run's start, s.
  double t_s;
  // Time from one answer to the next, s.
  double period_s;
  // Front points of the robots sensed near, m, nearest first.
  const struct phalanx_vector *near;
  // How many they are.
  size_t near_count;
  // Whoever of those that it hears was heard at least once; the lost are among them.
  const struct phalanx_neighbor *neighbors;
  // How many they are.
  size_t neighbor_count;
} phalanx_situation;

// A law: writes the velocity that the front point is to have, m/s, to `out`, and returns 0. Asked once for
// every odometry sample, in their order, but not while the robot has nothing to go by. Anything but 0, and
// numbers that are not finite, end the process. An exception of C++ must not leave it: it would end the
// process too, and nobody would say why (phalanx.hpp does). `user` is what was given to
// phalanx_serve_law.
typedef int (*phalanx_gamma)(const struct phalanx_situation *seen, struct phalanx_vector *out, void *user);

// A controller, one level lower than a law: writes the twist that the body is to have to `out`. The rest is
// as for phalanx_gamma.
typedef int (*phalanx_steer)(const struct phalanx_situation *seen, struct phalanx_twist *out, void *user);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Opens the robot that the command line names: what `phalanx run` starts a scenario's program with. If it
// names none, or one of another release, that is said and the process ends, with exit code 2 or 4. Arguments of the
// program's own come before those that `phalanx run` adds, and are left to the program.
//
// # Safety
//
// `argv` has `argc` strings, as those of `main`.
struct phalanx_robot *phalanx_open(int argc,
                                   char **argv);

// The gain `key` of the robot's law, one of `gains` in the scenario's `[laws.NAME]`, in the unit that its name
// ends in. If there is none, that is said and the process ends, with exit code 1.
//
// # Safety
//
// `robot` is of phalanx_open and not served yet; `key` is a string.
double phalanx_gain(const struct phalanx_robot *robot,
                    const char *key);

// Moves the robot by a law until the run is over. Returns the exit code of the process: 0 at the end of the
// run, 4 for want of anything that it needs. `user` is given to `law` at every call. The robot is gone then.
//
// # Safety
//
// `robot` is of phalanx_open and not served yet; `law` may be called with `user`.
int phalanx_serve_law(struct phalanx_robot *robot,
                      phalanx_gamma law,
                      void *user);

// The same by a controller.
//
// # Safety
//
// As of phalanx_serve_law.
int phalanx_serve_controller(struct phalanx_robot *robot, phalanx_steer controller, void *user);

// tanh as the built-in laws have it. It and the functions below are the same on every machine; those of the C
// library may differ in the last digit, and with it the trajectory.
double phalanx_tanh(double x);

// The direction of (x, y), rad, in (-pi, pi].
double phalanx_atan2(double y, double x);

// Of an angle in rad.
double phalanx_cos(double x);

// e^x.
double phalanx_exp(double x);

// The length of (x, y).
double phalanx_hypot(double x, double y);

// The natural logarithm.
double phalanx_ln(double x);

// x^y.
double phalanx_pow(double x, double y);

// Of an angle in rad.
double phalanx_sin(double x);

#ifdef __cplusplus
} // extern "C"
#endif // __cplusplus

#endif /* PHALANX_H */
