// Plays the .glb that a page of the gallery holds, so that it works from disk.
import {
  AmbientLight, AnimationMixer, Box3, Color, DirectionalLight, PerspectiveCamera, Scene, Timer, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const canvas = document.querySelector("canvas");
const bytes = Uint8Array.from(atob(document.getElementById("glb").textContent), (letter) => letter.charCodeAt(0));

new GLTFLoader().parse(bytes.buffer, "", ({ scene: character, animations }) => {
  const scene = new Scene().add(character, new AmbientLight(0xffffff, 1.4));
  scene.background = new Color(0xdfe6ee);
  const sun = new DirectionalLight(0xffffff, 2.4);
  sun.position.set(1, 2, 1.5);
  scene.add(sun);

  const box = new Box3().setFromObject(character);
  const size = box.getSize(new Vector3()).length();
  const camera = new PerspectiveCamera(35, 1, size / 100, size * 20);
  const controls = new OrbitControls(camera, canvas);
  box.getCenter(controls.target);
  camera.position.copy(controls.target).add(new Vector3(0.75, 0.4, 1.65).multiplyScalar(size));

  const mixer = new AnimationMixer(character);
  mixer.clipAction(animations.at(-1)).play();
  const renderer = new WebGLRenderer({ canvas, antialias: true });
  const timer = new Timer();
  renderer.setAnimationLoop(() => {
    const { clientWidth: width, clientHeight: height } = canvas;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    controls.update();
    mixer.update(timer.update().getDelta());
    renderer.render(scene, camera);
  });
});
