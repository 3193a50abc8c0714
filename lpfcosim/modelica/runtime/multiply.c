/* The product with the step matrix, half of what the plant of a whole spacecraft computes.

   The matrix lies in panels of so many rows that their sums fill half of the registers of four numbers; each panel column
   by column, without those that are zero there. The product is compiled a second time for processors that have such
   registers. Every sum is made in the same order, and product and sum are rounded apart, so that the bits are the same. */
#include "core.h"

#if AFFINE

#ifndef PANELS /* a few states: the compiler writes all of it out */

static COLD void lay_out(State *s, const double *e) {
    for (int j = 0; j < NZ; j++)
        for (int i = 0; i < NX; i++) s->e[j * NX + i] = e[i * NZ + j];
}

/* By columns: the sums of all states grow side by side. Each begins as 0 + the first term, for its sign if that is zero. */
static void multiply(const State *s, const double *z, double *dx) {
    double sum[NX];
    for (int i = 0; i < NX; i++) sum[i] = 0 + s->e[i] * z[0];
    for (int j = 1; j < NZ; j++)
        for (int i = 0; i < NX; i++) sum[i] += s->e[j * NX + i] * z[j];
    for (int i = 0; i < NX; i++) dx[i] = sum[i];
}

#else

#if defined(__GNUC__)
#define INSIDE inline __attribute__((always_inline))
#else
#define INSIDE
#endif

static int rows_of(int panel) { return panel < PANELS - 1 ? PANEL : ROWS - panel * PANEL; }

static COLD void lay_out(State *s, const double *e) {
    double *to = s->e;
    for (int p = 0; p < PANELS; p++) {
        const int first = p * PANEL, end = first + rows_of(p) < NX ? first + rows_of(p) : NX;
        s->kept[p] = 0;
        for (int j = 0; j < NZ; j++) {
            int any = 0;
            for (int i = first; i < end; i++) any |= e[i * NZ + j] != 0;
            if (!any) continue;
            s->column[p][s->kept[p]++] = j;
            for (int i = first; i < first + rows_of(p); i++) *to++ = i < NX ? e[i * NZ + j] : 0;
        }
    }
}

/* Whether the panels of a state from outside can be followed. */
static COLD int laid_out(const State *s) {
    for (int p = 0; p < PANELS; p++) {
        if (s->kept[p] < 0 || s->kept[p] > NZ) return 0;
        for (int j = 0; j < s->kept[p]; j++)
            if (s->column[p][j] < 0 || s->column[p][j] >= NZ) return 0;
    }
    return 1;
}

/* By columns: the sums of all rows of a panel grow side by side, several numbers in a register. */
#define PRODUCT(NAME, NUMBERS)                                                                                         \
    static INSIDE const double *NAME##_panel(const State *s, int panel, const int rows, const double *e,               \
                                             const double *z, double *dx) {                                            \
        enum { EACH = sizeof(NUMBERS) / sizeof(double) };                                                              \
        const int n = s->kept[panel], *column = s->column[panel];                                                      \
        NUMBERS sum[PANEL / EACH];                                                                                     \
        for (int k = 0; k < rows / EACH; k++) sum[k] = (NUMBERS){0};                                                   \
        for (int j = 0; j < n; j++, e += rows) {                                                                       \
            const double factor = z[column[j]];                                                                        \
            for (int k = 0; k < rows / EACH; k++) sum[k] += ((const NUMBERS *)e)[k] * factor;                          \
        }                                                                                                              \
        for (int k = 0; k < rows / EACH; k++) ((NUMBERS *)(dx + panel * PANEL))[k] = sum[k];                           \
        return e;                                                                                                      \
    }                                                                                                                  \
                                                                                                                       \
    static INSIDE void NAME(const State *s, const double *z, double *dx) {                                             \
        const double *e = s->e;                                                                                        \
        for (int p = 0; p < PANELS - 1; p++) e = NAME##_panel(s, p, PANEL, e, z, dx);                                  \
        NAME##_panel(s, PANELS - 1, ROWS - (PANELS - 1) * PANEL, e, z, dx);                                            \
    }

#if defined(__GNUC__)
typedef double Two __attribute__((vector_size(16), aligned(8), may_alias));
PRODUCT(by_two, Two)
#else
PRODUCT(by_two, double)
#endif

#if defined(__x86_64__) && defined(__GNUC__)
#include <cpuid.h>
#define WIDE __attribute__((target("avx2")))

typedef double Four __attribute__((vector_size(32), aligned(8), may_alias));
PRODUCT(by_four, Four)

static WIDE APART void by_four_wide(const State *s, const double *z, double *dx) { by_four(s, z, dx); }

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
    (processor == HAS_WIDE ? by_four_wide : by_two)(s, z, dx);
}
#else
static void multiply(const State *s, const double *z, double *dx) { by_two(s, z, dx); }
#endif
#endif

#endif
