/* FMI 2.0 for Co-Simulation. Every variable is a Real. */
#include "fmi2Functions.h"

#include <stdlib.h>
#include <string.h>

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

typedef struct {
    Instance instance; /* first, so that a component is an instance */
    fmi2CallbackLogger log;
    char name[128];
} Component;

static COLD fmi2Status fail(const Component *c, const char *message) {
    if (c && c->log) c->log(c->instance.environment, c->name, fmi2Error, "logStatusError", "%s", message);
    return fmi2Error;
}

static fmi2Status status_of(const Component *c, const char *problem) { return problem ? fail(c, problem) : fmi2OK; }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    const char *problem = type != fmi2CoSimulation                ? "this FMU is for co-simulation only"
                          : !guid || strcmp(guid, model_guid) ? "the GUID is not that of this FMU"
                                                                 : NULL;
    if (problem) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError", "%s", problem);
        return NULL;
    }
    Component *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    if (name) strncpy(c->name, name, sizeof c->name - 1);
    if (callbacks) {
        c->instance.environment = callbacks->componentEnvironment;
        c->log = callbacks->logger;
    }
    instance_reset(&c->instance);
    return c;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop) {
    ((Component *)c)->instance.now.state.start_time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    Instance *m = c;
    return status_of(c, instance_enter(m, m->now.state.start_time));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return status_of(c, instance_exit(c)); }

fmi2Status fmi2Terminate(fmi2Component c) { return status_of(c, instance_end(c)); }

fmi2Status fmi2Reset(fmi2Component c) {
    instance_reset(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real values[]) {
    return status_of(c, instance_get(c, vr, n, values));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real values[]) {
    return status_of(c, instance_set(c, vr, n, values));
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_rollback) {
    return status_of(c, instance_step(c, time, step));
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { return status_of(c, snapshot_save(c, state)); }

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return status_of(c, snapshot_restore(c, state)); }

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (state) free(*state), *state = NULL;
    return fmi2OK;
}

/* There are no variables of other types: reading or writing none of them is all that can succeed. */
#define NONE_OF(name, Type, values)                                                     \
    fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, values) { \
        return n ? fail(c, "this FMU has no variables of type " #Type) : fmi2OK;        \
    }
#define NO_VARIABLES(Type)                            \
    NONE_OF(fmi2Get##Type, Type, fmi2##Type values[]) \
    NONE_OF(fmi2Set##Type, Type, const fmi2##Type values[])

NO_VARIABLES(Integer)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

/* The rest of the interface belongs to capabilities that modelDescription.xml does not claim. */
#define NOT_OFFERED(name, ...) \
    fmi2Status name(fmi2Component c, __VA_ARGS__) { return fail(c, #name " is not offered by this FMU"); }

fmi2Status fmi2CancelStep(fmi2Component c) { return fail(c, "steps are not asynchronous here"); }

NOT_OFFERED(fmi2GetDirectionalDerivative, const fmi2ValueReference unknown[], size_t n_unknown,
            const fmi2ValueReference known[], size_t n_known, const fmi2Real dv[], fmi2Real dz[])
NOT_OFFERED(fmi2SetRealInputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
            const fmi2Real values[])
NOT_OFFERED(fmi2GetRealOutputDerivatives, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
            fmi2Real values[])
NOT_OFFERED(fmi2SerializedFMUstateSize, fmi2FMUstate state, size_t *size)
NOT_OFFERED(fmi2SerializeFMUstate, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
NOT_OFFERED(fmi2DeSerializeFMUstate, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
NOT_OFFERED(fmi2GetStatus, const fmi2StatusKind kind, fmi2Status *value)
NOT_OFFERED(fmi2GetRealStatus, const fmi2StatusKind kind, fmi2Real *value)
NOT_OFFERED(fmi2GetIntegerStatus, const fmi2StatusKind kind, fmi2Integer *value)
NOT_OFFERED(fmi2GetBooleanStatus, const fmi2StatusKind kind, fmi2Boolean *value)
NOT_OFFERED(fmi2GetStringStatus, const fmi2StatusKind kind, fmi2String *value)
