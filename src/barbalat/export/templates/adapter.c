/* Not part of the export: passes samples of a simulation to it; its state is kept with the simulation's. */
#include "controller.h"
#include <math.h>
#include <stdint.h>

uint8_t *barbalat_refused = 0; /* for each call whether a measurement, a command or the result was rejected */
uint64_t barbalat_called = 0;
uint64_t barbalat_room = 0; /* calls that it has room for; 0 outside of a recorded run */
int barbalat_in_a_row = 0; /* the count of rejected results has no place in the simulation's state, because a simulation rejects no results */

void barbalat_sample(double *numbers, int64_t step);

void barbalat_sample(double *numbers, int64_t step)
{
    ${name}_controller c;
    ${name}_input in;
    ${name}_output out;
    double *kept = numbers + ${macro}_MEASURED + ${macro}_COMMANDS + ${told};
    int i;
    if (${idle}) {
        return; /* the timer does not call at this step */
    }
    ${name}_init(&c);
${load}    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c.last_u[i] = c.${u}[i];
    }
    (void)step;
    in.sample_time = ${sample_time};
    in.freeze = 0;
    for (i = 0; i < ${macro}_MEASURED; ++i) {
        in.${measured}[i] = (${real})numbers[i];
    }
    for (i = 0; i < ${macro}_COMMANDS; ++i) {
        in.r[i] = (${real})numbers[${macro}_MEASURED + i];
    }
${spoil}    (void)${name}_step(&c, &in, &out);
    if (barbalat_called < barbalat_room) {
        barbalat_refused[barbalat_called] = (out.status & ~${macro}_${timer_status}) != ${macro}_OK;
        ++barbalat_called;
    }
${store}}
