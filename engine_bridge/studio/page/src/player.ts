/** Plays the .glb that its document holds: a page of the gallery on disk, or a cell of a notebook. */

import {
  AmbientLight,
  AnimationMixer,
  Box3,
  Color,
  DirectionalLight,
  PerspectiveCamera,
  Scene,
  Timer,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

const canvas = document.querySelector("canvas");
if (canvas === null) throw new Error("no canvas");
const text = document.getElementById("glb")?.textContent ?? "";
const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

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
  camera.position.copy(controls.target).add(new Vector3(0.9, 0.45, 2).multiplyScalar(size));

  const mixer = new AnimationMixer(character);
  const animation = animations.at(-1);
  if (animation !== undefined) mixer.clipAction(animation).play();
  const renderer = new WebGLRenderer({ canvas, antialias: true });
  const timer = new Timer();
  renderer.setAnimationLoop(() => {
    const { clientWidth: width, clientHeight: height } = canvas;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    mixer.update(timer.update().getDelta());
    const way = box.setFromObject(character).getCenter(new Vector3()).sub(controls.target); // of one that walks
    controls.target.add(way);
    camera.position.add(way);
    controls.update();
    renderer.render(scene, camera);
  });
});
