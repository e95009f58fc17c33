/* Expressions of time and state, as lists of instructions on a stack: mechsim.mechanism.expressions. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

/* in the order of `CODES` of compiled_expressions.py */
enum {
    NUMBER, TIME, COORDINATE, RATE, NEGATIVE, SUM, DIFFERENCE, PRODUCT, QUOTIENT, POWER, SINE, COSINE, TANGENT,
    ARCSINE, ARCCOSINE, ARCTANGENT, DIRECTION, ROOT, EXPONENTIAL, LOGARITHM, ABSOLUTE, LEAST_OF, LARGEST_OF, TABLE, SEGMENTS
};
/* the largest number of values on the stack: `MAX_VALUES` of compiled_expressions.py */
#define MAX_VALUES 64

/* `index` is the number of a coordinate, or that of the values which the result replaces; the value of a table is where
   it lies */
typedef struct {
    int code, index;
    double value;
} Instruction;

/* where the instructions of an expression lie; none if the length is 0 */
typedef struct {
    int first, length;
} Expression;

/* a value and its derivatives by the time that the expression names itself */
typedef struct {
    double value, rate, second;
} Timed;

/* f(x) from f, f' and f'' at x */
static Timed timed(double value, double first, double second, Timed x) {
    Timed result = {value, 0.0, 0.0};
    if (x.rate == 0.0 && x.second == 0.0) return result;
    result.rate = first * x.rate, result.second = second * x.rate * x.rate + first * x.second;
    return result;
}

/* what a piecewise polynomial has beyond its ends */
enum { REPEATED, UNDEFINED, CONTINUED_BEYOND };
/* rounding of the ends, relative to their distance */
#define SLACK 1e-9

/* value of a piecewise polynomial with two derivatives, and its integral from the first end: `table` holds numbers of
   intervals and coefficients, what is beyond, a slope to be added, ends of the intervals, and the coefficients of
   the integral in each, highest first */
static Timed of_table(const double *table, Timed x, double *integral) {
    int count = (int)table[0], order = (int)table[1], low = 0, high = count - 1;
    const double *ends = table + 4, *coefficients = ends + count + 1;
    double first = ends[0], span = ends[count] - first, at = x.value, p[4] = {0.0};
    if (table[2] == REPEATED) at -= floor((at - first) / span) * span;
    if (table[2] == UNDEFINED) {
        if (!(at >= first - SLACK * span && at <= first + span + SLACK * span)) at = NAN;
        at = at < first ? first : at > ends[count] ? ends[count] : at;
    }
    while (low < high) {
        int middle = (low + high + 1) / 2;
        if (ends[middle] <= at) low = middle;
        else high = middle - 1;
    }
    for (int k = 0; k < order; k++) {
        for (int i = 3; i > 0; i--) p[i] = p[i] * (at - ends[low]) + p[i - 1];
        p[0] = p[0] * (at - ends[low]) + coefficients[low * order + k];
    }
    if (integral) *integral = p[0];
    return timed(p[1] + table[3] * x.value, 2.0 * p[2] + table[3], 6.0 * p[3], x);
}

/* in the order of `LAWS` of cams.py */
enum { DWELL, CYCLOIDAL, MODIFIED_SINE, POLYNOMIAL_345 };

/* lift of a cam, repeated each revolution: `law` holds the number of segments, and of each the first angle, the width,
   the level, the lift and its kind */
static Timed of_segments(const double *law, Timed x) {
    const double pi = acos(-1.0), *first = law + 1, *segment = first + 5 * ((int)law[0] - 1);
    double at = x.value - 2.0 * pi * floor((x.value - first[0]) / (2.0 * pi)), value = 0.0, rate = 0.0, second = 0.0;
    while (segment > first && at < segment[0]) segment -= 5;
    double width = segment[1], u = (at - segment[0]) / width;
    switch ((int)segment[4]) {
    case CYCLOIDAL:
        value = u - sin(2.0 * pi * u) / (2.0 * pi), rate = 1.0 - cos(2.0 * pi * u), second = 2.0 * pi * sin(2.0 * pi * u);
        break;
    case MODIFIED_SINE: {
        int middle = u >= 0.125 && u <= 0.875;
        double angle = middle ? pi / 3.0 + 4.0 * pi / 3.0 * u : 4.0 * pi * u, factor = middle ? 2.25 : 0.25;
        value = pi * u - factor * sin(angle) + (middle ? 2.0 : u > 0.5 ? 4.0 : 0.0);
        rate = pi - (middle ? 3.0 : 1.0) * pi * cos(angle), second = 4.0 * pi * pi * sin(angle);
        value /= 4.0 + pi, rate /= 4.0 + pi, second /= 4.0 + pi;
        break;
    }
    case POLYNOMIAL_345:
        value = u * u * u * (10.0 - u * (15.0 - 6.0 * u)), rate = 30.0 * u * u * (1.0 - u) * (1.0 - u);
        second = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u);
    }
    return timed(segment[2] + segment[3] * value, segment[3] * rate / width, segment[3] * second / (width * width), x);
}

static Timed of_one(int code, Timed x) {
    double v = x.value, root = sqrt(v), square = 1.0 - v * v;
    switch (code) {
    case NEGATIVE: return timed(-v, -1.0, 0.0, x);
    case SINE: return timed(sin(v), cos(v), -sin(v), x);
    case COSINE: return timed(cos(v), -sin(v), -cos(v), x);
    case TANGENT: return timed(tan(v), 1.0 + tan(v) * tan(v), 2.0 * tan(v) * (1.0 + tan(v) * tan(v)), x);
    case ARCSINE: return timed(asin(v), 1.0 / sqrt(square), v / (square * sqrt(square)), x);
    case ARCCOSINE: return timed(acos(v), -1.0 / sqrt(square), -v / (square * sqrt(square)), x);
    case ARCTANGENT: return timed(atan(v), 1.0 / (1.0 + v * v), -2.0 * v / ((1.0 + v * v) * (1.0 + v * v)), x);
    case ROOT: return timed(root, 0.5 / root, -0.25 / (root * v), x);
    case EXPONENTIAL: return timed(exp(v), exp(v), exp(v), x);
    case LOGARITHM: return timed(log(v), 1.0 / v, -1.0 / (v * v), x);
    default: return timed(fabs(v), v < 0.0 ? -1.0 : 1.0, 0.0, x);
    }
}

static Timed sum_of(double factor, Timed a, double other, Timed b) {
    Timed result = {factor * a.value + other * b.value, factor * a.rate + other * b.rate,
                    factor * a.second + other * b.second};
    return result;
}

static Timed product(Timed a, Timed b) {
    Timed result = {a.value * b.value, 0.0, 0.0};
    result.rate = (b.rate != 0.0 ? a.value * b.rate : 0.0) + (a.rate != 0.0 ? b.value * a.rate : 0.0);
    result.second = (b.second != 0.0 ? a.value * b.second : 0.0) + (a.second != 0.0 ? b.value * a.second : 0.0);
    result.second += 2.0 * a.rate * b.rate;
    return result;
}

static Timed inverse(Timed b) {
    double v = b.value;
    return timed(1.0 / v, -1.0 / (v * v), 2.0 / (v * v * v), b);
}

static Timed power(Timed a, Timed b) {
    double v = a.value, n = b.value, value = pow(v, n);
    /* with a constant exponent, the base may be negative */
    if (b.rate == 0.0 && b.second == 0.0) return timed(value, n * pow(v, n - 1.0), n * (n - 1.0) * pow(v, n - 2.0), a);
    Timed exponent = product(b, of_one(LOGARITHM, a));
    return timed(value, value, value, exponent);
}

/* atan2: rate (a' b - a b') / (a^2 + b^2) */
static Timed direction(Timed a, Timed b) {
    double square = a.value * a.value + b.value * b.value;
    double turning = a.rate * b.value - a.value * b.rate, growing = 2.0 * (a.value * a.rate + b.value * b.rate);
    Timed result = {atan2(a.value, b.value), 0.0, 0.0};
    if (turning == 0.0 && a.second == 0.0 && b.second == 0.0) return result;
    result.rate = turning / square;
    result.second = (a.second * b.value - a.value * b.second) / square - result.rate * growing / square;
    return result;
}

static Timed of_two(int code, Timed a, Timed b) {
    switch (code) {
    case SUM: return sum_of(1.0, a, 1.0, b);
    case DIFFERENCE: return sum_of(1.0, a, -1.0, b);
    case PRODUCT: return product(a, b);
    case QUOTIENT: {
        Timed result = product(a, inverse(b));
        result.value = a.value / b.value;
        return result;
    }
    case POWER: return power(a, b);
    case DIRECTION: return direction(a, b);
    case LEAST_OF: return a.value <= b.value ? a : b;
    default: return a.value >= b.value ? a : b;
    }
}

/* value of an expression at a time, coordinates in SI and their rates, of which `value` is the unit */
static Timed evaluated(const Instruction *all, const double *tables, Expression e, double time, const double *q,
                       const double *rates) {
    Timed stack[MAX_VALUES] = {{0.0, 0.0, 0.0}};
    int top = 0;
    for (int i = e.first; i < e.first + e.length; i++) {
        const Instruction *one = all + i;
        if (one->code <= RATE) {
            double value = one->code == NUMBER ? one->value : one->code == TIME ? time
                         : one->code == COORDINATE ? q[one->index] : rates[one->index] * one->value;
            stack[top].value = value, stack[top].second = 0.0, stack[top++].rate = one->code == TIME;
            continue;
        }
        top -= one->index - 1;
        Timed result = stack[top - 1];
        if (one->code == TABLE) result = of_table(tables + (size_t)one->value, result, NULL);
        else if (one->code == SEGMENTS) result = of_segments(tables + (size_t)one->value, result);
        else if (one->index == 1 && one->code != LEAST_OF && one->code != LARGEST_OF) result = of_one(one->code, result);
        for (int k = 1; k < one->index; k++) result = of_two(one->code, result, stack[top - 1 + k]);
        stack[top - 1] = result;
    }
    return stack[0];
}

/* force or torque on a coordinate */
typedef struct {
    int coordinate;
    Expression effort;
} Controller;

/* force on a weighted sum of coordinates, as mechsim.mechanism.actuators states; or friction with bristles if their
   stiffness, the first of `bristles`, is not 0: then follow their damping, viscous and Coulomb friction, the latter at
   rest relative to that in motion, and the rate of Stribeck's curve */
typedef struct {
    Expression control;
    int has_state;
    double gain[3], bias[3], direct[2], inflow[4], control_range[2], state_range[2], force_range[2], bristles[6];
} Actuator;

static double clipped(double value, const double *range) {
    return value < range[0] ? range[0] : value > range[1] ? range[1] : value;
}

/* Coulomb friction at a rate relative to that in fast motion, by Stribeck's curve unless its rate is 0 */
static double slowness(double rate, double at_rest, double stribeck) {
    double relative = stribeck > 0.0 ? rate / stribeck : INFINITY;
    return 1.0 + (at_rest - 1.0) * exp(-relative * relative);
}

/* force of an actuator on its length, and the rate of its state */
static double actuator_force(const Actuator *a, Timed given, double state, double length, double speed, double *flow) {
    const double *bristles = a->bristles;
    if (bristles[0] != 0.0) {
        double limit = bristles[3] * slowness(speed, bristles[4], bristles[5]);
        *flow = speed - bristles[0] * fabs(speed) * state / limit;
        return -(bristles[0] * state + bristles[1] * *flow + bristles[2] * speed);
    }
    double control = clipped(given.value, a->control_range), x = a->has_state ? state : control;
    double rate = control == given.value ? given.rate : 0.0;
    double force = (a->gain[0] + a->gain[1] * length + a->gain[2] * speed) * x;
    force += a->bias[0] + a->bias[1] * length + a->bias[2] * speed;
    *flow = a->inflow[0] * control + a->inflow[1] * state + a->inflow[2] * length + a->inflow[3] * speed;
    if ((state <= a->state_range[0] && *flow < 0.0) || (state >= a->state_range[1] && *flow > 0.0)) *flow = 0.0;
    return clipped(force + a->direct[0] * control + (a->direct[1] != 0.0 ? a->direct[1] * rate : 0.0), a->force_range);
}
