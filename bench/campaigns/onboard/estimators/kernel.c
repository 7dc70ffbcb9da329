/* One tick of MPF-PN (Lundquist et al. (2013), Table I) for the rear pair, particle by particle: what plain NumPy is held against.
 *
 * Scalar code, one thread. Same arithmetic as tpmsd/onboard/estimators/mpf_pn.py without jump hypotheses: statistics (20),
 * Student-t draw (21), motion (7), statistics (19) with the floor, weights (22) by a Student-t of 4 degrees of
 * freedom, systematic resampling below half of the effective number, estimate (24). Normals by the ziggurat
 * method of Marsaglia and Tsang (2000) in the form of Doornik (2005), as NumPy's are; gammas by Marsaglia
 * and Tsang (2000, ACM TOMS 26(3)).
 */
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

typedef struct { double e, n, psi, m0, m1, s00, s10, s11, logw; } particle;
typedef struct {
    int count;
    double gamma, nu, track, radius0, radius1, floor2;
    uint64_t rng[4];
    particle *now, *next;
    double *weight;
} filter;

static double zig_x[129], zig_r[128];
static int zig_ready = 0;
#define ZIG_R 3.442619855899
#define ZIG_V 9.91256303526217e-3

static void zig_setup(void) {
    double f = exp(-0.5 * ZIG_R * ZIG_R);
    zig_x[0] = ZIG_V / f;
    zig_x[1] = ZIG_R;
    zig_x[128] = 0.0;
    for (int i = 2; i < 128; ++i) {
        zig_x[i] = sqrt(-2.0 * log(ZIG_V / zig_x[i - 1] + f));
        f = exp(-0.5 * zig_x[i] * zig_x[i]);
    }
    for (int i = 0; i < 128; ++i) zig_r[i] = zig_x[i + 1] / zig_x[i];
    zig_ready = 1;
}

static inline uint64_t rotl(uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }

static inline uint64_t draw(filter *f) { /* xoshiro256++ */
    uint64_t *s = f->rng, out = rotl(s[0] + s[3], 23) + s[0], t = s[1] << 17;
    s[2] ^= s[0]; s[3] ^= s[1]; s[1] ^= s[2]; s[0] ^= s[3]; s[2] ^= t; s[3] = rotl(s[3], 45);
    return out;
}

static inline double uniform(filter *f) { return ((draw(f) >> 11) + 0.5) * 0x1.0p-53; }

static double normal(filter *f) {
    for (;;) {
        uint64_t bits = draw(f);
        int i = (int)(bits & 127);
        double u = 2.0 * ((bits >> 11) + 0.5) * 0x1.0p-53 - 1.0;
        if (fabs(u) < zig_r[i]) return u * zig_x[i];
        if (i == 0) {
            double x, y;
            do { x = log(uniform(f)) / ZIG_R; y = log(uniform(f)); } while (-2.0 * y < x * x);
            return u < 0.0 ? x - ZIG_R : ZIG_R - x;
        }
        double x = u * zig_x[i];
        double f0 = exp(-0.5 * (zig_x[i] * zig_x[i] - x * x));
        double f1 = exp(-0.5 * (zig_x[i + 1] * zig_x[i + 1] - x * x));
        if (f1 + uniform(f) * (f0 - f1) < 1.0) return x;
    }
}

static double chisquare(filter *f, double dof) {
    double d = dof / 2.0 - 1.0 / 3.0, c = 1.0 / sqrt(9.0 * d);
    for (;;) {
        double x = normal(f), v = 1.0 + c * x;
        if (v <= 0.0) continue;
        v = v * v * v;
        double u = uniform(f);
        if (u < 1.0 - 0.0331 * x * x * x * x || log(u) < 0.5 * x * x + d * (1.0 - v + log(v))) return 2.0 * d * v;
    }
}

filter *filter_new(int count, uint64_t seed, double track, double radius0, double radius1, double prior_m, double noise_m,
                   double floor_m) {
    filter *f = calloc(1, sizeof *f);
    if (!f) return NULL;
    f->now = calloc((size_t)count, sizeof *f->now);
    f->next = calloc((size_t)count, sizeof *f->next);
    f->weight = calloc((size_t)count, sizeof *f->weight);
    if (!f->now || !f->next || !f->weight) { free(f->now); free(f->next); free(f->weight); free(f); return NULL; }
    if (!zig_ready) zig_setup();
    for (int i = 0; i < 4; ++i) { /* splitmix64 */
        uint64_t z = (seed += 0x9e3779b97f4a7c15ULL);
        z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
        z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
        f->rng[i] = z ^ (z >> 31);
    }
    f->count = count; f->track = track; f->radius0 = radius0; f->radius1 = radius1; f->floor2 = floor_m * floor_m;
    f->gamma = 0.2; f->nu = 5.0;
    for (int i = 0; i < count; ++i) {
        particle *p = f->now + i;
        p->m0 = normal(f) * prior_m; p->m1 = normal(f) * prior_m;
        p->s00 = p->s11 = noise_m * noise_m * (f->nu - 3.0);
    }
    return f;
}

void filter_free(filter *f) { if (f) { free(f->now); free(f->next); free(f->weight); free(f); } }

void filter_place(filter *f, double e, double n, double std, double psi, double psi_std) {
    for (int i = 0; i < f->count; ++i) {
        particle *p = f->now + i;
        p->e = e + std * normal(f); p->n = n + std * normal(f); p->psi = psi + psi_std * normal(f); p->logw = 0.0;
    }
}

/* out: mu3, mu4, their covariance (3), Sigma3, Sigma4, east, north, effective number */
void filter_step(filter *f, double a0, double a1, int informative, double forgetting, int has_fix, double fix_e, double fix_n,
                 double variance, double *out) {
    const int count = f->count;
    int moving = a0 != 0.0 || a1 != 0.0;
    double forget_scale = 1.0;
    if (informative && moving) {
        f->gamma /= forgetting;
        double nu = fmax(forgetting * f->nu, 4.0);
        forget_scale = nu / f->nu;
        f->nu = nu;
    }
    const double dof = f->nu - 1.0, factor = (1.0 + f->gamma) / dof;
    const double shrink = 1.0 / (1.0 + f->gamma), gain = f->gamma * shrink;
    const double nu_after = f->nu + 1.0, floor_l = f->floor2 * (nu_after - 3.0);
    double top = -INFINITY;
    for (int i = 0; i < count; ++i) {
        particle *p = f->now + i;
        if (moving) {
            if (forget_scale != 1.0) { p->s00 *= forget_scale; p->s10 *= forget_scale; p->s11 *= forget_scale; }
            double g = sqrt(dof / chisquare(f, dof)), z0 = normal(f) * g, z1 = normal(f) * g;
            double l00 = sqrt(p->s00 * factor), l10 = p->s10 * factor / l00;
            double l11 = sqrt(fmax(p->s11 * factor - l10 * l10, 0.0));
            double w0 = p->m0 + l00 * z0, w1 = p->m1 + l10 * z0 + l11 * z1;
            double r0 = a0 * (f->radius0 + w0), r1 = a1 * (f->radius1 + w1);
            double way = 0.5 * (r0 + r1), turn = (r1 - r0) / f->track, mid = p->psi + 0.5 * turn;
            p->e += way * cos(mid); p->n += way * sin(mid); p->psi += turn;
            if (informative) {
                double d0 = w0 - p->m0, d1 = w1 - p->m1;
                p->m0 += gain * d0; p->m1 += gain * d1;
                p->s00 = fmax(p->s00 + shrink * d0 * d0, floor_l);
                p->s10 += shrink * d0 * d1;
                p->s11 = fmax(p->s11 + shrink * d1 * d1, floor_l);
            }
        }
        if (has_fix && moving) {
            double de = fix_e - p->e, dn = fix_n - p->n;
            p->logw -= 3.0 * log1p((de * de + dn * dn) / variance / 4.0);
        }
        if (p->logw > top) top = p->logw;
    }
    if (informative && moving) { f->gamma = gain; f->nu = nu_after; }
    double sum = 0.0, square = 0.0;
    for (int i = 0; i < count; ++i) {
        f->now[i].logw -= top;
        sum += f->weight[i] = exp(f->now[i].logw);
    }
    for (int i = 0; i < count; ++i) { f->weight[i] /= sum; square += f->weight[i] * f->weight[i]; }
    double effective = 1.0 / square;
    if (effective <= 0.5 * count) {
        double step = 1.0 / count, pointer = uniform(f) * step, edge = f->weight[0];
        for (int i = 0, j = 0; i < count; ++i, pointer += step) {
            while (edge < pointer && j < count - 1) edge += f->weight[++j];
            f->next[i] = f->now[j];
            f->next[i].logw = 0.0;
        }
        particle *swap = f->now; f->now = f->next; f->next = swap;
        for (int i = 0; i < count; ++i) f->weight[i] = step;
        effective = count;
    }
    double m0 = 0, m1 = 0, s00 = 0, s10 = 0, s11 = 0, e = 0, n = 0, q00 = 0, q10 = 0, q11 = 0;
    for (int i = 0; i < count; ++i) {
        const particle *p = f->now + i;
        double w = f->weight[i];
        m0 += w * p->m0; m1 += w * p->m1; e += w * p->e; n += w * p->n;
        s00 += w * p->s00; s10 += w * p->s10; s11 += w * p->s11;
    }
    for (int i = 0; i < count; ++i) {
        const particle *p = f->now + i;
        double w = f->weight[i], d0 = p->m0 - m0, d1 = p->m1 - m1;
        q00 += w * d0 * d0; q10 += w * d0 * d1; q11 += w * d1 * d1;
    }
    double mean = 1.0 / (f->nu - 3.0);
    out[0] = m0; out[1] = m1;
    out[2] = q00 + f->gamma * s00 * mean; out[3] = q10 + f->gamma * s10 * mean; out[4] = q11 + f->gamma * s11 * mean;
    out[5] = s00 * mean; out[6] = s11 * mean; out[7] = e; out[8] = n; out[9] = effective;
}

/* Draws for the tests: `what` 0 normal, 1 chi-square, 2 uniform. */
void filter_draws(filter *f, int what, double dof, int count, double *out) {
    for (int i = 0; i < count; ++i) out[i] = what == 0 ? normal(f) : what == 1 ? chisquare(f, dof) : uniform(f);
}
