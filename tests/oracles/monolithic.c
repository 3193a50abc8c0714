/* The closed loop of the quick start as one C function: what the co-simulation's overhead is measured against.

   Written by hand from the equations, with the step matrix of the plant and the coefficients of the compensators
   handed in; the same feeds come in and the same channels go out as in the engine's loop. */
#include <stdint.h>
#include <string.h>

#define NX 5
#define NZ 15 /* states, g_1 g_2 F_noise, three delayed forces before and after their switch, 1 */
#define RING 8

typedef struct {
    double e[NX * NZ];                       /* plant: x += e [x; …] */
    double decay_1[3], entry_1[3], r_1[3];   /* drag-free compensator: s = decay s + entry (e + e before) */
    double decay_2[3], entry_2[3], r_2[3];   /* suspension compensator */
    double m_sc, m_tm, lambda_1, lambda_2, delta_ifo, f_start, F_max_1, F_max_2;
    int64_t whole[3];                        /* whole samples of the delays of f_applied_1, f_applied_2, F_x_sc */
} Loop;

static double clip(double x, double limit) { return x > limit ? limit : x < -limit ? -limit : x; }

static double compensate(const double *decay, const double *entry, const double *r, double *s, double *last, double e) {
    double a = 0;
    for (int i = 0; i < 3; i++) {
        s[i] = decay[i] * s[i] + entry[i] * (e + *last);
        a += r[i] * s[i];
    }
    *last = e;
    return a;
}

/* feeds: guidance_o_1, guidance_o_12, F_x_1, F_x_2, n_1, n_12, g_1, g_2, F_noise_x_sc, f_x_1_jitter
   recorded: o_1, o_12, f_x_1, f_x_2, guidance_o_1, guidance_o_12, F_x_sc */
__attribute__((visibility("default"))) void run(const Loop *l, const double *feeds, double *recorded, int64_t n) {
    double z[NZ] = {0}, s_1[3] = {0}, s_2[3] = {0}, e_1 = 0, e_2 = 0, ring[3][RING];
    for (int k = 0; k < RING; k++) {
        ring[0][k] = ring[2][k] = 0;
        ring[1][k] = l->lambda_2 * l->f_start;
    }
    z[NZ - 1] = 1;
    for (int64_t i = 0; i < n; i++, feeds += 10, recorded += 7) {
        double o_1 = z[0] + feeds[4];
        double o_12 = z[2] - z[0] + l->delta_ifo * z[0] + feeds[5];
        double thrust = l->m_sc * compensate(l->decay_1, l->entry_1, l->r_1, s_1, &e_1, o_1 - feeds[0]);
        double asked = l->f_start - compensate(l->decay_2, l->entry_2, l->r_2, s_2, &e_2, o_12 - feeds[1]);
        double f_1 = clip(feeds[2], l->F_max_1) / l->m_tm + feeds[9];
        double f_2 = clip(l->m_tm * asked + feeds[3], l->F_max_2) / l->m_tm;
        ring[0][i % RING] = l->lambda_1 * f_1;
        ring[1][i % RING] = l->lambda_2 * f_2;
        ring[2][i % RING] = thrust;
        memcpy(z + NX, feeds + 6, 3 * sizeof *z);
        for (int j = 0; j < 3; j++) {
            z[NX + 3 + j] = ring[j][(i - l->whole[j] - 1 + RING) % RING];
            z[NX + 6 + j] = ring[j][(i - l->whole[j] + RING) % RING];
        }
        double dx[NX];
        for (int j = 0; j < NX; j++) {
            double sum = 0;
            for (int k = 0; k < NZ; k++) sum += l->e[j * NZ + k] * z[k];
            dx[j] = sum;
        }
        for (int j = 0; j < NX; j++) z[j] += dx[j];
        recorded[0] = o_1, recorded[1] = o_12, recorded[2] = f_1, recorded[3] = f_2;
        recorded[4] = feeds[0], recorded[5] = feeds[1], recorded[6] = thrust;
    }
}
