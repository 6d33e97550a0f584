/** INTERIM: a mesh deformed on the CPU, until integrations/web has the shader. */

import { BufferAttribute, BufferGeometry, DoubleSide, FrontSide, Mesh, MeshStandardMaterial } from "three";

import { positionsOf } from "./blend";
import type { Scene } from "./stream";

export function makeMesh(scene: Scene): Mesh {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(scene.positions.slice(), 3));
  geometry.setAttribute("normal", new BufferAttribute(scene.normals.slice(), 3));
  if (scene.colors !== null) geometry.setAttribute("color", new BufferAttribute(scene.colors, 3));
  geometry.setIndex(new BufferAttribute(scene.triangles, 1));
  const materials = scene.parts.map(({ triangles: [first, count], material }, i) => {
    geometry.addGroup(3 * first, 3 * count, i);
    const made = new MeshStandardMaterial({ metalness: material.metallic, roughness: material.roughness, vertexColors: scene.colors !== null, side: material.double_sided ? DoubleSide : FrontSide });
    if (scene.colors === null) made.color.setRGB(material.base_color[0], material.base_color[1], material.base_color[2]);
    return made;
  });
  const mesh = new Mesh(geometry, materials);
  mesh.frustumCulled = false;
  return mesh;
}

export function pose(mesh: Mesh, scene: Scene, controls: Float32Array | null): void {
  const attribute = mesh.geometry.getAttribute("position") as BufferAttribute;
  (attribute.array as Float32Array).set(positionsOf(scene, controls));
  attribute.needsUpdate = true;
  if (controls !== null) mesh.geometry.computeVertexNormals();
}
