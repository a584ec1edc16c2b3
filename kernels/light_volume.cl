// The light volume: the fraction of each source's light that reaches the nodes of a coarse grid.
//
//     σ = mean of −log(1 − opacity(v)) / reference step over the voxels nearest to a node
//     T = exp(−∫ σ ds) towards a light;  open = min(1, 2 · mean of T over the sphere)
//
// NumPy twin: volspec/raycast/reference.py (layers). Same steps, same order.
//
// Launch: 1-D, whole work-groups. `extinction` has a work-item per node of the padded grid; then,
// for each layer, `parallel` or `converging` has one per packet of LANES nodes along x.
//
// The padded grid float[nz + 2][ny + 2][nx + 2 LANES] holds σ per cell, 0 in the padding: packets
// read whole vectors at any shift, and light that leaves the grid is not absorbed.
//
// extinction  reads   voxels VOXEL[nz][ny][nx]; spans Span[nx + ny + nz], the voxels per node,
//                     axis by axis; grid Grid, settings; table float2[rows][entries]: σ
//                     per cell and difference to the next entry; BY_SURFACE: (level, optical depth)
//             and with BY_MASK the mask's codes, its rows' Curve[], in `table`, and Mask
//             writes  the padded grid
// parallel    reads   the padded grid; steps Step[], by direction; ends int[] per direction
// converging  reads   the padded grid; float4[], places of the light
//             write   a layer of layers ushort[layer][nz][ny][nx], 65535 if all light arrives; or one
//                     of several numbers of each node; blocked multiplies one
//
// The host sets LANES, VOXEL, KIND (one of the five below) and the structs Span, Grid, Step, Curve
// and Mask (volspec/raycast/launch/light_volume.py and kernel_arguments.py describe their members).

#include "lanes.clh"
#include "mask.clh"

#define BY_VALUE 0
#define BY_GRADIENT 1  // and by value
#define BY_LABEL 2     // entry i is for label i; labels beyond the table are transparent
#define BY_SURFACE 3   // levels
#define BY_MASK 4      // by value, of the row of the mask's nearest voxel

// Optical depth at which the transmittance is below half of 1/65535.
#define DARK 12.0f

#if KIND == BY_SURFACE || KIND == BY_GRADIENT
// A voxel, its neighbours along an axis, and which of them there are.
typedef struct { float before, here, after; int has_before, has_after; } Line;

static inline Line line_at(__global const VOXEL *voxels, size_t at, int index, int count, int stride,
                           float least) {
    Line v;
    v.here = voxels[at];
    v.before = index > 0 ? voxels[at - stride] : v.here;
    v.after = index + 1 < count ? voxels[at + stride] : v.here;
    v.has_before = index > 0 && v.before >= least;
    v.has_after = index + 1 < count && v.after >= least;
    return v;
}

// Twice the slope per voxel, of the voxels that there are.
static inline float slope2(const Line *v) {
    const float rise = (v->has_after ? v->after : v->here) - (v->has_before ? v->before : v->here);
    return v->has_before && v->has_after ? rise : 2.0f * rise;
}

// The lines along x, y and z through voxel (x, y, z), flat index `at`.
static inline void lines_at(__global const VOXEL *voxels, const Grid *grid, int x, int y, int z,
                            size_t at, Line lines[3]) {
    const int4 count = grid->voxels;
    lines[0] = line_at(voxels, at, x, count.x, 1, grid->least);
    lines[1] = line_at(voxels, at, y, count.y, count.x, grid->least);
    lines[2] = line_at(voxels, at, z, count.z, count.x * count.y, grid->least);
}
#endif

#if KIND == BY_SURFACE
// Optical depth of the surfaces that are crossed on the way to a neighbour, each by its nearness.
static inline float crossed(__global const float2 *table, int last, float here, float next) {
    float depth = 0.0f;
    for (int s = 0; s <= last; ++s) {
        const float2 surface = table[s];
        if ((here < surface.x) != (next < surface.x))
            depth += surface.y * (1.0f - (surface.x - here) / (next - here));
    }
    return depth;
}

// Extinction at voxel (x, y, z), flat index `at`: of the surfaces that cross the edges to its
// neighbours, whose area on an edge is their normal's component along it.
static inline float extinction_at(__global const VOXEL *voxels, __global const float2 *table,
                                  const Grid *grid, int x, int y, int z, size_t at) {
    Line lines[3];
    lines_at(voxels, grid, x, y, z, at, lines);
    if (lines[0].here < grid->least) return 0.0f;
    const float edge[3] = {grid->edge.x, grid->edge.y, grid->edge.z};
    float square = 0.0f, squares[3];
    UNROLL(a, 3) {
        const float slope = 0.5f * slope2(&lines[a]) * grid->domain_scale * edge[a];
        squares[a] = slope * slope;
        square += squares[a];
    }
    float sum = 0.0f;
    UNROLL(a, 3) {
        const Line *v = &lines[a];
        UNROLL(side, 2) {
            if (!(side ? v->has_after : v->has_before)) continue;
            const float next = side ? v->after : v->before;
            const float depth = crossed(table, grid->last_entry, v->here, next);
            if (depth == 0.0f) continue;
            const float rise = fabs(next - v->here) * grid->domain_scale * edge[a];
            const float steep = MAX(square - squares[a], 0.0f) + rise * rise;
            sum += depth * edge[a] * rise * rsqrt(MAX(steep, 1e-30f));
        }
    }
    return sum;
}
#else
static inline float interpolate_entry(__global const float2 *row, int j, float f) {
    const float2 pair = row[j];
    return pair.x + f * pair.y;
}

#if KIND == BY_MASK
// Extinction at voxel (x, y, z), flat index `at`.
static inline float extinction_of_row(__global const VOXEL *voxels, __global const float2 *table,
                                      __global const ushort *codes, __global const Curve *curves,
                                      const Mask *mask, int x, int y, int z, size_t at) {
    __global const Curve *curve = curves + nearest_row(mask, codes, x, y, z);
    const float last = curve->last_entry;
    const float raw = ((float)voxels[at] - curve->domain_rest) * curve->domain_scale;
    const float entry = MIN(MAX(raw, 0.0f), last);
    const int j = MIN((int)entry, (int)last - 1);
    return interpolate_entry(table + curve->opacity, j, entry - (float)j);
}
#endif

// Extinction at voxel (x, y, z), flat index `at`.
static inline float extinction_at(__global const VOXEL *voxels, __global const float2 *table,
                                  const Grid *grid, int x, int y, int z, size_t at) {
    const float value = voxels[at];
#if KIND == BY_LABEL
    const int label = value < 0.0f ? -1 : (int)value;
    return label < 0 || label > grid->last_entry ? 0.0f : table[label].x;
#else
    const float last = grid->last_entry;
    const float raw = (value - grid->domain_low) * grid->domain_scale;
    const float entry = MIN(MAX(raw, 0.0f), last);
    const int j = MIN((int)entry, grid->last_entry - 1);
    const float f = entry - (float)j;
#if KIND != BY_GRADIENT
    return interpolate_entry(table, j, f);
#else
    Line lines[3];
    lines_at(voxels, grid, x, y, z, at, lines);
    const float4 g = slope2(&lines[0]) * grid->gradient[0] + slope2(&lines[1]) * grid->gradient[1] +
                     slope2(&lines[2]) * grid->gradient[2];
    const float height = MIN(sqrt(g.x * g.x + g.y * g.y + g.z * g.z), (float)grid->last_row);
    const int r = MIN((int)height, grid->last_row - 1);
    __global const float2 *below = table + r * (grid->last_entry + 1);
    __global const float2 *above = below + (grid->last_entry + 1);
    const float a = interpolate_entry(below, j, f), b = interpolate_entry(above, j, f);
    return a + (height - (float)r) * (b - a);
#endif
#endif
}
#endif

// The weight of voxel `index` in a node's span along an axis.
static inline float weight_of(const Span *span, int index) {
    const int n = index - span->first;
    const float first = n == 0 ? span->of_first : 1.0f;
    const float last = n == span->count - 1 ? span->of_last : 1.0f;
    return (span->weight + (float)n * span->slope) * first * last;
}

__kernel void extinction(__global const VOXEL *restrict voxels, __global const Span *restrict spans,
                         __global const float2 *restrict table, const Grid grid,
                         __global float *restrict sigma
#if KIND == BY_MASK
                         ,
                         __global const ushort *restrict codes,
                         __global const Curve *restrict curves, const Mask mask
#endif
) {
    const uint item = get_global_id(0);
    const uint row = grid.nodes.x + 2 * LANES, slice = row * (grid.nodes.y + 2);
    if (item >= slice * (grid.nodes.z + 2)) return;
    const int nx = (int)(item % row) - LANES, ny = (int)(item / row % (grid.nodes.y + 2)) - 1;
    const int nz = (int)(item / slice) - 1;
    float sum = 0.0f;
    if (nx >= 0 && nx < grid.nodes.x && ny >= 0 && ny < grid.nodes.y && nz >= 0 &&
        nz < grid.nodes.z) {
        const Span across = spans[nx], down = spans[grid.nodes.x + ny];
        const Span deep = spans[grid.nodes.x + grid.nodes.y + nz];
        const int begin = MAX(across.first, grid.low.x);
        const int end = MIN(across.first + across.count, grid.high.x);
        for (int k = 0; k < deep.count; ++k) {
            const int z = deep.first + k;
            if (z < grid.low.z || z >= grid.high.z) continue;
            for (int j = 0; j < down.count; ++j) {
                const int y = down.first + j;
                if (y < grid.low.y || y >= grid.high.y) continue;
                const size_t start = ((size_t)z * grid.voxels.y + y) * grid.voxels.x;
                float line = 0.0f;
                for (int x = begin; x < end; ++x) {
                    int cut = 0;
                    for (int p = 0; p < grid.plane_count; ++p) {
                        const float4 plane = grid.planes[p];
                        cut |= plane.x * x + plane.y * y + plane.z * z + plane.w < 0.0f;
                    }
                    if (cut) continue;
#if KIND == BY_MASK
                    const float here = extinction_of_row(voxels, table, codes, curves, &mask, x, y,
                                                         z, start + x);
#else
                    const float here = extinction_at(voxels, table, &grid, x, y, z, start + x);
#endif
                    line += weight_of(&across, x) * here;
                }
                sum += weight_of(&deep, z) * weight_of(&down, y) * line;
            }
        }
    }
    sigma[item] = grid.adds ? sigma[item] + sum : sum;
}

typedef struct {
    int x, y, z;  // the packet's first node
    int row, slice;
    __global const float *sigma;  // that node, in the padded grid
} Packet;

// Set this work-item's packet; false if none is left.
static inline bool make_packet(const int4 nodes, __global const float *sigma, Packet *p) {
    const uint item = get_global_id(0), columns = (nodes.x + LANES - 1) / LANES;
    if (item >= columns * nodes.y * nodes.z) return false;
    p->x = item % columns * LANES;
    p->y = item / columns % nodes.y;
    p->z = item / columns / nodes.y;
    p->row = nodes.x + 2 * LANES;
    p->slice = p->row * (nodes.y + 2);
    p->sigma = sigma + ((size_t)(p->z + 1) * p->slice + (p->y + 1) * p->row + p->x + LANES);
    return true;
}

// into: layer, numbers of a node from there on, and which of them.
static inline void store(const Packet *p, const int4 nodes, floatN light, int4 into,
                         __global ushort *layers) {
    intL level;
    level.v = CONVERT_INT(light * 65535.0f + 0.5f);
    const size_t node = ((size_t)p->z * nodes.y + p->y) * nodes.x + p->x;
    layers += (size_t)into.x * nodes.x * nodes.y * nodes.z + node * into.y + into.z;
    UNROLL(l, LANES) if (p->x + l < nodes.x) layers[l * into.y] = level.s[l];
}

// Vectors at any address.
typedef struct __attribute__((packed)) { floatN v; } Nodes;
#define NODES(offset) (((__global const Nodes *)(first + (offset)))->v)

// Light along directions that are the same for all nodes: neighbours read neighbours, with the
// same weights. gain: factor of the mean over the directions; the product is clipped to 1. part: of
// the optical depths.
__kernel void parallel(__global const float *restrict sigma, __global const Step *restrict steps,
                       __global const int *restrict ends, const int directions, const float gain,
                       const float part, const int4 nodes, const int4 into,
                       __global ushort *restrict layers) {
    Packet p;
    if (!make_packet(nodes, sigma, &p)) return;
    const float dark = DARK / part;
    floatN light = 0.0f;
    for (int d = 0, s = 0; d < directions; ++d) {
        const int end = ends[d];
        floatN depth = 0.0f;
        for (; s < end; ++s) {
            __global const Step *step = steps + s;
            // All lanes have left the grid, and a straight ray cannot re-enter it.
            if ((uint)(p.x + step->x + LANES) >= (uint)(nodes.x + LANES) ||
                (uint)(p.y + step->y + 1) > (uint)nodes.y ||
                (uint)(p.z + step->z + 1) > (uint)nodes.z)
                break;
            __global const float *first = p.sigma + step->at;
            depth += step->weight[0] * NODES(0) + step->weight[1] * NODES(1) +
                     step->weight[2] * NODES(p.row) + step->weight[3] * NODES(p.row + 1) +
                     step->weight[4] * NODES(p.slice) + step->weight[5] * NODES(p.slice + 1) +
                     step->weight[6] * NODES(p.slice + p.row) +
                     step->weight[7] * NODES(p.slice + p.row + 1);
            if (!ANY(MASK(depth < dark))) break;
        }
        s = end;
        light += exp_minus(part * depth);
    }
    light *= gain / (float)directions;
    store(&p, nodes, MIN(light, 1.0f), into, layers);
}

// Light from places in the grid, of the same power: a point, or those of a lamp with a radius;
// world_x, y, z: rows of world_from_grid, in cells; bias: distance from the node at which sampling
// begins, in cells.
__kernel void converging(__global const float *restrict sigma,
                         __global const float4 *restrict lamps, const int count,
                         const float4 world_x, const float4 world_y, const float4 world_z,
                         const float bias, const float part, const int4 nodes, const int4 into,
                         __global ushort *restrict layers) {
    Packet p;
    if (!make_packet(nodes, sigma, &p)) return;
    floatL column;
    UNROLL(l, LANES) column.s[l] = p.x + l;
    const float last_x = nodes.x, last_y = nodes.y, last_z = nodes.z, dark = DARK / part;
    floatN light = 0.0f;
    for (int n = 0; n < count; ++n) {
        const float4 place = lamps[n];
        floatN dx = place.x - column.v, dy = place.y - p.y, dz = place.z - p.z;
        const floatN wx = world_x.x * dx + world_x.y * dy + world_x.z * dz;
        const floatN wy = world_y.x * dx + world_y.y * dy + world_y.z * dz;
        const floatN wz = world_z.x * dx + world_z.y * dy + world_z.z * dz;
        const floatN square = MAX(wx * wx + wy * wy + wz * wz, 1e-30f);
        const floatN inverse = inverse_root(square), away = square * inverse;
        dx *= inverse;
        dy *= inverse;
        dz *= inverse;
        floatN depth = 0.0f;
        for (float begin = bias;; begin += 1.0f) {
            const floatN left = MAX(MIN(away - begin, 1.0f), 0.0f);
            const floatN middle = begin + 0.5f * left;
            const floatN x = column.v + middle * dx, y = p.y + middle * dy, z = p.z + middle * dz;
            const intN inside = MASK(x > -1.0f) & MASK(x < last_x) & MASK(y > -1.0f) &
                                MASK(y < last_y) & MASK(z > -1.0f) & MASK(z < last_z);
            if (!ANY(inside & MASK(left > 0.0f) & MASK(depth < dark))) break;
            // Lanes beyond the grid read its padding.
            const floatN cx = MIN(MAX(x, -1.0f), last_x) + 1.0f;
            const floatN cy = MIN(MAX(y, -1.0f), last_y) + 1.0f;
            const floatN cz = MIN(MAX(z, -1.0f), last_z) + 1.0f;
            const intN ix = MIN(CONVERT_INT(cx), nodes.x), iy = MIN(CONVERT_INT(cy), nodes.y),
                       iz = MIN(CONVERT_INT(cz), nodes.z);
            const floatN fx = cx - CONVERT_FLOAT(ix), fy = cy - CONVERT_FLOAT(iy),
                         fz = cz - CONVERT_FLOAT(iz);
            intL at;
            at.v = iz * p.slice + iy * p.row + ix + LANES - 1;
            const int rows[4] = {0, p.row, p.slice, p.slice + p.row};
            floatL a[4], b[4];
            UNROLL(l, LANES) {
                __global const float *here = sigma + (uint)at.s[l];
                UNROLL(r, 4) {
                    a[r].s[l] = here[rows[r]];
                    b[r].s[l] = here[rows[r] + 1];
                }
            }
            const floatN low = lerp(lerp(a[0].v, b[0].v, fx), lerp(a[1].v, b[1].v, fx), fy);
            const floatN high = lerp(lerp(a[2].v, b[2].v, fx), lerp(a[3].v, b[3].v, fx), fy);
            depth += left * lerp(low, high, fz);
        }
        light += exp_minus(part * depth);
    }
    store(&p, nodes, light / (float)count, into, layers);
}

// Takes what surfaces keep from the nodes: parts of 65535 that arrive.
__kernel void blocked(__global const ushort *restrict parts, const int nodes, const int4 into,
                      __global ushort *restrict layers) {
    const uint item = get_global_id(0);
    if (item >= nodes) return;
    __global ushort *light =
        layers + (size_t)into.x * nodes + (size_t)item * into.y + into.z;
    *light = ((uint)*light * parts[item] + 32767u) / 65535u;
}
