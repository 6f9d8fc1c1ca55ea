/* SPDX-License-Identifier: MIT */
#include "vs_sim.h"

#include <string.h>

#include "../vs_err.h"
#include "vs_cxx_step.h"
#include "vs_place.h"

/* Everything moves on to the capture, the tracker sees it, and the world takes that over. */
static void see(struct vs_sim *sim)
{
    vs_physics_advance(sim->physics, sim->capture_ns);
    vs_tracker_see(sim->tracker, sim->physics->poses, sim->errors, sim->capture_ns);
    sim->errors += 3 * (size_t)sim->tracker->count;
    vs_world_update(sim->world, sim->tracker->states, sim->tracker->count, sim->capture_ns);
}

/* Actuators act, and fields change. */
static int evolve(struct vs_sim *sim)
{
    uint32_t i;

    for (i = 0; i < sim->actuators_count; i++) {
        const struct vs_sim_actuator *one = &sim->actuators[i];
        int err;

        sim->failed = i;
        vs_heard_renew(one->heard);
        err = one->apply(one->actuator, one->scene, one->heard->levels, one->heard->growth);
        if (err != VS_OK)
            return err;
    }
    for (i = 0; i < sim->fields_count; i++)
        vs_spread_step(&sim->fields[i]);
    return VS_OK;
}

static int measure(struct vs_sim *sim)
{
    uint32_t i;

    for (i = 0; i < sim->sensors_count; i++) {
        struct vs_sim_sensor *one = &sim->sensors[i];
        int err = one->read(one->sensor, one->scene, one->sent->fresh);

        sim->failed = i;
        if (err != VS_OK)
            return err;
        one->sent->offsets = one->noise;
        err = vs_sent_renew(one->sent, sim->capture_ns);
        if (err != VS_OK)
            return err;
        if (one->noise)
            one->noise += (size_t)one->sent->robots * one->sent->count;
    }
    return VS_OK;
}

static int sense(struct vs_sim *sim)
{
    int err = sim->crowd ? vs_crowd_stand(sim->crowd, sim->capture_ns) : VS_OK;

    return err == VS_OK ? measure(sim) : err;
}

/* The record's row of this timestep. */
static void keep(struct vs_sim *sim)
{
    size_t tagged = sim->tracker->count;
    size_t robots = sim->physics->contacts->near->robots;

    memcpy(sim->kept_poses, sim->physics->poses, 3 * tagged * sizeof *sim->kept_poses);
    memcpy(sim->kept_leds, sim->leds, robots * sizeof *sim->kept_leds);
    sim->kept_poses += 3 * tagged;
    sim->kept_leds += robots;
}

static void give_prox(const struct vs_sim *sim, const struct vs_sim_program *program)
{
    uint32_t i;

    for (i = 0; i < program->robots && sim->rings; i++)
        memcpy(program->prox + VS_RING_SENSORS * i,
               sim->rings->raw + VS_RING_SENSORS * program->rows[i],
               VS_RING_SENSORS * sizeof *program->prox);
}

/* Runs the controllers of a program. */
static int control(struct vs_sim *sim, const struct vs_sim_program *program)
{
    give_prox(sim, program);
    *sim->present = program->number;
    *program->timestep = sim->timestep;
    *program->capture_ns = (uint64_t)sim->capture_ns;
    *program->now_ns = (uint64_t)(sim->capture_ns + sim->control_ns);
    return program->step(program->all, program->now);
}

static int has_said(const struct vs_sim_program *program)
{
    return *program->logged != 0 ||
           memcmp(program->shown, program->shown_before, program->shown_bytes) != 0;
}

/* Wheels and LEDs follow the controllers. */
static void obey(struct vs_sim *sim)
{
    uint32_t p, i;

    for (p = 0; p < sim->programs_count; p++) {
        const struct vs_sim_program *program = &sim->programs[p];

        for (i = 0; i < program->robots; i++) {
            uint32_t row = program->rows[i];

            memcpy(sim->wheels + 2 * row, program->wheels + 2 * i, 2 * sizeof *sim->wheels);
            sim->leds[row] = program->leds[i];
        }
    }
    if (sim->slip)
        vs_slip_apply(sim->slip, sim->wheels);
    vs_physics_advance(sim->physics, sim->capture_ns + sim->act_ns);
    vs_physics_drive_all(sim->physics, sim->wheels, sim->capture_ns + sim->act_ns);
}

/* Rings, controllers and wheels of a timestep; has_news: whether the host has to look. */
static int act(struct vs_sim *sim, int *has_news)
{
    uint32_t p;

    vs_physics_advance(sim->physics, sim->capture_ns + sim->sense_ns);
    if (sim->rings) {
        vs_rings_read(sim->rings, sim->physics->poses, sim->noise);
        sim->noise += (size_t)sim->rings->near->robots * VS_RING_SENSORS;
    }
    for (p = 0; p < sim->programs_count; p++) {
        int err = control(sim, &sim->programs[p]);

        if (err != VS_OK)
            return err;
        if (*sim->programs[p].failed != 0) {
            *has_news = 1;
            return VS_OK;
        }
        *has_news |= has_said(&sim->programs[p]);
    }
    obey(sim);
    return VS_OK;
}

static int end(struct vs_sim *sim, int *has_news)
{
    int err;

    keep(sim);
    err = act(sim, has_news);
    if (err != VS_OK)
        return err;
    sim->called = 0;
    sim->timestep++;
    sim->capture_ns += sim->dt_ns;
    sim->done++;
    return VS_OK;
}

/* Calls what is due of the loop, up to so many functions of a timestep; 0: somebody has to look. */
static int call_loop(struct vs_sim *sim, uint32_t functions)
{
    if (!sim->loop || (sim->stops >> sim->at & 1u) != 0)
        return 1;
    while (sim->called < functions && sim->said == 0) {
        uint32_t clock = sim->timestep - sim->first + 1;

        sim->said = (uint32_t)vs_cxx_step(sim->loop, sim->called, sim->timestep, clock);
        sim->called += sim->said != VS_CXX_SHINES;
    }
    return sim->said == 0;
}

/* The next part of a timestep; has_news is told at its end. */
static int go_on(struct vs_sim *sim, int *has_news)
{
    int err = VS_OK;

    if ((sim->at == VS_SIM_SEEN && !call_loop(sim, VS_CXX_POST_STEP)) ||
        (sim->at == VS_SIM_SENSED && !call_loop(sim, VS_CXX_FLOOR)))
        return VS_OK;
    if (sim->at == VS_SIM_BEGUN)
        see(sim);
    else if (sim->at == VS_SIM_SEEN)
        err = evolve(sim);
    else if (sim->at == VS_SIM_EVOLVED)
        err = sense(sim);
    else
        err = end(sim, has_news);
    if (err == VS_OK)
        sim->at = sim->at == VS_SIM_SENSED ? VS_SIM_BEGUN : sim->at + 1;
    return err;
}

int vs_sim_run(struct vs_sim *sim, uint32_t timesteps)
{
    int has_news = 0;

    sim->done = sim->said = 0;
    while (sim->at != VS_SIM_BEGUN || sim->done < timesteps) {
        int err = go_on(sim, &has_news);

        if (err != VS_OK)
            return err;
        if (has_news || sim->said != 0 || (sim->stops >> sim->at & 1u) != 0)
            break;
    }
    return VS_OK;
}
