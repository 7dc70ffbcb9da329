/* A disk that does not answer: fsync waits for as long as the file named by HELD_DISK exists. For LD_PRELOAD. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdlib.h>
#include <unistd.h>

int fsync(int descriptor)
{
    static int (*machine_fsync)(int);
    const char *held = getenv("HELD_DISK");
    if (machine_fsync == NULL)
        machine_fsync = (int (*)(int))dlsym(RTLD_NEXT, "fsync");
    while (held != NULL && access(held, F_OK) == 0)
        usleep(20000);
    return machine_fsync(descriptor);
}
