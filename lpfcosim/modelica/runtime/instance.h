/* One FMU instance: the core with the life cycle that FMI 2.0 and 3.0 have in common. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include "core.h"

#include <stddef.h>
#include <stdint.h>

typedef enum { INSTANTIATED, INITIALIZATION, STEP, TERMINATED } Mode;

/* Everything that saving and restoring has to keep. */
typedef struct {
    State state;
    char token[37]; /* of the model that the state belongs to */
    Mode mode;
} Snapshot;

typedef struct {
    Snapshot now;
    void *environment; /* of the importer, handed back to its log */
} Instance;

/* Each returns NULL, or what went wrong. */
static const char *instance_enter(Instance *m, double start);
static const char *instance_exit(Instance *m);
static const char *instance_get(Instance *m, const uint32_t *vr, size_t n, double *values);
static const char *instance_set(Instance *m, const uint32_t *vr, size_t n, const double *values);
static const char *instance_step(Instance *m, double time, double step);
static const char *instance_end(Instance *m);
static const char *snapshot_save(const Instance *m, void **state);
static const char *snapshot_restore(Instance *m, const void *state);
static const char *snapshot_write(const void *state, void *bytes, size_t size);
static const char *snapshot_read(const void *bytes, size_t size, void **state);
static void instance_reset(Instance *m);

#endif
