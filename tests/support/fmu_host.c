/* A program that runs a table's FMU on Linux or Windows: two inputs to and fro, outputs as bits.

   fmu_host LIBRARY TOKEN STEPS INPUT INPUT OUTPUT...   (value references; a step is 2 ms) */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
static void *found(const char *library, const char *name) {
    return (void *)GetProcAddress(LoadLibraryA(library), name);
}
#else
#include <dlfcn.h>
static void *found(const char *library, const char *name) { return dlsym(dlopen(library, RTLD_NOW), name); }
#endif

typedef void *(*Instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
                             void *, void *, void *);
typedef int (*Enter)(void *, bool, double, double, bool, double);
typedef int (*Plain)(void *);
typedef int (*Get)(void *, const unsigned *, size_t, double *, size_t);
typedef int (*Set)(void *, const unsigned *, size_t, const double *, size_t);
typedef int (*Step)(void *, double, double, bool, bool *, bool *, bool *, double *);

#define MOST 16

int main(int count, char **words) {
    const char *library = words[1];
    unsigned places[MOST];
    bool event, over, early;
    int n = count - 4;
    if (n < 3 || n > MOST) return 2;
    for (int i = 0; i < n; i++) places[i] = (unsigned)strtoul(words[4 + i], NULL, 10);
    void *table = ((Instantiate)found(library, "fmi3InstantiateCoSimulation"))("t", words[2], "", 0, 0, 0, 0, NULL, 0, NULL,
                                                                               NULL, NULL);
    if (!table) return 3;
    if (((Enter)found(library, "fmi3EnterInitializationMode"))(table, 0, 0.0, 0.0, 0, 0.0)) return 4;
    if (((Plain)found(library, "fmi3ExitInitializationMode"))(table)) return 5;
    Set set = (Set)found(library, "fmi3SetFloat64");
    Get get = (Get)found(library, "fmi3GetFloat64");
    Step step = (Step)found(library, "fmi3DoStep");
    for (int k = 0; k < atoi(words[3]); k++) {
        double told[2] = {k / 40 % 2 ? -1.0 : 1.0, k / 27 % 2 ? 0.75 : -0.75}, seen[MOST], reached;
        if (set(table, places, 2, told, 2)) return 6;
        if (step(table, 0.002 * k, 0.002, 0, &event, &over, &early, &reached)) return 7;
        if (get(table, places + 2, (size_t)(n - 2), seen, (size_t)(n - 2))) return 8;
        for (int i = 0; i < n - 2; i++) {
            uint64_t bits;
            memcpy(&bits, &seen[i], sizeof bits);
            printf("%08lx%08lx ", (unsigned long)(bits >> 32), (unsigned long)(bits & 0xffffffff));
        }
        printf("\n");
    }
    return ((Plain)found(library, "fmi3Terminate"))(table) ? 9 : 0;
}
