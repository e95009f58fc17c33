/* $name: its motion under forces, by mechsim $version. C99, no dependencies and no allocation.

   In one source file, define @IMPLEMENTATION before this header is included. All numbers are in SI.

     @motion motion;
     @start(&motion);                          start values; inputs, parameters and states may be changed
     const char *error = @begin(&motion);      NULL if the start values satisfy the loops
     motion.value[@INPUT] = 0.1;               an effort, until it is changed
     error = @advance(&motion, 0.01);          integrates to a time in s; NULL if it succeeds
     error = @evaluate(&motion);               derivatives and outputs at the states

   The functions share one memory: call them from one thread at a time. */
#ifndef @INCLUDED
#define @INCLUDED
#include <stddef.h>

/* numbers of the first values of each kind, and of all values; @names holds their names and units */
enum {
$numbers};

/* the values at the time value[0], and what the integrator keeps between two calls */
typedef struct {
    double kept[$kept];
    double value[@VALUES];
} @motion;

extern const char *const @names[@VALUES];
void @start(@motion *motion);
const char *@begin(@motion *motion);
const char *@advance(@motion *motion, double end);
const char *@evaluate(@motion *motion);
/* number of bytes that the functions have used at most */
size_t @memory(void);
#endif

#ifdef @IMPLEMENTATION
#include <math.h>
#include <stdlib.h>
#include <string.h>
#define integrate @integrate
#define evaluate @evaluate_states
#define ALLOCATE(bytes) taken(bytes)
#define RELEASE(memory) give_back(memory)

static union {
    double aligned;
    char bytes[$memory];
} memory;
static size_t used, most;

/* memory in the order of a stack, filled with zeros */
static void *taken(size_t bytes) {
    void *result = memory.bytes + used;
    bytes = (bytes + 15) / 16 * 16;
    if (bytes > sizeof memory.bytes - used) return NULL;
    used += bytes, most = used > most ? used : most;
    return memset(result, 0, bytes);
}

static void give_back(const void *block) {
    size_t first = block ? (size_t)((const char *)block - memory.bytes) : used;
    used = first < used ? first : used;
}

enum {
$plain};
static const double START[VALUES] = {$starts};

$code

const char *const @names[@VALUES] = {
    $names};
static Own own;
/* a motion is a snapshot */
typedef char equal_sizes[sizeof(@motion) == sizeof(Snapshot) ? 1 : -1];

static int ready(void) {
    if (own.work || prepare(&own)) return 1;
    discard(&own), own.work = NULL;
    return 0;
}

void @start(@motion *motion) {
    Snapshot now = {0};
    memcpy(now.value, START, sizeof START);
    start(&now, &own);
    memcpy(motion, &now, sizeof now);
}

/* calls a function with the values of a motion, and keeps what it changes if it succeeds */
#define CALL(function)                                           \
    Snapshot now;                                                \
    if (!ready()) return "the memory of the header is too small"; \
    memcpy(&now, motion, sizeof now);                            \
    const char *error = function;                                \
    if (!error) memcpy(motion, &now, sizeof now);                \
    return error

const char *@begin(@motion *motion) { CALL(begin(&now, &own)); }
const char *@advance(@motion *motion, double end) { CALL(end > now.value[0] ? advance(&now, &own, end) : "the end is not later"); }
const char *@evaluate(@motion *motion) { CALL(compute(&now, &own)); }
size_t @memory(void) { return most; }
#endif
