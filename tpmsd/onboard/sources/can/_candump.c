/* The commonest lines of `candump -L`, compiled: the same frames as `candump_text` makes of them with NumPy
 * arrays, which is the reference (tests/onboard/sources_can/test_candump_text.py).
 *
 * In: whole lines of text, the name of a channel, arrays with a row per line. Out: the rows of those lines that
 * are `(stamp) channel identifier#data` of a classic data frame on that channel, and which ones those are. All
 * other lines are left to the caller. Nothing is allocated.
 */
#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include "../../../foundation/_sources.h"
#include <Python.h>
#include <stdint.h>
#include <string.h>

/* As in `candump_line`, `signal_plan` and `can_block`. */
#define ERROR_FLAG 0x20000000u
#define EXTENDED 0x80000000u
enum { MAX_STANDARD = 0x7FF, CLASSIC_BYTES = 8 };
enum { WHOLE_DIGITS = 10, FRACTION_DIGITS = 9 }; /* 19 in all, which 64 bits hold */
/* A stamp of fewer digits is exact as an integer and so is its division by a power of ten. */
static const uint64_t EXACT_BELOW = 9000000000000000u;
static const double TENS[FRACTION_DIGITS + 1] = {1, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9};

struct row {
    double time_s;
    uint32_t identifier;
    uint8_t size, data[CLASSIC_BYTES];
};

static int nibble(char character)
{
    if (character >= '0' && character <= '9')
        return character - '0';
    character |= 0x20; /* to a small letter */
    return character >= 'a' && character <= 'f' ? character - 'a' + 10 : -1;
}

/* Read up to `most` digits; NULL if there is none. */
static const char *digits(const char *at, const char *end, int most, uint64_t *value, int *count)
{
    for (*count = 0; at < end && *count < most && *at >= '0' && *at <= '9'; at++, ++*count)
        *value = *value * 10 + (uint64_t)(*at - '0');
    return *count ? at : NULL;
}

/* Skip blanks and tabs, of which there must be one. */
static const char *gap(const char *at, const char *end)
{
    const char *begin = at;
    while (at < end && (*at == ' ' || *at == '\t'))
        at++;
    return at > begin ? at : NULL;
}

/* Whether a line is such a frame, which is put into the row. */
static int read_line(const char *at, const char *end, const char *channel, Py_ssize_t length, struct row *row)
{
    uint64_t stamp = 0;
    uint32_t identifier = 0;
    int whole, fraction, width = 0, high, low;
    if (at >= end || *at++ != '(' || !(at = digits(at, end, WHOLE_DIGITS, &stamp, &whole)) || at >= end ||
        *at++ != '.' || !(at = digits(at, end, FRACTION_DIGITS, &stamp, &fraction)) || at >= end ||
        *at++ != ')' || stamp >= EXACT_BELOW || !(at = gap(at, end)))
        return 0;
    if (end - at < length || memcmp(at, channel, (size_t)length) != 0 || !(at = gap(at + length, end)))
        return 0;
    for (; at < end && width < 8 && (high = nibble(*at)) >= 0; at++, width++)
        identifier = identifier << 4 | (uint32_t)high;
    if (at >= end || *at++ != '#' || (width == 3 ? identifier > MAX_STANDARD : width != 8 || identifier & ERROR_FLAG))
        return 0;
    row->identifier = width == 3 ? identifier : (identifier & (ERROR_FLAG - 1)) | EXTENDED;
    row->size = 0;
    while (at < end) {
        if (row->size == CLASSIC_BYTES || end - at < 2 || (high = nibble(at[0])) < 0 || (low = nibble(at[1])) < 0)
            return 0;
        row->data[row->size++] = (uint8_t)(high << 4 | low);
        at += 2;
    }
    row->time_s = (double)stamp / TENS[fraction];
    return 1;
}

/* lines(text, channel, found [n], time_s [n], identifier [n], size [n], data [n][8]) -> lines found; n lines,
 * each with its line end */
static PyObject *lines(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    enum { TEXT, CHANNEL, FOUND, TIME, IDENTIFIER, SIZE, DATA, ARGUMENTS };
    static const Py_ssize_t bytes[ARGUMENTS] = {1, 1, 1, sizeof(double), sizeof(uint32_t), 1, CLASSIC_BYTES};
    Py_buffer views[ARGUMENTS];
    int got = 0;
    if (given != ARGUMENTS) {
        PyErr_SetString(PyExc_ValueError, "seven arguments are needed");
        return NULL;
    }
    for (; got < ARGUMENTS; got++)
        if (PyObject_GetBuffer(args[got], &views[got], got < FOUND ? PyBUF_SIMPLE : PyBUF_WRITABLE) < 0)
            break;
    Py_ssize_t count = got > FOUND ? views[FOUND].len : 0, number = 0, found = 0;
    int fits = got == ARGUMENTS;
    for (int k = TIME; fits && k < ARGUMENTS; k++)
        fits = views[k].len == count * bytes[k];
    if (fits) {
        const char *at = views[TEXT].buf, *last = at + views[TEXT].len, *end;
        struct row row;
        for (; number < count && at < last && (end = memchr(at, '\n', (size_t)(last - at))); number++, at = end + 1) {
            if (!read_line(at, end, views[CHANNEL].buf, views[CHANNEL].len, &row))
                continue;
            ((uint8_t *)views[FOUND].buf)[number] = 1;
            ((double *)views[TIME].buf)[number] = row.time_s;
            ((uint32_t *)views[IDENTIFIER].buf)[number] = row.identifier;
            ((uint8_t *)views[SIZE].buf)[number] = row.size;
            memcpy((uint8_t *)views[DATA].buf + number * CLASSIC_BYTES, row.data, row.size);
            found++;
        }
    }
    for (int k = 0; k < got; k++)
        PyBuffer_Release(&views[k]);
    if (fits)
        return PyLong_FromSsize_t(found);
    if (!PyErr_Occurred())
        PyErr_SetString(PyExc_ValueError, "the arrays do not belong together");
    return NULL;
}

static PyMethodDef methods[] = {
    {"lines", (PyCFunction)(void (*)(void))lines, METH_FASTCALL, "Read the commonest lines of a log."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.onboard.sources.can._candump", "Lines of candump.", 0, methods, slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__candump(void)
{
    return PyModuleDef_Init(&module);
}
