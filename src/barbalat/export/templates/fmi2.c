/*
 * ${origin}
 * All functions of FMI 2.0 (https://fmi-standard.org), for Co-Simulation; the Model Exchange functions exist but return an error.
 */
#include "fmu_instance.h"

#ifdef FMI_OFFICIAL_HEADERS /* use the standard's header; otherwise declare the necessary parts */
#include "fmi2Functions.h"
#else
#include "fmi2_types.h"
#endif

#define FMI FMU_EXPORT

typedef struct {
    fmu_state state;
    fmi2CallbackFunctions callbacks;
    int logging;
    char name[256];
} instance;

static fmi2Status said(const instance *i, fmi2Status status, const char *what)
{
    if (what != NULL && i->callbacks.logger != NULL && (i->logging != 0 || status > fmi2Warning)) {
        i->callbacks.logger(i->callbacks.componentEnvironment, i->name, status, "logAll", "%s", what);
    }
    return status;
}

static fmi2Status refused(fmi2Component c, const char *what)
{
    return said((const instance *)c, fmi2Error, what);
}

static fmi2Status unless(fmi2Component c, const char *what)
{
    return what == NULL ? fmi2OK : refused(c, what);
}

FMI const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

FMI const char *fmi2GetVersion(void)
{
    return "2.0";
}

FMI fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    size_t k;
    for (k = 0; k < count; ++k) {
        if (strcmp(categories[k], "logAll") != 0) {
            return refused(c, "the only category of messages is logAll");
        }
    }
    ((instance *)c)->logging = on != 0;
    return fmi2OK;
}

FMI fmi2Component fmi2Instantiate(fmi2String name, fmi2Type kind, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    instance *made;
    (void)resources;
    (void)visible;
    if (callbacks == NULL || kind != fmi2CoSimulation || guid == NULL || strcmp(guid, MODEL_TOKEN) != 0) {
        if (callbacks != NULL && callbacks->logger != NULL) {
            callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logAll",
                "not instantiated: Co-Simulation alone is offered, and the GUID must be that of modelDescription.xml");
        }
        return NULL;
    }
    made = (instance *)calloc(1, sizeof *made);
    if (made != NULL) {
        made->callbacks = *callbacks;
        made->logging = logging != 0;
        strncpy(made->name, name != NULL ? name : "", sizeof made->name - 1);
        clear(&made->state);
    }
    return made;
}

FMI void fmi2FreeInstance(fmi2Component c)
{
    free(c);
}

FMI fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends,
    fmi2Real stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)ends;
    (void)stop;
    ((instance *)c)->state.start = start;
    return fmi2OK;
}

FMI fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    instance *i = (instance *)c;
    if (i->state.stage != INSTANTIATED) {
        return refused(c, "an instance is initialized once; reset it first");
    }
    i->state.stage = INITIALIZING;
    return fmi2OK;
}

FMI fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    instance *i = (instance *)c;
    if (i->state.stage != INITIALIZING) {
        return refused(c, "the initialization was not entered");
    }
    return unless(c, begin(&i->state));
}

FMI fmi2Status fmi2Terminate(fmi2Component c)
{
    ((instance *)c)->state.stage = TERMINATED;
    return fmi2OK;
}

FMI fmi2Status fmi2Reset(fmi2Component c)
{
    clear(&((instance *)c)->state);
    return fmi2OK;
}

FMI fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t count, fmi2Real value[])
{
    fmu_state *s = &((instance *)c)->state;
    const char *what = NULL;
    size_t k;
    refresh(s);
    for (k = 0; k < count && what == NULL; ++k) {
        what = get_real(s, r[k], &value[k]);
    }
    return unless(c, what);
}

FMI fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t count, const fmi2Real value[])
{
    return unless(c, set_reals(&((instance *)c)->state, r, count, value));
}

static fmi2Status wholes(fmi2Component c, const fmi2ValueReference r[], size_t count, int value[], char kind)
{
    const char *what = NULL;
    size_t k;
    for (k = 0; k < count && what == NULL; ++k) {
        what = get_whole(&((instance *)c)->state, r[k], kind, &value[k]);
    }
    return unless(c, what);
}

FMI fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t count, fmi2Integer value[])
{
    return wholes(c, r, count, value, 'w');
}

FMI fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t count, fmi2Boolean value[])
{
    return wholes(c, r, count, value, 'b');
}

FMI fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t count, const fmi2Boolean value[])
{
    const char *what = NULL;
    size_t k;
    for (k = 0; k < count && what == NULL; ++k) {
        what = set_whole(&((instance *)c)->state, r[k], value[k]);
    }
    return unless(c, what);
}

FMI fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t count, const fmi2Integer value[])
{
    (void)r;
    (void)value;
    return count == 0 ? fmi2OK : refused(c, "whole numbers cannot be set");
}

FMI fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t count, fmi2String value[])
{
    (void)r;
    (void)value;
    return count == 0 ? fmi2OK : refused(c, "there are no texts");
}

FMI fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t count, const fmi2String value[])
{
    (void)r;
    (void)value;
    return count == 0 ? fmi2OK : refused(c, "there are no texts");
}

${states}
FMI fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real size, fmi2Boolean final)
{
    static const fmi2Status grades[] = { fmi2OK, fmi2Warning, fmi2Error };
    int grade;
    const char *what = advance_by(&((instance *)c)->state, point, size, &grade);
    (void)final;
    return said((const instance *)c, grades[grade], what);
}

FMI fmi2Status fmi2CancelStep(fmi2Component c)
{
    return refused(c, "no step is pending: steps are made at once");
}

FMI fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = now(&((instance *)c)->state);
    return fmi2OK;
}

/* Below are the statuses of pending steps, which do not occur, and functions not offered, as modelDescription.xml states. */
${refused}
