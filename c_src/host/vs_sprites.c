/* SPDX-License-Identifier: MIT */
#include "vs_sprites.h"

#include <string.h>

#define INLINE static inline __attribute__((always_inline))

/* So many pixels of a row are looked at together: a compiler makes vectors of them. */
#define LANES 8

/* Everything below is compiled twice: `wide` for processors that fuse a multiplication and an
 * addition. On others the sum is of double, which rounds otherwise once in 2^29 times. */
#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>

#define WIDE __attribute__((target("avx2,fma")))
#define FUSED(wide, x, y, z) ((wide) ? __builtin_fmaf(x, y, z) : (float)((double)(x) * (y) + (z)))
#define YMM_STATE 6U

static int is_wide(void)
{
    unsigned a, b, c, d, high;

    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_FMA) || !(c & bit_OSXSAVE))
        return 0;
    /* Whether the system keeps the wide registers, too. */
    __asm__("xgetbv" : "=a"(a), "=d"(high) : "c"(0));
    return (a & YMM_STATE) == YMM_STATE && __get_cpuid_count(7, 0, &a, &b, &c, &d)
        && (b & bit_AVX2);
}

/* The C library's function is none of a vector's: it has an error to tell. */
INLINE void roots_of(float *values)
{
    for (int32_t i = 0; i < LANES; i += 4)
        _mm_storeu_ps(values + i, _mm_sqrt_ps(_mm_loadu_ps(values + i)));
}
#else
#define WIDE
#define FUSED(wide, x, y, z) __builtin_fmaf(x, y, z)

static int is_wide(void)
{
    return 1;
}

INLINE void roots_of(float *values)
{
    for (int32_t i = 0; i < LANES; i++)
        values[i] = __builtin_sqrtf(values[i]);
}
#endif

INLINE float fused(int wide, float x, float y, float z)
{
    (void)wide;
    return FUSED(wide, x, y, z);
}

void vs_sprites_clear(const struct vs_backdrop *backdrop, const struct vs_patch *patches,
                      size_t n, float *canvas_dn)
{
    for (const struct vs_patch *p = patches; p < patches + n; p++) {
        for (int32_t y = p->top; y < p->bottom; y++) {
            size_t at = (size_t)y * backdrop->width_px + (size_t)p->left;
            memcpy(canvas_dn + at, backdrop->light_dn + at,
                   (size_t)(p->right - p->left) * sizeof *canvas_dn);
        }
    }
}

/* Where the rays of some pixels meet a texture. */
struct lanes {
    int32_t at[LANES];     /* the texel to the upper left */
    float right[LANES];    /* how far beyond it, 0 to 1 */
    float down[LANES];
};

enum meeting { NOTHING, SOMETHING, THE_CORE };

/* What the rays meet: nothing but 0, or the sprite, or all of them its core. The border of a
 * texture is 0, and so is what lies beyond it. Where `coarse`, places are rounded to 1/32 of a
 * texel. */
INLINE enum meeting meet(int wide, const struct vs_sprite *s, int32_t pose, int coarse,
                         const float *x_m, const float *y_m, struct lanes *l)
{
    const float *column = s->column[pose], *row = s->row[pose], last = (float)(s->side - 1);
    float middle = 0.5f * last, reach = s->reach * s->reach, core = s->core * s->core;
    int32_t any = 0, beyond = 0;

    for (int32_t i = 0; i < LANES; i++) {
        float u = fused(wide, x_m[i], column[0], fused(wide, y_m[i], column[1], column[2]));
        float v = fused(wide, x_m[i], row[0], fused(wide, y_m[i], row[1], row[2]));
        float across = u - middle, along = v - middle, away = across * across + along * along;
        int32_t left, above;

        any |= away < reach;
        beyond |= !(away < core);
        u = u > 0.0f ? u : 0.0f;
        v = v > 0.0f ? v : 0.0f;
        u = u < last ? u : last;
        v = v < last ? v : last;
        u = coarse ? __builtin_rintf(u * 32.0f) / 32.0f : u;
        v = coarse ? __builtin_rintf(v * 32.0f) / 32.0f : v;
        left = (int32_t)u;
        above = (int32_t)v;
        left -= left == s->side - 1;
        above -= above == s->side - 1;
        l->at[i] = above * s->side + left;
        l->right[i] = u - (float)left;
        l->down[i] = v - (float)above;
    }
    return !any ? NOTHING : beyond ? SOMETHING : THE_CORE;
}

/* Fetches the four texels around each place: what is left to do has no foreign addresses, and
 * becomes vectors. */
INLINE void fetch(const float *texture, int32_t side, const struct lanes *l, float above[][2],
                  float below[][2])
{
    for (int32_t i = 0; i < LANES; i++) {
        const float *at = texture + l->at[i];

        memcpy(above[i], at, sizeof *above);
        memcpy(below[i], at + side, sizeof *below);
    }
}

/* Adds to value [LANES] what the pixels see between four texels of one channel, as OpenCV has
 * it. */
INLINE void sample(int wide, const struct vs_sprite *s, const struct lanes *l, float *value)
{
    float above[LANES][2], below[LANES][2];

    fetch(s->texture, s->side, l, above, below);
    for (int32_t i = 0; i < LANES; i++) {
        float up = fused(wide, l->right[i], above[i][1] - above[i][0], above[i][0]);
        float low = fused(wide, l->right[i], below[i][1] - below[i][0], below[i][0]);

        value[i] += fused(wide, l->down[i], low - up, up);
    }
}

/* Between four texels of a print OpenCV weighs, from the upper left on. */
INLINE float weigh(float right, float down, const float *above, const float *below)
{
    float left = 1.0f - right, up = 1.0f - down;

    return above[0] * (left * up) + above[1] * (right * up) + below[0] * (left * down) +
           below[1] * (right * down);
}

/* As `sample`, for a channel of a print. */
INLINE void sample_print(const struct vs_sprite *s, const float *texture, const struct lanes *l,
                         float *value)
{
    float above[LANES][2], below[LANES][2];

    fetch(texture, s->side, l, above, below);
    for (int32_t i = 0; i < LANES; i++)
        value[i] += weigh(l->right[i], l->down[i], above[i], below[i]);
}

INLINE void sample_core(float flat, const struct lanes *l, float *value)
{
    const float texels[2] = { flat, flat };

    for (int32_t i = 0; i < LANES; i++)
        value[i] += weigh(l->right[i], l->down[i], texels, texels);
}

/* Adds a sprite's value at a pose, and its cover if it is a print, [LANES] each; 0: it is not
 * there. */
INLINE int32_t look(int wide, const struct vs_sprite *s, int32_t effect, int32_t pose,
                    const float *x_m, const float *y_m, float *value, float *cover)
{
    struct lanes lanes;
    enum meeting with = meet(wide, s, pose, effect == VS_PRINT, x_m, y_m, &lanes);

    if (with == NOTHING)
        return 0;
    if (effect == VS_PRINT) {
        sample_print(s, s->texture, &lanes, value);
        if (with == THE_CORE)
            sample_core(s->flat, &lanes, cover);
        else
            sample_print(s, s->cover, &lanes, cover);
    } else if (with == THE_CORE) {
        for (int32_t i = 0; i < LANES; i++)
            value[i] += s->flat;
    } else {
        sample(wide, s, &lanes, value);
    }
    return 1;
}

/* Lays a sprite over the first n of LANES pixels of a row. */
INLINE void lay(int wide, const struct vs_sprite *s, int32_t effect, const float *x_m,
                const float *y_m, const float *white_dn, const float *top_m, float *canvas_dn,
                size_t n)
{
    float value[LANES] = { 0.0f }, cover[LANES] = { 0.0f }, share = (float)(1.0 / s->poses);
    float strength = s->strength, below_m = s->below_m;
    int32_t met = 0;
    float result[LANES];   /* no pointer leads here: the loops become vectors */

    for (int32_t k = 0; k < s->poses; k++)
        met |= look(wide, s, effect, k, x_m, y_m, value, cover);
    if (!met)
        return;
    for (int32_t i = 0; i < LANES; i++) {
        float light = canvas_dn[i], white = white_dn[i], more;
        float much = value[i] * share, covered = cover[i] * share;

        if (effect == VS_PRINT)
            more = much * white - covered * light;
        else if (effect == VS_COVER)
            more = much * (strength * white - light);
        else
            more = much * strength;
        result[i] = more + light;
    }
    for (int32_t i = 0; i < LANES; i++)
        result[i] = top_m[i] > below_m ? canvas_dn[i] : result[i];
    if (n < LANES)
        memcpy(canvas_dn, result, n * sizeof *result);
    else
        memcpy(canvas_dn, result, sizeof result);
}

/* As `lay`, for the last n pixels of the picture. */
INLINE void lay_few(int wide, const struct vs_backdrop *b, const struct vs_sprite *s,
                    int32_t effect, size_t at, size_t n, float *canvas_dn)
{
    const float *from[4] = { b->x_m, b->y_m, b->white_dn, b->top_m };
    float copy[5][LANES] = { { 0.0f } };

    for (int32_t k = 0; k < 4; k++)
        memcpy(copy[k], from[k] + at, n * sizeof **copy);
    memcpy(copy[4], canvas_dn + at, n * sizeof **copy);
    lay(wide, s, effect, copy[0], copy[1], copy[2], copy[3], copy[4], n);
    memcpy(canvas_dn + at, copy[4], n * sizeof **copy);
}

/* Draws a sprite into the rows from top to before bottom. */
INLINE void draw(int wide, const struct vs_backdrop *b, const struct vs_sprite *s,
                 int32_t effect, int32_t top, int32_t bottom, float *canvas)
{
    for (int32_t y = top; y < bottom; y++) {
        size_t at = (size_t)y * b->width_px + (size_t)s->patch.left;
        size_t left = (size_t)(s->patch.right - s->patch.left);
        size_t end = (size_t)b->height_px * b->width_px;

        for (; left > 0; at += LANES) {
            size_t n = left < LANES ? left : LANES;

            if (at + LANES <= end)
                lay(wide, s, effect, b->x_m + at, b->y_m + at, b->white_dn + at, b->top_m + at,
                    canvas + at, n);
            else
                lay_few(wide, b, s, effect, at, n, canvas);
            left -= n;
        }
    }
}

/* So many rows of all arrays stay in a processor's cache while all sprites are drawn there. */
#define BAND 16

INLINE void draw_all(int wide, const struct vs_backdrop *b, const struct vs_sprite *sprites,
                     size_t n, float *canvas)
{
    for (int32_t band = 0; band < (int32_t)b->height_px; band += BAND) {
        for (const struct vs_sprite *s = sprites; s < sprites + n; s++) {
            int32_t top = s->patch.top > band ? s->patch.top : band;
            int32_t bottom = s->patch.bottom < band + BAND ? s->patch.bottom : band + BAND;

            if (s->effect == VS_PRINT)
                draw(wide, b, s, VS_PRINT, top, bottom, canvas);
            else if (s->effect == VS_COVER)
                draw(wide, b, s, VS_COVER, top, bottom, canvas);
            else
                draw(wide, b, s, VS_GLOW, top, bottom, canvas);
        }
    }
}

WIDE static void draw_wide(const struct vs_backdrop *b, const struct vs_sprite *sprites, size_t n,
                           float *canvas)
{
    draw_all(1, b, sprites, n, canvas);
}

void vs_sprites_draw(const struct vs_backdrop *backdrop, const struct vs_sprite *sprites,
                     size_t n, float *canvas_dn)
{
    if (is_wide())
        draw_wide(backdrop, sprites, n, canvas_dn);
    else
        draw_all(0, backdrop, sprites, n, canvas_dn);
}

/* Where a patch is read from and to. */
struct reading {
    const struct vs_readout *readout;
    const float *canvas;
    size_t width;
    const uint8_t *noise;
    size_t noise_stride;
    uint8_t *picture;
    size_t picture_stride;
};

/* Reads the first n of LANES pixels of a row out; light has LANES. */
INLINE void read_some(int wide, const struct vs_readout *to, const float *light,
                      const uint8_t *noise, size_t n, uint8_t *picture)
{
    float root[LANES], most = (float)to->most;
    int32_t level[LANES];

    for (int32_t i = 0; i < LANES; i++)
        root[i] = light[i] * to->shot + to->read;
    roots_of(root);
    for (int32_t i = 0; i < LANES; i++) {
        float exact = __builtin_rintf(__builtin_fabsf(fused(wide, root[i], to->alpha, to->beta)));

        level[i] = (int32_t)(exact < most ? exact : most);
    }
    for (size_t i = 0; i < n; i++) {
        int32_t sum = level[i] + noise[i];

        picture[i] = to->table[sum < 255 ? sum : 255];
    }
}

INLINE void read_all(int wide, const struct reading *r, const struct vs_patch *patches, size_t n)
{
    for (const struct vs_patch *p = patches; p < patches + n; p++) {
        for (int32_t y = p->top; y < p->bottom; y++) {
            const float *light = r->canvas + (size_t)y * r->width;
            const uint8_t *noise = r->noise + (size_t)y * r->noise_stride;
            uint8_t *picture = r->picture + (size_t)y * r->picture_stride;
            int32_t x = p->left;

            for (; x + LANES <= p->right; x += LANES)
                read_some(wide, r->readout, light + x, noise + x, LANES, picture + x);
            if (x < p->right) {
                size_t left = (size_t)(p->right - x);
                float rest[LANES] = { 0.0f };

                memcpy(rest, light + x, left * sizeof *rest);
                read_some(wide, r->readout, rest, noise + x, left, picture + x);
            }
        }
    }
}

WIDE static void read_wide(const struct reading *r, const struct vs_patch *patches, size_t n)
{
    read_all(1, r, patches, n);
}

void vs_sprites_read(const struct vs_backdrop *backdrop, const struct vs_readout *readout,
                     const struct vs_patch *patches, size_t n, const float *canvas_dn,
                     const uint8_t *noise, size_t noise_stride, uint8_t *picture,
                     size_t picture_stride)
{
    struct reading reading = {
        readout, canvas_dn, backdrop->width_px, noise, noise_stride, picture, picture_stride,
    };

    if (is_wide())
        read_wide(&reading, patches, n);
    else
        read_all(0, &reading, patches, n);
}
