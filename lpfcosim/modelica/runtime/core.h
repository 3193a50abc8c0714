/* The numerical core of every FMU: one fixed internal step, exact where the model is affine.

   model.h and model.c are generated from Modelica; core.c is the same for all models and knows no FMI.
   State holds no pointers, so saving and restoring it is a copy. */
#ifndef CORE_H
#define CORE_H

#include "model.h"

#include <stdint.h>

#if defined(__GNUC__)
#define COLD __attribute__((cold))       /* keeps errors out of the way of what happens at every step */
#define APART __attribute__((noinline))  /* keeps a compiler from preparing for a loop that runs once */
#else
#define COLD
#define APART
#endif

#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1) /* C99 has no arrays of length zero */
#define DELAY_CAPACITY 128                  /* internal steps that a delay may span */

typedef struct {
#if AFFINE
    double e[NZ * NX]; /* of the step, by columns: x += e [x; held; delayed, before and after its switch; 1] */
#endif
    double start_time;
    double h;                                        /* internal step; 0 until the first step */
    double communication_step;                       /* of the last call, and the internal steps it takes */
    unsigned long long internal_steps;
    unsigned long long n;                            /* internal steps done */
    double v[NV];                                    /* values by value reference; v[0] is time */
    double ring[DELAY_CAPACITY][AT_LEAST_ONE(ND)];   /* held signals of the last steps */
    unsigned long long whole[AT_LEAST_ONE(ND)];      /* delay = whole*h + part, 0 <= part < h */
    double part[AT_LEAST_ONE(ND)];
    unsigned long long period[AT_LEAST_ONE(NC)], wait[AT_LEAST_ONE(NC)]; /* of the clocks, in internal steps */
    int initialized;
    int settled; /* parameters are as the last step took them */
    int fresh; /* the stage up to which v is up to date, see model_stage */
} State;

/* A partial derivative; numbers from NV on mean delayed signals. */
typedef struct {
    uint16_t unknown, known;
    unsigned char starting; /* at the start only */
} Link;

/* Generated, model.c. It comes first in the one translation unit, with seven constants:
   model_inputs     value references of all NU inputs, in order
   model_settable   by value reference: 0 never, 1 until the end of initialization, 2 always, 3 always as parameter
   model_known      by value reference: follows from nothing once a step may be made
   model_links      from known to unknown: all partial derivatives, in the order of execution
   model_stage      by value reference: up to date after 1 model_moved, 2 model_outputs, 3 model_algebraic
   model_arrays     by array: value reference of its first element, and how many there are
   model_token      of instantiation
   Every function works on the values v by value reference. */
static void model_start(double *v);
static void model_calculated(double *v);                 /* parameters that follow from others */
static void model_dependent_starts(double *v);           /* states that start where parameters say */
static void model_take_inputs(double *v, const double *u);
static void model_moved(double *v);                      /* outputs that follow from states and parameters alone */
static void model_outputs(double *v, const double *d);   /* the other outputs */
static void model_algebraic(double *v, const double *d); /* what no output needs, and derivatives of states */
static void model_partials(const double *v, const double *d, double *p); /* by link */
static void model_events(double *v, const double *d, const unsigned char *tick);
static void model_clocks(const double *v, double *start, double *period);
static void model_delay_values(const double *v, double *value);
static void model_delay_times(const double *v, double *duration);
#if AFFINE
static void model_held(const double *v, double *held);
static void model_affine(const double *v, double *a, double *b);
#elif NX > 0
static void model_rates(const double *v, const double *d, double *rate);
#endif

static void core_reset(State *s);
static void core_start(State *s, double time);
static void core_initialize(State *s);
static void core_touch(State *s);          /* a variable was set */
static void core_tune(State *s);           /* a parameter was set after initialization */
static void core_delayed(const State *s, double *d);
static void core_refresh(State *s, int to); /* bring up to date all variables of this stage */
static const char *core_step(State *s, double time, double step); /* NULL, or what went wrong */

#endif
