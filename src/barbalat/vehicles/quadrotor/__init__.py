"""A quadrotor in MuJoCo, with our own model of it, a geometric controller, and the project's schemes on each of its axes."""
