/* Steps Betaflight's SITL, unmodified, in lockstep: preloaded (LD_PRELOAD), it takes the place of its clock and its UDP.
 *
 * The firmware sleeps 50 us between two turns of its scheduler. Linux makes 125 us and more of that, and its 8 kHz loop
 * starves. Here CLOCK_MONOTONIC stands until the simulator grants time, and runs on by what the firmware sleeps. One
 * message on the socket LOCKSTEP_FD a step; the simulator's end closing ends the process.
 *
 *     to us    u64 time granted [ns], u64 what comes: 1 state, 2 channels; 144 bytes of state; 40 bytes of channels
 *     from us  u32 times that the motors were set, u16 port of the command line, u16 0, 4 x f32 motors 0..1
 *
 * State and channels are handed to the firmware's own threads, and time goes on when these have taken them: so a run is
 * the same to the bit each time. No UDP port is opened; those of TCP are ones that the kernel finds, on the loopback.
 *
 * Main thread and the one that serves TCP share a list of ports without a lock of their own: a port opened while the
 * other looked through the list was freed under it, and its board listened and never answered. Here one of the two runs
 * at a time: the server while the main thread waits for a step, the main thread while the server waits for its sockets.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <netinet/in.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { MOTORS_PORT = 9002, STATE_PORT = 9003, CHANNELS_PORT = 9004, CLI_PORT = 5761 };
#define READ_NS 50 /* what it takes to read the clock: loops that wait for it go on */

struct step { uint64_t granted_ns, what; uint8_t state[144], channels[40]; };
struct answer { uint32_t updates; uint16_t cli_port, none; float motors[4]; };
struct mouth { int fd, full; size_t size; const uint8_t *data; sem_t given, taken; };

static int wire = -1;
static pid_t main_thread;
static pthread_mutex_t ports = PTHREAD_MUTEX_INITIALIZER; /* main thread, but for its waits */
static _Atomic uint64_t now_ns = 1000000000, until_ns = 1000000000;
static struct step step;
static struct answer answer;
static struct mouth mouths[2] = {{.fd = -1, .size = sizeof step.state, .data = step.state},
                                 {.fd = -1, .size = sizeof step.channels, .data = step.channels}};

static int is_main(void) {
    static __thread pid_t id;
    if (!id) id = (pid_t)syscall(SYS_gettid);
    return id == main_thread;
}

__attribute__((constructor)) static void start(void) {
    const char *text = getenv("LOCKSTEP_FD");
    if (!text) return;
    wire = atoi(text);
    main_thread = getpid();
    pthread_mutex_lock(&ports);
    for (int i = 0; i < 2; i++) { sem_init(&mouths[i].given, 0, 0); sem_init(&mouths[i].taken, 0, 0); }
}

int clock_gettime(clockid_t clock, struct timespec *at) {
    if (wire < 0 || clock != CLOCK_MONOTONIC) return (int)syscall(SYS_clock_gettime, clock, at);
    if (is_main()) now_ns += READ_NS;
    uint64_t now = now_ns;
    at->tv_sec = (time_t)(now / 1000000000);
    at->tv_nsec = (long)(now % 1000000000);
    return 0;
}

static void take_step(void) {
    static int asked;
    if (asked && send(wire, &answer, sizeof answer, MSG_NOSIGNAL) < 0) _exit(0);
    asked = 1;
    pthread_mutex_unlock(&ports);
    if (recv(wire, &step, sizeof step, 0) != sizeof step) _exit(0);
    pthread_mutex_lock(&ports);
    until_ns += step.granted_ns;
    for (int i = 0; i < 2; i++)
        if (step.what & 1u << i && mouths[i].fd >= 0) { sem_post(&mouths[i].given); sem_wait(&mouths[i].taken); }
}

int nanosleep(const struct timespec *length, struct timespec *rest) {
    if (wire < 0 || !is_main()) return (int)syscall(SYS_nanosleep, length, rest);
    now_ns += (uint64_t)length->tv_sec * 1000000000 + (uint64_t)length->tv_nsec;
    while (now_ns >= until_ns) take_step();
    return 0;
}

int select(int n, fd_set *reads, fd_set *writes, fd_set *faults, struct timeval *limit) {
    for (int i = 0; i < 2; i++) {
        struct mouth *mouth = &mouths[i];
        if (mouth->fd < 0 || n != mouth->fd + 1 || writes) continue;
        if (mouth->full) { mouth->full = 0; sem_post(&mouth->taken); }
        struct timespec due;
        syscall(SYS_clock_gettime, CLOCK_REALTIME, &due);
        due.tv_nsec += limit->tv_usec * 1000;
        due.tv_sec += limit->tv_sec + due.tv_nsec / 1000000000;
        due.tv_nsec %= 1000000000;
        return mouth->full = sem_timedwait(&mouth->given, &due) == 0;
    }
    static int (*real)(int, fd_set *, fd_set *, fd_set *, struct timeval *);
    if (!real) real = dlsym(RTLD_NEXT, "select");
    if (wire < 0) return real(n, reads, writes, faults, limit);
    pthread_mutex_unlock(&ports);
    int ready = real(n, reads, writes, faults, limit);
    pthread_mutex_lock(&ports);
    return ready;
}

sighandler_t signal(int number, sighandler_t handler) {
    static sighandler_t (*real)(int, sighandler_t);
    if (!real) real = dlsym(RTLD_NEXT, "signal");
    if (wire >= 0 && number == SIGPIPE) pthread_mutex_lock(&ports); /* what the server does first, before its list */
    return real(number, handler);
}

int pthread_join(pthread_t thread, void **result) {
    static int (*real)(pthread_t, void **);
    if (wire >= 0 && !real) pthread_mutex_unlock(&ports); /* the server, joined first, ends once it has run on */
    if (!real) real = dlsym(RTLD_NEXT, "pthread_join");
    return real(thread, result);
}

ssize_t recvfrom(int fd, void *data, size_t size, int flags, struct sockaddr *from, socklen_t *length) {
    for (int i = 0; i < 2; i++)
        if (wire >= 0 && fd == mouths[i].fd && size >= mouths[i].size) {
            memcpy(data, mouths[i].data, mouths[i].size);
            return (ssize_t)mouths[i].size;
        }
    return syscall(SYS_recvfrom, fd, data, size, flags, from, length);
}

ssize_t sendto(int fd, const void *data, size_t size, int flags, const struct sockaddr *to, socklen_t length) {
    if (wire < 0 || !to || to->sa_family != AF_INET) return syscall(SYS_sendto, fd, data, size, flags, to, length);
    if (ntohs(((const struct sockaddr_in *)to)->sin_port) == MOTORS_PORT && size == sizeof answer.motors) {
        memcpy(answer.motors, data, size);
        answer.updates++;
    }
    return (ssize_t)size;
}

int bind(int fd, const struct sockaddr *at, socklen_t length) {
    if (wire < 0 || (at->sa_family != AF_INET && at->sa_family != AF_INET6)) return (int)syscall(SYS_bind, fd, at, length);
    int port = ntohs(((const struct sockaddr_in *)at)->sin_port); /* where sockaddr_in6 has it, too */
    if (port == STATE_PORT || port == CHANNELS_PORT) { mouths[port - STATE_PORT].fd = fd; return 0; }
    union { struct sockaddr any; struct sockaddr_in v4; struct sockaddr_in6 v6; } here = {.any = {.sa_family = at->sa_family}};
    if (at->sa_family == AF_INET) here.v4.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    else here.v6.sin6_addr = in6addr_loopback;
    socklen_t size = at->sa_family == AF_INET ? sizeof here.v4 : sizeof here.v6;
    if (syscall(SYS_bind, fd, &here, size) < 0) return -1;
    if (port == CLI_PORT && !getsockname(fd, &here.any, &size)) answer.cli_port = ntohs(here.v4.sin_port);
    return 0;
}
