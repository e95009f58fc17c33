
/* A dynamic model as an FMU. Its states are coordinates, quaternions, rates and states of actuators in SI; derivatives
   and outputs belong to the nearest state that satisfies the loops. */

typedef struct {
    /* of the C integrator, at the last instant: work and loss, balance of energy, proposed length of the next step */
    double energies[2], energy, correction, largest, drift, fastest, length, rate, inertia;
    double value[VALUES];
} Snapshot;

typedef struct {
    Tables tables;
    Model model;
    Run run;
    Work *work;
    double *steps, *dense, state[SIZE], scale[SIZE];
} Own;

/* largest change of a start value that closes the loops, in units of its coordinate */
#define SAME 1e-9
/* number of steps between two calls of the integrator, and the largest number of such calls in one step of the FMU */
#define STEPS 16
#define CALLS 100000

static int prepare(Own *own) {
    own->tables = TABLES;
    connect(&own->model, &own->tables);
    own->work = workspace(&own->model, 0);
    own->steps = ALLOCATE(STEPS * STEP * sizeof(double));
    own->dense = ALLOCATE((size_t)STEPS * (NODES + 1) * SIZE * sizeof(double));
    own->run.sliding = NONE, own->run.phase = PHASES, own->run.rule = RULE;
    own->run.rank = RANK, own->run.tolerance = TOLERANCE, own->run.longest = LONGEST, own->run.implicit = IMPLICIT;
    own->run.step = own->steps, own->run.dense = own->dense, own->run.max_steps = STEPS;
    own->run.state = own->state, own->run.scale = own->scale, own->run.origin = INITIAL_STATE;
    return own->work && own->steps && own->dense;
}

static void discard(Own *own) {
    RELEASE(own->work);
    RELEASE(own->steps);
    RELEASE(own->dense);
}

static void start(Snapshot *now, Own *own) {
    (void)own;
    memset(now->energies, 0, sizeof now->energies);
    now->length = 0.0;
}

/* inputs and parameters in the tables; the state in the units of the equations */
static void read_values(const Snapshot *now, Own *own, double *state) {
    for (int i = INPUT; i < STATE; i++) *(double *)(void *)((char *)&own->tables + PLACES[i - INPUT]) = now->value[i];
    connect(&own->model, &own->tables);
    memcpy(state, INITIAL_STATE, SIZE * sizeof(double));
    for (int i = 0; i < STATES; i++) state[INDEX[i]] = now->value[STATE + i] / UNIT[i];
    memcpy(state + SIZE - 2, now->energies, sizeof now->energies);
}

/* derivatives and outputs of a state; `state` moves onto the loops */
static const char *evaluate_state(Snapshot *now, Own *own, double *state) {
    double slope[SIZE], *out = now->value + OUTPUT;
    Work *w = own->work;
    own->run.nearest = 0.0, own->run.time = w->time = now->value[0];
    if (project(&own->model, w, &own->run, state)) return "the loops do not close at the values of the states";
    int status = derive(&own->model, w, &own->run, now->value[0], state, slope, 0);
    if (status == SINGULAR) return "the configuration is singular: accelerations are not determined";
    if (status) return "the mass matrix is singular";
    for (int i = 0; i < STATES; i++) now->value[DERIVATIVE + i] = slope[INDEX[i]] * UNIT[i];
    for (int i = 0; i < POINTS; i++, out += 6) locate(w, POINT_LINK[i], POINT_PLACE[i], out, out + 3);
    out[0] = w->kinetic, out[1] = w->potential;
    return NULL;
}

static const char *compute(Snapshot *now, Own *own) {
    double state[SIZE];
    read_values(now, own, state);
    return evaluate_state(now, own, state);
}

/* scale of the states, as scale_of of compiled_motion.py */
static void set_scale(const Snapshot *now, double *scale) {
    for (int i = 0; i < SIZE; i++) scale[i] = 1.0;
    for (int i = 0; i < COUNT; i++) scale[POSITIONS + i] = now->rate;
    scale[SIZE - 2] = scale[SIZE - 1] = IMPLICIT ? now->inertia * now->rate * now->rate : 1e300;
}

/* takes the states at the start, which must satisfy the loops */
static const char *begin(Snapshot *now, Own *own) {
    double state[SIZE], given[SIZE], fastest = 0.0, change = 0.0;
    const Work *w = own->work;
    read_values(now, own, state);
    memcpy(given, state, sizeof given);
    const char *error = evaluate_state(now, own, state);
    if (error) return error;
    for (int i = 0; i < COUNT; i++) {
        fastest = fmax(fastest, fabs(state[POSITIONS + i]));
        if (fabs(state[i] - given[i]) > SAME) error = "the start values of the coordinates do not close the loops";
    }
    for (int i = 0; i < COUNT; i++)
        if (fabs(state[POSITIONS + i] - given[POSITIONS + i]) > SAME * fmax(fastest, 1.0))
            error = "the start values of the rates contradict the loops";
    if (error) return error;
    now->inertia = 0.0;
    for (int i = 0; i < own->model.free; i++) {
        change = fmax(change, fabs(w->vector[i]));
        now->inertia += w->mass[i * own->model.free + i];
    }
    now->rate = fmax(fmax(fastest, sqrt(change)), 1.0 / DURATION), now->fastest = fastest;
    now->energy = w->kinetic + w->potential, now->largest = w->kinetic;
    now->correction = now->drift = now->length = 0.0;
    for (int i = 0; i < STATES; i++) now->value[STATE + i] = state[INDEX[i]] * UNIT[i];
    return NULL;
}

/* integrates to an end */
static const char *advance(Snapshot *now, Own *own, double end) {
    double *state = own->state;
    Run *run = &own->run;
    read_values(now, own, state);
    set_scale(now, own->scale);
    run->time = now->value[0], run->end = end, run->length = now->length, run->nearest = NEAREST;
    run->fastest = now->fastest, run->energy = now->energy, run->correction = now->correction;
    run->largest = now->largest, run->drift = now->drift;
    int status = FULL;
    for (int i = 0; i < CALLS && status == FULL; i++) status = integrate(&own->model, run);
    if (status == SINGULAR) return "the motion comes too close to a singular configuration";
    if (status == FULL) return "a step needs too many steps of the integrator; shorten it";
    if (status) return "no step of the integrator is possible";
    now->value[0] = end, now->length = run->length, now->fastest = run->fastest;
    now->correction = run->correction, now->largest = run->largest, now->drift = run->drift;
    memcpy(now->energies, state + SIZE - 2, sizeof now->energies);
    for (int i = 0; i < STATES; i++) now->value[STATE + i] = state[INDEX[i]] * UNIT[i];
    return NULL;
}
