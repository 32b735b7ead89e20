// The parts of three.js that the player uses; README.md says how three.min.js is made from this
// file.
export {
  BufferAttribute, BufferGeometry, Color, ConeGeometry, CylinderGeometry, DirectionalLight, DoubleSide, HemisphereLight, Line,
  LineBasicMaterial, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Quaternion, Scene, SphereGeometry,
  TorusGeometry, Vector3, WebGLRenderer,
} from "three";
