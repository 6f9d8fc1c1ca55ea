/* SPDX-License-Identifier: MIT */
#include "policy.h"

#include <float.h>
#include <string.h>

#include "number.h"
#include "robot.h"

enum { RING_NUMBERS = 8, WHEELS = 2 };

#define RING "proximity"
#define PARAM_BYTES 256 /* of the parameter `actuators`, the final zero included */

/* ln 2 in two parts: the first has so few digits that a small whole number of it is exact. */
#define LN2_HIGH 0.693359375f
#define LN2_LOW -2.12194440e-4f
#define LOG2_E 1.44269504f
#define TANH_IS_ONE 9.1f  /* above it tanh is nearer to 1 than to any other single */
#define TANH_IS_X 0.0002f /* below it x is nearer to tanh(x) than any other single */

/* (exp(2t) - 1) / (exp(2t) + 1), t = |x|, with exp(2t) - 1 = 2^k (exp(r) - 1) + (2^k - 1) and
 * |r| <= ln(2) / 2, where the series of exp(r) - 1 ends after seven terms below 6e-9 of it. */
float vs_policy_tanh(float x)
{
    float t = x < 0.0f ? -x : x;
    float twice = t + t;
    float k;
    float r;
    float series;
    float power;
    float grown;

    if (!(t < TANH_IS_ONE))
        return x != x ? x : x < 0.0f ? -1.0f : 1.0f;
    if (t < TANH_IS_X)
        return x;
    k = (float)(int)(twice * LOG2_E + 0.5f);
    r = twice - k * LN2_HIGH;
    r = r - k * LN2_LOW;
    series = 1.0f / 5040.0f;
    series = series * r + 1.0f / 720.0f;
    series = series * r + 1.0f / 120.0f;
    series = series * r + 1.0f / 24.0f;
    series = series * r + 1.0f / 6.0f;
    series = series * r + 0.5f;
    series = series * r + 1.0f;
    power = (float)(1 << (int)k);
    grown = power * (series * r) + (power - 1.0f);
    t = grown / (grown + 2.0f);
    return x < 0.0f ? -t : t;
}

static float sigmoid(float x)
{
    return 0.5f * vs_policy_tanh(0.5f * x) + 0.5f;
}

/* The inner loop goes over the outputs: each is the same sum in the same order, and machines that
 * add several numbers at once may. */
static void dense(const float *weights, const float *from, float *to, int inputs, int outputs)
{
    int i;
    int k;

    memcpy(to, weights, (size_t)outputs * sizeof *to);
    for (i = 0; i < inputs; i++) {
        float x = from[i];

        weights += outputs;
        for (k = 0; k < outputs; k++)
            to[k] += weights[k] * x;
    }
}

static float clipped(float x, float least, float most)
{
    if (x < least)
        return least;
    return x > most ? most : x;
}

static float result(enum vs_policy_op op, float x)
{
    switch (op) {
    case VS_POLICY_RELU:
        return x > 0.0f ? x : 0.0f;
    case VS_POLICY_TANH:
        return vs_policy_tanh(x);
    case VS_POLICY_SIGMOID:
        return sigmoid(x);
    default:
        return x;
    }
}

/* What is too small for a normal single is 0: the pinned compiler's division for processors without
 * a floating point unit makes it so, others keep it. */
static float quotient(float x, float y)
{
    float result = x / y;

    return result >= -FLT_MIN && result <= FLT_MIN ? 0.0f : result;
}

static float combined(enum vs_policy_op op, float x, float y)
{
    switch (op) {
    case VS_POLICY_ADD:
        return x + y;
    case VS_POLICY_SUB:
        return x - y;
    case VS_POLICY_MUL:
        return x * y;
    default:
        return quotient(x, y);
    }
}

void vs_policy_think(const struct vs_policy *policy, float *memory)
{
    int n;
    int i;

    for (n = 0; n < policy->count; n++) {
        const struct vs_policy_step *step = &policy->steps[n];
        const float *weights = step->weights < 0 ? NULL : policy->weights + step->weights;
        const float *with = weights == NULL ? memory + step->with : weights;
        const float *from = memory + step->from;
        enum vs_policy_op op = (enum vs_policy_op)step->op;
        float *to = memory + step->to;

        if (op == VS_POLICY_DENSE)
            dense(weights, from, to, step->inputs, step->outputs);
        else if (op == VS_POLICY_CLIP)
            for (i = 0; i < step->outputs; i++)
                to[i] = clipped(from[i], weights[0], weights[1]);
        else if (op >= VS_POLICY_ADD && op <= VS_POLICY_DIV)
            for (i = 0; i < step->outputs; i++)
                to[i] = combined(op, from[i], with[i]);
        else
            for (i = 0; i < step->outputs; i++)
                to[i] = result(op, from[i]);
    }
}

/* The table's sensors but for the ring, then the ring; returns how many numbers they have. */
static int bind_sensors(struct vs_policy_state *s, const struct vs_policy *policy,
                        struct vs_robot *robot)
{
    const struct vs_table *table = &robot->session->table;
    int ring = 0;
    int all = 0;
    int count = 0;
    uint32_t i;

    for (i = 0; i < table->count; i++) {
        const struct vs_entry *entry = &table->entries[i];
        const char *name = entry->name[0] == '+' ? entry->name + 1 : entry->name;

        if (entry->direction != VS_SENSOR)
            continue;
        if (strcmp(name, RING) == 0) {
            ring = entry->count;
            continue;
        }
        s->sensor[count] = vs_robot_sensor(robot, name);
        s->numbers[count++] = entry->count;
        all += entry->count;
    }
    if (ring == 0 && policy->inputs == all + RING_NUMBERS)
        ring = RING_NUMBERS;
    if (ring > 0) {
        s->sensor[count] = vs_robot_sensor(robot, RING);
        s->numbers[count] = (uint16_t)ring;
    }
    return all + ring;
}

/* The next word of a text, which ends at a blank or a comma; NULL: there is none. */
static char *next_word(char **text)
{
    char *word = *text + strspn(*text, " \t,");
    size_t len = strcspn(word, " \t,");

    if (len == 0)
        return NULL;
    *text = word + len;
    if (**text != '\0')
        *(*text)++ = '\0';
    return word;
}

static int read_number(char **text, double *value)
{
    const char *word = next_word(text);

    return word != NULL && vs_number_read(word, value) == strlen(word);
}

/* Reads what each actuator is called and stands for; 0: the text has another form. */
static int bind_actuators(struct vs_policy_state *s, struct vs_robot *robot)
{
    char text[PARAM_BYTES];
    char *rest = text;
    char *name;
    int len = vs_robot_param_text(robot, "actuators", text, sizeof text);

    if (len < 0)
        return 1;
    if ((size_t)len >= sizeof text)
        return 0;
    while ((name = next_word(&rest)) != NULL) {
        int n = s->actuators;

        if (n == VS_POLICY_ACTUATORS || !read_number(&rest, &s->low[n]) ||
            !read_number(&rest, &s->high[n]))
            return 0;
        s->actuator[n] = vs_robot_actuator(robot, name);
        s->actuators++;
    }
    return 1;
}

void vs_policy_init(struct vs_policy_state *s, const struct vs_policy *policy,
                    struct vs_robot *robot)
{
    int observed = bind_sensors(s, policy, robot);
    int is_read = bind_actuators(s, robot);

    s->has_leds = vs_robot_param_in(robot, "leds", 0.0, 0, 1) > 0.0;
    s->fits = (uint8_t)(is_read && observed == policy->inputs &&
                        policy->outputs == WHEELS + s->actuators + s->has_leds);
    if (!is_read)
        vs_robot_complain(robot, "expected NAME LOW HIGH of each as parameter", "actuators");
    else if (!s->fits)
        vs_robot_complain(robot, "observations or actions do not fit the policy", policy->name);
}

/* What is not known is 0, as in the environment in which it has learnt. */
static void observe(const struct vs_policy_state *s, const struct vs_robot *robot, float *to)
{
    double values[VS_SENSOR_BYTES];
    int n;
    int i;

    for (n = 0; n < VS_POLICY_SENSORS && s->numbers[n] > 0; n++) {
        int there = vs_robot_values(robot, s->sensor[n], values, s->numbers[n]);

        for (i = 0; i < s->numbers[n]; i++)
            *to++ = i < there ? (float)values[i] : 0.0f;
    }
}

/* A number of an action, from -1 to 1; one that is none counts as 0. */
static double action(struct vs_policy_state *s, const struct vs_policy *policy, const float *from,
                     struct vs_robot *robot)
{
    if (*from == *from)
        return (double)clipped(*from, -1.0f, 1.0f);
    if (!s->has_told)
        vs_robot_complain(robot, "it gives what is no number: the policy", policy->name);
    s->has_told = 1;
    return 0.0;
}

void vs_policy_step(struct vs_policy_state *s, const struct vs_policy *policy, float *memory,
                    struct vs_robot *robot)
{
    const float *from = memory + policy->action;
    double wheels[WHEELS];
    int n;

    if (!s->fits)
        return;
    observe(s, robot, memory);
    vs_policy_think(policy, memory);
    for (n = 0; n < WHEELS; n++)
        wheels[n] = VS_ROBOT_MAX_STEPS_S * action(s, policy, from++, robot);
    vs_robot_set_wheels(robot, (int)wheels[0], (int)wheels[1]);
    for (n = 0; n < s->actuators; n++) {
        double x = action(s, policy, from++, robot);

        vs_robot_actuate(robot, s->actuator[n], 0,
                         s->low[n] + (s->high[n] - s->low[n]) * (x + 1.0) / 2.0);
    }
    if (s->has_leds)
        vs_robot_set_leds(robot, action(s, policy, from, robot) > 0.0 ? VS_ROBOT_LED_RING : 0);
}
