/* The stepping loop of the co-simulation: connections, stimuli and recording come as tables.

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
    double *values;                   /* buffer for the input values */
    size_t output;                    /* where the output values go on the bus */
    int32_t version;                  /* of FMI: 2 or 3 */
    int32_t check_finite;             /* the outputs of a third-party FMU must be finite */
    int32_t n_steps;                  /* of the FMU in one of the loop */
} Fmu;

/* Signals of a block: that of place j at sample i is values[i * per_sample + j * per_signal]. */
typedef struct {
    double *values;
    int64_t n, per_sample, per_signal;
} Signals;

typedef struct {
    int64_t sample;
    int32_t component; /* whose code runs; -1: none */
    int32_t status;    /* of the call that failed; 0: none failed */
} Progress;

static int step(const Fmu *s, double time, double h) {
    if (s->version == 2) return s->step.v2(s->instance, time, h, 1);
    _Bool event = 0, terminate = 0, early = 0;
    double last = 0;
    int status = s->step.v3(s->instance, time, h, 1, &event, &terminate, &early, &last);
    if (status > WARNING) return status;
    return terminate ? ENDS : early ? EARLY : status; /* a step that ends before its end is no step */
}

/* The steps of an FMU within one of the loop; where each begins is where the one before it ended, without rounding. */
static int several_steps(const Fmu *s, double time, double h) {
    int status = 0;
    double begin = time, end;
    for (int32_t k = 1; k <= s->n_steps && status <= WARNING; k++, begin = end) {
        end = k < s->n_steps ? time + k * (h / s->n_steps) : time + h;
        status = step(s, begin, end - begin);
    }
    return status;
}

static int exchange(const Fmu *s, double *bus, double time, double h) {
    int status = 0;
    for (size_t i = 0; i < s->n_inputs; i++) s->values[i] = bus[s->sources[i]];
    if (s->n_inputs)
        status = s->version == 2 ? s->set.v2(s->instance, s->inputs, s->n_inputs, s->values)
                                 : s->set.v3(s->instance, s->inputs, s->n_inputs, s->values, s->n_inputs);
    if (status <= WARNING) status = s->n_steps == 1 ? step(s, time, h) : several_steps(s, time, h);
    if (status > WARNING) return status;
    double *outputs = bus + s->output;
    status = s->version == 2 ? s->get.v2(s->instance, s->outputs, s->n_outputs, outputs)
                             : s->get.v3(s->instance, s->outputs, s->n_outputs, outputs, s->n_outputs);
    if (s->check_finite && status <= WARNING)
        for (size_t i = 0; i < s->n_outputs; i++)
            if (!(outputs[i] - outputs[i] == 0)) return NOT_FINITE;
    return status;
}

/* Steps the FMUs in their order through samples first … first + n - 1, or until a call fails.
   The stimuli come first on the bus; record has the places of what is recorded.
   Another process may read the progress at any time, also after this one has ended. */
EXPORT void run_block(const Fmu *fmus, size_t n_fmus, double *bus, const Signals *stimuli,
                      const int32_t *record, const Signals *recorded, int64_t first, int64_t n, double h,
                      volatile Progress *progress) {
    for (int64_t i = 0; i < n; i++) {
        const double *stimulus = stimuli->values + i * stimuli->per_sample;
        double *out = recorded->values + i * recorded->per_sample;
        progress->sample = first + i;
        for (int64_t j = 0; j < stimuli->n; j++) bus[j] = stimulus[j * stimuli->per_signal];
        for (size_t j = 0; j < n_fmus; j++) {
            progress->component = (int32_t)j;
            /* A third-party FMU that adds up its steps finds the time that it is given, without rounding. */
            double time = (double)(first + i) * h;
            double step = fmus[j].check_finite ? (double)(first + i + 1) * h - time : h;
            int status = exchange(fmus + j, bus, time, step);
            if (status > WARNING) {
                progress->status = status;
                return;
            }
        }
        for (int64_t j = 0; j < recorded->n; j++) out[j * recorded->per_signal] = bus[record[j]];
    }
    progress->sample = first + n;
    progress->component = -1;
}
