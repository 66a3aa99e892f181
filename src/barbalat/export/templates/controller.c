/*
 * ${origin}
 * See controller.h and README.md.
 */
#include "controller.h"
${include}
${guard}
${functions}/* Whether every number is in range; NaN compares false. */
static int in_range(const ${real} *values, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        if (!(values[i] >= -${macro}_RANGE && values[i] <= ${macro}_RANGE)) {
            return 0;
        }
    }
    return 1;
}

${parameter_functions}/* Whether the results of a sample are in range. */
static int result_is_usable(const ${name}_controller *c)
{
    return ${usable_result};
}

/* Whether the whole state is in range. A sample never brings the state out of range. */
static int state_is_usable(const ${name}_controller *c)
{
    return ${usable}
        && result_is_usable(c);
}

/* One sample of the whole controller: the operations of the simulation, in the same order. */
static void advance(${name}_controller *c, const ${name}_input *in)
{
${advance}}

/* Copies the state that a sample changes, value by value, so that the compiler can drop copies that are not needed. */
static void copy(${name}_controller *to, const ${name}_controller *from)
{
${copied}}

/* Bumpless start: u begins at the current position of the actuator, and the difference fades out. */
static void fade(${name}_controller *c)
{
    int i;
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        if (c->matching != 0) {
            c->bump[i] = c->bump[i] - c->${u}[i];
        }
        if (c->fade_left > 0L && c->fade > 0L) {
            c->${u}[i] = c->${u}[i] + c->bump[i] * ((${real})c->fade_left / (${real})c->fade);
        }
    }
    c->matching = 0;
    if (c->fade_left > 0L) {
        --c->fade_left;
    }
}

/* If there is no measurement, the control is held and a fade pauses, so that u does not jump at the next good sample. */
static void hold(${name}_controller *c)
{
    int i;
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c->${u}[i] = c->last_u[i];
    }
}

/* The state from which a start, or a restart after an outage, begins. */
static void begin(${name}_controller *c, ${begin_argument}int keep_estimates)
{
${start}}

${limit}${come_back}${fall_back}${refuse}${parameter_change}/* Advances to this sample, measured or lost, and returns 1; returns 0 and changes nothing if the result would be out of range. */
static int go_on(${name}_controller *c, const ${name}_input *in, int measured${commanded})
{
    int i;
    int bumped = 0; /* whether the bump offset changes */
    ${name}_controller before;
    copy(&before, c);
    if (measured ${good} || c->${started}[0] > 0) {
${advances}    } else { /* nothing has begun, and the measurement is already the held value */
        for (i = 0; i < ${macro}_COMMANDS; ++i) {
            c->${last_r}[i] = in->r[i];
        }
    }
    if (measured ${good}) {
${returns}        bumped = c->matching;
        if (bumped != 0 || c->fade_left > 0L) {
            fade(c);
        }
    } else {
${counted}        hold(c);
${falls_back}    }
    if (!result_is_usable(c) || (bumped != 0 && !in_range(c->bump, ${macro}_INPUTS))) {
${unchanged}        copy(c, &before);
        refuse(c, in, measured${commanded_given});
        return 0;
    }
${accepted}    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c->last_u[i] = c->${u}[i];
    }
    return 1;
}

${shell_functions}${shell_timer}/* Replaces a lost command with the last good command, and a lost measurement with the last good measurement while the estimates are frozen${predicts}. */
static void take(${kept_const}${name}_controller *c, ${name}_input *in, int *measured, ${commanded_taken}unsigned *status)
{
    int i;
    if (${uncalled}${command_lost}) {
${untold}        for (i = 0; i < ${macro}_COMMANDS; ++i) {
            in->r[i] = c->${last_r}[i];
        }
    }
${command_good}    if (${uncalled}${implausible}) {
${lost}        *measured = 0;
        in->freeze = ${lost_freeze};
        for (i = 0; i < ${macro}_MEASURED; ++i) {
            in->${measured}[i] = c->${last_measured}[i];
        }
    }
}

static void give(const ${name}_controller *c, ${name}_output *out, unsigned status)
{
${give}    out->status = status;
}

/* Sets the held control to zero if it is NaN or out of range. */
static void keep_control(${name}_controller *c)
{
    int i;
    const int held = in_range(c->last_u, ${macro}_INPUTS);
    for (i = 0; i < ${macro}_INPUTS && held == 0; ++i) {
        c->last_u[i] = ${zero};
    }
}

void ${name}_reset(${name}_controller *c)
{
    int i;
    keep_control(c);
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c->bump[i] = ${zero};
    }
${reset}    c->fade = 0L;
    c->fade_left = 0L;
    c->matching = 0;
${no_change}${no_outage}}

void ${name}_init(${name}_controller *c)
{
    int i;
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c->last_u[i] = ${zero};
    }
${defaults}    ${name}_reset(c);
}

unsigned ${name}_start(${name}_controller *c, ${start_argument}const ${real} u_now[${macro}_INPUTS], long samples,
    int keep_estimates)
{
    int i;
    if (${start_refused}) {
        return ${macro}_START_REFUSED;
    }
    begin(c, ${begin_given}keep_estimates);
${start_control}    c->fade = samples > 0L ? samples : 0L;
    c->fade = c->fade < ${most}L ? c->fade : ${most}L;
    c->fade_left = c->fade;
    c->matching = 1;
${no_change}${no_outage_at_start}    return ${macro}_OK;
}

${wait}${step}
{
    unsigned status = ${macro}_OK;
    int measured = 1;
${commanded_before}    ${name}_input taken;
${clock_test}    if (!state_is_usable(c)) {
${outage_before}        keep_control(c);
${distrusted}        ${begins}${name}_start(c, ${measured_given}c->last_u, ${restart_fade}, 0)${begun}
${told_fallback}        give(c, out, status | ${macro}_STATE_REFUSED);
        return out->status;
    }
${wrong_call}    taken = *in;
${missed_call}    take(c, &taken, &measured, ${commanded_place}&status);
    if (go_on(c, &taken, measured${commanded_given}) == 0) {
        status |= ${macro}_RESULT_REFUSED;
    }
${fallback_status}    give(c, out, status);
    return out->status;
}

${timed_step}void ${name}_read_log(const ${name}_controller *c, ${name}_log *log)
{
    ${name}_output out;
    give(c, &out, ${macro}_OK);
${log}}
${parameter_set}