/* The stepping loop of the co-simulation: connections, feeds and recording come as tables. Then the recursion
   of the noise that drives it, and the low-pass of what it records.

   FMPy loads, initialises and frees the FMUs; here are only their functions and their instances. */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { WARNING = 1, ENDS = 100, EARLY, NOT_FINITE }; /* of FMI, then ours */

typedef int (*Set2)(void *, const uint32_t *, size_t, const double *);
typedef int (*Get2)(void *, const uint32_t *, size_t, double *);
typedef int (*Step2)(void *, double, double, int);
typedef int (*Set3)(void *, const uint32_t *, size_t, const double *, size_t);
typedef int (*Get3)(void *, const uint32_t *, size_t, double *, size_t);
typedef int (*Step3)(void *, double, double, _Bool, _Bool *, _Bool *, _Bool *, double *);

typedef struct {
    void *instance;
    union {
        Set2 v2;
        Set3 v3;
    } set;
    union {
        Get2 v2;
        Get3 v3;
    } get;
    union {
        Step2 v2;
        Step3 v3;
    } step;
    const uint32_t *inputs, *outputs; /* value references */
    size_t n_inputs, n_outputs;
    const int32_t *sources;           /* place on the bus of each input value */
    double *values;                   /* room for the input values */
    size_t n_values;
    size_t place, n_places;           /* where the output values go on the bus */
    int32_t version;                  /* of FMI: 2 or 3 */
    int32_t guarded;                  /* look at every output: it is not one of ours */
} Slave;

/* Signals of a block: that of place j at sample i is values[i * per_sample + j * per_signal]. */
typedef struct {
    double *values;
    int64_t n, per_sample, per_signal;
} Signals;

typedef struct {
    int64_t sample;
    int32_t slave;  /* whose code runs; -1: nobody's */
    int32_t status; /* how it refused a call; 0: it did not */
} Where;

static int step_2(const Slave *s, double *bus, double time, double h) {
    int status = s->n_inputs ? s->set.v2(s->instance, s->inputs, s->n_inputs, s->values) : 0;
    if (status > WARNING) return status;
    status = s->step.v2(s->instance, time, h, 1);
    if (status > WARNING) return status;
    return s->get.v2(s->instance, s->outputs, s->n_outputs, bus + s->place);
}

static int step_3(const Slave *s, double *bus, double time, double h) {
    _Bool event = 0, terminate = 0, early = 0;
    double last = 0;
    int status = s->n_inputs ? s->set.v3(s->instance, s->inputs, s->n_inputs, s->values, s->n_values) : 0;
    if (status > WARNING) return status;
    status = s->step.v3(s->instance, time, h, 1, &event, &terminate, &early, &last);
    if (status > WARNING) return status;
    if (terminate) return ENDS;
    if (early) return EARLY; /* a step that ends before its end is no step */
    return s->get.v3(s->instance, s->outputs, s->n_outputs, bus + s->place, s->n_places);
}

static int exchange(const Slave *s, double *bus, double time, double h) {
    for (size_t i = 0; i < s->n_values; i++) s->values[i] = bus[s->sources[i]];
    int status = s->version == 2 ? step_2(s, bus, time, h) : step_3(s, bus, time, h);
    if (s->guarded && status <= WARNING)
        for (size_t i = 0; i < s->n_places; i++)
            if (!(bus[s->place + i] - bus[s->place + i] == 0)) return NOT_FINITE;
    return status;
}

/* An FMU of FMI 3.0 with Float32 variables, behind functions that take doubles; its Float64 variables come
   first. The loop has it as the instance of a Slave. */
typedef struct {
    void *instance;
    Set3 set;
    Get3 get;
    Step3 step;
    int (*set_single)(void *, const uint32_t *, size_t, const float *, size_t);
    int (*get_single)(void *, const uint32_t *, size_t, float *, size_t);
    size_t n_inputs, n_input_values, n_outputs, n_output_values; /* of Float64 */
    float *room;                                                 /* for all Float32 inputs, or outputs */
} Mixed;

EXPORT int mixed_set(void *mixed, const uint32_t *references, size_t n, const double *values, size_t n_values) {
    const Mixed *m = mixed;
    size_t wide = m->n_inputs, n_wide = m->n_input_values;
    int status = wide ? m->set(m->instance, references, wide, values, n_wide) : 0;
    if (status > WARNING || n == wide) return status;
    for (size_t i = n_wide; i < n_values; i++) m->room[i - n_wide] = (float)values[i];
    int other = m->set_single(m->instance, references + wide, n - wide, m->room, n_values - n_wide);
    return other > status ? other : status;
}

EXPORT int mixed_get(void *mixed, const uint32_t *references, size_t n, double *values, size_t n_values) {
    const Mixed *m = mixed;
    size_t wide = m->n_outputs, n_wide = m->n_output_values;
    int status = wide ? m->get(m->instance, references, wide, values, n_wide) : 0;
    if (status > WARNING || n == wide) return status;
    int other = m->get_single(m->instance, references + wide, n - wide, m->room, n_values - n_wide);
    for (size_t i = n_wide; i < n_values; i++) values[i] = m->room[i - n_wide];
    return other > status ? other : status;
}

EXPORT int mixed_step(void *mixed, double time, double h, _Bool keep, _Bool *event, _Bool *terminate,
                      _Bool *early, double *last) {
    const Mixed *m = mixed;
    return m->step(m->instance, time, h, keep, event, terminate, early, last);
}

/* Steps the slaves in their order through samples first … first + n - 1, or until one refuses.
   The feeds come first on the bus; what is recorded has its places there in record.
   Another process may look at where, also when this one is no more: it is kept up to date. */
EXPORT void run_block(const Slave *slaves, size_t n_slaves, double *bus, const Signals *feeds,
                      const int32_t *record, const Signals *recorded, int64_t first, int64_t n, double h,
                      volatile Where *where) {
    for (int64_t i = 0; i < n; i++) {
        const double *feed = feeds->values + i * feeds->per_sample;
        double *out = recorded->values + i * recorded->per_sample;
        where->sample = first + i;
        for (int64_t j = 0; j < feeds->n; j++) bus[j] = feed[j * feeds->per_signal];
        for (size_t j = 0; j < n_slaves; j++) {
            where->slave = (int32_t)j;
            /* A third-party FMU that adds up its steps finds the time that it is given, without rounding. */
            double time = (double)(first + i) * h;
            double step = slaves[j].guarded ? (double)(first + i + 1) * h - time : h;
            int status = exchange(slaves + j, bus, time, step);
            if (status > WARNING) {
                where->status = status;
                return;
            }
        }
        for (int64_t j = 0; j < recorded->n; j++) out[j * recorded->per_signal] = bus[record[j]];
    }
    where->sample = first + n;
    where->slave = -1;
}

/* Replaces x[i] by x[i] + rho y[i-1], with last for the y before the first: noise that rises as 1/f. */
EXPORT void autoregress(double *x, int64_t n, double rho, double last) {
    for (int64_t i = 0; i < n; i++) x[i] = last = x[i] + rho * last;
}

/* Two channels side by side, which a processor takes at once; NumPy aligns numbers only. */
typedef double Pair __attribute__((vector_size(16), aligned(8)));

enum { PAIRS = 3 }; /* whose sums stay in registers */

/* Filters channels by 2 half + 1 symmetric taps, and only to the n outputs that are kept, a factor of samples apart.
   Sums go from the ends to the middle: each output has the same bits, whatever block it is in and whoever compiled. */
EXPORT void low_pass(const double *taps, int64_t half, int64_t factor, const Pair *x, Pair *out, int64_t n) {
    for (int64_t i = 0; i < n; i++, x += factor * PAIRS, out += PAIRS) {
        const Pair *before = x, *after = x + 2 * half * PAIRS;
        Pair sum[PAIRS] = {{0}};
        for (int64_t j = 0; j < half; j++, before += PAIRS, after -= PAIRS)
            for (int k = 0; k < PAIRS; k++) sum[k] += taps[j] * (before[k] + after[k]);
        for (int k = 0; k < PAIRS; k++) out[k] = sum[k] + taps[half] * before[k];
    }
}
