/* SPDX-License-Identifier: MIT */
/*
 * policy.h - steps a learnt policy, a network of numbers in single precision, as a controller.
 * `vsense robot build` makes a C file of an .onnx file: its weights, what is done with them, and a
 * vs_controller that calls the functions here. Pure.
 *
 * The same bits come out on every machine: sums are added up in the order of the inputs, nothing
 * is fused, and tanh and the sigmoid are functions of this file.
 */
#ifndef VS_POLICY_H
#define VS_POLICY_H

#include "controller.h"

#ifdef __cplusplus
extern "C" {
#endif

#define VS_POLICY_SENSORS 33  /* that a table can have, and the robot's own ring */
#define VS_POLICY_ACTUATORS 8 /* virtual ones that a policy may set */

enum vs_policy_op {
    VS_POLICY_DENSE, /* a sum for each output; weights: all outputs' first summands, then what each
                      * input is multiplied with for all outputs, input by input */
    VS_POLICY_ADD,   /* number by number, the second operand from weights or memory, as the next 3 */
    VS_POLICY_SUB,
    VS_POLICY_MUL,
    VS_POLICY_DIV,
    VS_POLICY_CLIP,  /* weights: least, most */
    VS_POLICY_RELU,
    VS_POLICY_TANH,
    VS_POLICY_SIGMOID,
    VS_POLICY_COPY
};

struct vs_policy_step {
    uint8_t op;       /* enum vs_policy_op */
    uint16_t from;    /* where its numbers begin in memory */
    uint16_t with;    /* where those of a second operand do */
    uint16_t to;      /* where its results do, apart from what it reads */
    uint16_t inputs;  /* of DENSE; of the others as outputs */
    uint16_t outputs; /* how many results */
    int32_t weights;  /* index of its first weight; -1: it has none */
};

struct vs_policy {
    const char *name;
    const struct vs_policy_step *steps;
    uint16_t count;   /* steps */
    uint16_t inputs;  /* numbers of an observation, the first of memory */
    uint16_t outputs; /* numbers of an action: two wheels, then actuators, then the LEDs */
    uint16_t action;  /* where they begin in memory */
    const float *weights;
};

/* What the robot senses and does for it; belongs into the controller's state. */
struct vs_policy_state {
    uint8_t fits;      /* 0: robot and policy do not match, the robot stands */
    uint8_t has_leds;  /* the last number of an action switches the red LEDs */
    uint8_t has_told;  /* that a number of an action is none */
    uint8_t actuators; /* how many */
    int sensor[VS_POLICY_SENSORS];
    uint16_t numbers[VS_POLICY_SENSORS]; /* of each sensor, 0 behind the last one */
    int actuator[VS_POLICY_ACTUATORS];
    double low[VS_POLICY_ACTUATORS]; /* what -1 and 1 stand for */
    double high[VS_POLICY_ACTUATORS];
};

/*
 * Binds what a policy observes: the table's sensors in their order without "proximity", then that
 * ring, where the table or the size of the observation has it. Reads the parameters `actuators`
 * (NAME LOW HIGH, of each that is set, with blanks or commas between) and `leds` (0; 1: it
 * switches them). Where that does not fit the policy's sizes it is complained of, and stands.
 */
void vs_policy_init(struct vs_policy_state *s, const struct vs_policy *policy,
                    struct vs_robot *robot);

/* One control step. memory is the policy's, all zeros before the first one. */
void vs_policy_step(struct vs_policy_state *s, const struct vs_policy *policy, float *memory,
                    struct vs_robot *robot);

/* From the observation in memory to the action there, and to what it remembers. */
void vs_policy_think(const struct vs_policy *policy, float *memory);

/* Within 3 units of the last place of tanh(x); NaN of NaN. The sigmoid is made of it. */
float vs_policy_tanh(float x);

#ifdef __cplusplus
}
#endif

#endif
