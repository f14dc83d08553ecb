/* FMI 3.0 co-simulation of one agent: its observer and controller (dobc_agent.c) behind the functions of the standard.
 *
 * Samples are taken at start, start + DOBC_PERIOD, ...  A step from t to t + h takes those in [t, t + h) with the
 * inputs that hold at t; afterwards the outputs are those of the last sample.
 */
#include <stdlib.h>
#include <string.h>

#include "fmi3_types.h"
#include "dobc_agent.h"

#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter" /* the standard says which parameters there are */
#endif

#define TOKEN @TOKEN@
#define M DOBC_PACKET
#define P DOBC_INPUTS
#define HEARD @HEARD@ /* neighbours of this agent */
/* value references, as in modelDescription.xml */
#define TIME 0u
#define MODE 1u
#define X 2u
#define Y (X + DOBC_MEASURED)
#define PACKET (Y + M + 3 * P) /* after x, y, u, v and dhat */
#define END (PACKET + HEARD * M)

typedef struct {
    dobc_agent agent;
    dobc_output output;
    double start, time;
    double samples; /* taken so far */
    int mode;
    dobc_real x[DOBC_MEASURED], y[M];
    dobc_real packets[HEARD + 1][M];
} instance_t;

static void clear(instance_t *own)
{
    memset(own, 0, sizeof *own);
    dobc_init(&own->agent, &dobc_agents[0]);
}

static void sample(instance_t *own, dobc_agent *agent)
{
#if HEARD > 0
    int j;

    for (j = 0; j < HEARD; j++) {
        dobc_receive(agent, j, own->packets[j]);
    }
#endif
    dobc_set_mode(agent, own->mode);
    dobc_packet(agent, own->x, own->y);
    dobc_step(agent, own->x, &own->output);
}

/* The place of a real variable; 0 for one that is none. */
static dobc_real *place(instance_t *own, fmi3ValueReference reference)
{
    dobc_real *const parts[] = {own->output.u, own->output.v, own->output.dhat};
    const fmi3ValueReference outputs = Y + M;

    if (reference < X || reference >= END) {
        return 0;
    }
    if (reference < Y) {
        return own->x + (reference - X);
    }
    if (reference < outputs) {
        return own->y + (reference - Y);
    }
    if (reference < PACKET) {
        return parts[(reference - outputs) / P] + (reference - outputs) % P;
    }
    return own->packets[(reference - PACKET) / M] + (reference - PACKET) % M;
}

FMI3_EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

FMI3_EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t count,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    instance_t *own;

    if (token == 0 || strcmp(token, TOKEN) != 0) {
        if (log != 0) {
            log(environment, fmi3Error, "logStatusError", "The instantiation token is not that of this FMU.");
        }
        return 0;
    }
    own = (instance_t *)malloc(sizeof *own); /* the importer's side; the controller itself uses no heap */
    if (own != 0) {
        clear(own);
    }
    return own;
}

FMI3_EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

FMI3_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined,
                                                   fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stop_defined,
                                                   fmi3Float64 stop)
{
    instance_t *own = (instance_t *)instance;

    own->start = own->time = start;
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    instance_t *own = (instance_t *)instance;
    dobc_agent preview = own->agent; /* outputs of the first sample; the first step takes it in earnest */

    sample(own, &preview);
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    clear((instance_t *)instance);
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 point, fmi3Float64 step, fmi3Boolean no_return,
                                  fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    instance_t *own = (instance_t *)instance;
    double end = point + step;

    if (!(step >= 0)) {
        return fmi3Error;
    }
    /* A sample that is due at the end, but for rounding, belongs to the next step. */
    while (own->start + own->samples * DOBC_PERIOD < end - 1e-6 * DOBC_PERIOD) {
        sample(own, &own->agent);
        own->samples += 1;
    }
    own->time = end;
    *event = false;
    *terminate = false;
    *early = false;
    *last = end;
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                                      fmi3Float64 values[], size_t size)
{
    instance_t *own = (instance_t *)instance;
    size_t i;

    if (size != count) {
        return fmi3Error;
    }
#ifndef DOBC_ESTIMATED /* estimated states are those of the last sample */
    dobc_packet(&own->agent, own->x, own->y);
#endif
    for (i = 0; i < count; i++) {
        const dobc_real *found = place(own, references[i]);

        if (found == 0 && references[i] != TIME) {
            return fmi3Error;
        }
        values[i] = found == 0 ? own->time : *found;
    }
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                                      const fmi3Float64 values[], size_t size)
{
    instance_t *own = (instance_t *)instance;
    size_t i;

    if (size != count) {
        return fmi3Error;
    }
    for (i = 0; i < count; i++) {
        fmi3ValueReference reference = references[i];
        dobc_real *found = (reference >= X && reference < Y) || reference >= PACKET ? place(own, reference) : 0;

        if (found == 0) {
            return fmi3Error;
        }
        /* NaN and infinity too: dobc_step and dobc_receive skip bad inputs and count them, see dobc_agent.h. */
        *found = (dobc_real)values[i];
    }
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                                    fmi3Int32 values[], size_t size)
{
    const instance_t *own = (const instance_t *)instance;
    size_t i;

    for (i = 0; i < count; i++) {
        if (size != count || references[i] != MODE) {
            return fmi3Error;
        }
        values[i] = own->mode;
    }
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3SetInt32(fmi3Instance instance, const fmi3ValueReference references[], size_t count,
                                    const fmi3Int32 values[], size_t size)
{
    instance_t *own = (instance_t *)instance;
    size_t i;

    for (i = 0; i < count; i++) {
        if (size != count || references[i] != MODE || values[i] < 0 || values[i] >= DOBC_MODES) {
            return fmi3Error;
        }
        own->mode = values[i];
    }
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    if (*state == 0) {
        *state = malloc(sizeof(instance_t));
    }
    if (*state == 0) {
        return fmi3Error;
    }
    memcpy(*state, instance, sizeof(instance_t));
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    memcpy(instance, state, sizeof(instance_t));
    return fmi3OK;
}

FMI3_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    free(*state);
    *state = 0;
    return fmi3OK;
}

/* What the standard names and this FMU has no use for. */
@STUBS@
