// Phalanx's agent with a law that is a C++ object. What an object sees and answers: phalanx.h.

#ifndef PHALANX_HPP
#define PHALANX_HPP

#include <cstdio>
#include <exception>

#include "phalanx.h"

namespace phalanx {

/// Calls `answer`; of what it throws, says what it is. Whether it answered: 0 or 1.
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

/// Moves the robot by `law.gamma(seen)`, the velocity of the front point, m/s, until the run is over. Returns
/// the exit code of the process. An exception ends the process.
template <class L> int serve_law(phalanx_robot *robot, L &law) {
    const phalanx_gamma gamma = [](const phalanx_situation *seen, phalanx_vector *out, void *user) {
        return answered([&] { *out = static_cast<L *>(user)->gamma(*seen); });
    };
    return phalanx_serve_law(robot, gamma, &law);
}

/// The same by `controller.twist(seen)`, the twist of the body.
template <class C> int serve_controller(phalanx_robot *robot, C &controller) {
    const phalanx_steer steer = [](const phalanx_situation *seen, phalanx_twist *out, void *user) {
        return answered([&] { *out = static_cast<C *>(user)->twist(*seen); });
    };
    return phalanx_serve_controller(robot, steer, &controller);
}

} // namespace phalanx

#endif
