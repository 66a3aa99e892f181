"""The certificate's statements on a sampled controller in addition to those on its continuous form."""

from __future__ import annotations

from barbalat import L1Adaptive, Mrac, Sampled, Simulation, input_filter
from barbalat.certificates.certify import certify
from barbalat.papers.jafari_2013.section_v import variant


def findings(controller, **settings):
    sampled = Sampled(controller=controller, sample_time=2e-3, **settings)
    found = certify(variant(), (sampled,), Simulation(t_end=1.0, dt=1e-3), keys=())  # no search makes a finding
    return " ".join(found[controller.name].findings)


def test_a_sampled_mrac_names_the_delay_that_fast_adaptation_tolerates():
    """The delay is one sample without a filter. With a filter or Euler's method there is no such statement. With a gain matrix
    the loop does not match the model while the projection acts."""
    assert "one sample, 0.002 s" in findings(Mrac(gamma=10.0))
    assert "one sample" in findings(L1Adaptive(gamma=10.0, filter=None))
    assert "one sample" not in findings(L1Adaptive(gamma=10.0, filter=input_filter(0.02)))
    assert "one sample" not in findings(Mrac(gamma=10.0), discretization="euler")
    assert "before its projection" in findings(Mrac(gamma=[[10.0, 1.0], [1.0, 5.0]]))
