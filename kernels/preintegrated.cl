// Cast rays as raycast.cl, with the transfer function integrated over each step.
//
//     τ = mean over the values between the step's ends,  α = 1 − e^(−τ length / step)
//     s = mean of τ s over the same values, divided by τ
//
// Means are differences of running integrals over the table, divided by the distance of the two
// values: no value between them is missed, however steep the transfer function. NumPy twin:
// volspec/raycast/reference.py, with volspec.transfer.segment_means.
//
// Launch and arguments: as raycast.cl, but
//         material_weights  floatV[4][last_entry + 1][VECTORS]: with c = (τ s₁ … τ s_K, τ) of a
//                  whole step, the integral up to an entry as a sum of two, c there, and the rise
//                  of c to the next; WEIGHTS is K + 1
// opacity is not read. The host sets NEAREST in addition to the constants of raycast.cl: if
// the two ends are closer than NEAREST, in table entries, the table is read at their midpoint.

#include "lanes.clh"
#include "rays.clh"
#include "field.clh"
#include "shade.clh"
#include "picture.clh"
#include "step_ends.clh"

// The integral up to a position clamped to the table; beyond the table it continues at `rate`.
typedef struct { floatV high[VECTORS], low[VECTORS], rate[VECTORS]; float beyond; } Integral;

// The integral up to position p of the table, in entries.
static inline Integral integral_at(__global const floatV *rows, int entries, float p) {
    Integral found;
    const float inside = MIN(MAX(p, 0.0f), (float)(entries - 1));
    const int j = MIN((int)inside, entries - 2);
    const float f = inside - (float)j;
    UNROLL(v, VECTORS) {
        __global const floatV *row = rows + j * VECTORS + v;
        const int next = entries * VECTORS;
        const floatV rate = row[2 * next], rise = row[3 * next];
        found.high[v] = row[0];
        found.low[v] = row[next] + (floatV)(f) * (rate + (floatV)(0.5f * f) * rise);
        found.rate[v] = rate + (floatV)(f) * rise;
    }
    found.beyond = p - inside;
    return found;
}

// Its growth from a to b, in vector v. Beyond one end the two differences are taken together: each
// may be far larger than their sum.
static inline floatV growth(const Integral *a, const Integral *b, int v) {
    const floatV inside = (b->high[v] - a->high[v]) + (b->low[v] - a->low[v]);
    if (a->beyond * b->beyond > 0.0f) return inside + (floatV)(b->beyond - a->beyond) * b->rate[v];
    return inside + (floatV)(b->beyond) * b->rate[v] - (floatV)(a->beyond) * a->rate[v];
}

__kernel void preintegrated(__global const VOXEL *restrict voxels,
                            __global const uchar *restrict brick_codes,
                            __global const float2 *restrict opacity,
                            __global const floatV *restrict material_weights,
                            __global const float *restrict channels,
                            __global const float4 *restrict sources,
                            __global const ushort *restrict light_volume,
                            __global const float2 *restrict spans, const Cast cast,
#if PARTS
                            __global const float *restrict through,
#endif
                            __global float *restrict coefficients_out,
                            __global float *restrict alpha_out, __global float *restrict depth_out,
                            __global float *restrict first_out, const int first_tile) {
    const int2 pixel = tile_pixel(first_tile);
    if (pixel.x >= cast.width || pixel.y >= cast.height) return;
    const Rays r = make_rays(&cast, spans, pixel);
    const float per_step = 1.0f / cast.step;
    const int entries = (int)cast.last_entry + 1;
    March m = start_march(&cast, &r);
    Accumulator g;
    clear(&g, THROUGH_FRONT);
    m.live &= MASK(g.transmittance > cast.min_transmittance);
    StepEnds e = no_ends(m.k);

    while (ANY(m.live)) {
        skip_empty_bricks(&cast, &r, brick_codes, &m);
        if (!ANY(m.live)) break;
        intN count = 1;
#if ADAPTIVE
        count = SELECT(MASK(m.k + m.stride <= m.next_brick), m.stride, 1);
#endif
        read_ends(&cast, voxels, opacity, &r, &m, count, &e);
        floatL front, back, depth_of_step, most;  // of the step, its mean or at an end
        WeightRow mean[LANES];
        front.v = (e.front - cast.domain_rest) * cast.domain_scale;
        back.v = (e.back - cast.domain_rest) * cast.domain_scale;
        UNROLL(l, LANES) {
            const float apart = back.s[l] - front.s[l];
            if (apart >= NEAREST || apart <= -NEAREST) {
                const Integral a = integral_at(material_weights, entries, front.s[l]);
                const Integral b = integral_at(material_weights, entries, back.s[l]);
                UNROLL(v, VECTORS) mean[l].v[v] = growth(&a, &b, v) / (floatV)(apart);
                const WeightRow *at_a = (const WeightRow *)a.rate;
                const WeightRow *at_b = (const WeightRow *)b.rate;
                most.s[l] = MAX(at_a->s[WEIGHTS - 1], at_b->s[WEIGHTS - 1]);
            } else {
                const float middle = 0.5f * (front.s[l] + back.s[l]);
                const Integral there = integral_at(material_weights, entries, middle);
                UNROLL(v, VECTORS) mean[l].v[v] = there.rate[v];
                most.s[l] = 0.0f;
            }
            depth_of_step.s[l] = mean[l].s[WEIGHTS - 1];
        }
        const floatN fraction = (e.end - e.begin) * per_step;
        const floatN tau = MAX(depth_of_step.v, 0.0f) * fraction;
        // 1 − e^−τ has no digits left for a faint τ.
        const floatN faint = tau * (1.0f - 0.5f * tau * (1.0f - tau * 0.33333333f));
        floatN alpha = SELECT(MASK(tau < 0.004f), faint, 1.0f - exp_minus(tau));
        intN here = m.live & in_part(&r, 0.5f * (e.begin + e.end));
#if MISSING
        here &= e.has_front & e.has_back;  // no values lie between one and a missing one
#endif
        alpha = SELECT(here, alpha, (floatN)(0.0f));
        if (ANY(MASK(alpha > 0.0f))) {
            const floatN visible = g.transmittance * alpha, middle = 0.5f * (e.begin + e.end);
            // A step into opaque matter is a surface, of whichever mean.
            const floatN away = lift_at(&cast, MAX(MAX(most.v, depth_of_step.v), 0.0f));
            floatL shading[GROUPS];
            add_shaded(&cast, voxels, opacity, sources, light_volume, &r, middle, away, visible,
                       &g, shading);
            m.live &= MASK(g.transmittance > cast.min_transmittance);
            // c holds τ s: divided by τ it is s.
            const floatN per_depth = 1.0f / MAX(depth_of_step.v, 1e-30f);
            UNROLL(group, GROUPS) shading[group].v *= per_depth;
            UNROLL(l, LANES) accumulate(&g, l, shading, mean[l].v);
        }
        m.k += count;
        m.live &= MASK(m.k < m.k_end);
    }
    write_picture(&cast, &g, &r, pixel, first_tile * TILE_HEIGHT, channels, coefficients_out,
                  alpha_out, depth_out, first_out);
}
