// A passage looked up in a table: axes and values are roots of responses relative to a white.
//
//     u = (response_from_XYZ XYZ)^(3/8)                 0 to 1; the host has put the matrix, which
//                                                      takes TOP whites to 1, into XYZ_from_layer
//                                                      and backdrop_XYZ
//     linear = linear_from_response table(u)^3
//
// Linear between NODES nodes along each axis.
// NumPy twin: volspec/appearance/table.py, TablePassage.apply.
//
// Reads   table    RGBA float: red runs fastest, blue slowest (shaders/nodes.frag or the host
//                  fills it); filtered linearly
//         passage  linear_from_response, in double precision on the host whenever the white changes
// Host sets NODES.

struct Passage {
    mat3 linear_from_response;
};
uniform Passage passage;
uniform highp sampler3D table;

vec3 displayed_from_scene(vec3 responses) {
    // x^(3/8) by roots alone, which cost less than a power.
    vec3 fourth = sqrt(sqrt(clamp(responses, 0.0, 1.0))), u = fourth * sqrt(fourth);
    // The first and last nodes lie in the middles of their texels.
    u = u * (float(NODES - 1) / float(NODES)) + 0.5 / float(NODES);
    vec3 root = textureLod(table, u, 0.0).rgb;
    return passage.linear_from_response * (root * root * root);
}
