/* SPDX-License-Identifier: MIT */
#include "vs_sprites.h"

#include <string.h>

#define INLINE static inline __attribute__((always_inline))

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

INLINE float root_of(float value)
{
    return _mm_cvtss_f32(_mm_sqrt_ss(_mm_set_ss(value)));
}
#else
#define WIDE
#define FUSED(wide, x, y, z) __builtin_fmaf(x, y, z)

static int is_wide(void)
{
    return 1;
}

INLINE float root_of(float value)
{
    return __builtin_sqrtf(value);
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

/* So many pixels of a row are looked at together: a compiler makes vectors of them. */
#define LANES 16

/* Where the rays of some pixels meet a texture. */
struct lanes {
    int32_t at[LANES];     /* the texel to the upper left */
    float right[LANES];    /* how far beyond it, 0 to 1 */
    float down[LANES];
};

/* Returns whether any ray meets what is not 0. The border of a texture is 0, and so is what lies
 * beyond it. Where `coarse`, places are rounded to 1/32 of a texel. */
INLINE int32_t meet(int wide, const struct vs_sprite *s, int32_t pose, int coarse,
                    const float *x_m, const float *y_m, struct lanes *l)
{
    const float *column = s->column[pose], *row = s->row[pose], last = (float)(s->side - 1);
    float middle = 0.5f * last, reach = s->reach * s->reach;
    int32_t any = 0;

    for (int32_t i = 0; i < LANES; i++) {
        float u = fused(wide, x_m[i], column[0], fused(wide, y_m[i], column[1], column[2]));
        float v = fused(wide, x_m[i], row[0], fused(wide, y_m[i], row[1], row[2]));
        float across = u - middle, along = v - middle;
        int32_t left, above;

        any |= across * across + along * along < reach;
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
    return any;
}

/* Adds to value [LANES] what the pixels see between four texels of one channel, as OpenCV has
 * it. The texels are fetched first: what is left has no foreign addresses, and becomes vectors. */
INLINE void sample(int wide, const struct vs_sprite *s, const struct lanes *l, float *value)
{
    float above[LANES][2], below[LANES][2];

    for (int32_t i = 0; i < LANES; i++) {
        const float *at = s->texture + l->at[i];

        memcpy(above[i], at, sizeof *above);
        memcpy(below[i], at + s->side, sizeof *below);
    }
    for (int32_t i = 0; i < LANES; i++) {
        float up = fused(wide, l->right[i], above[i][1] - above[i][0], above[i][0]);
        float low = fused(wide, l->right[i], below[i][1] - below[i][0], below[i][0]);

        value[i] += fused(wide, l->down[i], low - up, up);
    }
}

/* Two texels beside each other, of two channels. */
typedef float texels __attribute__((vector_size(16)));
typedef int32_t order __attribute__((vector_size(16)));

/* As `sample`, for two channels: value and cover [LANES]. OpenCV weighs there, from the upper left
 * on; both channels are added at once, in its order. */
INLINE void sample_print(const struct vs_sprite *s, const struct lanes *l, float *value,
                         float *cover)
{
    const texels sign = { -1.0f, -1.0f, 1.0f, 1.0f }, one = { 1.0f, 1.0f, 0.0f, 0.0f };
    const order right = { 2, 3, 2, 3 };
    float sums[LANES][4];

    for (int32_t i = 0; i < LANES; i++) {
        const float *at = s->texture + (ptrdiff_t)l->at[i] * 2;
        texels beside = one + sign * l->right[i], above, below;

        memcpy(&above, at, sizeof above);
        memcpy(&below, at + (ptrdiff_t)s->side * 2, sizeof below);
        above *= beside * (1.0f - l->down[i]);
        below *= beside * l->down[i];
        above += __builtin_shuffle(above, right);
        above += below;
        above += __builtin_shuffle(below, right);
        memcpy(sums[i], &above, sizeof sums[i]);
    }
    for (int32_t i = 0; i < LANES; i++) {
        value[i] += sums[i][0];
        cover[i] += sums[i][1];
    }
}

/* Lays a sprite over the first n of LANES pixels of a row. */
INLINE void lay(int wide, const struct vs_sprite *s, int32_t effect, const float *x_m,
                const float *y_m, const float *white_dn, const float *top_m, float *canvas_dn,
                size_t n)
{
    float value[LANES] = { 0.0f }, cover[LANES] = { 0.0f }, share = (float)(1.0 / s->poses);
    float strength = s->strength, below_m = s->below_m;
    int32_t met = 0;
    struct lanes lanes;
    float result[LANES];   /* no pointer leads here: the loop becomes vectors */

    for (int32_t k = 0; k < s->poses; k++) {
        if (!meet(wide, s, k, effect == VS_PRINT, x_m, y_m, &lanes))
            continue;
        met = 1;
        if (effect == VS_PRINT)
            sample_print(s, &lanes, value, cover);
        else
            sample(wide, s, &lanes, value);
    }
    if (!met)
        return;
    for (int32_t i = 0; i < LANES; i++) {
        float light = canvas_dn[i], white = white_dn[i], top = top_m[i], more;
        float much = value[i] * share, covered = cover[i] * share;

        if (effect == VS_PRINT)
            more = much * white - covered * light;
        else if (effect == VS_COVER)
            more = much * (strength * white - light);
        else
            more = much * strength;
        more += light;
        result[i] = top > below_m ? light : more;
    }
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

INLINE void read_all(int wide, const struct reading *r, const struct vs_patch *patches, size_t n)
{
    float shot = r->readout->shot, read = r->readout->read, alpha = r->readout->alpha;
    float beta = r->readout->beta, most = (float)r->readout->most;
    const uint8_t *table = r->readout->table;

    for (const struct vs_patch *p = patches; p < patches + n; p++) {
        for (int32_t y = p->top; y < p->bottom; y++) {
            const float *light = r->canvas + (size_t)y * r->width;
            const uint8_t *random = r->noise + (size_t)y * r->noise_stride;
            uint8_t *pixel = r->picture + (size_t)y * r->picture_stride;

            for (int32_t x = p->left; x < p->right; x++) {
                float root = root_of(light[x] * shot + read);
                float level = __builtin_rintf(__builtin_fabsf(fused(wide, root, alpha, beta)));
                uint32_t sum = (uint32_t)(level < most ? level : most) + random[x];

                pixel[x] = table[sum < 255 ? sum : 255];
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
