"""Programs of the graphics library, in GLSL 3.30, for `engine_bridge.pictures.gpu_renderer`."""

SHADOW_VERTEX = """
#version 330
uniform mat4 light;
in vec3 position;
void main() { gl_Position = light * vec4(position, 1.0); }
"""

SHADOW_FRAGMENT = """
#version 330
void main() {}
"""

SURFACE_VERTEX = """
#version 330
LIGHT
uniform mat4 camera;
uniform float lift;
uniform float floor_side;
uniform vec4 color;
in vec3 position;
in vec3 normal;
in vec4 vertex_color;
in vec2 uv;
out vec3 place;
out vec3 towards;
out vec2 texel;
out vec4 in_front;
out vec4 behind;
void main() {
    place = position;
    towards = normal;
    texel = uv;
    in_front = behind = color * vertex_color;
    if (BY_VERTEX && !UNLIT) {
        vec3 n = normalize(normal);
        in_front.rgb *= irradiance(position, n, lift);
        if (TWO_SIDED) behind.rgb *= irradiance(position, -n, lift);
    }
    if (BY_VERTEX && !TEXTURED) {
        in_front.rgb = encoded(in_front.rgb);
        behind.rgb = encoded(behind.rgb);
    }
    gl_Position = camera * vec4(position, 1.0);
    gl_ClipDistance[0] = floor_side * position.y;
}
"""

LIGHT = """
uniform mat4 key_light;
uniform mat4 sky_light;
uniform sampler2DShadow key_depths;
uniform sampler2DShadow sky_depths;
uniform vec3 key_direction;
uniform vec3 key_color;
uniform vec3 sky_color;
uniform vec3 ground_color;
uniform vec2 key_blur;   // radius of the penumbra, as a share of the map
uniform vec2 sky_blur;
uniform vec4 key_casters;   // middle and half extents of the part of the map where something casts a shadow
uniform vec4 sky_casters;

// The share of a light that reaches a point, from points on a disc that are evenly dense (Vogel 1979), so that the edge
// of a shadow is soft without grain. The outermost ones come first: where they agree, no others are taken. That is
// written as loops, because software renderers skip the rest of a loop, but run both sides of a condition.
float lit(sampler2DShadow depths, vec3 at, vec4 casters, vec2 blur, int count) {
    const mat2 turn = mat2(-0.737369, 0.675490, -0.675490, -0.737369);
    vec2 inside = casters.zw + blur - abs(at.xy - casters.xy);
    int first = min(inside.x, inside.y) < 0.0 ? 0 : OUTER_SAMPLES;
    vec2 way = vec2(1.0, 0.0);
    float sum = 0.0;
    for (int k = 0; k < first; k++) {
        sum += textureLod(depths, vec3(at.xy + blur * way, at.z), 0.0);
        way = turn * way;
    }
    int others = sum == 0.0 || sum == float(OUTER_SAMPLES) ? 0 : count;
    for (int k = 0; k < others; k++) {
        sum += textureLod(depths, vec3(at.xy + sqrt((float(k) + 0.5) / float(count)) * blur * way, at.z), 0.0);
        way = turn * way;
    }
    return first == 0 ? 1.0 : sum / float(OUTER_SAMPLES + others);
}

vec3 irradiance(vec3 place, vec3 n, float lift) {
    float cosine = dot(n, key_direction);
    float key = 0.0;
    if (cosine > 0.0) {
        vec3 at = (key_light * vec4(place + lift * n, 1.0)).xyz * 0.5 + 0.5;
        key = cosine * lit(key_depths, at, key_casters, key_blur, KEY_SAMPLES);
    }
    vec3 above = (sky_light * vec4(place + 2.0 * lift * n, 1.0)).xyz * 0.5 + 0.5;
    float open = mix(0.35, 1.0, lit(sky_depths, above, sky_casters, sky_blur, SKY_SAMPLES));
    float up = 0.5 + 0.5 * n.y;
    return key * key_color + up * open * sky_color + (1.0 - up) * ground_color;
}

// sRGB by roots (Taylor), which software computes faster than powers; at most 1 % off in the darkest colours
vec3 encoded(vec3 c) {
    c = clamp(c, 0.0, 1.0);
    vec3 a = sqrt(c), b = sqrt(a), d = sqrt(b);
    return 0.662002687 * a + 0.684122060 * b - 0.323583601 * d - 0.022541147 * c;
}
"""

SURFACE_FRAGMENT = """
#version 330
LIGHT
uniform vec3 eye;
uniform float lift;
uniform sampler2D image;
uniform float cutoff;
in vec3 place;
in vec3 towards;
in vec2 texel;
in vec4 in_front;
in vec4 behind;
out vec4 shown;
void main() {
    float side = 1.0;
    if (TWO_SIDED) {
        // Which side is seen, whatever the winding: many meshes are not consistent.
        vec3 flat_normal = cross(dFdx(place), dFdy(place));
        side = dot(flat_normal, eye - place) * dot(flat_normal, towards) < 0.0 ? -1.0 : 1.0;
    }
    vec4 shade = TWO_SIDED && side < 0.0 ? behind : in_front;
    if (TEXTURED) shade *= texture(image, texel);
    if (MASKED && shade.a < cutoff) discard;
    if (!BY_VERTEX && !UNLIT) shade.rgb *= irradiance(place, side * normalize(towards), lift);
    if (!BY_VERTEX || TEXTURED) shade.rgb = encoded(shade.rgb);
    shown = vec4(shade.rgb, 1.0) * (BLENDED ? shade.a : 1.0);
}
"""

FLOOR_VERTEX = """
#version 330
uniform mat4 camera;
uniform vec3 middle;
uniform float reach;
in vec2 corner;
out vec3 place;
void main() {
    place = middle + reach * vec3(corner.x, 0.0, corner.y);
    gl_Position = camera * vec4(place, 1.0);
}
"""

FLOOR_FRAGMENT = """
#version 330
uniform vec3 middle;
uniform float reach;
uniform float tile;
uniform sampler2D image;
in vec3 place;
out vec4 shown;
void main() {
    float far = length(place.xz - middle.xz) / reach;
    if (far > 1.0) discard;
    shown = vec4(texture(image, place.xz / tile).rgb, 1.0 - smoothstep(0.25, 1.0, far));
}
"""

FLOOR_SHADOW_FRAGMENT = """
#version 330
LIGHT
in vec3 place;
out vec4 shown;
void main() {
    // The floor casts no shadow, so it needs no lift; with one, whatever is lower than that would lose its shadow.
    vec3 full = key_direction.y * key_color + sky_color;
    shown = vec4(encoded(irradiance(place, vec3(0.0, 1.0, 0.0), 0.0) / full), 1.0);
}
"""

PANORAMA_VERTEX = """
#version 330
uniform vec3 right;
uniform vec3 up;
uniform vec3 ahead;
in vec2 corner;
out vec3 ray;
void main() {
    ray = ahead + corner.x * right - corner.y * up;
    gl_Position = vec4(corner, 0.0, 1.0);
}
"""

PANORAMA_FRAGMENT = """
#version 330
uniform sampler2D image;
uniform float period;   // of the picture around, in radians
uniform vec2 elevations;   // of its upper and lower edge
in vec3 ray;
out vec4 shown;
void main() {
    float around = atan(ray.x, -ray.z) / period;
    float down = (elevations.x - atan(ray.y, length(ray.xz))) / (elevations.x - elevations.y);
    shown = textureLod(image, vec2(0.5 + around, clamp(down, 0.001, 0.999)), 0.0);
}
"""

PICTURE_VERTEX = """
#version 330
uniform vec4 place;   // left, upper, right and lower edge, as shares of the frame
in vec2 corner;
out vec2 texel;
void main() {
    texel = 0.5 + 0.5 * corner;
    gl_Position = vec4(2.0 * mix(place.xy, place.zw, texel) - 1.0, 0.0, 1.0);
}
"""

PICTURE_FRAGMENT = """
#version 330
uniform sampler2D image;
uniform float opacity;
in vec2 texel;
out vec4 shown;
void main() { shown = texture(image, texel) * vec4(1.0, 1.0, 1.0, opacity); }
"""

RESOLVE_FRAGMENT = """
#version 330
uniform SAMPLER samples;
out vec4 shown;
void main() {
    shown = vec4(0.0);
    for (int k = 0; k < COUNT; k++) shown += texelFetch(samples, ivec2(gl_FragCoord.xy), k) / float(COUNT);
}
"""
