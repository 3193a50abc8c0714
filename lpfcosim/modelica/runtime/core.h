/* The numerical core of every FMU: one fixed internal step, exact where the model is affine.

   model.h and model.c are generated from Modelica; core.c is the same for all models and knows no FMI.
   State holds no pointers, so saving and restoring it is a copy. */
#ifndef CORE_H
#define CORE_H

#include "model.h"

#define AT_LEAST_ONE(n) ((n) > 0 ? (n) : 1) /* C99 has no arrays of length zero */
#define DELAY_CAPACITY 128                  /* internal steps that a delay may span */

typedef struct {
    double start_time, time;
    double h;                                        /* internal step; 0 until the first step */
    double communication_step;                       /* of the last call, and the internal steps it takes */
    unsigned long long internal_steps;
    unsigned long long n;                            /* internal steps done */
    double v[NV];                                    /* values by value reference; v[0] is time */
    double d[AT_LEAST_ONE(ND)];                      /* delayed signals at this time */
    double before[AT_LEAST_ONE(ND)];                 /* held signals before the start */
    double ring[AT_LEAST_ONE(ND)][DELAY_CAPACITY];   /* held signals of the last steps */
    unsigned long long whole[AT_LEAST_ONE(ND)];      /* delay = whole*h + part, 0 <= part < h */
    double part[AT_LEAST_ONE(ND)];
    unsigned long long period[AT_LEAST_ONE(NC)], wait[AT_LEAST_ONE(NC)]; /* of the clocks, in internal steps */
    double e[AT_LEAST_ONE(NX * NZ)];                 /* by columns: x += e [x; held; delayed, before and after its switch; 1] */
    int initialized;
    int fresh; /* what follows from states and inputs: 0 nothing is up to date, 1 the outputs, 2 everything */
} State;

/* Generated, model.c. Every function works on the values v by value reference. */
extern const unsigned char model_settable[NV]; /* 0 never, 1 until the end of initialization, 2 always */
extern const unsigned char model_inner[NV];    /* 1 for algebraic variables that are not outputs */
extern const char *const model_token;
void model_start(double *v);
void model_parameters(double *v);
void model_algebraic(double *v, const double *d);
void model_outputs(double *v, const double *d); /* as model_algebraic, but only what the outputs need */
void model_events(double *v, const double *pre, const double *d, const unsigned char *tick);
void model_clocks(const double *v, double *start, double *period);
void model_delay_values(const double *v, double *value);
void model_delay_times(const double *v, double *duration);
void model_held(const double *v, double *held);                  /* affine models */
void model_affine(const double *v, double *a, double *b);        /* affine models */
void model_rates(const double *v, const double *d, double *rate); /* the others */

void core_reset(State *s);
void core_initialize(State *s, double start_time);
void core_touch(State *s);          /* a variable was set */
void core_refresh(State *s, int to); /* bring up to date: 1 the outputs, 2 everything */
const char *core_step(State *s, double time, double step); /* NULL, or what went wrong */

#endif
