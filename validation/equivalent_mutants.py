"""Equivalent mutants, which no test can reject: (file, line, changed line) -> reason; "..." is any change."""

SHAPE = "reshape takes any negative number as the remaining length"
NEAR_ONE = "loops are scaled, so their largest singular values are near one"
SPEED = "changes the cost of a run, not its result"
JACOBIAN = "simulation/loop_jacobian.py"
CUTS = "simulation/mjcf/loop_cuts.py"
STATE = "simulation/state.py"
PATH = "numerics/continuation.py"
SOLVER = "numerics/loop_solver.py"
CONSTRAINTS = "analytic/loops/constraints.py"
TREE = "analytic/loops/kinematics.py"
DESIGN_MOTION = "analytic/loops/design_motion.py"
LOOP_MOTION = "analytic/loops/motion.py"
RATES = "analytic/loops/path.py"
CHECKS = "verdict/checks.py"

EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        SOLVER,
        "NEGLIGIBLE = 1e-14",
        "NEGLIGIBLE = 1e-13",
    ): "rows at rounding level change singular values by rounding only",
    (
        SOLVER,
        "if len(self.others) + self.matrix.shape[1] == len(jacobian) and self._idle(jacobian):",
        "if len(self.others) + self.matrix.shape[2] == len(jacobian) and self._idle(jacobian):",
    ): "the matrices are square",
    ("simulation/recording.py", "CHUNK = 2048", "..."): SPEED,
    (
        CUTS,
        "own = {branch.joint.name: branch.direction * along(branch.child)} "
        "if KINDS[branch.joint.kind].turns else {}",
        "own = {branch.joint.name: branch.direction / along(branch.child)} "
        "if KINDS[branch.joint.kind].turns else {}",
    ): "both factors are signs",
    (STATE, "if len(self._batches) > 8:", "..."): SPEED,
    (
        JACOBIAN,
        "values = np.linalg.svd(matrix, compute_uv=False).astype(np.float64, copy=False)",
        "values = np.linalg.svd(matrix, compute_uv=False).astype(np.float64, copy=True)",
    ): SPEED,
    (STATE, "threads = 1 if n <= ONE_THREAD else 0", "..."): SPEED,
    (STATE, "ONE_THREAD = 4096", "..."): SPEED,
    (
        "numerics/rank.py",
        "return values > np.maximum(tolerance * values[..., :1], floor)",
        "return values > np.maximum(tolerance / values[..., :1], floor)",
    ): NEAR_ONE,
    **{
        (
            "numerics/rank.py",
            "inverse = np.where(nonzero, 1.0 / np.where(nonzero, values, 1.0), 0.0)",
            f"inverse = np.where(nonzero, 1.0 / np.where(nonzero, values, {divisor}), 0.0)",
        ): "the mask excludes the quotient"
        for divisor in ("0.1", "10.0")
    },
    (
        PATH,
        "while direction * (first - self.end(direction)) < -ROUNDING and self.drop_last_segment(direction):",
        "while direction * (first - self.end(direction)) < +ROUNDING and self.drop_last_segment(direction):",
    ): SPEED,
    (
        PATH,
        "step = np.zeros((loops.count, 1))",
        "step = np.zeros((loops.count, 2))",
    ): "rows are selected at the first configuration only",
    (
        PATH,
        "step = remaining if remaining <= length else min(length, 0.6 * remaining)",
        "step = remaining if remaining <= length else min(length, 6.0 * remaining)",
    ): SPEED,
    (
        PATH,
        "nearest_index = np.argsort(np.abs(closed.signed_distance))[1:2]",
        "nearest_index = np.argsort(np.abs(closed.signed_distance))[1:3]",
    ): "only the first index is used",
    (
        PATH,
        "sign_changes = np.flatnonzero(signs[1:] != signs[:-1])",
        "sign_changes = np.flatnonzero(signs[1:] != signs[:+1])",
    ): "only the first sign change is used; there the sign first differs from that of the first node",
    (
        PATH,
        "if self.sign[0] * middle_sign < 0.0 and segment.solver is segments[-1].solver:",
        "if self.sign[0] / middle_sign < 0.0 and segment.solver is segments[-1].solver:",
    ): "both factors are signs",
    (PATH, "NEXT_LENGTH = 0.3", "NEXT_LENGTH = 3.0"): SPEED,
    (PATH, "OVERSHOOT = 0.2137", "OVERSHOOT = 2.137"): SPEED,
    (
        SOLVER,
        "MIN_VALUE_RATIO, MIN_DETERMINANT_RATIO, MIN_SHARE_RATIO = (0.4, 0.5, 0.2)",
        "MIN_VALUE_RATIO, MIN_DETERMINANT_RATIO, MIN_SHARE_RATIO = (0.4, 5.0, 0.2)",
    ): "the most significant rows are then always selected",
    (
        SOLVER,
        "nonzero = every > RANK_TOLERANCE * every.max()",
        "nonzero = every > RANK_TOLERANCE / every.max()",
    ): NEAR_ONE,
    **{
        (
            SOLVER,
            "return np.where(nonzero, linearised.singular_values[:, -1] / np.where(nonzero, every, 1.0), 1.0)",
            f"return np.where(nonzero, linearised.singular_values[:, -1] / np.where(nonzero, every, {divisor}), 1.0)",
        ): "the mask excludes the quotient"
        for divisor in ("0.1", "10.0")
    },
    (
        CHECKS,
        "fraction = np.divide(error, allowed, out=np.where(error > 0.0, np.inf, error), where=allowed > 0.0)",
        "fraction = np.divide(error, allowed, out=np.where(error > 1.0, np.inf, error), where=allowed > 0.0)",
    ): "where the tolerance is zero at every instant, any nonzero error may be the one reported",
    **{
        (
            "numerics/newton.py",
            "return float(brent(function, low, high, xtol=1e-300, rtol=1e-15, maxiter=1000))",
            f"return float(brent(function, low, high, xtol={absolute}, rtol=1e-15, maxiter={iterations}))",
        ): "the relative tolerance ends the search at any tiny absolute tolerance and any large number of steps"
        for absolute, iterations in (("1e-301", 1000), ("1e-299", 1000), ("1e-300", 10000))
    },
    (RATES, "CHUNK = 1024", "..."): SPEED,
    (
        RATES,
        "accelerations[i, :3] = spatial[i, :3] + cross(angular_acceleration, origin) + cross(angular_velocity, velocity[i, :3])",
        "accelerations[i, :3] = spatial[i, :3] + cross(angular_acceleration, origin) + cross(angular_velocity, velocity[i, :4])",
    ): "the vector product ignores a fourth component",
    (
        RATES,
        "rotation_rate, rotation_second = (np.ascontiguousarray(rows[:, columns].T).reshape(3, 3, -1) for rows in (first, second))",
        "rotation_rate, rotation_second = (np.ascontiguousarray(rows[:, columns].T).reshape(3, 3, -2) for rows in (first, second))",
    ): SHAPE,
    (
        DESIGN_MOTION,
        "sign = np.where(same_rows & (self.sign != 0.0), self.sign, signs[0])",
        "sign = np.where(same_rows & (self.sign != 0.0), self.sign, signs[1])",
    ): "a segment is valid only where all signs are equal",
    (
        RATES,
        "distance = float(np.abs(offset / path.loops.units[driven, None]).max(initial=0.0))",
        "distance = float(np.abs(offset / path.loops.units[driven, None]).max(initial=1.0))",
    ): SPEED,
    (DESIGN_MOTION, "MAX_KEPT = 4", "..."): SPEED,
    (
        "verdict/crosscheck.py",
        "pairs = np.unique(np.linspace(0, max(0, len(angle) - 2), MAX_PAIRS).astype(int))",
        "pairs = np.unique(np.linspace(0, max(1, len(angle) - 2), MAX_PAIRS).astype(int))",
    ): "a record of one instant has no next instant",
    **{
        (
            JACOBIAN,
            "return FLOOR * max(1.0, float(loops.characteristic_lengths.max()))",
            f"return FLOOR * max({least}, float(loops.characteristic_lengths.max()))",
        ): "rounding is far below both values"
        for least in ("0.1", "10.0")
    },
    (
        LOOP_MOTION,
        "MIN_SPIN = 1e-06",
        "...",
    ): "a passive degree of freedom rotates a link by a fraction near one, or by rounding",
    (
        LOOP_MOTION,
        "names |= {name for name, i in tree.links.items() if angular[i] > MIN_SPIN * angular.max()}",
        "names |= {name for name, i in tree.links.items() if angular[i] > MIN_SPIN / angular.max()}",
    ): "passive degrees of freedom have unit length, so their largest rotation is near one",
    (
        LOOP_MOTION,
        "rates = np.zeros((tree.count, 1))",
        "rates = np.zeros((tree.count, 2))",
    ): "a coordinate that does not move does not change the maximum",
    (
        LOOP_MOTION,
        "INTEGER_TOLERANCE = 1e-12",
        "...",
    ): "ratios are integers to rounding, or far from integers",
    (
        TREE,
        "zero = np.zeros(twist.shape[1:])",
        "zero = np.zeros(twist.shape[2:])",
    ): "the zeros are equal for all components",
    (
        TREE,
        "derivative[k, :3] = cross(w[3:], s[:3]) + cross(w[:3], s[3:])",
        "derivative[k, :3] = cross(w[3:], s[:3]) + cross(w[:4], s[3:])",
    ): "the vector product ignores a fourth component",
    (
        CONSTRAINTS,
        "rotations = np.ascontiguousarray(rows[:, k:].T).reshape(-1, 3, 3, len(rows))",
        "rotations = np.ascontiguousarray(rows[:, k:].T).reshape(-2, 3, 3, len(rows))",
    ): SHAPE,
    (
        CONSTRAINTS,
        "rotations[ball] = np.moveaxis(relative.reshape(-1, 3, 3), 0, -1)",
        "rotations[ball] = np.moveaxis(relative.reshape(-2, 3, 3), 0, -1)",
    ): SHAPE,
    (TREE, "return rotation.reshape(3, 3, -1)", "return rotation.reshape(3, 3, -2)"): SHAPE,
    (
        CONSTRAINTS,
        "safe = np.where(small, 1.0, angle)",
        "...",
    ): "where the angle is small, the quotient is replaced",
    (
        "analytic/loops/tree.py",
        "rotation_terms = ABOUT_Z * np.array([1.0, 1.0, branch.direction])[:, None, None]",
        "rotation_terms = ABOUT_Z / np.array([1.0, 1.0, branch.direction])[:, None, None]",
    ): "the factors are signs",
}
