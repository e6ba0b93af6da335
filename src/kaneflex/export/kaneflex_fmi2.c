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

typedef fmi2Component handle;
typedef fmi2Status status;
typedef fmi2Real real;
typedef fmi2Boolean boolean;
typedef fmi2String string;

typedef struct {
    kaneflex_instance *instance;
    const fmi2CallbackFunctions *callbacks;
    char *name;
} component;

static status said(component *c, int ended)
{
    if (!ended)
        return fmi2OK;
    if (c->callbacks && c->callbacks->logger)
        c->callbacks->logger(c->callbacks->componentEnvironment, c->name, fmi2Error, "logStatusError", "%s",
                             kaneflex_message(ended));
    return fmi2Error;
}

#ifdef _WIN32
#define OUT __declspec(dllexport)
#else
#define OUT __attribute__((visibility("default")))
#endif

#if defined __GNUC__ /* the standard hands over much that nothing here asks for */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define INSTANCE(c) (((component *)(c))->instance)

/* What is not offered. */
#define REFUSED(Name, ...)                                                                       \
    OUT status fmi2##Name(handle c, __VA_ARGS__) { return said(c, KANEFLEX_NOT_OFFERED); }

OUT status fmi2SetDebugLogging(handle c, boolean on, size_t count, const string categories[]) { return fmi2OK; }
OUT status fmi2ExitInitializationMode(handle c) { return said(c, kaneflex_begin(INSTANCE(c))); }
OUT status fmi2EnterEventMode(handle c) { return fmi2OK; }
OUT status fmi2Terminate(handle c) { return fmi2OK; }
OUT status fmi2Reset(handle c) { return said(c, kaneflex_reset(INSTANCE(c))); }

OUT status fmi2GetFMUstate(handle c, fmi2FMUstate *state)
{
    if (*state)
        kaneflex_restore(*state, INSTANCE(c));
    else
        *state = kaneflex_copy(INSTANCE(c));
    return *state ? fmi2OK : fmi2Error;
}

OUT status fmi2SetFMUstate(handle c, fmi2FMUstate state)
{
    kaneflex_restore(INSTANCE(c), state);
    return fmi2OK;
}

OUT status fmi2FreeFMUstate(handle c, fmi2FMUstate *state)
{
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* ---- model exchange ---- */

OUT status fmi2EnterContinuousTimeMode(handle c) { return fmi2OK; }

OUT status fmi2CompletedIntegratorStep(handle c, boolean final, boolean *event, boolean *end)
{
    *event = *end = 0;
    return fmi2OK;
}

OUT status fmi2SetTime(handle c, real time)
{
    INSTANCE(c)->time = time;
    INSTANCE(c)->stale = 1;
    return fmi2OK;
}

OUT status fmi2SetContinuousStates(handle c, const real x[], size_t count)
{
    kaneflex_set_states(INSTANCE(c), x);
    return fmi2OK;
}

OUT status fmi2GetDerivatives(handle c, real out[], size_t count)
{
    return said(c, kaneflex_derivatives(INSTANCE(c), out));
}

OUT status fmi2GetEventIndicators(handle c, real out[], size_t count) { return fmi2OK; }

OUT status fmi2GetContinuousStates(handle c, real x[], size_t count)
{
    kaneflex_get_states(INSTANCE(c), x);
    return fmi2OK;
}

OUT status fmi2GetNominalsOfContinuousStates(handle c, real x[], size_t count)
{
    for (size_t i = 0; i < count; i++)
        x[i] = 1.0;
    return fmi2OK;
}

OUT const char *fmi2GetTypesPlatform(void) { return "default"; }
OUT const char *fmi2GetVersion(void) { return "2.0"; }

OUT handle fmi2Instantiate(string name, fmi2Type type, string guid, string resources,
                           const fmi2CallbackFunctions *functions, boolean visible, boolean on)
{
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

OUT void fmi2FreeInstance(handle c)
{
    if (c)
        free(INSTANCE(c)), free(((component *)c)->name), free(c);
}

OUT status fmi2SetupExperiment(handle c, boolean tolerant, real tolerance, real start, boolean ends, real stop)
{
    return start == 0.0 ? fmi2OK : said(c, KANEFLEX_TOO_EARLY);
}

OUT status fmi2EnterInitializationMode(handle c) { return fmi2OK; }

OUT status fmi2GetReal(handle c, const fmi2ValueReference vr[], size_t count, real value[])
{
    return said(c, kaneflex_get(INSTANCE(c), vr, count, value));
}

OUT status fmi2SetReal(handle c, const fmi2ValueReference vr[], size_t count, const real value[])
{
    return said(c, kaneflex_set(INSTANCE(c), vr, count, value));
}

/* There are no variables of other types. */
#define NONE(Type)                                                                                               \
    OUT status fmi2Get##Type(handle c, const fmi2ValueReference vr[], size_t count, fmi2##Type value[])          \
    {                                                                                                            \
        return said(c, count ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                                  \
    }                                                                                                            \
    OUT status fmi2Set##Type(handle c, const fmi2ValueReference vr[], size_t count, const fmi2##Type value[])    \
    {                                                                                                            \
        return said(c, count ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                                  \
    }
NONE(Integer)
NONE(Boolean)
NONE(String)

REFUSED(SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
REFUSED(SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
REFUSED(DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
REFUSED(GetDirectionalDerivative, const fmi2ValueReference unknown[], size_t unknowns, const fmi2ValueReference known[],
        size_t knowns, const real by[], real out[])
REFUSED(SetRealInputDerivatives, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[],
        const real value[])
REFUSED(GetRealOutputDerivatives, const fmi2ValueReference vr[], size_t count, const fmi2Integer order[], real value[])
OUT status fmi2CancelStep(handle c) { return said(c, KANEFLEX_NOT_OFFERED); }

OUT status fmi2NewDiscreteStates(handle c, fmi2EventInfo *info)
{
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

/* ---- co-simulation ---- */

OUT status fmi2DoStep(handle c, real from, real step, boolean final)
{
    return said(c, kaneflex_advance(INSTANCE(c), from + step));
}

/* Every step has ended when it returns. */
#define STATUS(Name, type) \
    OUT status fmi2Get##Name##Status(handle c, const fmi2StatusKind kind, type *value) { return fmi2Discard; }
STATUS(, fmi2Status)
STATUS(Integer, fmi2Integer)
STATUS(Boolean, fmi2Boolean)
STATUS(String, fmi2String)

OUT status fmi2GetRealStatus(handle c, const fmi2StatusKind kind, real *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    *value = INSTANCE(c)->time;
    return fmi2OK;
}
