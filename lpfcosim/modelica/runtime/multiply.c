/* The product with the step matrix, half of what the plant of a whole spacecraft computes.

   It is compiled a second time for processors with registers of four numbers. Every sum is made in the same order, and
   product and sum are rounded apart, so that the bits are the same. */
#include "core.h"

#if AFFINE

#if NX >= 8 && defined(__x86_64__) && defined(__GNUC__) /* with fewer states it does not pay */
#define WIDE __attribute__((target("avx2")))
#define INSIDE inline __attribute__((always_inline))
#else
#define INSIDE
#endif

/* By columns: the sums of all states grow side by side. Each begins as 0 + the first term, for its sign if that is zero. */
static INSIDE void by_columns(const State *s, const double *z, double *dx) {
    double sum[NX];
    for (int i = 0; i < NX; i++) sum[i] = 0 + s->e[0][i] * z[0];
    for (int j = 1; j < NZ; j++)
        for (int i = 0; i < NX; i++) sum[i] += s->e[j][i] * z[j];
    for (int i = 0; i < NX; i++) dx[i] = sum[i];
}

#ifdef WIDE
#include <cpuid.h>

static WIDE APART void by_columns_wide(const State *s, const double *z, double *dx) { by_columns(s, z, dx); }

/* Whether the processor has wide registers, and the operating system keeps them. */
static COLD int has_wide(void) {
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c & bit_OSXSAVE)) return 0;
    __asm__("xgetbv" : "=a"(a), "=d"(d) : "c"(0));
    if ((a & 6) != 6) return 0;
    return __get_cpuid_count(7, 0, &a, &b, &c, &d) && (b & bit_AVX2);
}

/* Asked once a process, and not part of a state, which may come from another machine. */
static void multiply(const State *s, const double *z, double *dx) {
    static enum { UNKNOWN, PLAIN, HAS_WIDE } processor;
    if (processor == UNKNOWN) processor = has_wide() ? HAS_WIDE : PLAIN;
    (processor == HAS_WIDE ? by_columns_wide : by_columns)(s, z, dx);
}
#else
static void multiply(const State *s, const double *z, double *dx) { by_columns(s, z, dx); }
#endif

#endif
