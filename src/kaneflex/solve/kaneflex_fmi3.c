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

#ifdef _WIN32
#define OUT __declspec(dllexport)
#else
#define OUT __attribute__((visibility("default")))
#endif

typedef struct {
    kaneflex_instance *instance;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} component;

static fmi3Status said(component *c, int ended)
{
    if (!ended)
        return fmi3OK;
    if (c->log)
        c->log(c->environment, fmi3Error, "logStatusError", kaneflex_message(ended));
    return fmi3Error;
}

#define INSTANCE(c) (((component *)(c))->instance)
#define UNUSED(x) (void)(x)
#define REFERENCES const fmi3ValueReference vr[], size_t nvr

OUT const char *fmi3GetVersion(void) { return "3.0"; }
OUT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count, const fmi3String categories[])
{
    UNUSED(c), UNUSED(on), UNUSED(count), UNUSED(categories);
    return fmi3OK;
}

static fmi3Instance made(int steps_itself, fmi3String token, fmi3InstanceEnvironment environment,
                         fmi3LogMessageCallback log)
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

OUT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                              fmi3Boolean on, fmi3InstanceEnvironment environment,
                                              fmi3LogMessageCallback log)
{
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(on);
    return made(0, token, environment, log);
}

OUT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                             fmi3Boolean on, fmi3Boolean events, fmi3Boolean early, REFERENCES,
                                             fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                             fmi3IntermediateUpdateCallback update)
{
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(on), UNUSED(early), UNUSED(vr), UNUSED(update);
    return events || nvr ? NULL : made(1, token, environment, log); /* neither is offered */
}

OUT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                   fmi3Boolean visible, fmi3Boolean on,
                                                   fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                   fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                                   fmi3UnlockPreemptionCallback unlock)
{
    UNUSED(name), UNUSED(token), UNUSED(resources), UNUSED(visible), UNUSED(on), UNUSED(environment), UNUSED(log);
    UNUSED(update), UNUSED(lock), UNUSED(unlock);
    return NULL;
}

OUT void fmi3FreeInstance(fmi3Instance c)
{
    if (c)
        free(INSTANCE(c)), free(c);
}

OUT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerant, fmi3Float64 tolerance, fmi3Float64 start,
                                           fmi3Boolean ends, fmi3Float64 stop)
{
    UNUSED(tolerant), UNUSED(tolerance), UNUSED(ends), UNUSED(stop);
    return start == 0.0 ? fmi3OK : said(c, KANEFLEX_TOO_EARLY);
}

OUT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return said(c, kaneflex_begin(INSTANCE(c))); }
OUT fmi3Status fmi3EnterEventMode(fmi3Instance c) { UNUSED(c); return fmi3OK; }
OUT fmi3Status fmi3Terminate(fmi3Instance c) { UNUSED(c); return fmi3OK; }
OUT fmi3Status fmi3Reset(fmi3Instance c) { return said(c, kaneflex_reset(INSTANCE(c))); }

OUT fmi3Status fmi3GetFloat64(fmi3Instance c, REFERENCES, fmi3Float64 values[], size_t count)
{
    return said(c, count == nvr ? kaneflex_get(INSTANCE(c), vr, nvr, values) : KANEFLEX_UNKNOWN);
}

OUT fmi3Status fmi3SetFloat64(fmi3Instance c, REFERENCES, const fmi3Float64 values[], size_t count)
{
    return said(c, count == nvr ? kaneflex_set(INSTANCE(c), vr, nvr, values) : KANEFLEX_UNKNOWN);
}

/* There are no variables of other types. */
#define NONE(Type)                                                                                                  \
    OUT fmi3Status fmi3Get##Type(fmi3Instance c, REFERENCES, fmi3##Type values[], size_t count)                     \
    {                                                                                                               \
        UNUSED(vr), UNUSED(values), UNUSED(count);                                                                  \
        return said(c, nvr ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                                       \
    }                                                                                                               \
    OUT fmi3Status fmi3Set##Type(fmi3Instance c, REFERENCES, const fmi3##Type values[], size_t count)               \
    {                                                                                                               \
        UNUSED(vr), UNUSED(values), UNUSED(count);                                                                  \
        return said(c, nvr ? KANEFLEX_UNKNOWN : KANEFLEX_OK);                                                       \
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

/* What is not offered, with all its arguments unused. */
#define REFUSED(name, ...)                   \
    OUT fmi3Status name(fmi3Instance c, __VA_ARGS__) \
    {                                        \
        return said(c, KANEFLEX_NOT_OFFERED); \
    }
#if defined __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
REFUSED(fmi3GetBinary, REFERENCES, size_t sizes[], fmi3Binary values[], size_t count)
REFUSED(fmi3SetBinary, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t count)
REFUSED(fmi3GetClock, REFERENCES, fmi3Clock values[])
REFUSED(fmi3SetClock, REFERENCES, const fmi3Clock values[])
REFUSED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *count)
REFUSED(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t of_dependent[], fmi3ValueReference independents[],
        size_t of_independents[], fmi3DependencyKind kinds[], size_t count)
REFUSED(fmi3SerializedFMUStateSize, fmi3FMUState state, size_t *size)
REFUSED(fmi3SerializeFMUState, fmi3FMUState state, fmi3Byte bytes[], size_t size)
REFUSED(fmi3DeserializeFMUState, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
REFUSED(fmi3GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t count, const fmi3ValueReference knowns[],
        size_t known, const fmi3Float64 seed[], size_t seeds, fmi3Float64 out[], size_t outs)
REFUSED(fmi3GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t count, const fmi3ValueReference knowns[],
        size_t known, const fmi3Float64 seed[], size_t seeds, fmi3Float64 out[], size_t outs)
REFUSED(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
REFUSED(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
        fmi3IntervalQualifier qualifiers[])
REFUSED(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shifts[])
REFUSED(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
REFUSED(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 intervals[])
REFUSED(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
REFUSED(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shifts[])
REFUSED(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
REFUSED(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t count)
REFUSED(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
#if defined __GNUC__
#pragma GCC diagnostic pop
#endif
OUT fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) { return said(c, KANEFLEX_NOT_OFFERED); }
OUT fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) { return said(c, KANEFLEX_NOT_OFFERED); }

OUT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    if (*state)
        kaneflex_restore(*state, INSTANCE(c));
    else
        *state = kaneflex_copy(INSTANCE(c));
    return *state ? fmi3OK : fmi3Error;
}

OUT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    kaneflex_restore(INSTANCE(c), state);
    return fmi3OK;
}

OUT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    UNUSED(c);
    free(*state);
    *state = NULL;
    return fmi3OK;
}

OUT fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) { UNUSED(c); return fmi3OK; }

OUT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                        fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next)
{
    UNUSED(c), UNUSED(next);
    *again = *end = *nominals = *values = *defined = false;
    return fmi3OK;
}

/* ---- model exchange ---- */

OUT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { UNUSED(c); return fmi3OK; }

OUT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean final, fmi3Boolean *event, fmi3Boolean *end)
{
    UNUSED(c), UNUSED(final);
    *event = *end = false;
    return fmi3OK;
}

OUT fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    INSTANCE(c)->time = time;
    INSTANCE(c)->stale = 1;
    return fmi3OK;
}

OUT fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t count)
{
    UNUSED(count);
    kaneflex_set_states(INSTANCE(c), x);
    return fmi3OK;
}

OUT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 out[], size_t count)
{
    UNUSED(count);
    return said(c, kaneflex_derivatives(INSTANCE(c), out));
}

OUT fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 out[], size_t count)
{
    UNUSED(c), UNUSED(out), UNUSED(count);
    return fmi3OK;
}

OUT fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t count)
{
    UNUSED(count);
    kaneflex_get_states(INSTANCE(c), x);
    return fmi3OK;
}

OUT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t count)
{
    UNUSED(c);
    for (size_t i = 0; i < count; i++)
        x[i] = 1.0;
    return fmi3OK;
}

OUT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *count)
{
    UNUSED(c);
    *count = 0;
    return fmi3OK;
}

OUT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *count)
{
    UNUSED(c);
    *count = 2 * kaneflex_fmu.linear->n;
    return fmi3OK;
}

/* ---- co-simulation ---- */

OUT fmi3Status fmi3EnterStepMode(fmi3Instance c) { UNUSED(c); return fmi3OK; }

OUT fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 from, fmi3Float64 step, fmi3Boolean final, fmi3Boolean *event,
                          fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last)
{
    UNUSED(final);
    const fmi3Status status = said(c, kaneflex_advance(INSTANCE(c), from + step));
    *event = *end = *early = false;
    *last = INSTANCE(c)->time;
    return status;
}
