// Cast rays as raycast.cl, with the transfer function integrated over each step.
//
//     τ = mean over the values between the step's ends,  α = 1 − e^(−τ length / step)
//     s = mean of τ s over them, divided by τ
//
// Means are differences of running integrals over the table, divided by the distance of the two
// values: no value between them is missed, however steep the transfer function. NumPy twin:
// volspec/raycast/reference.py, with volspec.transfer.segment_means.
//
// Launch and what is read and written: as raycast.cl, but
//         shares   floatP[4][last_entry + 1][PARTS]: with c = (τ s₁ … τ s_K, τ) of a whole step,
//                  the integral up to an entry as a sum of two, c there, and what c rises by
//                  to the next; SHARES is K + 1
// opacity and filters are not read. The host sets NEAREST beside what raycast.cl wants: ends nearer
// than that, in entries, take the value in their middle.

#include "casts.clh"
#include "ends.clh"

// Up to a position held within the table; beyond it the integral goes on at `rate`.
typedef struct { floatP high[PARTS], low[PARTS], rate[PARTS]; float beyond; } Integral;

// The integral up to position p of the table, in entries.
static inline Integral integral_at(__global const floatP *rows, int entries, float p) {
    Integral found;
    const float inside = LOWER(UPPER(p, 0.0f), (float)(entries - 1));
    const int j = LOWER((int)inside, entries - 2);
    const float f = inside - (float)j;
    EACH(part, PARTS) {
        __global const floatP *row = rows + j * PARTS + part;
        const int next = entries * PARTS;
        const floatP rate = row[2 * next], rise = row[3 * next];
        found.high[part] = row[0];
        found.low[part] = row[next] + (floatP)(f) * (rate + (floatP)(0.5f * f) * rise);
        found.rate[part] = rate + (floatP)(f) * rise;
    }
    found.beyond = p - inside;
    return found;
}

// Its growth from a to b. Beyond one end the two differences are taken together, whose parts may
// be far larger than they.
static inline floatP growth(const Integral *a, const Integral *b, int part) {
    const floatP inside = (b->high[part] - a->high[part]) + (b->low[part] - a->low[part]);
    if (a->beyond * b->beyond > 0.0f)
        return inside + (floatP)(b->beyond - a->beyond) * b->rate[part];
    return inside + (floatP)(b->beyond) * b->rate[part] - (floatP)(a->beyond) * a->rate[part];
}

CASTS(preintegrated, uchar) {
    TILE_OF_PIXELS(cast)
    const Rays r = rays_of(&cast, pixel_x, pixel_y);
    const float per_step = 1.0f / cast.step;
    const int entries = (int)cast.last_entry + 1;
    intN k = first_step(&cast, &r), due = k, stride = 1;
    const intN k_end = end_step(&cast, &r, k);
    Gathered g;
    begin(&g);
    Ends e;
    e.next = k - 1;
    e.back = 0.0f;

    intN live = MASK(k < k_end);
    while (ANY(live)) {
        leap(&cast, &r, codes, k_end, &k, &due, &stride, &live);
        if (!ANY(live)) break;
        intN taken = 1;
#if ADAPTIVE
        taken = PICK(MASK(k + stride <= due), stride, 1);
#endif
        read_ends(&cast, voxels, opacity, &r, k, taken, live, &e);
        floatL front, back, depth_of_step;
        sharesP mean[LANES];
        front.v = (e.front - cast.domain_low - cast.domain_rest) * cast.domain_scale;
        back.v = (e.back - cast.domain_low - cast.domain_rest) * cast.domain_scale;
        FOR_LANES(l) {
            const float apart = back.s[l] - front.s[l];
            if (apart >= NEAREST || apart <= -NEAREST) {
                const Integral a = integral_at(shares, entries, front.s[l]);
                const Integral b = integral_at(shares, entries, back.s[l]);
                EACH(p, PARTS) mean[l].v[p] = growth(&a, &b, p) / (floatP)(apart);
            } else {
                const float middle = 0.5f * (front.s[l] + back.s[l]);
                const Integral there = integral_at(shares, entries, middle);
                EACH(p, PARTS) mean[l].v[p] = there.rate[p];
            }
            depth_of_step.s[l] = mean[l].s[SHARES - 1];
        }
        const floatN steps = (e.end - e.begin) * per_step;
        const floatN tau = UPPER(depth_of_step.v, 0.0f) * steps;
        // 1 − e^−τ would lose a faint τ.
        const floatN faint = tau * (1.0f - 0.5f * tau * (1.0f - tau * 0.33333333f));
        floatN share = PICK(MASK(tau < 0.004f), faint, 1.0f - exp_minus(tau));
        share = PICK(live, share, (floatN)(0.0f));
        if (ANY(MASK(share > 0.0f))) {
            const floatN visible = g.through * share, middle = 0.5f * (e.begin + e.end);
            floatN nx = 0.0f, ny = 0.0f, nz = 0.0f;
#if NORMALS
            const Field f = field_at(&cast, voxels, opacity, &r, middle);
            gradient_at(&cast, voxels, opacity, &f, &nx, &ny, &nz);
#endif
            floatN weight[GROUPS], gloss[GROUPS];
            shade(&cast, sources, layers, &r, middle, nx, ny, nz, visible, weight, gloss);
            cover(&cast, &g, visible, middle);
            live &= MASK(g.through > cast.opaque);
            // c holds τ s: what is reflected is its share of τ.
            floatL weights[GROUPS];
            const floatN per_depth = 1.0f / UPPER(depth_of_step.v, 1e-30f);
            EACH(group, GROUPS) {
                weights[group].v = weight[group] * per_depth;
                g.gloss[group] += gloss[group];
            }
            FOR_LANES(l) gather(&g, l, weights, mean[l].v);
        }
        k += taken;
        live &= MASK(k < k_end);
    }
    WRITE_PICTURE(cast, g, r);
}
