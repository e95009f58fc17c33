/* The scene as SVG, for a browser without WebGL: outlines of the solids, the farthest first (painter's algorithm). */

const CONVEX = ["BoxGeometry", "SphereGeometry", "CylinderGeometry"];

/* corners of the convex hull of points in a plane (monotone chain) */
function hull(points) {
  const sorted = points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (ordered) => ordered.reduce((kept, point) => {
    const turn = ([a, b]) => (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]);
    while (kept.length > 1 && turn(kept.slice(-2)) <= 0) kept.pop();
    return [...kept, point];
  }, []).slice(0, -1);
  return [...half(sorted), ...half(sorted.slice().reverse())];
}

const traced = (points, end = "") => `M${points.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}${end}`;

/* positions of a line, of pairs of ends, or of a solid's vertices */
function* vertices({ array }) { for (let i = 0; i < array.length; i += 3) yield [array[i], array[i + 1], array[i + 2]]; }

/* path of a part of the scene, its attributes, and its depth */
function outline(part, screen) {
  const { geometry, material } = part, wide = part.isLine2, positions = wide ? geometry.attributes.instanceStart : geometry.attributes.position;
  const seen = positions ? [...vertices(wide ? positions.data : positions)].map(screen) : [], style = { "fill": "none", "stroke": `#${material.color.getHexString()}`, "opacity": material.opacity };
  const depth = seen.reduce((sum, point) => sum + point[2], 0) / seen.length, triples = (part.isLineSegments ? 2 : 3);
  if (!seen.length) return null;
  if (wide || part.isLine && !part.isLineSegments) return { d: traced(seen), depth, style: { ...style, "stroke-width": wide ? material.linewidth : 1.5, ...(wide ? {} : { "stroke-dasharray": "9 4" }) } };
  if (CONVEX.includes(geometry.type)) return { d: traced(hull(seen), "Z"), depth, style: { ...style, fill: style.stroke, stroke: "var(--sky)", "stroke-width": 0.6 } };
  const order = geometry.index ? Array.from(geometry.index.array) : seen.map((_, i) => i), faces = [];
  for (let i = 0; i < order.length; i += triples) faces.push(traced(order.slice(i, i + triples).map((k) => seen[k]), "Z"));
  return { d: faces.join(""), depth, style: triples === 2 ? style : { ...style, fill: style.stroke, "stroke-width": 0.3 } };
}

function drawFlat() {
  const W = stage.clientWidth, H = stage.clientHeight, pieces = [], at = new THREE.Vector3();
  camera.updateMatrixWorld();
  scene.updateMatrixWorld();
  scene.traverseVisible((part) => {
    if (!part.material || part.material.isShadowMaterial) return;
    const found = outline(part, (point) => {
      at.fromArray(point).applyMatrix4(part.matrixWorld).project(camera);
      return [(at.x + 1) / 2 * W, (1 - at.y) / 2 * H, at.z];
    });
    if (found) pieces.push({ ...found, order: part.renderOrder });
  });
  pieces.sort((a, b) => a.order - b.order || b.depth - a.depth);
  $("flat").setAttribute("viewBox", `0 0 ${W} ${H}`);
  $("flat").replaceChildren(...pieces.map(({ d, style }) => make("path", { d, ...style })));
}
