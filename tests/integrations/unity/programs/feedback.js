({ shader, rows, vertices, place, stride }) => {
  // Run a vertex shader in WebGL 2, and return position, normal and position before of each vertex.
  const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer);
  const gl = document.createElement("canvas").getContext("webgl2");
  const program = gl.createProgram();
  const fragment = "#version 300 es\nprecision highp float; out vec4 color; void main() { color = vec4(1.0); }";
  for (const [kind, source] of [[gl.VERTEX_SHADER, shader], [gl.FRAGMENT_SHADER, fragment]]) {
    const compiled = gl.createShader(kind);
    gl.shaderSource(compiled, source);
    gl.compileShader(compiled);
    if (!gl.getShaderParameter(compiled, gl.COMPILE_STATUS)) {
      return { error: gl.getShaderInfoLog(compiled) };
    }
    gl.attachShader(program, compiled);
  }
  const results = ["position", "normal", "before"].map((name) => `_entryPointOutput_${name}`);
  gl.transformFeedbackVaryings(program, results, gl.INTERLEAVED_ATTRIBS);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
    return { error: gl.getProgramInfoLog(program) };
  }
  gl.useProgram(program);

  const texels = floats(rows);
  gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, 512, texels.length / 2048, 0, gl.RGBA, gl.FLOAT, texels);

  const values = floats(vertices);
  const count = values.length / stride;
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
  for (const [name, start] of Object.entries(place)) {
    const location = gl.getAttribLocation(program, `input_${name}`);
    const size = name.endsWith("OS") ? 3 : name === "block" ? 2 : 4;
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, gl.FLOAT, false, 4 * stride, 4 * start);
  }

  const feedback = gl.createBuffer();
  gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, feedback);
  gl.bufferData(gl.TRANSFORM_FEEDBACK_BUFFER, 36 * count, gl.STATIC_READ);
  gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, feedback);
  gl.enable(gl.RASTERIZER_DISCARD);
  gl.beginTransformFeedback(gl.POINTS);
  gl.drawArrays(gl.POINTS, 0, count);
  gl.endTransformFeedback();
  const found = new Float32Array(9 * count);
  gl.getBufferSubData(gl.TRANSFORM_FEEDBACK_BUFFER, 0, found);
  const error = gl.getError();
  let text = "";
  for (const byte of new Uint8Array(found.buffer)) {
    text += String.fromCharCode(byte);
  }
  return { error: error ? String(error) : "", values: btoa(text) };
}
