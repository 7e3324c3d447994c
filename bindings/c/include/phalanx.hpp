// C++ interface of the agent, with a control law that is an object. Inputs and results: see phalanx.h.

#ifndef PHALANX_HPP
#define PHALANX_HPP

#include <cstdio>
#include <exception>

#include "phalanx.h"

namespace phalanx {

/// Calls `answer`. Returns 0, or 1 after an exception, whose message it prints.
template <class F> int answered(F answer) noexcept {
    try {
        answer();
        return 0;
    } catch (const std::exception &error) {
        std::fprintf(stderr, "the law threw an exception: %s\n", error.what());
    } catch (...) {
        std::fprintf(stderr, "the law threw something that is no std::exception\n");
    }
    return 1;
}

/// Controls the robot with `law.gamma(seen)`, the desired velocity of the front point, m/s, until the end of the
/// run. Returns the exit code of the process. An exception ends the process.
template <class L> int serve_law(phalanx_robot *robot, L &law) {
    const phalanx_gamma gamma = [](const phalanx_situation *seen, phalanx_vector *out, void *user) {
        return answered([&] { *out = static_cast<L *>(user)->gamma(*seen); });
    };
    return phalanx_serve_law(robot, gamma, &law);
}

/// Controls the robot with `controller.twist(seen)`, the desired twist of the body, until the end of the run.
/// Returns the exit code of the process. An exception ends the process.
template <class C> int serve_controller(phalanx_robot *robot, C &controller) {
    const phalanx_steer steer = [](const phalanx_situation *seen, phalanx_twist *out, void *user) {
        return answered([&] { *out = static_cast<C *>(user)->twist(*seen); });
    };
    return phalanx_serve_controller(robot, steer, &controller);
}

} // namespace phalanx

#endif
