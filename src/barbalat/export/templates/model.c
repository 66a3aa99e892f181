/*
 * ${origin}
 * See model.h.
 */
#include "model.h"
#include <math.h>
#include <stddef.h>

${give}void model_defaults(model *m)
{
${defaults}}

const char *model_refused(const model *m)
{
${refusals}    return NULL;
}

void model_start(model *m)
{
${start}}

int model_step(model *m)
{
${step}}

void model_outputs(model *m)
{
${outputs}}
