/** What is around the characters in the film: the place's picture, and a floor of its colour. */

import { BackSide, CircleGeometry, Color, Group, Mesh, MeshBasicMaterial, RepeatWrapping, type Scene, SphereGeometry, SRGBColorSpace, type Texture, TextureLoader } from "three";

/** What a picture of a place shows: this much around, and from and to these angles above the horizon, in degrees. */
const [AROUND, LOWEST, HIGHEST] = [120, -10, 35];

/** Distance of the picture, in metres. */
export const RADIUS = 80;

export class Backdrop {
  private readonly around = new MeshBasicMaterial({ side: BackSide, depthWrite: false, fog: false });
  private readonly floor = new MeshBasicMaterial();
  private readonly group = new Group();
  private readonly loader = new TextureLoader();
  private shown: string | null = null;

  constructor(
    private readonly scene: Scene,
    private readonly changed: () => void,
  ) {
    const radians = (degrees: number): number => (degrees * Math.PI) / 180;
    const picture = new Mesh(new SphereGeometry(RADIUS, 48, 12, 0, 2 * Math.PI, radians(90 - HIGHEST), radians(HIGHEST - LOWEST)), this.around);
    picture.renderOrder = -2;
    const floor = new Mesh(new CircleGeometry(RADIUS, 48), this.floor);
    floor.rotation.x = -Math.PI / 2;
    floor.position.y = -0.005;
    floor.renderOrder = -1;
    this.group.add(picture, floor);
    this.group.visible = false;
    scene.add(this.group);
  }

  /** Whether a place is shown. */
  get isShown(): boolean {
    return this.group.visible;
  }

  /** Show a place by the address of its picture; with null, none. */
  show(picture: string | null): void {
    if (picture === this.shown) return;
    this.shown = picture;
    if (picture === null) {
      this.group.visible = false;
      this.changed();
      return;
    }
    this.loader.load(picture, (texture) => {
      if (this.shown !== picture) return;
      this.around.map?.dispose();
      texture.colorSpace = SRGBColorSpace;
      texture.wrapS = RepeatWrapping;
      texture.repeat.x = -360 / AROUND; // seen from inside
      texture.offset.x = 0.5 - 90 / AROUND; // its middle is behind the characters, as in the film
      this.around.map = texture;
      this.around.needsUpdate = true;
      const [top, bottom] = edgesOf(texture);
      this.scene.background = top;
      this.floor.color = bottom;
      this.group.visible = true;
      this.changed();
    }, undefined, () => {
      if (this.shown !== picture) return;
      this.group.visible = false; // rather none than the place before
      this.changed();
    });
  }
}

/** The colours of the upper and the lower edge of a picture. */
function edgesOf(texture: Texture): readonly [Color, Color] {
  const image = texture.image as HTMLImageElement;
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [1, image.height];
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context?.drawImage(image, 0, 0, 1, image.height);
  const at = (y: number): Color => {
    const [r = 0, g = 0, b = 0] = context?.getImageData(0, y, 1, 1).data ?? [];
    return new Color().setRGB(r / 255, g / 255, b / 255, SRGBColorSpace);
  };
  return [at(0), at(image.height - 1)];
}
