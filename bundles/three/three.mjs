// The parts of three.js that the view in three dimensions is made of.
export {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, Color, DirectionalLight, DoubleSide, EdgesGeometry,
  Float32BufferAttribute, Group, InstancedMesh, Line, LineBasicMaterial, LineDashedMaterial, LineLoop, LineSegments, Matrix4, Mesh,
  MeshBasicMaterial, MeshLambertMaterial, NearestFilter, Path, PerspectiveCamera, Plane, PlaneGeometry, Points, PointsMaterial, Raycaster, Scene,
  Shape, ShapeGeometry, SphereGeometry, SRGBColorSpace, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
