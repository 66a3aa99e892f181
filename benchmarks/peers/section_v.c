/* Section V's L1 loop, one trajectory, as one writes it by hand: eqs (5)-(8) and four Runge-Kutta stages. */

#include <stddef.h>

#define SIZE 9

static const double a_m1 = -0.3, a_m2 = -1.0, theta_1 = 4.0, theta_2 = -3.0, k_0 = 4.0, bound = 5.0;
static const double gain = 1e4, kappa = 0.02;
static const double p_1 = 5.0 / 3.0, p_2 = 13.0 / 6.0; /* P b, from P A_m + A_m'P = -I */

static double projected(double rate, double estimate)
{
    if ((estimate >= bound && rate > 0.0) || (estimate <= -bound && rate < 0.0))
        return 0.0;
    return rate;
}

static void derivative(const double *y, double r, double *k)
{
    const double x_1 = y[0], x_2 = y[1], u = y[8];
    const double learnt = y[4] * x_1 + y[5] * x_2;
    const double error = gain * ((x_1 - y[6]) * p_1 + (x_2 - y[7]) * p_2);
    k[0] = x_2;
    k[1] = a_m1 * x_1 + a_m2 * x_2 + u + theta_1 * x_1 + theta_2 * x_2;
    k[2] = y[3];
    k[3] = a_m1 * y[2] + a_m2 * y[3] + k_0 * r;
    k[4] = projected(error * x_1, y[4]);
    k[5] = projected(error * x_2, y[5]);
    k[6] = y[7];
    k[7] = a_m1 * y[6] + a_m2 * y[7] + u + learnt;
    k[8] = (k_0 * r - learnt - u) / kappa;
}

static void stage(const double *y, double h, const double *k, double *out)
{
    for (int i = 0; i < SIZE; ++i)
        out[i] = y[i] + h * k[i];
    for (int i = 4; i < 6; ++i)
        out[i] = out[i] > bound ? bound : out[i] < -bound ? -bound : out[i];
}

/* table: the command at the start, middle and end of every step */
void trajectory(size_t steps, double h, double *y, const double *table)
{
    double k[4][SIZE], z[SIZE];
    for (size_t n = 0; n < steps; ++n, table += 3) {
        derivative(y, table[0], k[0]);
        stage(y, h / 2, k[0], z);
        derivative(z, table[1], k[1]);
        stage(y, h / 2, k[1], z);
        derivative(z, table[1], k[2]);
        stage(y, h, k[2], z);
        derivative(z, table[2], k[3]);
        for (int i = 0; i < SIZE; ++i)
            k[0][i] += 2 * k[1][i] + 2 * k[2][i] + k[3][i];
        stage(y, h / 6, k[0], y);
    }
}
