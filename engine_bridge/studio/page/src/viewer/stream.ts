/** INTERIM: the stream, until integrations/web has it. */

import { address } from "../connection";
import type { Shape } from "./blend";

export interface Part { readonly name: string; readonly triangles: readonly [number, number]; readonly material: Material }
export interface Material { readonly name: string; readonly base_color: readonly [number, number, number, number]; readonly metallic: number; readonly roughness: number; readonly double_sided: boolean; readonly alpha_mode: string }
export interface Scene extends Shape {
  readonly revision: number; readonly normals: Float32Array; readonly uv: Float32Array | null; readonly colors: Float32Array | null;
  readonly parts: readonly Part[]; readonly bounds: readonly [[number, number, number], [number, number, number]]; readonly diagonal: number;
}
export interface Events {
  scene: (character: string, scene: Scene) => void;
  controls: (character: string, controls: Float32Array, time: number) => void;
  joints: (character: string, joints: Float32Array, time: number) => void;
}

export class Stream {
  private socket: WebSocket | null = null;
  private readonly names = new Set<string>();
  private readonly revisions = new Map<string, number>();
  private asked = 0;
  constructor(private readonly token: () => string, private readonly events: Events) {}
  open(): void {
    const socket = new WebSocket(address("/stream"));
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      socket.send(JSON.stringify({ token: this.token() }));
      this.names.clear();
      this.revisions.clear();
      socket.send(JSON.stringify({ subscribe: "service/characters" }));
    };
    socket.onmessage = ({ data }: MessageEvent) => { if (data instanceof ArrayBuffer) this.receive(data); };
    socket.onclose = () => setTimeout(() => { this.open(); }, 1000);
  }
  private send(values: object): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(values));
  }
  private ask(name: string): void {
    this.send({ subscribe: `${name}/scene/${(this.asked++).toString()}` });
  }
  private receive(data: ArrayBuffer): void {
    const bytes = new Uint8Array(data);
    const text = new TextDecoder();
    const topic = text.decode(bytes.subarray(0, 64)).replace(/\0.*$/s, "");
    const view = new DataView(data, 64);
    const kind = view.getUint8(2), revision = view.getUint32(8, true), time = view.getFloat64(24, true);
    const payload = data.slice(128);
    const name = topic.split("/")[0] ?? "";
    if (kind === 10) {
      for (const each of JSON.parse(text.decode(payload)) as { name: string }[]) {
        if (this.names.has(each.name)) continue;
        this.names.add(each.name);
        this.ask(each.name);
        for (const word of ["scene", "controls", "joints"]) this.send({ subscribe: `${each.name}/${word}` });
      }
    } else if (kind === 1) {
      const length = new DataView(payload).getUint32(0, true);
      const d = JSON.parse(text.decode(new Uint8Array(payload, 4, length))) as Record<string, never> & { arrays: Record<string, { type: string; shape: number[]; offset: number }> };
      const array = (key: string): Float32Array | Uint32Array | null => {
        const a = d.arrays[key];
        if (a === undefined) return null;
        const count = a.shape.reduce((x, y) => x * y, 1);
        return a.type === "u32" ? new Uint32Array(payload, 4 + length + a.offset, count) : new Float32Array(payload, 4 + length + a.offset, count);
      };
      this.revisions.set(name, revision);
      this.events.scene(name, { ...d, revision, triangles: array("triangles"), positions: array("positions"), normals: array("normals"), ladder: array("ladder"), uv: array("uv"), colors: array("colors") } as unknown as Scene);
    } else if (kind === 2 && this.revisions.get(name) === revision) this.events.controls(name, new Float32Array(payload), time);
    else if (kind === 6) this.events.joints(name, new Float32Array(payload), time);
  }
}
