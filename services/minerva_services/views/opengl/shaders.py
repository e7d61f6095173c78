"""GLSL 3.30 shaders.

Lit surfaces write their brightness into the picture's alpha channel. Transparent surfaces take that
brightness as their own, so shadows continue below them and are sampled only once. `#include NAME`
stands for the text of a constant of this module, see `complete`.
"""

import re

_FRAME = """
#version 330
layout(std140) uniform Frame {
    mat4 camera;      // from metres to the picture
    mat4 sun;         // from metres to the sun's picture, 0 to 1
    vec4 eye;         // metres
    vec4 light;       // towards the sun; w: share of it that shadows block
    vec4 page;        // width and height in pixels; pixels per metre at a distance of a metre
};
"""

_PLACED = """
#include _FRAME
out vec3 place;
out vec3 normal;
out vec3 shadow;      // position in the shadow map
void put(vec3 where, vec3 facing) {
    place = where;
    normal = facing;
    shadow = (sun * vec4(where + facing * 0.004 * eye.w, 1.0)).xyz;
    gl_Position = camera * vec4(where, 1.0);
}
"""

_LIT = """
#include _FRAME
in vec3 place;
in vec3 normal;
in vec3 shadow;
out vec4 pixel;
uniform sampler2DShadow shade;
const vec3 SKY = vec3(0.50, 0.535, 0.60), EARTH = vec3(0.44, 0.415, 0.39);

// Scaled such that a level surface in full sunlight has exactly its own colour.
vec4 shone(vec3 color, vec3 facing, float open) {
    vec3 ambient = mix(EARTH, SKY, facing.z * 0.5 + 0.5) * open;
    float lit = mix(1.0, texture(shade, shadow), light.w);
    vec3 all = ambient + (vec3(1.0) - SKY) * (max(dot(facing, light.xyz), 0.0) / light.z * lit);
    return vec4(sqrt(min(color * color * all, 1.0)), sqrt(min(all.g, 1.0)));
}
"""

_BACKDROP = """
vec3 backdrop(float height) {
    return mix(vec3(0.910, 0.918, 0.925), vec3(0.80, 0.835, 0.87), height);
}
"""

BACKDROP_VERTEX = """
#version 330
void main() {
    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    gl_Position = vec4(corner, 1.0, 1.0);
}
"""

BACKDROP_FRAGMENT = """
#include _FRAME
#include _BACKDROP
out vec4 pixel;
void main() { pixel = vec4(backdrop(gl_FragCoord.y / page.y), 1.0); }
"""

GROUND_VERTEX = """
#include _PLACED
in vec2 corner;
uniform vec4 span;    // centre, half a side, level
void main() { put(vec3(span.xy + corner * span.z, span.w), vec3(0.0, 0.0, 1.0)); }
"""

GROUND_FRAGMENT = """
#include _LIT
#include _BACKDROP
uniform vec4 span;
uniform float step;   // metres between lines
const vec3 COLOR = vec3(0.878, 0.886, 0.894);
void main() {
    vec2 at = place.xy / step, wide = fwidth(at) + 1e-6;
    vec2 off = abs(fract(at - 0.5) - 0.5) / wide;
    float line = max(1.0 - min(off.x, off.y), 0.0) * min(0.3 / max(wide.x, wide.y), 1.0);
    vec3 color = shone(COLOR * (1.0 - 0.1 * line), vec3(0.0, 0.0, 1.0), 1.0).rgb;
    float far = smoothstep(0.3, 1.0, length(place.xy - span.xy) / span.z);
    pixel = vec4(mix(color, backdrop(gl_FragCoord.y / page.y), far), 1.0);
}
"""

TILES_VERTEX = """
#include _PLACED
in vec2 corner;       // 0 to 1
out vec2 spot;
uniform mat3 lying;   // from corners to metres
uniform float level;
void main() {
    spot = corner;
    put(vec3((lying * vec3(corner, 1.0)).xy, level), vec3(0.0, 0.0, 1.0));
}
"""

TILES_FRAGMENT = """
#include _LIT
in vec2 spot;
uniform sampler2D colors;
uniform sampler2D openness;
void main() {
    float open = mix(0.5, 1.0, texture(openness, spot).r);
    pixel = shone(texture(colors, spot).rgb, vec3(0.0, 0.0, 1.0), open);
}
"""

OVERLAY_VERTEX = """
#include _FRAME
in vec2 corner;
out vec2 spot;
uniform mat3 lying;
uniform float level;
void main() {
    spot = corner;
    gl_Position = camera * vec4((lying * vec3(corner, 1.0)).xy, level, 1.0);
}
"""

DRAPED_VERTEX = """
#include _FRAME
in vec3 where;
out vec2 spot;
uniform mat3 over;    // from metres to corners
uniform float level;
void main() {
    spot = (over * vec3(where.xy, 1.0)).xy;
    gl_Position = camera * vec4(where + vec3(0.0, 0.0, level), 1.0);
}
"""

OVERLAY_FRAGMENT = """
#version 330
in vec2 spot;
out vec4 pixel;
uniform sampler2D colors;
void main() {
    vec4 color = texture(colors, spot);
    float inside = spot == clamp(spot, 0.0, 1.0) ? 1.0 : 0.0;
    pixel = vec4(color.rgb * color.a, color.a) * inside;
}
"""

WALL_VERTEX = """
#include _PLACED
in vec3 where;
in vec3 facing;
void main() { put(where, facing); }
"""

WALL_FRAGMENT = """
#include _LIT
uniform vec3 top_color;
uniform vec3 side_color;
uniform vec2 rise;    // lowest and highest z
void main() {
    bool top = normal.z > 0.5;
    float up = clamp((place.z - rise.x) / (rise.y - rise.x), 0.0, 1.0);
    pixel = shone(top ? top_color : side_color, normal, top ? 1.0 : mix(0.6, 1.0, sqrt(up)));
}
"""

WALL_SHADOW = """
#include _FRAME
in vec3 where;
void main() { gl_Position = vec4((sun * vec4(where, 1.0)).xyz * 2.0 - 1.0, 1.0); }
"""

_DRUM = """
in vec2 way;          // direction from the axis
in vec3 edge;         // offsets inwards and downwards, and height: 0 or 1
in vec2 facing;       // outwards, upwards
in vec4 stand;        // x, y, level of its base, angle
in vec2 size;         // radius, height
in vec4 paint;        // colour; whether it has a mark

// Distant discs are enlarged to 2.5 pixels, so that they do not vanish.
vec2 grown() {
    float pixels = size.x * page.z / max(distance(eye.xyz, stand.xyz), 1e-6);
    return size * max(1.0, 2.5 / pixels);
}
float bevel(vec2 grown) { return min(grown.x * 0.22, grown.y * 0.25); }
vec3 spot() {
    vec2 large = grown();
    float inset = bevel(large), radius = large.x - edge.x * inset;
    return vec3(stand.xy + way * radius, stand.z + edge.z * large.y - edge.y * inset);
}
"""

DRUM_VERTEX = """
#include _PLACED
#include _DRUM
out vec2 inner;
flat out vec4 tint;
void main() {
    float turn = radians(stand.w), reach = 1.0 - edge.x * bevel(size) / size.x;
    inner = mat2(cos(turn), -sin(turn), sin(turn), cos(turn)) * way * reach;
    tint = paint;
    put(spot(), vec3(way * facing.x, facing.y));
}
"""

DRUM_FRAGMENT = """
#include _LIT
in vec2 inner;
flat in vec4 tint;
// The heading mark: an arrow head that points along the disc's own x axis.
const vec2 TIP = vec2(0.78, 0.0), WING = vec2(-0.536, 0.45), NOTCH = vec2(-0.28, 0.0);
float beyond(vec2 at, vec2 from, vec2 to) {
    vec2 along = normalize(to - from);
    return (at.x - from.x) * along.y - (at.y - from.y) * along.x;
}
void main() {
    vec3 facing = normalize(normal);
    vec2 at = vec2(inner.x, abs(inner.y));
    float off = max(beyond(at, TIP, WING), beyond(at, WING, NOTCH));
    float mark = clamp(0.5 - off / max(fwidth(off), 1e-5), 0.0, 1.0);
    float shown = mark * step(0.5, tint.a) * step(0.5, facing.z);
    pixel = shone(mix(tint.rgb, vec3(1.0), shown), facing, 1.0);
}
"""

DRUM_SHADOW = """
#include _FRAME
#include _DRUM
void main() { gl_Position = vec4((sun * vec4(spot(), 1.0)).xyz * 2.0 - 1.0, 1.0); }
"""

_COPY = """
in vec3 corner;
in vec3 stand;
in vec4 turn;         // w, x, y, z
in vec3 size;
vec3 turned(vec3 at) { return at + 2.0 * cross(turn.yzw, cross(turn.yzw, at) + turn.x * at); }
vec3 spot() { return stand + turned(corner * size); }
"""

COPY_VERTEX = """
#include _PLACED
#include _COPY
in vec3 facing;
in vec4 paint;
flat out vec3 tint;
void main() {
    tint = paint.rgb;
    put(spot(), turned(normalize(facing / size)));
}
"""

COPY_SHADOW = """
#include _FRAME
#include _COPY
void main() { gl_Position = vec4((sun * vec4(spot(), 1.0)).xyz * 2.0 - 1.0, 1.0); }
"""

_PIN = """
in vec4 shape;        // x, y in radii, height, vertical offset in radii
in vec2 foot;
uniform vec2 size;    // radius, height
vec3 spot() {
    return vec3(foot + shape.xy * size.x, shape.z * size.y + shape.w * size.x);
}
"""

PIN_VERTEX = """
#include _PLACED
#include _PIN
in vec3 facing;
in vec3 paint;
flat out vec3 tint;
void main() {
    tint = paint;
    put(spot(), facing);
}
"""

TINTED_FRAGMENT = """
#include _LIT
flat in vec3 tint;
void main() { pixel = shone(tint, normalize(normal), 1.0); }
"""

PIN_SHADOW = """
#include _FRAME
#include _PIN
void main() { gl_Position = vec4((sun * vec4(spot(), 1.0)).xyz * 2.0 - 1.0, 1.0); }
"""

RIBBON_VERTEX = """
#include _PLACED
in vec3 where;
in vec3 off;          // sideways in half widths; metres along the line
in vec4 paint;        // colour; width in metres, negative if dashed
out float along;
flat out vec4 tint;
void main() {
    float metre = page.z / max(distance(eye.xyz, where), 1e-6);
    float wide = max(abs(paint.a), 1.6 / metre);
    along = off.z / wide;
    tint = paint;
    put(vec3(where.xy + off.xy * wide * 0.5, where.z), vec3(0.0, 0.0, 1.0));
}
"""

RIBBON_FRAGMENT = """
#include _LIT
in float along;
flat in vec4 tint;
void main() {
    if (tint.a < 0.0 && fract(along / 5.0) > 0.56) discard;
    pixel = shone(tint.rgb, vec3(0.0, 0.0, 1.0), 1.0);
}
"""

BEAM_VERTEX = """
#include _FRAME
in vec3 where;
in float far;         // 0 at the laser, 1 at the end
out float away;
void main() {
    away = far;
    gl_Position = camera * vec4(where, 1.0);
}
"""

BEAM_FRAGMENT = """
#version 330
in float away;
out vec4 pixel;
uniform vec4 color;
void main() {
    float opacity = color.a * mix(1.0, 0.45, away);
    pixel = vec4(color.rgb * opacity, opacity);
}
"""

SIGN_VERTEX = """
#include _FRAME
uniform vec4 sheet;   // left, top, width, height in pixels
out vec2 spot;
void main() {
    spot = vec2(gl_VertexID & 1, gl_VertexID >> 1);
    vec2 at = (sheet.xy + spot * sheet.zw) / page.xy * 2.0 - 1.0;
    gl_Position = vec4(at.x, -at.y, 0.0, 1.0);
}
"""

SIGN_FRAGMENT = """
#version 330
in vec2 spot;
out vec4 pixel;
uniform sampler2D letters;
void main() { pixel = texture(letters, spot); }
"""

NOTHING = """
#version 330
void main() {}
"""


def complete(shader: str) -> str:
    """A shader with its includes inserted, also nested ones: OpenGL knows no `#include`."""
    return re.sub(r"#include (\w+)\n", lambda name: complete(_INCLUDES[name[1]]), shader)


_INCLUDES = {
    "_FRAME": _FRAME, "_PLACED": _PLACED, "_LIT": _LIT,
    "_BACKDROP": _BACKDROP, "_DRUM": _DRUM, "_COPY": _COPY, "_PIN": _PIN,
}  # fmt: skip
