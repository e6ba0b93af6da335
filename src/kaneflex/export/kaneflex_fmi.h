/* What FMI 2.0 and 3.0 ask for alike, in the words of the version whose file includes this.
 *
 * That has the types handle, kept_state, status, real, boolean and string, its component with said(), and FMI(Name),
 * which puts its prefix before a name. */
#ifndef KANEFLEX_FMI_H
#define KANEFLEX_FMI_H

#ifdef _WIN32
#define OUT __declspec(dllexport)
#else
#define OUT __attribute__((visibility("default")))
#endif

#if defined __GNUC__ /* the standards hand over much that nothing here asks for */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

#define INSTANCE(c) (((component *)(c))->instance)

/* What is not offered. */
#define REFUSED(Name, ...)                                                                       \
    OUT status FMI(Name)(handle c, __VA_ARGS__) { return said(c, KANEFLEX_NOT_OFFERED); }

OUT status FMI(SetDebugLogging)(handle c, boolean on, size_t count, const string categories[]) { return FMI(OK); }
OUT status FMI(ExitInitializationMode)(handle c) { return said(c, kaneflex_begin(INSTANCE(c))); }
OUT status FMI(EnterEventMode)(handle c) { return FMI(OK); }
OUT status FMI(Terminate)(handle c) { return FMI(OK); }
OUT status FMI(Reset)(handle c) { return said(c, kaneflex_reset(INSTANCE(c))); }

OUT status FMI_STATE(Get)(handle c, kept_state *state)
{
    if (*state)
        kaneflex_restore(*state, INSTANCE(c));
    else
        *state = kaneflex_copy(INSTANCE(c));
    return *state ? FMI(OK) : FMI(Error);
}

OUT status FMI_STATE(Set)(handle c, kept_state state)
{
    kaneflex_restore(INSTANCE(c), state);
    return FMI(OK);
}

OUT status FMI_STATE(Free)(handle c, kept_state *state)
{
    free(*state);
    *state = NULL;
    return FMI(OK);
}

/* ---- model exchange ---- */

OUT status FMI(EnterContinuousTimeMode)(handle c) { return FMI(OK); }

OUT status FMI(CompletedIntegratorStep)(handle c, boolean final, boolean *event, boolean *end)
{
    *event = *end = 0;
    return FMI(OK);
}

OUT status FMI(SetTime)(handle c, real time)
{
    INSTANCE(c)->time = time;
    INSTANCE(c)->stale = 1;
    return FMI(OK);
}

OUT status FMI(SetContinuousStates)(handle c, const real x[], size_t count)
{
    kaneflex_set_states(INSTANCE(c), x);
    return FMI(OK);
}

OUT status FMI_DERIVATIVES(handle c, real out[], size_t count)
{
    return said(c, kaneflex_derivatives(INSTANCE(c), out));
}

OUT status FMI(GetEventIndicators)(handle c, real out[], size_t count) { return FMI(OK); }

OUT status FMI(GetContinuousStates)(handle c, real x[], size_t count)
{
    kaneflex_get_states(INSTANCE(c), x);
    return FMI(OK);
}

OUT status FMI(GetNominalsOfContinuousStates)(handle c, real x[], size_t count)
{
    for (size_t i = 0; i < count; i++)
        x[i] = 1.0;
    return FMI(OK);
}

#endif
