/*
 * ${origin}
 * See model.h.
 */
#include "model.h"
#include <math.h>

${give}void model_defaults(model *m)
{
${defaults}}

void model_start(model *m)
{
${start}}

int model_step(model *m)
{
${step}}

void model_outputs(model *m)
{
${outputs}}
