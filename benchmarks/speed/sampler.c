/* Where the processor is, every so often: the instruction pointer of whichever thread is running. */

#define _GNU_SOURCE
#include <signal.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/time.h>
#include <ucontext.h>

enum { MOST = 1 << 20 };
static uintptr_t seen[MOST];
static atomic_size_t taken;

static void take(int signal, siginfo_t *information, void *context)
{
    ucontext_t *at = context;
    size_t k = atomic_fetch_add(&taken, 1);
    (void)signal, (void)information;
    if (k < MOST)
#if defined(__x86_64__)
        seen[k] = (uintptr_t)at->uc_mcontext.gregs[REG_RIP];
#elif defined(__aarch64__)
        seen[k] = (uintptr_t)at->uc_mcontext.pc;
#else
#error "where the instruction pointer is kept on this processor is not known here"
#endif
}

/* Take a sample after every `microseconds` of this process's processor time, in all its threads; 0 if that works. */
int begin(long microseconds)
{
    struct sigaction action;
    struct itimerval every = {{microseconds / 1000000, microseconds % 1000000}, {0, 0}};
    memset(&action, 0, sizeof action);
    action.sa_sigaction = take;
    action.sa_flags = SA_SIGINFO | SA_RESTART;
    every.it_value = every.it_interval;
    return sigaction(SIGPROF, &action, NULL) || setitimer(ITIMER_PROF, &every, NULL);
}

/* Stop, and copy at most `room` samples to `out`; the number of them. */
size_t end(uintptr_t *out, size_t room)
{
    struct itimerval never;
    size_t n = atomic_load(&taken);
    memset(&never, 0, sizeof never);
    setitimer(ITIMER_PROF, &never, NULL);
    n = n < MOST ? n : MOST;
    n = n < room ? n : room;
    memcpy(out, seen, n * sizeof *out);
    return n;
}
