/* Comparison of hypotheses about the radii, compiled: the same formulas as `hypotheses`, `sizes`, `posterior`, `nuisance` and
 * `first_start` have for NumPy arrays, which are the reference (tests/onboard/monitor/test_evidence_kernel.py).
 *
 * In and out: C-contiguous double arrays; d wheels, n changes, r rows of sizes, h hypotheses of which the first s are
 * losses, g sizes of a loss. Nothing is allocated. Floating-point contraction is off (setup.py), so that machines
 * with and without fused multiply-add round alike.
 */
#define Py_LIMITED_API 0x030b0000
#include "../../../foundation/_arrays.h"
#include "../../../foundation/_sources.h"
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

/* ---- normal densities, and the first start ------------------------------------------------------------------ */

/* squares(square_out [n], volume_out [n], value [n][d], covariance [n][d][d])
 * -> whether each covariance has a factor: v' C^-1 v of each, and the log of the determinant */
static PyObject *squares(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    static const int dimensions[4] = {1, 1, 2, 3};
    Py_buffer v[4];
    if (given != 4) {
        PyErr_SetString(PyExc_ValueError, "four arguments are needed");
        return NULL;
    }
    if (get_arrays(args, v, dimensions, 4, 2) < 0)
        return NULL;
    Py_ssize_t n = v[2].shape[0], d = v[2].shape[1];
    if (!(d > 0 && d <= MOST_WHEELS && v[0].shape[0] == n && v[1].shape[0] == n && v[3].shape[0] == n &&
          v[3].shape[1] == d && v[3].shape[2] == d))
        return unfit(v, 4);
    double *square = v[0].buf, *volume = v[1].buf, root[MOST_WHEELS * MOST_WHEELS], white[MOST_WHEELS];
    const double *value = v[2].buf, *covariance = v[3].buf;
    int found = 1;
    for (Py_ssize_t j = 0; found && j < n; j++) {
        found = factor(covariance + j * d * d, d, root);
        if (!found)
            break;
        whiten(root, d, value + j * d, white);
        square[j] = product(white, white, d);
        volume[j] = 0.0;
        for (Py_ssize_t a = 0; a < d; a++)
            volume[j] += 2.0 * log(root[a * d + a]);
    }
    release(v, 4);
    return PyBool_FromLong(found);
}

/* first(soft_out [d], larger_out [d], loss_out [d], scratch [m + 1][h], deviation [d], noise [d][d], shifts [h][d],
 *       log_priors [h], shares [m], priors [m][d][d], losses [g])
 * -> whether each covariance has a factor: as `first_start.judge_first`, before it decides between two wheels */
static PyObject *first(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    enum { ARRAYS = 11, WRITTEN = 4 };
    static const int dimensions[ARRAYS] = {1, 1, 1, 2, 1, 2, 2, 1, 1, 3, 1};
    Py_buffer v[ARRAYS];
    if (given != ARRAYS) {
        PyErr_SetString(PyExc_ValueError, "eleven arguments are needed");
        return NULL;
    }
    if (get_arrays(args, v, dimensions, ARRAYS, WRITTEN) < 0)
        return NULL;
    Py_ssize_t d = v[4].shape[0], h = v[7].shape[0], m = v[8].shape[0], g = v[10].shape[0];
    if (!(d > 0 && d <= MOST_WHEELS && m > 0 && h == 1 + 2 * d * g && v[0].shape[0] == d && v[1].shape[0] == d &&
          v[2].shape[0] == d && v[3].shape[0] == m + 1 && v[3].shape[1] == h && v[5].shape[0] == d &&
          v[5].shape[1] == d && v[6].shape[0] == h && v[6].shape[1] == d && v[9].shape[0] == m && v[9].shape[1] == d &&
          v[9].shape[2] == d))
        return unfit(v, ARRAYS);
    double *soft = v[0].buf, *larger = v[1].buf, *loss = v[2].buf, *logs = v[3].buf, *chance = logs + m * h;
    const double *deviation = v[4].buf, *noise = v[5].buf, *shifts = v[6].buf, *log_priors = v[7].buf;
    const double *shares = v[8].buf, *priors = v[9].buf, *losses = v[10].buf;
    double total_m2[MOST_WHEELS * MOST_WHEELS], root[MOST_WHEELS * MOST_WHEELS], rest[MOST_WHEELS], white[MOST_WHEELS];
    double top = -INFINITY, total = 0.0;
    for (Py_ssize_t k = 0; k < m; k++) {
        for (Py_ssize_t a = 0; a < d * d; a++)
            total_m2[a] = priors[k * d * d + a] + noise[a];
        if (!factor(total_m2, d, root)) {
            release(v, ARRAYS);
            Py_RETURN_FALSE;
        }
        double scale = log(shares[k]);
        for (Py_ssize_t a = 0; a < d; a++)
            scale -= log(root[a * d + a]);
        for (Py_ssize_t i = 0; i < h; i++) {
            for (Py_ssize_t a = 0; a < d; a++)
                rest[a] = deviation[a] - shifts[i * d + a];
            whiten(root, d, rest, white);
            logs[k * h + i] = scale - 0.5 * product(white, white, d);
        }
    }
    for (Py_ssize_t i = 0; i < h; i++) {
        double most = -INFINITY, sum = 0.0;
        for (Py_ssize_t k = 0; k < m; k++)
            most = logs[k * h + i] > most ? logs[k * h + i] : most;
        for (Py_ssize_t k = 0; k < m; k++)
            sum += power(logs[k * h + i] - most);
        chance[i] = most + log(sum) + log_priors[i];
        top = chance[i] > top ? chance[i] : top;
    }
    for (Py_ssize_t i = 0; i < h; i++) {
        chance[i] = power(chance[i] - top);
        total += chance[i];
    }
    for (Py_ssize_t a = 0; a < d; a++) {
        const double *of_loss = chance + 1 + a * g, *of_gain = of_loss + d * g;
        double expected = 0.0;
        soft[a] = larger[a] = 0.0;
        for (Py_ssize_t l = 0; l < g; l++) {
            soft[a] += of_loss[l];
            larger[a] += of_gain[l];
            expected += of_loss[l] * losses[l];
        }
        loss[a] = soft[a] > 0.0 ? expected / soft[a] : 0.0;
        soft[a] /= total;
        larger[a] /= total;
    }
    release(v, ARRAYS);
    Py_RETURN_TRUE;
}

/* ---- the posterior -------------------------------------------------------------------------------------- */

/* Logarithm of a sum of which the logarithms are given. */
static double log_sum(const double *logs, Py_ssize_t count)
{
    double most = -INFINITY, sum = 0.0;
    for (Py_ssize_t i = 0; i < count; i++)
        most = logs[i] > most ? logs[i] : most;
    if (most == -INFINITY)
        return most;
    for (Py_ssize_t i = 0; i < count; i++)
        sum += power(logs[i] - most);
    return most + log(sum);
}

static double log_add(double one, double other)
{
    const double both[2] = {one, other};
    return log_sum(both, 2);
}

enum { MOST_WINDOWS = 3, OF_WINDOW = 7, MOST_SUBSETS = 15 };
static const double LEAST_CHANCE = 1e-300, LEAST_REST = 1e-12;

/* One window of onsets: its table, its probabilities, and what follows from both. */
struct window {
    const double *none, *larger, *lost, *large, *believed, *believed_off, *off;
    Py_ssize_t rows;
    double known;                                        /* log of what the longest window knows of nothing lost over it */
    double any[MOST_SUBSETS], any_off[MOST_SUBSETS];     /* share of a subset that is a loss, a change of any wheel */
    double share[MOST_SUBSETS], share_off[MOST_SUBSETS]; /* of the prior, of the windows that have a row for a subset */
    double passes[MOST_SUBSETS];                         /* log of what passes */
    double *nothing;                                     /* [sizes] log of nothing lost, or of what passes */
};

static void believe(struct window *windows, int count, Py_ssize_t s, Py_ssize_t d)
{
    for (Py_ssize_t i = 0; i < s; i++) {
        double of_any = 0.0, of_off = 0.0;
        for (int w = 0; w < count; w++) {
            struct window *one = &windows[w];
            one->any[i] = one->any_off[i] = -INFINITY;
            for (Py_ssize_t a = 0; a < d; a++) {
                double loss = one->believed[i * d + a], change = one->believed_off[i * d + a];
                one->any[i] = loss > one->any[i] ? loss : one->any[i];
                one->any_off[i] = change > one->any_off[i] ? change : one->any_off[i];
            }
            one->passes[i] = log(1.0 - one->any[i]);
            of_any += one->any[i] > 0.0;
            of_off += one->any_off[i] > 0.0;
        }
        for (int w = 0; w < count; w++) {
            windows[w].share[i] = windows[w].any[i] > 0.0 ? 1.0 / of_any : 0.0;
            windows[w].share_off[i] = windows[w].any_off[i] > 0.0 ? 1.0 / of_off : 0.0;
        }
    }
}

/* Log of each size with nothing lost: a wheel that is larger by any amount is a row of its size. Returns whether
 * larger wheels are in it. */
static int at_rest(const struct window *window, Py_ssize_t sizes, Py_ssize_t k, double *out)
{
    int known = 0;
    for (Py_ssize_t i = 0; i < k; i++)
        known = known || isfinite(window->larger[i]);
    for (Py_ssize_t row = 0; row < sizes; row++)
        out[row] = window->nothing[row];
    if (sizes == 1 || !known)
        return 0;
    for (Py_ssize_t i = 0; i < k; i++)
        out[1 + i] = log_add(out[1 + i], window->larger[i]);
    return 1;
}

/* Change of either sign: its union over the windows. */
static void deviate(const struct window *windows, int count, Py_ssize_t s, Py_ssize_t d, double *deviates)
{
    double total = 1.0;
    for (Py_ssize_t a = 0; a < d; a++)
        deviates[a] = 0.0;
    for (int w = 0; w < count; w++) {
        const struct window *one = &windows[w];
        double believed[MOST_SUBSETS], sum = 0.0;
        for (Py_ssize_t i = 0; i < s; i++) {
            believed[i] = one->off[i] * one->any_off[i];
            believed[i] = believed[i] > 1.0 ? 1.0 : believed[i];
            sum += believed[i];
        }
        double rest = 1.0 - sum > LEAST_REST ? 1.0 - sum : LEAST_REST;
        for (Py_ssize_t i = 0; i < s; i++) {
            double odds = one->share_off[i] * believed[i] / rest;
            double whole = one->any_off[i] > LEAST_CHANCE ? one->any_off[i] : LEAST_CHANCE;
            for (Py_ssize_t a = 0; a < d; a++)
                deviates[a] += odds * (one->believed_off[i * d + a] / whole);
            total += odds;
        }
    }
    for (Py_ssize_t a = 0; a < d; a++)
        deviates[a] = deviates[a] / total > 1.0 ? 1.0 : deviates[a] / total;
}

/* marginals(deflated_out [d], possible_out [d], deviates_out [d], subsets_out [s], sizes_out [n], onsets_out [windows],
 *           scratch [windows + 2][n], members [s][d], and of each window, the youngest first:
 *           none [r], larger [k], lost [r][s], large [r][s], believed [s][d], believed_off [s][d], off [s];
 *           rows that came in each window)
 * -> probability of nothing at all, and that a tyre has changed; None for tables of different sizes: as
 * `posterior.by_arrays` */
static PyObject *marginals(PyObject *self, PyObject *const *args, Py_ssize_t given)
{
    enum { FIRST = 8, WRITTEN = 7, MOST_ARRAYS = FIRST + OF_WINDOW * MOST_WINDOWS };
    static const int first[FIRST] = {1, 1, 1, 1, 1, 1, 2, 2}, of_window[OF_WINDOW] = {1, 1, 2, 2, 2, 2, 1};
    int dimensions[MOST_ARRAYS], count = (int)((given - FIRST) / (OF_WINDOW + 1)), arrays = FIRST + OF_WINDOW * count;
    Py_buffer v[MOST_ARRAYS];
    double came[MOST_WINDOWS];
    if (count < 1 || count > MOST_WINDOWS || given != arrays + count) {
        PyErr_SetString(PyExc_ValueError, "eight arguments, and eight of each of one to three windows, are needed");
        return NULL;
    }
    for (int i = 0; i < arrays; i++)
        dimensions[i] = i < FIRST ? first[i] : of_window[(i - FIRST) % OF_WINDOW];
    if (numbers(args + arrays, count, came) < 0 || get_arrays(args, v, dimensions, arrays, WRITTEN) < 0)
        return NULL;
    struct window windows[MOST_WINDOWS];
    Py_ssize_t d = v[0].shape[0], s = v[3].shape[0], n = v[4].shape[0], k = v[FIRST + 1].shape[0];
    int alike = 1, fits = d > 0 && d <= MOST_WHEELS && s > 0 && s <= MOST_SUBSETS && n > 0 && v[1].shape[0] == d &&
                          v[2].shape[0] == d && v[5].shape[0] == count && v[6].shape[0] == count + 2 &&
                          v[6].shape[1] == n && v[7].shape[0] == s && v[7].shape[1] == d;
    double *scratch = v[6].buf;
    for (int w = 0; w < count; w++) {
        const Py_buffer *own = v + FIRST + OF_WINDOW * w;
        Py_ssize_t r = own[0].shape[0];
        fits = fits && own[1].shape[0] == k && own[2].shape[0] == r && own[2].shape[1] == s && own[3].shape[0] == r &&
               own[3].shape[1] == s && own[4].shape[0] == s && own[4].shape[1] == d && own[5].shape[0] == s &&
               own[5].shape[1] == d && own[6].shape[0] == s;
        alike = alike && came[w] >= 0.0 && (double)r - came[w] == (double)n && r < 2 * n && (n == 1 || k < n);
        windows[w] = (struct window){own[0].buf, own[1].buf, own[2].buf, own[3].buf, own[4].buf, own[5].buf,
                                     own[6].buf, r,          0.0,        {0.0},      {0.0},      {0.0},
                                     {0.0},      {0.0},      scratch + w * n};
    }
    if (!fits)
        return unfit(v, arrays);
    if (!alike) {
        release(v, arrays);
        Py_RETURN_NONE;
    }
    double *deflated = v[0].buf, *possible = v[1].buf, *deviates = v[2].buf, *subsets = v[3].buf, *of_size = v[4].buf;
    double *onsets = v[5].buf, *rest = scratch + count * n, *other_rest = rest + n;
    const double *members = v[7].buf;
    const struct window *longest = &windows[count - 1];

    believe(windows, count, s, d);
    for (int w = 0; w < count; w++)
        for (Py_ssize_t row = 0; row < n; row++) {
            double logs[MOST_SUBSETS];
            for (Py_ssize_t i = 0; i < s; i++)
                logs[i] = windows[w].passes[i] + windows[w].lost[row * s + i];
            windows[w].nothing[row] = log_add(windows[w].none[row], log_sum(logs, s));
        }
    int of_rows = at_rest(longest, n, k, rest);
    double usual = log_sum(rest, n), top = -INFINITY, total = 0.0, apart_young = log((double)count);
    for (int w = 0; w < count - 1; w++)
        windows[w].known = usual - log_sum(windows[w].nothing, n);

    /* The constant: all that may be so, each relative to the most of them. */
    for (int pass = 0; pass < 2; pass++) {
#define TERM(value)                          \
    do {                                     \
        double term = (value);               \
        if (pass)                            \
            total += power(term - top);      \
        else                                 \
            top = term > top ? term : top;   \
    } while (0)
        for (Py_ssize_t row = 0; row < n; row++)
            TERM(rest[row]);
        for (Py_ssize_t i = 0; i < k && !of_rows; i++)
            TERM(longest->larger[i]);
        for (Py_ssize_t row = n; row < longest->rows; row++)
            TERM(longest->none[row]);
        for (int w = 0; w < count; w++) {
            const struct window *one = &windows[w];
            for (Py_ssize_t i = 0; i < s; i++) {
                double odds = one->known + log(one->share[i] * one->any[i]);
                for (Py_ssize_t row = 0; row < one->rows; row++)
                    TERM(odds + one->lost[row * s + i]);
            }
            for (Py_ssize_t i = 0; i < k && w < count - 1; i++)
                TERM(one->larger[i] + one->known - apart_young);
            for (Py_ssize_t row = n; row < one->rows && w < count - 1; row++)
                TERM(one->none[row] + one->known - apart_young);
        }
#undef TERM
    }
    double scale = top + log(total), changed = 0.0, sum = 0.0, none = power(rest[0] - scale);

    /* Marginals. */
    for (Py_ssize_t a = 0; a < d; a++)
        deflated[a] = possible[a] = 0.0;
    for (Py_ssize_t i = 0; i < s; i++)
        subsets[i] = 0.0;
    for (Py_ssize_t row = 0; row < n; row++) {
        of_size[row] = power(rest[row] - scale);
        changed += row ? power(longest->nothing[row] - scale) : 0.0;
    }
    at_rest(&windows[0], n, k, other_rest);
    for (Py_ssize_t row = 0; row < n; row++)
        for (Py_ssize_t i = 0; i < s && isfinite(other_rest[row]); i++) {
            double share = power(windows[0].large[row * s + i] + windows[0].passes[i] - other_rest[row]);
            for (Py_ssize_t a = 0; a < d; a++)
                possible[a] += of_size[row] * share * members[i * d + a];
        }
    for (int w = 0; w < count; w++) {
        const struct window *one = &windows[w];
        onsets[w] = 0.0;
        for (Py_ssize_t i = 0; i < s; i++) {
            double odds = one->known + log(one->share[i] * one->any[i]) - scale, severe = 0.0;
            double whole = one->any[i] > LEAST_CHANCE ? one->any[i] : LEAST_CHANCE;
            for (Py_ssize_t row = 0; row < one->rows; row++) {
                double lost = power(odds + one->lost[row * s + i]);
                severe += power(odds + one->large[row * s + i]);
                subsets[i] += lost;
                onsets[w] += lost;
                of_size[row < n ? row : 1 + row - n] += lost; /* what came is of the row of the same wheels */
            }
            for (Py_ssize_t a = 0; a < d; a++)
                deflated[a] += severe * (one->believed[i * d + a] / whole);
            changed += severe;
        }
    }
    for (Py_ssize_t a = 0; a < d; a++) {
        possible[a] = deflated[a] + possible[a] > 1.0 ? 1.0 : deflated[a] + possible[a];
        deflated[a] = deflated[a] > 1.0 ? 1.0 : deflated[a];
    }
    for (Py_ssize_t row = 0; row < n; row++)
        sum += of_size[row];
    for (Py_ssize_t row = 0; row < n; row++)
        of_size[row] /= sum;
    deviate(windows, count, s, d, deviates);
    release(v, arrays);
    return Py_BuildValue("dd", none > 1.0 ? 1.0 : none, changed > 1.0 ? 1.0 : changed);
}

/* ---- the module ----------------------------------------------------------------------------------------- */

#define FAST(name, doc) {#name, (PyCFunction)(void (*)(void))name, METH_FASTCALL, doc}
static PyMethodDef methods[] = {
    FAST(with_sizes, "Changes under each row of sizes that counts."),
    FAST(compare, "Posterior over all subsets and losses."),
    FAST(squares, "Squares of whitened values, and volumes."),
    FAST(first, "Posterior of soft and larger wheels at the first start."),
    FAST(marginals, "Marginals of the bank of all windows."),
    {NULL, NULL, 0, NULL},
};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, "tpmsd.onboard.monitor.evidence._evidence", "Comparison of hypotheses.", 0, methods, slots,
    NULL, NULL, NULL,
};

PyMODINIT_FUNC PyInit__evidence(void)
{
    return PyModuleDef_Init(&module);
}
