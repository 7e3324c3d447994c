/* A controller in C that goes to its slot by the inverse of the front point's map (17). It answers only while
 * the data of its in-neighbors agree with its own error. (13) */

#include <math.h>
#include <stdio.h>
#include <string.h>

#include <phalanx.h>

struct place {
    double k_per_s;
};

/* Returns the own front point minus the mean of the slots that the in-neighbors imply. */
static phalanx_vector error_of(const phalanx_situation *seen) {
    phalanx_vector error = seen->front_point;
    for (size_t i = 0; i < seen->neighbor_count; i++) {
        const phalanx_neighbor *heard = &seen->neighbors[i];
        error.x -= (heard->position.x + heard->offset.x) / (double)seen->neighbor_count;
        error.y -= (heard->position.y + heard->offset.y) / (double)seen->neighbor_count;
    }
    return error;
}

static int answer(const phalanx_situation *seen, phalanx_twist *out, void *user) {
    const struct place *law = user;
    phalanx_vector error = error_of(seen);
    double ux = seen->desired_velocity.x - law->k_per_s * seen->error.x;
    double uy = seen->desired_velocity.y - law->k_per_s * seen->error.y;
    double c = cos(seen->pose.heading_rad), s = sin(seen->pose.heading_rad);
    double ahead_x = seen->pose.x_m + seen->front_point_m * c;
    if (hypot(error.x - seen->error.x, error.y - seen->error.y) > 1e-9 || seen->neighbor_count == 0 ||
        fabs(ahead_x - seen->front_point.x) > 1e-9) {
        return 2;
    }
    for (size_t i = 0; i < seen->neighbor_count; i++) {
        if (seen->neighbors[i].contact != PHALANX_FRESH || strlen(seen->neighbors[i].name) != 2) {
            return 3;
        }
    }
    for (size_t i = 0; i < seen->near_count; i++) {
        double away = hypot(seen->near[i].x - seen->front_point.x, seen->near[i].y - seen->front_point.y);
        if (away < 0.3) {
            return 4;
        }
    }
    out->v_m_s = c * ux + s * uy;
    out->w_rad_s = (c * uy - s * ux) / seen->front_point_m;
    return 0;
}

int main(int argc, char **argv) {
    phalanx_robot *robot = phalanx_open(argc, argv);
    struct place law = {phalanx_gain(robot, "k_per_s")};
    return phalanx_serve_controller(robot, answer, &law);
}
