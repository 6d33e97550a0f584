// Puppetline in web pages: receive the characters of `puppetline serve` over WebSocket. See docs/web.md.

export * from "./message.js";
export * from "./client.js";
export * from "./character.js";
export * from "./evaluation.js";
export * from "./jitter-buffer.js";
