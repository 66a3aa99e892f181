/*
 * ${origin}
 * The exported controller closes the loop with the exported plant. Exit code 0: ${samples} samples of both agree bit for bit
 * with the simulation; for a 32-bit controller the program shows the largest differences instead.
 */
#include "controller.h"
#include "plant.h"
#include <stdio.h>
#include <string.h>
${guard}
#define SAMPLES ${samples}
#define EXACT ${exact}

static const double commands[SAMPLES][${macro}_COMMANDS] = {
${command_rows}};
static const double measured[SAMPLES][${macro}_MEASURED] = {
${measured_rows}};
static const double controls[SAMPLES][${macro}_INPUTS] = {
${control_rows}};
${tables}
static double apart(double a, double b)
{
    return a > b ? a - b : b - a;
}

int main(void)
{
    ${name}_controller c;
    ${name}_plant p;
    double largest_y = 0.0, largest_u = 0.0;
    int k, i, different = 0;
    ${name}_init(&c);
    ${name}_plant_init(&p);
    for (k = 0; k < SAMPLES; ++k) {
        ${name}_input in;
        ${name}_output out;
        ${name}_plant_input given;
        double y[${macro}_PLANT_OUTPUTS];
        memset(&given, 0, sizeof given);
${given}        ${name}_plant_measure(&p, &given, y);
        in.sample_time = ${macro}_SAMPLE_TIME;
        in.freeze = 0;
        for (i = 0; i < ${macro}_MEASURED; ++i) {
            in.${measured}[i] = (${real})y[i];
            different += memcmp(&y[i], &measured[k][i], sizeof y[i]) != 0;
            largest_y = apart(y[i], measured[k][i]) > largest_y ? apart(y[i], measured[k][i]) : largest_y;
        }
        for (i = 0; i < ${macro}_COMMANDS; ++i) {
            in.r[i] = (${real})commands[k][i];
        }
        different += ${name}_step(&c, &in, &out) != ${macro}_OK;
        for (i = 0; i < ${macro}_INPUTS; ++i) {
            given.u[i] = (double)out.u[i];
            different += memcmp(&given.u[i], &controls[k][i], sizeof given.u[i]) != 0;
            largest_u = apart(given.u[i], controls[k][i]) > largest_u ? apart(given.u[i], controls[k][i]) : largest_u;
        }
        for (i = 0; i < ${macro}_PLANT_STEPS_PER_SAMPLE; ++i) {
${moved}            ${name}_plant_step(&p, &given);
        }
    }
    if (EXACT == 0) {
        printf("${name}, closed loop: %d samples; ${measured} differs from the simulation by at most %g, u by %g\n", SAMPLES,
            largest_y, largest_u);
        return 0;
    }
    printf(different == 0 ? "${name}, closed loop: %d samples agree in every bit\n" : "${name}, closed loop: FAILED (%d samples)\n",
        SAMPLES);
    return different == 0 ? 0 : 1;
}
