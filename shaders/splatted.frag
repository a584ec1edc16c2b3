// Channels of a splatted view, as relight.frag reads them, from three to a slice; and the fog that
// is behind all layers.
//
// NumPy twin: volspec/image/depth.py (fog_behind).
//
// Reads   splatted    slices of shaders/splat.frag's sums.
//         cuts and fog: include/opacity.glsl, with DEPTH.
// Writes  recomposed  SLICES_DRAWN slices from FIRST_SLICE on.
// Host    FIRST_SLICE, SLICES_DRAWN, and what include/opacity.glsl takes.
//
// Valid for `300 es`; the host writes the version line.
precision highp float;
precision highp int;
precision highp sampler2DArray;

#include "opacity.glsl"

uniform sampler2DArray splatted;

layout(location = 0) out vec4 recomposed[SLICES_DRAWN];

// Channel n; opacity follows them, and then 0.
float channel(ivec2 pixel, int n) {
    vec4 sums = texelFetch(splatted, ivec3(pixel, min(n, CHANNELS - 1) / 3), 0);
    vec2 from_middle = gl_FragCoord.xy - 0.5 * vec2(textureSize(splatted, 0).xy);
    float added = (1.0 - sums.w) * (1.0 - fog_clear(stretch_of(from_middle) * cut_mm.y));
    if (n > CHANNELS) return 0.0;
    if (n == CHANNELS) return sums.w + added;
    float white = n % (MATERIALS + 1) == MATERIALS ? fog_light[n / (MATERIALS + 1)] : 0.0;
    return sums[n % 3] + added * white;
}

#define DRAW(j) { \
    const int n = 4 * (FIRST_SLICE + j); \
    recomposed[j] = vec4(channel(pixel, n), channel(pixel, n + 1), channel(pixel, n + 2), \
        channel(pixel, n + 3)); \
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
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
