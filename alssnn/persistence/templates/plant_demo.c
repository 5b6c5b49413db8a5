/* $What, as a table. Start your own program from here. */
#include <stdio.h>

#include "plant.h"

int main(void)
{
    plant_real x[PLANT_NX] = {0}, y[PLANT_NY];
#if CONTROL
    static const plant_real r[PLANT_NR] = {$values};
    plant_real u[PLANT_NU];
#if DISTURBED
    static const plant_real d[PLANT_ND] = {$d_values};
    static const int moved[PLANT_NV] = {$moved}, given[PLANT_ND] = {$given};
    plant_real m[PLANT_NV];
#endif
    plant_controller c;
#else
    static const plant_real u[PLANT_NU] = {$values};
#endif
    int k, i;
#if CONTROL
    plant_reset(&c);
#endif
    printf("k,$columns\n");
    for (k = 0; k < 200; k++) {
#if CONTROL
        plant_output(x, 0, y);
#if DISTURBED
        plant_control(&c, r, y, d, m);
        for (i = 0; i < PLANT_NV; i++)
            u[moved[i]] = m[i];
        for (i = 0; i < PLANT_ND; i++)
            u[given[i]] = d[i];
#else
        plant_control(&c, r, y, u);
#endif
#else
        plant_output(x, u, y);
#endif
        printf("%d", k);
        for (i = 0; i < PLANT_NY; i++)
            printf(",%.9g", (double)y[i]);
        for (i = 0; i < PLANT_NU; i++)
            printf(",%.9g", (double)u[i]);
        printf("\n");
        plant_step(x, u);
    }
    return 0;
}
