/* A mechanism solved in this page by its generated solver: drivers and dimensions are sliders. */

const DIMENSION_STEP = 0.02;  // of a dimension between two solutions, relative to its slider's scale
const SMALLEST_WAY = 1e-5;    // of a request, below which the limit counts as reached
const CURVE_NODES = 60;       // solutions of a curve in each direction
const HOLD = 1e-3;            // relative damping of the drivers when a point is dragged
const DIFFERENCE = 1e-5;      // change of a dimension for a rate, relative to its slider's scale
const LEAST_LOAD = 0, MOST_LOAD = 3;  // ends of a load's slider relative to its value
const DRAG_STEPS = 6;         // Newton steps of a drag for each event of the pointer
const DRAG_STEP = 0.15;       // largest change of a driver in each, in [rad] or sizes
const DRAG_HALVINGS = 8;      // halvings of a step that does not decrease the distance

/* the frame of a side of a joint, as mechsim.mechanism.joints.End makes it: rows of the columns reference, axis x reference, axis */
function frameOf(axis, reference) {
  const length = Math.hypot(...axis), z = times(axis, 1 / length);
  const mark = reference || (Math.abs(axis[0]) < 0.9 * length ? AXES[0] : AXES[1]);
  const across = minus(mark, times(z, dot(z, mark))), x = times(across, 1 / Math.hypot(...across)), y = cross(z, x);
  return [x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]];
}

/* scalar-first quaternion of a rotation matrix, row by row */
function quaternionOf(r) {
  const trace = r[0] + r[4] + r[8], squares = [1 + trace, 1 + 2 * r[0] - trace, 1 + 2 * r[4] - trace, 1 + 2 * r[8] - trace];
  const k = squares.indexOf(Math.max(...squares)), twice = 2 * Math.sqrt(squares[k]), main = twice / 4;
  const [a, b, c] = [r[7] - r[5], r[2] - r[6], r[3] - r[1]].map((v) => v / twice), [d, e, f] = [r[1] + r[3], r[2] + r[6], r[5] + r[7]].map((v) => v / twice);
  return [[main, a, b, c], [a, main, d, e], [b, d, main, f], [c, e, f, main]][k];
}

/* pairs of points that connect all with the least total length (Prim), as in mechsim.mechanism.masses */
function joined(points) {
  const done = [0], pairs = [];
  while (done.length < points.length) {
    let best = null;
    for (const i of done) for (let j = 0; j < points.length; j++) if (!done.includes(j)) {
      const gap = Math.hypot(...minus(points[j], points[i]));
      if (!best || gap < best[2] - 1e-15 * best[2]) best = [i, j, gap];
    }
    pairs.push([points[best[0]], points[best[1]]]);
    done.push(best[1]);
  }
  return pairs;
}

/* mass, centre and moments xx, yy, zz, xy, xz, yz about it of round rods */
function inertiaOfRods(pairs, density, diameter) {
  const rods = pairs.map(([a, b]) => {
    const length = Math.hypot(...minus(b, a)), mass = density * Math.PI * diameter ** 2 / 4 * length, line = times(minus(b, a), 1 / length);
    const along = mass * diameter ** 2 / 8, across = mass * (length ** 2 / 12 + diameter ** 2 / 16);
    return { mass, centre: a.map((v, i) => (v + b[i]) / 2), moment: (i, j) => (i === j ? across : 0) + (along - across) * line[i] * line[j] };
  });
  const mass = rods.reduce((sum, rod) => sum + rod.mass, 0), centre = AXES.map((_, i) => rods.reduce((sum, rod) => sum + rod.mass * rod.centre[i], 0) / mass);
  const moment = (i, j) => rods.reduce((sum, rod) => {
    const arm = minus(rod.centre, centre);
    return sum + rod.moment(i, j) + rod.mass * ((i === j ? dot(arm, arm) : 0) - arm[i] * arm[j]);
  }, 0);
  return [mass, ...centre, moment(0, 0), moment(1, 1), moment(2, 2), moment(0, 1), moment(0, 2), moment(1, 2)];
}

/* the inertia of a link that spins about a line, without momentum about that line */
function withoutSpin([mass, x, y, z, xx, yy, zz, xy, xz, yz], axis) {
  const full = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], across = (i, j) => (i === j ? 1 : 0) - axis[i] * axis[j];
  let mean = 0;
  for (let i = 0; i < 3; i++) for (let j = 0; j < 3; j++) mean += across(i, j) * full[j][i] / 2;
  return [mass, x, y, z, mean * across(0, 0), mean * across(1, 1), mean * across(2, 2), mean * across(0, 1), mean * across(0, 2), mean * across(1, 2)];
}

class LiveMechanism {
  constructor(data, solver, geometry) {
    Object.assign(this, data);
    this.code = solver;
    this.fillGeometry = geometry;
    this.state = solver.state();
    this.count = data.drivers.length;
    this.rates = data.drivers.map((driver) => (data.drivers.length === 1 && driver.unit === "rad" ? data.speed : 0));
    this.none = data.drivers.map(() => 0);
    this.scales = data.dimensions.map((dimension) => (dimension.unit === "m" ? data.size : Math.max(1, Math.abs(dimension.value))));
    this.original = data.dimensions.map((dimension) => dimension.value);
    this.given = [...this.original, ...data.loads.map((load) => load.value)];
    this.inertias = solver.INERTIAS ? Float64Array.from(solver.INERTIAS) : null;
    this.records = { links: solver.links.map(() => solver.link()), points: solver.points.map(() => solver.point()), joints: (solver.joints || []).map(() => solver.joint()) };
    this.setDimensions(this.original);
    this.first_placed = this.placed();
    solver.start(this.state);
    const start = Array.from(this.state.drivers);
    solver.solve(this.state, start, this.rates, this.none);
    this.first = this.solution([...start, ...this.given]);
    const shown = [...data.drivers.map((driver) => driver.start), ...this.given];
    const moved = this.towards(this.first, shown);
    if (moved.reached) this.first = moved;
  }

  /* the values of dimensions among those of all sliders */
  sized(values) { return Array.from(values.slice(this.count, this.count + this.dimensions.length)); }

  /* point and frame of a side of a joint, in its link */
  point(end) { return end.pointIndex < 0 ? end.point : Array.from(this.code.GEOMETRY.slice(end.pointIndex, end.pointIndex + 3)); }
  axis(end) { return end.frameIndex < 0 ? [2, 5, 8].map((k) => end.frame[k]) : [2, 5, 8].map((k) => this.code.GEOMETRY[end.frameIndex + k]); }

  setDimensions(values) {
    if (this.dimensionValues && values.every((value, i) => value === this.dimensionValues[i])) return;
    this.dimensionValues = values.slice();
    if (!this.code.GEOMETRY) return;
    const d = {}, g = this.code.GEOMETRY;
    this.dimensions.forEach((dimension, i) => { d[dimension.name] = values[i]; });
    this.fillGeometry(d, { set: (numbers, first) => numbers.forEach((value, k) => { g[first + k] = value; }) });
    this.shape = null;
    if (this.inertias) this.setInertias();
  }

  setInertias() {
    const diameter = this.masses.thickness * this.longest(), { density, pin } = this.masses;
    for (const rod of this.rods) {
      const name = this.links[rod.link], points = this.pointsOf(name, this.outlines[name]), ends = this.endsOf(name);
      let pairs = joined(points);
      if (points.length === 1) {
        const arm = times(ends.length ? this.axis(ends[0]) : [0, 0, 1], 0.5 * pin * diameter);
        pairs = [[minus(points[0], arm), points[0].map((v, i) => v + arm[i])]];
      }
      let numbers = inertiaOfRods(pairs, density, diameter);
      if (rod.spin) numbers = withoutSpin(numbers, rod.spin);
      this.inertias.set(numbers, 10 * this.code.links.indexOf(name));
    }
  }

  endsOf(link) { return this.joints.flatMap((joint) => [joint.a, joint.b]).filter((end) => end.link === link); }

  /* distinct points of a link: its joints' and its outline's */
  pointsOf(link, outline) {
    const kept = [];
    for (const at of [...this.endsOf(link).map((end) => this.point(end)), ...outline])
      if (kept.every((other) => Math.hypot(...minus(at, other)) > 1e-9 * this.size)) kept.push(at);
    return kept;
  }

  /* the mechanism's size: the largest distance between two joints of a link, or between other points of one */
  longest() {
    const widest = (more) => Math.max(...["ground", ...this.links].map((link) => {
      const points = [...this.endsOf(link).map((end) => this.point(end)), ...more(link)];
      return Math.max(0, ...points.flatMap((a) => points.map((b) => Math.hypot(...minus(a, b)))));
    }));
    const joints = widest(() => []), whole = widest((link) => this.morePoints(link));
    return joints > this.masses.one_place * whole ? joints : whole;
  }

  /* points of a link besides its joints: its outline and its tracked points */
  morePoints(link) { return [...(this.outlines[link] || []), ...this.points.filter((point) => point.link === link).map((point) => this.local(point))]; }

  local(point) { return point.index < 0 ? point.at : Array.from(this.code.GEOMETRY.slice(point.index, point.index + 3)); }

  /* positions of both sides of joints, and of points */
  placed() { return [...this.joints.flatMap((joint) => [this.point(joint.a), this.point(joint.b)]), ...this.points.map((point) => this.local(point))]; }

  /* changes of dimensions, joints and points in their links for a solution, for the picture */
  shapeAt(solution) {
    this.setDimensions(this.sized(solution.values));
    if (this.shape) return this.shape;
    this.shape = {
      changes: this.sized(solution.values).map((value, i) => (value - this.original[i]) / (this.dimensions[i].nodes[1] - this.dimensions[i].nodes[0])), shifts: this.placed().map((at, i) => minus(at, this.first_placed[i])),
      joints: Object.fromEntries(this.joints.map((joint) => [joint.name, this.point(joint.a)])),
      axes: Object.fromEntries(this.joints.map((joint) => [joint.name, this.axis(joint.a)])),
      points: Object.fromEntries(this.points.map((point) => [point.name, this.local(point)])),
    };
    return this.shape;
  }

  /* all records of the state's configuration that the page shows */
  solution(values) {
    const { code, state, records } = this, configuration = code.configuration(), poses = new Float64Array(7 * this.links.length);
    code.save(state, configuration);
    code.solve_links(state, records.links);
    this.links.forEach((name, l) => {
      const link = records.links[code.links.indexOf(name)];
      poses.set(link.position, 7 * l);
      poses.set(quaternionOf(link.rotation), 7 * l + 3);
    });
    if (code.solve_points) code.solve_points(state, records.points);
    if (code.solve_joints) code.solve_joints(state, records.joints);
    const torques = new Float64Array(this.count);
    if (code.solve_torques) {
      const acting = this.loads.map((load, i) => ({ ...load, value: values[this.count + this.dimensions.length + i] }));
      for (const load of acting) if (load.kind === "mass") this.inertias[10 * code.links.indexOf(load.link)] = load.value;
      code.solve_torques(state, this.inertias, code.GRAVITY, torques);
    }
    const solved = {
      values: values.slice(), configuration, poses, torques, reached: true, reason: "", coordinates: Float64Array.from(state.coordinates),
      points: Object.fromEntries(code.points.map((name, i) => [name, { position: Array.from(records.points[i].position), velocity: Array.from(records.points[i].velocity) }])),
      joints: records.joints.map((joint) => joint.motion[0]), transmission: this.transmission.map((found) => this.transmissionAngle(found, poses)),
    };
    this.holdLoads(solved.values, torques);
    return solved;
  }

  /* takes the power of the loads at a unit rate of each driver from its torque (virtual work) */
  holdLoads(values, torques) {
    const n = this.count, given = this.loads.map((load, i) => ({ ...load, value: values[n + this.dimensions.length + i] }));
    const acting = [...this.constant, ...given].filter((load) => load.kind !== "mass");
    if (acting.length) for (let k = 0; k < n; k++) {
      this.code.solve(this.state, Array.from(values.slice(0, n)), this.none.map((_, i) => (i === k ? 1 : 0)), this.none);
      this.code.solve_links(this.state, this.records.links);
      for (const load of acting) torques[k] -= this.power(load, this.rates[k]);
    }
  }

  /* position and velocity of a point of a link, in the records of the links */
  carried({ link, at }) {
    const record = this.records.links[this.code.links.indexOf(link)];
    if (!record) return [at, [0, 0, 0]];
    const r = AXES.map((_, i) => dot(record.rotation.slice(3 * i, 3 * i + 3), at)), turned = cross(record.angular_velocity, r);
    return [record.position, record.velocity].map((from, k) => r.map((value, i) => from[i] + (k ? turned[i] : value)));
  }

  /* power of a load at a unit rate of a driver; a damper has the rate of the motion */
  power(load, rate) {
    if (load.kind === "crank") return load.value;
    if (load.kind === "couple") return load.value * this.records.links[this.code.links.indexOf(load.link)].angular_velocity[load.axis];
    if (load.kind === "force") return load.value * this.carried(load)[1][load.axis];
    const [a, b] = [this.carried(load.a), this.carried(load.b)], along = minus(b[0], a[0]), length = Math.hypot(...along);
    const lengthening = dot(along, minus(b[1], a[1])) / length;
    return -(load.value * (length - load.rest) + load.damping * rate * lengthening) * lengthening;
  }

  world(poses, end, at) {
    const l = this.links.indexOf(end.link), turned = l < 0 ? at : rotated(poses, 7 * l, at);
    return l < 0 ? at : turned.map((v, i) => v + poses[7 * l + i]);
  }

  transmissionAngle(found, poses) {
    const joint = (name) => this.joints.find((candidate) => candidate.name === name), guide = joint(found.guide);
    const from = joint(found.other), to = joint(found.pin), at = this.world(poses, to.a, this.point(to.a)), push = minus(at, this.world(poses, from.a, this.point(from.a)));
    const base = guide.a.link === "ground" ? guide.a : guide.b, axis = this.axis(base);
    const way = guide.unit === "m" ? axis : cross(axis, minus(at, this.point(base)));
    return Math.asin(Math.min(1, Math.abs(dot(push, way)) / (Math.hypot(...push) * Math.hypot(...way))));
  }

  restore(solution) {
    this.setDimensions(this.sized(solution.values));
    this.code.restore(this.state, solution.configuration);
  }

  /* the last solution on the straight path to values of drivers and dimensions, and why it ends there */
  towards(from, values) {
    const n = this.count, far = Math.max(0, ...this.scales.map((scale, i) => Math.abs(values[n + i] - from.values[n + i]) / scale));
    let best = { ...from, reached: true, reason: "" }, share = 0, size = Math.min(1, DIMENSION_STEP / far);
    this.restore(from);
    while (share < 1) {
      const next = Math.min(1, share + size), at = values.map((value, i) => (next === 1 ? value : from.values[i] + next * (value - from.values[i])));
      this.setDimensions(this.sized(at));
      const status = this.code.solve(this.state, at.slice(0, n), this.rates, this.none);
      if (status === this.code.SOLVED) { best = this.solution(at); share = next; continue; }
      const reason = status === this.code.SINGULAR ? "a singular configuration lies in between" : "the loops do not close";
      this.restore(best);
      size /= 4;
      if (size < SMALLEST_WAY) return { ...best, reached: false, reason };
    }
    return best;
  }

  /* values whose drivers bring a point closest to a position in the plane of two directions (damped Gauss-Newton) */
  reaching(values, name, right, over, wanted, grid) {
    const n = this.count, sizes = this.drivers.map((driver) => (driver.unit === "rad" ? 1 : this.size)), index = this.code.points.indexOf(name);
    let current = grid.solutionAt(values);
    if (index < 0 || !current.points[name]) return values;
    const gap = (solution) => [wanted[0] - dot(right, solution.points[name].position), wanted[1] - dot(over, solution.points[name].position)];
    for (let step = 0; step < DRAG_STEPS; step++) {
      const off = gap(current), columns = this.drivers.map((_, k) => {
        this.restore(current);
        this.code.solve(this.state, Array.from(current.values.slice(0, n)), this.none.map((_, i) => (i === k ? sizes[k] : 0)), this.none);
        this.code.solve_points(this.state, this.records.points);
        const velocity = this.records.points[index].velocity;
        return [dot(right, velocity), dot(over, velocity)];
      });
      const change = dampedStep(columns, off), most = Math.max(...change.map(Math.abs));
      let next = null;
      for (let by = Math.min(1, DRAG_STEP / most), halving = 0; !next && halving < DRAG_HALVINGS; by /= 2, halving++) {
        const target = current.values.map((value, i) => {
          if (i >= n) return value;
          const { nodes, ring } = grid.sliders[i], moved = value + by * change[i] * sizes[i];
          return ring ? moved : Math.min(nodes[1], Math.max(nodes[0], moved));
        });
        const candidate = this.towards(current, target);
        if (Math.hypot(...gap(candidate)) < Math.hypot(...off)) next = candidate;
      }
      if (!next) break;
      current = next;
    }
    return current.values.map((value, i) => {
      const revolution = 2 * Math.PI;
      return i < n && grid.sliders[i].ring ? value - revolution * Math.round(value / revolution) : value;
    });
  }

  /* how the end of a joint on the frame moves with each dimension (central differences); empty if none moves it */
  frameRates(name, values) {
    const joint = this.joints.find((candidate) => candidate.name === name), end = [joint.a, joint.b].find((side) => side.link === "ground");
    if (!end || end.pointIndex < 0) return [];
    const dimensions = this.sized(values), at = (i, by) => {
      this.setDimensions(dimensions.map((value, k) => (k === i ? value + by * this.scales[i] : value)));
      return this.point(end);
    };
    return dimensions.map((_, i) => times(minus(at(i, DIFFERENCE), at(i, -DIFFERENCE)), 0.5 / DIFFERENCE));
  }

  /* values whose dimensions bring a joint's end on the frame closest to a position in the plane of two directions */
  placing(values, name, right, over, wanted) {
    const joint = this.joints.find((candidate) => candidate.name === name), end = [joint.a, joint.b].find((side) => side.link === "ground"), moved = values.slice();
    for (let step = 0; step < DRAG_STEPS; step++) {
      const columns = this.frameRates(name, moved).map((rate) => [dot(right, rate), dot(over, rate)]);
      this.setDimensions(this.sized(moved));
      const at = this.point(end), change = dampedStep(columns, [wanted[0] - dot(right, at), wanted[1] - dot(over, at)]);
      change.forEach((by, i) => { moved[this.count + i] += by * this.scales[i]; });
    }
    return moved;
  }

  /* the mechanism with its present dimensions as a TOML file */
  toml(values) {
    const solution = this.first.grid.solutionAt(values), shape = this.shapeAt(solution), joint = (name) => this.joints.find((candidate) => candidate.name === name);
    const list = (numbers) => `[${Array.from(numbers, decimal).join(", ")}]`, quoted = (name) => JSON.stringify(name), bare = (name) => (/^[\w-]+$/.test(name) ? name : quoted(name));
    return this.toml_pieces.map((piece) => {
      if (typeof piece === "string") return piece;
      if (piece.parts) return piece.parts.map((part) => (part.dimension ? decimal(this.dimensionValues[this.dimensions.findIndex((dimension) => dimension.name === part.dimension)] / part.scale)
        : part.load ? decimal(values[this.count + this.dimensions.length + this.loads.findIndex((load) => load.name === part.load)]) : part)).join("");
      if (piece.start) return `start = ${decimal(values[0])}`;
      if (piece.points) return `${bare(piece.points)} = { link = ${quoted(this.points.find((point) => point.name === piece.points).link)}, at = ${list(shape.points[piece.points])} }`;
      if (piece.guess) {
        const l = this.links.indexOf(piece.guess), rows = AXES.map((axis) => rotated(solution.poses, 7 * l, axis));
        return `${bare(piece.guess)} = { at = ${list(solution.poses.slice(7 * l, 7 * l + 3))}, rotation = [${[0, 1, 2].map((i) => list(rows.map((column) => column[i]))).join(", ")}] }`;
      }
      const end = joint(piece.joint)[piece.side], f = end.frameIndex < 0 ? end.frame : this.code.GEOMETRY.slice(end.frameIndex, end.frameIndex + 9);
      return `${piece.side} = { link = ${quoted(end.link)}, at = ${list(this.point(end))}, axis = ${list([f[2], f[5], f[8]])}, reference = ${list([f[0], f[3], f[6]])} }`;
    }).join("\n") + "\n";
  }
}

/* a number as text that TOML reads back exactly, with a fraction */
const decimal = (value) => (Number.isInteger(value) && Math.abs(value) < 1e15 ? `${value}.0` : `${value}`);

/* the least-norm step of a 2 x n system, damped relative to its size */
function dampedStep(columns, off) {
  let a = 0, b = 0, c = 0;
  for (const [u, v] of columns) { a += u * u; b += u * v; c += v * v; }
  const damping = HOLD * HOLD * (a + c) + 1e-300, det = (a + damping) * (c + damping) - b * b;
  const x = ((c + damping) * off[0] - b * off[1]) / det, y = ((a + damping) * off[1] - b * off[0]) / det;
  return columns.map(([u, v]) => u * x + v * y);
}

/* the mechanism in the form of a grid of the page */
function liveGrid(data) {
  const { toml, ...rest } = data, live = new LiveMechanism({ ...rest, toml_pieces: toml.pieces }, live_solver, live_geometry), n = data.drivers.length;
  const sliders = [
    ...data.drivers.map((driver, i) => ({ name: driver.name, unit: driver.unit, nodes: driver.nodes, ring: driver.ring, start: live.first.values[i], marks: [], reach: null })),
    ...data.dimensions.map((dimension) => ({ name: `dimension.${dimension.name}`, label: dimension.name, dimension: true, unit: dimension.unit === "1" ? "" : dimension.unit, nodes: dimension.nodes, ring: false, start: dimension.value, marks: [], reach: null })),
    ...data.loads.map((load) => ({ name: `load.${load.name}`, label: load.name, dimension: true, load: true, unit: load.unit, nodes: [LEAST_LOAD * load.value, MOST_LOAD * load.value].sort((a, b) => a - b), ring: false, start: load.value, marks: [] })),
  ];
  const single = (name, unit, of) => ({ name, unit, parts: [""], of: (solution) => [of(solution)] });
  const grid = solvedGrid({
    first: live.first, towards: (from, values) => live.towards(from, values), valuesOf: (solution) => solution.values, posesOf: (solution) => solution.poses,
    nodes: () => CURVE_NODES,
  }, {
    name: "live", note: "Solved in this page; dimensions vary, points and pivots can be dragged.", sliders, links: data.links, ghost: null, live,
    readouts: [
      ...data.points.filter((point) => live.code.points.includes(point.name)).flatMap((point) => [
        { name: point.name, unit: "m", parts: ["x", "y", "z"], of: (solution) => solution.points[point.name].position },
        ...(n === 1 ? [single(`speed of ${point.name}`, "m/s", (solution) => Math.hypot(...solution.points[point.name].velocity))] : []),
      ]),
      ...(live.code.joints || []).map((name, i) => single(name, jointUnit(data, name), (solution) => solution.joints[i])),
      ...live.code.coordinates.flatMap((name, i) => (data.drivers.some((driver) => driver.name === name) || jointUnit(data, name) === null ? [] : [single(name, jointUnit(data, name), (solution) => solution.coordinates[i])])),
      ...(live.inertias ? data.drivers.map((driver, i) => single(`${driver.unit === "rad" ? "torque" : "force"} of ${driver.name}`, driver.unit === "rad" ? "N m" : "N", (solution) => solution.torques[i])) : []),
      ...data.transmission.map((found, i) => single(i || data.transmission.length > 1 ? `transmission angle at ${found.link}` : "transmission angle", "rad", (solution) => solution.transmission[i])),
    ],
  });
  live.first.grid = grid;
  return grid;
}

/* unit of a coordinate of a joint; null for joints without a shown coordinate */
function jointUnit(data, name) {
  const joint = data.joints.find((candidate) => candidate.name === name);
  return joint ? joint.unit : null;
}
