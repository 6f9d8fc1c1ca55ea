/* SPDX-License-Identifier: MIT */
#include "vs_physics.h"

#include <stddef.h>

#include "vs_contacts.h"
#include "vs_math.h"

/* How readily a robot with blocked wheels gives way, beside 1 for one whose wheels turn.
 * Both weigh the same, so a pusher's tyres slip about as easily as those of a pushed robot
 * drag: it creeps, at a fifth of the pusher's speed. */
#define STANDING_MOBILITY 0.25

/* Speed over ground of a wheel [m/s] that was commanded to turn at steps_s. */
static double wheel_m_s(const struct vs_drive *drive, int steps_s)
{
    int size = steps_s < 0 ? -steps_s : steps_s;
    double speed_m_s;

    if (size == 0)
        return 0.0;
    if (size > drive->max_steps_s)
        size = drive->max_steps_s;
    if (drive->timer_hz > size)
        speed_m_s = (double)drive->timer_hz / (drive->timer_hz / size) * drive->step_m;
    else
        speed_m_s = (double)size * drive->step_m;
    return steps_s < 0 ? -speed_m_s : speed_m_s;
}

/* sin(x) / x. */
static double sinc(double x)
{
    double sine;
    double cosine;

    if (x > -1e-4 && x < 1e-4)
        return 1.0 - x * x / 6.0;
    vs_sin_cos(x, &sine, &cosine);
    return sine / x;
}

/* Rolls a robot along its arc, exactly. Most ticks are as long as the one before. */
static void roll(struct vs_physics *physics, uint32_t robot, int64_t time_ns)
{
    double *pose = physics->poses + 3 * robot;
    const double *wheels_m_s = physics->wheels_m_s + 2 * robot;
    double duration_s = (double)(time_ns - physics->rolled_ns[robot]) * 1e-9;
    double way_m = (wheels_m_s[0] + wheels_m_s[1]) * 0.5 * duration_s;
    double half_turn = physics->built != NULL ? 0.5 / physics->built[3 * robot + 2] :
                       physics->drives[robot].half_turn;
    double half_turn_rad = (wheels_m_s[1] - wheels_m_s[0]) * half_turn * duration_s;
    double *arc = physics->arcs + 2 * robot;
    double sine;
    double cosine;

    physics->rolled_ns[robot] = time_ns;
    if (half_turn_rad != arc[0]) {
        arc[0] = half_turn_rad;
        arc[1] = sinc(half_turn_rad);
    }
    if (way_m != 0.0) {
        double chord_m = way_m * arc[1];

        vs_sin_cos(pose[2] + half_turn_rad, &sine, &cosine);
        pose[0] += chord_m * cosine;
        pose[1] += chord_m * sine;
    }
    pose[2] = vs_wrap_angle(pose[2] + 2.0 * half_turn_rad);
}

void vs_physics_init(struct vs_physics *physics, int64_t time_ns)
{
    struct vs_near *near = physics->contacts->near;
    uint32_t b;

    physics->tick_ns = time_ns;
    for (b = 0; b < near->bodies; b++)
        physics->poses[3 * b + 2] = vs_wrap_angle(physics->poses[3 * b + 2]);
    for (b = 0; b < near->robots; b++) {
        physics->mobility[b] = physics->drives[b].mobility * STANDING_MOBILITY;
        physics->rolled_ns[b] = time_ns;
        physics->arcs[2 * b] = 0.0;
        physics->arcs[2 * b + 1] = 1.0;
        physics->wheels_m_s[2 * b] = physics->wheels_m_s[2 * b + 1] = 0.0;
        physics->commands[2 * b] = physics->commands[2 * b + 1] = 0;
    }
    vs_near_update(near, physics->poses, 3);
}

static int16_t limited(int steps_s, int32_t most)
{
    if (steps_s > most)
        return (int16_t)most;
    return steps_s < -most ? (int16_t)-most : (int16_t)steps_s;
}

/* What the wheels of a robot are to do [m/s], as it is built. */
static void aim(const struct vs_physics *physics, uint32_t robot, double aims_m_s[2])
{
    uint32_t side;

    for (side = 0; side < 2; side++) {
        aims_m_s[side] =
            wheel_m_s(&physics->drives[robot], physics->commands[2 * robot + side]);
        if (physics->built != NULL)
            aims_m_s[side] *= physics->built[3 * robot + side];
    }
}

/* Brings the wheels of a robot with inertia nearer to what they are told. */
static void speed_up(struct vs_physics *physics, uint32_t robot, double duration_s)
{
    double most_m_s = physics->drives[robot].most_m_s2 * duration_s;
    double aims_m_s[2];
    uint32_t side;

    aim(physics, robot, aims_m_s);
    for (side = 0; side < 2; side++) {
        double *now_m_s = &physics->wheels_m_s[2 * robot + side];
        double lacking_m_s = aims_m_s[side] - *now_m_s;

        *now_m_s += vs_most(-most_m_s, vs_least(lacking_m_s, most_m_s));
    }
}

void vs_physics_drive(struct vs_physics *physics, uint32_t robot, int left_steps_s,
                      int right_steps_s, int64_t time_ns)
{
    int16_t *command = physics->commands + 2 * robot;
    const struct vs_drive *drive = &physics->drives[robot];
    int16_t left = limited(left_steps_s, drive->max_steps_s);
    int16_t right = limited(right_steps_s, drive->max_steps_s);

    if (left == command[0] && right == command[1])
        return;
    if (time_ns > physics->rolled_ns[robot])
        roll(physics, robot, time_ns);
    command[0] = left;
    command[1] = right;
    if (drive->most_m_s2 == 0.0)
        aim(physics, robot, physics->wheels_m_s + 2 * robot);
    physics->mobility[robot] =
        drive->mobility * (left != 0 || right != 0 ? 1.0 : STANDING_MOBILITY);
}

void vs_physics_drive_all(struct vs_physics *physics, const int16_t *commands,
                          int64_t time_ns)
{
    uint32_t robot;

    for (robot = 0; robot < physics->contacts->near->robots; robot++)
        vs_physics_drive(physics, robot, commands[2 * robot], commands[2 * robot + 1],
                         time_ns);
}

void vs_physics_tick(struct vs_physics *physics, int64_t time_ns)
{
    uint32_t robot;

    for (robot = 0; robot < physics->contacts->near->robots; robot++) {
        if (physics->drives[robot].most_m_s2 > 0.0)
            speed_up(physics, robot, (double)(time_ns - physics->tick_ns) * 1e-9);
        roll(physics, robot, time_ns);
    }
    vs_contacts_separate(physics->contacts, physics->poses, 3);
    physics->tick_ns = time_ns;
}

void vs_physics_advance(struct vs_physics *physics, int64_t time_ns)
{
    while (time_ns - physics->tick_ns > VS_TICK_NS)
        vs_physics_tick(physics, physics->tick_ns + VS_TICK_NS);
    if (time_ns > physics->tick_ns)
        vs_physics_tick(physics, time_ns);
}
