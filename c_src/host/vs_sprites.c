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

/* The border of a texture is 0, and so is what lies beyond it. Where `coarse`, places are rounded
 * to 1/32 of a texel. */
INLINE void meet(int wide, const struct vs_sprite *s, int32_t pose, int coarse, const float *x_m,
                 const float *y_m, struct lanes *l)
{
    const float *column = s->column[pose], *row = s->row[pose], last = (float)(s->side - 1);

    for (int32_t i = 0; i < LANES; i++) {
        float u = fused(wide, x_m[i], column[0], fused(wide, y_m[i], column[1], column[2]));
        float v = fused(wide, x_m[i], row[0], fused(wide, y_m[i], row[1], row[2]));
        int32_t left, above;

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
}

/* What lies between four texels, the upper two first: as OpenCV has it for one channel. */
INLINE float between(int wide, float a, float b, float e, float f, float right, float down)
{
    float above = fused(wide, right, b - a, a), below = fused(wide, right, f - e, e);

    return fused(wide, down, below - above, above);
}

/* The same, as OpenCV has it for two channels. */
INLINE float weighted(float a, float b, float e, float f, float right, float down)
{
    float sum = a * ((1.0f - right) * (1.0f - down)) + b * (right * (1.0f - down));

    return sum + e * ((1.0f - right) * down) + f * (right * down);
}

/* Adds to value [channels * LANES] what the pixels see. */
INLINE void sample(int wide, const struct vs_sprite *s, const struct lanes *l, int32_t channels,
                   float *value)
{
    ptrdiff_t pitch = (ptrdiff_t)s->side * channels;

    for (int32_t i = 0; i < LANES; i++) {
        const float *at = s->texture + (ptrdiff_t)l->at[i] * channels;

        for (int32_t c = 0; c < channels; c++) {
            float a = at[c], b = at[c + channels], e = at[c + pitch], f = at[c + pitch + channels];

            value[channels * i + c] += channels == 2
                                     ? weighted(a, b, e, f, l->right[i], l->down[i])
                                     : between(wide, a, b, e, f, l->right[i], l->down[i]);
        }
    }
}

/* Lays a sprite over LANES pixels of a row. */
INLINE void lay(int wide, const struct vs_sprite *s, int32_t effect, const float *x_m,
                const float *y_m, const float *white_dn, const float *top_m, float *canvas_dn)
{
    float value[2 * LANES] = { 0.0f }, share = (float)(1.0 / s->poses);
    int32_t channels = effect == VS_PRINT ? 2 : 1;
    struct lanes lanes;

    for (int32_t k = 0; k < s->poses; k++) {
        meet(wide, s, k, channels == 2, x_m, y_m, &lanes);
        sample(wide, s, &lanes, channels, value);
    }
    for (int32_t i = 0; i < channels * LANES && s->poses > 1; i++)
        value[i] *= share;
    for (int32_t i = 0; i < LANES; i++) {
        float light = canvas_dn[i], more;

        if (effect == VS_PRINT)
            more = value[2 * i] * white_dn[i] - value[2 * i + 1] * light;
        else if (effect == VS_COVER)
            more = value[i] * (s->strength * white_dn[i] - light);
        else
            more = value[i] * s->strength;
        canvas_dn[i] = top_m[i] > s->below_m ? light : light + more;
    }
}

/* As `lay`, for the n pixels that are left of a row. */
INLINE void lay_few(int wide, const struct vs_backdrop *b, const struct vs_sprite *s,
                    int32_t effect, size_t at, size_t n, float *canvas_dn)
{
    const float *from[4] = { b->x_m, b->y_m, b->white_dn, b->top_m };
    float copy[5][LANES] = { { 0.0f } };

    for (int32_t k = 0; k < 4; k++)
        memcpy(copy[k], from[k] + at, n * sizeof **copy);
    memcpy(copy[4], canvas_dn + at, n * sizeof **copy);
    lay(wide, s, effect, copy[0], copy[1], copy[2], copy[3], copy[4]);
    memcpy(canvas_dn + at, copy[4], n * sizeof **copy);
}

/* Draws a sprite into the rows from top to before bottom. */
INLINE void draw(int wide, const struct vs_backdrop *b, const struct vs_sprite *s,
                 int32_t effect, int32_t top, int32_t bottom, float *canvas)
{
    for (int32_t y = top; y < bottom; y++) {
        size_t at = (size_t)y * b->width_px + (size_t)s->patch.left;
        size_t left = (size_t)(s->patch.right - s->patch.left);

        for (; left >= LANES; left -= LANES, at += LANES)
            lay(wide, s, effect, b->x_m + at, b->y_m + at, b->white_dn + at, b->top_m + at,
                canvas + at);
        if (left)
            lay_few(wide, b, s, effect, at, left, canvas);
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
