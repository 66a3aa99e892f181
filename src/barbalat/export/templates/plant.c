/*
 * ${origin}
 * See plant.h.
 */
#include "plant.h"
${include}
${functions}void ${name}_plant_init(${name}_plant *p)
{
${defaults}    ${name}_plant_reset(p);
}

void ${name}_plant_reset(${name}_plant *p)
{
${reset}}

void ${name}_plant_measure(const ${name}_plant *p, const ${name}_plant_input *in, double y[${macro}_PLANT_OUTPUTS])
{
${measure}}

void ${name}_plant_step(${name}_plant *p, const ${name}_plant_input *in)
{
${step}}
