
/* Integration of the equations by Dormand and Prince's method of order 8 with dense output of order 7, or by Gauss
   collocation if they are stiff, with error control and projection of each state onto the loops.

   Source: E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), sections
   II.5, II.6 and II.10, and II (1996), section IV.8. A state holds coordinates in units, quaternions of ball joints,
   rates, states of actuators, work and loss. */

/* coefficients of DOP853 by E. Hairer; stages 13 to 15 are those of the dense output */
static const double STAGES[16][15] = {
    {0},
    {0.05260015195876773},
    {0.0197250569845379, 0.0591751709536137},
    {0.02958758547680685, 0, 0.08876275643042054},
    {0.2413651341592667, 0, -0.8845494793282861, 0.924834003261792},
    {0.037037037037037035, 0, 0, 0.17082860872947386, 0.12546768756682242},
    {0.037109375, 0, 0, 0.17025221101954405, 0.06021653898045596, -0.017578125},
    {0.03709200011850479, 0, 0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
     0.008273789163814023},
    {0.6241109587160757, 0, 0, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
     20.154067550477894, -43.48988418106996},
    {0.47766253643826434, 0, 0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
     15.279233632882423, -33.28821096898486, -0.020331201708508627},
    {-0.9371424300859873, 0, 0, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
     -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196},
    {2.273310147516538, 0, 0, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
     27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636},
    {0.054293734116568765, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
     0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259},
    {0.056167502283047954, 0, 0, 0, 0, 0, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637,
     0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298},
    {0.03183464816350214, 0, 0, 0, 0, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099, 0,
     0, -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325},
    {-0.42889630158379194, 0, 0, 0, 0, -4.697621415361164, 7.683421196062599, 4.06898981839711,
     0.3567271874552811, 0, 0, 0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987}};
static const double ERRORS[2][12] = {
    {-0.18980075407240762, 0, 0, 0, 0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
     -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082},
    {0.01312004499419488, 0, 0, 0, 0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
     -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294}};
static const double DENSE[4][16] = {
    {-8.428938276109013, 0, 0, 0, 0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207,
     2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331,
     18.148505520854727, -9.194632392478356, -4.436036387594894},
    {10.427508642579134, 0, 0, 0, 0, 242.28349177525817, 165.20045171727028, -374.5467547226902,
     -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845,
     -31.139403219565178, -9.35292435884448, 35.81684148639408},
    {19.985053242002433, 0, 0, 0, 0, -387.0373087493518, -189.17813819516758, 527.8081592054236,
     -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508,
     -60.19669523126412, 84.32040550667716, 11.99229113618279},
    {-25.69393346270375, 0, 0, 0, 0, -154.18974869023643, -231.5293791760455, 357.6391179106141,
     93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114,
     96.32455395918828, -39.17726167561544, -149.72683625798564}};

enum { FINISHED, FULL, SINGULAR, FAILED };
/* numbers of a step: its start, duration, and EnergyBalance and fastest rate at its end */
#define STEP 6
/* next step: fraction of the longest one, smallest and largest ratio; first change of the state */
#define SAFETY 0.9
#define LEAST 0.2
#define LARGEST 8.0
/* relative disturbance of a state that shows the noise of its slopes, its fading, multiple of it that an error may be,
   and error above which it is measured */
#define DISTURBANCE 4e-16
#define FADING 0.9
#define NOISE 2.0
#define NOISY 0.4
#define FIRST_CHANGE 0.01
/* shortest step, relative to the spacing of doubles at its time */
#define SPACINGS 10.0
/* residual of closed loops that is rounding, and the largest that counts as closed */
#define ROUNDING 1e-15
#define CLOSED 1e-12
#define ITERATIONS 10
/* kinetic energy relative to the largest below which rates are not scaled */
#define SLOW 1e-2
/* the same relative to the potential energy, whose rounding is then near the tolerance of a step */
#define ROUNDED 1e-3
/* of collocation, as mechsim.numerics.gauss_collocation: nodes, last coefficients that are the error, iterations;
   ratio of changes and multiple of the tolerance beyond which a change is rounding; next step */
#define NODES 12
#define TAIL 3
#define NEWTON_ITERATIONS 20
#define SHRINKING 0.5
/* change of Newton's method, relative to the tolerance, that is small enough (Hairer and Wanner, Solving Ordinary
   Differential Equations II, IV.8: 0.1 to 0.01) */
#define NEGLIGIBLE 0.01
#define STIFF_ROUNDING 30.0
#define STIFF_SAFETY 0.85
#define STIFF_LARGEST 3.0
/* degree of the polynomial that continues the last step, and difference of rates relative to the fastest */
#define CONTINUED 9
#define DIFFERENCE 1e-7
/* as forward_dynamics.py */
#define STRIBECK_RANGE 6.0

/* memory filled with zeros; a header without allocation has its own */
#ifndef ALLOCATE
#define ALLOCATE(bytes) calloc(1, bytes)
#define RELEASE(memory) free(memory)
#endif

typedef struct {
    double time, end, tolerance, length, longest, nearest, fastest, energy, correction, largest, drift, lower, upper;
    /* watched: number of a coordinate, from 1 on, that ends the steps beyond `lower` or `upper`; 0 for none */
    int rank, implicit, resting, max_steps, steps, evaluations, status, watched;
    const int *at_rest;
    const double *phase;
    /* origin: state from which displacements count; rule: `collocation_rule` of compiled_motion.py */
    const double *sliding, *scale, *origin, *rule;
    /* state; numbers of each step (STEP); start state and coefficients of each step */
    double *state, *step, *dense;
} Run;

static int positions(const Model *m) { return m->count + 4 * m->balls; }

static int size_of(const Model *m) { return positions(m) + m->count + m->states + 2; }

static Work *workspace(const Model *m, int resting) {
    int n = m->free, k = m->count, rows = m->rows + resting, loaded = m->loaded;
    struct { size_t offset, count; } parts[] = {
        {offsetof(Work, q), k}, {offsetof(Work, turns), 9 * m->balls}, {offsetof(Work, position), 3 * m->links},
        {offsetof(Work, rotation), 9 * m->links}, {offsetof(Work, unit_twist), 6 * k},
        {offsetof(Work, twist), 6 * m->links}, {offsetof(Work, bias), 6 * m->links},
        {offsetof(Work, force), 6 * m->links}, {offsetof(Work, inertia), 13 * m->links},
        {offsetof(Work, rows), rows * n}, {offsetof(Work, residual), rows}, {offsetof(Work, gamma), rows},
        {offsetof(Work, mass), n * n}, {offsetof(Work, effort), n}, {offsetof(Work, reflectors), n * n},
        {offsetof(Work, bits), rows}, {offsetof(Work, vector), n}, {offsetof(Work, basis), n * n + 2 * n},
        {offsetof(Work, reduced), n * n}, {offsetof(Work, applied), k}, {offsetof(Work, inflow), m->states},
        {offsetof(Work, norms), rows}, {offsetof(Work, speed), m->driven}, {offsetof(Work, moving), n * n},
        {offsetof(Work, own), 13 * m->links}, {offsetof(Work, across), 6 * m->rows},
        {offsetof(Work, multiplier), m->rows}, {offsetof(Work, twisting), 6 * m->links},
        {offsetof(Work, carried), 6 * m->links + loaded}, {offsetof(Work, pull), 6 * m->links},
        {offsetof(Work, push), n}, {offsetof(Work, magnitude), 4 * loaded}, {offsetof(Work, moved), n * loaded},
        {offsetof(Work, terms), 12 * loaded * (loaded + 1)}};
    size_t total = 0, count = sizeof parts / sizeof *parts;
    for (size_t i = 0; i < count; i++) total += parts[i].count;
    char *memory = ALLOCATE(sizeof(Work) + total * sizeof(double) + ((3 + n) * rows + (7 + n) * n) * sizeof(int));
    if (!memory) return NULL;
    double *next = (double *)(memory + sizeof(Work));
    for (size_t i = 0; i < count; i++) {
        *(double **)(memory + parts[i].offset) = next;
        next += parts[i].count;
    }
    Work *w = (Work *)memory;
    w->order = (int *)next, w->dependent = w->order + rows, w->begin = w->dependent + rows;
    w->entries = w->begin + n, w->pivots = w->entries + n, w->eliminated = w->pivots + n;
    w->marked = w->eliminated + n, w->couplings = w->marked + n, w->first = w->couplings + n;
    w->coupled = w->first + n, w->columns = w->coupled + n * n, w->lengths = w->columns + rows * n;
    find_couplings(m, w);
    return w;
}

/* derivative of a state; FINISHED if it is defined. At `stages` of a step the dependent rows remain the same */
static int derive(const Model *m, Work *w, Run *run, double time, const double *state, double *out, int stages) {
    const double *rates = state + positions(m);
    run->evaluations++;
    w->time = time;
    set_poses(m, w, state);
    set_velocities(m, w, rates);
    int rows = set_rows(m, w, rates, run->resting, run->at_rest, stages);
    set_forces(m, w, rates, run->sliding, run->phase);
    set_equations(m, w, rates);
    if (!accelerate(m, w, rows) || (m->loaded && !add_friction_by_load(m, w, run->sliding))) return FAILED;
    /* the multiplier of a prescribed coordinate is its drive force */
    for (int i = 0; i < m->driven; i++) w->power_in += w->multiplier[m->rows - m->driven + i] * w->speed[i];
    for (int i = 0; i < rows && !stages; i++) w->dependent[w->order[i]] = i >= w->rank;
    if (!run->resting && (w->rank < run->rank || w->smallest < run->nearest)) return SINGULAR;
    memcpy(out, rates, m->count * sizeof(double));
    double *turning = out + m->count, *acceleration = out + positions(m);
    const double *q = state + m->count;
    for (int i = 0; i < m->links; i++) {
        const Branch *b = m->branches + i;
        if (!b->ball) continue;
        const double *spin = rates + b->first + b->slides;
        memset(out + b->first + b->slides, 0, 3 * sizeof(double));
        turning[0] = -0.5 * dot(spin, q + 1);
        cross(spin, q + 1, turning + 1);
        for (int j = 0; j < 3; j++) turning[1 + j] = 0.5 * (turning[1 + j] + q[0] * spin[j]);
        turning += 4, q += 4;
    }
    for (int k = 0; k < m->count; k++) {
        int column = m->coordinates[k].column;
        acceleration[k] = column < 0 ? 0.0 : w->vector[column];
    }
    double *more = acceleration + m->count;
    memcpy(more, w->inflow, m->states * sizeof(double));
    more[m->states] = w->power_in, more[m->states + 1] = w->power_lost;
    return FINISHED;
}

/* displaces a state by a step of the free coordinates in units */
static void displace(const Model *m, const double *step, double *state) {
    double *q = state + m->count;
    for (int k = 0; k < m->count; k++)
        if (m->coordinates[k].column >= 0) state[k] += step[m->coordinates[k].column];
    for (int i = 0; i < m->links; i++) {
        const Branch *b = m->branches + i;
        if (!b->ball) continue;
        int first = b->first + b->slides, column = m->coordinates[first].column;
        memset(state + first, 0, 3 * sizeof(double));
        const double *turn = column < 0 ? STILL : step + column;
        double angle = sqrt(dot(turn, turn)), c = cos(0.5 * angle), old[4];
        double s = angle > 1e-8 ? sin(0.5 * angle) / angle : 0.5;
        memcpy(old, q, sizeof old);
        q[0] = c * old[0] - s * dot(turn, old + 1);
        cross(turn, old + 1, q + 1);
        for (int j = 0; j < 3; j++) q[1 + j] = s * q[1 + j] + c * old[1 + j] + s * old[0] * turn[j];
        double length = sqrt(q[0] * q[0] + dot(q + 1, q + 1));
        for (int j = 0; j < 4; j++) q[j] /= length;
        q += 4;
    }
}

/* moves a state to the nearest configuration with closed loops at the time of `w`, and its rates to the nearest
 * consistent ones */
static int project(const Model *m, Work *w, Run *run, double *state) {
    double *rates = state + positions(m), worst = 0.0;
    for (int i = 0;; i++) {
        double before = worst;
        set_poses(m, w, state);
        int rows = set_rows(m, w, NULL, 0, NULL, 0);
        worst = 0.0;
        for (int k = 0; k < rows; k++) worst = fmax(worst, fabs(w->residual[k]));
        if (!(worst > ROUNDING) || i == ITERATIONS || (i && worst > 0.5 * before)) break;
        factor(rows, m->free, w);
        least_norm(m->free, w, -1.0, w->residual, w->vector);
        displace(m, w->vector, state);
    }
    if (!(worst <= CLOSED)) return FAILED;
    int rows = set_rows(m, w, NULL, run->resting, run->at_rest, 0);
    for (int k = 0; k < m->count; k++)
        if (m->coordinates[k].column >= 0) w->effort[m->coordinates[k].column] = rates[k];
    for (int k = 0; k < m->rows + run->resting; k++) {
        w->gamma[k] = 0.0;
        for (int i = 0; i < w->lengths[k]; i++) {
            int column = w->columns[k * m->free + i];
            w->gamma[k] += w->rows[k * m->free + column] * w->effort[column];
        }
    }
    for (int i = 0; i < m->driven; i++) w->gamma[m->rows - m->driven + i] -= w->speed[i];
    factor(rows, m->free, w);
    least_norm(m->free, w, -1.0, w->gamma, w->vector);
    for (int k = 0; k < m->count; k++)
        if (m->coordinates[k].column >= 0) rates[k] += w->vector[m->coordinates[k].column];
    return FINISHED;
}

/* scales the rates of a state to its energy, as EnergyBalance of forward_dynamics.py */
static void balance(const Model *m, Work *w, Run *run, double *state) {
    double *rates = state + positions(m), *energies = rates + m->count + m->states, gained = energies[0] - energies[1];
    if (!run->implicit && !m->driven) {
        set_velocities(m, w, rates);
        set_forces(m, w, rates, run->sliding, run->phase);
        double target = run->energy + gained - w->potential;
        run->largest = fmax(run->largest, w->kinetic);
        double least = fmax(SLOW * run->largest, ROUNDED * (fabs(run->energy) + fabs(w->potential)));
        if (w->kinetic >= least && 0.5 * w->kinetic < target && target < 2.0 * w->kinetic) {
            double factor = sqrt(target / w->kinetic);
            run->correction += target - w->kinetic;
            run->drift = fmax(run->drift, fabs(run->correction));
            for (int k = 0; k < m->count; k++) rates[k] *= factor;
        }
    }
    for (int k = 0; k < m->count; k++) run->fastest = fmax(run->fastest, fabs(rates[k]));
}

/* fraction of a step at which a stage lies */
static double node(int stage) {
    double sum = 0.0;
    for (int j = 0; j < 15; j++) sum += STAGES[stage][j];
    return sum;
}

/* state at a stage after a step of `length` */
static void stage(int size, int number, double length, const double *state, const double *slopes, double *out) {
    memcpy(out, state, size * sizeof(double));
    for (int j = 0; j < number && j < 15; j++)
        if (STAGES[number][j] != 0.0) add_scaled(size, length * STAGES[number][j], slopes + j * size, out);
}

/* allowed error of a component in a step, relative to its displacement since the start of the run */
static double step_tolerance(const Run *run, int i, double value) {
    return run->tolerance * (run->scale[i] + fabs(value - run->origin[i]));
}

/* error of a step relative to the tolerance or the noise of the slopes, from the slopes of its stages. Where a table's
   third derivative jumps, the estimate of order 3 tells nothing */
static double step_error(const Model *m, const Run *run, int size, const double *after, const double *slopes, double length,
                         const double *noise) {
    double fifth = 0.0, third = 0.0;
    for (int i = 0; i < size - 2; i++) {
        double errors[2] = {0.0};
        for (int k = 0; k < 2; k++)
            for (int j = 0; j < 12; j++) errors[k] += ERRORS[k][j] * slopes[j * size + i];
        double scale = fmax(step_tolerance(run, i, run->state[i]), step_tolerance(run, i, after[i]));
        scale = fmax(scale, NOISE * length * noise[i]);
        third += errors[0] * errors[0] / (scale * scale);
        fifth += errors[1] * errors[1] / (scale * scale);
    }
    if (m->tabled) third = 0.0;
    return fifth > 0.0 ? length * fifth / sqrt((fifth + 0.01 * third) * (size - 2)) : third;
}

/* start state and coefficients of the dense output: see `DenseSteps` of compiled_motion.py */
static void set_dense(int size, double length, const double *state, const double *after, const double *slopes,
                      double *out) {
    for (int i = 0; i < size; i++) {
        double change = after[i] - state[i], first = length * slopes[i], last = length * slopes[12 * size + i];
        out[i] = state[i], out[size + i] = change, out[2 * size + i] = first - change;
        out[3 * size + i] = 2.0 * change - first - last;
        for (int k = 0; k < 4; k++) {
            double sum = 0.0;
            for (int j = 0; j < 16; j++) sum += DENSE[k][j] * slopes[j * size + i];
            out[(4 + k) * size + i] = length * sum;
        }
    }
}

/* moves the end of a step onto the loops and the balance of energy; sets its derivative */
static int close_step(const Model *m, Work *w, Run *run, double length, double *after, double *slope) {
    w->time = run->time + length;
    if (project(m, w, run, after)) return FAILED;
    balance(m, w, run, after);
    return derive(m, w, run, run->time + length, after, slope, 0);
}

static void accept(Run *run, int size, double length, const double *after) {
    double *numbers = run->step + run->steps * STEP;
    numbers[0] = run->time, numbers[1] = length;
    numbers[2] = run->correction, numbers[3] = run->largest, numbers[4] = run->drift;
    numbers[5] = run->fastest;
    run->time = length == run->end - run->time ? run->end : run->time + length;
    memcpy(run->state, after, size * sizeof(double));
}

/* longest step from a state with these slopes that resolves Stribeck's curves: beyond STRIBECK_RANGE times their rate
   v_s half of what is left to it, within it a change of the rate by v_s */
static double resolving(const Model *m, Work *w, const Run *run, const double *slopes) {
    double longest = run->longest, wrench[6], rate, change;
    for (int i = 0; i < m->resistances; i++) {
        const Resistance *r = m->resistance + i;
        if (!(r->stribeck > 0.0)) continue;
        set_poses(m, w, run->state);
        set_velocities(m, w, slopes + positions(m));
        along_resistance(r, w, &change, wrench);
        set_velocities(m, w, run->state + positions(m));
        along_resistance(r, w, &rate, wrench);
        double beyond = 0.5 * (fabs(rate) - STRIBECK_RANGE * r->stribeck);
        longest = fmin(longest, fmax(r->stribeck, beyond) / fabs(change));
    }
    return longest;
}

/* length of the next trial: the end is not approached by a step that is much shorter than the others */
static double trial_length(const Run *run, double longest) {
    double remaining = run->end - run->time, length = fmin(run->length, longest);
    return length > 0.99 * remaining ? remaining : fmin(length, 0.5 * remaining);
}

static int too_short(const Run *run, double length) { return !(length > SPACINGS * 2.3e-16 * fabs(run->time)); }

/* measures the noise of the slopes, whose rounding an almost massless rotation amplifies; shorter steps do not reduce it */
static int measure_noise(const Model *m, Work *w, Run *run, const double *slopes, double *trial, double *noise) {
    int size = size_of(m);
    double *changed = trial + size;
    for (int i = 0; i < size; i++) trial[i] = run->state[i] * (i % 2 ? 1.0 + DISTURBANCE : 1.0 - DISTURBANCE);
    int status = derive(m, w, run, run->time, trial, changed, 1);
    for (int i = 0; i < size && !status; i++) noise[i] = fmax(FADING * noise[i], fabs(changed[i] - slopes[i]));
    return status;
}

/* one accepted step; slopes[0] is the derivative at its start */
static int take_step(const Model *m, Work *w, Run *run, double *slopes, double *after, double *trial, double *noise) {
    int size = size_of(m), status = FINISHED;
    double longest = resolving(m, w, run, slopes);
    for (int rejected = 0;; rejected = 1) {
        double length = trial_length(run, longest);
        if (too_short(run, length)) return status ? status : FAILED;
        status = FINISHED;
        for (int s = 1; s < 12 && status == FINISHED; s++) {
            stage(size, s, length, run->state, slopes, trial);
            status = derive(m, w, run, run->time + node(s) * length, trial, slopes + s * size, 1);
        }
        if (status == SINGULAR) return status;
        double error = NAN;
        if (status == FINISHED) {
            stage(size, 12, length, run->state, slopes, after);
            error = step_error(m, run, size, after, slopes, length, noise);
            if (error > NOISY && error < INFINITY && !measure_noise(m, w, run, slopes, trial, noise))
                error = step_error(m, run, size, after, slopes, length, noise);
        }
        double ratio = error < INFINITY ? SAFETY * pow(fmax(error, 1e-30), -0.125) : LEAST;
        run->length = length * fmin(fmax(ratio, LEAST), rejected ? 1.0 : LARGEST);
        if (!(error <= 1.0)) {
            run->length = fmin(run->length, 0.9 * length);
            continue;
        }
        double *dense = run->dense + (size_t)run->steps * 8 * size;
        memcpy(trial, after, size * sizeof(double));
        if ((status = close_step(m, w, run, length, trial, slopes + 12 * size))) return status;
        for (int s = 13; s < 16; s++) {
            stage(size, s, length, run->state, slopes, dense);
            if ((status = derive(m, w, run, run->time + node(s) * length, dense, slopes + s * size, 1))) return status;
        }
        set_dense(size, length, run->state, after, slopes, dense);
        accept(run, size, length, trial);
        memcpy(slopes, slopes + 12 * size, size * sizeof(double));
        return FINISHED;
    }
}

/* Gauss collocation. Newton's method takes the derivatives of the tangents' accelerations by the rates along them, and
   those of the actuators' states; nothing else is stiff. Of node i: tangents B_i, reduced Jacobian K_i, and
   c_i = B_i' (change of its rates). With the residuals R and the matrix A of the integrals,
   c_i - sum_j A_ij B_i' B_j K_j c_j = B_i' R_i, and the changes are R_i + sum_j A_ij B_j K_j c_j. */
typedef struct {
    /* numbers of tangents and of stiff variables */
    int tangents, count, *pivots;
    double *states, *slopes, *residuals, *bases, *jacobians, *matrix, *change, *moved;
} Nodes;

static Nodes *nodes_of(const Model *m, int tangents) {
    int size = size_of(m), p = tangents + m->states;
    size_t one = (size_t)NODES * size, parts[] = {one, one, one, (size_t)NODES * tangents * m->free,
        (size_t)NODES * (p + 2) * p, (size_t)NODES * NODES * p * p, (size_t)2 * NODES * (p + 2), (size_t)2 * size};
    size_t total = 0, count = sizeof parts / sizeof *parts;
    for (size_t i = 0; i < count; i++) total += parts[i];
    Nodes *x = ALLOCATE(sizeof(Nodes) + total * sizeof(double) + NODES * p * sizeof(int));
    if (!x) return NULL;
    double *next = (double *)(x + 1), **arrays = &x->states;
    for (size_t i = 0; i < count; i++) arrays[i] = next, next += parts[i];
    x->tangents = tangents, x->count = p, x->pivots = (int *)next;
    return x;
}

/* solves L U x = b with row exchanges, in place; `factored` tells whether `a` holds L and U */
static int solve_general(int n, double *a, int *pivots, double *b, int factored) {
    for (int k = 0; k < n && !factored; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
        if (!(fabs(a[best * n + k]) > 0.0)) return 0;
        pivots[k] = best;
        for (int j = 0; j < n && best != k; j++) {
            double kept = a[k * n + j];
            a[k * n + j] = a[best * n + j], a[best * n + j] = kept;
        }
        for (int i = k + 1; i < n; i++) {
            a[i * n + k] /= a[k * n + k];
            if (a[i * n + k] != 0.0) add_scaled(n - k - 1, -a[i * n + k], a + k * n + k + 1, a + i * n + k + 1);
        }
    }
    for (int k = 0; k < n; k++) {
        double kept = b[k];
        b[k] = b[pivots[k]], b[pivots[k]] = kept;
    }
    for (int i = 0; i < n; i++) b[i] -= inner(i, a + i * n, b);
    for (int i = n - 1; i >= 0; i--) b[i] = (b[i] - inner(n - 1 - i, a + i * n + i + 1, b + i + 1)) / a[i * n + i];
    return 1;
}

/* stiff variables of a state, or of its change: rates along tangents, states of actuators; then work and loss, which
   follow from them */
static void reduce(const Model *m, const Nodes *x, const double *basis, const double *state, double *out) {
    const double *rates = state + positions(m);
    for (int a = 0; a < x->tangents; a++) {
        out[a] = 0.0;
        for (int k = 0; k < m->count; k++)
            if (m->coordinates[k].column >= 0) out[a] += basis[a * m->free + m->coordinates[k].column] * rates[k];
    }
    memcpy(out + x->tangents, rates + m->count, (m->states + 2) * sizeof(double));
}

/* adds a multiple of stiff variables to a state */
static void expand(const Model *m, const Nodes *x, const double *basis, double factor, const double *change,
                   double *state) {
    double *rates = state + positions(m);
    for (int a = 0; a < x->tangents; a++)
        for (int k = 0; k < m->count; k++)
            if (m->coordinates[k].column >= 0)
                rates[k] += factor * change[a] * basis[a * m->free + m->coordinates[k].column];
    add_scaled(m->states + 2, factor, change + x->tangents, rates + m->count);
}

/* tangents and reduced Jacobian of a node, by differences */
static int linearise_node(const Model *m, Work *w, Run *run, Nodes *x, double time, int node) {
    int size = size_of(m), p = x->count;
    double *basis = x->bases + node * x->tangents * m->free, *slope = x->slopes + node * size, *moved = x->moved;
    int status = derive(m, w, run, time, x->states + node * size, slope, 1);
    if (status) return status;
    if (m->free - w->rank != x->tangents) return FAILED;
    memcpy(basis, w->basis, x->tangents * m->free * sizeof(double));
    for (int a = 0; a < p; a++) {
        double step = DIFFERENCE * (a < x->tangents ? fmax(run->fastest, 1.0) : 1.0);
        double *unit = x->change, *by = unit + p + 2;
        memset(unit, 0, (p + 2) * sizeof(double));
        unit[a] = step;
        memcpy(moved, x->states + node * size, size * sizeof(double));
        expand(m, x, basis, 1.0, unit, moved);
        if ((status = derive(m, w, run, time, moved, moved + size, 1))) return status;
        add_scaled(size, -1.0, slope, moved + size);
        reduce(m, x, basis, moved + size, by);
        for (int b = 0; b < p + 2; b++) x->jacobians[(node * (p + 2) + b) * p + a] = by[b] / step;
    }
    return FINISHED;
}

/* matrix of Newton's method */
static void set_newton_matrix(const Model *m, const Nodes *x, double length, const double *integrals) {
    int p = x->count, t = x->tangents, n = m->free;
    for (int i = 0; i < NODES; i++)
        for (int j = 0; j < NODES; j++)
            for (int a = 0; a < p; a++)
                for (int b = 0; b < p; b++) {
                    const double *column = x->jacobians + j * (p + 2) * p + b;
                    double sum = a >= t ? column[a * p] : 0.0;
                    for (int c = 0; c < t && a < t; c++)
                        sum += inner(n, x->bases + (i * t + a) * n, x->bases + (j * t + c) * n) * column[c * p];
                    x->matrix[((i * p + a) * NODES + j) * p + b] =
                        (i == j && a == b) - length * integrals[i * NODES + j] * sum;
                }
}

/* replaces the residuals at the nodes by the changes of Newton's method */
static int newton_changes(const Model *m, Nodes *x, double length, const double *integrals, int factored) {
    int size = size_of(m), p = x->count, t = x->tangents;
    double *bend = x->change + NODES * (p + 2);
    for (int i = 0; i < NODES; i++)
        reduce(m, x, x->bases + i * t * m->free, x->residuals + i * size, x->change + i * p);
    if (!solve_general(NODES * p, x->matrix, x->pivots, x->change, factored)) return 0;
    for (int j = 0; j < NODES; j++)
        for (int a = 0; a < p + 2; a++)
            bend[j * (p + 2) + a] = inner(p, x->jacobians + (j * (p + 2) + a) * p, x->change + j * p);
    for (int i = 0; i < NODES; i++)
        for (int j = 0; j < NODES; j++)
            expand(m, x, x->bases + j * t * m->free, length * integrals[i * NODES + j], bend + j * (p + 2),
                   x->residuals + i * size);
    return 1;
}

/* states at the nodes; the last change relative to the tolerance, NAN without a solution */
static double collocate(const Model *m, Work *w, Run *run, Nodes *x, double length, int *status) {
    int size = size_of(m);
    const double *nodes = run->rule, *integrals = nodes + NODES;
    double before = INFINITY;
    for (int i = 0; i < NODES; i++)
        if ((*status = linearise_node(m, w, run, x, run->time + nodes[i] * length, i))) return NAN;
    set_newton_matrix(m, x, length, integrals);
    for (int k = 0; k < NEWTON_ITERATIONS; k++) {
        for (int i = 0; k && i < NODES; i++) {
            double time = run->time + nodes[i] * length;
            if ((*status = derive(m, w, run, time, x->states + i * size, x->slopes + i * size, 1))) return NAN;
        }
        for (int i = 0; i < NODES; i++) {
            double *residual = x->residuals + i * size;
            for (int c = 0; c < size; c++) residual[c] = run->state[c] - x->states[i * size + c];
            for (int j = 0; j < NODES; j++)
                add_scaled(size, length * integrals[i * NODES + j], x->slopes + j * size, residual);
        }
        if (!newton_changes(m, x, length, integrals, k)) return NAN;
        double change = 0.0;
        for (int i = 0; i < NODES; i++)
            for (int c = 0; c < size; c++) {
                double tolerance = step_tolerance(run, c, run->state[c]);
                double relative = fabs(x->residuals[i * size + c]) / tolerance;
                change = relative <= change ? change : relative;
            }
        add_scaled(NODES * size, 1.0, x->residuals, x->states);
        if (!(change < INFINITY)) return NAN;
        if (change < NEGLIGIBLE || (SHRINKING * before < change && change < STIFF_ROUNDING)) return change;
        before = change;
    }
    return NAN;
}

/* first states at the nodes: those of the last step's polynomial, or along the derivative at the start */
static void predict(const Run *run, const Nodes *x, int size, double length, const double *slope) {
    const double *last = run->steps ? run->dense + (size_t)(run->steps - 1) * (NODES + 1) * size : NULL;
    for (int i = 0; i < NODES; i++) {
        double *state = x->states + i * size, ahead = run->rule[i] * length;
        memcpy(state, run->state, size * sizeof(double));
        if (!last) add_scaled(size, ahead, slope, state);
        double at = 1.0 + ahead / (last ? run->step[(run->steps - 1) * STEP + 1] : 1.0);
        for (int c = 0; last && c < size; c++) {
            double sum = 0.0;
            for (int k = CONTINUED; k > 0; k--) sum = (sum + last[k * size + c]) * (k % 2 ? at : 1.0 - at);
            state[c] += sum - last[size + c];
        }
    }
}

/* one accepted step by collocation; `slope` is the derivative at its start */
static int take_implicit_step(const Model *m, Work *w, Run *run, Nodes *x, double *slope) {
    int size = size_of(m), status = FINISHED;
    const double *to_dense = run->rule + NODES + NODES * NODES, *to_tail = to_dense + NODES * NODES;
    double longest = resolving(m, w, run, slope);
    for (;;) {
        double length = trial_length(run, longest), error = 0.0, *dense = run->dense + (size_t)run->steps * (NODES + 1) * size;
        if (too_short(run, length)) return status ? status : FAILED;
        predict(run, x, size, length, slope);
        double change = collocate(m, w, run, x, length, &status);
        if (status == SINGULAR) return status;
        run->length = 0.5 * length;
        if (!(change < INFINITY)) continue;
        memcpy(dense, run->state, size * sizeof(double));
        memset(dense + size, 0, (size_t)NODES * size * sizeof(double));
        for (int i = 0; i < NODES; i++) add_scaled(size, -1.0, run->state, x->states + i * size);
        for (int k = 0; k < NODES; k++)
            for (int j = 0; j < NODES; j++)
                add_scaled(size, to_dense[k * NODES + j], x->states + j * size, dense + (k + 1) * size);
        for (int c = 0; c < size; c++)
            for (int k = 0; k < TAIL; k++) {
                double sum = 0.0, tolerance = step_tolerance(run, c, run->state[c]);
                for (int j = 0; j < NODES; j++) sum += to_tail[k * NODES + j] * x->states[j * size + c];
                error = fmax(error, fabs(sum) / tolerance);
            }
        /* a shorter step does not reduce rounding */
        double ratio = STIFF_SAFETY * pow(fmax(error, 1e-16), -1.0 / NODES);
        ratio = 1.0 < error && error <= change ? 1.0 : fmin(fmax(ratio, LEAST), STIFF_LARGEST);
        int accepted = error <= fmax(1.0, change);
        /* after an accepted step neither: where rounding is the error, steps would become shorter and shorter */
        run->length = length * (accepted ? fmax(ratio, 1.0) : fmin(ratio, 0.5));
        if (!accepted) continue;
        memcpy(x->moved, run->state, size * sizeof(double));
        add_scaled(size, 1.0, dense + size, x->moved);
        if ((status = close_step(m, w, run, length, x->moved, slope))) return status;
        accept(run, size, length, x->moved);
        return FINISHED;
    }
}

static int beyond(const Run *run) {
    double value = run->watched ? run->state[run->watched - 1] : 0.0;
    return run->watched && run->steps && !(run->lower <= value && value <= run->upper);
}

/* integrates until the end or a watched value, or until there is no space for more steps, or no step is possible */
int integrate(const Model *m, Run *run) {
    int size = size_of(m);
    Work *w = workspace(m, run->resting);
    double *slopes = ALLOCATE((size_t)size * 20 * sizeof(double));
    run->steps = run->evaluations = 0, run->status = FAILED;
    if (w && slopes) run->status = derive(m, w, run, run->time, run->state, slopes, 0);
    if (run->status == FINISHED && !(run->length > 0.0)) {
        double change = 0.0;
        for (int i = 0; i < size; i++) change = fmax(change, fabs(slopes[i]) / run->scale[i]);
        run->length = change > 0.0 ? FIRST_CHANGE / change : run->end - run->time;
    }
    Nodes *x = run->status == FINISHED && run->implicit ? nodes_of(m, m->free - w->rank) : NULL;
    if (run->status == FINISHED && run->implicit && !x) run->status = FAILED;
    while (run->status == FINISHED && run->time < run->end && !beyond(run)) {
        double *after = slopes + 16 * size, *trial = after + size;
        run->status = run->steps == run->max_steps ? FULL
                    : run->implicit                ? take_implicit_step(m, w, run, x, slopes)
                                                   : take_step(m, w, run, slopes, after, trial, trial + 2 * size);
        run->steps += run->status == FINISHED;
    }
    RELEASE(slopes);
    RELEASE(x);
    RELEASE(w);
    return run->status;
}

/* derivatives and energies of states at times, each moved onto the loops first if `closing`; sets rank and
   smallest pivot of the loops at the last one */
int evaluate(const Model *m, Run *run, int count, const double *times, int closing, double *states,
             double *derivatives, double *energies) {
    int size = size_of(m), status = FINISHED;
    Work *w = workspace(m, run->resting);
    if (!w) return FAILED;
    for (int i = 0; i < count && status == FINISHED; i++, states += size, derivatives += size) {
        w->time = times[i];
        if (closing) status = project(m, w, run, states);
        if (status == FINISHED) status = derive(m, w, run, times[i], states, derivatives, 0);
        energies[2 * i] = w->kinetic, energies[2 * i + 1] = w->potential;
    }
    run->rank = w->rank, run->nearest = w->smallest;
    RELEASE(w);
    return status;
}
