"""Lost samples of a controller without states, stepped by hand, and the effect of a scheme's factors on the row."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from barbalat.export import campaign
from barbalat.papers.jafari_2013 import section_v
from barbalat.papers.jafari_2013.numerics import missed_samples
from barbalat.papers.jafari_2013.numerics.missed_samples import Losses, judged, losses, schemes

T = missed_samples.SAMPLE_TIME


def by_hand(lost: np.ndarray) -> np.ndarray:
    """The exact max |e| with known parameters: x' = (A_m + b theta') x + b u with a held u, also over a lost sample."""
    given = section_v.problem()
    A_m, b, theta, k_0 = given.plant.A_m, given.plant.b, given.plant.theta, given.reference_model.k_0
    amplitude, omega = given.reference.amplitude, given.reference.frequency
    M = np.zeros((7, 7))  # x, x_m, r and its quadrature, u
    M[:2, :2], M[:2, 6] = A_m + np.outer(b, theta), b
    M[2:4, 2:4], M[2:4, 4] = A_m, k_0 * b
    M[4, 5], M[5, 4] = omega, -omega
    step, z = expm(M * T), np.concatenate([given.plant.x0, given.plant.x0, [0.0, amplitude, 0.0]])
    most = np.zeros(2)
    for gone in lost:
        if not gone:
            z[6] = k_0 * z[4] - theta @ z[:2]
        z = step @ z
        most = np.maximum(most, np.abs(z[:2] - z[2:4]))
    return most


def test_the_errors_are_those_of_a_loop_stepped_by_hand():
    """The errors agree to 1e-6. RK4's error over a step of 1 ms is far smaller, and the factors are printed with three digits."""
    (known,) = [one for one in schemes() if one.name == "known parameters"]
    whole, tail = losses(known, 2)
    t = np.arange(round(missed_samples.T_END / T)) * T
    np.testing.assert_allclose(whole.own, by_hand(np.zeros(len(t), dtype=bool)), rtol=1e-6)
    for seed in range(2):
        drawn = replace(missed_samples.Dropout(share=0.1), seed=seed)
        np.testing.assert_allclose(whole.singles[seed], by_hand(drawn.there(t, 0)), rtol=1e-6)
        np.testing.assert_allclose(whole.bursts[seed], by_hand(replace(drawn, burst=10 * T).there(t, 0)), rtol=1e-6)
    assert (tail.bursts <= whole.bursts).all() and whole.factors[1] > 2 > whole.factors[0]


def one(own: float, singles: list[float], bursts: list[float]) -> Losses:
    return Losses(np.array([own, own]), *(np.array(kind)[:, None] * [own, own / 2] for kind in (singles, bursts)))


FINE, LOST = one(1.0, [1.1, 1.2], [1.5, 2.0]), one(1.0, [1.1, np.nan], [1.5, 1.5])


@pytest.mark.parametrize(
    ("other", "finding"),
    [
        (one(0.1, [1.1, 1.2], [1.3, 2.0]), "holds"),
        (one(0.1, [1.1, 1.2], [1.3, 2.1]), "mixed"),  # one draw of one scheme is a counterexample
        (one(0.1, [1.1, 2.1], [1.3, 2.1]), "fails"),
        (LOST, "mixed"),  # a run that diverges tolerates nothing
    ],
)
def test_one_draw_of_one_scheme_decides(other, finding):
    whole = {"fine": FINE, "other": other}
    row = judged(whole, whole)
    assert row.finding == finding
    (table,) = row.listings
    assert [line[-1] for line in table.rows] == ["yes", "yes" if finding == "holds" else "no"]


def test_a_small_factor_is_no_small_error():
    loose, tight = one(10.0, [1.1], [1.1]), one(0.1, [1.1], [4.0])
    whole = {"loose": loose, "tight": tight}
    assert not next(reading for reading in judged(whole, whole).readings if "smallest factor" in reading.says).holds
    assert (loose.largest, tight.largest) == (pytest.approx(11.0), pytest.approx(0.4))


def test_the_rule_is_that_of_the_campaign():
    assert missed_samples.TOLERATED == campaign.TOLERATED
    assert (missed_samples.LOST_SHARE, missed_samples.BURST_SAMPLES) == (campaign.BURST_SHARE, campaign.BURST_SAMPLES)


@pytest.mark.full
def test_more_draws_show_what_the_row_says_they_do():
    more = {one.name: losses(one, missed_samples.MORE_DRAWS)[0] for one in schemes() if one.name in ("PI", "MRAC")}
    assert not more["PI"].tolerated and more["PI"].factors[0] < 1.1 and more["MRAC"].tolerated
    few = Losses(more["PI"].own, *(kind[: missed_samples.DRAWS] for kind in (more["PI"].singles, more["PI"].bursts)))
    assert few.tolerated
