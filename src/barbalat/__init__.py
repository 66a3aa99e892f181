"""Design, certify, simulate and deploy adaptive controllers, and find out which claims about them are true.

This module offers problems, controllers and the functions that simulate and certify them. The other public names are in modules,
one for each subject:

plants      actuators, sensors and faults around a plant, labels, known sets
regressors  regressors, which the unknown parameters multiply
signals     commands, disturbances and recorded data
laws        adaptive laws and their modifications
solvers     integration methods
systems     linear systems, their margins and norms
designs     linear robust controller designs
results     the results of simulations and certificates
studies     sweeps, tuning, contests, margins found by simulation, explorers
exports     controllers as source code for flight computers and as FMUs
flights     controllers flown on flight models through failures
interfaces  the protocols that a controller or law of your own implements
testing     checks for a controller or law of your own

Each name is imported when it is first used, so ``import barbalat`` is fast.
"""

from barbalat.public_names import public

__version__ = "0.1.0"
__getattr__, __dir__, __all__ = public(__name__)
