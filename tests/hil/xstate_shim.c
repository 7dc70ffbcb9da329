/* Lets User Mode Linux run on processors whose register state is larger than it knows (AMX: 11 kB).
 *
 * The host's kernel takes PTRACE_SETREGSET of the extended state only in its full size, while the guest's kernel
 * keeps 2696 bytes of it. So what it sets is filled up to the full size with zeros, which is the initial state
 * of what it leaves out (nothing in the guest uses that). Loaded with LD_PRELOAD; elsewhere it changes nothing.
 */
#define _GNU_SOURCE
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#define NT_X86_XSTATE 0x202

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
