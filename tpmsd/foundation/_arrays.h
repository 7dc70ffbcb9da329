/* Arguments of the compiled parts: arrays of doubles, C-contiguous. Included by `onboard/estimators/bank/_bank.c`,
 * `onboard/monitor/evidence/_evidence.c` and `offline/inference/_gains.c`, after their `Py_LIMITED_API`.
 */
#ifndef TPMSD_ARRAYS_H
#define TPMSD_ARRAYS_H
#define PY_SSIZE_T_CLEAN
#include <Python.h>

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

/* 0 where no array that is written to, of which the first `writable` are, shares memory with another; else -1
 * with an exception. The code after it is compiled as if they were apart. */
static int apart(const Py_buffer *views, int count, int writable)
{
    for (int i = 0; i < writable; i++)
        for (int j = i + 1; j < count; j++) {
            const char *one = views[i].buf, *other = views[j].buf;
            if (one < other + views[j].len && other < one + views[i].len) {
                PyErr_SetString(PyExc_ValueError, "an array that is written to shares memory with another");
                return -1;
            }
        }
    return 0;
}

/* All of several arrays, of which the first `writable` are written to; 0, or -1 with none held and an exception. */
static inline int get_arrays(PyObject *const *objects, Py_buffer *views, const int *dimensions, int count, int writable)
{
    for (int i = 0; i < count; i++)
        if (get(objects[i], &views[i], dimensions[i], i < writable) < 0) {
            release(views, i);
            return -1;
        }
    if (apart(views, count, writable) < 0) {
        release(views, count);
        return -1;
    }
    return 0;
}

/* Doubles of several objects; 0, or -1 with an exception. */
static inline int numbers(PyObject *const *objects, Py_ssize_t count, double *out)
{
    for (Py_ssize_t i = 0; i < count; i++) {
        out[i] = PyFloat_AsDouble(objects[i]);
        if (out[i] == -1.0 && PyErr_Occurred())
            return -1;
    }
    return 0;
}

#endif
