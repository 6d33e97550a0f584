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
uniform bool two_sided;
in vec3 position;
in vec3 normal;
in vec4 vertex_color;
in vec2 uv;
out vec3 place;
out vec3 towards;
out vec4 tint;
out vec2 texel;
out vec3 light_in_front;
out vec3 light_behind;
void main() {
    place = position;
    towards = normal;
    tint = vertex_color;
    texel = uv;
    light_in_front = light_behind = vec3(0.0);
    if (BY_VERTEX) {
        vec3 n = normalize(normal);
        light_in_front = irradiance(position, n, lift);
        if (two_sided) light_behind = irradiance(position, -n, lift);
    }
    gl_Position = camera * vec4(position, 1.0);
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

// The share of a light that reaches a point, from points on a disc that are evenly dense (Vogel 1979), so that the edge
// of a shadow is soft without grain. The outermost ones come first: where they agree, no others are taken. That is
// written as loops, because software renderers skip the rest of a loop, but run both sides of a condition.
float lit(sampler2DShadow depths, vec3 at, vec2 blur, int count) {
    const mat2 turn = mat2(-0.737369, 0.675490, -0.675490, -0.737369);
    vec2 inside = 0.5 + blur - abs(at.xy - 0.5);
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
        key = cosine * lit(key_depths, at, key_blur, KEY_SAMPLES);
    }
    vec3 above = (sky_light * vec4(place + 2.0 * lift * n, 1.0)).xyz * 0.5 + 0.5;
    float open = mix(0.35, 1.0, lit(sky_depths, above, sky_blur, SKY_SAMPLES));
    float up = 0.5 + 0.5 * n.y;
    return key * key_color + up * open * sky_color + (1.0 - up) * ground_color;
}

vec3 encoded(vec3 c) {
    c = clamp(c, 0.0, 1.0);
    return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, c));
}
"""

SURFACE_FRAGMENT = """
#version 330
LIGHT
uniform vec3 eye;
uniform float lift;
uniform bool two_sided;
uniform bool textured;
uniform bool unlit;
uniform vec4 color;
uniform sampler2D image;
uniform float cutoff;
in vec3 place;
in vec3 towards;
in vec4 tint;
in vec2 texel;
in vec3 light_in_front;
in vec3 light_behind;
out vec4 shown;
void main() {
    vec4 base = color * tint;
    if (textured) base *= texture(image, texel);
    if (MASKED && base.a < cutoff) discard;
    float side = 1.0;
    if (two_sided) {
        // Which side is seen, whatever the winding: many meshes are not consistent.
        vec3 flat_normal = cross(dFdx(place), dFdy(place));
        side = dot(flat_normal, eye - place) * dot(flat_normal, towards) < 0.0 ? -1.0 : 1.0;
    }
    vec3 light = vec3(1.0);
    if (!unlit && BY_VERTEX) light = side > 0.0 ? light_in_front : light_behind;
    if (!unlit && !BY_VERTEX) light = irradiance(place, side * normalize(towards), lift);
    shown = vec4(encoded(base.rgb * light), base.a);
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
LIGHT
uniform vec3 middle;
uniform float reach;
uniform float lift;
uniform vec3 color;
uniform bool shadows_only;
in vec3 place;
out vec4 shown;
void main() {
    float far = length(place.xz - middle.xz) / reach;
    if (far > 1.0) discard;
    float fade = 1.0 - smoothstep(0.25, 1.0, far);
    vec3 full = key_direction.y * key_color + sky_color;
    vec3 share = irradiance(place, vec3(0.0, 1.0, 0.0), lift) / full;
    if (shadows_only) shown = vec4(0.0, 0.0, 0.0, fade * (1.0 - encoded(share).g));
    else shown = vec4(encoded(color * share), fade);
}
"""

PICTURE_VERTEX = """
#version 330
in vec2 corner;
out vec2 texel;
void main() {
    texel = 0.5 + 0.5 * corner;
    gl_Position = vec4(corner, 0.0, 1.0);
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
