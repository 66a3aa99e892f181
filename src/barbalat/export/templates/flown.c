/* Not part of the export: lets another program step the controller of this library. */
#include "controller.h"

static ${name}_controller controller;

void barbalat_begin(void);
unsigned barbalat_act(const double *handed, double *u, double *kept);

void barbalat_begin(void)
{
    ${name}_init(&controller);
}

unsigned barbalat_act(const double *handed, double *u, double *kept)
{
    ${name}_input in;
    ${name}_output out;
    unsigned status;
    int i;
    in.sample_time = ${macro}_SAMPLE_TIME;
    in.freeze = 0;
    for (i = 0; i < ${macro}_MEASURED; ++i) {
        in.${measured}[i] = handed[i];
    }
    for (i = 0; i < ${macro}_COMMANDS; ++i) {
        in.r[i] = handed[${macro}_MEASURED + i];
    }
    status = ${name}_step(&controller, &in, &out);
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        u[i] = out.u[i];
    }
${store}    return status;
}
