// A law that works until 1 s; then it fails in the way that the macro FAILS_BY selects.

#include <cmath>
#include <stdexcept>

#include <phalanx.hpp>

namespace {

[[maybe_unused]] int returns_a_code(phalanx_vector *) { return 7; }

[[maybe_unused]] int answers_nothing(phalanx_vector *) { return 0; }

[[maybe_unused]] int returns_nan(phalanx_vector *out) {
    *out = {std::nan(""), 0.5};
    return 0;
}

[[maybe_unused]] int throws(phalanx_vector *) { throw std::runtime_error("my law is at its end"); }

int answer(const phalanx_situation *seen, phalanx_vector *out, void *) {
    if (seen->t_s >= 1.0) {
        return FAILS_BY(out);
    }
    *out = seen->desired_velocity;
    return 0;
}

[[maybe_unused]] struct Law {
    phalanx_vector gamma(const phalanx_situation &seen) {
        phalanx_vector out;
        answer(&seen, &out, nullptr);
        return out;
    }
} law;

} // namespace

int main(int argc, char **argv) {
    phalanx_robot *robot = phalanx_open(argc, argv);
#ifdef OBJECT
    return phalanx::serve_law(robot, law);
#else
    return phalanx_serve_law(robot, answer, nullptr);
#endif
}
