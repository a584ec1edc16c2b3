// A curve per response, between two matrices: RLAB and the adaptations that are not linear.
//
//     r  = response_from_XYZ XYZ
//     r' = (gain (r + shift)^power + offset)^outer      powers with the sign of their base
//     linear = linear_from_response r'
//
// NumPy twin: volspec/appearance/transforms.py, CurveTransform.apply. Total: finite input gives
// finite output.
//
// Reads   view_transform, computed by the host in double precision when the white changes.
// Host sets OUTER if the outer power is not 1.

struct ViewTransform {
    mat3 response_from_XYZ;
    mat3 linear_from_response;  // the display's inverse, to linear RGB
    vec3 gain;
    vec3 power;
    vec3 shift;
    vec3 offset;
#if OUTER
    vec3 outer;
#endif
};
uniform ViewTransform view_transform;

vec3 signed_power(vec3 x, vec3 p) { return sign(x) * pow(abs(x), p); }

vec3 displayed_from_scene(vec3 XYZ) {
    vec3 r = view_transform.response_from_XYZ * XYZ + view_transform.shift;
    r = view_transform.gain * signed_power(r, view_transform.power) + view_transform.offset;
#if OUTER
    r = signed_power(r, view_transform.outer);
#endif
    return view_transform.linear_from_response * r;
}
