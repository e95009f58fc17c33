
/* The functions of FMI 2.0 alone. */

EXPORTED const char *JOINED(PREFIX, fmi2GetTypesPlatform)(void) { return "default"; }

EXPORTED Component JOINED(PREFIX, fmi2Instantiate)(fmi2String name, fmi2Type type, fmi2String guid,
                                                   fmi2String resources, const fmi2CallbackFunctions *functions,
                                                   fmi2Boolean visible, fmi2Boolean logging) {
    void *environment = functions ? functions->componentEnvironment : NULL;
    return new_instance(name, guid, functions ? functions->logger : NULL, environment);
}

F(SetupExperiment)(Component i, fmi2Boolean given, fmi2Real tolerance, fmi2Real from, fmi2Boolean ends, fmi2Real end) {
    return set_time(i, from);
}

F(EnterInitializationMode)(Component i) { return GOOD; }
F(GetReal)(Component i, REFERENCES, fmi2Real values[]) { return get_values(i, references, count, values); }
F(SetReal)(Component i, REFERENCES, const fmi2Real values[]) { return set_values(i, references, count, values); }
ABSENT(Integer, values[])
ABSENT(Boolean, values[])
ABSENT(String, values[])

LACKING(GetDirectionalDerivative, Component i, const Reference unknowns[], size_t count, const Reference knowns[],
        size_t others, const fmi2Real seed[], fmi2Real out[])
LACKING(SetRealInputDerivatives, Component i, REFERENCES, const fmi2Integer orders[], const fmi2Real values[])
LACKING(GetRealOutputDerivatives, Component i, REFERENCES, const fmi2Integer orders[], fmi2Real values[])
LACKING(CancelStep, Component i)

F(NewDiscreteStates)(Component i, fmi2EventInfo *info) { return memset(info, 0, sizeof *info), GOOD; }
F(DoStep)(Component i, fmi2Real from, fmi2Real length, fmi2Boolean last) { return step(i, from, length); }

#define STATUS_OF(name, type) \
    F(name)(Component i, const fmi2StatusKind kind, type *value) { return fmi2Discard; }
STATUS_OF(GetStatus, fmi2Status)
STATUS_OF(GetIntegerStatus, fmi2Integer)
STATUS_OF(GetBooleanStatus, fmi2Boolean)
STATUS_OF(GetStringStatus, fmi2String)

F(GetRealStatus)(Component i, const fmi2StatusKind kind, fmi2Real *value) {
    *value = ((Instance *)i)->now.value[0];
    return kind == fmi2LastSuccessfulTime ? GOOD : fmi2Discard;
}
