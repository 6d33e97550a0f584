// Vertex shader of a character in three.js: blends transforms by isoline coordinates (docs/protocol.md).

/** @import {Material} from "three" */
/** @typedef {{[name: string]: {value: any}}} Uniforms */

/** Maximum number of fields, whose isoline coordinates fit into two vertex attributes. */
export const MAX_FIELDS = 8;

/** Shader code before main(). Rows of a transform are the columns of a mat4, so x * transform transforms x. */
const DECLARATIONS = `
attribute vec4 puppetCoordinates0;
attribute vec4 puppetCoordinates1;
attribute vec4 puppetSlopes0;
attribute vec4 puppetSlopes1;
attribute vec4 puppetSlopes2;
attribute vec4 puppetSlopes3;
uniform highp sampler2D puppetControls;
uniform vec3 puppetShift;
uniform float puppetWeights[${MAX_FIELDS}];
uniform int puppetFields;
uniform int puppetIsolines;

vec3 puppetPosition;
vec3 puppetNormal;
vec3 puppetRestA;
vec3 puppetRestB;
vec3 puppetAlongA;
vec3 puppetAlongB;

mat4 puppetTransform(int number) {
  mat4 transform = mat4(0.0);
  for (int row = 0; row < 3; row++) transform[row] = texelFetch(puppetControls, ivec2(row, number), 0);
  return transform;
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

void puppetMove() {
  vec4 x = vec4(position, 1.0);
  puppetRestA = puppetFirstTangent(normal);
  puppetRestB = cross(normal, puppetRestA);
  float coordinates[8] = float[8](
    puppetCoordinates0.x, puppetCoordinates0.y, puppetCoordinates0.z, puppetCoordinates0.w,
    puppetCoordinates1.x, puppetCoordinates1.y, puppetCoordinates1.z, puppetCoordinates1.w);
  vec2 slopes[8] = vec2[8](
    puppetSlopes0.xy, puppetSlopes0.zw, puppetSlopes1.xy, puppetSlopes1.zw,
    puppetSlopes2.xy, puppetSlopes2.zw, puppetSlopes3.xy, puppetSlopes3.zw);
  puppetAlongA = vec3(0.0);
  puppetAlongB = vec3(0.0);
  mat4 mean = mat4(0.0);
  for (int field = 0; field < puppetFields; field++) {
    int isoline = clamp(int(coordinates[field]), 0, puppetIsolines - 2);
    mat4 lower = puppetTransform(field * puppetIsolines + isoline);
    mat4 rise = puppetTransform(field * puppetIsolines + isoline + 1) - lower;
    mean += puppetWeights[field] * (lower + rise * (coordinates[field] - float(isoline)));
    vec3 step = puppetWeights[field] * (x * rise).xyz;
    puppetAlongA += slopes[field].x * step;
    puppetAlongB += slopes[field].y * step;
  }
  puppetPosition = puppetShift + (x * mean).xyz;
  puppetAlongA += (vec4(puppetRestA, 0.0) * mean).xyz;
  puppetAlongB += (vec4(puppetRestB, 0.0) * mean).xyz;
  puppetNormal = puppetNormalized(cross(puppetAlongA, puppetAlongB));
}
`;

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
  const before = material.onBeforeCompile.bind(material);
  material.onBeforeCompile = (shader, renderer) => {
    before(shader, renderer);
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${DECLARATIONS}`)
      .replace("void main() {", "void main() {\npuppetMove();")
      .replace("#include <beginnormal_vertex>", NORMAL)
      .replace("#include <begin_vertex>", POSITION);
  };
  const key = material.customProgramCacheKey.bind(material);
  material.customProgramCacheKey = () => `${key()} puppetline`;
  return material;
}
