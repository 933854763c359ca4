r"""Gaussian process regression, with the kernels and gradients that the dynamical model shares.

The kernel is :math:`k(a, b) = s\,e^{-w |a - b|^2 / 2} + l\,a \cdot b + \delta_{ab} n`, with l = 0 for
plain regression; its parameters are kept as logarithms. C. Rasmussen, C. Williams, *Gaussian
Processes for Machine Learning*, 2006: eqs. 2.25, 2.26 (prediction), 5.9 (gradient of the evidence).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

Array = NDArray[np.float64]

_LOG_BOUNDS = (-12.0, 12.0)
"""Bound of the logarithms of kernel parameters: beyond it covariances are not invertible."""


def square_distances(a: Array, b: Array) -> Array:
    """Squared distances of rows, (N, d) and (M, d) to (N, M)."""
    d = np.einsum("nd,nd->n", a, a)[:, None] + np.einsum("md,md->m", b, b) - 2.0 * a @ b.T
    return np.asarray(np.maximum(d, 0.0))


@dataclass(frozen=True)
class Kernel:
    """Logarithms of a kernel's parameters.

    Attributes
    ----------
    signal, width, noise : float
        s, w and n.
    linear : float or None
        l; None for a kernel without the linear part.
    """

    signal: float
    width: float
    noise: float
    linear: float | None = None

    def between(self, a: Array, b: Array) -> Array:
        """Covariance (N, M) of different points, without noise."""
        k: Array = np.exp(self.signal - 0.5 * np.exp(self.width) * square_distances(a, b))
        return k if self.linear is None else k + np.exp(self.linear) * (a @ b.T)

    def of(self, a: Array, floor: float = 0.0) -> Array:
        """Covariance (N, N) of a set with itself, noise and a floor on it included."""
        return self.between(a, a) + (np.exp(self.noise) + floor) * np.eye(len(a))

    def variance(self, a: Array) -> Array:
        """Prior variance (N,) without noise."""
        base = np.full(len(a), np.exp(self.signal))
        return base if self.linear is None else base + np.exp(self.linear) * np.einsum("nd,nd->n", a, a)

    def as_array(self) -> Array:
        """Parameters in one array: signal, width, noise and, where there is one, linear."""
        own = [self.signal, self.width, self.noise]
        return np.array(own if self.linear is None else [*own, self.linear])

    @classmethod
    def from_array(cls, values: Array) -> Kernel:
        """Inverse of `as_array`."""
        return cls(*(float(v) for v in values))


@dataclass(frozen=True)
class Evidence:
    """Minus the logarithm of a marginal likelihood and its gradients.

    Attributes
    ----------
    value : float
    inputs : (N, d) float64
        Gradient by the inputs.
    parameters : (3,) or (4,) float64
        Gradient by the kernel's logarithms.
    solved : (N, N) float64
        Inverse covariance.
    """

    value: float
    inputs: Array
    parameters: Array
    solved: Array


def evidence(kernel: Kernel, x: Array, gram: Array, outputs: int, floor: float = 0.0) -> Evidence:
    r"""Evidence of outputs Y, (N, D), of which only ``gram = Y Y'`` is needed.

    :math:`L = \frac{D}{2} \ln |K| + \frac{1}{2} tr(K^{-1} Y Y')`, and
    :math:`dL/dK = \frac{1}{2} (D K^{-1} - K^{-1} Y Y' K^{-1})`.
    """
    n = len(x)
    distances = square_distances(x, x)
    width = np.exp(kernel.width)
    smooth = np.exp(kernel.signal - 0.5 * width * distances)
    noise = float(np.exp(kernel.noise))
    covariance = smooth + (noise + floor) * np.eye(n)
    inner = x @ x.T if kernel.linear is not None else None
    if kernel.linear is not None and inner is not None:
        covariance += np.exp(kernel.linear) * inner
    factor = cho_factor(covariance, lower=True, check_finite=False)
    inverse = cho_solve(factor, np.eye(n), check_finite=False)
    explained = inverse @ gram
    log_det = 2.0 * np.log(np.diag(factor[0])).sum()
    value = 0.5 * outputs * log_det + 0.5 * float(np.trace(explained))
    by_k = 0.5 * (outputs * inverse - explained @ inverse)
    by_k = 0.5 * (by_k + by_k.T)
    pull = by_k * smooth
    # d smooth_ij / d x_i = -w smooth_ij (x_i - x_j), and every pair occurs twice
    inputs = -2.0 * width * (pull.sum(axis=1)[:, None] * x - pull @ x)
    parameters = [pull.sum(), -0.5 * width * float((pull * distances).sum()), noise * float(np.trace(by_k))]
    if kernel.linear is not None and inner is not None:
        linear = float(np.exp(kernel.linear))
        inputs += 2.0 * linear * (by_k @ x)
        parameters.append(linear * float((by_k * inner).sum()))
    return Evidence(float(value), inputs, np.array(parameters), inverse)


@dataclass(frozen=True, eq=False)
class Regression:
    """A Gaussian process from inputs to outputs.

    Attributes
    ----------
    inputs : (N, d) float64
    outputs : (N, D) float64
    kernel : Kernel
    floor : float
        Least noise variance.
    """

    inputs: Array
    outputs: Array
    kernel: Kernel
    floor: float = 0.0

    @cached_property
    def mean(self) -> Array:
        """Mean output, (D,), predicted far from all inputs."""
        return np.asarray(self.outputs.mean(axis=0))

    @cached_property
    def inverse(self) -> Array:
        """Inverse covariance of the inputs, (N, N)."""
        factor = cho_factor(self.kernel.of(self.inputs, self.floor), lower=True)
        return np.asarray(cho_solve(factor, np.eye(len(self.inputs))))

    @cached_property
    def weights(self) -> Array:
        """Coefficients of the kernel values, (N, D)."""
        return np.ascontiguousarray(self.inverse @ (self.outputs - self.mean))

    def predict(self, x: Array) -> Array:
        """Mean outputs (M, D) at inputs (M, d)."""
        return self.predict_from(self.kernel.between(x, self.inputs))

    def predict_from(self, covariance: Array) -> Array:
        """Mean outputs (M, D) where the covariance with the inputs, (M, N), is known already."""
        return np.asarray(covariance @ self.weights + self.mean)

    def variance(self, x: Array) -> Array:
        """Variance (M,) of every output at inputs (M, d), without the noise."""
        k = self.kernel.between(x, self.inputs)
        return np.maximum(self.kernel.variance(x) - np.einsum("mn,mn->m", k @ self.inverse, k), 1e-12)

    def left_out(self) -> Array:
        """Residuals (N, D) of predicting each output from all others (eq. 5.12 of the book)."""
        return np.asarray(self.weights / np.diag(self.inverse)[:, None])


_START_NOISE = 0.05
"""Share of the variance that `learn_regression` attributes to noise at the start. Set by hand."""
_STEPS = 40
"""Maximum number of steps of `learn_regression`. Set by hand."""
_LEAST_NOISE = 1e-6
"""Least noise variance, in units of the outputs' variance. Set by hand."""


def learn_regression(inputs: Array, outputs: Array) -> Regression:
    """Fit the kernel's parameters to the evidence, outputs scaled by one standard deviation.

    Parameters
    ----------
    inputs : (N, d)
    outputs : (N, D)
    """
    centred = outputs - outputs.mean(axis=0)
    scale = max(float(np.sqrt((centred**2).mean())), 1e-12)
    gram = (centred / scale) @ (centred / scale).T
    typical = float(np.median(square_distances(inputs, inputs)))
    start = np.array([0.0, np.log(2.0 / max(typical, 1e-12)), np.log(_START_NOISE)])
    dimensions = outputs.shape[1]

    def cost(p: Array) -> tuple[float, Array]:
        found = evidence(Kernel.from_array(p), inputs, gram, dimensions, _LEAST_NOISE)
        return found.value, found.parameters

    low = start - np.array([6.0, 6.0, 9.0])
    best = minimize(
        cost, start, jac=True, method="L-BFGS-B", bounds=list(zip(low, start + 6.0, strict=True)),
        options={"maxiter": _STEPS},
    ).x  # fmt: skip
    shift = 2.0 * np.log(scale)
    kernel = Kernel(float(best[0] + shift), float(best[1]), float(best[2] + shift))
    return Regression(inputs, outputs, kernel, _LEAST_NOISE * scale**2)
