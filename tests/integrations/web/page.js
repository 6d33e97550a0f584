// Functions that tests call in a page.

import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import * as puppetline from "/puppetline.js";
import * as drawing from "/puppetline-three.js";
import * as driving from "/skeleton.js";

const WIDTH = 256;

// Return values for Python: typed arrays as base64.
function pack(value) {
  if (ArrayBuffer.isView(value)) {
    let binary = "";
    const bytes = new Uint8Array(value.buffer, value.byteOffset, value.byteLength);
    for (let i = 0; i < bytes.length; i += 8192) binary += String.fromCharCode(...bytes.subarray(i, i + 8192));
    return { type: value.constructor.name, base64: btoa(binary) };
  }
  if (Array.isArray(value)) return value.map(pack);
  if (value !== null && typeof value === "object") {
    return Object.fromEntries(Object.entries(value).map(([key, each]) => [key, pack(each)]));
  }
  return typeof value === "bigint" ? value.toString() : (value ?? null);
}

async function load(address) {
  return puppetline.decode(await (await fetch(address)).arrayBuffer());
}

// A material that draws each vertex as one pixel, whose colour is a value of its vertex shader.
function reading(value, defines) {
  return new THREE.ShaderMaterial({
    defines,
    vertexShader: `
      #include <common>
      varying vec3 read;
      void main() {
        #include <beginnormal_vertex>
        #include <begin_vertex>
        read = ${value};
        vec2 pixel = vec2(gl_VertexID % ${WIDTH}, gl_VertexID / ${WIDTH}) + 0.5;
        gl_Position = vec4(2.0 * pixel / ${WIDTH}.0 - 1.0, 0.0, 1.0);
        gl_PointSize = 1.0;
      }`,
    fragmentShader: `varying vec3 read; void main() { gl_FragColor = vec4(read, 1.0); }`,
    blending: THREE.NoBlending,
    depthTest: false,
  });
}

const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(innerWidth, innerHeight);
document.body.append(renderer.domElement);

// Return a value of the vertex shader of all vertices of a deforming mesh, as the graphics card computes it.
function readVertices(mesh, uniforms, value, defines = {}) {
  const count = mesh.geometry.attributes.position.count;
  if (count > WIDTH * WIDTH) throw new Error(`${count} vertices`);
  const target = new THREE.WebGLRenderTarget(WIDTH, WIDTH, {
    type: THREE.FloatType, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter,
  });
  const geometry = mesh.geometry.clone();
  geometry.setIndex(null);
  const points = new THREE.Points(geometry, drawing.deform(reading(value, defines), uniforms));
  points.frustumCulled = false;
  const scene = new THREE.Scene().add(points);
  renderer.setRenderTarget(target);
  renderer.render(scene, new THREE.Camera());
  const pixels = new Float32Array(4 * WIDTH * WIDTH);
  renderer.readRenderTargetPixels(target, 0, 0, WIDTH, WIDTH, pixels);
  renderer.setRenderTarget(null);
  target.dispose();
  return Float32Array.from({ length: 3 * count }, (_, i) => pixels[4 * Math.floor(i / 3) + (i % 3)]);
}

Object.assign(window, { THREE, GLTFLoader, puppetline, drawing, driving, pack, load, renderer, readVertices });
