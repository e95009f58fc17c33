
/* The functions of FMI 3.0 alone. */

EXPORTED Component JOINED(PREFIX, fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    return new_instance(name, token, log, environment);
}

EXPORTED Component JOINED(PREFIX, fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, REFERENCES, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback intermediate) {
    return new_instance(name, token, log, environment);
}

EXPORTED Component JOINED(PREFIX, fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback clock,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    return NULL;
}

F(EnterInitializationMode)(Component i, fmi3Boolean given, fmi3Float64 tolerance, fmi3Float64 from, fmi3Boolean ends,
                           fmi3Float64 end) {
    return set_time(i, from);
}

F(GetFloat64)(Component i, REFERENCES, fmi3Float64 values[], size_t size) {
    return size == count ? get_values(i, references, count, values) : tell(i, BAD, "the number of values is wrong");
}

F(SetFloat64)(Component i, REFERENCES, const fmi3Float64 values[], size_t size) {
    return size == count ? set_values(i, references, count, values) : tell(i, BAD, "the number of values is wrong");
}

ABSENT(Float32, values[], size_t size)
ABSENT(Int8, values[], size_t size)
ABSENT(UInt8, values[], size_t size)
ABSENT(Int16, values[], size_t size)
ABSENT(UInt16, values[], size_t size)
ABSENT(Int32, values[], size_t size)
ABSENT(UInt32, values[], size_t size)
ABSENT(Int64, values[], size_t size)
ABSENT(UInt64, values[], size_t size)
ABSENT(Boolean, values[], size_t size)
ABSENT(String, values[], size_t size)
ABSENT(Clock, values[])

F(GetBinary)(Component i, REFERENCES, size_t sizes[], fmi3Binary values[], size_t size) { return without(i, count); }

F(SetBinary)(Component i, REFERENCES, const size_t sizes[], const fmi3Binary values[], size_t size) {
    return without(i, count);
}

#define DIRECTION                                                                                                 \
    const Reference unknowns[], size_t count, const Reference knowns[], size_t others, const fmi3Float64 seed[],  \
        size_t seeds, fmi3Float64 out[], size_t size
LACKING(GetDirectionalDerivative, Component i, DIRECTION)
LACKING(GetAdjointDerivative, Component i, DIRECTION)
LACKING(GetNumberOfVariableDependencies, Component i, Reference reference, size_t *count)
LACKING(GetVariableDependencies, Component i, Reference reference, size_t elements[], Reference independents[],
        size_t others[], fmi3DependencyKind kinds[], size_t count)
LACKING(GetOutputDerivatives, Component i, REFERENCES, const fmi3Int32 orders[], fmi3Float64 values[], size_t size)
LACKING(EnterConfigurationMode, Component i)
LACKING(ExitConfigurationMode, Component i)
LACKING(GetIntervalDecimal, Component i, REFERENCES, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[])
LACKING(GetIntervalFraction, Component i, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
        fmi3IntervalQualifier qualifiers[])
LACKING(SetIntervalDecimal, Component i, REFERENCES, const fmi3Float64 intervals[])
LACKING(SetIntervalFraction, Component i, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
LACKING(GetShiftDecimal, Component i, REFERENCES, fmi3Float64 shifts[])
LACKING(GetShiftFraction, Component i, REFERENCES, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
LACKING(SetShiftDecimal, Component i, REFERENCES, const fmi3Float64 shifts[])
LACKING(SetShiftFraction, Component i, REFERENCES, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
LACKING(ActivateModelPartition, Component i, Reference clock, fmi3Float64 time)

F(GetNumberOfEventIndicators)(Component i, size_t *n) { return *n = 0, GOOD; }
F(GetNumberOfContinuousStates)(Component i, size_t *n) { return *n = STATES, GOOD; }
F(EnterStepMode)(Component i) { return GOOD; }
F(EvaluateDiscreteStates)(Component i) { return GOOD; }

F(UpdateDiscreteStates)(Component i, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals,
                        fmi3Boolean *states, fmi3Boolean *defined, fmi3Float64 *next) {
    return *again = *terminate = *nominals = *states = *defined = 0, *next = 0.0, GOOD;
}

F(DoStep)(Component i, fmi3Float64 from, fmi3Float64 length, fmi3Boolean last, fmi3Boolean *event,
          fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *reached) {
    Status status = step(i, from, length);
    return *event = *terminate = *early = 0, *reached = ((Instance *)i)->now.value[0], status;
}
