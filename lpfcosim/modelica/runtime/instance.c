/* One FMU instance: the core with the life cycle of FMI.
   Functions return NULL, or what went wrong. */
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef enum { INSTANTIATED, INITIALIZATION, STEP, TERMINATED } Mode;

/* Everything that saving and restoring has to keep. */
typedef struct {
    State state;
    Mode mode;
} Snapshot;

typedef struct {
    Snapshot now;
    void *environment; /* of the importer, handed back to its log */
} Instance;

static void instance_reset(Instance *m) {
    core_reset(&m->now.state);
    m->now.mode = INSTANTIATED;
}

static const char *instance_enter(Instance *m, double start) {
    if (m->now.mode != INSTANTIATED) return "initialization needs a fresh or reset instance";
    core_start(&m->now.state, start);
    m->now.mode = INITIALIZATION;
    return NULL;
}

static const char *instance_exit(Instance *m) {
    if (m->now.mode != INITIALIZATION) return "the end of initialization without its beginning";
    core_initialize(&m->now.state);
    m->now.mode = STEP;
    return core_assert(&m->now.state);
}

static const char *instance_get(Instance *m, const uint32_t *vr, size_t n, double *values) {
    State *s = &m->now.state;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= NV) return "there is no variable of this value reference";
        const int stage = model_stage[vr[i]];
        if (stage > s->evaluated_stage) core_evaluate(s, stage);
        memcpy(values + i, s->v + vr[i], sizeof *values); /* past the floating-point registers, which is quicker */
    }
    return NULL;
}

static const char *instance_set(Instance *m, const uint32_t *vr, size_t n, const double *values) {
    const int least = m->now.mode < STEP ? 1 : 2;
    State *s = &m->now.state;
    if (m->now.mode == TERMINATED) return "a variable is set after the end";
    core_inputs_changed(s);
    /* Who sets all inputs, and in their order, need not have each of them looked up. */
    if (n == NU && !memcmp(vr, model_inputs, NU * sizeof *vr)) {
        model_set_inputs(s->v, values);
        return NULL;
    }
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= NV) return "there is no variable of this value reference";
        if (model_settable[vr[i]] < least) return "this variable cannot be set, or not any more";
        s->v[vr[i]] = values[i];
    }
    return NULL;
}

static const char *instance_end(Instance *m) {
    if (m->now.mode != STEP) return "an end without a beginning";
    m->now.mode = TERMINATED;
    return NULL;
}

static const char *instance_step(Instance *m, double time, double step) {
    if (m->now.mode != STEP) return "a step before the end of initialization or after the end";
    return core_step(&m->now.state, time, step);
}

static const char *snapshot_save(const Instance *m, void **state) {
    if (!*state) *state = malloc(sizeof(Snapshot));
    if (!*state) return "out of memory";
    memcpy(*state, &m->now, sizeof(Snapshot));
    return NULL;
}

static const char *snapshot_restore(Instance *m, const void *state) {
    if (!state) return "there is no state to restore";
    memcpy(&m->now, state, sizeof(Snapshot));
    return NULL;
}
