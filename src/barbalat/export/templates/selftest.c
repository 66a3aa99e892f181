/*
 * ${origin}
 * Exit code 0: the ${samples} test vectors agree bit for bit, and everything else behaves as README.md says.
 */
#include "controller.h"
#include <stdint.h>
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
${estimate_table}/* Digests of the whole state after each sample. */
static const uint64_t digests[SAMPLES] = {
    ${digests} };
static const ${real} limits[${macro}_INPUTS][2] = {
${limit_rows}};
/* A run with lost samples. Flags: 1 measurement lost, 2 command lost, 4 estimates frozen. */
static const int losses[] = { ${losses} };
static const ${real} lossy_controls[][${macro}_INPUTS] = {
${lossy_rows}};
/* The log after the last sample. */
static const ${real} logged[${macro}_LOG_SIZE] = {
    ${log_row} };
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

static int close_to(const ${real} *a, const ${real} *b, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        const ${real} apart = a[i] > b[i] ? a[i] - b[i] : b[i] - a[i];
        if (!(apart <= ${small} * (1 + (b[i] > 0 ? b[i] : -b[i])))) {
            return 0;
        }
    }
    return 1;
}

static int same_state(const ${name}_controller *a, const ${name}_controller *b)
{
    return ${same_state};
}

/* Whether u_limited is u within the actuator's limits. */
static int is_limited(const ${name}_output *out)
{
    int i;
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        const ${real} u = out->u[i] < limits[i][0] ? limits[i][0] : out->u[i] > limits[i][1] ? limits[i][1] : out->u[i];
        if (!same(&out->u_limited[i], &u, 1)) {
            return 0;
        }
    }
    return 1;
}

/* The bits of these numbers mixed into a digest, which reveals every single difference. */
static uint64_t mixed(uint64_t digest, const ${real} *numbers, int count)
{
    int i;
    for (i = 0; i < count; ++i) {
        uint${width}_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        digest = (digest ^ bits) * ${prime};
    }
    return digest;
}

static uint64_t digest_of(const ${name}_controller *c)
{
    uint64_t found = 0U;
${digest_calls}    return found;
}

/* Runs samples 0 to count - 1 from a fresh state; returns the first that differs from the simulation. */
static int replay(${name}_controller *c, int count)
{
    int k;
    for (k = 0; k < count; ++k) {
        const ${name}_input in = sample(k);
        ${name}_output out;
        if (${name}_step(c, &in, &out) != ${macro}_OK || out.status != ${macro}_OK || !is_limited(&out)
            || !same(out.u, controls[k], ${macro}_INPUTS)${estimates_differ} || digest_of(c) != digests[k]) {
            return k;
        }
    }
    return count;
}

${chosen_tests}static void test_vectors(void)
{
    ${name}_controller c, fresh;
    ${name}_log log;
    ${real} shown[${macro}_LOG_SIZE];
    int k;
    memset(&c, 60, sizeof c); /* values that init must overwrite */
    memset(&fresh, 0, sizeof fresh);
    ${name}_init(&c);
    ${name}_init(&fresh);
    require(same_state(&c, &fresh) && same(c.last_u, fresh.last_u, ${macro}_INPUTS), "init does not overwrite the state");
    k = replay(&c, SAMPLES);
    if (k < SAMPLES) {
        printf("sample %d differs from the simulation\n", k);
    }
    require(k == SAMPLES, "the test vectors do not agree");
    memset(&log, 60, sizeof log);
    ${name}_read_log(&c, &log);
    memcpy(shown, &log, sizeof shown);
    require(sizeof log == sizeof shown && same(shown, logged, ${macro}_LOG_SIZE), "the log differs");
${state_tests}    c.fade = -1L;
    c.fade_left = 1L;
    c.matching = 1;
    ${name}_reset(&c);
    memcpy(fresh.last_u, c.last_u, sizeof fresh.last_u);
    require(same_state(&c, &fresh) && same(c.last_u, controls[SAMPLES - 1], ${macro}_INPUTS), "reset is not a fresh start");
    require(replay(&c, SAMPLES < 50 ? SAMPLES : 50) == (SAMPLES < 50 ? SAMPLES : 50), "reset is not a fresh start");
}

/* Lost samples, including losses before the first good sample: u and the state agree with the simulation with the same losses. */
static void test_losses(void)
{
    ${name}_controller c;
    const ${real} nothing = ${zero};
    int k;
    ${name}_init(&c);
    for (k = 0; k < (int)(sizeof losses / sizeof *losses); ++k) {
        ${name}_input in = sample(k);
        ${name}_output out;
        if ((losses[k] & 1) != 0) {
            in.${measured}[${macro}_MEASURED - 1] = nothing / nothing;
        }
        if ((losses[k] & 2) != 0) {
            in.r[${macro}_COMMANDS - 1] = nothing / nothing;
        }
        in.freeze = losses[k] & 4;
        require((${name}_step(&c, &in, &out)${told}) == (((losses[k] & 1) != 0 ? ${macro}_MEASUREMENT_LOST : ${macro}_OK)
                    | ((losses[k] & 2) != 0 ? ${macro}_COMMAND_LOST : ${macro}_OK)),
            "a lost sample is not told, or a good one refused");
        require(same(out.u, lossy_controls[k], ${macro}_INPUTS) && is_limited(&out), "a run with losses differs");
    }
${lossy_tests}}

/* After a bad measurement the last good one is repeated, the estimates are frozen and u is held. The last good command replaces a bad command. */
static void test_refused(${real} bad, int in_command)
{
    ${name}_controller c, other;
    ${name}_output out, expected;
    int k = SAMPLES > 12 ? 8 : SAMPLES - 4, last;
    ${name}_init(&c);
    (void)replay(&c, k);
    other = c;
    for (last = k + 2; k <= last; ++k) {
        ${name}_input in = sample(k), as = sample(k);
        ${real} held[${macro}_INPUTS];
        memcpy(held, other.last_u, sizeof held);
        if (k < last && in_command != 0) {
            in.r[0] = bad;
            memcpy(as.r, commands[last - 3], sizeof as.r);
        } else if (k < last) {
            in.${measured}[0] = bad;
            memcpy(as.${measured}, measured[last - 3], sizeof as.${measured});
            as.freeze = ${lost};
        }
        (void)${name}_step(&other, &as, &expected);
        if (k < last && in_command == 0) {
            memcpy(expected.u, held, sizeof held);
            memcpy(other.${u}, held, sizeof held);
            memcpy(other.last_u, held, sizeof held);
${mirror_outage}        }
        require(${name}_step(&c, &in, &out) == (k == last ? ${macro}_OK : in_command != 0 ? ${macro}_COMMAND_LOST : ${macro}_MEASUREMENT_LOST),
            "a bad input is not told");
${mirror_command}        require(same(out.u, expected.u, ${macro}_INPUTS), "a wrong control after a bad input");
        require(is_limited(&out), "a bad input leads beyond the actuator's limits, or changes the control within");
        require(same_state(&c, &other), "the state does not advance through a bad input as it should");
    }
}

/* If the result of the first sample would be out of range, here because of the fade, nothing changes. */
static void test_result(void)
{
    ${name}_controller c, before;
    ${name}_input in = sample(${fade_from});
    ${name}_output out;
    ${real} beyond;
    ${name}_init(&c);
    (void)replay(&c, ${fade_from});
    c.bump[0] = controls[${fade_from}][0] > 0 ? ${macro}_RANGE : -${macro}_RANGE;
    c.fade = 1L;
    c.fade_left = 1L;
    beyond = c.bump[0] + controls[${fade_from}][0];
    if (beyond >= -${macro}_RANGE && beyond <= ${macro}_RANGE) {
        return; /* this control is lost in the rounding of such a large number */
    }
    before = c;
    in.sample_time = ${off};
    require(${name}_step(&c, &in, &out) == (${refused_status} | ${reported}), "a result out of range is not refused");
${counted}${refused_misses}    require(${begins_again}(same(out.u, before.last_u, ${macro}_INPUTS) && is_limited(&out) && same_state(&c, &before)),
        "a refused result moves something");
}
${standstill}
static void test_limits(void)
{
    ${name}_controller c;
    ${name}_input in = sample(0);
    ${name}_output out;
    ${name}_log log;
    ${real} last;
    int i, k;
    ${name}_init(&c);
    in.sample_time = ${macro}_SAMPLE_TIME * (1 + 9 * ${small});
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "a timer's inaccuracy is flagged");
    in.sample_time = ${macro}_SAMPLE_TIME * (1 - 9 * ${small});
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "a timer's inaccuracy is flagged");
${timer_tests}    ${name}_init(&c);
    (void)replay(&c, 1);
    in = sample(1);
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c.last_u[i] = limits[i][1] < 1 ? limits[i][1] : limits[i][0] > 1 ? limits[i][0] : 1;
    }
    last = c.last_u[0];
    c.${u}[0] = 2 * ${macro}_RANGE;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED, "a state out of range is not refused");
    require(out.u[0] == last && is_limited(&out), "the last good control is not held");
${limit_tests}    ${name}_reset(&c);
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "the controller does not return from a bad state");
    c.last_u[0] = 2 * ${macro}_RANGE;
    c.bump[0] = 2 * ${macro}_RANGE;
    c.fade_left = 1L;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED && out.u[0] == 0 && is_limited(&out),
        "a control out of range is held");
    ${name}_reset(&c);
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "the controller does not return from a bad control");
    c.last_u[0] = 2 * ${macro}_RANGE;
    ${name}_reset(&c);
    require(c.last_u[0] == 0, "a reset keeps a control out of range");
    c.bump[0] = 2 * ${macro}_RANGE;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED, "a bump out of range is not refused");
    ${name}_reset(&c);
    c.fade = 0L;
    c.fade_left = 1L;
    require(${name}_step(&c, &in, &out) == ${macro}_STATE_REFUSED, "a fade that never ends is not refused");
    /* a held control is applied within the limits: tested from below the lower limit to above the upper limit, and at both limits */
    for (k = -4; k <= 20; ++k) {
        ${name}_init(&c);
        in.${measured}[0] = 2 * ${macro}_RANGE;
        for (i = 0; i < ${macro}_INPUTS; ++i) {
            const int without = limits[i][1] > ${macro}_RANGE;
            c.last_u[i] = without != 0 ? (${real})(k - 8) : limits[i][0] * ((${real})(16 - k) / 16) + limits[i][1] * ((${real})k / 16);
        }
        require((${name}_step(&c, &in, &out)${told}) == ${macro}_MEASUREMENT_LOST && same(out.u, c.last_u, ${macro}_INPUTS),
            "before the first good sample the control is not held");
        require(is_limited(&out), "a control beyond the actuator's limits, or a changed one within");
        ${name}_read_log(&c, &log);
        require(${log_of_u}, "the log has a different control");
    }
}

/* Far outside the simulated region, with inputs up to the range, the outputs stay finite and within limits, and violations are reported. */
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
        }
        require(is_limited(&out), "a control beyond the actuator's limits, or a changed one within");
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

/* If the control that the controller computes is not zero, the first control is u_now, and the difference fades out; the fade pauses during a lost sample. */
static void test_fade(void)
{
    ${name}_controller c;
    ${name}_output out;
    ${real} bump[${macro}_INPUTS];
    int i, k, left = ${fade};
    ${name}_init(&c);
    (void)replay(&c, ${fade_from});
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        c.bump[i] = controls[${fade_from}][i] + 1;
        bump[i] = c.bump[i] - controls[${fade_from}][i];
    }
    c.fade = ${fade}L;
    c.fade_left = ${fade}L;
    c.matching = 1;
    for (k = 0; left >= 0; ++k) {
        ${name}_input in = sample(${fade_from} + k / 2);
        ${name}_controller own = c;
        ${name}_output expected;
        own.matching = 0;
        own.fade_left = 0L;
        (void)${name}_step(&own, &in, &expected);
        for (i = 0; i < ${macro}_INPUTS; ++i) {
            if (k % 2 == 1) {
                expected.u[i] = c.last_u[i];
            } else if (left > 0) {
                expected.u[i] = expected.u[i] + bump[i] * ((${real})left / (${real})${fade});
            }
        }
        if (k % 2 == 1) {
            in.${measured}[0] = 2 * ${macro}_RANGE;
        }
        (void)${name}_step(&c, &in, &out);
        require(same(out.u, expected.u, ${macro}_INPUTS) && is_limited(&out), "a start does not fade out as it should");
        left -= k % 2 == 0 ? 1 : 0;
        require(c.fade_left == (left > 0 ? left : 0) && c.matching == 0, "a start does not fade out in the given time");
    }
}

/* A bump offset of either sign is rejected if u is large enough to move it beyond the range. */
static void test_bump_out_of_range(void)
{
    const ${name}_input in = sample(${fade_from});
    const ${real} u = controls[${fade_from}][0];
    const ${real} beyond = ${macro}_RANGE + (u < 0 ? -u : u);
    unsigned told = 0u;
    int side;
    for (side = 0; side < 2; ++side) {
        ${name}_controller c;
        ${name}_output out;
        ${name}_init(&c);
        (void)replay(&c, ${fade_from});
        c.fade = ${fade}L;
        c.fade_left = ${fade}L;
        c.matching = 1;
        c.bump[0] = side == 0 ? ${macro}_RANGE : -${macro}_RANGE;
        told |= ${name}_step(&c, &in, &out);
    }
    require((told & ${macro}_RESULT_REFUSED) != 0u || !(beyond > ${macro}_RANGE), "a bump out of range is put out");
}

static void test_start(void)
{
    ${name}_controller c, before;
    ${name}_input in = sample(0);
    ${name}_output out, own;
    ${real} u_now[${macro}_INPUTS];
    int i;
    ${name}_init(&c);
    (void)replay(&c, SAMPLES);
    before = c;
    in = sample(SAMPLES - 1);
    require(${name}_start(&c, ${start_argument}controls[0], -1L, 1) == ${macro}_OK, "a start is refused");
${kept_tests}    require(c.fade == 0L && c.fade_left == 0L && ${name}_step(&c, &in, &own) == ${macro}_OK,
        "a start with a negative number of samples is not one without a fade");
    (void)${name}_start(&c, ${start_argument}controls[0], ${most}L - 1L, 1);
    require(c.fade == ${most}L - 1L && c.fade_left == c.fade, "a long fade is shortened");
    (void)${name}_start(&c, ${start_argument}controls[0], ${most}L + 1L, 1);
    require(c.fade == ${most}L && c.fade_left == c.fade, "a start fades out over more samples than are counted");
    for (i = 0; i < ${macro}_INPUTS; ++i) {
        u_now[i] = own.u[i] + 1;
        u_now[i] = u_now[i] > limits[i][1] ? limits[i][1] : u_now[i] < limits[i][0] ? limits[i][0] : u_now[i];
    }
    c = before;
    (void)${name}_start(&c, ${start_argument}u_now, ${fade}L, 1);
    require(c.fade == ${fade}L && c.fade_left == ${fade}L && c.matching == 1, "the bump does not fade out in the given time");
    require(${name}_step(&c, &in, &out) == ${macro}_OK, "the first sample after a start is refused");
    require(close_to(out.u, u_now, ${macro}_INPUTS), "the start causes a bump");
    for (i = 1; i < ${fade}; ++i) {
        (void)${name}_step(&c, &in, &out);
    }
    require(c.fade_left == 0L, "the bump does not fade out in the given time");
    c = before;
    (void)${name}_start(&c, ${start_argument}u_now, 0L, 1);
    require(${name}_step(&c, &in, &out) == ${macro}_OK && same(out.u, own.u, ${macro}_INPUTS),
        "a start without a fade is not the controller's own control");
    for (i = 0; i < 2; ++i) { /* a start beyond the limits begins at the limits */
        ${real} ends[${macro}_INPUTS], beyond[${macro}_INPUTS];
        int j;
        for (j = 0; j < ${macro}_INPUTS; ++j) {
            const int without = limits[j][1] > ${macro}_RANGE;
            ends[j] = without != 0 ? own.u[j] : limits[j][i];
            beyond[j] = without != 0 ? own.u[j] : i == 1 ? limits[j][1] + 1 : limits[j][0] - 1;
        }
        c = before;
        require(${name}_start(&c, ${start_argument}beyond, ${fade}L, 1) == ${macro}_OK && same(c.last_u, ends, ${macro}_INPUTS)
                && same(c.bump, ends, ${macro}_INPUTS),
            "a start beyond the limits does not begin at them");
    }
    c = before;
    in.${measured}[0] = 2 * ${macro}_RANGE;
${refused_starts}${elsewhere}    (void)${name}_start(&c, ${other_start}u_now, ${fade}L, 0);
${start_tests}    before = c;
${first_miss}${fresh_tests}}

int main(void)
{
    const ${real} nothing = ${zero};
    test_vectors();
${run_chosen}    test_losses();
${refused_tests}    test_result();
${stands_still}    test_limits();
    test_hard_inputs();
    test_freeze();
${fade_test}    test_start();
    test_bump_out_of_range();
${shell_test}    printf(failures == 0 ? "${name}: %d samples agree in every bit\n" : "${name}: FAILED (%d samples)\n", SAMPLES);
    return failures == 0 ? 0 : 1;
}
