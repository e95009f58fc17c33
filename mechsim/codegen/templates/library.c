#include <stddef.h>
#include <string.h>
HEADER
/* Solves n configurations in sequence; returns how many are solved, and the status of the last call. */
int solve_all(int n, const double *drivers, const double *rates, const double *accelerations, double *motion,
              double *links, double *map, int *status
#if TORQUES
              , const double *inertias, const double *gravity, double *torques
#endif
              ) {
  @state s;
  @link link[@LINKS];
  int k = 0;
  *status = @start(&s);
  for (; k < n && *status == @SOLVED; k++) {
    const int d = k * @DRIVERS;
    *status = @solve(&s, drivers + d, rates + d, accelerations + d);
    if (*status != @SOLVED) { break; }
    for (int i = 0; i < @COORDINATES; i++) {
      double *row = motion + (size_t)k * 3 * @COORDINATES + i;
      row[0] = s.coordinates[i];
      row[@COORDINATES] = s.rates[i];
      row[2 * @COORDINATES] = s.accelerations[i];
    }
    memcpy(map + (size_t)k * @COORDINATES * @DRIVERS, s.map, sizeof s.map);
    @solve_links(&s, link);
    memcpy(links + (size_t)k * sizeof link / sizeof(double), link, sizeof link);
#if TORQUES
    @solve_torques(&s, inertias, gravity, torques + d);
#endif
  }
  return k;
}
