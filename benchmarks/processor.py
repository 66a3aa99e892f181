"""The processor on which the numbers are measured, also as if it had no AVX-512."""

from __future__ import annotations

import os
import platform
from pathlib import Path

import llvmlite.binding as llvm

from barbalat.lowering.llvm import machine

GCC_TARGET = ["-march=native"]
"""gcc's flags for the processor. ``without_avx512`` appends to them."""

_INFO = Path("/proc/cpuinfo")


def description() -> str:
    """The processor's name, LLVM's name for it, and the registers that the kernels use."""
    with_name = f"{_name()} ({llvm.get_host_cpu_name()}), {os.cpu_count()} cores"
    return f"{with_name}, vector registers: {32 if machine.many_registers() else 16} of {machine.vector_width()} doubles"


def _name() -> str:
    lines = _INFO.read_text().splitlines() if _INFO.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def without_avx512() -> None:
    """Make every contestant compile for 16 registers of 256 bits. Call this before any of them compiles or is imported.

    The kernel reads the host's features from llvmlite, so this function replaces what llvmlite returns.
    """
    features = llvm.get_host_cpu_features()
    for feature in features:
        if feature.startswith(("avx512", "evex512", "avx10")):
            features[feature] = False
    llvm.get_host_cpu_features = lambda: features
    machine.vector_width.cache_clear()
    GCC_TARGET.append("-mno-avx512f")
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_max_isa=AVX2".strip()
    os.environ |= {"NUMBA_CPU_NAME": llvm.get_host_cpu_name(), "NUMBA_CPU_FEATURES": features.flatten()}
