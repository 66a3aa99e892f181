"""Section V's loops as users of other tools write them: from the paper's equations, with nothing of Barbalat."""
