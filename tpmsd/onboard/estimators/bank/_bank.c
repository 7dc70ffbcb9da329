/* Arithmetic of the hypothesis bank, compiled: the same formulas as `error_state`, `batched_kalman` and
 * `measurements` have for NumPy arrays, which are the reference (tests/onboard/estimators/test_bank_kernel.py).
 *
 * In and out: C-contiguous double arrays in which the hypotheses lie side by side (`error_state.side_by_side`):
 * mean [n][N], covariance [n][n][N]; n states, N hypotheses. Nothing is allocated. Floating-point contraction
 * is off (setup.py), so that machines with and without fused multiply-add round alike.
 */
#define Py_LIMITED_API 0x030b0000
#include "../../../foundation/_arrays.h"
#include "../../../foundation/_sources.h"
#include <math.h>

/* Loops over hypotheses are also compiled for wider vectors, chosen when the module is loaded. Each hypothesis is
 * computed by itself and contraction is off, so the numbers are the same. */
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx512f", "avx2", "default")))
#else
#define WIDE
#endif
#ifdef __GNUC__
#define INLINE inline __attribute__((always_inline))
#else
#define INLINE inline
#endif

/* Places in the state, as in `error_state`. */
enum { E, N_, PSI, BE, BN, LAT, LATV, TRK, FWD, GYRO, GAIN, SLIP, LOAD, MU };
enum { POSE = PSI + 1, MOST_STATES = MU + 4, MOST_SUMS = POSE + 4 * 5 / 2, SUMS = 4, TILE = 64 };

/* ---- arguments ------------------------------------------------------------------------------------------ */

static PyObject *odd(const char *what)
{
    PyErr_SetString(PyExc_ValueError, what);
    return NULL;
}

/* Whether mean [n][N] and covariance [n][n][N] belong together. */
static int is_bank(const Py_buffer *mean, const Py_buffer *covariance)
{
    Py_ssize_t n = mean->shape[0], count = mean->shape[1];
    return n > MU && n <= MOST_STATES && count > 0 && covariance->shape[0] == n && covariance->shape[1] == n &&
           covariance->shape[2] == count;
}

/* ---- a tick --------------------------------------------------------------------------------------------- */

struct motion {
    double rear_m[2], rear_rad[2], half_horizontal, slip_accel, load_turn, load_gain, least_load;
    double track_m, independent_turn, curvature;
    double bias_decay, way_noise, way_noise2, turn_noise, turn_noise2, turn_way_noise2, latency_noise;
    double gyro_noise, bias_noise, dt_s;
};
enum { MOTION_NUMBERS = sizeof(struct motion) / sizeof(double) };

/* Way and turn of hypotheses [from, to): [Lundquist 2013, eqs 6a, 6b]; share: `_PoseDerivative.share`. */
static void way_and_turn(const struct motion *m, const double *mean, Py_ssize_t count, Py_ssize_t from,
                         Py_ssize_t to, double *way, double *turn, double *share)
{
    int steered = !isnan(m->curvature), known = isnan(m->load_gain);
    for (Py_ssize_t h = from; h < to; h++) {
        double left = (mean[MU * count + h] + m->rear_m[0]) * m->rear_rad[0];
        double right = (mean[(MU + 1) * count + h] + m->rear_m[1]) * m->rear_rad[1];
        double w = (left + right) * m->half_horizontal * (1.0 - mean[SLIP * count + h] * m->slip_accel);
        double load = mean[LOAD * count + h], factor = 1.0 + load * m->load_gain;
        double shown = (right - left) * (1.0 + mean[TRK * count + h]) / m->track_m;
        way[h - from] = w;
        share[h - from] = known ? 1.0 : 1.0 / (factor > m->least_load ? factor : m->least_load);
        turn[h - from] = steered ? w * m->curvature
                         : known ? shown + load * m->load_turn
                                 : shown * share[h - from];
    }
}

/* The derivative of a tick's change of E, N and PSI by the state, of a tile of hypotheses: what is not zero. */
struct bend {
    double across[2][TILE], by_radius[2][2][TILE], by_slip[2][TILE], by_track[TILE], share[TILE];
    double load, turned[2];
    int steered, slips;
};

/* Add B times a column of the covariance to the pose's part of it. */
static INLINE void bend_places(const struct bend *b, double *restrict east, double *restrict north,
                               double *restrict heading, const double *restrict slip, const double *restrict track,
                               const double *restrict load, const double *restrict left, const double *restrict right,
                               Py_ssize_t size)
{
    for (Py_ssize_t h = 0; h < size; h++) {
        double psi = heading[h], l = left[h], r = right[h];
        east[h] += b->across[0][h] * psi + b->by_radius[0][0][h] * l + b->by_radius[1][0][h] * r;
        north[h] += b->across[1][h] * psi + b->by_radius[0][1][h] * l + b->by_radius[1][1][h] * r;
    }
    if (b->slips)
        for (Py_ssize_t h = 0; h < size; h++) {
            east[h] += b->by_slip[0][h] * slip[h];
            north[h] += b->by_slip[1][h] * slip[h];
        }
    if (!b->steered)
        for (Py_ssize_t h = 0; h < size; h++)
            heading[h] += b->share[h] * (b->load * load[h] + b->turned[0] * left[h] + b->turned[1] * right[h]) +
                          b->by_track[h] * track[h];
}

/* The same; `column` + place * stride: that place's hypotheses. */
static inline void bend_column(const struct bend *b, double *column, Py_ssize_t stride, Py_ssize_t size)
{
    bend_places(b, column + E * stride, column + N_ * stride, column + PSI * stride, column + SLIP * stride,
                column + TRK * stride, column + LOAD * stride, column + MU * stride, column + (MU + 1) * stride, size);
}

/* Cosine and sine of the headings at mid-step by series about the first one, to rounding; 0 where they are more than
 * 0.1 rad apart and nothing was done. */
static INLINE int directions(const double *heading, const double *turn, Py_ssize_t size, double *cosine, double *sine)
{
    double base = heading[0] + 0.5 * turn[0], c = cos(base), s = sin(base), widest = 0.0;
    for (Py_ssize_t h = 0; h < size; h++) {
        double d = heading[h] + 0.5 * turn[h] - base;
        widest = fabs(d) < widest ? widest : fabs(d);
    }
    if (!(widest < 0.1)) /* not a number: nor this */
        return 0;
    for (Py_ssize_t h = 0; h < size; h++) {
        double d = heading[h] + 0.5 * turn[h] - base, q = d * d;
        double sd = d * (1.0 - q * (1.0 / 6.0) * (1.0 - q * 0.05 * (1.0 - q * (1.0 / 42.0) * (1.0 - q * (1.0 / 72.0)))));
        double cd = 1.0 - q * 0.5 * (1.0 - q * (1.0 / 12.0) * (1.0 - q * (1.0 / 30.0) * (1.0 - q * (1.0 / 56.0) * (1.0 - q * (1.0 / 90.0)))));
        cosine[h] = c * cd - s * sd;
        sine[h] = s * cd + c * sd;
    }
    return 1;
}

/* Move the means of hypotheses [from, to), at most TILE, through [Lundquist 2013, eq. 7], heading at mid-step. */
static INLINE void move_means(const int half, const struct motion *m, double *mean, Py_ssize_t count, Py_ssize_t from, Py_ssize_t to,
                              struct bend *b, double *sum_way, double *sum_turn)
{
    double way[TILE], turn[TILE];
    Py_ssize_t size = to - from;
    double *state = mean + from;
    way_and_turn(m, mean, count, from, to, way, turn, b->share);
    b->steered = !isnan(m->curvature);
    b->slips = m->slip_accel != 0.0;
    b->load = m->load_turn;
    b->turned[0] = b->steered ? 0.0 : -m->rear_rad[0] / m->track_m;
    b->turned[1] = b->steered ? 0.0 : m->rear_rad[1] / m->track_m;
    double cosine[TILE], sine[TILE];
    if (!half || !directions(state + PSI * count, turn, size, cosine, sine))
        for (Py_ssize_t h = 0; h < size; h++) {
            double middle = state[PSI * count + h] + 0.5 * turn[h];
            cosine[h] = cos(middle);
            sine[h] = sin(middle);
        }
    for (Py_ssize_t h = 0; h < size; h++) {
        double along[2] = {cosine[h], sine[h]};
        double step[2] = {along[0] * way[h], along[1] * way[h]};
        b->across[0][h] = -step[1];
        b->across[1][h] = step[0];
        for (int i = 0; i < 2; i++)
            for (int axis = 0; axis < 2; axis++)
                b->by_radius[i][axis][h] = m->rear_rad[i] * m->half_horizontal * along[axis] +
                                           b->turned[i] * (0.5 * b->share[h] * b->across[axis][h]);
        for (int axis = 0; axis < 2; axis++)
            b->by_slip[axis][h] = along[axis] * (way[h] * -m->slip_accel);
        b->by_track[h] = isnan(m->independent_turn) ? turn[h] : m->independent_turn;
        state[E * count + h] += step[0];
        state[N_ * count + h] += step[1];
        state[PSI * count + h] += turn[h];
        *sum_way += way[h];
        *sum_turn += turn[h];
    }
    for (Py_ssize_t j = BE; j <= BN; j++) /* the receiver's slow error fades */
        for (Py_ssize_t h = 0; h < size; h++)
            state[j * count + h] *= m->bias_decay;
}

/* Move hypotheses [from, to), at most TILE; no noise. */
WIDE static void move(const struct motion *m, double *mean, double *covariance, Py_ssize_t n, Py_ssize_t count,
                      Py_ssize_t from, Py_ssize_t to, double *sum_way, double *sum_turn)
{
    Py_ssize_t size = to - from, row = n * count;
    double *spread = covariance + from;
    struct bend b;
    move_means(0, m, mean, count, from, to, &b, sum_way, sum_turn);
    /* F P F' with F = I + B: the pose's rows of P + B P, then their part B' in the first columns; the first
     * columns of the other rows are these, mirrored. */
    for (Py_ssize_t k = 0; k < n; k++)
        bend_column(&b, spread + k * count, row, size);
    for (Py_ssize_t j = 0; j < POSE; j++)
        bend_column(&b, spread + j * row, count, size);
    for (Py_ssize_t j = 0; j < POSE; j++)
        for (Py_ssize_t k = POSE; k < n; k++)
            for (Py_ssize_t h = 0; h < size; h++)
                spread[k * row + j * count + h] = spread[j * row + k * count + h];
    for (Py_ssize_t j = BE; j <= BN; j++) {
        for (Py_ssize_t k = 0; k < n; k++)
            for (Py_ssize_t h = 0; h < size; h++)
                spread[j * row + k * count + h] *= m->bias_decay;
        for (Py_ssize_t k = 0; k < n; k++)
            for (Py_ssize_t h = 0; h < size; h++)
                spread[k * row + j * count + h] *= m->bias_decay;
    }
}

/* As `move`, of the upper triangle alone. */
WIDE static void move_half(const struct motion *m, double *mean, double *covariance, Py_ssize_t n, Py_ssize_t count,
                           Py_ssize_t from, Py_ssize_t to, double *sum_way, double *sum_turn)
{
#define AT(j, k) (covariance + from + ((j) * n + (k)) * count)
#define UPPER(j, k) ((j) < (k) ? AT(j, k) : AT(k, j))
    Py_ssize_t size = to - from;
    double pose[POSE][POSE][TILE]; /* [column][row]: P + B P of the pose */
    struct bend b;
    move_means(1, m, mean, count, from, to, &b, sum_way, sum_turn);
    for (Py_ssize_t k = 0; k < POSE; k++) {
        for (Py_ssize_t j = 0; j < POSE; j++)
            for (Py_ssize_t h = 0; h < size; h++)
                pose[k][j][h] = UPPER(j, k)[h];
        bend_places(&b, pose[k][E], pose[k][N_], pose[k][PSI], AT(k, SLIP), AT(k, TRK), AT(k, LOAD), AT(k, MU),
                    AT(k, MU + 1), size);
    }
    for (Py_ssize_t k = POSE; k < n; k++)
        bend_places(&b, AT(E, k), AT(N_, k), AT(PSI, k), UPPER(SLIP, k), UPPER(TRK, k), UPPER(LOAD, k), UPPER(MU, k),
                    UPPER(MU + 1, k), size);
    for (Py_ssize_t j = 0; j < POSE; j++) { /* row j of P + B P, times B' */
        double own[POSE][TILE];
        for (Py_ssize_t k = 0; k < POSE; k++)
            for (Py_ssize_t h = 0; h < size; h++)
                own[k][h] = pose[k][j][h];
        bend_places(&b, own[E], own[N_], own[PSI], AT(j, SLIP), AT(j, TRK), AT(j, LOAD), AT(j, MU), AT(j, MU + 1),
                    size);
        for (Py_ssize_t k = j; k < POSE; k++)
            for (Py_ssize_t h = 0; h < size; h++)
                AT(j, k)[h] = own[k][h];
    }
    for (Py_ssize_t j = BE; j <= BN; j++)
        for (Py_ssize_t k = 0; k < n; k++) {
            double decay = k == j ? m->bias_decay * m->bias_decay : m->bias_decay;
            for (Py_ssize_t h = 0; h < size; h++)
                UPPER(j, k)[h] *= decay;
        }
#undef UPPER
#undef AT
}

typedef void (*move_of_tile)(const struct motion *, double *, double *, Py_ssize_t, Py_ssize_t, Py_ssize_t, Py_ssize_t,
                             double *, double *);

/* propagate(mean, covariance, drift [d][d][N], noise_factor [N], *numbers of struct motion) -> (mean way, mean turn);
 * the factor is on the noise of way and heading that grows with the way */
static PyObject *propagate_by(move_of_tile moved, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[4] = {2, 3, 3, 1};
    Py_buffer views[4];
    struct motion m;
    if (given != 4 + MOTION_NUMBERS)
        return odd("four arrays and the numbers of a motion are needed");
    if (numbers(args + 4, MOTION_NUMBERS, (double *)&m) < 0 || get_arrays(args, views, dimensions, 4, 2) < 0)
        return NULL;
    Py_ssize_t n = views[0].shape[0], count = views[0].shape[1], wheels = n - MU;
    if (!is_bank(&views[0], &views[1]) || views[2].shape[0] != wheels || views[2].shape[1] != wheels ||
        views[2].shape[2] != count || views[3].shape[0] != count) {
        release(views, 4);
        return odd("the arrays do not belong together");
    }
    double *mean = views[0].buf, *covariance = views[1].buf, way = 0.0, turn = 0.0;
    const double *drift = views[2].buf, *factor = views[3].buf;
    for (Py_ssize_t from = 0; from < count; from += TILE)
        moved(&m, mean, covariance, n, count, from, from + TILE < count ? from + TILE : count, &way, &turn);
    way /= (double)count;
    turn /= (double)count;
    double distance = fabs(way), walked[POSE], own[GYRO + 1] = {0.0};
    walked[E] = walked[N_] = m.way_noise * distance;
    walked[PSI] = m.turn_noise * distance;
    own[E] = own[N_] = m.way_noise2 * distance * distance;
    own[PSI] = m.turn_noise2 * turn * turn;
    own[BE] = own[BN] = m.bias_noise;
    own[LAT] = m.latency_noise;
    own[GYRO] = m.gyro_noise;
    double rough = m.turn_way_noise2 * distance * distance;
    for (Py_ssize_t j = 0; j <= GYRO; j++) {
        double *diagonal = covariance + (j * n + j) * count;
        if (j <= PSI)
            for (Py_ssize_t h = 0; h < count; h++)
                diagonal[h] += walked[j] * factor[h] + own[j] + (j == PSI ? rough : 0.0);
        else if (own[j] != 0.0)
            for (Py_ssize_t h = 0; h < count; h++)
                diagonal[h] += own[j];
    }
    for (Py_ssize_t j = 0; j < wheels; j++)
        for (Py_ssize_t k = moved == move_half ? j : 0; k < wheels; k++)
            for (Py_ssize_t h = 0; h < count; h++)
                covariance[((MU + j) * n + MU + k) * count + h] += drift[(j * wheels + k) * count + h] * m.dt_s;
    release(views, 4);
    return Py_BuildValue("dd", way, turn);
}

static PyObject *propagate(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return propagate_by(move, args, given);
}

static PyObject *propagate_half(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return propagate_by(move_half, args, given);
}

/* ---- a scalar measurement ------------------------------------------------------------------------------- */

struct scalar {
    double variance, robust_from, dof;
};

/* Update hypotheses [from, to), at most TILE. `row`: the place's numbers `row_step` doubles apart from the
 * next place's, one per hypothesis where `row_each`, else one for all. `half`: the upper triangle alone. */
static INLINE void update_tile(const int half, const struct scalar *s, double *mean, double *covariance, double *log_weights,
                    const double *innovation, const double *row, Py_ssize_t row_step, int row_each,
                    Py_ssize_t frozen_from, Py_ssize_t n, Py_ssize_t count, Py_ssize_t from, Py_ssize_t to)
{
    double gain[MOST_STATES][TILE], projected[TILE], pull[TILE], scale[TILE];
    Py_ssize_t size = to - from, places[MOST_STATES], used = 0;
    int idle[MOST_STATES];
    double *state = mean + from, *spread = covariance + from;
    for (Py_ssize_t k = 0; k < n; k++) { /* rows hold few numbers that are not zero */
        const double *here = row + k * row_step + (row_each ? from : 0);
        for (Py_ssize_t h = 0; h < (row_each ? size : 1); h++)
            if (here[h] != 0.0) {
                places[used++] = k;
                break;
            }
    }
    for (Py_ssize_t h = 0; h < size; h++)
        projected[h] = 0.0;
    for (Py_ssize_t j = 0; j < n; j++) {
        for (Py_ssize_t h = 0; h < size; h++)
            gain[j][h] = 0.0;
        for (Py_ssize_t i = 0; i < used; i++) {
            const double *here = row + places[i] * row_step + (row_each ? from : 0);
            Py_ssize_t at = half && j > places[i] ? places[i] * n + j : j * n + places[i];
            const double *restrict of = spread + at * count;
            double *restrict to_gain = gain[j];
            if (row_each)
                for (Py_ssize_t h = 0; h < size; h++)
                    to_gain[h] += of[h] * here[h];
            else
                for (Py_ssize_t h = 0; h < size; h++)
                    to_gain[h] += of[h] * here[0];
        }
    }
    for (Py_ssize_t i = 0; i < used; i++) {
        const double *here = row + places[i] * row_step + (row_each ? from : 0);
        for (Py_ssize_t h = 0; h < size; h++)
            projected[h] += gain[places[i]][h] * here[row_each ? h : 0];
    }
    /* Root and quotients in loops of their own, which the compiler makes wide: logarithms it calls one by one. */
    double total[TILE], squared[TILE];
    for (Py_ssize_t h = 0; h < size; h++) {
        double off = innovation[from + h];
        total[h] = projected[h] + s->variance;
        squared[h] = off * off / total[h];
    }
    for (Py_ssize_t h = 0; h < size; h++)
        log_weights[from + h] += -0.5 * (s->dof + 1.0) * log1p(squared[h] / s->dof) - 0.5 * log(total[h]);
    for (Py_ssize_t h = 0; h < size; h++) {
        double beyond = sqrt(squared[h]) / s->robust_from;
        /* Not `beyond > 1.0`: what is not a number must stay so. */
        double held = projected[h] + s->variance * (beyond <= 1.0 ? 1.0 : beyond * beyond);
        pull[h] = innovation[from + h] / held;
        scale[h] = 1.0 / sqrt(held);
    }
    for (Py_ssize_t j = 0; j < n; j++) {
        if (j < frozen_from)
            for (Py_ssize_t h = 0; h < size; h++)
                state[j * count + h] += gain[j][h] * pull[h];
        idle[j] = 1; /* a place that this measurement says nothing of, as the gyro's before it is used */
        for (Py_ssize_t h = 0; h < size; h++)
            idle[j] &= gain[j][h] == 0.0;
        for (Py_ssize_t h = 0; h < size; h++)
            gain[j][h] *= scale[h]; /* K g' with K = g / total, of one scaled copy of g: rounded symmetrically */
    }
    for (Py_ssize_t j = 0; j < frozen_from; j++) {
        double *diagonal = spread + (j * n + j) * count;
        if (half && idle[j])
            continue;
        for (Py_ssize_t h = 0; h < size; h++)
            diagonal[h] -= gain[j][h] * gain[j][h];
        for (Py_ssize_t k = j + 1; k < n; k++) {
            if (half && idle[k])
                continue;
            double *restrict here = spread + (j * n + k) * count, *restrict mirrored = spread + (k * n + j) * count;
            const double *restrict one = gain[j], *restrict other = gain[k];
            if (half) {
                for (Py_ssize_t h = 0; h < size; h++)
                    here[h] -= one[h] * other[h];
                continue;
            }
            for (Py_ssize_t h = 0; h < size; h++) {
                double less = one[h] * other[h];
                here[h] -= less;
                mirrored[h] -= less;
            }
        }
    }
}

typedef void (*update_of_tile)(const struct scalar *, double *, double *, double *, const double *, const double *,
                               Py_ssize_t, int, Py_ssize_t, Py_ssize_t, Py_ssize_t, Py_ssize_t, Py_ssize_t);

#define UPDATE(name, half)                                                                                            \
    WIDE static void name(const struct scalar *s, double *mean, double *covariance, double *log_weights,              \
                          const double *innovation, const double *row, Py_ssize_t row_step, int row_each,             \
                          Py_ssize_t frozen_from, Py_ssize_t n, Py_ssize_t count, Py_ssize_t from, Py_ssize_t to)     \
    {                                                                                                                 \
        update_tile(half, s, mean, covariance, log_weights, innovation, row, row_step, row_each, frozen_from, n,      \
                    count, from, to);                                                                                 \
    }
UPDATE(measure, 0)
UPDATE(measure_half, 1)

/* update(mean, covariance, log_weights [N], innovation [N], row [n] or [n][N], variance, frozen_from,
 *        robust_from, dof) */
static PyObject *update_by(update_of_tile measured, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[4] = {2, 3, 1, 1};
    Py_buffer views[5];
    double values[4];
    if (given != 9)
        return odd("nine arguments are needed");
    if (numbers(args + 5, 4, values) < 0 || get_arrays(args, views, dimensions, 4, 3) < 0)
        return NULL;
    int row_each = 1;
    if (get(args[4], &views[4], 2, 0) < 0) {
        PyErr_Clear();
        row_each = 0;
        if (get(args[4], &views[4], 1, 0) < 0) {
            release(views, 4);
            return NULL;
        }
    }
    if (apart(views, 5, 3) < 0) {
        release(views, 5);
        return NULL;
    }
    Py_ssize_t n = views[0].shape[0], count = views[0].shape[1];
    if (!is_bank(&views[0], &views[1]) || views[2].shape[0] != count || views[3].shape[0] != count ||
        views[4].shape[0] != n || (row_each && views[4].shape[1] != count) ||
        !(values[1] >= 0.0 && values[1] <= (double)n)) { /* also what is no number, which has no integer */
        release(views, 5);
        return odd("the arrays do not belong together");
    }
    Py_ssize_t frozen_from = (Py_ssize_t)values[1];
    struct scalar s = {values[0], values[2], values[3]};
    for (Py_ssize_t from = 0; from < count; from += TILE)
        measured(&s, views[0].buf, views[1].buf, views[2].buf, views[3].buf, views[4].buf, row_each ? count : 1,
                row_each, frozen_from, n, count, from, from + TILE < count ? from + TILE : count);
    release(views, 5);
    Py_RETURN_NONE;
}

static PyObject *update(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return update_by(measure, args, given);
}

static PyObject *update_half(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    return update_by(measure_half, args, given);
}

/* covariances of a bank, (n, n, count): 0, or -1 with the error set */
static int covariances(PyObject *from, Py_buffer *view)
{
    if (get(from, view, 3, 1) < 0)
        return -1;
    if (view->shape[1] == view->shape[0])
        return 0;
    PyBuffer_Release(view);
    odd("the array is no covariance");
    return -1;
}

/* covariances, and the least variance that they may have */
static int bounded_covariances(PyObject *const *args, Py_ssize_t given, Py_buffer *view, double *least)
{
    if (given != 2) {
        odd("two arguments are needed");
        return -1;
    }
    return numbers(args + 1, 1, least) < 0 ? -1 : covariances(args[0], view);
}

/* symmetrise(covariance, least): the mean of both halves, and no variance below `least` */
static PyObject *symmetrise(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    Py_buffer view;
    double least;
    if (bounded_covariances(args, given, &view, &least) < 0)
        return NULL;
    Py_ssize_t n = view.shape[0], count = view.shape[2];
    double *spread = view.buf;
    for (Py_ssize_t j = 0; j < n; j++) {
        double *diagonal = spread + (j * n + j) * count;
        for (Py_ssize_t h = 0; h < count; h++)
            diagonal[h] = diagonal[h] < least ? least : diagonal[h];
        for (Py_ssize_t k = j + 1; k < n; k++) {
            double *here = spread + (j * n + k) * count, *mirrored = spread + (k * n + j) * count;
            for (Py_ssize_t h = 0; h < count; h++)
                here[h] = mirrored[h] = 0.5 * (here[h] + mirrored[h]);
        }
    }
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

/* clamp(covariance, least): no variance below `least` */
static PyObject *clamp(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    Py_buffer view;
    double least;
    if (bounded_covariances(args, given, &view, &least) < 0)
        return NULL;
    Py_ssize_t n = view.shape[0], count = view.shape[2];
    double *spread = view.buf;
    for (Py_ssize_t j = 0; j < n; j++)
        for (Py_ssize_t h = 0; h < count; h++)
            spread[(j * n + j) * count + h] =
                spread[(j * n + j) * count + h] < least ? least : spread[(j * n + j) * count + h];
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

/* mirror(covariance): the lower triangle is made of the upper one */
static PyObject *mirror(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    Py_buffer view;
    if (given != 1)
        return odd("one argument is needed");
    if (covariances(args[0], &view) < 0)
        return NULL;
    Py_ssize_t n = view.shape[0], count = view.shape[2];
    double *spread = view.buf;
    for (Py_ssize_t j = 0; j < n; j++)
        for (Py_ssize_t k = j + 1; k < n; k++)
            for (Py_ssize_t h = 0; h < count; h++)
                spread[(k * n + j) * count + h] = spread[(j * n + k) * count + h];
    PyBuffer_Release(&view);
    Py_RETURN_NONE;
}

/* ---- the mixture ---------------------------------------------------------------------------------------- */

/* moments(mean_out [n], radii_out [d][d], weights_out [N], mean, covariance, log_weights)
 * -> variances of east, north and heading, and the effective number of hypotheses */
static PyObject *moments(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[6] = {1, 2, 1, 2, 3, 1};
    Py_buffer views[6];
    if (given != 6)
        return odd("six arrays are needed");
    if (get_arrays(args, views, dimensions, 6, 3) < 0)
        return NULL;
    Py_ssize_t n = views[3].shape[0], count = views[3].shape[1], wheels = n - MU;
    if (!is_bank(&views[3], &views[4]) || views[0].shape[0] != n || views[1].shape[0] != wheels ||
        views[1].shape[1] != wheels || views[2].shape[0] != count || views[5].shape[0] != count) {
        release(views, 6);
        return odd("the arrays do not belong together");
    }
    double *mean = views[0].buf, *radii = views[1].buf, *weights = views[2].buf;
    const double *state = views[3].buf, *spread = views[4].buf, *logs = views[5].buf;
    double best = logs[0], total = 0.0, squares = 0.0, pose[POSE];
    for (Py_ssize_t h = 1; h < count; h++)
        best = logs[h] > best || isnan(logs[h]) ? logs[h] : best;
    for (Py_ssize_t h = 0; h < count; h++)
        total += weights[h] = exp(logs[h] - best);
    for (Py_ssize_t h = 0; h < count; h++) {
        weights[h] /= total;
        squares += weights[h] * weights[h];
    }
    for (Py_ssize_t j = 0; j < n; j += SUMS) { /* some sums side by side: each waits for itself alone */
        double some[SUMS] = {0.0};
        const double *rows[SUMS];
        for (int i = 0; i < SUMS; i++)
            rows[i] = state + (j + i < n ? j + i : j) * count;
        for (Py_ssize_t h = 0; h < count; h++)
            for (int i = 0; i < SUMS; i++)
                some[i] += rows[i][h] * weights[h];
        for (int i = 0; i < SUMS && j + i < n; i++)
            mean[j + i] = some[i];
    }
    Py_ssize_t pairs = 0, one[MOST_SUMS], other[MOST_SUMS];
    double sum[MOST_SUMS];
    for (Py_ssize_t j = 0; j < n; j++)
        for (Py_ssize_t k = j; k < (j < POSE ? j + 1 : j < MU ? j : n); k++) {
            one[pairs] = j;
            other[pairs++] = k;
        }
    for (Py_ssize_t from = 0; from < pairs; from += SUMS) {
        double some[SUMS] = {0.0}, at[SUMS], to[SUMS];
        const double *own[SUMS], *left[SUMS], *right[SUMS];
        for (int i = 0; i < SUMS; i++) {
            Py_ssize_t j = one[from + i < pairs ? from + i : from], k = other[from + i < pairs ? from + i : from];
            own[i] = spread + (j * n + k) * count;
            left[i] = state + j * count;
            right[i] = state + k * count;
            at[i] = mean[j];
            to[i] = mean[k];
        }
        for (Py_ssize_t h = 0; h < count; h++)
            for (int i = 0; i < SUMS; i++)
                some[i] += weights[h] * (own[i][h] + (left[i][h] - at[i]) * (right[i][h] - to[i]));
        for (int i = 0; i < SUMS && from + i < pairs; i++)
            sum[from + i] = some[i];
    }
    for (Py_ssize_t i = 0; i < pairs; i++) {
        Py_ssize_t j = one[i], k = other[i];
        if (j < POSE)
            pose[j] = sum[i];
        else
            radii[(j - MU) * wheels + k - MU] = radii[(k - MU) * wheels + j - MU] = sum[i];
    }
    release(views, 6);
    return Py_BuildValue("dddd", pose[E], pose[N_], pose[PSI], 1.0 / squares);
}

/* ---- positions ------------------------------------------------------------------------------------------ */

/* antenna(east [N], north [N], east_row [n][N], north_row [n][N], mean, behind_s, speed_mps, yaw_rate_radps,
 *         forward_m, left_m): as `measurements.antenna_position` */
static PyObject *antenna(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[5] = {1, 1, 2, 2, 2};
    Py_buffer views[5];
    double values[5];
    if (given != 10)
        return odd("ten arguments are needed");
    if (numbers(args + 5, 5, values) < 0 || get_arrays(args, views, dimensions, 5, 4) < 0)
        return NULL;
    Py_ssize_t n = views[4].shape[0], count = views[4].shape[1];
    int fits = n > MU && n <= MOST_STATES;
    for (int i = 0; i < 2; i++)
        fits = fits && views[i].shape[0] == count && views[2 + i].shape[0] == n && views[2 + i].shape[1] == count;
    if (!fits) {
        release(views, 5);
        return odd("the arrays do not belong together");
    }
    double *east = views[0].buf, *north = views[1].buf, *east_row = views[2].buf, *north_row = views[3].buf;
    const double *mean = views[4].buf, speed = values[1], rate = values[2], left = values[4];
    for (Py_ssize_t i = 0; i < n * count; i++)
        east_row[i] = north_row[i] = 0.0;
    for (Py_ssize_t h = 0; h < count; h++) {
        /* Back along the arc: the chord has the heading halfway back, the lever arm that of the fix. */
        double behind = values[0] + mean[LAT * count + h], turned = rate * behind, psi = mean[PSI * count + h];
        double c = cos(psi - turned), s = sin(psi - turned);
        double chord_c = cos(psi - turned / 2), chord_s = sin(psi - turned / 2);
        double forward = values[3] + mean[FWD * count + h], back = speed * behind;
        double arm_east = forward * c - left * s, arm_north = forward * s + left * c;
        double east_off = arm_east - back * chord_c, north_off = arm_north - back * chord_s;
        east[h] = mean[E * count + h] + mean[BE * count + h] + east_off;
        north[h] = mean[N_ * count + h] + mean[BN * count + h] + north_off;
        east_row[E * count + h] = east_row[BE * count + h] = 1.0;
        north_row[N_ * count + h] = north_row[BN * count + h] = 1.0;
        east_row[PSI * count + h] = -north_off;
        north_row[PSI * count + h] = east_off;
        east_row[LAT * count + h] = -speed * chord_c + rate * arm_north - rate * back / 2 * chord_s;
        north_row[LAT * count + h] = -speed * chord_s - rate * arm_east + rate * back / 2 * chord_c;
        east_row[FWD * count + h] = c;
        north_row[FWD * count + h] = s;
    }
    release(views, 5);
    Py_RETURN_NONE;
}

/* ---- the module ----------------------------------------------------------------------------------------- */

#define FAST(name, doc) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, doc}
static PyMethodDef methods[] = {
    FAST(propagate, "Move all hypotheses through a tick."),
    FAST(update, "Hold all hypotheses against a scalar measurement."),
    FAST(propagate_half, "Move all hypotheses through a tick, of covariances the upper triangle."),
    FAST(update_half, "Hold all hypotheses against a scalar measurement, of covariances the upper triangle."),
    FAST(clamp, "Undo the loss of positive diagonals that rounding leaves."),
    FAST(mirror, "Make the lower triangle of the upper one."),
    FAST(symmetrise, "Undo the asymmetry that rounding leaves."),
    FAST(moments, "Mean and covariance over the mixture."),
    FAST(antenna, "Predicted position of the antenna and its derivatives."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.onboard.estimators.bank._bank", "Arithmetic of the hypothesis bank.", 0, methods, slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__bank(void)
{
    return PyModuleDef_Init(&module);
}
