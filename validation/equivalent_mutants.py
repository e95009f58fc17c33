"""Mutants that no test can kill: (file, line before, line after) -> why; "..." stands for any line after."""

SHAPE = "any negative number stands for the length left over"
NEAR_ONE = "loops in units of their size have largest singular values near one"
SPEED = "changes what a run costs, not what it gives"
JACOBIAN = "simulation/loop_jacobian.py"
CUTS = "simulation/mjcf/loop_cuts.py"
POSED = "simulation/state.py"
MOTION = "analytic/loops/oracle.py"
PATH = "numerics/continuation.py"
SOLVER = "numerics/loop_solver.py"
TREE = "analytic/loops/kinematics.py"
MANY = "analytic/loops/design_motion.py"
WHOLE = "analytic/loops/motion.py"
RATES = "analytic/loops/path_rates.py"
CHECKS = "verdict/checks.py"
CROSSCHECK = "verdict/crosscheck.py"

EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        SOLVER,
        "NEGLIGIBLE = 1e-14",
        "NEGLIGIBLE = 1e-13",
    ): "rows of rounding, left out or not, move singular values by rounding",
    (
        SOLVER,
        "if len(self.others) + self.matrix.shape[1] == len(jacobian) and self._idle(jacobian):",
        "if len(self.others) + self.matrix.shape[2] == len(jacobian) and self._idle(jacobian):",
    ): "the matrices are square",
    ("simulation/recording.py", "CHUNK = 2048", "..."): SPEED,
    (CUTS, "if TYPE_CHECKING:", "if not TYPE_CHECKING:"): SPEED,
    (
        CUTS,
        "own = {branch.joint.name: branch.direction * along(branch.child)} "
        "if KINDS[branch.joint.kind].turns else {}",
        "own = {branch.joint.name: branch.direction / along(branch.child)} "
        "if KINDS[branch.joint.kind].turns else {}",
    ): "both are signs",
    (POSED, "if len(self._batches) > 8:", "..."): SPEED,
    (
        JACOBIAN,
        "values = np.linalg.svd(matrix, compute_uv=False).astype(np.float64, copy=False)",
        "values = np.linalg.svd(matrix, compute_uv=False).astype(np.float64, copy=True)",
    ): SPEED,
    (POSED, "threads = 1 if n <= ONE_THREAD else 0", "..."): SPEED,
    (POSED, "ONE_THREAD = 4096", "..."): SPEED,
    (
        "numerics/rank.py",
        "return values > np.maximum(tolerance * values[..., :1], floor)",
        "return values > np.maximum(tolerance / values[..., :1], floor)",
    ): NEAR_ONE,
    **{
        (
            "numerics/rank.py",
            "inverse = np.where(nonzero, 1.0 / np.where(nonzero, values, 1.0), 0.0)",
            f"inverse = np.where(nonzero, 1.0 / np.where(nonzero, values, {any_one}), 0.0)",
        ): "what is divided by it is not taken"
        for any_one in ("0.1", "10.0")
    },
    (
        PATH,
        "while direction * (first - self.end(direction)) < -SAME_PARAMETER and self.drop_last_segment(direction):",
        "while direction * (first - self.end(direction)) < +SAME_PARAMETER and self.drop_last_segment(direction):",
    ): SPEED,
    (
        PATH,
        "step = np.zeros((loops.count, 1))",
        "step = np.zeros((loops.count, 2))",
    ): "rows are chosen by the first pose alone",
    (
        PATH,
        "step = remaining if remaining <= length else min(length, 0.6 * remaining)",
        "step = remaining if remaining <= length else min(length, 6.0 * remaining)",
    ): SPEED,
    (
        PATH,
        "nearest_index = np.argsort(np.abs(closed.signed_distance))[1:2]",
        "nearest_index = np.argsort(np.abs(closed.signed_distance))[1:3]",
    ): "only the first of them counts",
    (
        PATH,
        "sign_changes = np.flatnonzero(signs[1:] != signs[:-1])",
        "sign_changes = np.flatnonzero(signs[1:] != signs[:+1])",
    ): "only the first flip counts: there the side is first another than at the first node",
    (
        PATH,
        "if self.sign[0] * middle_sign < 0.0 and segment.solver is segments[-1].solver:",
        "if self.sign[0] / middle_sign < 0.0 and segment.solver is segments[-1].solver:",
    ): "both are signs",
    (PATH, "NEXT_LENGTH = 0.3", "NEXT_LENGTH = 3.0"): SPEED,
    (PATH, "OVERSHOOT = 0.2137", "OVERSHOOT = 2.137"): SPEED,
    (
        SOLVER,
        "MIN_VALUE_RATIO, MIN_DETERMINANT_RATIO, MIN_SHARE_RATIO = (0.4, 0.5, 0.2)",
        "MIN_VALUE_RATIO, MIN_DETERMINANT_RATIO, MIN_SHARE_RATIO = (0.4, 5.0, 0.2)",
    ): "the rows that tell most are then always taken",
    (
        SOLVER,
        "nonzero = every > RANK_TOLERANCE * every.max()",
        "nonzero = every > RANK_TOLERANCE / every.max()",
    ): NEAR_ONE,
    **{
        (
            SOLVER,
            "return np.where(nonzero, linearised.singular_values[:, -1] / np.where(nonzero, every, 1.0), 1.0)",
            f"return np.where(nonzero, linearised.singular_values[:, -1] / np.where(nonzero, every, {any_one}), 1.0)",
        ): "what is divided by it is not taken"
        for any_one in ("0.1", "10.0")
    },
    (
        CHECKS,
        "fraction = np.divide(error, allowed, out=np.where(error > 0.0, np.inf, error), where=allowed > 0.0)",
        "fraction = np.divide(error, allowed, out=np.where(error > 1.0, np.inf, error), where=allowed > 0.0)",
    ): "where nothing is allowed at any instant, any of the errors may be the one that is reported",
    **{
        (
            "numerics/newton.py",
            "return float(brent(function, low, high, xtol=1e-300, rtol=1e-15, maxiter=1000))",
            f"return float(brent(function, low, high, xtol={tiny}, rtol=1e-15, maxiter={most}))",
        ): "any tiny number will do, the relative bound ends the search; so will any large number of steps"
        for tiny, most in (("1e-301", 1000), ("1e-299", 1000), ("1e-300", 10000))
    },
    (RATES, "CHUNK = 1024", "..."): SPEED,
    (
        RATES,
        "accelerations[i, :3] = spatial[i, :3] + cross(angular_acceleration, origin) + cross(angular_velocity, velocity[i, :3])",
        "accelerations[i, :3] = spatial[i, :3] + cross(angular_acceleration, origin) + cross(angular_velocity, velocity[i, :4])",
    ): "a fourth component has no part in a vector product",
    (
        RATES,
        "rotation_rate, rotation_second = (np.ascontiguousarray(rows[:, columns].T).reshape(3, 3, -1) for rows in (first, second))",
        "rotation_rate, rotation_second = (np.ascontiguousarray(rows[:, columns].T).reshape(3, 3, -2) for rows in (first, second))",
    ): SHAPE,
    (
        MANY,
        "sign = np.where(same_rows & (self.sign != 0.0), self.sign, signs[0])",
        "sign = np.where(same_rows & (self.sign != 0.0), self.sign, signs[1])",
    ): "a segment is good only where all signs are alike",
    (
        RATES,
        "distance = float(np.abs(offset / path.loops.units[driven, None]).max(initial=0.0))",
        "distance = float(np.abs(offset / path.loops.units[driven, None]).max(initial=1.0))",
    ): SPEED,
    (MANY, "MAX_KEPT = 4", "..."): SPEED,
    (
        "verdict/crosscheck.py",
        "pairs = np.unique(np.linspace(0, max(0, len(angle) - 2), MAX_PAIRS).astype(int))",
        "pairs = np.unique(np.linspace(0, max(1, len(angle) - 2), MAX_PAIRS).astype(int))",
    ): "of a single record the next is the same",
    **{
        (
            JACOBIAN,
            "return FLOOR * max(1.0, float(loops.characteristic_lengths.max()))",
            f"return FLOOR * max({least}, float(loops.characteristic_lengths.max()))",
        ): "rounding lies far below either"
        for least in ("0.1", "10.0")
    },
    (WHOLE, "MIN_SPIN = 1e-06", "..."): "links turn with an idle freedom by a part near one, or by rounding",
    (
        WHOLE,
        "names |= {name for name, i in tree.links.items() if angular[i] > MIN_SPIN * angular.max()}",
        "names |= {name for name, i in tree.links.items() if angular[i] > MIN_SPIN / angular.max()}",
    ): "idle freedoms are of unit length, their largest turn is near one",
    (
        WHOLE,
        "rates = np.zeros((tree.count, 1))",
        "rates = np.zeros((tree.count, 2))",
    ): "what does not move has no part in the largest",
    (WHOLE, "INTEGER_TOLERANCE = 1e-12", "..."): "ratios are whole numbers to rounding, or far from it",
    (
        TREE,
        "zero = np.zeros(twist.shape[1:])",
        "zero = np.zeros(twist.shape[2:])",
    ): "noughts are the same for all components",
    (
        TREE,
        "derivative[k, :3] = cross(w[3:], s[:3]) + cross(w[:3], s[3:])",
        "derivative[k, :3] = cross(w[3:], s[:3]) + cross(w[:4], s[3:])",
    ): "a fourth component has no part in a vector product",
}
