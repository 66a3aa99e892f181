"""The exported C of a piecewise-constant law for two states, with the calls of a flight computer when its modes change."""

from __future__ import annotations

import ctypes
from dataclasses import replace
from functools import cache

import numpy as np

from barbalat import Simulation
from barbalat.export.compiler import loaded, require_compiler, shared_library
from export.made import files

CALLS = """\
#include "controller.h"
static law_controller c;
void begin(void);
void again(void);
void enable(const double *x, const double *u_now, long samples, int keep);
unsigned act(const double *x, double r, double *u, double *sigma_hat);
void begin(void) { law_init(&c); }
void again(void) { law_reset(&c); }
void enable(const double *x, const double *u_now, long samples, int keep) { (void)law_start(&c, x, u_now, samples, keep); }
unsigned act(const double *x, double r, double *u, double *sigma_hat)
{
    law_input in = {LAW_SAMPLE_TIME, {x[0], x[1]}, {r}, 0};
    law_output out;
    const unsigned status = law_step(&c, &in, &out);
    *u = out.u[0];
    sigma_hat[0] = c.sigma_hat[0];
    sigma_hat[1] = c.sigma_hat[1];
    return status;
}
"""


@cache
def _compiled(problem, law) -> bytes:
    simulation = Simulation(t_end=100 * law.sample_time, dt=law.sample_time)
    texts = files(problem, replace(law, name="law"), simulation)
    return shared_library(
        require_compiler(), {**{name: texts[name] for name in ("controller.h", "controller.c")}, "calls.c": CALLS}
    )


class Engaged:
    """An initialised controller."""

    def __init__(self, problem, law) -> None:
        self._library = loaded(_compiled(problem, law))
        doubles = ctypes.POINTER(ctypes.c_double)
        self._library.enable.argtypes = [doubles, doubles, ctypes.c_long, ctypes.c_int]
        self._library.act.argtypes, self._library.act.restype = [doubles, ctypes.c_double, doubles, doubles], ctypes.c_uint
        self._library.begin()

    def reset(self) -> None:
        """Call ``_reset``."""
        self._library.again()

    def enable(self, x: np.ndarray, u_now: float, samples: int, *, keep: bool) -> None:
        """Call ``_start``."""
        self._library.enable((ctypes.c_double * 2)(*x), (ctypes.c_double * 1)(u_now), samples, keep)

    def __call__(self, x: np.ndarray, r: float) -> tuple[float, float, float]:
        """u and sigma_hat at the next sample, which must be accepted."""
        u, sigma_hat = (ctypes.c_double * 1)(), (ctypes.c_double * 2)()
        assert self._library.act((ctypes.c_double * 2)(*x), r, u, sigma_hat) == 0
        return u[0], *sigma_hat
