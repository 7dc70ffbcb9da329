/* The commonest NMEA sentences, compiled: the same values as `nmea_sentence` makes of them with regular
 * expressions, which is the reference (tests/onboard/gnss/test_nmea_kernel.py).
 *
 * In: one line. Out: the values of an `NmeaReading` in its order, where the line is RMC, GGA or VTG, or a sentence
 * that nothing is taken from, with a true checksum and fields of the usual form, empty ones too. Nothing (None) for
 * whatever else it is: wrong, impossible or unusual, which is left to the caller.
 */
#define Py_LIMITED_API 0x030b0000
#define PY_SSIZE_T_CLEAN
#include "../../../foundation/_sources.h"
#include <Python.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

/* As in `nmea_sentence`. */
#define KNOT_MPS (1852.0 / 3600.0)
#define KMH_MPS (1.0 / 3.6)
#define MAX_SPEED_MPS 150.0
#define RADIANS (3.14159265358979323846 / 180.0)
enum { HEAD = 7, FIELDS = 12, VALUES = 16 };
enum { EXACT_DIGITS = 15 }; /* so many digits are exact as a double, and so is 10 to that power */
enum { NO_DAY = INT32_MIN, UNKNOWN = -1 };
static const double TENS[EXACT_DIGITS + 1] = {1,   1e1, 1e2,  1e3,  1e4,  1e5,  1e6,  1e7,
                                              1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15};

struct field {
    const char *at;
    Py_ssize_t size;
};

struct reading {
    const char *kind;
    int day, valid, quality;
    double time_s, latitude, longitude, altitude, hdop, speed, course;
};

static int is_digit(char character)
{
    return character >= '0' && character <= '9';
}

static int is_upper(char character)
{
    return character >= 'A' && character <= 'Z';
}

static int nibble(char character)
{
    if (is_digit(character))
        return character - '0';
    character |= 0x20; /* to a small letter */
    return character >= 'a' && character <= 'f' ? character - 'a' + 10 : -1;
}

/* Each of the functions below is true if the field has the usual form, and then sets the value. */

/* A number without a sign; NaN for an empty field. */
static int number(struct field text, double *value)
{
    int64_t digits = 0;
    int count = 0, decimals = -1;
    *value = NAN;
    for (Py_ssize_t k = 0; k < text.size; k++) {
        if (text.at[k] == '.' && decimals < 0) {
            decimals = 0;
            continue;
        }
        if (!is_digit(text.at[k]) || ++count > EXACT_DIGITS)
            return 0;
        digits = digits * 10 + (text.at[k] - '0');
        decimals += decimals >= 0;
    }
    if (text.size == 0)
        return 1;
    *value = (double)digits / TENS[decimals > 0 ? decimals : 0];
    return count > 0;
}

static int signed_number(struct field text, double *value)
{
    int minus = text.size > 1 && text.at[0] == '-';
    if (!number((struct field){text.at + minus, text.size - minus}, value))
        return 0;
    *value = minus ? -*value : *value;
    return 1;
}

/* The number of digits before a point or the end. */
static Py_ssize_t whole(struct field text)
{
    Py_ssize_t k = 0;
    while (k < text.size && is_digit(text.at[k]))
        k++;
    return k == text.size || text.at[k] == '.' ? k : -1;
}

static int pair(const char *at)
{
    return 10 * (at[0] - '0') + (at[1] - '0');
}

static int time_of_day(struct field text, double *value)
{
    double second;
    *value = NAN;
    if (text.size == 0)
        return 1;
    if (whole(text) != 6 || !number((struct field){text.at + 4, text.size - 4}, &second))
        return 0;
    int hour = pair(text.at), minute = pair(text.at + 2);
    *value = 3600.0 * hour + 60.0 * minute + second;
    return hour <= 23 && minute <= 59 && second < 61.0;
}

static int angle(struct field text, struct field side, double limit, double *value)
{
    Py_ssize_t digits = whole(text);
    double degrees, minutes;
    if (digits < 3 || digits > 5 || side.size != 1 || !strchr("NSEW", side.at[0]) ||
        !number((struct field){text.at, digits - 2}, &degrees) ||
        !number((struct field){text.at + digits - 2, text.size - digits + 2}, &minutes))
        return 0;
    *value = degrees + minutes / 60.0;
    if (minutes >= 60.0 || *value > limit)
        return 0;
    if (side.at[0] == 'S' || side.at[0] == 'W')
        *value = -*value;
    return 1;
}

static int position(const struct field *fields, struct reading *found)
{
    if (fields[0].size + fields[1].size + fields[2].size + fields[3].size == 0)
        return 1;
    return angle(fields[0], fields[1], 90.0, &found->latitude) && angle(fields[2], fields[3], 180.0, &found->longitude);
}

static int course(struct field text, double *value)
{
    double degrees;
    *value = NAN;
    if (!number(text, &degrees) || degrees > 360.0)
        return 0;
    if (!isnan(degrees))
        *value = (degrees == 360.0 ? 0.0 : degrees) * RADIANS;
    return 1;
}

static int speed(double mps, double *value)
{
    *value = mps;
    return isnan(mps) || mps <= MAX_SPEED_MPS;
}

/* Days since 1970-01-01 of a date of six digits; the year is one from 1980 to 2079. */
static int date(struct field text, int *value)
{
    static const int before[] = {0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365};
    *value = NO_DAY;
    if (text.size == 0)
        return 1;
    if (text.size != 6 || whole(text) != 6)
        return 0;
    int day = pair(text.at), month = pair(text.at + 2), year = pair(text.at + 4);
    year += year >= 80 ? 1900 : 2000;
    if (month < 1 || month > 12)
        return 0;
    int leap = year % 4 == 0; /* 2000 is one */
    if (day < 1 || day > before[month] - before[month - 1] + (leap && month == 2))
        return 0;
    *value = 365 * (year - 1970) + (year - 1969) / 4 + before[month - 1] + (leap && month > 2) + day - 1;
    return 1;
}

/* The quality of a mode's letter; as it was for an empty field. */
static int mode(struct field text, int *quality)
{
    static const char letters[] = "NADPRFEMS"; /* in the order of their qualities */
    const char *at;
    if (text.size == 0)
        return 1;
    if (text.size != 1 || !(at = strchr(letters, text.at[0])))
        return 0;
    *quality = (int)(at - letters);
    return 1;
}

static int measured(int quality)
{
    return quality >= 1 && quality <= 8 && quality != 7;
}

static int rmc(const struct field *fields, struct reading *found)
{
    double knots;
    if (fields[1].size != 1 || !strchr("AV", fields[1].at[0]))
        return 0;
    found->quality = 1;
    if (!mode(fields[11], &found->quality) || !time_of_day(fields[0], &found->time_s) ||
        !position(fields + 2, found) || !number(fields[6], &knots) || !speed(knots * KNOT_MPS, &found->speed) ||
        !course(fields[7], &found->course) || !date(fields[8], &found->day))
        return 0;
    if (fields[1].at[0] == 'V')
        found->quality = 0;
    found->valid = measured(found->quality);
    return 1;
}

static int gga(const struct field *fields, struct reading *found)
{
    double separation;
    if (fields[5].size != 1 || !is_digit(fields[5].at[0]))
        return 0;
    found->quality = fields[5].at[0] - '0';
    found->valid = measured(found->quality);
    if (!time_of_day(fields[0], &found->time_s) || !position(fields + 1, found) || !number(fields[7], &found->hdop) ||
        !signed_number(fields[8], &found->altitude) || !signed_number(fields[10], &separation))
        return 0;
    if (!isnan(separation))
        found->altitude += separation;
    return 1;
}

static int vtg(const struct field *fields, struct reading *found)
{
    double knots, kmh;
    if (!mode(fields[8], &found->quality) || !course(fields[0], &found->course) || !number(fields[4], &knots) ||
        !number(fields[6], &kmh) || !speed(isnan(kmh) ? knots * KNOT_MPS : kmh * KMH_MPS, &found->speed))
        return 0;
    if (found->quality != UNKNOWN)
        found->valid = measured(found->quality);
    return 1;
}

/* Whether the line is a sentence with a true checksum: its address, a comma, printable characters without blanks. */
static int is_sound(const char *line, Py_ssize_t size, const char **star)
{
    uint8_t sum = 0;
    if (size < HEAD + 3 || line[0] != '$' || line[1] == 'P' || line[HEAD - 1] != ',')
        return 0;
    for (int k = 1; k < HEAD - 1; k++)
        if (!is_upper(line[k]) && !is_digit(line[k]))
            return 0;
    *star = memchr(line, '*', (size_t)size);
    if (!*star || line + size - *star != 3)
        return 0;
    int high = nibble((*star)[1]), low = nibble((*star)[2]);
    for (const char *at = line + 1; at < *star; at++) {
        if (*at <= ' ' || *at > '~')
            return 0;
        sum ^= (uint8_t)*at;
    }
    return high >= 0 && low >= 0 && sum == (high << 4 | low);
}

static int read_line(const char *line, Py_ssize_t size, struct reading *found)
{
    static const char *const others[] = {"ZDA", "GST", "GNS", "GLL"};
    const char *star, *at = line + HEAD, *kind = line + 3;
    struct field fields[FIELDS] = {{NULL, 0}};
    if (!is_sound(line, size, &star))
        return 0;
    for (int k = 0; k < FIELDS && at <= star; k++) {
        const char *end = memchr(at, ',', (size_t)(star - at));
        fields[k] = (struct field){at, (end ? end : star) - at};
        at += fields[k].size + 1;
    }
    if (!memcmp(kind, "RMC", 3))
        return found->kind = "RMC", rmc(fields, found);
    if (!memcmp(kind, "GGA", 3))
        return found->kind = "GGA", gga(fields, found);
    if (!memcmp(kind, "VTG", 3))
        return found->kind = "VTG", vtg(fields, found);
    for (int k = 0; k < 4; k++)
        if (!memcmp(kind, others[k], 3))
            return 0;
    found->kind = "other";
    return 1;
}

static PyObject *known(int there, PyObject *value)
{
    if (there)
        return value;
    Py_XDECREF(value);
    Py_RETURN_NONE;
}

static PyObject *made_of(double value, PyObject *nan)
{
    if (!isnan(value))
        return PyFloat_FromDouble(value);
    Py_INCREF(nan);
    return nan;
}

/* decode(line, nan) -> values of an NmeaReading, or None; `nan` stands for numbers that it lacks, the same
 * object as in the reference: readings that lack the same are equal then */
static PyObject *decode(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    struct reading found = {NULL, NO_DAY, UNKNOWN, UNKNOWN, NAN, NAN, NAN, NAN, NAN, NAN, NAN};
    Py_buffer view;
    if (given != 2) {
        PyErr_SetString(PyExc_ValueError, "two arguments are needed");
        return NULL;
    }
    PyObject *nan = args[1];
    if (PyObject_GetBuffer(args[0], &view, PyBUF_SIMPLE) < 0)
        return NULL;
    int is_read = read_line(view.buf, view.len, &found);
    PyBuffer_Release(&view);
    if (!is_read)
        Py_RETURN_NONE;
    PyObject *values[VALUES] = {
        PyUnicode_InternFromString(found.kind),
        PyBool_FromLong(1),
        PyBool_FromLong(0),
        made_of(found.time_s, nan),
        known(found.day != NO_DAY, PyLong_FromLong(found.day)),
        known(found.valid != UNKNOWN, PyBool_FromLong(found.valid)),
        made_of(found.latitude, nan),
        made_of(found.longitude, nan),
        made_of(found.altitude, nan),
        known(found.quality != UNKNOWN, PyLong_FromLong(found.quality)),
        made_of(found.hdop, nan),
        made_of(found.speed, nan),
        made_of(found.course, nan),
        made_of(NAN, nan),
        made_of(NAN, nan),
        PyUnicode_InternFromString(""),
    };
    PyObject *made = PyTuple_New(VALUES);
    for (int k = 0; k < VALUES; k++) {
        if (made && values[k]) {
            PyTuple_SetItem(made, k, values[k]); /* takes the reference */
            continue;
        }
        Py_XDECREF(values[k]);
        Py_CLEAR(made);
    }
    return made;
}

static PyMethodDef methods[] = {
    {"decode", (PyCFunction)(void (*)(void))decode, METH_FASTCALL, "Read one of the commonest sentences."},
    {NULL, NULL, 0, NULL},
};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.onboard.sources.gnss._nmea", "Sentences of NMEA 0183.", 0, methods, slots, NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__nmea(void)
{
    return PyModuleDef_Init(&module);
}
