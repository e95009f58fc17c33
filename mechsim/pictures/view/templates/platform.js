/* A platform moved by its pose: the loop-closure equations of all joints, solved by Newton's method in the page. */

const CLOSED = 1e-13;         // largest residual of a solution, lengths relative to the mechanism's size
const DAMPING = 1e-10;        // of the normal equations: passive rotations of rods do not change
const NEWTON_STEPS = 12;
const LARGEST_STEP = 0.05;    // of a pose coordinate between two solutions, in sizes or rad
const LARGEST_CHANGE = 0.6;   // of a link within one step: beyond it, the corrector has left the assembly
const SMALLEST_STEP = 1e-4;   // of the requested displacement, below which the limit counts as reached
const NODES_EACH_WAY = 30;    // nodes of the curves along one coordinate, in each direction
/* Cardan angles: about x, then about the turned y, then about the turned z */
function anglesOf(poses, o) {
  const [x, y, z] = AXES.map((axis) => rotated(poses, o, axis));
  return [Math.atan2(-z[1], z[2]), Math.asin(Math.min(1, Math.max(-1, z[0]))), Math.atan2(-y[0], x[0])];
}

const nearest = (angle, to) => angle + 2 * Math.PI * Math.round((to - angle) / (2 * Math.PI));

class Platform {
  constructor(data) {
    Object.assign(this, data);
    this.unknowns = 6 * data.links.length;
    const start = Float64Array.from(data.start.flat());
    // lengths relative to the size, so that all residuals have one scale
    for (let l = 0; l < data.links.length; l++) for (let k = 0; k < 3; k++) start[7 * l + k] /= data.size;
    for (const joint of data.joints) for (const end of [joint.a, joint.b]) end.point = times(end.point, 1 / data.size);
    this.point = times(data.point, 1 / data.size);
    this.isAngle = data.coordinates.map((name) => name.length === 2);
    this.first = this.solution(start, null);
    this.first.det = this.orientation(start);
  }

  end({ link, point, frame }, poses) {
    const o = link < 0 ? -1 : 7 * link, arm = rotated(poses, o, point);
    const at = link < 0 ? arm : [arm[0] + poses[o], arm[1] + poses[o + 1], arm[2] + poses[o + 2]];
    return { link, arm, at, frame: [0, 3, 6].map((k) => rotated(poses, o, frame.slice(k, k + 3))) };
  }

  /* rows of the joints: [residual, link, linear, angular, link, linear, angular] */
  jointRows(poses) {
    const rows = [];
    for (const joint of this.joints) {
      const a = this.end(joint.a, poses), b = this.end(joint.b, poses), gap = minus(b.at, a.at), fixed = joint.slides.length === 0;
      for (let k = 0; k < 3; k++) if (!joint.slides.includes(k)) {
        const u = fixed ? AXES[k] : a.frame[k], lever = cross(a.arm, u), turn = fixed ? [0, 0, 0] : cross(u, gap);
        rows.push([dot(u, gap), a.link, times(u, -1), minus(turn, lever), b.link, u, cross(b.arm, u)]);
      }
      const pairs = joint.turns === 2 ? [[2, 2, joint.cosine]] : joint.turns === 3 ? [] : [[0, 2, 0], [1, 2, 0], ...(joint.turns ? [] : [[0, 1, 0]])];
      for (const [i, j, cosine] of pairs) {
        const across = cross(a.frame[i], b.frame[j]);
        rows.push([dot(a.frame[i], b.frame[j]) - cosine, a.link, [0, 0, 0], across, b.link, [0, 0, 0], times(across, -1)]);
      }
    }
    return rows;
  }

  /* the platform's coordinates, and their rates as rows */
  poseRows(poses) {
    const o = 7 * this.link, arm = rotated(poses, o, this.point), [a, b] = anglesOf(poses, o), c = Math.cos(a), s = Math.sin(a);
    const values = [poses[o] + arm[0], poses[o + 1] + arm[1], poses[o + 2] + arm[2], ...anglesOf(poses, o)];
    const rates = [[1, s * Math.tan(b), -c * Math.tan(b)], [0, c, s], [0, -s / Math.cos(b), c / Math.cos(b)]];
    return this.coordinates.map((name) => {
      const k = ["x", "y", "z", "rx", "ry", "rz"].indexOf(name);
      return k < 3 ? [values[k], this.link, AXES[k], cross(arm, AXES[k]), -1] : [values[k], this.link, [0, 0, 0], rates[k - 3], -1];
    });
  }

  /* the drivers' coordinates in [m] and [rad], and their rates as rows with lengths relative to the size */
  driverRows(poses) {
    return this.drivers.map((driver) => {
      const joint = this.joints[driver.joint], a = this.end(joint.a, poses), b = this.end(joint.b, poses), axis = a.frame[2], none = [0, 0, 0];
      if (driver.unit === "m") {
        const gap = minus(b.at, a.at), lever = cross(a.arm, axis);
        return [dot(axis, gap) * this.size, a.link, times(axis, -1), minus(cross(axis, gap), lever), b.link, axis, cross(b.arm, axis)];
      }
      return [Math.atan2(dot(a.frame[1], b.frame[0]), dot(a.frame[0], b.frame[0])), a.link, none, times(axis, -1), b.link, none, axis];
    });
  }

  entries(row) {
    const entries = [];
    for (const [link, linear, angular] of [[row[1], row[2], row[3]], [row[4], row[5], row[6]]])
      if (link >= 0) for (let k = 0; k < 3; k++) entries.push([6 * link + k, linear[k]], [6 * link + 3 + k, angular[k]]);
    return entries;
  }

  /* Cholesky factor of the damped normal equations of some rows */
  factor(rows) {
    const n = this.unknowns, matrix = Array.from({ length: n }, () => new Float64Array(n));
    for (let k = 0; k < n; k++) matrix[k][k] = DAMPING;
    for (const row of rows) {
      const entries = this.entries(row);
      for (const [i, u] of entries) for (const [j, v] of entries) if (j <= i) matrix[i][j] += u * v;
    }
    for (let i = 0; i < n; i++)
      for (let j = 0; j <= i; j++) {
        let sum = matrix[i][j];
        for (let k = 0; k < j; k++) sum -= matrix[i][k] * matrix[j][k];
        matrix[i][j] = i === j ? Math.sqrt(Math.max(sum, DAMPING * DAMPING)) : sum / matrix[j][j];
      }
    return matrix;
  }

  /* least-norm change of the unknowns for given right sides of the rows */
  change(factor, rows, right) {
    const n = this.unknowns, x = new Float64Array(n);
    rows.forEach((row, r) => { for (const [i, u] of this.entries(row)) x[i] += u * right[r]; });
    for (let i = 0; i < n; i++) { for (let k = 0; k < i; k++) x[i] -= factor[i][k] * x[k]; x[i] /= factor[i][i]; }
    for (let i = n - 1; i >= 0; i--) { for (let k = i + 1; k < n; k++) x[i] -= factor[k][i] * x[k]; x[i] /= factor[i][i]; }
    return x;
  }

  moved(poses, change) {
    const out = Float64Array.from(poses);
    for (let l = 0; l < this.links.length; l++) {
      const o = 7 * l, turn = change.subarray(6 * l + 3, 6 * l + 6), angle = Math.hypot(...turn), by = angle > 1e-8 ? Math.sin(angle / 2) / angle : 0.5;
      for (let k = 0; k < 3; k++) out[o + k] += change[6 * l + k];
      const [w, x, y, z] = poses.subarray(o + 3, o + 7), [p, q, r, s] = [Math.cos(angle / 2), by * turn[0], by * turn[1], by * turn[2]];
      const made = [p * w - q * x - r * y - s * z, p * x + q * w + r * z - s * y, p * y - q * z + r * w + s * x, p * z + q * y - r * x + s * w];
      const norm = Math.hypot(...made);
      for (let k = 0; k < 4; k++) out[o + 3 + k] = made[k] / norm;
    }
    return out;
  }

  /* poses of all links at values of the pose coordinates, from nearby poses; null if Newton's method fails */
  corrected(poses, values) {
    let current = poses, moved = 0;
    for (let step = 0; step < NEWTON_STEPS; step++) {
      const joints = this.jointRows(current), pose = this.poseRows(current), rows = [...joints, ...pose];
      const right = [...joints.map((row) => -row[0]), ...pose.map((row, i) => values[i] - (this.isAngle[i] ? nearest(row[0], values[i]) : row[0]))];
      if (Math.max(...right.map(Math.abs)) < CLOSED) return current;
      const change = this.change(this.factor(rows), rows, right);
      moved += Math.max(...change.map(Math.abs));
      if (!(moved < LARGEST_CHANGE)) return null;
      current = this.moved(current, change);
    }
    return null;
  }

  /* determinant of the drivers' rates by those of the pose coordinates: its sign changes at a singular pose */
  orientation(poses) {
    const pose = this.poseRows(poses), rows = [...this.jointRows(poses), ...pose], factor = this.factor(rows), first = rows.length - pose.length;
    const drivers = this.driverRows(poses).map((row) => this.entries(row));
    const matrix = pose.map((_, i) => {
      const right = new Float64Array(rows.length);
      right[first + i] = 1;
      const change = this.change(factor, rows, right);
      return drivers.map((entries) => entries.reduce((sum, [k, u]) => sum + u * change[k], 0));
    });
    return determinant(matrix);
  }

  solution(poses, before) {
    const values = this.poseRows(poses).map((row, i) => (this.isAngle[i] && before ? nearest(row[0], before.values[i]) : row[0]));
    const drivers = this.driverRows(poses).map((row, i) => (this.drivers[i].unit === "rad" && before ? nearest(row[0], before.drivers[i]) : row[0]));
    return { poses, values, drivers };
  }

  /* reason why a solution is invalid; "" if it is valid */
  problem(solution) {
    for (let i = 0; i < this.drivers.length; i++) {
      const { name, limits, unit } = this.drivers[i];
      if (limits && solution.drivers[i] < limits[0] - 1e-9) return `${name} reaches its lower limit, ${text(limits[0], unit)}`;
      if (limits && solution.drivers[i] > limits[1] + 1e-9) return `${name} reaches its upper limit, ${text(limits[1], unit)}`;
    }
    solution.det = this.orientation(solution.poses);
    return solution.det * this.first.det > 0 ? "" : "a singular pose lies in between, in which the drivers do not determine the platform";
  }

  /* the last solution on the straight path to given values, and why it ends there */
  towards(from, values) {
    let best = from, share = 0, reason = "";
    const far = Math.max(...values.map((value, i) => Math.abs(value - from.values[i])), 0);
    let size = Math.min(1, LARGEST_STEP / far);
    while (share < 1) {
      const next = Math.min(1, share + size), at = values.map((value, i) => (next === 1 ? value : from.values[i] + next * (value - from.values[i])));
      const poses = this.corrected(best.poses, at), solution = poses && this.solution(poses, best);
      reason = solution ? this.problem(solution) : "the loops do not close";
      if (!reason) { best = { ...solution, values: at }; share = next; continue; }
      size /= 4;
      if (size * Math.min(1, far) < SMALLEST_STEP) return { ...best, reached: false, reason };
    }
    return { ...best, reached: true, reason: "" };
  }

  /* values of the coordinates in units of the solver from those of the sliders, and back */
  inner(values) { return values.map((value, i) => (this.isAngle[i] ? value : value / this.size)); }
  outer(solution) {
    const poses = Float64Array.from(solution.poses);
    for (let l = 0; l < this.links.length; l++) for (let k = 0; k < 3; k++) poses[7 * l + k] *= this.size;
    return poses;
  }
}

function determinant(matrix) {
  const rows = matrix.map((row) => row.slice()), n = rows.length;
  let result = 1;
  for (let i = 0; i < n; i++) {
    let pivot = i;
    for (let k = i + 1; k < n; k++) if (Math.abs(rows[k][i]) > Math.abs(rows[pivot][i])) pivot = k;
    if (rows[pivot][i] === 0) return 0;
    if (pivot !== i) { [rows[i], rows[pivot]] = [rows[pivot], rows[i]]; result = -result; }
    result *= rows[i][i];
    for (let k = i + 1; k < n; k++) { const by = rows[k][i] / rows[i][i]; for (let j = i; j < n; j++) rows[k][j] -= by * rows[i][j]; }
  }
  return result;
}

/* A platform in the form of a grid of the page: sliders with reachable ranges, poses and read-outs. */
function platformGrid(data) {
  const platform = new Platform(data), first = platform.first;
  const outside = (values) => values.map((value, i) => (platform.isAngle[i] ? value : value * data.size));
  const sliders = data.coordinates.map((name, i) => {
    const centre = outside(first.values)[i], reach = platform.isAngle[i] ? Math.PI / 2 : data.size, edge = name === "ry" ? 85 * DEGREE : Infinity;
    const nodes = [Math.max(centre - reach, -edge), Math.min(centre + reach, edge)];
    return { name: `${platform.isAngle[i] ? data.links[data.link] : data.origin}.${name}`, unit: platform.isAngle[i] ? "rad" : "m", nodes, ring: false, start: centre, marks: [], reach: null };
  });
  return solvedGrid({
    first, towards: (from, values) => platform.towards(from, platform.inner(values)), valuesOf: (solution) => outside(solution.values),
    posesOf: (solution) => platform.outer(solution), nodes: () => NODES_EACH_WAY,
  }, {
    name: data.name, note: "Poses are solved in this page; drivers follow the platform.", sliders, links: data.links, ghost: null,
    readouts: [
      ...data.drivers.map((driver, i) => ({ name: driver.name, unit: driver.unit, parts: [""], of: (solution) => [solution.drivers[i]] })),
      ...DATA.points.filter((point) => data.links.includes(point.link)).map((point) => ({ name: point.name, unit: "m", parts: ["x", "y", "z"], of: (solution) => {
        const o = 7 * data.links.indexOf(point.link), arm = rotated(solution.poses, o, point.at);
        return arm.map((value, i) => value + data.size * solution.poses[o + i]);
      } })),
    ],
  });
}
