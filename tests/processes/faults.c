/* Faults of an OpenCL driver, for a process that this is preloaded into. The file that
   RHYTID_TEST_FAULT names holds a word and the name of a kernel, or * for all; then a launch of it does:
     segv        write where there is no memory
     hang        never come back
     error       fail with CL_OUT_OF_RESOURCES
     wait        nothing, but the next reading from the device never comes back
   Followed by "once", the file is removed first. The file may hold "call", the name of a function of
   OpenCL and an error instead, and "once": then that function fails with the error.
   The names of functions that were called are added to the file that RHYTID_TEST_CALLS names. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* The first letter of what a launch of a kernel shall do, 0 for nothing. */
static char asked(const char *kernel)
{
    const char *path = getenv("RHYTID_TEST_FAULT");
    char word[32] = "", name[128] = "", once[32] = "";
    FILE *file = path ? fopen(path, "r") : NULL;
    if (!file)
        return 0;
    int count = fscanf(file, "%31s %127s %31s", word, name, once);
    fclose(file);
    if (count < 2 || (strcmp(name, "*") && strcmp(name, kernel)))
        return 0;
    if (count == 3)
        unlink(path);
    return word[0];
}

static void hang(void)
{
    for (;;)
        sleep(1000);
}

/* The function of the loader that this one stands before; Python loads that for itself alone, so that
   RTLD_NEXT does not find it. */
static int is_loader(struct dl_phdr_info *info, size_t size, void *path)
{
    if (!strstr(info->dlpi_name, "libOpenCL"))
        return 0;
    *(const char **)path = info->dlpi_name;
    return 1;
}

static void *real(const char *name)
{
    const char *path = NULL;
    dl_iterate_phdr(is_loader, &path);
    void *loader = path ? dlopen(path, RTLD_LAZY | RTLD_NOLOAD) : NULL;
    return loader ? dlsym(loader, name) : NULL;
}

static int waits;

/* The error that a function shall fail with, 0 for none. */
static int failing(const char *function)
{
    const char *path = getenv("RHYTID_TEST_FAULT");
    char word[32] = "", name[128] = "", once[32] = "";
    int error = 0;
    FILE *file = path ? fopen(path, "r") : NULL;
    if (!file)
        return 0;
    int count = fscanf(file, "%31s %127s %d %31s", word, name, &error, once);
    fclose(file);
    if (count < 3 || strcmp(word, "call") || strcmp(name, function))
        return 0;
    if (count == 4)
        unlink(path);
    return error;
}

static void noted(const char *function, int *known)
{
    const char *path = getenv("RHYTID_TEST_CALLS");
    FILE *file = path && !*known ? fopen(path, "a") : NULL;
    *known = 1;
    if (file) {
        fprintf(file, "%s\n", function);
        fclose(file);
    }
}

/* A function of numbers and pointers alone, at most 12. It tells an error by what it returns, or where
   argument `told` points to; then it returns nothing. */
typedef long word;
typedef word (*anything)(word, word, word, word, word, word, word, word, word, word, word, word);
#define CALL(name, told)                                                                           \
    word name(word a1, word a2, word a3, word a4, word a5, word a6, word a7, word a8, word a9,     \
              word a10, word a11, word a12)                                                        \
    {                                                                                              \
        static int known;                                                                          \
        word all[] = {0, a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12};                       \
        noted(#name, &known);                                                                      \
        int error = failing(#name);                                                                \
        if (error && !told)                                                                        \
            return error;                                                                          \
        if (error) {                                                                               \
            if (all[told])                                                                         \
                *(int *)all[told] = error;                                                         \
            return 0;                                                                              \
        }                                                                                          \
        anything next = (anything)real(#name);                                                     \
        return next(a1, a2, a3, a4, a5, a6, a7, a8, a9, a10, a11, a12);                            \
    }

CALL(clCreateContext, 6)
CALL(clCreateCommandQueue, 4)
CALL(clCreateCommandQueueWithProperties, 4)
CALL(clCreateBuffer, 5)
CALL(clCreateSubBuffer, 5)
CALL(clCreateProgramWithSource, 5)
CALL(clCreateProgramWithBinary, 7)
CALL(clBuildProgram, 0)
CALL(clCreateKernel, 3)
CALL(clCreateKernelsInProgram, 0)
CALL(clSetKernelArg, 0)
CALL(clEnqueueWriteBuffer, 0)
CALL(clEnqueueWriteBufferRect, 0)
CALL(clEnqueueCopyBuffer, 0)
CALL(clEnqueueCopyBufferRect, 0)
CALL(clEnqueueFillBuffer, 0)
CALL(clEnqueueMapBuffer, 10)
CALL(clEnqueueUnmapMemObject, 0)
CALL(clEnqueueMarkerWithWaitList, 0)
CALL(clEnqueueBarrierWithWaitList, 0)
CALL(clWaitForEvents, 0)
CALL(clFinish, 0)
CALL(clFlush, 0)
CALL(clGetDeviceInfo, 0)
CALL(clGetProgramInfo, 0)
CALL(clGetProgramBuildInfo, 0)
CALL(clGetKernelInfo, 0)
CALL(clGetKernelWorkGroupInfo, 0)
CALL(clGetEventInfo, 0)
CALL(clGetEventProfilingInfo, 0)

typedef int (*launch)(void *, void *, unsigned, const size_t *, const size_t *, const size_t *,
                      unsigned, const void *, void *);
typedef int (*kernel_info)(void *, unsigned, size_t, void *, size_t *);

int clEnqueueNDRangeKernel(void *queue, void *kernel, unsigned dimensions, const size_t *offset,
                           const size_t *size, const size_t *group, unsigned count,
                           const void *events, void *event)
{
    static int known;
    noted("clEnqueueNDRangeKernel", &known);
    int error = failing("clEnqueueNDRangeKernel");
    if (error)
        return error;
    char name[128] = "";
    const unsigned function_name = 0x1190;
    ((kernel_info)real("clGetKernelInfo"))(kernel, function_name, sizeof name, name, NULL);
    switch (asked(name)) {
    case 's':
        *(volatile int *)16 = 0;
        break;
    case 'h':
        hang();
        break;
    case 'e':
        return -5;
    case 'w':
        waits = 1;
    }
    launch next = (launch)real("clEnqueueNDRangeKernel");
    return next(queue, kernel, dimensions, offset, size, group, count, events, event);
}

typedef int (*rectangle)(void *, void *, unsigned, const size_t *, const size_t *, const size_t *,
                         size_t, size_t, size_t, size_t, void *, unsigned, const void *, void *);

int clEnqueueReadBufferRect(void *queue, void *buffer, unsigned blocking, const size_t *origin,
                            const size_t *host_origin, const size_t *region, size_t row,
                            size_t slice, size_t host_row, size_t host_slice, void *host,
                            unsigned count, const void *events, void *event)
{
    static int known;
    noted("clEnqueueReadBufferRect", &known);
    int error = failing("clEnqueueReadBufferRect");
    if (error)
        return error;
    if (waits)
        hang();
    rectangle next = (rectangle)real("clEnqueueReadBufferRect");
    return next(queue, buffer, blocking, origin, host_origin, region, row, slice, host_row,
                host_slice, host, count, events, event);
}

typedef int (*stretch)(void *, void *, unsigned, size_t, size_t, void *, unsigned, const void *,
                       void *);

int clEnqueueReadBuffer(void *queue, void *buffer, unsigned blocking, size_t offset, size_t size,
                        void *host, unsigned count, const void *events, void *event)
{
    static int known;
    noted("clEnqueueReadBuffer", &known);
    int error = failing("clEnqueueReadBuffer");
    if (error)
        return error;
    if (waits)
        hang();
    stretch next = (stretch)real("clEnqueueReadBuffer");
    return next(queue, buffer, blocking, offset, size, host, count, events, event);
}
