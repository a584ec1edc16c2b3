// The display's code values: its transfer function, a power with a toe, odd about 0; and what an
// observer with a colour-vision deficiency sees on it.
//
// NumPy twins: volspec/appearance/display/spaces.py, Transfer.encode and decode;
//              volspec/appearance/display/deficiency.py, Simulation.apply.
// Reads   deficiency  if SIMULATE; computed when the deficiency, its severity or the display changes
// Host sets OETF_TOE (0 without a toe), OETF_SLOPE, OETF_GAIN, OETF_POWER, SIMULATE.

vec3 curve(vec3 x) {
    vec3 power = OETF_GAIN * pow(x, vec3(OETF_POWER)) - (OETF_GAIN - 1.0);
    return mix(power, OETF_SLOPE * x, lessThanEqual(x, vec3(OETF_TOE)));
}

// Codes of a colour clipped to the display's gamut.
vec3 encode(vec3 linear) { return curve(clamp(linear, 0.0, 1.0)); }

// Codes of any linear light, and back.
vec3 encode_beyond(vec3 linear) { return sign(linear) * curve(abs(linear)); }

vec3 decode(vec3 code) {
    vec3 x = abs(code);
    vec3 power = pow((x + OETF_GAIN - 1.0) / OETF_GAIN, vec3(1.0 / OETF_POWER));
    vec3 linear = mix(power, x / OETF_SLOPE, lessThanEqual(x, vec3(OETF_SLOPE * OETF_TOE)));
    return sign(code) * linear;
}

#if SIMULATE
// A linear map of linear RGB on each side of a plane, on which both agree.
struct Deficiency {
    mat3 above;  // where dot(plane, linear) >= 0
    mat3 below;
    vec3 plane;
};
uniform Deficiency deficiency;

vec3 simulated(vec3 linear) {
    return (dot(deficiency.plane, linear) >= 0.0 ? deficiency.above : deficiency.below) * linear;
}
#endif
