/* Expressions of time and state, as lists of instructions on a stack: mechsim.model.expressions. */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

/* in the order of `CODES` of compiled_expressions.py */
enum {
    NUMBER, TIME, COORDINATE, RATE, NEGATIVE, SUM, DIFFERENCE, PRODUCT, QUOTIENT, POWER, SINE, COSINE, TANGENT,
    ARCSINE, ARCCOSINE, ARCTANGENT, DIRECTION, ROOT, EXPONENTIAL, LOGARITHM, ABSOLUTE, LEAST_OF, LARGEST_OF
};
/* the largest number of values on the stack: `MAX_VALUES` of compiled_expressions.py */
#define MAX_VALUES 64

/* `index` is the number of a coordinate, or that of the values which the result replaces */
typedef struct {
    int code, index;
    double value;
} Instruction;

/* where the instructions of an expression lie; none if the length is 0 */
typedef struct {
    int first, length;
} Expression;

/* a value and its rate by the time that the expression names itself */
typedef struct {
    double value, rate;
} Timed;

static Timed timed(double value, double derivative, Timed x) {
    Timed result = {value, x.rate != 0.0 ? derivative * x.rate : 0.0};
    return result;
}

static Timed of_one(int code, Timed x) {
    double v = x.value, root = sqrt(v);
    switch (code) {
    case NEGATIVE: return timed(-v, -1.0, x);
    case SINE: return timed(sin(v), cos(v), x);
    case COSINE: return timed(cos(v), -sin(v), x);
    case TANGENT: return timed(tan(v), 1.0 + tan(v) * tan(v), x);
    case ARCSINE: return timed(asin(v), 1.0 / sqrt(1.0 - v * v), x);
    case ARCCOSINE: return timed(acos(v), -1.0 / sqrt(1.0 - v * v), x);
    case ARCTANGENT: return timed(atan(v), 1.0 / (1.0 + v * v), x);
    case ROOT: return timed(root, 0.5 / root, x);
    case EXPONENTIAL: return timed(exp(v), exp(v), x);
    case LOGARITHM: return timed(log(v), 1.0 / v, x);
    default: return timed(fabs(v), v < 0.0 ? -1.0 : 1.0, x);
    }
}

static Timed of_two(int code, Timed a, Timed b) {
    double square = a.value * a.value + b.value * b.value;
    Timed first = timed(0.0, 1.0, a), second = timed(0.0, 1.0, b), result = a;
    switch (code) {
    case SUM: result.value = a.value + b.value; break;
    case DIFFERENCE: result.value = a.value - b.value, second = timed(0.0, -1.0, b); break;
    case PRODUCT: result.value = a.value * b.value, first = timed(0.0, b.value, a), second = timed(0.0, a.value, b); break;
    case QUOTIENT:
        result.value = a.value / b.value;
        first = timed(0.0, 1.0 / b.value, a), second = timed(0.0, -result.value / b.value, b);
        break;
    case POWER:
        result.value = pow(a.value, b.value);
        first = timed(0.0, b.value * pow(a.value, b.value - 1.0), a);
        second = timed(0.0, result.value * log(a.value), b);
        break;
    case DIRECTION:
        result.value = atan2(a.value, b.value);
        first = timed(0.0, b.value / square, a), second = timed(0.0, -a.value / square, b);
        break;
    case LEAST_OF: return a.value <= b.value ? a : b;
    default: return a.value >= b.value ? a : b;
    }
    result.rate = first.rate + second.rate;
    return result;
}

/* value of an expression at a time, coordinates in SI and their rates, of which `value` is the unit */
static Timed evaluated(const Instruction *all, Expression e, double time, const double *q, const double *rates) {
    Timed stack[MAX_VALUES] = {{0.0, 0.0}};
    int top = 0;
    for (int i = e.first; i < e.first + e.length; i++) {
        const Instruction *one = all + i;
        if (one->code <= RATE) {
            double value = one->code == NUMBER ? one->value : one->code == TIME ? time
                         : one->code == COORDINATE ? q[one->index] : rates[one->index] * one->value;
            stack[top].value = value, stack[top++].rate = one->code == TIME;
            continue;
        }
        top -= one->index - 1;
        Timed result = stack[top - 1];
        if (one->index == 1) result = one->code == LEAST_OF || one->code == LARGEST_OF ? result : of_one(one->code, result);
        for (int k = 1; k < one->index; k++) result = of_two(one->code, result, stack[top - 1 + k]);
        stack[top - 1] = result;
    }
    return stack[0];
}
