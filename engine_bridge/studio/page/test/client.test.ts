import assert from "node:assert/strict";
import test from "node:test";

import { Client } from "../../../../integrations/web/puppetline.js";
import { pass, sleep } from "./clock";

class Socket {
  static last: Socket;
  onmessage: ((event: { data: string }) => void) | null = null;

  constructor() {
    Socket.last = this;
  }

  close(): void {
    this.onmessage = null;
  }
}

test("a service is gone after six seconds without a message, of which those do not count in which the page slept", async () => {
  Object.assign(globalThis, { WebSocket: Socket });
  const client = new Client("ws://127.0.0.1:7402/stream");
  const first = Socket.last;
  await pass(5000);
  first.onmessage?.({ data: "{}" });
  await pass(5000);
  sleep(60_000);
  await pass(0);
  assert.equal(client.state, "connecting");
  await pass(1000);
  assert.deepEqual([client.state, client.reason], ["offline", "No message from ws://127.0.0.1:7402/stream for 6 s."]);
  await pass(250);
  assert.notEqual(Socket.last, first);
  client.close();
  await pass(10_000);
  assert.equal(client.state, "closed");
});
