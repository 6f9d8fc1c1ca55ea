/* SPDX-License-Identifier: MIT */
/* vs_search.h - how the picture kernel searches, and what it takes for a marker at first sight. */
#ifndef VS_SEARCH_H
#define VS_SEARCH_H

#include <stdint.h>

#define VS_MARKERS_AGAIN 2   /* scans of a picture after the first */
#define VS_MARKERS_CORNERS 4 /* right angles of an outline */

/* What a marker looks like: its size in the picture, its proportions on its plane. */
struct vs_shape_gate {
    double least_px;     /* sides of the box around it, where a picture shows it smallest */
    double most_px;      /* and where it is largest: an inclined camera has both */
    double least_px2, most_px2; /* area of the outline, cells included; likewise */
    double least_m2, most_m2;   /* the same on its plane, where it is */
    double least_aspect; /* variance along over variance across (1.2) */
    double most_aspect;  /* the same (2.9) */
    double least_taper;  /* how much it must come to a point (0.12) */
    double least_square; /* how much corners: a square has 0.6, a disc 0; 0 of an arrow */
};

struct vs_rescan {
    int32_t level_256, least_light; /* as below, 0: none; [grey] where it looks, 0: everywhere */
};

/* A right angle of an outline: ahead of the disc's centre and to the left; and the unit vector
 * from there between the two sides. */
struct vs_angle {
    double x_m, y_m, ahead, left;
};

/* How to search. */
struct vs_search {
    int32_t least_contrast; /* [grey] light ground over dark things; noise raises it (36) */
    int32_t level_256;      /* threshold between the darkest, 0, and the lightest, 256 (100) */
    int32_t pale_contrast;  /* [grey] least_contrast where nothing has much, and a veil; 0: none */
    double pale_fit;        /* [grey] least_contrast of the outline there */
    struct vs_rescan again[VS_MARKERS_AGAIN]; /* scans for what those before did not show */
    int32_t print_256;      /* share of the light ground that ink is darker by, at least (102) */
    int32_t has_veil;       /* whether the picture's darkest counts as 0 in that (0) */
    const uint8_t *outside; /* of each block of a whole picture: not 0: skip it; NULL: none */
    int32_t corners;        /* of the outline, that are looked for in large things; 0: none, */
    int32_t wanted;         /* and where so many markers were read already, none */
    struct vs_angle corner[VS_MARKERS_CORNERS];
    double corner_side_m;   /* length of the shortest side at one of them */
    double lead_m;          /* from the outline's centroid ahead to the disc's centre */
    double least_apart_m;   /* of two markers; of closer ones the better fit is kept */
    struct vs_shape_gate gate;
};

#endif
