/* The peer of the controller task: a loop at absolute deadlines on clock_nanosleep, and nothing else.
 *
 *     nanosleep PERIOD_NS CYCLES SPINS [PRIORITY]
 *
 * prints how late each cycle started, in ns, one a line. As in an RTOS, a cycle that could not start within its slot
 * is missed and never replayed; a line "missed N" tells of them at the end. With SPINS 1 it wakes early and spins for the
 * rest, by the same rule for the margin as the robot's scheduler; with 0 it only sleeps. With a PRIORITY it runs under
 * SCHED_FIFO.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <time.h>

enum { MARGIN_MIN = 20000, MARGIN_START = 100000, MARGIN_MAX = 250000 }; /* ns, as in txt1/kernel/scheduler.py */

static long long now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int argc, char **argv)
{
    if (argc != 4 && argc != 5) {
        fprintf(stderr, "usage: %s PERIOD_NS CYCLES SPINS [PRIORITY]\n", argv[0]);
        return 2;
    }
    const long long period = atoll(argv[1]);
    const long cycles = atol(argv[2]);
    long long margin = atoi(argv[3]) ? MARGIN_START : 0;
    long long *late = calloc((size_t)cycles, sizeof *late); /* touched here: no page fault in a cycle */
    long run = 0, missed = 0;
    if (late == NULL || period <= 0)
        return 2;
    for (long i = 0; i < cycles; i++)
        late[i] = -1;
    if (argc == 5) {
        const struct sched_param fifo = {atoi(argv[4])};
        if (sched_setscheduler(0, SCHED_FIFO, &fifo) != 0) {
            perror("SCHED_FIFO");
            return 1;
        }
    }
    prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL); /* the same as the robot's event loop */

    long long deadline = now_ns() + period;
    for (long i = 0; i < cycles; i++) {
        const long long wake = deadline - margin;
        struct timespec until = {wake / 1000000000LL, wake % 1000000000LL};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR)
            ;
        if (margin) {
            const long long past = now_ns() - deadline;
            if (past <= 0)
                margin = margin * 99 / 100;
            else if (past < 1000000)
                margin = margin * 109 / 100;
            margin = margin > MARGIN_MAX ? MARGIN_MAX : margin < MARGIN_MIN ? MARGIN_MIN : margin;
            while (now_ns() < deadline)
                ;
        }
        long long l = now_ns() - deadline;
        long long skipped = l / period;
        late[run++] = l - skipped * period;
        missed += skipped;
        i += skipped;
        deadline += (skipped + 1) * period;
    }
    for (long i = 0; i < run; i++)
        printf("%lld\n", late[i]);
    printf("missed %ld\n", missed);
    return 0;
}
