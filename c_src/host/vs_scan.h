/* SPDX-License-Identifier: MIT */
/*
 * vs_scan.h - finds dark things on light ground in a picture: a local threshold
 * from the extremes of blocks, runs of dark pixels on every second row, and the
 * components that touching runs make. One pass, no allocation, bounded tables.
 */
#ifndef VS_SCAN_H
#define VS_SCAN_H

#include "vs_markers.h"

#define VS_SCAN_SIDE VS_MARKERS_SIDE
#define VS_SCAN_BLOCK VS_MARKERS_BLOCK
#define VS_SCAN_STEP 2        /* [px] from one scanned row to the next */
#define VS_SCAN_LINE 512      /* blocks in a row: SIDE / BLOCK */
#define VS_SCAN_BLOCKS 262144 /* blocks in a picture: LINE * LINE */
#define VS_SCAN_ROWS 4096     /* scanned rows: SIDE / STEP */
#define VS_SCAN_RUNS 65536    /* runs of dark pixels that there is room for, at least */
#define VS_SCAN_SPREAD 32     /* in large pictures there is room for one run in so many pixels */

/* Dark pixels of one row that touch: columns begin .. end - 1. */
struct vs_run {
    uint16_t begin;
    uint16_t end;
    uint32_t part;
};

/* Runs that touch; the one that is its own parent speaks for all that were joined. */
struct vs_part {
    uint32_t parent;
    uint32_t dark_px; /* dark pixels on the scanned rows */
    uint16_t left;    /* columns left .. right - 1 */
    uint16_t right;
    uint16_t top;     /* scanned rows top .. bottom */
    uint16_t bottom;
};

/*
 * Working memory, the caller's; one thread at a time. Its content is of no meaning before, but for
 * its tables and the room in them, which the caller sets.
 */
struct vs_scan {
    struct vs_run *runs;   /* run_room of them */
    struct vs_part *parts; /* part_room: components before those that meet are joined */
    uint32_t run_room;
    uint32_t part_room;
    uint32_t full;       /* VS_MARKERS_FULL_... of the newest scan */
    uint32_t rows;       /* scanned */
    uint32_t run_count;
    uint32_t part_count;
    uint32_t line;       /* blocks in a row of blocks */
    uint32_t lines;      /* rows of blocks */
    int32_t noise;       /* [grey] contrast that noise alone can make */
    int32_t veil;        /* [grey] nothing in the picture is darker; 0 .. 255 */
    int32_t contrast;    /* [grey] hardly a block has more */
    int pale;            /* whether that is little */
    uint32_t first[VS_SCAN_ROWS + 1]; /* run with which each scanned row begins */
    uint8_t dark[VS_SCAN_BLOCKS];     /* darkest pixel of each block */
    uint8_t light[VS_SCAN_BLOCKS];    /* lightest */
    uint8_t level[VS_SCAN_BLOCKS];    /* a pixel below this is dark */
    uint16_t words[VS_SCAN_BLOCK / VS_SCAN_STEP][VS_SCAN_LINE + 4]; /* of a line of blocks, then 0 */
    uint16_t edge[VS_SCAN_SIDE + 2]; /* columns at which a row changes */
};

/*
 * Scans a picture, see struct vs_search.
 * Errors: VS_ERR_ARGUMENT for sizes outside 1 .. VS_SCAN_SIDE, a stride smaller
 * than the width, level_256 outside 1 .. 255, or print_256 outside 0 .. 256. A full table
 * is no error: see full.
 */
int vs_scan_picture(struct vs_scan *s, const struct vs_picture *picture,
                    const struct vs_search *search);

/* A disc in a picture. */
struct vs_spot {
    double x_px, y_px, radius_px;
};

/* Whether another scan of the newest scan's picture has anything to look at. */
int vs_scan_needs(const struct vs_scan *s, const struct vs_rescan *again);

/* Scans that picture again, without what is in count discs; see full. */
void vs_scan_again(struct vs_scan *s, const struct vs_picture *picture,
                   const struct vs_search *search, const struct vs_rescan *again,
                   const struct vs_spot *without, size_t count);

/* The part that speaks for a part of the newest scan. */
uint32_t vs_scan_root(struct vs_scan *s, uint32_t part);

#endif
