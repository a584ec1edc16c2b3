// A curve per response, between two matrices: RLAB and the adaptations that are not linear.
//
//     r  = response_from_XYZ XYZ
//     r' = (gain (r + shift)^power + offset)^outer      powers with the sign of their base
//     linear = linear_from_response r'
//
// NumPy twin: volspec/appearance/passages.py, CurvePassage.apply. Total: finite input gives finite
// output.
//
// Reads   passage, computed by the host in double precision whenever the white changes.
// Host sets OUTER where the outer power is not 1.

struct Passage {
    mat3 response_from_XYZ;
    mat3 linear_from_response;  // the display's inverse of it, to linear RGB
    vec3 gain;
    vec3 power;
    vec3 shift;
    vec3 offset;
#if OUTER
    vec3 outer;
#endif
};
uniform Passage passage;

vec3 signed_power(vec3 x, vec3 p) { return sign(x) * pow(abs(x), p); }

vec3 displayed_from_scene(vec3 XYZ) {
    vec3 r = passage.response_from_XYZ * XYZ + passage.shift;
    r = passage.gain * signed_power(r, passage.power) + passage.offset;
#if OUTER
    r = signed_power(r, passage.outer);
#endif
    return passage.linear_from_response * r;
}
