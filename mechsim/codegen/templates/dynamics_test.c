/* Checks @motion against mechsim's own run, and times it. */
#define @IMPLEMENTATION
#include "$header"
#include <stdio.h>
#include <time.h>

$data

int main(void) {
    @motion motion;
    double worst = 0.0;
    @start(&motion);
    const char *error = @begin(&motion);
    const clock_t begun = clock();
    for (int k = 0; k < INSTANTS && !error; k++) {
        error = @advance(&motion, times[k]);
        error = error ? error : @evaluate(&motion);
        for (int i = 0; i < COMPARED && !error; i++) {
            const double difference = fabs(motion.value[compared[i]] - expected[k * COMPARED + i]) / allowed[i];
            if (!(difference <= worst)) worst = isnan(difference) ? INFINITY : difference;
        }
    }
    printf("$name: %s; largest error %.2g of its tolerance; %.3g s of motion in %.3g ms\n", error ? error : "done",
           worst, motion.value[0], 1e3 * (double)(clock() - begun) / CLOCKS_PER_SEC);
    return error || !(worst <= 1.0);
}
