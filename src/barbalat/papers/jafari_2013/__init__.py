"""S. Jafari, P. Ioannou, L. Rudd, What is L1 Adaptive Control, 2013."""
