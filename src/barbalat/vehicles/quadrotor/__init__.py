"""A quadrotor in MuJoCo, with its model, a geometric controller, and the schemes of this project on each of its axes."""
