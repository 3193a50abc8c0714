/* FMI 3.0 for Co-Simulation. Every variable is a Float64: a scalar, or an array, whose value reference is NV or more. */
#include "fmi3Functions.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

typedef struct {
    Instance instance; /* first, so that a component is an instance */
    fmi3LogMessageCallback log;
} Component;

static COLD fmi3Status fail(const Component *m, const char *message) {
    if (m && m->log) m->log(m->instance.environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static fmi3Status status_of(const Component *m, const char *problem) { return problem ? fail(m, problem) : fmi3OK; }

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    if (!token || strcmp(token, model_token)) {
        if (log) log(environment, fmi3Error, "logStatusError", "the instantiation token is not that of this FMU");
        return NULL;
    }
    Component *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->instance.environment = environment;
    m->log = log;
    instance_reset(&m->instance);
    return m;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback clock_update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance m, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop) {
    return status_of(m, instance_enter(m, start));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance m) { return status_of(m, instance_exit(m)); }

fmi3Status fmi3Terminate(fmi3Instance m) { return status_of(m, instance_end(m)); }

fmi3Status fmi3Reset(fmi3Instance m) {
    instance_reset(m);
    return fmi3OK;
}

static int is_array(fmi3ValueReference vr) { return vr >= NV && vr < NV + NA; }

/* The value references of all n_values elements of n variables, to be freed; NULL if they have more or less. */
static uint32_t *elements(const fmi3ValueReference vr[], size_t n, size_t n_values) {
    uint32_t *all = malloc((n_values + 1) * sizeof *all); /* none of none is no NULL */
    size_t at = 0, i = 0;
    for (; all && i < n; i++) {
        uint32_t first = is_array(vr[i]) ? model_arrays[vr[i] - NV][0] : vr[i];
        size_t count = is_array(vr[i]) ? model_arrays[vr[i] - NV][1] : 1;
        if (count > n_values - at) break;
        while (count--) all[at++] = first++;
    }
    if (i == n && at == n_values) return all;
    free(all);
    return NULL;
}

static COLD fmi3Status miscounted(const Component *m, const char *function) {
    char message[128];
    snprintf(message, sizeof message, "%s: as many values as the variables have elements are expected", function);
    return fail(m, message);
}

static COLD NOINLINE fmi3Status get_arrays(fmi3Instance m, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                                        size_t n_values) {
    uint32_t *all = elements(vr, n, n_values);
    fmi3Status status = all ? fmi3GetFloat64(m, all, n_values, values, n_values) : miscounted(m, "fmi3GetFloat64");
    free(all);
    return status;
}

static COLD NOINLINE fmi3Status set_arrays(fmi3Instance m, const fmi3ValueReference vr[], size_t n,
                                        const fmi3Float64 values[], size_t n_values) {
    uint32_t *all = elements(vr, n, n_values);
    fmi3Status status = all ? fmi3SetFloat64(m, all, n_values, values, n_values) : miscounted(m, "fmi3SetFloat64");
    free(all);
    return status;
}

/* As many values as variables are values of scalars, which is quick. */
fmi3Status fmi3GetFloat64(fmi3Instance m, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t n_values) {
    if (n != n_values) return get_arrays(m, vr, n, values, n_values);
    return status_of(m, instance_get(m, vr, n, values));
}

fmi3Status fmi3SetFloat64(fmi3Instance m, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values) {
    if (n != n_values) return set_arrays(m, vr, n, values, n_values);
    return status_of(m, instance_set(m, vr, n, values));
}

fmi3Status fmi3DoStep(fmi3Instance m, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_rollback,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_time) {
    if (event_needed) *event_needed = fmi3False;
    if (terminate) *terminate = fmi3False;
    if (early_return) *early_return = fmi3False;
    const char *problem = instance_step(m, time, step);
    if (last_time) *last_time = ((Instance *)m)->now.state.v[0];
    return status_of(m, problem);
}

fmi3Status fmi3GetFMUState(fmi3Instance m, fmi3FMUState *state) { return status_of(m, snapshot_save(m, state)); }

fmi3Status fmi3SetFMUState(fmi3Instance m, fmi3FMUState state) { return status_of(m, snapshot_restore(m, state)); }

fmi3Status fmi3FreeFMUState(fmi3Instance m, fmi3FMUState *state) {
    if (state) free(*state), *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance m, fmi3FMUState state, size_t *size) {
    *size = sizeof(Snapshot);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance m, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return status_of(m, snapshot_write(state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance m, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return status_of(m, snapshot_read(bytes, size, state));
}

/* There are no variables of other types: reading or writing none of them is all that can succeed. */
#define NONE_OF(name, kind, ...)                                                            \
    fmi3Status name(fmi3Instance m, const fmi3ValueReference vr[], size_t n, __VA_ARGS__) { \
        return n ? fail(m, "this FMU has no " kind) : fmi3OK;                               \
    }
#define NO_VARIABLES(Type)                                                                   \
    NONE_OF(fmi3Get##Type, "variables of type " #Type, fmi3##Type values[], size_t n_values) \
    NONE_OF(fmi3Set##Type, "variables of type " #Type, const fmi3##Type values[], size_t n_values)

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(Int32)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
NO_VARIABLES(Boolean)
NO_VARIABLES(String)

NONE_OF(fmi3GetBinary, "variables of type Binary", size_t sizes[], fmi3Binary values[], size_t n_values)
NONE_OF(fmi3SetBinary, "variables of type Binary", const size_t sizes[], const fmi3Binary values[], size_t n_values)
NONE_OF(fmi3GetClock, "clocks", fmi3Clock values[])
NONE_OF(fmi3SetClock, "clocks", const fmi3Clock values[])

/* The rest of the interface belongs to capabilities that modelDescription.xml does not claim. */
#define NOT_OFFERED(name, ...) \
    fmi3Status name(fmi3Instance m, __VA_ARGS__) { return fail(m, #name " is not offered by this FMU"); }

fmi3Status fmi3EnterEventMode(fmi3Instance m) { return fail(m, "this FMU has no event mode"); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance m) { return fail(m, "this FMU has no configuration mode"); }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance m) { return fail(m, "this FMU has no configuration mode"); }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance m) { return fail(m, "this FMU has no continuous-time mode"); }
fmi3Status fmi3EnterStepMode(fmi3Instance m) { return fail(m, "this FMU has no event mode to leave"); }
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance m) { return fail(m, "this FMU has no event mode"); }

NOT_OFFERED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *n)
NOT_OFFERED(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t element[], fmi3ValueReference independent[],
            size_t element_of[], fmi3DependencyKind kind[], size_t n)
NOT_OFFERED(fmi3GetDirectionalDerivative, const fmi3ValueReference unknowns[], size_t n_unknowns,
            const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
            fmi3Float64 sensitivity[], size_t n_sensitivity)
NOT_OFFERED(fmi3GetAdjointDerivative, const fmi3ValueReference unknowns[], size_t n_unknowns,
            const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
            fmi3Float64 sensitivity[], size_t n_sensitivity)
NOT_OFFERED(fmi3GetIntervalDecimal, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
            fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetIntervalFraction, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
            fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
NOT_OFFERED(fmi3GetShiftDecimal, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
NOT_OFFERED(fmi3GetShiftFraction, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
            fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetIntervalDecimal, const fmi3ValueReference vr[], size_t n, const fmi3Float64 intervals[])
NOT_OFFERED(fmi3SetIntervalFraction, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
            const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3SetShiftDecimal, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[])
NOT_OFFERED(fmi3SetShiftFraction, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
            const fmi3UInt64 resolutions[])
NOT_OFFERED(fmi3UpdateDiscreteStates, fmi3Boolean *update, fmi3Boolean *terminate, fmi3Boolean *nominals,
            fmi3Boolean *values, fmi3Boolean *next_defined, fmi3Float64 *next_time)
NOT_OFFERED(fmi3CompletedIntegratorStep, fmi3Boolean no_rollback, fmi3Boolean *event, fmi3Boolean *terminate)
NOT_OFFERED(fmi3SetTime, fmi3Float64 time)
NOT_OFFERED(fmi3SetContinuousStates, const fmi3Float64 states[], size_t n)
NOT_OFFERED(fmi3GetContinuousStateDerivatives, fmi3Float64 derivatives[], size_t n)
NOT_OFFERED(fmi3GetEventIndicators, fmi3Float64 indicators[], size_t n)
NOT_OFFERED(fmi3GetContinuousStates, fmi3Float64 states[], size_t n)
NOT_OFFERED(fmi3GetNominalsOfContinuousStates, fmi3Float64 nominals[], size_t n)
NOT_OFFERED(fmi3GetNumberOfEventIndicators, size_t *n)
NOT_OFFERED(fmi3GetNumberOfContinuousStates, size_t *n)
NOT_OFFERED(fmi3GetOutputDerivatives, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
            fmi3Float64 values[], size_t n_values)
NOT_OFFERED(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
