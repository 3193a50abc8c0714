/* The numerical core of every FMU: one fixed internal step. The affine part of the derivatives is integrated exactly, a
   polynomial remainder is held at its extrapolated midpoint; other derivatives take Runge-Kutta steps.

   model.h and model.c are generated from Modelica; core.c is the same for all models and knows no FMI.
   State holds no pointers, so saving and restoring it is a copy. */
#ifndef CORE_H
#define CORE_H

#include "model.h"

#include <stdint.h>

#if defined(__GNUC__)
#define COLD __attribute__((cold))         /* moves error paths out of the stepping loop */
#define NOINLINE __attribute__((noinline)) /* keeps compilers from unrolling a loop that mostly runs once */
#else
#define COLD
#define NOINLINE
#endif

/* For the instructions of the processor it runs on; each element of a vector is rounded as a scalar is. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define VECTORISED __attribute__((target_clones("avx2", "default")))
#else
#define VECTORISED
#endif

#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1) /* C99 has no arrays of length zero */
#define DELAY_CAPACITY 128                  /* internal steps that a delay may span */

typedef struct {
#if AFFINE
#if NQ > 0
    double remainder[NQ]; /* of the derivatives, at the begin of the last step */
#endif
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
    int evaluated_stage; /* stage up to which v is up to date, see model_stage */
} State;

/* Generated, model.c. It comes first in the one translation unit, with four constants:
   model_inputs     value references of all NU inputs, in order
   model_settable   by value reference: 0 never, 1 until the end of initialization, 2 always
   model_stage      by value reference: up to date after 1 model_state_outputs, 2 model_outputs, 3 model_algebraic
   model_guid       of the FMU
   Every function works on the values v by value reference. */
static void model_start(double *v);
static void model_calculated(double *v);                 /* parameters that follow from others */
static void model_dependent_starts(double *v);           /* states that start where parameters say */
static void model_set_inputs(double *v, const double *u);
static void model_state_outputs(double *v);              /* outputs that follow from states and parameters alone */
static void model_outputs(double *v, const double *d);   /* the other outputs */
static void model_algebraic(double *v, const double *d); /* the rest, and derivatives of states */
static void model_events(double *v, const double *d, const unsigned char *tick);
static void model_clocks(const double *v, double *start, double *period);
static void model_delay_values(const double *v, double *value);
static void model_delay_times(const double *v, double *duration);
static const char *model_assert(const double *v, const double *d); /* NULL, or the message of what does not hold */
#if AFFINE
static void model_held(const double *v, double *held);
static void model_affine(const double *v, double *a, double *b);
#if NQ > 0
static void model_remainder(const double *v, const double *d, double *q);
#endif
#elif NX > 0
static void model_rates(const double *v, const double *d, double *rate);
#endif

#endif
