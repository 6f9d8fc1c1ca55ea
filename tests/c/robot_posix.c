/* SPDX-License-Identifier: MIT */
/*
 * The POSIX edge of the line on a device that says ready and then takes or gives nothing:
 * read and write end with their deadline. Its system calls are replaced before it is read.
 */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "check.h"

#define LIMIT 1000 /* calls that end nothing: a loop without end */

static int calls;
static ssize_t outcome; /* of read and write: -1 = EAGAIN */

static int always_ready(struct pollfd *fds)
{
    fds->revents = fds->events;
    return 1;
}

static ssize_t give_outcome(void)
{
    CHECK(++calls < LIMIT);
    errno = EAGAIN;
    return outcome;
}

static int settings_made;
static int gathered; /* VMIN of the newest */

static int note_settings(const struct termios *settings)
{
    settings_made++;
    gathered = settings->c_cc[VMIN];
    return 0;
}

/* Each look at the clock is a millisecond later. */
static int tick(struct timespec *now)
{
    static long ms;

    ms++;
    now->tv_sec = 1;
    now->tv_nsec = ms * 1000000;
    return 0;
}

#undef SYS_clock_gettime32
#define poll(fds, count, timeout_ms) always_ready(fds)
#define read(fd, buf, cap) ((void)(fd), (void)(buf), (void)(cap), give_outcome())
#define write(fd, buf, len) ((void)(fd), (void)(buf), (void)(len), give_outcome())
#define tcsetattr(fd, when, settings) ((void)(fd), note_settings(settings))
#define clock_gettime(clock, now) tick(now)
#ifndef VSENSED_SLOW_CLOCK
#define VSENSED_SLOW_CLOCK
#endif
#include "../../c_src/vs_posix.c"
#undef read
#undef write

/* The kernel is told how much to wait for when that changes, and only then. */
static void test_gathering(struct vs_io *io)
{
    uint8_t buf[72];
    int i;

    outcome = 64; /* so many at once, however many are there */
    for (i = 0; i < 3; i++) {
        io->expect(io->context, 72);
        CHECK(io->read(io->context, buf, 72, io->now_ns(io->context) + 20000000) == 128);
        CHECK(settings_made == 1 && gathered == 72);
    }
    io->expect(io->context, 72);
    CHECK(io->read(io->context, buf, 1, 0) == 64 && settings_made == 1);
    CHECK(io->read(io->context, buf, 1, io->now_ns(io->context) + 20000000) == 64);
    CHECK(settings_made == 2 && gathered == 1);
    vs_posix_take_over();
    CHECK(io->read(io->context, buf, 1, io->now_ns(io->context) + 20000000) == 64);
    CHECK(settings_made == 3 && gathered == 1);
}

/* At half of the clock's rate half of the time has passed, and waits last twice as long. */
static void test_a_slow_clock(void)
{
    uint64_t fast_ns = vs_posix_now_ns();
    uint64_t slow_ns;

    vs_posix_slow(500);
    slow_ns = vs_posix_now_ns();
    CHECK(slow_ns >= fast_ns / 2 && slow_ns < fast_ns);
    CHECK(vs_posix_timeout_ms(0, 3000000) == 6 && vs_posix_timeout_ms(0, UINT64_MAX) == -1);
    CHECK(vs_posix_timeout_ms(5, 5) == 0 && vs_posix_timeout_ms(0, 1) == 2);
    vs_posix_slow(1);
    CHECK(vs_posix_timeout_ms(0, 1000000) == 1000);
    CHECK(vs_posix_timeout_ms(0, 2000000000000u) == 1000000);
    vs_posix_slow(1000);
    CHECK(vs_posix_timeout_ms(0, 3000000) == 3);
}

int main(void)
{
    uint8_t buf[12] = {0};
    struct vs_io io;
    int fd = 0;

    vs_posix_io(&io, &fd);
    outcome = -1;
    CHECK(io.read(io.context, buf, sizeof buf, io.now_ns(io.context) + 20000000) == 0);
    CHECK(io.read(io.context, buf, sizeof buf, 0) == 0);
    CHECK(io.write(io.context, buf, sizeof buf, io.now_ns(io.context) + 20000000) == VS_ERR_IO);
    outcome = 0;
    CHECK(io.write(io.context, buf, sizeof buf, io.now_ns(io.context) + 20000000) == VS_ERR_IO);
    CHECK(io.read(io.context, buf, sizeof buf, 0) == VS_ERR_HANGUP);
    outcome = sizeof buf;
    CHECK(io.read(io.context, buf, sizeof buf, 0) == (int)sizeof buf);
    CHECK(io.write(io.context, buf, sizeof buf, 0) == VS_OK);
    CHECK(settings_made == 0);
    test_gathering(&io);
    test_a_slow_clock();
    return 0;
}
