/*
 * ${origin}
 * Exit code 0: the ${samples} test vectors agree in every bit, and everything else behaves as README.md says.
 */
#include "controller.h"
#include <stdio.h>
#include <string.h>
${guard}
#define SAMPLES ${samples}

static const ${real} measured[SAMPLES][${macro}_MEASURED] = {
${measured_rows}};
static const ${real} commands[SAMPLES][${macro}_COMMANDS] = {
${command_rows}};
static const ${real} controls[SAMPLES][${macro}_INPUTS] = {
${control_rows}};
${estimate_table}
static int failures = 0;

static void require(int holds, const char *what)
{
    if (!holds) {
        ++failures;
        printf("%s\n", what);
    }
}

static ${name}_input sample(int k)
{
    ${name}_input in;
    memcpy(in.${measured}, measured[k], sizeof in.${measured});
    memcpy(in.r, commands[k], sizeof in.r);
    in.sample_time = ${macro}_SAMPLE_TIME;
    in.freeze = 0;
    return in;
}

static int same(const ${real} *a, const ${real} *b, size_t count)
{
    return memcmp(a, b, count * sizeof *a) == 0;
}

/* Samples 0 to count - 1 from a fresh state; the first that differs from the simulation. */
static int replay(${name}_controller *c, int count)
{
    int k;
    for (k = 0; k < count; ++k) {
        const ${name}_input in = sample(k);
        ${name}_output out;
        if (${name}_step(c, &in, &out) != ${macro}_OK || !same(out.u, controls[k], ${macro}_INPUTS)${estimates_differ}) {
            return k;
        }
    }
    return count;
}

static void test_vectors(void)
{
    ${name}_controller c;
    int k;
    ${name}_init(&c);
    k = replay(&c, SAMPLES);
    if (k < SAMPLES) {
        printf("sample %d differs from the simulation\n", k);
    }
    require(k == SAMPLES, "the test vectors do not agree");
${state_tests}    ${name}_reset(&c);
    require(replay(&c, SAMPLES < 50 ? SAMPLES : 50) == (SAMPLES < 50 ? SAMPLES : 50), "reset is not a fresh start");
}

/* A refused sample holds u and says so, the next good one goes on. */
static void test_refused(${real} bad, int in_command, unsigned expected)
{
    ${name}_controller c, before;
    ${name}_input in;
    ${name}_output out, good;
    const int k = SAMPLES > 8 ? 8 : SAMPLES - 2;
    int i;
    ${name}_init(&c);
    (void)replay(&c, k);
    in = sample(k);
    (void)${name}_step(&c, &in, &good);
    before = c;
    for (i = 0; i < 2; ++i) {
        in = sample(k);
        if (in_command != 0) {
            in.r[${macro}_COMMANDS - 1] = bad;
        } else {
            in.${measured}[${macro}_MEASURED - 1] = bad;
        }
        require(${name}_step(&c, &in, &out) == expected && out.status == expected, "a bad input is not refused");
        require(same(out.u, good.u, ${macro}_INPUTS), "the last good control is not held");
    }
${refused_tests}    in = sample(k);
    require(${name}_step(&c, &in, &out) == ${macro}_OK && out.status == ${macro}_OK, "there is no way back from a bad input");
    require(c.waiting == 0 && c.${started}[0] > 0, "the controller still waits after a good sample");
    (void)before;
}

static void test_limits(void)
{
    ${name}_controller c;
    ${name}_input in = sample(0);
    ${name}_output out;
    int i;
    ${name}_init(&c);
    in.sample_time = 2 * ${macro}_SAMPLE_TIME;
    require(${name}_step(&c, &in, &out) == ${macro}_WRONG_SAMPLE_TIME, "another sample time is not flagged");
    in.sample_time = ${macro}_SAMPLE_TIME / 2;
    require(${name}_step(&c, &in, &out) == ${macro}_WRONG_SAMPLE_TIME, "another sample time is not flagged");
    ${name}_init(&c);
    (void)replay(&c, 1);
    in = sample(1);
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c.last_u[i] = 1;
    }
    c.${u}[0] = 2 * ${macro}_RANGE;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED, "a state out of range is not refused");
    require(out.u[0] == 1, "the last good control is not held");
${limit_tests}    ${name}_reset(&c);
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "there is no way back from a bad state");
    c.last_u[0] = 2 * ${macro}_RANGE;
    c.bump[0] = 2 * ${macro}_RANGE;
    c.fade_left = 1L;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED && out.u[0] == 0, "a control out of range is held");
    ${name}_reset(&c);
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "there is no way back from a bad control");
    c.fade = 0L;
    c.fade_left = 1L;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED, "a fade that never ends is not refused");
}

/* Far outside of what was simulated, with inputs up to the range: what is given out stays finite, in its limits, and said. */
static void test_hard_inputs(void)
{
    ${name}_controller c;
    unsigned long random = 1UL;
    int k, i;
    ${name}_init(&c);
    for (k = 0; k < 2000; ++k) {
        ${name}_input in = sample(k % SAMPLES);
        ${name}_output out;
        for (i = 0; i < ${macro}_MEASURED; ++i) {
            random = (1103515245UL * random + 12345UL) & 0x7fffffffUL;
            in.${measured}[i] = ${macro}_RANGE * ((${real})(random >> 8) / (${real})0x400000L - 1);
        }
        (void)${name}_step(&c, &in, &out);
        for (i = 0; i < ${macro}_INPUTS; ++i) {
            require(out.u[i] >= -${macro}_RANGE && out.u[i] <= ${macro}_RANGE, "a control out of range");
            require(${saturated}, "a control beyond the actuator's limits");
        }
        if (failures != 0) {
            return;
        }
    }
}

static void test_freeze(void)
{
    ${name}_controller c;
    ${name}_output out;
    int k;
    ${name}_init(&c);
    (void)replay(&c, 1);
    for (k = 1; k < SAMPLES && k < 50; ++k) {
        ${name}_input in = sample(k);
        ${name}_controller before = c;
        in.freeze = 1;
        require(${name}_step(&c, &in, &out) == ${macro}_OK, "a frozen step is refused");
${frozen_tests}        (void)before;
    }
}

static void test_start(void)
{
    ${name}_controller c;
    ${name}_input in = sample(0);
    ${name}_output out, own;
    ${real} u_now[${macro}_INPUTS];
    int i, k;
    ${name}_init(&c);
    ${name}_start(&c, ${start_argument}controls[0], 0L, 0);
    (void)${name}_step(&c, &in, &own);
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        u_now[i] = own.u[i] + 1;
    }
    ${name}_start(&c, ${start_argument}u_now, 4L, 0);
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "the first sample after a start is refused");
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        const ${real} apart = out.u[i] - u_now[i];
        require(apart < ${tiny} && apart > -${tiny}, "the start is not without a bump");
    }
    for (k = 1; k < 4; ++k) {
        (void)${name}_step(&c, &in, &out);
    }
    require(c.fade_left == 0L, "the bump does not fade out in the time that was asked for");
    ${name}_start(&c, ${start_argument}u_now, 0L, 0);
    (void)${name}_step(&c, &in, &out);
    require(same(out.u, own.u, ${macro}_INPUTS), "a start without a fade is not the controller's own control");
    (void)replay(&c, 1);
    in.${measured}[0] = 2 * ${macro}_RANGE;
    ${name}_start(&c, ${fixed_start}u_now, 4L, 1);
    require(${name}_step(&c, &in, &out) == ${macro}_INPUT_REFUSED && same(out.u, u_now, ${macro}_INPUTS),
        "a refused first sample does not hold the actuator where it is");
${fresh_tests}}

int main(void)
{
    const ${real} nothing = ${zero};
    test_vectors();
    test_refused(nothing / nothing, 0, ${macro}_INPUT_REFUSED);
    test_refused(1 / nothing, 0, ${macro}_INPUT_REFUSED);
    test_refused(-2 * ${macro}_RANGE, 0, ${macro}_INPUT_REFUSED);
    test_refused(nothing / nothing, 1, ${macro}_INPUT_REFUSED);
    test_refused(2 * ${macro}_RANGE, 1, ${macro}_INPUT_REFUSED);
    test_limits();
    test_hard_inputs();
    test_freeze();
    test_start();
    printf(failures == 0 ? "${name}: %d samples agree in every bit\n" : "${name}: FAILED (%d samples)\n", SAMPLES);
    return failures == 0 ? 0 : 1;
}
