/* SPDX-License-Identifier: MIT */
/* Timesteps of a simulation under the sanitizers: each kernel is called when it is due, with the
 * numbers of its timestep, and what a controller says ends the call. */
#include <string.h>

#include "check.h"
#include "vs_sim.h"

#define ROBOTS 3
#define STEPS 6
#define MS 1000000
#define FIRST_NS 1000000000
#define ROW 45

/* What the controllers are told and say; they note what they were called with. */
struct told {
    uint32_t timestep;
    uint64_t capture_ns;
    uint64_t now_ns;
    uint32_t logged, failed;
    uint32_t calls;
    uint32_t log_at, show_at, fail_at, ended_at; /* timesteps */
    int16_t prox[ROBOTS * 8];
    int16_t wheels[ROBOTS * 2];
    uint16_t leds[ROBOTS];
    uint8_t shown[4], shown_before[4];
};

struct run {
    struct vs_near near;
    struct vs_pair pairs[ROBOTS * ROBOTS];
    uint32_t next[ROBOTS], heads[2 * ROBOTS], newest[ROBOTS], order[ROBOTS], rows[ROBOTS];
    struct vs_contacts contacts;
    struct vs_contact now[ROBOTS * ROBOTS], before[ROBOTS * ROBOTS];
    struct vs_physics physics;
    double radii_m[ROBOTS], searched_m[2 * ROBOTS], moved_m[2 * ROBOTS], poses[3 * ROBOTS];
    double mobility[ROBOTS], wheels_m_s[2 * ROBOTS], last[3 * ROBOTS];
    int16_t commands[2 * ROBOTS], raw[8 * ROBOTS], wheels[2 * ROBOTS];
    int64_t rolled_ns[ROBOTS];
    double arcs[2 * ROBOTS];
    uint8_t states[ROBOTS * ROW], kept[ROBOTS * ROW];
    struct vs_pose_fields fields;
    struct vs_tracker tracker;
    struct vs_world world;
    struct vs_ring ring;
    struct vs_rings rings;
    const struct vs_ring *each[ROBOTS];
    struct vs_drive drives[ROBOTS];
    double zeros[8], ones[8], table_m[2], table_raw[2];
    double distances_m[8 * ROBOTS], clean[8 * ROBOTS];
    double errors[STEPS * 3 * ROBOTS], noise[STEPS * 8 * ROBOTS];
    double kept_poses[STEPS * 3 * ROBOTS];
    uint16_t leds[ROBOTS], kept_leds[STEPS * ROBOTS];
    struct told told;
    struct vs_sim_program program;
    struct vs_sim_sensor sensor;
    struct vs_sent sent;
    double fresh[ROBOTS], offsets[STEPS * ROBOTS], unit, low, high;
    float block[ROBOTS];
    int64_t captures_ns[ROBOTS];
    uint32_t present, measured, applied, refuse_at;
    struct vs_sim sim;
};

static int step(void *all, void *now)
{
    struct told *told = now;
    uint32_t i;

    CHECK(all == (void *)told);
    if (told->timestep == told->ended_at)
        return VS_ERR_STATE;
    told->calls++;
    told->logged = told->timestep == told->log_at;
    told->failed = told->timestep == told->fail_at;
    told->shown[0] = told->timestep >= told->show_at;
    for (i = 0; i < ROBOTS; i++) {
        told->wheels[2 * i] = told->wheels[2 * i + 1] = (int16_t)(100 * (i + 1));
        told->leds[i] = (uint16_t)(told->timestep + 10 * i);
    }
    return VS_OK;
}

static int read(const void *sensor, const struct vs_scene *scene, double *readings)
{
    struct run *run = (struct run *)(uintptr_t)sensor;
    uint32_t i;

    CHECK(scene == NULL);
    for (i = 0; i < ROBOTS; i++)
        readings[i] = run->measured;
    run->measured++;
    return VS_OK;
}

static void set_floor(struct run *r)
{
    uint32_t i;

    r->near.robots = r->near.bodies = ROBOTS;
    r->near.radii_m = r->radii_m;
    r->near.searched_m = r->searched_m;
    r->near.pairs = r->pairs;
    r->near.next = r->next;
    r->near.heads = r->heads;
    r->contacts.near = &r->near;
    r->contacts.mobility = r->physics.mobility = r->mobility;
    r->contacts.now = r->now;
    r->contacts.before = r->before;
    r->contacts.moved_m = r->moved_m;
    r->contacts.newest = r->newest;
    r->physics.contacts = &r->contacts;
    r->physics.poses = r->poses;
    r->physics.wheels_m_s = r->wheels_m_s;
    r->physics.commands = r->commands;
    r->physics.rolled_ns = r->rolled_ns;
    r->physics.arcs = r->arcs;
    r->physics.drives = r->drives;
    r->near.reach_m = 0.11;
    for (i = 0; i < ROBOTS; i++) {
        static const struct vs_drive epuck = {1.288e-4, 0.5 / 0.053, 0.0, 1.0, 10000, 1000};

        r->drives[i] = epuck;
        r->radii_m[i] = 0.035;
        r->poses[3 * i + 1] = i;
    }
    vs_physics_init(&r->physics, FIRST_NS);
}

static void set_rings(struct run *r)
{
    uint32_t i;

    r->ring.sensors = 8;
    r->ring.rays = 1;
    r->ring.from_x_m = r->ring.from_y_m = r->ring.ray_y = r->zeros;
    r->ring.ray_x = r->ring.response = r->ones;
    r->table_m[1] = 0.07;
    r->table_raw[0] = 4095.0;
    r->table_raw[1] = 67.0;
    r->ring.points = 2;
    r->ring.table_m = r->table_m;
    r->ring.table_raw = r->table_raw;
    for (i = 0; i < ROBOTS; i++)
        r->each[i] = &r->ring;
    r->rings.rings = r->each;
    r->rings.near = &r->near;
    r->rings.distances_m = r->distances_m;
    r->rings.clean = r->clean;
    r->rings.raw = r->raw;
}

static void set_sensor(struct run *r)
{
    struct vs_sent sent = {ROBOTS, 1, VS_NUMBER_F4, (uint8_t *)r->block, sizeof(float),
                           r->captures_ns, 1, r->fresh, NULL, &r->unit, &r->low, &r->high};

    r->sent = sent;
    r->unit = 1.0;
    r->low = -10.0;
    r->high = 10.0;
    r->sensor.read = read;
    r->sensor.sensor = r;
    r->sensor.sent = &r->sent;
    r->sensor.noise = r->offsets;
    r->sim.sensors = &r->sensor;
    r->sim.sensors_count = 1;
}

static void set_program(struct run *r)
{
    struct told *told = &r->told;

    told->log_at = told->show_at = told->fail_at = told->ended_at = 1000;
    r->program.step = step;
    r->program.failed = &told->failed;
    r->program.all = r->program.now = told;
    r->program.timestep = &told->timestep;
    r->program.capture_ns = &told->capture_ns;
    r->program.now_ns = &told->now_ns;
    r->program.robots = ROBOTS;
    r->program.rows = r->rows;
    r->program.prox = told->prox;
    r->program.wheels = told->wheels;
    r->program.leds = told->leds;
    r->program.shown = told->shown;
    r->program.shown_before = told->shown_before;
    r->program.shown_bytes = sizeof told->shown;
    r->program.logged = &told->logged;
    r->program.number = 5;
    r->sim.programs = &r->program;
    r->sim.programs_count = 1;
}

static void set_world(struct run *r)
{
    const struct vs_pose_fields fields = {ROW, 1, 5, 29, 37, 0};
    uint32_t i;

    r->fields = fields;
    for (i = 0; i < ROBOTS; i++) {
        r->order[i] = r->rows[i] = i;
        r->states[i * ROW] = 1;
        r->states[i * ROW + 1] = r->kept[i * ROW + 1] = (uint8_t)(i + 1);
    }
    r->tracker.fields = r->world.fields = &r->fields;
    r->tracker.count = r->world.real = r->world.robots_all = ROBOTS;
    r->tracker.order = r->order;
    r->tracker.states = r->states;
    r->tracker.last = r->last;
    r->tracker.last_ns = -1;
    r->world.robots = r->kept;
    r->world.things = r->kept + ROBOTS * ROW;
}

static void begin(struct run *r)
{
    uint32_t i;

    memset(r, 0, sizeof *r);
    for (i = 0; i < 8; i++)
        r->ones[i] = 1.0;
    for (i = 0; i < STEPS * 8 * ROBOTS; i++)
        r->noise[i] = i / (8 * ROBOTS);
    for (i = 0; i < STEPS * ROBOTS; i++)
        r->offsets[i] = 0.25 * (i / ROBOTS);
    set_floor(r);
    set_rings(r);
    set_world(r);
    set_sensor(r);
    set_program(r);
    r->sim.physics = &r->physics;
    r->sim.tracker = &r->tracker;
    r->sim.world = &r->world;
    r->sim.rings = &r->rings;
    r->sim.errors = r->errors;
    r->sim.noise = r->noise;
    r->sim.present = &r->present;
    r->sim.wheels = r->wheels;
    r->sim.leds = r->leds;
    r->sim.kept_poses = r->kept_poses;
    r->sim.kept_leds = r->kept_leds;
    r->sim.capture_ns = FIRST_NS;
    r->sim.dt_ns = 100 * MS;
    r->sim.sense_ns = 20 * MS;
    r->sim.control_ns = 30 * MS;
    r->sim.act_ns = 31 * MS;
}

static void all_timesteps_have_what_is_theirs(struct run *r)
{
    double m_s;
    uint32_t i, k;

    begin(r);
    CHECK(vs_sim_run(&r->sim, STEPS) == VS_OK && r->sim.done == STEPS);
    CHECK(r->told.calls == STEPS && r->measured == STEPS && r->present == 5);
    CHECK(r->told.timestep == STEPS - 1);
    CHECK(r->told.capture_ns == FIRST_NS + 100 * MS * (STEPS - 1));
    CHECK(r->told.now_ns == r->told.capture_ns + 30 * MS);
    CHECK(r->told.prox[0] == 67 + STEPS - 1);
    CHECK(r->block[1] == 1.25f * (STEPS - 1));
    CHECK(r->captures_ns[2] == FIRST_NS + 100 * MS * (STEPS - 1));
    for (k = 0; k < STEPS; k++)
        for (i = 0; i < ROBOTS; i++) {
            m_s = r->physics.wheels_m_s[2 * i];
            m_s *= k == 0 ? 0.0 : 0.1 * k - 0.031;
            CHECK(m_s - r->kept_poses[3 * (k * ROBOTS + i)] < 1e-12);
            CHECK(r->kept_poses[3 * (k * ROBOTS + i)] - m_s < 1e-12);
            CHECK(r->kept_leds[k * ROBOTS + i] == (k == 0 ? 0 : k - 1 + 10 * i));
        }
}

static void news_end_the_call(struct run *r)
{
    begin(r);
    r->told.log_at = 1;
    r->told.show_at = 3;
    r->told.fail_at = 4;
    CHECK(vs_sim_run(&r->sim, STEPS) == VS_OK && r->sim.done == 2);
    CHECK(vs_sim_run(&r->sim, 1) == VS_OK && r->sim.done == 1);
    CHECK(vs_sim_run(&r->sim, 3) == VS_OK && r->sim.done == 1);
    memcpy(r->told.shown_before, r->told.shown, sizeof r->told.shown);
    CHECK(r->leds[0] == 3);
    CHECK(vs_sim_run(&r->sim, 2) == VS_OK && r->sim.done == 1);
    CHECK(r->leds[0] == 3 && r->told.leds[0] == 4); /* wheels and LEDs do not obey */
}

static void noise_ends_where_singles_do(struct run *r)
{
    begin(r);
    r->high = r->low = 1e300;
    r->offsets[0] = 1.0;
    CHECK(vs_sim_run(&r->sim, 1) == VS_OK);
    CHECK(r->block[0] > 3.4e38f); /* noise is limited to what can travel */
    r->measured = 0;
    r->sensor.noise = NULL;
    r->unit = 0.0;
    CHECK(vs_sim_run(&r->sim, 1) == VS_OK && r->block[0] == 0.0f);
}

static int apply(const void *actuator, const struct vs_scene *scene, const double *levels,
                 const double *growth)
{
    struct run *run = (struct run *)(uintptr_t)actuator;

    CHECK(scene == NULL && levels[0] == growth[0]);
    run->applied++;
    return run->applied == run->refuse_at ? VS_ERR_ARGUMENT : VS_OK;
}

/* Actuators act before fields change, once in every timestep. */
static void what_is_virtual_evolves(struct run *r)
{
    static const uint8_t report = 7;
    double last = 0.0, level, growth, low = 0.0, high = 9.0, cell = 1.0, before;
    struct vs_heard heard = {1, 1, VS_NUMBER_U1, &report, 1, &low, &high, &last, &level, &growth};
    struct vs_sim_actuator actuator = {apply, r, NULL, &heard};
    struct vs_field field = {1, 1, {0.0, 0.0}, 1.0, &cell};
    struct vs_spread spread = {&field, 1, 0.2, 0.5, &before};

    begin(r);
    r->sim.actuators = &actuator;
    r->sim.fields = &spread;
    r->sim.actuators_count = r->sim.fields_count = 1;
    CHECK(vs_sim_run(&r->sim, 1) == VS_OK && r->applied == 1 && cell == 0.5);
    CHECK(level == 7.0 && last == 7.0);
    last = 0.0;
    r->refuse_at = 2;
    CHECK(vs_sim_run(&r->sim, 2) == VS_ERR_ARGUMENT && r->sim.done == 0);
    CHECK(r->sim.at == VS_SIM_SEEN && r->sim.failed == 0 && cell == 0.5 && r->measured == 1);
}

/* Whoever wants to comes in between, and each part of a timestep happens once. */
static void it_comes_back_where_it_is_told(struct run *r)
{
    uint32_t k;

    begin(r);
    r->sim.stops = 1u << VS_SIM_SEEN | 1u << VS_SIM_SENSED;
    r->told.log_at = 1;
    for (k = 0; k < STEPS; k++) {
        CHECK(vs_sim_run(&r->sim, STEPS) == VS_OK);
        if (k == 2) { /* the controllers have logged: that comes first */
            CHECK(r->sim.done == 1 && r->sim.at == VS_SIM_BEGUN);
            CHECK(vs_sim_run(&r->sim, STEPS) == VS_OK);
        }
        CHECK(r->sim.done == (k != 0 && k != 2) && r->sim.at == VS_SIM_SEEN);
        CHECK(r->measured == k && r->told.calls == k && r->sim.timestep == k);
        CHECK(vs_sim_run(&r->sim, STEPS) == VS_OK && r->sim.done == 0);
        CHECK(r->sim.at == VS_SIM_SENSED && r->measured == k + 1 && r->told.calls == k);
        CHECK(r->captures_ns[0] == FIRST_NS + 100 * MS * k);
    }
    CHECK(vs_sim_run(&r->sim, 1) == VS_OK && r->sim.done == 1 && r->told.calls == STEPS);
    CHECK(r->sim.at == VS_SIM_BEGUN);
}

/* Controllers after their end are an error, not a timestep. */
static void nobody_steps_who_has_ended(struct run *r)
{
    begin(r);
    r->told.ended_at = 2;
    CHECK(vs_sim_run(&r->sim, STEPS) == VS_ERR_STATE && r->sim.done == 2);
    CHECK(r->sim.timestep == 2 && r->told.calls == 2);
}

int main(void)
{
    static struct run run;

    all_timesteps_have_what_is_theirs(&run);
    news_end_the_call(&run);
    noise_ends_where_singles_do(&run);
    what_is_virtual_evolves(&run);
    it_comes_back_where_it_is_told(&run);
    nobody_steps_who_has_ended(&run);
    return 0;
}
