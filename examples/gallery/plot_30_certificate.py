"""
The loop behind a certificate
=============================

Bode, Nyquist and sensitivity of the linear loop whose margins a certificate prints, with the margins marked: L1
adaptive control in its limit of fast adaptation.
"""

from barbalat import L1Adaptive, certify, input_filter, load_case

case = load_case("third-order")
l1 = L1Adaptive(gamma=1e3, filter=input_filter(kappa=0.05))
certificate = certify(case.problem, [l1], case.simulation)["L1"]
print(certificate.values["margins_of"], certificate.values["delay_margin"])
certificate.plot()
