/* The functions of FMI 3.0, model exchange and co-simulation. Only numbers are set and read: all is Float64. */
#include "kaneflex_fmu.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifdef KANEFLEX_FMI_HEADER /* the standard's own declarations, to compare with */
#include KANEFLEX_FMI_HEADER
#else
typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent, fmi3Constant, fmi3Fixed, fmi3Tunable, fmi3Discrete, fmi3Dependent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown, fmi3IntervalUnchanged, fmi3IntervalChanged } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String category, fmi3String message);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
#endif

typedef fmi3Instance handle;
typedef fmi3FMUState kept_state;
typedef fmi3Status status;
typedef fmi3Float64 real;
typedef fmi3Boolean boolean;
typedef fmi3String string;
#define FMI(Name) fmi3##Name
#define FMI_STATE(verb) fmi3##verb##FMUState
#define FMI_DERIVATIVES fmi3GetContinuousStateDerivatives

typedef struct {
    kaneflex_instance *instance;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} component;

static status said(component *c, int ended)
{
    if (!ended)
        return fmi3OK;
    if (c->log)
        c->log(c->environment, fmi3Error, "logStatusError", kaneflex_message(ended));
    return fmi3Error;
}

#include "kaneflex_fmi.h"
#define REFERENCES const fmi3ValueReference vr[], size_t nvr

OUT const char *fmi3GetVersion(void) { return "3.0"; }

static handle made(int steps_itself, string token, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    component *c = token && !strcmp(token, kaneflex_fmu.token) ? calloc(1, sizeof(component)) : NULL;
    if (!c)
        return NULL;
    c->environment = environment;
    c->log = log;
    c->instance = kaneflex_make(steps_itself);
    if (c->instance)
        return c;
    free(c);
    return NULL;
}

OUT handle fmi3InstantiateModelExchange(string name, string token, string resources, boolean visible, boolean on,
                                        fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    return made(0, token, environment, log);
}

OUT handle fmi3InstantiateCoSimulation(string name, string token, string resources, boolean visible, boolean on,
                                       boolean events, boolean early, REFERENCES, fmi3InstanceEnvironment environment,
                                       fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    return events || nvr ? NULL : made(1, token, environment, log); /* neither is offered */
}

OUT handle fmi3InstantiateScheduledExecution(string name, string token, string resources, boolean visible, boolean on,
                                             fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                             fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                             fmi3UnlockPreemptionCallback unlock)
{
    return NULL;
}

OUT void fmi3FreeInstance(handle c)
{
    if (c)
        free(INSTANCE(c)), free(c);
}

OUT status fmi3EnterInitializationMode(handle c, boolean tolerant, real tolerance, real start, boolean ends, real stop)
{
    return start == 0.0 ? fmi3OK : said(c, KANEFLEX_TOO_EARLY);
}

OUT status fmi3GetFloat64(handle c, REFERENCES, real values[], size_t count)
{
    return said(c, count == nvr ? kaneflex_get(INSTANCE(c), vr, nvr, values) : KANEFLEX_UNKNOWN);
}

OUT status fmi3SetFloat64(handle c, REFERENCES, const real values[], size_t count)
{
    return said(c, count == nvr ? kaneflex_set(INSTANCE(c), vr, nvr, values) : KANEFLEX_UNKNOWN);
}

/* There are no variables of other types. */
#define NONE(Type)                                                                              \
    OUT status fmi3Get##Type(handle c, REFERENCES, fmi3##Type values[], size_t count)           \
    {                                                                                           \
        return said(c, nvr ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                   \
    }                                                                                           \
    OUT status fmi3Set##Type(handle c, REFERENCES, const fmi3##Type values[], size_t count)     \
    {                                                                                           \
        return said(c, nvr ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                   \
    }
NONE(Float32)
NONE(Int8)
NONE(UInt8)
NONE(Int16)
NONE(UInt16)
NONE(Int32)
NONE(UInt32)
NONE(Int64)
NONE(UInt64)
NONE(Boolean)
NONE(String)

REFUSED(GetBinary, REFERENCES, size_t sizes[], fmi3Binary values[], size_t count)
REFUSED(SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t count)
REFUSED(GetClock, REFERENCES, fmi3Clock values[])
REFUSED(SetClock, REFERENCES, const fmi3Clock values[])
REFUSED(GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *count)
REFUSED(GetVariableDependencies, fmi3ValueReference dependent, size_t of_dependent[], fmi3ValueReference independents[],
        size_t of_independents[], fmi3DependencyKind kinds[], size_t count)
REFUSED(SerializedFMUStateSize, fmi3FMUState state, size_t *size)
REFUSED(SerializeFMUState, fmi3FMUState state, fmi3Byte bytes[], size_t size)
REFUSED(DeserializeFMUState, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
REFUSED(GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t count, const fmi3ValueReference knowns[],
        size_t known, const real seed[], size_t seeds, real out[], size_t outs)
REFUSED(GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t count, const fmi3ValueReference knowns[],
        size_t known, const real seed[], size_t seeds, real out[], size_t outs)
REFUSED(GetIntervalDecimal, REFERENCES, real intervals[], fmi3IntervalQualifier qualifiers[])
REFUSED(GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
        fmi3IntervalQualifier qualifiers[])
REFUSED(GetShiftDecimal, REFERENCES, real shifts[])
REFUSED(GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
REFUSED(SetIntervalDecimal, REFERENCES, const real intervals[])
REFUSED(SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
REFUSED(SetShiftDecimal, REFERENCES, const real shifts[])
REFUSED(SetShiftFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
REFUSED(GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], real values[], size_t count)
REFUSED(ActivateModelPartition, fmi3ValueReference clock, real time)
OUT status fmi3EnterConfigurationMode(handle c) { return said(c, KANEFLEX_NOT_OFFERED); }
OUT status fmi3ExitConfigurationMode(handle c) { return said(c, KANEFLEX_NOT_OFFERED); }

OUT status fmi3EvaluateDiscreteStates(handle c) { return fmi3OK; }

OUT status fmi3UpdateDiscreteStates(handle c, boolean *again, boolean *end, boolean *nominals, boolean *values,
                                    boolean *defined, real *next)
{
    *again = *end = *nominals = *values = *defined = false;
    return fmi3OK;
}

OUT status fmi3GetNumberOfEventIndicators(handle c, size_t *count)
{
    *count = 0;
    return fmi3OK;
}

OUT status fmi3GetNumberOfContinuousStates(handle c, size_t *count)
{
    *count = 2 * kaneflex_fmu.linear->n;
    return fmi3OK;
}

/* ---- co-simulation ---- */

OUT status fmi3EnterStepMode(handle c) { return fmi3OK; }

OUT status fmi3DoStep(handle c, real from, real step, boolean final, boolean *event, boolean *end, boolean *early,
                      real *last)
{
    const status ended = said(c, kaneflex_advance(INSTANCE(c), from + step));
    *event = *end = *early = false;
    *last = INSTANCE(c)->time;
    return ended;
}
