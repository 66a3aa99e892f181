/*
 * ${origin}
 * Common parts of both versions of the standard: an instance, its stages, access to variables, steps, states as bytes.
 */
#ifndef FMU_INSTANCE_H
#define FMU_INSTANCE_H

#include "model.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>

#if defined _WIN32 || defined __CYGWIN__
#define FMU_EXPORT __declspec(dllexport)
#else
#define FMU_EXPORT __attribute__((visibility("default")))
#endif

enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };

/* Everything that a step depends on, without pointers: a copy of it is a saved state. */
typedef struct {
    model m;
    double start; /* [s] */
    double steps; /* number of steps of MODEL_STEP since the start, an integer */
    int stage;
} fmu_state;

typedef struct {
    char mark[sizeof MODEL_TOKEN];
    fmu_state state;
} fmu_saved; /* the format written to a file */

static void clear(fmu_state *s)
{
    memset(s, 0, sizeof *s);
    model_defaults(&s->m);
    s->stage = INSTANTIATED;
}

static double now(const fmu_state *s)
{
    return s->start + s->steps * MODEL_STEP;
}

/* Calculated values follow from all values that were set, even before the start. */
static void refresh(fmu_state *s)
{
    if (s->stage <= INITIALIZING) {
        model_start(&s->m);
    }
    model_outputs(&s->m);
}

static const char *get_real(fmu_state *s, unsigned reference, double *value)
{
    if (reference == MODEL_TIME) {
        *value = now(s);
        return NULL;
    }
    if (reference >= MODEL_REALS) {
        return "there is no real variable with this value reference";
    }
    *value = s->m.real[reference];
    return NULL;
}

static const char *set_real(fmu_state *s, unsigned reference, double value)
{
    if (reference >= MODEL_REALS) {
        return "there is no real variable with this value reference that can be set";
    }
    const char when = model_settable[reference];
    if (when == 'n' || ((when == 's' || when == 'S') && s->stage > INITIALIZING)) {
        return "this variable can't be set now: it is an output, or a parameter that is fixed after the start";
    }
    if (when != 'i' && !isfinite(value)) {
        return "a parameter must be a finite number"; /* the controller itself rejects such an input and reports it in its status */
    }
    if ((when == 'T' || when == 'S') && !(value > 0.0)) {
        return "this parameter must be above 0, see modelDescription.xml";
    }
    s->m.real[reference] = value;
    return NULL;
}

/* Sets all real values of one call, or none of them. Before the start, parameters may be set in any order. */
static const char *set_reals(fmu_state *s, const unsigned references[], size_t count, const double values[])
{
    double before[MODEL_REALS];
    const char *what = NULL;
    size_t k;
    memcpy(before, s->m.real, sizeof before);
    for (k = 0; k < count && what == NULL; ++k) {
        what = set_real(s, references[k], values[k]);
    }
    if (what == NULL && s->stage > INITIALIZING) {
        what = model_refused(&s->m);
    }
    if (what != NULL) {
        memcpy(s->m.real, before, sizeof before);
    }
    return what;
}

static const char *get_whole(const fmu_state *s, unsigned reference, char kind, int *value)
{
    const unsigned place = reference - MODEL_FIRST_WHOLE;
    if (reference < MODEL_FIRST_WHOLE || place >= model_wholes || model_kinds[place] != kind) {
        return "there is no variable of this type with this value reference";
    }
    *value = s->m.whole[place];
    return NULL;
}

static const char *set_whole(fmu_state *s, unsigned reference, int value)
{
    if (reference < MODEL_FIRST_WHOLE || reference - MODEL_FIRST_WHOLE >= model_wholes
        || model_kinds[reference - MODEL_FIRST_WHOLE] != 'b') {
        return "there is no truth value with this value reference that can be set";
    }
    s->m.whole[reference - MODEL_FIRST_WHOLE] = value != 0;
    return NULL;
}

static const char *begin(fmu_state *s)
{
    const char *what = model_refused(&s->m);
    if (what == NULL) {
        model_start(&s->m);
        model_outputs(&s->m);
        s->steps = 0;
        s->stage = STEPPING;
    }
    return what;
}

/* Advance from the communication point by a whole number of model steps; returns the fault and its severity. */
static const char *advance_by(fmu_state *s, double point, double size, int *grade)
{
    const double ratio = size / MODEL_STEP, count = floor(ratio + 0.5);
    double k;
    *grade = FMU_ERROR;
    if (s->stage != STEPPING) {
        return "a step is possible only between the end of the initialization and the termination";
    }
    if (!(fabs(point - now(s)) <= MODEL_POINT_TOLERANCE * MODEL_STEP)) {
        return "the communication point is not where the last step ended";
    }
    if (!(count >= 1 && count <= MODEL_MOST_STEPS && fabs(ratio - count) <= MODEL_TOLERANCE * count)) {
        return "the communication step size must be a whole number of the model's own steps, see its stepSize";
    }
    *grade = FMU_OK;
    for (k = 0; k < count; k += 1) {
        const int found = model_step(&s->m);
        *grade = found > *grade ? found : *grade;
        if (*grade == FMU_ERROR) {
            return "the state is not finite: the model diverges";
        }
        s->steps += 1;
    }
    model_outputs(&s->m);
    return *grade == FMU_WARNING ? "a sample was refused or flagged: see the variable status" : NULL;
}

static fmu_state *copied(const fmu_state *of, fmu_state *into)
{
    fmu_state *made = into != NULL ? into : (fmu_state *)malloc(sizeof *made);
    if (made != NULL) {
        memcpy(made, of, sizeof *made);
    }
    return made;
}

static void to_bytes(const fmu_state *of, void *bytes)
{
    fmu_saved saved;
    memset(&saved, 0, sizeof saved);
    memcpy(saved.mark, MODEL_TOKEN, sizeof saved.mark);
    memcpy(&saved.state, of, sizeof saved.state);
    memcpy(bytes, &saved, sizeof saved);
}

static const char *from_bytes(const void *bytes, size_t size, fmu_state *into)
{
    fmu_saved saved;
    if (size != sizeof saved) {
        return "these bytes are not a state of this model: their number is wrong";
    }
    memcpy(&saved, bytes, sizeof saved);
    if (memcmp(saved.mark, MODEL_TOKEN, sizeof saved.mark) != 0) {
        return "these bytes are a state of another model";
    }
    memcpy(into, &saved.state, sizeof *into);
    return NULL;
}

#endif
