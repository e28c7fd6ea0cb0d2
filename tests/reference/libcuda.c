/* A stand-in for the CUDA driver on machines without a card, for tests/reference/test_cuda.py.

   It has one device, stores the kernels that it receives as KERNELS/0000.ptx and so on, and runs none of them.
   Memory lies on the host and is filled with words of 1; a single number of 4 bytes is read as 1. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { CAPABILITY_MINOR = 76, MEMORY_POOLS = 115, SHARED_MEMORY = 97, CAPABILITY_MAJOR = 75, OUT_OF_MEMORY = 2 };

#define DONE(name) int name(void) { return 0; }
DONE(cuCtxEnablePeerAccess) DONE(cuCtxSynchronize) DONE(cuDeviceCanAccessPeer) DONE(cuDevicePrimaryCtxRelease_v2)
DONE(cuEventDestroy_v2) DONE(cuEventRecord) DONE(cuEventSynchronize) DONE(cuEventElapsedTime) DONE(cuEventQuery)
DONE(cuFuncSetAttribute) DONE(cuInit) DONE(cuLaunchKernel) DONE(cuMemAdvise) DONE(cuModuleUnload)
DONE(cuCtxPushCurrent_v2) DONE(cuCtxPopCurrent_v2) DONE(cuStreamDestroy_v2) DONE(cuStreamSynchronize)
DONE(cuStreamWaitEvent) DONE(cuStreamWaitEvent_ptsz) DONE(cuPointerGetAttribute) DONE(cuArrayCreate_v2)
DONE(cuArray3DCreate_v2) DONE(cuArray3DGetDescriptor_v2) DONE(cuArrayDestroy) DONE(cuMipmappedArrayCreate)
DONE(cuMipmappedArrayGetLevel) DONE(cuMipmappedArrayDestroy) DONE(cuTexObjectCreate)
DONE(cuTexObjectGetResourceDesc) DONE(cuTexObjectDestroy) DONE(cuSurfObjectCreate) DONE(cuSurfObjectDestroy)
DONE(cuMemcpy2DAsync_v2) DONE(cuMemcpy3DAsync_v2) DONE(cuProfilerStart) DONE(cuProfilerStop)
DONE(cuGraphicsGLRegisterBuffer) DONE(cuGraphicsGLRegisterImage) DONE(cuGraphicsUnregisterResource)
DONE(cuGraphicsMapResources) DONE(cuGraphicsUnmapResources) DONE(cuGraphicsSubResourceGetMappedArray)
DONE(cuGraphicsResourceGetMappedPointer)

#define HANDLE(name) int name(void **handle) { *handle = (void *)0x1000; return 0; }
HANDLE(cuDevicePrimaryCtxRetain) HANDLE(cuEventCreate) HANDLE(cuStreamCreate) HANDLE(cuModuleGetFunction)

int cuDeviceGet(int *device, int number) { *device = number; return 0; }
int cuDeviceGetCount(int *count) { *count = 1; return 0; }
int cuDeviceGetName(char *name, int size) { snprintf(name, size, "stand-in"); return 0; }
int cuDeviceTotalMem_v2(size_t *bytes) { *bytes = (size_t)1 << 33; return 0; }
int cuDriverGetVersion(int *version) { *version = 12040; return 0; }
int cuGetErrorName(int error, const char **name) { *name = "error"; return error * 0; }
int cuGetErrorString(int error, const char **words) { *words = "error"; return error * 0; }
int cuLaunchHostFunc(void *stream, void (*call)(void *), void *data) { (void)stream; call(data); return 0; }
int cuOccupancyMaxPotentialBlockSize(int *grid, int *block) { *grid = 1; *block = 128; return 0; }

int cuDeviceGetAttribute(int *value, int attribute) {
    *value = attribute == CAPABILITY_MAJOR ? 9 : attribute == SHARED_MEMORY ? 98304
        : attribute != CAPABILITY_MINOR && attribute != MEMORY_POOLS;
    return 0;
}

static int take(void **memory, size_t size) {
    uint32_t *words = *memory = aligned_alloc(256, size = (size + 255) / 256 * 256);
    for (size_t k = 0; words && k < size / 4; ++k) words[k] = 1;
    return words ? 0 : OUT_OF_MEMORY;
}
int cuMemAlloc_v2(void **memory, size_t size) { return take(memory, size); }
int cuMemAllocHost_v2(void **memory, size_t size) { return take(memory, size); }
int cuMemFree_v2(void *memory) { free(memory); return 0; }
int cuMemFreeHost(void *memory) { free(memory); return 0; }

int cuMemcpy(void *to, const void *from, size_t size) {
    /* A copy of 4 bytes reads a count that a kernel would have written; all others read arrays. */
    memcpy(to, size == 4 ? &(uint32_t){1} : from, size);
    return 0;
}
int cuMemcpyAsync(void *to, const void *from, size_t size) { return cuMemcpy(to, from, size); }
int cuMemsetD8Async(void *to, uint8_t value, size_t count) { memset(to, value, count); return 0; }
int cuMemsetD16Async(uint16_t *to, uint16_t value, size_t count) { while (count--) *to++ = value; return 0; }
int cuMemsetD32Async(uint32_t *to, uint32_t value, size_t count) { while (count--) *to++ = value; return 0; }

int cuModuleLoadData(void **module, const char *text) {
    static int kept = 0;
    char path[4096];
    snprintf(path, sizeof path, "%s/%04d.ptx", getenv("KERNELS"), kept++);
    FILE *file = fopen(path, "w");
    if (!file || fputs(text, file) < 0 || fclose(file)) return OUT_OF_MEMORY;
    *module = (void *)0x2000;
    return 0;
}
int cuModuleLoadDataEx(void **module, const char *text) { return cuModuleLoadData(module, text); }
