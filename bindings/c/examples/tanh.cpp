// The law formation-tanh in C++: gamma = -k tanh(e) + alpha*'. (28)

#include <phalanx.hpp>

namespace {

/// The law of one robot. Each robot is a process with its own object, which may have state.
struct Tanh {
    double k_m_s; // maximum correction along each axis

    /// Returns the desired velocity of the front point, m/s. Called once for every sample.
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
