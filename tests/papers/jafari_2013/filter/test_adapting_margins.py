"""The margins of the adapting loop over gain and filter, compared with independent linearisations, Pade approximations and their
limits."""

import control
import numpy as np
import pytest

from barbalat import Mrac, Simulation, certify
from barbalat.certificates.linear_loops.ideal import around_equilibrium
from barbalat.linear.margins import margins
from barbalat.linear.systems import TransferFunction, series
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.filter import adapting_margins, gain_margins


@pytest.fixture(scope="module")
def effect():
    return adapting_margins.filter_effect()


def linearised(gamma, r, kappa):
    controller = Mrac(gamma=gamma) if kappa is None else section_v.l1("L1", gamma, kappa)
    return around_equilibrium(section_v.problem(), controller, r)


@pytest.mark.parametrize("kappa", [None, 0.005, 0.3])
def test_the_loop_is_affine_in_gamma_and_depends_on_gamma_r_squared(kappa):
    w = np.geomspace(1e-2, 1e4, 40)
    for size in (1e-5, 1.0, 3e4):
        found = adapting_margins.loop(kappa)(size).response(w)
        for r in (1.0, 50.0):
            np.testing.assert_allclose(found, linearised(size / r**2, r, kappa).response(w), rtol=1e-6)


def test_the_line_of_ratio_1_divides_the_plane(effect):
    """The test has points on both sides of the line, from linearisations at either command and with a Pade approximation of a
    delay in between."""
    shown = effect.maps[0]
    line = shown.curves[0]
    for size, kappa in list(zip(line.x, line.y, strict=True))[::3]:
        for r in (1.0, 50.0):
            for factor, raised in ((0.8, False), (1.25, True)):
                gamma = factor * size / r**2
                plain, filtered = linearised(gamma, r, None), linearised(gamma, r, kappa)
                between = np.sqrt(margins(plain).delay * margins(filtered).delay)
                assert (margins(filtered).delay > margins(plain).delay) == raised
                assert [is_stable(loop, between) for loop in (plain, filtered)] == [not raised, raised]
    assert (shown.values[:, shown.x.values < 1e-3][:-1] < 1).all() and (shown.values[:-1, shown.x.values > 3e-3] > 1).all()


def is_stable(loop, delay):
    num, den = control.pade(delay, 8)
    delayed = series(loop, TransferFunction(np.array(num), np.array(den)).realise())
    return np.linalg.eigvals(delayed.A - np.outer(delayed.B, delayed.C) / (1 + delayed.D)).real.max() < 0


def test_the_filter_costs_gain_margin_whatever_the_gain(effect):
    """At gains between the ones of the map, the factor that MRAC's loop tolerates makes the filtered loop unstable."""
    shown = effect.maps[1]
    assert (shown.values[shown.y.values <= adapting_margins.MODERATE_KAPPA] < 1).all()
    for size in (3e-3, 7.0, 2e5):
        tolerated = margins(adapting_margins.loop(None)(size)).gain_up * 0.9999
        for kappa, stable in ((None, True), (0.02, False)):
            loop = adapting_margins.loop(kappa)(size)
            assert (np.linalg.eigvals(loop.A - tolerated * np.outer(loop.B, loop.C)).real.max() < 0) == stable


def test_the_ends_of_the_curves():
    """For Gamma -> 0 the margin equals the margin of the loop with constant estimates. At high gain it is proportional to 1/Gamma
    for MRAC, and for L1-AC it equals the margin of the limit loop."""
    claim = gain_margins.gain_reduces_margins()
    (chart,) = claim.maps
    assert [reading.holds for reading in claim.readings if reading.literal] == [True]
    assert [reading.says for reading in claim.readings if not reading.literal and not reading.holds] == [
        "L1-AC with Section V's filter: both are more than a tenth smaller at Section V's gain than at 10",
        "MRAC: the gain margin downwards falls with every increase of the gain",  # a higher gain tolerates a larger loss of it
        *(
            f"L1-AC, kappa = 0.02 s: the {name} falls with every increase of the gain"
            for name in ("gain margin downwards", "phase margin", "delay margin")
        ),
    ]
    high, moderate = (margins(linearised(gamma, 50.0, 0.02)).delay for gamma in (1e4, 10.0))
    assert high > moderate and f"{moderate:.4g} to {high:.4g}" in claim.readings[1].measured
    curves = {curve.label: curve.y for curve in chart.curves}
    plain, filtered = curves["MRAC"], curves["L1-AC, κ = 0.02 s"]
    assert plain[0] == pytest.approx(0.254, rel=0.01) and filtered[0] == pytest.approx(0.234, rel=0.01)
    assert plain[-1] / plain[-4] == pytest.approx(0.1, rel=1e-3)  # three values in a decade
    assert filtered[-1] == pytest.approx(0.0328, rel=1e-2)
    assert filtered.min() < filtered[-1] / 100 and filtered.argmin() not in (0, len(filtered) - 1)


def test_the_gain_margin_upwards_is_the_papers_evidence_no_other_is(effect):
    assert [reading.holds for reading in effect.readings] == [True, *[False] * 4]
    assert effect.fall_at_every_gain == (adapting_margins.UPWARDS,)
    assert effect.rise_at_high_gain == ("phase margin", "delay margin", "small-gain margin 1/||T||_inf")
    slow = effect.readings[0].measured  # the excluded cells are named: 3 filters of 43 gains
    assert "all 387 cells with kappa <= 0.1 s" in slow and slow.count("of 43 cells") == 3
    assert (
        "rises in 2 (Gamma r^2 = " in slow
        and "kappa = 0.4 s, k - 1 falls in 0 of 43 cells, and the loop with the filter is unstable in 43" in slow
    )
    for kappa, factor in zip((None, 0.02), effect.gain_margins, strict=True):
        loop = linearised(1e4, 50.0, kappa)
        for k, stable in ((factor * 0.9999, True), (factor * 1.0001, False)):
            assert (np.linalg.eigvals(loop.A - k * np.outer(loop.B, loop.C)).real.max() < 0) == stable


@pytest.mark.parametrize(
    ("gain", "phases", "sizes", "downwards"),
    [(100.0, (0.00118, 0.0201), (0.00118, 0.00478), (1.2e-4, 0.077)), (2.5e7, (2.35e-6, 1.63), (2.35e-6, 0.0046), (0.0, 0.077))],
)
def test_phase_and_small_gain_margins_rise_with_the_filter_and_the_gain_margin_downwards_gets_worse(
    gain, phases, sizes, downwards
):
    """The margins are compared with the response of independent linearisations at r = 50 on a grid and with eigenvalues at a
    reduced gain."""
    for kappa, phase, size, down in zip((None, 0.02), phases, sizes, downwards, strict=True):
        own = linearised(gain / 2500, 50.0, kappa)
        tolerated = adapting_margins.tolerates(adapting_margins.loop(kappa)(gain))
        poles = np.linalg.eigvals(own.A - np.outer(own.B, own.C))  # the slower its poles decay, the narrower the peaks of T
        around = np.abs(poles.imag[:, None] + poles.real[:, None] * np.linspace(-3, 3, 2001)).ravel()
        at = own.response(np.concatenate([np.geomspace(1e-3, 1e6, 20_001), around]))
        assert tolerated.small_gain == pytest.approx(size, rel=0.01)
        assert 1 / np.abs(at / (1 + at)).max() == pytest.approx(tolerated.small_gain, rel=1e-4)
        turned = own.response(np.array(tolerated.margins.crossovers))  # e^(-+ j phase) moves one of them to -1
        turns = np.exp(1j * phase * np.array([[1], [-1]]))
        assert np.abs(1 + turned * turns).min() < 0.01 * phase + 1e-6
        assert tolerated.margins.phase == pytest.approx(phase, rel=0.01)
        assert tolerated.margins.gain_down == pytest.approx(down, rel=0.01, abs=1e-8)
        if down:
            for k, stable in ((0.98 * down, False), (1.02 * down, True)):
                assert (np.linalg.eigvals(own.A - k * np.outer(own.B, own.C)).real.max() < 0) == stable


def test_the_delay_margin_of_mrac_falls_like_one_over_gamma():
    """The delay margin is inversely proportional to the gain and not to its square root, as the oscillation's frequency would
    suggest: with ten times the gain it is a tenth."""
    gains = (1e2, 1e3, 1e4, 1e5)
    found = [
        certify(section_v.problem(), [Mrac(gamma=gamma)], Simulation(t_end=1.0, dt=1e-4))["MRAC"].values["delay_margin_adapting"]
        for gamma in gains
    ]
    np.testing.assert_allclose(np.multiply(found, gains), found[0] * gains[0], rtol=1e-3)


def test_what_l1s_authors_say_of_its_margins():
    """The phase margin has three values. The delay margin tends to the delay margin of C/(1 - C) (1 + theta'G)."""
    claim = gain_margins.l1_margins()
    assert claim.finding == "mixed" and claim.sentence.source.side == "ours"
    phase, delay = claim.readings[:2]
    assert "0.0932 at the smallest" in phase.measured and "1.6 at the largest" in phase.measured
    assert delay.holds and "0.03277 s in the limit" in delay.measured
    least = adapting_margins.tolerates(adapting_margins.loop(0.02)(100.0)).margins.delay
    assert (
        least == pytest.approx(1.03e-4, rel=0.01) and "0.000103 s" in claim.shows
    )  # the dip is reported beside the restored margin
