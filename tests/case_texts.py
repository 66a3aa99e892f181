"""Case files that several tests vary."""

SECTION_V = """
[plant]
A_m = [[0.0, 1.0], [-0.3, -1.0]]
b = [0.0, 1.0]
theta = [4.0, -3.0]
x0 = [1.0, 1.0]
[reference_model]
k_0 = 4.0
[reference]
kind = "sine"
amplitude = 50.0
frequency = 0.5
[uncertainty]
lower = [-5.0, -5.0]
upper = [5.0, 5.0]
"""
"""The plant, model, command and known set of Section V."""

OWN = """
name = "own"
[plant]
A_m = [[0.0, 1.0], [-1.0, -1.4]]
b = [0.0, 1.0]
theta = [1.0, -0.5]
x0 = [0.1, 0.0]
[reference_model]
k_0 = 1.0
[reference]
kind = "sine"
amplitude = 1.0
frequency = 0.5
[uncertainty]
lower = [-2.0, -2.0]
upper = [2.0, 2.0]
[simulation]
t_end = 2.0
dt = 1e-2
"""
"""A plant of two states for laws of users' own files."""

DRIVE = """
name = "Drive"
[plant]
A_m = [[-2.0]]
b = [1.5]
theta = [1.0]
x0 = [0.3]
[reference_model]
k_0 = 1.3
[reference]
kind = "sine"
amplitude = 1.0
frequency = 1.2
[uncertainty]
lower = [-3.0]
upper = [3.0]
[simulation]
t_end = 4.0
tolerance = 1e-6
[[controller]]
name = "MRAC"
scheme = "mrac"
gamma = 3.0
"""
"""A small drive with a sine command, simulated under MRAC with variable steps."""
