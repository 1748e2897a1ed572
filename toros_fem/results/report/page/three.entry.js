// What reports use of three.js. three.min.js is made of it, with three 0.187.0 and esbuild 0.28.2:
//
//   npm install three@0.187.0 esbuild@0.28.2
//   npx esbuild three.entry.js --bundle --minify --format=iife --global-name=THREE \
//     --target=es2020 --legal-comments=inline --outfile=three.min.js
export {
  AmbientLight, BufferAttribute, BufferGeometry, CanvasTexture, Color, DirectionalLight, DoubleSide,
  FrontSide, LineBasicMaterial, LineSegments, Mesh, MeshLambertMaterial, OrthographicCamera,
  SRGBColorSpace, Scene, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
