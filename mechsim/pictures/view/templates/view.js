/* Shows solved poses: cubic interpolation between nodes, a picture, read-outs and curves. */
const DATA = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const DEGREE = Math.PI / 180;
const GRAB = 16, TOUCHED = 28;  // distance in pixels within which a point is selected, by a mouse and by a finger
const MOST_OPEN = 6;          // dimensions that a page shows at once; more are collapsed
const CHANGE_PAUSE = 1000;    // in ms: a dimension that moves after it begins another change
const CLOSURE = 0xd81b9a;     // colour of a mark at a loop closure
const PALETTE = ["#d55e00", "#0072b2", "#009e73", "#e69f00", "#cc79a7", "#56b4e9"];

/* ---- records ---- */

function floats(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}

DATA.rest = floats(DATA.rest);
for (const readout of DATA.readouts) readout.values = floats(readout.values);
for (const grid of DATA.grids) {
  grid.links = DATA.links;
  grid.poses = floats(grid.poses);
  for (const readout of grid.readouts) readout.values = floats(readout.values);
  if (grid.ghost) grid.ghost.values = floats(grid.ghost.values);
  // what is at rest in a grid is stored once
  if (grid.moving.length < grid.links.length) {
    const own = new Map(grid.readouts.map((readout) => [readout.name, readout]));
    grid.readouts = DATA.readouts.map((readout) => own.get(readout.name) || readout);
  }
}
if (DATA.live) DATA.grids.unshift(liveGrid(DATA.live));

/* ---- between nodes ---- */

function bracket(nodes, value) {
  let low = 0, high = nodes.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (nodes[middle] <= value) low = middle; else high = middle;
  }
  return low;
}

function stencil(slider, value) {
  const nodes = slider.nodes, n = nodes.length, low = bracket(nodes, value), count = Math.min(4, n);
  const at = [], where = [];
  if (slider.ring) {
    const period = nodes[n - 1] - nodes[0];
    for (let i = low - 1; i < low - 1 + count; i++) {
      const revolution = Math.floor(i / (n - 1)), index = i - revolution * (n - 1);
      at.push(index);
      where.push(nodes[index] + period * revolution);
    }
  } else {
    const first = Math.min(Math.max(low - 1, 0), n - count);
    for (let i = first; i < first + count; i++) { at.push(i); where.push(nodes[i]); }
  }
  const weights = where.map((a, j) => where.reduce((w, b, k) => (k === j ? w : w * (value - b) / (a - b)), 1));
  return { index: at, weight: weights };
}

function posesAt(grid, values) {
  if (grid.solver) return grid.posesAt(values);
  return posesFrom(grid, stencil(grid.sliders[0], values[0]));
}

function posesFrom(grid, { index, weight }) {
  const width = 7 * grid.moving.length, all = grid.poses, out = Float64Array.from(DATA.rest);
  for (let l = 0; l < grid.moving.length; l++) {
    const o = 7 * grid.moving[l], first = index[0] * width + 7 * l;
    out.fill(0, o, o + 7);
    for (let j = 0; j < index.length; j++) {
      const from = index[j] * width + 7 * l;
      let same = 0;
      for (let k = 3; k < 7; k++) same += all[from + k] * all[first + k];
      const sign = same < 0 ? -weight[j] : weight[j];
      for (let k = 0; k < 3; k++) out[o + k] += weight[j] * all[from + k];
      for (let k = 3; k < 7; k++) out[o + k] += sign * all[from + k];
    }
    const norm = Math.hypot(out[o + 3], out[o + 4], out[o + 5], out[o + 6]);
    if (!(norm > 0.5) || !Number.isFinite(out[o])) return null;
    for (let k = 3; k < 7; k++) out[o + k] /= norm;
  }
  return out;
}

function readAt(grid, readout, values) {
  if (grid.solver) return grid.read(readout, values);
  const width = readout.parts.length, out = new Array(width).fill(0);
  if (readout.values.length === width) return Array.from(readout.values);
  const { index, weight } = stencil(grid.sliders[0], values[0]);
  for (let j = 0; j < index.length; j++)
    for (let k = 0; k < width; k++) out[k] += weight[j] * readout.values[index[j] * width + k];
  return out;
}

/* ---- settings ---- */

const state = { grid: DATA.grids[0], values: [], active: 0, driver: 0, playing: new Set(), direction: [], speed: 1, camera: 0,
  show: { names: true, axes: false, paths: true, ghost: false, joints: !DATA.own_bodies }, magnified: true, kept: false, poses: null, chosen: [] };

const shownUnit = (unit) => ({ rad: ["°", 1 / DEGREE], m: LENGTH, s: ["s", 1], "m/s": SPEED }[unit] || [unit, 1]);
let LENGTH = ["mm", 1e3], SPEED = ["m/s", 1];

function text(value, unit) {
  const [name, by] = shownUnit(unit), shown = value * by;
  if (!Number.isFinite(shown)) return "–";
  const size = Math.abs(shown), digits = unit === "rad" ? 2 : size >= 1000 ? 1 : size >= 100 ? 2 : size >= 1 ? 3 : 4;
  return `${(Math.abs(shown) < 0.5 * 10 ** -digits ? 0 : shown).toFixed(digits)}${name === "°" ? "" : " "}${name}`;
}

/* ---- picture ---- */

// colours reach the screen as the page states them
THREE.ColorManagement.enabled = false;
const stage = $("stage"), scene = new THREE.Scene(), bodies = {}, solids = {}, ghosts = {}, pointMarks = [], closureMarks = [], axisLines = [], pathLines = [], formerLines = [], springLines = [];
let renderer = null, camera = null, controls = null, lamp = null;
const steels = [];

function geometryOf(solid) {
  const [a, b, c] = solid.half;
  if (solid.kind === "box") return new THREE.BoxGeometry(2 * a, 2 * b, 2 * c);
  if (solid.kind === "sphere") return new THREE.SphereGeometry(a, 32, 20);
  if (solid.kind === "facets") {
    const facets = new THREE.BufferGeometry();
    facets.setAttribute("position", new THREE.BufferAttribute(floats(solid.vertices), 3));
    facets.setIndex(new THREE.BufferAttribute(new Uint32Array(floats(solid.faces).buffer), 1));
    return facets;
  }
  const made = new THREE.CylinderGeometry(a, a, 2 * b, 32);
  made.rotateX(Math.PI / 2);
  return made;
}

function solidsOf(solids, material) {
  const group = new THREE.Group();
  for (const solid of solids) {
    const made = material || new THREE.MeshStandardMaterial({ roughness: 0.6, metalness: 0.05, side: THREE.DoubleSide, flatShading: solid.kind === "facets" });
    if (!material) { made.userData.rgba = solid.rgba; steels.push(made); }
    const holder = new THREE.Group();
    holder.add(new THREE.Mesh(geometryOf(solid), made));
    if (solid.kind === "capsule")
      for (const end of [-1, 1]) {
        const cap = new THREE.Mesh(new THREE.SphereGeometry(solid.half[0], 24, 16), made);
        cap.position.z = end * solid.half[1];
        holder.add(cap);
      }
    holder.position.fromArray(solid.at);
    holder.quaternion.set(solid.turn[1], solid.turn[2], solid.turn[3], solid.turn[0]);
    group.add(holder);
  }
  return group;
}

function build() {
  try {
    renderer = new THREE.WebGLRenderer({ canvas: $("picture"), antialias: true });
    renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  } catch (error) {
    $("nowebgl").hidden = false;
  }
  const size = Math.max(DATA.cameras[0].width, DATA.cameras[0].height);
  if (size > 2) LENGTH = ["m", 1];
  camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.001, 10);
  // three.js divides light by pi when a surface reflects it
  lamp = new THREE.DirectionalLight(0xffffff, 0.62 * Math.PI);
  scene.add(new THREE.AmbientLight(0xffffff, 0.5 * Math.PI), lamp, lamp.target);
  const glass = new THREE.MeshBasicMaterial({ color: 0x3a6ea5, transparent: true, opacity: 0.42, depthWrite: false });
  for (const [link, shapes] of Object.entries(DATA.bodies)) {
    scene.add(bodies[link] = new THREE.Group());
    bodies[link].add(solids[link] = solidsOf(shapes, null));
    if (link in DATA.anchors) { scene.add(ghosts[link] = solidsOf(shapes, glass)); ghosts[link].visible = false; }
  }
  for (const joint of DATA.joints) if (joint.axis) {
    const along = new THREE.Vector3(...joint.axis).multiplyScalar(9 * DATA.radius);
    const made = new THREE.BufferGeometry().setFromPoints([along.clone().negate(), along]);
    const line = joint.line = new THREE.Line(made, new THREE.LineDashedMaterial({ color: 0xc02060, dashSize: 1.4 * DATA.radius, gapSize: 0.6 * DATA.radius, depthTest: false }));
    line.computeLineDistances();
    line.position.fromArray(joint.at);
    line.renderOrder = 4;
    bodies[joint.link].add(line);
    axisLines.push(line);
  }
  for (const joint of DATA.joints) joint.original = joint.at;
  for (const point of DATA.points) {
    point.original = point.at;
    const colour = new THREE.Color(...point.colour);
    const mark = new THREE.Mesh(new THREE.SphereGeometry(0.75 * DATA.radius, 20, 14), new THREE.MeshBasicMaterial({ color: colour, depthTest: false, transparent: true }));
    mark.position.fromArray(point.at);
    mark.renderOrder = 6;
    bodies[point.link].add(mark);
    pointMarks.push(mark);
    const line = new THREE.Line2(new THREE.LineGeometry(), new THREE.LineMaterial({ color: colour.getHex(), linewidth: 2, depthTest: false, transparent: true, opacity: 0.85 }));
    line.renderOrder = 5;
    const former = new THREE.Line2(line.geometry, line.material.clone());
    former.material.opacity = 0.25;
    line.frustumCulled = former.frustumCulled = former.visible = false;
    scene.add(line, former);
    pathLines.push(line);
    formerLines.push(former);
  }
  // loop closures of a file
  for (const closure of DATA.closures) {
    const mark = new THREE.Mesh(new THREE.SphereGeometry(0.6 * DATA.radius, 20, 14), new THREE.MeshBasicMaterial({ color: CLOSURE, depthTest: false, transparent: true }));
    mark.position.fromArray(closure.at);
    mark.renderOrder = 3;
    bodies[closure.link].add(mark);
    closureMarks.push(mark);
  }
  for (const { ends, damper } of DATA.springs) for (const shape of damper ? [rod, cylinder] : [coil]) {
    const line = new THREE.Line2(new THREE.LineGeometry(), new THREE.LineMaterial({ color: 0x707682, linewidth: 3 }));
    line.frustumCulled = false;
    scene.add(line);
    springLines.push({ line, ends, shape });
  }
  addFloor();
}

/* lines of springs and dampers: part of the way between the ends, and offsets in radii to both sides */
const coil = [[0, 0, 0], ...Array.from({ length: 129 }, (_, k) => [0.1 + 0.8 * k / 128, 2 * Math.sin(k * Math.PI / 8), 2 * Math.cos(k * Math.PI / 8)]), [1, 0, 0]];
const rod = [[0, 0, 0], [0.45, 0, 0], [0.45, 1.6, 0], [0.45, -1.6, 0]];
const cylinder = [[1, 0, 0], [0.7, 0, 0], [0.7, 2, 0], [0.3, 2, 0], [0.7, 2, 0], [0.7, -2, 0], [0.3, -2, 0]];
function drawSprings() {
  for (const { line, ends, shape } of springLines) {
    const [a, b] = ends.map((end) => corner(end.at, moved(end.follow), 0).applyMatrix4(bodies[end.link].matrixWorld));
    const along = b.clone().sub(a), side = new THREE.Vector3(0, 0, 1).cross(along);
    if (side.lengthSq() < 1e-12 * along.lengthSq()) side.set(1, 0, 0);
    side.setLength(DATA.radius);
    const other = along.clone().normalize().cross(side);
    line.geometry.setPositions(shape.flatMap(([share, right, over]) => a.clone().addScaledVector(along, share).addScaledVector(side, right).addScaledVector(other, over).toArray()));
  }
}

/* a floor, or a wall behind a planar mechanism, with a grid and the shadow of the links */
let floorLines = null, shade = null;
function addFloor() {
  const view = DATA.cameras[0], size = Math.max(view.width, view.height), extent = 3 * size + 4 * DATA.path;
  const normal = new THREE.Vector3(...DATA.floor.normal);
  const spacing = 10 ** Math.round(Math.log10(size / 8)), divisions = 2 * Math.round(extent / spacing / 2);
  const centre = new THREE.Vector3(...view.centre), at = centre.clone().addScaledVector(normal, DATA.floor.at - centre.dot(normal));
  shade = new THREE.ShadowMaterial({ opacity: 0.16 });
  const floor = new THREE.Mesh(new THREE.PlaneGeometry(extent, extent), shade);
  floor.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), normal);
  floor.receiveShadow = true;
  floorLines = new THREE.GridHelper(divisions * spacing, divisions);
  floorLines.material = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.55, depthWrite: false });
  floorLines.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), normal);
  for (const part of [floor, floorLines]) { part.position.copy(at); part.raycast = () => {}; scene.add(part); }
  // the sun only casts the shadow; the lamp lights the links
  const sun = new THREE.DirectionalLight(0xffffff, 0), box = sun.shadow.camera;
  const over = new THREE.Vector3(...view.up), right = new THREE.Vector3().crossVectors(over, new THREE.Vector3(...view.back));
  sun.position.copy(centre).addScaledVector(normal, 2 * size).addScaledVector(over, 0.5 * size).addScaledVector(right, -0.4 * size);
  sun.target.position.copy(centre);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  box.left = box.bottom = -1.2 * size; box.right = box.top = 1.2 * size; box.near = 0.01 * size; box.far = 6 * size;
  scene.add(sun, sun.target);
  for (const solid of Object.values(solids)) castShadow(solid);
  if (renderer) { renderer.shadowMap.enabled = true; renderer.shadowMap.type = THREE.PCFShadowMap; }
}

const castShadow = (group) => group.traverse((part) => { part.castShadow = !!part.isMesh; });

/* Moves joints, points and the corners of solids to their positions for given dimensions; null shows the links as they
   were drawn. */
let shapeShown = null;
function showDimensions(shape) {
  if (shape === shapeShown) return;
  shapeShown = shape;
  for (const [link, group] of Object.entries(solids)) group.children.forEach((holder, i) => { if (DATA.bodies[link][i].follow) reshape(holder, DATA.bodies[link][i]); });
  DATA.points.forEach((point, i) => {
    point.at = shape ? shape.points[point.name] : point.original;
    pointMarks[i].position.fromArray(point.at);
  });
  for (const joint of DATA.joints) {
    joint.at = shape && shape.joints[joint.name] ? shape.joints[joint.name] : joint.original;
    if (!joint.line) continue;
    joint.line.position.fromArray(joint.at);
    if (shape && shape.axes[joint.name]) joint.line.quaternion.setFromUnitVectors(new THREE.Vector3(...joint.axis), new THREE.Vector3(...shape.axes[joint.name]));
  }
  DATA.closures.forEach((closure, i) => closureMarks[i].position.fromArray(DATA.joints.find((joint) => joint.name === closure.joint).at));
  pathsOf = "";
}

/* displacements of the corners of what is drawn, three numbers each, and changes of its sizes after these */
function moved(follow) {
  const out = follow && shapeShown ? follow.at.flatMap((k) => shapeShown.shifts[k] || [0, 0, 0]) : [];
  if (out.length) for (const [k, first, second] of follow.rates) first.forEach((by, i) => { out[i] = (out[i] || 0) + shapeShown.changes[k] * (by + shapeShown.changes[k] * second[i]); });
  return out;
}

/* corner i of what is drawn */
const corner = (at, by, i) => new THREE.Vector3(...at).add(new THREE.Vector3(...(by.length ? by.slice(3 * i, 3 * i + 3) : [0, 0, 0])));

function reshape(holder, { kind, at, turn, half, vertices, follow }) {
  const by = moved(follow), [made, ...caps] = holder.children;
  if (kind === "facets") {
    const { geometry } = made;
    geometry.attributes.position.array.set(floats(vertices).map((value, i) => value + (by[i] || 0)));
    geometry.attributes.position.needsUpdate = true;
    geometry.computeBoundingSphere();
    return;
  }
  const long = kind === "sphere" ? 0 : half.at(-1), old = new THREE.Quaternion(turn[1], turn[2], turn[3], turn[0]), along = new THREE.Vector3(0, 0, 1).applyQuaternion(old);
  const [a, b] = [-1, 1].map((end, i) => corner(along.clone().multiplyScalar(end * long).add(new THREE.Vector3(...at)), by, i)), now = b.clone().sub(a), length = now.length() / 2;
  const [wide, thick] = [0, 1].map((i) => 1 + (by[6 + i] || 0) / half[i]);
  holder.position.copy(a).add(b).divideScalar(2);
  if (length > 0 && long) holder.quaternion.setFromUnitVectors(along, now.normalize()).multiply(old);
  made.scale.set(wide, kind === "box" ? thick : wide, long ? length / long : wide);
  caps.forEach((cap, i) => { cap.position.z = (2 * i - 1) * length; cap.scale.setScalar(wide); });
}

function framing(width, height) {
  const view = DATA.cameras[state.camera];
  return 0.82 * Math.min(width / view.width, height / view.height);  // pixels a metre
}

/* the camera follows a machine that falls or flies: its path from the first pose */
const followed = new THREE.Vector3();
function followPath() {
  if (!(DATA.path > 0)) return;
  const links = state.grid.links, middle = new THREE.Vector3();
  for (const link of links) middle.addScaledVector(bodies[link].position, 1 / links.length);
  const step = middle.sub(new THREE.Vector3(...DATA.middle)).sub(followed);
  followed.add(step);
  for (const at of [camera.position, controls.target]) at.add(step);
}

function lookFrom(which) {
  state.camera = which;
  const view = DATA.cameras[which], centre = new THREE.Vector3(...view.centre).add(followed), far = 2 * (view.width + view.height + view.depth + 4 * DATA.path);
  // orbits rotate about the vertical, so that the horizon stays level; for a vertical view, a small tilt defines the up direction
  const vertical = new THREE.Vector3(...DATA.vertical), back = new THREE.Vector3(...view.back), along = back.dot(vertical);
  if (Math.abs(along) > 0.9999) back.addScaledVector(new THREE.Vector3(...view.up), -1e-4 * Math.sign(along)).normalize();
  camera.up.copy(vertical);
  camera.position.copy(centre).addScaledVector(back, far / 2);
  camera.near = 0.001 * far;
  camera.far = far;
  camera.zoom = 1;
  if (controls) controls.dispose();
  controls = new THREE.OrbitControls(camera, stage);
  // one finger scrolls the page up and down, and rotates the mechanism sideways
  stage.style.touchAction = "pan-y";
  controls.target.copy(centre);
  controls.enableDamping = false;
  controls.addEventListener("change", () => { draw(); remember(); });
  controls.update();
  resize();
}

function resize() {
  const width = stage.clientWidth, height = stage.clientHeight, scale = framing(width, height);
  camera.left = -width / 2 / scale; camera.right = width / 2 / scale;
  camera.top = height / 2 / scale; camera.bottom = -height / 2 / scale;
  camera.updateProjectionMatrix();
  if (renderer) { renderer.setPixelRatio(window.devicePixelRatio || 1); renderer.setSize(width, height, false); }
  for (const line of [...pathLines, ...formerLines, ...springLines.map((spring) => spring.line)]) line.material.resolution.set(width, height);
  draw();
}

function dressed() {
  const style = getComputedStyle(document.documentElement), dark = document.documentElement.dataset.theme === "dark";
  scene.background = new THREE.Color(style.getPropertyValue("--sky").trim());
  floorLines.material.color.set(style.getPropertyValue("--line").trim());
  shade.opacity = dark ? 0.45 : 0.16;
  for (const made of steels) {
    const [r, g, b, a] = made.userData.rgba, up = dark && Math.max(r, g, b) < 0.45 ? 0.3 : 0;
    made.color.setRGB(r + up * (1 - r), g + up * (1 - g), b + up * (1 - b));
    made.transparent = a < 1; made.opacity = a;
  }
  draw();
}

function setPose(group, poses, o) {
  group.position.set(poses[o], poses[o + 1], poses[o + 2]);
  group.quaternion.set(poses[o + 4], poses[o + 5], poses[o + 6], poses[o + 3]);
}

function setGhost(grid, poses) {
  const ghost = state.show.ghost && grid.ghost;
  for (const group of Object.values(ghosts)) group.visible = !!ghost;
  if (!ghost) return;
  const value = state.values[0], low = Math.min(bracket(ghost.nodes, value), ghost.nodes.length - 2);
  const fraction = Math.min(1, Math.max(0, (value - ghost.nodes[low]) / (ghost.nodes[low + 1] - ghost.nodes[low])));
  const width = 6 * grid.links.length, by = state.magnified ? ghost.by : 1;
  grid.links.forEach((link, l) => {
    const d = [];
    for (let k = 0; k < 6; k++) d.push(by * ((1 - fraction) * ghost.values[low * width + 6 * l + k] + fraction * ghost.values[(low + 1) * width + 6 * l + k]));
    const group = ghosts[link], anchor = new THREE.Vector3(...DATA.anchors[link]);
    setPose(group, poses, 7 * l);
    const at = anchor.clone().applyQuaternion(group.quaternion).add(group.position).add(new THREE.Vector3(d[0], d[1], d[2]));
    const turn = new THREE.Vector3(d[3], d[4], d[5]), angle = turn.length();
    if (angle > 0) group.quaternion.premultiply(new THREE.Quaternion().setFromAxisAngle(turn.normalize(), angle));
    group.position.copy(at.sub(anchor.applyQuaternion(group.quaternion)));
  });
}

function draw() {
  if (!camera || !state.poses) return;
  const right = new THREE.Vector3(1, 0, 0).applyQuaternion(camera.quaternion), over = new THREE.Vector3(0, 1, 0).applyQuaternion(camera.quaternion);
  lamp.position.copy(camera.position).addScaledVector(over, 0.3 * camera.far).addScaledVector(right, -0.2 * camera.far);
  lamp.target.position.copy(controls.target);
  if (renderer) renderer.render(scene, camera);
  else drawFlat();
  write();
}

/* ---- names on the picture ---- */

const pen = document.createElement("canvas").getContext("2d"), widths = {}, sides = {};
function widthOf(label, size) {
  const key = size + label;
  if (!(key in widths)) { pen.font = `${size}px system-ui, sans-serif`; widths[key] = pen.measureText(label).width; }
  return widths[key];
}

function pixel(at) {
  const where = at.clone().project(camera);
  return [(where.x + 1) / 2 * stage.clientWidth, (1 - where.y) / 2 * stage.clientHeight];
}

function named() {
  const labels = [];
  DATA.points.forEach((point, i) => labels.push({ name: point.name, kind: "point", shown: state.show.names, at: pixel(pointMarks[i].getWorldPosition(new THREE.Vector3())) }));
  if (state.show.joints) for (const joint of DATA.joints) if (joint.label) {
    const at = new THREE.Vector3(...joint.at).applyMatrix4(bodies[joint.link].matrixWorld);
    labels.push({ name: joint.label, kind: "joint", shown: true, at: pixel(at) });
  }
  const groups = [];
  for (const label of labels) {
    const close = groups.find((group) => Math.hypot(group.at[0] - label.at[0], group.at[1] - label.at[1]) < 2.5);
    if (close) close.members.push(label); else groups.push({ at: label.at, members: [label] });
  }
  return groups;
}

const AROUND = [[1, -1], [-1, -1], [1, 1], [-1, 1], [1, 0], [-1, 0], [0, -1], [0, 1]];

function spot(at, width, size, side, reach) {
  const [x, y] = AROUND[side], left = at[0] + x * reach + (x < 0 ? -width : x === 0 ? -width / 2 : 0);
  const middle = at[1] + y * (reach + (x === 0 ? size / 2 : 2));
  return { left, right: left + width, top: middle - 0.6 * size, bottom: middle + 0.6 * size, middle };
}

const distance = (box, [x, y]) => Math.hypot(Math.max(box.left - x, 0, x - box.right), Math.max(box.top - y, 0, y - box.bottom));

const apart = (a, b) => a.right + 2 < b.left || b.right + 2 < a.left || a.bottom < b.top || b.bottom < a.top;

function write() {
  const layer = $("labels"), groups = named(), W = stage.clientWidth, H = stage.clientHeight, pieces = [];
  const scale = camera.zoom * W / (camera.right - camera.left), reach = 2.4 * DATA.radius * scale * 0.7 + 5;
  layer.setAttribute("viewBox", `0 0 ${W} ${H}`);
  stage.dataset.scale = scale;
  const bar = scaleBar(scale, W), occupied = [{ left: 0, right: bar.pixels + 100, top: H - 40, bottom: H }, { left: W - 76, right: W, top: H - 76, bottom: H }];
  const dots = groups.map((group) => ({ left: group.at[0] - 4, right: group.at[0] + 4, top: group.at[1] - 4, bottom: group.at[1] + 4 }));
  groups.forEach((group, g) => {
    const shown = group.members.filter((member) => member.shown), label = [...new Set(shown.map((member) => member.name))].join(", ");
    const size = shown.some((member) => member.kind === "point") ? 13 : 12;
    for (const { kind, name, at } of group.members) if (kind === "point") pieces.push(make("g", { "data-point": name, "data-x": at[0].toFixed(3), "data-y": at[1].toFixed(3) }));
    if (!label) return;
    const width = widthOf(label, size), order = [...AROUND.keys()];
    if (label in sides) order.unshift(sides[label]);
    let best = null, least = Infinity;
    for (let round = 0; round < 6 && least > 0; round++)
      for (const side of order) {
        const box = spot(group.at, width, size, side, reach * (1 + 0.7 * round));
        const off = box.left < 0 || box.right > W || box.top < 0 || box.bottom > H;
        const hits = occupied.filter((other) => !apart(box, other)).length * 3 + dots.filter((dot, k) => k !== g && !apart(box, dot)).length + (off ? 10 : 0)
          + (groups.some((other, k) => k !== g && distance(box, other.at) < distance(box, group.at)) ? 2 : 0);
        if (hits < least) { least = hits; best = { box, side, round }; }
        if (!hits) break;
      }
    if (least >= 3) return;  // no position without covering another name
    sides[label] = best.side;
    occupied.push(best.box);
    if (best.round > 0) pieces.push(make("line", { class: "leader", x1: group.at[0], y1: group.at[1], x2: (best.box.left + best.box.right) / 2, y2: best.box.middle }));
    const word = make("text", { x: best.box.left, y: best.box.middle + 0.35 * size, class: size === 13 ? "" : "joint" });
    word.textContent = label;
    pieces.push(word);
  });
  pieces.push(make("line", { class: "bar", x1: 14, x2: 14 + bar.pixels, y1: H - 16, y2: H - 16 }));
  const word = make("text", { x: 20 + bar.pixels, y: H - 12 });
  word.textContent = bar.label;
  pieces.push(word, ...triad(W - 40, H - 40));
  layer.replaceChildren(...pieces);
}

/* the directions of x, y and z */
function triad(x, y) {
  const right = new THREE.Vector3(1, 0, 0).applyQuaternion(camera.quaternion), over = new THREE.Vector3(0, 1, 0).applyQuaternion(camera.quaternion);
  return ["x", "y", "z"].flatMap((name, i) => {
    const axis = new THREE.Vector3().setComponent(i, 1), dx = 22 * axis.dot(right), dy = -22 * axis.dot(over);
    if (Math.hypot(dx, dy) < 3) return [];
    const letter = make("text", { x: x + 1.35 * dx, y: y + 1.35 * dy + 4, "text-anchor": "middle", class: "joint" });
    letter.textContent = name;
    return [make("line", { class: "axis", x1: x, y1: y, x2: x + dx, y2: y + dy, stroke: ["#d55e00", "#009e73", "#0072b2"][i] }), letter];
  });
}

function scaleBar(scale, width) {
  const most = Math.min(width, 900) / 5 / scale, power = 10 ** Math.floor(Math.log10(most));
  const length = [5, 2, 1].map((k) => k * power).find((candidate) => candidate <= most * (1 + 1e-9)) || power;
  const [unit, by] = length >= 1 ? ["m", 1] : length >= 1e-3 ? ["mm", 1e3] : ["µm", 1e6];
  return { pixels: length * scale, label: `${+(length * by).toPrecision(3)} ${unit}` };
}

function make(kind, attributes) {
  const made = document.createElementNS(SVG, kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

/* ---- moving ---- */

function update() {
  const grid = state.grid, poses = posesAt(grid, state.values);
  if (poses) state.poses = poses;
  else if (grid.solver) state.poses = grid.nearestPoses();
  trouble(poses ? "" : unreachable(grid));
  if (grid.live) showDimensions(grid.live.shapeAt(grid.solutionAt(state.values)));
  if (state.poses) {
    grid.links.forEach((link, l) => setPose(bodies[link], state.poses, 7 * l));
    followPath();
    setGhost(grid, state.poses);
    scene.updateMatrixWorld();
    drawSprings();
  }
  // curves of an unreachable request do not change
  if (poses || !grid.solver) paths();
  writeReadouts(!poses);
  draw();
  remember();
  if (grid.solver) showReach(grid, !!poses);
}

/* reachable ranges of the sliders: of the moved one at once, of the others at rest */
let reachDelay = 0;
function showReach(grid, reached) {
  clearTimeout(reachDelay);
  if (reached) sampled(grid, grid.sliders[state.active].load ? curveSlider() : state.active);
  grid.sliders.forEach((slider, i) => {
    if (slider.load) return;
    if (i !== state.active) slider.reach = null;
    reachRow(slider, i);
  });
  if (!reached || state.playing.size) return;
  const rest = grid.sliders.map((_, i) => i).filter((i) => i !== state.active && !grid.sliders[i].load);
  const measure = () => {
    const i = rest.shift();
    if (i === undefined || state.grid !== grid) return;
    grid.sliders[i].reach = grid.range(state.values, i);
    reachRow(grid.sliders[i], i);
    reachDelay = setTimeout(measure);
  };
  reachDelay = setTimeout(measure, 300);
}

function reachRow(slider, i) {
  const row = sliderRows[i], band = row.querySelector(".reach"), label = row.querySelector(".reachable");
  if (!slider.reach) { band.hidden = true; label.textContent = "reaches …"; return; }
  const [low, high] = slider.nodes, [from, to] = slider.reach.map((value) => (value - low) / (high - low));
  band.hidden = false;
  band.style.left = `calc(8px + ${from} * (100% - 16px))`;
  band.style.width = `calc(${to - from} * (100% - 16px))`;
  const [unit, by] = shownUnit(slider.unit);
  label.textContent = `reaches ${slider.reach.map((value) => +(value * by).toPrecision(5)).join(" to ")} ${unit}`;
}

function unreachable(grid) {
  if (!grid.solver) return "Not reachable: the loops do not close, or a dead centre is near; the last pose is shown.";
  return `Not reachable: ${grid.problem()}; the last pose on the way there is shown.`;
}

function trouble(label) { $("trouble").hidden = !label; $("trouble").textContent = label; }

/* the slider over which curves are drawn: of a changed dimension the driver that moved last */
const curveSlider = () => (state.grid.sliders[state.active].dimension ? state.driver : state.active);

/* the present curves become those of the former design */
function keepDesign() {
  former = drawn;
  formerLines.forEach((line, i) => { line.geometry = pathLines[i].geometry; });
  for (const box of state.chosen) box.former = box.shown;
}

const showsFormer = () => former.rest === drawn.rest && former.dimensions !== drawn.dimensions;

/* paths of the points over the driver that moved last, and faded those before the last change of dimensions */
let pathsOf = "", drawn = { rest: "", dimensions: "" }, former = drawn, changedAt = -Infinity;
function paths() {
  const grid = state.grid, k = curveSlider();
  const others = (dimension) => state.values.filter((_, i) => i !== k && !!grid.sliders[i].dimension === dimension).join();
  const now = { rest: [DATA.grids.indexOf(grid), k, others(false)].join(), dimensions: others(true) };
  const key = [now.rest, now.dimensions, state.show.paths].join();
  if (key === pathsOf) return;
  pathsOf = key;
  if (drawn.rest && now.dimensions !== drawn.dimensions) {
    if (!state.kept && performance.now() - changedAt > CHANGE_PAUSE) keepDesign();
    changedAt = performance.now();
  }
  drawn = now;
  const behind = state.show.paths && showsFormer();
  const along = sampled(grid, k), fine = along.map((value) => posesAt(grid, state.values.map((v, i) => (i === k ? value : v))));
  DATA.points.forEach((point, i) => {
    const l = grid.links.indexOf(point.link), positions = [], at = new THREE.Vector3(), turn = new THREE.Quaternion();
    if (l >= 0 && state.show.paths) for (const poses of fine) if (poses) {
      turn.set(poses[7 * l + 4], poses[7 * l + 5], poses[7 * l + 6], poses[7 * l + 3]);
      at.fromArray(point.at).applyQuaternion(turn);
      positions.push(at.x + poses[7 * l], at.y + poses[7 * l + 1], at.z + poses[7 * l + 2]);
    }
    formerLines[i].visible = behind;
    pathLines[i].visible = positions.length > 3;
    if (positions.length > 3) {
      pathLines[i].geometry.dispose();
      pathLines[i].geometry = new THREE.LineGeometry();
      pathLines[i].geometry.setPositions(positions);
    }
  });
}

function sampled(grid, k) {
  if (grid.solver) return grid.along(state.values, k);
  const nodes = grid.sliders[k].nodes;
  if (grid.sliders.length === 1 && nodes.length >= 120) return nodes;
  return Array.from({ length: 121 }, (_, i) => nodes[0] + (nodes[nodes.length - 1] - nodes[0]) * i / 120);
}

/* widens the range of a dimension to a value from the input field or the address */
function widen(i, value) {
  const slider = state.grid.sliders[i], by = shownUnit(slider.unit)[1], range = sliderRows[i].querySelector("input[type=range]");
  if (!Number.isFinite(value)) return;
  slider.nodes = [Math.min(slider.nodes[0], value), Math.max(slider.nodes[1], value)];
  [range.min, range.max] = slider.nodes.map((node) => node * by);
}

/* sets a slider without moving the mechanism */
function placeSlider(i, value) {
  const slider = state.grid.sliders[i];
  if (slider.dimension) widen(i, value);
  const low = slider.nodes[0], high = slider.nodes[slider.nodes.length - 1];
  if (slider.ring && (value < low || value > high)) value = low + (((value - low) % (high - low)) + (high - low)) % (high - low);
  state.values[i] = Math.min(high, Math.max(low, value));
  const row = sliderRows[i], by = shownUnit(slider.unit)[1];
  row.querySelector("input[type=range]").value = state.values[i] * by;
  row.querySelector("input[type=range]").setAttribute("aria-valuetext", text(state.values[i], slider.unit));
  const box = row.querySelector("input[type=number]");
  if (document.activeElement !== box) box.value = slider.unit === "rad" ? +(state.values[i] * by).toFixed(2) : +(state.values[i] * by).toPrecision(6);
}

function setSlider(i, value) {
  placeSlider(i, value);
  state.active = i;
  if (!state.grid.sliders[i].dimension) state.driver = i;
  update();
}

let last = 0;
function step(now) {
  const elapsed = Math.min(0.1, (now - last) / 1000) * state.speed;
  last = now;
  for (const i of state.playing) {
    const slider = state.grid.sliders[i], [low, high] = slider.reach || [slider.nodes[0], slider.nodes[slider.nodes.length - 1]];
    let value = state.values[i] + (state.direction[i] || 1) * elapsed * (high - low) / (slider.ring ? 6 : 4);
    if (!slider.ring && (value > high || value < low)) { state.direction[i] = value > high ? -1 : 1; value = Math.min(high, Math.max(low, value)); }
    setSlider(i, value);
  }
  if (state.playing.size) requestAnimationFrame(step);
}

function play(i, on) {
  if (on) state.playing.add(i); else state.playing.delete(i);
  const button = sliderRows[i].querySelector(".play");
  button.textContent = on ? "❚❚ pause" : "▶ play";
  button.setAttribute("aria-pressed", on);
  if (on && state.playing.size === 1) { last = performance.now(); requestAnimationFrame(step); }
}

/* ---- panel ---- */

function node(kind, attributes = {}, label = "") {
  const made = document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.textContent = label;
  return made;
}

let sliderRows = [];
function sliderRow(slider, i) {
  const row = node("div", { class: "slider" }), head = node("div", { class: "row" }), [unit, by] = shownUnit(slider.unit);
  const low = slider.nodes[0], high = slider.nodes[slider.nodes.length - 1];
  const title = node("div", { class: "title" });
  title.append(node("label", { for: `slider${i}` }, `${slider.label || slider.name}${unit && ` [${unit}]`}`));
  head.append(title);
  const box = node("input", { type: "number", step: "any", "aria-label": `${slider.name} in ${unit}` });
  box.addEventListener("change", () => { if (box.value !== "") setSlider(i, box.valueAsNumber / by); });
  const button = node("button", { class: "play", type: "button", "aria-pressed": false }, "▶ play");
  button.addEventListener("click", () => play(i, !state.playing.has(i)));
  head.append(box, button);
  const track = node("div", { class: "track" });
  const range = node("input", { type: "range", id: `slider${i}`, min: low * by, max: high * by, step: "any" });
  range.addEventListener("input", () => setSlider(i, range.valueAsNumber / by));
  range.addEventListener("keydown", (event) => {
    const unitStep = slider.unit === "rad" ? DEGREE : (high - low) / 200, sign = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!sign) return;
    event.preventDefault();
    setSlider(i, state.values[i] + sign * unitStep * (event.shiftKey ? 0.1 : 1));
  });
  track.append(range);
  const marks = node("div", { class: "marks" });
  for (const mark of slider.marks) {
    const label = `${mark.label}: ${text(mark.value, slider.unit)}`;
    const tick = node("span", { class: `tick ${mark.kind}`, title: label, style: `left: calc(8px + ${(mark.value - low) / (high - low)} * (100% - 16px))` });
    const go = node("button", { type: "button", class: mark.kind }, label);
    go.addEventListener("click", () => setSlider(i, mark.value));
    track.append(tick);
    marks.append(go);
  }
  row.append(head, track, marks);
  if ("reach" in slider) {
    track.append(node("span", { class: "reach", hidden: "" }));
    title.append(node("p", { class: "reachable soft" }));
  }
  return row;
}

function choose(which) {
  for (const i of [...state.playing]) play(i, false);
  const before = state.values.slice(), old = state.grid;
  state.grid = DATA.grids[which];
  state.poses = null;
  sliderRows = state.grid.sliders.map(sliderRow);
  const { sliders, live } = state.grid;
  $("sliders").replaceChildren(...sliderRows.filter((_, i) => !sliders[i].dimension));
  for (const [id, title, which] of [["dimensions", "Dimensions", (slider) => slider.dimension && !slider.load], ["loads", "Loads", (slider) => slider.load]]) {
    const rows = sliderRows.filter((_, i) => which(sliders[i]));
    if (!rows.length) continue;
    const box = node("details", { id, ...(rows.length <= MOST_OPEN ? { open: "" } : {}) });
    box.append(node("summary", {}, title), ...rows);
    $("sliders").append(box);
  }
  if (live && live.uncounted) $("sliders").append(node("p", { class: "soft" }, `Not in the torque: ${live.uncounted}.`));
  showDimensions(null);
  state.values = state.grid.sliders.map((slider, i) => (old.sliders[i] && old.sliders[i].name === slider.name && before.length ? before[i] : slider.start));
  state.values = state.grid.sliders.map((slider, i) => Math.min(slider.nodes[slider.nodes.length - 1], Math.max(slider.nodes[0], state.values[i])));
  state.active = 0;
  pathsOf = "";
  for (const button of $("choice").querySelectorAll("button")) button.setAttribute("aria-pressed", +button.dataset.grid === which);
  tools();
  curves();
  state.grid.sliders.forEach((_, i) => placeSlider(i, state.values[i]));
  state.active = state.driver = state.grid.live ? 0 : state.grid.sliders.length - 1;
  update();
}

function choices() {
  if (DATA.grids.length < 2) return;
  const row = node("div", { class: "row", role: "group", "aria-label": "Assemblies and motions" });
  DATA.grids.forEach((grid, i) => {
    const button = node("button", { type: "button", "data-grid": i, title: grid.note, "aria-pressed": i === 0 }, grid.name);
    button.addEventListener("click", () => choose(i));
    row.append(button);
  });
  $("choice").append(row);
  $("choice").hidden = false;
}

function flip(what) {
  state.show[what] = !state.show[what];
  shown();
}

function shown() {
  for (const line of axisLines) line.visible = state.show.axes;
  for (const mark of pointMarks) mark.visible = true;
  tools();
  update();
}

function tools() {
  const row = $("tools");
  const focused = document.activeElement && document.activeElement.dataset ? document.activeElement.dataset.tool : null;
  row.replaceChildren();
  const add = (tool, label, on, act) => {
    const button = node("button", { type: "button", "data-tool": tool }, label);
    if (on !== null) button.setAttribute("aria-pressed", on);
    button.addEventListener("click", act);
    row.append(button);
    if (focused === tool) button.focus();
  };
  add("names", "names", state.show.names, () => flip("names"));
  add("joints", "pivots", state.show.joints, () => flip("joints"));
  add("axes", "axes", state.show.axes, () => flip("axes"));
  add("paths", "paths", state.show.paths, () => flip("paths"));
  const ghost = state.grid.ghost;
  if (ghost) {
    add("ghost", `ghost: ${ghost.name}`, state.show.ghost, () => flip("ghost"));
    if (state.show.ghost && ghost.by !== 1) add("by", `difference × ${ghost.by.toExponential(0)}`, state.magnified, () => { state.magnified = !state.magnified; shown(); });
  }
  const pick = node("select", { "aria-label": "Look from" });
  DATA.cameras.forEach((view, i) => pick.append(node("option", { value: i }, view.name)));
  pick.value = state.camera;
  pick.addEventListener("change", () => lookFrom(+pick.value));
  row.append(pick);
  const speed = node("select", { "aria-label": "Playing speed" });
  for (const k of [0.1, 0.25, 0.5, 1, 2, 4]) speed.append(node("option", { value: k }, `speed × ${k}`));
  speed.value = state.speed;
  speed.addEventListener("change", () => { state.speed = +speed.value; });
  row.append(speed);
  add("theme", "light / dark", null, flipTheme);
  if (renderer) add("png", "save PNG", null, () => picture().toBlob((blob) => save(`${DATA.name}.png`, blob)));
  if (state.grid.live) add("kept", "keep design", state.kept, () => { state.kept = !state.kept; if (state.kept) keepDesign(); tools(); update(); });
  if (state.grid.live) add("toml", "save TOML", null, () => save(`${DATA.name}.toml`, new Blob([state.grid.live.toml(state.values)], { type: "application/toml" })));
  add("csv", "save CSV", null, () => save(`${DATA.name}.csv`, new Blob([table()], { type: "text/csv" })));
}

/* ---- read-outs and curves ---- */

const allReadouts = () => state.grid.readouts;

function writeReadouts(unsolved) {
  const rows = allReadouts().map((readout) => {
    const row = node("tr"), values = readAt(state.grid, readout, state.values);
    row.append(node("th", { scope: "row" }, readout.name));
    const cell = node("td", {}, unsolved ? "–" : "");
    if (!unsolved) cell.append(...values.map((value, i) => node("span", {}, (readout.parts[i] ? `${readout.parts[i]} ` : "") + text(value, readout.unit))));
    row.append(cell);
    return row;
  });
  if (state.show.ghost && state.grid.ghost) rows.push(ghostRow());
  $("readouts").tBodies[0].replaceChildren(...rows);
  if (!unsolved || !state.grid.solver) for (const box of state.chosen) box.point();
}

function ghostRow() {
  const { ghost, links } = state.grid, value = state.values[0], low = Math.min(bracket(ghost.nodes, value), ghost.nodes.length - 2), width = 6 * links.length;
  let worst = 0;
  for (let l = 0; l < links.length; l++) {
    const o = low * width + 6 * l;
    worst = Math.max(worst, Math.hypot(ghost.values[o], ghost.values[o + 1], ghost.values[o + 2]));
  }
  const row = node("tr");
  row.append(node("th", { scope: "row" }, `${ghost.name} differs by`), node("td", {}, `${worst.toExponential(2)} m`));
  return row;
}

function ticks(low, high, count, degrees) {
  const span = high - low || 1, rough = span / count, power = 10 ** Math.floor(Math.log10(rough));
  const steps = degrees ? [1, 2, 5, 10, 15, 30, 45, 60, 90, 180, 360] : [1, 2, 5, 10].map((k) => k * power);
  const size = (degrees && rough >= 1 ? steps.find((s) => s >= rough) : [1, 2, 5, 10].map((k) => k * power).find((s) => s >= rough)) || rough, out = [];
  for (let t = Math.ceil(low / size - 1e-9) * size; t <= high + 1e-9 * span; t += size) out.push(Math.abs(t) < 1e-9 * size ? 0 : +t.toPrecision(10));
  return out;
}

class CurveBox {
  constructor(which) {
    this.box = node("div", { class: "curve" });
    this.pick = node("select", { "aria-label": "Quantity of the curve" });
    allReadouts().forEach((readout, i) => this.pick.append(node("option", { value: i }, readout.name)));
    this.pick.value = which;
    this.pick.addEventListener("change", () => { this.key = ""; this.point(); });
    this.svg = make("svg", { role: "img" });
    this.legend = node("div", { class: "key" });
    this.box.append(this.pick, this.svg, this.legend);
    const drag = (event) => { if (event.buttons) this.go(event); };
    this.svg.addEventListener("pointerdown", (event) => { this.svg.setPointerCapture(event.pointerId); this.go(event); });
    this.svg.addEventListener("pointermove", drag);
  }
  get readout() { return allReadouts()[+this.pick.value]; }
  go(event) {
    const fraction = (event.clientX - this.svg.getBoundingClientRect().left - this.left) / this.width;
    const k = curveSlider(), along = sampled(state.grid, k), [low, high] = [along[0], along[along.length - 1]];
    setSlider(k, low + Math.min(1, Math.max(0, fraction)) * (high - low));
  }
  draw() {
    const grid = state.grid, k = curveSlider(), slider = grid.sliders[k], [name, by] = shownUnit(slider.unit), [unit, up] = shownUnit(this.readout.unit);
    const along = sampled(grid, k), W = this.svg.clientWidth || 320, H = this.svg.clientHeight || 160;
    const rows = along.map((value) => readAt(grid, this.readout, state.values.map((v, i) => (i === k ? value : v))).map((v) => v * up));
    const behind = showsFormer() && this.former && this.former.which === this.pick.value ? this.former : null;
    const all = [...rows, ...(behind ? behind.rows : [])].flat().filter(Number.isFinite);
    this.shown = { which: this.pick.value, along, rows };
    let low = Math.min(...all), high = Math.max(...all);
    const pad = Math.max(0.06 * (high - low), 1e-6 * Math.max(Math.abs(low), Math.abs(high)), 1e-9);
    low -= pad; high += pad;
    const yTicks = ticks(low, high, 4, this.readout.unit === "rad");
    this.left = 10 + Math.max(...yTicks.map((t) => widthOf(String(t), 11)), 10);
    this.width = W - this.left - 8;
    const top = 14, bottom = H - 26, a = along[0] * by, b = along[along.length - 1] * by;
    this.x = (value) => this.left + (value * by - a) / (b - a) * this.width;
    this.y = (value) => bottom - (value - low) / (high - low) * (bottom - top);
    const pieces = [], write = (x, y, label, anchor) => { const word = make("text", { x, y, "text-anchor": anchor }); word.textContent = label; pieces.push(word); };
    for (const t of yTicks) { pieces.push(make("line", { class: "grid", x1: this.left, x2: this.left + this.width, y1: this.y(t), y2: this.y(t) })); write(this.left - 5, this.y(t) + 4, t, "end"); }
    for (const t of ticks(a, b, 5, slider.unit === "rad")) { const x = this.x(t / by); pieces.push(make("line", { class: "grid", x1: x, x2: x, y1: top, y2: bottom })); write(x, bottom + 13, t, "middle"); }
    write(this.left - 5, 9, unit, "end");
    write(this.left + this.width, H - 1, `${slider.label || slider.name}${name && ` [${name}]`}`, "end");
    for (const mark of slider.marks) pieces.push(make("line", { class: `mark ${mark.kind}`, x1: this.x(mark.value), x2: this.x(mark.value), y1: top, y2: bottom }));
    for (const [curve, kind] of [[behind, "line former"], [this.shown, "line"]]) if (curve) this.readout.parts.forEach((_, p) => {
      let path = "";
      curve.rows.forEach((row, i) => { if (Number.isFinite(row[p])) path += `${path && Number.isFinite(curve.rows[i - 1][p]) ? "L" : "M"}${this.x(curve.along[i]).toFixed(1)} ${this.y(row[p]).toFixed(1)}`; });
      pieces.push(make("path", { class: kind, d: path, stroke: PALETTE[p % PALETTE.length] }));
    });
    this.cursor = make("line", { class: "cursor", y1: top, y2: bottom });
    this.dots = this.readout.parts.map((_, p) => make("circle", { r: 3.5, fill: PALETTE[p % PALETTE.length] }));
    this.svg.replaceChildren(...pieces, this.cursor, ...this.dots);
    this.svg.setAttribute("aria-label", `${this.readout.name} over ${slider.name}: from ${+Math.min(...all).toPrecision(4)} to ${+Math.max(...all).toPrecision(4)} ${unit}`);
  }
  point() {
    const k = curveSlider(), key = [DATA.grids.indexOf(state.grid), this.pick.value, k, this.svg.clientWidth, showsFormer(), ...state.values.filter((_, i) => i !== k)].join();
    if (key !== this.key) { this.key = key; this.draw(); }
    const up = shownUnit(this.readout.unit)[1], values = readAt(state.grid, this.readout, state.values), x = this.x(state.values[k]);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    const words = [];
    values.forEach((value, p) => {
      this.dots[p].setAttribute("cx", x);
      this.dots[p].setAttribute("cy", Number.isFinite(value) ? this.y(value * up) : -99);
      const word = node("span");
      word.append(Object.assign(node("i"), { style: `background: ${PALETTE[p % PALETTE.length]}` }), `${this.readout.parts[p]} ${text(value, this.readout.unit)}`);
      words.push(word);
    });
    this.legend.replaceChildren(...words);
  }
}

function curves() {
  const all = allReadouts(), usual = [];
  const positions = all.map((readout, i) => [readout, i]).filter(([readout]) => readout.parts.length === 3);
  if (positions.length) usual.push(positions[positions.length - 1][1]);
  const transmission = all.findIndex((readout) => readout.name === "transmission angle");
  usual.push(transmission >= 0 ? transmission : all.length - 1);
  const boxes = [...new Set(usual.filter((i) => i >= 0))].map((which) => new CurveBox(which));
  state.chosen = [];
  $("curves").replaceChildren(...boxes.map((curve) => curve.box));
  $("curves").hidden = !boxes.length;
  state.chosen = boxes;
}

/* ---- light and dark, keys, the address ---- */

function flipTheme() {
  document.documentElement.dataset.theme = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
  document.documentElement.dataset.chosen = "yes";
  dressed();
  remember();
}

function orbit(sideways, upwards) {
  const off = camera.position.clone().sub(controls.target), right = new THREE.Vector3().crossVectors(camera.up, off).normalize();
  off.applyAxisAngle(camera.up.clone().normalize(), sideways);
  const tilted = off.clone().applyAxisAngle(right, upwards);
  if (Math.abs(tilted.clone().normalize().dot(camera.up)) < 0.995) off.copy(tilted);
  camera.position.copy(controls.target).add(off);
  controls.update();
  draw();
}

function save(name, blob) {
  const link = node("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/* the picture with its names, as displayed */
function picture() {
  const own = $("picture"), ratio = own.width / stage.clientWidth, copy = Object.assign(document.createElement("canvas"), { width: own.width, height: own.height });
  const pen = copy.getContext("2d");
  if (renderer) renderer.render(scene, camera);
  pen.drawImage(own, 0, 0);
  pen.scale(ratio, ratio);
  for (const piece of $("labels").children) {
    const style = getComputedStyle(piece), number = (name) => +piece.getAttribute(name);
    if (piece.tagName === "line") {
      Object.assign(pen, { strokeStyle: style.stroke, lineWidth: parseFloat(style.strokeWidth) });
      pen.beginPath(); pen.moveTo(number("x1"), number("y1")); pen.lineTo(number("x2"), number("y2")); pen.stroke();
    } else if (piece.tagName === "text") {
      Object.assign(pen, { font: `${style.fontSize} ${style.fontFamily}`, textAlign: piece.getAttribute("text-anchor") === "middle" ? "center" : "left", lineJoin: "round", lineWidth: 3, strokeStyle: style.stroke, fillStyle: style.fill });
      pen.strokeText(piece.textContent, number("x"), number("y")); pen.fillText(piece.textContent, number("x"), number("y"));
    }
  }
  return copy;
}

/* all read-outs along the last moved slider */
function table() {
  const k = curveSlider(), slider = state.grid.sliders[k], [unit, by] = shownUnit(slider.unit);
  const head = [`${slider.name} [${unit}]`], along = sampled(state.grid, k), rows = along.map((value) => [value * by]);
  for (const readout of allReadouts()) {
    const [name, up] = shownUnit(readout.unit);
    for (const part of readout.parts) head.push(`${readout.name}${part && "."}${part}${name && ` [${name}]`}`);
    rows.forEach((row, r) => row.push(...readAt(state.grid, readout, state.values.map((v, i) => (i === k ? along[r] : v))).map((v) => v * up)));
  }
  const quoted = (word) => (/[",]/.test(word) ? `"${word.replace(/"/g, '""')}"` : word);
  return [head.map(quoted), ...rows.map((row) => row.map((value) => (Number.isFinite(value) ? +value.toPrecision(8) : "")))].map((row) => row.join(",")).join("\r\n") + "\r\n";
}

function zoom(by) {
  camera.zoom = Math.min(200, Math.max(0.05, camera.zoom * by));
  camera.updateProjectionMatrix();
  draw();
  remember();
}

/* points and pivots are dragged by hand: the drivers follow by inverse kinematics, or the dimensions that place the pivot */
let dragged = null;
const onStage = ({ clientX, clientY }) => { const box = stage.getBoundingClientRect(); return [clientX - box.left, clientY - box.top]; };

function grabbed(at, reach) {
  const live = state.grid.live;
  if (!live) return null;
  const pivots = DATA.joints.filter((joint) => joint.pivot && live.frameRates(joint.name, state.values).length);
  return [
    ...DATA.points.map((point, i) => ({ point: point.name, at: pixel(pointMarks[i].getWorldPosition(new THREE.Vector3())) })),
    ...pivots.map((joint) => ({ pivot: joint.name, at: pixel(new THREE.Vector3(...joint.at).applyMatrix4(bodies[joint.link].matrixWorld)) })),
  ].map((mark) => ({ ...mark, gap: Math.hypot(mark.at[0] - at[0], mark.at[1] - at[1]) })).filter((mark) => mark.gap < reach).sort((a, b) => a.gap - b.gap)[0] || null;
}

stage.addEventListener("pointerdown", (event) => {
  dragged = grabbed(onStage(event), event.pointerType === "mouse" ? GRAB : TOUCHED);
  if (!dragged) return;
  event.stopImmediatePropagation();
  event.preventDefault();
  stage.setPointerCapture(event.pointerId);
}, true);
// a finger on a point drags it and does not scroll the page
stage.addEventListener("touchstart", (event) => { if (grabbed(onStage(event.touches[0]), TOUCHED)) event.preventDefault(); }, { passive: false });
stage.addEventListener("pointermove", (event) => {
  if (!dragged) { if (!event.buttons) stage.style.cursor = grabbed(onStage(event), GRAB) ? "move" : ""; return; }
  event.stopImmediatePropagation();
  dragTo(dragged, onStage(event));
}, true);
for (const kind of ["pointerup", "pointercancel"]) stage.addEventListener(kind, () => { dragged = null; }, true);

/* Moves the drivers so that a point comes closest to a position on the screen, or the dimensions so that a pivot does. */
function dragTo({ point, pivot }, target) {
  const right = new THREE.Vector3(1, 0, 0).applyQuaternion(camera.quaternion).toArray(), over = new THREE.Vector3(0, 1, 0).applyQuaternion(camera.quaternion).toArray();
  const origin = pixel(new THREE.Vector3()), scale = +stage.dataset.scale, live = state.grid.live;
  const wanted = [(target[0] - origin[0]) / scale, (origin[1] - target[1]) / scale];
  const values = pivot ? live.placing(state.values, pivot, right, over, wanted) : live.reaching(state.values, point, right, over, wanted, state.grid);
  state.grid.sliders.forEach((slider, k) => { if (!!slider.dimension === !!pivot) placeSlider(k, values[k]); });
  if (pivot) state.active = Math.max(state.active, live.count);
  else if (state.grid.sliders[state.active].dimension) state.active = 0;
  update();
}

stage.addEventListener("keydown", (event) => {
  const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
  if (turns) orbit(6 * DEGREE * turns[0], 6 * DEGREE * turns[1]);
  else if (event.key === "+" || event.key === "=") zoom(1.2);
  else if (event.key === "-") zoom(1 / 1.2);
  else if (event.key === "0") lookFrom(state.camera);
  else return;
  event.preventDefault();
});

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const on = event.target, typing = on.tagName === "SELECT" || (on.tagName === "INPUT" && on.type === "number");
  if (typing) return;
  const key = event.key.toLowerCase();
  if (key === " " && on.tagName !== "BUTTON" && on.tagName !== "SUMMARY") { play(state.active, !state.playing.has(state.active)); event.preventDefault(); }
  else if (key === "l") flip("names");
  else if (key === "a") flip("axes");
  else if (key === "p") flip("paths");
  else if (key === "g" && state.grid.ghost) flip("ghost");
  else if (key === "t") flipTheme();
  else if (key === "c") { lookFrom((state.camera + 1) % DATA.cameras.length); tools(); }
  else if (/^[1-9]$/.test(key) && DATA.grids[+key - 1]) choose(+key - 1);
});

/* the address of the page contains its state */
let remembering = 0, written = "";
function remember() {
  clearTimeout(remembering);
  remembering = setTimeout(() => {
    if (state.playing.size) return;
    const shown = new URLSearchParams(), off = camera.position.clone().sub(controls.target).normalize();
    if (DATA.grids.length > 1) shown.set("grid", DATA.grids.indexOf(state.grid));
    state.grid.sliders.forEach((slider, i) => shown.set(slider.name, +(state.values[i] * shownUnit(slider.unit)[1]).toPrecision(7)));
    shown.set("camera", state.camera);
    shown.set("view", [...off.toArray().map((part) => +part.toFixed(4)), +camera.zoom.toFixed(3)].join(","));
    for (const [what, on] of Object.entries(state.show)) shown.set(what, on ? "on" : "off");
    if (document.documentElement.dataset.chosen) shown.set("theme", document.documentElement.dataset.theme);
    written = `#${shown}`;
    try { history.replaceState(null, "", written); } catch (error) { /* a frame without an address of its own */ }
  }, 250);
}

function addressed() {
  if (location.hash === written) return;
  const requested = new URLSearchParams(location.hash.slice(1));
  if (requested.has("theme")) { document.documentElement.dataset.theme = requested.get("theme"); dressed(); }
  if (requested.has("grid") && DATA.grids[+requested.get("grid")]) choose(+requested.get("grid"));
  for (const what of Object.keys(state.show)) if (requested.has(what)) { state.show[what] = requested.get(what) !== "off"; shown(); }
  if (requested.has("camera") && DATA.cameras[+requested.get("camera")]) lookFrom(+requested.get("camera"));
  const view = (requested.get("view") || "").split(",").map(Number);
  if (view.length === 4 && view.every(Number.isFinite) && view[3] > 0) {
    camera.position.copy(controls.target).addScaledVector(new THREE.Vector3(view[0], view[1], view[2]).normalize(), camera.far / 2);
    camera.zoom = view[3];
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }
  const stated = state.grid.sliders.map((slider, i) => i).filter((i) => requested.has(state.grid.sliders[i].name));
  for (const i of stated) placeSlider(i, parseFloat(requested.get(state.grid.sliders[i].name)) / shownUnit(state.grid.sliders[i].unit)[1]);
  if (stated.length) update();
}

const dark = window.matchMedia("(prefers-color-scheme: dark)");
const follow = () => { document.documentElement.dataset.theme = dark.matches ? "dark" : "light"; dressed(); };
document.documentElement.dataset.theme = dark.matches ? "dark" : "light";
build();
for (const line of axisLines) line.visible = state.show.axes;
choices();
lookFrom(0);
choose(0);
dressed();
addressed();
dark.addEventListener("change", follow);
window.addEventListener("hashchange", addressed);
new ResizeObserver(() => { resize(); for (const box of state.chosen) box.point(); }).observe(stage);
document.documentElement.dataset.ready = "yes";
