
/* The functions that FMI 2.0 and 3.0 share, by their names in 3.0. The standards fix all parameters, also those that
   this FMU does not read. */
#pragma GCC diagnostic ignored "-Wunused-parameter"

#define PASTED(a, b) a##b
#define JOINED(a, b) PASTED(a, b)
#define F(name) EXPORTED Status JOINED(PREFIX, FMI(name))
#define REFERENCES const Reference references[], size_t count
/* functions that modelDescription.xml excludes, by their parameters, and those of variables of another type */
#define LACKING(name, ...) \
    F(name)(__VA_ARGS__) { return tell(i, BAD, "modelDescription.xml states that the FMU lacks this function"); }
#define ABSENT(type, ...)                                                                       \
    F(Get##type)(Component i, REFERENCES, FMI(type) __VA_ARGS__) { return without(i, count); }  \
    F(Set##type)(Component i, REFERENCES, const FMI(type) __VA_ARGS__) { return without(i, count); }

static Status without(Instance *instance, size_t count) {
    return count ? tell(instance, BAD, "all variables of the FMU are real numbers of 64 bits") : GOOD;
}

EXPORTED const char *JOINED(PREFIX, FMI(GetVersion))(void) { return VERSION; }
EXPORTED void JOINED(PREFIX, FMI(FreeInstance))(Component i) { free_instance(i); }
F(SetDebugLogging)(Component i, FMI(Boolean) on, size_t count, const FMI(String) categories[]) { return GOOD; }
F(ExitInitializationMode)(Component i) { return finish_start(i); }
F(EnterEventMode)(Component i) { return GOOD; }
F(EnterContinuousTimeMode)(Component i) { return GOOD; }
F(Terminate)(Component i) { return GOOD; }
F(Reset)(Component i) { return reset_instance(i), GOOD; }

F(GetFMUState)(Component i, FMI(FMUState) *state) { return save(i, state); }
F(SetFMUState)(Component i, FMI(FMUState) state) { return restore(i, state); }
F(FreeFMUState)(Component i, FMI(FMUState) *state) { return free(*state), *state = NULL, GOOD; }
F(SerializedFMUStateSize)(Component i, FMI(FMUState) state, size_t *size) { return *size = KEPT, GOOD; }

F(SerializeFMUState)(Component i, FMI(FMUState) state, FMI(Byte) bytes[], size_t size) {
    return copy_snapshot(i, bytes, state, size);
}

F(DeserializeFMUState)(Component i, const FMI(Byte) bytes[], size_t size, FMI(FMUState) *state) {
    return read_snapshot(i, bytes, size, state);
}

F(SetTime)(Component i, double time) { return set_time(i, time); }
F(SetContinuousStates)(Component i, const double states[], size_t n) { return set_states(i, states, n); }
F(GetContinuousStates)(Component i, double states[], size_t n) { return get_states(i, states, n, STATE); }

F(GetContinuousStateDerivatives)(Component i, double derivatives[], size_t n) {
    return get_states(i, derivatives, n, DERIVATIVE);
}

F(GetNominalsOfContinuousStates)(Component i, double nominals[], size_t n) {
    for (size_t k = 0; k < n; k++) nominals[k] = 1.0;
    return GOOD;
}

F(GetEventIndicators)(Component i, double indicators[], size_t n) {
    return n ? tell(i, BAD, "the FMU has no event indicators") : GOOD;
}

F(CompletedIntegratorStep)(Component i, FMI(Boolean) last, FMI(Boolean) *event, FMI(Boolean) *terminate) {
    return *event = *terminate = 0, GOOD;
}
