/** What lies on the floor of the film: a soft shadow below each character, and a ring around the one that is chosen. */

import { type Box3, CanvasTexture, CircleGeometry, Color, Group, Mesh, MeshBasicMaterial, RingGeometry } from "three";

/** Height of what lies on the floor, in shares of its width: nothing flickers. */
const LIFT = 0.002;

export class Ground {
  readonly group = new Group();
  private readonly shadows = new Map<string, Mesh>();
  private readonly ring = new Mesh(new RingGeometry(0.94, 1, 64), new MeshBasicMaterial({ transparent: true, opacity: 0.9 }));
  private readonly shadow = new MeshBasicMaterial({ map: softDisc(), transparent: true, depthWrite: false });
  private readonly disc = new CircleGeometry(1, 32);

  constructor() {
    this.ring.rotation.x = -Math.PI / 2;
    this.group.add(this.ring);
  }

  theme(accent: string): void {
    this.ring.material.color = new Color(accent);
  }

  /** Lie below characters, whose boxes are in the view's coordinates. */
  lie(boxes: ReadonlyMap<string, Box3>, chosen: string | null): void {
    for (const [name, mesh] of this.shadows) {
      if (boxes.has(name)) continue;
      mesh.removeFromParent();
      this.shadows.delete(name);
    }
    this.ring.visible = false;
    for (const [name, { min, max }] of boxes) {
      let mesh = this.shadows.get(name);
      if (mesh === undefined) {
        mesh = new Mesh(this.disc, this.shadow);
        mesh.rotation.x = -Math.PI / 2;
        this.shadows.set(name, mesh);
        this.group.add(mesh);
      }
      const [x, z] = [(min.x + max.x) / 2, (min.z + max.z) / 2];
      const [wide, deep] = [(max.x - min.x) / 2, (max.z - min.z) / 2];
      mesh.position.set(x, LIFT * wide, z);
      mesh.scale.set(1.15 * wide, 1.15 * deep, 1);
      if (name !== chosen || boxes.size < 2) continue;
      this.ring.visible = true;
      this.ring.position.set(x, 2 * LIFT * wide, z);
      this.ring.scale.set(1.15 * wide, 1.15 * deep, 1);
    }
  }
}

/** A black disc that is dark in the middle and clear at its edge. */
function softDisc(): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const context = canvas.getContext("2d");
  if (context !== null) {
    const gradient = context.createRadialGradient(32, 32, 4, 32, 32, 32);
    gradient.addColorStop(0, "rgb(0 0 0 / 45%)");
    gradient.addColorStop(1, "rgb(0 0 0 / 0%)");
    context.fillStyle = gradient;
    context.fillRect(0, 0, 64, 64);
  }
  return new CanvasTexture(canvas);
}
