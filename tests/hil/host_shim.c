/* What stands between User Mode Linux and the machine: loaded into its kernel with LD_PRELOAD.
 *
 * 1. The guest's clock. With HIL_PACE=0.5 in the environment a second of the guest takes two of the machine's:
 * its clocks run that much slower, its timers expire that much later, and its processor does twice the work in
 * one of its seconds. So a guest keeps its time on a machine whose processor is taken away now and then.
 *
 * 2. Processors whose register state is larger than the guest's kernel knows (AMX: 11 kB). The host's kernel takes
 * PTRACE_SETREGSET of the extended state only in its full size, while the guest's kernel keeps 2696 bytes of it.
 * So what it sets is filled up to the full size with zeros, which is the initial state of what it leaves out
 * (nothing in the guest uses that). Elsewhere it changes nothing.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#define NT_X86_XSTATE 0x202

#define CLOCKS 2
#define SECOND_NS 1000000000LL

static double pace = 1.0;
static int64_t began_ns[CLOCKS];
static int (*machine_gettime)(clockid_t, struct timespec *);
static int (*machine_settime)(timer_t, int, const struct itimerspec *, struct itimerspec *);

static int64_t to_ns(const struct timespec *time) { return time->tv_sec * SECOND_NS + time->tv_nsec; }

static struct timespec from_ns(int64_t ns)
{
    return (struct timespec){.tv_sec = ns / SECOND_NS, .tv_nsec = ns % SECOND_NS};
}

__attribute__((constructor)) static void begin(void)
{
    const char *word = getenv("HIL_PACE");
    machine_gettime = dlsym(RTLD_NEXT, "clock_gettime");
    machine_settime = dlsym(RTLD_NEXT, "timer_settime");
    for (clockid_t clock = 0; clock < CLOCKS; clock++) {
        struct timespec now;
        machine_gettime(clock, &now);
        began_ns[clock] = to_ns(&now);
    }
    if (word != NULL && atof(word) > 0.0)
        pace = atof(word);
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    int result = machine_gettime(clock, time);
    /* CLOCK_REALTIME and CLOCK_MONOTONIC; of the others the guest asks only how long a thread has run. */
    if (result == 0 && pace != 1.0 && clock >= 0 && clock < CLOCKS)
        *time = from_ns(began_ns[clock] + (int64_t)((double)(to_ns(time) - began_ns[clock]) * pace));
    return result;
}

int gettimeofday(struct timeval *restrict time, void *restrict zone)
{
    struct timespec now;
    (void)zone;
    if (clock_gettime(CLOCK_REALTIME, &now) != 0)
        return -1;
    *time = (struct timeval){.tv_sec = now.tv_sec, .tv_usec = now.tv_nsec / 1000};
    return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *wanted, struct itimerspec *before)
{
    /* The guest's kernel sets relative times alone. */
    struct itimerspec longer = *wanted;
    if (pace != 1.0 && !(flags & TIMER_ABSTIME)) {
        longer.it_value = from_ns((int64_t)((double)to_ns(&wanted->it_value) / pace));
        longer.it_interval = from_ns((int64_t)((double)to_ns(&wanted->it_interval) / pace));
    }
    return machine_settime(timer, flags, &longer, before);
}

static char whole[1 << 16];
static size_t full_size;

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    long pid = va_arg(arguments, long);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (request == PTRACE_SETREGSET && address == (void *)NT_X86_XSTATE) {
        const struct iovec *given = data;
        if (full_size == 0) {
            struct iovec all = {whole, sizeof whole};
            if (syscall(SYS_ptrace, PTRACE_GETREGSET, pid, address, &all) == 0)
                full_size = all.iov_len;
            memset(whole, 0, sizeof whole);
        }
        if (given->iov_len < full_size) {
            struct iovec all = {whole, full_size};
            memcpy(whole, given->iov_base, given->iov_len);
            return syscall(SYS_ptrace, request, pid, address, &all);
        }
    }
    if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
        /* The bare system call hands the word over in memory. */
        long word = 0;
        return syscall(SYS_ptrace, request, pid, address, &word) < 0 ? -1 : word;
    }
    return syscall(SYS_ptrace, request, pid, address, data);
}
