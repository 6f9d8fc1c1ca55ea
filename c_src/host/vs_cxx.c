/* SPDX-License-Identifier: MIT */
#include "vs_cxx_step.h"

#include <string.h>

#define TEXT_MAX 64
#define OPAQUE 255.0

static const char *const names[VS_CXX_FUNCTIONS] = {"PreStep", "PostStep", "IsExperimentFinished",
                                                    "GetFloorColor"};

/* Notes that a function runs, as if a robot were in its control step, and calls it. */
static void call(struct vs_cxx *loop, uint32_t function, const char *text, size_t size,
                 const double *numbers, size_t count)
{
    uint32_t before = loop->note[2];

    loop->note[2] = loop->numbers[function];
    loop->note[1] = 1;
    loop->call(text, size, numbers, count, &loop->answer);
    loop->note[1] = 0;
    loop->note[2] = before;
}

/* Appends a number's digits; gives how many. */
static size_t spell(char *text, uint32_t number)
{
    char digits[10];
    size_t count = 0, i;

    do
        digits[count++] = (char)('0' + number % 10);
    while ((number /= 10) > 0);
    for (i = 0; i < count; i++)
        text[i] = digits[count - 1 - i];
    return count;
}

int vs_cxx_step(struct vs_cxx *loop, uint32_t function, uint32_t timestep, uint32_t clock)
{
    static const char word[] = "\nclock\t";
    const struct vs_world *world = loop->world;
    size_t size = strlen(names[function]);
    char text[TEXT_MAX];
    uint32_t i;

    if (memcmp(loop->colors, loop->told, loop->color_bytes) != 0)
        return VS_CXX_SHINES;
    memcpy(text, names[function], size);
    memcpy(text + size, word, sizeof word - 1);
    size += sizeof word - 1;
    size += spell(text + size, clock);
    for (i = 0; i < world->robots_all; i++)
        memcpy(loop->places + 3 * (size_t)i,
               world->robots + (size_t)i * world->fields->row + world->fields->place,
               3 * sizeof *loop->places);
    loop->note[0] = timestep;
    call(loop, function, text, size, loop->places, 3 * (size_t)world->robots_all);
    return loop->answer.text_size > 0 ? VS_CXX_SAID : VS_OK;
}

int vs_cxx_paint(void *loop, const double *points_m, uint32_t n, double *colors)
{
    struct vs_cxx *one = loop;
    const char *name = names[VS_CXX_FLOOR];
    uint32_t i, c;

    if (!one->answers || n == 0)
        return one->ask(one, points_m, n, colors);
    call(one, VS_CXX_FLOOR, name, strlen(name), points_m, 2 * (size_t)n);
    for (i = 0; 3 * (size_t)i + 2 < one->answer.color_count; i++) {
        for (c = 0; c < 3; c++)
            colors[4 * i + c] = one->answer.colors[3 * i + c];
        colors[4 * i + 3] = OPAQUE;
    }
    return one->answer.text_size > 0 ? one->hear(one) : VS_OK;
}
