/* Comparison of hypotheses about the radii, compiled: the same formulas as `hypotheses` and `sizes` have for NumPy
 * arrays, which are the reference (tests/onboard/monitor/test_evidence_kernel.py).
 *
 * In and out: C-contiguous double arrays; d wheels, n changes, r rows of sizes, h hypotheses of which the first s are
 * losses, g sizes of a loss. Nothing is allocated. Floating-point contraction is off (setup.py), so that machines
 * with and without fused multiply-add round alike.
 */
#define Py_LIMITED_API 0x030b0000
#include "../../../foundation/_arrays.h"
#include <math.h>

enum { MOST_WHEELS = 4, MOST_HYPOTHESES = 19, MOST_LOSSES = 64 };
static const double UNKNOWN = -1e300, NO_EXPONENT = -746.0, LEAST_STD = 1e-12;

static PyObject *unfit(Py_buffer *views, int count)
{
    release(views, count);
    PyErr_SetString(PyExc_ValueError, "the arrays do not belong together");
    return NULL;
}

/* exp, where far below 0 nothing is computed. */
static double power(double x)
{
    return x < NO_EXPONENT ? 0.0 : exp(x);
}

static double normal_cdf(double z)
{
    return 0.5 * erfc(-z / sqrt(2.0));
}

/* Lower Cholesky factor of a (d, d) matrix; 0 where it is not positive definite. */
static int factor(const double *matrix, Py_ssize_t d, double *root)
{
    for (Py_ssize_t i = 0; i < d; i++)
        for (Py_ssize_t j = 0; j <= i; j++) {
            double sum = matrix[i * d + j];
            for (Py_ssize_t k = 0; k < j; k++)
                sum -= root[i * d + k] * root[j * d + k];
            if (i != j)
                root[i * d + j] = sum / root[j * d + j];
            else if (sum > 0.0)
                root[i * d + i] = sqrt(sum);
            else
                return 0;
        }
    return 1;
}

/* The vector that the factor's product with it makes `given` of: what is white of it. */
static void whiten(const double *root, Py_ssize_t d, const double *given, double *white)
{
    for (Py_ssize_t i = 0; i < d; i++) {
        double sum = given[i];
        for (Py_ssize_t k = 0; k < i; k++)
            sum -= root[i * d + k] * white[k];
        white[i] = sum / root[i * d + i];
    }
}

static double product(const double *one, const double *other, Py_ssize_t d)
{
    double sum = 0.0;
    for (Py_ssize_t i = 0; i < d; i++)
        sum += one[i] * other[i];
    return sum;
}

/* ---- wheels of another size ----------------------------------------------------------------------------- */

/* with_sizes(change_out [rm][d], covariance_out [rm][d][d], log_out [rm], row_out [rm], size_out [rm], std_out [rm],
 *            squares [r][m] scratch, change [m][d], covariance [m][d][d], log_weight [m], radius [d], pattern [r][d],
 *            mean [r], variance [r], log_prior [r], every, negligible_nats)
 * -> number of the changes that count, -1 where a covariance is none: as `sizes.with_sizes` */
static PyObject *with_sizes(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[15] = {2, 3, 1, 1, 1, 1, 2, 2, 3, 1, 1, 2, 1, 1, 1};
    Py_buffer v[15];
    double values[2];
    if (given != 17) {
        PyErr_SetString(PyExc_ValueError, "seventeen arguments are needed");
        return NULL;
    }
    if (numbers(args + 15, 2, values) < 0 || get_arrays(args, v, dimensions, 15, 7) < 0)
        return NULL;
    Py_ssize_t m = v[7].shape[0], d = v[7].shape[1], r = v[11].shape[0], most = r * m;
    int fits = d > 0 && d <= MOST_WHEELS && r > 0 && m > 0 && v[0].shape[0] == most && v[0].shape[1] == d &&
               v[1].shape[0] == most && v[1].shape[1] == d && v[1].shape[2] == d && v[6].shape[0] == r &&
               v[6].shape[1] == m && v[8].shape[0] == m && v[8].shape[1] == d && v[8].shape[2] == d &&
               v[9].shape[0] == m && v[10].shape[0] == d && v[11].shape[1] == d;
    for (int i = 2; i < 6; i++)
        fits = fits && v[i].shape[0] == most;
    for (int i = 12; i < 15; i++)
        fits = fits && v[i].shape[0] == r;
    if (!fits)
        return unfit(v, 15);
    double *rest = v[0].buf, *total = v[1].buf, *logs = v[2].buf, *rows = v[3].buf, *size = v[4].buf, *std = v[5].buf;
    double *squares = v[6].buf;
    const double *change = v[7].buf, *covariance = v[8].buf, *weight = v[9].buf, *radius = v[10].buf;
    const double *patterns = v[11].buf, *mean = v[12].buf, *variance = v[13].buf, *prior = v[14].buf;
    double best = -INFINITY, root[MOST_WHEELS * MOST_WHEELS], white[MOST_WHEELS], of_size[MOST_WHEELS], p[MOST_WHEELS];
    Py_ssize_t count = 0;
    for (Py_ssize_t k = 0; k < r; k++)
        for (Py_ssize_t j = 0; j < m; j++) {
            Py_ssize_t at = k * m + j;
            for (Py_ssize_t a = 0; a < d; a++) {
                double off = patterns[k * d + a] * radius[a];
                rest[at * d + a] = change[j * d + a] - mean[k] * off;
                for (Py_ssize_t b = 0; b < d; b++)
                    total[(at * d + a) * d + b] = covariance[(j * d + a) * d + b] +
                                                  variance[k] * off * (patterns[k * d + b] * radius[b]);
            }
            if (!factor(total + at * d * d, d, root)) {
                release(v, 15);
                return PyLong_FromLong(-1);
            }
            whiten(root, d, rest + at * d, white);
            for (Py_ssize_t a = 0; a < d; a++)
                p[a] = patterns[k * d + a] * radius[a];
            whiten(root, d, p, of_size);
            double volume = 0.0;
            for (Py_ssize_t a = 0; a < d; a++)
                volume += 2.0 * log(root[a * d + a]);
            squares[at] = product(white, white, d);
            logs[at] = squares[at] + volume; /* for a moment */
            size[at] = mean[k] + variance[k] * product(of_size, white, d);
            double known = variance[k] - variance[k] * variance[k] * product(of_size, of_size, d);
            std[at] = sqrt(known > 0.0 ? known : 0.0);
        }
    for (Py_ssize_t k = r; k--;)
        for (Py_ssize_t j = 0; j < m; j++) {
            double gain = 0.5 * (logs[j] - logs[k * m + j]);
            logs[k * m + j] = k ? prior[k] + weight[j] + gain : prior[0] + weight[j];
            best = logs[k * m + j] > best ? logs[k * m + j] : best;
        }
    for (Py_ssize_t k = 0; k < r; k++)
        for (Py_ssize_t j = 0; j < m; j++) {
            Py_ssize_t at = k * m + j;
            if (k && values[0] == 0.0 && !(logs[at] + 0.5 * squares[at] > best - values[1]))
                continue;
            for (Py_ssize_t a = 0; a < d; a++)
                rest[count * d + a] = rest[at * d + a];
            for (Py_ssize_t a = 0; a < d * d; a++)
                total[count * d * d + a] = total[at * d * d + a];
            logs[count] = logs[at];
            size[count] = size[at];
            std[count] = std[at];
            rows[count++] = (double)k;
        }
    release(v, 15);
    return PyLong_FromSsize_t(count);
}

/* ---- the comparison ------------------------------------------------------------------------------------- */

/* compare(none_out [r], larger_out [h - s], lost_out [r][s], large_out [r][s], deflated_out [d], loss_out [d],
 *         off_out [s], gains_out [h], best_out [d], changes_out [n], intact_out [n], scratch [n][4 h],
 *         change [n][d], covariance [n][d][d], log_weight [n], row [n], size [n], std [n], subset [r], members [h][d],
 *         log_shares [h], log_ratios [s], radius [d], losses [g], severity [g],
 *         log_intact, limit, one_alone, beyond, negligible)
 * -> probability that nothing is lost, and suspicion; None where a covariance is none: as `Comparison.of_accounts` */
static PyObject *compare(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    enum { ARRAYS = 25, WRITTEN = 12, NUMBERS = 5 };
    static const int dimensions[ARRAYS] = {1, 1, 2, 2, 1, 1, 1, 1, 1, 1, 1, 2, 2, 3, 1, 1, 1, 1, 1, 2, 1, 1, 1, 1, 1};
    Py_buffer v[ARRAYS];
    double values[NUMBERS];
    if (given != ARRAYS + NUMBERS) {
        PyErr_SetString(PyExc_ValueError, "thirty arguments are needed");
        return NULL;
    }
    if (numbers(args + ARRAYS, NUMBERS, values) < 0 || get_arrays(args, v, dimensions, ARRAYS, WRITTEN) < 0)
        return NULL;
    Py_ssize_t n = v[12].shape[0], d = v[12].shape[1], r = v[0].shape[0], h = v[19].shape[0], s = v[21].shape[0];
    Py_ssize_t g = v[23].shape[0], beyond = (Py_ssize_t)values[3];
    const Py_ssize_t lengths[ARRAYS] = {r, h - s, r, r, d, d, s, h, d, n, n, n, n, n, n, n, n, n, r, h, h, s, d, g, g};
    int fits = n > 0 && d > 0 && d <= MOST_WHEELS && h <= MOST_HYPOTHESES && s > 0 && s <= h && g > 0 &&
               g <= MOST_LOSSES && beyond >= 0 && beyond < g && v[2].shape[1] == s && v[3].shape[1] == s &&
               v[11].shape[1] == 4 * h && v[13].shape[1] == d && v[13].shape[2] == d && v[19].shape[1] == d;
    for (int i = 0; i < ARRAYS; i++)
        fits = fits && v[i].shape[0] == lengths[i];
    const double *row = v[15].buf, *subset = v[18].buf;
    for (Py_ssize_t j = 0; fits && j < n; j++)
        fits = row[j] >= 0.0 && row[j] < (double)r;
    for (Py_ssize_t k = 0; fits && k < r; k++)
        fits = subset[k] >= 0.0 && subset[k] < (double)s;
    if (!fits)
        return unfit(v, ARRAYS);
    double *none_of = v[0].buf, *larger = v[1].buf, *lost = v[2].buf, *large = v[3].buf, *deflated = v[4].buf;
    double *loss = v[5].buf, *off = v[6].buf, *gains = v[7].buf, *best = v[8].buf, *changes = v[9].buf;
    double *intact = v[10].buf, *scratch = v[11].buf;
    const double *change = v[12].buf, *covariance = v[13].buf, *weight = v[14].buf;
    const double *size = v[16].buf, *std = v[17].buf, *members = v[19].buf, *shares = v[20].buf, *ratios = v[21].buf;
    const double *radius = v[22].buf, *losses = v[23].buf, *severity = v[24].buf;
    const double log_intact = values[0], limit = values[1], negligible = values[4];
    const int alone = values[2] != 0.0;
    double half_square[MOST_LOSSES], found[MOST_HYPOTHESES][MOST_LOSSES] = {{0.0}}, logs[MOST_LOSSES];
    double root[MOST_WHEELS * MOST_WHEELS], seen[MOST_WHEELS], white[MOST_WHEELS], p[MOST_WHEELS];
    double top = -INFINITY, total = 0.0;
    for (Py_ssize_t l = 0; l < g; l++)
        half_square[l] = 0.5 * losses[l];

    /* Slope and curvature of each hypothesis, and the largest logarithm. */
    for (Py_ssize_t j = 0; j < n; j++) {
        double *slope = scratch + j * 4 * h, *curvature = slope + h;
        if (!factor(covariance + j * d * d, d, root)) {
            release(v, ARRAYS);
            Py_RETURN_NONE;
        }
        whiten(root, d, change + j * d, seen);
        double shift = intact[j] = weight[j] + log_intact;
        for (Py_ssize_t i = 0; i < h; i++) {
            for (Py_ssize_t a = 0; a < d; a++)
                p[a] = members[i * d + a] * radius[a];
            whiten(root, d, p, white);
            slope[i] = -product(seen, white, d);
            curvature[i] = product(white, white, d);
            int out = (i >= s && row[j] > 0.0) || (alone && i >= d);
            double most = -INFINITY;
            for (Py_ssize_t l = 0; l < g; l++) {
                double fit = losses[l] * (slope[i] - half_square[l] * curvature[i]);
                most = fit > most ? fit : most;
            }
            double base = out ? -INFINITY : weight[j] + shares[i] + (i < s ? ratios[i] : 0.0);
            slope[2 * h + i] = base;
            shift = base + most > shift ? base + most : shift;
        }
        changes[j] = shift > UNKNOWN ? shift : UNKNOWN; /* for a moment */
        top = shift > top ? shift : top;
    }

    /* Sums over the losses, relative to the largest logarithm of the change; then over the changes. */
    for (Py_ssize_t j = 0; j < n; j++) {
        double *slope = scratch + j * 4 * h, *curvature = slope + h, *plain = slope + 2 * h, *weighed = slope + 3 * h;
        double scale = power(changes[j] - top);
        for (Py_ssize_t i = 0; i < h; i++) {
            double base = plain[i] - changes[j], sum = 0.0, severe = 0.0;
            for (Py_ssize_t l = 0; l < g; l++)
                logs[l] = base + losses[l] * (slope[i] - half_square[l] * curvature[i]);
            for (Py_ssize_t l = 0; l < g; l++) {
                double share = power(logs[l]);
                sum += share;
                severe += share * severity[l];
                found[i][l] += scale * share;
            }
            plain[i] = sum;
            weighed[i] = severe;
            total += scale * sum;
        }
        total += power(intact[j] - top);
    }

    /* The table by rows of sizes. */
    for (Py_ssize_t i = 0; i < h - s; i++)
        larger[i] = -INFINITY;
    for (Py_ssize_t k = 0; k < r; k++) {
        double of_row = UNKNOWN, none = -INFINITY, rest = 0.0, sum[2][MOST_HYPOTHESES] = {{0.0}};
        for (Py_ssize_t j = 0; j < n; j++)
            if ((Py_ssize_t)row[j] == k) {
                of_row = changes[j] > of_row ? changes[j] : of_row;
                none = intact[j] > none ? intact[j] : none;
            }
        for (Py_ssize_t j = 0; j < n; j++)
            if ((Py_ssize_t)row[j] == k) {
                const double *plain = scratch + j * 4 * h + 2 * h, *weighed = plain + h;
                double scale = power(changes[j] - of_row);
                rest += none > -INFINITY ? power(intact[j] - none) : 0.0;
                for (Py_ssize_t i = 0; i < h; i++) {
                    sum[0][i] += scale * plain[i];
                    sum[1][i] += scale * weighed[i];
                }
            }
        none_of[k] = none > -INFINITY ? none + log(rest) : none;
        for (Py_ssize_t i = 0; i < s; i++) {
            lost[k * s + i] = log(sum[0][i]) + of_row;
            large[k * s + i] = log(sum[1][i]) + of_row;
        }
        for (Py_ssize_t i = s; i < h; i++) {
            double one = log(sum[0][i]) + of_row;
            larger[i - s] = one > larger[i - s] ? one : larger[i - s];
        }
    }

    /* Probabilities of the changes, and of wheels that are off. */
    Py_ssize_t usual = 0, likeliest = 0;
    double most_usual = -INFINITY, nothing = 0.0;
    for (Py_ssize_t i = 0; i < s; i++)
        off[i] = 0.0;
    for (Py_ssize_t j = 0; j < n; j++) {
        const double *slope = scratch + j * 4 * h, *curvature = slope + h, *plain = slope + 2 * h;
        double scale = power(changes[j] - top) / total, sum = 0.0;
        intact[j] = power(intact[j] - top) / total;
        for (Py_ssize_t i = 0; i < h; i++) {
            double chance = scale * plain[i];
            sum += chance;
            if (chance > negligible && isfinite(limit)) {
                double own = 1.0 / sqrt(curvature[i]);
                off[i % s] += chance * normal_cdf(slope[i] * own - limit / own);
            }
        }
        changes[j] = intact[j] + sum;
        nothing += row[j] == 0.0 ? intact[j] : 0.0;
        double of_usual = row[j] == 0.0 ? changes[j] : -1.0;
        if (of_usual > most_usual) {
            most_usual = of_usual;
            usual = j;
        }
        likeliest = changes[j] > changes[likeliest] ? j : likeliest;
        if (row[j] > 0.0 && changes[j] > negligible && isfinite(limit)) {
            double own = std[j] > LEAST_STD ? std[j] : LEAST_STD;
            off[(Py_ssize_t)subset[(Py_ssize_t)row[j]]] +=
                changes[j] * (normal_cdf((size[j] - limit) / own) + normal_cdf((-size[j] - limit) / own));
        }
    }

    /* Marginals of the losses. */
    double suspicion = -INFINITY, most = -1.0;
    for (Py_ssize_t a = 0; a < d; a++)
        deflated[a] = loss[a] = best[a] = 0.0;
    for (Py_ssize_t i = 0; i < h; i++) {
        double severe = 0.0, expected = 0.0, sum = 0.0, gain = -INFINITY;
        const double *own = scratch + likeliest * 4 * h, *known = scratch + usual * 4 * h;
        for (Py_ssize_t l = 0; l < g; l++) {
            double chance = found[i][l] / total, fit = losses[l] * (own[i] - half_square[l] * own[h + i]);
            sum += chance;
            severe += chance * severity[l];
            expected += chance * losses[l];
            gain = fit > gain ? fit : gain;
            fit = losses[l] * (known[i] - half_square[l] * known[h + i]);
            if (i < s && l >= beyond)
                suspicion = fit > suspicion ? fit : suspicion;
            if (i < s && chance > most) {
                most = chance;
                for (Py_ssize_t a = 0; a < d; a++)
                    best[a] = members[i * d + a] * losses[l] * radius[a];
            }
        }
        gains[i] = gain;
        nothing += i < s ? 0.0 : sum;
        for (Py_ssize_t a = 0; i < s && a < d; a++) {
            deflated[a] += severe * members[i * d + a];
            loss[a] += expected * members[i * d + a] * radius[a];
        }
    }
    for (Py_ssize_t a = 0; a < d; a++)
        deflated[a] = deflated[a] > 1.0 ? 1.0 : deflated[a];
    release(v, ARRAYS);
    return Py_BuildValue("dd", nothing, suspicion);
}

/* ---- the module ----------------------------------------------------------------------------------------- */

#define FAST(name, doc) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, doc}
static PyMethodDef methods[] = {
    FAST(with_sizes, "Changes under each row of sizes that counts."),
    FAST(compare, "Posterior over all subsets and losses."),
    {NULL, NULL, 0, NULL},
};

static PyModuleDef_Slot slots[] = {{0, NULL}};
static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.onboard.monitor.evidence._evidence", "Comparison of hypotheses.", 0, methods, slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__evidence(void)
{
    return PyModuleDef_Init(&module);
}
