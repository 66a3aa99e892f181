"""The oscillations of the estimates, their cause, and the solvers, steps and gains that remove them."""
