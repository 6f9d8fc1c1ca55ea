/* SPDX-License-Identifier: MIT */
/* params.c - the experiment's parameters for a controller: lines "name=value\n". Pure. */
#include "robot.h"

#include <float.h>
#include <limits.h>
#include <string.h>

#include "../c_src/vs_format.h"
#include "number.h"

static const char *next_line(const char *line)
{
    line += strcspn(line, "\n");
    return *line == '\n' ? line + 1 : line;
}

/* The line "name=value\n", NULL if there is none. */
static const char *find_param(const char *line, const char *name)
{
    size_t len = strlen(name);

    for (; *line != '\0'; line = next_line(line))
        if (strncmp(line, name, len) == 0 && line[len] == '=')
            return line;
    return NULL;
}

/* What stands behind "name=", NULL if the experiment does not name the parameter. */
static const char *ask_param(struct vs_robot *robot, const char *name)
{
    const char *line = find_param(robot->session->params, name);
    size_t at;

    if (line == NULL)
        return NULL;
    at = (size_t)(line - robot->session->params);
    robot->asked[at / 8] |= (uint8_t)(1u << at % 8);
    return line + strlen(name) + 1;
}

int vs_robot_param_text(struct vs_robot *robot, const char *name, char *text, size_t size)
{
    const char *value = ask_param(robot, name);
    size_t len = value != NULL ? strcspn(value, "\n") : 0;
    size_t kept = len < size ? len : size - 1;

    if (value == NULL)
        return -1;
    if (size > 0) {
        memcpy(text, value, kept);
        text[kept] = '\0';
    }
    return (int)len;
}

/* The parameter as a number from least to most, the nearer of the two where it lies beyond them; the
 * fallback where it is no number. Of both, expected is complained of. */
static double number(struct vs_robot *robot, const char *name, double fallback, double least,
                     double most, const char *expected)
{
    const char *text = ask_param(robot, name);
    size_t len;
    double value;

    if (text == NULL)
        return fallback;
    text += strspn(text, " \t");
    len = vs_number_read(text, &value);
    if (len == 0 || (text[len] != '\n' && text[len] != '\0'))
        value = fallback;
    else if (value >= least && value <= most)
        return value;
    else
        value = value < least ? least : most;
    vs_robot_complain(robot, expected, name);
    return value;
}

double vs_robot_param(struct vs_robot *robot, const char *name, double fallback)
{
    return number(robot, name, fallback, -DBL_MAX, DBL_MAX, "expected a number as parameter");
}

double vs_robot_param_in(struct vs_robot *robot, const char *name, double fallback, int least,
                         int most)
{
    char expected[64];

    if (most == INT_MAX)
        (void)vs_format(expected, sizeof expected, "expected a number of %d or more as parameter",
                        least);
    else
        (void)vs_format(expected, sizeof expected, "expected a number from %d to %d as parameter",
                        least, most);
    return number(robot, name, fallback, least, most == INT_MAX ? DBL_MAX : most, expected);
}

const char *vs_robot_unasked_param(const struct vs_robot *robot, const char *after)
{
    const char *params = robot->session->params;
    const char *line = after == NULL ? params : next_line(after);

    for (; *line != '\0'; line = next_line(line)) {
        size_t at = (size_t)(line - params);

        if ((robot->asked[at / 8] >> at % 8 & 1) == 0)
            return line;
    }
    return NULL;
}
