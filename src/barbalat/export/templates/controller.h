/*
 * ${origin}
 *
 * Compile as ISO C (or C++17): -std=c99 -ffp-contract=off. A compiler that fuses multiply-adds by itself, as GNU mode does on
 * aarch64 and riscv64, changes last bits; selftest.c sees it.
 */
#ifndef ${macro}_CONTROLLER_H
#define ${macro}_CONTROLLER_H

#define ${macro}_EXPORT ${mark}
#define ${macro}_SAMPLE_TIME ${sample_time} /* [s] for which it was made */
#define ${macro}_RANGE ${range} /* what a measurement, a command or a state may be in size: beyond it is refused */
${sizes}${limits}${shell_macros}
/* Status of a step, of which several may hold, and of a start. */
#define ${macro}_OK 0u
#define ${macro}_WRONG_SAMPLE_TIME 1u /* called after another time, by more than 0.1 %; the step was made as if after the right one */
#define ${macro}_MEASUREMENT_LOST 2u /* an entry of the measurement is no number or out of range: see ${name}_step */
#define ${macro}_STATE_REFUSED 4u /* the state is no number or out of range: last u held, nothing goes on until reset or start */
#define ${macro}_RESULT_REFUSED 8u /* the step would have led out of range: u and the whole state stay as they are */
#define ${macro}_COMMAND_LOST 16u /* an entry of the command is no number or out of range: see ${name}_step */
#define ${macro}_START_REFUSED 32u /* of ${name}_start, which changed nothing: an argument is no number or out of range */

#ifdef __cplusplus
extern "C" {
#endif

/* Everything that the controller keeps. Matrices stand row by row. */
typedef struct {
${members}    ${real} last_u[${macro}_INPUTS]; /* what was put out last: what is held */
    ${real} bump[${macro}_INPUTS]; /* of a bumpless start: what fades out of u */
    long fade; /* samples over which it does */
    long fade_left; /* of them still to come */
    int matching; /* 1 until the first sample after a start */
${shell_members}} ${name}_controller;

typedef struct {
    ${real} sample_time; /* [s] since the last call, as a timer has it or ${macro}_SAMPLE_TIME: within 0.1 % of that */
    ${real} ${measured}[${macro}_MEASURED]; /* ${measured_meaning} */
    ${real} r[${macro}_COMMANDS]; /* command of (2) */
    int freeze; /* not 0: the estimates and what was learnt for them keep their values, all else goes on */
} ${name}_input;

typedef struct {
    ${real} u[${macro}_INPUTS]; /* control${units} as it was simulated, before the actuator */
    ${real} u_limited[${macro}_INPUTS]; /* the same within the saturation limits, where the case has them; a rate limit is left to the actuator */
${estimates}    unsigned status; /* as ${name}_step returns it */
} ${name}_output;

/* The state in which the simulation starts. */
void ${name}_init(${name}_controller *c);

/* The same, with what was last put out still held where an input is refused. */
void ${name}_reset(${name}_controller *c);

/*
 * ${start_comment}
 * u_now is what the actuator gets at this moment: the first control is the same, and the difference to the controller's own
 * fades out over so many samples. keep_estimates: not 0 to keep what was learnt so far.
 * Returns ${macro}_OK, or ${macro}_START_REFUSED.
 */
unsigned ${name}_start(${name}_controller *c, ${start_argument}const ${real} u_now[${macro}_INPUTS], long samples,
    int keep_estimates);

/*
 * One sample. Call it every ${macro}_SAMPLE_TIME, also when there is no measurement (then with NaN in its place), put u out at
 * once and hold it until the next call. Returns the status.
 * A lost measurement: u stays, and all else goes on under the last good measurement and this u, with the estimates frozen.
 * A lost command: the last good one stands in for it, and the controller goes on as ever.
 * Nothing begins, and u stays, until a first sample after init, reset or start has both.
${shell_comment} */
/*@ requires \valid(c) && \valid_read(in) && \valid(out);
    requires \separated(c, in, out);
    ensures \forall integer i; 0 <= i < ${macro}_INPUTS ==> -${macro}_RANGE <= out->u[i] <= ${macro}_RANGE;
    ensures \result == out->status && \result <= ${shell_statuses};
*/
unsigned ${name}_step(${name}_controller *c, const ${name}_input *in, ${name}_output *out);

#ifdef __cplusplus
}
#endif

#endif
