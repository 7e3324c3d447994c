// The law formation-tanh in C++: gamma = -k tanh(e) + alpha*'. (28)

#include <phalanx.hpp>

namespace {

/// One robot's law: each robot is a process, and has its own. It may keep state.
struct Tanh {
    double k_m_s; // largest correction along each axis

    /// The velocity that the front point is to have, m/s. Asked once for every sample.
    phalanx_vector gamma(const phalanx_situation &seen) {
        const auto [ex, ey] = seen.error;
        const auto [vx, vy] = seen.desired_velocity;
        return {-k_m_s * phalanx_tanh(ex) + vx, -k_m_s * phalanx_tanh(ey) + vy};
    }
};

} // namespace

int main(int argc, char **argv) {
    phalanx_robot *robot = phalanx_open(argc, argv);
    Tanh law{phalanx_gain(robot, "k_f_m_s")};
    return phalanx::serve_law(robot, law);
}
