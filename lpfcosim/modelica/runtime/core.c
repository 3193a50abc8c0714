#include "core.h"

#include <math.h>
#include <string.h>

#define NW (NH + 2 * ND + 1) /* held columns of the step matrix: held, delayed before and after, 1 */

static double *states(State *s) { return s->v + FIRST_STATE; }

/* Held signal j as it was set at internal step m; before the first as at the start. */
static double held_signal(const State *s, int j, unsigned long long m) { return s->ring[m % DELAY_CAPACITY][j]; }

/* The delayed signals at this time, with `value` set last. */
static void delayed(const State *s, const double *value, double *d) {
    for (int j = 0; j < ND; j++) {
        unsigned long long back = s->whole[j] + (s->part[j] > 0);
        d[j] = back ? held_signal(s, j, s->n - back) : value[j];
    }
}

static void core_reset(State *s) {
    memset(s, 0, sizeof *s);
    s->communication_step = NAN;
    model_start(s->v);
}

static void core_start(State *s, double time) {
    s->start_time = s->v[0] = time;
    s->evaluated_stage = 0;
}

/* Before the end of initialization anything can be set, after it only inputs: they leave stage 1 as it is. */
static void core_inputs_changed(State *s) {
    if (s->evaluated_stage > s->initialized) s->evaluated_stage = s->initialized;
}

static void core_delayed(const State *s, double *d) {
    if (!s->initialized)
        model_delay_values(s->v, d); /* delay(u, T) is u until T has passed */
    else
        delayed(s, s->ring[(s->n - 1) % DELAY_CAPACITY], d);
}

/* Bring up to date all variables of this stage. */
static void core_evaluate(State *s, int stage) {
    if (s->evaluated_stage < 1) {
        if (!s->initialized) model_calculated(s->v), model_dependent_starts(s->v);
        model_state_outputs(s->v);
    }
    if (stage > 1) {
        double d[AT_LEAST_ONE(ND)];
        core_delayed(s, d);
        if (s->evaluated_stage < 2) model_outputs(s->v, d);
        if (stage > 2) model_algebraic(s->v, d);
    }
    s->evaluated_stage = stage;
}

/* NULL, or the message of an assertion that does not hold. */
static const char *core_assert(State *s) {
    double d[AT_LEAST_ONE(ND)];
    if (NM == 0) return NULL;
    core_evaluate(s, 3);
    core_delayed(s, d);
    return model_assert(s->v, d);
}

static void core_initialize(State *s) {
    double value[AT_LEAST_ONE(ND)];
    s->evaluated_stage = 0;
    core_evaluate(s, 3);
    model_delay_values(s->v, value);
    for (int k = 0; k < DELAY_CAPACITY; k++)
        for (int j = 0; j < ND; j++) s->ring[k][j] = value[j];
    s->initialized = 1;
}

#if AFFINE
/* g = exp(m) - 1 in its first NX rows, m = [a b; 0 0] dt: scaled Taylor series, then repeated squaring. */
static void exponential(const double *a, const double *b, double dt, double *g) {
    double norm = 0, term[NX * NZ], next[NX * NZ];
    for (int i = 0; i < NX; i++) {
        double row = 0;
        for (int j = 0; j < NX; j++) row += fabs(a[i * NX + j]) * dt;
        if (row > norm) norm = row;
    }
    int squarings = 0;
    while (norm > 0.25) norm *= 0.5, dt *= 0.5, squarings++;
    for (int i = 0; i < NX; i++) {
        for (int j = 0; j < NX; j++) term[i * NZ + j] = a[i * NX + j] * dt;
        for (int j = 0; j < NW; j++) term[i * NZ + NX + j] = b[i * NW + j] * dt;
    }
    memcpy(g, term, sizeof term);
    for (int k = 2; k <= 16; k++) {
        for (int i = 0; i < NX; i++)
            for (int j = 0; j < NZ; j++) {
                double sum = 0;
                for (int l = 0; l < NX; l++) sum += a[i * NX + l] * term[l * NZ + j];
                next[i * NZ + j] = sum * dt / k;
            }
        memcpy(term, next, sizeof term);
        for (int i = 0; i < NX * NZ; i++) g[i] += term[i];
    }
    while (squarings-- > 0) {
        for (int i = 0; i < NX; i++)
            for (int j = 0; j < NZ; j++) {
                double sum = 2 * g[i * NZ + j];
                for (int l = 0; l < NX; l++) sum += g[i * NZ + l] * g[l * NZ + j];
                next[i * NZ + j] = sum;
            }
        memcpy(g, next, sizeof next);
    }
}

/* dx = e z; e is stored by columns, so that compilers vectorise the inner loop. */
VECTORISED static void multiply(const State *s, const double *z, double *dx) {
    double sum[NX];
    for (int i = 0; i < NX; i++) sum[i] = 0;
    for (int j = 0; j < NZ; j++)
        for (int i = 0; i < NX; i++) sum[i] += s->e[j * NX + i] * z[j];
    for (int i = 0; i < NX; i++) dx[i] = sum[i];
}

#if NQ > 0
/* The remainder of the derivatives in the middle of the step, extrapolated from the begins of this step and the last. */
static void extrapolate_remainder(State *s, double *q) {
    double d[AT_LEAST_ONE(ND)], now[NQ];
    delayed(s, s->ring[s->n % DELAY_CAPACITY], d);
    model_remainder(s->v, d, now);
    for (int i = 0; i < NQ; i++) {
        q[i] = s->n > 0 ? now[i] + 0.5 * (now[i] - s->remainder[i]) : now[i];
        s->remainder[i] = now[i];
    }
}
#endif
#endif

/* The end of the subinterval that begins at t: the next switch of a delayed signal, or the end of the step. */
static double next_switch(const State *s, double t) {
    double end = s->h;
    for (int j = 0; j < ND; j++)
        if (s->part[j] > t && s->part[j] < end) end = s->part[j];
    return end;
}

/* The matrix of one internal step. Delayed signals switch inside it, at part[j]: the product of the
   exponentials of the subintervals is still one matrix, exact for any switch. */
static const char *discretise(State *s) {
#if AFFINE
    double a[NX * NX], b[NX * (NH + ND + 1)], wide[NX * NW], g[NX * NZ], e[NX * NZ], product[NX * NZ];
    model_affine(s->v, a, b);
    for (int i = 0; i < NX * NX; i++)
        if (!isfinite(a[i])) return "the parameters make the model singular";
    for (int i = 0; i < NX * (NH + ND + 1); i++)
        if (!isfinite(b[i])) return "the parameters make the model singular";
    memset(e, 0, sizeof e);
    for (double t = 0, end; t < s->h; t = end) {
        end = next_switch(s, t);
        memset(wide, 0, sizeof wide);
        for (int i = 0; i < NX; i++) {
            const double *from = b + i * (NH + ND + 1);
            double *to = wide + i * NW;
            for (int j = 0; j < NH; j++) to[j] = from[j];
            for (int j = 0; j < ND; j++) to[NH + (t >= s->part[j] ? ND : 0) + j] = from[NH + j];
            to[NW - 1] = from[NH + ND];
        }
        exponential(a, wide, end - t, g);
        for (int i = 0; i < NX; i++)
            for (int j = 0; j < NZ; j++) {
                double sum = e[i * NZ + j] + g[i * NZ + j];
                for (int l = 0; l < NX; l++) sum += g[i * NZ + l] * e[l * NZ + j];
                product[i * NZ + j] = sum;
            }
        memcpy(e, product, sizeof e);
    }
    for (int j = 0; j < NZ; j++)
        for (int i = 0; i < NX; i++) s->e[j * NX + i] = e[i * NZ + j];
#else
    (void)s;
#endif
    return NULL;
}

/* Fix the internal step: the model's own where it divides the communication step, otherwise the longest that
   does and is no longer; place clocks and delays on it. */
static const char *prepare(State *s, double step) {
    double ratio = step / INTERNAL_STEP;
    s->h = fabs(ratio - floor(ratio + 0.5)) < 1e-6 * ratio && ratio > 0.5 ? INTERNAL_STEP : step / ceil(ratio);
    double start[AT_LEAST_ONE(NC)], period[AT_LEAST_ONE(NC)], duration[AT_LEAST_ONE(ND)];
    model_clocks(s->v, start, period);
    for (int c = 0; c < NC; c++) {
        double n = period[c] / s->h, n0 = (start[c] - s->start_time) / s->h;
        if (!(n > 0.5) || fabs(n - floor(n + 0.5)) > 1e-6 * n || fabs(n0 - floor(n0 + 0.5)) > 1e-6 * (1 + fabs(n0)))
            return "the sampling period is not a multiple of the communication step";
        n = floor(n + 0.5), n0 = floor(n0 + 0.5);
        if (n0 < 0) n0 = fmod(n - fmod(-n0, n), n); /* a clock that started before the simulation */
        s->period[c] = (unsigned long long)n;
        s->wait[c] = (unsigned long long)n0;
    }
    model_delay_times(s->v, duration);
    for (int j = 0; j < ND; j++) {
        double n = duration[j] / s->h, whole = floor(n + 1e-9);
        if (!(n > -1e-9)) return "a delay is negative";
        if (whole + 2 > DELAY_CAPACITY) return "a delay spans too many communication steps";
        s->whole[j] = (unsigned long long)whole;
        s->part[j] = n - whole > 1e-9 ? (n - whole) * s->h : 0;
    }
    return discretise(s);
}

#if NX > 0 && !AFFINE
/* One Runge-Kutta step of fourth order; delayed signals are constant in it. */
static void runge_kutta(State *s, double t, const double *d, double dt) {
    double x[NX], k1[NX], k2[NX], k3[NX], k4[NX];
    memcpy(x, states(s), sizeof x);
    s->v[0] = t;
    model_rates(s->v, d, k1);
    s->v[0] = t + 0.5 * dt;
    for (int i = 0; i < NX; i++) states(s)[i] = x[i] + 0.5 * dt * k1[i];
    model_rates(s->v, d, k2);
    for (int i = 0; i < NX; i++) states(s)[i] = x[i] + 0.5 * dt * k2[i];
    model_rates(s->v, d, k3);
    s->v[0] = t + dt;
    for (int i = 0; i < NX; i++) states(s)[i] = x[i] + dt * k3[i];
    model_rates(s->v, d, k4);
    for (int i = 0; i < NX; i++) states(s)[i] = x[i] + dt / 6 * (k1[i] + 2 * (k2[i] + k3[i]) + k4[i]);
}
#endif

static void integrate(State *s) {
#if AFFINE
    double z[NZ], dx[NX];
    for (int i = 0; i < NX; i++) z[i] = states(s)[i];
    model_held(s->v, z + NX);
#if NQ > 0
    extrapolate_remainder(s, z + NX + NH - NQ);
#endif
    for (int j = 0; j < ND; j++) {
        z[NX + NH + j] = held_signal(s, j, s->n - s->whole[j] - 1);
        z[NX + NH + ND + j] = held_signal(s, j, s->n - s->whole[j]);
    }
    z[NZ - 1] = 1;
    multiply(s, z, dx);
    for (int i = 0; i < NX; i++) states(s)[i] = z[i] + dx[i];
#elif NX > 0
    const double time = s->v[0];
    double d[AT_LEAST_ONE(ND)];
    for (double t = 0, end; t < s->h; t = end) {
        end = next_switch(s, t);
        for (int j = 0; j < ND; j++) d[j] = held_signal(s, j, s->n - s->whole[j] - (t >= s->part[j] ? 0 : 1));
        runge_kutta(s, time + t, d, end - t);
    }
#else
    (void)states;
    (void)s;
#endif
}

/* One internal step: sample, hold, move. */
static NOINLINE void advance(State *s) {
    double value[AT_LEAST_ONE(ND)], d[AT_LEAST_ONE(ND)];
    unsigned char tick[AT_LEAST_ONE(NC)];
    int any = 0;
    for (int c = 0; c < NC; c++) {
        tick[c] = s->wait[c] == 0;
        s->wait[c] = (tick[c] ? s->period[c] : s->wait[c]) - 1;
        any |= tick[c];
    }
    model_delay_values(s->v, value);
    if (any) {
        delayed(s, value, d);
        model_events(s->v, d, tick);
        model_delay_values(s->v, value);
    }
    for (int j = 0; j < ND; j++) s->ring[s->n % DELAY_CAPACITY][j] = value[j];
    integrate(s);
    s->n++;
    s->v[0] = s->start_time + (double)(long long)s->n * s->h;
}

/* Check and prepare a step that does not simply continue the last one. */
static COLD const char *check_step(State *s, double time, double step) {
    if (!(step > 0)) return "the communication step is not positive";
    if (s->h == 0) {
        const char *problem = prepare(s, step);
        if (problem) return s->h = 0, problem;
    }
    double count = step / s->h, steps = floor(count + 0.5);
    if (steps < 1 || fabs(count - steps) > 1e-6 * count)
        return "the communication step is not a multiple of the internal step";
    s->communication_step = step;
    s->internal_steps = (unsigned long long)steps;
    if (fabs(time - s->v[0]) > 1e-6 * s->h + 1e-12 * fabs(time))
        return "the communication point is not where the last step ended";
    return NULL;
}

/* Returns NULL, or what went wrong. */
static const char *core_step(State *s, double time, double step) {
    if (step != s->communication_step || time != s->v[0]) {
        const char *problem = check_step(s, time, step);
        if (problem) return problem;
    }
    for (unsigned long long i = s->internal_steps; i > 0; i--) advance(s);
    s->evaluated_stage = 0;
    return core_assert(s);
}
