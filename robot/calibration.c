/* SPDX-License-Identifier: MIT */
#include "calibration.h"

#include <string.h>

#include "number.h"
#include "robot.h"

#define SPAN_MIN 16            /* a sensor that tells no more than this apart is broken */
#define NOMINAL_MM 41.0
#define NOMINAL_AXLE_MM 53.0
#define ONE 16777216.0 /* 1 in a matrix */

static const struct {
    const char *name;
    const char *expected;
    int16_t count; /* of sensors */
    int16_t least; /* of a raw reading; a number is in the same row of numbers */
    int16_t most;
    int16_t low; /* what spans become */
    int16_t high;
    int16_t top; /* largest reading */
} settings[VS_CAL_SETTINGS] = {
    {"proximity-scale", "1 or 8 NOTHING:WALL, -4096..4096, 16 apart", 8, -4096, 4096, 67, 1466,
     4095},
    {"light-scale", "1 or 8 DARK:BRIGHT, -4096..4096, 16 apart", 8, -4096, 4096, 0, 4095, 4095},
    {"ground-scale", "1 or 3 BLACK:WHITE, 0..1023, 16 apart", 3, 0, EPUCK_GROUND_MAX, 0,
     EPUCK_GROUND_MAX, EPUCK_GROUND_MAX},
    {"wheel-diameter", "30..50 mm", 0, 0, 0, 0, 0, 0},
    {"wheel-ratio", "0.9..1.1", 0, 0, 0, 0, 0, 0},
    {"axle-length", "40..70 mm", 0, 0, 0, 0, 0, 0},
};

static const double ranges[VS_CAL_SETTINGS - VS_CAL_SPANS][2] = {
    {30.0, 50.0}, {0.9, 1.1}, {40.0, 70.0}};

/* Reads a number from least to most. Returns what follows, NULL if it is none. */
static const char *read_number(const char *text, double least, double most, double *number)
{
    size_t len = vs_number_read(text, number);

    return len > 0 && *number >= least && *number <= most ? text + len : NULL;
}

static const char *read_raw(const char *text, int which, int16_t *raw)
{
    double number = 0.0;

    text = read_number(text, settings[which].least, settings[which].most, &number);
    if (text == NULL)
        return NULL;
    *raw = (int16_t)number;
    return number == *raw ? text : NULL;
}

/* Reads one span for all sensors, or one for each. Returns 0, or -1. */
static int take_spans(const char *text, int which, struct vs_span spans[8])
{
    int has_more;
    int count = 0;

    do {
        struct vs_span *span = &spans[count++];

        text = read_raw(text, which, &span->low);
        if (text == NULL || *text != ':')
            return -1;
        text = read_raw(text + 1, which, &span->high);
        if (text == NULL || span->high - span->low < SPAN_MIN)
            return -1;
        has_more = *text == ',';
        text += has_more;
    } while (has_more && count < settings[which].count);
    if (has_more || *text != '\0' || (count != 1 && count != settings[which].count))
        return -1;
    for (; count < settings[which].count; count++)
        spans[count] = spans[0];
    return 0;
}

/* The robot's left and right wheel make so much more way per step than nominal, and are so
 * much wider apart. The ratio of the wheels leaves their mean as it is. Source: Borenstein, Feng:
 * Measurement and correction of systematic odometry errors in mobile robots, 1996 (UMBmark). */
static void find_wheels(struct vs_calibration *c)
{
    double more = c->text[VS_CAL_DIAMETER] != NULL ? c->numbers[0] / NOMINAL_MM : 1.0;
    double ratio = c->text[VS_CAL_RATIO] != NULL ? c->numbers[1] : 1.0;
    double wider = c->text[VS_CAL_AXLE] != NULL ? c->numbers[2] / NOMINAL_AXLE_MM : 1.0;
    double way = 2.0 * more / (ratio + 1.0); /* of the left wheel */
    int wheel;
    int other;

    for (wheel = 0; wheel < 2; wheel++, way *= ratio) {
        for (other = 0; other < 2; other++) {
            double sum = other == wheel ? wider + 1.0 : wider - 1.0;

            c->sense[other][wheel] = (int32_t)(sum * way / (2.0 * wider) * ONE);
            if (other != wheel)
                sum = -sum;
            c->drive[wheel][other] = (int32_t)(sum / (2.0 * way) * ONE);
        }
    }
    c->has_wheels = 1;
}

static int take(struct vs_calibration *c, int which, const char *text)
{
    struct vs_span spans[8];
    int number = which - VS_CAL_SPANS;
    double read;

    if (number < 0) {
        if (take_spans(text, which, spans) != 0)
            return -1;
        memcpy(c->spans[which], spans, sizeof spans);
    } else {
        text = read_number(text, ranges[number][0], ranges[number][1], &read);
        if (text == NULL || *text != '\0')
            return -1;
        c->numbers[number] = read;
    }
    return 0;
}

const char *vs_calibration_take(struct vs_calibration *calibration, const char *name,
                                const char *text)
{
    int which = 0;

    while (which < VS_CAL_SETTINGS - 1 && strcmp(name, settings[which].name) != 0)
        which++;
    if (take(calibration, which, text) != 0)
        return settings[which].expected;
    calibration->text[which] = text;
    if (which >= VS_CAL_SPANS)
        find_wheels(calibration);
    return NULL;
}

const char *vs_calibration_name(enum vs_calibrated which)
{
    return settings[which].name;
}

/* Readings of all sensors of a kind. */
static void rescale(const struct vs_calibration *c, int which, int16_t *raw)
{
    int i;

    for (i = 0; c->text[which] != NULL && i < settings[which].count; i++) {
        const struct vs_span *span = &c->spans[which][i];
        int width = span->high - span->low;
        int scaled = (raw[i] - span->low) * (settings[which].high - settings[which].low) +
                     settings[which].low * width; /* times width */

        scaled = scaled > 0 ? (scaled + width / 2) / width : 0;
        raw[i] = (int16_t)(scaled < settings[which].top ? scaled : settings[which].top);
    }
}

void vs_robot_sense_raw(struct vs_robot *robot)
{
    robot->raw = 1;
}

/* Rounded to the nearest. */
static int32_t combine(const int32_t row[2], int32_t left, int32_t right)
{
    return (int32_t)(((int64_t)row[0] * left + (int64_t)row[1] * right + (1 << 23)) >> 24);
}

void vs_calibration_sense(const struct vs_calibration *calibration,
                          struct vs_base_reading *reading, int raw)
{
    const struct vs_calibration *c = calibration;
    int32_t left = reading->steps[0];

    if (!raw) {
        rescale(c, VS_CAL_PROXIMITY, reading->prox);
        rescale(c, VS_CAL_LIGHT, reading->light);
        rescale(c, VS_CAL_GROUND, reading->ground);
    }
    if (!c->has_wheels)
        return;
    /* The counts since the start, so that what is rounded off does not add up. */
    reading->steps[0] = combine(c->sense[0], left, reading->steps[1]);
    reading->steps[1] = combine(c->sense[1], left, reading->steps[1]);
    if (c->text[VS_CAL_DIAMETER] != NULL)
        reading->step_nm = VS_EPUCK_STEP_NM;
}

void vs_calibration_sense_ground(const struct vs_calibration *calibration, int16_t ground[3])
{
    rescale(calibration, VS_CAL_GROUND, ground);
}

void vs_calibration_drive(const struct vs_calibration *calibration,
                          struct vs_base_command *command, int16_t max_steps_s)
{
    const struct vs_calibration *c = calibration;
    int32_t left = vs_base_clamp(command->left_steps_s, max_steps_s);
    int32_t right = vs_base_clamp(command->right_steps_s, max_steps_s);
    int32_t wheels[2];
    int32_t most = max_steps_s;
    int i;

    if (!c->has_wheels)
        return;
    if (most <= 0) { /* a limit that is no number: the robot stands */
        command->left_steps_s = command->right_steps_s = 0;
        return;
    }
    for (i = 0; i < 2; i++) {
        wheels[i] = combine(c->drive[i], left, right);
        if (wheels[i] > most || -wheels[i] > most)
            most = wheels[i] < 0 ? -wheels[i] : wheels[i];
    }
    command->left_steps_s = (int16_t)(wheels[0] * max_steps_s / most);
    command->right_steps_s = (int16_t)(wheels[1] * max_steps_s / most);
}
