/* SPDX-License-Identifier: MIT */
/*
 * calibration.h - what one robot's sensors and wheels differ in from those of the nominal
 * e-puck, which controllers see: the one that `vsense sim` simulates. What was measured
 * stands in the robot's settings; readings and wheel commands are converted between base
 * and controller. Pure.
 *
 * Nominal: proximity reads 67 with nothing near and 1466 with a white wall 1 cm ahead;
 * light 0 in the dark and 4095 at its brightest; ground 0 on black and 1 on white; both
 * wheels measure 41 mm, 53 mm apart. Source: epuck.md section 6, proximity from the table
 * of Webots' e-puck.
 */
#ifndef VS_CALIBRATION_H
#define VS_CALIBRATION_H

#include "base.h"

enum vs_calibrated {
    VS_CAL_PROXIMITY = 0,
    VS_CAL_LIGHT,
    VS_CAL_GROUND,
    VS_CAL_SPANS, /* so many of them are spans of raw readings, the others numbers: */
    VS_CAL_DIAMETER = VS_CAL_SPANS,
    VS_CAL_RATIO,
    VS_CAL_AXLE,
    VS_CAL_SETTINGS
};

/* Two raw readings of one sensor. */
struct vs_span {
    int16_t low;
    int16_t high;
};

struct vs_calibration {
    const char *text[VS_CAL_SETTINGS]; /* as it was given, NULL: not calibrated */
    struct vs_span spans[VS_CAL_SPANS][8];
    double numbers[VS_CAL_SETTINGS - VS_CAL_SPANS]; /* [mm], right / left, [mm] */
    uint8_t has_wheels;
    int32_t drive[2][2]; /* [2^-24] from nominal left and right to this robot's left and right */
    int32_t sense[2][2]; /* and back */
};

/* Takes a setting by its name; text is kept, not copied. Returns NULL, or what was expected. */
const char *vs_calibration_take(struct vs_calibration *calibration, const char *name,
                                const char *text);

/* Name of a setting. */
const char *vs_calibration_name(enum vs_calibrated which);

/* What the nominal e-puck would measure where this one measured *reading, ground of the base's
 * own included, but for its boards; and where its ground board measured ground[3]. raw: the ways
 * of the wheels only. */
void vs_calibration_sense(const struct vs_calibration *calibration,
                          struct vs_base_reading *reading, int raw);
void vs_calibration_sense_ground(const struct vs_calibration *calibration, int16_t ground[3]);

/* What makes this robot move as *command moves the nominal e-puck. Where a wheel would have to
 * turn faster than max_steps_s both are slowed down alike: it keeps to its curve. */
void vs_calibration_drive(const struct vs_calibration *calibration,
                          struct vs_base_command *command, int16_t max_steps_s);

#endif
