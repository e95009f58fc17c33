// what the pages use of three.js; `make three` bundles it as three.min.js
export {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, Color, ColorManagement, CylinderGeometry,
  DirectionalLight, DoubleSide, GridHelper, Group, Line, LineBasicMaterial, LineDashedMaterial,
  LinearSRGBColorSpace, Mesh, MeshBasicMaterial, MeshStandardMaterial, OrthographicCamera, PCFShadowMap,
  PlaneGeometry, Quaternion, Scene, ShadowMaterial, SphereGeometry, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
export { Line2 } from "three/examples/jsm/lines/Line2.js";
export { LineGeometry } from "three/examples/jsm/lines/LineGeometry.js";
export { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
