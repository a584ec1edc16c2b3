// Recompose a coefficient image from its layers of opacity: one pass per change of opacities.
//
//     left = T exp(-Σ s_k τ_k),   C_gk += (T - left) s_k τ_k f_gk / Σ s_k τ_k,
//     white_g += (T - left) gloss_g,   T = left                      near to far
//
// and fade (C as cast - C at scale 1) is added. The result replaces what relight.frag reads.
//
// With DEPTH, layers are cut, and seen through fog F(d) = exp(-fog.x (d - fog.y)), which adds
//
//     white_g += fog_light_g T (F(d_i) - F(d_j))    between layers i and j, to the cut's far end.
//
// NumPy twin: volspec/image/layers.py (OpacityLayers.recompose), image.py (recompose), and
// depth.py with DEPTH.
//
// Reads   layers, scales and, with DEPTH, cuts and fog: include/opacity.glsl.
//         base      texture array with the result's slices: the picture as cast if DIFFERENCE,
//                   else its difference from its layers at scale 1.
//         fade      0 to 1.
// Writes  recomposed  SLICES_DRAWN slices of channels and alpha from FIRST_SLICE on, as in
//                   relight.frag; if DIFFERENCE, what the picture as cast has and its layers lack.
// Host    FIRST_SLICE, SLICES_DRAWN, DIFFERENCE, and what include/opacity.glsl takes.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2DArray;
#endif

#include "opacity.glsl"

uniform sampler2DArray base;
uniform float fade;

layout(location = 0) out vec4 recomposed[SLICES_DRAWN];

// Channels of a light group; white is last, in a place of its own if there are four materials.
struct Group {
    vec4 channels;
    float white, through;
};

// Loops hold vectors alone: arrays that a loop indexes cost software devices twenty times as much.
Group group(ivec2 pixel, int g) {
    Group made = Group(vec4(0.0), 0.0, 1.0);
#if DEPTH
    float stretch = stretch_of(gl_FragCoord.xy - 0.5 * vec2(textureSize(layers, 0).xy));
    float lit = 1.0, fogged = 0.0;
#endif
    int count = layers_of(pixel);
    for (int layer = 0; layer < count; ++layer) {
        int slice = layer * TEXELS;
        vec4 tau = scaled_depths(pixel, slice);
        float total = dot(tau, vec4(1.0)), own = total;
        if (total <= 0.0) continue;
#if DEPTH
        vec3 slab = slab_of(pixel, slice, total, stretch);
        total = slab.x;
        if (total <= 0.0) continue;
        float clear = min(fog_clear(slab.y), lit);
        fogged += made.through * (lit - clear);
        lit = clear;
#endif
        float seen = made.through * opacity_of(total);
        made.through -= seen;
#if DEPTH
        seen *= clear;
#endif
        Light light = light_of(pixel, slice, g);
        made.channels += seen / own * tau * light.shade;
        made.white += seen * light.gloss;
    }
#if DEPTH
    float left = fog_clear(stretch * cut_mm.y);
    fogged += made.through * (lit - left);
    made.through *= left;
    made.white += fog_light[g] * fogged;
#endif
    return made;
}

// Channel n of the groups `made`; opacity follows, and then 0. Constant indices, as above.
#define GROUP(n) made[min((n) / (MATERIALS + 1), GROUPS - 1)]
#define CHANNEL(n) ((n) > CHANNELS ? 0.0 : (n) == CHANNELS ? 1.0 - made[0].through \
    : (n) % (MATERIALS + 1) == MATERIALS ? GROUP(n).white \
    : GROUP(n).channels[min((n) % (MATERIALS + 1), 3)])
#if DIFFERENCE
#define RESULT(own, now, n) own - now
#else
// Opacity is at most 1.
#define RESULT(own, now, n) \
    clamp(now + fade * own, 0.0, (n) == CHANNELS ? 1.0 : 3.0e38)
#endif
#define DRAW(j) { \
    vec4 own = texelFetch(base, ivec3(pixel, FIRST_SLICE + j), 0); \
    const int n = 4 * (FIRST_SLICE + j); \
    recomposed[j] = vec4( \
        RESULT(own.x, CHANNEL(n), n), RESULT(own.y, CHANNEL(n + 1), n + 1), \
        RESULT(own.z, CHANNEL(n + 2), n + 2), RESULT(own.w, CHANNEL(n + 3), n + 3)); \
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Group made[GROUPS];
    made[0] = group(pixel, 0);
    for (int g = 1; g < GROUPS; ++g) made[g] = group(pixel, g);
    DRAW(0)
#if SLICES_DRAWN > 1
    DRAW(1)
#endif
#if SLICES_DRAWN > 2
    DRAW(2)
#endif
#if SLICES_DRAWN > 3
    DRAW(3)
#endif
}
