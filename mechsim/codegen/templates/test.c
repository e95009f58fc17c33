/* Checks @solver against the analytic solution, and times it. */
#include <stdio.h>
#include <time.h>
#include "HEADER"

DATA

int main(void) {
  @state s;
  @KIND values[NAMES];
  double worst = 0;
  const double allowed = TOLERANCE * (double)@EPSILON / DBL_EPSILON;
  if (@start(&s) != @SOLVED) { printf("start fails\n"); return 1; }
  for (int k = 0; k < COUNT; k++) {
    const int d = k * @DRIVERS;
    const int status = @solve(&s, drivers + d, rates + d, accelerations + d);
    if (status != @SOLVED) { printf("configuration %d: status %d\n", k, status); return 1; }
    @solve_KINDs(&s, values);
    for (int i = 0; i < COMPARED; i++) {
      const double *expected = reference + (k * COMPARED + i) * 9;
      for (int j = 0; j < 3; j++) {
        const double errors[3] = {
          fabs((double)values[index[i]].position[j] - expected[j]) / scales[0],
          fabs((double)values[index[i]].velocity[j] - expected[3 + j]) / scales[1],
          fabs((double)values[index[i]].acceleration[j] - expected[6 + j]) / scales[2],
        };
        for (int e = 0; e < 3; e++) { if (!(errors[e] <= worst)) { worst = isnan(errors[e]) ? INFINITY : errors[e]; } }
      }
    }
  }
#if LIMITED
  {
    const @real outside[1] = { @HIGH + 1 };
    const @real before = s.coordinates[0];
    if (@solve(&s, outside, rates, accelerations) == @SOLVED || s.coordinates[0] != before) {
      printf("a configuration outside the range is not rejected\n");
      return 1;
    }
  }
#endif
  long solved = 0;
  const clock_t begin = clock();
  while (worst <= allowed && clock() - begin < CLOCKS_PER_SEC / 10) {
    for (int k = 0; k < 2 * COUNT; k++) {
      const int d = (k < COUNT ? k : 2 * COUNT - 1 - k) * @DRIVERS;
      solved += @solve(&s, drivers + d, rates + d, accelerations + d) == @SOLVED;
    }
  }
  printf("NAME: largest relative error %.2g, allowed %.2g; %.3f us a configuration\n", worst, allowed,
         1e6 * (double)(clock() - begin) / CLOCKS_PER_SEC / (double)solved);
  return !(worst <= allowed);
}
