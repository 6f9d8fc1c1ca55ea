/* SPDX-License-Identifier: MIT */
/*
 * policy_steps.c - a policy thinks, without a robot: for the bits that come out, and for counting
 * instructions. What was made of the policy's file stands before this in one file with it.
 *
 *     policy_steps N < OBSERVATIONS     singles as they lie in memory; of each observation N
 *                                       control steps, and the last one's action to the output
 *     policy_steps tanh < SINGLES       their hyperbolic tangents
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int tangents(void)
{
    float x;

    while (fread(&x, sizeof x, 1, stdin) == 1) {
        x = vs_policy_tanh(x);
        if (fwrite(&x, sizeof x, 1, stdout) != 1)
            return 1;
    }
    return 0;
}

int main(int argc, char **argv)
{
    struct state s;
    float seen[sizeof s.memory / sizeof s.memory[0]];
    long count = argc == 2 ? atol(argv[1]) : 0;
    long n;

    if (argc == 2 && strcmp(argv[1], "tanh") == 0)
        return tangents();
    memset(&s, 0, sizeof s);
    while (fread(seen, sizeof seen[0], policy.inputs, stdin) == policy.inputs) {
        for (n = 0; n < count; n++) {
            memcpy(s.memory, seen, policy.inputs * sizeof seen[0]);
            vs_policy_think(&policy, s.memory);
        }
        if (fwrite(s.memory + policy.action, sizeof seen[0], policy.outputs, stdout) !=
            policy.outputs)
            return 1;
    }
    return 0;
}
