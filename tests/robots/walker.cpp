// Keeps the last readings in a vector, and turns away from what it has seen in them.
#include "controller.h"

#include <algorithm>
#include <new>
#include <vector>

namespace {

constexpr std::size_t kept = 5;

struct Walker {
    int proximity = 0;
    std::vector<double> highest;

    explicit Walker(vs_robot *robot) : proximity(vs_robot_sensor(robot, "proximity")) {}

    void step(vs_robot *robot)
    {
        double prox[8] = {};

        vs_robot_values(robot, proximity, prox, 8);
        highest.push_back(*std::max_element(prox, prox + 8));
        if (highest.size() > kept)
            highest.erase(highest.begin());
        const bool is_free =
            std::all_of(highest.begin(), highest.end(), [](double raw) { return raw < 150.0; });
        vs_robot_show(robot, "kept", static_cast<double>(highest.size()));
        vs_robot_set_wheels(robot, 300, is_free ? 300 : -300);
    }
};

void init(void *state, vs_robot *robot)
{
    // The state is plain zeros here: the class begins in it.
    new (state) Walker(robot);
}

void step(void *state, vs_robot *robot)
{
    static_cast<Walker *>(state)->step(robot);
}

}  // namespace

const struct vs_controller vs_controller = {"walker", sizeof(Walker), init, step, nullptr};
