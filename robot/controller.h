/* SPDX-License-Identifier: MIT */
/*
 * controller.h - all that a controller sees and may do. A controller is one C or
 * C++ file that includes this header only and defines `vs_controller`:
 *
 *     struct follower { int light; };
 *     static void init(void *state, struct vs_robot *robot)
 *     {
 *         struct follower *f = state;
 *         f->light = vs_robot_sensor(robot, "light");
 *     }
 *     static void step(void *state, struct vs_robot *robot) { ... }
 *     const struct vs_controller vs_controller =
 *         {"follower", sizeof(struct follower), init, step, NULL};
 *
 * Sensors are known by name, and a controller need not know which are virtual: a name in the host's
 * sensor table wins over the robot's own sensor of that name, and "+NAME" there is fused with it:
 * number by number the larger of the two, so that a virtual wall turns a robot like a real one.
 * Where the virtual part is unknown or stale the real one counts alone, and where the real one is
 * unknown nothing does. The robot's own, calibrated where its settings hold what was measured of
 * it: "proximity" and "light", 8 numbers each, ps0..ps7 at vs_robot_sensor_angle_rad, raw 0..4096
 * (higher is nearer, brighter); "battery_low" (0 or 1) and "battery", its voltage in mV where base
 * or board can tell it; "wheels", the way [cm] of the left and the right wheel since the daemon
 * began, where the base counts steps; "accelerometer", raw x, y, z, and "microphones", raw, where
 * the base's firmware reads them (IRIDIA's: the newest sample of right, left and back; GCtronic's
 * for the e-puck2: the loudness of its four); "distance" [mm] ahead, of an e-puck2 with asercom,
 * far above its 2 m where it sees nothing; with boards on I2C (`vsensed --help`) "ground", 3
 * numbers from 0 black to 1 white, and "range_and_bearing", laid out as the virtual one with 5
 * places. Its own actuator, with that board: "message", the length and 4 bytes. "gyroscope"
 * [rad/s], of an e-puck2 with asercom or with `imu=BUS`: x, y, z, limited to 4.36. z is upwards, so
 * turning left is positive; where x and y point the firmwares' sources contradict each other. With
 * `imu=BUS` it has an offset: what it says at rest.
 *
 * All that a controller remembers belongs into its state, never into a static variable: one process
 * may run many robots. No function here fails or blocks.
 */
#ifndef VS_CONTROLLER_H
#define VS_CONTROLLER_H

#include <limits.h>
#include <stddef.h>
#include <stdint.h>

#include "walk.h" /* getting about: wander, go towards, rest */

#ifdef __cplusplus
extern "C" {
#endif

#define VS_CONTROLLER_STATE_MAX 16384 /* [byte] largest state of a controller */
#define VS_ROBOT_STEPS_PER_CM 77.64   /* [step/cm] wheel of 41 mm, 1000 steps a turn */
#define VS_ROBOT_MAX_STEPS_S 1000     /* [step/s] what every robot's motors can do */
#define VS_ROBOT_LED_RING 0xFF        /* the 8 red LEDs around the body */
#define VS_ROBOT_LED_BODY 0x100
#define VS_ROBOT_LED_FRONT 0x200

struct vs_robot;

struct vs_controller {
    const char *name;  /* at most 31 characters */
    size_t state_size; /* [byte] at most VS_CONTROLLER_STATE_MAX */
    /* Begins a run: *state is all zeros, wheels 0, LEDs off. Bind sensors and read parameters
     * here. Called again when a new run or another table comes. */
    void (*init)(void *state, struct vs_robot *robot);
    /* One control step: read, think, set wheels and LEDs. */
    void (*step)(void *state, struct vs_robot *robot);
    /* Ends what init began, once: before the next init, and at an orderly end. May be NULL. */
    void (*end)(void *state, struct vs_robot *robot);
};

/* The one controller that is linked into the daemon. */
extern const struct vs_controller vs_controller;

struct vs_reading {
    double value;    /* its first number, 0 if not known */
    int known;       /* 0: no such sensor, or nothing measured yet */
    int stale;       /* older than 2.5 timesteps, or not known */
    uint64_t age_ns; /* [ns] since it was measured, UINT64_MAX if not known */
};

/* Binds a sensor by name; 1 if somebody offers it. For init. Else its reading is not known. */
int vs_robot_sensor(struct vs_robot *robot, const char *name);
int vs_robot_offers(const struct vs_robot *robot, const char *name);

/* The sensor's newest reading. */
struct vs_reading vs_robot_read(const struct vs_robot *robot, int sensor);

/* Its numbers, at most max. Returns how many it has, 0 if not known. */
int vs_robot_values(const struct vs_robot *robot, int sensor, double *values, int max);

/* Binds a virtual actuator, or a reading that goes up, by name; for init. Always gives a handle. */
int vs_robot_actuator(struct vs_robot *robot, const char *name);

/* Sets number index of a virtual actuator, a level or a cumulative counter; stays until set again.
 * Clipped to its type, NaN counts as 0; nobody's actuator: no effect. A level must be meant for as
 * long as it stays, 0 is off; a counter only grows, from 0 in init; a reading is of this step. */
void vs_robot_actuate(struct vs_robot *robot, int actuator, int index, double value);

/* Parameter of the experiment, fallback if it names none or no number. */
double vs_robot_param(struct vs_robot *robot, const char *name, double fallback);

/* The same, from least to most (INT_MAX: or more); another one is refused, a robot clips it. */
double vs_robot_param_in(struct vs_robot *robot, const char *name, double fallback, int least,
                         int most);

/* Parameter of the experiment as text, into text[size] with a final zero; at most size - 1 bytes of
 * it. Returns the bytes that the experiment gives, -1: it names none. All together: 4096 bytes. */
int vs_robot_param_text(struct vs_robot *robot, const char *name, char *text, size_t size);

/* Shows a named value to people: on the page, in recordings and exports. Stays until it is
 * set again or the run ends. Names of 1 to 15 bytes, texts of at most 48, all of them
 * together at most 255 bytes: a number costs 6 bytes and its name, a text 3 and its name. */
void vs_robot_show(struct vs_robot *robot, const char *name, double value);
void vs_robot_show_text(struct vs_robot *robot, const char *name, const char *text);

/* One line for the host's list of events, cut to 120 bytes. Some ten lines per second get
 * through; of more than 8 that wait the oldest are lost, which the host says. */
void vs_robot_log(struct vs_robot *robot, const char *line);

/* In this run "proximity", "light" and "ground" are not calibrated: for who measures the robot. */
void vs_robot_sense_raw(struct vs_robot *robot);

/* Uniform in [0, 1): a generator of this robot's own, seeded by the experiment. */
double vs_robot_random(struct vs_robot *robot);

/* [step/s], forwards; stays until set again. Its motors' limit: +-1000, an e-puck2's +-1100. */
void vs_robot_set_wheels(struct vs_robot *robot, int left_steps_s, int right_steps_s);

/* Lit ones: VS_ROBOT_LED_*, bit n of the ring = LED n; stays until set again. */
void vs_robot_set_leds(struct vs_robot *robot, unsigned int leds);

/* Coloured LED 0, 1, .., 0 to 255 each; stays until set again. Of an e-puck2 with GCtronic's
 * gumstix firmware 0..3: LED2, LED4, LED6 and LED8, clockwise from the front right; while one is
 * black the LED of the ring in its place shows. Of IRIDIA's board (`rgb=BUS`) 0..2: front left,
 * front right, back. A robot that has no such LED: no effect. */
void vs_robot_set_rgb(struct vs_robot *robot, int led, int red, int green, int blue);

/* How many of them it has: 4, 3, or 0; from the first control step on, init included. */
int vs_robot_rgb_leds(const struct vs_robot *robot);

/* [s] length of a timestep; control steps are about that far apart. */
double vs_robot_timestep_s(const struct vs_robot *robot);

/* [rad] where ps0..ps7 look, counter-clockwise from ahead. Source: e-puck proto of Webots. */
extern const double vs_robot_sensor_angle_rad[8];

#ifdef __cplusplus
}
#endif
#endif
