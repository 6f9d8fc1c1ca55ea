/* SPDX-License-Identifier: MIT */
/*
 * vs_floor.h - the colours of the floor: a picture on it or one colour, and coloured regions
 * painted over it. Lengths in m, arena frame; colours are red, green, blue, alpha, 0..255 each.
 */
#ifndef VS_FLOOR_H
#define VS_FLOOR_H

#include "vs_scene.h"

/* A circle, or a rectangle with a turn; its edge belongs to it. */
struct vs_zone {
    double x_m;
    double y_m;
    double radius_m2; /* the square of a circle's radius; negative: a rectangle */
    double cosine;    /* of a rectangle's turn */
    double sine;
    double half_m[2]; /* half its sizes, along its own x and y */
    uint8_t color[4];
};

/* The arrays are the caller's. */
struct vs_floor {
    const uint8_t *image;        /* [rows * columns * channels], the highest y first; NULL: plain */
    uint32_t columns;
    uint32_t rows;
    uint32_t channels;           /* 3 or 4 */
    uint32_t zones_count;
    double centre_m[2];          /* of the picture */
    double size_m[2];
    uint8_t color[4];            /* of a plain floor */
    const struct vs_zone *zones; /* later ones lie over earlier ones */
    int (*ask)(void *whom, const double *points_m, uint32_t n, double *colors);
    void *whom;                  /* who knows the colours, as vs_floor_sample; NULL: nobody */
};

/* Which of n points, x and y each, lie in a zone: 1 or 0 each. */
void vs_zone_contains(const struct vs_zone *zone, const double *points_m, uint32_t n,
                      uint8_t *inside);

/* Colours of the floor at n points, four numbers each: that of the pixel in which the point lies;
 * outside of the picture, of the nearest one. Errors: those of ask. */
int vs_floor_sample(const struct vs_floor *floor, const double *points_m, uint32_t n,
                    double *colors);

/* Sensors that look at the floor. */
struct vs_ground {
    const struct vs_floor *floor;
    uint32_t points;       /* where a robot looks, in its own frame: */
    const double *ahead_m; /* [points] */
    const double *left_m;  /* [points] */
    const double *grey;    /* [3] brightness of each unit of red, green, blue; NULL: colours are read */
    double *points_m;      /* [robots * points * 2] scratch, */
    double *colors;        /* [robots * points * 4] and NULL where colours are read */
};

/* Reads brightnesses [robots * points], 0 to 1, or colours [robots * points * 4]; ground is a
 * struct vs_ground. Errors: as vs_floor_sample. */
int vs_ground_read(const void *ground, const struct vs_scene *scene, double *readings);

#endif
