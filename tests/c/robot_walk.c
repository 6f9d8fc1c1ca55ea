/* SPDX-License-Identifier: MIT */
/* The wandering that all shipped controllers share: what the pollutant controller did before it
 * was shared, number by number, and what every controller may expect of it. */
#include <math.h>
#include <string.h>

#include "robot_check.h"
#include "robot.h"
#include "../../c_src/vs_bytes.h"

#define MS UINT64_C(1000000)
#define STEPS 4000

struct world {
    struct vs_session session;
    struct vs_robot robot;
    uint64_t state[VS_CONTROLLER_STATE_MAX / 8];
};

static void begin(struct world *w, uint32_t seed, const char *params)
{
    struct vs_session_config config;

    memset(w, 0, sizeof *w);
    memset(&config, 0, sizeof config);
    config.tag = 5;
    CHECK(vs_session_init(&w->session, &config) == VS_OK);
    w->session.seed = seed;
    w->session.timestep_ns = 100 * MS;
    w->session.timestep_s = 0.1;
    strcpy(w->session.params, params);
    CHECK(vs_table_add(&w->session.table, 1, VS_SENSOR, "pollutant", "f4") == VS_OK);
    w->session.capture_ns = 5000 * MS;
    w->robot.session_ns = 9000 * MS;
    w->robot.now_ns = w->robot.base_ns = 1000 * MS;
    /* host's clock = ours - 4 s, known exactly */
    CHECK(vs_clock_sample(&w->session.clock, 1, (uint64_t)1 - 4000 * MS, 0, 1) == VS_OK);
    vs_robot_begin(&w->robot, &w->session);
}

/* Something stands here and there for a while, and the pollutant comes and goes. */
static void change(struct world *w, uint32_t *random)
{
    int i;

    if (draw(random, 12) == 0) {
        memset(w->robot.base.prox, 0, sizeof w->robot.base.prox);
        for (i = (int)draw(random, 3); i > 0; i--)
            w->robot.base.prox[draw(random, 8)] = (int16_t)draw(random, 1200);
    }
    if (draw(random, 15) == 0)
        vs_store_f4(w->session.state.payload, draw(random, 3) == 0 ? 1.0f : 0.0f);
    w->session.state.older_us[0] = draw(random, 10) == 0 ? 300000 : 0;
}

/* Checksum of wheels, LEDs and the generator's state over a run of the pollutant controller. */
static uint32_t live(uint32_t seed, const char *params)
{
    static uint8_t record[STEPS * 14];
    struct world w;
    struct vs_writer out;
    uint32_t random = seed * 2654435761u + 1u;
    int i;

    begin(&w, seed, params);
    vs_writer_init(&out, record, sizeof record);
    vs_controller.init(w.state, &w.robot);
    for (i = 0; i < STEPS; i++) {
        change(&w, &random);
        vs_controller.step(w.state, &w.robot);
        vs_put_u16(&out, (uint16_t)w.robot.command.left_steps_s);
        vs_put_u16(&out, (uint16_t)w.robot.command.right_steps_s);
        vs_put_u16(&out, w.robot.command.leds);
        vs_put_u64(&out, w.robot.random);
    }
    CHECK(out.error == VS_OK && out.len == sizeof record);
    return vs_crc32(record, sizeof record);
}

/* Recorded from the pollutant controller as it was when the thesis's experiment was measured,
 * before its wandering moved to walk.c. */
static void test_the_cleaners_walk_what_they_always_walked(void)
{
    static const struct {
        uint32_t seed;
        const char *params;
        uint32_t checksum;
    } rows[] = {
        {1, "", 0xE363DF63},
        {2, "stop_probability=1\n", 0x6939FB4D},
        {3, "speed_cm_s=3\nwalk_s=0.5\nnear_raw=300\n", 0xF757A5F0},
        {4, "speed_cm_s=99\nwalk_s=0\nstop_probability=0\n", 0x6EFDA708},
        {5, "speed_cm_s=-1\n", 0x5047623D},
    };
    size_t i;

    for (i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        char what[40];
        uint32_t checksum = live(rows[i].seed, rows[i].params);

        snprintf(what, sizeof what, "seed %u gave 0x%08X", rows[i].seed, checksum);
        CHECK_FOR(what, checksum == rows[i].checksum);
    }
}

struct walker {
    struct world world;
    struct vs_walk walk;
};

static void begin_walker(struct walker *w, const char *params)
{
    begin(&w->world, 42, params);
    vs_walk_init(&w->walk, &w->world.robot);
}

static double left(const struct walker *w)
{
    return w->world.robot.command.left_steps_s;
}

static double right(const struct walker *w)
{
    return w->world.robot.command.right_steps_s;
}

/* Towards a bearing: straight on ahead, a curve to its side, on the spot from 90 degrees. */
static void test_steers_to_the_side_of_the_goal(void)
{
    struct walker w;
    int degrees;

    begin_walker(&w, "");
    for (degrees = -720; degrees <= 720; degrees += 5) {
        int side = (degrees % 360 + 360) % 360;
        double turn;

        vs_walk_towards(&w.walk, &w.world.robot, degrees * 3.14159265358979 / 180.0);
        turn = right(&w) - left(&w);
        CHECK(fabs(left(&w)) <= 777 && fabs(right(&w)) <= 777);
        if (side == 0)
            CHECK(fabs(turn) <= 1 && left(&w) > 770);
        else if (side != 180)
            CHECK(side < 180 ? turn > 10 : turn < -10);
        if (side >= 90 && side <= 270)
            CHECK(fabs(right(&w) + left(&w)) <= 1 && fabs(turn) > 920);
        else
            CHECK(right(&w) + left(&w) > 0);
    }
    vs_walk_towards(&w.walk, &w.world.robot, (double)NAN);
    CHECK(fabs(right(&w) - left(&w)) <= 1 && left(&w) > 770);
    vs_walk_towards(&w.walk, &w.world.robot, (double)INFINITY);
    CHECK(fabs(right(&w) - left(&w)) <= 1 && left(&w) > 770);
}

/* The unicycle that the wheels make of it arrives, wherever the goal lies. */
static void test_reaches_a_goal(void)
{
    int start;

    for (start = 0; start < 24; start++) {
        struct walker w;
        double x_cm = 0.0;
        double y_cm = 0.0;
        double yaw_rad = start * 3.14159265358979 / 12.0;
        int i;

        begin_walker(&w, "");
        for (i = 0; i < 100 && hypot(50.0 - x_cm, 20.0 - y_cm) > 2.0; i++) {
            double forwards_cm;

            vs_walk_towards(&w.walk, &w.world.robot, atan2(20.0 - y_cm, 50.0 - x_cm) - yaw_rad);
            forwards_cm = (left(&w) + right(&w)) / 2.0 / VS_ROBOT_STEPS_PER_CM * 0.1;
            yaw_rad += (right(&w) - left(&w)) / 5.3 / VS_ROBOT_STEPS_PER_CM * 0.1;
            x_cm += forwards_cm * cos(yaw_rad);
            y_cm += forwards_cm * sin(yaw_rad);
        }
        CHECK(hypot(50.0 - x_cm, 20.0 - y_cm) <= 2.0);
    }
}

/* Away from what stands ahead, past it for a while, and only then back to the goal. */
static void test_passes_an_obstacle_on_the_way_to_the_goal(void)
{
    struct walker w;
    int passed = 0;
    int i;

    begin_walker(&w, "");
    w.world.robot.base.prox[0] = 1000;
    for (i = 0; i < 5; i++) {
        vs_walk_towards(&w.walk, &w.world.robot, 0.0);
        CHECK(left(&w) < 0 && right(&w) > 0);
    }
    memset(w.world.robot.base.prox, 0, sizeof w.world.robot.base.prox);
    for (i = 0; i < 40; i++) {
        vs_walk_towards(&w.walk, &w.world.robot, 1.0);
        passed += w.walk.activity == VS_WALK_PASS;
    }
    CHECK(passed > 0 && passed <= 10);
    CHECK(w.walk.activity == VS_WALK_STEER && right(&w) > left(&w));
}

/* Whatever is asked for in whatever order, wheels keep within the speed and nothing sticks. */
static void test_any_mixture_of_wishes(void)
{
    struct walker w;
    uint32_t random = 7;
    int wandered = 0;
    int i;

    begin_walker(&w, "speed_cm_s=5\nwalk_s=1\n");
    for (i = 0; i < 20000; i++) {
        uint32_t wish = draw(&random, 3);

        change(&w.world, &random);
        if (wish == 0)
            vs_walk_wander(&w.walk, &w.world.robot);
        else if (wish == 1)
            vs_walk_towards(&w.walk, &w.world.robot, draw(&random, 100) / 10.0 - 5.0);
        else
            vs_walk_rest(&w.walk, &w.world.robot);
        CHECK(fabs(left(&w)) <= 389 && fabs(right(&w)) <= 389);
        CHECK(wish != 2 || (fabs(left(&w)) < 1 && fabs(right(&w)) < 1));
        wandered += wish == 0 && w.walk.activity == VS_WALK_STRAIGHT;
    }
    CHECK(wandered > 1000);
}

int main(void)
{
    test_steers_to_the_side_of_the_goal();
    test_reaches_a_goal();
    test_passes_an_obstacle_on_the_way_to_the_goal();
    test_any_mixture_of_wishes();
    test_the_cleaners_walk_what_they_always_walked();
    return 0;
}
