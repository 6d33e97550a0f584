// Vertex shader of a character in three.js: blends transforms by isoline coordinates (docs/protocol.md).

/** @import {Material} from "three" */
/** @typedef {{[name: string]: {value: any}}} Uniforms */

/** Maximum number of fields, whose isoline coordinates fit into two vertex attributes. */
export const MAX_FIELDS = 8;

/**
 * Shader code before main(). Rows of a transform are the columns of a mat4, so x * transform transforms x.
 *
 * Fields are written one after another: a loop over them takes twice as long where no graphics card draws.
 *
 * @param {number} fields
 */
const declarations = (fields) => `
attribute vec4 puppetCoordinates0;
attribute vec4 puppetCoordinates1;
attribute vec4 puppetSlopes0;
attribute vec4 puppetSlopes1;
attribute vec4 puppetSlopes2;
attribute vec4 puppetSlopes3;
uniform highp sampler2D puppetControls;
uniform vec3 puppetShift;
uniform float puppetWeights[${MAX_FIELDS}];
uniform int puppetIsolines;

vec3 puppetPosition;
vec3 puppetNormal;
vec3 puppetRestA;
vec3 puppetRestB;
vec3 puppetAlongA;
vec3 puppetAlongB;
mat4 puppetMean;

vec4 puppetRow(int row, int number) {
  return texelFetch(puppetControls, ivec2(row, number), 0);
}

mat4 puppetTransform(int number) {
  return mat4(puppetRow(0, number), puppetRow(1, number), puppetRow(2, number), vec4(0.0));
}

vec3 puppetNormalized(vec3 vector) {
  float size = length(vector);
  return size > 0.0 ? vector / size : vec3(0.0);
}

// The first tangent along which slopes are defined (docs/protocol.md). Slopes are valid for this tangent only.
vec3 puppetFirstTangent(vec3 direction) {
  vec3 size = abs(direction);
  vec3 axis = vec3(0.0, 0.0, 1.0);
  if (size.x <= size.y && size.x <= size.z) axis = vec3(1.0, 0.0, 0.0);
  else if (size.y <= size.z) axis = vec3(0.0, 1.0, 0.0);
  return puppetNormalized(cross(axis, direction));
}

void puppetAdd(int field, float coordinate, vec2 slope) {
  int isoline = clamp(int(coordinate), 0, puppetIsolines - 2);
  mat4 lower = puppetTransform(field * puppetIsolines + isoline);
  mat4 rise = puppetTransform(field * puppetIsolines + isoline + 1) - lower;
  puppetMean += puppetWeights[field] * (lower + rise * (coordinate - float(isoline)));
  vec3 step = puppetWeights[field] * (vec4(position, 1.0) * rise).xyz;
  puppetAlongA += slope.x * step;
  puppetAlongB += slope.y * step;
}

void puppetMove() {
  puppetRestA = puppetFirstTangent(normal);
  puppetRestB = cross(normal, puppetRestA);
  puppetAlongA = vec3(0.0);
  puppetAlongB = vec3(0.0);
  puppetMean = mat4(0.0);
${Array.from({ length: fields }, (_, field) => `  puppetAdd(${field}, ${coordinateOf(field)}, ${slopeOf(field)});`).join("\n")}
  puppetPosition = puppetShift + (vec4(position, 1.0) * puppetMean).xyz;
  puppetAlongA += (vec4(puppetRestA, 0.0) * puppetMean).xyz;
  puppetAlongB += (vec4(puppetRestB, 0.0) * puppetMean).xyz;
  puppetNormal = puppetNormalized(cross(puppetAlongA, puppetAlongB));
}
`;

/** @param {number} field */
const coordinateOf = (field) => `puppetCoordinates${field >> 2}.${"xyzw"[field % 4]}`;

/** @param {number} field */
const slopeOf = (field) => `puppetSlopes${field >> 1}.${field % 2 ? "zw" : "xy"}`;

const NORMAL = `
vec3 objectNormal = puppetNormal;
#ifdef USE_TANGENT
  vec3 objectTangent = puppetNormalized(
    dot(tangent.xyz, puppetRestA) * puppetAlongA + dot(tangent.xyz, puppetRestB) * puppetAlongB);
#endif
`;

const POSITION = `
vec3 transformed = puppetPosition;
#ifdef USE_ALPHAHASH
  vPosition = vec3(position);
#endif
`;

/**
 * Make a material deform its mesh. Its vertex shader must include three's chunks `common` and `begin_vertex`.
 *
 * @template {Material} M
 * @param {M} material is changed
 * @param {Uniforms} uniforms those of a `PuppetMesh`
 * @returns {M}
 */
export function deform(material, uniforms) {
  const { value: fields } = uniforms.puppetFields;
  const before = material.onBeforeCompile.bind(material);
  material.onBeforeCompile = (shader, renderer) => {
    before(shader, renderer);
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${declarations(fields)}`)
      .replace("void main() {", "void main() {\npuppetMove();")
      .replace("#include <beginnormal_vertex>", NORMAL)
      .replace("#include <begin_vertex>", POSITION);
  };
  const key = material.customProgramCacheKey.bind(material);
  material.customProgramCacheKey = () => `${key()} puppetline ${fields}`;
  return material;
}
