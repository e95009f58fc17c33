
/* The functions of FMI 3.0. */

#define PASTED(a, b) a##b
#define JOINED(a, b) PASTED(a, b)
#ifdef FMI3_FUNCTION_PREFIX
#define NAMED(name) JOINED(FMI3_FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#define F(name) EXPORTED fmi3Status NAMED(fmi3##name)
#define REFERENCES const fmi3ValueReference references[], size_t count
#define IGNORED(x) (void)(x)

EXPORTED const char *NAMED(fmi3GetVersion)(void) { return "3.0"; }

F(SetDebugLogging)(fmi3Instance i, fmi3Boolean on, size_t count, const fmi3String categories[]) {
    return IGNORED(i), IGNORED(on), IGNORED(count), IGNORED(categories), fmi3OK;
}

EXPORTED fmi3Instance NAMED(fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    return IGNORED(resources), IGNORED(visible), IGNORED(logging), new_instance(name, token, log, environment);
}

EXPORTED fmi3Instance NAMED(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, REFERENCES, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback intermediate) {
    IGNORED(resources), IGNORED(visible), IGNORED(events), IGNORED(early), IGNORED(references), IGNORED(count);
    return IGNORED(intermediate), IGNORED(logging), new_instance(name, token, log, environment);
}

EXPORTED fmi3Instance NAMED(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback clock,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    IGNORED(name), IGNORED(token), IGNORED(resources), IGNORED(visible), IGNORED(logging), IGNORED(environment);
    IGNORED(log), IGNORED(clock), IGNORED(lock), IGNORED(unlock);
    return NULL;
}

EXPORTED void NAMED(fmi3FreeInstance)(fmi3Instance i) { free_instance(i); }

F(EnterInitializationMode)(fmi3Instance i, fmi3Boolean given, fmi3Float64 tolerance, fmi3Float64 from,
                           fmi3Boolean ends, fmi3Float64 end) {
    IGNORED(given), IGNORED(tolerance), IGNORED(ends), IGNORED(end);
    set_time(i, from);
    return fmi3OK;
}

F(ExitInitializationMode)(fmi3Instance i) { return finish_start(i); }
F(EnterEventMode)(fmi3Instance i) { return IGNORED(i), fmi3OK; }
F(Terminate)(fmi3Instance i) { return IGNORED(i), fmi3OK; }
F(Reset)(fmi3Instance i) { return reset_instance(i), fmi3OK; }

F(GetFloat64)(fmi3Instance i, REFERENCES, fmi3Float64 values[], size_t size) {
    return size == count ? get_values(i, references, count, values) : tell(i, BAD, "the number of values is wrong");
}

F(SetFloat64)(fmi3Instance i, REFERENCES, const fmi3Float64 values[], size_t size) {
    return size == count ? set_values(i, references, count, values) : tell(i, BAD, "the number of values is wrong");
}

static fmi3Status without(Instance *instance, size_t count) {
    return count ? tell(instance, BAD, "all variables of the FMU are of the type Float64") : fmi3OK;
}

#define ABSENT(type)                                                                                  \
    F(Get##type)(fmi3Instance i, REFERENCES, fmi3##type values[], size_t size) {                      \
        IGNORED(references), IGNORED(values), IGNORED(size);                                          \
        return without(i, count);                                                                     \
    }                                                                                                 \
    F(Set##type)(fmi3Instance i, REFERENCES, const fmi3##type values[], size_t size) {                \
        IGNORED(references), IGNORED(values), IGNORED(size);                                          \
        return without(i, count);                                                                     \
    }
ABSENT(Float32)
ABSENT(Int8)
ABSENT(UInt8)
ABSENT(Int16)
ABSENT(UInt16)
ABSENT(Int32)
ABSENT(UInt32)
ABSENT(Int64)
ABSENT(UInt64)
ABSENT(Boolean)
ABSENT(String)

F(GetBinary)(fmi3Instance i, REFERENCES, size_t sizes[], fmi3Binary values[], size_t size) {
    IGNORED(references), IGNORED(sizes), IGNORED(values), IGNORED(size);
    return without(i, count);
}

F(SetBinary)(fmi3Instance i, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t size) {
    IGNORED(references), IGNORED(sizes), IGNORED(values), IGNORED(size);
    return without(i, count);
}

F(GetClock)(fmi3Instance i, REFERENCES, fmi3Clock values[]) {
    return IGNORED(references), IGNORED(values), without(i, count);
}

F(SetClock)(fmi3Instance i, REFERENCES, const fmi3Clock values[]) {
    return IGNORED(references), IGNORED(values), without(i, count);
}

static fmi3Status lacking(Instance *instance) {
    return tell(instance, BAD, "the FMU does not have this function, as modelDescription.xml states");
}

F(GetNumberOfVariableDependencies)(fmi3Instance i, fmi3ValueReference reference, size_t *count) {
    return IGNORED(reference), IGNORED(count), lacking(i);
}

F(GetVariableDependencies)(fmi3Instance i, fmi3ValueReference reference, size_t elements[],
                           fmi3ValueReference independents[], size_t others[], fmi3DependencyKind kinds[],
                           size_t count) {
    IGNORED(reference), IGNORED(elements), IGNORED(independents), IGNORED(others), IGNORED(kinds), IGNORED(count);
    return lacking(i);
}

F(GetFMUState)(fmi3Instance i, fmi3FMUState *state) { return save(i, state); }
F(SetFMUState)(fmi3Instance i, fmi3FMUState state) { return restore(i, state); }

F(FreeFMUState)(fmi3Instance i, fmi3FMUState *state) {
    IGNORED(i);
    free(*state);
    *state = NULL;
    return fmi3OK;
}

F(SerializedFMUStateSize)(fmi3Instance i, fmi3FMUState state, size_t *size) {
    return IGNORED(i), IGNORED(state), *size = sizeof(Snapshot), fmi3OK;
}

F(SerializeFMUState)(fmi3Instance i, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return copy_snapshot(i, bytes, state, size);
}

F(DeserializeFMUState)(fmi3Instance i, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return read_snapshot(i, bytes, size, state);
}

#define DERIVATIVE_OF(name)                                                                                     \
    F(name)(fmi3Instance i, const fmi3ValueReference unknowns[], size_t count, const fmi3ValueReference knowns[], \
            size_t others, const fmi3Float64 seed[], size_t seeds, fmi3Float64 out[], size_t size) {             \
        IGNORED(unknowns), IGNORED(count), IGNORED(knowns), IGNORED(others), IGNORED(seed), IGNORED(seeds);       \
        IGNORED(out), IGNORED(size);                                                                            \
        return lacking(i);                                                                                      \
    }
DERIVATIVE_OF(GetDirectionalDerivative)
DERIVATIVE_OF(GetAdjointDerivative)

F(EnterConfigurationMode)(fmi3Instance i) { return lacking(i); }
F(ExitConfigurationMode)(fmi3Instance i) { return lacking(i); }

F(GetIntervalDecimal)(fmi3Instance i, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    return IGNORED(references), IGNORED(count), IGNORED(intervals), IGNORED(qualifiers), lacking(i);
}

F(GetIntervalFraction)(fmi3Instance i, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                       fmi3IntervalQualifier qualifiers[]) {
    IGNORED(references), IGNORED(count), IGNORED(counters), IGNORED(resolutions), IGNORED(qualifiers);
    return lacking(i);
}

F(GetShiftDecimal)(fmi3Instance i, REFERENCES, fmi3Float64 shifts[]) {
    return IGNORED(references), IGNORED(count), IGNORED(shifts), lacking(i);
}

F(GetShiftFraction)(fmi3Instance i, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
    return IGNORED(references), IGNORED(count), IGNORED(counters), IGNORED(resolutions), lacking(i);
}

#define CLOCKS_OF(kind)                                                                                     \
    F(Set##kind##Decimal)(fmi3Instance i, REFERENCES, const fmi3Float64 times[]) {                          \
        return IGNORED(references), IGNORED(count), IGNORED(times), lacking(i);                             \
    }                                                                                                       \
    F(Set##kind##Fraction)(fmi3Instance i, REFERENCES, const fmi3UInt64 a[], const fmi3UInt64 b[]) {        \
        return IGNORED(references), IGNORED(count), IGNORED(a), IGNORED(b), lacking(i);                     \
    }
CLOCKS_OF(Interval)
CLOCKS_OF(Shift)

F(EvaluateDiscreteStates)(fmi3Instance i) { return IGNORED(i), fmi3OK; }

F(UpdateDiscreteStates)(fmi3Instance i, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
                        fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next) {
    IGNORED(i);
    *again = *terminate = *nominals = *states = *defined = 0, *next = 0.0;
    return fmi3OK;
}

F(EnterContinuousTimeMode)(fmi3Instance i) { return IGNORED(i), fmi3OK; }

F(CompletedIntegratorStep)(fmi3Instance i, fmi3Boolean last, fmi3Boolean *event, fmi3Boolean *terminate) {
    return IGNORED(i), IGNORED(last), *event = *terminate = 0, fmi3OK;
}

F(SetTime)(fmi3Instance i, fmi3Float64 time) { return set_time(i, time), fmi3OK; }
F(SetContinuousStates)(fmi3Instance i, const fmi3Float64 states[], size_t n) { return set_states(i, states, n); }

F(GetContinuousStateDerivatives)(fmi3Instance i, fmi3Float64 derivatives[], size_t n) {
    return get_states(i, derivatives, n, DERIVATIVE);
}

F(GetEventIndicators)(fmi3Instance i, fmi3Float64 indicators[], size_t n) {
    return IGNORED(indicators), n ? lacking(i) : fmi3OK;
}

F(GetContinuousStates)(fmi3Instance i, fmi3Float64 states[], size_t n) { return get_states(i, states, n, STATE); }

F(GetNominalsOfContinuousStates)(fmi3Instance i, fmi3Float64 nominals[], size_t n) {
    for (size_t k = 0; k < n; k++) nominals[k] = 1.0;
    return IGNORED(i), fmi3OK;
}

F(GetNumberOfEventIndicators)(fmi3Instance i, size_t *n) { return IGNORED(i), *n = 0, fmi3OK; }
F(GetNumberOfContinuousStates)(fmi3Instance i, size_t *n) { return IGNORED(i), *n = STATES, fmi3OK; }
F(EnterStepMode)(fmi3Instance i) { return IGNORED(i), fmi3OK; }

F(GetOutputDerivatives)(fmi3Instance i, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t size) {
    return IGNORED(references), IGNORED(count), IGNORED(orders), IGNORED(values), IGNORED(size), lacking(i);
}

F(DoStep)(fmi3Instance i, fmi3Float64 from, fmi3Float64 length, fmi3Boolean last, fmi3Boolean *event,
          fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    IGNORED(last);
    *event = *terminate = *early = 0;
    fmi3Status status = step(i, from, length);
    *reached = ((Instance *)i)->now.value[0];
    return status;
}

F(ActivateModelPartition)(fmi3Instance i, fmi3ValueReference clock, fmi3Float64 time) {
    return IGNORED(clock), IGNORED(time), lacking(i);
}
