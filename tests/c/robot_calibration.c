/* SPDX-License-Identifier: MIT */
/*
 * calibration.h: what was measured of a robot is taken out of its readings and put into its
 * wheels. Expected: the nominal e-puck's readings (the table of Webots' e-puck, which
 * vsense/world/physics/proximity_ring.py holds) and the kinematics of two wheels on an axle.
 */
#include <math.h>
#include <string.h>

#include "calibration.h"
#include "robot_check.h"

#define PI 3.14159265358979323846
#define WORLDS 4000

static uint32_t seed = 14;

static double between(double least, double most)
{
    return least + (most - least) * draw(&seed, 1000001) / 1e6;
}

static const char *take(struct vs_calibration *c, enum vs_calibrated which, const char *text)
{
    return vs_calibration_take(c, vs_calibration_name(which), text);
}

static struct vs_base_reading make_reading(void)
{
    struct vs_base_reading reading;
    int i;

    memset(&reading, 0, sizeof reading);
    for (i = 0; i < 8; i++) {
        reading.prox[i] = (int16_t)((int)draw(&seed, 8193) - 4096);
        reading.light[i] = (int16_t)((int)draw(&seed, 8193) - 4096);
    }
    for (i = 0; i < 3; i++)
        reading.boards.ground[i] = (int16_t)draw(&seed, 1024);
    for (i = 0; i < 2; i++)
        reading.steps[i] = (int32_t)draw(&seed, 2000001) - 1000000;
    reading.step_nm = VS_EPUCK2_STEP_NM;
    return reading;
}

static void sense(const struct vs_calibration *c, struct vs_base_reading *reading)
{
    vs_calibration_sense(c, reading, 0);
    vs_calibration_sense_ground(c, reading->boards.ground);
}

/* A base may measure ground itself: by Bluetooth an e-puck answers for its ground board. */
static void test_ground_of_a_base_is_calibrated_as_that_of_a_board(void)
{
    struct vs_calibration c;
    struct vs_base_reading reading = make_reading();
    int i;

    memset(&c, 0, sizeof c);
    CHECK(take(&c, VS_CAL_GROUND, "200:800,250:900,0:1023") == NULL);
    reading.has_ground = 1;
    reading.ground[0] = reading.boards.ground[0] = 500;
    reading.ground[1] = reading.boards.ground[1] = 250;
    reading.ground[2] = reading.boards.ground[2] = 1023;
    sense(&c, &reading);
    CHECK(reading.ground[0] == 512 && reading.ground[1] == 0 && reading.ground[2] == 1023);
    for (i = 0; i < 3; i++)
        CHECK(reading.boards.ground[i] == reading.ground[i]);
}

static void test_a_nominal_robot_is_left_alone(void)
{
    struct vs_calibration none;
    struct vs_base_reading reading = make_reading();
    struct vs_base_reading before = reading;
    struct vs_base_command command = {30000, -7, 0x3FF, {0, {0}}, {{0}}};

    memset(&none, 0, sizeof none);
    sense(&none, &reading);
    vs_calibration_drive(&none, &command, 1000);
    CHECK(memcmp(&reading, &before, sizeof reading) == 0);
    CHECK(command.left_steps_s == 30000 && command.right_steps_s == -7 && command.leds == 0x3FF);
}

static void test_what_was_measured_reads_as_nominal(void)
{
    struct vs_calibration c;
    struct vs_base_reading reading = make_reading();
    int i;

    memset(&c, 0, sizeof c);
    CHECK(take(&c, VS_CAL_PROXIMITY, "-3:900,1:20,3:40") != NULL);
    CHECK(c.text[VS_CAL_PROXIMITY] == NULL);
    CHECK(take(&c, VS_CAL_PROXIMITY, "-3:900,10:1010,20:1120,0:500,0:501,0:502,0:503,4:4000") ==
          NULL);
    CHECK(take(&c, VS_CAL_LIGHT, "300:3900") == NULL);
    CHECK(take(&c, VS_CAL_GROUND, "200:800,250:900,0:1023") == NULL);
    for (i = 0; i < 8; i++) {
        reading.prox[i] = c.spans[VS_CAL_PROXIMITY][i].low;
        reading.light[i] = 300;
    }
    reading.boards.ground[0] = 200;
    reading.boards.ground[1] = 900;
    reading.boards.ground[2] = 1023;
    vs_calibration_sense(&c, &reading, 1);
    for (i = 0; i < 8; i++)
        CHECK(reading.prox[i] == c.spans[VS_CAL_PROXIMITY][i].low && reading.light[i] == 300);
    sense(&c, &reading);
    for (i = 0; i < 8; i++)
        CHECK(reading.prox[i] == 67 && reading.light[i] == 0);
    CHECK(reading.boards.ground[0] == 0 && reading.boards.ground[1] == 1023 &&
          reading.boards.ground[2] == 1023);
    reading.prox[1] = 1010;
    reading.prox[7] = 4000;
    reading.light[7] = 3900;
    vs_calibration_sense(&c, &reading, 0);
    CHECK(reading.prox[1] == 1466 && reading.prox[7] == 1466 && reading.light[7] == 4095);
}

/* Whatever a base gives: what is nearer never reads farther, and all stays in range. */
static void test_order_and_range_are_kept(void)
{
    int world;

    for (world = 0; world < WORLDS; world++) {
        struct vs_calibration c;
        struct vs_base_reading one = make_reading();
        struct vs_base_reading other = make_reading();
        int low = (int)draw(&seed, 8193 - 16) - 4096;
        char text[40];
        struct vs_base_reading seen[2];
        int i;

        memset(&c, 0, sizeof c);
        snprintf(text, sizeof text, "%d:%d", low,
                 low + 16 + (int)draw(&seed, (uint32_t)(4096 - low - 15)));
        CHECK(take(&c, VS_CAL_PROXIMITY, text) == NULL && take(&c, VS_CAL_LIGHT, text) == NULL);
        CHECK(take(&c, VS_CAL_GROUND, "100:116") == NULL);
        seen[0] = one;
        seen[1] = other;
        sense(&c, &seen[0]);
        sense(&c, &seen[1]);
        for (i = 0; i < 8; i++) {
            CHECK(seen[0].prox[i] >= 0 && seen[0].prox[i] <= 4095);
            CHECK(seen[0].light[i] >= 0 && seen[0].light[i] <= 4095);
            CHECK(one.prox[i] > other.prox[i] || seen[0].prox[i] <= seen[1].prox[i]);
            CHECK(one.light[i] > other.light[i] || seen[0].light[i] <= seen[1].light[i]);
        }
        for (i = 0; i < 3; i++)
            CHECK(seen[0].boards.ground[i] >= 0 && seen[0].boards.ground[i] <= 1023);
    }
}

/* A robot's wheels and axle, and its settings as a text each. */
struct body {
    double diameter_mm[2];
    double axle_mm;
    char text[3][32];
    struct vs_calibration calibration;
};

static void build(struct body *body)
{
    double mean = between(36.0, 46.0);
    double ratio = between(0.95, 1.05);

    memset(&body->calibration, 0, sizeof body->calibration);
    body->diameter_mm[0] = 2.0 * mean / (1.0 + ratio);
    body->diameter_mm[1] = ratio * body->diameter_mm[0];
    body->axle_mm = between(45.0, 65.0);
    snprintf(body->text[0], sizeof body->text[0], "%.9f", mean);
    snprintf(body->text[1], sizeof body->text[1], "%.9f", ratio);
    snprintf(body->text[2], sizeof body->text[2], "%.9f", body->axle_mm);
    CHECK(take(&body->calibration, VS_CAL_DIAMETER, body->text[0]) == NULL);
    CHECK(take(&body->calibration, VS_CAL_RATIO, body->text[1]) == NULL);
    CHECK(take(&body->calibration, VS_CAL_AXLE, body->text[2]) == NULL);
}

/* [mm/s] ahead and [rad/s] of a robot whose wheels turn so many steps per second. */
static void move(const double diameter_mm[2], double axle_mm, double left, double right,
                 double *ahead, double *turn)
{
    double left_mm_s = PI * diameter_mm[0] * left / 1000.0;
    double right_mm_s = PI * diameter_mm[1] * right / 1000.0;

    *ahead = (left_mm_s + right_mm_s) / 2.0;
    *turn = (right_mm_s - left_mm_s) / axle_mm;
}

static void test_every_robot_moves_as_the_nominal_one(void)
{
    static const double nominal_mm[2] = {41.0, 41.0};
    int world;

    for (world = 0; world < WORLDS; world++) {
        struct body body;
        struct vs_base_command command;
        double ahead[2];
        double turn[2];

        build(&body);
        memset(&command, 0, sizeof command);
        command.left_steps_s = (int16_t)((int)draw(&seed, 1001) - 500);
        command.right_steps_s = (int16_t)((int)draw(&seed, 1001) - 500);
        move(nominal_mm, 53.0, command.left_steps_s, command.right_steps_s, &ahead[0], &turn[0]);
        vs_calibration_drive(&body.calibration, &command, 1000);
        move(body.diameter_mm, body.axle_mm, command.left_steps_s, command.right_steps_s,
             &ahead[1], &turn[1]);
        /* Half a step of each wheel is rounded off. */
        CHECK(fabs(ahead[0] - ahead[1]) < 0.5 * PI * 46.0 * 1.03 / 1000.0);
        CHECK(fabs(turn[0] - turn[1]) < PI * 46.0 * 1.03 / 1000.0 / 45.0);
    }
}

static void test_ways_are_those_of_the_nominal_robot(void)
{
    int world;

    for (world = 0; world < WORLDS; world++) {
        struct body body;
        struct vs_base_reading reading = make_reading();
        const double nominal_mm[2] = {128.805e-3 * 1000.0 / PI, 128.805e-3 * 1000.0 / PI};
        double ahead[2];
        double turn[2];

        build(&body);
        move(body.diameter_mm, body.axle_mm, reading.steps[0], reading.steps[1], &ahead[0],
             &turn[0]);
        vs_calibration_sense(&body.calibration, &reading, 0);
        CHECK(reading.step_nm == 128805);
        move(nominal_mm, 53.0, reading.steps[0], reading.steps[1], &ahead[1], &turn[1]);
        CHECK(fabs(ahead[0] - ahead[1]) < 0.065 + 1e-5 * fabs(ahead[0]));
        CHECK(fabs(turn[0] - turn[1]) < 0.0026 + 1e-5 * fabs(turn[0]));
    }
}

static void test_too_fast_a_wheel_slows_both_and_rest_is_rest(void)
{
    int world;

    for (world = 0; world < WORLDS; world++) {
        struct body body;
        struct vs_base_command command;
        struct vs_base_command rest;
        int16_t most = (int16_t)(world % 2 ? 1000 : 1100);
        int speed = (int)draw(&seed, 65535) - 32767;

        build(&body);
        memset(&command, 0, sizeof command);
        memset(&rest, 0, sizeof rest);
        command.left_steps_s = command.right_steps_s = (int16_t)speed;
        vs_calibration_drive(&body.calibration, &command, most);
        CHECK(abs(command.left_steps_s) <= most && abs(command.right_steps_s) <= most);
        /* Straight on stays straight on, whatever was too fast: each wheel was rounded by half
         * a step and then cut by less than one, both the same way. */
        CHECK(fabs(command.left_steps_s * body.diameter_mm[0] -
                   command.right_steps_s * body.diameter_mm[1]) < 2.0 * 46.0 * 1.03);
        CHECK((int)command.left_steps_s * speed >= 0);
        vs_calibration_drive(&body.calibration, &rest, most);
        CHECK(rest.left_steps_s == 0 && rest.right_steps_s == 0);
    }
}

static void test_one_setting_changes_nothing_else(void)
{
    struct vs_calibration c;
    struct vs_base_reading reading = make_reading();
    struct vs_base_reading before = reading;
    struct vs_base_command turn = {-200, 200, 0, {0, {0}}, {{0}}};

    memset(&c, 0, sizeof c);
    CHECK(take(&c, VS_CAL_AXLE, "58.3") == NULL);
    vs_calibration_sense(&c, &reading, 0);
    CHECK(memcmp(reading.prox, before.prox, sizeof reading.prox) == 0);
    CHECK(reading.step_nm == before.step_nm);
    CHECK(abs(reading.steps[0] + reading.steps[1] - before.steps[0] - before.steps[1]) <= 1);
    vs_calibration_drive(&c, &turn, 1000);
    CHECK(turn.left_steps_s == -220 && turn.right_steps_s == 220);
    vs_calibration_drive(&c, &turn, 0);
    CHECK(turn.left_steps_s == 0 && turn.right_steps_s == 0);
}

static void test_what_is_no_setting(void)
{
    static const struct {
        enum vs_calibrated which;
        const char *text;
    } bad[] = {
        {VS_CAL_PROXIMITY, ""},         {VS_CAL_PROXIMITY, "1"},
        {VS_CAL_PROXIMITY, "1:"},       {VS_CAL_PROXIMITY, "100:115"},
        {VS_CAL_PROXIMITY, "900:100"},  {VS_CAL_PROXIMITY, "0:4097"},
        {VS_CAL_PROXIMITY, "0.5:900"},  {VS_CAL_PROXIMITY, "0:900,"},
        {VS_CAL_PROXIMITY, "0:900 1"},  {VS_CAL_LIGHT, "-4097:0"},
        {VS_CAL_LIGHT, "0:1e99"},       {VS_CAL_GROUND, "-1:900"},
        {VS_CAL_GROUND, "0:1024"},      {VS_CAL_GROUND, "0:900,0:900,0:900,0:900"},
        {VS_CAL_GROUND, "0:900,0:900"}, {VS_CAL_DIAMETER, "4.1"},
        {VS_CAL_DIAMETER, "41mm"},      {VS_CAL_DIAMETER, ""},
        {VS_CAL_RATIO, "1.2"},          {VS_CAL_RATIO, "nan"},
        {VS_CAL_AXLE, "5.3"},           {VS_CAL_AXLE, "53 "}};
    struct vs_calibration c;
    struct vs_calibration before;
    size_t i;

    memset(&c, 0, sizeof c);
    before = c;
    for (i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        CHECK_FOR(bad[i].text, take(&c, bad[i].which, bad[i].text) != NULL);
        CHECK_FOR(bad[i].text, memcmp(&c, &before, sizeof c) == 0);
    }
}

int main(void)
{
    test_a_nominal_robot_is_left_alone();
    test_what_was_measured_reads_as_nominal();
    test_ground_of_a_base_is_calibrated_as_that_of_a_board();
    test_order_and_range_are_kept();
    test_every_robot_moves_as_the_nominal_one();
    test_ways_are_those_of_the_nominal_robot();
    test_too_fast_a_wheel_slows_both_and_rest_is_rest();
    test_one_setting_changes_nothing_else();
    test_what_is_no_setting();
    return 0;
}
