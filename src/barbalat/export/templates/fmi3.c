/*
 * ${origin}
 * All functions of FMI 3.0 (https://fmi-standard.org), for Co-Simulation; the functions of the other interfaces exist but return an error.
 */
#include "fmu_instance.h"

#ifdef FMI_OFFICIAL_HEADERS /* use the standard's header; otherwise declare the necessary parts */
#include "fmi3Functions.h"
#else
#include "fmi3_types.h"
#endif

#define FMI FMU_EXPORT

typedef struct {
    fmu_state state;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    int logging;
} instance;

static fmi3Status said(const instance *i, fmi3Status status, const char *what)
{
    if (what != NULL && i->log != NULL && (i->logging != 0 || status > fmi3Warning)) {
        i->log(i->environment, status, "logAll", what);
    }
    return status;
}

static fmi3Status refused(fmi3Instance c, const char *what)
{
    return said((const instance *)c, fmi3Error, what);
}

static fmi3Status unless(fmi3Instance c, const char *what)
{
    return what == NULL ? fmi3OK : refused(c, what);
}

FMI const char *fmi3GetVersion(void)
{
    return "3.0";
}

FMI fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    size_t k;
    for (k = 0; k < count; ++k) {
        if (strcmp(categories[k], "logAll") != 0) {
            return refused(c, "the only category of messages is logAll");
        }
    }
    ((instance *)c)->logging = on;
    return fmi3OK;
}

static fmi3Instance none(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, const char *why)
{
    if (log != NULL) {
        log(environment, fmi3Error, "logAll", why);
    }
    return NULL;
}

FMI fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    instance *made;
    (void)name;
    (void)resources;
    (void)visible;
    (void)early;
    (void)intermediate;
    (void)update;
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        return none(environment, log, "not instantiated: the token must be that of modelDescription.xml");
    }
    if (events || count > 0) {
        return none(environment, log, "not instantiated: there is no event mode and no intermediate update");
    }
    made = (instance *)calloc(1, sizeof *made);
    if (made != NULL) {
        made->environment = environment;
        made->log = log;
        made->logging = logging;
        clear(&made->state);
    }
    return made;
}

FMI fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    return none(environment, log, "not instantiated: Co-Simulation alone is offered");
}

FMI fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)update;
    (void)lock;
    (void)unlock;
    return none(environment, log, "not instantiated: Co-Simulation alone is offered");
}

FMI void fmi3FreeInstance(fmi3Instance c)
{
    free(c);
}

FMI fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerant, fmi3Float64 tolerance, fmi3Float64 start,
    fmi3Boolean ends, fmi3Float64 stop)
{
    instance *i = (instance *)c;
    (void)tolerant;
    (void)tolerance;
    (void)ends;
    (void)stop;
    if (i->state.stage != INSTANTIATED) {
        return refused(c, "an instance is initialized once; reset it first");
    }
    i->state.start = start;
    i->state.stage = INITIALIZING;
    return fmi3OK;
}

FMI fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    instance *i = (instance *)c;
    if (i->state.stage != INITIALIZING) {
        return refused(c, "the initialization was not entered");
    }
    return unless(c, begin(&i->state));
}

FMI fmi3Status fmi3Terminate(fmi3Instance c)
{
    ((instance *)c)->state.stage = TERMINATED;
    return fmi3OK;
}

FMI fmi3Status fmi3Reset(fmi3Instance c)
{
    clear(&((instance *)c)->state);
    return fmi3OK;
}

FMI fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t count, fmi3Float64 value[], size_t values)
{
    fmu_state *s = &((instance *)c)->state;
    const char *what = values == count ? NULL : "all variables are scalars: as many values as references are wanted";
    size_t k;
    refresh(s);
    for (k = 0; k < count && what == NULL; ++k) {
        what = get_real(s, r[k], &value[k]);
    }
    return unless(c, what);
}

FMI fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t count, const fmi3Float64 value[], size_t values)
{
    const char *what = "all variables are scalars: as many values as references are wanted";
    return unless(c, values == count ? set_reals(&((instance *)c)->state, r, count, value) : what);
}

FMI fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t count, fmi3Int32 value[], size_t values)
{
    const char *what = values == count ? NULL : "all variables are scalars: as many values as references are wanted";
    size_t k;
    for (k = 0; k < count && what == NULL; ++k) {
        int found = 0;
        what = get_whole(&((instance *)c)->state, r[k], 'w', &found);
        value[k] = found;
    }
    return unless(c, what);
}

FMI fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t count, fmi3Boolean value[], size_t values)
{
    const char *what = values == count ? NULL : "all variables are scalars: as many values as references are wanted";
    size_t k;
    for (k = 0; k < count && what == NULL; ++k) {
        int found = 0;
        what = get_whole(&((instance *)c)->state, r[k], 'b', &found);
        value[k] = found != 0;
    }
    return unless(c, what);
}

FMI fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t count, const fmi3Boolean value[], size_t values)
{
    const char *what = values == count ? NULL : "all variables are scalars: as many values as references are wanted";
    size_t k;
    for (k = 0; k < count && what == NULL; ++k) {
        what = set_whole(&((instance *)c)->state, r[k], value[k]);
    }
    return unless(c, what);
}

${states}
FMI fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 point, fmi3Float64 size, fmi3Boolean final, fmi3Boolean *events,
    fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached)
{
    static const fmi3Status grades[] = { fmi3OK, fmi3Warning, fmi3Error };
    int grade;
    const char *what = advance_by(&((instance *)c)->state, point, size, &grade);
    (void)final;
    *events = false;
    *end = false;
    *early = false;
    *reached = now(&((instance *)c)->state);
    return said((const instance *)c, grades[grade], what);
}

/* Below are the types without variables, and functions that are not offered, as modelDescription.xml states. */
${refused}
