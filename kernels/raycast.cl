// Cast rays through a scalar volume and gather the channels of what they meet.
//
//     α = 1 − (1 − opacity(v))^(length / step),  C += T α (g s(v) + k_s),  T ← T (1 − α)
//     g = ambient + diffuse · lambert,  k_s = specular · lambert^shininess      (METHOD §3)
//
// NumPy twin: volspec/raycast/reference.py (cast). Same steps, same clipping, same order.
//
// Launch: 2-D, one work-item per tile of TILE_WIDTH × TILE_HEIGHT pixels (a packet of LANES
// rays), in bands: first_tile is the first row of tiles. (PoCL would build a second program for
// a launch with an offset.)
//
// Reads   voxels   VOXEL[nz][ny][nx], padded by one voxel before and two after each axis with
//                  the edge's values: clamping costs nothing and loads may run past the end
//         leaps    uchar per brick of BRICK³ cells: 0 visible, d = nearer than d all is empty
//         opacity  float2[last_entry + 1]: opacity of one whole step, difference to the next entry
//         colours  floatP[last_entry + 2][PARTS]: the M channels and zeros; the row after the
//                  table's last entry is white, the channels that a highlight adds to
// Writes  coefficients float[height][width][CHANNELS] premultiplied; alpha and depth
//         float[height][width] (expected depth in smallest spacings, inf where nothing is)
//
// The host sets LANES, VOXEL, CHANNELS, TILE_WIDTH, TILE_HEIGHT, PART and PARTS (vectors of 4 or 8
// that hold the channels), BRICK, SHADED, SPECULAR, and what voxels.clh wants.

#include "lanes.clh"
#include "voxels.clh"

#if PART == 4
typedef float4 floatP;
#else
typedef float8 floatP;
#endif
typedef union { floatP v[PARTS]; float s[PARTS * PART]; } channelsL;

typedef struct {
    // Lengths are in the volume's smallest spacing, so that no unit of the user's is too large
    // or too small for float32. Rays are anchored in the plane through the target, as RayField.
    float4 target;                     // in index space
    float4 forward, across, down;      // in the world; across and down one pixel long
    float4 index_x, index_y, index_z;  // rows of index_from_world
    float4 top;          // largest index along x, y, z
    float4 shade;        // ambient, diffuse, specular, unused
    float middle_x, middle_y;  // pixel that looks at the target
    float distance;      // from the camera to the target
    float perspective;   // 1, or 0 for parallel rays
    float phase;         // from the target to step 0; steps are whole ones from the camera
    float start;         // position of the camera counted from step 0
    float domain_low;    // value of table entry 0
    float domain_scale;  // table entries per value
    float last_entry;    // of the table
    float step;          // length of a step
    float opaque;        // a ray ends when its transmittance falls to this
    float gradient_scale;          // central difference -> share of the volume's range
    float gradient_floor_squared;  // below it, in those shares, shading fades
    int width, height;   // of the picture
    int row, slice;      // elements from one voxel row, one slice to the next
    int bricks_x, bricks_y;
    int shininess;       // Blinn-Phong exponent
} Cast;

#define FAR ((floatN)(INFINITY))
#define ROWS(r, count) _Pragma("unroll") for (int r = 0; r < count; ++r)
#define DOT(row, a, b, c) ((row).x * (a) + (row).y * (b) + (row).z * (c))
// Interpolate four rows along y, then z.
#define BILERP(y0z0, y1z0, y0z1, y1z1) lerp(lerp(y0z0, y1z0, fy), lerp(y0z1, y1z1, fy), fz)

// Entry and exit of the box 0…top along one axis; a ray along a face's plane is never outside
// of it when it lies between the two faces, and always when it does not.
static inline void clip(float top, floatN o, floatN d, floatN *near, floatN *far) {
    const intN parallel = MASK(d == 0.0f);
    const intN between = MASK(o >= 0.0f) & MASK(o <= top);
    const floatN a = (0.0f - o) / d, b = (top - o) / d;
    const floatN enter = PICK(parallel, PICK(between, -FAR, FAR), LOWER(a, b));
    const floatN leave = PICK(parallel, PICK(between, FAR, -FAR), UPPER(a, b));
    *near = UPPER(enter, *near);
    *far = LOWER(leave, *far);
}

// Where rays are along one axis, held within the volume.
static inline floatN position(floatN o, floatN d, floatN along, float top) {
    return LOWER(UPPER(o + along * d, 0.0f), top);
}

// Where rays (one axis of them) leave the bricks low…high.
static inline floatN leaves(intN low, intN high, floatN o, floatN d, floatN inverse) {
    const floatN side = CONVERT_FLOAT(PICK(MASK(d > 0.0f), high, low) * BRICK);
    return PICK(MASK(d == 0.0f), FAR, (side - o) * inverse);
}

__kernel void raycast(__global const VOXEL *restrict voxels, __global const uchar *restrict leaps,
                      __global const float2 *restrict opacity,
                      __global const floatP *restrict colours, const Cast cast,
                      __global float *restrict coefficients, __global float *restrict alpha,
                      __global float *restrict depth_out, const int first_tile) {
    const int pixel_x = get_global_id(0) * TILE_WIDTH;
    const int pixel_y = (first_tile + get_global_id(1)) * TILE_HEIGHT;
    if (pixel_x >= cast.width || pixel_y >= cast.height) return;
    const floatN x = (float)pixel_x + LANE_X, y = (float)pixel_y + LANE_Y;

    // Offset in the target's plane; how much longer the ray to it is than the middle one,
    // without the cancellation of two long lengths.
    const floatN u = x - cast.middle_x, v = y - cast.middle_y;
    const floatN rx = u * cast.across.x + v * cast.down.x;
    const floatN ry = u * cast.across.y + v * cast.down.y;
    const floatN rz = u * cast.across.z + v * cast.down.z;
    const floatN spread = cast.perspective * (rx * rx + ry * ry + rz * rz);
    const floatN ray_squared = cast.distance * cast.distance + spread;
    const floatN ray_length = ray_squared * inverse_root(ray_squared);
    const floatN longer = spread / (ray_length + cast.distance);
    const floatN wx = (cast.forward.x * cast.distance + cast.perspective * rx) / ray_length;
    const floatN wy = (cast.forward.y * cast.distance + cast.perspective * ry) / ray_length;
    const floatN wz = (cast.forward.z * cast.distance + cast.perspective * rz) / ray_length;
    floatL ox, oy, oz, dx, dy, dz;
    dx.v = DOT(cast.index_x, wx, wy, wz);
    dy.v = DOT(cast.index_y, wx, wy, wz);
    dz.v = DOT(cast.index_z, wx, wy, wz);
    const floatN shift = cast.phase - longer;
    ox.v = cast.target.x + DOT(cast.index_x, rx, ry, rz) + shift * dx.v;
    oy.v = cast.target.y + DOT(cast.index_y, rx, ry, rz) + shift * dy.v;
    oz.v = cast.target.z + DOT(cast.index_z, rx, ry, rz) + shift * dz.v;

    floatL near, far;
    near.v = cast.start;
    far.v = INFINITY;
    clip(cast.top.x, ox.v, dx.v, &near.v, &far.v);
    clip(cast.top.y, oy.v, dy.v, &near.v, &far.v);
    clip(cast.top.z, oz.v, dz.v, &near.v, &far.v);
    const intN inside = MASK(near.v < far.v) & MASK(x < (float)cast.width);
    near.v = PICK(inside, near.v, (floatN)(0.0f));
    far.v = PICK(inside, far.v, (floatN)(0.0f));

    const float step = cast.step, per_step = 1.0f / step;
    const floatN inverse_x = 1.0f / dx.v, inverse_y = 1.0f / dy.v, inverse_z = 1.0f / dz.v;
    intN k = CONVERT_INT(floor(near.v / step));
    const intN k_end = PICK(inside, CONVERT_INT(ceil(far.v / step)), (intN)(0));
    intN k_check = k;

    channelsL colour[LANES];
    FOR_LANES(l) { ROWS(p, PARTS) colour[l].v[p] = (floatP)(0.0f); }
#if SPECULAR
    floatP gloss[PARTS];
    ROWS(p, PARTS) gloss[p] = colours[((int)cast.last_entry + 1) * PARTS + p];
#endif
    // What is covered is summed beside what is left: 1 − through would lose faint media.
    floatN through = 1.0f, covered = 0.0f, depth = 0.0f;

    intN live = MASK(k < k_end);
    while (ANY(live)) {
        // Lanes at their next brick look whether it may be seen, and leap while it may not.
        for (intN ask = live & MASK(k >= k_check); ANY(ask); ask = live & MASK(k >= k_check)) {
            const floatN at_k = CONVERT_FLOAT(k);
            const floatN begin = UPPER(at_k * step, near.v);
            const floatN middle = 0.5f * (begin + LOWER((at_k + 1.0f) * step, far.v));
            const intN x = CONVERT_INT(position(ox.v, dx.v, middle, cast.top.x)) / BRICK;
            const intN y = CONVERT_INT(position(oy.v, dy.v, middle, cast.top.y)) / BRICK;
            const intN z = CONVERT_INT(position(oz.v, dz.v, middle, cast.top.z)) / BRICK;
            intL brick, distance;
            brick.v = (z * cast.bricks_y + y) * cast.bricks_x + x;
            FOR_LANES(l) distance.s[l] = leaps[brick.s[l]];
            // The box of bricks known to be alike, and where the ray leaves it.
            const intN low = UPPER(distance.v - 1, 0), high = low + 1;
            const floatN leave_x = leaves(x - low, x + high, ox.v, dx.v, inverse_x);
            const floatN leave_y = leaves(y - low, y + high, oy.v, dy.v, inverse_y);
            const floatN leave_z = leaves(z - low, z + high, oz.v, dz.v, inverse_z);
            const floatN leave = LOWER(LOWER(leave_x, leave_y), LOWER(leave_z, far.v));
            // The first step whose middle, at k + 1/2, lies beyond; at least one further. Counted
            // from k, where truncation is rounding down whatever the sign of k.
            const intN ahead = CONVERT_INT(leave * per_step - at_k + 0.5f);
            const intN next = k + UPPER(ahead, 1);
            const intN empty = MASK(distance.v > 0);
            k_check = PICK(ask & ~empty, next, k_check);
            k = PICK(ask & empty, next, k);
            live &= MASK(k < k_end);
        }
        if (!ANY(live)) break;
        // The step's clipped interval, sampled at its middle.
        const floatN step_begin = CONVERT_FLOAT(k) * step;
        const floatN step_end = CONVERT_FLOAT(k + 1) * step;
        const floatN begin = UPPER(step_begin, near.v), end = LOWER(step_end, far.v);
        const floatN middle = 0.5f * (begin + end);
        const floatN px = position(ox.v, dx.v, middle, cast.top.x);
        const floatN py = position(oy.v, dy.v, middle, cast.top.y);
        const floatN pz = position(oz.v, dz.v, middle, cast.top.z);
        const intN ix = CONVERT_INT(px), iy = CONVERT_INT(py), iz = CONVERT_INT(pz);
        const floatN fx = px - CONVERT_FLOAT(ix), fy = py - CONVERT_FLOAT(iy),
                     fz = pz - CONVERT_FLOAT(iz);
        // Of the cell's first voxel; the padding shifts every axis by one.
        const intN at = (iz + 1) * cast.slice + (iy + 1) * cast.row + ix + 1;

        // The cell's four rows along x: (y, z), (y + 1, z), (y, z + 1), (y + 1, z + 1).
        const int rows[4] = {0, cast.row, cast.slice, cast.slice + cast.row};
        floatN left[4], right[4], along_x[4];
        ROWS(r, 4) {
            pairs(voxels, at + rows[r], &left[r], &right[r]);
            along_x[r] = lerp(left[r], right[r], fx);
        }
        const floatN value = BILERP(along_x[0], along_x[1], along_x[2], along_x[3]);

        const floatN raw = (value - cast.domain_low) * cast.domain_scale;
        const floatN entry = LOWER(UPPER(raw, 0.0f), cast.last_entry);
        intL j;
        j.v = CONVERT_INT(LOWER(entry, cast.last_entry - 1.0f));
        floatL f, first, rise;
        f.v = entry - CONVERT_FLOAT(j.v);
        FOR_LANES(l) {
            const float2 two = opacity[j.s[l]];
            first.s[l] = two.x;
            rise.s[l] = two.y;
        }
        floatN share = first.v + f.v * rise.v;
        const intN clipped = (MASK(begin > step_begin) | MASK(end < step_end)) & live;
        if (ANY(clipped & MASK(share > 0.0f)))
            share = PICK(clipped, 1.0f - pow(1.0f - share, (end - begin) * per_step), share);
        share = PICK(live, share, (floatN)(0.0f));

        if (ANY(MASK(share > 0.0f))) {
            floatL visible, weight, white;
            visible.v = weight.v = through * share;
            through -= weight.v;
            covered += weight.v;
            depth += weight.v * middle;
            live &= MASK(through > cast.opaque);
#if SHADED
            // Central differences of the trilinear field are trilinear in the differences of
            // the voxels: the four rows widened by one along x, and the eight rows around.
            floatN slope[4], outer[8];
            ROWS(r, 4) {
                floatN a, b, c, d;
                quads(voxels, at + rows[r], &a, &b, &c, &d);
                slope[r] = lerp(c - a, d - b, fx);
            }
            const int around[8] = {-cast.row, 2 * cast.row,
                                   cast.slice - cast.row, cast.slice + 2 * cast.row,
                                   -cast.slice, 2 * cast.slice,
                                   cast.row - cast.slice, cast.row + 2 * cast.slice};
            ROWS(r, 8) {
                floatN a, b;
                pairs(voxels, at + around[r], &a, &b);
                outer[r] = lerp(a, b, fx);
            }
            const float scale = cast.gradient_scale;
            const floatN gx = scale * BILERP(slope[0], slope[1], slope[2], slope[3]);
            const floatN gy = scale * BILERP(along_x[1] - outer[0], outer[1] - along_x[0],
                                             along_x[3] - outer[2], outer[3] - along_x[2]);
            const floatN gz = scale * BILERP(along_x[2] - outer[4], along_x[3] - outer[6],
                                             outer[5] - along_x[0], outer[7] - along_x[1]);
            const floatN nx = gx * cast.index_x.x + gy * cast.index_y.x + gz * cast.index_z.x;
            const floatN ny = gx * cast.index_x.y + gy * cast.index_y.y + gz * cast.index_z.y;
            const floatN nz = gx * cast.index_x.z + gy * cast.index_y.z + gz * cast.index_z.z;
            const floatN square = nx * nx + ny * ny + nz * nz;
            const floatN trust = square / (square + cast.gradient_floor_squared);
            const floatN along_ray = nx * wx + ny * wy + nz * wz;
            const floatN facing = UPPER(along_ray, -along_ray) *
                                  inverse_root(UPPER(square, 1e-30f));
#if SPECULAR
            white.v = weight.v * cast.shade.z * trust;
            floatN power = facing;
            for (int n = cast.shininess; n > 0; n >>= 1, power *= power)
                if (n & 1) white.v *= power;
#endif
            weight.v *= cast.shade.x + cast.shade.y * (1.0f + trust * (facing - 1.0f));
#else
            weight.v *= cast.shade.x;
#endif
            FOR_LANES(l) {
                if (visible.s[l] > 0.0f) {
                    __global const floatP *two = colours + j.s[l] * PARTS;
                    ROWS(p, PARTS) {
                        const floatP s0 = two[p], s1 = two[PARTS + p];
                        const floatP seen = s0 + (floatP)(f.s[l]) * (s1 - s0);
                        colour[l].v[p] += (floatP)(weight.s[l]) * seen;
#if SPECULAR
                        colour[l].v[p] += (floatP)(white.s[l]) * gloss[p];
#endif
                    }
                }
            }
        }
        k += 1;
        live &= MASK(k < k_end);
    }

    floatL opaque, distance;
    opaque.v = covered;
    distance.v = depth / opaque.v - cast.start;
    FOR_LANES(l) {
        const int column = pixel_x + l % TILE_WIDTH, line = pixel_y + l / TILE_WIDTH;
        if (column < cast.width && line < cast.height) {
            const size_t pixel = (size_t)line * cast.width + column;
            _Pragma("unroll") for (int c = 0; c < CHANNELS; ++c)
                coefficients[pixel * CHANNELS + c] = colour[l].s[c];
            alpha[pixel] = opaque.s[l];
            depth_out[pixel] = opaque.s[l] > 0.0f ? distance.s[l] : INFINITY;
        }
    }
}
