// Nearby views of a picture in layers of opacity: every layer of a pixel as points at its depth.
//
//     arrange   τ = Σ s_k τ_k and the colours of each pixel's layers at given scales s, sorted into
//               slices of depth, BUCKETS, for each block of BLOCK² pixels
//     splat     front to back into the pixels x around a point's place p, with tents
//               h(x) = max(0, 1 − |x − p| / r) along both axes, r the view's `radius`:
//               left = T exp(−m τ h),  C += (T − left) c,  T = left
//
// m is the area of the source's pixel by that of the target's, at the point, by r². So depths
// add to the medium's, whatever distance and zoom. Slices are of depth along the *source's* view:
// along a ray of the target's they have the same order, if the views are within 90°.
//
// A layer is up to MAX_PARTS points, one a PART pixels, evenly spaced half-way to its neighbours:
// borders of layers jump between pixels, which one point a layer shows when turned.
//
// NumPy twin: volspec/image/reproject.py (reproject_reference).
//
// Launch: arrange 1-D, one work-item per block; twice, as points are stored behind one another:
// first it counts (`store` 0, `cells` int[BUCKETS][blocks] 0), then it stores (1, and `cells` the
// first point of each; its ends afterwards). splat 2-D, one work-item per tile of the target: no
// other writes its pixels. It sees the blocks tile_blocks[tile_starts[tile]…tile_starts[tile + 1]];
// `starts` int[BUCKETS · blocks + 1].
//
// A point is ROWS float8: τ, depth along the view from the target's plane in mm, its pixel from the
// middle, and from COLOURS_AT on CHANNELS colours. Sums are alike, with T in place of τ.
//
// Reads   tau, shade, gloss, depth float[height][width][LAYERED]…: OpacityLayers
// Writes  coefficients float[other_height][other_width][CHANNELS], alpha, depth: a cast's picture
//
// The host sets LAYERED, SOLID (1 if the last is of surfaces, which scales leave as they are),
// MATERIALS, GROUPS, CHANNELS = GROUPS · (MATERIALS + 1), ROWS, COLOURS_AT, BLOCK, BUCKETS, PART,
// MAX_PARTS, FARTHER, WIDE (r is above 1), NEAR and the struct View.

#define LANES 4
#include "lanes.clh"

// Ways from a layer to its neighbours, neither more than FARTHER times the other: what is farther
// away is behind a void; 0 if it is alone.
static inline void ways_to_neighbours(__global const float *depth, int layer, float ways[2]) {
    const int last = LAYERED - SOLID;
    const bool next_to = 0 < layer && layer < last && depth[-1] < INFINITY;
    const float before = next_to ? depth[0] - depth[-1] : INFINITY;
    const float behind = layer + 1 < last ? depth[1] - depth[0] : INFINITY;
    const float nearer = min(before, behind), most = nearer < INFINITY ? FARTHER * nearer : 0.0f;
    ways[0] = before < INFINITY ? min(before, most) : nearer < INFINITY ? nearer : 0.0f;
    ways[1] = behind < INFINITY ? min(behind, most) : nearer < INFINITY ? nearer : 0.0f;
}

__kernel void arrange(__global const float *tau, __global const float *shade,
                      __global const float *gloss, __global const float *depth,
                      __global const float *scales, const View view, __global int *cells,
                      __global float2 *extents, const int store, __global float8 *points) {
    const int block = get_global_id(0), across = (view.width + BLOCK - 1) / BLOCK;
    const int blocks = across * ((view.height + BLOCK - 1) / BLOCK);
    const int x0 = block % across * BLOCK, y0 = block / across * BLOCK;
    const float slant = view.pitch * view.nearness;
    float low = INFINITY, high = -INFINITY;
    for (int y = y0; y < min(y0 + BLOCK, view.height); ++y) {
        for (int x = x0; x < min(x0 + BLOCK, view.width); ++x) {
            const float u = x - view.middle_x, v = y - view.middle_y;
            const float cosine = 1.0f / sqrt(1.0f + slant * slant * (u * u + v * v));
            size_t at = ((size_t)y * view.width + x) * LAYERED;
            for (int i = 0; i < LAYERED; ++i, ++at) {
                if (!(depth[at] < INFINITY)) continue;
                const bool fades = i < LAYERED - SOLID;
                float total = 0.0f, share[MATERIALS], ways[2];
                for (int k = 0; k < MATERIALS; ++k) {
                    share[k] = (fades ? scales[k] : 1.0f) * tau[at * MATERIALS + k];
                    total += share[k];
                }
                if (!(total > 0.0f)) continue;
                ways_to_neighbours(depth + at, i, ways);
                const float deep = 0.5f * (ways[0] + ways[1]) / (PART * view.pitch);
                const int parts = clamp((int)ceil(deep), 1, MAX_PARTS);
                for (int part = 0; part < parts; ++part) {
                    const float off = 0.5f * ((2 * part + 1) / (float)parts - 1.0f);
                    const float ahead = (depth[at] + off * ways[off > 0.0f]) * cosine - view.distance;
                    const int bucket = clamp(
                        (int)((ahead - view.first_ahead) * view.buckets_per_mm), 0, BUCKETS - 1);
                    const int place = cells[bucket * blocks + block]++;
                    low = min(low, ahead);
                    high = max(high, ahead);
                    if (!store) continue;
                    __global float *out = (__global float *)(points + (size_t)place * ROWS);
                    for (int n = 0; n < 8 * ROWS; ++n) out[n] = 0.0f;
                    out[0] = total / parts;
                    out[1] = ahead;
                    out[2] = u;
                    out[3] = v;
                    out += COLOURS_AT;
                    for (int g = 0; g < GROUPS; ++g) {
                        for (int k = 0; k < MATERIALS; ++k) {
                            *out++ = share[k] / total * shade[(at * GROUPS + g) * MATERIALS + k];
                        }
                        *out++ = gloss[at * GROUPS + g];
                    }
                }
            }
        }
    }
    extents[block] = (float2)(low, high);
}

static inline void add_point(__global float8 *into, const float8 point[ROWS], float clear) {
    const float seen = into[0].s0 * (1.0f - clear);
    UNROLL(r, ROWS) into[r] += seen * point[r];
}

// Splat a point of the tile x0…x1, y0…y1 (ends excluded).
static inline void splat_point(const View *view, const float8 point[ROWS], float tau, float x,
                               float y, int x0, int y0, int x1, int y1, __global float8 *sums) {
#if WIDE
    const float radius = view->radius, inverse = 1.0f / radius;
    const int left = max((int)ceil(x - radius), x0), right = min((int)floor(x + radius), x1 - 1);
    const int top = max((int)ceil(y - radius), y0), bottom = min((int)floor(y + radius), y1 - 1);
    for (int b = top; b <= bottom; ++b) {
        const float height = tau * (1.0f - fabs(b - y) * inverse);
        __global float8 *into = sums + ((size_t)b * view->other_width + left) * ROWS;
        for (int a = left; a <= right; a += 4) {
            const float4 away = (float4)(0, 1, 2, 3) + (a - x);
            floatL clear;
            clear.v = exp_minus(height * (1.0f - MIN(MAX(away, 0.0f - away) * inverse, 1.0f)));
            for (int i = 0; i < min(4, right + 1 - a); ++i, into += ROWS) {
                add_point(into, point, clear.s[i]);
            }
        }
    }
#else
    const float left = floor(x), top = floor(y), fx = x - left, fy = y - top;
    const int a = left, b = top;
    if (a < x0 - 1 || a >= x1 || b < y0 - 1 || b >= y1) return;
    const float4 part = (float4)(1.0f - fx, fx, 1.0f - fx, fx) *
                        (float4)(1.0f - fy, 1.0f - fy, fy, fy);
    const float4 clear = exp_minus(tau * part);
    __global float8 *into = sums + ((long)b * view->other_width + a) * ROWS;
    __global float8 *below = into + view->other_width * ROWS;
    const int in_left = a >= x0, in_right = a + 1 < x1;
    if (b >= y0) {
        if (in_left) add_point(into, point, clear.s0);
        if (in_right) add_point(into + ROWS, point, clear.s1);
    }
    if (b + 1 < y1) {
        if (in_left) add_point(below, point, clear.s2);
        if (in_right) add_point(below + ROWS, point, clear.s3);
    }
#endif
}

__kernel void splat(__global const float8 *points, __global const int *starts,
                    __global const int *tile_starts, __global const int *tile_blocks,
                    const int blocks, const View view,
                    __global float8 *sums, __global float *coefficients, __global float *alpha,
                    __global float *depth) {
    const int x0 = get_global_id(0) * view.tile_width, y0 = get_global_id(1) * view.tile_height;
    const int x1 = min(x0 + view.tile_width, view.other_width);
    const int y1 = min(y0 + view.tile_height, view.other_height);
    const float8 nothing = (float8)(1, 0, 0, 0, 0, 0, 0, 0), zero = 0.0f;
    for (int y = y0; y < y1; ++y) {
        __global float8 *into = sums + ((size_t)y * view.other_width + x0) * ROWS;
        for (int x = x0; x < x1; ++x, into += ROWS) {
            UNROLL(r, ROWS) into[r] = r ? zero : nothing;
        }
    }
    const int tile = get_global_id(1) * get_global_size(0) + get_global_id(0);
    const int own = tile_starts[tile], own_end = tile_starts[tile + 1];
    for (int b = 0; b < BUCKETS; ++b) {
        for (int i = own; i < own_end; ++i) {
            const int cell = b * blocks + tile_blocks[i], last = starts[cell + 1];
            for (int n = starts[cell]; n < last; ++n) {
                float8 point[ROWS];
                UNROLL(r, ROWS) point[r] = points[(size_t)n * ROWS + r];
                const float tau = point[0].s0, ahead = point[0].s1;
                const float wider = 1.0f + ahead * view.nearness;
                const float4 at = view.origin + ahead * view.forward +
                                  wider * (point[0].s2 * view.across + point[0].s3 * view.down);
                const float w = 1.0f + at.z * view.other_nearness;
                if (w < NEAR) continue;
                const float inverse = 1.0f / w, scale = view.scale * wider * inverse;
                const float x = view.other_middle_x + at.x * inverse;
                const float y = view.other_middle_y + at.y * inverse;
                point[0].s0 = -1.0f;
                point[0].s1 = at.z;
                splat_point(&view, point, tau * scale * scale, x, y, x0, y0, x1, y1, sums);
            }
        }
    }
    const float slant = view.other_pitch * view.other_nearness;
    for (int y = y0; y < y1; ++y) {
        const float v = y - view.other_middle_y;
        for (int x = x0; x < x1; ++x) {
            const size_t pixel = (size_t)y * view.other_width + x;
            const float u = x - view.other_middle_x;
            __global const float *sum = (__global const float *)(sums + pixel * ROWS);
            const float seen = 1.0f - sum[0];
            UNROLL(c, CHANNELS) coefficients[pixel * CHANNELS + c] = sum[COLOURS_AT + c];
            alpha[pixel] = seen;
            depth[pixel] = seen > 0.0f ? (view.other_distance + sum[1] / seen) *
                sqrt(1.0f + slant * slant * (u * u + v * v)) : INFINITY;
        }
    }
}
