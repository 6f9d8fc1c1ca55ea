/* SPDX-License-Identifier: MIT */
#include "base_config.h"

#include <string.h>

#include "number.h"
#include "../c_src/vs_format.h"

#define RAB_K_CM 0.0867438559f /* [cm] Source: argos3-epuck 66cb8d9
                                  real_epuck_range_and_bearing_sensor.cpp:75 */
#define RAB_K_MAX_CM 10.0
#define RESET_DIGITS 4 /* of a GPIO's number */

static const char *const board_names[VS_BOARDS] = {"ground", "rab", "battery", "rgb", "imu"};

/* A part of the text, not ended by '\0'. */
struct part {
    const char *text;
    size_t len;
};

static int is(struct part part, const char *name)
{
    return strlen(name) == part.len && memcmp(part.text, name, part.len) == 0;
}

/* Cuts off what comes before the separator, or everything. */
static struct part cut(const char **text, const char *separators)
{
    struct part part = {*text, strcspn(*text, separators)};

    *text += part.len;
    return part;
}

static const struct vs_base_ops *find(struct part name)
{
    size_t i;

    for (i = 0; vs_bases[i] != NULL; i++)
        if (is(name, vs_bases[i]->name))
            return vs_bases[i];
    return NULL;
}

/* Adds to a text as far as there is room. */
static void add(char *text, size_t size, const char *more)
{
    size_t len = strlen(text);

    vs_format(text + len, size - len, "%s", more);
}

static int refuse_kind(char *expected, size_t size)
{
    size_t i;

    vs_format(expected, size, "KIND:DEVICE with KIND one of ");
    for (i = 0; vs_bases[i] != NULL; i++) {
        add(expected, size, i == 0 ? "" : ", ");
        add(expected, size, vs_bases[i]->name);
    }
    return -1;
}

static int refuse_option(const struct vs_base_ops *ops, char *expected, size_t size)
{
    const struct vs_base_choice *choice;
    size_t i;

    vs_format(expected, size, "after %s:DEVICE only ", ops->name);
    for (choice = ops->choices; choice->name != NULL; choice++) {
        add(expected, size, choice->name);
        for (i = 0; choice->values[i] != NULL; i++) {
            add(expected, size, i == 0 ? "=" : "|");
            add(expected, size, choice->values[i]);
        }
        add(expected, size, ", ");
    }
    add(expected, size, "ground=BUS, rab=BUS, battery=BUS, rgb=BUS, imu=BUS, rab_bytes=4|2, "
                        "rab_power=0..255, rab_k=CM");
    if (ops->on_i2c)
        add(expected, size, " (without =BUS: on the same bus), reset=GPIO");
    return -1;
}

/* Copies a path. Returns 0, or -1 if it is empty or too long. */
static int keep(struct part path, char kept[VS_BASE_DEVICE_MAX + 1])
{
    if (path.len == 0 || path.len > VS_BASE_DEVICE_MAX)
        return -1;
    memcpy(kept, path.text, path.len);
    kept[path.len] = '\0';
    return 0;
}

/* Returns 0, or -1 if the value is not one of this choice. */
static int choose(const char *const *values, struct part value, uint8_t *chosen)
{
    uint8_t i;

    for (i = 0; values[i] != NULL; i++) {
        if (is(value, values[i])) {
            *chosen = i;
            return 0;
        }
    }
    return -1;
}

/* Reads 0..255. Returns 0, or -1 if it is none of them. */
static int byte_of(struct part value, uint8_t *byte)
{
    unsigned int number = 0;
    size_t i;

    for (i = 0; i < value.len && number <= UINT8_MAX; i++) {
        if (value.text[i] < '0' || value.text[i] > '9')
            return -1;
        number = 10 * number + (unsigned int)(value.text[i] - '0');
    }
    *byte = (uint8_t)number;
    return value.len > 0 && number <= UINT8_MAX ? 0 : -1;
}

/* An option of the range-and-bearing board. */
static int take_rab_option(struct vs_base_config *config, struct part name, struct part value)
{
    static const char *const widths[] = {"4", "2", NULL};
    double number = 0.0;

    if (is(name, "rab_bytes")) {
        uint8_t width;

        if (choose(widths, value, &width) != 0)
            return -1;
        config->rab_bytes = width == 0 ? 4 : 2;
        return 0;
    }
    if (is(name, "rab_power"))
        return byte_of(value, &config->rab_power);
    if (!is(name, "rab_k") || vs_number_read(value.text, &number) != value.len)
        return -1;
    config->rab_k_cm = (float)number;
    return number > 0.0 && number <= RAB_K_MAX_CM ? 0 : -1;
}

/* The GPIO that resets the microcontroller: its number, or a folder. */
static int take_reset(struct vs_base_config *config, struct part value)
{
    size_t digits = strspn(value.text, "0123456789");

    if (keep(value, config->reset) != 0)
        return -1;
    return value.text[0] == '/' || (digits == value.len && digits <= RESET_DIGITS) ? 0 : -1;
}

static int take_option(struct vs_base_config *config, struct part name, const char *equals,
                       struct part value)
{
    int i;

    for (i = 0; i < VS_BOARDS; i++) {
        struct part device = {config->device, strlen(config->device)};

        if (!is(name, board_names[i]))
            continue;
        if (equals == NULL && !config->ops->on_i2c)
            return -1;
        return keep(equals == NULL ? device : value, config->board[i]);
    }
    if (config->ops->on_i2c && is(name, "reset"))
        return take_reset(config, value);
    for (i = 0; i < VS_BASE_CHOICES && config->ops->choices[i].name != NULL; i++)
        if (is(name, config->ops->choices[i].name))
            return choose(config->ops->choices[i].values, value, &config->choice[i]);
    return take_rab_option(config, name, value);
}

int vs_base_configure(struct vs_base_config *config, const char *text, char *expected, size_t size)
{
    struct part kind = cut(&text, ":");

    memset(config, 0, sizeof *config);
    config->ops = find(kind);
    config->rab_bytes = 4;
    config->rab_power = EPUCK_RAB_POWER_DEFAULT;
    config->rab_k_cm = RAB_K_CM;
    if (config->ops == NULL || *text != ':')
        return refuse_kind(expected, size);
    text++;
    if (keep(cut(&text, ","), config->device) != 0) {
        vs_format(expected, size, "a device of at most %d bytes, such as %s:%s",
                 VS_BASE_DEVICE_MAX, config->ops->name, config->ops->device);
        return -1;
    }
    while (*text == ',') {
        struct part name;
        const char *equals = NULL;

        text++;
        name = cut(&text, "=,");
        if (*text == '=')
            equals = text++;
        if (take_option(config, name, equals, cut(&text, ",")) != 0)
            return refuse_option(config->ops, expected, size);
    }
    return 0;
}
