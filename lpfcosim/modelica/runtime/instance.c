#include "instance.h"

#include <stdlib.h>
#include <string.h>

void instance_reset(Instance *m) {
    memcpy(m->now.token, model_token, sizeof m->now.token);
    core_reset(&m->now.state);
    m->now.mode = INSTANTIATED;
}

const char *instance_enter(Instance *m, double start) {
    if (m->now.mode != INSTANTIATED) return "initialization needs a fresh or reset instance";
    m->now.state.start_time = m->now.state.time = start;
    core_touch(&m->now.state);
    m->now.mode = INITIALIZATION;
    return NULL;
}

const char *instance_exit(Instance *m) {
    if (m->now.mode != INITIALIZATION) return "the end of initialization without its beginning";
    core_initialize(&m->now.state, m->now.state.start_time);
    m->now.mode = STEP;
    return NULL;
}

const char *instance_get(Instance *m, const uint32_t *vr, size_t n, double *values) {
    int inner = 0;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= NV) return "there is no variable of this value reference";
        inner |= model_inner[vr[i]];
    }
    core_refresh(&m->now.state, 1 + inner);
    for (size_t i = 0; i < n; i++) values[i] = m->now.state.v[vr[i]];
    return NULL;
}

const char *instance_set(Instance *m, const uint32_t *vr, size_t n, const double *values) {
    const int least = m->now.mode < STEP ? 1 : 2;
    if (m->now.mode == TERMINATED) return "a variable is set after the end";
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= NV) return "there is no variable of this value reference";
        if (model_settable[vr[i]] < least) return "this variable cannot be set, or not any more";
        m->now.state.v[vr[i]] = values[i];
    }
    core_touch(&m->now.state);
    return NULL;
}

const char *instance_end(Instance *m) {
    if (m->now.mode != STEP) return "an end without a beginning";
    m->now.mode = TERMINATED;
    return NULL;
}

const char *instance_step(Instance *m, double time, double step) {
    if (m->now.mode != STEP) return "a step before the end of initialization or after the end";
    return core_step(&m->now.state, time, step);
}

const char *snapshot_save(const Instance *m, void **state) {
    if (!*state) *state = malloc(sizeof(Snapshot));
    if (!*state) return "out of memory";
    memcpy(*state, &m->now, sizeof(Snapshot));
    return NULL;
}

const char *snapshot_restore(Instance *m, const void *state) {
    if (!state) return "there is no state to restore";
    memcpy(&m->now, state, sizeof(Snapshot));
    return NULL;
}

const char *snapshot_write(const void *state, void *bytes, size_t size) {
    if (!state || size < sizeof(Snapshot)) return "no state to serialize, or too few bytes for it";
    memcpy(bytes, state, sizeof(Snapshot));
    return NULL;
}

const char *snapshot_read(const void *bytes, size_t size, void **state) {
    if (size != sizeof(Snapshot) || strcmp(((const Snapshot *)bytes)->token, model_token))
        return "these bytes are not a state of this FMU";
    if (!*state) *state = malloc(sizeof(Snapshot));
    if (!*state) return "out of memory";
    memcpy(*state, bytes, sizeof(Snapshot));
    return NULL;
}
