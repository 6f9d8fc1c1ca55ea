/* SPDX-License-Identifier: MIT */
/*
 * vs_sim.h - timesteps of a simulation as far as they are C: the kernels of physics, world,
 * sensors and rings, and the robots' controllers, in the order in which vsense/modes/sim/_simulation.py
 * and vsense/run/environment.py call them. There is nothing here that they do not do, too.
 */
#ifndef VS_SIM_H
#define VS_SIM_H

#include "vs_field.h"
#include "vs_light.h"
#include "vs_cxx.h"
#include "vs_physics.h"
#include "vs_ring.h"
#include "vs_slip.h"
#include "vs_world.h"

/* How far the timestep is; each of these is what was done last. */
#define VS_SIM_BEGUN 0   /* nothing yet */
#define VS_SIM_SEEN 1    /* the world has taken over where everybody is */
#define VS_SIM_EVOLVED 2 /* and what is virtual has changed */
#define VS_SIM_SENSED 3  /* and the sensors are read: rings, controllers and wheels are left */

/* A sensor of the robots of one controller. */
struct vs_sim_sensor {
    int (*read)(const void *sensor, const struct vs_scene *scene, double *readings);
    const void *sensor;
    const struct vs_scene *scene; /* with all robots that have it */
    struct vs_sent *sent;
    const double *noise;          /* of the next timestep, then of those after it; or NULL */
};

/* An actuator of the robots of one controller. */
struct vs_sim_actuator {
    int (*apply)(const void *actuator, const struct vs_scene *scene, const double *levels,
                 const double *growth);
    const void *actuator;
    const struct vs_scene *scene; /* with all robots that have it */
    const struct vs_heard *heard;
};

/* The robots of one controller; robot/inprocess.h has the functions and what they take. */
struct vs_sim_program {
    int (*step)(void *all, void *now);
    void *all;
    void *now;
    uint32_t *timestep;       /* these three are told, in now */
    uint64_t *capture_ns;
    uint64_t *now_ns;
    uint32_t robots;
    const uint32_t *rows;     /* [robots] their numbers among all robots */
    int16_t *prox;            /* [robots * 8] given to them */
    const int16_t *wheels;    /* [robots * 2] what comes of it */
    const uint16_t *leds;     /* [robots] */
    const uint8_t *shown;     /* [shown_bytes] what they show, and what they showed before */
    const uint8_t *shown_before;
    size_t shown_bytes;
    const uint32_t *logged;   /* lines that wait to be read */
    const uint32_t *failed;   /* robots whose controllers cannot go on */
    uint32_t number;          /* of the controller */
};

/* A run. All arrays are the caller's. */
struct vs_sim {
    struct vs_physics *physics;
    struct vs_tracker *tracker;
    struct vs_world *world;
    struct vs_crowd *crowd;       /* NULL: no sensor asks for it */
    const struct vs_sim_actuator *actuators;
    const struct vs_spread *fields; /* after the actuators */
    struct vs_sim_sensor *sensors;
    uint32_t actuators_count;
    uint32_t fields_count;
    uint32_t sensors_count;
    uint32_t programs_count;
    struct vs_sim_program *programs;
    struct vs_cxx *loop;          /* C++ around every timestep, unless stops says so; or NULL */
    struct vs_rings *rings;       /* NULL: nobody asks for them */
    const struct vs_slip *slip;   /* NULL: wheels obey */
    const double *errors;         /* the tracker's, and the rings' noise: of the next timestep, */
    const double *noise;          /* then of those after it */
    uint32_t *present;            /* told which controller runs */
    int16_t *wheels;              /* [robots * 2] and leds [robots]: in force */
    uint16_t *leds;
    double *kept_poses;           /* the record: true poses of all tagged bodies, and the LEDs */
    uint16_t *kept_leds;          /* that robots have, of the next timestep, then of those after */
    int64_t capture_ns;           /* of the next timestep */
    int64_t dt_ns;                /* more than act_ns */
    int64_t sense_ns;             /* from the capture: the rings measure, */
    int64_t control_ns;           /* controllers run, */
    int64_t act_ns;               /* and wheels obey */
    uint32_t timestep;            /* the next one */
    uint32_t done;                /* timesteps of the newest call of vs_sim_run */
    uint32_t at;                  /* VS_SIM_..., of the next timestep; VS_SIM_BEGUN at first */
    uint32_t first;               /* the run's first timestep, whose clock is 1 */
    uint32_t called;              /* functions of the loop in this timestep */
    uint32_t said;                /* VS_CXX_... of the newest one; else 0 */
    uint32_t stops;               /* bits: 1 << VS_SIM_SEEN: come back in every timestep then */
    uint32_t failed;              /* number of the sensor or actuator that an error is of */
};

/*
 * Runs at most so many timesteps, and goes on where it was. It ends after one in which a controller
 * failed, showed something else than before, or logged; after a failure the wheels do not obey. It
 * ends within one where stops says so, or said: then somebody else may change the world, the
 * pointers of this structure, and what they point to, and calls what it has not called. Errors:
 * those of vs_crowd_stand, of actuators, of sensors, of vs_sent_renew and of controllers' steps;
 * after VS_ERR_SPACE it can be called again, with more room in the crowd.
 */
int vs_sim_run(struct vs_sim *sim, uint32_t timesteps);

#endif
