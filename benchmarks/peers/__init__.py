"""Section V's loops as users of other tools write them: from the paper's equations and without Barbalat."""
