"""Design, certify, simulate and deploy adaptive controllers, and find out which claims about them are true.

Here are problems, controllers and what is done with them. What else there is stands in modules by its subject:

plants      what lies before and behind a plant, labels, known sets
regressors  what the unknown parameters multiply
signals     commands, disturbances and recorded data
laws        adaptive laws and their modifications
solvers     integration methods
systems     linear systems, their margins and norms
designs     linear robust designs
results     what simulations and certificates give back
studies     sweeps, tuning, contests, margins found by simulation, explorers
exports     controllers as source for flight computers and as FMUs
flights     controllers on flight models
interfaces  what a controller of one's own must be
testing     a check of one

Each name is imported when it is first used, so that ``import barbalat`` is fast.
"""

from barbalat.public_names import public

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = public(__name__)
