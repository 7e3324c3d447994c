// A program that requests a gain that its law does not have, or, with SERVES_NONE, serves no law.

#include <phalanx.h>

int main(int argc, char **argv) {
    phalanx_robot *robot = phalanx_open(argc, argv);
#ifdef SERVES_NONE
    return phalanx_serve_law(robot, nullptr, nullptr);
#else
    return phalanx_gain(robot, "k_f") > 0.0;
#endif
}
