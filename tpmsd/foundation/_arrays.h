/* Arguments of the compiled parts: arrays of doubles, C-contiguous. Included by `onboard/estimators/bank/_bank.c` and
 * `offline/inference/_gains.c`, after their `Py_LIMITED_API`.
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

#endif
