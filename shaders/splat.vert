// Splat a picture's layers of opacity into the view of a camera nearby: a layer is up to four points,
// evenly spaced in its slab, which are drawn far to near and blended by (one, one - alpha).
//
//     p' = M (u w, v w, z) - e,   x = (p'_xy / w' + s) / pitch,   w = 1 + z / distance
//
// u, v being a pixel's place in the target's plane and z the layer's depth behind it. The optical
// depth grows by (w / w')², as the area of what a pixel covers shrinks. Through a part of a lens, what
// is out of focus is as wide as the circle that the part makes of a point.
//
// NumPy twin: volspec/image/reproject.py (Warp.places); kernel: kernels/reproject.cl.
//
// Reads   point      28 bits of layer · width · height + pixel, row by row; from there on two of the
//                    layer's points less one, and two of this point's number.
//         layers, scales, cuts and fog: include/opacity.glsl, with DEPTH.
//         turn       M, of the camera's axes: across, down, ahead.
//         eye_mm     e across and down; and s, by which the picture is shifted.
//         camera     its distance and 1 / distance (0 for parallel rays); a pixel's pitch there, mm.
//         lens       circle of what is infinitely far, pixels; and the distance in focus, mm.
// Writes  place      in the view, pixels; its tent's half width; tau; three channels of each target
//                    from FIRST_TARGET on.
// Host    FIRST_TARGET, TARGETS_DRAWN, MAX_RADIUS (of the device's points), and what include/opacity.glsl takes.
//
// Valid for `300 es`; the host writes the version line.
precision highp float;
precision highp int;
precision highp sampler2DArray;

#include "opacity.glsl"

in uint point;

uniform mat3 turn;
uniform vec4 eye_mm;
uniform vec3 camera;
uniform vec2 lens;

flat out vec3 place;
flat out float tau;
flat out vec3 colours[TARGETS_DRAWN];

// Nearer to the camera, as a fraction of its distance, nothing is shown.
const float NEAR = 1e-3;

void main() {
    ivec2 size = textureSize(layers, 0).xy;
    int at = int(point & 0xfffffffu), pixels = size.x * size.y, slice = at / pixels * TEXELS;
    float parts = float(point >> 28 & 3u) + 1.0, part = float(point >> 30);
    ivec2 pixel = ivec2(at % pixels % size.x, at % pixels / size.x);
    vec2 middle = 0.5 * vec2(size - 1), from_middle = vec2(pixel) - middle;
    float stretch = stretch_of(from_middle);
    vec4 depths = scaled_depths(pixel, slice);
    float own = dot(depths, vec4(1.0));
    vec3 slab = slab_of(pixel, slice, own, stretch);
    if (parts > 1.0) slab.y += slab.z * ((part + 0.5) / parts - mean_position(slab.x));
    float ahead = slab.y / stretch - camera.x, wider = 1.0 + ahead * camera.y;
    vec3 seen = turn * vec3(from_middle * camera.z * wider, ahead) - vec3(eye_mm.xy, 0.0);
    float w = 1.0 + seen.z * camera.y;
    if (slab.x <= 0.0 || w < NEAR) {
        gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
        return;
    }
    float blur = lens.x * abs(1.0 - lens.y / (camera.x + seen.z));
    float radius = clamp(blur, 1.0, MAX_RADIUS);
    place = vec3(middle + (seen.xy / w + eye_mm.zw) / camera.z, radius);
    float magnified = wider / w / radius;
    tau = slab.x / parts * magnified * magnified;
    float clear = fog_clear(slab.y);
    float channels[3 * TARGETS_DRAWN + MATERIALS + 1];
    const int first = 3 * FIRST_TARGET;
    for (int g = 0; g < GROUPS; ++g) {
        int n = g * (MATERIALS + 1) - first;
        if (n <= -MATERIALS - 1 || n >= 3 * TARGETS_DRAWN) continue;
        Light light = light_of(pixel, slice, g);
        for (int k = 0; k < MATERIALS; ++k) {
            if (n + k >= 0) channels[n + k] = clear * depths[k] / own * light.shade[k];
        }
        n += MATERIALS;
        if (n >= 0) channels[n] = clear * light.gloss + (1.0 - clear) * fog_light[g];
    }
    for (int i = 0; i < TARGETS_DRAWN; ++i) {
        colours[i] = vec3(channels[3 * i], channels[3 * i + 1], channels[3 * i + 2]);
    }
    gl_PointSize = 2.0 * radius;
    gl_Position = vec4(2.0 * (place.xy + 0.5) / vec2(size) - 1.0, 0.0, 1.0);
}
