
/* The functions of FMI 2.0. */

#define PASTED(a, b) a##b
#define JOINED(a, b) PASTED(a, b)
#ifdef FMI2_FUNCTION_PREFIX
#define NAMED(name) JOINED(FMI2_FUNCTION_PREFIX, name)
#else
#define NAMED(name) name
#endif
#define F(name) EXPORTED fmi2Status NAMED(fmi2##name)
#define REFERENCES const fmi2ValueReference references[], size_t count
#define IGNORED(x) (void)(x)

EXPORTED const char *NAMED(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORTED const char *NAMED(fmi2GetVersion)(void) { return "2.0"; }

F(SetDebugLogging)(fmi2Component i, fmi2Boolean on, size_t count, const fmi2String categories[]) {
    return IGNORED(i), IGNORED(on), IGNORED(count), IGNORED(categories), fmi2OK;
}

EXPORTED fmi2Component NAMED(fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                                              fmi2Boolean logging) {
    IGNORED(type), IGNORED(resources), IGNORED(visible), IGNORED(logging);
    void *environment = functions ? functions->componentEnvironment : NULL;
    return new_instance(name, guid, functions ? functions->logger : NULL, environment);
}

EXPORTED void NAMED(fmi2FreeInstance)(fmi2Component i) { free_instance(i); }

F(SetupExperiment)(fmi2Component i, fmi2Boolean given, fmi2Real tolerance, fmi2Real from, fmi2Boolean ends,
                   fmi2Real end) {
    IGNORED(given), IGNORED(tolerance), IGNORED(ends), IGNORED(end);
    set_time(i, from);
    return fmi2OK;
}

F(EnterInitializationMode)(fmi2Component i) { return IGNORED(i), fmi2OK; }
F(ExitInitializationMode)(fmi2Component i) { return finish_start(i); }
F(Terminate)(fmi2Component i) { return IGNORED(i), fmi2OK; }
F(Reset)(fmi2Component i) { return reset_instance(i), fmi2OK; }
F(GetReal)(fmi2Component i, REFERENCES, fmi2Real values[]) { return get_values(i, references, count, values); }
F(SetReal)(fmi2Component i, REFERENCES, const fmi2Real values[]) { return set_values(i, references, count, values); }

static fmi2Status without(Instance *instance, size_t count) {
    return count ? tell(instance, BAD, "all variables of the FMU are of the type Real") : fmi2OK;
}

#define ABSENT(type)                                                                    \
    F(Get##type)(fmi2Component i, REFERENCES, fmi2##type values[]) {                    \
        return IGNORED(references), IGNORED(values), without(i, count);                 \
    }                                                                                   \
    F(Set##type)(fmi2Component i, REFERENCES, const fmi2##type values[]) {              \
        return IGNORED(references), IGNORED(values), without(i, count);                 \
    }
ABSENT(Integer)
ABSENT(Boolean)
ABSENT(String)

static fmi2Status lacking(Instance *instance) {
    return tell(instance, BAD, "the FMU does not have this function, as modelDescription.xml states");
}

F(GetFMUstate)(fmi2Component i, fmi2FMUstate *state) { return save(i, state); }
F(SetFMUstate)(fmi2Component i, fmi2FMUstate state) { return restore(i, state); }

F(FreeFMUstate)(fmi2Component i, fmi2FMUstate *state) {
    IGNORED(i);
    free(*state);
    *state = NULL;
    return fmi2OK;
}

F(SerializedFMUstateSize)(fmi2Component i, fmi2FMUstate state, size_t *size) {
    return IGNORED(i), IGNORED(state), *size = sizeof(Snapshot), fmi2OK;
}

F(SerializeFMUstate)(fmi2Component i, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return copy_snapshot(i, bytes, state, size);
}

F(DeSerializeFMUstate)(fmi2Component i, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return read_snapshot(i, bytes, size, state);
}

F(GetDirectionalDerivative)(fmi2Component i, const fmi2ValueReference unknowns[], size_t count,
                            const fmi2ValueReference knowns[], size_t others, const fmi2Real seed[],
                            fmi2Real out[]) {
    IGNORED(unknowns), IGNORED(count), IGNORED(knowns), IGNORED(others), IGNORED(seed), IGNORED(out);
    return lacking(i);
}

F(EnterEventMode)(fmi2Component i) { return IGNORED(i), fmi2OK; }

F(NewDiscreteStates)(fmi2Component i, fmi2EventInfo *info) {
    IGNORED(i);
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

F(EnterContinuousTimeMode)(fmi2Component i) { return IGNORED(i), fmi2OK; }

F(CompletedIntegratorStep)(fmi2Component i, fmi2Boolean last, fmi2Boolean *event, fmi2Boolean *terminate) {
    return IGNORED(i), IGNORED(last), *event = *terminate = 0, fmi2OK;
}

F(SetTime)(fmi2Component i, fmi2Real time) { return set_time(i, time), fmi2OK; }
F(SetContinuousStates)(fmi2Component i, const fmi2Real states[], size_t n) { return set_states(i, states, n); }
F(GetDerivatives)(fmi2Component i, fmi2Real derivatives[], size_t n) { return get_states(i, derivatives, n, DERIVATIVE); }
F(GetEventIndicators)(fmi2Component i, fmi2Real x[], size_t n) { return IGNORED(x), n ? lacking(i) : fmi2OK; }
F(GetContinuousStates)(fmi2Component i, fmi2Real states[], size_t n) { return get_states(i, states, n, STATE); }

F(GetNominalsOfContinuousStates)(fmi2Component i, fmi2Real nominals[], size_t n) {
    for (size_t k = 0; k < n; k++) nominals[k] = 1.0;
    return IGNORED(i), fmi2OK;
}

F(SetRealInputDerivatives)(fmi2Component i, REFERENCES, const fmi2Integer orders[], const fmi2Real values[]) {
    return IGNORED(references), IGNORED(count), IGNORED(orders), IGNORED(values), lacking(i);
}

F(GetRealOutputDerivatives)(fmi2Component i, REFERENCES, const fmi2Integer orders[], fmi2Real values[]) {
    return IGNORED(references), IGNORED(count), IGNORED(orders), IGNORED(values), lacking(i);
}

F(DoStep)(fmi2Component i, fmi2Real from, fmi2Real length, fmi2Boolean last) { return IGNORED(last), step(i, from, length); }
F(CancelStep)(fmi2Component i) { return lacking(i); }

#define STATUS_OF(name, type)                                                                        \
    F(name)(fmi2Component i, const fmi2StatusKind kind, type *value) {                               \
        return IGNORED(i), IGNORED(kind), IGNORED(value), fmi2Discard;                               \
    }
STATUS_OF(GetStatus, fmi2Status)
STATUS_OF(GetIntegerStatus, fmi2Integer)
STATUS_OF(GetBooleanStatus, fmi2Boolean)
STATUS_OF(GetStringStatus, fmi2String)

F(GetRealStatus)(fmi2Component i, const fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Instance *)i)->now.value[0];
    return kind == fmi2LastSuccessfulTime ? fmi2OK : fmi2Discard;
}
