/* SPDX-License-Identifier: MIT */
/* vs_format.h against the C library's snprintf: the same text from the same words. */
#include "../../c_src/vs_format.h"

#include <inttypes.h>
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "check.h"

/* Both with room for all, and with every room that is too small. */
#define SAME(...)                                                                   \
    do {                                                                            \
        char ours[200];                                                             \
        char theirs[200];                                                           \
        size_t size;                                                                \
        for (size = 1; size <= sizeof ours; size++) {                               \
            memset(ours, 'x', sizeof ours);                                         \
            snprintf(theirs, size, __VA_ARGS__);                                    \
            CHECK_FOR(theirs, vs_format(ours, size, __VA_ARGS__) == strlen(theirs)); \
            CHECK_FOR(theirs, strcmp(ours, theirs) == 0);                           \
            CHECK(size == sizeof ours || ours[size] == 'x');                        \
        }                                                                           \
    } while (0)

int main(void)
{
    static const char *volatile empty = ""; /* what a compiler sees it warns of */

    SAME("plain");
    SAME("%s", empty);
    SAME("%s:%u: %s%%", "file", 17u, "text");
    SAME("%d %d %d %d", 0, -1, INT_MAX, INT_MIN);
    SAME("%u %u", 0u, UINT_MAX);
    SAME("%ld %ld %lu", LONG_MIN, LONG_MAX, ULONG_MAX);
    SAME("%lld %lld %llu", LLONG_MIN, LLONG_MAX, ULLONG_MAX);
    SAME("%" PRIu32 " %" PRId64 " %" PRIu64, UINT32_MAX, INT64_MIN, UINT64_MAX);
    SAME("[%-8s] [%8s] [%-3s] [%5d] [%-5u]", "clock", "clock", "clock", -12, 34u);
    SAME("[%.3s] [%.0s] [%.9s] [%.*s]", "abcdef", "abc", "abc", 2, "xyz");
    SAME("[%-*s] [%*u]", 6, "ab", 4, 7u);
    return 0;
}
