/*
 * ${origin}
 *
 * Compile as ISO C (or C++17): -std=c99 -ffp-contract=off. A compiler that fuses multiply-adds, as in GNU mode on aarch64
 * and riscv64, changes the last bits; selftest.c detects it.
 */
#ifndef ${macro}_CONTROLLER_H
#define ${macro}_CONTROLLER_H

#define ${macro}_EXPORT ${mark}
#define ${macro}_SAMPLE_TIME ${sample_time} /* sample time of the controller [s] */
#define ${macro}_RANGE ${range} /* largest magnitude of a measurement, a command or a state; larger values are rejected */
${sizes}#define ${macro}_REFUSALS ${refusals} /* number of consecutive rejected results after which it restarts with the initial estimates */
${limits}${shell_macros}${log_macros}${parameter_macros}
/* Status bits of a step, possibly several, and of a start. */
#define ${macro}_OK 0u
#define ${macro}_WRONG_SAMPLE_TIME 1u /* called at a wrong time, off by more than ${tolerated}: ${wrong_time} */
#define ${macro}_MEASUREMENT_LOST 2u /* an entry of the measurement is NaN or out of range: see ${name}_step */
#define ${macro}_STATE_REFUSED 4u /* the state was NaN or out of range: u is held, and the controller starts again */
#define ${macro}_RESULT_REFUSED 8u /* the result of the step would have been out of range: ${result_refused} */
#define ${macro}_COMMAND_LOST 16u /* an entry of the command is NaN or out of range: see ${name}_step */
#define ${macro}_START_REFUSED 32u /* returned by ${name}_start, which changed nothing: an argument is NaN or out of range${start_range} */

#ifdef __cplusplus
extern "C" {
#endif

/* The state of the controller. Matrices are stored row by row. */
typedef struct {
${members}    ${real} last_u[${macro}_INPUTS]; /* the last control, which is held */
    ${real} bump[${macro}_INPUTS]; /* the part of u that fades out after a bumpless start */
    long fade; /* samples over which it fades out */
    long fade_left; /* remaining samples of the fade */
    int matching; /* 1 until the first sample after a start */
    int refused; /* consecutive good samples whose result was out of range */
${shell_members}} ${name}_controller;

typedef struct {
    ${real} sample_time; /* time since the last call [s], within 0.1 % of ${macro}_SAMPLE_TIME; at a first call that constant */
    ${real} ${measured}[${macro}_MEASURED]; /* ${measured_meaning} */
    ${real} r[${macro}_COMMANDS]; /* command of (2)${command_units} */
    int freeze; /* if nonzero, the estimates and the law's signals keep their values; everything else continues${predicts_only} */
} ${name}_input;

typedef struct {
    ${real} u[${macro}_INPUTS]; /* control${units} before the actuator, as simulated */
    ${real} u_limited[${macro}_INPUTS]; /* u clipped to the case's saturation limits, if any; a rate limit is left to the actuator */
${estimates}    unsigned status; /* the return value of ${name}_step */
} ${name}_output;

/* The internal signals for a log: consecutive numbers of one type; their names and labels are defined above. */
typedef struct {
${log_members}} ${name}_log;

/* The state in which the simulation starts. */
void ${name}_init(${name}_controller *c);

/* Like init, but the last control is still held if an input is rejected. */
void ${name}_reset(${name}_controller *c);

/*
 * ${start_comment}
 * u_now is the current command to the actuator. The first control equals it, and the difference from the control that the
 * controller computes fades out over `samples` samples (at most 1e9). If keep_estimates is nonzero, the estimates are kept.
 * Returns ${macro}_OK, or ${macro}_START_REFUSED.
 */
unsigned ${name}_start(${name}_controller *c, ${start_argument}const ${real} u_now[${macro}_INPUTS], long samples,
    int keep_estimates);

/*
 * One sample. Call it every ${macro}_SAMPLE_TIME, even without a measurement (then pass NaN), apply u at once and hold it
 * until the next call. Returns the status.
 * A lost measurement: u is held, and everything else continues with ${with_what} while the estimates are frozen.
 * A lost command: the last good command replaces it, and the controller continues normally.
 * Until the first good measurement after init, reset or start the state does not advance and u is held${first_misses}.
${shell_comment} */
/*@ requires \valid(c) && \valid_read(in) && \valid(out);
    requires \separated(c, in, out);
    ensures \forall integer i; 0 <= i < ${macro}_INPUTS ==> -${macro}_RANGE <= out->u[i] <= ${macro}_RANGE;
    ensures \result == out->status && \result <= ${shell_statuses};
*/
unsigned ${name}_step(${name}_controller *c, const ${name}_input *in, ${name}_output *out);

/* Reads the internal signals after the last step; the state does not change. */
void ${name}_read_log(const ${name}_controller *c, ${name}_log *log);
${parameter_declared}
#ifdef __cplusplus
}
#endif

#endif
