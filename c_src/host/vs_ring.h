/* SPDX-License-Identifier: MIT */
/*
 * vs_ring.h - the infrared proximity rings of robots: rays from every sensor to the bodies
 * and boxes near the robot, and what an emitter and receiver make of them.
 */
#ifndef VS_RING_H
#define VS_RING_H

#include "vs_physics.h"

#define VS_RING_SENSORS 8 /* most of one robot */
#define VS_RING_TABLE_MAX 16
#define VS_RING_RAW_MAX 4095 /* largest value of the converter */

/* A ring, in the robot's frame: x forward, y left [m]. All arrays are the caller's. */
struct vs_ring {
    uint32_t sensors;         /* VS_RING_SENSORS at most */
    uint32_t rays;            /* of one sensor, in all rings the same; below, ray r of sensor s is at s * rays + r */
    const double *from_x_m;   /* [sensors * rays] where each ray starts */
    const double *from_y_m;
    const double *ray_x;      /* [sensors * rays] its unit vector */
    const double *ray_y;
    const double *response;   /* [rays] how strongly a ray's reflection counts, 0..1 */
    uint32_t points;          /* of the table, 2..VS_RING_TABLE_MAX */
    const double *table_m;    /* [points] distances, rising */
    const double *table_raw;  /* [points] readings there; the last is also that of nothing */
    const uint8_t *stand_in;  /* [VS_RING_SENSORS] for each sensor of an e-puck, bits of those that
                                 stand in for it, 0: it sees nothing; NULL: they come as they are */
};

/*
 * What n sensors make of the distances along their rays [n * rays], without noise: the raw
 * value of the ray that reflects most.
 */
void vs_ring_readings(const struct vs_ring *ring, const double *distances_m, uint32_t n,
                      double *raw);

/* The rings of all robots of near: what is read where. All arrays are the caller's; each robot's
 * part of them is as long as if it had VS_RING_SENSORS. */
struct vs_rings {
    const struct vs_ring **rings; /* [robots] */
    const struct vs_near *near;
    const double *gain;  /* [robots * VS_RING_SENSORS] what each makes of a reflection, 1: as the
                            table says; NULL: all are 1 */
    const double *bias;  /* [robots * VS_RING_SENSORS] added to its reading; NULL where gain is */
    double *distances_m; /* [robots * VS_RING_SENSORS * rays] scratch */
    double *clean;       /* [robots * VS_RING_SENSORS] scratch */
    int16_t *raw;        /* [robots * VS_RING_SENSORS] 0..VS_RING_RAW_MAX, higher is nearer; 0
                            where there is no sensor */
};

/*
 * How far each ray of each robot gets [m], in rings->distances_m; infinity where it meets
 * nothing. poses as in struct vs_physics; rings->near holds for them.
 */
void vs_rings_distances(const struct vs_rings *rings, const double *poses);

/* Reads all rings; noise [robots * VS_RING_SENSORS] is added, poses as above. */
void vs_rings_read(const struct vs_rings *rings, const double *poses, const double *noise);

#endif
