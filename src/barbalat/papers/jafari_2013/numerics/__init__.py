"""The oscillations of the estimates: whose they are, and which solver, step or gain removes them."""
