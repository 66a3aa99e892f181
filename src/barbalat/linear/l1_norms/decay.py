"""Foundations in ball arithmetic: floats rounded outward, exact spectra, verified decay certificates.

Every quantity that enters a bound is an Arb ball (python-flint); plain floats only determine choices
(step sizes, precision, iteration counts) whose results are verified in ball arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import cast

import numpy as np
from flint import acb, arb, arb_mat, ctx, fmpz_mat
from numpy.typing import NDArray

FloatMatrix = NDArray[np.float64]

# Number of bits with which the sign of a real part is first determined, and the largest number that is tried. An eigenvalue of a
# float64 matrix this close to the axis (2^-4096 relative) counts as being on it.
_SPECTRUM_BITS = 64
_SPECTRUM_BITS_LIMIT = 4096
# Number of bits of the largest entry in units of the last bit of the smallest entry: 160 if the entries differ by a factor of
# 1e30. The roots of a cubic whose coefficients have 800 bits take eight seconds.
_WIDEST_ENTRIES = 400


@dataclass(frozen=True)
class ScaledSystem:
    """Exact balls of a system in rescaled states and time. Transfer gain and L1 norm are unchanged.

    A (n, n), B (n, m), C (p, n); `time_exponent` is the k for which one unit of time is 2^-k s.
    """

    A: arb_mat
    B: arb_mat
    C: arb_mat
    time_exponent: int


def scaled(A: FloatMatrix, B: FloatMatrix, C: FloatMatrix) -> ScaledSystem:
    """Return the system (A (n, n), B (n, m), C (p, n)) with states and time rescaled by powers of two.

    The states follow LAPACK's gebal (Parlett and Reinsch 1969); time is scaled so that A has entries about 1, which keeps all
    floats that steer the computation in range. The product by a power of two is exact in Arb, so the result is exactly the given
    system. Integral norms keep their value: A and B are both divided by 2^k.
    """
    from scipy.linalg.lapack import dgebal

    n, m, p = A.shape[0], B.shape[1], C.shape[0]
    # gebal scales by powers of two. Any other scale is reduced to a power of two, so that exactness does not depend on gebal.
    _, _, _, scaling, _ = dgebal(A, scale=1, permute=0)
    exponents = [math.frexp(float(scale))[1] - 1 for scale in scaling]
    rows = A.tolist()
    shifts = [math.frexp(rows[i][j])[1] + exponents[j] - exponents[i] for i in range(n) for j in range(n) if rows[i][j]]
    time = max(shifts)
    up = [arb(2) ** exponent for exponent in exponents]
    down = [arb(2) ** -(exponent + time) for exponent in exponents]
    return ScaledSystem(
        arb_mat(n, n, [arb(rows[i][j]) * up[j] * down[i] for i in range(n) for j in range(n)]),
        arb_mat(n, m, [arb(value) * down[i] for i, row in enumerate(B.tolist()) for value in row]),
        arb_mat(p, n, [arb(value) * up[j] for row in C.tolist() for j, value in enumerate(row)]),
        time,
    )


def eigenvalues(A: FloatMatrix) -> list[tuple[acb, int]]:
    """Return disjoint enclosures of the eigenvalues of A (n, n), 1/s, each with its multiplicity.

    The characteristic polynomial of the float64 matrix is computed exactly over the integers, so repeated and
    defective eigenvalues are recognised exactly (square-free factorisation, arb_fmpz_poly_complex_roots).
    """
    return list(_eigenvalues(tuple(A.ravel().tolist()), ctx.prec))


@lru_cache(maxsize=64)  # cached: the norms of one system share it, and it may take seconds
def _eigenvalues(entries: tuple[float, ...], precision: int) -> tuple[tuple[acb, int], ...]:
    """Return enclosures, at a precision in bits, of the eigenvalues of a matrix given row by row."""
    n = math.isqrt(len(entries))
    fractions = [value.as_integer_ratio() for value in entries]
    denominator = max(bottom for _, bottom in fractions)  # the power of two that divides all others
    bits = max(abs(top) * (denominator // bottom) for top, bottom in fractions).bit_length()
    if n > 2 and bits > _WIDEST_ENTRIES:
        raise ArithmeticError(
            f"the eigenvalues of a {n} x {n} matrix are computed only if its entries together fit into {_WIDEST_ENTRIES} bits, "
            f"got {bits}: their magnitudes are too far apart"
        )
    integers = fmpz_mat(n, n, [top * (denominator // bottom) for top, bottom in fractions])
    # The stub of python-flint 0.9 types the (root, multiplicity) pairs as single roots.
    with ctx.workprec(precision):
        roots = cast("list[tuple[acb, int]]", integers.charpoly().complex_roots())
        scale = arb(denominator)
        return tuple((acb(root) / scale, int(multiplicity)) for root, multiplicity in roots)


def require_hurwitz(A: FloatMatrix) -> None:
    """Raise ValueError unless every eigenvalue of A (n, n) certainly has a negative real part."""
    bits = _SPECTRUM_BITS
    while True:
        with ctx.workprec(bits):
            real_parts = [root.real for root, _ in eigenvalues(A)]
            if all(part < 0 for part in real_parts):
                return
            largest = max(real_parts, key=lambda part: float(part.mid()))
            unstable = any(part >= 0 for part in real_parts)
            quoted = float(largest.mid())
        if unstable or bits >= _SPECTRUM_BITS_LIMIT:
            raise ValueError(
                f"the L1 norm requires a matrix A that is certainly Hurwitz, but the largest real part is {quoted:.6g}"
            )
        bits *= 2


@dataclass(frozen=True)
class DecayCertificate:
    """Verified quadratic form P with |C e^(As) x|, weighted by e^(rate s), bounded in L2 by sqrt(x'Px).

    P is positive definite and A'P + PA + 2 rate P + C'C <= 0 in ball arithmetic. Integrating the derivative
    of e^(2 rate s) x(s)'P x(s) along x(s) = e^(As) x gives, for every row c of C (p, n),
    integral_0^inf e^(2 rate s) (c x(s))^2 ds <= x'Px, and norm(x(s)) <= e^(-rate s) norm(x). The existence of
    P proves that A is Hurwitz with all real parts <= -rate (Khalil, Nonlinear Systems, Theorem 4.6).
    """

    rate: arb
    factor: arb_mat  # upper triangular R with R'R = P, (n, n)

    def norm(self, x: arb_mat) -> arb:
        """Return an upper bound on sqrt(x'Px) for the column x (n, 1)."""
        return euclidean_norm(self.factor * x)

    def tail(self, norm: arb) -> arb:
        """Return the bound norm / sqrt(2 rate) on integral_0^inf |c e^(As) x| ds (Cauchy-Schwarz)."""
        return norm / (2 * self.rate).sqrt()


def decay_certificate(A: arb_mat, C: arb_mat, spectrum: Sequence[complex], rate: float) -> DecayCertificate | None:
    """Return a verified certificate for A (n, n), C (p, n) at the rate (1/s), None if this precision is insufficient.

    `spectrum` holds approximate eigenvalues of A, which only steer the iteration. P is found by Smith's
    doubling of the Cayley transform (R. A. Smith, SIAM J. Appl. Math. 16, 1968), then verified.
    """
    n = A.nrows()
    shifted = A + identity(n) * arb(rate)
    # C'C alone may be singular; the added multiple of I makes P definite and absorbs the rounding of P. With a third of the
    # digits, it is far below C'C and far above the rounding errors.
    gram = C.transpose() * C
    largest = max((abs(gram[i, i]) for i in range(n)), key=float).upper()
    slack = (largest if largest > 0 else arb(1)) * arb(2) ** (-(ctx.prec // 3))
    weight = gram + identity(n) * slack
    P = _approximate_lyapunov(shifted, weight, [value + rate for value in spectrum])
    if P is None:
        return None
    product = shifted.transpose() * P
    margin = -(product + product.transpose()) - gram
    factor = _cholesky(P)
    if factor is None or not _diagonally_dominant(margin):
        return None
    return DecayCertificate(arb(rate), factor)


def euclidean_norm(x: arb_mat) -> arb:
    """Return an upper bound on the Euclidean norm of the column x (n, 1)."""
    # The square of a ball around 0 extends below 0, where the root is undefined; only its upper end counts.
    return (x.transpose() * x)[0, 0].upper().sqrt().upper()


def identity(n: int) -> arb_mat:
    """Return the exact identity matrix (n, n)."""
    return arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def _approximate_lyapunov(M: arb_mat, weight: arb_mat, spectrum: Sequence[complex]) -> arb_mat | None:
    """Return an approximate symmetric solution P of M'P + PM = -weight, None if the method breaks down."""
    shift = math.sqrt(min(abs(value) for value in spectrum)) * math.sqrt(max(abs(value) for value in spectrum))
    if not (0.0 < shift < math.inf) or any(value.real >= 0.0 for value in spectrum):
        return None
    unit = identity(M.nrows()) * arb(shift)
    try:
        inverse = (unit - M).inv().mid()
    except ZeroDivisionError:  # not invertible at this precision, which the caller then increases
        return None
    transition = (inverse * (unit + M)).mid()
    P = (inverse.transpose() * weight * inverse * arb(2 * shift)).mid()
    for _ in range(_doublings([value / shift for value in spectrum])):
        P = (P + transition.transpose() * P * transition).mid()
        transition = (transition * transition).mid()
    P = ((P + P.transpose()) * arb(0.5)).mid()
    return P if all(entry.is_finite() for entry in P.entries()) else None


def _doublings(spectrum: Sequence[complex]) -> int:
    """Return the number of squarings of the Cayley transform after which its powers vanish at the working precision."""
    # -2 ln|(1 + z)/(1 - z)| = -ln(1 + 4 Re z/|1 - z|^2), for each eigenvalue z of M scaled by the shift
    decays = [-0.5 * math.log1p(max(4.0 * z.real / abs(1.0 - z) ** 2, -1.0 + 2.0**-52)) for z in spectrum]
    slowest = max(min(decays), 2.0**-1000)
    # Three more squarings leave room for the transient growth of defective blocks.
    return max(1, math.ceil(math.log2(ctx.prec * math.log(2.0)) - math.log2(slowest))) + 3


def _diagonally_dominant(matrix: arb_mat) -> bool:
    """Whether a symmetric matrix is certainly positive definite by Gershgorin's discs."""
    n = matrix.nrows()
    for i, row in enumerate(matrix.tolist()):
        off_diagonal = sum((abs(row[j]) for j in range(n) if j != i), arb(0))
        if not row[i] > off_diagonal:
            return False
    return True


def _cholesky(P: arb_mat) -> arb_mat | None:
    """Return upper triangular R with R'R = P (n, n), None unless every pivot is certainly positive."""
    n = P.nrows()
    rows = P.tolist()
    factor: list[list[arb]] = []
    for i in range(n):
        pivot = rows[i][i]
        if not pivot > 0:
            return None
        scale = pivot.rsqrt()
        factor.append([arb(0)] * i + [rows[i][j] * scale for j in range(i, n)])
        top = factor[i]
        for j in range(i + 1, n):
            for k in range(j, n):
                rows[j][k] -= top[j] * top[k]
    return arb_mat(factor)
