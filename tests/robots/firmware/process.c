/* Runs firmware of a dsPIC as a process: `process LINE PAGE`.
 *
 * LINE is the descriptor of a pseudo-terminal's master, the UART, or of a bus' listening socket; PAGE
 * a file for struct page. The
 * timer's interrupt is a signal, so it comes between any two instructions of the firmware, as on the
 * chip; periods that the machine has slept through are made up for. A reset starts the program anew:
 * nothing of its memory is left but the page. */
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "page.h"

int firmware_main(void);

struct page *page;
int line;
static char **words;
static int64_t next_ns;

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC_RAW, &t); /* as vsense does */
    return t.tv_sec * (int64_t)1000000000 + t.tv_nsec;
}

static void begin_anew(void)
{
    execv("/proc/self/exe", words);
    _exit(1);
}

void pic_word(const char *word)
{
    if (strcmp(word, "reset") == 0)
        begin_anew();
}

static void tick(int signal_number)
{
    (void)signal_number;
    if (page->reset) {
        page->reset = 0;
        begin_anew();
    }
    int64_t now = now_ns();
    if (now - next_ns > page->late_ns)
        page->late_ns = now - next_ns;
    for (; next_ns <= now; next_ns += TICK_NS)
        chip_tick();
    int32_t left = page->left_steps, right = page->right_steps;
    chip_shows(page);
    if (left != page->left_steps || right != page->right_steps)
        page->stepped_ns = now;
}

int uart_get(char *c)
{
    struct pollfd waited = {.fd = line, .events = POLLIN};
    return poll(&waited, 1, 1) == 1 && read(line, c, 1) == 1;
}

void uart_flush(void)
{
    char lost;
    while (uart_get(&lost))
        ;
}

void uart_put(const char *bytes, int length)
{
    for (int done = 0; done < length;) {
        ssize_t put = write(line, bytes + done, (size_t)(length - done));
        if (put > 0)
            done += (int)put;
    }
}

int main(int count, char **arguments)
{
    if (count != 3)
        return 2;
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* it never outlives its test */
    words = arguments;
    line = atoi(arguments[1]);
    int file = open(arguments[2], O_RDWR | O_CLOEXEC);
    page = mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (page == MAP_FAILED) {
        perror(arguments[2]);
        return 1;
    }
    page->resets++;
    next_ns = now_ns();
    struct sigaction action = {.sa_handler = tick};
    sigaction(SIGALRM, &action, NULL);
    sigset_t alarms; /* blocked where the handler itself has started the program anew */
    sigemptyset(&alarms);
    sigaddset(&alarms, SIGALRM);
    sigprocmask(SIG_UNBLOCK, &alarms, NULL);
    struct itimerval every = {{0, TICK_NS / 1000}, {0, TICK_NS / 1000}};
    setitimer(ITIMER_REAL, &every, NULL);
    return firmware_main();
}
