#include "instance.h"

#include <string.h>

/* Fill p with the partial derivatives of model_partial_table at the present values. */
static void partial_derivatives(State *s, double *p) {
    double d[AT_LEAST_ONE(ND)];
    core_evaluate(s, 3);
    core_delayed(s, d);
    model_partials(s->v, d, p);
    /* After initialization, states and delayed signals follow from nothing. */
    for (int k = 0; s->initialized && k < NP; k++)
        if (model_partial_table[k].starting) p[k] = 0;
}

static int is_known(const Instance *m, uint32_t vr) {
    if (vr >= NV) return 0;
    return m->now.mode == INITIALIZATION ? model_settable[vr] > 0 || vr == 0 : model_independent[vr];
}

static const char *instance_derivative(Instance *m, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                                       size_t n_knowns, const double *seed, double *sensitivity) {
    double p[AT_LEAST_ONE(NP)], change[NV + ND];
    if (m->now.mode == INSTANTIATED) return "a derivative before initialization";
    for (size_t i = 0; i < n_unknowns; i++)
        if (unknowns[i] >= NV) return "there is no variable of this value reference";
    for (size_t i = 0; i < n_knowns; i++)
        if (!is_known(m, knowns[i])) return "a derivative by a variable that follows from others";
    partial_derivatives(&m->now.state, p);
    memset(change, 0, sizeof change);
    for (size_t i = 0; i < n_knowns; i++) change[knowns[i]] += seed[i];
    for (int k = 0; k < NP; k++)
        change[model_partial_table[k].unknown] += p[k] * change[model_partial_table[k].known];
    for (size_t i = 0; i < n_unknowns; i++) sensitivity[i] = change[unknowns[i]];
    return NULL;
}
