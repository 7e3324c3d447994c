/* A consensus filter in C: each robot averages its estimate with those of its in-neighbors, and names it as its target. With
 * WRONG, the message of a later sample is wrong. */

#include <math.h>
#include <string.h>

#include <phalanx.h>

struct filter {
    double k_per_s;
    double estimate[2];
};

static int answer(const phalanx_situation *seen, phalanx_vector *out, void *user) {
    struct filter *law = user;
    double sum[2] = {0.0, 0.0};
    for (size_t i = 0; i < seen->neighbor_count; i++) {
        const phalanx_neighbor *heard = &seen->neighbors[i];
        double x[2];
        if (heard->message == NULL) {
            continue;
        }
        size_t length = 0;
        const uint8_t *bytes = phalanx_bytes(heard->message, &length);
        if (phalanx_numbers(heard->message, "x_m", x, 2) != 2 || phalanx_numbers(heard->message, "y", x, 2) != 0 ||
            length != 24 || memcmp(bytes + 8, &x[0], 8) != 0 || !(heard->message_age_s < 1.0)) {
            return 5;
        }
        sum[0] += x[0] - law->estimate[0];
        sum[1] += x[1] - law->estimate[1];
    }
    law->estimate[0] += seen->period_s * law->k_per_s * sum[0];
    law->estimate[1] += seen->period_s * law->k_per_s * sum[1];
#ifdef WRONG
    if (seen->t_s > 0.5) {
        WRONG;
    }
#endif
    double n = (double)seen->neighbor_count;
    phalanx_publish(seen, "n", &n, 1);
    phalanx_publish(seen, "x_m", law->estimate, 2);
    phalanx_record(seen, "x_m", law->estimate[0]);
    phalanx_target(seen, (phalanx_vector){law->estimate[0], seen->front_point.y}, (phalanx_vector){0.0, 0.0});
    out->x = law->k_per_s * (law->estimate[0] - seen->front_point.x);
    out->y = 0.0;
    return 0;
}

int main(int argc, char **argv) {
    phalanx_robot *robot = phalanx_open(argc, argv);
    struct filter law = {phalanx_gain(robot, "k_per_s"), {phalanx_gain(robot, "start_m"), 0.0}};
    return phalanx_serve_law(robot, answer, &law);
}
