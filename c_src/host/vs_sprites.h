/* SPDX-License-Identifier: MIT */
/*
 * vs_sprites.h - draws the lab's bodies into a camera's picture: flat sprites, each lying in a
 * horizontal plane and seen through the camera's rays.
 *
 * Every operation is of float, in the order and with the fused multiplications that OpenCV's
 * addWeighted, remap (bilinear) and convertScaleAbs have where a processor fuses them: pictures
 * are the same bit by bit on all machines.
 */
#ifndef VS_SPRITES_H
#define VS_SPRITES_H

#include <stddef.h>
#include <stdint.h>

#define VS_SPRITE_POSES 3

/* What a sprite does to the light of what lies below it, L, where the camera has P of white. */
enum vs_effect {
    VS_PRINT = 0,  /* texture is colour, and there is a cover: L + colour P - cover L */
    VS_COVER = 1,  /* texture is cover: L + cover (strength P - L) */
    VS_GLOW = 2    /* texture is light: L + light strength */
};

/* The empty arena in one camera; every array [height_px * width_px], row by row. */
struct vs_backdrop {
    const float *x_m;      /* where the pixel's ray meets the floor */
    const float *y_m;
    const float *white_dn; /* a white surface's light there */
    const float *top_m;    /* height above the floor of what is seen */
    const float *light_dn; /* the arena's own light */
    uint32_t width_px;
    uint32_t height_px;
};

/* Pixels of a picture; right and bottom are the first beyond. Within the picture. */
struct vs_patch {
    int32_t left, top, right, bottom;
};

/* A sprite in the pixels that it may cover, at its poses during the exposure. */
struct vs_sprite {
    const float *texture;  /* [side * side], row by row; the border is 0 */
    const float *cover;    /* likewise, VS_PRINT's */
    int32_t side;
    float reach;           /* texels farther from the middle are 0, and so are those between */
    float core;            /* nearer to it all are `flat`, VS_PRINT's cover, others' texture */
    float flat;
    int32_t effect;        /* enum vs_effect */
    float strength;
    float below_m;         /* where something stands higher, nothing is drawn */
    struct vs_patch patch;
    int32_t poses;         /* 1 to VS_SPRITE_POSES: their mean is drawn */
    /* By pose: the texture's column and row as affine functions of x_m, y_m: two factors and
     * the offset. */
    float column[VS_SPRITE_POSES][3];
    float row[VS_SPRITE_POSES][3];
};

/* What a sensor makes of light [DN]: level = alpha * sqrt(light * shot + read) + beta, at most
 * most; the noise's value is added, and the table says what is read for the sum. */
struct vs_readout {
    float shot, read;
    float alpha, beta;
    uint8_t most;
    uint8_t table[256];
};

/* Puts the empty arena's light into n patches of the canvas [height_px * width_px]. */
void vs_sprites_clear(const struct vs_backdrop *backdrop, const struct vs_patch *patches,
                      size_t n, float *canvas_dn);

/* Draws n sprites over the canvas, the first first. */
void vs_sprites_draw(const struct vs_backdrop *backdrop, const struct vs_sprite *sprites,
                     size_t n, float *canvas_dn);

/*
 * Reads n patches of the canvas out into a picture. noise is that of the whole picture; rows of
 * noise and picture are noise_stride and picture_stride bytes apart.
 */
void vs_sprites_read(const struct vs_backdrop *backdrop, const struct vs_readout *readout,
                     const struct vs_patch *patches, size_t n, const float *canvas_dn,
                     const uint8_t *noise, size_t noise_stride, uint8_t *picture,
                     size_t picture_stride);

#endif
