/* What an FMU of $name does, whatever the version of the interface calls it.
 *
 * Values are numbered: 0 is time, then $n_in inputs, $n_out outputs, $n_states states.
 * Samples are $dt s apart. At each, outputs follow from states and inputs; until the
 * next one, both are held.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "plant.h"

#define TOKEN "$token"
#define N_IN $n_in
#define N_OUT $n_out
#define N_STATES $n_states
#define NEAR 1e-6 /* samples: times this close are the same */

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else /* elsewhere all is seen */
#define EXPORT
#endif /* _WIN32 */
#define PASTE(a, b) a##b
#define JOIN(a, b) PASTE(a, b)

/* What is saved, restored and sent as bytes. */
typedef struct {
    double time, start; /* s */
    double n; /* samples since the start */
    int started; /* whether initialization is over */
    int at_sample; /* whether inputs of this sample may still come */
    double in[N_IN], held[N_IN];
#if !CONTROLLER
    double x[PLANT_NX];
#endif
#if !MODEL
    plant_controller c;
#endif
} fmu_state;

/* Copies of a state, and their bytes: return why there is none, or 0. */
static const char *fmu_copy(const void *s, void **copy)
{
    if (!*copy)
        *copy = malloc(sizeof(fmu_state));
    if (!*copy)
        return "There is no memory for a state.";
    memcpy(*copy, s, sizeof(fmu_state));
    return 0;
}

static const char *fmu_write(const void *s, void *bytes, size_t size)
{
    if (size < sizeof(fmu_state))
        return "A state does not fit into so few bytes.";
    memcpy(bytes, s, sizeof(fmu_state));
    return 0;
}

static const char *fmu_read(const void *bytes, size_t size, void **copy)
{
    if (size != sizeof(fmu_state))
        return "These are not the bytes of a state.";
    return fmu_copy(bytes, copy);
}

static void fmu_free(void **copy)
{
    if (copy) {
        free(*copy);
        *copy = 0;
    }
}

static void fmu_reset(fmu_state *s)
{
    static const double rest[N_IN] = {$rest};
    memset(s, 0, sizeof *s);
    s->at_sample = 1;
    memcpy(s->in, rest, sizeof rest);
    memcpy(s->held, rest, sizeof rest);
#if !MODEL
    plant_reset(&s->c);
#endif
}

/* Outputs of this sample; *s becomes the state of the next one. */
static void fmu_sample(fmu_state *s, const double *in, double *out)
{
#if MODEL
    plant_output(s->x, in, out);
    plant_step(s->x, in);
#endif
#if CONTROLLER && DISTURBED
    plant_control(&s->c, in, in + PLANT_NR, in + PLANT_NR + PLANT_NY, out);
#endif
#if CONTROLLER && !DISTURBED
    plant_control(&s->c, in, in + PLANT_NR, out);
#endif
#if BOTH && DISTURBED
    static const int moved[PLANT_NV] = {$moved}, given[PLANT_ND] = {$given};
    double u[PLANT_NU];
    int i;
    plant_output(s->x, 0, out);
    plant_control(&s->c, in, out, in + PLANT_NR, out + PLANT_NY);
    for (i = 0; i < PLANT_NV; i++)
        u[moved[i]] = out[PLANT_NY + i];
    for (i = 0; i < PLANT_ND; i++)
        u[given[i]] = s->c.d[i]; /* the last one that was finite */
    plant_step(s->x, u);
#endif
#if BOTH && !DISTURBED
    plant_output(s->x, 0, out);
    plant_control(&s->c, in, out, out + PLANT_NY);
    plant_step(s->x, out + PLANT_NY);
#endif
}

static double *fmu_place(fmu_state *s, unsigned reference)
{
    unsigned i = reference - 1;
    if (i < N_IN)
        return s->in + i;
    i -= N_IN + N_OUT;
#if !CONTROLLER
    if (i < PLANT_NX)
        return s->x + i;
    i -= PLANT_NX;
#endif
#if !MODEL
    if (i < PLANT_NX)
        return s->c.x + i;
    i -= PLANT_NX;
#endif
#if !MODEL && INTEGRATES
    if (i < PLANT_NY)
        return s->c.z + i;
#endif
    return 0;
}

/* Return why a value cannot be given, or 0. */
static const char *fmu_get(const fmu_state *s, const unsigned *references, size_t n,
    double *values)
{
    const double *in = s->at_sample ? s->in : s->held;
    double out[N_OUT];
    size_t k;
    int known = 0;
    for (k = 0; k < n; k++) {
        unsigned reference = references[k];
        if (reference == 0)
            values[k] = s->time;
        else if (reference > N_IN && reference <= N_IN + N_OUT) {
            if (!known) {
#if MODEL
                plant_output(s->x, in, out);
#else
                fmu_state copy = *s;
                fmu_sample(&copy, in, out);
#endif
            }
            known = 1;
            values[k] = out[reference - 1 - N_IN];
        } else {
            fmu_state *same = (fmu_state *)s; /* not changed */
            const double *place = fmu_place(same, reference);
            if (!place)
                return "There is no variable of this value reference.";
            values[k] = *place;
        }
    }
    return 0;
}

static const char *fmu_set(fmu_state *s, const unsigned *references, size_t n,
    const double *values)
{
    size_t k;
    for (k = 0; k < n; k++) {
        unsigned reference = references[k];
        double *place = fmu_place(s, reference);
        if (reference == 0 || !place)
            return "Only inputs and states can be set.";
        if (reference > N_IN && s->started)
            return "States can be set before the end of initialization.";
#if MODEL
        if (!isfinite(values[k]))
            return "Inputs and states must be finite.";
#else
        if (reference > N_IN && !isfinite(values[k]))
            return "States must be finite.";
#endif
        *place = values[k];
    }
    return 0;
}

static const char *fmu_do_step(fmu_state *s, double time, double step)
{
    double end = time + step, out[N_OUT];
    if (!s->started)
        return "Initialization must be over before a step.";
    if (!(step >= 0) || !isfinite(end))
        return "A step must be finite and lead forward.";
    if (fabs(time - s->time) > NEAR * PLANT_DT)
        return "A step must begin where the last one ended.";
    if (s->at_sample)
        memcpy(s->held, s->in, sizeof s->in);
    while (s->start + (s->n + 1) * PLANT_DT <= end + NEAR * PLANT_DT) {
        fmu_sample(s, s->held, out);
        memcpy(s->held, s->in, sizeof s->in);
        s->n += 1;
    }
    s->at_sample = s->start + s->n * PLANT_DT >= end - NEAR * PLANT_DT;
    s->time = end;
    return 0;
}
#if MODEL

/* What changes of inputs and states do to outputs of the same sample. */
static const char *fmu_slope(const fmu_state *s, const unsigned *unknowns, size_t n,
    const unsigned *knowns, size_t m, const double *seed, double *slopes)
{
    double du[N_IN] = {0}, dx[PLANT_NX] = {0}, dy[N_OUT];
    size_t k;
    for (k = 0; k < m; k++) {
        unsigned i = knowns[k] - 1;
        if (i < N_IN)
            du[i] += seed[k];
        else if (i >= N_IN + N_OUT && i < N_IN + N_OUT + N_STATES)
            dx[i - N_IN - N_OUT] += seed[k];
        else
            return "Derivatives are by inputs and states.";
    }
    plant_output_slope(s->x, s->at_sample ? s->in : s->held, dx, du, dy);
    for (k = 0; k < n; k++) {
        unsigned i = unknowns[k] - 1 - N_IN;
        if (i >= N_OUT)
            return "Derivatives are those of outputs.";
        slopes[k] = dy[i];
    }
    return 0;
}
#endif
