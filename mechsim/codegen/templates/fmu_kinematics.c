
/* A solver of configurations as an FMU: it follows the assembly to the positions of the drivers. */

typedef struct {
    @state state;
    double value[VALUES];
} Snapshot;

typedef struct {
    int none;
} Own;

static const char *const ERRORS[] = {
    NULL, "a driver is beyond the range of its assembly, or a rate is not finite",
    "the configuration is singular: the drivers do not determine the motion",
    "the configuration cannot be reached from the last one in steps"};

static int prepare(Own *own) { return (void)own, 1; }
static void discard(Own *own) { (void)own; }

static void start(Snapshot *now, Own *own) {
    /* not used: numbers of the model are parameters */
    (void)own, (void)@GRAVITY, (void)@solve_links;
#if TORQUES
    (void)@INERTIAS;
#endif
    @start(&now->state);
}

static const char *compute(Snapshot *now, Own *own) {
    (void)own;
    double *value = now->value, *out = value + OUTPUT, drivers[3][@DRIVERS];
    for (int i = 0; i < @DRIVERS; i++)
        for (int k = 0; k < 3; k++) drivers[k][i] = value[INPUT + 3 * i + k];
    int status = @solve(&now->state, drivers[0], drivers[1], drivers[2]);
    if (status != @SOLVED) return ERRORS[status];
    for (int i = 0; i < COORDINATES; i++, out += 3) {
        out[0] = now->state.coordinates[COORDINATE[i]], out[1] = now->state.rates[COORDINATE[i]];
        out[2] = now->state.accelerations[COORDINATE[i]];
    }
#if JOINTS
    @joint joints[@JOINTS];
    @solve_joints(&now->state, joints);
    for (int i = 0; i < @JOINTS; i++, out += 3) memcpy(out, joints[i].motion, 3 * sizeof(double));
#endif
#if POINTS
    @point points[@POINTS];
    @solve_points(&now->state, points);
    for (int i = 0; i < @POINTS; i++, out += 9) {
        memcpy(out, points[i].position, 3 * sizeof(double));
        memcpy(out + 3, points[i].velocity, 3 * sizeof(double));
        memcpy(out + 6, points[i].acceleration, 3 * sizeof(double));
    }
#endif
#if TORQUES
    @solve_torques(&now->state, value + PARAMETER + 3, value + PARAMETER, out);
#endif
    return NULL;
}

static const char *begin(Snapshot *now, Own *own) { return compute(now, own); }

static const char *advance(Snapshot *now, Own *own, double end) {
    const char *error = compute(now, own);
    if (!error) now->value[0] = end;
    return error;
}
