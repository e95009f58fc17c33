/* MuJoCo's callbacks of velocity_products.py and applied_controls.py, called at every stage of a step. Callbacks are
   global: they leave other models and data alone. */

/* a coupling by a function of the right side relative to the reference, plus `reference`, which is the time of the
   expression; its value is `difference` above that of the constraint. Without an expression, a polynomial */
typedef struct {
    int equality;
    double reference, difference;
    Expression function;
} Coupling;

/* points of two bodies whose distance a tendon equality keeps */
typedef struct {
    int equality, bodies[2];
    double points[2][3];
} Rod;

/* numbers of nonlinear couplings and rods of a model, and these; `weights` are those of degrees of freedom in the right sides */
typedef struct {
    const int *count;
    const Coupling *coupling;
    const Rod *rod;
    const double *weights;
    const Instruction *instruction;
    const double *tables;
} Rows;
enum { COUPLINGS, RODS };

static const Rows *rows;
static const mjModel *model;

void select_rows(const Rows *chosen, const mjModel *of) { rows = chosen, model = of; }

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void add_cross(double factor, const double *a, const double *b, double *out) {
    for (int i = 0; i < 3; i++)
        out[i] += factor * (a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]);
}

static double right_side(const mjModel *m, const double *weights, const double *qpos) {
    double value = 0.0;
    for (int k = 0; k < m->nv; k++) {
        if (weights[k] == 0.0) continue;
        int address = m->jnt_qposadr[m->dof_jntid[k]];
        value += weights[k] * (qpos[address] - m->qpos0[address]);
    }
    return value;
}

/* value and two derivatives of a coupling */
static Timed coupled(const Rows *r, const mjModel *m, const Coupling *c, double right) {
    const double *p = m->eq_data + mjNEQDATA * c->equality;
    Timed f = {0.0, 0.0, 0.0};
    if (c->function.length) {
        f = evaluated(r->instruction, r->tables, c->function, right + c->reference, NULL, NULL);
        f.value += c->difference;
        return f;
    }
    for (int i = 4; i >= 0; i--) {
        f.second = f.second * right + 2.0 * f.rate;
        f.rate = f.rate * right + f.value;
        f.value = f.value * right + p[i];
    }
    return f;
}

/* sets polynomials to the Taylor polynomials of functions at a state, of `CouplingConstraint.expanded` */
void expand(const Rows *r, mjModel *m, const double *qpos, double difference) {
    for (int i = 0; i < r->count[COUPLINGS]; i++) {
        const Coupling *c = r->coupling + i;
        if (!c->function.length) continue;
        double *p = m->eq_data + mjNEQDATA * c->equality, right = right_side(m, r->weights + i * m->nv, qpos);
        Timed before = coupled(r, m, c, right - difference), f = coupled(r, m, c, right);
        Timed after = coupled(r, m, c, right + difference);
        double fourth = (after.second - 2.0 * f.second + before.second) / (difference * difference);
        double derivatives[5] = {f.value, f.rate, f.second / 2.0,
                                 (after.second - before.second) / (12.0 * difference), fourth / 24.0};
        memset(p, 0, 5 * sizeof(double));
        for (int k = 4; k >= 0; k--) {
            for (int n = 4; n > 0; n--) p[n] = p[n - 1] - right * p[n];
            p[0] = derivatives[k] - right * p[0];
        }
    }
}

/* second derivative of the distance of two points at accelerations of zero: u.b + (v.v - (u.v)^2) / length */
static double stretching(const mjModel *m, const mjData *d, const Rod *rod) {
    double gap[3] = {0.0}, velocity[3] = {0.0}, bias[3] = {0.0};
    for (int side = 0; side < 2; side++) {
        int body = rod->bodies[side];
        double sign = side ? -1.0 : 1.0, spatial[6] = {0.0}, point[3], arm[3], v[3];
        const double *rotation = d->xmat + 9 * body, *twist = d->cvel + 6 * body;
        for (int i = 0; i < 3; i++) {
            point[i] = d->xpos[3 * body + i] + dot(rotation + 3 * i, rod->points[side]);
            arm[i] = point[i] - d->subtree_com[3 * m->body_rootid[body] + i], v[i] = twist[3 + i];
        }
        for (int b = body; b > 0; b = m->body_parentid[b])
            for (int k = m->body_dofadr[b]; k < m->body_dofadr[b] + m->body_dofnum[b]; k++)
                for (int i = 0; i < 6; i++) spatial[i] += d->cdof_dot[6 * k + i] * d->qvel[k];
        add_cross(1.0, twist, arm, v);
        add_cross(1.0, spatial, arm, spatial + 3);
        add_cross(1.0, twist, v, spatial + 3);
        for (int i = 0; i < 3; i++)
            gap[i] += sign * point[i], velocity[i] += sign * v[i], bias[i] += sign * spatial[3 + i];
    }
    double length = sqrt(dot(gap, gap)), along = dot(gap, velocity) / length;
    return dot(gap, bias) / length + (dot(velocity, velocity) - along * along) / length;
}

static int row_of(const mjData *d, int equality) {
    int row = 0;
    while (row < d->ne && !(d->efc_type[row] == mjCNSTR_EQUALITY && d->efc_id[row] == equality)) row++;
    return row;
}

/* acceleration of a constraint per violation, without damping */
static double scale_of(const mjData *d, int row) { return d->efc_KBIP[4 * row] * d->efc_KBIP[4 * row + 2]; }

/* terms of the velocities in constraints, before MuJoCo computes accelerations: `velocity_products` */
void add_velocity_products(const mjModel *m, mjData *d) {
    if (m != model) return;
    for (int i = 0; i < rows->count[RODS]; i++) {
        int row = row_of(d, rows->rod[i].equality);
        if (row < d->ne) d->efc_pos[row] += stretching(m, d, rows->rod + i) / scale_of(d, row);
    }
    for (int i = 0; i < rows->count[COUPLINGS]; i++) {
        const Coupling *c = rows->coupling + i;
        int row = row_of(d, c->equality);
        if (row == d->ne) continue;
        const double *weights = rows->weights + i * m->nv;
        Timed f = coupled(rows, m, c, right_side(m, weights, d->qpos));
        double rate = 0.0, ratio = 1.0;
        for (int k = 0; k < m->nv; k++) rate += weights[k] * d->qvel[k];
        d->efc_pos[row] -= f.second * rate * rate / scale_of(d, row);
        if (m->eq_type[c->equality] == mjEQ_JOINT) {
            double left = m->dof_invweight0[m->jnt_dofadr[m->eq_obj1id[c->equality]]];
            double right = m->dof_invweight0[m->jnt_dofadr[m->eq_obj2id[c->equality]]];
            ratio = (left + f.rate * f.rate * right) / (left + right);
        }
        d->efc_R[row] *= ratio, d->efc_D[row] = 1.0 / d->efc_R[row];
    }
}

/* nonlinear spring, whose control is the tension, or a soft stop on one side. The expression has the length as
   coordinate 0 and the rate as rate 0 */
typedef struct {
    int control, table, over_rate;
    double side, rest, stiffness, damping, preload;
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

/* numbers, and controls that are efforts over time and angle; controllers act on degrees of freedom, actuators by the weights in `gear` */
typedef struct {
    const int *count;
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
enum { CONTROLS, CONTROLLERS, ACTUATORS, SPRINGS, BUSHINGS, DRY };

/* the coordinates of the data that have these forces */
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
    for (int i = 0; i < forces->count[DRY]; i++) {
        const Dry *one = forces->dry + i;
        double square = 0.0;
        for (int k = one->control; k < one->control + one->count; k++) square += rate[k] * rate[k];
        for (int k = one->control; k < one->control + one->count; k++)
            d->ctrl[k] = square > 0.0 ? -one->magnitude * rate[k] / sqrt(square) : 0.0;
    }
    for (int i = 0; i < forces->count[SPRINGS]; i++) {
        const Spring *one = forces->spring + i;
        d->ctrl[one->control] = tension(one, length[one->control], rate[one->control]);
    }
    for (int i = 0; i < forces->count[BUSHINGS]; i++) {
        int k = forces->bushing[i].control;
        mount(forces->bushing + i, length + k, rate + k, d->ctrl + k);
    }
}

void apply_forces(const mjModel *m, mjData *d) {
    if (d->qpos != coordinates) return;
    for (int i = 0; i < forces->count[CONTROLS]; i++)
        d->ctrl[forces->control[i].coordinate] = effort(forces->control[i].effort, d);
    react(d);
    memset(d->qfrc_applied, 0, m->nv * sizeof(double));
    for (int i = 0; i < forces->count[CONTROLLERS]; i++)
        d->qfrc_applied[forces->controller[i].coordinate] += effort(forces->controller[i].effort, d);
    for (int i = 0; i < forces->count[ACTUATORS]; i++) {
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
