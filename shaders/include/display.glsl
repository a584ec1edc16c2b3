// The display's encoding: clip to the gamut, then its transfer function, a power with a toe.
//
// NumPy twin: volspec/appearance/curves.py, Transfer.encode, after the clip.
// Host sets OETF_TOE (0 without a toe), OETF_SLOPE, OETF_GAIN, OETF_POWER.

vec3 encode(vec3 linear) {
    vec3 x = clamp(linear, 0.0, 1.0);
    vec3 curve = OETF_GAIN * pow(x, vec3(OETF_POWER)) - (OETF_GAIN - 1.0);
    return mix(curve, OETF_SLOPE * x, lessThanEqual(x, vec3(OETF_TOE)));
}
