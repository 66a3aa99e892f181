"""If only some keys of a certificate are requested, they equal the keys of the full certificate, and the expensive parts are left
out."""

from __future__ import annotations

import pytest

from barbalat import certify

COSTLY = {
    "margins_over_known_set",
    "kappa_admissible",
    "error_bound_command",
    "error_bound_worst",
    "gamma_max_at_model",
    "step_max_at_model",
    "delay_margin_adapting",
    "sample_time_max",
    "mu_parameters",
    "parameter_scale",
    "theta_destabilising",
    "mu",
    "mu_frequency",
    "mu_dynamics",
}
CHEAP = {"delay_margin", "condition", "error_bound", "gamma_max", "norms"}


@pytest.mark.short(kept=lambda name: name == "paper")
@pytest.mark.parametrize(
    "name", ["paper", "third-order", "astrom-wittenmark", "f16-short-period", "first-order", "wing-rock", "quadrotor-pitch"]
)
def test_each_needed_key_is_that_of_the_whole_certificate(name, certified):
    case, whole = certified(name)
    for keys in (sorted(COSTLY)[::2], sorted(COSTLY)[1::2]):
        part = certify(case.problem, case.controllers, case.simulation, keys=keys)
        for controller, one in whole.items():
            assert [part[controller].entry(key) for key in keys] == [one.entry(key) for key in keys], (controller, keys)
    cheap = certify(case.problem, case.controllers, case.simulation, keys=CHEAP)
    for controller, one in whole.items():
        left_out = {entry.key for entry in one.entries} - {entry.key for entry in cheap[controller].entries}
        assert left_out <= COSTLY
        assert [cheap[controller].entry(key) for key in CHEAP] == [one.entry(key) for key in CHEAP]
    for one in whole.values():
        of_all, of_own = one.entry("error_bound_worst"), one.entry("error_bound_command")
        if of_all is not None and of_own is not None and of_all.kind == "guaranteed" and of_all.value and of_own.value:
            assert of_own.value <= of_all.value
    assert certify(case.problem, case.controllers, case.simulation) == whole  # nothing remains left out
