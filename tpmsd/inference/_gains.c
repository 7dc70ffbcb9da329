/* The recursions of the whitening filter, compiled: the same as `gains.py` has for NumPy arrays, which is the
 * reference (tests/inference/test_gains.py).
 *
 * In and out: C-contiguous double arrays. Nothing is allocated. What makes it fast beside NumPy is that rows of
 * the moving matrix hold few numbers that are not zero. Floating-point contraction is off (setup.py).
 */
#define Py_LIMITED_API 0x030b0000
#include "../_arrays.h"
#include <math.h>
#include <string.h>

enum { CHANNELS = 9, MOST_CARRIED = 48, MOST_ROWS = MOST_CARRIED + CHANNELS, TILE = 64 };

/* The arrays of a call, of which the first `writable` are written to. */
static int get_all(PyObject *const *objects, Py_ssize_t given, Py_buffer *views, const int *dimensions, int count,
                   int writable)
{
    if (given != count) {
        PyErr_Format(PyExc_ValueError, "%d arrays are needed", count);
        return -1;
    }
    for (int i = 0; i < count; i++)
        if (get(objects[i], &views[i], dimensions[i], i < writable) < 0) {
            release(views, i);
            return -1;
        }
    return 0;
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

#define FAST(name, doc) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, doc}
static PyMethodDef methods[] = {
    FAST(recursion, "Gains of all windows."),
    FAST(apply, "Whiten columns."),
    FAST(chain, "States of a linear recursion."),
    {NULL, NULL, 0, NULL},
};
static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.inference._gains", "Gains of the whitening filter.", 0, methods, slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__gains(void)
{
    return PyModuleDef_Init(&module);
}
