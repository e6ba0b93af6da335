/* The functions of FMI 2.0.5, model exchange and co-simulation. Only numbers are set and read: all is Real. */
#include "kaneflex_fmu.h"

#include <stdlib.h>
#include <string.h>

#ifdef KANEFLEX_FMI_HEADER /* the standard's own declarations, to compare with */
#include KANEFLEX_FMI_HEADER
#else
typedef void *fmi2Component;
typedef void *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(void *environment, fmi2String instance, fmi2Status status, fmi2String category, fmi2String message, ...);
    void *(*allocateMemory)(size_t count, size_t size);
    void (*freeMemory)(void *memory);
    void (*stepFinished)(void *environment, fmi2Status status);
    void *componentEnvironment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged;
    fmi2Boolean valuesOfContinuousStatesChanged, nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;
#endif

#ifdef _WIN32
#define OUT __declspec(dllexport)
#else
#define OUT __attribute__((visibility("default")))
#endif

typedef struct {
    kaneflex_instance *instance;
    const fmi2CallbackFunctions *callbacks;
    char *name;
} component;

static fmi2Status said(component *c, int ended)
{
    if (!ended)
        return fmi2OK;
    if (c->callbacks && c->callbacks->logger)
        c->callbacks->logger(c->callbacks->componentEnvironment, c->name, fmi2Error, "logStatusError", "%s",
                             kaneflex_message(ended));
    return fmi2Error;
}

#define INSTANCE(c) (((component *)(c))->instance)
#define UNUSED(x) (void)(x)

OUT const char *fmi2GetTypesPlatform(void) { return "default"; }
OUT const char *fmi2GetVersion(void) { return "2.0"; }
OUT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count, const fmi2String categories[])
{
    UNUSED(c), UNUSED(on), UNUSED(count), UNUSED(categories);
    return fmi2OK;
}

OUT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                  const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean on)
{
    UNUSED(resources), UNUSED(visible), UNUSED(on);
    component *c = guid && !strcmp(guid, kaneflex_fmu.token) ? calloc(1, sizeof(component)) : NULL;
    if (!c)
        return NULL;
    c->instance = kaneflex_make(type == fmi2CoSimulation);
    c->name = malloc(name ? strlen(name) + 1 : 1);
    if (!c->instance || !c->name) {
        free(c->instance), free(c->name), free(c);
        return NULL;
    }
    strcpy(c->name, name ? name : "");
    c->callbacks = functions;
    return c;
}

OUT void fmi2FreeInstance(fmi2Component c)
{
    if (c)
        free(INSTANCE(c)), free(((component *)c)->name), free(c);
}

OUT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerant, fmi2Real tolerance, fmi2Real start,
                                   fmi2Boolean ends, fmi2Real stop)
{
    UNUSED(tolerant), UNUSED(tolerance), UNUSED(ends), UNUSED(stop);
    return start == 0.0 ? fmi2OK : said(c, KANEFLEX_TOO_EARLY);
}

OUT fmi2Status fmi2EnterInitializationMode(fmi2Component c) { UNUSED(c); return fmi2OK; }
OUT fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return said(c, kaneflex_begin(INSTANCE(c))); }
OUT fmi2Status fmi2Terminate(fmi2Component c) { UNUSED(c); return fmi2OK; }
OUT fmi2Status fmi2Reset(fmi2Component c) { return said(c, kaneflex_reset(INSTANCE(c))); }

OUT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, fmi2Real value[])
{
    return said(c, kaneflex_get(INSTANCE(c), vr, count, value));
}

OUT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count, const fmi2Real value[])
{
    return said(c, kaneflex_set(INSTANCE(c), vr, count, value));
}

/* There are no variables of other types. */
#define NONE(Type, type)                                                                                          \
    OUT fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t count, type value[])      \
    {                                                                                                             \
        UNUSED(vr), UNUSED(value);                                                                                \
        return said(c, count ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                                   \
    }                                                                                                             \
    OUT fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t count, const type value[]) \
    {                                                                                                             \
        UNUSED(vr), UNUSED(value);                                                                                \
        return said(c, count ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                                   \
    }
NONE(Integer, fmi2Integer)
NONE(Boolean, fmi2Boolean)
NONE(String, fmi2String)

OUT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (*state)
        kaneflex_restore(*state, INSTANCE(c));
    else
        *state = kaneflex_copy(INSTANCE(c));
    return *state ? fmi2OK : fmi2Error;
}

OUT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    kaneflex_restore(INSTANCE(c), state);
    return fmi2OK;
}

OUT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    UNUSED(c);
    free(*state);
    *state = NULL;
    return fmi2OK;
}

OUT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    UNUSED(state), UNUSED(size);
    return said(c, KANEFLEX_NOT_OFFERED);
}

OUT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    UNUSED(state), UNUSED(bytes), UNUSED(size);
    return said(c, KANEFLEX_NOT_OFFERED);
}

OUT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    UNUSED(bytes), UNUSED(size), UNUSED(state);
    return said(c, KANEFLEX_NOT_OFFERED);
}

OUT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                            const fmi2ValueReference known[], size_t knowns, const fmi2Real by[],
                                            fmi2Real out[])
{
    UNUSED(unknown), UNUSED(unknowns), UNUSED(known), UNUSED(knowns), UNUSED(by), UNUSED(out);
    return said(c, KANEFLEX_NOT_OFFERED);
}

/* ---- model exchange ---- */

OUT fmi2Status fmi2EnterEventMode(fmi2Component c) { UNUSED(c); return fmi2OK; }

OUT fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    UNUSED(c);
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

OUT fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { UNUSED(c); return fmi2OK; }

OUT fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean final, fmi2Boolean *event, fmi2Boolean *end)
{
    UNUSED(c), UNUSED(final);
    *event = *end = 0;
    return fmi2OK;
}

OUT fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    INSTANCE(c)->time = time;
    INSTANCE(c)->stale = 1;
    return fmi2OK;
}

OUT fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t count)
{
    UNUSED(count);
    kaneflex_set_states(INSTANCE(c), x);
    return fmi2OK;
}

OUT fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real out[], size_t count)
{
    UNUSED(count);
    return said(c, kaneflex_derivatives(INSTANCE(c), out));
}

OUT fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real out[], size_t count)
{
    UNUSED(c), UNUSED(out), UNUSED(count);
    return fmi2OK;
}

OUT fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t count)
{
    UNUSED(count);
    kaneflex_get_states(INSTANCE(c), x);
    return fmi2OK;
}

OUT fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t count)
{
    UNUSED(c);
    for (size_t i = 0; i < count; i++)
        x[i] = 1.0;
    return fmi2OK;
}

/* ---- co-simulation ---- */

OUT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                           const fmi2Integer order[], const fmi2Real value[])
{
    UNUSED(vr), UNUSED(count), UNUSED(order), UNUSED(value);
    return said(c, KANEFLEX_NOT_OFFERED);
}

OUT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                            const fmi2Integer order[], fmi2Real value[])
{
    UNUSED(vr), UNUSED(count), UNUSED(order), UNUSED(value);
    return said(c, KANEFLEX_NOT_OFFERED);
}

OUT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real from, fmi2Real step, fmi2Boolean final)
{
    UNUSED(final);
    return said(c, kaneflex_advance(INSTANCE(c), from + step));
}

OUT fmi2Status fmi2CancelStep(fmi2Component c) { return said(c, KANEFLEX_NOT_OFFERED); }

#define STATUS(Name, type)                                                                       \
    OUT fmi2Status fmi2Get##Name##Status(fmi2Component c, const fmi2StatusKind kind, type *value) \
    {                                                                                            \
        UNUSED(c), UNUSED(kind), UNUSED(value);                                                  \
        return fmi2Discard; /* every step has ended when it returns */                           \
    }
STATUS(, fmi2Status)
STATUS(Integer, fmi2Integer)
STATUS(Boolean, fmi2Boolean)
STATUS(String, fmi2String)

OUT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = INSTANCE(c)->time;
    return fmi2OK;
}
