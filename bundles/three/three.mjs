// The parts of three.js that the map is made of.
export {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, Color, ColorManagement, DirectionalLight, DoubleSide, EdgesGeometry,
  Float32BufferAttribute, Group, InstancedMesh, LinearSRGBColorSpace, LineBasicMaterial, LineLoop, LineSegments, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, MOUSE, NearestFilter, OrthographicCamera, Path, PerspectiveCamera, Plane, PlaneGeometry, Points, PointsMaterial,
  Raycaster, Scene, Shape, ShapeGeometry, TOUCH, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
