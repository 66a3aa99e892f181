"""What a slider is called in a page: its symbol, indices counted from 1, its unit, and the table in which it stands."""

from __future__ import annotations

from barbalat.open_numbers.path import FieldPath, Key

SYMBOLS = {
    "gamma": ("Γ", ""), "kappa": ("κ", "s"), "tau": ("τ", "s"), "theta": ("θ", ""), "x0": ("x(0)", ""), "k_0": ("k₀", ""),
    "amplitude": ("amplitude", ""), "frequency": ("frequency", "rad/s"), "phase": ("phase", "rad"), "t_end": ("horizon", "s"),
    "dt": ("step h", "s"), "c_0": ("c₀", ""), "covariance0": ("P(0)", ""), "alpha_0": ("α₀", ""), "delta_0": ("δ₀", "1/s"),
    "theta_hat0": ("θ̂(0)", ""), "sigma": ("σ", ""), "A_m": ("A_m", ""), "b": ("b", ""), "delay": ("delay", "s"),
    "gain": ("input gain", ""), "start": ("start", "s"), "sigma_bound": ("σ bound", ""), "lower": ("least", ""),
    "upper": ("greatest", ""), "input_gain": ("input gain", ""), "g_0": ("dead zone g₀", ""), "c_0_min": ("least c₀", ""),
    "frequencies": ("frequency", "rad/s"), "amplitudes": ("amplitude", ""), "rate_limit": ("rate limit", "1/s"),
    "lag": ("sensor lag", "s"), "std": ("noise, standard deviation", ""),
}  # fmt: skip
"""Symbol and unit by a number's key, where the key alone does not say it."""


def label(path: FieldPath) -> str:
    """Symbol, indices counted from 1, and unit."""
    keys = [key for key in path.keys if isinstance(key, str)]
    symbol, unit = SYMBOLS.get(keys[-1], (keys[-1].replace("_", " "), ""))
    if keys[-1] in ("num", "den"):
        symbol = f"{keys[-2].replace('_', ' ')} {keys[-1]}"
    places = ",".join(str(int(index) + 1) for index in path.keys[len(path.vector) :])
    return symbol + (f" [{places}]" if places else "") + (f", {unit}" if unit else "")


def group(path: FieldPath) -> tuple[Key, ...]:
    """The table that it stands in: a controller's keys are ("controller", i)."""
    first = path.keys[0]
    return path.keys[:2] if first in ("controller", "reference") and isinstance(path.keys[1], int) else (first,)
