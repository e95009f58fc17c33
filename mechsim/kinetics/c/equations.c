/* The equations of motion of mechsim.kinetics for one state; the mechanism is data.

   All wrenches and twists are at the ground's origin, linear before angular. Coordinates are in units: the
   characteristic length for displacements, 1 rad for angles.
   Source: R. Featherstone, Rigid Body Dynamics Algorithms (2008), chapters 5 (recursive Newton-Euler), 6
   (composite rigid bodies) and 8 (loops). */

/* a tree joint; -1 is the ground, `before` the tree joint of the parent. Angles follow slides */
typedef struct {
    int parent, child, before, forward, slides, turns, ball, first;
    double parent_frame[9], parent_point[3], child_frame[9], child_point[3];
    /* successive rotations: factors of 1, cosine and sine of the angles, from parent to child */
    double rotation[2][27];
} Branch;

/* a coordinate: axis of the child's motion on a link, and the link with which it moves; `centred` if it
   passes through a point that moves with the other side. `column` is its place among the free ones, or -1 */
typedef struct {
    int link, carrier, slide, centred, centre_link, column;
    double axis[3], centre[3], unit;
} Coordinate;

typedef struct {
    int link;
    double point[3], frame[9];
} Side;

/* a joint that closes a loop: scalar products (column of a, column of b or -1 for a length) and targets; or a rod of
   length `rod` between the points */
typedef struct {
    Side a, b;
    int rows, first_column, columns, of_a[6], of_b[6];
    double unit[6], target[6], rod;
} Cut;

/* coordinate that moves the sides of a cut differently, and the sign of side b's motion relative to a's */
typedef struct {
    int coordinate;
    double sign;
} Moved;

/* (left q - left_zero - p(right q - right_zero)) / unit - offset = 0; weights lie in `weights`. A function, with the
   right side as time, takes the place of the polynomial p */
typedef struct {
    double left_zero, right_zero, coefficients[5], unit, offset;
    Expression function;
} Coupling;

typedef struct {
    double mass, centre[3], moments[9];
} Inertia;

/* two points, each in the frame of its link */
typedef struct {
    int link_a, link_b;
    double a[3], b[3];
} Line;

typedef struct {
    Line line;
    double stiffness, rest, damping;
} Spring;

/* the line of an actuator if it `acts` between points, and the change of its length per change of the distance */
typedef struct {
    int acts;
    Line line;
    double ratio;
} Pull;

/* spring, viscous and Coulomb friction along one coordinate of a joint in tree or loop; at rest Coulomb friction
   is `at_rest` times as large, and it falls with the rate as Stribeck's curve if `stribeck` is above zero. If
   `loaded`, the magnitudes of force and moment across and along the axis, times `load`, are added to `coulomb`;
   the joint is that of branch `branch`, or of cut `cut` if that is -1. A spring acts on a coordinate of the tree,
   which counts revolutions, if `coordinate` is 0 or more */
typedef struct {
    Side a, b;
    int motion, column, friction, hinge, coordinate, loaded, branch, cut;
    double stiffness, rest, viscous, coulomb, at_rest, stribeck, load[4];
} Resistance;
enum { SLIDE, TURN, BALL, FIRST_AXIS, SECOND_AXIS };

/* nonlinear spring or soft stop between two points, or in a coordinate if that is 0 or more; its expression has the
   length as coordinate 0 and the rate as rate 0. A table, which lies at `table` if that is 0 or more, is over the
   length or the rate */
typedef struct {
    Line line;
    int coordinate, table, over_rate;
    double rest, stiffness, damping, preload, exponent, hysteresis;
    Expression expression;
} NonlinearSpring;

/* elastic mount between two frames: symmetric 6 x 6 matrices in the frame of side a */
typedef struct {
    Side a, b;
    double stiffness[36], damping[36];
} Bushing;

/* constant force on a point of a link, and constant moment on the link; expressions take their place */
typedef struct {
    int link, varying;
    double point[3], wrench[6];
    Expression expressions[6];
} Load;

/* a coordinate that follows a motion law */
typedef struct {
    int coordinate;
    Expression law;
} Prescribed;

typedef struct {
    int links, count, free, balls, cuts, couplings, rows, springs, resistances, loads, crank;
    int controllers, actuators, states, rotating, nonlinear_springs, loaded, tabled, driven, bushings;
    const Branch *branches;
    const Coordinate *coordinates;
    const Cut *cut;
    const Moved *moved;
    const Coupling *coupling;
    const double *weights;
    const Inertia *inertias;
    const Spring *spring;
    const Resistance *resistance;
    const Load *load;
    const Instruction *instruction;
    const Controller *controller;
    const Prescribed *prescribed;
    const Actuator *actuator;
    const double *gear;
    const Pull *pull;
    const double *rotors;
    const NonlinearSpring *nonlinear_spring;
    const double *tables;
    const Bushing *bushing;
    double gravity[3], torque, torque_slope;
} Model;

/* one state and what follows from it */
typedef struct {
    double *q, *turns, *position, *rotation, *unit_twist, *twist, *bias, *force, *inertia;
    double *rows, *residual, *gamma, *mass, *effort, *reflectors, *vector, *basis, *reduced;
    /* forces of controllers and actuators on all coordinates, and rates of the actuators' states */
    double *applied, *inflow;
    /* rates of prescribed coordinates, in units */
    double *speed;
    /* of friction by the load: each link's inertia, wrench of each row of a cut, multipliers, and forces on links;
       magnitudes, their changes of the accelerations, and terms of the loads, without them and by a unit of each */
    double *own, *across, *multiplier, *twisting, *carried, *pull, *push, *magnitude, *moved, *terms;
    double *moving;
    /* of the rows: columns and numbers of their entries, with a bit for each column modulo 64, and what is left of them
       in the elimination; of its reflectors: where their columns begin in `columns`, numbers of entries, columns that
       they eliminate, and whether one does; of each column: whether it is marked, and columns and number of its entries
       in the mass matrix */
    int *columns, *lengths;
    unsigned long long *bits;
    double *norms;
    int *begin, *entries, *pivots, *eliminated, *marked, *coupled, *couplings;
    /* of the rows of the reduced mass matrix: their first entry */
    int *first;
    /* rows in the order of elimination; whether a row depends on others, so that stages leave it out */
    int *order, *dependent;
    double potential, kinetic, power_in, power_lost, smallest, time;
    int rank;
} Work;

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double *a, const double *b, double *c) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0], c[0] = x, c[1] = y;
}

static void add_cross(const double *a, const double *b, double *c) {
    double product[3];
    cross(a, b, product);
    for (int i = 0; i < 3; i++) c[i] += product[i];
}

static void rotate(const double *r, const double *v, double *out) {
    double x = dot(r, v), y = dot(r + 3, v), z = dot(r + 6, v);
    out[0] = x, out[1] = y, out[2] = z;
}

static void multiply(const double *a, const double *b, double *out) {
    for (int i = 0; i < 9; i += 3) {
        double x = a[i], y = a[i + 1], z = a[i + 2];
        out[i] = x * b[0] + y * b[3] + z * b[6];
        out[i + 1] = x * b[1] + y * b[4] + z * b[7];
        out[i + 2] = x * b[2] + y * b[5] + z * b[8];
    }
}

/* a b' */
static void multiply_transposed(const double *a, const double *b, double *out) {
    for (int i = 0; i < 9; i += 3)
        out[i] = dot(a + i, b), out[i + 1] = dot(a + i, b + 3), out[i + 2] = dot(a + i, b + 6);
}

static double inner(int n, const double *a, const double *b) {
    double sum = 0.0;
    for (int i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

static void add_scaled(int n, double factor, const double *a, double *out) {
    for (int i = 0; i < n; i++) out[i] += factor * a[i];
}

/* point of a link in the ground frame, and its velocity if that is wanted */
static void locate(const Work *w, int link, const double *local, double *point, double *velocity) {
    if (link < 0) {
        memcpy(point, local, 3 * sizeof(double));
        if (velocity) memset(velocity, 0, 3 * sizeof(double));
        return;
    }
    rotate(w->rotation + 9 * link, local, point);
    for (int i = 0; i < 3; i++) point[i] += w->position[3 * link + i];
    if (!velocity) return;
    memcpy(velocity, w->twist + 6 * link, 3 * sizeof(double));
    add_cross(w->twist + 6 * link + 3, point, velocity);
}

static void column_of(const Work *w, const Side *side, int column, double *out) {
    double local[3] = {side->frame[column], side->frame[3 + column], side->frame[6 + column]};
    if (side->link < 0) memcpy(out, local, sizeof local);
    else rotate(w->rotation + 9 * side->link, local, out);
}

static const double STILL[6];

#define REVOLUTION 6.283185307179586
/* least 1 + trace of a rotation, zero at half a revolution */
#define LEAST_TRACE 1e-12
/* squared tangent of a half angle below which a series is exact to rounding */
#define SMALL_SQUARE 1e-3

static const double *spin_of(const Work *w, int link) { return link < 0 ? STILL : w->twist + 6 * link + 3; }

static void relative_rotation(const Work *w, const Branch *b, const double *turn, double *out) {
    double rotation[2][9];
    int angles = b->ball ? 0 : b->turns, first = b->first + b->slides;
    for (int i = 0; i < angles; i++) {
        double angle = w->q[b->forward ? first + i : first + angles - 1 - i], c = cos(angle), s = sin(angle);
        const double *f = b->rotation[i];
        for (int k = 0; k < 9; k++) rotation[i][k] = f[3 * k] + f[3 * k + 1] * c + f[3 * k + 2] * s;
    }
    if (angles == 1) memcpy(out, rotation[0], sizeof rotation[0]);
    else if (angles == 2) multiply(rotation[0], rotation[1], out);
    else if (!b->ball) multiply_transposed(b->parent_frame, b->child_frame, out);
    else {
        if (b->forward) multiply(b->parent_frame, turn, rotation[0]);
        else multiply_transposed(b->parent_frame, turn, rotation[0]);
        multiply_transposed(rotation[0], b->child_frame, out);
    }
}

static void set_rotation(const double *quaternion, double *r) {
    double length = sqrt(quaternion[0] * quaternion[0] + dot(quaternion + 1, quaternion + 1));
    double w = quaternion[0] / length, x = quaternion[1] / length, y = quaternion[2] / length;
    double z = quaternion[3] / length;
    r[0] = 1.0 - 2.0 * (y * y + z * z), r[1] = 2.0 * (x * y - w * z), r[2] = 2.0 * (x * z + w * y);
    r[3] = 2.0 * (x * y + w * z), r[4] = 1.0 - 2.0 * (x * x + z * z), r[5] = 2.0 * (y * z - w * x);
    r[6] = 2.0 * (x * z - w * y), r[7] = 2.0 * (y * z + w * x), r[8] = 1.0 - 2.0 * (x * x + y * y);
}

/* poses of the links and unit twists of the coordinates in units */
static void set_poses(const Model *m, Work *w, const double *state) {
    for (int k = 0; k < m->count; k++) w->q[k] = state[k] * m->coordinates[k].unit;
    for (int i = 0; i < m->balls; i++) set_rotation(state + m->count + 4 * i, w->turns + 9 * i);
    const double *turn = w->turns;
    for (int i = 0; i < m->links; i++) {
        const Branch *b = m->branches + i;
        double *rotation = w->rotation + 9 * b->child, *position = w->position + 3 * b->child;
        double relative[9], arm[3], slid[3] = {0.0}, back[3];
        const double *origin = b->parent < 0 ? STILL : w->position + 3 * b->parent;
        relative_rotation(w, b, turn, relative);
        turn += 9 * b->ball;
        if (b->parent < 0) {
            memcpy(arm, b->parent_point, sizeof arm);
            memcpy(rotation, relative, sizeof relative);
        } else {
            rotate(w->rotation + 9 * b->parent, b->parent_point, arm);
            multiply(w->rotation + 9 * b->parent, relative, rotation);
        }
        for (int k = b->first; k < b->first + b->slides + b->turns; k++) {
            const Coordinate *c = m->coordinates + k;
            double *unit = w->unit_twist + 6 * k, axis[3], centre[3];
            if (c->link < 0) memcpy(axis, c->axis, sizeof axis);
            else rotate(w->rotation + 9 * c->link, c->axis, axis);
            for (int j = 0; j < 3; j++) {
                centre[j] = origin[j] + arm[j] + (b->forward ? slid[j] : 0.0);
                unit[j] = c->slide ? axis[j] * c->unit : 0.0, unit[3 + j] = c->slide ? 0.0 : axis[j];
            }
            if (c->slide) add_scaled(3, w->q[k], axis, slid);
            else cross(centre, axis, unit);
        }
        rotate(rotation, b->child_point, back);
        for (int j = 0; j < 3; j++) position[j] = origin[j] + (arm[j] - back[j] + slid[j]);
    }
}

/* twists of the links, and their accelerations at constant rates of the coordinates */
static void set_velocities(const Model *m, Work *w, const double *rates) {
    for (int i = 0; i < m->links; i++) {
        const Branch *b = m->branches + i;
        double *twist = w->twist + 6 * b->child, *bias = w->bias + 6 * b->child;
        memcpy(twist, b->parent < 0 ? STILL : w->twist + 6 * b->parent, 6 * sizeof(double));
        memcpy(bias, b->parent < 0 ? STILL : w->bias + 6 * b->parent, 6 * sizeof(double));
        for (int k = b->first; k < b->first + b->slides + b->turns; k++)
            add_scaled(6, rates[k], w->unit_twist + 6 * k, twist);
        for (int k = b->first; k < b->first + b->slides + b->turns; k++) {
            const Coordinate *c = m->coordinates + k;
            const double *s = w->unit_twist + 6 * k;
            const double *moving = c->carrier < 0 ? STILL : w->twist + 6 * c->carrier;
            double change[6] = {0.0};
            cross(moving + 3, s + 3, change + 3);
            if (c->centred) {
                double centre[3], velocity[3];
                locate(w, c->centre_link, c->centre, centre, velocity);
                cross(velocity, s + 3, change);
                add_cross(centre, change + 3, change);
            } else {
                cross(moving + 3, s, change);
                add_cross(moving, s + 3, change);
            }
            add_scaled(6, rates[k], change, bias);
        }
    }
}

/* removes the entries of a row of the Jacobian */
static void clear_row(const Model *m, Work *w, int row) {
    for (int i = 0; i < w->lengths[row]; i++) w->rows[row * m->free + w->columns[row * m->free + i]] = 0.0;
    w->lengths[row] = 0, w->bits[row] = 0;
}

/* adds the entry of a column to those of a row */
static void add_entry(int n, Work *w, int row, int column) {
    w->columns[row * n + w->lengths[row]++] = column;
    w->bits[row] |= 1ULL << (column & 63);
}

/* sets a derivative by a coordinate, unless that is prescribed */
static inline void set_entry(const Model *m, Work *w, int row, int coordinate, double value) {
    int column = m->coordinates[coordinate].column;
    if (column < 0 || value == 0.0) return;
    w->rows[row * m->free + column] = value;
    add_entry(m->free, w, row, column);
}

/* Jacobian by the free coordinates of a row of a cut, from the wrench whose power is the rate of its residual */
static void set_jacobian_row(const Model *m, Work *w, const Cut *cut, int row, const double *wrench) {
    if (m->loaded) memcpy(w->across + 6 * row, wrench, 6 * sizeof(double));
    clear_row(m, w, row);
    for (int c = cut->first_column; c < cut->first_column + cut->columns; c++) {
        const Moved *moved = m->moved + c;
        set_entry(m, w, row, moved->coordinate, moved->sign * inner(6, wrench, w->unit_twist + 6 * moved->coordinate));
    }
}

/* velocity-product term of the acceleration of a point that moves with a link */
static void bias_of(const double *twist, const double *bias, const double *point, double *out) {
    double velocity[3] = {twist[0], twist[1], twist[2]};
    add_cross(twist + 3, point, velocity);
    memcpy(out, bias, 3 * sizeof(double));
    add_cross(bias + 3, point, out);
    add_cross(twist + 3, velocity, out);
}

/* residuals, Jacobian and velocity-product terms of a cut's rows from `row` on, without dependent ones if they are
   known; a rod has the residual (D.D - L^2) / (2 L) with D from a to b */
static int set_cut_rows(const Model *m, Work *w, const Cut *cut, int row, int moving, int known, int count) {
    double a[3], b[3], va[3], vb[3], relative[3] = {0.0}, gap[3], spin[3], second[3];
    const double *ta = cut->a.link < 0 ? STILL : w->twist + 6 * cut->a.link, *wa = ta + 3;
    const double *tb = cut->b.link < 0 ? STILL : w->twist + 6 * cut->b.link, *wb = tb + 3;
    const double *da = cut->a.link < 0 ? STILL : w->bias + 6 * cut->a.link;
    const double *db = cut->b.link < 0 ? STILL : w->bias + 6 * cut->b.link;
    locate(w, cut->a.link, cut->a.point, a, moving ? va : NULL);
    locate(w, cut->b.link, cut->b.point, b, moving ? vb : NULL);
    for (int j = 0; j < 3; j++) gap[j] = b[j] - a[j];
    if (moving) {
        double of_a[3], velocity[3], coriolis[3];
        int rod = cut->rod > 0.0;
        /* relative to side a, of whose frame point b is a point for the moment unless it is at the end of a rod */
        bias_of(tb, db, b, relative);
        bias_of(ta, da, rod ? a : b, of_a);
        if (!rod) memcpy(va, ta, sizeof va), add_cross(wa, b, va);
        for (int j = 0; j < 3; j++) velocity[j] = vb[j] - va[j], relative[j] -= of_a[j];
        cross(wa, velocity, coriolis);
        for (int j = 0; j < 3; j++) {
            spin[j] = wb[j] - wa[j], second[j] = db[3 + j] - da[3 + j];
            if (!rod) relative[j] -= 2.0 * coriolis[j];
        }
        if (rod) w->gamma[row] = (dot(gap, relative) + dot(velocity, velocity)) * cut->unit[0] / cut->rod;
    }
    for (int i = 0; i < cut->rows; i++, row++) {
        double u[3], v[3], wrench[6] = {0.0};
        int length = cut->of_b[i] < 0;
        if (known && w->dependent[row]) continue;
        w->order[count++] = row;
        if (cut->rod > 0.0)
            for (int j = 0; j < 3; j++) u[j] = gap[j] / cut->rod;
        else column_of(w, &cut->a, cut->of_a[i], u);
        if (length) memcpy(v, b, sizeof v);
        else column_of(w, &cut->b, cut->of_b[i], v);
        for (int j = 0; j < 3; j++) u[j] *= cut->unit[i], wrench[j] = length ? u[j] : 0.0;
        cross(v, u, wrench + 3);
        set_jacobian_row(m, w, cut, row, wrench);
        w->residual[row] = dot(u, length ? gap : v) - cut->target[i];
        if (cut->rod > 0.0) w->residual[row] = 0.5 * (w->residual[row] - cut->rod * cut->unit[i]);
        if (!moving || cut->rod > 0.0) continue;
        if (length) {
            w->gamma[row] = dot(u, relative);
            continue;
        }
        double turning_u[3], turning_v[3], changing[3];
        cross(wb, v, turning_v);
        cross(wa, u, turning_u);
        cross(turning_v, u, changing);
        add_cross(v, turning_u, changing);
        w->gamma[row] = dot(wrench + 3, second) + dot(changing, spin);
    }
    return count;
}

static void set_coupling_row(const Model *m, Work *w, int i, int row, const double *rates) {
    const Coupling *c = m->coupling + i;
    const double *left = m->weights + 2 * i * m->count, *right = left + m->count, *p = c->coefficients;
    double x = inner(m->count, right, w->q) - c->right_zero, rate = 0.0;
    double value = p[0] + x * (p[1] + x * (p[2] + x * (p[3] + x * p[4])));
    double first = p[1] + x * (2.0 * p[2] + x * (3.0 * p[3] + x * 4.0 * p[4]));
    double second = 2.0 * p[2] + x * (6.0 * p[3] + x * 12.0 * p[4]);
    if (c->function.length) {
        Timed f = evaluated(m->instruction, m->tables, c->function, x, NULL, NULL);
        value = f.value, first = f.rate, second = f.second;
    }
    w->residual[row] = (inner(m->count, left, w->q) - c->left_zero - value) / c->unit - c->offset;
    clear_row(m, w, row);
    for (int k = 0; k < m->count; k++) {
        double unit = m->coordinates[k].unit;
        rate += rates ? right[k] * rates[k] * unit : 0.0;
        set_entry(m, w, row, k, (left[k] - right[k] * first) / c->unit * unit);
    }
    w->gamma[row] = -second * rate * rate / c->unit;
}

/* q - f(t) = 0 of a prescribed coordinate */
static void set_prescribed_row(const Model *m, Work *w, int i, int row) {
    const Coordinate *to = m->coordinates + m->prescribed[i].coordinate;
    Timed f = evaluated(m->instruction, m->tables, m->prescribed[i].law, w->time, NULL, NULL);
    clear_row(m, w, row);
    set_entry(m, w, row, m->prescribed[i].coordinate, 1.0);
    w->residual[row] = (w->q[m->prescribed[i].coordinate] - f.value) / to->unit;
    w->speed[i] = f.rate / to->unit, w->gamma[row] = -f.second / to->unit;
}

/* rows of the loops and of prescribed coordinates, then those of coordinates at rest, without dependent ones if
 * they are known; without rates, no velocity-product terms */
static int set_rows(const Model *m, Work *w, const double *rates, int resting, const int *at_rest, int known) {
    int row = 0, count = 0;
    for (int c = 0; c < m->cuts; c++) {
        count = set_cut_rows(m, w, m->cut + c, row, rates != NULL, known, count);
        row += m->cut[c].rows;
    }
    for (int i = 0; i < m->couplings; i++, row++) {
        if (known && w->dependent[row]) continue;
        set_coupling_row(m, w, i, row, rates);
        w->order[count++] = row;
    }
    for (int i = 0; i < m->driven; i++, row++) {
        if (known && w->dependent[row]) continue;
        set_prescribed_row(m, w, i, row);
        w->order[count++] = row;
    }
    for (int i = 0; i < resting; i++, row++) {
        if (known && w->dependent[row]) continue;
        w->order[count++] = row;
        clear_row(m, w, row);
        set_entry(m, w, row, at_rest[i], 1.0);
        w->gamma[row] = w->residual[row] = 0.0;
    }
    return count;
}

static void add_force(const Work *w, int link, const double *point, double size, const double *direction) {
    if (link < 0) return;
    double force[3] = {size * direction[0], size * direction[1], size * direction[2]};
    add_scaled(3, 1.0, force, w->force + 6 * link);
    add_cross(point, force, w->force + 6 * link + 3);
}

/* spatial inertias (mass, first moment, inertia matrix) and wrenches of weight and inertia at constant rates */
static void set_bodies(const Model *m, Work *w) {
    w->potential = w->kinetic = 0.0;
    for (int i = 0; i < m->links; i++) {
        const Inertia *body = m->inertias + i;
        double *inertia = w->inertia + 13 * i, *force = w->force + 6 * i, centre[3], half[9];
        locate(w, i, body->centre, centre, NULL);
        inertia[0] = body->mass;
        for (int j = 0; j < 3; j++) inertia[1 + j] = body->mass * centre[j];
        multiply(w->rotation + 9 * i, body->moments, half);
        multiply_transposed(half, w->rotation + 9 * i, inertia + 4);
        double square = dot(centre, centre);
        for (int j = 0; j < 3; j++)
            for (int k = 0; k < 3; k++)
                inertia[4 + 3 * j + k] += body->mass * ((j == k) * square - centre[j] * centre[k]);
        const double *twist = w->twist + 6 * i, *bias = w->bias + 6 * i, *h = inertia + 1;
        double momentum[6], change[6];
        for (int j = 0; j < 3; j++) momentum[j] = body->mass * twist[j], change[j] = body->mass * bias[j];
        add_cross(twist + 3, h, momentum);
        add_cross(bias + 3, h, change);
        rotate(inertia + 4, twist + 3, momentum + 3);
        rotate(inertia + 4, bias + 3, change + 3);
        add_cross(h, twist, momentum + 3);
        add_cross(h, bias, change + 3);
        w->kinetic += 0.5 * inner(6, momentum, twist);
        add_cross(twist + 3, momentum, change);
        add_cross(twist + 3, momentum + 3, change + 3);
        add_cross(twist, momentum, change + 3);
        for (int j = 0; j < 6; j++) force[j] = -change[j];
        w->potential -= body->mass * dot(centre, m->gravity);
        add_force(w, i, centre, body->mass, m->gravity);
    }
}

/* distance of two points and its rate; `ends` are the points, and the direction from a to b */
static double distance(const Work *w, const Line *line, double *rate, double ends[3][3]) {
    double *a = ends[0], *b = ends[1], *along = ends[2], va[3], vb[3];
    locate(w, line->link_a, line->a, a, va);
    locate(w, line->link_b, line->b, b, vb);
    for (int i = 0; i < 3; i++) along[i] = b[i] - a[i];
    double length = sqrt(dot(along, along));
    *rate = 0.0;
    for (int i = 0; i < 3; i++) along[i] /= length > 0.0 ? length : 1.0, *rate += along[i] * (vb[i] - va[i]);
    return length;
}

static void add_tension(Work *w, const Line *line, double tension, double ends[3][3]) {
    add_force(w, line->link_a, ends[0], tension, ends[2]);
    add_force(w, line->link_b, ends[1], -tension, ends[2]);
}

static void add_spring(const Spring *spring, Work *w) {
    double ends[3][3], rate, stretch = distance(w, &spring->line, &rate, ends) - spring->rest;
    add_tension(w, &spring->line, spring->stiffness * stretch + spring->damping * rate, ends);
    w->potential += 0.5 * spring->stiffness * stretch * stretch;
    w->power_lost += spring->damping * rate * rate;
}

/* rotation vector of a rotation, and c of J^-1 = 1 - [v]/2 + c [v]^2, as kinematics/vector_method/rotations.py */
static double rotation_vector(const double *r, double *v) {
    double total = 1.0 + r[0] + r[4] + r[8], square;
    if (!(total > LEAST_TRACE)) total = LEAST_TRACE;
    v[0] = (r[7] - r[5]) / total, v[1] = (r[2] - r[6]) / total, v[2] = (r[3] - r[1]) / total;
    square = dot(v, v);
    double size = sqrt(square), h = (1.0 - atan(size) / size) / square;
    if (square < SMALL_SQUARE) {
        h = 0.0;
        for (int k = 5; k >= 0; k--) h = 1.0 / (2 * k + 3) - square * h;
    }
    double k = 1.0 - h * square;
    for (int i = 0; i < 3; i++) v[i] *= 2.0 * k;
    return 0.25 * h / (k * k);
}

/* a bushing, as mechsim.mechanism.bushings states it */
static void add_bushing(const Bushing *bushing, Work *w) {
    double a[3], b[3], va[3], vb[3], axes[9], turned[9], turn[9], x[6], y[6], elastic[6], across[3], twice[3];
    locate(w, bushing->a.link, bushing->a.point, a, va);
    locate(w, bushing->b.link, bushing->b.point, b, vb);
    const double *wa = spin_of(w, bushing->a.link), *wb = spin_of(w, bushing->b.link);
    double gap[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, spin[3] = {wb[0] - wa[0], wb[1] - wa[1], wb[2] - wa[2]};
    double rate[3] = {va[0] - vb[0], va[1] - vb[1], va[2] - vb[2]};
    add_cross(wa, gap, rate);
    /* rows of both frames */
    for (int i = 0; i < 3; i++)
        column_of(w, &bushing->a, i, axes + 3 * i), column_of(w, &bushing->b, i, turned + 3 * i);
    multiply_transposed(axes, turned, turn);
    double factor = rotation_vector(turn, x + 3);
    rotate(axes, gap, x), rotate(axes, rate, y), rotate(axes, spin, y + 3);
    for (int i = 0; i < 3; i++) y[i] = -y[i];
    for (int i = 0; i < 6; i++) {
        elastic[i] = -inner(6, bushing->stiffness + 6 * i, x);
        w->potential -= 0.5 * elastic[i] * x[i];
    }
    cross(x + 3, elastic + 3, across);
    cross(x + 3, across, twice);
    for (int i = 0; i < 3; i++) elastic[3 + i] += 0.5 * across[i] + factor * twice[i];
    for (int i = 0; i < 6; i++) {
        double damped = inner(6, bushing->damping + 6 * i, y);
        w->power_lost += damped * y[i], elastic[i] -= damped;
    }
    for (int i = 0; i < 3; i++) {
        const double *axis = axes + 3 * i;
        add_force(w, bushing->b.link, b, elastic[i], axis), add_force(w, bushing->a.link, b, -elastic[i], axis);
        if (bushing->b.link >= 0) add_scaled(3, elastic[3 + i], axis, w->force + 6 * bushing->b.link + 3);
        if (bushing->a.link >= 0) add_scaled(3, -elastic[3 + i], axis, w->force + 6 * bushing->a.link + 3);
    }
}

/* direction of the couple that does the work of one coordinate, and its rate */
static double turning(const Work *w, const Resistance *r, double *direction) {
    const double *wa = spin_of(w, r->a.link), *wb = spin_of(w, r->b.link);
    double spin[3] = {wb[0] - wa[0], wb[1] - wa[1], wb[2] - wa[2]}, first[3], second[3];
    column_of(w, &r->a, 2, first);
    if (r->motion == TURN) {
        memcpy(direction, first, sizeof first);
        return dot(first, spin);
    }
    if (r->motion == BALL) {
        double rate = sqrt(dot(spin, spin));
        for (int i = 0; i < 3; i++) direction[i] = spin[i] / (rate != 0.0 ? rate : 1.0);
        return rate;
    }
    column_of(w, &r->b, 2, second);
    const double *own = r->motion == FIRST_AXIS ? first : second, *other = own == first ? second : first;
    double c = dot(first, second), square = 1.0 - c * c;
    for (int i = 0; i < 3; i++) direction[i] = (own[i] - c * other[i]) / square;
    return dot(direction, spin);
}

static double hinge_angle(const Work *w, const Resistance *r) {
    double x[3], y[3], reference[3];
    column_of(w, &r->a, 0, x);
    column_of(w, &r->a, 1, y);
    column_of(w, &r->b, 0, reference);
    return atan2(dot(y, reference), dot(x, reference));
}

/* axis, rate and value of the motion that a resistance opposes, and the wrench of a unit force along it */
static double along_resistance(const Resistance *r, const Work *w, double *rate, double *wrench) {
    double axis[3], a[3], b[3], va[3], vb[3], value = 0.0;
    memset(wrench, 0, 6 * sizeof(double));
    if (r->motion != SLIDE) {
        *rate = turning(w, r, wrench + 3);
        return r->hinge && r->stiffness != 0.0 ? hinge_angle(w, r) : value;
    }
    locate(w, r->a.link, r->a.point, a, va);
    locate(w, r->b.link, r->b.point, b, vb);
    column_of(w, &r->a, r->column, axis);
    double gap[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, carried[3];
    cross(spin_of(w, r->a.link), gap, carried);
    for (int i = 0; i < 3; i++) carried[i] += va[i];
    *rate = dot(axis, vb) - dot(axis, carried);
    memcpy(wrench, axis, sizeof axis);
    cross(b, axis, wrench + 3);
    return dot(axis, gap);
}

/* a wrench on side b, and its opposite on side a */
static void act(double *force, const Side *a, const Side *b, double size, const double *wrench) {
    if (b->link >= 0) add_scaled(6, size, wrench, force + 6 * b->link);
    if (a->link >= 0) add_scaled(6, -size, wrench, force + 6 * a->link);
}

static void add_resistance(const Resistance *r, const double *sliding, Work *w) {
    double wrench[6], rate, direction = r->friction < 0 ? 0.0 : sliding[r->friction];
    double value = along_resistance(r, w, &rate, wrench);
    double stretch = r->stiffness != 0.0 ? value - r->rest : 0.0;
    if (r->stiffness != 0.0 && r->coordinate >= 0) stretch = w->q[r->coordinate] - r->rest;
    else if (r->hinge) stretch -= REVOLUTION * rint(stretch / (REVOLUTION));
    double lost = r->viscous * rate + r->coulomb * slowness(rate, r->at_rest, r->stribeck) * direction;
    w->potential += 0.5 * r->stiffness * stretch * stretch;
    w->power_lost += lost * rate;
    act(w->force, &r->a, &r->b, -lost - r->stiffness * stretch, wrench);
}

static void add_load(const Model *m, const Load *load, const double *rates, Work *w) {
    double point[3], velocity[3], wrench[6];
    for (int i = 0; i < 6; i++)
        wrench[i] = load->varying ? evaluated(m->instruction, m->tables, load->expressions[i], w->time, w->q, rates).value
                                  : load->wrench[i];
    locate(w, load->link, load->point, point, velocity);
    add_force(w, load->link, point, 1.0, wrench);
    if (load->link >= 0) add_scaled(3, 1.0, wrench + 3, w->force + 6 * load->link + 3);
    w->power_in += dot(wrench, velocity) + dot(wrench + 3, spin_of(w, load->link));
}

/* adds the force of an actuator with a state, of which the rate is returned */
static double add_actuator(const Model *m, int i, double state, const double *rates, Work *w) {
    const Actuator *a = m->actuator + i;
    const Pull *pull = m->pull + i;
    const double *gear = m->gear + i * m->count;
    double ends[3][3], length = inner(m->count, gear, w->q), speed = 0.0;
    for (int k = 0; k < m->count; k++) speed += gear[k] * m->coordinates[k].unit * rates[k];
    if (pull->acts) length = pull->ratio * distance(w, &pull->line, &speed, ends), speed *= pull->ratio;
    Timed control = evaluated(m->instruction, m->tables, a->control, w->time, w->q, rates);
    double flow, force = actuator_force(a, control, state, length, speed, &flow);
    for (int k = 0; k < m->count; k++) w->applied[k] += gear[k] * m->coordinates[k].unit * force;
    if (pull->acts) add_tension(w, &pull->line, -pull->ratio * force, ends), w->power_in += force * speed;
    return flow;
}

/* forces on coordinates; states of actuators follow the rates */
static void set_applied(const Model *m, Work *w, const double *rates) {
    const double *state = rates + m->count;
    double *inflow = w->inflow;
    memset(w->applied, 0, m->count * sizeof(double));
    for (int i = 0; i < m->controllers; i++) {
        const Controller *c = m->controller + i;
        double effort = evaluated(m->instruction, m->tables, c->effort, w->time, w->q, rates).value;
        w->applied[c->coordinate] += effort * m->coordinates[c->coordinate].unit;
    }
    for (int i = 0; i < m->actuators; i++) {
        int has_state = m->actuator[i].has_state;
        double rate = add_actuator(m, i, has_state ? *state : 0.0, rates, w);
        if (has_state) *inflow++ = rate, state++;
    }
    w->power_in += inner(m->count, w->applied, rates);
}

/* a nonlinear spring, as mechsim.mechanism.nonlinear_springs states its law within a phase */
static void add_nonlinear_spring(const Model *m, const NonlinearSpring *s, double phase, const double *rates, Work *w) {
    double ends[3][3], length, rate, unstored = 0.0;
    if (s->coordinate >= 0)
        length = w->q[s->coordinate], rate = rates[s->coordinate] * m->coordinates[s->coordinate].unit;
    else length = distance(w, &s->line, &rate, ends);
    /* zero while a stop is open; negative while it is left behind */
    double stretch = phase ? length - s->rest : 0.0;
    double power = s->exponent == 1.0 ? stretch : copysign(pow(fabs(stretch), s->exponent), stretch);
    double elastic = s->stiffness * power + s->preload;
    double tension = phase > 0.0 ? elastic * (1.0 + s->hysteresis * rate / phase) + s->damping * rate : 0.0;
    if (s->expression.length) {
        double still = 0.0;
        unstored = evaluated(m->instruction, m->tables, s->expression, w->time, &length, &still).value;
        tension += evaluated(m->instruction, m->tables, s->expression, w->time, &length, &rate).value;
    }
    if (s->table >= 0) {
        Timed at = {s->over_rate ? rate : length, 0.0, 0.0};
        double stored, tabled = of_table(m->tables + s->table, at, &stored).value;
        tension += tabled;
        if (!s->over_rate) elastic += tabled, w->potential += stored;
    }
    w->potential += (s->stiffness * power / (s->exponent + 1.0) + s->preload) * stretch;
    w->power_in -= unstored * rate, w->power_lost += (tension - elastic - unstored) * rate;
    if (s->coordinate >= 0) w->applied[s->coordinate] -= tension * m->coordinates[s->coordinate].unit;
    else add_tension(w, &s->line, tension, ends);
}

/* all forces; energies and powers */
static void set_forces(const Model *m, Work *w, const double *rates, const double *sliding, const double *phase) {
    w->power_in = w->power_lost = 0.0;
    set_bodies(m, w);
    for (int i = 0; i < m->springs; i++) add_spring(m->spring + i, w);
    for (int i = 0; i < m->bushings; i++) add_bushing(m->bushing + i, w);
    for (int i = 0; i < m->resistances; i++) add_resistance(m->resistance + i, sliding, w);
    for (int i = 0; i < m->loads; i++) add_load(m, m->load + i, rates, w);
    set_applied(m, w, rates);
    for (int i = 0; i < m->nonlinear_springs; i++)
        add_nonlinear_spring(m, m->nonlinear_spring + i, phase[i], rates, w);
    for (int i = 0; m->rotating && i < m->count; i++) {
        int row = m->coordinates[i].column;
        for (int j = 0; row >= 0 && j < m->count; j++) {
            int column = m->coordinates[j].column;
            if (column >= 0) w->kinetic += 0.5 * rates[i] * rates[j] * m->rotors[row * m->free + column];
        }
    }
    if (m->crank >= 0) {
        double rate = rates[m->crank];
        w->power_in += (m->torque + m->torque_slope * rate) * rate;
    }
}

static void set_momentum(const double *inertia, const double *twist, double *momentum) {
    for (int j = 0; j < 3; j++) momentum[j] = inertia[0] * twist[j];
    add_cross(twist + 3, inertia + 1, momentum);
    rotate(inertia + 4, twist + 3, momentum + 3);
    add_cross(inertia + 1, twist, momentum + 3);
}

/* branch of the parent; NULL at the ground */
static const Branch *parent_of(const Model *m, const Branch *b) { return b->before < 0 ? NULL : m->branches + b->before; }

/* entries of the mass matrix: of coordinates on one path from the ground, and of those that rotors couple, which are
   constant */
static void find_couplings(const Model *m, Work *w) {
    int n = m->free;
    double *entry = w->basis;
    for (int k = 0; m->rotating && k < n * n; k++) w->mass[k] = m->rotors[k], entry[k] = m->rotors[k] != 0.0;
    for (int i = 0; i < m->links; i++)
        for (const Branch *b = m->branches + i, *p = b; p; p = parent_of(m, p))
            for (int k = b->first; k < b->first + b->slides + b->turns; k++)
                for (int j = p->first; j < p->first + p->slides + p->turns; j++) {
                    int column = m->coordinates[k].column, other = m->coordinates[j].column;
                    if (column >= 0 && other >= 0) entry[column * n + other] = entry[other * n + column] = 1.0;
                }
    for (int k = 0; k < n * n; k++)
        if (entry[k] != 0.0) w->coupled[k / n * n + w->couplings[k / n]++] = k % n;
}

/* adds a multiple of a column of the mass matrix */
static void add_mass(int n, const Work *w, int column, double factor, double *out) {
    const int *coupled = w->coupled + column * n;
    const double *mass = w->mass + column * n;
    for (int i = 0; i < w->couplings[column]; i++) out[coupled[i]] += factor * mass[coupled[i]];
}

/* mass matrix by composite rigid bodies, and generalised forces, from the leaves to the ground */
static void set_equations(const Model *m, Work *w, const double *rates) {
    if (m->loaded) memcpy(w->own, w->inertia, 13 * m->links * sizeof(double));
    for (int i = m->links - 1; i >= 0; i--) {
        const Branch *b = m->branches + i;
        double *inertia = w->inertia + 13 * b->child, *force = w->force + 6 * b->child;
        for (int k = b->first; k < b->first + b->slides + b->turns; k++) {
            int column = m->coordinates[k].column;
            if (column < 0) continue;
            const double *s = w->unit_twist + 6 * k;
            double momentum[6];
            set_momentum(inertia, s, momentum);
            w->effort[column] = inner(6, s, force);
            for (const Branch *p = b; p; p = parent_of(m, p))
                for (int j = p->first; j < p->first + p->slides + p->turns; j++) {
                    int other = m->coordinates[j].column;
                    if (other < 0) continue;
                    double value = inner(6, momentum, w->unit_twist + 6 * j);
                    if (m->rotating) value += m->rotors[column * m->free + other];
                    w->mass[column * m->free + other] = w->mass[other * m->free + column] = value;
                }
        }
        if (b->parent < 0) continue;
        add_scaled(13, 1.0, inertia, w->inertia + 13 * b->parent);
        add_scaled(6, 1.0, force, w->force + 6 * b->parent);
    }
    for (int k = 0; k < m->count; k++)
        if (m->coordinates[k].column >= 0) w->effort[m->coordinates[k].column] += w->applied[k];
    if (m->crank < 0) return;
    int column = m->coordinates[m->crank].column;
    w->effort[column] += m->torque + m->torque_slope * rates[m->crank];
}

/* singular values below this fraction of the largest, and below this number, are zero: as numerics.rank */
#define RANK_TOLERANCE 1e-9
#define FLOOR 1e-13
/* number of rows above which not the row with the largest norm is eliminated, but the first one with this fraction of
   it: in the order of the loops, few entries become others than zero */
#define MANY_ROWS 100
#define LARGE 0.1

/* x <- (1 - v v') x with a reflector; whether x changes */
static int reflect_one(const Work *w, int k, int n, double *x) {
    const double *v = w->reflectors + k * n;
    const int *support = w->columns + w->begin[k];
    double sum = 0.0;
    for (int j = 0; j < w->entries[k]; j++) sum += v[j] * x[support[j]];
    for (int j = 0; j < w->entries[k] && sum != 0.0; j++) x[support[j]] -= sum * v[j];
    return sum != 0.0;
}

/* norm of a row without the columns that were eliminated */
static double remaining(int n, const Work *w, int row) {
    double square = 0.0;
    for (int i = 0; i < w->lengths[row]; i++) {
        int column = w->columns[row * n + i];
        double value = w->rows[row * n + column];
        square += w->eliminated[column] ? 0.0 : value * value;
    }
    return sqrt(square);
}

/* adds entries in all columns of a reflector to a row */
static void fill(int n, Work *w, int row, int k) {
    const int *columns = w->columns + row * n, *support = w->columns + w->begin[k];
    int length = w->lengths[row];
    if (length == n) return;
    for (int i = 0; i < length; i++) w->marked[columns[i]] = 1;
    for (int j = 0; j < w->entries[k]; j++)
        if (!w->marked[support[j]]) add_entry(n, w, row, support[j]);
    for (int i = 0; i < length; i++) w->marked[columns[i]] = 0;
}

/* L H' of independent rows with row pivoting: reflectors H, rank, smallest pivot; a row of L takes the place of each row.
   A reflector has entries in the columns of its row only, behind those of L, and eliminates that of its largest entry:
   rows of other loops stay as they are */
static void factor(int count, int n, Work *w) {
    double largest = 0.0, least = count > MANY_ROWS ? LARGE : 1.0;
    int rows = 0;
    w->rank = 0, w->smallest = 1.0;
    memset(w->eliminated, 0, n * sizeof(int));
    for (int i = 0; i < count; i++) {
        int row = w->order[i];
        if ((w->norms[row] = remaining(n, w, row)) != 0.0) w->order[i] = w->order[rows], w->order[rows++] = row;
    }
    for (int k = 0; k < rows && k < n; k++) {
        int best = k;
        double most = 0.0;
        for (int i = k; i < rows; i++)
            if (w->norms[w->order[i]] > most) most = w->norms[w->order[i]];
        while (w->norms[w->order[best]] < least * most) best++;
        int chosen = w->order[best];
        double norm = w->norms[chosen], *row = w->rows + chosen * n, *v = w->reflectors + k * n;
        if (!(norm > fmax(RANK_TOLERANCE * largest, FLOOR))) return;
        if (!k) largest = norm;
        w->order[best] = w->order[k], w->order[k] = chosen;
        int *columns = w->columns + chosen * n, length = w->lengths[chosen], before = 0, pivot = -1;
        unsigned long long bits = 0;
        for (int i = 0; i < length; i++) {
            int column = columns[i];
            if (w->eliminated[column]) columns[i] = columns[before], columns[before++] = column;
            else bits |= 1ULL << (column & 63);
        }
        int entries = length - before, *support = columns + before;
        for (int j = 0; j < entries; j++)
            if (pivot < 0 || fabs(row[support[j]]) > fabs(row[pivot])) pivot = support[j];
        double new = row[pivot] > 0.0 ? -norm : norm, scale = 1.0 / sqrt(norm * (norm + fabs(row[pivot])));
        for (int j = 0; j < entries; j++) {
            v[j] = (row[support[j]] - (support[j] == pivot) * new) * scale;
            row[support[j]] = 0.0;
        }
        row[pivot] = new, w->pivots[k] = pivot, w->entries[k] = entries, w->begin[k] = chosen * n + before;
        w->smallest = k ? fmin(w->smallest, norm) : norm, w->rank = k + 1, w->eliminated[pivot] = 1;
        for (int i = k + 1; i < rows; i++) {
            int other = w->order[i];
            if (!(w->bits[other] & bits) || w->norms[other] == 0.0) continue;
            if (reflect_one(w, k, n, w->rows + other * n)) fill(n, w, other, k);
            else if (w->rows[other * n + pivot] == 0.0) continue;
            w->norms[other] = remaining(n, w, other);
        }
    }
}

/* x <- H x with the reflectors */
static void reflect(int n, const Work *w, double *x) {
    for (int k = w->rank - 1; k >= 0; k--) reflect_one(w, k, n, x);
}

/* least-norm solution of the independent rows for right sides */
static void least_norm(int n, Work *w, double sign, const double *right, double *x) {
    memset(x, 0, n * sizeof(double));
    for (int k = 0; k < w->rank; k++) {
        const double *row = w->rows + w->order[k] * n;
        double value = sign * right[w->order[k]];
        for (int i = w->order[k] * n; i < w->begin[k]; i++) value -= row[w->columns[i]] * x[w->columns[i]];
        x[w->pivots[k]] = value / row[w->pivots[k]];
    }
    reflect(n, w, x);
}

/* Cholesky factor in place, whose rows begin at the same `first` entries; 0 if the matrix is not positive definite */
static int factor_positive(int n, double *a, int *first) {
    for (int i = 0; i < n; i++) {
        first[i] = 0;
        while (first[i] < i && a[i * n + first[i]] == 0.0) first[i]++;
        for (int j = first[i]; j <= i; j++) {
            int k = first[i] > first[j] ? first[i] : first[j];
            double value = a[i * n + j] - inner(j - k, a + i * n + k, a + j * n + k);
            if (i == j && !(value > 0.0)) return 0;
            a[i * n + j] = i == j ? sqrt(value) : value / a[j * n + j];
        }
    }
    return 1;
}

static void solve_positive(int n, const double *a, const int *first, double *x) {
    for (int i = 0; i < n; i++)
        x[i] = (x[i] - inner(i - first[i], a + i * n + first[i], x + first[i])) / a[i * n + i];
    for (int i = n - 1; i >= 0; i--) {
        x[i] /= a[i * n + i];
        add_scaled(i - first[i], -x[i], a + i * n + first[i], x + first[i]);
    }
}

/* adds the accelerations that forces on the free coordinates cause within the loops; sets the multipliers of the
   independent rows, those of the others are zero */
static void respond(const Model *m, Work *w, const double *effort, double *acceleration) {
    int n = m->free, free = n - w->rank;
    double *left = w->basis + n * n, *right = left + n;
    for (int i = 0; i < free; i++) right[i] = inner(n, w->basis + i * n, effort);
    solve_positive(free, w->reduced, w->first, right);
    for (int i = 0; i < free; i++) add_scaled(n, right[i], w->basis + i * n, acceleration);
    if (!m->loaded && !m->driven) return;
    /* J' lambda = M a - Q with J = L H' */
    for (int i = 0; i < n; i++) {
        left[i] = -effort[i];
        for (int j = 0; j < free; j++) left[i] += right[j] * w->moving[j * n + i];
    }
    for (int k = 0; k < w->rank; k++) reflect_one(w, k, n, left);
    memset(w->multiplier, 0, m->rows * sizeof(double));
    for (int k = w->rank - 1; k >= 0; k--) {
        const double *row = w->rows + w->order[k] * n;
        double value = left[w->pivots[k]] / row[w->pivots[k]];
        for (int i = w->order[k] * n; i < w->begin[k]; i++) left[w->columns[i]] -= row[w->columns[i]] * value;
        if (w->order[k] < m->rows) w->multiplier[w->order[k]] = value;
    }
}

/* accelerations of the free coordinates, M a = Q + J' lambda with J a + gamma = 0, in `vector` */
static int accelerate(const Model *m, Work *w, int rows) {
    int n = m->free;
    factor(rows, n, w);
    least_norm(n, w, -1.0, w->gamma, w->vector);
    int free = n - w->rank, column = 0, *entries = w->marked;
    for (int i = 0; i < n; i++) add_mass(n, w, i, -w->vector[i], w->effort);
    memset(w->basis, 0, free * n * sizeof(double));
    memset(w->moving, 0, free * n * sizeof(double));
    for (int i = 0; i < free; i++) {
        double *along = w->basis + i * n, *moving = w->moving + i * n;
        int count = 0;
        while (w->eliminated[column]) column++;
        along[column++] = 1.0;
        reflect(n, w, along);
        for (int k = 0; k < n; k++)
            if (along[k] != 0.0) add_mass(n, w, k, along[k], moving), entries[count++] = k;
        for (int j = 0; j <= i; j++) {
            double *value = w->reduced + i * free + j;
            *value = 0.0;
            for (int k = 0; k < count; k++) *value += along[entries[k]] * w->moving[j * n + entries[k]];
        }
    }
    memset(w->marked, 0, n * sizeof(int));
    if (!factor_positive(free, w->reduced, w->first)) return 0;
    respond(m, w, w->effort, w->vector);
    return 1;
}

/* wrenches on links become those on all links that each joint carries */
static void collect(const Model *m, double *force) {
    for (int i = m->links - 1; i >= 0; i--) {
        const Branch *b = m->branches + i;
        if (b->parent >= 0) add_scaled(6, 1.0, force + 6 * b->child, force + 6 * b->parent);
    }
}

/* terms of the loads, (loaded, 4, 3), under accelerations, multipliers, and collected wrenches on the links */
static void set_terms(const Model *m, Work *w, const double *acceleration, const double *collected, double *terms) {
    memset(w->carried, 0, 6 * m->links * sizeof(double));
    for (int c = 0, row = 0; c < m->cuts; c++)
        for (int i = 0; i < m->cut[c].rows; i++, row++)
            act(w->carried, &m->cut[c].a, &m->cut[c].b, -w->multiplier[row], w->across + 6 * row);
    for (int i = 0; i < m->links; i++) {
        const Branch *b = m->branches + i;
        double *twist = w->twisting + 6 * b->child, momentum[6];
        memcpy(twist, b->parent < 0 ? STILL : w->twisting + 6 * b->parent, 6 * sizeof(double));
        for (int k = b->first; k < b->first + b->slides + b->turns; k++)
            if (m->coordinates[k].column >= 0)
                add_scaled(6, acceleration[m->coordinates[k].column], w->unit_twist + 6 * k, twist);
        set_momentum(w->own + 13 * b->child, twist, momentum);
        add_scaled(6, 1.0, momentum, w->carried + 6 * b->child);
    }
    collect(m, w->carried);
    for (int i = 0; i < m->resistances; i++) {
        const Resistance *r = m->resistance + i;
        double wrench[6] = {0.0}, point[3], axis[3] = {0.0};
        if (!r->loaded) continue;
        if (r->branch >= 0) {
            const Branch *b = m->branches + r->branch;
            double sign = b->forward ? 1.0 : -1.0;
            add_scaled(6, sign, w->carried + 6 * b->child, wrench);
            add_scaled(6, -sign, collected + 6 * b->child, wrench);
        } else {
            int row = 0;
            for (int c = 0; c < r->cut; c++) row += m->cut[c].rows;
            for (int k = row; k < row + m->cut[r->cut].rows; k++)
                add_scaled(6, w->multiplier[k], w->across + 6 * k, wrench);
        }
        locate(w, r->b.link, r->b.point, point, NULL);
        double moment[3];
        cross(wrench, point, moment);
        add_scaled(3, 1.0, moment, wrench + 3);
        if (r->motion != BALL) column_of(w, &r->a, 2, axis);
        for (int part = 0; part < 2; part++) {
            double along = dot(axis, wrench + 3 * part);
            for (int k = 0; k < 3; k++) {
                terms[6 * part + k] = r->load[2 * part] * (wrench[3 * part + k] - along * axis[k]);
                terms[6 * part + 3 + k] = r->load[2 * part + 1] * along * axis[k];
            }
        }
        terms += 12;
    }
}

/* largest number of iterations of the frictions by the load, and their relative change at convergence */
#define FRICTION_ITERATIONS 1000
#define BALANCED 1e-15

/* whether the frictions contract: B^k 1 -> 0 with B_ij the change of friction i by a unit of friction j */
static int contracts(int count, const double *terms, double *power, double *next) {
    double largest = 1.0;
    for (int i = 0; i < count; i++) power[i] = 1.0;
    for (int k = 0; k < FRICTION_ITERATIONS && largest >= 1.0; k++) {
        largest = 0.0;
        for (int i = 0; i < count; i++) {
            next[i] = 0.0;
            for (int j = 0; j < count; j++)
                for (int t = 0; t < 4; t++) {
                    const double *change = terms + 12 * (count * (j + 1) + i) + 3 * t;
                    next[i] += sqrt(dot(change, change)) * power[j];
                }
            largest = fmax(largest, next[i]);
        }
        memcpy(power, next, count * sizeof(double));
    }
    return largest < 1.0;
}

/* adds friction by the load, x_i = sum over t of |base_it + sum over j of change_ijt x_j|, by a fixed point from
   the last one, as numerics/complementarity.py; 0 without a unique solution */
static int add_friction_by_load(const Model *m, Work *w, const double *sliding) {
    int n = m->free, count = m->loaded, number = 0;
    double *x = w->magnitude, *next = x + count, *rate = next + count, *ratio = rate + count;
    set_terms(m, w, w->vector, w->force, w->terms);
    for (int i = 0; i < m->resistances; i++) {
        const Resistance *r = m->resistance + i;
        if (!r->loaded) continue;
        double wrench[6], *moved = w->moved + number * n, *terms = w->terms + 12 * count * (number + 1);
        along_resistance(r, w, rate + number, wrench);
        ratio[number] = slowness(rate[number], r->at_rest, r->stribeck);
        memset(w->pull, 0, 6 * m->links * sizeof(double));
        act(w->pull, &r->a, &r->b, -sliding[r->friction], wrench);
        collect(m, w->pull);
        for (int k = 0; k < m->links; k++) {
            const Branch *b = m->branches + k;
            for (int c = b->first; c < b->first + b->slides + b->turns; c++)
                if (m->coordinates[c].column >= 0)
                    w->push[m->coordinates[c].column] = inner(6, w->unit_twist + 6 * c, w->pull + 6 * b->child);
        }
        memset(moved, 0, n * sizeof(double));
        respond(m, w, w->push, moved);
        set_terms(m, w, moved, w->pull, terms);
        number++;
    }
    for (int j = 0; j <= count; j++)
        for (int i = 0; i < 12 * count; i++) w->terms[12 * count * j + i] *= ratio[i / 12];
    if (!contracts(count, w->terms, next, w->carried)) return 0;
    double change = INFINITY, largest = 0.0;
    for (int k = 0; k < FRICTION_ITERATIONS && !(change <= BALANCED * largest); k++) {
        change = largest = 0.0;
        for (int i = 0; i < count; i++) {
            double value = 0.0;
            for (int t = 0; t < 4; t++) {
                const double *base = w->terms + 12 * i + 3 * t;
                double term[3] = {base[0], base[1], base[2]};
                for (int j = 0; j < count; j++) add_scaled(3, x[j], base + 12 * count * (j + 1), term);
                value += sqrt(dot(term, term));
            }
            change = fmax(change, fabs(value - x[i])), largest = fmax(largest, value), x[i] = value;
        }
    }
    for (int i = 0, j = 0; i < m->resistances; i++)
        if (m->resistance[i].loaded) {
            add_scaled(n, x[j], w->moved + j * n, w->vector);
            w->power_lost += x[j] * sliding[m->resistance[i].friction] * rate[j], j++;
        }
    return 1;
}
