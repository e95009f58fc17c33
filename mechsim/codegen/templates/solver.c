/* Evaluates the loop equations at the state's coordinates: residuals, s->lu the Jacobian by the unknowns,
   by_drivers that by the drivers; all free of units. */
static inline void @equations(@state *s, real *residual, real *by_drivers) {
  for (int i = 0; i < @UNKNOWNS * @UNKNOWNS; i++) { s->lu[i] = 0; }
  for (int i = 0; i < @UNKNOWNS * @DRIVERS; i++) { by_drivers[i] = 0; }
#if ANGLES
  for (int i = 0; i < @ANGLES; i++) {
    s->cosines[@ANGLE[i]] = cos(s->coordinates[@ANGLE[i]]);
    s->sines[@ANGLE[i]] = sin(s->coordinates[@ANGLE[i]]);
  }
#endif
  (void)residual;
  EQUATIONS
}

/* Evaluates the second rate of the residuals at coordinate rates that do not change. */
static inline void @velocity_products(const @state *s, const real *rates, real *out) {
  (void)s; (void)rates; (void)out;
  VELOCITY_PRODUCTS
}

/* Factorises s->lu in place with partial pivoting; returns the sign of the determinant, 0 if singular. */
static inline int @factorise(@state *s) {
  int sign = 1;
  for (int k = 0; k < @UNKNOWNS; k++) {
    int pivot = k;
    real largest = fabs(s->lu[k * @UNKNOWNS + k]);
    for (int i = k + 1; i < @UNKNOWNS; i++) {
      const real size = fabs(s->lu[i * @UNKNOWNS + k]);
      if (size > largest) { largest = size; pivot = i; }
    }
    s->pivots[k] = pivot;
    if (!(largest > @PIVOT)) { return 0; }
    if (pivot != k) {
      sign = -sign;
      for (int j = 0; j < @UNKNOWNS; j++) {
        const real value = s->lu[k * @UNKNOWNS + j];
        s->lu[k * @UNKNOWNS + j] = s->lu[pivot * @UNKNOWNS + j];
        s->lu[pivot * @UNKNOWNS + j] = value;
      }
    }
    if (s->lu[k * @UNKNOWNS + k] < 0) { sign = -sign; }
    const real inverse = 1 / s->lu[k * @UNKNOWNS + k];
    s->inverses[k] = inverse;
    for (int i = k + 1; i < @UNKNOWNS; i++) {
      const real factor = s->lu[i * @UNKNOWNS + k] * inverse;
      s->lu[i * @UNKNOWNS + k] = factor;
      if (factor != 0) {
        for (int j = k + 1; j < @UNKNOWNS; j++) {
          s->lu[i * @UNKNOWNS + j] -= factor * s->lu[k * @UNKNOWNS + j];
        }
      }
    }
  }
  return sign;
}

/* Replaces b by the solution x of J x = b, by the factors in s->lu. */
static inline void @substitute(const @state *s, real *b) {
  for (int k = 0; k < @UNKNOWNS; k++) {
    const real value = b[s->pivots[k]];
    b[s->pivots[k]] = b[k];
    b[k] = value;
  }
  for (int i = 1; i < @UNKNOWNS; i++) {
    for (int j = 0; j < i; j++) { b[i] -= s->lu[i * @UNKNOWNS + j] * b[j]; }
  }
  for (int i = @UNKNOWNS - 1; i >= 0; i--) {
    for (int j = i + 1; j < @UNKNOWNS; j++) { b[i] -= s->lu[i * @UNKNOWNS + j] * b[j]; }
    b[i] *= s->inverses[i];
  }
}

/* Moves the unknown coordinates by a step free of units. */
static inline void @displace(@state *s, const real *step) {
  for (int u = 0; u < @UNKNOWNS; u++) { s->coordinates[@UNKNOWN[u]] += @UNIT[u] * step[u]; }
#if BALLS
  /* ball joints: multiply the quaternions (w, x, y, z) by (1, step / 2) */
  for (int k = 0; k < @BALLS; k++) {
    const int first = @BALL[k];
    const real x = step[first] / 2;
    const real y = step[first + 1] / 2;
    const real z = step[first + 2] / 2;
    const real a = s->balls[4 * k];
    const real b = s->balls[4 * k + 1];
    const real c = s->balls[4 * k + 2];
    const real d = s->balls[4 * k + 3];
    const real w_new = a - x * b - y * c - z * d;
    const real x_new = b + x * a + y * d - z * c;
    const real y_new = c + y * a + z * b - x * d;
    const real z_new = d + z * a + x * c - y * b;
    const real scale = 1 / sqrt(w_new * w_new + x_new * x_new + y_new * y_new + z_new * z_new);
    s->balls[4 * k] = w_new * scale;
    s->balls[4 * k + 1] = x_new * scale;
    s->balls[4 * k + 2] = y_new * scale;
    s->balls[4 * k + 3] = z_new * scale;
    for (int i = 0; i < 3; i++) { s->coordinates[@UNKNOWN[first + i]] = 0; }
  }
#endif
}

/* Fills in s->map, the derivatives of all coordinates by the drivers, from the factors in s->lu. */
static inline void @differentiate(@state *s, const real *by_drivers) {
  real column[@UNKNOWNS_OR_1];
  for (int d = 0; d < @DRIVERS; d++) {
    for (int u = 0; u < @UNKNOWNS; u++) { column[u] = -by_drivers[u * @DRIVERS + d]; }
    @substitute(s, column);
    for (int u = 0; u < @UNKNOWNS; u++) {
      s->map[@UNKNOWN[u] * @DRIVERS + d] = column[u] * @UNIT[u] / @UNIT_OF_DRIVER[d];
    }
    s->map[@DRIVEN[d] * @DRIVERS + d] = 1;
  }
#if ONE_DRIVER
  @velocity_products(s, s->map, s->second);
  @substitute(s, s->second);
#endif
}

/* Advances by one driver step: predicts by first and second derivatives, corrects by Newton's method.
   On failure, a status other than @SOLVED, the state is undefined. */
static inline int @advance(@state *s, const real *drivers) {
  real residual[@UNKNOWNS_OR_1];
  real by_drivers[@UNKNOWNS_OR_1 * @DRIVERS];
#if ONE_DRIVER
  const real step = drivers[0] - s->drivers[0];
  for (int u = 0; u < @UNKNOWNS; u++) {
    residual[u] = step * (s->map[@UNKNOWN[u]] / @UNIT[u] - step / 2 * s->second[u]);
  }
#endif
#if !ONE_DRIVER
  real first[@COORDINATES];
  for (int i = 0; i < @COORDINATES; i++) {
    first[i] = 0;
    for (int d = 0; d < @DRIVERS; d++) {
      first[i] += s->map[i * @DRIVERS + d] * (drivers[d] - s->drivers[d]);
    }
  }
  @velocity_products(s, first, residual);
  @substitute(s, residual);
  for (int u = 0; u < @UNKNOWNS; u++) { residual[u] = first[@UNKNOWN[u]] / @UNIT[u] - residual[u] / 2; }
#endif
  for (int u = 0; u < @UNKNOWNS; u++) {
    if (!(fabs(residual[u]) <= @DISPLACEMENT)) { return @TOO_FAR; }
  }
  @displace(s, residual);
  for (int d = 0; d < @DRIVERS; d++) { s->drivers[d] = drivers[d]; s->coordinates[@DRIVEN[d]] = drivers[d]; }
  real previous = @CORRECTION / @CONTRACTION;
  for (int k = 0; k < @ITERATIONS; k++) {
    @equations(s, residual, by_drivers);
    if (@factorise(s) != @SIGN) { return @SINGULAR; }
    @substitute(s, residual);
    real largest = 0;
    for (int u = 0; u < @UNKNOWNS; u++) {
      residual[u] = -residual[u];
      if (!(fabs(residual[u]) <= largest)) { largest = fabs(residual[u]); }
    }
    const int slow = !(largest <= @CONTRACTION * previous);
    if (slow && !(largest < sqrt(@EPSILON))) { return @TOO_FAR; }
    @displace(s, residual);
    if (slow || largest < 16 * @EPSILON) {
      @differentiate(s, by_drivers);
      return @SOLVED;
    }
    previous = largest;
  }
  return @TOO_FAR;
}

/* Copies the configuration of a state. */
static inline void @save(const @state *s, @configuration *c) {
  for (int i = 0; i < @DRIVERS; i++) { c->drivers[i] = s->drivers[i]; }
  for (int i = 0; i < @COORDINATES; i++) { c->coordinates[i] = s->coordinates[i]; }
#if BALLS
  for (int i = 0; i < 4 * @BALLS; i++) { c->balls[i] = s->balls[i]; }
#endif
}

/* Sets a state to a configuration; rates stay. Returns the status: @TOO_FAR where the loops do not close. */
static inline int @restore(@state *s, const @configuration *c) {
  real residual[@UNKNOWNS_OR_1];
  real by_drivers[@UNKNOWNS_OR_1 * @DRIVERS];
  for (int i = 0; i < @DRIVERS; i++) { s->drivers[i] = c->drivers[i]; }
  for (int i = 0; i < @COORDINATES; i++) { s->coordinates[i] = c->coordinates[i]; }
#if BALLS
  for (int i = 0; i < 4 * @BALLS; i++) { s->balls[i] = c->balls[i]; }
#endif
  @equations(s, residual, by_drivers);
  if (@factorise(s) != @SIGN) { return @SINGULAR; }
  @differentiate(s, by_drivers);
  for (int u = 0; u < @UNKNOWNS; u++) {
    if (!(fabs(residual[u]) < sqrt(@EPSILON))) { return @TOO_FAR; }
  }
  return @SOLVED;
}

/* Sets a state to the configuration from which the assembly is followed, at rest. Call it first. */
static inline int @start(@state *s) {
  @configuration initial;
  for (int i = 0; i < @DRIVERS; i++) { initial.drivers[i] = @START[@DRIVEN[i]]; }
  for (int i = 0; i < @COORDINATES; i++) { initial.coordinates[i] = @START[i]; }
#if BALLS
  for (int i = 0; i < 4 * @BALLS; i++) { initial.balls[i] = @START_BALLS[i]; }
#endif
  for (int i = 0; i < @COORDINATES; i++) { s->rates[i] = 0; s->accelerations[i] = 0; }
  for (int i = 0; i < @COORDINATES * @DRIVERS; i++) { s->map[i] = 0; }
  for (int i = 0; i < @COORDINATES; i++) { s->cosines[i] = 1; s->sines[i] = 0; }
  return @restore(s, &initial);
}

/* Fills in rates and accelerations of all coordinates at those of the drivers. */
static inline void @set_rates(@state *s, const real *rates, const real *accelerations) {
  for (int i = 0; i < @COORDINATES; i++) {
    s->rates[i] = 0;
    s->accelerations[i] = 0;
    for (int d = 0; d < @DRIVERS; d++) {
      s->rates[i] += s->map[i * @DRIVERS + d] * rates[d];
      s->accelerations[i] += s->map[i * @DRIVERS + d] * accelerations[d];
    }
  }
#if ONE_DRIVER
  const real square = rates[0] * rates[0];
  for (int u = 0; u < @UNKNOWNS; u++) { s->accelerations[@UNKNOWN[u]] -= @UNIT[u] * s->second[u] * square; }
#endif
#if !ONE_DRIVER
  real second[@UNKNOWNS_OR_1];
  @velocity_products(s, s->rates, second);
  @substitute(s, second);
  for (int u = 0; u < @UNKNOWNS; u++) { s->accelerations[@UNKNOWN[u]] -= @UNIT[u] * second[u]; }
#endif
}

/* Solves the configuration, rates and accelerations at given drivers, starting from the state's last
   configuration, which it does not leave where the status is not @SOLVED. */
static inline int @solve(@state *s, const real *drivers, const real *rates, const real *accelerations) {
  @configuration initial;
  @configuration last;
  real target[@DRIVERS];
  real distance = 0;
  for (int d = 0; d < @DRIVERS; d++) {
#if LIMITED
    if (!(drivers[d] >= @LOW && drivers[d] <= @HIGH)) { return @OUT_OF_RANGE; }
#endif
    /* rates that are not finite */
    if (!(rates[d] - rates[d] == 0 && accelerations[d] - accelerations[d] == 0)) { return @OUT_OF_RANGE; }
    const real steps = fabs(drivers[d] - s->drivers[d]) / @STEP[d];
    if (!(steps <= @ATTEMPTS)) { return @TOO_FAR; }
    if (steps > distance) { distance = steps; }
  }
  real step = 1;
  if (distance > 1) { step = 1 / distance; }
  const real smallest = step * @HALVED;
  real fraction = 0;
  int attempt = 0;
  @save(s, &initial);
  while (fraction < 1) {
    @save(s, &last);
    real next = fraction + step;
    if (next > 1 - smallest) { next = 1; }
    for (int d = 0; d < @DRIVERS; d++) {
      target[d] = drivers[d];
      if (next < 1) { target[d] = initial.drivers[d] + next * (drivers[d] - initial.drivers[d]); }
    }
    const int status = @advance(s, target);
    attempt++;
    if (status == @SOLVED) {
      fraction = next;
    } else {
      step = step / 2;
      if (step < smallest || attempt >= @ATTEMPTS) {
        @restore(s, &initial);
        return status;
      }
      @restore(s, &last);
    }
  }
  @set_rates(s, rates, accelerations);
  return @SOLVED;
}
#if POINTS

/* Fills in positions, velocities and accelerations of the points, in the ground frame. */
static inline void @solve_points(const @state *s, @point *points) {
  (void)s; (void)points;
  POINT_MOTIONS
}
#endif

/* Fills in the motion of the links in the ground frame: of their origins, rotations row by row. */
static inline void @solve_links(const @state *s, @link *links) {
  (void)s; (void)links;
  LINK_MOTIONS
}
#if JOINTS

/* Fills in value, rate and acceleration of coordinates of joints that close loops; angles in (-pi, pi]. */
static inline void @solve_joints(const @state *s, @joint *joints) {
  (void)s; (void)joints;
  JOINT_MOTIONS
}
#endif
#if TORQUES

/* Fills in the torques or forces of the drivers that the links' inertia and weight require at the state's
   rates. inertias: for each link mass, centre of mass (3), and moments xx, yy, zz, xy, xz, yz about it in the
   link's frame; @INERTIAS are those of the model. */
static inline void @solve_torques(const @state *s, const real *inertias, const real *gravity, real *torques) {
  real forces[@COORDINATES];
  (void)inertias; (void)gravity;
  FORCES
  for (int d = 0; d < @DRIVERS; d++) {
    torques[d] = 0;
    for (int i = 0; i < @COORDINATES; i++) { torques[d] += s->map[i * @DRIVERS + d] * forces[i]; }
  }
}
#endif
