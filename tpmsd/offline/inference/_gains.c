/* The recursions of the whitening filter, compiled: the same as `gains.py` and `scores.py` have for NumPy arrays,
 * which are the reference (tests/offline/inference/test_gains.py, test_scores.py).
 *
 * In and out: C-contiguous double arrays. Nothing is allocated. What makes it fast beside NumPy is that rows of
 * the moving matrix hold few numbers that are not zero. Floating-point contraction is off (setup.py).
 */
#define Py_LIMITED_API 0x030b0000
#include "../../foundation/_arrays.h"
#include "../../foundation/_sources.h"
#include <math.h>
#include <string.h>

enum { CHANNELS = 9, MOST_CARRIED = 48, MOST_ROWS = MOST_CARRIED + CHANNELS, MOST_STATES = 64, TILE = 64 };

/* The arrays of a call, of which the first `writable` are written to. */
static int get_all(PyObject *const *objects, Py_ssize_t given, Py_buffer *views, const int *dimensions, int count,
                   int writable)
{
    if (given != count) {
        PyErr_Format(PyExc_ValueError, "%d arrays are needed", count);
        return -1;
    }
    return get_arrays(objects, views, dimensions, count, writable);
}

/* Whether arrays of three dimensions have these shapes. */
static int have(const Py_buffer *views, const Py_ssize_t shapes[][3], int count)
{
    for (int i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++)
            if (views[i].shape[axis] != shapes[i][axis])
                return 0;
    return 1;
}

static PyObject *odd(Py_buffer *views, int count)
{
    release(views, count);
    PyErr_SetString(PyExc_ValueError, "the arrays do not belong together");
    return NULL;
}

/* out [rows][width] = left [rows][inner] times right [inner][width]; zeros of `left` are left out. */
static void multiply(Py_ssize_t rows, Py_ssize_t inner, Py_ssize_t width, const double *left, const double *right,
                     double *out)
{
    for (Py_ssize_t i = 0; i < rows; i++) {
        double *row = out + i * width;
        memset(row, 0, width * sizeof(double));
        for (Py_ssize_t j = 0; j < inner; j++) {
            const double factor = left[i * inner + j], *other = right + j * width;
            if (factor != 0.0)
                for (Py_ssize_t k = 0; k < width; k++)
                    row[k] += factor * other[k];
        }
    }
}

/* The inverse of the lower Cholesky factor of a matrix [CHANNELS][CHANNELS] with `stride` numbers from row to row,
 * by its lower triangle; -1 if it is not positive definite. */
static int inverse_factor(const double *matrix, Py_ssize_t stride, double *inverse)
{
    double factor[CHANNELS][CHANNELS];
    for (int i = 0; i < CHANNELS; i++)
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i * stride + j];
            for (int k = 0; k < j; k++)
                sum -= factor[i][k] * factor[j][k];
            if (i != j)
                factor[i][j] = sum / factor[j][j];
            else if (sum > 0.0 && isfinite(sum))
                factor[i][i] = sqrt(sum);
            else
                return -1;
        }
    memset(inverse, 0, CHANNELS * CHANNELS * sizeof(double));
    for (int j = 0; j < CHANNELS; j++) {
        inverse[j * CHANNELS + j] = 1.0 / factor[j][j];
        for (int i = j + 1; i < CHANNELS; i++) {
            double sum = 0.0;
            for (int k = j; k < i; k++)
                sum -= factor[i][k] * inverse[k * CHANNELS + j];
            inverse[i * CHANNELS + j] = sum / factor[i][i];
        }
    }
    return 0;
}

/* recursion(inverse [w][9][9], gain [w][9][c], spread [w or 1][c + 9][c], moved [w][c + 9][c],
 *           fresh [w][c + 9][c + 9], start [c]) -> whether all covariances were positive definite */
static PyObject *recursion(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[6] = {3, 3, 3, 3, 3, 1};
    Py_buffer views[6];
    if (get_all(args, given, views, dimensions, 6, 3) < 0)
        return NULL;
    const Py_ssize_t count = views[3].shape[0], carry = views[5].shape[0], rows = carry + CHANNELS;
    const Py_ssize_t shapes[5][3] = {{count, CHANNELS, CHANNELS},
                                     {count, CHANNELS, carry},
                                     {views[2].shape[0] == 1 ? 1 : count, rows, carry},
                                     {count, rows, carry},
                                     {count, rows, rows}};
    if (carry < 1 || carry > MOST_CARRIED || !have(views, shapes, 5))
        return odd(views, 6);
    const double *moved = views[3].buf, *fresh = views[4].buf, *start = views[5].buf;
    const Py_ssize_t step = views[2].shape[0] == 1 ? 0 : rows * carry;
    double P[MOST_CARRIED * MOST_CARRIED], turned[MOST_CARRIED * MOST_ROWS], joint[MOST_ROWS * MOST_ROWS];
    int sound = 1;
    memset(P, 0, sizeof P);
    for (Py_ssize_t i = 0; i < carry; i++)
        P[i * carry + i] = start[i];
    for (Py_ssize_t k = 0; k < count && sound; k++) {
        const double *M = moved + k * rows * carry, *added = fresh + k * rows * rows;
        double *inverse = (double *)views[0].buf + k * CHANNELS * CHANNELS;
        double *B = (double *)views[1].buf + k * CHANNELS * carry, *MP = (double *)views[2].buf + k * step;
        multiply(rows, carry, carry, M, P, MP);
        for (Py_ssize_t i = 0; i < rows; i++)
            for (Py_ssize_t j = 0; j < carry; j++)
                turned[j * rows + i] = MP[i * carry + j];
        multiply(rows, carry, rows, M, turned, joint); /* M P M', which is symmetric */
        for (Py_ssize_t i = 0; i < rows * rows; i++)
            joint[i] += added[i];
        sound = inverse_factor(joint + carry * rows + carry, rows, inverse) == 0;
        if (!sound)
            break;
        for (Py_ssize_t i = 0; i < CHANNELS; i++)
            memcpy(turned + i * carry, joint + (carry + i) * rows, carry * sizeof(double));
        multiply(CHANNELS, CHANNELS, carry, inverse, turned, B);
        for (Py_ssize_t i = 0; i < carry; i++) {
            double *row = P + i * carry;
            memcpy(row, joint + i * rows, carry * sizeof(double));
            for (Py_ssize_t channel = 0; channel < CHANNELS; channel++) {
                const double factor = B[channel * carry + i], *other = B + channel * carry;
                for (Py_ssize_t j = 0; j < carry; j++)
                    row[j] -= factor * other[j];
            }
        }
    }
    release(views, 6);
    return PyBool_FromLong(sound);
}

/* row [width] += factor * other [width] */
static void add(double *restrict row, double factor, const double *restrict other, Py_ssize_t width)
{
    for (Py_ssize_t k = 0; k < width; k++)
        row[k] += factor * other[k];
}

/* apply(out [w][9][p], columns [w][9][p], moved [w][c + 9][c], inverse [w][9][9], gain [w][9][c], here [w][9]):
 * the columns, whitened; what is not here counts as zero. A tile of columns goes through all windows in turn. */
static PyObject *apply(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[6] = {3, 3, 3, 3, 3, 2};
    Py_buffer views[6];
    if (get_all(args, given, views, dimensions, 6, 1) < 0)
        return NULL;
    const Py_ssize_t count = views[0].shape[0], all = views[0].shape[2], carry = views[2].shape[2];
    const Py_ssize_t shapes[5][3] = {{count, CHANNELS, all},
                                     {count, CHANNELS, all},
                                     {count, carry + CHANNELS, carry},
                                     {count, CHANNELS, CHANNELS},
                                     {count, CHANNELS, carry}};
    if (carry < 1 || carry > MOST_CARRIED || !have(views, shapes, 5) || views[5].shape[0] != count ||
        views[5].shape[1] != CHANNELS)
        return odd(views, 6);
    double both[2][MOST_CARRIED][TILE], seen[CHANNELS][TILE], white[CHANNELS][TILE];
    for (Py_ssize_t first = 0; first < all; first += TILE) {
        const Py_ssize_t width = all - first < TILE ? all - first : TILE, bytes = width * sizeof(double);
        double(*state)[TILE] = both[0], (*after)[TILE] = both[1];
        memset(both, 0, sizeof both);
        for (Py_ssize_t k = 0; k < count; k++) {
            const double *M = (double *)views[2].buf + k * (carry + CHANNELS) * carry;
            const double *inverse = (double *)views[3].buf + k * CHANNELS * CHANNELS;
            const double *gain = (double *)views[4].buf + k * CHANNELS * carry;
            const double *here = (double *)views[5].buf + k * CHANNELS;
            const double *data = (double *)views[1].buf + k * CHANNELS * all + first;
            double *out = (double *)views[0].buf + k * CHANNELS * all + first;
            for (Py_ssize_t i = 0; i < CHANNELS; i++) {
                if (here[i] != 0.0)
                    memcpy(seen[i], data + i * all, bytes);
                else
                    memset(seen[i], 0, bytes);
                for (Py_ssize_t j = 0; j < carry; j++)
                    if (M[(carry + i) * carry + j] != 0.0)
                        add(seen[i], -M[(carry + i) * carry + j], state[j], width);
            }
            for (Py_ssize_t i = 0; i < CHANNELS; i++) {
                memset(white[i], 0, bytes);
                for (Py_ssize_t j = 0; j <= i; j++)
                    add(white[i], inverse[i * CHANNELS + j], seen[j], width);
                memcpy(out + i * all, white[i], bytes);
            }
            for (Py_ssize_t i = 0; i < carry; i++) {
                memset(after[i], 0, bytes);
                for (Py_ssize_t j = 0; j < carry; j++)
                    if (M[i * carry + j] != 0.0)
                        add(after[i], M[i * carry + j], state[j], width);
                for (Py_ssize_t j = 0; j < CHANNELS; j++)
                    add(after[i], gain[j * carry + i], white[j], width);
            }
            double(*spare)[TILE] = state;
            state = after;
            after = spare;
        }
    }
    release(views, 6);
    Py_RETURN_NONE;
}

/* chain(out [w][c][p], last [c][p], step [w][c][c], added [w][c][p]): out_k = x_k and x_(k + 1) = step_k x_k +
 * added_k from x_0 = 0 on; `last` is the x behind the last window. */
static PyObject *chain(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[4] = {3, 2, 3, 3};
    Py_buffer views[4];
    if (get_all(args, given, views, dimensions, 4, 2) < 0)
        return NULL;
    const Py_ssize_t count = views[0].shape[0], carry = views[0].shape[1], width = views[0].shape[2];
    const Py_ssize_t shapes[2][3] = {{count, carry, carry}, {count, carry, width}};
    if (!have(views + 2, shapes, 2) || views[1].shape[0] != carry || views[1].shape[1] != width)
        return odd(views, 4);
    double *states = views[0].buf, *last = views[1].buf;
    const Py_ssize_t size = carry * width;
    if (count)
        memset(states, 0, size * sizeof(double));
    else
        memset(last, 0, size * sizeof(double));
    for (Py_ssize_t k = 0; k < count; k++) {
        const double *step = (double *)views[2].buf + k * carry * carry, *state = states + k * size;
        double *after = k + 1 < count ? states + (k + 1) * size : last;
        memcpy(after, (double *)views[3].buf + k * size, size * sizeof(double));
        for (Py_ssize_t i = 0; i < carry; i++)
            for (Py_ssize_t j = 0; j < carry; j++)
                if (step[i * carry + j] != 0.0)
                    add(after + i * width, step[i * carry + j], state + j * width, width);
    }
    release(views, 4);
    Py_RETURN_NONE;
}

/* Sum of products of two rows [width]. */
static double product(const double *one, const double *other, Py_ssize_t width)
{
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    Py_ssize_t k = 0;
    for (; k + 4 <= width; k += 4)
        for (int lane = 0; lane < 4; lane++)
            sum[lane] += one[k + lane] * other[k + lane];
    for (; k < width; k++)
        sum[0] += one[k] * other[k];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* The states before each window [w][c][p], given the innovations [w][9][p]. */
static void filtered(Py_ssize_t count, Py_ssize_t carry, Py_ssize_t width, const double *moved, const double *gain,
                     const double *white, double *states)
{
    const Py_ssize_t rows = carry + CHANNELS, size = carry * width;
    if (count)
        memset(states, 0, size * sizeof(double));
    for (Py_ssize_t k = 0; k + 1 < count; k++) {
        const double *M = moved + k * rows * carry, *B = gain + k * CHANNELS * carry;
        const double *seen = white + k * CHANNELS * width, *state = states + k * size;
        double *after = states + (k + 1) * size;
        memset(after, 0, size * sizeof(double));
        for (Py_ssize_t i = 0; i < carry; i++) {
            for (Py_ssize_t j = 0; j < carry; j++)
                if (M[i * carry + j] != 0.0)
                    add(after + i * width, M[i * carry + j], state + j * width, width);
            for (Py_ssize_t j = 0; j < CHANNELS; j++)
                add(after + i * width, B[j * carry + i], seen + j * width, width);
        }
    }
}

/* The scores of carried states and channels [c + 9][p] at a window, of which `zeta` holds those of the states after
 * it; behind these it has room for 9 rows more. */
static void score_channels(Py_ssize_t carry, Py_ssize_t width, const double *B, const double *inverse,
                           const double *white, double *zeta)
{
    double *error = zeta + carry * width, *left = error + CHANNELS * width;
    memcpy(left, white, CHANNELS * width * sizeof(double));
    memset(error, 0, CHANNELS * width * sizeof(double));
    for (Py_ssize_t i = 0; i < CHANNELS; i++) {
        for (Py_ssize_t j = 0; j < carry; j++)
            add(left + i * width, -B[i * carry + j], zeta + j * width, width);
        for (Py_ssize_t j = 0; j <= i; j++)
            add(error + j * width, inverse[i * CHANNELS + j], left + i * width, width);
    }
}

/* What carried states and channels tell together [c + 9][c + 9], by what is told of the states after a window N
 * [c][c]: [N, -N K; -K' N, K' N K + (L L')^-1]. */
static void joint_information(Py_ssize_t carry, const double *B, const double *inverse, const double *N, double *Z)
{
    const Py_ssize_t rows = carry + CHANNELS;
    double K[MOST_CARRIED * CHANNELS], NK[MOST_CARRIED * CHANNELS];
    memset(K, 0, sizeof K);
    for (Py_ssize_t i = 0; i < carry; i++)
        for (Py_ssize_t m = 0; m < CHANNELS; m++)
            for (Py_ssize_t j = 0; j <= m; j++)
                K[i * CHANNELS + j] += B[m * carry + i] * inverse[m * CHANNELS + j];
    multiply(carry, carry, CHANNELS, N, K, NK);
    for (Py_ssize_t i = 0; i < carry; i++) {
        memcpy(Z + i * rows, N + i * carry, carry * sizeof(double));
        for (Py_ssize_t j = 0; j < CHANNELS; j++)
            Z[i * rows + carry + j] = Z[(carry + j) * rows + i] = -NK[i * CHANNELS + j];
    }
    for (Py_ssize_t i = 0; i < CHANNELS; i++) {
        double *row = Z + (carry + i) * rows + carry;
        memset(row, 0, CHANNELS * sizeof(double));
        for (Py_ssize_t m = 0; m < carry; m++)
            add(row, K[m * CHANNELS + i], NK + m * CHANNELS, CHANNELS);
        for (Py_ssize_t m = i; m < CHANNELS; m++)
            add(row, inverse[m * CHANNELS + i], inverse + m * CHANNELS, m + 1);
    }
}

/* scores(variance_out [w][9], decay_out [w][s], fresh_out [w][s], start_out [c], room [w][c][p], room [2 (c + 9)][p],
 *        moved [w][c + 9][c], joint [w][c + 9][s], inverse [w][9][9], gain [w][9][c], spread [w][c + 9][c],
 *        white [w][9][p], carried [c]): derivatives of -1/2 (log-determinant + squares of white), by scores.py. */
static PyObject *scores(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    enum { VARIANCE, DECAY, FRESH, START, STATES, ZETA, MOVED, JOINT, INVERSE, GAIN, SPREAD, WHITE, CARRIED, ALL };
    static const int dimensions[ALL] = {2, 2, 2, 1, 3, 2, 3, 3, 3, 3, 3, 3, 1};
    Py_buffer views[ALL];
    if (get_all(args, given, views, dimensions, ALL, MOVED) < 0)
        return NULL;
    const Py_ssize_t count = views[WHITE].shape[0], width = views[WHITE].shape[2], carry = views[CARRIED].shape[0];
    const Py_ssize_t rows = carry + CHANNELS, every = views[JOINT].shape[2];
    const Py_ssize_t shapes[6][3] = {{count, rows, carry},         {count, rows, every}, {count, CHANNELS, CHANNELS},
                                     {count, CHANNELS, carry},     {count, rows, carry}, {count, CHANNELS, width}};
    const Py_ssize_t flat[4][2] = {{count, CHANNELS}, {count, every}, {count, every}, {2 * rows, width}};
    static const int of_flat[4] = {VARIANCE, DECAY, FRESH, ZETA};
    int fit = carry >= 1 && carry <= MOST_CARRIED && every <= MOST_STATES && have(views + MOVED, shapes, 6) &&
              views[START].shape[0] == carry && views[STATES].shape[0] == count && views[STATES].shape[1] == carry &&
              views[STATES].shape[2] == width;
    for (int i = 0; i < 4; i++)
        fit = fit && views[of_flat[i]].shape[0] == flat[i][0] && views[of_flat[i]].shape[1] == flat[i][1];
    const double *carried = views[CARRIED].buf;
    for (Py_ssize_t i = 0; fit && i < carry; i++)
        fit = carried[i] >= 0.0 && carried[i] < every;
    if (!fit)
        return odd(views, ALL);
    double *states = views[STATES].buf, *zeta = views[ZETA].buf, *start = views[START].buf;
    double N[MOST_CARRIED * MOST_CARRIED], Z[MOST_ROWS * MOST_ROWS], S[MOST_ROWS * MOST_ROWS];
    double turned[MOST_CARRIED * MOST_ROWS], back[MOST_ROWS * MOST_CARRIED];
    filtered(count, carry, width, views[MOVED].buf, views[GAIN].buf, views[WHITE].buf, states);
    memset(N, 0, sizeof N);
    memset(zeta, 0, carry * width * sizeof(double));
    for (Py_ssize_t k = count - 1; k >= 0; k--) {
        const double *M = (double *)views[MOVED].buf + k * rows * carry;
        const double *J = (double *)views[JOINT].buf + k * rows * every;
        const double *inverse = (double *)views[INVERSE].buf + k * CHANNELS * CHANNELS;
        const double *B = (double *)views[GAIN].buf + k * CHANNELS * carry;
        const double *MP = (double *)views[SPREAD].buf + k * rows * carry;
        const double *white = (double *)views[WHITE].buf + k * CHANNELS * width, *state = states + k * carry * width;
        double *variance = (double *)views[VARIANCE].buf + k * CHANNELS;
        double *decay = (double *)views[DECAY].buf + k * every, *fresh = (double *)views[FRESH].buf + k * every;
        score_channels(carry, width, B, inverse, white, zeta);
        joint_information(carry, B, inverse, N, Z);
        for (Py_ssize_t i = 0; i < rows; i++)
            for (Py_ssize_t j = i; j < rows; j++)
                S[i * rows + j] = S[j * rows + i] =
                    product(zeta + i * width, zeta + j * width, width) - Z[i * rows + j];
        for (Py_ssize_t i = 0; i < CHANNELS; i++)
            variance[i] = 0.5 * S[(carry + i) * rows + carry + i];
        memset(decay, 0, every * sizeof(double));
        for (Py_ssize_t s = 0; s < every; s++) {
            Py_ssize_t at[MOST_ROWS], found = 0;
            for (Py_ssize_t i = 0; i < rows; i++)
                if (J[i * every + s] != 0.0)
                    at[found++] = i;
            double sum = 0.0;
            for (Py_ssize_t i = 0; i < found; i++)
                for (Py_ssize_t j = 0; j < found; j++)
                    sum += J[at[i] * every + s] * J[at[j] * every + s] * S[at[i] * rows + at[j]];
            fresh[s] = 0.5 * sum;
            for (Py_ssize_t own = 0; own < carry; own++) {
                if ((Py_ssize_t)carried[own] != s)
                    continue;
                for (Py_ssize_t i = 0; i < found; i++) {
                    sum = product(zeta + at[i] * width, state + own * width, width);
                    for (Py_ssize_t m = 0; m < rows; m++)
                        sum += S[at[i] * rows + m] * MP[m * carry + own];
                    decay[s] += J[at[i] * every + s] * sum;
                }
            }
        }
        /* N before the window is M' Z M, and the states' score before it M' zeta. */
        memset(turned, 0, carry * rows * sizeof(double));
        for (Py_ssize_t m = 0; m < rows; m++)
            for (Py_ssize_t j = 0; j < carry; j++)
                if (M[m * carry + j] != 0.0)
                    add(turned + j * rows, M[m * carry + j], Z + m * rows, rows);
        for (Py_ssize_t m = 0; m < rows; m++)
            for (Py_ssize_t j = 0; j < carry; j++)
                back[m * carry + j] = turned[j * rows + m];
        memset(N, 0, carry * carry * sizeof(double));
        double *before = zeta + rows * width;
        memset(before, 0, carry * width * sizeof(double));
        for (Py_ssize_t m = 0; m < rows; m++)
            for (Py_ssize_t j = 0; j < carry; j++)
                if (M[m * carry + j] != 0.0) {
                    add(N + j * carry, M[m * carry + j], back + m * carry, carry);
                    add(before + j * width, M[m * carry + j], zeta + m * width, width);
                }
        memcpy(zeta, before, carry * width * sizeof(double));
        /* What rounding makes unsymmetric would grow, for nothing that is measured holds it. */
        for (Py_ssize_t i = 0; i < carry; i++)
            for (Py_ssize_t j = 0; j < i; j++)
                N[i * carry + j] = N[j * carry + i] = 0.5 * (N[i * carry + j] + N[j * carry + i]);
    }
    for (Py_ssize_t i = 0; i < carry; i++)
        start[i] = 0.5 * (product(zeta + i * width, zeta + i * width, width) - N[i * carry + i]);
    release(views, ALL);
    Py_RETURN_NONE;
}

#define FAST(name, doc) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, doc}
static PyMethodDef methods[] = {
    FAST(recursion, "Gains of all windows."),
    FAST(apply, "Whiten columns."),
    FAST(chain, "States of a linear recursion."),
    FAST(scores, "Derivatives of the likelihood."),
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.offline.inference._gains", "Gains of the whitening filter.", 0, methods, slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__gains(void)
{
    return PyModuleDef_Init(&module);
}
