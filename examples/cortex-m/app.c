/*
 * A controller in the timer interrupt of a Cortex-M4F, for the L1 controller of docs/guides/flight.md, exported with
 * `--float32 --name law`. The functions measure and apply stand for a board's sensors and actuators.
 */
#include "law_controller.h"
#include <stdint.h>
#include <stdio.h>

#define CLOCK 25000000u /* frequency of the processor, of its timer and of the counter [Hz] */
#define COUNTER (*(volatile uint32_t *)0x40028018u) /* counts up on the emulated MPS2 board; on most chips DWT->CYCCNT */
#define SYST_CSR (*(volatile uint32_t *)0xE000E010u) /* ARMv7-M, B3.3 */
#define SYST_RVR (*(volatile uint32_t *)0xE000E014u)
#define SYST_CVR (*(volatile uint32_t *)0xE000E018u)
#define PERIOD ((uint32_t)(LAW_SAMPLE_TIME * CLOCK + 0.5f))
#define SAMPLES 1000u

static law_controller c; /* used by main only while the interrupt cannot occur */
static uint32_t before;  /* the counter at the last call */
static volatile unsigned samples, wrong_times, other_statuses;
static float x[LAW_MEASURED]; /* the plant of the page, by Euler steps */

static void measure(float measured[LAW_MEASURED])
{
    measured[0] = x[0];
    measured[1] = x[1];
}

static void apply(float u)
{
    x[0] += LAW_SAMPLE_TIME * x[1];
    x[1] += LAW_SAMPLE_TIME * (-2.0f * x[1] + 5.0f * u);
}

void SysTick_Handler(void)
{
    law_input in = {0};
    law_output out;
    const uint32_t now = COUNTER;
    unsigned status;

    in.sample_time = (float)(now - before) / CLOCK; /* right across an overflow of the counter too */
    before = now;
    measure(in.x);
    in.r[0] = 1.0f;
    status = law_step(&c, &in, &out);
    apply(out.u_limited[0]);
    ++samples;
    wrong_times += (status & LAW_WRONG_SAMPLE_TIME) != 0u;
    other_statuses += (status & ~LAW_WRONG_SAMPLE_TIME) != 0u;
}

int main(void)
{
    static const float at_rest[LAW_INPUTS];
    law_log log;

    law_init(&c);
    measure(x);
    if (law_start(&c, x, at_rest, 100, 0) != LAW_OK) return 1;
    SYST_RVR = PERIOD - 1u;
    SYST_CVR = 0u;
    before = COUNTER;
    SYST_CSR = 7u; /* the processor's clock, with an interrupt */
    while (samples < SAMPLES) { /* the rest of the program */
    }
    SYST_CSR = 0u; /* the log must not be read while a step changes the state */
    law_read_log(&c, &log);
    printf("%u samples, %u at a wrong time, %u with another status, x = %.4f\n", samples, wrong_times, other_statuses,
        (double)x[0]);
    return 0;
}
