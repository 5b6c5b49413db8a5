/* $What, one sample after the other. Put your sensors and actuators
   in the place of the model. */
#include <Arduino.h>
#include <plant.h>

static plant_real x[PLANT_NX]; /* of the model that stands for the plant */
#if CONTROL
static plant_controller c;
static const plant_real r[PLANT_NR] = {$values};
#else
static const plant_real u[PLANT_NU] = {$values};
#endif
#if CONTROL && DISTURBED
static const plant_real d[PLANT_ND] = {$d_values};
static const int moved[PLANT_NV] = {$moved}, given[PLANT_ND] = {$given};
#endif
static const unsigned long period = (unsigned long)(PLANT_DT * 1e6); /* us */
static unsigned long last;

void setup()
{
    Serial.begin(115200);
#if CONTROL
    plant_reset(&c);
#endif
    last = micros();
}

void loop()
{
    plant_real y[PLANT_NY];
#if CONTROL
    plant_real u[PLANT_NU];
#endif
#if CONTROL && DISTURBED
    plant_real m[PLANT_NV];
#endif
    int i;
    if (micros() - last < period) {
        return;
    }
    last += period;
#if CONTROL
    plant_output(x, 0, y); /* measure */
#else
    plant_output(x, u, y);
#endif
#if CONTROL && DISTURBED
    plant_control(&c, r, y, d, m);
    for (i = 0; i < PLANT_NV; i++) {
        u[moved[i]] = m[i];
    }
    for (i = 0; i < PLANT_ND; i++) {
        u[given[i]] = d[i];
    }
#endif
#if CONTROL && !DISTURBED
    plant_control(&c, r, y, u);
#endif
    for (i = 0; i < PLANT_NY; i++) {
        Serial.println((double)y[i], 6);
    }
    plant_step(x, u); /* apply u */
}
