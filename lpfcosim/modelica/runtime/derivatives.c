#include "instance.h"

#include <string.h>

/* Fill p with the partial derivatives of all links where the model stands. */
static void linearise(State *s, double *p) {
    double d[AT_LEAST_ONE(ND)];
    core_refresh(s, 3);
    core_delayed(s, d);
    model_partials(s->v, d, p);
    /* Once initialized, states are what they are, and a delayed signal is what was set before. */
    for (int k = 0; s->initialized && k < NL; k++)
        if (model_links[k].starting) p[k] = 0;
}

static int is_known(const Instance *m, uint32_t vr) {
    return vr < NV && (m->now.mode == INITIALIZATION ? model_settable[vr] > 0 || vr == 0 : model_known[vr]);
}

static const char *instance_derivative(Instance *m, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                                       size_t n_knowns, const double *seed, double *sensitivity, int adjoint) {
    double p[AT_LEAST_ONE(NL)], change[NV + ND];
    if (m->now.mode == INSTANTIATED) return "a derivative before initialization";
    for (size_t i = 0; i < n_unknowns; i++)
        if (unknowns[i] >= NV) return "there is no variable of this value reference";
    for (size_t i = 0; i < n_knowns; i++)
        if (!is_known(m, knowns[i])) return "a derivative by a variable that follows from others";
    linearise(&m->now.state, p);
    memset(change, 0, sizeof change);
    const size_t n = adjoint ? n_unknowns : n_knowns;
    for (size_t i = 0; i < n; i++) change[adjoint ? unknowns[i] : knowns[i]] += seed[i];
    if (adjoint)
        for (int k = NL; k-- > 0;) change[model_links[k].known] += p[k] * change[model_links[k].unknown];
    else
        for (int k = 0; k < NL; k++) change[model_links[k].unknown] += p[k] * change[model_links[k].known];
    for (size_t i = 0; i < (adjoint ? n_knowns : n_unknowns); i++)
        sensitivity[i] = change[adjoint ? knowns[i] : unknowns[i]];
    return NULL;
}
