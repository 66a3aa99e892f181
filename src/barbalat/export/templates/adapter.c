/* Not of the export: hands samples of a simulation to it, whose state stands with the simulation's. */
#include "controller.h"
#include <stdint.h>

uint64_t barbalat_refused = 0;

void barbalat_sample(double *numbers, int64_t step);

void barbalat_sample(double *numbers, int64_t step)
{
    ${name}_controller c;
    ${name}_input in;
    ${name}_output out;
    double *kept = numbers + ${macro}_MEASURED + ${macro}_COMMANDS;
    int i;
    ${name}_init(&c);
${load}    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c.last_u[i] = c.${u}[i];
    }
    (void)step;
    in.sample_time = ${macro}_SAMPLE_TIME;
    in.freeze = 0;
    for (i = 0; i < ${macro}_MEASURED; ++i) {
        in.${measured}[i] = (${real})numbers[i];
    }
    for (i = 0; i < ${macro}_COMMANDS; ++i) {
        in.r[i] = (${real})numbers[${macro}_MEASURED + i];
    }
    if (${name}_step(&c, &in, &out) != ${macro}_OK) {
        ++barbalat_refused;
    }
${store}}
