// Colours that a display cannot show: chroma reduced at equal lightness and hue, or hatched.
//
//     x, a, b = opponent signals of the compressed responses to the colour
//     x  = clamp(x, 0, top),  (a_g, b_g) = max(x - knee, 0) knee_slope     the grey to move to
//     R0 = RESPONSE_FROM_OPPONENT (x, a_g, b_g)
//     R1 = RESPONSE_FROM_OPPONENT (0, a - a_g, b - b_g)
//     s  : the largest multiple of last_step, by halving, for which linear(R0 + s R1) is shown
//
// The same for every form of view transform: the signals are recomputed from the linear RGB. Only
// pixels outside the display's cube run the search; on software GL every pixel pays for the
// signals and one bisection step.
//
// NumPy twin and derivation: volspec/appearance/gamut_mapping.py. Total: finite input gives finite output.
//
// Reads   gamut  if REDUCE; computed in double precision when the display or the model changes
// Host sets REDUCE, MARK, and the constants of volspec.appearance.gamut_mapping.SHADER_CONSTANTS.

#if REDUCE || MARK
bool is_shown(vec3 linear) {
    return all(greaterThanEqual(linear, vec3(-GAMUT_SLACK)))
        && all(lessThanEqual(linear, vec3(1.0 + GAMUT_SLACK)));
}
#endif

#if REDUCE
struct Gamut {
    mat3 response_from_linear;
    mat3 linear_from_response;
    float top;        // the display white's x
    float knee;       // up to here grey has no chroma
    vec2 knee_slope;
    float last_step;  // step of the last bisection
};
uniform Gamut gamut;

vec3 linear_from_compressed(vec3 R) {
    vec3 size = min(abs(R), vec3(RESPONSE_LIMIT));
    vec3 r = sign(R) * pow(size / (RESPONSE_POLE - size), vec3(1.0 / RESPONSE_POWER));
    return gamut.linear_from_response * r;
}

vec3 reduce_chroma(vec3 linear) {
    vec3 r = gamut.response_from_linear * linear;
    vec3 f = pow(abs(r), vec3(RESPONSE_POWER));
    vec3 R = sign(r) * (RESPONSE_POLE * f / (RESPONSE_HALF + f));
    float x = min(dot(ACHROMATIC, R), gamut.top);
    if (x <= 0.0) return vec3(0.0);
    vec2 grey = max(x - gamut.knee, 0.0) * gamut.knee_slope;
    vec2 way = vec2(dot(OPPONENT_A, R), dot(OPPONENT_B, R)) - grey;
    vec3 R0 = RESPONSE_FROM_OPPONENT * vec3(x, grey);
    vec3 R1 = RESPONSE_FROM_OPPONENT * vec3(0.0, way);
    float s = 0.0;
    // The bound is no constant: unrolled, software GL would run all bisections for all pixels.
    for (float step = 0.5; step >= gamut.last_step; step *= 0.5) {
        if (is_shown(linear_from_compressed(R0 + (s + step) * R1))) s += step;
    }
    return linear_from_compressed(R0 + s * R1);
}
#endif

#if MARK
// Diagonal bands over the colour's own grey, so that form remains and hue cannot be mistaken.
vec3 hatch(vec3 code, ivec2 pixel) {
    bool band = (pixel.x + pixel.y) % HATCH_PERIOD < HATCH_WIDTH;
    return band ? HATCH_CODE : vec3(dot(code, vec3(1.0 / 3.0)));
}
#endif
