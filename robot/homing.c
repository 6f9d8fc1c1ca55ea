/* SPDX-License-Identifier: MIT */
#include "homing.h"

/* Whole numbers: an ARMv5 has no others. Lengths are in 1/16 mm, angles in 2^-20 rad. */
#define NEAR 80          /* [1/16 mm] 5 mm: there is the goal, and the heading counts */
#define AHEAD_MAX 930    /* [step/s] 12 cm/s */
#define TURN_MAX 350     /* [step/s] each wheel: 1.7 rad/s */
#define WHEEL_MAX 1000   /* [step/s] both together */
#define ONE_RAD (1 << 20)

struct way {
    int32_t x; /* ahead */
    int32_t y; /* to the left */
    int32_t heading;
};

static int32_t magnitude(int32_t number)
{
    return number < 0 ? -number : number;
}

static int32_t clamp(int32_t number, int32_t most)
{
    if (number > most)
        return most;
    return number < -most ? -most : number;
}

static int32_t times(int32_t angle, int32_t length)
{
    return (int32_t)((int64_t)angle * length / ONE_RAD);
}

/* The robot drove for so long: what it drives to is elsewhere, seen from it. An e-puck's step is
 * 0.1288 mm and its wheels are 53 mm apart: epuck.md, section 6. */
static void drive_on(struct way *way, const struct vs_leg *leg, int32_t ms)
{
    int32_t turn = (leg->right_steps_s - leg->left_steps_s) * ms * 163 / 64;

    way->x -= (leg->right_steps_s + leg->left_steps_s) * ms * 17 / (1 << 14);
    way->heading -= turn;
    /* A rotation by the angle, in three shears. */
    way->x += times(turn / 2, way->y);
    way->y -= times(turn, way->x);
    way->x += times(turn / 2, way->y);
}

/* All that was driven since then. */
static void reckon(const struct vs_homing *homing, struct way *way, uint64_t since_ns,
                   uint64_t now_ns)
{
    int i;

    for (i = 1; i <= VS_HOMING_LEGS; i++) {
        const struct vs_leg *leg = &homing->legs[(homing->newest + i) % VS_HOMING_LEGS];
        const struct vs_leg *next = &homing->legs[(homing->newest + i + 1) % VS_HOMING_LEGS];
        uint64_t from_ns = leg->from_ns > since_ns ? leg->from_ns : since_ns;
        uint64_t until_ns = i == VS_HOMING_LEGS ? now_ns : next->from_ns;

        if (until_ns > from_ns)
            drive_on(way, leg, (int32_t)((uint32_t)(until_ns - from_ns) / 1000000));
    }
}

/* Counter-clockwise from ahead. atan(z) = z (pi/4 + 0.273 (1 - z)) to 0.004 rad: S. Rajan et al.,
 * Efficient approximations for the arctangent function, IEEE Signal Processing Magazine 2006. */
static int32_t bearing(const struct way *way, int32_t most, int32_t least)
{
    int32_t z = (int32_t)(((uint32_t)least << 12) / (uint32_t)most);
    int32_t angle = z * (3217 + (1118 * (4096 - z) >> 12)) >> 4;

    if (magnitude(way->y) > magnitude(way->x))
        angle = 1647099 - angle; /* pi / 2 */
    if (way->x < 0)
        angle = 3294199 - angle; /* pi */
    return way->y < 0 ? -angle : angle;
}

void vs_homing_steer(const struct vs_homing *homing, const struct vs_state *state,
                     uint64_t age_ns, uint64_t now_ns, struct vs_base_command *command)
{
    uint64_t longest_ns = UINT64_C(1000000) * VS_HOMING_LONGEST_MS;
    struct way way = {state->goal_x_mm * 16, state->goal_y_mm * 16,
                      state->goal_heading * 26844 / 256};
    int32_t most, least, far, angle, turn;
    int32_t ahead = 0;

    reckon(homing, &way, now_ns - (age_ns < longest_ns ? age_ns : longest_ns), now_ns);
    most = magnitude(way.x);
    least = magnitude(way.y);
    if (most < least) {
        most = magnitude(way.y);
        least = magnitude(way.x);
    }
    far = (61 * most + 25 * least) >> 6; /* to 4 % */
    angle = far < NEAR ? way.heading : bearing(&way, most, least);
    turn = clamp(clamp(angle, 3 * ONE_RAD) * 514 / ONE_RAD, TURN_MAX); /* 2.5 rad/s for 1 rad */
    if (far >= NEAR && magnitude(angle) < ONE_RAD) {
        ahead = far > 1280 ? AHEAD_MAX : far * 47 >> 6; /* 1.5 mm/s for 1 mm */
        ahead = ahead * ((ONE_RAD - magnitude(angle)) >> 10) >> 10;
        ahead = clamp(ahead, WHEEL_MAX - magnitude(turn));
    }
    command->left_steps_s = (int16_t)(ahead - turn);
    command->right_steps_s = (int16_t)(ahead + turn);
}

void vs_homing_note(struct vs_homing *homing, const struct vs_base_command *command,
                    uint64_t now_ns)
{
    struct vs_leg *leg;

    homing->newest = (uint8_t)((homing->newest + 1) % VS_HOMING_LEGS);
    leg = &homing->legs[homing->newest];
    leg->from_ns = now_ns;
    leg->left_steps_s = command->left_steps_s;
    leg->right_steps_s = command->right_steps_s;
}
