/* The least lateness that this machine allows: a bare clock_nanosleep loop.
   bench_floor PERIOD_NS COUNT PRIORITY prints the lateness of each wake-up in microseconds, one a line. */
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>

int main(int argc, char **argv) {
    if (argc != 4) return 2;
    long period = atol(argv[1]), count = atol(argv[2]);
    struct sched_param param = {.sched_priority = atoi(argv[3])};
    if (param.sched_priority > 0 && sched_setscheduler(0, SCHED_FIFO, &param) != 0) return 3;
    long *late = calloc(count, sizeof *late);
    if (late == NULL) return 4;
    mlockall(MCL_CURRENT | MCL_FUTURE);
    struct timespec due, now;
    clock_gettime(CLOCK_MONOTONIC, &due);
    for (long k = 0; k < count; k++) {
        due.tv_nsec += period;
        while (due.tv_nsec >= 1000000000L) { due.tv_nsec -= 1000000000L; due.tv_sec++; }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        clock_gettime(CLOCK_MONOTONIC, &now);
        late[k] = (now.tv_sec - due.tv_sec) * 1000000L + (now.tv_nsec - due.tv_nsec) / 1000L;
    }
    for (long k = 0; k < count; k++) printf("%ld\n", late[k]);
    return 0;
}
