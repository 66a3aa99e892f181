"""From a closed loop to a result: the time grid, the compiled step, the time loop, metrics, ensembles."""
