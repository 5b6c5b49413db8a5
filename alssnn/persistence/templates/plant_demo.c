/* $What, as a table. Start your own program from here. */
#include <stdio.h>

#include "plant.h"

int main(void)
{
    plant_real x[PLANT_NX] = {0}, y[PLANT_NY];
#if CONTROL
    static const plant_real r[PLANT_NR] = {$values};
    plant_real u[PLANT_NU];
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
        plant_control(&c, r, y, u);
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
