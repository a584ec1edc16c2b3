// A passage looked up in a table: axes and values are cube roots of responses relative to a white.
//
//     u = (response_from_XYZ XYZ)^(1/3) / TOP          0 to 1; the host has put the matrix into
//                                                     XYZ_from_layer and backdrop_XYZ
//     linear = linear_from_response table(u)^3
//
// Linear between NODES nodes along each axis: two bilinear looks, into the slices below and above.
// NumPy twin: volspec/appearance/table.py, TablePassage.apply.
//
// Reads   table    RGBA float, NODES slices of NODES × NODES side by side: red runs fastest, green
//                  along y, blue from slice to slice (shaders/nodes.frag or the host fills it);
//                  filtered linearly
//         passage  linear_from_response, in double precision on the host whenever the white changes
// Host sets NODES, TOP.

struct Passage {
    mat3 linear_from_response;
};
uniform Passage passage;
uniform highp sampler2D table;

vec3 displayed_from_scene(vec3 responses) {
    const float LAST = float(NODES - 1);
    vec3 u = pow(clamp(responses, 0.0, TOP * TOP * TOP), vec3(1.0 / 3.0)) * (LAST / TOP);
    float below = min(floor(u.z), LAST - 1.0);
    // Within a slice no look reaches the next one's texels.
    vec2 at = vec2(below * float(NODES) + u.x + 0.5, u.y + 0.5);
    const vec2 size = vec2(NODES * NODES, NODES);
    vec3 root = mix(textureLod(table, at / size, 0.0).rgb,
                    textureLod(table, (at + vec2(NODES, 0)) / size, 0.0).rgb, u.z - below);
    return passage.linear_from_response * (root * root * root);
}
