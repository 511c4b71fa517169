/* FMI 3.0 co-simulation around one table: bookkeeping alone, no physics.
 *
 * Above this text stand the rig's equations (rig_table_tick, rig_derive), made from their Python
 * source, and what belongs to this table: TICK_S, STEP_S, ROWS, STATE_ROWS, HEIGHT_AT, BALL_AT, TOKEN,
 * TAKES_VOLTS, LATE_S, START. Prototypes are those of the FMI 3.0 standard, declared here so that no file of
 * others is needed.
 */

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#if !defined(fmi3PlatformTypes_h) /* a build that brings the standard's headers uses those */
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
typedef int fmi3IntervalQualifier, fmi3DependencyKind;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment);
typedef void (*fmi3LockPreemptionCallback)();
typedef void (*fmi3UnlockPreemptionCallback)();
#endif

/* Everything that a state saved by the importer holds. */
typedef struct {
    struct plant plant;
    double state[STATE_ROWS * 2], history[ROWS * 2], seen[7];
    double drive[2], push[2], start[2], time, began;
    int64_t ticks, held, fallen, initialized;
} Model;

typedef struct {
    Model now;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Table;

typedef struct {
    fmi3ValueReference reference;
    size_t offset;   /* of the first number in Model */
    int count;       /* how many numbers in a row hold this one value */
    char causality;  /* p parameter, i input, o output */
} Variable;

static const Variable VARIABLES[] = {
    VARIABLE_ROWS
};

#define MOST_TICKS 1e9 /* of a communication step; chosen: weeks, and counted down exactly */

static fmi3Status tell(Table *table, const char *text) {
    if (table->log) table->log(table->environment, fmi3Error, "logStatusError", text);
    return fmi3Error;
}

static void begin(Model *m) {
    memset(m, 0, sizeof *m);
    m->plant = START;
}

static const Variable *find(fmi3ValueReference reference) {
    for (size_t i = 0; i < sizeof VARIABLES / sizeof *VARIABLES; i++)
        if (VARIABLES[i].reference == reference) return VARIABLES + i;
    return NULL;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String names[]) {
    (void)instance, (void)on, (void)n, (void)names;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference intermediate[], size_t n_intermediate,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)name, (void)resources, (void)visible, (void)logging, (void)early, (void)intermediate, (void)update;
    if (events || n_intermediate || !token || strcmp(token, TOKEN)) {
        if (log) log(environment, fmi3Error, "logStatusError",
                     "not this model's token, or event mode or intermediate variables asked for");
        return NULL;
    }
    Table *table = malloc(sizeof *table);
    if (!table) return NULL;
    table->environment = environment;
    table->log = log;
    begin(&table->now);
    return table;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance) { free(instance); }

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_given, fmi3Float64 tolerance,
                                              fmi3Float64 begins, fmi3Boolean end_given, fmi3Float64 ends) {
    (void)tolerance_given, (void)tolerance, (void)end_given, (void)ends;
    ((Table *)instance)->now.began = ((Table *)instance)->now.time = begins;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    Table *table = instance;
    Model *m = &table->now;
    rig_derive(&m->plant);
    if (TAKES_VOLTS && !(m->plant.motor_inertia[0] > 0.0 && m->plant.motor_inertia[1] > 0.0))
        return tell(table, "servo.time_constant_s gives an inertia below that of gears and plate: raise it, "
                           "or lower drive.plate_inertia_kg_m2");
    for (int a = 0; a < 2; a++) { /* the history's last row would stand for all that is older */
        double late = LATE_S(m->plant, a);
        if (!(late >= 0.0 && late <= (ROWS - 2) * TICK_S))
            return tell(table, "delays of an axis: must be from 0 to what this model remembers; "
                               "longer ones need a rig file that has them");
    }
    memset(m->state, 0, sizeof m->state);
    m->state[HEIGHT_AT] = m->plant.height;
    m->state[BALL_AT] = m->start[0];
    m->state[BALL_AT + 1] = m->start[1];
    m->initialized = 1;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance) {
    begin(&((Table *)instance)->now);
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance instance) {
    (void)instance;
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 from, fmi3Float64 step, fmi3Boolean no_return,
                             fmi3Boolean *event, fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    Table *table = instance;
    Model *m = &table->now;
    double ticks = rint(step / TICK_S);
    char text[160];
    (void)from, (void)no_return;
    *event = *terminate = *early = false;
    *reached = m->time;
    if (!m->initialized) return tell(table, "fmi3DoStep before the initialization's end");
    if (!(ticks >= 1.0 && ticks <= MOST_TICKS) || fabs(ticks * TICK_S - step) > 1e-6 * TICK_S) {
        snprintf(text, sizeof text, "a communication step of %g s: must be a whole multiple of %g s", step, TICK_S);
        return tell(table, text);
    }
    for (; ticks > 0.5; ticks--) {
        double t = (double)m->ticks * TICK_S;
        /* seen in the tick's last step: tilt and ball's velocity at its end */
        m->fallen = rig_table_tick(m->state, &m->plant, m->history, m->drive, m->push[0], m->push[1], m->held, t,
                                   TICK_S, t + TICK_S - 0.5 * STEP_S, m->seen);
        m->ticks++;
    }
    for (int i = 0; i < STATE_ROWS * 2; i++)
        if (!isfinite(m->state[i])) return tell(table, "the motion has left all bounds");
    *reached = m->time = m->began + (double)m->ticks * TICK_S;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                                 fmi3Float64 values[], size_t n_values) {
    Table *table = instance;
    if (n != n_values) return tell(table, "all variables are scalars");
    for (size_t i = 0; i < n; i++) {
        const Variable *one = find(references[i]);
        if (!one) return tell(table, "no such real variable");
        values[i] = *(double *)((char *)&table->now + one->offset);
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                                 const fmi3Float64 values[], size_t n_values) {
    Table *table = instance;
    if (n != n_values) return tell(table, "all variables are scalars");
    for (size_t i = 0; i < n; i++) {
        const Variable *one = find(references[i]);
        if (!one || one->causality == 'o') return tell(table, "no real variable that can be set");
        if (one->causality == 'p' && table->now.initialized)
            return tell(table, "parameters are set before the initialization's end");
        if (isnan(values[i])) return tell(table, "a value must be a number");
        for (int k = 0; k < one->count; k++)
            ((double *)((char *)&table->now + one->offset))[k] = values[i];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                                 fmi3Boolean values[], size_t n_values) {
    Table *table = instance;
    for (size_t i = 0; i < n && i < n_values; i++) {
        if (references[i] != HELD && references[i] != FALLEN) return tell(table, "no such Boolean variable");
        values[i] = (references[i] == HELD ? table->now.held : table->now.fallen) != 0;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBoolean(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                                 const fmi3Boolean values[], size_t n_values) {
    Table *table = instance;
    for (size_t i = 0; i < n && i < n_values; i++) {
        if (references[i] != HELD) return tell(table, "no Boolean variable that can be set");
        table->now.held = values[i];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state) {
    if (!*state && !(*state = malloc(sizeof(Model)))) return tell(instance, "out of memory");
    memcpy(*state, &((Table *)instance)->now, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state) {
    memcpy(&((Table *)instance)->now, state, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state) {
    (void)instance;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size) {
    (void)instance, (void)state;
    *size = sizeof(Model);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    if (size < sizeof(Model)) return tell(instance, "too little room for the state");
    memcpy(bytes, state, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                          fmi3FMUState *state) {
    if (size != sizeof(Model)) return tell(instance, "not a state of this model");
    if (!*state && !(*state = malloc(sizeof(Model)))) return tell(instance, "out of memory");
    memcpy(*state, bytes, sizeof(Model));
    return fmi3OK;
}

/* What the standard wants to be there and this model has none of: an error where it is asked for. */
#define NONE_OF(Type)                                                                                              \
    EXPORT fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference references[], size_t n,        \
                                    fmi3##Type values[], size_t n_values) {                                        \
        (void)references, (void)values, (void)n_values;                                                            \
        return n ? tell(instance, "no variable of this type") : fmi3OK;                                            \
    }                                                                                                              \
    EXPORT fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference references[], size_t n,        \
                                    const fmi3##Type values[], size_t n_values) {                                  \
        (void)references, (void)values, (void)n_values;                                                            \
        return n ? tell(instance, "no variable of this type") : fmi3OK;                                            \
    }
NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(Int32)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(String)

#define UNKNOWN(...) { return tell(instance, "this model has no " __VA_ARGS__); }
#define REFERENCES const fmi3ValueReference references[], size_t n
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
EXPORT fmi3Status fmi3GetBinary(fmi3Instance instance, REFERENCES, size_t sizes[], fmi3Binary values[], size_t m)
    UNKNOWN("binaries")
EXPORT fmi3Status fmi3SetBinary(fmi3Instance instance, REFERENCES, const size_t sizes[], const fmi3Binary values[],
                                size_t m)
    UNKNOWN("binaries")
EXPORT fmi3Status fmi3GetClock(fmi3Instance instance, REFERENCES, fmi3Clock values[]) UNKNOWN("clocks")
EXPORT fmi3Status fmi3SetClock(fmi3Instance instance, REFERENCES, const fmi3Clock values[]) UNKNOWN("clocks")
EXPORT fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, REFERENCES, fmi3Float64 intervals[],
                                         fmi3IntervalQualifier qualifiers[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, REFERENCES, fmi3UInt64 counters[],
                                          fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, REFERENCES, fmi3Float64 shifts[]) UNKNOWN("clocks")
EXPORT fmi3Status fmi3GetShiftFraction(fmi3Instance instance, REFERENCES, fmi3UInt64 counters[],
                                       fmi3UInt64 resolutions[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, REFERENCES, const fmi3Float64 intervals[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, REFERENCES, const fmi3UInt64 counters[],
                                          const fmi3UInt64 resolutions[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, REFERENCES, const fmi3Float64 shifts[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3SetShiftFraction(fmi3Instance instance, REFERENCES, const fmi3UInt64 counters[],
                                       const fmi3UInt64 resolutions[])
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference reference, size_t *n)
    UNKNOWN("list of dependencies")
EXPORT fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent, size_t of[],
                                              fmi3ValueReference independents[], size_t at[],
                                              fmi3DependencyKind kinds[], size_t n)
    UNKNOWN("list of dependencies")
EXPORT fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, REFERENCES, const fmi3ValueReference knowns[],
                                               size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                               fmi3Float64 sensitivity[], size_t n_sensitivity)
    UNKNOWN("derivatives")
EXPORT fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, REFERENCES, const fmi3ValueReference knowns[],
                                           size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                           fmi3Float64 sensitivity[], size_t n_sensitivity)
    UNKNOWN("derivatives")
EXPORT fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, REFERENCES, const fmi3Int32 orders[],
                                           fmi3Float64 values[], size_t n_values)
    UNKNOWN("derivatives")
EXPORT fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) UNKNOWN("structural parameters")
EXPORT fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) UNKNOWN("structural parameters")
EXPORT fmi3Status fmi3EnterEventMode(fmi3Instance instance) UNKNOWN("events")
EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance instance) UNKNOWN("events")
EXPORT fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) UNKNOWN("events")
EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *update, fmi3Boolean *terminate,
                                           fmi3Boolean *nominals, fmi3Boolean *states, fmi3Boolean *defined,
                                           fmi3Float64 *next)
    UNKNOWN("events")

/* The other two kinds of interface: this is a co-simulation alone. */
EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                                 fmi3Boolean visible, fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    return NULL;
}
EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                                      fmi3Boolean visible, fmi3Boolean logging,
                                                      fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                      fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                                      fmi3UnlockPreemptionCallback unlock) {
    return NULL;
}
EXPORT fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 at)
    UNKNOWN("clocks")
EXPORT fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) UNKNOWN("model exchange")
EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_return, fmi3Boolean *event,
                                              fmi3Boolean *terminate)
    UNKNOWN("model exchange")
EXPORT fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) UNKNOWN("model exchange")
EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t n)
    UNKNOWN("model exchange")
EXPORT fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t n)
    UNKNOWN("model exchange")
EXPORT fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 rates[], size_t n)
    UNKNOWN("model exchange")
EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n)
    UNKNOWN("model exchange")
EXPORT fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n)
    UNKNOWN("model exchange")
EXPORT fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) UNKNOWN("model exchange")
EXPORT fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n) UNKNOWN("model exchange")
