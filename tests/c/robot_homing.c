/* SPDX-License-Identifier: MIT */
/* The walk home against a unicycle that the host sees late, sometimes not at all, and whose wheels
 * are not what they should be. argv[1]: of 48 goals, only each of so many. */
#include "homing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "robot_check.h"

#define MS UINT64_C(1000000)
#define PI 3.14159265358979
#define STEP_MM 0.1288
#define AXLE_MM 53.0
#define STEP_NS (100 * MS)
#define LATENCY 12 /* [10 ms] from the host's picture to the wheels */

struct place {
    double x_mm, y_mm, yaw_rad;
};

static double wrap(double angle_rad)
{
    return remainder(angle_rad, 2.0 * PI);
}

/* The goal as the host tells it to who stands there; who has come near only turns. */
static void look(const struct place *robot, const struct place *goal, struct vs_state *state,
                 int *near)
{
    double x = goal->x_mm - robot->x_mm, y = goal->y_mm - robot->y_mm;
    double c = cos(robot->yaw_rad), s = sin(robot->yaw_rad);

    *near = hypot(x, y) < (*near ? 15.0 : 8.0);
    if (*near)
        x = y = 0.0;
    state->goal_x_mm = (int16_t)lround(c * x + s * y);
    state->goal_y_mm = (int16_t)lround(c * y - s * x);
    state->goal_heading = (int16_t)lround(wrap(goal->yaw_rad - robot->yaw_rad) * 1e4);
}

/* Ten milliseconds of wheels, the left one's factor above 1. */
static void roll(struct place *robot, const struct vs_base_command *command, double factor)
{
    double left = command->left_steps_s * STEP_MM * factor * 0.01;
    double right = command->right_steps_s * STEP_MM / factor * 0.01;

    robot->yaw_rad += (right - left) / AXLE_MM;
    robot->x_mm += (left + right) / 2.0 * cos(robot->yaw_rad);
    robot->y_mm += (left + right) / 2.0 * sin(robot->yaw_rad);
}

/* Drives for 30 s at most; how long it took to stand there for good [s]. */
static double drive(const struct place *goal, double factor, uint32_t lost_percent)
{
    struct vs_homing homing;
    struct vs_state state;
    struct vs_base_command command;
    struct place robot = {0.0, 0.0, 0.0}, then[LATENCY];
    uint32_t random = 7;
    uint64_t seen_ns = 0;
    double arrived_s = 30.0;
    int near = 0;
    int i;

    memset(&homing, 0, sizeof homing);
    memset(&state, 0, sizeof state);
    memset(&command, 0, sizeof command);
    memset(then, 0, sizeof then);
    for (i = 0; i < 3000; i++) {
        uint64_t now_ns = (1000 + (uint64_t)i * 10) * MS;

        if (i % 10 == 0 && draw(&random, 100) >= lost_percent) {
            look(&then[i % LATENCY], goal, &state, &near);
            seen_ns = now_ns - LATENCY * 10 * MS;
        }
        if (i % 10 == 0 && seen_ns != 0) {
            vs_homing_steer(&homing, &state, now_ns - seen_ns, now_ns, &command);
            vs_homing_note(&homing, &command, now_ns);
        }
        then[i % LATENCY] = robot;
        roll(&robot, &command, factor);
        if (hypot(goal->x_mm - robot.x_mm, goal->y_mm - robot.y_mm) > 15.0 ||
            fabs(wrap(goal->yaw_rad - robot.yaw_rad)) > 0.05)
            arrived_s = 30.0;
        else if (arrived_s >= 30.0)
            arrived_s = i * 0.01;
    }
    return arrived_s;
}

static void test_arrives_from_everywhere(int step)
{
    static const double factors[] = {1.0, 1.025, 0.975};
    int i, k;

    for (i = 0; i < 48; i += step) {
        double bearing = i * PI / 24.0;
        double far_mm = i % 3 == 0 ? 30.0 : i % 3 == 1 ? 300.0 : 1000.0;
        struct place goal = {far_mm * cos(bearing), far_mm * sin(bearing), i * 2.4};

        for (k = 0; k < 3; k++) {
            CHECK(drive(&goal, factors[k], 0) < 6.0 + far_mm / 100.0);
            CHECK(drive(&goal, factors[k], 30) < 7.0 + far_mm / 100.0);
        }
    }
}

static void steer_to(double x_mm, double y_mm, double heading, struct vs_base_command *command)
{
    struct vs_homing homing;
    struct vs_state state;

    memset(&homing, 0, sizeof homing);
    memset(&state, 0, sizeof state);
    memset(command, 0, sizeof *command);
    state.goal_x_mm = (int16_t)x_mm;
    state.goal_y_mm = (int16_t)y_mm;
    state.goal_heading = (int16_t)(heading * 1e4);
    vs_homing_steer(&homing, &state, 0, 2000 * MS, command);
}

/* On the spot to what lies beside and behind, and at the goal; everything to the proper side. */
static void test_turns_to_the_side_of_the_goal(void)
{
    struct vs_base_command command;
    int i;

    for (i = 1; i < 36; i++) {
        double angle = i * PI / 36.0;

        steer_to(20000.0 * cos(angle), 20000.0 * sin(angle), -1.0, &command);
        CHECK(command.right_steps_s > command.left_steps_s);
        CHECK((command.right_steps_s == -command.left_steps_s) == (angle > 1.0));
        steer_to(20000.0 * cos(angle), -20000.0 * sin(angle), 1.0, &command);
        CHECK(command.right_steps_s < command.left_steps_s);
        steer_to(3.0, 2.0, angle, &command);
        CHECK(command.right_steps_s > 0 && command.right_steps_s == -command.left_steps_s);
    }
    steer_to(0.0, 0.0, 0.0, &command);
    CHECK(command.left_steps_s == 0 && command.right_steps_s == 0);
    steer_to(40.0, 0.0, 3.0, &command); /* 1.5 mm/s for each mm */
    CHECK(fabs(command.left_steps_s * STEP_MM - 60.0) < 5.0);
    CHECK(command.left_steps_s == command.right_steps_s);
}

/* No goal, no age and no history makes wheels turn faster than 1000 steps/s, or numbers
 * overflow: the sanitizers look. */
static void test_any_goal(void)
{
    struct vs_homing homing;
    struct vs_state state;
    struct vs_base_command command;
    uint32_t random = 11;
    int i;

    memset(&homing, 0, sizeof homing);
    memset(&state, 0, sizeof state);
    memset(&command, 0, sizeof command);
    for (i = 0; i < 100000; i++) {
        uint64_t now_ns = (5000 + (uint64_t)i * 40) * MS;

        state.goal_x_mm = (int16_t)((int)draw(&random, 65536) - 32768);
        state.goal_y_mm = (int16_t)((int)draw(&random, 65536) - 32768);
        state.goal_heading = (int16_t)((int)draw(&random, 65536) - 32768);
        vs_homing_steer(&homing, &state, draw(&random, 8) ? draw(&random, 2000) * MS : UINT64_MAX,
                        now_ns, &command);
        CHECK(command.left_steps_s <= 1000 && command.left_steps_s >= -1000);
        CHECK(command.right_steps_s <= 1000 && command.right_steps_s >= -1000);
        vs_homing_note(&homing, &command, now_ns);
    }
}

int main(int argc, char *argv[])
{
    test_arrives_from_everywhere(argc > 1 ? (int)strtol(argv[1], NULL, 10) : 1);
    test_turns_to_the_side_of_the_goal();
    test_any_goal();
    return 0;
}
