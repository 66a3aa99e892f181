/*
 * ${origin}
 *
 * The plant from the control to the measurement, integrated with the steps of the solver. Compile as ISO C: -std=c99 -ffp-contract=off.
 */
#ifndef ${macro}_PLANT_H
#define ${macro}_PLANT_H

#define ${macro}_PLANT_STEP ${dt} /* [s] of the solver */
#define ${macro}_PLANT_STEPS_PER_SAMPLE ${steps}
${sizes}
/* A step uses the disturbances at these fractions of its length, in this order: ${nodes}. */

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
${members}} ${name}_plant;

typedef struct {
${inputs}} ${name}_plant_input;

/* The initial state of the simulation; reset keeps the parameters, if any. */
void ${name}_plant_init(${name}_plant *p);
void ${name}_plant_reset(${name}_plant *p);

/* The current measurement, for the controller. The control in the input does not affect it. */
void ${name}_plant_measure(const ${name}_plant *p, const ${name}_plant_input *in, double y[${macro}_PLANT_OUTPUTS]);

/* One solver step. */
void ${name}_plant_step(${name}_plant *p, const ${name}_plant_input *in);

#ifdef __cplusplus
}
#endif

#endif
