/* SPDX-License-Identifier: MIT */
#include "guard_rights.h"

#include <fcntl.h>
#include <link.h>
#include <linux/capability.h>
#include <sched.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "../c_src/vs_format.h"

#define PRIORITY 1      /* before all ordinary processes, behind the kernel's own */
#define STACK 12288     /* [byte] more than the guard ever uses */
#define BOUNDED 64      /* numbers of capabilities that Linux may have */
#define KEPT (1u << CAP_IPC_LOCK | 1u << CAP_SYS_NICE | 1u << CAP_SYS_RESOURCE)

long syscall(long number, ...); /* no part of POSIX, so no header shows it */

extern const ElfW(Ehdr) __ehdr_start; /* the linker puts it where the program begins */

/* Locks a part of the program, but for what may be swapped out. */
static int lock_part(uintptr_t at, size_t len, uintptr_t spare, size_t spare_len)
{
    if (spare < at || spare + spare_len > at + len)
        return mlock((const void *)at, len);
    return mlock((const void *)at, spare - at) |
           mlock((const void *)(spare + spare_len), at + len - spare - spare_len);
}

/* The program's own parts, as the kernel mapped them. mlockall() would lock the whole of the
 * stack's first 132 kB besides, and the C library's pages that nobody uses. */
static int lock_program(uintptr_t spare, size_t spare_len)
{
    uintptr_t begin = (uintptr_t)&__ehdr_start;
    const ElfW(Phdr) *parts = (const ElfW(Phdr) *)(begin + __ehdr_start.e_phoff);
    uintptr_t offset = 0;
    int err = 0;
    int i;

    for (i = 0; i < __ehdr_start.e_phnum; i++) {
        if (parts[i].p_type != PT_LOAD)
            continue;
        if (parts[i].p_offset == 0) /* the part that the header itself is in */
            offset = begin - parts[i].p_vaddr;
        err |= lock_part(offset + parts[i].p_vaddr, parts[i].p_memsz, spare, spare_len);
    }
    return err;
}

/* From here downwards: the caller's callers are not come back to. */
static int lock_stack(void)
{
    volatile char depth[STACK];
    size_t i;

    for (i = 0; i < sizeof depth; i += 1024)
        depth[i] = 0;
    return mlock((const void *)(uintptr_t)depth, sizeof depth);
}

static int write_file(const char *path, const char *text)
{
    int fd = open(path, O_WRONLY);
    ssize_t len = -1;

    if (fd >= 0) {
        len = write(fd, text, strlen(text));
        close(fd);
    }
    return len > 0 ? 0 : -1;
}

/* Before Linux 2.6.36 the score had another file and another scale. */
static int set_oom_score(const char *score, const char *old_score)
{
    if (access("/proc/self/oom_score_adj", F_OK) == 0)
        return write_file("/proc/self/oom_score_adj", score);
    return write_file("/proc/self/oom_adj", old_score);
}

/* The C library for the robots' boards has this function, but it only says ENOSYS. */
static int set_scheduler(int policy, int priority)
{
    return (int)syscall(SYS_sched_setscheduler, 0, policy, &priority);
}

unsigned int vs_rights_take(const void *spare, size_t spare_len)
{
    unsigned int refused = 0;
    int unlocked = lock_program((uintptr_t)spare, spare_len);

    if ((unlocked | lock_stack()) != 0)
        refused |= VS_RIGHT_MEMORY;
    if (set_oom_score("-1000", "-17") != 0)
        refused |= VS_RIGHT_OOM;
    if (set_scheduler(SCHED_FIFO, PRIORITY) != 0)
        refused |= VS_RIGHT_TIME;
    return refused;
}

void vs_rights_give_back(void)
{
    (void)set_scheduler(SCHED_OTHER, 0);
    (void)set_oom_score("0", "0");
}

/* The first version of the call knows 32 capabilities, takes the rest away, and is known to every
 * Linux. The bound keeps a program that root starts from having all again where the kernel is
 * older than "no new privileges", 3.5; one that is older than the bound, 2.6.25, has neither. */
int vs_rights_drop(void)
{
    struct __user_cap_header_struct head = {_LINUX_CAPABILITY_VERSION_1, 0};
    struct __user_cap_data_struct rights;
    long number;

    for (number = 0; number < BOUNDED; number++)
        if (number >= 32 || !(KEPT >> number & 1u))
            (void)syscall(SYS_prctl, (long)PR_CAPBSET_DROP, number, 0L, 0L, 0L);
    (void)syscall(SYS_prctl, (long)PR_SET_NO_NEW_PRIVS, 1L, 0L, 0L, 0L);
    if (syscall(SYS_capget, &head, &rights) != 0)
        return -1;
    rights.effective &= KEPT;
    rights.permitted &= KEPT;
    rights.inheritable &= KEPT;
    return (int)syscall(SYS_capset, &head, &rights);
}

void vs_rights_text(unsigned int refused, char text[VS_RIGHTS_TEXT])
{
    vs_format(text, VS_RIGHTS_TEXT, "without%s%s%s",
              refused & VS_RIGHT_MEMORY ? " locked memory," : "",
              refused & VS_RIGHT_OOM ? " the least out-of-memory score," : "",
              refused & VS_RIGHT_TIME ? " real-time priority," : "");
    text[strlen(text) - 1] = '\0';
}
