/* SPDX-License-Identifier: MIT */
/*
 * What a base and its boards measure, as controllers see it: numbers where the virtual
 * sensors of the same names have them, and nothing where nothing is known.
 */
#include <math.h>
#include <string.h>

#include "base_sensors.h"
#include "check.h"
#include "robot.h"
#include "../../c_src/vs_bytes.h"

#define PI 3.14159265358979323846

static int is_near(double a, double b)
{
    return fabs(a - b) <= 1e-9 + 1e-6 * fabs(b);
}

static struct vs_base_reading make_reading(void)
{
    struct vs_base_reading reading;
    int i;

    memset(&reading, 0, sizeof reading);
    for (i = 0; i < 8; i++) {
        reading.prox[i] = (int16_t)(10 * i);
        reading.light[i] = (int16_t)(4000 - i);
        reading.boards.heard[i].data[0] = (uint8_t)i;
        reading.boards.heard[i].bearing_e4rad = (int16_t)(1000 * i - 4000);
        reading.boards.heard[i].range_raw = (uint16_t)(500 * i);
    }
    reading.battery_low = VS_UNKNOWN;
    reading.step_nm = 125664;
    reading.boards.rab_k_cm = 0.0867438559f;
    reading.steps[0] = 1000;
    reading.steps[1] = -250;
    reading.boards.ground[0] = 1023;
    reading.boards.heard_count = 20;
    return reading;
}

static void test_what_is_not_there_is_not_known(void)
{
    struct vs_base_reading reading = make_reading();
    double values[VS_BASE_NUMBERS_MAX];

    CHECK(vs_base_sensor("nothing") == -1 && vs_base_has(&reading, -1) == 0);
    CHECK(vs_base_values(&reading, vs_base_sensor("ground"), 0, values, 3) == 0);
    CHECK(vs_base_values(&reading, vs_base_sensor("wheels"), 0, values, 2) == 0);
    CHECK(vs_base_values(&reading, vs_base_sensor("range_and_bearing"), 0, values, 9) == 0);
    CHECK(vs_base_values(&reading, vs_base_sensor("battery_low"), 0, values, 1) == 0);
    reading.battery_low = 1;
    CHECK(vs_base_values(&reading, vs_base_sensor("battery_low"), 0, values, 1) == 1);
    CHECK(values[0] == 1.0);
    CHECK(vs_base_values(&reading, vs_base_sensor("proximity"), 0, values, 8) == 8);
    reading.blind = 1;
    CHECK(vs_base_values(&reading, vs_base_sensor("proximity"), 0, values, 8) == 0);
    CHECK(vs_base_values(&reading, vs_base_sensor("light"), 0, values, 8) == 0);
}

static void test_ground_and_wheels(void)
{
    struct vs_base_reading reading = make_reading();
    double values[VS_BASE_NUMBERS_MAX];

    reading.boards.there = 3;
    CHECK(vs_base_values(&reading, VS_BASE_GROUND, 0, values, 3) == 0);
    reading.boards.has[VS_BOARD_GROUND] = reading.has_steps = 1;
    CHECK(vs_base_values(&reading, VS_BASE_GROUND, 0, values, 3) == 3);
    CHECK(values[0] == 1.0 && values[1] == 0.0);
    CHECK(vs_base_values(&reading, VS_BASE_WHEELS, 0, values, 2) == 2);
    CHECK(is_near(values[0], 12.5664) && is_near(values[1], -3.1416));
}

static void test_messages(void)
{
    struct vs_base_reading reading = make_reading();
    double values[VS_BASE_NUMBERS_MAX];
    int i;

    reading.boards.there = 1u << VS_BOARD_RAB;
    reading.boards.has[VS_BOARD_RAB] = 1;
    CHECK(vs_base_values(&reading, VS_BASE_RAB, 20, values, 31) == 31 && values[0] == 0.0);
    CHECK(vs_base_values(&reading, VS_BASE_RAB, 17, values, 31) == 31 && values[0] == 3.0);
    for (i = 0; i < 3; i++) { /* the newest of 20 is the one at 19 % 8 */
        const struct epuck_rab_message *heard = &reading.boards.heard[(19 - i) % 8];
        const double *place = values + 1 + 6 * i;

        CHECK(is_near(place[0], 0.0867438559 * exp(9.06422181283387 -
                                                   0.00565074879677167 * heard->range_raw)));
        CHECK(is_near(place[1], heard->bearing_e4rad / 1e4) && place[2] == heard->data[0]);
    }
    for (i = 1 + 6 * 3; i < 31; i++)
        CHECK(values[i] == 0.0);
    CHECK(vs_base_values(&reading, VS_BASE_RAB, 0, values, 31) == 31 && values[0] == 5.0);
    reading.boards.rab_k_cm = 0.1f; /* of this robot's board */
    CHECK(vs_base_values(&reading, VS_BASE_RAB, 0, values, 31) == 31);
    CHECK(is_near(values[1], (double)0.1f * exp(9.06422181283387 - 0.00565074879677167 *
                                                (double)reading.boards.heard[3].range_raw)));
}

static void test_accelerometer_and_microphones(void)
{
    static const int16_t still[3] = {2048, 2040, 2848};
    static const int16_t quiet[3] = {2000, 0, 2010};
    struct vs_base_reading reading = make_reading();
    double values[4];
    int acceleration = vs_base_sensor("accelerometer");
    int microphones = vs_base_sensor("microphones");

    reading.microphone_count = 3; /* a firmware that does not read them sends zeros */
    CHECK(vs_base_values(&reading, acceleration, 0, values, 3) == 0);
    CHECK(vs_base_values(&reading, microphones, 0, values, 3) == 0);
    memcpy(reading.acceleration, still, sizeof still);
    memcpy(reading.microphones, quiet, sizeof quiet);
    CHECK(vs_base_values(&reading, acceleration, 0, values, 2) == 3 && values[1] == 2040.0);
    CHECK(vs_base_values(&reading, microphones, 0, values, 4) == 3 && values[2] == 2010.0);
}

static void test_gyroscope_and_distance(void)
{
    static const int16_t rates[3] = {-32768, 0, 7510}; /* -250 degrees a second; 1 rad/s */
    struct vs_base_reading reading = make_reading();
    double values[3];
    int gyroscope = vs_base_sensor("gyroscope");
    int distance = vs_base_sensor("distance");

    CHECK(!vs_base_has(&reading, gyroscope) && !vs_base_has(&reading, distance));
    reading.has_distance = 1; /* who has it may not have measured yet */
    CHECK(vs_base_has(&reading, distance));
    CHECK(vs_base_values(&reading, distance, 0, values, 1) == 0);
    reading.distance_mm = 1234;
    CHECK(vs_base_values(&reading, distance, 0, values, 1) == 1 && values[0] == 1234.0);
    reading.boards.there = 1u << VS_BOARD_BATTERY; /* likewise */
    CHECK(vs_base_has(&reading, VS_BASE_VOLTAGE));
    CHECK(vs_base_values(&reading, VS_BASE_VOLTAGE, 0, values, 1) == 0);
    reading.boards.there = 1u << VS_BOARD_IMU;
    memcpy(reading.boards.rates, rates, sizeof rates);
    CHECK(vs_base_has(&reading, gyroscope));
    CHECK(vs_base_values(&reading, gyroscope, 0, values, 3) == 0);
    reading.boards.has[VS_BOARD_IMU] = 1;
    CHECK(vs_base_values(&reading, gyroscope, 0, values, 3) == 3 && values[1] == 0.0);
    CHECK(is_near(values[0], -250.0 * PI / 180.0) && fabs(values[2] - 1.0) < 1e-4);
    reading.has_rates = 1; /* the base's own counts */
    CHECK(vs_base_values(&reading, gyroscope, 0, values, 3) == 3 && values[0] == 0.0);
}

/* Each control step sees what was heard since the one before, a new guard's from the start. */
static void test_steps_see_new_messages_only(void)
{
    static struct vs_robot robot;
    static struct vs_session session;
    double count;
    int sensor;

    vs_robot_begin(&robot, &session);
    robot.base = make_reading();
    robot.base.boards.there = 1u << VS_BOARD_RAB;
    robot.base.boards.has[VS_BOARD_RAB] = 1;
    robot.base_ns = 1;
    sensor = vs_robot_sensor(&robot, "range_and_bearing");
    vs_robot_begin_step(&robot);
    vs_robot_begin_step(&robot);
    CHECK(vs_robot_values(&robot, sensor, &count, 1) == 31 && count == 0.0);
    robot.base.boards.heard_count += 2;
    vs_robot_begin_step(&robot);
    CHECK(vs_robot_values(&robot, sensor, &count, 1) == 31 && count == 2.0);
    robot.base.boards.heard_count = 1;
    vs_robot_begin_step(&robot);
    CHECK(vs_robot_values(&robot, sensor, &count, 1) == 31 && count == 1.0);
}

static uint32_t complaints;

static void complain(void *context, const char *what, const char *name)
{
    (void)context;
    (void)what;
    (void)name;
    complaints++;
}

static void test_own_message(void)
{
    static struct vs_robot robot;
    static struct vs_session session;
    int message;

    robot.complain = complain;
    robot.base_ns = 1;
    vs_robot_begin(&robot, &session);
    CHECK(vs_robot_actuator(&robot, "message") < 0 && complaints == 1);
    CHECK(vs_robot_sensor(&robot, "ground") < 0 && complaints == 2);
    CHECK(!vs_robot_offers(&robot, "ground") && !vs_robot_offers(&robot, "pollutant"));
    CHECK(vs_robot_offers(&robot, "proximity") && complaints == 2);
    robot.base.boards.there = 1u << VS_BOARD_RAB;
    message = vs_robot_actuator(&robot, "message");
    CHECK(message >= 0 && complaints == 2);
    vs_robot_actuate(&robot, message, 0, 9.0);
    vs_robot_actuate(&robot, message, 1, 300.0);
    vs_robot_actuate(&robot, message, 4, -5.0);
    vs_robot_actuate(&robot, message, 5, 7.0);
    vs_robot_actuate(&robot, message, -1, 7.0);
    CHECK(robot.command.message.length == 4 && robot.command.message.data[0] == 255);
    CHECK(robot.command.message.data[3] == 0);
    vs_robot_rest(&robot);
    CHECK(robot.command.message.length == 0);
}

int main(void)
{
    test_what_is_not_there_is_not_known();
    test_ground_and_wheels();
    test_messages();
    test_accelerometer_and_microphones();
    test_gyroscope_and_distance();
    test_steps_see_new_messages_only();
    test_own_message();
    return 0;
}
