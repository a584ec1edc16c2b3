// Recompose a coefficient image from its layers of opacity: one pass per change of opacities.
//
//     left = T exp(-Σ s_k τ_k),   C_gk += (T - left) s_k τ_k f_gk / Σ s_k τ_k,
//     white_g += (T - left) gloss_g,   T = left                      near to far
//
// and fade (C as cast - C at scale 1) is added. The result replaces what relight.frag reads.
//
// Shades and highlights of groups that are SHADOWED or OCCLUDED are kept apart from the light that
// shadows take: they are multiplied by
//
//     1 - v + v p,   p = min(1, gain (1 + Σ s_k (exp(b E_k) - 1))^(-1/b))
//
// With DEPTH, layers are cut, and seen through fog F(d) = exp(-fog.x (d - fog.y)), which adds
//
//     white_g += fog_light_g T (F(d_i) - F(d_j))    between layers i and j, to the cut's far end.
//
// NumPy twin: volspec/raycast/layered.py (OpacityLayers.recompose), image.py (recompose), and
// depth.py with DEPTH.
//
// Reads   layers    texture array of RGBA, TEXELS slices a layer, near to far: τ of up to four
//                   materials; for each light group their shades, and the highlight after them;
//                   four materials leave no place for it: highlights follow, four to a slice.
//                   From slice SHADOWS_AT on two slices for each group's shadow and occlusion: E;
//                   v of the shade and of the highlight, and b.
//                   With EXTENTS a slice more: where it begins, mm beyond nearest_mm; its width.
//         base      texture array with the result's slices: the picture as cast if DIFFERENCE,
//                   else its difference from its layers at scale 1.
//         scales    of the materials' optical depths; the first MATERIALS count.
//         fade      0 to 1.
//         cut_mm, fog (per mm, mm), fog_light, slope (of a pixel to the axis), nearest_mm  if DEPTH.
//         shade_code, gloss_code  if CODED.
// Writes  recomposed  SLICES_DRAWN slices of channels and alpha from FIRST_SLICE on, as in
//                   relight.frag; if DIFFERENCE, what the picture as cast has and its layers lack.
// Host    COUNT (layers), MATERIALS, GROUPS, TEXELS, FIRST_SLICE, SLICES_DRAWN, DIFFERENCE,
//         CODED (1 if the numbers are 8-bit codes c of τ = TAU_CODE c³, shade = shade_code c,
//         gloss = gloss_code c², E = PATH_CODE c³, b = BEND_CODE c³), TAU_CODE, PATH_CODE,
//         BEND_CODE; SHADOWED and OCCLUDED (bits of groups), SHADOWS_AT, OCCLUSION_GAIN, BEND_LEAST
//         and MOST_EXPONENT.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2DArray;
#endif

#ifndef DEPTH
#define DEPTH 0
#endif
#define CHANNELS (GROUPS * (MATERIALS + 1))

uniform sampler2DArray layers, base;
uniform vec4 scales;
uniform float fade;
#if CODED
uniform float shade_code, gloss_code;
#endif

layout(location = 0) out vec4 recomposed[SLICES_DRAWN];

#if DEPTH
uniform vec2 cut_mm, fog;
uniform float fog_light[GROUPS], slope, nearest_mm;

float fog_clear(float distance_mm) {
    return exp(-fog.x * max(distance_mm - fog.y, 0.0));
}

// How deep light goes into a slab, as a fraction of its width.
float mean_position(float tau) {
    if (tau < 0.1) return 0.5 - tau * (1.0 / 12.0 - tau * tau / 720.0);
    return 1.0 / tau - 1.0 / (exp(min(tau, 64.0)) - 1.0);
}
#endif

#if SHADOWED || OCCLUDED
// Fractions of a shade and of a highlight that are taken from it.
vec2 taken(ivec2 pixel, int slice, float gain) {
    vec4 path = texelFetch(layers, ivec3(pixel, slice), 0);
    vec4 part = texelFetch(layers, ivec3(pixel, slice + 1), 0);
#if CODED
    path *= PATH_CODE * path * path;
    part.z *= BEND_CODE * part.z * part.z;
#endif
    float bend = max(part.z, BEND_LEAST);
    vec4 depth = min(bend * path, vec4(MOST_EXPONENT));
    // exp(depth) - 1 loses all precision of small depths.
    vec4 small = depth * (1.0 + depth * (0.5 + depth / 6.0));
    vec4 grown = mix(exp(depth) - 1.0, small, lessThan(depth, vec4(0.02)));
    float passes = exp(-log(1.0 + dot(grown, scales)) / bend);
    return part.xy * (1.0 - min(gain * passes, 1.0));
}
#endif

// Channels of a light group; white is last, in a place of its own if there are four materials.
struct Group {
    vec4 channels;
    float white, through;
};

// Loops hold vectors alone: arrays that a loop indexes cost software devices twenty times as much.
Group group(ivec2 pixel, int g) {
    Group made = Group(vec4(0.0), 0.0, 1.0);
#if DEPTH
    vec2 off_axis = slope * (gl_FragCoord.xy - 0.5 * vec2(textureSize(layers, 0).xy));
    float along = sqrt(1.0 + dot(off_axis, off_axis)), lit = 1.0, fogged = 0.0;
#endif
#if SHADOWED || OCCLUDED
    bool shadowed = ((SHADOWED >> g) & 1) == 1, occluded = ((OCCLUDED >> g) & 1) == 1;
    int shadow_at = SHADOWS_AT;
    for (int i = 0; i < g; ++i) shadow_at += 2 * (((SHADOWED >> i) & 1) + ((OCCLUDED >> i) & 1));
#endif
    for (int layer = 0; layer < COUNT; ++layer) {
        int slice = layer * TEXELS;
        vec4 tau = texelFetch(layers, ivec3(pixel, slice), 0);
#if CODED
        // Unused layers are the last.
        if (tau == vec4(0.0)) break;
        tau *= TAU_CODE * tau * tau;
#endif
        tau *= scales;
        float total = dot(tau, vec4(1.0));
        if (total <= 0.0) continue;
        float own = total;
#if DEPTH
        vec2 extent = texelFetch(layers, ivec3(pixel, slice + TEXELS - 1), 0).xy;
        float begin = nearest_mm + extent.x, end = begin + extent.y;
        float start = max(begin, along * cut_mm.x), stop = min(end, along * cut_mm.y);
        total *= extent.y > 0.0 ? clamp((stop - start) / extent.y, 0.0, 1.0) : float(start <= stop);
        if (total <= 0.0) continue;
        float clear = min(fog_clear(start + (stop - start) * mean_position(total)), lit);
        fogged += made.through * (lit - clear);
        lit = clear;
#endif
        // 1 - exp(-total) loses all precision in faint layers.
        float faint = total * (1.0 - total * (0.5 - total * (1.0 / 6.0 - total / 24.0)));
        float seen = made.through * (total < 0.1 ? faint : 1.0 - exp(-total));
        made.through -= seen;
#if DEPTH
        seen *= clear;
#endif
        vec4 shade = texelFetch(layers, ivec3(pixel, slice + 1 + g), 0);
#if MATERIALS == 4
        vec4 highlights = texelFetch(layers, ivec3(pixel, slice + 1 + GROUPS + g / 4), 0);
        float gloss = dot(highlights, vec4(equal(ivec4(g % 4), ivec4(0, 1, 2, 3))));
#else
        float gloss = shade[MATERIALS];
#endif
#if CODED
        gloss *= gloss_code * gloss;
        shade *= shade_code;
#endif
#if SHADOWED || OCCLUDED
        vec2 kept = vec2(1.0);
        if (shadowed) kept -= taken(pixel, slice + shadow_at, 1.0);
        if (occluded) {
            int at = slice + shadow_at + (shadowed ? 2 : 0);
            kept -= taken(pixel, at, OCCLUSION_GAIN);
        }
        shade *= kept.x;
        gloss *= kept.y;
#endif
        made.channels += seen / own * tau * shade;
        made.white += seen * gloss;
    }
#if DEPTH
    float left = fog_clear(along * cut_mm.y);
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
