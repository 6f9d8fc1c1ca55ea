/* SPDX-License-Identifier: MIT */
/* check.h - the whole test framework: a claim that is wrong says so and ends the test. */
#ifndef CHECK_H
#define CHECK_H

#include <stdio.h>
#include <stdlib.h>

#define CHECK(claim) check_that((claim) != 0, __FILE__, __LINE__, #claim, "")
#define CHECK_FOR(what, claim) check_that((claim) != 0, __FILE__, __LINE__, #claim, what)

static void check_that(int is_true, const char *file, int line, const char *claim,
                       const char *what)
{
    if (!is_true) {
        fprintf(stderr, "%s:%d: not true: %s %s\n", file, line, claim, what);
        exit(1);
    }
}

#endif
