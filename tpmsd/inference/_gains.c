/* The gains of the whitening filter, compiled: the same recursion as `ArrayGains` in `gains.py` has for NumPy
 * arrays, which is the reference (tests/inference/test_gains.py).
 *
 * In and out: C-contiguous double arrays. Nothing is allocated. What makes it fast beside NumPy is that rows of
 * the moving matrix hold few numbers that are not zero. Floating-point contraction is off (setup.py).
 */
#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <math.h>
#include <string.h>

enum { CHANNELS = 9, MOST_CARRIED = 48, MOST_ROWS = MOST_CARRIED + CHANNELS };

static int get(PyObject *object, Py_buffer *view, int dimensions, int writable)
{
    int flags = PyBUF_C_CONTIGUOUS | PyBUF_FORMAT | (writable ? PyBUF_WRITABLE : 0);
    if (PyObject_GetBuffer(object, view, flags) < 0)
        return -1;
    if (view->ndim == dimensions && view->format && view->format[0] == 'd' && !view->format[1])
        return 0;
    PyBuffer_Release(view);
    PyErr_Format(PyExc_ValueError, "an array of %d dimensions of doubles is needed", dimensions);
    return -1;
}

static void release(Py_buffer *views, int count)
{
    while (count--)
        PyBuffer_Release(&views[count]);
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
    if (given != 6) {
        PyErr_SetString(PyExc_ValueError, "six arrays are needed");
        return NULL;
    }
    for (int i = 0; i < 6; i++)
        if (get(args[i], &views[i], dimensions[i], i < 3) < 0) {
            release(views, i);
            return NULL;
        }
    const Py_ssize_t count = views[3].shape[0], carry = views[5].shape[0], rows = carry + CHANNELS;
    const Py_ssize_t shapes[5][3] = {{count, CHANNELS, CHANNELS},
                                     {count, CHANNELS, carry},
                                     {views[2].shape[0] == 1 ? 1 : count, rows, carry},
                                     {count, rows, carry},
                                     {count, rows, rows}};
    int fits = carry > 0 && carry <= MOST_CARRIED;
    for (int i = 0; i < 5; i++)
        for (int axis = 0; axis < 3; axis++)
            fits = fits && views[i].shape[axis] == shapes[i][axis];
    if (!fits) {
        release(views, 6);
        PyErr_SetString(PyExc_ValueError, "the arrays do not belong together");
        return NULL;
    }
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

static PyMethodDef methods[] = {
    {"recursion", (PyCFunction)(void (*)(void))recursion, METH_FASTCALL, "Gains of all windows."},
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
