/* SPDX-License-Identifier: MIT */
#include "vs_posix.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/syscall.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define LOCK_RETRY_MS 20
#define DESCRIPTORS 64 /* more than a daemon ever has */

static uint64_t recent_ns;
static clockid_t clock_id = CLOCK_MONOTONIC_RAW;
#ifdef VSENSED_SLOW_CLOCK
static uint32_t pace_permille = 1000;
#else
enum { pace_permille = 1000 };
#endif

#ifdef SYS_clock_gettime32
long syscall(long number, ...); /* no part of POSIX, so no header shows it */

/* musl makes the call of Linux 5.1 first. Where the kernel is older it fails, every time,
 * and each reading costs two calls. */
static int read_clock(struct timespec *now)
{
    long old[2]; /* the time since the board's start fits it for 68 years */

    if (syscall(SYS_clock_gettime32, clock_id, old) != 0)
        return clock_gettime(clock_id, now);
    now->tv_sec = old[0];
    now->tv_nsec = old[1];
    return 0;
}
#else
static int read_clock(struct timespec *now)
{
    return clock_gettime(clock_id, now);
}
#endif

uint64_t vs_posix_now_ns(void)
{
    struct timespec now;

    /* Linux before 2.6.28 has no clock that nobody slews. Asked for once: a time of another
     * clock in mid-life would be a jump. */
    if (read_clock(&now) != 0 && recent_ns == 0) {
        clock_id = CLOCK_MONOTONIC;
        read_clock(&now);
    }
    recent_ns = (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
    if (pace_permille != 1000)
        recent_ns = recent_ns / 1000 * pace_permille + recent_ns % 1000 * pace_permille / 1000;
    return recent_ns;
}

#ifdef VSENSED_SLOW_CLOCK
void vs_posix_slow(uint32_t permille)
{
    pace_permille = permille;
}
#endif

int vs_posix_clock_is_slewed(void)
{
    (void)vs_posix_now_ns();
    return clock_id == CLOCK_MONOTONIC;
}

uint64_t vs_posix_recent_ns(void)
{
    return recent_ns != 0 ? recent_ns : vs_posix_now_ns();
}

int vs_posix_timeout_ms(uint64_t now_ns, uint64_t deadline_ns)
{
    uint64_t ms;

    if (deadline_ns == UINT64_MAX)
        return -1;
    if (deadline_ns <= now_ns)
        return 0;
    ms = (deadline_ns - now_ns + 999999u) / 1000000u;
    if (pace_permille != 1000 && ms < 1000000u)
        ms = (ms * 1000 + pace_permille - 1) / pace_permille;
    return ms < 1000000u ? (int)ms : 1000000;
}

void vs_posix_keep_from_children(int fd)
{
    fcntl(fd, F_SETFD, FD_CLOEXEC);
}

void vs_posix_close_kept(void)
{
    int fd;

    for (fd = STDERR_FILENO + 1; fd < DESCRIPTORS; fd++)
        if (fcntl(fd, F_GETFD) == FD_CLOEXEC)
            close(fd);
}

void vs_posix_close_but(int one, int other)
{
    int fd;

    for (fd = STDERR_FILENO + 1; fd < DESCRIPTORS; fd++)
        if (fd != one && fd != other)
            close(fd);
}

/* The serial port. The kernel wakes whoever waits when `gathers` bytes are there. */
static struct termios settings;
static size_t gathers = 1;  /* 0: nobody knows */
static size_t expected = 1; /* by the next read */

static int set_raw(int fd, speed_t speed)
{
    if (tcgetattr(fd, &settings) != 0)
        return -1;
    settings.c_iflag = 0;
    settings.c_oflag = 0;
    settings.c_lflag = 0;
    settings.c_cflag = CS8 | CREAD | CLOCAL;
    settings.c_cc[VMIN] = 1;
    settings.c_cc[VTIME] = 0;
    if (cfsetispeed(&settings, speed) != 0 || cfsetospeed(&settings, speed) != 0)
        return -1;
    if (tcsetattr(fd, TCSANOW, &settings) != 0)
        return -1;
    gathers = expected = 1;
    return tcflush(fd, TCIOFLUSH);
}

int vs_posix_lock(int fd, uint64_t wait_ns)
{
    uint64_t until_ns = vs_posix_now_ns() + wait_ns;

    while (flock(fd, LOCK_EX | LOCK_NB) != 0) {
        if (errno != EWOULDBLOCK && errno != EINTR)
            return VS_ERR_IO;
        if (vs_posix_now_ns() >= until_ns)
            return VS_ERR_LOCKED;
        poll(NULL, 0, LOCK_RETRY_MS);
    }
    return VS_OK;
}

int vs_posix_open_serial(const char *path, uint32_t baud, uint64_t wait_ns, int *fd)
{
    int opened;
    int err;
    int why;

    if (baud != 115200 && baud != 230400)
        return VS_ERR_ARGUMENT;
    opened = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (opened < 0)
        return VS_ERR_IO;
    vs_posix_keep_from_children(opened);
    err = vs_posix_lock(opened, wait_ns);
    if (err == VS_OK && set_raw(opened, baud == 115200 ? B115200 : B230400) != 0)
        err = VS_ERR_IO;
    if (err != VS_OK) {
        why = errno;
        close(opened);
        errno = why;
        return err;
    }
    *fd = opened;
    return VS_OK;
}

static uint64_t io_now_ns(void *context)
{
    (void)context;
    return vs_posix_recent_ns();
}

int vs_posix_wait(int fd, short events, uint64_t deadline_ns)
{
    uint64_t now_ns = vs_posix_recent_ns();

    for (;;) {
        struct pollfd line = {fd, events, 0};
        int ready = poll(&line, 1, vs_posix_timeout_ms(now_ns, deadline_ns));

        now_ns = vs_posix_now_ns();
        if (ready > 0)
            return (line.revents & events) ? VS_OK : VS_ERR_HANGUP;
        if (ready < 0 && errno != EINTR)
            return VS_ERR_IO;
        if (now_ns >= deadline_ns)
            return VS_ERR_BUSY;
    }
}

/* 1: errno is of the passing kind. poll() may say ready again at once, so that a
 * loop which does not look at the time would never end. */
static int passing(void)
{
    return errno == EAGAIN || errno == EINTR;
}

static int failure(void)
{
    return errno == EIO || errno == ENXIO || errno == ENODEV ? VS_ERR_HANGUP : VS_ERR_IO;
}

/* Reads what is there. Returns how many bytes, 0 if there are none, or the error. */
static int read_some(int fd, uint8_t *buf, size_t cap)
{
    ssize_t len = read(fd, buf, cap);

    if (len > 0)
        return (int)len;
    if (len < 0 && passing())
        return 0;
    return len == 0 ? VS_ERR_HANGUP : failure();
}

static void io_expect(void *context, size_t len)
{
    (void)context;
    expected = len > 0 && len <= UCHAR_MAX ? len : 1;
}

/* Has the kernel wake this process when what the read expects is there. */
static int gather(int fd)
{
    size_t wanted = expected;

    expected = 1;
    if (wanted == gathers)
        return 0;
    settings.c_cc[VMIN] = (cc_t)wanted;
    gathers = wanted;
    return tcsetattr(fd, TCSANOW, &settings);
}

void vs_posix_take_over(void)
{
    gathers = 0;
}

/* Reads what was gathered: newer kernels hand out 64 bytes at a time. */
static int read_gathered(int fd, uint8_t *buf, size_t cap)
{
    int done = 0;

    while ((size_t)done < gathers && (size_t)done < cap) {
        int len = read_some(fd, buf + done, cap - (size_t)done);

        if (len <= 0)
            return done > 0 ? done : len;
        done += len;
    }
    return done;
}

static int io_read(void *context, uint8_t *buf, size_t cap, uint64_t deadline_ns)
{
    int fd = *(const int *)context;

    if (deadline_ns <= vs_posix_recent_ns()) {
        expected = 1;
        return read_some(fd, buf, cap);
    }
    if (gather(fd) != 0)
        return failure();
    for (;;) {
        int err = vs_posix_wait(fd, POLLIN, deadline_ns);
        int len;

        if (err == VS_ERR_BUSY)
            return gathers > 1 ? read_gathered(fd, buf, cap) : 0;
        if (err != VS_OK)
            return err;
        len = read_gathered(fd, buf, cap);
        if (len != 0 || vs_posix_recent_ns() >= deadline_ns)
            return len;
    }
}

static int io_write(void *context, const uint8_t *buf, size_t len, uint64_t deadline_ns)
{
    int fd = *(const int *)context;
    size_t done = 0;

    for (;;) {
        ssize_t step = write(fd, buf + done, len - done);
        int err;

        if (step > 0)
            done += (size_t)step;
        else if (step < 0 && !passing())
            return failure();
        if (done == len)
            return VS_OK;
        if (vs_posix_recent_ns() >= deadline_ns)
            return VS_ERR_IO;
        err = vs_posix_wait(fd, POLLOUT, deadline_ns);
        if (err != VS_OK)
            return err == VS_ERR_BUSY ? VS_ERR_IO : err;
    }
}

void vs_posix_io(struct vs_io *io, int *fd)
{
    io->context = fd;
    io->now_ns = io_now_ns;
    io->read = io_read;
    io->write = io_write;
    io->expect = io_expect;
}
