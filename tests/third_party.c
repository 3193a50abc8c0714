/* A suspension controller as another tool might export it, FMI 2.0 or 3.0 (-DFMI=3), with the variations that
   tests ask for by -D. It includes no header of FMI: the functions that are missing here are made by the tests. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { DISTANCE, WANTED, BANDWIDTH, HOLD, FORCE, MODE, ENABLED, LABEL, LAW, SINGLE, STATE, N };

typedef void (*Log2)(void *, const char *, int, const char *, const char *, ...);
typedef void (*Log3)(void *, int, const char *, const char *);

typedef struct {
    double real[N];
    int64_t mode, law;
    bool enabled;
    char label[100], resources[1000];
    double omega, scale, low, sum, time;
    int steps;
    void *environment;
    Log2 log2;
    Log3 log3;
} Slave;

static void say(Slave *s, int status, const char *message) {
    if (s->log2) s->log2(s->environment, "slave", status, "logStatusError", "%s", message);
    if (s->log3) s->log3(s->environment, status, "logStatusError", message);
}

static void begin(Slave *s) {
    memset(s->real, 0, sizeof s->real);
    s->real[BANDWIDTH] = 1e-3;
    s->real[SINGLE] = 1;
    s->mode = s->law = 1;
    s->enabled = true;
    strcpy(s->label, "");
    s->omega = s->scale = s->low = s->sum = s->time = 0;
    s->steps = 0;
}

static void compute(Slave *s) {
    s->omega = 2 * M_PI * s->real[BANDWIDTH];
    s->scale = (1 + 0.1 * (double)(s->mode - 1)) * s->real[SINGLE];
    if (s->law == 2) s->scale *= 1.25;
    if (!strcmp(s->label, "half")) s->scale *= 0.5;
    if (!s->enabled) s->scale = 0;
    s->low = s->real[STATE];
}

static void *instantiate(void *environment, Log2 log2, Log3 log3, const char *resources) {
    Slave *s = calloc(1, sizeof *s);
    s->environment = environment, s->log2 = log2, s->log3 = log3;
    strncpy(s->resources, resources ? resources : "", sizeof s->resources - 1);
    begin(s);
#ifdef RESOURCE
    const char *path = s->resources;
    if (!strncmp(path, "file://", 7)) path += 7; /* no decoding */
    char place[1200];
    snprintf(place, sizeof place, "%s/bandwidth.txt", path);
    FILE *table = fopen(place, "r");
    if (!table || fscanf(table, "%lf", &s->real[BANDWIDTH]) != 1) {
        say(s, ERROR, place);
        return NULL;
    }
    fclose(table);
#endif
    return s;
}

static int enter(Slave *s) {
#ifdef EARLY
    compute(s);
#endif
#ifdef QUIET_FAILURE
    return ERROR;
#endif
    (void)s;
    return OK;
}

static int leave(Slave *s) {
#ifndef EARLY
    compute(s);
#endif
    s->real[FORCE] = s->real[HOLD];
    return OK;
}

static int reset(Slave *s) {
    begin(s);
    return OK;
}

static int step(Slave *s, double time, double h) {
#ifdef CHECKS_TIME
    if (fabs(time - s->time) > 1e-10) {
        say(s, ERROR, "invalid communication point");
        return ERROR;
    }
#endif
    (void)time;
#ifdef SHORT
    if (h > 0.0201) return DISCARD;
#endif
    double w = s->omega, e = s->real[DISTANCE] - s->real[WANTED];
    s->low += (1 - exp(-6 * w * h)) * (e - s->low);
    s->sum += 0.018 * w * w * w * e * h;
    double force = w * 6 * w * (e - s->low) + 0.3 * w * w * s->low + s->sum;
    s->real[FORCE] = s->real[HOLD] - s->scale * force;
    s->time += h;
    s->steps++;
#ifdef DISCARDS
    if (s->steps > 50) return DISCARD;
#endif
#ifdef INFINITE
    if (s->steps > 50) s->real[FORCE] = INFINITY;
#endif
#ifdef CRASHES
    if (s->steps > 50) *(volatile int *)0 = 0;
#endif
#ifdef TRACEBACK
    if (s->steps > 50) {
        say(s, FATAL, "Traceback (most recent call last):\n  File \"slave.py\", line 3\nValueError: an empty table");
        return FATAL;
    }
#endif
    return OK;
}

#if FMI == 3
EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool events, bool early, const uint32_t *needed, size_t n,
                                         void *environment, Log3 log, void *update) {
    return instantiate(environment, NULL, log, resources);
}
EXPORT void fmi3FreeInstance(void *s) { free(s); }
EXPORT int fmi3EnterInitializationMode(void *s, bool t, double tolerance, double start, bool e, double stop) {
    return enter(s);
}
EXPORT int fmi3ExitInitializationMode(void *s) { return leave(s); }
EXPORT int fmi3Terminate(void *s) { return OK; }
EXPORT int fmi3Reset(void *s) { return reset(s); }
EXPORT int fmi3DoStep(void *s, double time, double h, bool keep, bool *event, bool *terminate, bool *early,
                      double *last) {
    *event = *terminate = *early = false;
    *last = time + h;
    int status = step(s, time, h);
#ifdef TERMINATES
    *terminate = ((Slave *)s)->steps > 50;
#endif
    return status;
}
EXPORT int fmi3SetFloat64(void *c, const uint32_t *r, size_t n, const double *x, size_t m) {
    Slave *s = c;
    for (size_t i = 0; i < n; i++) s->real[r[i]] = x[i];
    return OK;
}
EXPORT int fmi3GetFloat64(void *c, const uint32_t *r, size_t n, double *x, size_t m) {
    for (size_t i = 0; i < n; i++) x[i] = ((Slave *)c)->real[r[i]];
    return OK;
}
EXPORT int fmi3SetFloat32(void *c, const uint32_t *r, size_t n, const float *x, size_t m) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->real[r[i]] = x[i];
    return OK;
}
EXPORT int fmi3SetUInt8(void *c, const uint32_t *r, size_t n, const uint8_t *x, size_t m) {
    return ((Slave *)c)->mode = x[0], OK;
}
EXPORT int fmi3SetInt64(void *c, const uint32_t *r, size_t n, const int64_t *x, size_t m) {
    return ((Slave *)c)->law = x[0], OK;
}
EXPORT int fmi3SetBoolean(void *c, const uint32_t *r, size_t n, const bool *x, size_t m) {
    return ((Slave *)c)->enabled = x[0], OK;
}
EXPORT int fmi3SetString(void *c, const uint32_t *r, size_t n, const char *const *x, size_t m) {
    return strncpy(((Slave *)c)->label, x[0], 99), OK;
}
#else
typedef struct {
    Log2 log;
    void *allocate, *release, *finished, *environment;
} Callbacks;
EXPORT void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logging) {
    return instantiate(callbacks->environment, callbacks->log, NULL, resources);
}
EXPORT void fmi2FreeInstance(void *s) { free(s); }
EXPORT int fmi2SetupExperiment(void *s, int t, double tolerance, double start, int e, double stop) { return OK; }
EXPORT int fmi2EnterInitializationMode(void *s) { return enter(s); }
EXPORT int fmi2ExitInitializationMode(void *s) { return leave(s); }
EXPORT int fmi2Terminate(void *s) { return OK; }
EXPORT int fmi2Reset(void *s) { return reset(s); }
EXPORT int fmi2DoStep(void *s, double time, double h, int keep) {
    return step(s, time, h);
}
EXPORT int fmi2SetReal(void *c, const uint32_t *r, size_t n, const double *x) {
    for (size_t i = 0; i < n; i++) ((Slave *)c)->real[r[i]] = x[i];
    return OK;
}
EXPORT int fmi2GetReal(void *c, const uint32_t *r, size_t n, double *x) {
    for (size_t i = 0; i < n; i++) x[i] = ((Slave *)c)->real[r[i]];
    return OK;
}
EXPORT int fmi2SetInteger(void *c, const uint32_t *r, size_t n, const int *x) {
    for (size_t i = 0; i < n; i++) *(r[i] == MODE ? &((Slave *)c)->mode : &((Slave *)c)->law) = x[i];
    return OK;
}
EXPORT int fmi2SetBoolean(void *c, const uint32_t *r, size_t n, const int *x) {
    return ((Slave *)c)->enabled = x[0], OK;
}
EXPORT int fmi2SetString(void *c, const uint32_t *r, size_t n, const char *const *x) {
    return strncpy(((Slave *)c)->label, x[0], 99), OK;
}
#endif
