// Combine both eyes' frames: next to each other, or as an anaglyph that is mixed in linear light.
//
//     code = encode(clamp(left_mix decode(left) + right_mix decode(right), 0, 1))
//
// NumPy twin: volspec/relight/stereo.py (Stereo.combine).
//
// Reads   left, right   frames of equal size, codes of the display; SIDE_BY_SIDE shows left left.
//         left_mix, right_mix, corner (of the result, in pixels).
// Writes  colour        codes.
// Host    SIDE_BY_SIDE (1 or 0), and the display of display.glsl.
//
// Valid for `330 core` and `300 es`; the host writes the version line.
#ifdef GL_ES
precision highp float;
precision highp int;
precision highp sampler2D;
#endif

#include "display.glsl"

uniform sampler2D left, right;
uniform mat3 left_mix, right_mix;
uniform vec2 corner;

layout(location = 0) out vec4 colour;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy - corner);
#if SIDE_BY_SIDE
    int width = textureSize(left, 0).x;
    colour = at.x < width ? texelFetch(left, at, 0) : texelFetch(right, at - ivec2(width, 0), 0);
#else
    vec3 mixed = left_mix * decode(texelFetch(left, at, 0).rgb)
        + right_mix * decode(texelFetch(right, at, 0).rgb);
    colour = vec4(encode(mixed), 1.0);
#endif
}
