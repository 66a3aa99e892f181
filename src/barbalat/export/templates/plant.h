/*
 * ${origin}
 *
 * All between the control and the measurement, by the solver's own steps. Compile as ISO C: -std=c99 -ffp-contract=off.
 */
#ifndef ${macro}_PLANT_H
#define ${macro}_PLANT_H

#define ${macro}_PLANT_STEP ${dt} /* [s] of the solver */
#define ${macro}_PLANT_STEPS_PER_SAMPLE ${steps}
${sizes}
/* A step sees the disturbances at these parts of it, in this order: ${nodes}. */

#ifdef __cplusplus
extern "C" {
#endif

typedef struct {
${members}} ${name}_plant;

typedef struct {
${inputs}} ${name}_plant_input;

/* Where the simulation starts; reset keeps the parameters, if there are some. */
void ${name}_plant_init(${name}_plant *p);
void ${name}_plant_reset(${name}_plant *p);

/* What a sensor says now: hand it to the controller. The control in the input has no effect on it. */
void ${name}_plant_measure(const ${name}_plant *p, const ${name}_plant_input *in, double y[${macro}_PLANT_OUTPUTS]);

/* One solver step. */
void ${name}_plant_step(${name}_plant *p, const ${name}_plant_input *in);

#ifdef __cplusplus
}
#endif

#endif
