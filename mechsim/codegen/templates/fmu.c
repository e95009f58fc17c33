
/* An instance of the FMU: what a snapshot keeps, what follows from the model, and how messages are written. */

typedef struct {
    Snapshot now;
    /* whether parameters and start values may be set; whether outputs and derivatives belong to earlier values */
    int starting, stale;
    Own own;
    void *environment;
    Logger logger;
    char *name;
} Instance;

/* a kept state: what an instance begins with */
#define KEPT offsetof(Instance, stale)

static Status tell(Instance *instance, Status status, const char *text) {
    if (instance->logger) LOG(instance, status, text);
    return status;
}

static Status ended(Instance *instance, const char *error) { return error ? tell(instance, BAD, error) : GOOD; }

static void free_instance(Instance *instance) {
    if (!instance) return;
    discard(&instance->own);
    free(instance->name);
    free(instance);
}

static void reset_instance(Instance *instance) {
    memcpy(instance->now.value, START, sizeof START);
    start(&instance->now, &instance->own);
    instance->stale = instance->starting = 1;
}

static Instance *new_instance(const char *name, const char *token, Logger logger, void *environment) {
    Instance *instance = calloc(1, sizeof(Instance));
    if (!instance) return NULL;
    instance->logger = logger, instance->environment = environment;
    size_t length = strlen(name) + 1;
    instance->name = malloc(length);
    if (instance->name) memcpy(instance->name, name, length);
    if (!instance->name || !prepare(&instance->own)) {
        tell(instance, BAD, "there is not enough memory for an instance");
    } else if (!token || strcmp(token, TOKEN)) {
        tell(instance, BAD, "the instantiation token is not that of this FMU");
    } else {
        reset_instance(instance);
        return instance;
    }
    free_instance(instance);
    return NULL;
}

static Status update(Instance *instance) {
    if (!instance->stale) return GOOD;
    const char *error = compute(&instance->now, &instance->own);
    instance->stale = error != NULL;
    return ended(instance, error);
}

static Status get_values(Instance *instance, const Reference *references, size_t count, double *values) {
    for (size_t i = 0; i < count; i++) {
        if (references[i] >= VALUES) return tell(instance, BAD, "a value is read that the FMU does not have");
        if (references[i] >= DERIVATIVE && update(instance) != GOOD) return BAD;
        values[i] = instance->now.value[references[i]];
    }
    return GOOD;
}

static Status set_values(Instance *instance, const Reference *references, size_t count, const double *values) {
    for (size_t i = 0; i < count; i++) {
        if (references[i] < INPUT || references[i] >= DERIVATIVE)
            return tell(instance, BAD, "a value is set that is no input, parameter or start value");
        if (references[i] >= PARAMETER && !instance->starting)
            return tell(instance, BAD, "a parameter or start value is set after the initialization");
        if (!isfinite(values[i])) return tell(instance, BAD, "a value is set that is not finite");
        instance->now.value[references[i]] = values[i];
        instance->stale = 1;
    }
    return GOOD;
}

static Status finish_start(Instance *instance) {
    const char *error = begin(&instance->now, &instance->own);
    instance->starting = error != NULL, instance->stale = 1;
    return ended(instance, error);
}

static Status set_time(Instance *instance, double time) {
    if (!isfinite(time)) return tell(instance, BAD, "the time is not finite");
    return instance->now.value[0] = time, instance->stale = 1, GOOD;
}

static Status set_states(Instance *instance, const double *states, size_t count) {
    if (count != STATES) return tell(instance, BAD, "the number of states is wrong");
    for (size_t i = 0; i < count; i++)
        if (!isfinite(states[i])) return tell(instance, BAD, "a state is set that is not finite");
    memcpy(instance->now.value + STATE, states, count * sizeof(double));
    instance->stale = 1;
    return GOOD;
}

static Status get_states(Instance *instance, double *states, size_t count, int first) {
    if (count != STATES) return tell(instance, BAD, "the number of states is wrong");
    if (first == DERIVATIVE && update(instance) != GOOD) return BAD;
    memcpy(states, instance->now.value + first, count * sizeof(double));
    return GOOD;
}

static Status step(Instance *instance, double from, double length) {
    double time = instance->now.value[0];
    if (!(fabs(from - time) <= 1e-9 * (1.0 + fabs(time))))
        return tell(instance, BAD, "a step starts at another time than the last one ended");
    if (!(length > 0.0)) return tell(instance, BAD, "the length of a step is not positive");
    const char *error = advance(&instance->now, &instance->own, time + length);
    instance->stale = 1;
    return ended(instance, error);
}

static Status save(Instance *instance, void **kept) {
    if (!*kept) *kept = malloc(KEPT);
    if (!*kept) return tell(instance, BAD, "there is not enough memory to keep a state");
    memcpy(*kept, instance, KEPT);
    return GOOD;
}

static Status restore(Instance *instance, const void *kept) {
    memcpy(instance, kept, KEPT);
    instance->stale = 1;
    return GOOD;
}

static Status copy_snapshot(Instance *instance, void *to, const void *from, size_t size) {
    if (size != KEPT) return tell(instance, BAD, "the size of a kept state is wrong");
    memcpy(to, from, size);
    return GOOD;
}

static Status read_snapshot(Instance *instance, const void *bytes, size_t size, void **kept) {
    if (!*kept) *kept = malloc(KEPT);
    if (!*kept) return tell(instance, BAD, "there is not enough memory to keep a state");
    return copy_snapshot(instance, *kept, bytes, size);
}
