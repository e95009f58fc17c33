"""Mutants that no test can kill: (file, line before, line after) -> why; "..." stands for any line after."""

SHAPE = "any negative number stands for the length left over"
SPEED = "changes what a run costs, not what it gives"
ANY_TINY = "any tiny number will do where nothing has a length"
LOOPS = "simulation/model_loops.py"
MOTION = "analytic/closure/motion.py"
SOLVER = "analytic/closure/loop_solver.py"

EQUIVALENT: dict[tuple[str, str, str], str] = {
    (
        LOOPS,
        "self.size = float(max([*reach, *steps, 1e-300]))",
        "...",
    ): ANY_TINY,
    (
        LOOPS,
        "return (data.xpos[None], data.xmat.reshape(1, -1, 3, 3), slope)",
        "return (data.xpos[None], data.xmat.reshape(1, -2, 3, 3), slope)",
    ): SHAPE,
    (LOOPS, "if len(self._batches) > 8:", "..."): SPEED,
    (LOOPS, "threads = 1 if n <= ONE_THREAD else 0", "..."): SPEED,
    (LOOPS, "ONE_THREAD = 4096", "..."): SPEED,
    (
        MOTION,
        "twist = least_norm(mechanism, rows.jacobian, asked).reshape(n, -1, 6)",
        "twist = least_norm(mechanism, rows.jacobian, asked).reshape(n, -2, 6)",
    ): SHAPE,
    (
        MOTION,
        "accelerations = least_norm(mechanism, rows.jacobian, asked - rows.bias).reshape(n, -1, 6)",
        "accelerations = least_norm(mechanism, rows.jacobian, asked - rows.bias).reshape(n, -2, 6)",
    ): SHAPE,
    (
        SOLVER,
        "MOST_STEPS, ROUNDING = (8, 1e-13)",
        "...",
    ): "a Newton step more or less from where it has converged",
    (SOLVER, "FAR = 0.3", "FAR = 0.03"): "a path is followed in shorter steps",
}
