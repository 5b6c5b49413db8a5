/* Self-test of $name: what Python computed, compared on the machine that will run it.
   Returns 0 if all agrees. */
#include <math.h>
#include <stdio.h>

#include "plant.h"

#define SAMPLES $samples

$vectors

static int differs(int k, const char *what, int n, const plant_real *found,
    const plant_real *expected, plant_real near)
{
    int i, wrong = 0;
    for (i = 0; i < n; i++)
        if (!(fabs((double)(found[i] - expected[i])) <= (double)near)) {
            printf("sample %d, %s[%d]: %.17g, expected %.17g\n", k, what, i,
                (double)found[i], (double)expected[i]);
            wrong = 1;
        }
    return wrong;
}

int main(void)
{
    int k, i, wrong = 0;
#if CONTROL
    plant_controller c;
    plant_reset(&c);
#endif
    for (k = 0; k < SAMPLES; k++) {
        plant_real x[PLANT_NX], y[PLANT_NY];
        const plant_real *u = u_in + k * PLANT_NU;
        for (i = 0; i < PLANT_NX; i++)
            x[i] = x_in[k * PLANT_NX + i];
        plant_output(x, u, y);
        wrong |= differs(k, "y", PLANT_NY, y, y_out + k * PLANT_NY, near_y);
        plant_step(x, u);
        wrong |= differs(k, "x", PLANT_NX, x, x_out + k * PLANT_NX, near_x);
#if OBSERVER
        for (i = 0; i < PLANT_NX; i++)
            x[i] = x_in[k * PLANT_NX + i];
        for (i = 0; i < PLANT_NY; i++)
            y[i] = y_in[k * PLANT_NY + i];
        if (k % 2)
            y[0] = (plant_real)NAN; /* not measured */
        plant_correct(x, u, y);
        wrong |= differs(k, "x_hat", PLANT_NX, x, hat_out + k * PLANT_NX, near_hat);
#endif
#if LAW
        {
            plant_real m[PLANT_NV], cut[PLANT_NV];
#if DISTURBED
            plant_law(v_in + k * PLANT_NV, s_in + k * PLANT_NS, d_in + k * PLANT_ND, m,
                cut);
#else
            plant_law(v_in + k * PLANT_NV, s_in + k * PLANT_NS, m, cut);
#endif
            wrong |= differs(k, "u", PLANT_NV, m, law_out + k * PLANT_NV, near_law);
            wrong |= differs(k, "cut", PLANT_NV, cut, cut_out + k * PLANT_NV, near_law);
        }
#endif
#if CONTROL
        if (k < CONTROLLED) {
            const plant_real *sent = control_out + k * PLANT_NV;
            plant_real m[PLANT_NV];
            for (i = 0; i < PLANT_NY; i++)
                y[i] = y_loop[k * PLANT_NY + i];
            if (k % 2)
                y[0] = (plant_real)NAN; /* not measured */
#if DISTURBED
            plant_control(&c, r_loop + k * PLANT_NR, y, d_loop + k * PLANT_ND, m);
#else
            plant_control(&c, r_loop + k * PLANT_NR, y, m);
#endif
            wrong |= differs(k, "control", PLANT_NV, m, sent, near_control);
        }
#endif
    }
    printf(wrong ? "failed\n" : "passed: %d samples\n", SAMPLES);
    return wrong;
}
