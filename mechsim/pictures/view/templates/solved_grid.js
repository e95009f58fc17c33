/* Grids of the page whose poses a solver in the page computes, and the vectors that solvers use. */

const AXES = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

const dot = (u, v) => u[0] * v[0] + u[1] * v[1] + u[2] * v[2];
const cross = (u, v) => [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
const minus = (u, v) => [u[0] - v[0], u[1] - v[1], u[2] - v[2]];
const times = (u, by) => [u[0] * by, u[1] * by, u[2] * by];

/* a vector rotated by the quaternion (scalar first) at an offset of the poses */
function rotated(poses, o, v) {
  if (o < 0) return v;
  const w = poses[o + 3], axis = [poses[o + 4], poses[o + 5], poses[o + 6]], twice = times(cross(axis, v), 2), more = cross(axis, twice);
  return [v[0] + w * twice[0] + more[0], v[1] + w * twice[1] + more[1], v[2] + w * twice[2] + more[2]];
}

/* A grid over a solver, with memory, curves along sliders and reachable ranges. The solver has: first, a
   solution; towards(from, values), the nearest solution, its `reached` false with a `reason` where it stops
   short; valuesOf(solution) and posesOf(solution); nodes(k), how many solutions a curve has each way. */
function solvedGrid(solver, grid) {
  const memory = new Map();
  let current = solver.first, request = null, scanOf = "", scan = [];

  function solved(values) {
    const key = values.join();
    if (memory.has(key)) return memory.get(key);
    if (key !== request) {
      request = key;
      current = solver.towards(current, values);
    }
    return current;
  }

  /* solutions along one slider in one direction; closer to each other near a limit, where poses vary with the root of the distance */
  function oneWay(from, values, k, end) {
    const count = solver.nodes(k), march = (last, share) => {
      const solutions = [];
      for (let i = 1, at = from; i <= count && at.reached !== false; i++) {
        const target = solver.valuesOf(at).slice();
        target[k] = values[k] + (last - values[k]) * share(i / count);
        solutions.push(at = solver.towards(at, target));
      }
      return solutions;
    };
    const even = march(end, (share) => share), last = even[even.length - 1];
    return last.reached === false ? [...march(solver.valuesOf(last)[k], (share) => Math.sin(share * Math.PI / 2)).filter((solution) => solution.reached !== false), last] : even;
  }

  /* solutions along one slider in both directions up to its limits, with the others at rest */
  function along(values, k) {
    const from = solved(values), [low, high] = grid.sliders[k].nodes;
    return [...oneWay(from, values, k, low).reverse(), from, ...oneWay(from, values, k, high)];
  }

  return Object.assign(grid, {
    solver,
    posesAt(values) {
      const solution = solved(values);
      return solution.reached === false ? null : solver.posesOf(solution);
    },
    /* poses of the last solution, which is shown if the request cannot be reached */
    nearestPoses: () => solver.posesOf(current),
    solutionAt: (values) => solved(values),
    read(readout, values) {
      const solution = solved(values);
      return solution.reached === false ? readout.parts.map(() => NaN) : readout.of(solution);
    },
    /* values of a slider along its reachable range; also measures that range */
    along(values, k) {
      const key = [k, ...values.filter((_, i) => i !== k)].join();
      if (key === scanOf) return scan;
      if (solved(values).reached === false) return scan;
      const solutions = along(values, k);
      scanOf = key;
      memory.clear();
      scan = solutions.map((solution) => {
        const at = values.slice();
        at[k] = solver.valuesOf(solution)[k];
        memory.set(at.join(), { ...solution, reached: true });
        return at[k];
      });
      grid.sliders[k].reach = [scan[0], scan[scan.length - 1]];
      return scan;
    },
    range(values, k) {
      const solutions = along(values, k);
      return [solutions[0], solutions[solutions.length - 1]].map((solution) => solver.valuesOf(solution)[k]);
    },
    problem: () => (current.reached === false ? current.reason : ""),
  });
}
