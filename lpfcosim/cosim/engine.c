/* The stepping loop of the co-simulation: connections, feeds and recording come as tables. Then the noise
   that drives it, and the low-pass of what it records.

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

enum { OF_LINE = 8, AHEAD = 3 * OF_LINE }; /* samples in a cache line; how far ahead they are fetched */

/* Every signal of a block lies by itself: more places than a processor looks ahead at. */
static void fetch(const Signals *signals, int64_t sample) {
    for (int64_t j = 0; j < signals->n; j++)
        __builtin_prefetch(signals->values + sample * signals->per_sample + j * signals->per_signal);
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
        if (i % OF_LINE == 0 && i + AHEAD < n) {
            fetch(feeds, i + AHEAD);
            fetch(recorded, i + AHEAD);
        }
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

/* Normal numbers, with the bits of NumPy's Generator(PCG64).standard_normal: a ziggurat of 256 layers. NumPy's own
   function for one number, of its C interface, tells the layers and draws the 1 in 80 that is not well inside one. */
__extension__ typedef unsigned __int128 Wide;

enum { LAYERS = 256, SIGN = 256, ABOVE = 9 }; /* layer, sign, and from bit 9 on the magnitude of 52 bits */

typedef struct {
    uint64_t high, low, add_high, add_low; /* state and increment */
} Pcg;

typedef struct { /* bitgen_t of numpy/random/bitgen.h */
    void *state;
    uint64_t (*next_uint64)(void *);
    uint32_t (*next_uint32)(void *);
    double (*next_double)(void *);
    uint64_t (*next_raw)(void *);
} Bits;

typedef double (*Normal)(Bits *);

typedef struct {
    uint64_t first; /* number that it answers with, then one that NumPy accepts */
    int asked;
} Script;

static uint64_t inside[LAYERS];  /* smaller magnitudes lie inside the layer at any height */
static double width[2 * LAYERS]; /* by sign and layer, of a magnitude of one */

static uint64_t answer(void *at) {
    Script *script = at;
    return script->asked++ ? (uint64_t)1 << ABOVE | 3 : script->first;
}

static double half(void *at) {
    Script *script = at;
    script->asked++;
    return 0.5;
}

/* Fills the tables. */
EXPORT void learn(Normal normal) {
    Script script;
    Bits bits = {&script, answer, NULL, half, answer};
    for (uint64_t layer = 0; layer < 2 * LAYERS; layer++) {
        script = (Script){(uint64_t)1 << ABOVE | layer, 0};
        width[layer] = normal(&bits);
    }
    for (uint64_t layer = 0; layer < LAYERS; layer++) {
        uint64_t low = 0, high = (uint64_t)1 << 52;
        while (low < high) {
            uint64_t middle = (low + high) / 2;
            script = (Script){middle << ABOVE | layer, 0};
            normal(&bits);
            if (script.asked == 1) low = middle + 1;
            else high = middle;
        }
        inside[layer] = low;
    }
}

static Wide joined(uint64_t high, uint64_t low) { return (Wide)high << 64 | low; }

static Wide after(Wide state, Wide add) {
    return state * joined(2549297995355413924u, 4865540595714422341u) + add;
}

static uint64_t said(Wide state) {
    uint64_t mixed = (uint64_t)(state >> 64) ^ (uint64_t)state;
    unsigned by = (unsigned)(state >> 122);
    return mixed >> by | mixed << (-by & 63);
}

static void keep(Pcg *pcg, Wide state) {
    pcg->high = (uint64_t)(state >> 64);
    pcg->low = (uint64_t)state;
}

static uint64_t next(void *at) {
    Pcg *pcg = at;
    keep(pcg, after(joined(pcg->high, pcg->low), joined(pcg->add_high, pcg->add_low)));
    return said(joined(pcg->high, pcg->low));
}

static double uniform(void *at) { return (double)(next(at) >> 11) / 9007199254740992.0; }

/* Draws the next n numbers x[i] into out[i] = size x[i] + rho out[i-1], with last before the first; returns the last.
   White noise has no rho. */
EXPORT double draw(Pcg *pcg, Normal normal, double *out, int64_t n, double size, double rho, double last) {
    Bits bits = {pcg, next, NULL, uniform, next};
    Wide state = joined(pcg->high, pcg->low), add = joined(pcg->add_high, pcg->add_low);
    for (int64_t i = 0; i < n; i++) {
        Wide following = after(state, add);
        uint64_t drawn = said(following), magnitude = drawn >> ABOVE & (((uint64_t)1 << 52) - 1);
        double x;
        if (magnitude < inside[drawn & (LAYERS - 1)]) {
            x = (double)(int64_t)magnitude * width[drawn & (2 * LAYERS - 1)];
            state = following;
        } else {
            keep(pcg, state);
            x = normal(&bits);
            state = joined(pcg->high, pcg->low);
        }
        out[i] = last = size * x + rho * last;
    }
    keep(pcg, state);
    return last;
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
