/* The forces of applied_controls.py as a callback of MuJoCo, at every stage of a step. */

/* nonlinear spring, whose control is the tension, or a soft stop on one side; `offset` is the length at which
   MuJoCo's is zero. The expression has the length as coordinate 0 and the rate as rate 0 */
typedef struct {
    int control, table, over_rate;
    double side, offset, rest, stiffness, damping, preload;
    Expression expression;
} Spring;

/* elastic mount, with the controls of force and moment on side a, then on side b */
typedef struct {
    int control;
    double stiffness[36], damping[36];
} Bushing;

/* dry friction, whose `count` controls oppose their rates */
typedef struct {
    int control, count;
    double magnitude;
} Dry;

/* an actuator that MuJoCo does not have: number of its control, and of its state */
typedef struct {
    int control, state;
} Driven;

/* controls are efforts over time and angle; controllers act on degrees of freedom, actuators by the weights in `gear` */
typedef struct {
    int controls, controllers, actuators, springs, bushings, drys;
    const Controller *control, *controller;
    const Actuator *actuator;
    const Spring *spring;
    const Bushing *bushing;
    const Dry *dry;
    const Driven *driven;
    const double *gear;
    const Instruction *instruction;
    const double *tables;
} Forces;

/* MuJoCo's callbacks are global: only the data with these coordinates have these forces */
static const Forces *forces;
static const double *coordinates;

void select_forces(const Forces *chosen, const double *qpos) { forces = chosen, coordinates = qpos; }

static double effort(Expression e, const mjData *d) {
    return evaluated(forces->instruction, forces->tables, e, d->time, d->qpos, d->qvel).value;
}

static double tension(const Spring *s, double length, double rate) {
    double value = s->stiffness * (length - s->rest) + s->damping * rate + s->preload;
    if (s->side != 0.0) return s->side * (length - s->rest) > 0.0 && s->side * value > 0.0 ? value : 0.0;
    Timed at = {s->over_rate ? rate : length, 0.0, 0.0};
    if (s->table >= 0) value += of_table(forces->tables + s->table, at, NULL).value;
    if (!s->expression.length) return value;
    return value + evaluated(forces->instruction, forces->tables, s->expression, 0.0, &length, &rate).value;
}

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void add_cross(double factor, const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++)
        out[i] += factor * (a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
}

static void to_quaternion(const double *vector, double sign, double *q) {
    double angle = sqrt(dot(vector, vector)), share = angle > 0.0 ? sin(0.5 * angle) / angle : 0.5;
    q[0] = cos(0.5 * angle);
    for (int i = 0; i < 3; i++) q[1 + i] = sign * share * vector[i];
}

/* v rotated by a quaternion: v + 2 w (u x v) + 2 u x (u x v) */
static void turn(const double *q, const double *v, double *out) {
    double across[3] = {0.0};
    add_cross(1.0, q + 1, v, across);
    for (int i = 0; i < 3; i++) out[i] = v[i] + 2.0 * q[0] * across[i];
    add_cross(2.0, q + 1, across, out);
}

/* wrenches on both sides from their poses and velocities, (12) each: bushings.py */
static void mount(const Bushing *bushing, const double *pose, const double *velocity, double *wrench) {
    double to_a[4], from_a[4], of_b[4], spin[3], gap[3], rate[3], x[6], y[6], elastic[6], damped[6], total[6];
    to_quaternion(pose + 3, -1.0, to_a), to_quaternion(pose + 3, 1.0, from_a), to_quaternion(pose + 9, 1.0, of_b);
    for (int i = 0; i < 3; i++) {
        gap[i] = pose[6 + i] - pose[i], rate[i] = velocity[6 + i] - velocity[i];
        spin[i] = velocity[9 + i] - velocity[3 + i];
    }
    add_cross(-1.0, velocity + 3, gap, rate);
    turn(to_a, gap, x), turn(to_a, rate, y), turn(to_a, spin, y + 3);
    /* rotation vector of b in a: 2 atan2(|u|, w) u / |u|, shorter than pi */
    double w = to_a[0] * of_b[0] - dot(to_a + 1, of_b + 1), u[3];
    for (int i = 0; i < 3; i++) u[i] = to_a[0] * of_b[1 + i] + of_b[0] * to_a[1 + i];
    add_cross(1.0, to_a + 1, of_b + 1, u);
    double sine = sqrt(dot(u, u)), half = atan2(sine, fabs(w));
    double share = (w < 0.0 ? -2.0 : 2.0) * (sine > 0.0 ? half / sine : 1.0);
    for (int i = 0; i < 3; i++) x[3 + i] = share * u[i];
    for (int i = 0; i < 6; i++) {
        elastic[i] = damped[i] = 0.0;
        for (int k = 0; k < 6; k++)
            elastic[i] -= bushing->stiffness[6 * i + k] * x[k], damped[i] -= bushing->damping[6 * i + k] * y[k];
        total[i] = elastic[i] + damped[i];
    }
    /* J^-T m = m + theta x m / 2 + c theta x (theta x m): `rotation_vector_rates` */
    double angle = 2.0 * half, across[3] = {0.0};
    double c = angle > 1e-4 ? 1.0 / (angle * angle) - 0.5 / (angle * tan(half)) : 1.0 / 12.0 + angle * angle / 720.0;
    add_cross(1.0, x + 3, elastic + 3, across);
    for (int i = 0; i < 3; i++) total[3 + i] += 0.5 * across[i];
    add_cross(c, x + 3, across, total + 3);
    turn(from_a, total, wrench + 6), turn(from_a, total + 3, wrench + 9);
    for (int i = 0; i < 6; i++) wrench[i] = -wrench[6 + i];
    add_cross(-1.0, gap, wrench + 6, wrench + 3);
}

static void react(mjData *d) {
    const double *length = d->actuator_length, *rate = d->actuator_velocity;
    for (int i = 0; i < forces->drys; i++) {
        const Dry *one = forces->dry + i;
        double square = 0.0;
        for (int k = one->control; k < one->control + one->count; k++) square += rate[k] * rate[k];
        for (int k = one->control; k < one->control + one->count; k++)
            d->ctrl[k] = square > 0.0 ? -one->magnitude * rate[k] / sqrt(square) : 0.0;
    }
    for (int i = 0; i < forces->springs; i++) {
        const Spring *one = forces->spring + i;
        d->ctrl[one->control] = tension(one, length[one->control] + one->offset, rate[one->control]);
    }
    for (int i = 0; i < forces->bushings; i++) {
        int k = forces->bushing[i].control;
        mount(forces->bushing + i, length + k, rate + k, d->ctrl + k);
    }
}

void apply_forces(const mjModel *m, mjData *d) {
    if (d->qpos != coordinates) return;
    for (int i = 0; i < forces->controls; i++)
        d->ctrl[forces->control[i].coordinate] = effort(forces->control[i].effort, d);
    react(d);
    memset(d->qfrc_applied, 0, m->nv * sizeof(double));
    for (int i = 0; i < forces->controllers; i++)
        d->qfrc_applied[forces->controller[i].coordinate] += effort(forces->controller[i].effort, d);
    for (int i = 0; i < forces->actuators; i++) {
        const Actuator *a = forces->actuator + i;
        const double *gear = forces->gear + i * m->nv;
        double value = 0.0, speed = 0.0, flow, state = a->has_state ? d->act[forces->driven[i].state] : 0.0;
        for (int k = 0; k < m->nv; k++) {
            if (gear[k] == 0.0) continue;
            value += gear[k] * d->qpos[m->jnt_qposadr[m->dof_jntid[k]]], speed += gear[k] * d->qvel[k];
        }
        Timed given = evaluated(forces->instruction, forces->tables, a->control, d->time, d->qpos, d->qvel);
        double force = actuator_force(a, given, state, value, speed, &flow);
        if (a->has_state) d->ctrl[forces->driven[i].control] = flow;
        for (int k = 0; k < m->nv; k++) d->qfrc_applied[k] += gear[k] * force;
    }
}
